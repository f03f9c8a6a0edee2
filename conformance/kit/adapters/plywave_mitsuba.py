#!/usr/bin/env python3
"""Adapter of plywave's Mitsuba plugin `plywave_cloth`, as the mean over the cell.

    python3 conformance/kit/conform.py "python3 conformance/kit/adapters/plywave_mitsuba.py [NAME ..]"

Needs `pip install "./python[mitsuba]"`, and LLVM's library for the variant llvm_ad_rgb (DRJIT_LIBLLVM_PATH).
"""
import functools
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
import plywave.mitsuba  # noqa: F401  (registers the plugins)

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from pipe import serve

FOLDER = HERE.parents[2] / "fabrics/cloths"
NAMES = sys.argv[1:] or ["organza"]


class Plugin:
    def describe(self):
        models = []
        for name in NAMES:
            claims = ["reciprocal", "lossless", "traced", "straight_gaps"]
            model = dict(name=f"plywave_cloth {name}", kind="cloth", fields=["mean"], claims=claims, truth=name, accuracy={"reciprocal": 0.05})
            models.append({**model, "parameters": {"sigma_per_um": [0.0, 0.02, 0.0]}})
        return {"protocol": 1, "name": "plywave in Mitsuba", "version": f"{plywave.__version__}, {mi.__version__}", "models": models}

    @functools.lru_cache(maxsize=32)
    def made(self, name, sigma):
        keys = {"type": "plywave_cloth", "filename": str(FOLDER / f"{name.split()[-1]}.toml"), "gaps": "straight", "edges": False}
        return mi.load_dict({**keys, "far": True, "footprint_um": 1e5, "sigma_per_um": {"type": "rgb", "value": [float(sigma)] * 3}})

    def bsdf(self, q):
        if not np.isfinite(q["parameters"]["sigma_per_um"]):
            raise ValueError("sigma_per_um: not finite")
        return self.made(q["model"], q["parameters"]["sigma_per_um"])

    def interaction(self, q, count):
        si = mi.SurfaceInteraction3f()
        si.wi = vectors(np.repeat([q["wi"]], count, axis=0))
        si.t, si.uv, si.sh_frame = mi.Float(1.0), mi.Point2f(0.5, 0.5), mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
        si.n = mi.Normal3f(0.0, 0.0, 1.0)
        si.dp_du, si.dp_dv = mi.Vector3f(1.0, 0.0, 0.0), mi.Vector3f(0.0, 1.0, 0.0)
        return si

    # Mitsuba's viewer is the kit's light: the same path the other way.
    context = mi.BSDFContext()

    def eval(self, q, wo):
        f = self.bsdf(q).eval(self.context, self.interaction(q, len(wo)), vectors(wo))
        return np.broadcast_to(np.array(f)[1], len(wo))

    def pdf(self, q, wo):
        return np.broadcast_to(np.array(self.bsdf(q).pdf(self.context, self.interaction(q, len(wo)), vectors(wo))), len(wo))

    def straight(self, q):
        return float(np.array(self.bsdf(q).eval_null_transmission(self.interaction(q, 1)))[1, 0])

    def sample(self, q, u):
        n = len(u)
        s1, s2 = mi.Float(u[:, 0].astype(np.float32)), mi.Point2f(*(u[:, k].astype(np.float32) for k in (1, 2)))
        bs, weight = self.bsdf(q).sample(self.context, self.interaction(q, n), s1, s2)
        w = np.broadcast_to(np.array(weight)[1], n)
        wo = np.stack([np.broadcast_to(np.array(x), n) for x in (bs.wo.x, bs.wo.y, bs.wo.z)], axis=1)
        pdf, null = (np.broadcast_to(np.array(x), n) for x in (bs.pdf, mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)))
        hit = ~null & (pdf > 0.0)
        return {"wo": wo, "weight": np.where(hit, w, 0.0), "pdf": np.where(hit, pdf, 0.0), "straight": np.where(null, w, 0.0)}


def vectors(w):
    w = np.asarray(w, np.float32).reshape(-1, 3)
    return mi.Vector3f(*(np.ascontiguousarray(w[:, k]) for k in range(3)))


if __name__ == "__main__":
    serve(Plugin())
