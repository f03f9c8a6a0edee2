"""Shadows of yarns on their neighbors in Dr.Jit (``src/fabric/shadow.rs``, ``at.rs``)."""

import math

import drjit as dr

from ._kit import clamp, cross3, dot3

TAU = 2.0 * math.pi
# src/fabric/shade.rs
PARTS, MIN_SHARE = 6, 2e-3
# src/ply/data/exits.rs
EXIT_KINDS, MEANS, MAX_MEAN = 3, 65, 0.97
# src/ply/lines.rs
PASSED_ROWS, PASSED_COLUMNS = 16, 65
# src/fabric/shadow.rs
PLACES, BANDS, COLUMNS, OFFSETS = (4, 8), 8, 16, 7
ROWS = BANDS + 1
SIZE = 2 * ROWS * COLUMNS
MAX_SHARE = 1.35
MEAN_Z = [0.017678, 0.082322, 0.175568, 0.290118, 0.422526, 0.570634, 0.732919, 0.908235]
PER_SQUARED_SINE = 1.0 / (1.0 - MEAN_Z[-1] ** 2)


def two_thirds(z):
    root = dr.sqrt(z)
    c = 0.4 + 0.6 * root
    for _ in range(2):
        c = c - (c * c * c - root) / (3.0 * c * c)
    return c * c * c * c


class Shadows:
    """Chances that light of a ply gets out of the cloth. The tables are those of ``Cloth``."""

    def shadow_rows(self, hit, s):
        """Two rows of the table and their shares, of light that leaves ``s`` radii further along the ply."""
        is_warp = hit["is_warp"]
        per_radius = self.of_family("radius", is_warp) * dr.select(is_warp, hit["frame"][2][1], hit["frame"][2][0])
        x = (hit["along"] + s * per_radius) * self.of_family("places_per_um", is_warp)
        whole, place = self.kit.floor(x)
        return [(self.shadow_row(hit, place), 1.0 - (x - whole)), (self.shadow_row(hit, place + 1), x - whole)]

    def shadow_row(self, hit, place):
        kit = self.kit
        is_warp = hit["is_warp"]
        if self.patterns is None:
            of_warp, of_weft = (y["places"] * other for y, other in zip(self.yarn, (self.picks, self.ends)))
            warp = self.modulo(hit["yarn"], self.ends) * of_warp + self.modulo(place, of_warp)
            weft = of_warp * self.ends + self.modulo(hit["yarn"], self.picks) * of_weft + self.modulo(place, of_weft)
            return dr.select(is_warp, warp, weft)
        places = kit.int(self.of_family("places", is_warp))
        phase = place & (places - 1)
        crossing, phase = (place - phase) // places, kit.uint(phase)
        bits = kit.uint(0)
        before, behind = (self.sides(is_warp, hit["yarn"], crossing + c) for c in (-1, 1))
        for n in range(3):
            yarn = ((before >> (2 * n)) & 1) * 4 + ((before >> (2 * n + 1)) & 1) * 2 + ((behind >> (2 * n)) & 1)
            bits = bits * 8 + yarn
        family = dr.select(is_warp, kit.uint(0), kit.uint(1))
        return kit.take_word(self.patterns, (family * PLACES[1] + phase) * 512 + bits)

    def shadow_direction(self, b):
        """Rows and columns of the table around a direction and their weights."""
        kit = self.kit
        z = dr.minimum(dr.abs(b[2]), 1.0)
        r = dr.minimum(dr.floor(dr.maximum(dr.minimum(two_thirds(z) * BANDS, float(BANDS)) - 0.5, 0.0)), BANDS - 1.0)
        at = kit.uint(r)
        s = (z - kit.take(self.mean_z, at * 2)) * kit.take(self.mean_z, at * 2 + 1)
        s = dr.select(r < BANDS - 1.0, s, 1.0 - dr.sqrt((1.0 - z * z) * PER_SQUARED_SINE))
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
        kit = self.kit
        sums = [0.0] * OFFSETS
        for row, weight in self.shadow_rows(hit, s):
            row = row * SIZE
            for entry, w in around:
                low, high = kit.word_pair(self.free_table, row + entry)
                w = w * weight
                for o in range(OFFSETS):
                    word = low if o < 4 else high
                    sums[o] = sums[o] + w * kit.float(kit.int((word >> (8 * (o % 4))) & 255))
        return [clamp(x * (MAX_SHARE / 255.0), 0.0, MAX_SHARE) for x in sums]

    def exit_density(self, model, kind, mean):
        """How light of a kind lies across a ply of a model where it leaves, as :meth:`below` asks (src/ply/data/exits.rs)."""
        kit = self.kit
        x = dr.minimum(dr.abs(mean), MAX_MEAN) * ((MEANS - 1) / MAX_MEAN)
        node = dr.minimum(dr.floor(x), MEANS - 2.0)
        mode, length, mode_to, length_to = kit.packets(self.exit_shapes, (kit.uint(model) * EXIT_KINDS + kind) * (MEANS - 1) + kit.uint(node), 1)
        s = x - node
        mode = dr.mulsign(mode + s * (mode_to - mode), mean)
        per = math.log2(math.e) / (length + s * (length_to - length))
        tail, other = dr.exp2((-1.0 - mode) * per), dr.exp2((mode - 1.0) * per)
        return mode, per, tail, 1.0 / (2.0 - tail - other)

    @staticmethod
    def below(density, t):
        """The share that leaves at offsets below ``t``."""
        mode, per, tail, per_all = density
        t = clamp(t, -1.0, 1.0) - mode
        e = dr.exp2(-dr.abs(t) * per)
        return (dr.select(t < 0.0, e, 2.0 - e) - tail) * per_all

    def within(self, free, density, off, scale):
        """The mean of what is free at the offsets of a yarn, of light that leaves a ply so."""
        total, before = 0.0, 1.0
        for o, value in enumerate(free):
            after = self.below(density, off - (2.0 * (o + 1) / OFFSETS - 1.0) / scale) if o + 1 < OFFSETS else 0.0
            total = total + (before - after) * value
            before = after
        return total

    def free(self, hit, model, b, lines, around, counts):
        """Shares of single reflection, of other light of clear fibers and of dark ones that get out in direction ``b``."""
        refl, clear, dark = lines
        off, further, scale = self.off_yarn(hit, b)
        narrow = self.free_at(hit, 0.5 * (refl[1] + dark[1]) + further, around)
        wide = self.free_at(hit, clear[1] + further, around)
        exits = [self.exit_density(model, kind, line[0]) for kind, line in enumerate(lines)]
        shares = [self.within(free, exit, off, scale) for free, exit in zip((narrow, wide, narrow), exits)]
        if self.some_one_by_one:
            shares = [a * b for a, b in zip(shares, self.pass_plies(hit, model, b, lines, exits))]
        return [dr.select(counts, x, 1.0) for x in shares]

    def off_yarn(self, hit, b):
        """How far a ply's axis lies from its yarn's, across and along direction ``b``, over the ply's radius, and that radius over half of the yarn's width."""
        is_warp = hit["is_warp"]
        scale = self.of_family("radius", is_warp) / self.of_family("half_width", is_warp)
        if self.most_plies == 1:
            return 0.0, 0.0, scale
        z, radius = hit["frame"][2], self.of_family("radius", is_warp)
        p = [v / radius for v in hit["off_axis"]]
        bz = dot3(b, z)
        per_sine = dr.rsqrt(dr.maximum(1.0 - bz * bz, 0.02))
        return dot3(p, cross3(b, z)) * per_sine, -(dot3(p, b) - bz * dot3(p, z)) * bz * per_sine * per_sine, scale

    def pass_plies(self, hit, model, b, lines, exits):
        """What the other plies of a yarn let pass of light that leaves its ply so (src/fabric/shade.rs)."""
        kit, is_warp, z, t = self.kit, hit["is_warp"], hit["frame"][2], hit["yarn_axis"]
        radius = self.of_family("radius", is_warp)
        p = [v / radius for v in hit["off_axis"]]

        def turned(v, c, s):
            w, along = cross3(t, v), (1.0 - c) * dot3(t, v)
            return [c * v[i] + s * w[i] + along * t[i] for i in range(3)]

        x = cross3(b, z)
        per_x = 1.0 / dr.maximum(dr.sqrt(dot3(x, x)), 1e-3)
        edges = [2.0 * part / PARTS - 1.0 for part in range(PARTS + 1)]
        parts = []
        for density in exits:
            below = [self.below(density, edge) for edge in edges]
            share = [y - x for x, y in zip(below, below[1:])]
            parts.append([dr.select(x > MIN_SHARE, x, 0.0) for x in share])
        lines = [([p[i] + further * z[i] for i in range(3)], [aside * per_x * x[i] for i in range(3)]) for aside, further in lines]
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
            slope = -per_x * dot3(x, across) / sine
            half = dr.maximum(dr.abs(slope), 0.1) * (radius / PARTS)
            for i, (start, aside) in enumerate(lines):
                middle = [start[k] - center[k] for k in range(3)]
                off = [middle[k] - aside[k] for k in range(3)]
                is_ahead = kit.both(here, along * dot3(off, axis) > dot3(off, b))
                h = dot3(middle, across) / sine
                total = 0.0
                for edge, share in zip(edges, parts[i]):
                    at = radius * (h + slope * (edge + 1.0 / PARTS))
                    total = total + share * self.passed_mean(model, theta, at - half, at + half)
                shares[i] = dr.select(is_ahead, shares[i] * total / sum(parts[i]), shares[i])
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
