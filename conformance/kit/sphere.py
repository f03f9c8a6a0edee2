"""Grids on the sphere, a chi-square test, and incidences: what the checks share. Only numpy."""
import math

import numpy as np

TAU = 2.0 * np.pi


def direction(theta, phi):
    """Unit vector of latitude theta and azimuth phi, z along the fiber (or the normal, theta from the plane)."""
    return np.array([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)])


class Grid:
    """Gauss-Legendre nodes in `bins` latitudes times azimuths; sums over nodes give integrals, by bin or in all.

    Nodes are in the latitude with the weight cos(theta).
    """

    def __init__(self, bins=(12, 24), nodes=(8, 8)):
        self.bins, self.nodes = bins, nodes
        edges = np.linspace(-0.5 * np.pi, 0.5 * np.pi, bins[0] + 1)
        theta, wt = composite(edges, nodes[0])
        phi, wp = composite(np.linspace(-np.pi, np.pi, bins[1] + 1), nodes[1])
        t, p = np.meshgrid(theta, phi, indexing="ij")
        self.theta, self.phi = t.ravel(), p.ravel()
        cos = np.cos(self.theta)
        self.wo = np.stack([cos * np.cos(self.phi), cos * np.sin(self.phi), np.sin(self.theta)], axis=1)
        self.weight = (np.outer(wt, wp).ravel()) * cos

    def integral(self, values):
        """Integral over the sphere; a second axis is kept."""
        return np.tensordot(self.weight, values, axes=(0, 0))

    def by_bin(self, values):
        """Integral over each bin."""
        shape = (self.bins[0], self.nodes[0], self.bins[1], self.nodes[1])
        return (self.weight * values).reshape(shape).sum(axis=(1, 3)).ravel()

    def bin_of(self, wo):
        theta, phi = np.arcsin(np.clip(wo[:, 2], -1.0, 1.0)), np.arctan2(wo[:, 1], wo[:, 0])
        i = np.clip(((theta / np.pi + 0.5) * self.bins[0]).astype(int), 0, self.bins[0] - 1)
        j = np.clip(((phi / TAU + 0.5) * self.bins[1]).astype(int), 0, self.bins[1] - 1)
        return i * self.bins[1] + j

    def finer(self):
        """The same bins with twice the nodes each way."""
        return Grid(self.bins, (2 * self.nodes[0], 2 * self.nodes[1]))


# Directions on a spiral, where its count is not said.
SPIRAL = 300000


def spiral(count=SPIRAL):
    """Directions of equal weight 4 pi / count on Fibonacci's spiral.

    No line of latitude has more than one of them, so that a jump of f along one costs little."""
    i = np.arange(count) + 0.5
    z, phi = 1.0 - 2.0 * i / count, np.pi * (1.0 + np.sqrt(5.0)) * i
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)


def basis(w):
    """Two vectors across each direction, with it a right-handed frame (Duff et al. 2017)."""
    sign = np.where(w[:, 2] < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + w[:, 2])
    b = w[:, 0] * w[:, 1] * a
    first = np.stack([1.0 + sign * w[:, 0] ** 2 * a, sign * b, -sign * w[:, 0]], axis=1)
    return first, np.stack([b, sign + w[:, 1] ** 2 * a, -w[:, 1]], axis=1)


def composite(edges, nodes):
    """Gauss-Legendre nodes and weights in each interval."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    half = 0.5 * np.diff(edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return (middle[:, None] + half[:, None] * x).ravel(), (half[:, None] * w).ravel()


def chi_square(observed, expected, minimum=8.0):
    """p-value of counts against expected counts; bins that expect less than `minimum` are pooled.

    A sum that the samples miss by more than rounding belongs in a bin of its own, which the caller adds.
    """
    order = np.argsort(expected)
    o, e = observed[order], expected[order]
    cut = int(np.searchsorted(e, minimum))
    pooled_o, pooled_e = o[:cut].sum(), e[:cut].sum()
    o, e = o[cut:], e[cut:]
    if pooled_e > 0.0:
        # A pool below the minimum joins the smallest bin that is left.
        if pooled_e >= minimum or len(e) == 0:
            o, e = np.append(o, pooled_o), np.append(e, pooled_e)
        else:
            o[0], e[0] = o[0] + pooled_o, e[0] + pooled_e
    elif pooled_o > 0.0:
        return 0.0
    statistic = float((((o - e) ** 2) / e).sum())
    return gamma_upper(0.5 * max(len(e) - 1, 1), 0.5 * statistic)


def gamma_upper(a, x):
    """Regularized upper incomplete gamma function Q(a, x) (series below a + 1, Lentz's fraction above)."""
    if not math.isfinite(x):
        return 0.0
    if x <= 0.0:
        return 1.0
    front = math.exp(-x + a * math.log(x) - math.lgamma(a))
    if x < a + 1.0:
        term = total = 1.0 / a
        n = a
        while term > total * 1e-15:
            n += 1.0
            term *= x / n
            total += term
        return max(0.0, 1.0 - front * total)
    b, c = x + 1.0 - a, 1e300
    d = 1.0 / b
    h = d
    for i in range(1, 10000):
        an = -i * (i - a)
        b += 2.0
        d = 1.0 / (an * d + b)
        c = b + an / c
        h *= d * c
        if abs(d * c - 1.0) < 1e-15:
            break
    return front * h
