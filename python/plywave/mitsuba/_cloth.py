"""A woven fabric in Dr.Jit: its tables on the device, those of ``src/fabric/tensors.rs``.

A line is followed in a loop of the kernel (``_flight.py``). At each ply that it comes near (``_yarns.py``), its light is added up, less what yarns beside it shadow
(``_shadow.py``), and it is weighed against the others as the one that a sample is drawn of, so that no list of plies is kept. ``_between.py`` has the light between yarns.
"""

import math

import drjit as dr
import numpy as np

from ._between import CLASSES, COUNT, SIGMAS, Between
from ._flight import Flight
from ._kit import clamp
from ._ply import Plies, read_container
from ._shadow import MEAN_Z, PASSED_COLUMNS, PASSED_ROWS, PLACES, Shadows

# src/fabric/bsdf.rs, hit.rs
MIN_CAUGHT, MAX_NEAR = 1e-3, 4

YARN = "plies radius circle half_width spacing per_spacing reach turns_per_um slope step amplitude arc_radius arc steepest one_by_one".split()


class Cloth(Flight, Shadows, Between):
    """Tables and geometry of a fabric on the device."""

    def __init__(self, kit, tensors):
        self.kit = kit
        self.plies = Plies(kit, [read_container(bytes(b), "model")[0] for b in tensors["models"]])
        self.models = len(tensors["models"])
        self.yarn = [dict(zip(YARN, map(float, row))) for row in tensors["yarn"]]
        self.turn = tensors["turn"]
        plies = [int(y["plies"]) for y in self.yarn]
        self.least_plies, self.most_plies = min(plies), max(plies)
        for y, other in zip(self.yarn, self.yarn[::-1]):
            y["places"] = PLACES[int(y["plies"] > 1)]
            y["places_per_um"] = other["per_spacing"] * y["places"]
        self.some_one_by_one = any(y["one_by_one"] for y in self.yarn)
        passed = tensors["passed"]
        corners = [passed[:, i : i + PASSED_ROWS - 1, k : k + PASSED_COLUMNS - 1] for i in range(2) for k in range(2)]
        self.passed, self.passed_h = kit.floats(np.stack(corners, -1)), kit.floats(tensors["passed_h_um"])
        self.top, self.grain, self.edge_step, self.curve_length = map(float, tensors["scalars"])
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
        self.free_table = kit.words(np.ascontiguousarray(tensors["shadow_free"]).reshape(-1).view("<u4"))
        patterns = tensors["shadow_patterns"]
        self.patterns = kit.words(patterns) if patterns.size else None
        curve = tensors["curve"]
        self.curve_nodes = len(curve)
        self.curve = kit.floats(curve)
        at_one = 1.0 / (1.0 + self.curve_length)
        self.curve_range = (float(np.interp(at_one, curve[::-1, 0], curve[::-1, 1])), float(curve[0, 1]))
        widths = np.diff(np.float32(MEAN_Z))
        # Those of two means behind each other, a packet.
        shapes = tensors["exit_shapes"]
        self.exit_shapes = kit.floats(np.concatenate([shapes[..., :-1, :], shapes[..., 1:, :]], -1))
        self.mean_z = kit.floats(np.stack([MEAN_Z, [*(1.0 / widths), 0.0]], 1))
        caught = np.zeros((2, CLASSES, SIGMAS - 1, COUNT, 8), np.float32)
        of = tensors["between_caught"].transpose(0, 1, 3, 4, 2)
        caught[..., 0:3], caught[..., 3:6] = of[:, :, :-1], of[:, :, 1:]
        self.caught = kit.floats(caught)
        self.leaves = kit.floats(tensors["between_leaves"])
        self.shape = kit.floats(tensors["between_shape"])

    def model_of(self, hit):
        """Index of the model of a yarn: a number where all have the same."""
        if self.models == 1:
            return 0
        return self.entry("stripes", hit["is_warp"], hit["yarn"])

    def sigma_of_brightness(self, brightness):
        """The absorption with which the cloth has a brightness: clear fibers above its range, black ones below (src/color/absorption.rs)."""
        kit, last = self.kit, self.curve_nodes - 2
        low, high = kit.uint(0), kit.uint(last)
        # The last node whose value is not below the brightness.
        for _ in range(max(1, math.ceil(math.log2(last + 1)))):
            middle = (low + high + 1) >> 1
            up = kit.take(self.curve, middle * 2 + 1) >= brightness
            low, high = dr.select(up, middle, low), dr.select(up, high, middle - 1 if not kit.jit else dr.maximum(middle, 1) - 1)
        v0, a, v1, b = (kit.take(self.curve, low * 2 + i) for i in range(4))
        v = v0 + dr.select(a > b, clamp((a - brightness) / dr.maximum(a - b, 1e-12), 0.0, 1.0), 0.0) * (v1 - v0)
        sigma = dr.minimum((1.0 / dr.maximum(v, 1e-9) - 1.0) / self.curve_length, 1.0)
        dark, bright = self.curve_range
        return dr.select(brightness > bright, 0.0, dr.select(brightness >= dark, sigma, 1.0))
