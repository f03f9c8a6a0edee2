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


def check(scene):
    """Refuses a scene in which a shape cannot carry the plugin that it has; what a plugin cannot see by itself.

    Raises ``ValueError``, in one line, for a mesh without texture coordinates under ``plywave_fabric``, and for a ``linearcurve`` under ``plywave_ply`` or ``plywave_fiber``:
    Mitsuba's linear curves do not tell where they run; take ``bsplinecurve``.
    """
    for shape in scene.shapes():
        bsdf = shape.bsdf()
        kind = type(bsdf).__name__
        name = shape.id() or shape.class_name()
        if kind == "Fabric" and shape.is_mesh() and not shape.has_vertex_texcoords():
            raise ValueError(f"{name}: no texture coordinates: plywave_fabric needs uv, along whose u the weft runs")
        if kind == "Fabric" and "Curve" in shape.class_name():
            raise ValueError(f"{name}: a curve: plywave_fabric is for surfaces: use plywave_ply")
        if kind in ("Ply", "OneFiber") and shape.class_name() == "LinearCurve":
            raise ValueError(f"{name}: a linearcurve: Mitsuba does not tell where it runs: use a bsplinecurve")


_mi.detail.add_variant_callback(_register)
_register()
