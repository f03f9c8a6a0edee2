"""Unevenness of yarns in Dr.Jit, with the formulas of ``src/cloth/geometry/uneven.rs``."""

import drjit as dr
import numpy as np

from ._kit import Words

#: Scale at which deviates have variance 1.
PER_DEVIATION = 6.0**0.5


class Uneven(Words):
    """The uneven kinds of yarns of a cloth."""

    def __init__(self, kit, tensors):
        self.kit = kit
        rows = np.asarray(tensors["uneven"], np.float64)
        self.kinds = [([float(x) for x in row], int(seed)) for row, seed in zip(rows, tensors["uneven_seed"])]

    def place(self, at):
        """The position on the even cloth that appears at a point."""
        to = list(at)
        for (a, b, pitch, start, length, width, place), seed in self.kinds:
            u, along = (at[0] * a + at[1] * b - start) / pitch, (at[1] * a - at[0] * b) / length
            off = lambda u: self.off(seed, u, along, width, place)
            by = pitch * off(u - off(u))
            to = [to[0] - by * a, to[1] - by * b]
        return to

    def off(self, seed, u, along, width, place):
        whole, yarn = self.kit.floor(u)
        t = u - whole
        s = 1.0 - t
        (low, rise), (high, fall) = (self.values(seed, yarn + k, along, width, place) for k in (0, 1))
        return low + t * t * (3.0 - 2.0 * t) * (high - low) + t * s * (s * rise - t * fall)

    def values(self, seed, yarn, along, width, place):
        kit = self.kit
        row = self.mix(self.word(yarn) ^ seed)
        x = along + kit.float(row) * 2.0**-32
        whole, stretch = kit.floor(x)
        t = x - whole
        a, b = (self.deviates(self.mix(row ^ self.word(stretch + k))) for k in (0, 1))
        s = t * t * (3.0 - 2.0 * t)
        per = dr.rsqrt(s * s + (1.0 - s) * (1.0 - s))
        off, wide = (per * ((1.0 - s) * a[k] + s * b[k]) for k in (0, 1))
        return place * off, width * wide

    def deviates(self, word):
        part = lambda shift: self.kit.float((word >> shift) & 0xFF) * (1.0 / 255.0)
        return [PER_DEVIATION * (part(shift) + part(shift + 8) - 1.0) for shift in (0, 16)]
