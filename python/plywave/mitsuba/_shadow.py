"""Shadows of yarns on their neighbors in Dr.Jit (``src/fabric/shadow.rs``, ``at.rs``)."""

import math

import drjit as dr

from ._kit import clamp, cross3, dot3

TAU = 2.0 * math.pi
# src/fabric/at.rs
NARROW = 0.2
# src/ply/lines.rs
PASSED_ROWS, PASSED_COLUMNS = 16, 65
# src/fabric/shadow.rs
PLACES, ROWS, COLUMNS, OFFSETS, SIZE = 4, 8, 16, 7, 2 * 8 * 16
MOST_SHARE = 1.35
MEAN_Z = [0.017678, 0.082322, 0.175568, 0.290118, 0.422526, 0.570634, 0.732919, 0.908235]
PER_ROW = (MEAN_Z[-1] - MEAN_Z[-2]) / (1.0 - MEAN_Z[-1])


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
        s = (z - kit.take(self.mean_z, at * 2)) * kit.take(self.mean_z, at * 2 + 1)
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
        # At the pole no bend makes lines more.
        s = around[2][1] + around[3][1]
        most = dr.minimum(MOST_SHARE - (MOST_SHARE - 1.0) * PER_ROW * (s - 1.0), MOST_SHARE)
        return [clamp(x * (MOST_SHARE / 255.0), 0.0, most) for x in sums]

    @staticmethod
    def within(free, offset, half):
        half = dr.minimum(half, 1.0)
        center = clamp(offset, half - 1.0, 1.0 - half)
        low, high = (center - half + 1.0) * (0.5 * OFFSETS), (center + half + 1.0) * (0.5 * OFFSETS)
        total = 0.0
        for o, value in enumerate(free):
            total = total + value * dr.maximum(dr.minimum(high, o + 1.0) - dr.maximum(low, float(o)), 0.0)
        return total / dr.maximum(high - low, 1e-6)

    def free(self, hit, model, b, lines, around, counts):
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
        if self.some_one_by_one:
            halves = [NARROW, 1.0 - dr.abs(clear[0]), NARROW]
            shares = [a * b for a, b in zip(shares, self.pass_plies(hit, model, b, zip(lines, halves)))]
        return [dr.select(counts, x, 1.0) for x in shares]

    def pass_plies(self, hit, model, b, exits):
        """What the other plies of a yarn let pass of light that leaves on lines so far from its ply's axis and so wide (src/fabric/shade.rs)."""
        kit, is_warp, z, t = self.kit, hit["is_warp"], hit["frame"][2], hit["yarn_axis"]
        radius = self.of_family("radius", is_warp)
        p = [v / radius for v in hit["off_axis"]]

        def turned(v, c, s):
            w, along = cross3(t, v), (1.0 - c) * dot3(t, v)
            return [c * v[i] + s * w[i] + along * t[i] for i in range(3)]

        x = cross3(b, z)
        per_x = 1.0 / dr.maximum(dr.sqrt(dot3(x, x)), 1e-3)
        exits = [([p[i] - aside * per_x * x[i] + further * z[i] for i in range(3)], half) for (aside, further), half in exits]
        shares = [kit.float(1.0)] * len(exits)
        several = self.of_family("one_by_one", is_warp) > 0.5
        for n, (c, s) in enumerate(self.places_of_plies(is_warp)):
            if n == 0:
                continue
            here = kit.both(several, n < self.of_family("plies", is_warp))
            center, axis = turned(p, c, s), turned(z, c, s)
            across, along = cross3(b, axis), dot3(b, axis)
            sine = dr.maximum(dr.sqrt(dot3(across, across)), 1e-3)
            theta = dr.atan2(along, sine)
            for i, (start, half) in enumerate(exits):
                off = [start[k] - center[k] for k in range(3)]
                is_ahead = kit.both(here, along * dot3(off, axis) > dot3(off, b))
                h = dot3(off, across) / sine
                mean = self.passed_mean(model, theta, (h - half) * radius, (h + half) * radius)
                shares[i] = dr.select(is_ahead, shares[i] * mean, shares[i])
        return shares

    def passed_mean(self, model, theta, low, high):
        """The mean of r_d over offsets from ``low`` to ``high`` (src/ply/lines.rs)."""
        kit = self.kit
        per_h, flip = 1.0 / kit.take(self.passed_h, kit.uint(model)), theta < 0.0
        low, high = dr.select(flip, -high, low) * per_h, dr.select(flip, -low, high) * per_h
        row = dr.minimum(dr.abs(theta) * ((PASSED_ROWS - 1) / (0.5 * math.pi)), PASSED_ROWS - 1.0)
        node = dr.minimum(dr.floor(row), PASSED_ROWS - 2.0)
        first, s = (kit.uint(model) * (PASSED_ROWS - 1) + kit.uint(node)) * (PASSED_COLUMNS - 1), row - node

        def until(h):
            inside = clamp(h, -1.0, 1.0)
            column = (inside + 1.0) * (0.5 * (PASSED_COLUMNS - 1))
            node = dr.minimum(dr.floor(column), PASSED_COLUMNS - 2.0)
            a, b, c, d = kit.packets(self.passed, first + kit.uint(node), 1)
            t = column - node
            x, y = a + t * (b - a), c + t * (d - c)
            return x + s * (y - x) + (h - inside)

        mean = clamp((until(high) - until(low)) / dr.maximum(high - low, 1e-6), 0.0, 1.0)
        return dr.select((low >= 1.0) | (high <= -1.0), 1.0, mean)
