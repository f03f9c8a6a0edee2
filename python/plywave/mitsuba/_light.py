"""Light of the plies that a line through a cloth hits, in Dr.Jit (``src/cloth/bsdf.rs``).

The hits of a line (``_through.py``) do not depend on the direction of the light. A loop over the few retained plies
adds up their light in all directions of a call at once, so that each ply is interpolated once; a sample draws one of
the plies.
"""

import drjit as dr

from ._kit import detached, dot3
from ._ply import clear_share, exit_lines
from ._tables import MAX_NEAR

#: Number of retained plies: the first hit, and those behind it.
KEPT = MAX_NEAR + 1
# src/cloth/bsdf.rs
MIN_FREE, FOR_SHADOWS = 0.5, 1.35


def answer(self, si, own, wo, between, s, of_plies, spectra, hairs):
    """Prepares the hits of a line for queries: inter-yarn scattering, from the energies of first plies by class and the
    absorptions in ``between``; light that passes all plies; and the probabilities of all parts (``set_chances`` of
    src/cloth/bsdf.rs).
    """
    kit, cloth = self.kit, self.cloth
    detach = dr.detach if kit.jit else (lambda x: x)
    up, down, about, (caught, _) = cloth.inter_yarn(wo, *between)
    if cloth.places is not None:
        *ratios, weight = s["ratios"]
        sigma = between[1][0] if cloth.kinds == 1 else dr.select(s["first_kind"] == 0, *between[1])
        up, down, about, caught = cloth.at_place(wo, up, down, about, caught, ratios, weight, 1.0 - s["passing"], sigma)
    of_plies = detach(of_plies)
    plies = kit.mean(of_plies)
    root = lambda x: dr.sqrt(kit.mean(x * x))
    chance_up, chance_down = (FOR_SHADOWS * root(detach(x)) for x in (up, down))
    all_ = of_plies
    if hairs is not None:
        all_ = all_ + detach(sum(energy for side in hairs["sides"] for energy in side["energy"]))
    free = dr.maximum(1.0 - detach(caught) / dr.maximum(all_, 1e-30), MIN_FREE)
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
    of_hairs = [] if hairs is None else [root(detach(out)) for out in hairs["out"]]
    total = sum(of_hairs, total)
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
        "chances": [per * direct, per * dr.select(is_diffracted, passing, 0.0), per * chance_up, per * chance_down, *(per * chance for chance in of_hairs)],
        "hairs": hairs,
        "straight": per * dr.select(is_diffracted, 0.0, passing),
        "own": own,
        "kept": s["kept"],
        "count": s["count"],
    }
    return out if self.far is None else out | {"far": self.mean_at(si, own, wo)}


def plies_light(self, si, at, directions):
    """f of the plies of a walk, and the sum over their lobes of energy times density, in each of these directions of the
    pattern.
    """
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
        arrives = entry(of["arrives"], i)
        arrives = dr.select(i == at["last_kept"], arrives * at["more"], arrives)
        hit = cloth.hit_at({key: entry(of[key], i) for key in cloth.WHERE}, line, d)
        model = cloth.model_of(hit)
        theta_i, h, frame = hit["theta_i"], hit["h"], hit["frame"]
        sigma = self.sigma_of(si, own, hit, at["corner"])
        energies = cloth.plies.energies(model, theta_i, h)
        towards = [[dot3(a, b) for a in frame] for b in directions]
        lights = cloth.plies.lobes_towards(model, theta_i, h, sigma, towards, energies, gradients, self.slit_of(si, hit, at))
        exits = cloth.plies.exits(model, theta_i, h, cloth.ply_radius(hit))
        share, out = clear_share(sigma), []
        if self.speckle is not None or self.relief is not None:
            where = {key: detached(hit[key]) for key in ("frame", "curve", "parameter", "cells")}
            place = cloth.place_on(where, at["corner"], detached(at["wo"]), detached(at["footprint"]))
        if self.speckle is not None:
            patterns = self.speckle.at(model, *place, h)
        for n, (v, (refl, high, of_slit, density)) in enumerate(zip(towards, lights)):
            if self.speckle is not None:
                factors = self.speckle.factors(model, patterns, dr.sin(theta_i), v, self.lambda_um(si))
                refl, high = refl * factors[0], high * factors[1]
            if self.relief is not None:
                factors = self.relief.factors(hit["kind"], place, detached(h), detached(v))
                refl, high = refl * factors[0], high * factors[1]
            free = cloth.free(hit, model, exit_lines(exits, v), arounds[n], counts[n])
            light = free[0] * refl + (free[2] + share * (free[1] - free[2])) * (high + of_slit)
            f, sum_d = sums[n]
            out.append((f + arrives * light, sum_d + arrives * detach(density)))
        return i + 1, out

    state = (kit.uint(0), [(kit.zero_s(), kit.float(0.0)) for _ in directions])
    _, sums = kit.loop(state, lambda i, sums: i < at["count"], body, "light of plies", given)
    return sums


def chosen_ply(self, si, at, number):
    """Draws one of the plies of a walk from a number in [0, 1), in proportion to its energy."""
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
    hit = cloth.hit_at({key: detach(entry(at["kept"][key], chosen)) for key in cloth.WHERE}, start, d)
    q = [hit["theta_i"], hit["h"], *hit["frame"][0], *hit["frame"][2]]
    return {"q": q, "model": cloth.model_of(hit), "hit": hit, "slit": self.slit_of(si, hit, at)}


def entry(values, i):
    """Entry of a short list at a variable index."""
    value = values[0]
    for n in range(1, len(values)):
        value = dr.select(i == n, values[n], value)
    return value
