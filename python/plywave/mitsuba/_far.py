"""The mean of a cloth over its cell, for pixels that cover many yarns (src/cloth/light/far.rs).

The light of the plies comes from tables of views, inter-yarn scattering is evaluated at the mean energies, and a few
apertures represent all gaps through which light passes.
"""

import math

import drjit as dr
import numpy as np

from ._kit import clamp

TAU = 2.0 * math.pi
# src/cloth/light/far.rs
LENGTH_UM, APERTURES, MIN_COSINE, MIN_ENERGY = 150.0, 3, 0.02, 1e-6


def theta_of(theta_i, q, steps):
    """Latitude of node q, 0 to ``2 steps``, of the scattered light at incident latitude theta_i."""
    t = q / steps - 1.0
    t = t * dr.sqrt(dr.abs(t))
    return -theta_i + t * dr.select(t < 0.0, 0.5 * math.pi - theta_i, 0.5 * math.pi + theta_i)


def q_of(theta_i, theta_o, steps):
    """The inverse of :func:`theta_of`."""
    off = theta_o + theta_i
    width = dr.select(off < 0.0, 0.5 * math.pi - theta_i, 0.5 * math.pi + theta_i)
    t = dr.cbrt(dr.minimum(dr.abs(off) / dr.maximum(width, 1e-6), 1.0))
    return steps * (1.0 + dr.select(off < 0.0, -t * t, t * t))


def asin(x):
    """Arcsine that is exact in single precision near 1."""
    return dr.atan2(x, dr.sqrt(dr.maximum((1.0 - x) * (1.0 + x), 0.0)))


class Far:
    """Tables of the mean over the cell on the device."""

    def __init__(self, kit, tensors, cloth, along_y):
        """Loads the tables; ``along_y`` tells for each kind of yarn whether it runs along y (else along x)."""
        self.kit, self.cloth, self.along_y = kit, cloth, along_y
        f = tensors["far_f"]
        _, self.views, self.columns, self.nodes, self.sigmas = f.shape
        self.steps, self.cells = (self.nodes - 1) // 2, self.columns * (self.nodes - 1)
        self.axes = [tensors["far_phi_i"], tensors["far_theta_i"]]
        self.axis_tables = [kit.floats(axis) for axis in self.axes]
        self.inverse = [1.0 / (1.0 + float(s) * LENGTH_UM) for s in tensors["far_sigma"]]
        self.last_sigma = float(tensors["far_sigma"][-1])
        self.packets = self.sigmas // 4
        self.f = kit.floats(f)
        self.sums = kit.floats(np.pad(tensors["far_chances"], [(0, 0)] * 3 + [(1, 0)]))
        self.energy, self.first = kit.floats(tensors["far_energy"]), kit.floats(tensors["far_first"])
        self.passing, self.passing_shape = kit.floats(tensors["far_passing"]), tensors["far_passing"].shape
        self.apertures = kit.words(tensors["far_apertures"])
        # Number of classes of first plies of one kind.
        self.layers = tensors["far_first"].shape[2]

    # Absorptions

    def weights(self, sigma):
        """Weights of the absorption nodes for an absorption."""
        at, v = 1.0 / (1.0 + clamp(sigma, 0.0, self.last_sigma) * LENGTH_UM), self.inverse
        weights = []
        for i, node in enumerate(v):
            above = (v[i - 1] - at) * (1.0 / (v[i - 1] - node)) if i > 0 else 1.0
            below = (at - v[i + 1]) * (1.0 / (node - v[i + 1])) if i + 1 < len(v) else 1.0
            weights.append(dr.maximum(dr.minimum(above, below), 0.0))
        return weights

    def mixed(self, colors):
        """Mixes colors by their shares: weights of the absorption nodes by channel, and one representative absorption."""
        kit = self.kit
        weights, sigma = [], kit.zero_s()
        for k in range(kit.count):
            parts = [(share, color[k]) for share, color in colors]
            weights.append([sum(w) for w in zip(*([share * w for w in self.weights(s)] for share, s in parts))])
            mean = sum(share / (1.0 + clamp(s, 0.0, 1e6) * LENGTH_UM) for share, s in parts)
            sigma[k] = dr.maximum(1.0 / dr.maximum(mean, 1e-9) - 1.0, 0.0) * (1.0 / LENGTH_UM)
        return weights, sigma

    # Views

    @staticmethod
    def angles(along_y, w):
        """theta and phi of a direction about yarns that run along y or x."""
        along, across = (w[1], w[0]) if along_y else (w[0], w[1])
        return asin(clamp(along, -1.0, 1.0)), dr.atan2(w[2], across)

    @staticmethod
    def direction(along_y, theta, phi):
        s, c = dr.sincos(theta)
        t, u = dr.sincos(phi)
        across, up = c * u, c * t
        return [across, s, up] if along_y else [s, across, up]

    def node(self, which, x):
        """Node below ``x`` on an axis, and the weight of the next node."""
        kit, axis = self.kit, self.axes[which]
        node = kit.uint(0)
        for value in axis[1:-1]:
            node = node + dr.select(x >= float(value), kit.uint(1), kit.uint(0))
        low, high = (kit.take(self.axis_tables[which], node + i) for i in (0, 1))
        return node, clamp((x - low) / (high - low), 0.0, 1.0)

    def around(self, along_y, wo):
        """The four surrounding views and their weights, and theta_i."""
        theta, phi = self.angles(along_y, wo)
        rows, side = len(self.axes[1]), len(self.axes[0])
        i, s = self.node(0, dr.abs(phi) * (180.0 / math.pi))
        m, t = self.node(1, theta * (180.0 / math.pi))
        at = (i + dr.select(phi < 0.0, self.kit.uint(side), self.kit.uint(0))) * rows + m
        shares = [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t]
        return [at, at + 1, at + rows, at + rows + 1], shares, theta

    def passing_share(self, wo):
        """Share of the beam that passes all plies without hairs; a line and its reverse pass alike."""
        kit, (rows, columns) = self.kit, self.passing_shape
        theta, phi = self.angles(self.along_y[0], [dr.select(wo[2] < 0.0, -x, x) for x in wo])

        def node(x, count):
            x = clamp(x * (count / math.pi) - 0.5, 0.0, count - 1.0)
            low = dr.minimum(kit.uint(x), count - 2)
            return low, x - kit.float(low)

        (i, s), (j, t) = node(theta + 0.5 * math.pi, rows), node(phi, columns)
        low, high = (
            (1.0 - t) * kit.take(self.passing, at) + t * kit.take(self.passing, at + 1) for at in (i * columns + j, (i + 1) * columns + j)
        )
        return (1.0 - s) * low + s * high

    def row(self, table, at):
        """Values for all absorptions."""
        return self.kit.packets(table, at * self.packets, self.packets)

    # Light

    def at(self, wo, colors, gaps):
        """The mean seen from ``wo``; ``colors`` has, for each kind of yarn, absorptions with shares."""
        kit, cloth = self.kit, self.cloth
        detach = dr.detach if kit.jit else (lambda x: x)
        mixed = [self.mixed(of) for of in colors]
        at = {"wo": wo, "weights": [m[0] for m in mixed], "around": [], "dark": [], "energy": []}
        clear, classes, hairless = 0.0, [], [kit.zero_s()] * (cloth.classes // 2 - self.layers)
        for k, along_y in enumerate(self.along_y):
            views, shares, theta = self.around(along_y, wo)
            at["around"].append((views, shares, theta))
            sums, first = [0.0] * self.sigmas, [[0.0] * self.sigmas for _ in range(self.layers)]
            widths = [0.5 * math.pi - theta, 0.5 * math.pi + theta]
            for view, share in zip(views, shares):
                for side, width in enumerate(widths):
                    row = self.row(self.energy, (view + k * self.views) * 2 + side)
                    sums = [s + share * width * x for s, x in zip(sums, row)]
                for layers in range(self.layers):
                    row = self.row(self.first, (view + k * self.views) * self.layers + layers)
                    first[layers] = [s + share * x for s, x in zip(first[layers], row)]
            clear = clear + sum(row[0] for row in first)
            weights = mixed[k][0]
            dot = lambda row: [sum(x * w for x, w in zip(row, of)) for of in weights]
            energy = dot(sums)
            classes += [self.spectrum(dot(row)) for row in first] + hairless
            mean, bright, dark = detach(sum(energy) * (1.0 / kit.count)), sums[0], sums[-1]
            share = (bright - mean) / dr.maximum(bright - dark, 1e-9) * dark / dr.maximum(mean, 1e-30)
            at["dark"].append(dr.select(mean > 0.0, clamp(share, 0.0, 1.0), 0.0))
            at["energy"].append(self.spectrum(energy))
        sigma = [m[1] for m in mixed]
        if len(self.along_y) == 1:
            # The other kind scatters no light.
            classes += [kit.zero_s()] * (cloth.classes // 2)
            at["around"] *= 2
            at["dark"].append(kit.float(0.0))
            at["energy"].append(kit.zero_s())
        views, shares, _ = at["around"][0]
        at["passing"] = dr.select(clear > MIN_ENERGY, self.passing_share(wo), 1.0)
        # The light that non-absorbing plies scatter is the rest of the beam.
        per = (1.0 - at["passing"]) / dr.maximum(clear, MIN_ENERGY)
        classes = [per * e for e in classes]
        of_hairs = []
        if cloth.hairs is not None:
            at["free"] = cloth.hairs.passes(wo)
            at["hairs"] = hairs = cloth.hairs.at(wo, [sigma[0], sigma[-1]], at["free"] * at["passing"])
            at["passing"] = at["free"] * at["passing"] * hairs["passes_behind"]
            classes = cloth.hairs.with_energies([at["free"] * e for e in classes], hairs)
            of_hairs = [detach(kit.mean(out)) for out in hairs["out"]]
        at["up"], at["down"], at["about"], (_, caught) = cloth.inter_yarn(wo, classes, [sigma[0], sigma[-1]])
        # f of each kind has the energy that its first plies scatter and other plies do not intercept.
        at["scale"], of_kind = [], cloth.classes // 2
        for k, energy in enumerate(at["energy"]):
            straight = dr.maximum(sum(classes[of_kind * k : of_kind * k + self.layers]) - caught[k], 0.0)
            has_light = energy > MIN_ENERGY
            at["scale"].append(dr.select(has_light, straight / dr.maximum(energy, MIN_ENERGY), 1.0))
            at["energy"][k] = detach(kit.mean(dr.select(has_light, straight, energy)))
        at["up_sign"] = dr.select(wo[2] < 0.0, -1.0, 1.0)
        at["spectra"], at["count"] = [], kit.uint(0)
        if gaps is not None:
            nearest, best = views[0], shares[0]
            for view, share in zip(views[1:], shares[1:]):
                # Of several equal maxima, the last one is chosen.
                nearest, best = dr.select(share >= best, view, nearest), dr.maximum(best, share)
            row = nearest * (1 + 3 * APERTURES)
            at["count"] = kit.take_word(self.apertures, row)
            at["openings"] = row + 1
        parts = [*at["energy"], detach(kit.mean(at["up"])), detach(kit.mean(at["down"]))]
        total = sum(parts) + sum(of_hairs) + at["passing"]
        per = dr.select(total > 0.0, 1.0 / dr.maximum(total, 1e-30), 0.0)
        is_diffracted = at["count"] > 0
        at["chances"] = [per * e for e in parts] + [dr.select(is_diffracted, per * at["passing"], 0.0)] + [per * e for e in of_hairs]
        # Energy and probability of light that passes straight through.
        at["straight"] = dr.select(is_diffracted, 0.0, at["passing"])
        at["chance"] = per * at["straight"]
        return at

    def spectrum(self, values):
        s = self.kit.zero_s()
        for k, value in enumerate(values):
            s[k] = value
        return s

    def solid_angle(self, theta_i, q):
        low, high = (dr.sin(theta_of(theta_i, q + i, self.steps)) for i in (0.0, 1.0))
        return (high - low) * (TAU / self.columns)

    def plies(self, at, k, b):
        """f of the plies of a kind of yarn, by channel, and their sampling density."""
        kit = self.kit
        views, shares, theta_i = at["around"][k]
        theta, phi = self.angles(self.along_y[k], b)
        q = clamp(q_of(theta_i, theta, self.steps), 0.0, self.nodes - 1.0)
        row = dr.minimum(dr.floor(q), self.nodes - 2.0)
        s = q - row
        x = phi * (self.columns / TAU)
        whole = dr.floor(x)
        t, r = x - whole, kit.uint(row)
        column = kit.uint(whole + self.columns) % self.columns
        after = dr.select(column + 1 == self.columns, kit.uint(0), column + 1)
        corners = [
            (column * self.nodes + r, (1.0 - t) * (1.0 - s)),
            (column * self.nodes + r + 1, (1.0 - t) * s),
            (after * self.nodes + r, t * (1.0 - s)),
            (after * self.nodes + r + 1, t * s),
        ]
        cell = column * (self.nodes - 1) + r
        sums, density = [0.0] * self.sigmas, 0.0
        for view, share in zip(views, shares):
            view = view + k * self.views
            for node, weight in corners:
                weight = weight * share
                values = self.row(self.f, view * (self.columns * self.nodes) + node)
                sums = [a + weight * v for a, v in zip(sums, values)]
            chances = []
            for dark in range(2):
                place = (view * 2 + dark) * (self.cells + 1) + cell
                chances.append(kit.take(self.sums, place + 1) - kit.take(self.sums, place))
            density = density + share * ((1.0 - at["dark"][k]) * chances[0] + at["dark"][k] * chances[1])
        per_cosine = 1.0 / dr.maximum(dr.cos(theta), MIN_COSINE)
        f = at["scale"][k] * per_cosine * self.spectrum([sum(v * w for v, w in zip(sums, weights)) for weights in at["weights"][k]])
        return f, density / dr.maximum(self.solid_angle(theta_i, row), 1e-12)

    def eval(self, at, b, lam, gaps):
        """f and sampling density in a direction of the pattern."""
        kit, cloth = self.kit, self.cloth
        is_up = b[2] * at["up_sign"] >= 0.0
        f, pdf = kit.zero_s(), cloth.inter_yarn_pdf(at["about"], at["chances"][2:4], is_up, b)
        for k in range(len(self.along_y)):
            light, density = self.plies(at, k, b)
            f, pdf = f + light, pdf + at["chances"][k] * density
        if cloth.hairs is not None:
            f = cloth.hairs.passes(b) * f + cloth.hairs.eval(at["hairs"], is_up, b)
            pdf = pdf + dr.select(is_up, *at["chances"][5:]) * (0.5 / math.pi)
        f = f + cloth.inter_yarn_eval(at["about"], at["up"], at["down"], is_up, b)
        if gaps is not None:
            per = 1.0 / dr.maximum(kit.float(at["count"]), 1.0)

            def one(i, light, density):
                first = at["openings"] + 3 * i
                spectra = gaps.opening([kit.take_word(self.apertures, first + k) for k in range(3)])
                here = at["count"] > i
                value, chance = gaps.eval(spectra, at["wo"], lam, b)
                dark = kit.no(kit.both(spectra[0].passes(), spectra[1].passes()))
                here = kit.both(kit.both(here, kit.no(dark)), at["wo"][2] != 0.0)
                return light + dr.select(here, value, kit.zero_s()), density + dr.select(here, chance, 0.0)

            light, density = kit.times(APERTURES, (kit.zero_s(), kit.float(0.0)), one, False, "apertures")
            f, pdf = f + at["passing"] * per * light, pdf + at["chances"][4] * per * density
        return f, pdf

    def draw(self, at, lam, gaps, u):
        """Samples a direction of the pattern; also returns whether light passes straight through instead."""
        kit = self.kit
        remaining, found, number = u[0], kit.bool(False), u[0]
        which = kit.uint(7)
        for i, chance in enumerate(at["chances"]):
            here = kit.both(kit.no(found), remaining < chance)
            number = dr.select(here, remaining / dr.maximum(chance, 1e-30), number)
            which = dr.select(here, kit.uint(i), which)
            found = found | here
            remaining = dr.select(found, remaining, remaining - chance)
        number = clamp(number, 0.0, 0.99999994)
        b = self.draw_plies(at, which == 0, [number, u[1], u[2]])
        w = self.cloth.inter_yarn_draw(at["about"], which == 2, at["up_sign"], [number, u[1], u[2]])
        b = [dr.select((which == 2) | (which == 3), x, y) for x, y in zip(w, b)]
        if gaps is not None:
            x = number * dr.maximum(kit.float(at["count"]), 1.0)
            i = dr.minimum(dr.floor(x), dr.maximum(kit.float(at["count"]), 1.0) - 1.0)
            first = at["openings"] + 3 * kit.uint(i)
            spectra = gaps.opening([kit.take_word(self.apertures, first + k) for k in range(3)])
            w = gaps.draw(spectra, at["wo"], lam, [clamp(x - i, 0.0, 0.99999994), u[1], u[2]])
            b = [dr.select(which == 4, x, y) for x, y in zip(w, b)]
        if self.cloth.hairs is not None:
            w = self.cloth.hairs.draw(dr.select(which == 5, at["up_sign"], -at["up_sign"]), u[1:])
            b = [dr.select((which == 5) | (which == 6), x, y) for x, y in zip(w, b)]
        return b, kit.no(found)

    def draw_plies(self, at, is_first, u):
        """Samples a direction of the light of the first or the last kind."""
        kit = self.kit
        (a, b) = at["around"]
        views = [dr.select(is_first, x, y + (len(self.along_y) - 1) * self.views) for x, y in zip(a[0], b[0])]
        shares = [dr.select(is_first, x, y) for x, y in zip(a[1], b[1])]
        theta_i, share_dark = dr.select(is_first, a[2], b[2]), dr.select(is_first, *at["dark"])
        u0, view, found = u[0], views[3], kit.bool(False)
        for v, share in zip(views, shares):
            here = kit.both(kit.no(found), u0 < share)
            view = dr.select(here, v, view)
            u0 = dr.select(here, u0 / dr.maximum(share, 1e-30), dr.select(found, u0, u0 - share))
            found = found | here
        dark = dr.select(clamp(u0, 0.0, 0.99999994) < share_dark, kit.uint(1), kit.uint(0))
        first = (view * 2 + dark) * (self.cells + 1)
        target = u[1] * kit.take(self.sums, first + self.cells)
        # Binary search for the last cell whose cumulative sum does not exceed the target.
        cell, step = kit.uint(0), 1 << ((self.cells - 1).bit_length() - 1)
        while step:
            after = dr.minimum(cell + step, kit.uint(self.cells - 1))
            cell = dr.select(kit.take(self.sums, first + after) <= target, after, cell)
            step //= 2
        low, high = (kit.take(self.sums, first + cell + i) for i in (0, 1))
        across = clamp((target - low) / dr.maximum(high - low, 1e-20), 0.0, 0.99999994)
        column = cell // (self.nodes - 1)
        row = kit.float(cell - column * (self.nodes - 1))
        low, high = (dr.sin(theta_of(theta_i, row + i, self.steps)) for i in (0.0, 1.0))
        theta = asin(clamp(low + (high - low) * u[2], -1.0, 1.0))
        phi = (kit.float(column) + across) * (TAU / self.columns)
        return [dr.select(is_first, x, y) for x, y in zip(*(self.direction(along_y, theta, phi) for along_y in (self.along_y[0], self.along_y[-1])))]
