"""Relief in Dr.Jit: the visibility of single fibers on a ply's surface, as factors of mean 1 on f_refl and f_high
(``src/ply/relief.rs``).
"""

import math

import drjit as dr
import numpy as np

from ._kit import clamp
from ._speckle import GAMMA, Words

# src/ply/relief.rs
JITTER, HIGH, ENDS, WIDEST, LEAST = 0.35, 0.3, 7.0**0.5, 1.5, 0.02
COUNT, RING, FREE, FIBER, WIDTH = range(5)


class Relief:
    """The fibers on the surface of a cloth's plies. The tables are those of ``Curves``."""

    def __init__(self, kit, tensors):
        self.kit, self.words = kit, Words(kit.jit)
        rows = np.asarray(tensors["relief"], np.float64)
        self.some = bool((rows[:, COUNT] > 0.0).any())
        self.rows = [[float(x) for x in row] for row in rows]

    def number(self, which, kind):
        """A number of the plies of a kind."""
        first, last = self.rows[0][which], self.rows[-1][which]
        return first if first == last else dr.select(kind == 0, first, last)

    def factors(self, kind, place, h_um, w):
        """Factors of f_refl and f_high in direction ``w`` of the ply's frame."""
        s = dr.sqrt(w[0] * w[0] + w[1] * w[1])
        cos = dr.select(s > 0.0, clamp(w[1] / dr.maximum(s, 1e-30), -1.0, 1.0), 1.0)
        sine = dr.sqrt(dr.maximum(0.5 - 0.5 * cos, 0.0))
        sine = dr.select(w[0] < 0.0, -sine, sine)
        fiber = self.number(FIBER, kind)
        return [self.factor(kind, place, h_um - part * fiber * sine, which) for which, part in ((0, 1.0), (1, 0.5))]

    def factor(self, kind, place, x_um, which):
        kit, words = self.kit, self.words
        ply, azimuth, _, footprint = place
        count, ring, own = (self.number(which, kind) for which in (COUNT, RING, WIDTH + which))
        has = count > 0.0
        apart = 2.0 * math.pi / dr.maximum(count, 1.0)
        wide = ENDS * 0.29 * dr.maximum(footprint, 0.0)
        wide = dr.sqrt(own * own + wide * wide)
        most = WIDEST * apart * ring
        contrast = dr.select(wide > most, most / dr.maximum(wide, 1e-30), 1.0)
        width = dr.maximum(dr.minimum(wide, most), 1e-6)
        x = clamp(x_um, -ring, ring)
        asin = lambda x: dr.safe_asin(clamp(x / dr.maximum(ring, 1e-6), -1.0, 1.0)) if kit.jit else math.asin(clamp(x / max(ring, 1e-6), -1.0, 1.0))
        low, high = azimuth - asin(x + width), azimuth - asin(x - width)
        first = dr.ceil(low / apart - 0.5 - JITTER)
        last = dr.floor(high / apart - 0.5 + JITTER)
        last = dr.minimum(last, first + count - 1.0)
        ply = words.of(ply) << 32
        free = self.number(FREE, kind)
        low_bits = lambda bits: kit.float(kit.UInt(bits & words.of(0xFFFFFF))) if kit.jit else float(bits & 0xFFFFFF)

        def add(cell, sum_):
            whole = cell - count * dr.floor(cell / dr.maximum(count, 1.0))
            number = words.of(kit.UInt(whole)) if kit.jit else int(whole)
            bits = words.mix(words.times(ply | number, GAMMA) ^ words.of(which))
            jitter = JITTER * (2.0 * 2.0**-24 * low_bits(bits) - 1.0)
            u = 2.0**-24 * low_bits(bits >> 40)
            weight = dr.select(u < free, 1.0 / free, 0.0) if which == 0 else 1.0 + HIGH * (2.0 * u - 1.0)
            phi = (cell + 0.5 + jitter) * apart - azimuth
            t = (x + ring * dr.sin(phi)) / width
            bump = dr.maximum(1.0 - t * t, 0.0)
            inside = kit.both(dr.abs(phi) < 0.5 * math.pi, dr.cos(phi) > 0.0)
            return cell + 1.0, sum_ + dr.select(inside, weight * dr.cos(phi) * bump * bump, 0.0)

        _, sum_ = kit.loop((kit.float(first), kit.float(0.0)), lambda cell, _: kit.both(cell <= last, has), add, "relief")

        def upto(t):
            t = clamp(t, -1.0, 1.0)
            return t * (1.0 - t * t * (2.0 / 3.0 - 0.2 * t * t))

        integral = upto((ring - x) / width) + upto((ring + x) / width)
        m = apart * ring * sum_ / (width * dr.maximum(integral, 0.1))
        return dr.select(kit.both(has, contrast > LEAST), 1.0 + contrast * (m - 1.0), 1.0)
