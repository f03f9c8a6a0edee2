"""The BSDF plugins, defined anew for every variant."""

import mitsuba as mi

from . import _plugin_cloth, _plugin_fiber, _plugin_ply
from ._base import make_calls


def define():
    """Defines and registers the plugins for the current variant."""
    Calls = make_calls()
    made = {"ply": _plugin_ply.define(Calls), "fiber": _plugin_fiber.define(Calls), "cloth": _plugin_cloth.define(Calls)}
    for name, plugin in made.items():
        mi.register_bsdf(f"plywave_{name}", plugin)
    return {plugin.__name__: plugin for plugin in made.values()}
