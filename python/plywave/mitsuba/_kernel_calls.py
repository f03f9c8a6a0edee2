"""Calls of the Rust library from kernels of Dr.Jit's LLVM backend (``python/src/kernel_calls.rs``).

Dr.Jit's core emits a call of a ray tracer's function, whose address it is given: 12 words go in by lane, five come
back. The library's functions have that signature. They run within the kernel, in Dr.Jit's threads, so loops and calls
stay symbolic, and nothing is compiled for a cloth.

The functions of Dr.Jit's core are exported from its library, but they are not part of its interface for Python: in other
versions than those they are known of, or where they are missing, :func:`calls_of` returns ``None``.
"""

import ctypes
import functools
import pathlib

import drjit as dr
import mitsuba as mi

#: Names in the library, as compilers for Linux and macOS make them of
#: ``jit_var_pointer``, ``jit_llvm_ray_trace``, ``jit_var_dec_ref_impl`` and ``jit_llvm_vector_width``.
POINTER, TRACE, RELEASE, LANES = "_Z15jit_var_pointer10JitBackendPKvji", "_Z18jit_llvm_ray_tracejjiPKjPj", "_Z20jit_var_dec_ref_implj", "_Z21jit_llvm_vector_widthv"
VERSIONS = "1.5."
LIBRARIES = ("libdrjit-core.so", "libdrjit-core.dylib")
#: Which numbers a query has beside its own: absorptions of the two kinds of yarns, wavelengths.
SIGMAS, LAMBDA = (1, 2), 4
#: Numbers of a spectrum in a call.
CHANNELS = 4
HITS = 8


@functools.cache
def core():
    """The functions of Dr.Jit's core by name, or ``None``."""
    if not dr.__version__.startswith(VERSIONS):
        return None
    for name in LIBRARIES:
        path = pathlib.Path(dr.__file__).parent / name
        if not path.exists():
            continue
        try:
            library = ctypes.PyDLL(str(path))
            found = {key: getattr(library, key) for key in (POINTER, TRACE, RELEASE, LANES)}
        except (OSError, AttributeError):
            return None
        u32, pointer = ctypes.c_uint32, ctypes.c_void_p
        found[POINTER].restype, found[POINTER].argtypes = u32, (ctypes.c_int, pointer, u32, ctypes.c_int)
        found[TRACE].restype, found[TRACE].argtypes = None, (u32, u32, ctypes.c_int, pointer, pointer)
        found[RELEASE].restype, found[RELEASE].argtypes = None, (u32,)
        found[LANES].restype, found[LANES].argtypes = u32, ()
        return found
    return None


def calls_of(kit, tables):
    """The calls of a cloth, or ``None`` for variants and versions of Dr.Jit that have none."""
    if not kit.variant.startswith("llvm") or core() is None:
        return None
    known = tables.kernel_calls(core()[LANES](), kit.count)
    return None if known is None else Calls(kit, *known)


class Calls:
    """The calls of a cloth."""

    def __init__(self, kit, cloth, addresses):
        self.kit, self.cloth = kit, cloth
        self.put, self.get, self.light, self.draw, self.passing = addresses

    def call(self, address, floats, words, active):
        """Results of a function: three numbers and two words."""
        kit, library = self.kit, core()
        floats = [dr.detach(kit.Float(x)) for x in floats] + [kit.Float(0.0)] * (9 - len(floats))
        words = [kit.UInt(x) for x in words] + [kit.UInt(0)] * (3 - len(words))
        given = [kit.Bool(True), kit.Bool(active), *floats, *words]
        widths = {dr.width(x) for x in given} - {1}
        # What Dr.Jit's core raises would end the process.
        if len(widths) > 1 or 0 in widths:
            raise RuntimeError(f"plywave_cloth: arrays of {sorted(widths)} values in one call")
        function, cloth = (library[POINTER](int(dr.JitBackend.LLVM.value), x, 0, 0) for x in (address, self.cloth))
        taken, made = (ctypes.c_uint32 * len(given))(*(x.index for x in given)), (ctypes.c_uint32 * HITS)()
        library[TRACE](function, cloth, 0, taken, made)
        results = [dr.detail.update_indices(of(0), [index]) for of, index in zip((kit.Float, kit.Float, kit.Float, kit.UInt), made[1:5])]
        results.append(dr.detail.update_indices(kit.UInt(0), [made[6]]))
        for index in (function, cloth, *made):
            library[RELEASE](index)
        return results

    def query(self, at, w, active):
        """Inputs of a query: ``at`` has position, direction towards the viewer, footprint, absorptions by kind of yarn or
        ``None``, and wavelengths or ``None``.
        """
        kit, (position, wo, footprint, sigmas, lam) = self.kit, at
        given = sum(bit for bit, sigma in zip(SIGMAS, sigmas) if sigma is not None) + (0 if lam is None else LAMBDA)
        token = kit.UInt(0)
        if given:
            more = []
            for values in (*sigmas, *[None] * (2 - len(sigmas)), lam):
                more += [0.0] * CHANNELS if values is None else [values[k] if k < kit.count else 0.0 for k in range(CHANNELS)]
            words = [dr.reinterpret_array(kit.UInt, dr.detach(kit.Float(x))) for x in more[9:]]
            token = self.call(self.put, more[:9], words, active)[3]
        return [*position, *wo, footprint, *w], [token, given], active

    def eval_pdf(self, at, w, active):
        """f and density in direction ``w``."""
        kit = self.kit
        results = [self.number(x) for x in self.call(self.light, *self.query(at, w, active))]
        f = kit.zero_s()
        for k in range(kit.count):
            f[k] = results[k]
        return f, results[kit.count]

    def sample(self, at, u, active):
        """A direction, whether light goes straight through, its probability or the density, and f or the energy of
        that light.
        """
        kit = self.kit
        x, y, z, pdf, token = self.call(self.draw, *self.query(at, u, active))
        pdf = self.number(pdf)
        of = self.call(self.get, [], [token], active)
        f = kit.zero_s()
        for k in range(kit.count):
            f[k] = self.number(of[k])
        return [x, y, z], pdf < 0.0, dr.abs(pdf), f

    def straight(self, at, active):
        """Energy of the light that goes straight through."""
        return self.call(self.passing, *self.query(at, [0.0] * 3, active))[0]

    def number(self, x):
        """A result as a number."""
        return x if dr.is_float_v(x) else dr.reinterpret_array(self.kit.Float, x)
