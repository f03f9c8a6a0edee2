"""Yarns of a fabric in Dr.Jit: the draft, the yarns' axes, and the ply of a yarn that a line meets.

The formulas are those of ``src/fabric/profile.rs``, ``yarn.rs``, ``hit.rs``.
"""

import math

import drjit as dr
import numpy as np

from ._kit import cross3, dot3

TAU = 2.0 * math.pi
# src/fabric/walk.rs
STRETCH = 1.0


class Yarns:
    """What a line meets of one yarn. The tables are those of ``Cloth``."""

    def of_family(self, key, is_warp):
        a, b = self.yarn[0][key], self.yarn[1][key]
        return a if a == b else dr.select(is_warp, a, b)

    def other_family(self, key, is_warp):
        a, b = self.yarn[1][key], self.yarn[0][key]
        return a if a == b else dr.select(is_warp, a, b)

    def modulo(self, x, n):
        """Of a signed index, less than 2^29 from 0: 0 to n - 1."""
        if n == 1:
            return self.kit.uint(0)
        if not self.kit.jit:
            return int(x) % n
        return self.kit.UInt(x + (1 << 29) // n * n) % n

    def entry(self, name, is_warp, yarn):
        """Entry of a yarn in the lists of both families that repeat."""
        kit, values = self.kit, []
        for k, raw in enumerate(self.stripes if name == "stripes" else self.dyes):
            table = self.lists[name][k]
            values.append(int(raw[0]) if table is None else kit.take_word(table, self.modulo(yarn, len(raw))))
        if all(isinstance(v, int) for v in values) and values[0] == values[1]:
            return kit.uint(values[0])
        return dr.select(is_warp, kit.uint(values[0]), kit.uint(values[1]))

    @staticmethod
    def sides_of(draft):
        """On which side yarns are at their crossings, by family, yarn and crossing, a word each: bits 0 and 1 for the yarn before this one, at this crossing and the next, 2 and 3 for
        this yarn, 4 and 5 for the yarn behind it."""
        words = []
        for up in (draft.T.astype(bool), ~draft.astype(bool)):
            word = np.zeros(up.shape, np.uint32)
            for n, yarn in enumerate((-1, 0, 1)):
                for crossing in (0, 1):
                    word |= np.roll(up, (-yarn, -crossing), (0, 1)).astype(np.uint32) << (2 * n + crossing)
            words.append(word.ravel())
        return np.concatenate(words)

    def sides(self, is_warp, yarn, crossing):
        """The word of :meth:`sides_of`; ``is_warp`` may be a Python bool."""
        kit, ends, picks = self.kit, self.ends, self.picks
        if isinstance(is_warp, bool):
            yarns, crossings, first = (ends, picks, 0) if is_warp else (picks, ends, ends * picks)
            return kit.take_word(self.side_words, self.modulo(yarn, yarns) * crossings + self.modulo(crossing, crossings) + first)
        end, pick = (self.modulo(dr.select(is_warp, a, b), n) for a, b, n in ((yarn, crossing, ends), (crossing, yarn, picks)))
        return kit.take_word(self.side_words, dr.select(is_warp, end * picks + pick, pick * ends + end + ends * picks))

    def joined(self, of, start, to, u):
        """Height and slope of an axis at the share ``u`` of the way from a crossing to the next (src/fabric/profile.rs)."""
        side = dr.select(start, 1.0, -1.0)
        far = u > 0.5
        x = of("step") * dr.select(far, 1.0 - u, u)
        straight = x >= of("arc")
        depth = dr.sqrt(dr.maximum(of("arc_radius") * of("arc_radius") - x * x, 1e-12))
        height = dr.select(straight, of("steepest") * (0.5 * of("step") - x), of("amplitude") - of("arc_radius") + depth)
        slope = dr.select(straight, -of("steepest"), -x / depth)
        level = start == to
        height = dr.select(level, side * of("amplitude"), dr.select(far, -side * height, side * height))
        return height, dr.select(level, 0.0, side * slope)

    def bent(self, yarn, u):
        """Height at the share ``u`` of the way from a crossing where a yarn of a family is on top to one where it is below, and the squared cosine of its lean."""
        far = u > 0.5
        x = yarn["step"] * dr.select(far, 1.0 - u, u)
        straight = x >= yarn["arc"]
        depth = dr.sqrt(dr.maximum(yarn["arc_radius"] * yarn["arc_radius"] - x * x, 1e-12))
        height = dr.select(straight, yarn["steepest"] * (0.5 * yarn["step"] - x), yarn["amplitude"] - yarn["arc_radius"] + depth)
        arc = depth / yarn["arc_radius"]
        return dr.select(far, -height, height), dr.select(straight, 1.0 / (1.0 + yarn["steepest"] * yarn["steepest"]), arc * arc)

    def axis_at(self, is_warp, yarn, along):
        whole, first = self.kit.floor(along * self.other_family("per_spacing", is_warp) - 0.5)
        u = along * self.other_family("per_spacing", is_warp) - 0.5 - whole
        word = self.sides(is_warp, yarn, first)
        start, to = (word & 4) != 0, (word & 8) != 0
        return self.joined(lambda key: self.of_family(key, is_warp), start, to, u)

    def turns(self, is_warp, yarn, along):
        """Turns of ply 0 about a yarn's axis."""
        kit = self.kit
        if kit.jit:
            x = kit.UInt(yarn) ^ dr.select(is_warp, kit.UInt(0), kit.UInt(0x9E3779B9))
            x = (x ^ (x >> 16)) * kit.UInt(0x7FEB352D)
            x = (x ^ (x >> 15)) * kit.UInt(0x846CA68B)
            x = x ^ (x >> 16)
            begin = kit.Float(x >> 8) * (1.0 / (1 << 24))
        else:
            x = (int(yarn) & 0xFFFFFFFF) ^ (0 if is_warp else 0x9E3779B9)
            x = ((x ^ (x >> 16)) * 0x7FEB352D) & 0xFFFFFFFF
            x = ((x ^ (x >> 15)) * 0x846CA68B) & 0xFFFFFFFF
            x = x ^ (x >> 16)
            begin = (x >> 8) / (1 << 24)
        turned = along * self.of_family("turns_per_um", is_warp)
        return begin + turned - dr.floor(turned)

    def across(self, w, z):
        m = cross3(w, z)
        squared = dot3(m, m)
        ok = squared > 1e-10
        sine = dr.sqrt(dr.maximum(squared, 1e-10))
        # y along n where the line is parallel to the ply.
        other = [z[2], 0.0, -z[0]]
        per_other = dr.rsqrt(dr.maximum(dot3(other, other), 1e-6))
        per = 1.0 / sine
        return [dr.select(ok, a * per, b * per_other) for a, b in zip(m, other)], dr.select(ok, sine, 1e-5)

    def cylinder(self, of, line, ck, sk, shift, c, s):
        origin, w = line["origin"], line["w"]
        cos, sin = c * ck - s * sk, s * ck + c * sk
        slope, circle, radius = of("slope") * line["lean"], of("circle"), of("radius")
        norm = 1.0 / dr.sqrt(1.0 + slope * slope)
        tangent = [-slope * sin * norm, slope * cos * norm, norm + 0.0 * cos]
        x, sine = self.across(w, tangent)
        d = [origin[0] - circle * cos, origin[1] - circle * sin, origin[2] - shift]
        h = dot3(d, x)
        room = radius * radius - h * h
        nearest = -dot3(d, cross3(tangent, x)) / sine
        # Above 0, where the root has no derivative.
        entry = nearest + dr.sqrt(dr.maximum(room, 1e-12)) / sine
        dt, wt = dot3(d, tangent), dot3(w, tangent)
        further = (dt + entry * wt) * tangent[2]
        along = dt + nearest * wt
        center = [origin[i] - d[i] + along * tangent[i] for i in range(3)]
        met = {"hit": room > 0.0, "h": h, "tangent": tangent, "x": x, "sine": sine, "nearest": nearest, "center": center}
        return met, entry, further

    def meet_one(self, of, line):
        """The ply of a yarn of one."""
        kit, origin, w = self.kit, line["origin"], line["w"]
        zero, one = kit.float(0.0), kit.float(1.0)
        x, sine = self.across(w, [zero, zero, one])
        h = dot3(origin, x)
        nearest = -dot3(origin, cross3([zero, zero, one], x)) / sine
        center = [zero, zero, origin[2] + nearest * w[2]]
        return {"hit": dr.abs(h) < of("radius"), "h": h, "tangent": [zero, zero, one], "x": x, "sine": sine, "nearest": nearest, "center": center}

    def places_of_plies(self, is_warp):
        """Cosine and sine of the turn of each ply against the first."""
        turn = [[(float(c), float(s)) for c, s in self.turn[k]] for k in range(2)]
        return [[dr.select(is_warp, turn[0][n][i], turn[1][n][i]) for i in range(2)] for n in range(self.most_plies)]

    def meet_ply(self, of, is_warp, line, ply, is_hit):
        """A ply of several that a line meets or passes next to its point."""
        places = self.places_of_plies(is_warp)
        chosen = places[0]
        for n in range(1, self.most_plies):
            chosen = [dr.select(ply == n, a, b) for a, b in zip(places[n], chosen)]

        def at(shift):
            s, c = dr.sincos(TAU * (line["turns"] + shift * line["lean"] * of("turns_per_um")))
            return self.cylinder(of, line, *chosen, shift, c, s)

        kit, shift = self.kit, line["origin"][2]
        first, _, further = at(shift)
        again, _, _ = at(shift + further)
        moved = kit.both(of("slope") != 0.0, dr.abs(further) < 2.0 * of("half_width"))
        met = select_met(moved, again, first)
        radius = of("radius")
        beside = dr.maximum(dr.abs(met["h"]), radius) * dr.select(met["h"] < 0.0, -1.0, 1.0)
        met["h"] = dr.select(is_hit, dr.minimum(dr.maximum(met["h"], -radius), radius), beside)
        met["hit"] = is_hit
        return met

    def ahead(self, of, is_warp, line, least, skips):
        """Of a yarn straightened at a point of the line: how far the line may go, the ply that it meets there or -1, and of plies that it passes by less than ``least`` on this way the
        ply (or -1), how near, and how far ahead (``src/fabric/walk.rs``). Plies to skip are not there."""
        kit, (x, y, shift) = self.kit, line["origin"]
        beside = dr.sqrt(x * x + y * y)
        step = dr.maximum(STRETCH * of("radius"), beside - of("half_width"))
        s, c = dr.sincos(TAU * (line["turns"] + shift * line["lean"] * of("turns_per_um")))
        first, passed, passed_at = kit.int(-1), kit.int(-1), kit.float(0.0)
        for n, (ck, sk) in enumerate(self.places_of_plies(is_warp)):
            met, entry, _ = self.cylinder(of, line, ck, sk, shift, c, s)
            here = kit.both(kit.both(n < of("plies"), kit.no(skips[n])), met["nearest"] <= 0.0)
            ahead = dr.maximum(-entry, 0.0)
            is_first = kit.both(kit.both(here, met["hit"]), ahead < step)
            near = kit.both(kit.both(here, kit.no(met["hit"])), kit.both(-met["nearest"] < step, dr.abs(met["h"]) < least))
            step, first = dr.select(is_first, ahead, step), dr.select(is_first, kit.int(n), first)
            least = dr.select(near, dr.abs(met["h"]), least)
            passed, passed_at = dr.select(near, kit.int(n), passed), dr.select(near, -met["nearest"], passed_at)
        return beside, step, first, least, passed, passed_at

    def straightened(self, is_warp, yarn, start, d, at):
        """The line ``at`` um along it and a yarn, straight along its tangent next to the point: the line from that point, the yarn's axes, and the point of its axis."""
        q = [start[i] + at * d[i] for i in range(3)]
        along = dr.select(is_warp, q[1], q[0])
        height, slope = self.axis_at(is_warp, yarn, along)
        if self.most_plies > 1:
            # The foot of the point on the axis.
            half = self.of_family("half_width", is_warp)
            foot = (q[2] - height) * slope / (1.0 + slope * slope)
            foot = dr.minimum(dr.maximum(foot, -half), half)
            if self.least_plies == 1:
                foot = dr.select(self.of_family("plies", is_warp) == 1.0, 0.0, foot)
            along = along + foot
            height, slope = self.axis_at(is_warp, yarn, along)
        c = dr.rsqrt(1.0 + slope * slope)
        s = slope * c
        zero = 0.0 * s
        sel = lambda a, b: dr.select(is_warp, a, b)
        axes = [
            [sel(-1.0 + zero, zero), sel(zero, 1.0 + zero), zero],
            [sel(zero, -s), sel(-s, zero), c],
            [sel(zero, c), sel(c, zero), s],
        ]
        middle = (self.kit.float(yarn) + 0.5) * self.of_family("spacing", is_warp)
        axis = [sel(middle, along), sel(along, middle), height]
        off = [q[i] - axis[i] for i in range(3)]
        w = [-x for x in d]
        line = {"origin": [dot3(a, off) for a in axes], "w": [dot3(a, w) for a in axes]}
        # Plies turn evenly along the cloth.
        line["lean"] = c
        line["turns"] = self.turns(is_warp, yarn, along) if self.most_plies > 1 else 0.0
        return line, axes, axis

    def meet_at(self, is_warp, yarn, ply, is_hit, start, d, at):
        """What a line meets at a place of it: all of the ply (of one ply the last two do not count), the yarn's axes, the point of its axis, the light's direction."""
        of = lambda key: self.of_family(key, is_warp)
        line, axes, axis = self.straightened(is_warp, yarn, start, d, at)
        if self.most_plies == 1:
            met = self.meet_one(of, line)
        else:
            met = self.meet_ply(of, is_warp, line, ply, is_hit)
            if self.least_plies == 1:
                met = select_met(of("plies") == 1.0, self.meet_one(of, line), met)
        return met, axes, axis, line["w"]


def select_met(here, a, b):
    """The one meeting or the other."""
    return {key: [dr.select(here, p, q) for p, q in zip(a[key], b[key])] if isinstance(b[key], list) else dr.select(here, a[key], b[key]) for key in b}
