"""Lobes of ply models in Dr.Jit: round ones and cones, which a mixture of them (``_ply.py``) asks alike; the formulas of ``src/ply/kernel/lobe.rs`` and ``cone_lobe.rs``.

A lobe is six numbers of a file, bandwidths as :func:`stored_mu` has them. Values and densities are of a lobe of energy 1, in the frame of the mirrored incidence, theta_i >= 0.
"""

import math

import drjit as dr

from ._kit import clamp
from ._native import CONSTANTS

LOG2_E = math.log2(math.e)
MU_MIN, MU_MAX = 0.2, 20_000.0
# src/ply/cone.rs
CONE_MU1, CONE_MU2, GRAZING = (1e-3, 20_000.0), (1e-3, 500_000.0), 0.05
#: Exponents of 2 from this magnitude on count as dark.
DARK = 100.0
TAU = 2.0 * math.pi

#: Energy of a lobe of amplitude 1, rows of coefficients (src/ply/kernel/lobe.rs).
MEAN = [CONSTANTS["lobe_mean"][12 * k - k * k : 12 * (k + 1) - (k + 1) ** 2] for k in range(6)]


def stored_mu(mu):
    """A bandwidth stored as log2 sqrt(mu log2 e)."""
    return 0.5 * (math.log(mu) * LOG2_E + math.log2(LOG2_E))


def root_width(stored, bounds=(MU_MIN, MU_MAX)):
    """sqrt(mu log2 e), clamped to the bounds of mu."""
    return dr.exp2(clamp(stored, *map(stored_mu, bounds)))


def disc_share(a):
    return dr.maximum(1.0 - dr.exp2(-dr.minimum(a, 120.0)), 1e-6)


def _polynomial(c, x):
    value = c[-1]
    for k in c[-2::-1]:
        value = dr.fma(value, x, k)
    return value


def unit_mean(t1, t2):
    """Energy of a lobe of amplitude 1 times sqrt(mu1 mu2) / pi, for bandwidths multiplied by log2 e
    (src/ply/kernel/lobe.rs).
    """
    a = (2.0 * LOG2_E - t1) / (2.0 * LOG2_E + t1)
    b = (2.0 * LOG2_E - t2) / (2.0 * LOG2_E + t2)
    x, y = 0.5 * (a + b), a * b
    value = MEAN[5][0]
    for row in MEAN[4::-1]:
        value = dr.fma(value, y, _polynomial(row, x))
    return value


def disc_point(s1, s2, u1, u2):
    """Components along a lobe's axes of a direction sampled from it."""
    s, c = dr.sincos(2.0 * math.pi * u1)
    c, s = s2 * c, s1 * s
    n2 = 1.0 / (c * c + s * s)
    a = ((s1 * c) * (s1 * c) + (s2 * s) * (s2 * s)) * n2
    drop = -dr.log(1.0 - u2 * (1.0 - dr.exp2(-dr.minimum(a, 120.0))))
    r2 = clamp(drop / (math.log(2.0) * a), 0.0, 1.0 - 1.2e-7)
    r = dr.sqrt(r2 * n2)
    return r * c, r * s, dr.sqrt(1.0 - r2)


def kind_of(is_cone, theta_i):
    """Evaluator of a model's lobes at the latitude ``theta_i``; ``is_cone`` is a constant if all models have the same
    kind.
    """
    if not isinstance(is_cone, float):
        return Either(is_cone > 0.5, theta_i)
    return (Cones if is_cone > 0.5 else Round)(theta_i)


class Round:
    """Anisotropic spherical Gaussians (Yu 2025, Eq. 4)."""

    def __init__(self, theta_i):
        self.sin, self.cos = dr.sincos(dr.abs(theta_i))

    def toward(self, v):
        """Quantities of a direction shared by all lobes."""
        return v

    def frame(self, p):
        """Quantities of a lobe shared by all directions: sines and cosines of its angles, widths, peaks for values and
        densities.
        """
        s1, s2 = root_width(p[3]), root_width(p[4])
        norm = s1 * s2 * (1.0 / (math.pi * LOG2_E))
        return [*dr.sincos(p[0]), *dr.sincos(p[1]), *dr.sincos(p[2]), s1, s2, norm / unit_mean(s1 * s1, s2 * s2), norm]

    def value(self, frame, v):
        """Value and sampling density of a lobe in a direction."""
        st, ct, sp, cp, sx, cx, s1, s2, peak, norm = frame
        across, along = cp * v[1] - sp * v[0], cp * v[0] + sp * v[1]
        up, cz = ct * v[2] - st * along, ct * along + st * v[2]
        u, w = cx * across + sx * up, cx * up - sx * across
        su, sw = s1 * u, s2 * w
        q = su * su + sw * sw
        shape = dr.select((cz > 0.0) & (q < DARK), cz * dr.exp2(-dr.minimum(q, 120.0)), 0.0)
        a = (q + 1e-30) / (u * u + w * w + 1e-30)
        return shape * peak, shape * norm / disc_share(a)

    def draw(self, frame, u1, u2):
        """Samples a direction from a lobe, with two numbers in [0, 1)."""
        st, ct, sp, cp, sx, cx, s1, s2 = frame[:8]
        u, w, cz = disc_point(s1, s2, u1, u2)
        across, up = cx * u - sx * w, sx * u + cx * w
        along = ct * cz - st * up
        return [cp * along - sp * across, sp * along + cp * across, st * cz + ct * up]

    def forward(self, frame):
        """Cosine between a lobe's axis and the forward direction."""
        st, ct, sp = frame[:3]
        return -self.cos * ct * sp - self.sin * st


class Cones:
    """Cones about the fibers' axis (docs/reference/format/models.md, a cone lobe)."""

    def __init__(self, theta_i):
        self.sin, cos = dr.sincos(dr.minimum(dr.abs(theta_i), 0.5 * math.pi))
        self.cos = dr.maximum(cos, 0.0)
        self.g = dr.maximum(cos, GRAZING)

    def toward(self, v):
        return [dr.atan2(v[1], v[0]), v[2]]

    def frame(self, p):
        """The azimuth, s0 there and its change with sin x, roots of the bandwidths along the azimuth and in s, and the
        peak without the sum of erf.
        """
        root = math.sqrt(math.log(2.0))
        r1, r2 = root * root_width(p[3], CONE_MU1), root * root_width(p[4], CONE_MU2) / self.g
        peak = r1 * r2 * (2.0 / math.pi) / dr.erf(math.pi * r1)
        return [p[1], self.g * p[0] - self.sin, self.g * p[2], r1, r2, peak]

    def center(self, frame, x):
        """s0 at the azimuth ``x`` relative to the lobe's."""
        return clamp(frame[1] + frame[2] * dr.sin(x), -1.0, 1.0)

    def value(self, frame, v):
        phi, _, _, r1, r2, peak = frame
        x = v[0] - phi
        x = x - TAU * dr.floor(x * (1.0 / TAU) + 0.5)
        s0 = self.center(frame, x)
        u, w = r1 * x, r2 * (v[1] - s0)
        q = LOG2_E * (u * u + w * w)
        both = dr.erf(r2 * (1.0 - s0)) + dr.erf(r2 * (1.0 + s0))
        value = dr.select(q < DARK, dr.exp2(-dr.minimum(q, 120.0)) * peak / both, 0.0)
        return value, value

    def draw(self, frame, u1, u2):
        phi, _, _, r1, r2, _ = frame
        # The argument stays short of +-1, where the inverse diverges.
        inverse = lambda y: dr.erfinv(clamp(y, -1.0 + 6e-8, 1.0 - 6e-8))
        x = clamp(inverse((2.0 * u1 - 1.0) * dr.erf(math.pi * r1)) / r1, -math.pi, math.pi)
        s0 = self.center(frame, x)
        low, high = dr.erf(r2 * (-1.0 - s0)), dr.erf(r2 * (1.0 - s0))
        s = clamp(s0 + inverse(low + (high - low) * u2) / r2, -1.0, 1.0)
        sin, cos = dr.sincos(phi + x)
        c = dr.sqrt((1.0 - s) * (1.0 + s))
        return [c * cos, c * sin, s]

    def forward(self, frame):
        s = clamp(frame[1], -1.0, 1.0)
        return -self.cos * dr.sqrt((1.0 - s) * (1.0 + s)) * dr.sin(frame[0]) - self.sin * s


class Either:
    """Round lobes or cones, depending on the model."""

    def __init__(self, is_cone, theta_i):
        self.is_cone, self.kinds = is_cone, (Cones(theta_i), Round(theta_i))

    def toward(self, v):
        return [kind.toward(v) for kind in self.kinds]

    def frame(self, p):
        return [kind.frame(p) for kind in self.kinds]

    def value(self, frame, v):
        return self.choose(*(kind.value(f, w) for kind, f, w in zip(self.kinds, frame, v)))

    def draw(self, frame, u1, u2):
        return self.choose(*(kind.draw(f, u1, u2) for kind, f in zip(self.kinds, frame)))

    def forward(self, frame):
        return dr.select(self.is_cone, *(kind.forward(f) for kind, f in zip(self.kinds, frame)))

    def choose(self, cones, round_):
        return [dr.select(self.is_cone, a, b) for a, b in zip(cones, round_)]
