"""Lines through a cloth of curves in Dr.Jit (``src/cloth/geometry/lines.rs``): the plies that a line hits, nearest
first.

A line walks through the voxels of a grid over the cell. Each voxel lists pieces of curves, which are cubics; for the
candidates near the line, Newton's method finds the point nearest to the line. The nearest hits are stored in a list
ordered by the distance to the surfaces of their plies. The list contains only what identifies a hit;
:meth:`Lines.hit_at` computes all other quantities.
"""

import math

import drjit as dr
import numpy as np

from ._kit import cross3, dot3
from ._uneven import Uneven

#: Largest number of stored hits of a line.
HITS = 12
# src/cloth/light/gaps.rs
FACES, FACES_IN_FULL = 0.5, 0.2
# src/cloth/geometry/lines.rs, nearest.rs
SLACK, BEYOND2, ACROSS, AWAY, MIN_SINE2, MIN_LEFT, BEYOND = 0.25, 0.16, 0.5, 0.05, 0.01, 3e-4, 3.0
MIN_SPEED2_UM2 = 1e-12
MAX_ENTRIES, ROUNDS, MARGIN_UM = 1 << 15, 8, 1.0
#: Offset added to cell numbers, which may be negative.
BIAS = 1 << 15


class Grid:
    """A grid over the cell: its voxels, and the pieces of curves that lines in them pass within ``beside`` [um]."""

    def __init__(self, kit, tensors, name, top, beside):
        self.top, self.beside = top, beside
        self.counts = [int(n) for n in tensors[f"{name}counts"]]
        voxel = tensors[f"{name}voxel"]
        self.voxels = kit.words(np.stack([voxel[:-1], voxel[1:]], 1))
        piece, i, j = tensors[f"{name}entry"].astype(np.uint32).T
        self.entry = kit.words(np.stack([piece, i << 16 | j], 1))


class Lines:
    """The pieces of a cloth's curves in their grid. The tables are those of ``Curves``."""

    def read_lines(self, tensors):
        kit = self.kit
        self.cell = [[float(x) for x in v] for v in tensors["cell_um"]]
        (a, b), (c, d) = self.cell
        area = a * d - b * c
        self.inverse = [[d / area, -c / area], [-b / area, a / area]]
        self.grid = Grid(kit, tensors, "", self.top, 0.0)
        # A second grid serves lines that pass near plies.
        self.wide, self.uneven = None, Uneven(kit, tensors)
        if "gap" in tensors:
            top, _, reach = map(float, tensors["gap"])
            self.wide = Grid(kit, tensors, "gap_", top, reach)
        pieces = tensors["piece"].astype(np.float64)
        cubic, (radius, reach, start, growth) = pieces[:, :12].reshape(-1, 4, 3), pieces[:, 12:].T
        chord = cubic[:, 1:].sum(1)
        # For each piece: the data that tell whether a line passes near it, then its cubic.
        rows = np.zeros((len(pieces), 24))
        rows[:, 0:3], rows[:, 3] = cubic[:, 0], reach**2
        rows[:, 4:7], rows[:, 7] = chord, (chord**2).sum(1)
        for power in (1, 2, 3):
            rows[:, 4 + 4 * power : 7 + 4 * power] = cubic[:, power]
        rows[:, 11], rows[:, 15], rows[:, 19] = radius, start, growth
        self.pieces = kit.floats(rows)
        self.curve_of_piece = kit.words(tensors["piece_curve"])
        self.of_curve = kit.words(tensors["curve_of"])

    def fractions(self, x, y):
        """A position in fractions of the cell's vectors."""
        return [row[0] * x + row[1] * y for row in self.inverse]

    def moved(self, i, j):
        """The position of an integer combination of the cell's vectors."""
        (a, b), (c, d) = self.cell
        return [i * a + j * c, i * b + j * d]

    def begin_line(self, at, w):
        """A line that arrives from direction ``w`` at a point of the middle plane: its start above the plies relative to
        the corner of the point's cell, and that cell.
        """
        kit, at = self.kit, self.uneven.place(at)
        cells = [kit.floor(f) for f in self.fractions(*at)]
        corner = self.moved(cells[0][0], cells[1][0])
        way = (self.top + MARGIN_UM) / dr.maximum(dr.abs(w[2]), 1e-4)
        return [at[0] - corner[0] + way * w[0], at[1] - corner[1] + way * w[1], way * w[2]], [cell for _, cell in cells]

    # Hits

    def chord_near(self, piece, shift, start, d, min_t, max_t, beside):
        """Whether a line passes near a piece's chord between the distances ``min_t`` and ``max_t``, and where on the
        chord, 0 to 1.
        """
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
        reach2 = p[3]
        if beside:
            reach = dr.sqrt(reach2) + beside
            reach2 = reach * reach
        over = dr.maximum(dr.maximum(near2 - reach2, beyond - BEYOND2 * all_), dr.maximum(min_t - way, way - max_t))
        return over <= 0.0, u

    def cubic(self, piece):
        """Power coefficients of a piece, its radius, and the curve parameter at its start and per unit of the piece's
        own parameter.
        """
        p = self.kit.packets(self.pieces, piece * 6, 5)
        return [p[0:3], p[8:11], p[12:15], p[16:19]], p[11], p[15], p[19]

    @staticmethod
    def along(cubic, shift, start, u):
        """Point of a piece relative to the line's start, with first and second derivative."""
        c0, c1, c2, c3 = cubic
        off = [shift[0] - start[0], shift[1] - start[1], -start[2]]
        p = [c0[k] + off[k] + u * (c1[k] + u * (c2[k] + u * c3[k])) for k in range(3)]
        first = [c1[k] + u * (2.0 * c2[k] + u * 3.0 * c3[k]) for k in range(3)]
        return p, first, [2.0 * c2[k] + 6.0 * u * c3[k] for k in range(3)]

    @staticmethod
    def step(p, first, second, d):
        """Newton's step towards the point of a piece nearest to a line, and whether the distance has a minimum nearby."""
        pw, dw, ddw = dot3(p, d), dot3(first, d), dot3(second, d)
        d2 = dot3(first, first)
        slope, straight = dot3(p, first) - pw * dw, d2 - dw * dw
        bend = straight + dot3(p, second) - pw * ddw
        return -slope / dr.select(bend > 0.1 * d2, bend, dr.maximum(straight, 0.05 * d2)), bend > 0.0

    def refined(self, piece, shift, start, d, u, beside):
        """Point of a piece nearest to a line: its parameter, the distance along the line, the squared distance from the
        line, and whether it lies within the piece and the ply.
        """
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
        reach = radius + beside
        inside = kit.both(kit.both(u >= 0.0, u < 1.0), kit.both(h2 < reach * reach, way >= 0.0))
        return u, kit.both(kit.both(inside, is_least), moved < AWAY), way, h2, first, p, radius

    def follow(self, start, d, active, r_d):
        """The hits of a line until hardly any light remains: lists of ``piece``, ``cells``, ``place`` and the distances
        to the plies' surfaces, and the number of hits. ``r_d(kind, theta_i, h_um, radius)`` returns the fraction of
        light that passes a ply.
        """
        kit = self.kit
        found = {"piece": [kit.uint(0)] * HITS, "cells": [kit.uint(0)] * HITS, "place": [kit.float(0.0)] * HITS, "enter": [kit.float(math.inf)] * HITS}

        def hit(found, ply):
            radius, across = ply["radius"], ply["across"]
            sine2 = dr.maximum(dot3(across, across), MIN_SINE2)
            h2 = dr.minimum(ply["h2"], radius * radius)
            enter = dr.select(ply["inside"], ply["way"] - dr.sqrt((radius * radius - h2) / sine2), math.inf)
            return self.insert(found, {"piece": ply["piece"], "cells": self.packed(ply["cells"]), "place": ply["place"], "enter": enter})

        def passes(ply):
            h = dr.sqrt(ply["h2"]) * dr.select(dot3(ply["off"], ply["across"]) < 0.0, -1.0, 1.0)
            theta_i = dr.asin(dr.minimum(dr.maximum(-dot3(d, ply["tangent"]), -1.0), 1.0))
            return r_d(self.kind_of(ply["piece"]), theta_i, h, ply["radius"])

        found = self.visit(self.grid, start, d, active, found, hit, "lines through curves", passes)
        count = kit.uint(0)
        for enter in found["enter"]:
            count = count + dr.select(enter < math.inf, kit.uint(1), kit.uint(0))
        return found, count

    def aperture(self, start, d, active):
        """Sides of the aperture that a line passes without hitting a ply [um], and cosine and sine of the angle from x
        to the aperture's first axis (``src/cloth/light/gaps.rs``).
        """
        kit, grid = self.kit, self.wide
        reach = grid.beside
        way = (grid.top - self.top) / dr.maximum(dr.abs(d[2]), 1e-4)
        start = [x - way * w for x, w in zip(start, d)]

        def edge(ply):
            """Direction to a ply in the plane, its distance, and the remaining fraction of the beam's reach there."""
            across = ply["across"]
            per = -dr.rsqrt(dr.maximum(dot3(across, across), 1e-12))
            x, y = across[0] * per, across[1] * per
            per_um = dr.maximum(dr.sqrt(x * x + y * y), 1e-3)
            room = dr.sqrt(ply["h2"]) - ply["radius"]
            sign = dr.select(dot3(ply["off"], across) < 0.0, 1.0, -1.0) / per_um
            near = dr.minimum(dr.maximum(1.0 - room / reach, 0.0), 1.0)
            return sign * x, sign * y, dr.maximum(room, 0.0) / per_um, near

        def turns(sums, ply):
            x, y, _, near = edge(ply)
            c, s = x * x - y * y, 2.0 * x * y
            weight = dr.select(ply["inside"], near * near, 0.0)
            return [sums[0] + weight * (c * c - s * s), sums[1] + weight * 2.0 * c * s]

        sums = self.visit(grid, start, d, active, [kit.float(0.0), kit.float(0.0)], turns, "edges of gaps")
        angle = 0.25 * dr.atan2(sums[1], sums[0])
        s, c = dr.sincos(dr.select(angle < 0.0, angle + 0.5 * math.pi, angle))
        axes = [(-c, -s), (c, s), (s, -c), (-s, c)]

        def bounds(sides, ply):
            x, y, away, _ = edge(ply)
            out = []
            for side, e in zip(sides, axes):
                facing = x * e[0] + y * e[1]
                share = dr.minimum(dr.maximum((facing - FACES) / FACES_IN_FULL, 0.0), 1.0)
                closer = dr.minimum(side, away / dr.maximum(facing * share, 1e-6))
                out.append(dr.select(kit.both(ply["inside"], share > 0.0), closer, side))
            return out

        sides = self.visit(grid, start, d, active, [kit.float(reach)] * 4, bounds, "sides of gaps")
        return sides, (c, s)

    def visit(self, grid, start, d, active, state, each, label, passes=None):
        """Calls ``state = each(state, ply)`` for the plies of a grid that a line passes near, until the line ends or
        hardly any light remains according to the fractions ``passes(ply)``; ``ply["inside"]`` tells whether the ply
        is hit.
        """
        kit = self.kit
        per_z = 1.0 / dr.select(dr.abs(d[2]) < 1e-6, dr.select(d[2] < 0.0, -1e-6, 1e-6), d[2])
        low, high = (-grid.top - start[2]) * per_z, (grid.top - start[2]) * per_z
        begin, end = dr.maximum(dr.minimum(low, high), 0.0), dr.maximum(low, high)
        ok = kit.both(kit.both(end > begin, end < 1e9), active)
        counts = [float(n) for n in grid.counts]
        rate = [f * n for f, n in zip([*self.fractions(d[0], d[1]), d[2] * (0.5 / grid.top)], counts)]
        first = [f * n for f, n in zip([*self.fractions(start[0], start[1]), 0.5 + start[2] * (0.5 / grid.top)], counts)]
        per_rate = [dr.select(dr.abs(r) < 1e-12, math.inf, 1.0 / dr.select(r == 0.0, 1.0, r)) for r in rate]
        voxel = [kit.floor(f + begin * r)[1] for f, r in zip(first, rate)]
        voxel[2] = dr.minimum(dr.maximum(voxel[2], 0), grid.counts[2] - 1)
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
            return cells, [v - c * n for v, c, n in zip(voxel, cells, grid.counts)]

        def entries_of(voxel):
            _, here = cells_of(voxel)
            height = dr.minimum(dr.maximum(voxel[2], 0), grid.counts[2] - 1)
            return kit.word_pair(grid.voxels, kit.uint((here[0] * grid.counts[1] + here[1]) * grid.counts[2] + height))

        at, last = entries_of(voxel)
        leave = out_of(border(voxel), end, begin)
        # The voxel, the distances at which the line enters and leaves it, and its entries.
        walk = {
            "on": ok,
            "voxel": voxel,
            "from": kit.float(begin),
            "leave": kit.float(leave),
            "entry": at,
            "last": last,
            "looked": kit.uint(0),
            "state": state,
        }
        changes = ["state"]
        if passes is not None:
            # The remaining light, and the distances to the nearest point of the farthest ply and to where
            # plies end.
            walk |= {"left": kit.float(1.0), "deepest": kit.float(0.0), "stop": kit.float(math.inf)}
            changes += ["left", "deepest"]

        def body(s):
            s = dict(s)
            some = s["entry"] < s["last"]
            piece, packed = kit.word_pair(grid.entry, dr.select(some, s["entry"], 0))
            cells, _ = cells_of(s["voxel"])
            cells = [cells[0] + kit.int(packed >> 16) - BIAS, cells[1] + kit.int(packed & 0xFFFF) - BIAS]
            shift = self.moved(kit.float(cells[0]), kit.float(cells[1]))
            min_t = dr.select(s["from"] == begin, -math.inf, s["from"])
            max_t = dr.select(s["leave"] >= end, math.inf, s["leave"])
            near, u = self.chord_near(piece, shift, start, d, min_t, max_t, grid.beside)

            def hit(state, *light):
                place, inside, way, h2, first, p, radius = self.refined(piece, shift, start, d, u, grid.beside)
                if light:
                    inside = kit.both(inside, way <= stop)
                has_tangent = dot3(first, first) > MIN_SPEED2_UM2
                first = [dr.select(has_tangent, first[k], 1.0 if k == 0 else 0.0) for k in range(3)]
                per = dr.rsqrt(dot3(first, first))
                tangent = [x * per for x in first]
                off = [p[k] - way * d[k] for k in range(3)]
                ply = {"piece": piece, "cells": cells, "place": place, "inside": inside, "way": way, "h2": h2, "radius": radius, "tangent": tangent, "off": off}
                ply |= {"across": cross3(d, tangent)}
                state = each(state, ply)
                if not light:
                    return (state,)
                left, deepest = light
                return state, dr.select(inside, left * passes(ply), left), dr.select(inside, dr.maximum(deepest, way), deepest)

            stop = s["stop"] if passes is not None else None
            s |= dict(zip(changes, kit.branch(tuple(s[key] for key in changes), kit.both(some, near), hit)))
            # After the last entry of a voxel comes the next voxel.
            done = s["entry"] + 1 >= s["last"]
            last_way = end
            if passes is not None:
                short = kit.both(kit.both(done, s["left"] < MIN_LEFT), s["stop"] == math.inf)
                s["stop"] = dr.select(short, s["deepest"] + BEYOND * self.largest, s["stop"])
                last_way = dr.minimum(end, s["stop"])
            leaves, is_end = s["leave"], s["leave"] >= last_way
            ways = border(s["voxel"])
            is_up = ways[2] < dr.minimum(ways[0], ways[1])
            is_second = kit.both(kit.no(is_up), ways[1] < ways[0])
            take = [kit.no(is_up | is_second), is_second, is_up]
            s["voxel"] = [dr.select(kit.both(done, t), v + dr.select(f, 1, -1), v) for t, f, v in zip(take, forward, s["voxel"])]
            is_end = is_end | (s["voxel"][2] < 0) | (s["voxel"][2] >= grid.counts[2])
            entry, last = entries_of(s["voxel"])
            s["entry"] = dr.select(done, entry, s["entry"] + 1)
            s["last"] = dr.select(done, last, s["last"])
            s["from"] = dr.select(done, leaves, s["from"])
            s["leave"] = dr.select(done, out_of(border(s["voxel"]), last_way, leaves), leaves)
            s["looked"] = s["looked"] + 1
            s["on"] = kit.both(kit.both(s["on"], kit.no(kit.both(done, is_end))), s["looked"] < MAX_ENTRIES)
            return (s,)

        (s,) = kit.loop((walk,), lambda s: s["on"], body, label)
        return s["state"]

    def packed(self, cells):
        """Cells along both vectors packed into a word."""
        i, j = (self.kit.uint(c + BIAS) for c in cells)
        return (i << 16) | (j & 0xFFFF)

    @staticmethod
    def insert(found, new):
        """Inserts a hit into the stored ones, ordered by the distance to its ply's surface."""
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
        """All quantities of a hit of a line from ``start`` (``LineHit`` of src/cloth/geometry/lines.rs), from its piece,
        the cells of its image and its approximate parameter.
        """
        kit = self.kit
        piece, packed = where["piece"], where["cells"]
        cubic, radius, parameter, growth = self.cubic(piece)
        cells = [kit.int(packed >> 16) - BIAS, kit.int(packed & 0xFFFF) - BIAS]
        shift = self.moved(kit.float(cells[0]), kit.float(cells[1]))
        u = where["place"]
        # One more step adds the gradients of the line's position, which the search lacks.
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
        # If the line runs along the ply, any axis across it serves.
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
