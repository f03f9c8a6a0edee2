"""Inter-yarn scattering in Dr.Jit (``src/cloth/light/inter_yarn.rs``, ``splines.rs``)."""

import math

import drjit as dr

from ._kit import clamp
from ._shadow import two_thirds

TAU = 2.0 * math.pi
SIGMAS, LENGTH_UM, COUNT, SPLINE_COLUMNS, INTERVALS, PLY_CLASSES = 8, 150.0, 168, 24, 5, 4
# src/cloth/light/cones.rs: numbers per cone (width, 16 terms, norms), nodes of the norm, smallest energy.
CONE, NORMS, MIN_ENERGY = 50, 33, 1e-3
# src/cloth/light/inter_yarn.rs: probability of sampling the cones for light about them.
ABOUT_CONES, MAX_LEAN = 0.2, 0.9


# src/cloth/light/lit_places.rs: angles about a ply, maps (for clear and for dark fibers), functions of the
# light's direction.
ANGLES, MAPS, FUNCTIONS = 8, 2, 4
RATIOS = 2 * MAPS * FUNCTIONS


# Nodes of absorption [1/um], and v = 1 / (1 + sigma L) at the nodes, with 0 appended.
SIGMA_PER_UM = (0.0, 0.0006, 0.002, 0.005, 0.0115, 0.028, 0.085, 3.0)
V = [1.0 / (1.0 + s * LENGTH_UM) for s in SIGMA_PER_UM[:-1]] + [0.0]


def sigma_nodes(kit, sigma):
    """Node below an absorption, and the fraction towards the next node."""
    sigma = clamp(sigma, 0.0, 1e6)
    v = 1.0 / (1.0 + sigma * LENGTH_UM)
    node, high, per = kit.uint(0), V[0], 1.0 / (V[0] - V[1])
    for n in range(1, SIGMAS - 1):
        beyond = sigma >= SIGMA_PER_UM[n]
        node = dr.select(beyond, kit.uint(n), node)
        high, per = dr.select(beyond, V[n], high), dr.select(beyond, 1.0 / (V[n] - V[n + 1]), per)
    return node, (high - v) * per


def polynomials(w):
    x, y, z = w[0], w[1], dr.abs(w[2])
    d, e = x * x - y * y, 2.0 * x * y
    return [1.0, z, z * z, z * z * z, x, y, x * z, y * z, d, e, d * z, e * z, d * z * z, e * z * z, d * d - e * e, 2.0 * d * e]


def functions(b):
    return [1.0, b[0], b[1], dr.abs(b[2])]


def clear_map_share(sigma):
    dark = 1.0 / (1.0 + SIGMA_PER_UM[5] * LENGTH_UM)
    return dr.maximum((1.0 / (1.0 + clamp(sigma, 0.0, 1e6) * LENGTH_UM) - dark) * (1.0 / (1.0 - dark)), 0.0)


def spline(kit, a):
    """Indices and values of the splines that are not zero in a direction."""
    x = two_thirds(dr.minimum(dr.abs(a[2]), 1.0)) * INTERVALS
    row = dr.minimum(dr.floor(x), INTERVALS - 1.0)
    quadratic = lambda u: [0.5 * (1.0 - u) * (1.0 - u), 0.5 + u * (1.0 - u), 0.5 * u * u]
    column = dr.atan2(a[1], a[0]) * (SPLINE_COLUMNS / TAU)
    whole, c = kit.floor(column)
    rows, columns = quadratic(x - row), quadratic(column - whole)
    out = []
    for i in range(3):
        for j in range(3):
            at = (kit.uint(row) + i) * SPLINE_COLUMNS + kit.uint(c + (j + SPLINE_COLUMNS)) % SPLINE_COLUMNS
            out.append((at, rows[i] * columns[j]))
    return out


def few(t):
    return [t[0], t[1], t[2], t[3], t[4], t[5], t[8], t[9]]


class Between:
    """Light that plies scatter to other yarns, and the directions in which it leaves. The tables are those of
    ``Curves``.
    """

    def inter_yarn(self, a, classes, sigma):
        """Energies that leave up and down, of a beam from ``a`` whose first plies scatter ``classes``, energies by class, in yarns of two kinds of ``sigma``; what
        ``between_eval`` needs besides; what other yarns catch of the first plies' light, and of that of plies alone by kind."""
        kit, n, count = self.kit, self.kit.count, self.classes
        t = polynomials(a)
        terms = few(t)
        side = dr.select(a[2] < 0.0, kit.uint(1), kit.uint(0))
        splines = spline(kit, a)
        nodes = [[sigma_nodes(kit, sigma[f][k]) for k in range(n)] for f in range(2)]
        corners = [self.corners(nodes[0][k], nodes[1][k]) for k in range(n)]
        sent = [self.options["shadowing"], self.options["layers"]]

        def of_class(classes, cls):
            e = classes[count - 1]
            for c in range(count - 2, -1, -1):
                e = dr.select(cls == c, classes[c], e)
            return e

        def following(cls):
            """The next class with energy, starting at ``cls``."""
            found = kit.uint(count)
            for c in range(count - 1, -1, -1):
                found = dr.select(kit.both(cls <= c, self.some(classes[c])), kit.uint(c), found)
            return found

        def body(given, cls, up, down, all_caught, of_first, of_second, *parallel):
            classes, fractions, weights = given
            energy = of_class(classes, cls)
            is_first = cls < count // 2
            up, down, all_caught = kit.S(up), kit.S(down), kit.S(all_caught)
            of_plies = [kit.S(of_first), kit.S(of_second)]
            is_ply = (cls % (count // 2)) < PLY_CLASSES
            parallel = [kit.S(x) for x in parallel]
            for k in range(n):
                node = dr.select(is_first, nodes[0][k][0], nodes[1][k][0])
                u = dr.select(is_first, fractions[0][k], fractions[1][k])
                at = ((side * count + cls) * (SIGMAS - 1) + node) * COUNT
                sums = [0.0] * 6
                for index, w in splines:
                    values = kit.packets(self.caught, (at + index) * 2, 2)
                    sums = [s + w * v for s, v in zip(sums, values)]
                of = [(1.0 - u) * sums[i] + u * sums[3 + i] for i in range(3)]
                per = energy[k] / dr.maximum(of[2], 1e-6)
                for cause in range(2):
                    if not sent[cause]:
                        continue
                    caught = clamp(per * of[cause], -energy[k], energy[k])
                    all_caught[k] = all_caught[k] + caught
                    for kind, here in enumerate((is_first, kit.no(is_first))):
                        of_plies[kind][k] = of_plies[kind][k] + dr.select(kit.both(is_ply, here), caught, 0.0)
                    for half in range(2):
                        at_leaves = (((side * count + cls) * 2 + cause) * 2 + half) * (SIGMAS * SIGMAS)
                        leaves = 0.0
                        for (pair, _), share in zip(corners[k], weights[k]):
                            values = kit.packets(self.leaves, (at_leaves + pair) * 2, 2)
                            leaves = leaves + share * sum(v * t for v, t in zip(values, terms))
                        leaves = clamp(leaves, 0.0, 1.0)
                        out = caught * leaves
                        if parallel:
                            at_node = ((((side * count + cls) * 2 + cause) * 2 + half) * SIGMAS + node) * 2
                            low, high = (sum(v * t for v, t in zip(kit.packets(self.parallel, at_node + 2 * i, 2), terms)) for i in range(2))
                            own = caught * dr.minimum(dr.maximum(low + u * (high - low), 0.0), leaves)
                            for kind, here in enumerate((is_first, kit.no(is_first))):
                                parallel[2 * kind + half][k] = parallel[2 * kind + half][k] + dr.select(here, own, 0.0)
                        if half == 0:
                            up[k] = up[k] + out
                        else:
                            down[k] = down[k] + out
            return following(cls + 1), up, down, all_caught, *of_plies, *parallel

        fractions = [[nodes[f][k][1] for k in range(n)] for f in range(2)]
        given = (list(classes), fractions, [[share for _, share in corners[k]] for k in range(n)])
        state = (following(kit.uint(0)), *(kit.zero_s() for _ in range(9 if self.axes else 5)))
        _, up, down, caught, of_first, of_second, *parallel = kit.loop(state, lambda cls, *_: cls < count, body, "light between yarns", given)
        for k in range(n):
            for half, energy in enumerate((up, down)):
                rest = energy[k] = dr.maximum(energy[k], 0.0)
                for own in parallel[half::2]:
                    own[k] = clamp(own[k], 0.0, rest)
                    rest = rest - own[k]
        return up, down, (side, corners, parallel, self.cones_at(a, side, (up, down), parallel), None), (caught, [of_first, of_second])

    def ratios_at(self, hit):
        """Ratio of inter-yarn light to its mean at a hit, as coefficients by side of the light and map (``LitPlaces::at``)."""
        kit, (x, y, z) = self.kit, hit["frame"]
        across = clamp(hit["h_um"] / hit["radius"], -1.0, 1.0)
        towards = dr.sqrt(1.0 - across * across)
        n = [towards * p + across * q for p, q in zip(y, x)]
        turns = (dr.atan2(n[0] * z[1] - n[1] * z[0], n[2]) * (1.0 / TAU) + 1.0) * ANGLES
        low = dr.floor(turns)
        angles = [(kit.uint(low) % ANGLES, 1.0 - (turns - low)), ((kit.uint(low) + 1) % ANGLES, turns - low)]
        sums = [0.0] * RATIOS
        for row, weight in self.shadow_rows(hit, 0.0):
            for angle, share in angles:
                values = kit.packets(self.places, (row * ANGLES + angle) * (RATIOS // 4), RATIOS // 4)
                sums = [total + weight * share * value for total, value in zip(sums, values)]
        return sums

    def at_place(self, a, up, down, about, caught, ratios, weight, all_, sigma):
        """Moves inter-yarn light to the place of the plies whose ``ratios``, weighted by the light that they intercept, these
        are; ``all_`` is what plies and hairs intercept. Returns the energies there, what ``inter_yarn_eval`` needs, and what other
        yarns catch there.
        """
        kit, (side, corners, parallel, cones, _) = self.kit, about
        means = [0.0] * RATIOS
        for index, w in spline(kit, a):
            values = kit.packets(self.place_means, (side * COUNT + index) * (RATIOS // 4), RATIOS // 4)
            means = [total + w * value for total, value in zip(means, values)]
        per = 1.0 / dr.maximum(dr.maximum(all_, weight), 1e-30)
        of = [per * (ratio - weight * mean) for ratio, mean in zip(ratios, means)]
        half = RATIOS // 2
        of = [dr.select(side == 0, x, y) for x, y in zip(of, of[half:] + of[:half])]
        deviations = [[of[(half * 2 + m) * FUNCTIONS :][:FUNCTIONS] for m in range(MAPS)] for half in range(2)]
        clear = [clear_map_share(sigma[k]) for k in range(kit.count)]
        place, out, leaves = (deviations, clear, (up, down)), [], [[0.0, 0.0] for _ in clear]
        for half, energy in enumerate((up, down)):
            here = kit.zero_s()
            for k in range(kit.count):
                parts, rest = [], energy[k]
                for kind in range(len(parallel) // 2):
                    own, sine = parallel[2 * kind + half][k], cones[2 * kind + half][1]
                    t = [1.0, 0.0, 0.0, 0.25 * math.pi * dr.sqrt(dr.maximum(1.0 - sine * sine, 0.0))]
                    t[1 + self.axes[kind]] = -sine
                    rest = rest - own
                    parts.append((own, t))
                t = [0.0] * FUNCTIONS
                for pair, share in corners[k]:
                    values = kit.packets(self.shape_means, (side * 2 + half) * (SIGMAS * SIGMAS) + pair, 1)
                    t = [total + share * value for total, value in zip(t, values)]
                factors = [(own, *self.place_factors(place, half, k, t)) for own, t in [*parts, (rest, t)]]
                here[k] = sum(own * ratio for own, _, ratio in factors)
                leaves[k] = [leaves[k][0] + energy[k], sum((own * bright for own, bright, _ in factors), leaves[k][1])]
            out.append(here)
        # What leaves of clear fibers is what other yarns intercept.
        caught = kit.S(caught)
        for k, (all_, bright) in enumerate(leaves):
            caught[k] = caught[k] * dr.select(all_ > 0.0, bright / dr.maximum(all_, 1e-30), 1.0)
        detach = dr.detach if kit.jit else (lambda x: x)
        leans = [tuple(detach(x) for x in lean) for lean in self.leans(kit, place, out)]
        return *out, (side, corners, parallel, cones, (*place, leans)), caught

    @staticmethod
    def leans(kit, place, out):
        """For each half, x and y of the density of samples, ``cos / pi (1 + x b_x + y b_y)``."""
        deviations, clear, means = place
        share, leans = sum(clear) * (1.0 / kit.count), []
        for half, (energy, mean) in enumerate(zip(out, means)):
            bright, dark = deviations[half]
            x, y = (dark[i] + share * (bright[i] - dark[i]) for i in (1, 2))
            mean, here = kit.mean(mean), kit.mean(energy)
            per = mean / dr.maximum(dr.maximum(here, 1e-3 * mean), 1e-30)
            per = per * dr.minimum(MAX_LEAN / dr.maximum(per * dr.sqrt(x * x + y * y), 1e-30), 1.0)
            leans.append((per * x, per * y))
        return leans

    @staticmethod
    def place_factors(place, half, k, t):
        """Ratios to the mean over places of clear fibers, and in channel ``k``."""
        deviations, clear = place[:2]
        bright, dark = (sum(c * v for c, v in zip(of, t)) for of in deviations[half])
        return dr.maximum(1.0 + bright, 0.0), dr.maximum(1.0 + dark + clear[k] * (bright - dark), 0.0)

    def cones_at(self, a, side, energies, parallel):
        """For each kind and half, the cone of light for the opposite direction, its sine and norm at ``a``, and its
        sampling probability.
        """
        kit, cones = self.kit, []
        detach = dr.detach if kit.jit else (lambda x: x)
        for number, own in enumerate(parallel):
            kind, half = divmod(number, 2)
            sine = clamp(a[self.axes[kind]], -1.0, 1.0)
            here, back = ((of * 4 + number) * CONE for of in (side, side ^ half))
            all_ = detach(kit.mean(energies[half]))
            share = dr.select(all_ > 0.0, ABOUT_CONES * detach(kit.mean(own)) / dr.maximum(all_, 1e-30), 0.0)
            cones.append((back, sine, self.cone_norm(here, sine), share))
        return cones

    def cone_norm(self, cone, sine):
        at = clamp(0.5 * (sine + 1.0), 0.0, 1.0) * (NORMS - 1.0)
        whole = dr.minimum(dr.floor(at), NORMS - 2.0)
        node = cone + 17 + self.kit.uint(whole)
        low, high = (self.kit.take(self.cones, node + i) for i in range(2))
        return low + (at - whole) * (high - low)

    def cone_density(self, cone, v):
        squared = dr.square(self.kit.take(self.cones, cone))
        t = squared + v * v
        return 0.5 * squared / (t * dr.sqrt(t))

    def cone_ends(self, cone, sine):
        squared = dr.square(self.kit.take(self.cones, cone))
        return [0.5 * v * dr.rsqrt(squared + v * v) for v in (sine - 1.0, sine + 1.0)]

    def some(self, s):
        any_ = s[0] > 0.0
        for k in range(1, self.kit.count):
            any_ = any_ | (s[k] > 0.0)
        return any_

    @staticmethod
    def corners(first, second):
        (i, x), (j, y) = first, second
        at = i * SIGMAS + j
        return [(at, (1.0 - x) * (1.0 - y)), (at + 1, (1.0 - x) * y), (at + SIGMAS, x * (1.0 - y)), (at + SIGMAS + 1, x * y)]

    def inter_yarn_eval(self, about, up, down, is_up, b):
        """f in direction ``b`` [1/sr]."""
        kit = self.kit
        side, corners, parallel, cones, place = about
        if place is not None:
            up, down = place[2]
        half = dr.select(is_up, kit.uint(0), kit.uint(1))
        terms, cos = polynomials(b), dr.abs(b[2])
        energy, f = dr.select(is_up, up, down), kit.zero_s()
        for k in range(kit.count):
            shape = 0.0
            for pair, weight in corners[k]:
                values = kit.packets(self.shape, ((side * 2 + half) * (SIGMAS * SIGMAS) + pair) * 4, 4)
                shape = shape + weight * sum(v * t for v, t in zip(values, terms))
            rest = energy[k]
            for i in range(0, len(parallel), 2):
                rest = rest - dr.select(is_up, parallel[i][k], parallel[i + 1][k])
            f[k] = rest * dr.maximum(shape * cos, 0.0)
        for i in range(0, len(parallel), 2):
            cone, sine, norm = (dr.select(is_up, x, y) for x, y in zip(cones[i][:3], cones[i + 1][:3]))
            other = clamp(b[self.axes[i // 2]], -1.0, 1.0)
            of = [kit.take(self.cones, cone + 1 + t) for t in range(16)]
            energy = dr.maximum(sum(c * t for c, t in zip(of, terms)), MIN_ENERGY * dr.maximum(dr.abs(of[0]), 1e-6))
            value = self.cone_density(cone, sine + other) * energy * cos / (norm * self.cone_norm(cone, other))
            f = f + dr.select(is_up, parallel[i], parallel[i + 1]) * value
        if place is not None:
            t = functions(b)
            for k in range(kit.count):
                f[k] = f[k] * dr.select(is_up, *(self.place_factors(place, half, k, t)[1] for half in range(2)))
        return f

    def inter_yarn_pdf(self, about, chances, is_up, b):
        """Sampling density [1/sr], given the probabilities that light leaves up and down."""
        _, _, parallel, cones, place = about
        cos, pdf, rest = dr.abs(b[2]), 0.0, 1.0
        for i in range(0, len(parallel), 2):
            cone, sine, _, share = (dr.select(is_up, x, y) for x, y in zip(cones[i], cones[i + 1]))
            other = clamp(b[self.axes[i // 2]], -1.0, 1.0)
            low, high = self.cone_ends(cone, sine)
            across = dr.sqrt(dr.maximum(1.0 - other * other, 1e-12))
            pdf = pdf + share * self.cone_density(cone, sine + other) / (high - low) * 0.5 * dr.minimum(cos / across, 1.0)
            rest = rest - share
        of_cosine = dr.minimum(cos, 1.0) * (1.0 / math.pi)
        if place is not None:
            x, y = (dr.select(is_up, *lean) for lean in zip(*place[3]))
            of_cosine = of_cosine * (1.0 + x * b[0] + y * b[1])
        return dr.select(is_up, *chances) * (pdf + rest * of_cosine)

    def inter_yarn_draw(self, about, is_up, up_sign, u):
        """Samples a direction of the light that leaves up, or down; ``up_sign`` is the sign of z for the former."""
        _, _, parallel, cones, place = about
        up = dr.select(is_up, up_sign, -up_sign)
        sin, cos = dr.sincos(TAU * u[2])
        radius = dr.sqrt(u[1])
        b = [radius * cos, radius * sin, up * dr.sqrt(dr.maximum(1.0 - u[1], 0.0))]
        remaining, found, rest = u[0], self.kit.bool(False), 1.0
        if place is not None:
            for i in range(0, len(parallel), 2):
                rest = rest - dr.select(is_up, cones[i][3], cones[i + 1][3])
            x, y = (dr.select(is_up, *lean) for lean in zip(*place[3]))
            # Of two opposite directions, each is drawn in proportion to its density.
            sign = dr.select(remaining - (1.0 - rest) < 0.5 * rest * (1.0 + x * b[0] + y * b[1]), 1.0, -1.0)
            b = [sign * b[0], sign * b[1], b[2]]
        for i in range(0, len(parallel), 2):
            cone, sine, _, share = (dr.select(is_up, x, y) for x, y in zip(cones[i], cones[i + 1]))
            here = self.kit.both(self.kit.no(found), remaining < share)
            remaining, found = remaining - share, found | here
            low, high = self.cone_ends(cone, sine)
            y = clamp(low + u[1] * (high - low), 1e-6 - 0.5, 0.5 - 1e-6)
            other = clamp(self.kit.take(self.cones, cone) * y * dr.rsqrt(0.25 - y * y) - sine, -1.0, 1.0)
            across = dr.sqrt(1.0 - other * other)
            turn = clamp(2.0 * u[2] - 1.0, -1.0, 1.0)
            w = [across * turn] * 2 + [up * across * dr.sqrt(dr.maximum(1.0 - turn * turn, 0.0))]
            w[self.axes[i // 2]] = other
            b = [dr.select(here, x, y) for x, y in zip(w, b)]
        return b
