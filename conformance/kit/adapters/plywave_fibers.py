#!/usr/bin/env python3
"""Adapter of plywave's analytic fibers, through its Python package (the Rust code that renders).

    python3 conformance/kit/conform.py "python3 conformance/kit/adapters/plywave_fibers.py"

Needs `pip install ./python`.
"""
import functools
import sys
from pathlib import Path

import numpy as np
import plywave

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from pipe import serve

RADIUS_UM = 10.0
LAMBDA_UM = 0.55


def three(x):
    return [float(x)] * 3


def dielectric(p):
    return {"kind": "dielectric", "eta": p["eta"], "beta_m": three(p["beta_m"]), "beta_n": p["beta_n"], "orders": 8}


def rough(p, normalize):
    shift = [-2.0 * p["alpha"], p["alpha"], 4.0 * p["alpha"]]
    return {
        "kind": "rough_dielectric", "eta": p["eta"], "shift": shift, "width_theta": three(p["beta_m"]),
        "width_phi": three(p["beta_n"]), "normalize": normalize,
    }


def opaque(p):
    return {"kind": "opaque", "eta": p["eta"], "kappa": p["kappa"], "beta_m": p["beta_m"], "beta_n": p["beta_n"]}


def matte(p):
    return {"kind": "opaque", "diffuse": p["albedo"]}


def khungurn(p):
    return {"kind": "khungurn", "c_r": p["c_r"], "c_tt": p["c_tt"], "beta_r": p["beta_m"], "beta_tt": p["beta_m"]}


def kajiya_kay(p):
    return {"kind": "kajiya_kay", "exponent": p["exponent"]}


WIDTH = [0.1, 1.0, 0.3]
ETA, TAU = [1.1, 2.0, 1.55], [0.0, 5.0, 0.0]
BOTH = ["near", "far"]
# Maker, fields, parameters, claims: what docs/explain/filaments.md says of each kind.
MODELS = {
    "dielectric": (dielectric, BOTH, {"eta": ETA, "tau": TAU, "beta_m": WIDTH, "beta_n": WIDTH},
                   ["lossless", "smooth_cylinder", "circular", "far_is_mean"]),
    "rough_dielectric": (functools.partial(rough, normalize=False), BOTH,
                         {"eta": ETA, "tau": TAU, "alpha": [-0.05, 0.05, 0.0], "beta_m": WIDTH, "beta_n": WIDTH},
                         ["circular", "reciprocal", "far_is_mean"]),
    "rough_dielectric, normalize": (functools.partial(rough, normalize=True), BOTH,
                                    {"eta": ETA, "tau": TAU, "alpha": [-0.05, 0.05, 0.0], "beta_m": WIDTH, "beta_n": WIDTH},
                                    ["lossless", "circular"]),
    "opaque, metal": (opaque, BOTH, {"eta": [0.2, 3.0, 0.43], "kappa": [0.5, 7.0, 2.46], "beta_m": WIDTH, "beta_n": WIDTH},
                      ["circular", "conductor"]),
    "opaque, matte": (matte, BOTH, {"albedo": [0.0, 1.0, 1.0]}, ["circular", "far_is_mean"]),
    "khungurn": (khungurn, ["far"], {"c_r": [0.0, 1.0, 0.05], "c_tt": [0.0, 1.0, 0.9], "beta_m": WIDTH}, ["circular"]),
    "kajiya_kay": (kajiya_kay, ["far"], {"exponent": [1.0, 200.0, 50.0]}, ["circular"]),
}


class Plywave:
    def describe(self):
        models = [dict(name=n, kind="fiber", fields=f, parameters=p, claims=c) for n, (_, f, p, c) in MODELS.items()]
        return {"protocol": 1, "name": "plywave", "version": plywave.__version__, "models": models}

    @functools.lru_cache(maxsize=64)
    def made(self, name, parameters):
        keys = {**MODELS[name][0](dict(parameters)), "radius_um": RADIUS_UM}
        lines = ["name = 'kit'", "[filament]"]
        lines += [f"{k} = {repr(v).lower() if isinstance(v, bool) else repr(v)}" for k, v in keys.items()]
        return plywave.Fiber.from_bytes("\n".join(lines).encode(), "kit.toml")

    def asked(self, q):
        fiber = self.made(q["model"], tuple(sorted(q["parameters"].items())))
        sigma = q["parameters"].get("tau", 0.0) / (2.0 * RADIUS_UM)
        more = {"h_rel": q["h"]} if q["field"] == "near" else {}
        return fiber, {"lambda_um": [LAMBDA_UM], "sigma_per_um": [sigma], **more}

    def eval(self, q, wo):
        fiber, more = self.asked(q)
        return fiber.eval(q["wi"], wo, **more)[..., 0]

    def pdf(self, q, wo):
        fiber, more = self.asked(q)
        return fiber.pdf(q["wi"], wo, **more)

    def sample(self, q, u):
        fiber, more = self.asked(q)
        # JSON's numbers are doubles: the last below 1 must not round up.
        s = fiber.sample(q["wi"], np.minimum(u, 1.0 - 2.0**-24), **more)
        return {"wo": s.w, "weight": s.weight[..., 0], "pdf": s.pdf}


if __name__ == "__main__":
    serve(Plywave())
