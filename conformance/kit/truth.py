"""Checks against the data (../data), and against closed forms of the lobes' places, widths and tilts."""
import functools
import json
from pathlib import Path

import numpy as np

from checks import INTEGRAL, POINT, check, far_apart, missed, place, spread
from sphere import direction, spiral

DATA = Path(__file__).resolve().parent.parent / "data"
NAMES = ["R", "TT", "TRT", "later"]
VERSION = 1


@functools.cache
def rows(name):
    found = json.loads((DATA / f"{name}.json").read_text())
    if found["version"] != VERSION:
        raise RuntimeError(f"data/{name}.json: version = {found['version']}: this kit reads {VERSION}")
    return found["rows"]


def inside(s, **values):
    """Whether the model takes these parameters."""
    return all(name in s.ranges and s.ranges[name][0] <= v <= s.ranges[name][1] for name, v in values.items())


def thinned(s, found, step):
    """Every row, or some of them with --fast: a step that no axis' length divides meets all their values."""
    return found[::step] if s.fast else found


@check("energy of lobes", {"smooth_cylinder"}, ("fiber",))
def energies(s):
    """integral of each lobe of the near field = A_p(h, theta, eta, tau) of one ray traced in three dimensions.

    Lobes of a model that spreads light have the energies of a smooth cylinder at the same incidence. A model that
    answers one sum is compared by the sum. Limit: INTEGRAL and the value's own error."""
    for row in thinned(s, rows("cylinder_near"), 7):
        for tau, a in row["energy"].items():
            if s.fast and tau not in ("0.0", "2.0") or not inside(s, eta=row["eta"], tau=float(tau)):
                continue
            wi = direction(np.radians(row["theta_deg"]), 0.7)
            q = s.query(wi, row["h"], "near", eta=row["eta"], tau=float(tau))
            expected = np.array(a) if s.model.get("lobes") else np.sum(a)
            found, resolution = s.integral(q, "eval", expected)
            yield missed(found, expected, resolution), INTEGRAL + row["error"], place(q)


@check("energy of the far field", {"smooth_cylinder", "far_is_mean"}, ("fiber",))
def far_energies(s):
    """The same for the mean over the width. The reference's own sum over offsets is stated by its limit: a mean by 12
    nodes is good to 0.01, as R and TT have infinite slopes at the rim."""
    for row in thinned(s, rows("cylinder_far"), 7):
        for tau, a in row["energy"].items():
            if inside(s, eta=row["eta"], tau=float(tau)) and not (s.fast and tau != "0.5"):
                q = s.query(direction(np.radians(row["theta_deg"]), 0.7), 0.0, "far", eta=row["eta"], tau=float(tau))
                expected = np.array(a) if s.model.get("lobes") else np.sum(a)
                found, resolution = s.integral(q, "eval", expected)
                yield missed(found, expected, resolution), 0.01 + row["error"], place(q)


@check("absorption by path", {"smooth_cylinder"}, ("fiber",))
def path(s):
    """Lambert's law: A_p(tau) / A_p(0) = exp(-p tau way), way = one pass over the diameter, from the traced ray.

    The ratio needs no Fresnel term. Only TT and TRT, where a lobe has more than 1e-4 of the light.
    Value: distance of the log ratio over tau; limit: INTEGRAL in the smaller energy, carried to the ratio."""
    if not s.model.get("lobes"):
        return
    for row in thinned(s, rows("cylinder_near"), 11):
        wi, tau = direction(np.radians(row["theta_deg"]), 0.7), 0.5
        if not inside(s, eta=row["eta"], tau=tau):
            continue
        clear, dark = (s.integral(s.query(wi, row["h"], "near", eta=row["eta"], tau=t))[0] for t in (0.0, tau))
        for p in (1, 2):
            if row["energy"]["0.5"][p] > 1e-2:
                # Not max(): a lobe that is gone or NaN must fail.
                log = np.log(clear[p] / dark[p]) / tau if clear[p] > 0.0 and dark[p] > 0.0 else np.inf
                limit = 2.0 * INTEGRAL / (tau * row["energy"]["0.5"][p])
                yield abs(log - p * row["way"]), limit, f"{NAMES[p]} {place(s.query(wi, row['h'], 'near', eta=row['eta']))}"


def moments(s, q):
    """Energy and mean of (cos phi, sin phi, sin theta) of each lobe, phi from wi."""
    f = s.on_grid(q).reshape(len(s.grid.wo), -1)
    phi = s.grid.phi - np.arctan2(q["wi"][1], q["wi"][0])
    energy = s.grid.integral(f)
    means = [s.grid.integral(f * x[:, None]) / energy for x in (np.cos(phi), np.sin(phi), s.grid.wo[:, 2])]
    return energy, means


@check("azimuth of lobes", {"smooth_cylinder"}, ("fiber",))
def azimuths(s):
    """The circular mean of each lobe's azimuth is where the traced ray of that order leaves.

    A lobe symmetric about its center, wrapped around the circle, has its circular mean there, whatever its width.
    Lobes with more than 1e-4 of the light. Limit: 2 INTEGRAL over the length of the mean vector. A model that answers
    one sum is asked at tau = 5, where R is most of the light: the other lobes turn the mean by asin(others / R) at
    most, over the length of R's mean vector, for which 0.5 is taken."""
    split = s.model.get("lobes")
    for row in thinned(s, rows("cylinder_near"), 7):
        if not inside(s, eta=row["eta"], tau=5.0):
            continue
        a = row["energy"]["0.0" if split else "5.0"]
        wi, narrow = direction(np.radians(row["theta_deg"]), 0.7), {"beta_n": s.ranges["beta_n"][0]} if s.has("beta_n") else {}
        q = s.query(wi, row["h"], "near", eta=row["eta"], tau=0.0 if split else 5.0, **({} if split else narrow))
        _, (cos, sin, _) = moments(s, q)
        for p in range(3 if split else 1):
            others = 0.0 if split else 2.0 * sum(a[1:]) / a[0]
            if a[p] > 1e-4 and others < 0.5:
                off = abs((np.arctan2(sin[p], cos[p]) - row["phi"][p] + np.pi) % (2.0 * np.pi) - np.pi)
                limit = 2.0 * INTEGRAL / max(np.hypot(cos[p], sin[p]), 1e-3) + np.arcsin(others)
                yield off, limit, f"{NAMES[p]} {place(q)}"


def kappa_mean(v):
    """Mean cosine of a von Mises-Fisher lobe of variance v: coth(1/v) - v."""
    return 1.0 / np.tanh(1.0 / v) - v


@check("cone", {"smooth_cylinder"}, ("fiber",))
def cone(s):
    """A cylinder keeps the latitude: without tilt every lobe is around -theta_i.

    Value: |mean sin theta_o + sin theta_i| of R, TT, TRT at the least beta_m, at |theta_i| below 50 degrees. A lobe of
    standard deviation b shifts this mean by b^2 at most (the sine's curvature, and the pole). b is measured: the
    lobe's own rms distance. Limit: b^2 + INTEGRAL with b at most 0.4."""
    if not s.model.get("lobes"):
        return
    for theta in (0.2, -0.8):
        q = s.query(direction(theta, 0.7), 0.4, "near", **({"beta_m": s.ranges["beta_m"][0]} if s.has("beta_m") else {}))
        f = s.on_grid(q)
        energy, (_, _, sin) = moments(s, q)
        for p in range(3):
            b2 = s.grid.integral(f[:, p] * (s.grid.theta + theta) ** 2) / energy[p]
            yield abs(sin[p] + np.sin(theta)), min(b2, 0.16) + INTEGRAL, f"{NAMES[p]} {place(q)}"


@check("widths of Chiang", {"chiang"}, ("fiber",))
def widths(s):
    """The roughness that the user gives is that of Chiang 2016, sections 4.1 and 4.2.

    Along: M is the mean over the azimuth of a von Mises-Fisher lobe with kappa = 1/v, so that the mean of sin theta_o
    is -sin theta_i (coth(1/v) - v), exactly, with v = (0.726 b + 0.812 b^2 + 3.7 b^20)^2 for R, v/4 for TT, 4v for TRT.
    Around: the length of the mean vector of R is that of a logistic of scale s, cut to [-pi, pi].
    Limit: INTEGRAL, over |sin theta_i| for the first."""
    if not s.model.get("lobes"):
        return
    theta = 0.9
    for beta in (0.3, 0.6, 0.9):
        q = s.query(direction(theta, 0.7), 0.4, "near", beta_m=beta, beta_n=beta)
        energy, (cos, sin, along) = moments(s, q)
        v = (0.726 * beta + 0.812 * beta**2 + 3.7 * beta**20) ** 2
        for p, share in enumerate((1.0, 0.25, 4.0)):
            expected = -np.sin(theta) * kappa_mean(share * v)
            yield abs(along[p] - expected) / np.sin(theta), 2.0 * INTEGRAL, f"along {NAMES[p]} {place(q)}"
        scale = np.sqrt(np.pi / 8.0) * (0.265 * beta + 1.194 * beta**2 + 5.372 * beta**22)
        x = np.linspace(-np.pi, np.pi, 20001)
        density = 1.0 / np.cosh(0.5 * x / scale) ** 2
        length = (density * np.cos(x)).sum() / density.sum()
        yield abs(np.hypot(cos[0], sin[0]) - length), 2.0 * INTEGRAL, f"around R {place(q)}"


@check("tilt of the scales", {"smooth_cylinder"}, ("fiber",))
def tilt(s):
    """Scales tilted by a small alpha shift R by -2 alpha toward the root, TT and TRT toward the tip.

    By Snell's law to first order in alpha, for light across the fiber: a normal turned by alpha turns the mirrored
    ray by 2 alpha; TT meets two such normals and leaves 2 (eta - 1) alpha further, TRT three, (4 eta - 2) alpha. Papers
    take 1 (Marschner, d'Eon, Chiang) for TT and 3 (Marschner) or 4 (d'Eon, Chiang) for TRT. Which end of z is the tip
    is convention: the sign of R sets it. Value: distance of shift / alpha from the nearest of these intervals; limit:
    0.15, as a mean latitude of a wide lobe is pulled to 0 by its width (coth(1/v) - v)."""
    if not (s.model.get("lobes") and s.has("alpha", "eta")):
        return
    low = {"beta_m": s.ranges["beta_m"][0]} if s.has("beta_m") else {}
    alpha, eta = 0.05, s.ranges["eta"][2]
    for theta in (0.0, 0.5):
        centers = []
        for a in (0.0, alpha):
            q = s.query(direction(theta, 0.7), 0.2, "near", alpha=a, **low)
            f = s.on_grid(q)
            centers.append(s.grid.integral(f * s.grid.theta[:, None]) / s.grid.integral(f))
        shift = (centers[1] - centers[0])[:3] / alpha
        shift = shift * -np.sign(shift[0])
        for p, (a, b) in enumerate([(-2.0, -2.0), sorted((1.0, 2.0 * (eta - 1.0))), sorted((3.0, max(4.0, 4.0 * eta - 2.0)))]):
            slack = 0.15 * max(abs(a), abs(b))
            yield max(a - shift[p], shift[p] - b, 0.0), slack, f"{NAMES[p]} {place(q)}"


@check("far is the mean of near", {"far_is_mean"}, ("fiber", "ply"))
def far_is_mean(s):
    """The far field is the mean over h of the near field, h uniform in [-1, 1]; so is what is straight.

    By Gauss-Legendre over asin h with 128 nodes. Limit: 1 % of the largest value, which a table's interpolation may
    cost, and the difference that half the nodes make."""
    for wi, _ in s.incidences()[: 2 if s.fast else 4]:
        wo = spread(s, 100)
        means, straight = [], 0.0
        for nodes in (64, 128):
            x, w = np.polynomial.legendre.leggauss(nodes)
            h, w = np.sin(0.5 * np.pi * x), 0.25 * np.pi * w * np.cos(0.5 * np.pi * x)
            means.append(sum(wk * s.eval(s.query(wi, hk, "near"), wo) for hk, wk in zip(h, w)))
            straight = sum(wk * s.straight(s.query(wi, hk, "near")) for hk, wk in zip(h, w))
        q = s.query(wi, 0.0, "far")
        yield abs(straight - s.straight(q)), 0.01, f"straight {place(q)}"
        yield far_apart(means[1], s.eval(q, wo)), 0.01 + far_apart(*means), place(q)


@check("metal", {"conductor"}, ("fiber",))
def metal(s):
    """Light reflected by a cylinder of a metal, near field and mean, against Fresnel's formulas. Limit: INTEGRAL."""
    for row in thinned(s, rows("metal_cylinder"), 2):
        wi, p = direction(np.radians(row["theta_deg"]), 0.7), {"eta": row["eta"], "kappa": row["kappa"]}
        asked = [("far", 0.0, row["far"])] if "far" in s.model["fields"] else []
        asked += [("near", h, r) for h, r in zip(row["h"], row["near"])] if "near" in s.model["fields"] else []
        for field, h, expected in asked:
            q = s.query(wi, h, field, **p)
            found, resolution = s.integral(q, "eval", expected)
            yield missed(np.sum(found), expected, resolution), INTEGRAL, place(q)


@check("rough plane", {"ggx_plane"}, ("surface",))
def rough_plane(s):
    """Reflected and transmitted light of a rough dielectric plane of GGX facets, against facets drawn and Snell's law.

    Compared by side with light that meets one facet, masked by G1(wi) G1(wo). Limit: INTEGRAL and five standard
    errors. eta < 1 is asked from below."""
    for row in rows("rough_plane"):
        below = row["eta"] < 1.0
        eta = 1.0 / row["eta"] if below else row["eta"]
        if not inside(s, eta=eta, alpha=row["alpha"]) or (below and "two_sided" not in s.claims):
            continue
        wi = direction(0.5 * np.pi - np.radians(row["theta_deg"]), 0.4) * np.array([1.0, 1.0, -1.0 if below else 1.0])
        q = s.query(wi, eta=eta, alpha=row["alpha"])
        grid, found = s.grid, None
        for _ in range(3):
            f, up = s.on_grid(q, "eval", grid), (grid.wo[:, 2] * wi[2] > 0.0)
            before, found = found, np.array([grid.weight[up] @ f[up], grid.weight[~up] @ f[~up]])
            resolution = np.inf if before is None else np.max(np.abs(found - before))
            if resolution < 0.2 * INTEGRAL:
                break
            grid = grid.finer()
        off = max(missed(found[k], row["single"][k], resolution) - 5.0 * row["se_single"][k] for k in range(2))
        if off > INTEGRAL:
            f, up = s.on_spiral(q), spiral()[:, 2] * wi[2] > 0.0
            found, resolution = np.array([f[up].sum(), f[~up].sum()]) * 4.0 * np.pi / len(f), 0.0
        for k, side in enumerate(("reflected", "transmitted")):
            yield missed(found[k], row["single"][k], resolution), INTEGRAL + 5.0 * row["se_single"][k], f"{side} {place(q)}"


@check("equals the reference", {"chiang"}, ("fiber",))
def equals_reference(s):
    """A model that says it is Chiang's has the values of reference.py. Limit: POINT of the largest value."""
    from reference import Reference

    if isinstance(s.adapter, Reference) or s.model.get("mutation"):
        return
    truth = Reference()
    for q in s.queries():
        if q["field"] == "near":
            q2 = {**q, "parameters": {"alpha": 0.0, "tau": 0.0, **q["parameters"]}}
            yield far_apart(s.eval(q, spread(s)), truth.eval(q2, spread(s)).sum(axis=1)), 5.0 * POINT, place(q)
