"""Light through the gaps between yarns and the slits between fibers, diffracted by rectangular apertures (``src/gap.rs``, ``src/gap/``, ``src/math/faddeeva.rs``)."""

import math

import drjit as dr
import numpy as np

from ._kit import clamp
from ._native import CONSTANTS

EDGES, CELLS, MIN_MASS, MIN_APERTURE_UM, TURNS = 32, 64, 1e-12, 0.1, 256
# src/gap/slit.rs
MIN_COSINE = 1e-3
SCALE, *SERIES = CONSTANTS["faddeeva"]


def faddeeva(x, y):
    """w(x + i y) for y >= 0 by Weideman's series."""
    d = SCALE + y
    norm = 1.0 / (d * d + x * x)
    r = (d * norm, x * norm)
    mul = lambda a, b: (a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0])
    z = mul((SCALE - y, x), r)
    p = (SERIES[-1], 0.0)
    for c in SERIES[-2::-1]:
        p = mul(p, z)
        p = (p[0] + c, p[1])
    p = mul(mul(p, r), r)
    return 2.0 * p[0] + r[0] / math.sqrt(math.pi), 2.0 * p[1] + r[1] / math.sqrt(math.pi)


# src/math/erf.rs, erf_from_0
OVER, UNDER = CONSTANTS["erf_over"], CONSTANTS["erf_under"]


def erf_from_0(x):
    """The error function for x >= 0, with full relative precision for small x."""
    x = dr.minimum(x, 4.0)
    over, under = OVER[-1], UNDER[-1]
    for c in OVER[-2::-1]:
        over = over * (x * x) + c
    for c in UNDER[-2::-1]:
        under = under * (x * x) + c
    return dr.minimum(x * over / under, 1.0)


class Spectrum:
    """Spectrum of one axis of an aperture, from a row of the table or for edges near those of that row [um]."""

    def __init__(self, gaps, at, edges=None):
        kit = self.kit = gaps.kit
        self.gaps = gaps
        factor = kit.packets(gaps.factors, at * 3, 3)
        self.edges = [factor[0:3], factor[3:6]]
        self.w0, self.scale, self.g = factor[6:9]
        self.first = at * (CELLS + 1)
        # Factor that converts frequencies to those of the table.
        self.stretch = 1.0
        if edges is not None:
            t = [dr.minimum(x / self.w0, 30.0) for x in edges]
            self.edges = [(x, sign, dr.exp(-x * x)) for x, sign in zip(t, (-1.0, 1.0))]
            power = 0.5 * math.sqrt(0.5 * math.pi) * sum(erf_from_0(math.sqrt(2.0) * x) for x in t)
            scale = 0.25 * math.pi * self.w0 / dr.maximum(power, 1e-12)
            self.stretch = self.scale / scale
            self.scale = scale

    def mass_at(self, i):
        return self.kit.take(self.gaps.masses, self.first + i)

    def passes(self):
        return self.mass_at(0) > 0.0

    def place(self, f):
        t = f / (f + self.g) * CELLS
        i = dr.minimum(dr.floor(t), CELLS - 1.0)
        return self.kit.uint(i), clamp(t - i, 0.0, 1.0)

    def beyond(self, f):
        i, x = self.place(f)
        low = self.mass_at(i)
        return low + x * (self.mass_at(i + 1) - low)

    def range(self, low, high):
        """Bounds of the frequencies between two limits, and the fraction of the spectrum within."""
        low, high = low * self.stretch, high * self.stretch
        a, b = self.beyond(dr.abs(low)), self.beyond(dr.abs(high))
        about = (low < 0.0) & (high > 0.0)
        return low, high, a, b, dr.select(about, 1.0 - 0.5 * (a + b), 0.5 * dr.abs(a - b))

    def pdf(self, r, f):
        low, high, _, _, mass = r
        f = f * self.stretch
        i, _ = self.place(dr.abs(f))
        stretch = dr.abs(f) + self.g
        density = 0.5 * CELLS * (self.mass_at(i) - self.mass_at(i + 1)) * self.g / (stretch * stretch)
        flat = dr.select(low < high, 1.0 / dr.maximum(high - low, 1e-12), 0.0)
        return self.stretch * dr.select(mass > MIN_MASS, density / dr.maximum(mass, MIN_MASS), flat)

    def sample(self, r, u):
        low, high, a, b, mass = r
        about = (low < 0.0) & (high > 0.0)
        left, at = 0.5 * (1.0 - a), u * mass
        is_left = at < left
        within = dr.select(is_left, dr.maximum(1.0 - 2.0 * at, a), dr.maximum(1.0 - 2.0 * (at - left), b))
        beyond = dr.select(about, within, a + u * (b - a))
        sign = dr.select(dr.select(about, is_left, low < 0.0), -1.0, 1.0)
        kit = self.kit
        i = kit.uint(0)
        step = CELLS // 2
        while step:
            i = dr.select(self.mass_at(i + step) >= beyond, i + step, i)
            step //= 2
        before = self.mass_at(i)
        cell = before - self.mass_at(i + 1)
        x = dr.select(cell > 0.0, clamp((before - beyond) / dr.maximum(cell, 1e-30), 0.0, 1.0), 0.5)
        t = dr.minimum((kit.float(i) + x) * (1.0 / CELLS), 1.0 - 1.2e-7)
        f = clamp(sign * self.g * t / (1.0 - t), low, high)
        return dr.select(mass > MIN_MASS, f, low + u * (high - low)) / self.stretch

    def value(self, f):
        """Density of the exact spectrum at a frequency [1/um]."""
        g = clamp(f * self.w0, -1e4, 1e4)
        parts = []
        for t, _, amplitude in self.edges:
            w = faddeeva(-math.pi * g, t)
            turns = g * t
            s, c = dr.sincos(2.0 * math.pi * (turns - dr.floor(turns + 0.5)))
            parts.append((amplitude * (w[0] * c + w[1] * s), amplitude * (w[1] * c - w[0] * s)))
        low, high = self.edges[0][1], self.edges[1][1]
        s = math.pi * g
        re = (high - low) * dr.exp(-dr.minimum(s * s, 80.0)) - high * parts[1][0] + low * parts[0][0]
        im = parts[0][1] - parts[1][1]
        return self.scale * (re * re + im * im)


def turned(w, turn, sign=1.0):
    """A direction in axes whose first one is turned from x by an angle with this cosine and sine, or the inverse
    rotation.
    """
    if turn is None:
        return w
    c, s = turn[0], sign * turn[1]
    return [c * w[0] + s * w[1], c * w[1] - s * w[0], w[2]]


class Gaps:
    """Aperture spectra of a cloth on the device."""

    def __init__(self, kit, tables, step):
        self.kit, self.step = kit, step
        rows = tables.reshape(-1, 9 + CELLS + 1)
        self.factors = kit.floats(np.pad(rows[:, :9], ((0, 0), (0, 3))))
        self.masses = kit.floats(rows[:, 9:])

    def at(self, aperture, turn):
        """A gap with these distances to its edges [um]: the spectra of its two axes, and cosine and sine of the angle
        from x to the first axis.
        """
        west, east, south, north = aperture
        return self.near(west, east), self.near(south, north), turn

    def near(self, before, beyond):
        kit = self.kit
        room = 0.5 * dr.maximum(MIN_APERTURE_UM - before - beyond, 0.0)
        before, beyond = (dr.minimum(x + room, EDGES * self.step) for x in (before, beyond))
        a, b = (dr.minimum(dr.floor(x / self.step + 0.5), float(EDGES)) for x in (before, beyond))
        # The aperture of the row must have a positive width.
        none, low = (a + b) < 0.5, before > beyond
        a, b = dr.select(kit.both(none, low), 1.0, a), dr.select(kit.both(none, kit.no(low)), 1.0, b)
        return Spectrum(self, kit.uint(a) * (EDGES + 1) + kit.uint(b), (before, beyond))

    def of(self, x, y, turn=None):
        """A gap from the rows of its two spectra."""
        return Spectrum(self, x), Spectrum(self, y), turn

    def opening(self, words):
        """A gap from the words of an opening (src/gap/apertures.rs)."""
        x, y, steps = words
        s, c = dr.sincos((self.kit.float(steps) + 0.5) * (0.5 * math.pi / TURNS))
        return self.of(x, y, (dr.select(steps == 0, 1.0, c), dr.select(steps == 0, 0.0, s)))

    def along(self, y, wo, x, per):
        reach = dr.sqrt(dr.maximum(1.0 - x * x, 0.0)) * per
        middle = wo[1] * per
        return y.range(middle - reach, middle + reach)

    def eval(self, spectra, wo, lam, b):
        """Light of energy 1 by wavelength, and the density of :meth:`draw`."""
        kit, (x, y, turn) = self.kit, spectra
        wo, b = turned(wo, turn), turned(b, turn)
        leaves = b[2] * wo[2] < 0.0
        cos = dr.minimum(dr.abs(b[2]), 1.0)
        f, pdf = kit.zero_s(), 0.0
        for k in range(kit.count):
            per = 1.0 / clamp(lam[k], 0.05, 20.0)
            fx, fy = (wo[0] + b[0]) * per, (wo[1] + b[1]) * per
            across, along = x.range((wo[0] - 1.0) * per, (wo[0] + 1.0) * per), self.along(y, wo, b[0], per)
            mass = across[4] * along[4]
            scale = cos * per * per
            f[k] = dr.select(leaves & (mass > 1e-12), x.value(fx) * y.value(fy) * scale / dr.maximum(mass, 1e-12), 0.0)
            pdf = pdf + dr.select(leaves, x.pdf(across, fx) * y.pdf(along, fy) * scale, 0.0)
        return f, pdf * (1.0 / kit.count)

    def draw(self, spectra, wo, lam, u):
        kit, (x, y, turn) = self.kit, spectra
        wo = turned(wo, turn)
        which = kit.uint(dr.minimum(u[0] * kit.count, kit.count - 1.0))
        chosen = lam[0]
        for k in range(1, kit.count):
            chosen = dr.select(which == k, lam[k], chosen)
        chosen = clamp(chosen, 0.05, 20.0)
        per = 1.0 / chosen
        across = x.range((wo[0] - 1.0) * per, (wo[0] + 1.0) * per)
        bx = clamp(chosen * x.sample(across, u[1]) - wo[0], -1.0, 1.0)
        by = chosen * y.sample(self.along(y, wo, bx, per), u[2]) - wo[1]
        reach = dr.sqrt(dr.maximum(1.0 - bx * bx, 0.0))
        by = clamp(by, -reach, reach)
        bz = dr.sqrt(dr.maximum(1.0 - bx * bx - by * by, 1e-12))
        return turned([bx, by, dr.select(wo[2] > 0.0, -bz, bz)], turn, -1.0)


class Slits:
    """Slits between the fibers of yarns (Yu 2025, 7.3; src/gap/slit.rs)."""

    def __init__(self, kit, shares, spectra):
        self.kit, self.shares, self.gaps = kit, [float(share) for share in shares], Gaps(kit, spectra, 1.0)

    def at(self, is_first, is_double, lam):
        """The slit of a hit ply of the first or second kind of yarn; where two layers overlap there is none."""
        kit = self.kit
        share = dr.select(is_double, 0.0, dr.select(is_first, *self.shares))
        row = dr.select(is_first, kit.uint(0), kit.uint(2))
        return Slit(share, self.gaps, self.gaps.of(row, row + 1), lam)


class Slit:
    """A slit along a ply, with the fraction of forward light that passes it and its spectra across and along the ply."""

    def __init__(self, share, gaps, spectra, lam):
        self.share, self.gaps, self.spectra, self.lam = share, gaps, spectra, lam

    def takes(self, cos):
        """The fraction of a lobe that passes, from the cosine between the lobe's axis and the forward direction."""
        return self.share * clamp(cos, 0.0, 1.0)

    def incident(self, theta_i):
        """The incident direction in the slit's frame, whose y axis is the ply's z axis."""
        s, c = dr.sincos(clamp(theta_i, -0.5 * math.pi, 0.5 * math.pi))
        return [0.0, s, dr.maximum(c, MIN_COSINE)]

    def eval(self, theta_i, v):
        """Light of energy 1 by wavelength [1/sr], and the density of :meth:`draw`, for a direction in the ply's frame."""
        return self.gaps.eval(self.spectra, self.incident(theta_i), self.lam, [v[0], v[2], v[1]])

    def draw(self, theta_i, u):
        x, z, y = self.gaps.draw(self.spectra, self.incident(theta_i), self.lam, u)
        return [x, y, z]
