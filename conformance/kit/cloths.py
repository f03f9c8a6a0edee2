"""Checks of what is larger than a fiber: plies (strands of fibers) and cloths, seen as a mean over their cell.

Light that goes straight on is a delta apart from f: `straight` of a query, and `straight` of each sample.
Limits of the comparisons with traced fibers are those of `plywave check`.
"""
import numpy as np

from checks import INTEGRAL, POINT, check, far_apart, missed, place, spread
from sphere import direction
from truth import rows

LARGE = ("ply", "cloth")


@check("sampled straight", (), LARGE)
def sampled_straight(s):
    """The mean of `straight` over samples, 0 where one is scattered or absorbed, estimates what goes straight on.

    Limit: 4.5 standard errors of that mean, and POINT. A sample cannot be scattered and straight at once: 1 if so."""
    for q in s.queries():
        d = s.drawn(q)
        w = np.asarray(d.get("straight", np.zeros(s.samples)), float)
        both = float(np.any((w > 0.0) & (d["pdf"] > 0.0)))
        off = abs(w.mean() - s.straight(q)) / (w.std() / np.sqrt(s.samples) + POINT)
        yield max(both * 99.0, off) if np.isfinite(off) else np.nan, 4.5, place(q)


@check("not finite", (), LARGE)
def not_finite(s):
    """Numbers that are not finite, and a wi without length, give an error, or finite values that are not negative.

    Value: count of values that are not, 1 for an adapter that ends. Limit: 0."""
    q = s.query(s.incidences()[0][0], 0.2)
    wo, u = spread(s, 4), np.full((4, 3), 0.5)
    bad_wo = wo.copy()
    bad_wo[1] = np.nan
    bad_wo[2] = np.inf
    asked = [("wo", q, bad_wo)]
    asked += [(f"wi {w}", {**q, "wi": [w, w, w]}, wo) for w in (np.nan, np.inf, 0.0)]
    asked += [("h", {**q, "h": np.nan}, wo)] if "near" in s.model["fields"] else []
    asked += [(name, {**q, "parameters": {**q["parameters"], name: np.nan}}, wo) for name in s.ranges]
    for name, bad, w in asked:
        for call in (lambda: s.eval(bad, w), lambda: s.adapter.pdf(bad, w), lambda: s.adapter.straight(bad), lambda: drawn(s, bad, u)):
            try:
                v = np.asarray(call(), float)
                yield float(np.sum(~np.isfinite(v) | (v < 0.0))), 0.0, f"{name} not finite"
            except Exception as error:
                yield float("the adapter ended" in str(error)), 0.0, f"{name} not finite"


def drawn(s, q, u):
    d = s.adapter.sample(q, u)
    return np.concatenate([np.asarray(d[name], float).ravel() for name in ("weight", "pdf")])


@check("half turn", {"half_turn"}, LARGE)
def half_turn(s):
    """A ply laid the other way round is the same ply: a half turn about a line across it, (x, -y, -z), changes neither
    its twist nor f, with h to -h. A weave with a twofold axis is the same after a half turn about its normal.

    Limit: POINT, and what the model states for the claim."""
    ply = s.model["kind"] == "ply"
    flip = np.array([1.0, -1.0, -1.0] if ply else [-1.0, -1.0, 1.0])
    for q in s.queries():
        r = {**q, "wi": (np.array(q["wi"]) * flip).tolist(), "h": -q["h"]}
        wo = spread(s)
        yield far_apart(s.eval(q, wo), s.eval(r, wo * flip)), POINT + s.stated("half_turn"), place(q)


@check("mirror of twist", {"mirror"}, ("ply",))
def mirror_of_twist(s):
    """A mirror makes a Z twist an S twist: with `twist` to -twist, or without twist, f is the mirrored f.

    Of the mirror that holds the axis, (x, -y, z) with h to -h, and of that across it, (x, y, -z).
    Limit: POINT, and what the model states for the claim."""
    for q in s.queries():
        p = dict(q["parameters"])
        if "twist" in p:
            p["twist"] = -p["twist"]
            if not s.ranges["twist"][0] <= p["twist"] <= s.ranges["twist"][1]:
                continue
        wo = spread(s)
        for flip, h in ((np.array([1.0, -1.0, 1.0]), -q["h"]), (np.array([1.0, 1.0, -1.0]), q["h"])):
            r = {**q, "wi": (np.array(q["wi"]) * flip).tolist(), "h": h, "parameters": p}
            yield far_apart(s.eval(q, wo), s.eval(r, wo * flip)), POINT + s.stated("mirror"), place(q)


@check("straight through the gap", {"thin_gap"}, ("cloth",))
def thin_gap(s):
    """A sheet without thickness of which the share `gap` is open lets this share pass at any angle. Limit: POINT."""
    for q in s.queries():
        yield abs(s.straight(q) - q["parameters"]["gap"]), POINT, place(q)


@check("straight at most the light", (), LARGE)
def straight_bounded(s):
    """A share of light is between 0 and 1. Limit: 0."""
    for q in s.queries():
        v = s.straight(q)
        yield (max(0.0, -v, v - 1.0) if np.isfinite(v) else np.nan), 0.0, place(q)


def halves(s, q):
    """Light that leaves on wi's side of a cloth, and on the other, without what is straight; quadrature error."""
    grid, found = s.grid, None
    for _ in range(3):
        f, up = s.on_grid(q, "eval", grid), grid.wo[:, 2] * np.sign(q["wi"][2]) > 0.0
        f = f.sum(axis=1) if f.ndim == 2 else f
        before, found = found, np.array([grid.weight[up] @ f[up], grid.weight[~up] @ f[~up]])
        if before is not None and np.all(np.abs(found - before) < 0.2 * INTEGRAL):
            return found, 0.0
        grid = grid.finer()
    return found, float(np.max(np.abs(found - before)))


@check("authored albedo", {"albedo"}, ("cloth",))
def authored_albedo(s):
    """R + T under an even sky all round, over the light that does not go straight, is the `albedo` that was authored.

    The sky's light falls with the cosine: sum of |cos theta_i| (R + T) over sum of |cos theta_i| (1 - straight), by
    Gauss-Legendre in the cosine and even azimuths, on both sides. A sheet whose R + T depends on the direction has
    its mean right. Limit: INTEGRAL, and what the model states for the claim."""
    x, w = np.polynomial.legendre.leggauss(3 if s.fast else 4)
    mu, w = 0.5 * (x + 1.0), 0.5 * w
    turns = np.arange(2 if s.fast else 4) * np.pi / (2 if s.fast else 4) * 2.0 + 0.3
    low, high, default = s.ranges["albedo"]
    for albedo in sorted({0.5 * (low + high), default, high}):
        light = met = 0.0
        for side in (1.0, -1.0):
            for m, wm in zip(mu, w):
                for turn in turns:
                    q = s.query(direction(side * np.arcsin(m), turn), albedo=albedo)
                    light += wm * m * float(np.sum(s.integral(q)[0]))
                    met += wm * m * (1.0 - s.straight(q))
        yield abs(light / met - albedo), INTEGRAL + s.stated("albedo"), f"albedo={albedo:.4g}"


@check("two layers", {"layers"}, ("cloth",))
def two_layers(s):
    """Two layers one on the other are one layer added to itself (van de Hulst's adding method), direction by direction.

    On quadrature directions K[o, i] = f(i -> o) w_o, and what is straight goes from i to -i. With the light D that
    goes down between the layers, D = Tt + Rb Rt D, so R2 = Rt + Tb Rt D and T2 = Tt D; t and b are a layer lit from
    above and from below. The quadrature is the same on both sides. Compared are R and T with straight light by wi.
    Limit: 2 INTEGRAL, and what the model states for the claim."""
    n, m = (4, 8) if s.fast else (6, 12)
    x, w = np.polynomial.legendre.leggauss(n)
    mu, turns = 0.5 * (x + 1.0), 2.0 * np.pi * np.arange(m) / m + 0.2
    up = np.array([direction(np.arcsin(z), t) for z in mu for t in turns])
    weight = np.repeat(0.5 * w, m) * 2.0 * np.pi / m
    both, twice = np.concatenate([up, -up]), np.concatenate([weight, weight])
    half = len(up)

    def matrix(layers):
        k = np.empty((2 * half, 2 * half))
        for i, wi in enumerate(both):
            q = s.query(wi, layers=layers, **fixed)
            k[:, i] = s.eval(q, both) * twice
            # The direction -wi has the index of the other half.
            k[(i + half) % (2 * half), i] += float(s.adapter.straight(q))
        return k[:half, :half], k[half:, :half], k[half:, half:], k[:half, half:]

    for fixed in s.cases()[: 3 if s.fast else 6]:
        fixed = {name: v for name, v in fixed.items() if name != "layers"}
        rt, tt, rb, tb = matrix(1)
        # Light that leaves downward as -up[k] falls on the next layer from up[k]: halves have the same order.
        down = np.linalg.solve(np.eye(half) - rb @ rt, tt)
        r2, t2 = rt + tb @ rt @ down, tt @ down
        got_r, got_t, _, _ = matrix(2)
        off = max(np.max(np.abs((a - b).sum(axis=0))) for a, b in ((r2, got_r), (t2, got_t)))
        yield float(off), 2.0 * INTEGRAL + s.stated("layers"), place(s.query(up[0], layers=2, **fixed))


def asked_of(s, name):
    """Rows of the data that the model says it stands for."""
    return [row for row in rows(name) if row["of"] == s.model.get("truth")]


@check("energy of traced cloth", {"traced"}, ("cloth",))
def traced_energy(s):
    """R, and T with what is straight, of the cloth's explicit fibers, by rays (data/cloths.json).

    Limit: 0.015, 0.03 beyond 60 degrees, and five standard errors of the rays."""
    for row in asked_of(s, "cloths"):
        q = s.query(row["wi"], sigma_per_um=row["sigma_per_um"])
        (r, t), resolution = halves(s, q)
        limit = 0.03 if row["tilt_deg"] > 60.5 else 0.015
        yield missed(r, row["R"], resolution), limit + 5.0 * row["se_R"], f"R at {row['tilt_deg']:g} {place(q)}"
        both, truth = t + s.straight(q), row["T"] + row["straight"]
        yield missed(both, truth, resolution), limit + 5.0 * row["se_T"], f"T + straight at {row['tilt_deg']:g} {place(q)}"


@check("straight of traced cloth", {"traced", "straight_gaps"}, ("cloth",))
def traced_straight(s):
    """Light that hits no fiber is a fact of the geometry: 1 less the cover, seen from wi. Limit: 0.01 and five standard
    errors sqrt(p (1 - p) / n)."""
    for row in asked_of(s, "cloths"):
        q = s.query(row["wi"], sigma_per_um=row["sigma_per_um"])
        yield abs(s.straight(q) - row["straight"]), 0.01 + 5.0 * row["se_straight"], f"at {row['tilt_deg']:g} {place(q)}"


def bin_means(s, q, shape, lobe=None):
    """Means of f over bins that are equal in z and azimuth from 0, by 4 x 4 midpoints in each."""
    z = (np.arange(4 * shape[0]) + 0.5) / (4 * shape[0]) * 2.0 - 1.0
    phi = (np.arange(4 * shape[1]) + 0.5) / (4 * shape[1]) * 2.0 * np.pi
    zz, pp = np.meshgrid(z, phi, indexing="ij")
    c = np.sqrt(1.0 - zz**2)
    wo = np.stack([c * np.cos(pp), c * np.sin(pp), zz], axis=-1).reshape(-1, 3)
    f = s.eval(q, wo) if lobe is None else s.lobes(q, wo)[:, lobe]
    return f.reshape(shape[0], 4, shape[1], 4).mean(axis=(1, 3))


def distance(got, truth, noise):
    """Relative L2 distance of bins, with the noise of the truth removed (0 where noise is all of it)."""
    power = np.sum(truth**2) - noise
    return float(np.sqrt(max(0.0, np.sum((got - truth) ** 2) - noise) / power)) if power > 0.0 else 0.0


@check("directions of traced cloth", {"traced"}, ("cloth",))
def traced_directions(s):
    """Relative L2 distance of f from the rays', over the bins of each half of the sphere, the rays' noise removed.

    Limit: 0.12 on wi's side, 0.20 on the other, where more than 0.05 of the light goes there. What is straight is
    not in the bins; where a model diffracts it, the other half is left out."""
    for row in [r for r in asked_of(s, "cloths") if "density" in r]:
        q = s.query(row["wi"], sigma_per_um=row["sigma_per_um"])
        truth = np.array(row["density"])
        got, below = bin_means(s, q, truth.shape), truth.shape[0] // 2
        for k, half in ((1, slice(below, None)), (0, slice(0, below))):
            across = (k == 1) != (row["wi"][2] > 0.0)
            light, limit = (row["T"], 0.20) if across else (row["R"], 0.12)
            if across and (light < 0.05 or "straight_gaps" not in s.claims):
                continue
            off = distance(got[half], truth[half], row["noise"][k])
            yield off, limit, f"{'lower' if across else 'upper'} at {row['tilt_deg']:g} {place(q)}"


def ply_query(s, row, sigma):
    return s.query(direction(np.radians(row["theta_deg"]), 0.5 * np.pi), row["h"], "near", sigma_per_um=sigma)


@check("energy of traced ply", {"traced"}, ("ply",))
def ply_energy(s):
    """Light by the fibers of a ply, by rays (data/plies.json): only reflected, all other, and what hits no fiber.

    A model that answers lobes answers these two; else their sum is compared. Limit: 0.01 and five standard errors."""
    for row in asked_of(s, "plies"):
        for sigma, high in row["high"].items():
            q = ply_query(s, row, float(sigma))
            truth = np.array([row["refl"], high])
            truth = truth if s.model.get("lobes") else truth.sum()
            found, resolution = s.integral(q, "eval", truth)
            yield missed(found, truth, resolution), 0.01 + 5.0 * row["se"], place(q)
        yield abs(s.straight(q) - row["straight"]), 0.01 + 5.0 * row["se"], f"straight {place(q)}"


@check("directions of traced ply", {"traced"}, ("ply",))
def ply_directions(s):
    """Relative L2 distance of f of a clear ply from the rays', over bins of the sphere, the rays' noise removed.

    Limit: 0.15 where the light is 0.05 or more."""
    for row in asked_of(s, "plies"):
        if "density" in row:
            q, truth = ply_query(s, row, 0.0), np.array(row["density"])
            yield distance(bin_means(s, q, truth.shape), truth, row["noise"]), 0.15, place(q)


@check("measured card", {"measured"}, ("cloth",))
def measured(s):
    """R, T and what is straight of a cloth that was measured at the normal (data/measured.json), hemispherical.

    Limit: the tolerance of the row. A row without a quantity does not hold it."""
    for row in rows("measured"):
        if row["of"] != s.model.get("truth"):
            continue
        q = s.query([0.0, 0.0, 1.0])
        (r, t), resolution = halves(s, q)
        found = {"R": r, "T": t + s.straight(q), "straight": s.straight(q)}
        for name, value in found.items():
            if name in row:
                yield missed(value, row[name], resolution), row["tolerance"], f"{name} {place(q)}"
