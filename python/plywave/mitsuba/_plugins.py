"""The BSDF plugins, made anew for every variant."""

import mitsuba as mi

from . import _plugin_cloth, _plugin_fabric, _plugin_fiber, _plugin_ply, _surface
from ._base import make_calls


def define():
    """Makes and registers the plugins for the current variant."""
    Calls = make_calls()
    Surface = _surface.define(Calls)
    made = {"ply": _plugin_ply.define(Calls), "fiber": _plugin_fiber.define(Calls), "fabric": _plugin_fabric.define(Surface), "cloth": _plugin_cloth.define(Surface)}
    for name, plugin in made.items():
        mi.register_bsdf(f"plywave_{name}", plugin)
    return {plugin.__name__: plugin for plugin in made.values()}
