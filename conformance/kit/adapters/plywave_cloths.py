#!/usr/bin/env python3
"""Adapter of plywave's cloths that ship, as the mean over their cell, through its Python package.

    python3 conformance/kit/conform.py "python3 conformance/kit/adapters/plywave_cloths.py [NAME ..]"

Needs `pip install ./python`. A cloth is made once, in up to a minute, and kept in plywave's cache folder. Rays have no
diffraction: the models that are held to them let light through gaps go straight on. `NAME, diffracted` is the usual model,
`NAME, colored` the one with an authored color.
"""
import functools
import sys
from pathlib import Path

import numpy as np
import plywave

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from pipe import serve

FOLDER = HERE.parents[2] / "fabrics/cloths"
LAMBDA_UM = 0.55
NAMES = sys.argv[1:] or ["organza", "percale", "jersey"]
# docs/validation/cloth.md, "Light": swapped directions differ by 0.02 to 0.05 of the root mean square.
ACCURACY = {"reciprocal": 0.05, "albedo": 0.01}


def described(name, what):
    claims, parameters = ["reciprocal"], {"sigma_per_um": [0.0, 0.02, 0.0]}
    if what == "colored":
        claims, parameters = ["albedo"], {"albedo": [0.05, 0.8, 0.3]}
    else:
        claims += ["lossless", "traced"]
        claims += ["straight_gaps"] if what == "straight" else []
    model = dict(name=name if what == "straight" else f"{name}, {what}", kind="cloth", fields=["mean"], truth=name)
    return {**model, "claims": claims, "accuracy": ACCURACY, "parameters": parameters}


def srgb(x):
    return 12.92 * x if x <= 0.0031308 else 1.055 * x ** (1.0 / 2.4) - 0.055


class Cloths:
    def describe(self):
        models = [described(name, "straight") for name in NAMES]
        models += [described(name, what) for name in NAMES[:1] for what in ("diffracted", "colored")]
        return {"protocol": 1, "name": "plywave cloths", "version": plywave.__version__, "models": models}

    @functools.lru_cache(maxsize=None)
    def made(self, name, what):
        diffracted = what == "diffracted"
        return plywave.Cloth(str(FOLDER / f"{name}.toml"), gaps="diffracted" if diffracted else "straight", edges=diffracted)

    @functools.lru_cache(maxsize=64)
    def colored(self, name, albedo):
        color = [srgb(albedo)] * 3
        cloth = self.made(name, "straight")
        return cloth.with_colors(*[color] * len(cloth.yarns))

    def asked(self, q):
        name, _, what = q["model"].partition(", ")
        if what == "colored":
            cloth, more = self.colored(name, q["parameters"]["albedo"]), {}
        else:
            cloth = self.made(name, what or "straight")
            more = {"lambda_um": [LAMBDA_UM], "sigma_per_um": [q["parameters"]["sigma_per_um"]]}
        (ax, ay), (bx, by) = cloth.cell_um
        # More than a cell: the mean over it.
        return cloth, {"position_um": [0.0, 0.0], "wo": q["wi"], "footprint_um": 4.0 * max(np.hypot(ax, ay), np.hypot(bx, by))}, more

    def eval(self, q, wo):
        cloth, at, more = self.asked(q)
        # plywave's viewer is the kit's light: the same path the other way.
        f = cloth.eval(at["position_um"], at["wo"], wo, footprint_um=at["footprint_um"], **more)
        return f[..., min(1, f.shape[-1] - 1)]

    def pdf(self, q, wo):
        cloth, at, more = self.asked(q)
        return cloth.pdf(at["position_um"], at["wo"], wo, footprint_um=at["footprint_um"], **more)

    def straight(self, q):
        cloth, at, more = self.asked(q)
        s = cloth.straight(at["position_um"], at["wo"], footprint_um=at["footprint_um"], **more)
        return float(s[..., min(1, s.shape[-1] - 1)])

    def sample(self, q, u):
        cloth, at, more = self.asked(q)
        s = cloth.sample(at["position_um"], at["wo"], np.minimum(u, 1.0 - 2.0**-24), footprint_um=at["footprint_um"], **more)
        weight, scattered = s.weight[..., min(1, s.weight.shape[-1] - 1)], s.event == plywave.SCATTERED
        straight = np.where(s.event == plywave.STRAIGHT, weight, 0.0)
        return {"wo": s.w, "weight": np.where(scattered, weight, 0.0), "pdf": np.where(scattered, s.pdf, 0.0), "straight": straight}


if __name__ == "__main__":
    serve(Cloths())
