"""BSDF plugins for Mitsuba 3: ``import plywave.mitsuba`` registers ``plywave_cloth`` (surfaces with uv), ``plywave_ply``
and ``plywave_fiber`` (curves).

All plugins evaluate the model's own tensors in Dr.Jit, so they run in megakernels and on GPUs and are differentiable.
Where nothing has gradients, kernels of LLVM variants call the Rust library for cloths (``_kernel_calls.py``).
docs/reference/mitsuba_plugins.md lists the keys.
"""

try:
    import mitsuba as _mi
except ImportError:
    raise ImportError("plywave.mitsuba needs Mitsuba 3.9 or newer: install it with `pip install plywave[mitsuba]`") from None

#: Plugin classes by variant.
classes = {}


def _register(old=None, new=None):
    """Registers the plugins for the current variant; Mitsuba calls this function after each change of the variant."""
    variant = _mi.variant()
    if variant is None or "polarized" in variant:
        return
    from . import _plugins

    classes[variant] = _plugins.define()


def check(scene):
    """Refuses a scene in which a shape cannot carry its plugin, which the plugins cannot check by themselves.

    Raises ``ValueError``, in one line, for a mesh without texture coordinates, for ``plywave_cloth`` on a curve, and
    for ``plywave_ply`` or ``plywave_fiber`` on a shape that is neither a ``bsplinecurve`` nor a tube (Mitsuba's
    ``linearcurve`` does not provide its direction). BSDFs nested in others, such as ``mask`` and ``twosided``, are
    checked too.
    """
    from ._base import misfit, plugins_of

    for shape in scene.shapes():
        for bsdf in plugins_of(shape.bsdf()):
            if text := misfit(bsdf, shape):
                raise ValueError(text)


_mi.detail.add_variant_callback(_register)
_register()
