"""Lines through a cloth of curves in Dr.Jit (``src/cloth/lines.rs``): the plies that a line hits, nearest first.

A line walks through the voxels of a grid over the cell. Each lists pieces of curve, cubics; of those that the line comes near, Newton's method finds the place where it is nearest.
The nearest hits are kept in a list by the way to their walls; only what identifies a hit is kept, and :meth:`Lines.hit_at` finds all else of it.
"""

import math

import drjit as dr
import numpy as np

from ._kit import cross3, dot3

#: Hits of a line that are kept.
HITS = 12
# src/cloth/lines.rs, nearest.rs
SLACK, BEYOND2, ACROSS, AWAY, MIN_SINE2, MIN_LEFT, BEYOND = 0.25, 0.16, 0.5, 0.05, 0.01, 3e-4, 3.0
MAX_ENTRIES, ROUNDS, MARGIN_UM = 1 << 15, 8, 1.0
#: Added to numbers of cells, which may be negative.
BIAS = 1 << 15


class Lines:
    """The pieces of a cloth's curves in their grid. The tables are those of ``Curves``."""

    def read_lines(self, tensors):
        kit = self.kit
        self.cell = [[float(x) for x in v] for v in tensors["cell_um"]]
        (a, b), (c, d) = self.cell
        area = a * d - b * c
        self.inverse = [[d / area, -c / area], [-b / area, a / area]]
        self.counts = [int(n) for n in tensors["counts"]]
        self.voxels = kit.words(np.stack([tensors["voxel"][:-1], tensors["voxel"][1:]], 1))
        piece, i, j = tensors["entry"].astype(np.uint32).T
        self.entry = kit.words(np.stack([piece, i << 16 | j], 1))
        pieces = tensors["piece"].astype(np.float64)
        cubic, (radius, reach, start, growth) = pieces[:, :12].reshape(-1, 4, 3), pieces[:, 12:].T
        chord = cubic[:, 1:].sum(1)
        # Of each piece what says whether a line comes near, then its cubic.
        rows = np.zeros((len(pieces), 24))
        rows[:, 0:3], rows[:, 3] = cubic[:, 0], reach**2
        rows[:, 4:7], rows[:, 7] = chord, (chord**2).sum(1)
        for power in (1, 2, 3):
            rows[:, 4 + 4 * power : 7 + 4 * power] = cubic[:, power]
        rows[:, 11], rows[:, 15], rows[:, 19], rows[:, 20] = radius, start, growth, 0.0
        self.pieces = kit.floats(rows)
        self.curve_of_piece = kit.words(tensors["piece_curve"])
        self.of_curve = kit.words(tensors["curve_of"])

    def fractions(self, x, y):
        """A place in fractions of the cell's vectors."""
        return [row[0] * x + row[1] * y for row in self.inverse]

    def moved(self, i, j):
        """The place of a whole combination of the vectors."""
        (a, b), (c, d) = self.cell
        return [i * a + j * c, i * b + j * d]

    def begin_line(self, at, w):
        """A line that comes from direction ``w`` through a point of the middle plane: its start above the plies relative to the corner of the point's cell, and that cell."""
        kit = self.kit
        cells = [kit.floor(f) for f in self.fractions(*at)]
        corner = self.moved(cells[0][0], cells[1][0])
        way = (self.top + MARGIN_UM) / dr.maximum(dr.abs(w[2]), 1e-4)
        return [at[0] - corner[0] + way * w[0], at[1] - corner[1] + way * w[1], way * w[2]], [cell for _, cell in cells]

    # Hits

    def chord_near(self, piece, shift, start, d, least, most):
        """Whether a line comes near a piece's chord on its way from ``least`` to ``most``, and where on it, 0 to 1."""
        p = self.kit.packets(self.pieces, piece * 6, 2)
        chord, all_ = p[4:7], p[7]
        e = [p[0] + shift[0] - start[0], p[1] + shift[1] - start[1], p[2] - start[2]]
        ew, dw = dot3(e, d), dot3(chord, d)
        ed = dot3(e, chord) - ew * dw
        dd = all_ - dw * dw
        ee = dot3(e, e) - ew * ew
        free = -ed / dr.maximum(dd, 1e-6)
        u = dr.minimum(dr.maximum(free, 0.0), 1.0)
        near2, way = ee + u * (2.0 * ed + u * dd), ew + u * dw
        beyond = dr.select(dd > ACROSS * all_, (free - u) * (free - u) * dd, 0.0)
        over = dr.maximum(dr.maximum(near2 - p[3], beyond - BEYOND2 * all_), dr.maximum(least - way, way - most))
        return over <= 0.0, u

    def cubic(self, piece):
        """Coefficients of a piece's powers, its radius, parameter at its begin and the growth of that."""
        p = self.kit.packets(self.pieces, piece * 6, 5)
        return [p[0:3], p[8:11], p[12:15], p[16:19]], p[11], p[15], p[19]

    @staticmethod
    def along(cubic, shift, start, u):
        """A piece's point from the line's start, first and second derivative."""
        c0, c1, c2, c3 = cubic
        off = [shift[0] - start[0], shift[1] - start[1], -start[2]]
        p = [c0[k] + off[k] + u * (c1[k] + u * (c2[k] + u * c3[k])) for k in range(3)]
        first = [c1[k] + u * (2.0 * c2[k] + u * 3.0 * c3[k]) for k in range(3)]
        return p, first, [2.0 * c2[k] + 6.0 * u * c3[k] for k in range(3)]

    @staticmethod
    def step(p, first, second, d):
        """Newton's step towards where a line is nearest to a piece, and whether the distance has a minimum about there."""
        pw, dw, ddw = dot3(p, d), dot3(first, d), dot3(second, d)
        d2 = dot3(first, first)
        slope, straight = dot3(p, first) - pw * dw, d2 - dw * dw
        bend = straight + dot3(p, second) - pw * ddw
        return -slope / dr.select(bend > 0.1 * d2, bend, dr.maximum(straight, 0.05 * d2)), bend > 0.0

    def refined(self, piece, shift, start, d, u):
        """Where a line is nearest to a piece: the place, the way along the line, the squared distance, and whether it is within the piece and the ply."""
        kit = self.kit
        cubic, radius, _, _ = self.cubic(piece)
        moved, is_least = 0.0, kit.bool(True)
        for _ in range(ROUNDS):
            by, is_least = self.step(*self.along(cubic, shift, start, u), d)
            to = u + by
            to = dr.minimum(dr.maximum(to, -SLACK), 1.0 + SLACK)
            u, moved = to, dr.abs(to - u)
        p, first, _ = self.along(cubic, shift, start, u)
        way = dot3(p, d)
        h2 = dr.maximum(dot3(p, p) - way * way, 0.0)
        inside = kit.both(kit.both(u >= 0.0, u < 1.0), kit.both(h2 < radius * radius, way >= 0.0))
        return u, kit.both(kit.both(inside, is_least), moved < AWAY), way, h2, first, p, radius

    def follow(self, start, d, active, kind_of, r_d):
        """The hits of a line until hardly any light is left: lists of ``piece``, ``cells``, ``place`` and of the way to their walls, and how many there are. ``r_d(kind, theta_i,
        h_um, radius)`` says what passes a ply."""
        kit = self.kit
        zero = kit.float(0.0)
        per_z = 1.0 / dr.select(dr.abs(d[2]) < 1e-6, dr.select(d[2] < 0.0, -1e-6, 1e-6), d[2])
        low, high = (-self.top - start[2]) * per_z, (self.top - start[2]) * per_z
        begin, end = dr.maximum(dr.minimum(low, high), 0.0), dr.maximum(low, high)
        ok = kit.both(kit.both(end > begin, end < 1e9), active)
        counts = [float(n) for n in self.counts]
        rate = [f * n for f, n in zip([*self.fractions(d[0], d[1]), d[2] * (0.5 / self.top)], counts)]
        first = [f * n for f, n in zip([*self.fractions(start[0], start[1]), 0.5 + start[2] * (0.5 / self.top)], counts)]
        per_rate = [dr.select(dr.abs(r) < 1e-12, math.inf, 1.0 / dr.select(r == 0.0, 1.0, r)) for r in rate]
        voxel = [kit.floor(f + begin * r)[1] for f, r in zip(first, rate)]
        voxel[2] = dr.minimum(dr.maximum(voxel[2], 0), self.counts[2] - 1)
        forward = [r >= 0.0 for r in rate]

        def border(voxel):
            ways = []
            for k in range(3):
                at = (kit.float(voxel[k]) + dr.select(forward[k], 1.0, 0.0) - first[k]) * per_rate[k]
                ways.append(dr.select(dr.isfinite(per_rate[k]), at, math.inf))
            return ways

        def out_of(ways, end, after):
            return dr.maximum(dr.minimum(dr.minimum(ways[0], ways[1]), dr.minimum(ways[2], end)), after)

        def cells_of(voxel):
            cells = [kit.floor((kit.float(v) + 0.5) / n)[1] for v, n in zip(voxel[:2], counts)]
            return cells, [v - c * n for v, c, n in zip(voxel, cells, self.counts)]

        def entries_of(voxel):
            _, here = cells_of(voxel)
            height = dr.minimum(dr.maximum(voxel[2], 0), self.counts[2] - 1)
            return kit.word_pair(self.voxels, kit.uint((here[0] * self.counts[1] + here[1]) * self.counts[2] + height))

        at, last = entries_of(voxel)
        leave = out_of(border(voxel), end, begin)
        found = {"piece": [kit.uint(0)] * HITS, "cells": [kit.uint(0)] * HITS, "place": [zero] * HITS, "enter": [kit.float(math.inf)] * HITS}
        # The voxel, the way to it and out of it, its entries, the light that is left, where to end.
        state = {
            "on": ok,
            "voxel": voxel,
            "from": kit.float(begin),
            "leave": kit.float(leave),
            "entry": at,
            "last": last,
            "left": kit.float(1.0),
            "end": kit.float(end),
            # The way to the place nearest to the furthest ply, and to where plies count no more.
            "deepest": zero,
            "stop": kit.float(math.inf),
            "looked": kit.uint(0),
            "found": found,
        }

        def body(s):
            s = dict(s)
            some = s["entry"] < s["last"]
            piece, packed = kit.word_pair(self.entry, dr.select(some, s["entry"], 0))
            cells, _ = cells_of(s["voxel"])
            cells = [cells[0] + kit.int(packed >> 16) - BIAS, cells[1] + kit.int(packed & 0xFFFF) - BIAS]
            shift = self.moved(kit.float(cells[0]), kit.float(cells[1]))
            least = dr.select(s["from"] == begin, -math.inf, s["from"])
            most, stop = dr.select(s["leave"] >= end, math.inf, s["leave"]), s["stop"]
            near, u = self.chord_near(piece, shift, start, d, least, most)

            def hit(left, deepest, found):
                place, inside, way, h2, first, p, radius = self.refined(piece, shift, start, d, u)
                inside = kit.both(inside, way <= stop)
                per = dr.rsqrt(dot3(first, first))
                tangent = [x * per for x in first]
                across = cross3(d, tangent)
                sine2 = dr.maximum(dot3(across, across), MIN_SINE2)
                enter = dr.select(inside, way - dr.sqrt((radius * radius - dr.minimum(h2, radius * radius)) / sine2), math.inf)
                off = [p[k] - way * d[k] for k in range(3)]
                h = dr.sqrt(h2) * dr.select(dot3(off, across) < 0.0, -1.0, 1.0)
                theta_i = dr.asin(dr.minimum(dr.maximum(-dot3(d, tangent), -1.0), 1.0))
                left = dr.select(inside, left * r_d(kind_of(piece), theta_i, h, radius), left)
                return left, dr.select(inside, dr.maximum(deepest, way), deepest), self.insert(found, {"piece": piece, "cells": self.packed(cells), "place": place, "enter": enter})

            s["left"], s["deepest"], s["found"] = kit.branch((s["left"], s["deepest"], s["found"]), kit.both(some, near), hit)
            # At the end of a voxel the next one.
            done = s["entry"] + 1 >= s["last"]
            short = kit.both(kit.both(done, s["left"] < MIN_LEFT), s["stop"] == math.inf)
            s["stop"] = dr.select(short, s["deepest"] + BEYOND * self.largest, s["stop"])
            s["end"] = dr.minimum(s["end"], s["stop"])
            leaves, is_end = s["leave"], s["leave"] >= s["end"]
            ways = border(s["voxel"])
            is_up = ways[2] < dr.minimum(ways[0], ways[1])
            is_second = kit.both(kit.no(is_up), ways[1] < ways[0])
            take = [kit.no(is_up | is_second), is_second, is_up]
            s["voxel"] = [dr.select(kit.both(done, t), v + dr.select(f, 1, -1), v) for t, f, v in zip(take, forward, s["voxel"])]
            is_end = is_end | (s["voxel"][2] < 0) | (s["voxel"][2] >= self.counts[2])
            entry, last = entries_of(s["voxel"])
            s["entry"] = dr.select(done, entry, s["entry"] + 1)
            s["last"] = dr.select(done, last, s["last"])
            s["from"] = dr.select(done, leaves, s["from"])
            s["leave"] = dr.select(done, out_of(border(s["voxel"]), s["end"], leaves), leaves)
            s["looked"] = s["looked"] + 1
            s["on"] = kit.both(kit.both(s["on"], kit.no(kit.both(done, is_end))), s["looked"] < MAX_ENTRIES)
            return (s,)

        (s,) = kit.loop((state,), lambda s: s["on"], body, "lines through curves")
        count = kit.uint(0)
        for enter in s["found"]["enter"]:
            count = count + dr.select(enter < math.inf, kit.uint(1), kit.uint(0))
        return s["found"], count

    def packed(self, cells):
        """Cells along both vectors in a word."""
        i, j = (self.kit.uint(c + BIAS) for c in cells)
        return (i << 16) | (j & 0xFFFF)

    @staticmethod
    def insert(found, new):
        """A hit among those that are kept, by the way to its wall."""
        out = {key: [] for key in found}
        for i in range(HITS):
            here = new["enter"] < found["enter"][i]
            for key in found:
                old = found[key][i]
                out[key].append(dr.select(here, new[key], old))
                new = new | {key: dr.select(here, old, new[key])} if key != "enter" else new
            new = new | {"enter": dr.select(here, found["enter"][i], new["enter"])}
        return out

    def hit_at(self, where, start, d):
        """All of a ply that a line from ``start`` hits (``LineHit`` of src/cloth/lines.rs), from its piece, the cells of its image and about its place there."""
        kit = self.kit
        piece, packed = where["piece"], where["cells"]
        cubic, radius, parameter, growth = self.cubic(piece)
        cells = [kit.int(packed >> 16) - BIAS, kit.int(packed & 0xFFFF) - BIAS]
        shift = self.moved(kit.float(cells[0]), kit.float(cells[1]))
        u = where["place"]
        # With the gradients of the line's place, which the search has not.
        u = u + self.step(*self.along(cubic, shift, start, u), d)[0]
        p, first, second = self.along(cubic, shift, start, u)
        way = dot3(p, d)
        off = [p[k] - way * d[k] for k in range(3)]
        speed = dr.sqrt(dot3(first, first))
        z = [x / speed for x in first]
        across = cross3(d, z)
        h = dr.sqrt(dr.maximum(dot3(off, off), 1e-12)) * dr.select(dot3(off, across) < 0.0, -1.0, 1.0)
        h = dr.minimum(dr.maximum(h, -radius), radius)
        along = dr.minimum(dr.maximum(-dot3(d, z), -1.0), 1.0)
        y = [-along * z[k] - d[k] for k in range(3)]
        length2 = dot3(y, y)
        # Along the ply: any axis across it.
        other = cross3(z, [dr.select(dr.abs(z[0]) < 0.7, 1.0, 0.0), dr.select(dr.abs(z[0]) < 0.7, 0.0, 1.0), kit.float(0.0)])
        y = [dr.select(length2 < 1e-8, b, a) for a, b in zip(y, other)]
        per = dr.rsqrt(dr.maximum(dot3(y, y), 1e-12))
        y = [v * per for v in y]
        curve = kit.take_word(self.curve_of_piece, piece)
        kind = self.kind_of(piece)
        return {
            "kind": kind,
            "curve": curve,
            "cells": cells,
            "parameter": parameter + u * growth,
            "frame": [cross3(y, z), y, z],
            "theta_i": dr.asin(along),
            "h_um": h,
            "h": h * self.scale_of(kind),
            "radius": radius,
            "speed": speed / growth,
        }
