"""Checks that need nothing but the model: energy, density, sampling, symmetry, corners.

Each check is a function of a `Subject` that yields (value, limit, where); it fails where value > limit or is NaN.
Its docstring derives the quantity and the limit. Statistical limits are p-values or standard errors, set so that a
correct model fails once in about a thousand runs; others follow from rounding of 32-bit floats and from quadrature.
"""
import numpy as np

from sphere import SPIRAL, Grid, chi_square, direction, spiral

# Integrals. Sums of 32-bit floats over the grid round to 1e-5; published series for I_0 are good to 1e-4.
INTEGRAL = 1e-3
# Pointwise equality of two evaluations in 32-bit floats at directions that are themselves rounded: a lobe of
# width 0.05 has slopes of 20 to 60 per radian, and directions are good to 1e-6 near the pole of theta.
POINT = 1e-3
CHECKS = []
# Requests of a model that a model answers, where `describe` does not name fewer.
METHODS = ("eval", "pdf", "sample")
KINDS = ("fiber", "surface", "ply", "cloth")
# Kinds whose axis is z, and those with a normal.
ROUND, FLAT = ("fiber", "ply"), ("surface", "cloth")


def check(name, claims=(), kinds=KINDS, needs=()):
    """Registers a check for models of these kinds that make all these claims and answer these requests beside eval."""

    def register(function):
        CHECKS.append((name, set(claims), kinds, set(needs), function))
        return function

    return register


class Subject:
    """A model of an adapter, with its cases and what has been asked."""

    def __init__(self, adapter, model, fast=False, seed=1):
        self.adapter, self.model, self.fast, self.seed = adapter, model, fast, seed
        self.claims = set(model.get("claims", []))
        self.methods = set(model.get("methods", METHODS))
        self.ranges = model["parameters"]
        self.grid = Grid((12, 24), (4, 4) if fast else (8, 8))
        self.samples = 4000 if fast else 40000
        self.known = {}

    def parameters(self, **changes):
        return {name: changes.get(name, bounds[2]) for name, bounds in self.ranges.items()}

    def stated(self, claim):
        """By how much the renderer says that it misses a claim: `accuracy` of the model, 0 without."""
        return float(self.model.get("accuracy", {}).get(claim, 0.0))

    def has(self, *names):
        return all(name in self.ranges for name in names)

    def query(self, wi, h=0.0, field=None, **changes):
        q = {"model": self.model["name"], "parameters": self.parameters(**changes)}
        return {**q, "field": field or self.model["fields"][0], "wi": [float(x) for x in wi], "h": float(h)}

    def cases(self):
        """The defaults, every parameter at both ends, and some random ones."""
        found = [{}]
        for name, (low, high, default) in self.ranges.items():
            found += [{name: end} for end in (low, high) if end != default]
        rng = np.random.default_rng(self.seed)
        for _ in range(1 if self.fast else 4):
            case = {name: float(low + rng.random() * (high - low)) for name, (low, high, _) in self.ranges.items()}
            found.append({name: round(v) if name == "layers" else v for name, v in case.items()})
        return found

    def incidences(self):
        """Pairs of wi and h: steep, oblique, from below, grazing (89 degrees), near the rim."""
        if self.model["kind"] in FLAT:
            below = "two_sided" in self.claims or self.model["kind"] == "cloth"
            angles = [1.55, 0.8, 0.15] + ([-0.8, -0.3] if below else [])
            return [(direction(t, 0.4), 0.0) for t in angles]
        return [(direction(t, p), h) for t, p, h in [(0.35, 0.7, 0.6), (-1.1, -2.0, -0.92), (1.5533, 0.3, 0.3), (0.0, 3.0, 0.0)]]

    def queries(self):
        """All cases: the first at all incidences, others at one each in turn. All at all without --fast."""
        incidences, found = self.incidences(), []
        for k, case in enumerate(self.cases()):
            # The tilt of scales is hardest on grazing light, which it turns beyond the pole.
            one = 2 if "alpha" in case and len(incidences) > 2 else k % len(incidences)
            chosen = incidences if k == 0 or not self.fast else [incidences[one]]
            found += [self.query(wi, h, **case) for wi, h in chosen]
        if "far" in self.model["fields"][1:]:
            found += [self.query(wi, 0.0, "far") for wi, _ in (incidences[:1] if self.fast else incidences)]
        return found

    def eval(self, q, wo):
        """f, summed over lobes."""
        f = np.asarray(self.adapter.eval(q, wo), float)
        return f.sum(axis=1) if f.ndim == 2 else f

    def lobes(self, q, wo):
        return np.asarray(self.adapter.eval(q, wo), float)

    def straight(self, q):
        """Light that goes straight on, as a delta; fibers and surfaces have none."""
        if self.model["kind"] not in ("ply", "cloth"):
            return 0.0
        key = ("straight", str(q))
        if key not in self.known:
            self.known[key] = float(self.adapter.straight(q))
        return self.known[key]

    def on_grid(self, q, what="eval", grid=None):
        """Values at the nodes, remembered."""
        grid = grid or self.grid
        key = (what, len(grid.wo), str(q))
        if key not in self.known:
            ask = self.adapter.eval if what == "eval" else self.adapter.pdf
            self.known[key] = np.asarray(ask(q, grid.wo), float)
        return self.known[key]

    def drawn(self, q):
        key = ("sample", str(q))
        if key not in self.known:
            rng = np.random.default_rng([self.seed, len(self.known)])
            found = self.adapter.sample(q, rng.random((self.samples, 3)))
            self.known[key] = {name: np.asarray(values, float) for name, values in found.items()}
        return self.known[key]

    def integral(self, q, what="eval", expected=None):
        """Integral over the sphere by lobe (or of the sum), and the error of its quadrature.

        The grid is refined, to 32 nodes a bin each way, while the integral is off what is expected. A jump of f along
        a latitude (facets cut off at the horizon) may shift all grids alike, so that a miss is asked on a spiral too.
        """
        grid, values = self.grid, None
        for _ in range(4 if self.fast else 3):
            before, values = values, grid.integral(self.on_grid(q, what, grid))
            near = expected is not None and np.all(np.abs(values - expected) < 0.5 * INTEGRAL)
            close = before is not None and np.all(np.abs(values - before) < 0.2 * INTEGRAL)
            if near or close:
                return values, 0.0
            grid = grid.finer()
        resolution = float(np.max(np.abs(values - before)))
        if expected is not None and missed(values, expected, resolution) > INTEGRAL:
            values, half = (self.on_spiral(q, what, n).mean(axis=0) * 4.0 * np.pi for n in (SPIRAL, SPIRAL // 2))
            resolution = float(np.max(np.abs(values - half)))
        return values, resolution

    def on_spiral(self, q, what="eval", count=SPIRAL):
        return np.asarray((self.adapter.eval if what == "eval" else self.adapter.pdf)(q, spiral(count)), float)


def place(q):
    """A query in words, without the defaults' length."""
    p = " ".join(f"{k}={v:.4g}" for k, v in q["parameters"].items())
    return f"{q['field']} wi=({q['wi'][0]:.3f} {q['wi'][1]:.3f} {q['wi'][2]:.3f}) h={q['h']:.3g} {p}"


def missed(value, expected, resolution):
    """Distance less the quadrature's own error; an integral that never settles counts as missed."""
    off = float(np.max(np.abs(np.asarray(value) - expected)))
    return off if resolution > 0.02 or not np.isfinite(off) else max(0.0, off - 2.0 * resolution)


@check("furnace", {"lossless"})
def furnace(s):
    """A white room: without absorption the light that falls on the model leaves it, integral f dwo + straight = 1.

    f is an energy density, so no cosine is added. Limit: INTEGRAL, and what the model states for the claim."""
    for q in s.queries():
        clear = {name: 0.0 for name in ("tau", "sigma_per_um") if s.has(name)}
        q = {**q, "parameters": {**q["parameters"], **clear}}
        kept = 1.0 - s.straight(q)
        total, resolution = s.integral(q, expected=kept if kept > 0.0 else None)
        yield missed(np.sum(total), kept, resolution), INTEGRAL + s.stated("lossless"), place(q)


@check("energy at most 1")
def bounded(s):
    """No passive model scatters more than falls on it: integral f dwo + straight <= 1.

    Limit: INTEGRAL, and what the model states for `lossless`: a clear model that is off by it is so to both sides."""
    for q in s.queries():
        total, resolution = s.integral(q)
        over = np.sum(total) + s.straight(q) - 1.0 - 2.0 * resolution
        yield max(0.0, over) if np.all(np.isfinite(total)) else np.nan, INTEGRAL + s.stated("lossless"), place(q)


@check("positive")
def positive(s):
    """f and pdf are finite and not negative, and pdf > 0 where f matters.

    Value: 1 for a value that is negative or not finite; else the share of energy at directions without density.
    Of a model without pdf: f alone."""
    for q in s.queries():
        f = s.on_grid(q)
        pdf = s.on_grid(q, "pdf") if "pdf" in s.methods else np.ones(len(f))
        total = f.sum(axis=1) if f.ndim == 2 else f
        bad = not (np.all(np.isfinite(total)) and np.all(np.isfinite(pdf)) and f.min() >= 0.0 and pdf.min() >= 0.0)
        unseen = s.grid.weight[pdf <= 0.0] @ total[pdf <= 0.0]
        yield (1.0 if bad else unseen), 1e-4, place(q)


@check("pdf integral", needs=("pdf", "sample"))
def pdf_integral(s):
    """The density of what `sample` scatters integrates to the share of samples that are scattered (pdf > 0).

    Limit: INTEGRAL, and five standard errors sqrt(p (1 - p) / n) of that share."""
    for q in s.queries():
        drawn = s.drawn(q)
        share = float(np.mean(drawn["pdf"] > 0.0))
        total, resolution = s.integral(q, "pdf", share)
        error = 5.0 * np.sqrt(share * (1.0 - share) / s.samples)
        yield missed(total, share, resolution), INTEGRAL + error, place(q)


@check("weight x pdf = eval", needs=("pdf", "sample"))
def weight(s):
    """weight = f / pdf at the sampled direction, and pdf(wo) is the pdf that `sample` gave.

    Both are 32-bit values at directions rounded to 1e-7, so single samples may lie on a steep side: limit POINT on
    the 99th percentile of |difference| / (|value| + 1e-3 of the median value)."""
    for q in s.queries():
        d = s.drawn(q)
        hit = d["pdf"] > 0.0
        if not hit.any():
            # A black model scatters nothing: then f must be 0.
            yield float(np.sum(s.integral(q)[0])), POINT, place(q)
            continue
        wo, pdf, w = d["wo"][hit], d["pdf"][hit], d["weight"][hit]
        f, again = s.eval(q, wo), np.asarray(s.adapter.pdf(q, wo), float)
        off = [np.abs(a - b) / (np.abs(b) + 1e-3 * np.median(np.abs(b)) + 1e-30) for a, b in ((w * pdf, f), (pdf, again))]
        yield max(float(np.percentile(o, 99)) if np.all(np.isfinite(o)) else np.nan for o in off), POINT, place(q)


@check("chi-square", needs=("pdf", "sample"))
def chi_squares(s):
    """Counts of samples in 288 bins, and of those not scattered, against the integral of pdf over each bin.

    Pearson's statistic, bins that expect fewer than 8 pooled. Value: -log10 p. Limit: that at which one of a thousand
    runs of a correct model fails, by Sidak's correction for the number of queries."""
    queries = s.queries()
    limit = -np.log10(1.0 - (1.0 - 1e-3) ** (1.0 / len(queries)))
    for q in queries:
        d = s.drawn(q)
        hit = (d["pdf"] > 0.0) & np.all(np.isfinite(d["wo"]), axis=1)
        observed = np.bincount(s.grid.bin_of(d["wo"][hit]), minlength=np.prod(s.grid.bins)).astype(float)
        grid, expected = s.grid, None
        for _ in range(3):
            before, expected = expected, grid.by_bin(s.on_grid(q, "pdf", grid)) * s.samples
            # Quadrature is good when it moves no bin by a tenth of the bin's own noise.
            if before is not None and np.all(np.abs(expected - before) < 0.1 * np.sqrt(expected + 1.0)):
                break
            grid = grid.finer()
        observed = np.append(observed, s.samples - hit.sum())
        p = chi_square(observed, with_lost(expected, s.samples)) if np.all(np.isfinite(expected)) else 0.0
        if -np.log10(max(p, 1e-99)) > limit:
            wo, weight = spiral(), s.samples * 4.0 * np.pi / SPIRAL
            expected = np.bincount(s.grid.bin_of(wo), s.on_spiral(q, "pdf") * weight, np.prod(s.grid.bins))
            p = chi_square(observed, with_lost(expected, s.samples)) if np.all(np.isfinite(expected)) else 0.0
        yield -np.log10(max(p, 1e-99)), limit, place(q)


def with_lost(expected, samples):
    """Expected counts, and those of samples that scatter nothing."""
    return np.append(expected, max(samples - expected.sum(), 0.0))


@check("sampled energy", needs=("sample",))
def sampled_energy(s):
    """The mean weight estimates integral f dwo. Value: distance in standard errors of that mean. Limit: 4.5, which
    a correct model exceeds with a probability of 7e-6 a query. Quadrature to INTEGRAL is added to the error."""
    for q in s.queries():
        d = s.drawn(q)
        w = np.where(d["pdf"] > 0.0, d["weight"], 0.0)
        mean, se = float(w.mean()), float(w.std() / np.sqrt(s.samples))
        total, resolution = s.integral(q, "eval")
        yield abs(mean - np.sum(total)) / (se + INTEGRAL + resolution), 4.5, place(q)


def turned(vectors, angle):
    c, k = np.cos(angle), np.sin(angle)
    return np.asarray(vectors) @ np.array([[c, k, 0.0], [-k, c, 0.0], [0.0, 0.0, 1.0]])


def spread(s, count=200):
    """Directions over the sphere, the same every time."""
    rng = np.random.default_rng(7)
    w = rng.normal(size=(count, 3))
    return w / np.linalg.norm(w, axis=1)[:, None]


def far_apart(a, b):
    """Largest distance of two sets of values, in the largest value; infinite where one is not finite."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        return np.inf
    return float(np.max(np.abs(a - b)) / max(np.max(np.abs(a)), np.max(np.abs(b)), 1e-30))


def rms_apart(a, b):
    """Root mean square of the difference of two sets of values, over that of their mean."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        return np.inf
    return float(np.sqrt(np.mean((a - b) ** 2) / max(np.mean((0.5 * (a + b)) ** 2), 1e-60)))


@check("roll", {"circular"})
def roll(s):
    """A circle has no marked azimuth: turning wi and wo about the axis by any angle leaves f and pdf. Limit: POINT."""
    for q in s.queries():
        for angle in (0.9, 2.6):
            r = {**q, "wi": turned([q["wi"]], angle)[0].tolist()}
            wo = spread(s)
            yield far_apart(s.eval(q, wo), s.eval(r, turned(wo, angle))), POINT, f"turn by {angle} {place(q)}"
            if "pdf" in s.methods:
                yield far_apart(s.adapter.pdf(q, wo), s.adapter.pdf(r, turned(wo, angle))), POINT, f"turn by {angle} {place(q)}"


@check("mirror", {"circular"}, ("fiber", "surface", "cloth"))
def mirror(s):
    """A mirror that holds the axis: azimuths and h change sign, f and pdf do not. Limit: POINT.

    A ply is held to it by `mirror of twist`."""
    flip = np.array([1.0, -1.0, 1.0])
    for q in s.queries():
        r = {**q, "wi": (np.array(q["wi"]) * flip).tolist(), "h": -q["h"]}
        wo = spread(s)
        yield far_apart(s.eval(q, wo), s.eval(r, wo * flip)), POINT, place(q)
        if "pdf" in s.methods:
            yield far_apart(s.adapter.pdf(q, wo), s.adapter.pdf(r, wo * flip)), POINT, place(q)


@check("tangent flip", {"circular"}, ("fiber",))
def tangent(s):
    """A mirror across the axis: latitudes and the scales' tilt alpha change sign, f does not. Limit: POINT.

    A model without alpha has no root and no tip, so that flipping its tangent changes nothing."""
    flip = np.array([1.0, 1.0, -1.0])
    for q in s.queries():
        p = dict(q["parameters"])
        if "alpha" in p:
            if not s.ranges["alpha"][0] <= -p["alpha"] <= s.ranges["alpha"][1]:
                continue
            p["alpha"] = -p["alpha"]
        r = {**q, "wi": (np.array(q["wi"]) * flip).tolist(), "parameters": p}
        wo = spread(s)
        yield far_apart(s.eval(q, wo), s.eval(r, wo * flip)), POINT, place(q)


@check("reciprocity", {"reciprocal"})
def reciprocity(s):
    """Swapped light: f(wi, h -> wo) / cos(wo) = f(wo, -h -> wi) / cos(wi), times the squares of the indices.

    f dwo is the share of flux, so flux through the solid angles is balanced by etendue n^2 cos dw: with n_i the index
    on wi's side f(wi -> wo) n_i^2 cos_i = f(wo -> wi) n_o^2 cos_o. The cosine is that to a surface's normal, or, for the
    mean over a fiber's width, that of the latitude; light leaves a symmetric fiber at -h. Limit: POINT.

    Plies and cloths, which are fits, are held to it in the root mean square over 40 directions, and to what they state."""
    for q in s.queries():
        if q["field"] == "near" and "reciprocal_near" not in s.claims:
            continue
        large = s.model["kind"] in ("ply", "cloth")
        off = swapped(s, q, spread(s, 40), rms_apart) if large else swapped(s, q, spread(s, 12))
        yield off, POINT + s.stated("reciprocal"), place(q)


@check("mirror reciprocity", {"circular"}, ("fiber",))
def mirror_reciprocity(s):
    """The same at wo of latitude -theta_i, where both cosines agree: f(wi, h -> wo) = f(wo, -h -> wi).

    It holds for models that take the attenuation at theta_i alone too, which are not reciprocal elsewhere.
    Asked without tilt. Limit: POINT."""
    for q in s.queries():
        if q["parameters"].get("alpha", 0.0) != 0.0:
            continue
        theta = np.arcsin(q["wi"][2])
        wo = np.array([direction(-theta, p) for p in np.linspace(-3.0, 3.0, 8)])
        yield swapped(s, q, wo), POINT, place(q)


def swapped(s, q, wo, apart=far_apart):
    """Distance of both sides of reciprocity, in the largest of them."""
    surface, eta = s.model["kind"] in FLAT, q["parameters"].get("eta", 1.0)

    def measure(w):
        w = np.atleast_2d(w)
        if surface:
            n2 = np.where(w[:, 2] < 0.0, eta**2, 1.0) if "two_sided" in s.claims else 1.0
            return np.abs(w[:, 2]) * n2
        return np.sqrt(np.maximum(0.0, 1.0 - w[:, 2] ** 2))

    there = s.eval(q, wo) * measure(q["wi"])
    back = [s.eval({**q, "wi": w.tolist(), "h": -q["h"]}, np.array([q["wi"]]))[0] for w in wo] * measure(wo)
    return apart(there, back)


@check("corners")
def corners(s):
    """Every end of every parameter at the worst incidences, and the ends of the random numbers, give finite values:
    wi along the axis, wi = wo, h = +-1, u = 0 and the last number below 1. wo has length 1 to 1e-4.

    Value: count of values that are not finite, or negative, or not of length 1. Limit: 0."""
    last = 1.0 - 2.0**-24
    u = np.array([[a, b, c] for a in (0.0, 0.5, last) for b in (0.0, last) for c in (0.0, 0.5, last)])
    if s.model["kind"] in ROUND:
        steep = [([0.0, 0.0, 1.0], 0.0), (direction(1.5707, 0.0), 1.0), (direction(0.0, 0.0), -1.0), (direction(-1.57, 1.0), 0.999)]
    else:
        steep = [([0.0, 0.0, 1.0], 0.0), (direction(1e-3, 0.0), 0.0), ([1.0, 0.0, 0.0], 0.0)]
    for case in s.cases():
        for wi, h in steep:
            q = s.query(wi, h, **case)
            wo = np.concatenate([spread(s, 20), [q["wi"]], [[-x for x in q["wi"]]], [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
            values, lengths = [s.eval(q, wo)], np.ones(0)
            if "pdf" in s.methods:
                values.append(s.adapter.pdf(q, wo))
            if "sample" in s.methods:
                d = s.adapter.sample(q, u)
                values += [d["weight"], d["pdf"]]
                lengths = np.linalg.norm(np.asarray(d["wo"])[np.asarray(d["pdf"]) > 0.0], axis=1)
            bad = sum(int(np.sum(~np.isfinite(v) | (np.asarray(v) < 0.0))) for v in values)
            bad += int(np.sum(~(np.abs(lengths - 1.0) < 1e-4)))
            yield float(bad), 0.0, place(q)
