"""A cloth of ply curves in Dr.Jit: its tables on the device, as exported by ``src/cloth/tensors.rs``."""

import drjit as dr
import numpy as np

from ._hairs import Hairs
from ._lines import Lines
from ._tables import Tables

#: Words of a curve: its kind; first position and number of positions in the table of shadows; number of its
#: yarn and the increments of that number from cell to cell; index of the curve.
KIND, FIRST, COUNT, NUMBER, STEP_A, STEP_B, CURVE = range(7)


class Curves(Lines, Tables):
    """Tables and geometry of a cloth on the device."""

    #: Values that identify a hit ply.
    WHERE = ("piece", "cells", "place")

    def __init__(self, kit, tensors):
        Tables.__init__(self, kit, tensors)
        self.top, self.largest = map(float, tensors["scalars"][:2])
        self.twist, self.way = kit.floats(tensors["twist"]), kit.floats(tensors["along"])
        self.options = dict(zip(("speckle", "layers", "shadowing", "edges"), (v > 0.5 for v in tensors["options"])))
        self.along_y = [bool(row[0] > 0.5) for row in tensors["kind"]]
        self.kinds, self.scale = len(self.along_y), [float(row[1]) for row in tensors["kind"]]
        self.per_knot = kit.floats(tensors["places_per_knot"])
        self.dye_mean = [int(dye) for dye in tensors["dye_mean"]]
        self.dyes, self.dye_shares = [], []
        for kind in range(self.kinds):
            yarns = tensors[f"dyes_{kind}"]
            dyes, counts = np.unique(yarns, return_counts=True)
            self.dyes.append((kit.words(yarns), len(yarns)))
            self.dye_shares.append([(int(dye), float(count) / len(yarns)) for dye, count in zip(dyes, counts)])
        self.hairs = Hairs(kit, tensors) if "hair_area" in tensors else None
        self.read_lines(tensors)

    def curve_word(self, curve, which):
        return self.kit.take_word(self.of_curve, curve * 8 + which)

    def kind_of(self, piece):
        """Kind of the yarn of a piece."""
        kit = self.kit
        return kit.uint(0) if self.kinds == 1 else self.curve_word(kit.take_word(self.curve_of_piece, piece), KIND)

    def scale_of(self, kind):
        """Ratio of the radius of the model's ply to that of the curves."""
        return self.scale[0] if self.scale[0] == self.scale[-1] else dr.select(kind == 0, *self.scale)

    def model_of(self, hit):
        """Index of the model of a kind: a constant if there is only one model."""
        return 0 if self.models == 1 else hit["kind"]

    def ply_radius(self, hit):
        """Radius of the hit ply according to its model [um]."""
        return hit["radius"] * self.scale_of(hit["kind"])

    def number_of(self, hit, corner):
        """Number of the yarn that a line of a cell hits, modulo 2^32."""
        kit, curve = self.kit, hit["curve"]
        i, j = (kit.uint(c + o) for c, o in zip(hit["cells"], corner))
        return self.curve_word(curve, NUMBER) + self.curve_word(curve, STEP_A) * i + self.curve_word(curve, STEP_B) * j

    def dye_of(self, kind, hit, corner):
        """Index of the color of the yarn that a line of a cell hits."""
        kit, (dyes, count) = self.kit, self.dyes[kind]
        number = kit.int(self.number_of(hit, corner)) if kit.jit else _signed(self.number_of(hit, corner))
        # The magnitude of ``number`` must stay below 2^30.
        return kit.take_word(dyes, kit.uint((number % count + count) % count))

    def place_on(self, hit, corner, wo, footprint_um):
        """Position at which light towards ``wo`` leaves a ply (``ClothModel::place``): the ply's number, the viewer's
        azimuth among its fibers, the position along it and the footprint [um].
        """
        kit, curve, (x, y, z) = self.kit, hit["curve"], hit["frame"][2]
        ply = self.number_of(hit, corner) * 64 + curve
        up = wo[2] - z * (wo[0] * x + wo[1] * y + wo[2] * z)
        azimuth = dr.atan2(y * wo[0] - x * wo[1], up) - kit.take(self.twist, curve) * hit["parameter"]
        i, j = (kit.float(kit.int(c + o)) for c, o in zip(hit["cells"], corner))
        step, a, b = (kit.take(self.way, curve * 3 + k) for k in range(3))
        return ply if kit.jit else ply & 0xFFFFFFFF, azimuth, step * hit["parameter"] + (a * i + b * j), footprint_um

    # Shadows

    def shadow_rows(self, hit, s):
        """Two rows of the table of shadows and their weights, for light that leaves ``s`` radii further along the ply."""
        kit, curve = self.kit, hit["curve"]
        per_knot = kit.take(self.per_knot, curve)
        x = (hit["parameter"] + s * hit["radius"] / dr.maximum(hit["speed"], 1e-6)) * per_knot
        whole, place = kit.floor(x)
        # In inactive lanes the count reads 0.
        first, count = self.curve_word(curve, FIRST), dr.maximum(self.curve_word(curve, COUNT), 1)
        # The position stays within 2^12 periods of the first one.
        own = lambda place: first + kit.uint(place + kit.int(count) * (1 << 12)) % count
        row = own if self.shadow_table is None else lambda place: kit.take_word(self.shadow_table, own(place))
        return [(row(place), 1.0 - (x - whole)), (row(place + 1), x - whole)]


def _signed(word):
    """A word as a signed number."""
    word = int(word) & 0xFFFFFFFF
    return word - (1 << 32) if word >> 31 else word
