"""The way of a line through a fabric in Dr.Jit, from ply to ply, in a loop of the kernel.

The formulas are those of ``src/fabric/flight.rs`` and ``hit.rs``. No list of plies is kept: the line knows which yarns it has passed.
"""

import drjit as dr

from ._kit import clamp, cross3, dot3
from ._yarns import Yarns

# src/fabric/flight.rs
MIN_STEP_UM, CLOSE_UM, NEAREST, MAX_ROUNDS, MAX_STEPS, PASSED, MARGIN_UM = 1.0, 3.0, 0.001, 7, 1024, 8, 1.0
NO_YARN = -(2**31)
# A yarn that is found is named with its ply and whether that is met: 16 numbers a yarn.
PLIES = 16
FAR_UM = 1e7
LOOKED_AT = 4.0
AHEAD = 6.0
OWN = 2.5
# src/fabric/walk.rs
MAX_STRETCHES, NEXT = 24, 0.02
# Squared sine below which a line counts as parallel to a yarn.
PARALLEL = 1e-10


class Flight(Yarns):
    """Lines on their way. The tables are those of ``Cloth``."""

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
            # Where on the line a yarn of one ply was found last.
            "met": [kit.float(-1e30)] * (PASSED if self.least_plies == 1 else 0),
            "oldest": kit.uint(0),
            "on": kit.bool(active),
            # For a yarn whose plies scatter one by one: the yarn, and up to which place the line hits none of
            # the plies that it has left.
            "left": [kit.int(NO_YARN), *[kit.float(0.0)] * (self.most_plies if self.some_one_by_one else 0)],
        }
        return start, d, state

    def nearest(self, q, ids, until, at):
        """The nearest hull that has not been asked: distance, yarn, and how far the line may go without meeting any."""
        kit = self.kit
        least, which, free = kit.float(1e30), kit.int(NO_YARN), 1e30
        counts = [at < until[i] for i in range(PASSED)]
        for k in range(2):
            yarn, other = self.yarn[k], self.yarn[1 - k]
            hull = yarn["half_width"] + yarn["reach"] - yarn["radius"]
            whole, cell = kit.floor(q[k] * yarn["per_spacing"])
            t = q[k] * yarn["per_spacing"] - whole - 0.5
            left = t < 0.0
            step = dr.select(left, kit.int(-1), kit.int(1))
            along = q[1 - k] * other["per_spacing"] - 0.5
            whole, first = kit.floor(along)
            bent, cos2 = self.bent(yarn, along - whole)
            word = self.sides(k == 0, cell, first)
            nearest, name = kit.float(1e30), kit.int(NO_YARN)
            for index, offset, sides in ((cell, t, word >> 2), (cell + step, dr.select(left, t + 1.0, t - 1.0), dr.select(left, word, word >> 4))):
                this = index * 2 + k
                passed = kit.bool(False)
                for i in range(PASSED):
                    passed = passed | kit.both(ids[i] == this, counts[i])
                start, to = (sides & 1) != 0, (sides & 2) != 0
                level = start == to
                lateral, height = offset * yarn["spacing"], dr.select(level, yarn["amplitude"], bent)
                up = q[2] - dr.select(start, height, -height)
                squared = lateral * lateral + up * up * dr.select(level, 1.0, cos2)
                nearer = kit.both(kit.no(passed), squared < nearest)
                nearest, name = dr.select(nearer, squared, nearest), dr.select(nearer, this, name)
            distance = dr.sqrt(nearest) - hull
            nearer = distance < least
            least, which = dr.select(nearer, distance, least), dr.select(nearer, name, which)
            free = min(free, max(yarn["spacing"] - hull, 0.3 * yarn["half_width"]))
        return least, which, dr.minimum(free, 0.9 * least)

    def beside(self, is_warp, yarn, start, d, at):
        """How far a place of the line lies behind the one that is next to the axis of a yarn, straight along its tangent at this place."""
        q = [start[i] + at * d[i] for i in range(3)]
        height, slope = self.axis_at(is_warp, yarn, dr.select(is_warp, q[1], q[0]))
        axis = (self.kit.float(yarn) + 0.5) * self.of_family("spacing", is_warp)
        across, along = dr.select(is_warp, d[0], d[1]), dr.select(is_warp, d[1], d[0])
        cos2 = 1.0 / (1.0 + slope * slope)
        rise = d[2] - slope * along
        sine2 = dr.maximum(across * across + rise * rise * cos2, PARALLEL)
        return ((dr.select(is_warp, q[0], q[1]) - axis) * across + (q[2] - height) * rise * cos2) / sine2

    def next_near(self, start, d, state):
        """Moves on to the next ply that the line comes near. The new state, its ``on`` false where there is none, and name and place of the line at which it was met, for ``hit``."""
        kit = self.kit

        def march(at, which, on, steps, ids, until):
            q = [start[i] + at * d[i] for i in range(3)]
            height = dr.abs(q[2])
            out = height > self.top
            gone = kit.both(out, q[2] * d[2] >= 0.0)
            distance, near, free = self.nearest(q, ids, until, at)
            close = kit.both(distance < CLOSE_UM, kit.no(out))
            way = dr.select(out, (height - self.top) / dr.maximum(dr.abs(d[2]), 1e-12) + 0.1 * MARGIN_UM, dr.maximum(free, MIN_STEP_UM))
            which = dr.select(close, near, which)
            go = kit.no(gone | close)
            at = dr.select(go, at + way, at)
            on = kit.both(kit.both(on, kit.no(gone)), steps < MAX_STEPS)
            return at, which, on, steps + 1, ids, until

        def refine(at, round_, looking, which):
            is_warp, yarn = family_of(kit, which)
            nearest = self.beside(is_warp, yarn, start, d, at)
            half = self.of_family("half_width", is_warp)
            step = clamp(-nearest, -2.0 * half, 2.0 * half)
            stop = (dr.abs(step) < NEAREST * half) | (round_ == MAX_ROUNDS)
            return dr.select(stop, at, at + step), round_ + 1, kit.both(looking, kit.no(stop)), which

        def stretch(at, end, least, ply, place, is_hit, count, walking, which, left):
            is_warp, yarn = family_of(kit, which)
            of = lambda key: self.of_family(key, is_warp)
            line, _, _ = self.straightened(is_warp, yarn, start, d, at)
            skips = [kit.both(left[0] == which, at < until) for until in left[1:]] or [kit.bool(False)] * self.most_plies
            beside, step, first, least, passed, passed_at = self.ahead(of, is_warp, line, least, skips)
            place = dr.select(passed >= 0, at + passed_at, place)
            ply = dr.select(passed >= 0, passed, ply)
            at = at + step
            is_hit = kit.both(first >= 0, step < NEXT * of("radius"))
            ply, place = dr.select(is_hit, first, ply), dr.select(is_hit, at, place)
            (x, y, _), (wc, wn, _) = line["origin"], line["w"]
            hull = of("half_width") + of("reach") - of("radius")
            ends = (at > end) | kit.both(beside > hull, x * wc + y * wn < 0.0) | is_hit
            count = count + 1
            walking = kit.both(kit.both(walking, kit.no(ends)), count < MAX_STRETCHES)
            return at, end, least, ply, place, is_hit, count, walking, which, left

        def search(at, ids, until, met_at, oldest, on, searching, found_which, found_at, left):
            which = kit.int(NO_YARN)
            at, which, on, _, _, _ = kit.loop(
                (at, which, on, kit.uint(0), list(ids), list(until)),
                lambda at, which, on, steps, ids, until: kit.both(on, which == NO_YARN),
                march,
                "march",
            )
            has = kit.both(on, which != NO_YARN)
            is_warp, yarn = family_of(kit, which)
            one = self.of_family("plies", is_warp) == 1.0 if self.least_plies == 1 else False
            hull = self.of_family("half_width", is_warp) + self.of_family("reach", is_warp) - self.of_family("radius", is_warp)
            place, ply, is_hit, looked, known = at, kit.int(-1), kit.bool(False), at, has
            if self.least_plies == 1:
                place, _, _, _ = kit.loop(
                    (at, kit.uint(0), kit.both(has, one), which),
                    lambda at, round_, looking, which: looking,
                    refine,
                    "refine",
                )
            if self.most_plies > 1:
                several = has if one is False else kit.both(has, kit.no(one))
                end = at + LOOKED_AT * hull
                looked, _, _, ply, walked, is_hit, _, _, _, _ = kit.loop(
                    (at, end, kit.float(1e30), ply, at, is_hit, kit.uint(0), several, which, list(left)),
                    lambda at, end, least, ply, place, is_hit, count, walking, which, left: walking,
                    stretch,
                    "stretch",
                )
                place = walked if one is False else dr.select(one, place, walked)
                known = kit.both(has, ply >= 0 if one is False else (ply >= 0) | one)
            met, axes, axis, _ = self.meet_at(is_warp, yarn, ply, is_hit, start, d, place)
            nearest = place - met["nearest"]
            # Where it leaves the hull, straight as the yarn is here.
            off = [start[i] + at * d[i] - axis[i] for i in range(3)]
            o, v = ([dot3(axes[i], x) for i in range(2)] for x in (off, d))
            a = v[0] * v[0] + v[1] * v[1]
            half = o[0] * v[0] + o[1] * v[1]
            room = half * half - a * (o[0] * o[0] + o[1] * o[1] - hull * hull)
            leaves = dr.select(kit.both(a > 1e-6, room > 0.0), (dr.sqrt(dr.maximum(room, 0.0)) - half) / dr.maximum(a, 1e-6), 0.0)
            end = at + clamp(leaves, MIN_STEP_UM, LOOKED_AT * hull)
            if self.most_plies > 1:
                is_met = kit.both(is_hit, known) if one is False else kit.both(is_hit, known) | one
                end = dr.select(is_met, end, dr.maximum(looked, at + MIN_STEP_UM))
            if self.some_one_by_one:
                # Behind the ply that is met there may be another.
                leaves = kit.both(kit.both(has, is_hit), kit.both(known, self.of_family("one_by_one", is_warp) > 0.5))
                end = dr.select(leaves, dr.maximum(nearest, at), end)
                again = nearest + OWN * self.of_family("radius", is_warp)
                known_yarn = left[0] == which
                plies = [dr.select(ply == n, again, dr.select(known_yarn, until, 0.0)) for n, until in enumerate(left[1:])]
                left = [dr.select(leaves, a, b) for a, b in zip([which, *plies], left)]
            listed = kit.bool(False)
            for i in range(PASSED):
                listed = listed | (ids[i] == which)
            near = dr.abs(nearest - at) < AHEAD * hull
            is_new = True
            if met_at:
                # A line that stays near a yarn beyond the searched length finds the same place or, where the
                # yarn bends, the next.
                before = kit.float(-1e30)
                for i in range(PASSED):
                    before = dr.select(ids[i] == which, met_at[i], before)
                is_new = kit.no(kit.both(one, dr.abs(nearest - before) <= self.of_family("half_width", is_warp)))
                last = dr.select(near, nearest, before)
            slots = [dr.select(listed, ids[i] == which, oldest == i) for i in range(PASSED)]
            was_oldest = kit.bool(False)
            for i in range(PASSED):
                was_oldest = was_oldest | kit.both(slots[i], oldest == i)
            ids = [dr.select(kit.both(has, slots[i]), which, ids[i]) for i in range(PASSED)]
            until = [dr.select(kit.both(has, slots[i]), end, until[i]) for i in range(PASSED)]
            met_at = [dr.select(kit.both(has, slot), last, m) for slot, m in zip(slots, met_at)]
            oldest = dr.select(kit.both(has, was_oldest), dr.select(oldest == PASSED - 1, kit.uint(0), oldest + 1), oldest)
            at = dr.select(has, at + 0.1 * MIN_STEP_UM, at)
            taken = dr.abs(met["h"]) < self.of_family("reach", is_warp)
            taken = kit.both(kit.both(taken, nearest > 0.0), near)
            taken = kit.both(kit.both(known, is_new), taken)
            name = which * PLIES + dr.maximum(ply, 0) * 2 + dr.select(is_hit, kit.int(1), kit.int(0)) if self.most_plies > 1 else which * PLIES
            searching = kit.both(kit.both(searching, on), kit.no(taken))
            return at, ids, until, met_at, oldest, on, searching, dr.select(taken, name, found_which), dr.select(taken, place, found_at), left

        s = state
        at, ids, until, met_at, oldest, on, _, which, place, left = kit.loop(
            (s["at"], list(s["ids"]), list(s["until"]), list(s["met"]), s["oldest"], s["on"], s["on"], kit.int(NO_YARN), kit.float(0.0), list(s["left"])),
            lambda at, ids, until, met_at, oldest, on, searching, which, place, left: searching,
            search,
            "search",
        )
        on = kit.both(on, which != NO_YARN)
        return {"at": at, "ids": ids, "until": until, "met": met_at, "oldest": oldest, "on": on, "left": left}, which, place

    def hit(self, which, start, d, place):
        """All about the ply that a line comes near (``PlyHit`` of src/fabric/hit.rs)."""
        kit = self.kit
        (which, ply), is_hit = (which >> 4, (which >> 1) & 7) if kit.jit else (which // PLIES, which // 2 % 8), (which & 1) == 1
        is_warp, yarn = family_of(kit, which)
        met, axes, axis, w = self.meet_at(is_warp, yarn, ply, is_hit, start, d, place)
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
            "ply": kit.uint(ply),
            "is_hit": met["hit"],
            "frame": frame,
            "theta_i": dr.atan2(dot3(w, met["tangent"]), met["sine"]),
            "h": met["h"],
            "along": along,
            "is_double": double,
            "yarn_axis": axes[2],
            "off_axis": [met["center"][0] * axes[0][i] + met["center"][1] * axes[1][i] for i in range(3)],
        }


def family_of(kit, which):
    """Whether a yarn is of the warp, and its number."""
    if kit.jit:
        return (which & 1) == 0, which >> 1
    return which % 2 == 0, which // 2
