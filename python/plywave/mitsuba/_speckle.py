"""Speckle in Dr.Jit (Yu 2025, 6.2): factors of mean 1 on f_refl and f_high, the power of a field of sources on the fibers of a ply.

The tables are those of the library's ``NoiseField``, the formulas those of ``src/ply/speckle/field.rs``; so are the hashes, to the bit. Gradients do not flow through it.
"""

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from ._kit import Words, clamp, detached

# src/ply/speckle/field.rs
SEAM_RAD, CELLS, ACROSS, LEAST, SPREAD, STEPS, TABLE = 0.15, 16, 0.58, 0.02, 0x9E3779B9, (0xC13FA9A9, 0x91E10DA5), 512
SIZE, ALONG, REFL, HIGH = range(4)
NUMBERS = "count ring w0 lam share_refl share_high fade_refl slope_refl fade_high slope_high seed has".split()


class Speckle(Words):
    """Noise of one or several models on the device."""

    def __init__(self, kit, noise):
        """Loads ``noise``: for each model a dictionary of its numbers and tables (python/src/tensors.rs), or ``None``."""
        self.kit = kit
        self.some = any(n is not None for n in noise)
        if not self.some:
            return
        rows = [[1.0] * 10 + [0, 0.0] if n is None else [*map(float, n["numbers"]), int(n["seed"]), 1.0] for n in noise]
        none = np.zeros((4, TABLE), np.float32)
        self.tables = kit.floats(np.concatenate([none if n is None else n["tables"] for n in noise]))
        columns = dict(zip(NUMBERS, zip(*rows)))
        self.head = {name: values[0] if len(set(values)) == 1 else self._table(name, values) for name, values in columns.items()}

    def _table(self, name, values):
        return self.kit.words(values) if name == "seed" else self.kit.floats(values)

    def number(self, name, model):
        """A number of a model: a constant if all models have the same number."""
        value = self.head[name]
        if isinstance(value, (int, float)):
            return value
        return self.kit.take_word(value, model) if name == "seed" else self.kit.take(value, model)

    def entry(self, model, table, index):
        return self.kit.take(self.tables, (model * 4 + table) * TABLE + index)

    def row(self, model, azimuth, h_um):
        """Number of fibers around the ply between the viewer and the fiber visible at an offset (``FibersAround::row``)."""
        x = clamp(h_um / self.number("ring", model), -1.0, 1.0)
        asin = dr.atan2(x, dr.sqrt(dr.maximum(1.0 - x * x, 0.0)))
        return self.number("count", model) * (0.5 / math.pi) * (azimuth - asin)

    def blur(self, model, footprint_um, h_um):
        """Contrast of each kind that remains under a footprint."""
        footprint_um = dr.maximum(footprint_um, 0.0)
        along = 0.29 * footprint_um / self.number("w0", model)
        rows = self.row(model, 0.0, h_um - 0.5 * footprint_um) - self.row(model, 0.0, h_um + 0.5 * footprint_um)
        a, b = along * along, (0.29 / ACROSS * rows) ** 2
        field = 1.0 / dr.sqrt((1.0 + 2.0 * a) * (1.0 + 2.0 * b))
        square = 1.0 / dr.sqrt((1.0 + 4.0 * a) * (1.0 + 4.0 * b))
        out = []
        for kind in ("refl", "high"):
            share = self.number(f"share_{kind}", model)
            left = dr.sqrt((2.0 * (1.0 - share) * field + share * square) / (2.0 - share))
            left = dr.maximum((left - LEAST) / (1.0 - LEAST), 0.0)
            out.append(dr.select(footprint_um > 0.0, left, 1.0))
        return out

    def at(self, model, ply, azimuth, along_um, footprint_um, h_um):
        """The patterns at a position: for the two fibers the hash, the lowest cell, the position relative to the middle
        cell, the scale of the weights and the first quantiles of positions; the number of their sources; and the
        contrast.
        """
        kit = self.kit
        azimuth, along_um, footprint_um, h_um = map(detached, (azimuth, along_um, footprint_um, h_um))
        count = self.number("count", model)
        row = self.row(model, azimuth, h_um) - 0.5
        first = dr.floor(row)
        t = dr.select(count < 1.5, 0.0, clamp(2.0 * (row - first) - 0.5, 0.0, 1.0))
        first, t = dr.select(t >= 1.0, first + 1.0, first), dr.select(t >= 1.0, 0.0, t)
        turn = 0.5 * math.pi * t * t * (3.0 - 2.0 * t)
        of_ply = self.mix(self.word(ply) ^ self.word(self.number("seed", model)))
        fibers = []
        for i, share in enumerate((dr.cos(turn), dr.sin(turn))):
            number = first + float(i)
            number = number - count * dr.floor(number / count)
            # Rounding may produce the total number of fibers, which wraps to 0.
            number = dr.select(number >= count, 0.0, number)
            key = self.mix(self.plus(of_ply, self.times(self.word(number), SPREAD)))
            cell = 0.25 * CELLS / self.number("w0", model) * along_um + 2.0**-24 * kit.float(key >> 8)
            whole = dr.floor(cell)
            past = clamp(cell - whole, 0.0, 1.0)
            sum_ = 0.0
            for s in range(CELLS):
                w = self.window(float(s), past)
                sum_ = sum_ + w * w
            lowest = self.word(kit.int(whole) - (CELLS // 2 - 1))
            shifts = [self.mix(self.plus(key, k)) for k in (1, 2, 3)]
            fibers.append([key, lowest, past, dr.abs(share) / dr.sqrt(sum_), *shifts])
        return fibers, kit.uint(dr.select(t > 0.0, 2 * CELLS, CELLS)), self.blur(model, footprint_um, h_um)

    def window(self, s, past):
        d = (s - (CELLS // 2 - 1) - past) * (2.0 / CELLS)
        open_ = 1.0 - d * d
        return open_ * open_ * open_

    def source(self, model, fibers, s):
        """Weight and position along the fiber of a source; for each kind its size, phase [half turns] and position
        across.
        """
        kit = self.kit
        is_second = s >= CELLS
        key, lowest, past, scale, *shifts = (dr.select(is_second, b, a) for a, b in zip(*fibers))
        within = s & (CELLS - 1)
        weight = scale * self.window(kit.float(within), past)
        cell = self.plus(lowest, within)
        word = self.mix(key ^ self.times(cell, SPREAD))
        position = lambda table, k, step: self.position(model, table, self.plus(shifts[k], self.times(cell, step)))
        kinds = []
        for k, kind in enumerate((REFL, HIGH)):
            own = word >> (16 * k)
            kinds.append((self.entry(model, SIZE, own & (TABLE - 1)), kit.float(own >> 9 & 127) * (1.0 / 64.0), position(kind, k, STEPS[0])))
        return weight, position(ALONG, 2, STEPS[1]), kinds

    def position(self, model, table, quantile):
        """Entry of a table of unsigned positions at a quantile of 32 bits."""
        is_above = quantile >= 1 << 31
        x = self.entry(model, table, dr.select(is_above, quantile, self.word(0xFFFFFFFF) - quantile) >> 22 & (TABLE - 1))
        return dr.select(is_above, x, -x)

    def waves(self, model, fibers, count, points, per, which, wanted):
        """The field of each kind and wavelength at u, or at u on the other side of the seam, where it is wanted; for the
        latter also the correlation of both sides.
        """
        kit = self.kit
        zero = lambda: [[kit.float(0.0) for _ in range(kit.count)] for _ in points]

        def add(s, re, im, both):
            weight, along, kinds = self.source(model, fibers, s)
            re, im, both = ([list(row) for row in x] for x in (re, im, both))
            for i, ((size, phase, across), (u, other, v, _)) in enumerate(zip(kinds, points)):
                for k in range(kit.count):
                    sin, cos = dr.sincos(math.pi * self.part(phase + per[k] * (across * (other if which else u) + along * v)))
                    re[i][k] += weight * size * cos
                    im[i][k] += weight * size * sin
                    if which:
                        both[i][k] += weight * weight * dr.cos(math.pi * self.part(per[k] * across * (u - other)))
            return s + 1, re, im, both

        state = (kit.uint(0), zero(), zero(), zero())
        return kit.loop(state, lambda s, *_: kit.both(s < count, wanted), add, "speckle")[1:]

    def part(self, half_turns):
        """Half turns without whole turns: sine and cosine of large numbers are slow and inexact."""
        return half_turns - 2.0 * dr.round(0.5 * half_turns)

    def factors(self, model, place, sin_i, w, lam):
        """Factors of f_refl and f_high by wavelength, in direction ``w`` of the ply's frame."""
        kit, (fibers, count, blur) = self.kit, place
        sin_i, w, lam = detached(sin_i), detached(w), [detached(lam[k]) for k in range(kit.count)]
        x, y, z = w
        alpha = dr.atan2(-x, y)
        beta = alpha - dr.select(alpha < 0.0, -math.pi, math.pi)
        v = z + sin_i
        points = []
        for azimuth, cos, along in ((alpha, dr.sqrt(dr.maximum(1.0 - 0.25 * v * v, 0.0)), v), (beta, dr.sqrt(dr.minimum(x * x + y * y, 1.0)), z)):
            beyond = azimuth - dr.select(azimuth < 0.0, -2.0 * math.pi, 2.0 * math.pi)
            t = clamp((dr.abs(azimuth) - (math.pi - SEAM_RAD)) * (1.0 / SEAM_RAD), 0.0, 1.0)
            points.append((azimuth * cos, beyond * cos, along, t * t * (3.0 - 2.0 * t)))
        own = self.number("lam", model)
        lam = [own * clamp(lam[k] / own, 0.1, 10.0) for k in range(kit.count)]
        per = [2.0 / l for l in lam]
        has = self.number("has", model) > 0.5
        visible = kit.both(kit.bool(has), (blur[0] > 0.0) | (blur[1] > 0.0))
        re, im, _ = self.waves(model, fibers, count, points, per, False, visible)
        at_seam = (points[0][3] > 0.0) | (points[1][3] > 0.0)
        over_re, over_im, both = self.waves(model, fibers, count, points, per, True, kit.both(visible, at_seam))
        out = []
        for i, kind in enumerate(("refl", "high")):
            share, factor = self.number(f"share_{kind}", model), kit.zero_s()
            turn = 0.25 * math.pi * points[i][3]
            a, b = dr.cos(turn), dr.sin(turn)
            for k in range(kit.count):
                scale = dr.sqrt(share) / dr.sqrt(dr.maximum(1.0 + 2.0 * a * b * both[i][k], 1e-3))
                real = dr.sqrt(1.0 - share) + scale * (a * re[i][k] + b * over_re[i][k])
                imaginary = scale * (a * im[i][k] + b * over_im[i][k])
                fade = blur[i] * clamp(self.number(f"slope_{kind}", model) * lam[k] + self.number(f"fade_{kind}", model), 0.0, 1.0)
                factor[k] = dr.select(visible, 1.0 + fade * (real * real + imaginary * imaginary - 1.0), 1.0)
            out.append(factor)
        return out
