"""Tables of a cloth on the device: ply models, shadows, inter-yarn scattering, brightness (``src/cloth/tensors.rs``)."""

import math

import drjit as dr
import numpy as np

from ._inter_yarn import COUNT, SIGMAS, Between
from ._kit import clamp
from ._ply import Plies, read_container
from ._shadow import MEAN_Z, PASSED_COLUMNS, PASSED_ROWS, Shadows

# src/cloth/model.rs, bsdf.rs
MIN_CAUGHT, MAX_NEAR = 1e-3, 4


class Tables(Shadows, Between):
    """Tables for the light between the plies of a cloth."""

    def __init__(self, kit, tensors):
        self.kit = kit
        self.plies = Plies(kit, [read_container(bytes(b), "model")[0] for b in tensors["models"]])
        self.models = len(tensors["models"])
        passed = tensors["passed"]
        corners = [passed[:, i : i + PASSED_ROWS - 1, k : k + PASSED_COLUMNS - 1] for i in range(2) for k in range(2)]
        self.passed, self.passed_h = kit.floats(np.stack(corners, -1)), kit.floats(tensors["passed_h_um"])
        self.free_table = kit.words(np.ascontiguousarray(tensors["shadow_free"]).reshape(-1).view("<u4"))
        shared = tensors["shadow_table"]
        self.shadow_table = kit.words(shared) if len(shared) else None
        curve = tensors["curve"]
        self.curve_length = float(tensors["scalars"][2])
        self.curve_nodes = len(curve)
        self.curve = kit.floats(curve)
        at_one = 1.0 / (1.0 + self.curve_length)
        self.curve_range = (float(np.interp(at_one, curve[::-1, 0], curve[::-1, 1])), float(curve[0, 1]))
        widths = np.diff(np.float32(MEAN_Z))
        # Shapes of two consecutive means form a packet.
        shapes = tensors["exit_shapes"]
        self.exit_shapes = kit.floats(np.concatenate([shapes[..., :-1, :], shapes[..., 1:, :]], -1))
        self.mean_z = kit.floats(np.stack([MEAN_Z, [*(1.0 / widths), 0.0]], 1))
        of = tensors["inter_yarn_caught"].transpose(0, 1, 3, 4, 2)
        self.classes = of.shape[1]
        caught = np.zeros((2, self.classes, SIGMAS - 1, COUNT, 8), np.float32)
        caught[..., 0:3], caught[..., 3:6] = of[:, :, :-1], of[:, :, 1:]
        self.caught = kit.floats(caught)
        self.leaves = kit.floats(tensors["inter_yarn_leaves"])
        self.shape = kit.floats(tensors["inter_yarn_shape"])
        self.parallel = kit.floats(tensors["inter_yarn_parallel"])
        self.cones = kit.floats(tensors["inter_yarn_cones"])
        self.places = kit.floats(tensors["inter_yarn_places"]) if tensors["inter_yarn_places"].size else None
        self.place_means, self.shape_means = (kit.floats(tensors[f"inter_yarn_{what}_means"]) for what in ("place", "shape"))
        # Axes along which two kinds of yarns run; a cloth of one kind has no cones.
        along_y = tensors["kind"][:, 0] > 0.5
        self.axes = [int(y) for y in along_y] if len(along_y) == 2 else []

    def sigma_of_brightness(self, brightness):
        """The absorption at which the cloth has a brightness: non-absorbing fibers above its range, black ones below
        (src/color/absorption.rs).
        """
        kit, last = self.kit, self.curve_nodes - 2
        low, high = kit.uint(0), kit.uint(last)
        # Binary search for the last node whose value is not below the brightness.
        for _ in range(max(1, math.ceil(math.log2(last + 1)))):
            middle = (low + high + 1) >> 1
            up = kit.take(self.curve, middle * 2 + 1) >= brightness
            low, high = dr.select(up, middle, low), dr.select(up, high, middle - 1 if not kit.jit else dr.maximum(middle, 1) - 1)
        v0, a, v1, b = (kit.take(self.curve, low * 2 + i) for i in range(4))
        v = v0 + dr.select(a > b, clamp((a - brightness) / dr.maximum(a - b, 1e-12), 0.0, 1.0), 0.0) * (v1 - v0)
        sigma = dr.minimum((1.0 / dr.maximum(v, 1e-9) - 1.0) / self.curve_length, 1.0)
        dark, bright = self.curve_range
        return dr.select(brightness > bright, 0.0, dr.select(brightness >= dark, sigma, 1.0))
