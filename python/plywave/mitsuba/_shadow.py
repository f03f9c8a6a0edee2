"""Shadows of yarns on their neighbors in Dr.Jit (``src/fabric/shadow.rs``, ``at.rs``)."""

import math

import drjit as dr

from ._kit import clamp, cross3, dot3

TAU = 2.0 * math.pi
# src/fabric/at.rs
NARROW = 0.2
# src/fabric/shadow.rs
PLACES, ROWS, COLUMNS, OFFSETS, SIZE = 4, 8, 16, 7, 2 * 8 * 16
MEAN_Z = [0.017678, 0.082322, 0.175568, 0.290118, 0.422526, 0.570634, 0.732919, 0.908235]


def two_thirds(z):
    root = dr.sqrt(z)
    c = 0.4 + 0.6 * root
    for _ in range(2):
        c = c - (c * c * c - root) / (3.0 * c * c)
    return c * c * c * c


class Shadows:
    """Chances that light of a ply gets out of the cloth. The tables are those of ``Cloth``."""

    def shadow_row(self, hit, place):
        kit = self.kit
        is_warp = hit["is_warp"]
        if self.patterns is None:
            ends, picks = self.ends, self.picks
            warp = self.modulo(hit["yarn"], ends) * (PLACES * picks) + self.modulo(place, PLACES * picks)
            weft = PLACES * ends * picks + self.modulo(hit["yarn"], picks) * (PLACES * ends) + self.modulo(place, PLACES * ends)
            return dr.select(is_warp, warp, weft)
        crossing, phase = (place >> 2, kit.uint(place & 3))
        bits = kit.uint(0)
        before, behind = (self.sides(is_warp, hit["yarn"], crossing + c) for c in (-1, 1))
        for n in range(3):
            yarn = ((before >> (2 * n)) & 1) * 4 + ((before >> (2 * n + 1)) & 1) * 2 + ((behind >> (2 * n)) & 1)
            bits = bits * 8 + yarn
        family = dr.select(is_warp, kit.uint(0), kit.uint(1))
        return kit.take_word(self.patterns, (family * PLACES + phase) * 512 + bits)

    def shadow_direction(self, b):
        """Rows and columns of the table around a direction and their weights."""
        kit = self.kit
        z = dr.minimum(dr.abs(b[2]), 1.0)
        r = dr.minimum(dr.floor(dr.maximum(dr.minimum(two_thirds(z) * ROWS, float(ROWS)) - 0.5, 0.0)), ROWS - 2.0)
        at = kit.uint(r)
        s = dr.minimum((z - kit.take(self.mean_z, at * 2)) * kit.take(self.mean_z, at * 2 + 1), 1.0)
        column = (dr.atan2(b[1], b[0]) * (1.0 / TAU) + 1.0) * COLUMNS - 0.5
        c = dr.floor(column)
        t = column - c
        c0 = kit.uint(c) % COLUMNS
        c1 = (c0 + 1) % COLUMNS
        row = at + dr.select(b[2] < 0.0, kit.uint(ROWS), kit.uint(0))
        return [
            (row * COLUMNS + c0, (1.0 - s) * (1.0 - t)),
            (row * COLUMNS + c1, (1.0 - s) * t),
            (row * COLUMNS + COLUMNS + c0, s * (1.0 - t)),
            (row * COLUMNS + COLUMNS + c1, s * t),
        ]

    def free_at(self, hit, s, around):
        """Chances of being free at the offsets, of light that leaves ``s`` radii further along the ply."""
        kit, is_warp = self.kit, hit["is_warp"]
        per_radius = self.of_family("radius", is_warp) * dr.select(is_warp, hit["frame"][2][1], hit["frame"][2][0])
        x = (hit["along"] + s * per_radius) * (self.other_family("per_spacing", is_warp) * PLACES)
        whole, place = kit.floor(x)
        between = x - whole
        sums = [0.0] * OFFSETS
        for at, weight in ((place, 1.0 - between), (place + 1, between)):
            row = self.shadow_row(hit, at) * SIZE
            for entry, w in around:
                low, high = kit.word_pair(self.free_table, row + entry)
                w = w * weight
                for o in range(OFFSETS):
                    word = low if o < 4 else high
                    sums[o] = sums[o] + w * kit.float(kit.int((word >> (8 * (o % 4))) & 255))
        return [dr.maximum(x * (1.0 / 255.0), 0.0) for x in sums]

    @staticmethod
    def within(free, offset, half):
        half = dr.minimum(half, 1.0)
        center = clamp(offset, half - 1.0, 1.0 - half)
        low, high = (center - half + 1.0) * (0.5 * OFFSETS), (center + half + 1.0) * (0.5 * OFFSETS)
        total = 0.0
        for o, value in enumerate(free):
            total = total + value * dr.maximum(dr.minimum(high, o + 1.0) - dr.maximum(low, float(o)), 0.0)
        return total / dr.maximum(high - low, 1e-6)

    def free(self, hit, b, lines, around, counts):
        """Shares of single reflection, of other light of clear fibers and of dark ones that get out in direction ``b``."""
        is_warp = hit["is_warp"]
        refl, clear, dark = lines
        scale = self.of_family("radius", is_warp) / self.of_family("half_width", is_warp)
        off = further = 0.0
        if self.most_plies > 1:
            z, radius = hit["frame"][2], self.of_family("radius", is_warp)
            p = [v / radius for v in hit["off_axis"]]
            bz = dot3(b, z)
            per_sine = dr.rsqrt(dr.maximum(1.0 - bz * bz, 0.02))
            off = dot3(p, cross3(b, z)) * per_sine
            further = -(dot3(p, b) - bz * dot3(p, z)) * bz * per_sine * per_sine
        narrow = self.free_at(hit, 0.5 * (refl[1] + dark[1]) + further, around)
        wide = self.free_at(hit, clear[1] + further, around)
        at = lambda t: (off - t) * scale
        shares = [
            self.within(narrow, at(refl[0]), NARROW * scale),
            self.within(wide, at(clear[0]), (1.0 - dr.abs(clear[0])) * scale),
            self.within(narrow, at(dark[0]), NARROW * scale),
        ]
        return [dr.select(counts, x, 1.0) for x in shares]
