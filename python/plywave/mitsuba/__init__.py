"""BSDF plugins for Mitsuba 3: ``import plywave.mitsuba`` registers ``plywave_fabric`` (surfaces with uv), ``plywave_ply`` and ``plywave_fiber`` (curves).

All is evaluated in Dr.Jit from the model's own tensors, so it runs in megakernels and on GPUs and is differentiable. docs/mitsuba.md has the keys.
"""

try:
    import mitsuba as _mi
except ImportError:
    raise ImportError("plywave.mitsuba needs Mitsuba 3.9 or newer: install it with `pip install plywave[mitsuba]`") from None

#: Plugin classes by variant.
classes = {}


def _register(old=None, new=None):
    """Registers the plugins for the current variant; Mitsuba calls this after each change of it."""
    variant = _mi.variant()
    if variant is None or "polarized" in variant:
        return
    from . import _plugins

    classes[variant] = _plugins.define()


_mi.detail.add_variant_callback(_register)
_register()
