"""A woven fabric in Dr.Jit: the plies that a line comes near, shadows of yarns on their neighbors, light between yarns.

The tables are those of ``src/fabric/tensors.rs``; the formulas those of ``flight.rs``, ``yarn.rs``, ``place.rs``, ``at.rs``, ``shadow.rs``, ``between.rs``, ``splines.rs``.
A line is followed in a loop of the kernel. At each ply that it comes near, its light is added up and it is weighed against the others as the one that a sample is drawn
of, so that no list of plies is kept.
"""

import math

import drjit as dr
import numpy as np

from ._kit import clamp, cross3, dot3
from ._ply import Plies, clear_share, exit_lines, read_container

TAU = 2.0 * math.pi
# src/fabric/flight.rs
LEAST_STEP_UM, CLOSE_UM, NEAREST, MOST_ROUNDS, MOST_STEPS, PASSED, MARGIN_UM = 1.0, 3.0, 0.001, 7, 1024, 8, 1.0
NO_YARN = -(2**31)
# src/fabric/bsdf.rs, place.rs, at.rs
LEAST_CAUGHT, MAX_NEAR, NARROW, FAR_UM = 1e-3, 4, 0.2, 1e7
# src/fabric/shadow.rs
PLACES, ROWS, COLUMNS, OFFSETS, SIZE = 4, 8, 16, 7, 2 * 8 * 16
MEAN_Z = [0.017678, 0.082322, 0.175568, 0.290118, 0.422526, 0.570634, 0.732919, 0.908235]
# src/fabric/between.rs, splines.rs
SIGMAS, LENGTH_UM, CLASSES, COUNT, SPLINE_COLUMNS, INTERVALS = 8, 150.0, 4, 168, 24, 5

YARN = "plies radius circle half_width spacing per_spacing reach turns_per_um slope norm step amplitude arc_radius arc steepest".split()


def two_thirds(z):
    root = dr.sqrt(z)
    c = 0.4 + 0.6 * root
    for _ in range(2):
        c = c - (c * c * c - root) / (3.0 * c * c)
    return c * c * c * c


def sigma_nodes(kit, sigma):
    """Node below an absorption and the fraction to the next."""
    x = (1.0 - 1.0 / (1.0 + clamp(sigma, 0.0, 1e6) * LENGTH_UM)) * (SIGMAS - 1)
    node = dr.minimum(dr.floor(dr.detach(x) if kit.jit else x), SIGMAS - 2.0)
    return kit.uint(node), x - node


def polynomials(w):
    x, y, z = w[0], w[1], dr.abs(w[2])
    d, e = x * x - y * y, 2.0 * x * y
    return [1.0, z, z * z, z * z * z, x, y, x * z, y * z, d, e, d * z, e * z, d * z * z, e * z * z, d * d - e * e, 2.0 * d * e]


def few(t):
    return [t[0], t[1], t[2], t[3], t[4], t[5], t[8], t[9]]


class Cloth:
    """Tables and geometry of a fabric on the device."""

    def __init__(self, kit, tensors):
        self.kit = kit
        self.plies = Plies(kit, [read_container(bytes(b), "model")[0] for b in tensors["models"]])
        self.models = len(tensors["models"])
        self.yarn = [dict(zip(YARN, map(float, row))) for row in tensors["yarn"]]
        self.turn = tensors["turn"]
        self.most_plies = int(max(y["plies"] for y in self.yarn))
        self.top, self.grain, self.edge_step, self.curve_length = map(float, tensors["scalars"])
        self.options = dict(zip(("diffracted", "speckle", "layers", "shadowing", "edges"), (v > 0.5 for v in tensors["options"])))
        draft = tensors["draft"]
        self.picks, self.ends = draft.shape
        self.threads = [self.ends, self.picks]
        bits = draft.ravel().astype(np.uint64)
        self.draft_word = int(sum(int(b) << i for i, b in enumerate(bits))) if bits.size <= 32 else None
        packed = np.packbits(np.pad(draft.ravel(), (0, -bits.size % 32)), bitorder="little").view("<u4")
        self.draft = kit.words(packed)
        self.stripes = [tensors["stripes_warp"], tensors["stripes_weft"]]
        self.dyes = [tensors["threads_warp"], tensors["threads_weft"]]
        self.lists = {}
        for name, lists in (("stripes", self.stripes), ("dyes", self.dyes)):
            self.lists[name] = [None if len(set(of.tolist())) == 1 else kit.words(of) for of in lists]
        self.free_table = kit.words(np.ascontiguousarray(tensors["shadow_free"]).reshape(-1).view("<u4"))
        patterns = tensors["shadow_patterns"]
        self.patterns = kit.words(patterns) if patterns.size else None
        curve = tensors["curve"]
        self.curve_nodes = len(curve)
        self.curve = kit.floats(curve)
        at_one = 1.0 / (1.0 + self.curve_length)
        self.curve_range = (float(np.interp(at_one, curve[::-1, 0], curve[::-1, 1])), float(curve[0, 1]))
        widths = np.diff(np.float32(MEAN_Z))
        self.mean_z = kit.floats(np.stack([MEAN_Z[:-1], 1.0 / widths], 1))
        caught = np.zeros((2, CLASSES, SIGMAS - 1, COUNT, 8), np.float32)
        of = tensors["between_caught"].transpose(0, 1, 3, 4, 2)
        caught[..., 0:3], caught[..., 3:6] = of[:, :, :-1], of[:, :, 1:]
        self.caught = kit.floats(caught)
        self.leaves = kit.floats(tensors["between_leaves"])
        self.shape = kit.floats(tensors["between_shape"])

    # Draft and yarns

    def of_family(self, key, is_warp):
        a, b = self.yarn[0][key], self.yarn[1][key]
        return a if a == b else dr.select(is_warp, a, b)

    def other_family(self, key, is_warp):
        a, b = self.yarn[1][key], self.yarn[0][key]
        return a if a == b else dr.select(is_warp, a, b)

    def modulo(self, x, n):
        """Of a signed index, 0 to n - 1."""
        if n == 1:
            return self.kit.uint(0)
        if not self.kit.jit:
            return int(x) % n
        r = x - (x // n) * n if False else x % n
        return self.kit.UInt(dr.select(r < 0, r + n, r))

    def entry(self, name, is_warp, yarn):
        """Entry of a yarn in the lists of both families that repeat."""
        kit, values = self.kit, []
        for k, raw in enumerate(self.stripes if name == "stripes" else self.dyes):
            table = self.lists[name][k]
            values.append(int(raw[0]) if table is None else kit.take_word(table, self.modulo(yarn, len(raw))))
        if isinstance(values[0], int) and values[0] == values[1] if isinstance(values[1], int) else False:
            return kit.uint(values[0])
        return dr.select(is_warp, kit.uint(values[0]), kit.uint(values[1]))

    def bit(self, at):
        if self.draft_word is not None:
            word = self.kit.UInt(self.draft_word) if self.kit.jit else self.draft_word
            return ((word >> at) & 1) == 1
        return ((self.kit.take_word(self.draft, at >> 5) >> (at & 31)) & 1) == 1

    def is_on_top(self, is_warp, yarn, crossing):
        """Whether a yarn lies above at a crossing with the other family; ``is_warp`` may be a Python bool."""
        if is_warp is True:
            return self.bit(self.modulo(crossing, self.picks) * self.ends + self.modulo(yarn, self.ends))
        if is_warp is False:
            up = self.bit(self.modulo(yarn, self.picks) * self.ends + self.modulo(crossing, self.ends))
            return ~up if self.kit.jit else not up
        pick, end = dr.select(is_warp, crossing, yarn), dr.select(is_warp, yarn, crossing)
        return self.bit(self.modulo(pick, self.picks) * self.ends + self.modulo(end, self.ends)) == is_warp

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

    def axis_at(self, is_warp, yarn, along):
        whole, first = self.kit.floor(along * self.other_family("per_spacing", is_warp) - 0.5)
        u = along * self.other_family("per_spacing", is_warp) - 0.5 - whole
        start, to = self.is_on_top(is_warp, yarn, first), self.is_on_top(is_warp, yarn, first + 1)
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

    def model_of(self, hit):
        """Index of the model of a yarn: a number where all have the same."""
        if self.models == 1:
            return 0
        return self.entry("stripes", hit["is_warp"], hit["yarn"])

    def sigma_of_brightness(self, brightness):
        """The absorption with which the cloth has a brightness: clear fibers above its range, black ones below (src/color/absorption.rs)."""
        kit, last = self.kit, self.curve_nodes - 2
        low, high = kit.uint(0), kit.uint(last)
        # The last node whose value is not below the brightness.
        for _ in range(max(1, math.ceil(math.log2(last + 1)))):
            middle = (low + high + 1) >> 1
            up = kit.take(self.curve, middle * 2 + 1) >= brightness
            low, high = dr.select(up, middle, low), dr.select(up, high, middle - 1 if not kit.jit else dr.maximum(middle, 1) - 1)
        v0, a, v1, b = (kit.take(self.curve, low * 2 + i) for i in range(4))
        v = v0 + dr.select(a > b, clamp((a - brightness) / dr.maximum(a - b, 1e-12), 0.0, 1.0), 0.0) * (v1 - v0)
        sigma = dr.minimum((1.0 / dr.maximum(v, 1e-9) - 1.0) / self.curve_length, 1.0)
        dark, bright = self.curve_range
        return dr.select(brightness > bright, 0.0, dr.select(brightness >= dark, sigma, 1.0))

    # A yarn and a line (src/fabric/yarn.rs)

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

    # The way of a line (src/fabric/flight.rs)

    def begin(self, position, w, active):
        """The state of the line through a point of the middle plane from the light at ``w``."""
        kit = self.kit
        position = [dr.select(dr.abs(p) <= FAR_UM, p, 0.0) for p in position]
        lift = dr.minimum(self.top / dr.maximum(dr.abs(w[2]), 1e-6), 1e5)
        start = [position[0] + lift * w[0], position[1] + lift * w[1], lift * w[2]]
        d = [-x for x in w]
        state = {
            "at": kit.float(0.0),
            "ids": [kit.int(NO_YARN)] * PASSED,
            "until": [kit.float(0.0)] * PASSED,
            "oldest": kit.uint(0),
            "on": kit.bool(active),
        }
        return start, d, state

    def nearest(self, q, ids, until, at):
        """The nearest hull that has not been asked: distance, yarn, and how far the line may go without meeting any."""
        kit = self.kit
        least, which, free = kit.float(1e30), kit.int(NO_YARN), 1e30
        for k in range(2):
            yarn, other = self.yarn[k], self.yarn[1 - k]
            hull = yarn["half_width"] + yarn["reach"] - yarn["radius"]
            whole, cell = kit.floor(q[k] * yarn["per_spacing"])
            t = q[k] * yarn["per_spacing"] - whole - 0.5
            left = t < 0.0
            step = dr.select(left, kit.int(-1), kit.int(1))
            along = q[1 - k] * other["per_spacing"] - 0.5
            whole, first = kit.floor(along)
            u = along - whole
            for index, offset in ((cell, t), (cell + step, dr.select(left, t + 1.0, t - 1.0))):
                name = index * 2 + k
                passed = kit.bool(False)
                for i in range(PASSED):
                    passed = passed | kit.both(ids[i] == name, at < until[i])
                start, to = (self.is_on_top(k == 0, index, first + n) for n in range(2))
                height, slope = self.joined(lambda key: yarn[key], start, to, u)
                lateral = offset * yarn["spacing"]
                up = (q[2] - height) * (q[2] - height) / (1.0 + slope * slope)
                distance = dr.sqrt(lateral * lateral + up) - hull
                nearer = kit.both(kit.no(passed), distance < least)
                least, which = dr.select(nearer, distance, least), dr.select(nearer, name, which)
            free = min(free, max(yarn["spacing"] - hull, 0.3 * yarn["half_width"]))
        return least, which, dr.minimum(free, 0.9 * least)

    def next_near(self, start, d, state):
        """Moves on to the next ply that the line comes near. The new state, its ``on`` false where there is none, and yarn and place of the line at which it was met."""
        kit, none = self.kit, kit_false(self.kit)

        def march(at, which, on, steps, ids, until):
            q = [start[i] + at * d[i] for i in range(3)]
            height = dr.abs(q[2])
            out = height > self.top
            gone = kit.both(out, q[2] * d[2] >= 0.0)
            distance, near, free = self.nearest(q, ids, until, at)
            close = kit.both(distance < CLOSE_UM, kit.no(out))
            way = dr.select(out, (height - self.top) / dr.maximum(dr.abs(d[2]), 1e-12) + 0.1 * MARGIN_UM, dr.maximum(free, LEAST_STEP_UM))
            which = dr.select(close, near, which)
            go = kit.no(gone | close)
            at = dr.select(go, at + way, at)
            on = kit.both(kit.both(on, kit.no(gone)), steps < MOST_STEPS)
            return at, which, on, steps + 1, ids, until

        def refine(at, round_, looking, which):
            is_warp, yarn = family_of(kit, which)
            met, _, _, _ = self.meet_at(is_warp, yarn, start, d, at)
            half = self.of_family("half_width", is_warp)
            step = clamp(-met["nearest"], -2.0 * half, 2.0 * half)
            stop = (dr.abs(step) < NEAREST * half) | (round_ == MOST_ROUNDS)
            return dr.select(stop, at, at + step), round_ + 1, kit.both(looking, kit.no(stop)), which

        def search(at, ids, until, oldest, on, searching, found_which, found_at):
            which = kit.int(NO_YARN)
            at, which, on, _, _, _ = kit.loop(
                (at, which, on, kit.uint(0), list(ids), list(until)),
                lambda at, which, on, steps, ids, until: kit.both(on, which == NO_YARN),
                march,
                "march",
            )
            has = kit.both(on, which != NO_YARN)
            place, _, _, _ = kit.loop(
                (at, kit.uint(0), has, which),
                lambda at, round_, looking, which: looking,
                refine,
                "refine",
            )
            is_warp, yarn = family_of(kit, which)
            met, axes, axis, _ = self.meet_at(is_warp, yarn, start, d, place)
            nearest = place - met["nearest"]
            hull = self.of_family("half_width", is_warp) + self.of_family("reach", is_warp) - self.of_family("radius", is_warp)
            # Where it leaves the hull, straight as the yarn is here.
            off = [start[i] + at * d[i] - axis[i] for i in range(3)]
            o, v = ([dot3(axes[i], x) for i in range(2)] for x in (off, d))
            a = v[0] * v[0] + v[1] * v[1]
            half = o[0] * v[0] + o[1] * v[1]
            room = half * half - a * (o[0] * o[0] + o[1] * o[1] - hull * hull)
            leaves = dr.select(kit.both(a > 1e-6, room > 0.0), (dr.sqrt(dr.maximum(room, 0.0)) - half) / dr.maximum(a, 1e-6), 0.0)
            end = at + clamp(leaves, LEAST_STEP_UM, 4.0 * hull)
            known = kit.bool(False)
            for i in range(PASSED):
                known = known | (ids[i] == which)
            slots = [dr.select(known, ids[i] == which, oldest == i) for i in range(PASSED)]
            was_oldest = kit.bool(False)
            for i in range(PASSED):
                was_oldest = was_oldest | kit.both(slots[i], oldest == i)
            ids = [dr.select(kit.both(has, slots[i]), which, ids[i]) for i in range(PASSED)]
            until = [dr.select(kit.both(has, slots[i]), end, until[i]) for i in range(PASSED)]
            oldest = dr.select(kit.both(has, was_oldest), dr.select(oldest == PASSED - 1, kit.uint(0), oldest + 1), oldest)
            at = dr.select(has, at + 0.1 * LEAST_STEP_UM, at)
            taken = dr.abs(met["h"]) < self.of_family("reach", is_warp)
            taken = kit.both(kit.both(taken, nearest > 0.0), dr.abs(nearest - at) < 6.0 * hull)
            taken = kit.both(has, taken)
            searching = kit.both(kit.both(searching, on), kit.no(taken))
            return at, ids, until, oldest, on, searching, dr.select(taken, which, found_which), dr.select(taken, place, found_at)

        s = state
        at, ids, until, oldest, on, _, which, place = kit.loop(
            (s["at"], list(s["ids"]), list(s["until"]), s["oldest"], s["on"], s["on"], kit.int(NO_YARN), kit.float(0.0)),
            lambda at, ids, until, oldest, on, searching, which, place: searching,
            search,
            "search",
        )
        on = kit.both(on, which != NO_YARN)
        return {"at": at, "ids": ids, "until": until, "oldest": oldest, "on": on}, which, place

    def hit(self, which, start, d, place):
        """All about the ply that a line comes near (``PlyHit`` of src/fabric/place.rs)."""
        kit = self.kit
        is_warp, yarn = family_of(kit, which)
        met, axes, axis, w = self.meet_at(is_warp, yarn, start, d, place)
        to_fabric = lambda v: [v[0] * axes[0][i] + v[1] * axes[1][i] + v[2] * axes[2][i] for i in range(3)]
        z, x = met["tangent"], met["x"]
        off = dot3(x, z)
        x = [x[i] - off * z[i] for i in range(3)]
        per = dr.rsqrt(dr.maximum(dot3(x, x), 1e-12))
        x = [a * per for a in x]
        frame = [to_fabric(v) for v in (x, cross3(z, x), z)]
        center = to_fabric(met["center"])
        along = dr.select(is_warp, axis[1] + center[1], axis[0] + center[0])
        beside = along * self.other_family("per_spacing", is_warp)
        whole, other = kit.floor(beside)
        double = dr.abs(beside - whole - 0.5) * self.other_family("spacing", is_warp) < self.other_family("half_width", is_warp)
        return {
            "is_warp": is_warp,
            "yarn": yarn,
            "other": other,
            "ply": met["ply"],
            "is_hit": met["hit"],
            "frame": frame,
            "theta_i": dr.atan2(dot3(w, met["tangent"]), met["sine"]),
            "h": met["h"],
            "along": along,
            "is_double": double,
            "off_axis": [met["center"][0] * axes[0][i] + met["center"][1] * axes[1][i] for i in range(3)],
        }

    # Shadows (src/fabric/shadow.rs, at.rs)

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
        for y in (-1, 0, 1):
            for c in (-1, 0, 1):
                on = self.is_on_top(is_warp, hit["yarn"] + y, crossing + c)
                bits = bits * 2 + dr.select(on, kit.uint(1), kit.uint(0))
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

    # Light between yarns (src/fabric/between.rs)

    def between(self, a, classes, sigma):
        """Energies that leave up and down, of a beam from ``a`` whose first plies scatter ``classes``, energies by class, in yarns of warp and weft of ``sigma``."""
        kit, n = self.kit, self.kit.count
        t = polynomials(a)
        terms = few(t)
        side = dr.select(a[2] < 0.0, kit.uint(1), kit.uint(0))
        # Splines of the direction.
        x = two_thirds(dr.minimum(dr.abs(a[2]), 1.0)) * INTERVALS
        row = dr.minimum(dr.floor(x), INTERVALS - 1.0)
        quadratic = lambda u: [0.5 * (1.0 - u) * (1.0 - u), 0.5 + u * (1.0 - u), 0.5 * u * u]
        column = dr.atan2(a[1], a[0]) * (SPLINE_COLUMNS / TAU)
        whole, c = kit.floor(column)
        rows, columns = quadratic(x - row), quadratic(column - whole)
        spline = []
        for i in range(3):
            for j in range(3):
                at = (kit.uint(row) + i) * SPLINE_COLUMNS + kit.uint(c + (j + SPLINE_COLUMNS)) % SPLINE_COLUMNS
                spline.append((at, rows[i] * columns[j]))
        nodes = [[sigma_nodes(kit, sigma[f][k]) for k in range(n)] for f in range(2)]
        corners = [self.corners(nodes[0][k], nodes[1][k]) for k in range(n)]
        sent = [self.options["shadowing"], self.options["layers"]]

        def of_class(classes, cls):
            e = classes[CLASSES - 1]
            for c in range(CLASSES - 2, -1, -1):
                e = dr.select(cls == c, classes[c], e)
            return e

        def following(cls):
            """The next class with energy from ``cls`` on."""
            found = kit.uint(CLASSES)
            for c in range(CLASSES - 1, -1, -1):
                found = dr.select(kit.both(cls <= c, self.some(classes[c])), kit.uint(c), found)
            return found

        def body(given, cls, up, down):
            classes, fractions, weights = given
            energy = of_class(classes, cls)
            is_warp = cls < 2
            up, down = kit.S(up), kit.S(down)
            for k in range(n):
                node = dr.select(is_warp, nodes[0][k][0], nodes[1][k][0])
                u = dr.select(is_warp, fractions[0][k], fractions[1][k])
                at = ((side * CLASSES + cls) * (SIGMAS - 1) + node) * COUNT
                sums = [0.0] * 6
                for index, w in spline:
                    values = kit.packets(self.caught, (at + index) * 2, 2)
                    sums = [s + w * v for s, v in zip(sums, values)]
                of = [(1.0 - u) * sums[i] + u * sums[3 + i] for i in range(3)]
                per = energy[k] / dr.maximum(of[2], 1e-6)
                for cause in range(2):
                    if not sent[cause]:
                        continue
                    caught = clamp(per * of[cause], 0.0, energy[k])
                    for half in range(2):
                        at_leaves = (((side * CLASSES + cls) * 2 + cause) * 2 + half) * (SIGMAS * SIGMAS)
                        leaves = 0.0
                        for (pair, _), share in zip(corners[k], weights[k]):
                            values = kit.packets(self.leaves, (at_leaves + pair) * 2, 2)
                            leaves = leaves + share * sum(v * t for v, t in zip(values, terms))
                        out = caught * clamp(leaves, 0.0, 1.0)
                        if half == 0:
                            up[k] = up[k] + out
                        else:
                            down[k] = down[k] + out
            return following(cls + 1), up, down

        fractions = [[nodes[f][k][1] for k in range(n)] for f in range(2)]
        given = (list(classes), fractions, [[share for _, share in corners[k]] for k in range(n)])
        state = (following(kit.uint(0)), kit.zero_s(), kit.zero_s())
        _, up, down = kit.loop(state, lambda cls, up, down: cls < CLASSES, body, "light between yarns", given)
        return up, down, (side, corners)

    def some(self, s):
        any_ = s[0] > 0.0
        for k in range(1, self.kit.count):
            any_ = any_ | (s[k] > 0.0)
        return any_

    @staticmethod
    def corners(warp, weft):
        (i, x), (j, y) = warp, weft
        at = i * SIGMAS + j
        return [(at, (1.0 - x) * (1.0 - y)), (at + 1, (1.0 - x) * y), (at + SIGMAS, x * (1.0 - y)), (at + SIGMAS + 1, x * y)]

    def between_eval(self, about, up, down, is_up, b):
        """f in direction ``b`` [1/sr]."""
        kit = self.kit
        side, corners = about
        half = dr.select(is_up, kit.uint(0), kit.uint(1))
        terms, cos = polynomials(b), dr.abs(b[2])
        energy, f = dr.select(is_up, up, down), kit.zero_s()
        for k in range(kit.count):
            shape = 0.0
            for pair, weight in corners[k]:
                values = kit.packets(self.shape, ((side * 2 + half) * (SIGMAS * SIGMAS) + pair) * 4, 4)
                shape = shape + weight * sum(v * t for v, t in zip(values, terms))
            f[k] = energy[k] * dr.maximum(shape * cos, 0.0)
        return f


def kit_false(kit):
    return kit.bool(False)


def family_of(kit, which):
    """Whether a yarn is of the warp, and its number."""
    if kit.jit:
        return (which & 1) == 0, which >> 1
    return which % 2 == 0, which // 2
