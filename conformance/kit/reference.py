#!/usr/bin/env python3
"""A reference fiber: R, TT, TRT and all later orders of a rough dielectric cylinder, near and far field.

Longitudinal function: d'Eon et al. 2011, "An Energy-Conserving Hair Reflectance Model", Eq. 7.
Azimuthal function, roughness and tilt: Chiang et al. 2016, "A Practical and Controllable Hair and Fur Model".
Names follow pbrt's chapter 9.9. It has no table and no approximation but the sum over offsets of the far field.
It answers the kit's protocol (docs/howto/conformance.md): f is an energy density [1/sr].

    f = sum over p of M_p(theta_i, theta_o) A_p(h, theta_i, tau) N_p(phi - phi_p(h))

`mutations.py` changes single lines of this file and shows that the kit finds each change.
"""
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from pipe import serve

PI, TAU = np.pi, 2.0 * np.pi
LOBES = 4
# Offsets h = sin gamma of the far field, with weights of a mean over h: nodes in gamma are dense at the rim.
GAMMA, WEIGHTS = np.polynomial.legendre.leggauss(48)
OFFSETS, WEIGHTS = np.sin(0.5 * PI * GAMMA), 0.25 * PI * WEIGHTS * np.cos(0.5 * PI * GAMMA)
WEIGHTS /= WEIGHTS.sum()


def log_i0(x):
    """log of the modified Bessel function I_0, to 1e-6 (NIST 10.40.1 beyond 15)."""
    small = np.minimum(x, 15.0)
    large = np.maximum(x, 15.0)
    series = 1.0 + 1.0 / (8.0 * large) + 9.0 / (128.0 * large**2) + 225.0 / (3072.0 * large**3)
    return np.where(x < 15.0, np.log(np.i0(small)), large - 0.5 * np.log(TAU * large) + np.log(series))


def longitudinal(sin_i, cos_i, sin_o, cos_o, v):
    """d'Eon's M: the mean over the azimuth of a von Mises-Fisher lobe around the latitude -theta_i."""
    exponent = log_i0(cos_i * cos_o / v) - sin_i * sin_o / v - 1.0 / v
    return np.exp(exponent - np.log1p(-np.exp(-2.0 / v))) / v


def sample_longitudinal(sin_i, cos_i, v, u1, u2):
    """Sine of a latitude with the density M (d'Eon 2013, "Importance Sampling for Physically-Based Hair")."""
    along = 1.0 + v * np.log(u1 + (1.0 - u1) * np.exp(-2.0 / v))
    across = np.sqrt(np.maximum(0.0, 1.0 - along**2)) * np.cos(TAU * u2)
    return np.clip(-along * sin_i + across * cos_i, -1.0, 1.0)


def wrap(angle):
    """An angle in [-pi, pi)."""
    return (angle + PI) % TAU - PI


def logistic_cdf(x, s):
    return 1.0 / (1.0 + np.exp(-x / s))


def trimmed_logistic(x, s):
    """The logistic density of scale s, cut to [-pi, pi] and normalized there."""
    e = np.exp(-np.abs(x) / s)
    return e / (s * (1.0 + e) ** 2) / (logistic_cdf(PI, s) - logistic_cdf(-PI, s))


def sample_trimmed_logistic(u, s):
    low, high = logistic_cdf(-PI, s), logistic_cdf(PI, s)
    c = low + u * (high - low)
    return np.clip(-s * np.log(1.0 / c - 1.0), -PI, PI)


def fresnel(cos_i, eta):
    """Reflectance of unpolarized light that enters a dielectric."""
    cos_i = np.clip(cos_i, 0.0, 1.0)
    cos_t = np.sqrt(np.maximum(0.0, 1.0 - (1.0 - cos_i**2) / eta**2))
    if eta == 1.0:
        return 0.0 * cos_i
    parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    return 0.5 * (parallel**2 + perpendicular**2)


def attenuations(sin_i, cos_i, h, eta, tau):
    """A_p of R, TT, TRT and all later orders, and gamma and gamma_t, in a cross section at h."""
    eta_p = np.sqrt(eta**2 - sin_i**2) / max(cos_i, 1e-9)
    gamma, gamma_t = np.arcsin(np.clip(h, -1.0, 1.0)), np.arcsin(np.clip(h / eta_p, -1.0, 1.0))
    cos_theta_t = np.sqrt(1.0 - (sin_i / eta) ** 2)
    path = np.cos(gamma_t) / max(cos_theta_t, 1e-9)
    t = np.exp(-tau * path)
    f = fresnel(cos_i * np.cos(gamma), eta)
    a_r = f
    a_tt = (1.0 - f) ** 2 * t
    a_trt = a_tt * t * f
    a_rest = a_trt * t * f / max(1.0 - t * f, 1e-12)
    return np.array([a_r, a_tt, a_trt, a_rest]), gamma, gamma_t


def lobe_azimuth(p, gamma, gamma_t):
    """Relative azimuth at which order p leaves: one turn at the surface, and one of pi - 2 gamma_t a pass."""
    return 2.0 * gamma - p * (2.0 * gamma_t - PI)


class AtOffset:
    """The fiber for one incidence, at one offset."""

    def __init__(self, parameters, wi, h):
        p = parameters
        self.sin_i = float(np.clip(wi[2], -1.0, 1.0))
        self.cos_i = float(np.sqrt(max(0.0, 1.0 - self.sin_i**2)))
        self.phi_i = float(np.arctan2(wi[1], wi[0]))
        base = 0.726 * p["beta_m"] + 0.812 * p["beta_m"] ** 2 + 3.7 * p["beta_m"] ** 20
        v = base**2
        self.v = np.maximum(np.array([v, 0.25 * v, 4.0 * v, 4.0 * v]), 1e-7)
        spread = 0.265 * p["beta_n"] + 1.194 * p["beta_n"] ** 2 + 5.372 * p["beta_n"] ** 22
        self.s = max(np.sqrt(PI / 8.0) * spread, 1e-4)
        self.a, gamma, gamma_t = attenuations(self.sin_i, self.cos_i, h, p["eta"], p["tau"])
        self.phi_p = [lobe_azimuth(order, gamma, gamma_t) for order in range(3)]
        # Tilts of the scales turn the light that enters: R by 2 alpha to the root, TT and TRT to the tip.
        turns = np.array([2.0, -1.0, -4.0, 0.0]) * p["alpha"]
        sin_l = self.sin_i * np.cos(turns) + self.cos_i * np.sin(turns)
        cos_l = np.abs(self.cos_i * np.cos(turns) - self.sin_i * np.sin(turns))
        self.tilted = list(zip(sin_l, cos_l))
        total = self.a.sum()
        self.chance = self.a / total if total > 0.0 else np.array([1.0, 0.0, 0.0, 0.0])

    def shapes(self, wo):
        """M_p N_p of each lobe, [n][lobe]."""
        sin_o = np.clip(wo[:, 2], -1.0, 1.0)
        cos_o = np.sqrt(np.maximum(0.0, 1.0 - sin_o**2))
        phi = np.arctan2(wo[:, 1], wo[:, 0]) - self.phi_i
        out = np.empty((len(wo), LOBES))
        for lobe in range(LOBES):
            sin_l, cos_l = self.tilted[lobe]
            m = longitudinal(sin_l, cos_l, sin_o, cos_o, self.v[lobe])
            n = trimmed_logistic(wrap(phi - self.phi_p[lobe]), self.s) if lobe < 3 else 1.0 / TAU
            out[:, lobe] = m * n
        return out

    def sample(self, u0, u1, u2):
        """Directions for uniform numbers: u0 chooses the lobe, and what remains of it the azimuth."""
        edges = np.concatenate([[0.0], np.cumsum(self.chance)])
        lobe = np.minimum(np.searchsorted(edges[1:], u0, side="right"), LOBES - 1)
        rest = np.clip((u0 - edges[lobe]) / np.maximum(self.chance[lobe], 1e-30), 1e-9, 1.0 - 1e-9)
        wo = np.empty((len(u0), 3))
        for k in range(LOBES):
            of = lobe == k
            sin_l, cos_l = self.tilted[k]
            sin_o = sample_longitudinal(sin_l, cos_l, self.v[k], u1[of], u2[of])
            turn = self.phi_p[k] + sample_trimmed_logistic(rest[of], self.s) if k < 3 else TAU * rest[of]
            phi = self.phi_i + turn
            cos_o = np.sqrt(np.maximum(0.0, 1.0 - sin_o**2))
            wo[of] = np.stack([cos_o * np.cos(phi), cos_o * np.sin(phi), sin_o], axis=1)
        return wo


class Reference:
    """Answers the kit's protocol."""

    def describe(self):
        parameters = {"eta": [1.1, 2.0, 1.55], "tau": [0.0, 5.0, 0.0], "alpha": [-0.1, 0.1, 0.0]}
        parameters.update(beta_m=[0.15, 1.0, 0.3], beta_n=[0.15, 1.0, 0.3])
        claims = ["lossless", "smooth_cylinder", "chiang", "circular", "far_is_mean"]
        model = dict(name="reference", kind="fiber", fields=["near", "far"], lobes=True)
        model.update(parameters=parameters, claims=claims)
        return {"protocol": 1, "name": "reference.py", "version": "1", "models": [model]}

    def parts(self, q):
        """The offsets of a query and their shares."""
        if q["field"] == "near":
            return [(1.0, AtOffset(q["parameters"], q["wi"], q["h"]))]
        return [(w, AtOffset(q["parameters"], q["wi"], h)) for h, w in zip(OFFSETS, WEIGHTS)]

    def eval(self, q, wo):
        """f of each lobe, [n][lobe]."""
        return sum(w * at.shapes(wo) * at.a for w, at in self.parts(q))

    def pdf(self, q, wo):
        return sum(w * at.shapes(wo) @ at.chance for w, at in self.parts(q))

    def sample(self, q, u):
        parts = self.parts(q)
        edges = np.concatenate([[0.0], np.cumsum([w for w, _ in parts])])
        part = np.minimum(np.searchsorted(edges[1:], u[:, 0], side="right"), len(parts) - 1)
        wo = np.empty((len(u), 3))
        for k, (w, at) in enumerate(parts):
            of = part == k
            wo[of] = at.sample((u[of, 0] - edges[k]) / w, u[of, 1], u[of, 2])
        pdf, f = self.pdf(q, wo), self.eval(q, wo).sum(axis=1)
        weight = np.where(pdf > 0.0, f / np.maximum(pdf, 1e-300), 0.0)
        return {"wo": wo, "weight": weight, "pdf": pdf}


if __name__ == "__main__":
    serve(Reference())
