"""Relief in Dr.Jit: the visibility of single fibers on a ply's surface, as factors of mean 1 on f_refl and f_high
(``src/ply/relief.rs``).
"""

import math

import drjit as dr
import numpy as np

from ._kit import Words, clamp

# src/ply/relief.rs
JITTER, HIGH, ENDS, WIDEST, LEAST, GOLDEN = 0.35, 0.3, 7.0**0.5, 1.5, 0.02, 0x9E3779B9
COUNT, RING, FREE, FIBER, WIDTH = range(5)


class Relief(Words):
    """The fibers on the surface of a cloth's plies. The tables are those of ``Curves``."""

    def __init__(self, kit, tensors):
        self.kit = kit
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
        kit = self.kit
        ply, azimuth, _, footprint = place
        count, ring, free, fiber = (self.number(which, kind) for which in (COUNT, RING, FREE, FIBER))
        has = count > 0.0
        around = dr.maximum(count, 1.0)
        apart = 2.0 * math.pi / around
        blur = ENDS * 0.29 * dr.maximum(footprint, 0.0)
        most = WIDEST * apart * ring
        widths, contrasts, offsets = [], [], []
        for which, part in ((0, 1.0), (1, 0.5)):
            own = self.number(WIDTH + which, kind)
            wide = dr.sqrt(own * own + blur * blur)
            contrasts.append(dr.select(wide > most, most / dr.maximum(wide, 1e-30), 1.0))
            widths.append(dr.maximum(dr.minimum(wide, most), 1e-6))
            offsets.append(clamp(h_um - part * fiber * sine, -ring, ring))
        sine = lambda end: clamp(end / dr.maximum(ring, 1e-6), -1.0, 1.0)
        asin = lambda x: dr.atan2(x, dr.sqrt(1.0 - x * x))
        row = lambda end: (azimuth - asin(sine(end))) / apart - 0.5
        first = dr.ceil(row(dr.maximum(*(x + width for x, width in zip(offsets, widths)))) - JITTER)
        last = dr.floor(row(dr.minimum(*(x - width for x, width in zip(offsets, widths)))) + JITTER)
        last = dr.minimum(last, first + count - 1.0)
        key = self.mix(self.word(ply))
        low = azimuth / math.pi

        def add(cell, *sums):
            number = self.word(cell - count * dr.floor(cell / around))
            bits = self.mix(self.plus(key, self.times(number, GOLDEN)))
            unit = lambda shift, count: kit.float(kit.int((bits >> shift) & ((1 << count) - 1))) + 0.5
            jitter = JITTER * (unit(22, 10) * 2.0**-9 - 1.0)
            half_turns = 2.0 / around * (cell + 0.5 + jitter) - low
            sin, cos = dr.sincos(math.pi * half_turns)
            cos = dr.select(dr.abs(half_turns) < 0.5, cos, 0.0)
            weights = dr.select(unit(11, 11) * 2.0**-11 < free, 1.0 / free, 0.0), 1.0 + HIGH * (unit(0, 11) * 2.0**-10 - 1.0)
            out = []
            for sum_, weight, x, width in zip(sums, weights, offsets, widths):
                t = (x + ring * sin) / width
                bump = dr.maximum(1.0 - t * t, 0.0)
                out.append(sum_ + weight * cos * bump * bump)
            return (cell + 1.0, *out)

        state = (kit.float(first), kit.float(0.0), kit.float(0.0))
        _, *sums = kit.loop(state, lambda cell, *_: kit.both(cell <= last, has), add, "relief")

        def upto(t):
            t = clamp(t, -1.0, 1.0)
            return t * (1.0 - t * t * (2.0 / 3.0 - 0.2 * t * t))

        factors = []
        for sum_, contrast, x, width in zip(sums, contrasts, offsets, widths):
            integral = upto((ring - x) / width) + upto((ring + x) / width)
            m = apart * ring * sum_ / (width * dr.maximum(integral, 0.1))
            factors.append(dr.select(kit.both(has, contrast > LEAST), 1.0 + contrast * (m - 1.0), 1.0))
        return factors

