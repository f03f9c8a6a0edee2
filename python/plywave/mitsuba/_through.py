"""The plies that a line through a cloth of curves hits, and the light that they scatter, in Dr.Jit
(``src/cloth/model.rs``).

The hits are found without gradients (``_lines.py``). Where colors or the scale of uv have gradients, the light of the
retained plies is evaluated once more, one after the other.

Mitsuba 3.9 does not forward ``eval_pdf_sample`` to plugins in Python: it calls ``eval_pdf`` and then ``sample`` for
the same point. So the hits of a line are cached until the next line, while kernels are recorded; the variables that
describe a point identify it.
"""

import drjit as dr

from ._kit import detached
from ._inter_yarn import RATIOS
from ._light import KEPT, answer, entry
from ._tables import MAX_NEAR, MIN_CAUGHT

# src/cloth/model.rs, plies.rs
MIN_OWN, OFF = 0.05, 0.05


def walked(self, si, active, is_last=False):
    """Result of :func:`walk`, cached for the next call on the same point; the last call on a point does not cache it."""
    if not (self.kit.jit and dr.flag(dr.JitFlag.SymbolicScope)):
        return walk(self, si, active)
    inputs = [self.kit.bool(active), si.wi, si.uv, si.dp_du, si.dp_dv, si.sh_frame.n, si.t, si.duv_dx, si.duv_dy, si.p, si.prim_index, si.wavelengths, si.time]
    all_ = list(variables(inputs))
    # Results computed while gradients are suspended have none.
    key = ([(v.index, getattr(v, "index_ad", 0)) for v in all_], dr.grad_enabled(self.probe))
    last, self.last = self.last, None
    at = last[2] if last is not None and last[0] == key else walk(self, si, active)
    if not is_last and not dr.grad_enabled(at["up"], at["down"], self.um_per_uv, *(x for x in at["own"] if x is not None)):
        # Results with gradients are not cached. The variables are stored too, so that their indices are not
        # reused.
        self.last = (key, all_, at)
    return at


def variables(value):
    """All Dr.Jit variables of the arrays in a list."""
    if isinstance(value, list):
        for v in value:
            yield from variables(v)
    elif dr.is_tensor_v(value):
        yield value.array
    elif dr.is_array_v(value):
        if dr.depth_v(value) > 1:
            for i in range(len(value)):
                yield from variables(value[i])
        else:
            yield value


def walk(self, si, active):
    """Follows the line of ``si.wi`` through the cloth."""
    kit, cloth = self.kit, self.cloth
    own = self.own_sigmas(si, active)
    share, footprint = None, self.footprint(si)
    if self.far is not None:
        share = self.far_share(footprint)
        active = kit.both(active, share < 1.0)
    detach = dr.detach if kit.jit else (lambda x: x)
    wo = [detach(x) for x in self.to_pattern(si, si.wi)]
    d = [-x for x in wo]
    moved, corner = cloth.begin_line(self.place(si), wo)
    start = [detach(x) for x in moved]
    flat = detached(own)

    def passes(kind, theta_i, h_um, radius):
        h, off = h_um * cloth.scale_of(kind), OFF * radius
        return cloth.passed_mean(cloth.model_of({"kind": kind}), theta_i, h - off, h + off)

    place = None if cloth.hairs is None else cloth.hairs.here(cloth.uneven.place(self.place(si)), footprint)
    found, count = cloth.follow(start, d, active, passes)
    is_double = kit.bool(False)
    if self.slits is not None:
        kinds = [cloth.kind_of(piece) for piece in found["piece"]]
        for i, kind in enumerate(kinds):
            is_double = is_double | kit.both(count > i, kind != kinds[0])
    zero, none = kit.float(0.0), kit.zero_s()
    whole = ("piece", "cells", "class")
    loop = {
        "i": kit.uint(0),
        "on": count > 0,
        "passing": kit.float(1.0) if cloth.hairs is None else 1.0 - cloth.hairs.seen(cloth.hairs.side_of(wo), wo, place),
        # Stored for each ply: its position, its class, the light that arrives, and the mean energy that it
        # scatters.
        "kept": {key: [kit.uint(0) if key in whole else zero] * KEPT for key in (*cloth.WHERE, "class", "arrives", "weight")},
        "count": kit.uint(0),
        # Energies by class, including that of the last ply, which scatters what later plies intercept.
        "classes": [none] * cloth.classes,
        "plies": none,
        # Places of the plies, weighted by the light that they intercept.
        "ratios": [] if cloth.places is None else [zero] * (RATIOS + 1),
        "last": {"more": kit.float(1.0), "catch": zero, "class": kit.uint(0), "energy": none},
        "main": {"q": [zero] * 8, "model": kit.uint(0)},
        # Color of the first hit ply of each kind.
        "dyed": [kit.uint(dye) for dye in cloth.dye_mean],
        "is_dyed": [kit.bool(False)] * cloth.kinds,
    }

    def body(s):
        s, i = dict(s), s["i"]
        where = {key: entry(found[key], i) for key in cloth.WHERE}
        hit = cloth.hit_at(where, start, d)
        model, theta_i, h = cloth.model_of(hit), hit["theta_i"], hit["h"]
        energies = cloth.plies.energies(model, theta_i, h)
        arrives, r_d = s["passing"], energies[0]
        catch = arrives * (1.0 - r_d)
        is_main = kit.both(s["on"], i == 0)
        behind = kit.both(s["on"], i > 0)
        room = (s["count"] == 1) | kit.both(s["count"] <= MAX_NEAR, arrives > MIN_OWN)
        is_other = kit.both(kit.both(behind, room), catch >= MIN_CAUGHT)
        is_beyond = kit.both(behind, kit.no(room))
        counted = is_main | is_other
        through = cloth.plies.transmittances(model, self.sigma_of(si, flat, hit, corner))
        kind = hit["kind"]
        for k in range(cloth.kinds):
            if flat[k] is None:
                takes = kit.both(kit.both(counted, kind == k), kit.no(s["is_dyed"][k]))
                s["dyed"] = [dr.select(kit.both(takes, kit.bool(n == k)), cloth.dye_of(k, hit, corner), dye) for n, dye in enumerate(s["dyed"])]
                s["is_dyed"] = [is_dyed | kit.both(takes, kit.bool(n == k)) for n, is_dyed in enumerate(s["is_dyed"])]
        sent = dr.select(counted, arrives * (kit.S(energies[1]) + cloth.plies.high_energy(energies[2], through)), none)
        cls = class_of(cloth, hit["kind"], i, count)
        s["plies"] = s["plies"] + sent
        s["classes"] = [e + dr.select(cls == c, sent, none) for c, e in enumerate(s["classes"])]
        if cloth.places is not None:
            s["ratios"] = [x + dr.select(counted, catch, 0.0) * of for x, of in zip(s["ratios"], [*cloth.ratios_at(hit), 1.0])]
        last = s["last"]
        more = dr.select(is_beyond, 1.0 + catch / dr.maximum(last["catch"], MIN_CAUGHT), 1.0)
        s["last"] = {
            "more": last["more"] * more,
            "catch": dr.select(is_other, catch, last["catch"] * more),
            "class": dr.select(is_other, cls, last["class"]),
            "energy": dr.select(is_other, sent, last["energy"]),
        }
        new = where | {"class": cls, "arrives": arrives, "weight": kit.mean(sent)}
        at = [kit.both(counted, s["count"] == k) for k in range(KEPT)]
        s["kept"] = {key: [dr.select(here, new[key], x) for here, x in zip(at, old)] for key, old in s["kept"].items()}
        s["count"] = s["count"] + dr.select(counted, kit.uint(1), kit.uint(0))
        q = [theta_i, h, *hit["frame"][0], *hit["frame"][2]]
        main = s["main"]
        s["main"] = {"q": [dr.select(is_main, x, y) for x, y in zip(q, main["q"])], "model": dr.select(is_main, kit.uint(model), main["model"])}
        s["passing"] = dr.select(counted | is_beyond, arrives * r_d, arrives)
        s["i"] = i + 1
        s["on"] = kit.both(kit.both(s["on"], s["passing"] >= MIN_CAUGHT), s["i"] < count)
        return (s,)

    (s,) = kit.loop((loop,), lambda s: s["on"], body, "plies")
    last, several = s["last"], s["count"] > 1
    more = dr.select(several, last["more"] - 1.0, 0.0)
    s["classes"] = [e + dr.select(last["class"] == c, more * last["energy"], none) for c, e in enumerate(s["classes"])]
    s["plies"] = s["plies"] + more * last["energy"]
    s["main"] = s["main"] | {"is": s["count"] > 0}
    s["first_kind"] = kit.uint(0) if cloth.kinds == 1 else dr.select(count > 0, cloth.kind_of(found["piece"][0]), 0)
    last_kept = dr.select(several, s["count"] - 1, KEPT)
    is_moved = kit.jit and dr.grad_enabled(self.um_per_uv)
    if kit.jit and (is_moved or dr.grad_enabled(self.dyes, *(x for x in own if x is not None))):
        s = again(self, si, own, moved, d, s, last_kept, last["more"], corner)
    dyes = [self.dye(si, dye) if sigma is None else sigma for sigma, dye in zip(own, s["dyed"])]
    spectra = None
    if self.gaps is not None:
        spectra = self.gaps.at(*cloth.aperture(start, d, kit.both(active, s["count"] == 0)))
    hairs = None
    if cloth.hairs is not None:
        # Hairs have the color of the yarn below them.
        hairs = cloth.hairs.at(wo, [dyes[0], dyes[-1]], s["passing"], place)
        s = dict(s, classes=cloth.hairs.with_energies(s["classes"], hairs), passing=s["passing"] * hairs["passes_behind"])
    out = answer(self, si, own, wo, (s["classes"], [dyes[0], dyes[-1]]), s, s["plies"], spectra, hairs)
    return out | {
        "line": (moved if is_moved else start, d),
        "is_moved": is_moved,
        "last_kept": last_kept,
        "more": last["more"],
        "corner": corner,
        "is_double": is_double,
        "far_share": share,
        "footprint": footprint,
    }


def class_of(cloth, kind, i, count):
    """Class of the ``i``-th of ``count`` plies that a line hits."""
    kit = cloth.kit
    return kit.uint(kind) * (cloth.classes // 2) + dr.select(i > 0, kit.uint(2), kit.uint(0)) + dr.select(i + 1 < count, kit.uint(1), kit.uint(0))


def again(self, si, own, start, d, s, last_kept, more, corner):
    """The state of a walk's loop with the gradients of the line's position and of the absorptions."""
    kit, cloth = self.kit, self.cloth
    s, kept = dict(s), s["kept"]
    none, product = kit.zero_s(), kit.float(1.0)
    classes, plies, arriving = [kit.zero_s() for _ in s["classes"]], kit.zero_s(), []
    ratios = [kit.float(0.0) for _ in s["ratios"]]
    main = s["main"]
    for i in range(KEPT):
        here = s["count"] > i
        hit = cloth.hit_at({key: kept[key][i] for key in cloth.WHERE}, start, d)
        model, theta_i, h = cloth.model_of(hit), hit["theta_i"], hit["h"]
        energies = cloth.plies.energies(model, theta_i, h)
        arrives = product * ratio(kept["arrives"][i], product)
        through = cloth.plies.transmittances(model, self.sigma_of(si, own, hit, corner))
        grown = arrives * dr.select(last_kept == i, more, 1.0)
        sent = dr.select(here, grown * (kit.S(energies[1]) + cloth.plies.high_energy(energies[2], through)), none)
        classes = [e + dr.select(kept["class"][i] == c, sent, none) for c, e in enumerate(classes)]
        plies = plies + sent
        if cloth.places is not None:
            catch = dr.select(here, arrives * (1.0 - energies[0]), 0.0)
            ratios = [x + catch * of for x, of in zip(ratios, [*cloth.ratios_at(hit), 1.0])]
        if i == 0:
            q = [theta_i, h, *hit["frame"][0], *hit["frame"][2]]
            main = main | {"q": [dr.select(here, x, y) for x, y in zip(q, main["q"])]}
        product = dr.select(here, product * energies[0], product)
        arriving.append(arrives)
    s["passing"] = product * ratio(s["passing"], product)
    return s | {"kept": kept | {"arrives": arriving}, "classes": classes, "plies": plies, "ratios": ratios, "main": main}


def ratio(value, product):
    """Factor that converts a product without gradients to a value."""
    product = dr.detach(product)
    return dr.select(product > 1e-20, value / dr.maximum(product, 1e-20), 1.0)
