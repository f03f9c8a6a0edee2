"""Gradients of a walk where the cloth is moved under its line, in Dr.Jit.

Which plies a line comes near, and in what order, is found without gradients (``_walk.py``). Of the plies that are kept, all that depends smoothly on the place is evaluated here once
more: where on the line each is met, r_d of those before it as a product, what it scatters, the edges of a gap. Left out is what jumps: another ply, another class of light between
yarns, plies that are not kept.
"""

import drjit as dr

from ._flight import NO_YARN, family_of
from ._kit import detached
from ._yarns import TAU

# Step of the difference along a line, part of the yarn's half width; the least change of what is sought along
# it; room within a rim, part of the squared radius, where the way to the rim is as the way to the axis.
STEP, MIN_RISE, RIM = 0.02, 0.1, 1e-3


def beyond(cloth, which, start, d, at):
    """How far a place of the line lies behind the one at which a ply is met; 0 there."""
    kit = cloth.kit
    (which, ply), is_hit = (which >> 4, (which >> 1) & 7), (which & 1) == 1
    is_warp, yarn = family_of(kit, which)
    of = lambda key: cloth.of_family(key, is_warp)
    one = cloth.beside(is_warp, yarn, start, d, at) if cloth.least_plies == 1 else None
    if cloth.most_plies == 1:
        return one
    line, _, _ = cloth.straightened(is_warp, yarn, start, d, at)
    places = cloth.places_of_plies(is_warp)
    turn = places[0]
    for n in range(1, cloth.most_plies):
        turn = [dr.select(ply == n, a, b) for a, b in zip(places[n], turn)]
    shift, radius = line["origin"][2], of("radius")
    s, c = dr.sincos(TAU * (line["turns"] + shift * line["lean"] * of("turns_per_um")))
    met, _, _ = cloth.cylinder(of, line, *turn, shift, c, s)
    room = radius * radius - met["h"] * met["h"]
    entry = met["nearest"] + dr.sqrt(dr.maximum(room, RIM * radius * radius)) / met["sine"]
    several = dr.select(is_hit, entry, met["nearest"])
    return several if one is None else dr.select(of("plies") == 1.0, one, several)


def place_on_line(cloth, which, start, d, at):
    """A place of the line at which a ply is met, as it moves with the line."""
    flat = detached(start)
    half = STEP * cloth.of_family("half_width", family_of(cloth.kit, which >> 4)[0])
    ahead, behind = (beyond(cloth, which, flat, d, at + step) for step in (half, -half))
    rise = dr.maximum(dr.detach((ahead - behind) / (2.0 * half)), MIN_RISE)
    change = beyond(cloth, which, start, d, at)
    return at - (change - dr.detach(change)) / rise


def ratio(value, product):
    """What a product without gradients is multiplied by for a value."""
    product = dr.detach(product)
    return dr.select(product > 1e-20, value / dr.maximum(product, 1e-20), 1.0)


def again(self, si, own, start, d, s):
    """The state of a walk's loop with the gradients of the line's place and of the absorptions."""
    kit, cloth = self.kit, self.cloth
    s, kept = dict(s), s["kept"]
    none, product = kit.zero_s(), kit.float(1.0)
    classes, plies, energy_last = [kit.zero_s() for _ in s["classes"]], kit.zero_s(), kit.zero_s()
    main, is_found, places, arriving = list(s["main"]["q"]), kit.bool(False), [], []
    for i, (which, place, arrives) in enumerate(zip(kept["yarn"], kept["place"], kept["arrives"])):
        here = s["count"] > i
        which, place = dr.select(here, which, 0), dr.select(here, place, 0.0)
        place = place_on_line(cloth, which, start, d, place)
        hit = cloth.hit(which, start, d, place)
        model, theta_i, h = cloth.model_of(hit), hit["theta_i"], hit["h"]
        energies = cloth.plies.energies(model, theta_i, h)
        arrives = product * ratio(arrives, product)
        through = cloth.plies.transmittances(model, self.sigma_of(si, own, hit))
        sent = dr.select(here, arrives * (kit.S(energies[1]) + cloth.plies.high_energy(energies[2], through)), none)
        is_last = s["last_kept"] == i
        cls = dr.select(hit["is_warp"], kit.uint(0), kit.uint(2)) + dr.select(hit["is_double"], kit.uint(1), kit.uint(0))
        classes = [e + dr.select((cls == c) & ~is_last, sent, none) for c, e in enumerate(classes)]
        plies, energy_last = plies + dr.select(is_last, none, sent), energy_last + dr.select(is_last, sent, none)
        is_main = here & hit["is_hit"] & ~is_found
        is_found = is_found | is_main
        main = [dr.select(is_main, x, y) for x, y in zip([theta_i, h, *hit["frame"][0], *hit["frame"][2]], main)]
        product = dr.select(here, product * energies[0], product)
        places.append(place)
        arriving.append(arrives)
    s["passing"] = product * ratio(s["passing"], product)
    s["kept"] = kept | {"place": places, "arrives": arriving}
    s |= {"classes": classes, "plies": plies, "main": s["main"] | {"q": main}, "last": s["last"] | {"energy": energy_last}}
    if self.gaps is not None:
        edges = []
        for which, place, room in zip(s["edge_yarn"], s["edge_place"], s["aperture"]):
            some = which != NO_YARN
            which, place = dr.select(some, which, 0), dr.select(some, place, 0.0)
            hit = cloth.hit(which, start, d, place_on_line(cloth, which, start, d, place))
            edges.append(dr.select(some, room_beside(cloth, hit)[0], room))
        s["aperture"] = edges
    return s


def room_beside(cloth, hit):
    """How far the line may be moved across before it meets a ply (src/fabric/hit.rs) [um], and whether beyond it."""
    per_um = dr.select(hit["is_warp"], hit["frame"][0][0], hit["frame"][0][1])
    room = dr.maximum(dr.abs(hit["h"]) - cloth.of_family("radius", hit["is_warp"]), 0.0) / dr.maximum(dr.abs(per_um), 1e-3)
    return room, (hit["h"] < 0.0) == (per_um > 0.0)
