"""Fiber tables in Dr.Jit: d'Eon's M_0 over the latitude, the table's N over the azimuth (Xia 2020, 5 and 6).

The tables are those of the fiber files (docs/reference/format/models.md) and the formulas those of ``fiber/src/model.rs`` and ``fiber/src/distributions/longitudinal.rs``.
"""

import math

import drjit as dr
import numpy as np

from ._kit import clamp

TAU = 2.0 * math.pi
# fiber/src/model.rs, fiber/src/table/table.rs
WIDTH_LIMIT, BETA_M = 6.0, (1e-3, 2.0)

# e^-x I_0(x) (fiber/src/distributions/longitudinal.rs).
NEAR = [
    3.3839764e-1, -3.0468267e-1, 1.716209e-1, -9.49011e-2, 4.9305284e-2, -2.3737415e-2, 1.054646e-2, -4.32431e-3, 1.6394756e-3,
    -5.763756e-4, 1.8850289e-4, -5.754195e-5, 1.6448448e-5, -4.416738e-6, 1.1173846e-6, -2.6706212e-7, 6.037319e-8, -1.2481271e-8,
]  # fmt: skip
FAR = [4.022452e-1, 3.3691165e-3, 6.889758e-5, 2.8913705e-6, 2.0489187e-7, 2.266673e-8]


def i0e(x):
    """``e^-x I_0(x)`` for x >= 0."""
    is_far = x > 8.0
    far = dr.select(is_far, x, 16.0)
    return dr.select(is_far, _chebyshev(FAR, 16.0 / far - 1.0) * dr.rsqrt(far), _chebyshev(NEAR, 0.25 * dr.minimum(x, 8.0) - 1.0))


def _chebyshev(c, t):
    b1 = b2 = 0.0
    for value in c[:0:-1]:
        b1, b2 = value + 2.0 * t * b1 - b2, b1
    return c[0] + t * b1 - b2


def longitudinal(v, i, o):
    """M_0 with variance ``v`` between the latitudes ``i`` and ``o``, each given as sine and cosine: a density over ``cos
    theta_o d theta_o``.
    """
    scale = 1.0 / (v * (1.0 - dr.exp(-2.0 / v)))
    across, along = i[1] - o[1], i[0] + o[0]
    return scale * dr.exp(-0.5 * (across * across + along * along) / v) * i0e(i[1] * o[1] / v)


def longitudinal_draw(v, i, u):
    """Samples a latitude with density ``M_0 cos theta_o`` from two numbers in [0, 1); returns its sine and cosine."""
    w = clamp(-v * dr.log((1.0 - u[0]) + u[0] * dr.exp(-2.0 / v)), 0.0, 2.0)
    cos, sin = 1.0 - w, dr.sqrt(dr.maximum(w * (2.0 - w), 0.0))
    sin_psi, cos_psi = dr.sincos(TAU * u[1])
    x, y = i[1] * cos + i[0] * sin * cos_psi, sin * sin_psi
    return clamp(i[1] * sin * cos_psi - i[0] * cos, -1.0, 1.0), dr.sqrt(x * x + y * y)


class Fiber:
    """The table of a fiber on the device."""

    def __init__(self, kit, tensors, document):
        self.kit = kit
        symmetry = document["symmetry"]
        self.folds, self.is_mirrored = int(symmetry["folds"]), symmetry["mirror_rad"] is not None
        azimuthal, c_x = tensors["azimuthal"].astype(np.float64), tensors["c_x_um"]
        self.counts, self.cells = azimuthal.shape[:3], azimuthal.shape[3]
        lam, phi = tensors["lambda_um"], tensors["phi_i"]
        l, _, p = self.counts
        self.lambda_first = float(lam[0])
        self.lambda_per_um = (l - 1) / float(lam[-1] - lam[0]) if l > 1 else 0.0
        self.phi_first, self.turn = float(phi[0]), TAU / max(self.folds, 1)
        step = TAU
        if self.folds > 0:
            step = math.pi / (self.folds * max(p - 1, 1)) if self.is_mirrored else TAU / (self.folds * max(p, 1))
        self.phi_per_rad = 1.0 / step
        width = np.minimum(c_x, WIDTH_LIMIT * tensors["width_um"])
        self.max_width_um = float(np.float32(width.max()))
        # Cumulative light at the nodes; the mean of a cell is that of its two nodes.
        means = 0.5 * (azimuthal + np.roll(azimuthal, -1, -1))
        sums = np.concatenate([np.zeros((*self.counts, 1)), np.cumsum(means, -1)], -1)
        self.values, self.sums = kit.floats(azimuthal), kit.floats(sums)
        # Width and albedo of each slice.
        self.slices = kit.floats(np.stack([width, sums[..., -1] * (TAU / self.cells)], -1))

    def _place(self, at, count):
        """Nodes around the position ``at`` (in units of nodes), and their weights."""
        if count == 1:
            return [(self.kit.uint(0), 1.0)]
        at = clamp(at, 0.0, count - 1.0)
        first = dr.minimum(dr.floor(at), count - 2.0)
        node, t = self.kit.uint(first), at - first
        return [(node, 1.0 - t), (node + 1, t)]

    def _around(self, phi):
        """Nodes around the azimuth, and whether they contain it mirrored."""
        kit, count = self.kit, self.counts[2]
        if self.folds == 0:
            return [(kit.uint(0), 1.0)], kit.bool(False)
        turns = (phi - self.phi_first) / self.turn
        x = (turns - dr.floor(turns)) * self.turn
        if self.is_mirrored:
            mirrored = x > 0.5 * self.turn
            return self._place(dr.select(mirrored, self.turn - x, x) * self.phi_per_rad, count), mirrored
        at = x * self.phi_per_rad
        first = dr.minimum(dr.floor(at), count - 1.0)
        node, t = kit.uint(first), clamp(at - first, 0.0, 1.0)
        return [(node, 1.0 - t), (dr.select(node + 1 == count, kit.uint(0), node + 1), t)], kit.bool(False)

    def at(self, wi, lam):
        """Looks up the values that are shared by all outgoing directions, for light from ``wi`` in the fiber's frame and
        a list of wavelengths [um].
        """
        kit = self.kit
        sin, cos = wi[2], dr.sqrt(wi[0] * wi[0] + wi[1] * wi[1])
        has = cos > 0.0
        per = 1.0 / dr.select(has, cos, 1.0)
        x, y = dr.select(has, wi[0] * per, 1.0), dr.select(has, wi[1] * per, 0.0)
        theta = dr.atan2(dr.abs(sin), cos)
        latitudes = self._place(theta * (self.counts[1] / (0.5 * math.pi)) - 0.5, self.counts[1])
        azimuths, mirrored = self._around(dr.atan2(y, x))
        at = {"azimuth": (x, y), "latitude": (sin, cos), "mirrored": mirrored, "corners": [], "albedo": kit.zero_s(), "width_um": kit.zero_s()}
        for k in range(kit.count):
            corners, width, albedo = [], 0.0, 0.0
            for a, of_lambda in self._place((lam[k] - self.lambda_first) * self.lambda_per_um, self.counts[0]):
                for b, of_theta in latitudes:
                    for c, of_phi in azimuths:
                        slice_ = (a * self.counts[1] + b) * self.counts[2] + c
                        share = of_lambda * of_theta * of_phi * kit.take(self.slices, slice_ * 2)
                        width, albedo = width + share, albedo + share * kit.take(self.slices, slice_ * 2 + 1)
                        corners.append((slice_, share))
            at["corners"].append([(slice_, share / width) for slice_, share in corners])
            at["width_um"][k], at["albedo"][k] = width, albedo / width
        return at

    def _mix(self, table, corners, j, row):
        return sum(share * self.kit.take(table, slice_ * row + j) for slice_, share in corners)

    def eval(self, at, v, wo):
        """f by wavelength [1/sr]; ``v`` is the variance of M_0."""
        kit, (x, y) = self.kit, at["azimuth"]
        o = (wo[2], dr.sqrt(wo[0] * wo[0] + wo[1] * wo[1]))
        relative = dr.atan2(x * wo[1] - y * wo[0], x * wo[0] + y * wo[1])
        relative = dr.select(at["mirrored"], -relative, relative) * (1.0 / TAU)
        place = (relative - dr.floor(relative)) * self.cells
        first = dr.minimum(dr.floor(place), self.cells - 1.0)
        j, t = kit.uint(first), clamp(place - first, 0.0, 1.0)
        after = dr.select(j + 1 == self.cells, kit.uint(0), j + 1)
        m, f = longitudinal(v, at["latitude"], o), kit.zero_s()
        for k in range(kit.count):
            low, high = (self._mix(self.values, at["corners"][k], n, self.cells) for n in (j, after))
            f[k] = m * ((1.0 - t) * low + t * high)
        return f

    def draw(self, at, v, shares, u):
        """Samples a direction: a wavelength in proportion to ``shares``, then its azimuth and the latitude."""
        kit = self.kit
        total = sum(shares[k] for k in range(kit.count))
        left = u[0] * total
        corners, of, found = at["corners"][-1], shares[kit.count - 1], kit.bool(False)
        below = before = kit.float(0.0)
        for k in range(kit.count - 1):
            here = kit.both(kit.no(found), left < before + shares[k])
            corners = [(dr.select(here, a, c), dr.select(here, b, d)) for (a, b), (c, d) in zip(at["corners"][k], corners)]
            of, below = dr.select(here, shares[k], of), dr.select(here, before, below)
            found, before = found | here, before + shares[k]
        below = dr.select(found, below, before)
        first = clamp((left - below) / dr.maximum(of, 1e-30), 0.0, 0.99999994)
        relative = self._invert(corners, first)
        relative = dr.select(at["mirrored"], -relative, relative)
        sin, cos = longitudinal_draw(v, at["latitude"], [u[1], u[2]])
        x, y = at["azimuth"]
        s, c = dr.sincos(dr.atan2(y, x) + relative)
        return [cos * c, cos * s, sin]

    def _invert(self, corners, u):
        """Relative azimuth [rad] below which the mixed slices have the fraction ``u`` of their light."""
        kit, row = self.kit, self.cells + 1
        target = u * self._mix(self.sums, corners, self.cells, row)
        # Binary search for the last node whose cumulative light does not exceed the target.
        j, step = kit.uint(0), 1 << max((self.cells - 1).bit_length() - 1, 0)
        while step and self.cells > 1:
            next_ = dr.minimum(j + step, self.cells - 1)
            j = dr.select(self._mix(self.sums, corners, next_, row) <= target, next_, j)
            step //= 2
        low = self._mix(self.values, corners, j, self.cells)
        high = self._mix(self.values, corners, dr.select(j + 1 == self.cells, kit.uint(0), j + 1), self.cells)
        mass = 0.5 * (low + high)
        x = clamp((target - self._mix(self.sums, corners, j, row)) / dr.maximum(mass, 1e-30), 0.0, 1.0)
        # Solves t (low + t (high - low) / 2) = x for the fraction t of the cell.
        root = dr.sqrt(dr.maximum(low * low + x * (high * high - low * low), 0.0))
        t = dr.select(low + root > 0.0, x * (low + high) / dr.maximum(low + root, 1e-30), x)
        return (kit.float(j) + clamp(t, 0.0, 1.0)) * (TAU / self.cells)
