"""Yarns of a fabric in Dr.Jit: the draft, the yarns' axes, and the ply of a yarn that a line meets.

The formulas are those of ``src/fabric/profile.rs``, ``yarn.rs``, ``place.rs``.
"""

import math

import drjit as dr
import numpy as np

from ._kit import cross3, dot3

TAU = 2.0 * math.pi


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
        slope, norm, circle, radius = of("slope"), of("norm"), of("circle"), of("radius")
        tangent = [-slope * sin * norm, slope * cos * norm, norm + 0.0 * cos]
        x, sine = self.across(w, tangent)
        d = [origin[0] - circle * cos, origin[1] - circle * sin, origin[2] - shift]
        h = dot3(d, x)
        room = radius * radius - h * h
        nearest = -dot3(d, cross3(tangent, x)) / sine
        entry = nearest + dr.sqrt(dr.maximum(room, 0.0)) / sine
        dt, wt = dot3(d, tangent), dot3(w, tangent)
        further = (dt + entry * wt) * tangent[2]
        along = dt + nearest * wt
        center = [origin[i] - d[i] + along * tangent[i] for i in range(3)]
        met = {"hit": room > 0.0, "h": h, "tangent": tangent, "x": x, "sine": sine, "nearest": nearest, "center": center}
        return met, entry, further

    def meet(self, is_warp, line):
        """The first ply of a yarn that a line meets; where it meets none, the one it comes nearest to."""
        kit = self.kit
        of = lambda key: self.of_family(key, is_warp)
        origin, w = line["origin"], line["w"]
        if self.most_plies == 1:
            zero, one = kit.float(0.0), kit.float(1.0)
            x, sine = self.across(w, [zero, zero, one])
            h = dot3(origin, x)
            nearest = -dot3(origin, cross3([zero, zero, one], x)) / sine
            center = [zero, zero, origin[2] + nearest * w[2]]
            hit = dr.abs(h) < of("radius")
            return {"hit": hit, "ply": kit.uint(0), "h": h, "tangent": [zero, zero, one], "x": x, "sine": sine, "nearest": nearest, "center": center}
        turn = [[(float(c), float(s)) for c, s in self.turn[k]] for k in range(2)]
        places = [[dr.select(is_warp, turn[0][n][i], turn[1][n][i]) for i in range(2)] for n in range(self.most_plies)]
        plies = of("plies")
        # How far along t the line meets the first of the circles that the plies are where the point is.
        sine2 = w[0] * w[0] + w[1] * w[1]
        per_sine = dr.rsqrt(dr.maximum(sine2, 1e-3))
        s, c = dr.sincos(TAU * line["turns"])
        first, met_any = kit.float(-1e30), kit.bool(False)
        circle, radius = of("circle"), of("radius")
        for n, (ck, sk) in enumerate(places):
            x, y = circle * (c * ck - s * sk), circle * (s * ck + c * sk)
            dx, dy = origin[0] - x, origin[1] - y
            h = (dx * w[1] - dy * w[0]) * per_sine
            room = radius * radius - h * h
            here = kit.both(room > 0.0, n < plies)
            entry = dr.sqrt(dr.maximum(room, 0.0)) - (dx * w[0] + dy * w[1]) * per_sine
            first = dr.select(here, dr.maximum(first, entry), first)
            met_any = met_any | here
        distance = dr.select(met_any, first, -(origin[0] * w[0] + origin[1] * w[1]) * per_sine)
        shift = dr.select(sine2 < 1e-3, origin[2], origin[2] + distance * per_sine * w[2])
        shift = dr.select(of("slope") == 0.0, 0.0, shift)
        turns = of("turns_per_um")
        s, c = dr.sincos(TAU * (line["turns"] + shift * turns))
        zero = kit.float(0.0)
        best = {"hit": kit.bool(False), "h": zero, "tangent": [zero, zero, kit.float(1.0)], "x": [kit.float(1.0), zero, zero], "sine": kit.float(1.0), "nearest": zero, "center": [zero] * 3}
        best_ply, first, near, step = kit.uint(0), kit.float(-1e30), kit.float(1e30), zero
        chosen = [places[0][0] + zero, places[0][1] + zero]

        def select(here, a, b):
            return {key: [dr.select(here, p, q) for p, q in zip(a[key], b[key])] if isinstance(b[key], list) else dr.select(here, a[key], b[key]) for key in b}

        for n, (ck, sk) in enumerate(places):
            met, entry, further = self.cylinder(of, line, ck, sk, shift, c, s)
            exists = n < plies
            is_hit = kit.both(kit.both(met["hit"], entry > first), exists)
            no_hit = kit.no(met["hit"] | best["hit"])
            is_near = kit.both(kit.both(no_hit, dr.abs(met["h"]) < near), exists)
            here = is_hit | is_near
            first, step = dr.select(is_hit, entry, first), dr.select(is_hit, further, step)
            near = dr.select(is_near, dr.abs(met["h"]), near)
            best = select(here, met, best)
            best_ply = dr.select(here, kit.uint(n), best_ply)
            chosen = [dr.select(here, ck, chosen[0]), dr.select(here, sk, chosen[1])]
        again = kit.both(kit.both(best["hit"], of("slope") != 0.0), dr.abs(step) < 2.0 * of("half_width"))
        shift = shift + step
        s, c = dr.sincos(TAU * (line["turns"] + shift * turns))
        met, _, _ = self.cylinder(of, line, chosen[0], chosen[1], shift, c, s)
        best = select(kit.both(again, met["hit"]), met, best)
        best["ply"] = best_ply
        return best

    def meet_at(self, is_warp, yarn, start, d, at):
        """A yarn, straight along its tangent at the place of the line that is ``at`` from its start."""
        q = [start[i] + at * d[i] for i in range(3)]
        along = dr.select(is_warp, q[1], q[0])
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
        line["turns"] = self.turns(is_warp, yarn, along) if self.most_plies > 1 else 0.0
        return self.meet(is_warp, line), axes, axis, line["w"]
