"""Speckle in Dr.Jit (Yu 2025, 6.2): factors of mean 1 on f_refl and f_high, of tiles of noise that every stretch of a ply has placed elsewhere.

The tiles are those that the library makes of a model's noise; the formulas those of ``src/speckle/lookup.rs`` and ``tiles.rs``, the hash in 64-bit arithmetic too.
"""

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from ._kit import clamp

GAMMA, MASK = 0x9E3779B97F4A7C15, (1 << 64) - 1
# src/speckle/tiles.rs
SEAM_RAD = 0.15


class Words:
    """64-bit words of a variant: arrays of Dr.Jit, or Python's numbers."""

    def __init__(self, jit):
        self.jit = jit

    def of(self, x):
        return mi.UInt64(x) if self.jit else int(x) & MASK

    def times(self, x, factor):
        return x * self.of(factor) if self.jit else (x * factor) & MASK

    def plus(self, x, y):
        return x + y if self.jit else (x + y) & MASK

    def mix(self, x):
        """The finalizer of SplitMix64 (src/math/hash.rs)."""
        x = self.times(x ^ (x >> 30), 0xBF58476D1CE4E5B9)
        x = self.times(x ^ (x >> 27), 0x94D049BB133111EB)
        return x ^ (x >> 31)


def instance(kit, ply, along, h_um, grain_um):
    """The patterns of a place on a ply, by its number and the place along and across it [um] (``Instance::new``)."""
    words = Words(kit.jit)
    # In doubles rounded to singles at each step, as the library's singles are: a product with the reciprocal,
    # or one step for two, would end grains elsewhere.
    double, single = (mi.Float64, lambda x: mi.Float64(kit.Float(x))) if kit.jit else (float, lambda x: float(np.float32(x)))
    grain_um = double(np.float32(grain_um).item())

    def whole(um, shift):
        cell = dr.floor(single(single(double(um) / grain_um) + shift))
        return words.of(kit.UInt(mi.Int32(cell)) if kit.jit else int(cell) & 0xFFFFFFFF)

    ply = kit.UInt(ply) if kit.jit else int(ply) & 0xFFFFFFFF
    row = words.mix((words.of(ply) << 32) | whole(h_um, 0.5))
    shift = (double(kit.UInt(row >> 44)) if kit.jit else float(row >> 44)) * 2.0**-20
    return words.mix(words.plus(row ^ words.of(GAMMA), whole(along, shift)))


class Speckle:
    """Tiles of one or several models on the device."""

    def __init__(self, kit, noise):
        """``noise``: of each model a dictionary of its tiles (python/src/tensors.rs), or none."""
        self.kit, self.words = kit, Words(kit.jit)
        self.some = any(n is not None for n in noise)
        if not self.some:
            return
        codes, scales, heads, at = [], [], [], 0
        for n in noise:
            if n is None:
                # A tile of one node, whose value is not used.
                heads.append([0.0, 0, 0, 0, 1, *[1.0] * 4, *[0.0] * 4, 1.0, 1])
                continue
            tiles = n["tiles"]
            _, count, rows, columns = tiles.shape
            step, fade = np.asarray(n["step"], np.float64), np.asarray(n["fade"], np.float64)
            lam = float(np.float32(n["lambda_um"]))
            per = 1.0 / step.astype(np.float32)
            fade = [np.float32(fade[kind][0]) if i == 0 else np.float32(fade[kind][1]) * np.float32(lam) for kind in range(2) for i in range(2)]
            heads.append([1.0, at, sum(map(len, scales)) // 2, count - 1, rows, *per.ravel(), *fade, 1.0 / lam, columns])
            codes.append(tiles.ravel())
            scales.append(np.asarray(n["code"], np.float32).ravel())
            at += tiles.size
        self.codes = kit.words(np.pad(np.concatenate(codes), (0, -at % 4)).view("<u4"))
        self.scales = kit.floats(np.concatenate(scales))
        columns = list(zip(*heads))
        names = "has first scale mask rows v_refl u_refl v_high u_high fade_refl slope_refl fade_high slope_high per_lambda columns".split()
        self.whole = {"first", "scale", "mask", "rows", "columns"}
        self.head = {name: values[0] if len(set(values)) == 1 else self._table(name, values) for name, values in zip(names, columns)}

    def _table(self, name, values):
        return self.kit.words(values) if name in self.whole else self.kit.floats(values)

    def number(self, name, model):
        """A number of a model: a constant where all have the same."""
        value = self.head[name]
        if isinstance(value, (int, float, np.floating)):
            return int(value) if name in self.whole else float(value)
        return self.kit.take_word(value, model) if name in self.whole else self.kit.take(value, model)

    def unit(self, bits, sides):
        """A place on a tile, of 20 bits."""
        low = bits & self.words.of(0xFFFFF)
        kit = self.kit
        return kit.float(kit.UInt(low) if kit.jit else low) * (1.0 / (1 << 20)) * (kit.float(sides) if kit.jit else float(sides))

    def node(self, first, columns, scale, row, column):
        kit = self.kit
        at = first + row * columns + column
        code = (kit.take_word(self.codes, at >> 2) >> ((at & 3) * 8)) & 255
        root = scale[0] + scale[1] * kit.float(code)
        return root * root

    def value(self, tile, v, u):
        """N at a place, bilinear."""
        kit, (first, rows, columns, scale) = self.kit, tile
        (fv, row), (fu, column) = kit.floor(v), kit.floor(u)
        v, u = v - fv, u - fu
        word = (lambda x: kit.UInt(x)) if kit.jit else (lambda x: int(x) & 0xFFFFFFFF)
        row, column = word(row) & (rows - 1), word(column) & (columns - 1)
        below, right = (row + 1) & (rows - 1), (column + 1) & (columns - 1)
        a, b, c, d = (self.node(first, columns, scale, r, q) for r in (row, below) for q in (column, right))
        top, bottom = a + u * (b - a), c + u * (d - c)
        return top + v * (bottom - top)

    def factors(self, model, instance, sin_i, w, lam):
        """Factors of f_refl and f_high by wavelength, in direction ``w`` of the ply's frame."""
        kit, words = self.kit, self.words
        x, y, z = w
        alpha = dr.atan2(-x, y)
        beta = alpha - dr.select(alpha < 0.0, -math.pi, math.pi)
        v = z + sin_i
        places = [(alpha, dr.sqrt(dr.maximum(1.0 - 0.25 * v * v, 0.0)), v), (beta, dr.sqrt(x * x + y * y), z)]
        rows, columns = self.number("rows", model), self.number("columns", model)
        has, out = self.number("has", model) > 0.5, []
        for kind, (name, (azimuth, cos, along)) in enumerate(zip(("refl", "high"), places)):
            bits = words.mix(instance ^ words.of(((kind + 1) * GAMMA) & MASK))
            low = lambda x: kit.UInt(x & words.of(0xFFFFFFFF)) if kit.jit else int(x) & 0xFFFFFFFF
            mask = self.number("mask", model)
            index = kind * (mask + 1) + (low(bits >> 42) & mask)
            first = self.number("first", model) + index * (rows * columns)
            at = (self.number("scale", model) + index) * 2
            tile = (first, rows, columns, [kit.take(self.scales, at), kit.take(self.scales, at + 1)])
            offset = [self.unit(bits, rows), self.unit(bits >> 20, columns)]
            mirror = [dr.select((low(bits >> s) & 1) == 1, -1.0, 1.0) for s in (62, 63)]
            per = [m * self.number(f"{axis}_{name}", model) for m, axis in zip(mirror, "vu")]
            # On the other side of the seam, and its share.
            beyond = azimuth - dr.select(azimuth < 0.0, -2.0 * math.pi, 2.0 * math.pi)
            t = clamp((dr.abs(azimuth) - (math.pi - SEAM_RAD)) * (1.0 / SEAM_RAD), 0.0, 1.0)
            share, factor = t * t * (1.5 - t), kit.zero_s()
            for k in range(kit.count):
                ratio = clamp(lam[k] * self.number("per_lambda", model), 0.1, 10.0)
                per_v, per_u = per[0] / ratio, per[1] / ratio
                at_v = along * per_v + offset[0]
                n = self.value(tile, at_v, azimuth * cos * per_u + offset[1])
                n = n + share * (self.value(tile, at_v, beyond * cos * per_u + offset[1]) - n)
                fade = clamp(self.number(f"slope_{name}", model) * ratio + self.number(f"fade_{name}", model), 0.0, 1.0)
                factor[k] = dr.select(has, 1.0 + fade * (n - 1.0), 1.0)
            out.append(factor)
        return out
