"""Hairs of a cloth as a layer over each side, in Dr.Jit (``src/cloth/light/hair_layer.rs``)."""

import math

import drjit as dr
import numpy as np

from ._inter_yarn import SIGMAS, sigma_nodes
from ._kit import clamp

# src/cloth/light/hair_field.rs
LAYERS = 4
SHADOW, MIN_HEIGHT_COSINE = (0.371, 0.619), 0.2

TAU = 2.0 * math.pi
# src/cloth/light/hair_layer.rs
MIN_COSINE, MIN_ARRIVES = 1e-3, 1e-3


class Hairs:
    """The layer's tables on the device."""

    def __init__(self, kit, tensors):
        self.kit = kit
        area, scatter = tensors["hair_area"], tensors["hair_scatter"]
        self.cosines, self.azimuths = area.shape[2], scatter.shape[3]
        self.kinds = [k for k in range(2) if area[:, k].any()]
        self.area, self.scatter = kit.floats(area), kit.floats(scatter)
        field = [float(x) for x in tensors["hair_field"]]
        self.cover, self.means = kit.words(tensors["hair_cover"]), kit.floats(field[: 2 * LAYERS])
        # A side has the texels of all levels, down to one.
        self.of_side = len(tensors["hair_cover"]) // 2
        self.texels = round(math.sqrt((3 * self.of_side + 1) / 4))
        self.per_um = [field[8:10], field[10:12]]
        self.texel_um, self.heights, self.standing = field[12], field[13:15], field[15:17]
        # Energies scattered to the viewer's side and to the other side, by kind and cosine of the viewer.
        sums = scatter.sum(3, dtype=np.float64) * (TAU / (self.cosines * self.azimuths))
        halves = [sums[:, :, self.cosines :].sum(2), sums[:, :, : self.cosines].sum(2)]
        self.energy = kit.floats(np.stack(halves, 2).astype(np.float32))

    def part(self, x, parts):
        """Index of the part below ``x`` among equal parts whose values lie at their centers, and the weight of the next
        part.
        """
        x = clamp(x - 0.5, 0.0, parts - 1.0)
        at = dr.minimum(dr.floor(x), parts - 2.0)
        return self.kit.uint(at), x - at

    def depth(self, side, cosine):
        """Optical depth of the hairs on a side (0 for the face) along a line, by kind."""
        z = clamp(dr.abs(cosine), MIN_COSINE, 1.0)
        at, share = self.part(z * self.cosines, self.cosines)
        depths = []
        for k in self.kinds:
            low, high = (self.kit.take(self.area, (side * 2 + k) * self.cosines + at + i) for i in range(2))
            depths.append((low + share * (high - low)) / z)
        return depths

    def side_of(self, b):
        return dr.select(b[2] < 0.0, self.kit.uint(1), self.kit.uint(0))

    def passes(self, b):
        """Probability that light in direction ``b`` passes the hairs on the side on which it leaves."""
        return dr.exp(-sum(self.depth(self.side_of(b), b[2])))

    def here(self, at_um, footprint_um):
        """The hairs about a point of the even cloth, for a footprint (``HairsHere``)."""
        detach = dr.detach if self.kit.jit else (lambda x: x)
        place = [detach(row[0] * at_um[0] + row[1] * at_um[1]) for row in self.per_um]
        size = clamp(self.kit.float(detach(footprint_um)) * (0.5 / self.texel_um), 1.0, self.texels)
        return {"place": place, "level": dr.log2(size)}

    def covered(self, here, side, w, depth, is_shadow):
        """Part of a line of direction ``w`` that hairs of a side intercept at a point; its mean is ``1 - exp(-depth)``."""
        kit = self.kit
        standing = depth * dr.select(side == 0, *self.standing)
        probability, lying = 1.0 - dr.exp(-standing), dr.exp(standing - depth)
        means = [kit.take(self.means, side * LAYERS + i) for i in range(LAYERS)]
        above = sum(dr.select(mean < probability, kit.uint(1), kit.uint(0)) for mean in means)
        low = high = kit.float(0.0)
        for i in range(LAYERS + 1):
            low = dr.select(above == i, means[i - 1] if i > 0 else 0.0, low)
            high = dr.select(above == i, means[i] if i < LAYERS else 1.0, high)
        share = dr.select(high > low, (probability - low) / dr.select(high > low, high - low, 1.0), 1.0)
        cosine = dr.maximum(dr.abs(w[2]), MIN_HEIGHT_COSINE)
        way = dr.select(side == 0, *self.heights) / dr.select(w[2] < 0.0, -cosine, cosine)
        moved = [way * (row[0] * w[0] + row[1] * w[1]) for row in self.per_um]
        place = [p + m + (shift if is_shadow else 0.0) for p, m, shift in zip(here["place"], moved, SHADOW)]
        fine = dr.floor(here["level"])
        level = kit.uint(fine)
        values = [self.bilinear(side, place, dr.minimum(level + i, kit.uint(self.texels.bit_length() - 1)), above, share) for i in range(2)]
        return 1.0 - (1.0 - values[0] - (here["level"] - fine) * (values[1] - values[0])) * lying

    def bilinear(self, side, place, level, above, share):
        kit = self.kit
        size = kit.uint(self.texels) >> level
        squares = self.texels * self.texels - size * size
        first = side * self.of_side + (squares // 3) * 4
        corners = []
        for p in place:
            at = (p - dr.floor(p)) * kit.float(size) - 0.5
            whole, i = kit.floor(at)
            mask = kit.int(size) - 1
            corners.append((kit.uint(i & mask), kit.uint((i + 1) & mask), at - whole))
        (x0, x1, s), (y0, y1, t) = corners

        def value(x, y):
            texel = kit.take_word(self.cover, first + y * size + x)
            byte = lambda i: kit.float((texel >> (8 * dr.minimum(i, kit.uint(3)))) & 255)
            low = dr.select(above == 0, 0.0, byte(dr.maximum(above, kit.uint(1)) - 1))
            high = dr.select(above == LAYERS, 255.0, byte(above))
            return low + share * (high - low)

        rows = [value(x0, y) + s * (value(x1, y) - value(x0, y)) for y in (y0, y1)]
        return (rows[0] + t * (rows[1] - rows[0])) * (1.0 / 255.0)

    def seen(self, side, a, here):
        """Part of the light to a viewer in direction ``a`` that hairs of a side intercept, at a point or in the mean."""
        depth = sum(self.depth(side, a[2]))
        return 1.0 - dr.exp(-depth) if here is None else self.covered(here, side, a, depth, False)

    def free(self, at, b):
        """Part of the plies' light in direction ``b`` that passes the hairs there."""
        if at["here"] is None:
            return self.passes(b)
        side = self.side_of(b)
        return 1.0 - self.covered(at["here"], side, b, sum(self.depth(side, b[2])), True)

    def weights(self, sigma):
        """Weights of the absorption nodes, by channel."""
        all_ = []
        for k in range(self.kit.count):
            node, share = sigma_nodes(self.kit, sigma[k])
            all_.append([dr.select(node == i, 1.0 - share, dr.select(node + 1 == i, share, 0.0)) for i in range(SIGMAS)])
        return all_

    def spectrum(self, values, weights):
        out = self.kit.zero_s()
        for k, of in enumerate(weights):
            out[k] = sum(v * w for v, w in zip(values, of))
        return out

    def at(self, a, sigma, passing, here=None):
        """The hairs seen from ``a`` at a point or in the mean over the cell, with absorptions by kind; ``passing`` is the
        fraction of the beam that passes all plies.
        """
        kit = self.kit
        viewer = self.side_of(a)
        weights = [self.weights(sigma[k]) for k in range(2)]
        at, share = self.part(dr.abs(a[2]) * self.cosines, self.cosines)
        sides, out = [], []
        for behind, (side, arrives) in enumerate(((viewer, kit.float(1.0)), (1 - viewer, passing))):
            depth = self.depth(side, a[2])
            whole = sum(depth)
            hits = 1.0 - dr.exp(-whole)
            # The other layer counts only where light arrives.
            covered = dr.select(arrives > MIN_ARRIVES, self.seen(side, a, here), hits)
            arrives = arrives * dr.select(hits > 0.0, covered / dr.maximum(hits, 1e-30), 0.0)
            hit = arrives * hits / dr.maximum(whole, 1e-30)
            energies, sent = [], kit.zero_s()
            for k, own in zip(self.kinds, depth):
                halves = []
                for half in range(2):
                    low, high = (kit.packets(self.energy, ((k * self.cosines + at + i) * 2 + half) * 2, 2) for i in range(2))
                    halves.append(self.spectrum([x + share * (y - x) for x, y in zip(low, high)], weights[k]))
                energies.append(hit * own * (halves[0] + halves[1]))
                sent = sent + hit * own * halves[behind]
            sides.append({"side": side, "depth": depth, "arrives": arrives, "free": 1.0 - covered, "energy": energies})
            out.append(sent)
        return {"a": a, "here": here, "weights": weights, "sides": sides, "out": out, "passes_behind": sides[1]["free"]}

    def with_energies(self, classes, at):
        """Energies by class, with those that hairs scatter added to the last two classes of each kind."""
        classes, of_kind = list(classes), len(classes) // 2
        for n, kind in enumerate(self.kinds):
            for behind, side in enumerate(at["sides"]):
                classes[(kind + 1) * of_kind - 2 + behind] = side["energy"][n]
        return classes

    def eval(self, at, is_up, b):
        """f of the light that hairs scatter to their side of the cloth in direction ``b`` [1/sr]; ``is_up`` tells
        whether that is the viewer's side.
        """
        kit, a, sides = self.kit, at["a"], at["sides"]
        depth = [dr.select(is_up, x, y) for x, y in zip(*(side["depth"] for side in sides))]
        arrives = dr.select(is_up, *(side["arrives"] for side in sides))
        start = sum(depth)
        to = sum(self.depth(self.side_of(b), b[2]))
        both, off = start + to, start - to
        once = dr.select(both < 1e-6, start, start / dr.maximum(both, 1e-30) * (1.0 - dr.exp(-both)))
        near = dr.abs(off) < 1e-3
        through = dr.select(near, start * dr.exp(-0.5 * both), start * (dr.exp(-to) - dr.exp(-start)) / dr.select(near, 1.0, off))
        share = arrives * dr.select(is_up, once, through) / dr.maximum(start, 1e-30)
        lengths = dr.sqrt((a[0] * a[0] + a[1] * a[1]) * (b[0] * b[0] + b[1] * b[1]))
        cosine = clamp((a[0] * b[0] + a[1] * b[1]) / dr.maximum(lengths, 1e-12), -1.0, 1.0)
        azimuth = dr.select(lengths < 1e-12, 0.5 * math.pi, dr.acos(cosine))
        z = dr.select(is_up, dr.abs(b[2]), -dr.abs(b[2]))
        axes = [
            (*self.part(dr.abs(a[2]) * self.cosines, self.cosines), 2 * self.cosines * self.azimuths),
            (*self.part((z + 1.0) * self.cosines, 2 * self.cosines), self.azimuths),
            (*self.part(azimuth * (self.azimuths / math.pi), self.azimuths), 1),
        ]
        f = kit.zero_s()
        for k, own in zip(self.kinds, depth):
            corners = [(kit.uint(k * self.cosines * 2 * self.cosines * self.azimuths), 1.0)]
            for node, rest, step in axes:
                corners = [(at_ + (node + i) * step, w * (rest if i else 1.0 - rest)) for at_, w in corners for i in range(2)]
            sums = [0.0] * SIGMAS
            for node, w in corners:
                sums = [s + w * v for s, v in zip(sums, kit.packets(self.scatter, node * 2, 2))]
            f = f + own * self.spectrum(sums, at["weights"][k])
        return share * f

    @staticmethod
    def draw(up, u):
        """Samples a direction whose z has the sign ``up``."""
        z = clamp(u[0], MIN_COSINE, 1.0)
        sin, cos = dr.sincos(TAU * u[1])
        r = dr.sqrt(dr.maximum(1.0 - z * z, 0.0))
        return [r * cos, r * sin, up * z]
