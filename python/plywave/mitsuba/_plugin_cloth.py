"""The plugin ``plywave_cloth``."""

import drjit as dr
import mitsuba as mi

from . import _native, _surface, _through
from ._base import typed
from ._curves import Curves
from ._far import Far
from ._gaps import Gaps, Slits
from ._speckle import Speckle

YARNS = ("warp_", "weft_")
COLORS = ("color", "sigma_per_um")


def define(Surface):
    """The plugin's class for the current variant."""

    class Cloth(Surface):
        """``plywave_cloth``: a cloth on a surface with uv."""

        PLUGIN, ALONG = "plywave_cloth", "along whose u the cloth's x runs"
        FLAGS = {"layers": True, "shadowing": True, "edges": True, "slits": True, "speckle": False, "far": False}
        KEYS = _surface.KEYS | set(FLAGS) | {"gaps"} | {f"{yarn}{what}" for yarn in ("", *YARNS) for what in COLORS}

        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            name = self.PLUGIN
            on, kit = self.begin(props), self.kit
            filename = typed(name, props, "filename", str, None)
            if filename is None:
                raise ValueError(f"{name}: filename: give a cloth file (.pwc), made with `plywave weave SPEC -o CLOTH.pwc`, or a cloth spec (.toml)")
            gaps = self.gaps_of(props)
            tables = _native.ClothTables(str(mi.file_resolver().resolve(filename)), gaps == "diffracted", **on)
            for note in tables.notes():
                mi.Log(mi.LogLevel.Info, f"{name}: {note}")
            tensors = tables.tensors()
            self.cloth = Curves(kit, tensors)
            self.gaps = Gaps(kit, tensors["apertures"], float(tensors["gap"][1])) if gaps == "diffracted" else None
            self.slits = Slits(kit, tensors["slit_share"], tensors["slits"]) if tensors["slits"].size else None
            self.speckle = Speckle(kit, tensors["noise"]) if on["speckle"] else None
            if self.speckle is not None and not self.speckle.some:
                raise ValueError(f"{name}: speckle: true: no model of the cloth has speckle noise; add it with `plywave noise`")
            if on["far"] and "far_f" not in tensors:
                raise ValueError(f"{name}: far: true: the cloth file has no far view: make it anew with `plywave weave`")
            self.far = Far(kit, tensors, self.cloth, self.cloth.along_y) if on["far"] else None
            self.longest_um = max((a * a + b * b) ** 0.5 for a, b in self.cloth.cell)
            self.yarns = YARNS[: self.cloth.kinds] if self.cloth.kinds > 1 else ("",)
            if self.cloth.kinds == 1:
                for key in (f"{yarn}{what}" for yarn in YARNS for what in COLORS):
                    if key in props:
                        raise ValueError(f"{name}: {key}: all yarns of this cloth are alike: use '{key.split('_', 1)[1]}'")
            self.finish(props, on, (tensors["dye_rgb"], tensors["dye_spectrum"]))

        walk = _through.walk

        def mean_at(self, si, own, wo):
            """The mean over the cell seen from ``wo``, of the colors that the point has."""
            shares = self.cloth.dye_shares
            dyed = lambda kind: [(share, self.dye(si, self.kit.uint(dye))) for dye, share in shares[kind]]
            return self.far.at(wo, [dyed(kind) if sigma is None else [(1.0, sigma)] for kind, sigma in enumerate(own)], self.gaps)

        def own_sigmas(self, si, active):
            """Absorptions of the kinds of yarns at a point, where all of a kind have the same."""
            kit, own = self.kit, []
            for kind, (color, sigma) in enumerate(zip(self.colors, self.sigmas)):
                if sigma is not None:
                    own.append(dr.maximum(sigma.eval(si, active), 0.0))
                elif color is not None:
                    own.append(self.sigma_of_color(color.eval(si, active)))
                elif len(self.cloth.dye_shares[kind]) > 1:
                    own.append(None)
                else:
                    own.append(self.dye(si, kit.uint(self.cloth.dye_mean[kind])))
            return own

        def sigma_of(self, si, own, hit, corner):
            """Absorptions of the yarn that a line hits, whose numbers are those of the cell ``corner``."""
            sigmas = [self.dye(si, self.cloth.dye_of(kind, hit, corner)) if sigma is None else sigma for kind, sigma in enumerate(own)]
            return sigmas[0] if len(own) == 1 else dr.select(hit["kind"] == 0, *sigmas)

        def slit_of(self, si, hit, at):
            """The slit of a ply that a line hits, of a cloth with slits."""
            return None if self.slits is None else self.slits.at(hit["kind"] == 0, at["is_double"], self.lambda_um(si))

        def to_string(self):
            return f"plywave_cloth[cell = {self.cloth.cell} um, um_per_uv = {self.um_per_uv}]"

    return Cloth
