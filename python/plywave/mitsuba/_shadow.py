"""Shadows of yarns on their neighbors in Dr.Jit (``src/cloth/shade/shadow_table.rs``, ``shade.rs``)."""

import math

import drjit as dr

from ._kit import clamp
from ._native import CONSTANTS

TAU = 2.0 * math.pi
# src/ply/data/exits.rs
EXIT_KINDS, MEANS, MAX_MEAN = 3, 65, 0.97
# src/ply/lines.rs
PASSED_ROWS, PASSED_COLUMNS = 16, 65
# src/cloth/shade/shadow_table.rs
BANDS, COLUMNS, OFFSETS = 8, 16, 7
ROWS = BANDS + 1
SIZE = 2 * ROWS * COLUMNS
MAX_SHARE = 1.35
MEAN_Z = CONSTANTS["shadow_mean_z"]
PER_SQUARED_SINE = 1.0 / (1.0 - MEAN_Z[-1] ** 2)


def two_thirds(z):
    root = dr.sqrt(z)
    c = 0.4 + 0.6 * root
    for _ in range(2):
        c = c - (c * c * c - root) / (3.0 * c * c)
    return c * c * c * c


class Shadows:
    """Probabilities that light of a ply escapes the cloth. The tables are those of ``Curves``."""

    def shadow_direction(self, b):
        """Rows and columns of the table around a direction, and their weights."""
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
        """Probabilities of escape at the offsets, for light that leaves ``s`` radii further along the ply."""
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
        """Distribution across a ply of the light of a kind that leaves it, in the form that :meth:`below` takes
        (src/ply/data/exits.rs).
        """
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
        """The fraction that leaves at offsets below ``t``."""
        mode, per, tail, per_all = density
        t = clamp(t, -1.0, 1.0) - mode
        e = dr.exp2(-dr.abs(t) * per)
        return (dr.select(t < 0.0, e, 2.0 - e) - tail) * per_all

    def within(self, free, density):
        """Mean over the exit offsets of the probability of escape."""
        total, before = 0.0, 1.0
        for o, value in enumerate(free):
            after = self.below(density, 1.0 - 2.0 * (o + 1) / OFFSETS) if o + 1 < OFFSETS else 0.0
            total = total + (before - after) * value
            before = after
        return total

    def free(self, hit, model, lines, around, counts):
        """Fractions of single reflection, of other light of clear fibers and of dark ones that escape in the direction
        of ``around``.
        """
        refl, clear, dark = lines
        narrow = self.free_at(hit, 0.5 * (refl[1] + dark[1]), around)
        wide = self.free_at(hit, clear[1], around)
        exits = [self.exit_density(model, kind, line[0]) for kind, line in enumerate(lines)]
        shares = [self.within(free, exit) for free, exit in zip((narrow, wide, narrow), exits)]
        return [dr.select(counts, x, 1.0) for x in shares]

    def passed_mean(self, model, theta, low, high):
        """Mean of r_d over offsets from ``low`` to ``high`` (src/ply/lines.rs)."""
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
