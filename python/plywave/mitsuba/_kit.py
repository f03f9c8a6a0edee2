"""Types of the current Mitsuba variant, reads of flat tables, and loops, which all models use.

The code of this package is written once for all variants. In JIT variants numbers are Dr.Jit arrays and tables are
arrays on the device; in scalar variants numbers are Python's and tables are NumPy's.
"""

import drjit as dr
import mitsuba as mi
import numpy as np


class Kit:
    """Types and helpers of one variant."""

    def __init__(self):
        variant = mi.variant()
        if "polarized" in variant:
            raise ValueError(f"variant {variant}: plywave's models carry no polarization: use a variant without it")
        self.variant = variant
        self.jit = not variant.startswith("scalar")
        self.spectral = "spectral" in variant
        self.Float, self.UInt, self.Int, self.Bool = mi.Float, mi.UInt32, mi.Int32, mi.Bool
        self.Vector3f, self.Point2f, self.S = mi.Vector3f, mi.Point2f, mi.UnpolarizedSpectrum
        self.Four = mi.Vector4f
        self.Two = mi.Vector2u
        #: Number of absorptions evaluated at once: channels or wavelengths.
        self.count = len(self.S(0.0))

    def floats(self, values):
        """A table in single precision."""
        values = np.ascontiguousarray(values, np.float32).ravel()
        return self.Float(_aligned(values)) if self.jit else values

    def words(self, values):
        """A table of 32-bit words."""
        values = np.ascontiguousarray(values, np.uint32).ravel()
        return self.UInt(_aligned(values)) if self.jit else values

    def parameter(self, values):
        """Numbers that ``mi.traverse`` shows. In scalar variants they are Dr.Jit's array, as the vertices of Mitsuba's meshes are: Mitsuba takes neither NumPy's arrays nor Python's
        numbers."""
        if self.jit:
            return self.floats(values) if np.ndim(values) else self.Float(values)
        return dr.scalar.ArrayXf(self.floats(values))

    def table_of(self, parameter):
        """A parameter converted to a table."""
        return parameter if self.jit else np.array(parameter, np.float32)

    def number_of(self, parameter):
        """Value of a parameter that has one number."""
        return parameter if self.jit else float(parameter[0])

    def take(self, table, index):
        """Reads one number of a table."""
        if self.jit:
            return dr.gather(self.Float, table, index)
        return float(table[int(index)])

    def take_word(self, table, index):
        if self.jit:
            return dr.gather(self.UInt, table, index)
        return int(table[int(index)])

    def packets(self, table, index, count):
        """Reads ``4 count`` numbers, starting at the packet of four with this index."""
        if self.jit:
            return [x for i in range(count) for x in dr.gather(self.Four, table, index + i)]
        at = 4 * int(index)
        return [float(x) for x in table[at : at + 4 * count]]

    def word_pair(self, table, index):
        """Reads two words, starting at the pair with this index."""
        if self.jit:
            return list(dr.gather(self.Two, table, index))
        return [int(x) for x in table[2 * int(index) : 2 * int(index) + 2]]

    def uint(self, x):
        """Converts a number without fractional part to an index."""
        return self.UInt(x) if self.jit else int(x)

    def int(self, x):
        return self.Int(x) if self.jit else int(x)

    def float(self, x):
        return self.Float(x) if self.jit else float(x)

    def bool(self, x):
        return self.Bool(x) if self.jit else bool(x)

    def both(self, a, b):
        return a & b if self.jit else bool(a) and bool(b)

    def no(self, x):
        return ~x if self.jit else not x

    def loop(self, state, cond, body, label=None, given=None):
        """While ``cond(*state)`` holds, ``state = body(*state)``. Results that gradients flow through are sums over the iterations.

        What is ``given`` comes to ``body`` as its first argument. All that has gradients and is not a table must be given so: in calls, Dr.Jit 1.5 loses the gradients of
        what a loop finds around it.
        """
        if not self.jit:
            while cond(*state):
                state = body(*state) if given is None else body(given, *state)
            return state
        if given is None:
            return dr.while_loop(state, cond, body, label=label)
        state = dr.while_loop(
            (given, *state),
            lambda _, *s: cond(*s),
            lambda given, *s: (given, *body(given, *s)),
            label=label,
            max_iterations=-1,
        )
        return state[1:]

    def branch(self, state, cond, then):
        """``then(*state)`` where ``cond`` holds, else ``state``; gradients do not pass."""
        if self.jit:
            return dr.if_stmt(state, cond, lambda *s: then(*s), lambda *s: s)
        return then(*state) if cond else state

    def times(self, count, state, body, unrolled, label=None):
        """``count`` iterations of ``state = body(i, *state)``. Gradients do not pass nested loops, so the iterations are
        unrolled where gradients flow.
        """
        if not self.jit or unrolled or count <= 1:
            for i in range(count):
                state = body(i, *state)
            return state
        state = dr.while_loop(
            (self.UInt(0), *state),
            lambda i, *_: i < count,
            lambda i, *s: (i + 1, *body(i, *s)),
            label=label,
        )
        return state[1:]

    def floor(self, x):
        """The largest integer not above ``x``, as a number and as a signed index."""
        whole = dr.floor(x)
        return whole, self.int(whole)

    def mean(self, s):
        """Mean over channels or wavelengths."""
        return sum(s[k] for k in range(self.count)) * (1.0 / self.count)

    def zero_s(self):
        return self.S(0.0)


class Words:
    """Words of 32 bits: Dr.Jit arrays or Python's numbers, modulo 2^32. The variant's kit is ``self.kit``."""

    def word(self, x):
        """An integer, which may be negative, as a word."""
        return self.kit.UInt(x) if self.kit.jit else int(x) & 0xFFFFFFFF

    def times(self, x, factor):
        return x * self.kit.UInt(factor) if self.kit.jit else (x * factor) & 0xFFFFFFFF

    def plus(self, x, y):
        return x + y if self.kit.jit else (x + y) & 0xFFFFFFFF

    def mix(self, x):
        """A mixing hash (``mix32`` of src/math/hash.rs)."""
        x = self.times(x ^ (x >> 16), 0x7FEB352D)
        x = self.times(x ^ (x >> 15), 0x846CA68B)
        return x ^ (x >> 16)


def _aligned(values):
    """A copy at an address that suits reads of packets. Dr.Jit takes NumPy's memory as it lies; from another address it reads the numbers of a packet one by one, and where a
    processor has no fast gather LLVM makes a branch of each: three times the time of a query, up to nine times that of the kernel's compilation."""
    buffer = np.empty(len(values) + 16, values.dtype)
    first = -buffer.ctypes.data % 64 // 4
    buffer[first : first + len(values)] = values
    return buffer[first : first + len(values)]


def dot3(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross3(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def clamp(x, low, high):
    return dr.minimum(dr.maximum(x, low), high)


def detached(x):
    """Values detached from gradients, including those in lists."""
    if isinstance(x, (list, tuple)):
        return type(x)(detached(v) for v in x)
    return dr.detach(x) if x is not None and dr.is_jit_v(x) else x
