"""The plugin ``plywave_fabric``."""

import drjit as dr
import mitsuba as mi
import numpy as np

from . import _native, _surface, _walk
from ._base import typed
from ._cloth import Cloth
from ._far import Far
from ._gaps import Gaps, Slits
from ._speckle import Speckle


def define(Surface):
    """The plugin's class for the current variant."""

    class Fabric(Surface):
        """``plywave_fabric``: a woven fabric on a surface with uv."""

        PLUGIN, ALONG = "plywave_fabric", "along whose u the weft runs"
        FLAGS = {"layers": True, "shadowing": True, "edges": True, "slits": True, "speckle": False, "far": False}
        KEYS = _surface.KEYS | set(FLAGS) | {"spec", "folder", "gaps"}
        KEYS |= {f"{family}_{what}" for family in ("warp", "weft") for what in ("color", "sigma_per_um")}
        yarns = ("warp_", "weft_")

        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            name = self.PLUGIN
            on, kit = self.begin(props), self.kit
            filename, text = (typed(name, props, key, str, None) for key in ("filename", "spec"))
            if (filename is None) == (text is None):
                raise ValueError(f"{name}: filename: give one of 'filename', a fabric's spec (.toml), and 'spec', its text")
            folder = typed(name, props, "folder", str, ".")
            gaps = self.gaps_of(props)
            if filename is not None:
                filename = str(mi.file_resolver().resolve(filename))
            tables = _native.FabricTables(filename, text, folder, gaps == "diffracted", **on)
            tensors = tables.tensors()
            self.cloth = Cloth(kit, tensors)
            self.gaps = Gaps(kit, tensors["apertures"], self.cloth.edge_step) if gaps == "diffracted" else None
            self.slits = Slits(kit, tensors["slit_share"], tensors["slits"]) if tensors["slits"].size else None
            self.speckle = Speckle(kit, tensors["noise"]) if on["speckle"] else None
            if self.speckle is not None and not self.speckle.some:
                raise ValueError(f"{name}: speckle: true: no model of the fabric has speckle noise; add it with `plywave noise`")
            self.far = Far(kit, tensors, self.cloth, (True, False)) if on["far"] else None
            # By family, each dye and its share of the threads.
            self.dye_shares = []
            for threads in self.cloth.dyes:
                dyes, counts = np.unique(threads, return_counts=True)
                self.dye_shares.append([(int(dye), float(count) / len(threads)) for dye, count in zip(dyes, counts)])
            self.repeat_um = tables.repeat_um()
            self.longest_um = max(self.repeat_um)
            self.finish(props, on, (tensors["dye_rgb"], tensors["dye_spectrum"]))

        walk = _walk.walk

        def mean_at(self, si, own, wo):
            """The mean over the repeat seen from ``wo``, of the colors that the point has."""
            colors = []
            for k in range(2):
                if own[k] is not None:
                    colors.append([(1.0, own[k])])
                else:
                    colors.append([(share, self.dye(si, self.kit.uint(dye))) for dye, share in self.dye_shares[k]])
            return self.far.at(wo, colors, self.gaps)

        def own_sigmas(self, si, active):
            """Absorptions of warp and weft at a point, where all their yarns have the same."""
            kit, cloth, own = self.kit, self.cloth, []
            for k in range(2):
                if self.sigmas[k] is not None:
                    own.append(dr.maximum(self.sigmas[k].eval(si, active), 0.0))
                elif self.colors[k] is not None:
                    own.append(self.sigma_of_color(self.colors[k].eval(si, active)))
                elif cloth.lists["dyes"][k] is None:
                    own.append(self.dye(si, kit.uint(int(cloth.dyes[k][0]))))
                else:
                    own.append(None)
            return own

        def sigma_of(self, si, own, hit, _=None):
            """Absorptions of the yarn that a line meets."""
            kit, is_warp, yarn = self.kit, hit["is_warp"], hit["yarn"]
            if own[0] is not None and own[1] is not None:
                return dr.select(is_warp, own[0], own[1])
            dyed = self.dye(si, self.cloth.entry("dyes", is_warp, yarn))
            for k in range(2):
                if own[k] is not None:
                    dyed = dr.select(is_warp if k == 0 else kit.no(is_warp), own[k], dyed)
            return dyed

        def slit_of(self, si, hit, _):
            """The slit of a ply that a line comes near, of a cloth with slits."""
            return None if self.slits is None else self.slits.at(hit["is_warp"], hit["is_double"], self.lambda_um(si))

        def to_string(self):
            return f"plywave_fabric[repeat = {self.repeat_um} um, um_per_uv = {self.um_per_uv}]"

    return Fabric
