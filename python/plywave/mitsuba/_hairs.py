"""Hairs of a cloth as a layer over each side, in Dr.Jit (``src/cloth/light/hair_layer.rs``)."""

import math

import drjit as dr
import numpy as np

from ._inter_yarn import SIGMAS, sigma_nodes
from ._kit import clamp

TAU = 2.0 * math.pi
# src/cloth/light/hair_layer.rs
MIN_COSINE = 1e-3


class Hairs:
    """The layer's tables on the device."""

    def __init__(self, kit, tensors):
        self.kit = kit
        area, scatter = tensors["hair_area"], tensors["hair_scatter"]
        self.cosines, self.azimuths = area.shape[2], scatter.shape[3]
        self.kinds = [k for k in range(2) if area[:, k].any()]
        self.area, self.scatter = kit.floats(area), kit.floats(scatter)
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

    def at(self, a, sigma, passing):
        """The hairs seen from ``a``, with absorptions by kind; ``passing`` is the fraction of the beam that passes all
        plies.
        """
        kit = self.kit
        viewer = self.side_of(a)
        weights = [self.weights(sigma[k]) for k in range(2)]
        at, share = self.part(dr.abs(a[2]) * self.cosines, self.cosines)
        sides, out = [], []
        for behind, (side, arrives) in enumerate(((viewer, kit.float(1.0)), (1 - viewer, passing))):
            depth = self.depth(side, a[2])
            whole = sum(depth)
            hit = arrives * (1.0 - dr.exp(-whole)) / dr.maximum(whole, 1e-30)
            energies, sent = [], kit.zero_s()
            for k, own in zip(self.kinds, depth):
                halves = []
                for half in range(2):
                    low, high = (kit.packets(self.energy, ((k * self.cosines + at + i) * 2 + half) * 2, 2) for i in range(2))
                    halves.append(self.spectrum([x + share * (y - x) for x, y in zip(low, high)], weights[k]))
                energies.append(hit * own * (halves[0] + halves[1]))
                sent = sent + hit * own * halves[behind]
            sides.append({"side": side, "depth": depth, "arrives": arrives, "energy": energies})
            out.append(sent)
        return {"a": a, "weights": weights, "sides": sides, "out": out, "passes_behind": dr.exp(-sum(sides[1]["depth"]))}

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
