"""The way of a line through a fabric and the light of the plies on it, in Dr.Jit (``src/fabric/bsdf.rs``, ``at.rs``).

A walk finds what does not depend on the direction of the light: the plies that the line comes near, what passes them, what they send to other yarns. It keeps of each ply its
yarn and its place on the line, a few at most, and draws one of them for a sample. A second loop adds up their light in all directions of a call at once, so that each ply is
interpolated once.

Mitsuba 3.9 does not hand ``eval_pdf_sample`` on to plugins in Python: it calls ``eval_pdf`` and then ``sample``, of the same point. So the walk of one point stays until the
walk of the next, while kernels are recorded; the variables that describe a point identify it.
"""

import drjit as dr

from ._flight import NO_YARN
from ._kit import detached, dot3
from ._moved import again, room_beside
from ._ply import clear_share, exit_lines
from ._speckle import instance
from ._tables import MAX_NEAR, MIN_CAUGHT

#: Plies that are kept: the one that the line meets, and those beside it.
KEPT = MAX_NEAR + 1
# src/fabric/at.rs
MIN_FREE, FOR_SHADOWS = 0.4, 1.25


def walked(self, si, active, is_last=False):
    """``walk`` of the plugin, or what it found before of the same point; kept for the next call but for the last of a point."""
    if not (self.kit.jit and dr.flag(dr.JitFlag.SymbolicScope)):
        return self.walk(si, active)
    inputs = [self.kit.bool(active), si.wi, si.uv, si.dp_du, si.dp_dv, si.sh_frame.n, si.t, si.duv_dx, si.duv_dy, si.p, si.prim_index, si.wavelengths, si.time]
    variables = list(_variables(inputs))
    # Where gradients are suspended, the answer has none.
    key = ([(v.index, getattr(v, "index_ad", 0)) for v in variables], dr.grad_enabled(self.probe))
    last, self.last = self.last, None
    at = last[2] if last is not None and last[0] == key else self.walk(si, active)
    if not is_last and not dr.grad_enabled(at["up"], at["down"], self.um_per_uv, *(x for x in at["own"] if x is not None)):
        # Results with gradients are not kept. The variables are kept too, so that their numbers are not
        # reused.
        self.last = (key, variables, at)
    return at


def _variables(value):
    """All Dr.Jit variables of arrays in a list."""
    if isinstance(value, list):
        for v in value:
            yield from _variables(v)
    elif dr.is_array_v(value):
        if dr.depth_v(value) > 1:
            for i in range(len(value)):
                yield from _variables(value[i])
        else:
            yield value


def walk(self, si, active):
    """Follows the line of ``si.wi`` through the cloth."""
    kit, cloth = self.kit, self.cloth
    own = self.own_sigmas(si, active)
    share = None
    if self.far is not None:
        share = self.far_share(si)
        active = kit.both(active, share < 1.0)
    detach = dr.detach if kit.jit else (lambda x: x)
    wo = [detach(x) for x in self.to_pattern(si, si.wi)]
    # Where the scale of uv has gradients, the walk is followed without any, and the plies that it keeps are
    # evaluated again.
    is_moved = kit.jit and dr.grad_enabled(self.um_per_uv)
    start, d, state = cloth.begin(self.place(si), wo, active)
    moved, given = start, detached(own) if is_moved else own
    start = [detach(x) for x in start]
    zero, none = kit.float(0.0), kit.zero_s()
    loop = {
        "state": state,
        "passing": kit.float(1.0),
        "others": kit.uint(0),
        # Kept for each ply: its yarn, its place on the line, the light that arrives, the mean energy that it
        # scatters; the number of plies, and the last of those that are distinguished.
        "kept": {key: [kit.int(NO_YARN) if key == "yarn" else zero] * KEPT for key in ("yarn", "place", "arrives", "weight")},
        "count": kit.uint(0),
        "last_kept": kit.uint(KEPT),
        "classes": [kit.zero_s() for _ in range(cloth.classes)],
        "plies": kit.zero_s(),
        # The ply that the line hits: whether there is one, theta_i, h, model, axes x and z; the yarns that
        # dye the light between yarns.
        "main": {"is": kit.bool(False), "q": [zero] * 8, "model": kit.uint(0)},
        "dyed": {"is": kit.bool(False), "yarns": [kit.int(0), kit.int(0)]},
        # The last of the plies beside it, of which those beyond scatter more.
        "last": {"more": kit.float(1.0), "catch": zero, "class": kit.uint(0), "energy": kit.zero_s()},
    }
    if self.gaps is not None:
        loop["aperture"] = [kit.float(cloth.yarn[k]["spacing"]) for k in (0, 0, 1, 1)]
        if is_moved:
            # The plies that are the gap's edges.
            loop |= {"edge_yarn": [kit.int(NO_YARN)] * 4, "edge_place": [zero] * 4}

    def body(own, s):
        s = dict(s)
        state, which, place = cloth.next_near(start, d, s["state"])
        hit = cloth.hit(which, start, d, place)
        model = cloth.model_of(hit)
        on = state["on"]
        theta_i, h = hit["theta_i"], hit["h"]
        main, last = dict(s["main"]), dict(s["last"])
        is_main = kit.both(kit.both(on, hit["is_hit"]), kit.no(main["is"]))
        energies = cloth.plies.energies(model, theta_i, h)
        r_d, met = energies[0], 1.0 - energies[0]
        arrives = s["passing"]
        beside = kit.both(on, kit.no(is_main))
        beside = kit.both(beside, arrives * met >= MIN_CAUGHT)
        is_other = kit.both(beside, s["others"] < MAX_NEAR)
        is_beyond = kit.both(beside, s["others"] >= MAX_NEAR)
        is_last = kit.both(is_other, s["others"] == MAX_NEAR - 1)
        counted = is_main | is_other
        sigma = self.sigma_of(si, own, hit)
        through = cloth.plies.transmittances(model, sigma)
        energy = kit.S(energies[1]) + cloth.plies.high_energy(energies[2], through)
        sent = dr.select(counted, arrives * energy, none)
        s["plies"] = s["plies"] + dr.select(is_last, none, sent)
        cls = dr.select(hit["is_warp"], kit.uint(0), kit.uint(2)) + dr.select(hit["is_double"], kit.uint(1), kit.uint(0))
        s["classes"] = [e + dr.select(kit.both(cls == c, kit.no(is_last)), sent, none) for c, e in enumerate(s["classes"])]
        # Beyond as many as are told apart, the last of them scatters what others catch.
        more = dr.select(is_beyond, 1.0 + arrives * met / dr.maximum(last["catch"], MIN_CAUGHT), 1.0)
        last["more"] = last["more"] * more
        last["catch"] = dr.select(is_last, arrives * met, last["catch"] * more)
        last["class"] = dr.select(is_last, cls, last["class"])
        last["energy"] = last["energy"] + dr.select(is_last, sent, none)
        new = {"yarn": which, "place": place, "arrives": arrives, "weight": detach(kit.mean(sent))}
        at = [kit.both(counted, s["count"] == i) for i in range(KEPT)]
        s["kept"] = {key: [dr.select(here, new[key], x) for here, x in zip(at, old)] for key, old in s["kept"].items()}
        s["last_kept"] = dr.select(is_last, s["count"], s["last_kept"])
        s["count"] = s["count"] + dr.select(counted, kit.uint(1), kit.uint(0))
        q = [theta_i, h, *hit["frame"][0], *hit["frame"][2]]
        if self.gaps is not None:
            room, beyond = room_beside(cloth, hit)
            aside = kit.both(on, kit.no(is_main))
            edges = [
                kit.both(hit["is_warp"] if k == 0 else kit.no(hit["is_warp"]), beyond if far else kit.no(beyond))
                for k in range(2)
                for far in (False, True)
            ]
            if is_moved:
                nearer = [aside & e & (room < a) for e, a in zip(edges, s["aperture"])]
                s["edge_yarn"] = [dr.select(n, which, x) for n, x in zip(nearer, s["edge_yarn"])]
                s["edge_place"] = [dr.select(n, place, x) for n, x in zip(nearer, s["edge_place"])]
            s["aperture"] = [dr.select(kit.both(aside, e), dr.minimum(a, room), a) for e, a in zip(edges, s["aperture"])]
        main["q"] = [dr.select(is_main, x, y) for x, y in zip(q, main["q"])]
        main["model"] = dr.select(is_main, kit.uint(model), main["model"])
        main["is"] = main["is"] | is_main
        dyed = dict(s["dyed"])
        takes = kit.both(counted, hit["is_hit"] | (kit.no(dyed["is"])))
        yarns = [dr.select(hit["is_warp"], hit["yarn"], hit["other"]), dr.select(hit["is_warp"], hit["other"], hit["yarn"])]
        dyed["yarns"] = [dr.select(takes, x, y) for x, y in zip(yarns, dyed["yarns"])]
        dyed["is"] = dyed["is"] | takes
        s["others"] = s["others"] + dr.select(is_other, kit.uint(1), kit.uint(0))
        passing = dr.select(counted | is_beyond, arrives * r_d, arrives)
        state = dict(state)
        state["on"] = kit.both(on, passing >= MIN_CAUGHT)
        s |= {"state": state, "passing": passing, "main": main, "last": last, "dyed": dyed}
        return (s,)

    (s,) = kit.loop((loop,), lambda s: s["state"]["on"], body, "plies", given)
    if is_moved:
        s = again(self, si, own, moved, d, s)
    last = s["last"]
    classes = [e + dr.select(last["class"] == c, last["more"] * last["energy"], none) for c, e in enumerate(s["classes"])]
    yarns = s["dyed"]["yarns"]
    dyes = [self.sigma_of(si, own, {"is_warp": kit.bool(k == 0), "yarn": yarns[k]}) for k in range(2)]
    spectra = None if self.gaps is None else self.gaps.at(s["aperture"])
    out = answer(self, si, own, wo, (classes, dyes), s, s["plies"] + last["more"] * last["energy"], spectra)
    return out | {
        "line": (moved if is_moved else start, d),
        "is_moved": is_moved,
        "last_kept": s["last_kept"],
        "more": last["more"],
        "far_share": share,
    }


def answer(self, si, own, wo, between, s, of_plies, spectra):
    """What a line meets as queries need it: the light between yarns, of the energies of first plies by class and the absorptions in ``between``, what passes all plies, the chances of
    all parts (``set_chances`` of src/fabric/at.rs)."""
    kit, cloth = self.kit, self.cloth
    detach = dr.detach if kit.jit else (lambda x: x)
    up, down, about, caught = cloth.between(wo, *between)
    of_plies = detach(of_plies)
    plies = kit.mean(of_plies)
    root = lambda x: dr.sqrt(kit.mean(x * x))
    chance_up, chance_down = (FOR_SHADOWS * root(detach(x)) for x in (up, down))
    free = dr.maximum(1.0 - detach(caught) / dr.maximum(of_plies, 1e-30), MIN_FREE)
    direct = root(of_plies * dr.sqrt(free * dr.sqrt(free)))
    is_edge = kit.both(s["main"]["is"], kit.bool(cloth.options["edges"] and cloth.plies.some_edge))
    if not cloth.plies.has_edge:
        is_edge = kit.both(is_edge, cloth.plies.number("edge", s["main"]["model"]) > 0.5)
    is_aperture = kit.bool(False)
    if spectra is not None:
        open_ = kit.both(kit.both(spectra[0].passes(), spectra[1].passes()), wo[2] != 0.0)
        is_aperture = kit.both(kit.no(s["main"]["is"]), open_)
    is_diffracted = is_edge | is_aperture
    passing = detach(s["passing"])
    total = direct + chance_up + chance_down + passing
    per = dr.select(total > 0.0, 1.0 / dr.maximum(total, 1e-30), 0.0)
    out = {
        "wo": wo,
        "up_sign": dr.select(wo[2] < 0.0, -1.0, 1.0),
        "passing": s["passing"],
        "is_edge": is_edge,
        "is_aperture": is_aperture,
        "spectra": spectra,
        "main": s["main"],
        "up": up,
        "down": down,
        "about": about,
        "per_ply": dr.select(plies > 0.0, per * direct / dr.maximum(plies, 1e-30), 0.0),
        "chances": [per * direct, per * dr.select(is_diffracted, passing, 0.0), per * chance_up, per * chance_down],
        "straight": per * dr.select(is_diffracted, 0.0, passing),
        "own": own,
        "kept": s["kept"],
        "count": s["count"],
    }
    return out if self.far is None else out | {"far": self.mean_at(si, own, wo)}


def plies_light(self, si, at, directions):
    """f of the plies of a walk and the sum of energies times densities of their lobes, in each of these directions of the pattern."""
    kit, cloth = self.kit, self.cloth
    options, own, (start, d) = cloth.options, at["own"], at["line"]
    gradients = kit.jit and dr.grad_enabled(self.dyes, self.um_per_uv, *(x for x in own if x is not None))
    arounds = [cloth.shadow_direction(b) for b in directions]
    counts = [dr.select(b[2] * at["up_sign"] < 0.0, kit.bool(options["layers"]), kit.bool(options["shadowing"])) for b in directions]
    detach = dr.detach if kit.jit else (lambda x: x)
    kept, given = {key: [detach(x) for x in values] for key, values in at["kept"].items()}, own
    if at["is_moved"]:
        given = (own, start, at["kept"])

    def body(given, i, sums):
        own, line, of = given if at["is_moved"] else (given, start, kept)
        arrives = _of(of["arrives"], i)
        arrives = dr.select(i == at["last_kept"], arrives * at["more"], arrives)
        hit = cloth.hit_at({key: _of(of[key], i) for key in cloth.WHERE}, line, d)
        model = cloth.model_of(hit)
        theta_i, h, frame = hit["theta_i"], hit["h"], hit["frame"]
        sigma = self.sigma_of(si, own, hit, at.get("corner"))
        energies = cloth.plies.energies(model, theta_i, h)
        towards = [[dot3(a, b) for a in frame] for b in directions]
        lights = cloth.plies.lobes_towards(model, theta_i, h, sigma, towards, energies, gradients, self.slit_of(si, hit, at))
        exits = cloth.plies.exits(model, theta_i, h, cloth.ply_radius(hit))
        share, out = clear_share(sigma), []
        if self.speckle is not None:
            ply, along, across = cloth.pattern_of(hit, at)
            patterns = instance(kit, ply, along, across, cloth.grain)
        for n, (b, v, (refl, high, of_slit, density)) in enumerate(zip(directions, towards, lights)):
            if self.speckle is not None:
                factors = self.speckle.factors(model, patterns, dr.sin(theta_i), v, self.lambda_um(si))
                refl, high = refl * factors[0], high * factors[1]
            free = cloth.free(hit, model, b, exit_lines(exits, v), arounds[n], counts[n])
            light = free[0] * refl + (free[2] + share * (free[1] - free[2])) * (high + of_slit)
            f, sum_d = sums[n]
            out.append((f + arrives * light, sum_d + arrives * detach(density)))
        return i + 1, out

    state = (kit.uint(0), [(kit.zero_s(), kit.float(0.0)) for _ in directions])
    _, sums = kit.loop(state, lambda i, sums: i < at["count"], body, "light of plies", given)
    return sums


def chosen_ply(self, si, at, number):
    """One of the plies of a walk, by a number in [0, 1), as often as by its energy."""
    kit, cloth, (start, d) = self.kit, self.cloth, at["line"]
    detach = dr.detach if kit.jit else (lambda x: x)
    sums = []
    for i, weight in enumerate(at["kept"]["weight"]):
        weight = dr.select(at["last_kept"] == i, weight * at["more"], weight)
        sums.append(detach(weight) + (sums[-1] if sums else 0.0))
    chosen, threshold = kit.uint(0), number * sums[-1]
    for i in range(KEPT - 1):
        chosen = dr.select(threshold >= sums[i], kit.uint(i + 1), chosen)
    chosen = dr.minimum(chosen, dr.maximum(at["count"], 1) - 1)
    hit = cloth.hit_at({key: detach(_of(at["kept"][key], chosen)) for key in cloth.WHERE}, start, d)
    q = [hit["theta_i"], hit["h"], *hit["frame"][0], *hit["frame"][2]]
    return {"q": q, "model": cloth.model_of(hit), "hit": hit, "slit": self.slit_of(si, hit, at)}


def _of(values, i):
    """An entry of a short list by its number."""
    value = values[0]
    for n in range(1, len(values)):
        value = dr.select(i == n, values[n], value)
    return value
