"""A woven fabric in Dr.Jit: its tables on the device, those of ``src/fabric/tensors.rs``.

A line is followed in a loop of the kernel (``_flight.py``). At each ply that it comes near (``_yarns.py``), its light is added up, less what yarns beside it shadow
(``_shadow.py``), and it is weighed against the others as the one that a sample is drawn of, so that no list of plies is kept. ``_between.py`` has the light between yarns.
"""

import drjit as dr
import numpy as np

from ._flight import Flight
from ._shadow import PLACES
from ._tables import Tables

YARN = "plies radius circle half_width spacing per_spacing reach turns_per_um slope step amplitude arc_radius arc steepest one_by_one".split()


class Cloth(Flight, Tables):
    """Tables and geometry of a fabric on the device."""

    #: What is kept of a ply that a line meets.
    WHERE = ("yarn", "place")

    def __init__(self, kit, tensors):
        Tables.__init__(self, kit, tensors)
        self.yarn = [dict(zip(YARN, map(float, row))) for row in tensors["yarn"]]
        self.turn = tensors["turn"]
        plies = [int(y["plies"]) for y in self.yarn]
        self.least_plies, self.most_plies = min(plies), max(plies)
        for y, other in zip(self.yarn, self.yarn[::-1]):
            y["places"] = PLACES[int(y["plies"] > 1)]
            y["places_per_um"] = other["per_spacing"] * y["places"]
        self.some_one_by_one = any(y["one_by_one"] for y in self.yarn)
        self.top, self.grain, self.edge_step = map(float, tensors["scalars"][:3])
        self.options = dict(zip(("diffracted", "speckle", "layers", "shadowing", "edges"), (v > 0.5 for v in tensors["options"])))
        draft = tensors["draft"]
        self.picks, self.ends = draft.shape
        self.threads = [self.ends, self.picks]
        self.side_words = kit.words(self.sides_of(np.asarray(draft)))
        self.stripes = [tensors["stripes_warp"], tensors["stripes_weft"]]
        self.dyes = [tensors["threads_warp"], tensors["threads_weft"]]
        self.lists = {}
        for name, lists in (("stripes", self.stripes), ("dyes", self.dyes)):
            self.lists[name] = [None if len(set(of.tolist())) == 1 else kit.words(of) for of in lists]
        patterns = tensors["shadow_patterns"]
        self.patterns = kit.words(patterns) if patterns.size else None

    def model_of(self, hit):
        """Index of the model of a yarn: a number where all have the same."""
        if self.models == 1:
            return 0
        return self.entry("stripes", hit["is_warp"], hit["yarn"])

    def hit_at(self, where, start, d):
        """All of a ply that was kept."""
        return self.hit(where["yarn"], start, d, where["place"])

    def ply_radius(self, hit):
        """Radius of the ply that a line meets, as its model has it [um]."""
        return self.of_family("radius", hit["is_warp"])

    def pattern_of(self, hit, at):
        """Number of a ply, and place along and across it [um], by which speckle has its patterns, of what a line meets."""
        family = dr.select(hit["is_warp"], self.kit.uint(0), self.kit.uint(1))
        return self.kit.uint(hit["yarn"]) * 16 + hit["ply"] * 2 + family, hit["along"], hit["h"]
