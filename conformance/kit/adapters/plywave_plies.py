#!/usr/bin/env python3
"""Adapter of plywave's ply models that ship, through its Python package (the Rust code that renders).

    python3 conformance/kit/conform.py "python3 conformance/kit/adapters/plywave_plies.py [NAME ..]"

Needs `pip install ./python`. Rays have no diffraction: the models that are held to them leave light that passes
beside a ply straight on. `NAME, edge` diffracts it.
"""
import functools
import re
import sys
from pathlib import Path

import numpy as np
import plywave

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from pipe import serve

MODELS = HERE.parents[2] / "fabrics/models"
LAMBDA_UM = 0.55
NAMES = sys.argv[1:] or ["polyester", "cotton", "wool", "cotton_2ply", "silk", "gold"]
# docs/explain/conventions.md: "a ply's f is reciprocal to a few percent".
ACCURACY = {"reciprocal": 0.05}
UNTWISTED, METALS, TRACED = ["glass", "glass_bundle", "polyester_bundle"], ["gold"], ["polyester", "cotton"]
NODES, SHARES = np.polynomial.legendre.leggauss(96)
OFFSETS, SHARES = np.sin(0.5 * np.pi * NODES), 0.25 * np.pi * SHARES * np.cos(0.5 * np.pi * NODES)


def described(name, edge):
    claims = ["circular", "reciprocal", "half_turn", "far_is_mean"]
    claims += [] if name in METALS else ["lossless"]
    claims += ["mirror"] if name in UNTWISTED else []
    claims += ["traced"] if name in TRACED and not edge else []
    model = dict(name=f"{name}, edge" if edge else name, kind="ply", fields=["near", "far"], lobes=not edge, truth=name)
    return {**model, "claims": claims, "accuracy": ACCURACY, "parameters": {"sigma_per_um": [0.0, 0.05, 0.0]}}


class Plies:
    def describe(self):
        models = [described(name, False) for name in NAMES] + [described(name, True) for name in NAMES[:1]]
        return {"protocol": 1, "name": "plywave plies", "version": plywave.__version__, "models": models}

    @functools.lru_cache(maxsize=None)
    def made(self, name):
        path = str(MODELS / f"{name}.pwm")
        model = plywave.load(path)
        plies = re.search(r"^plies = (\d+)", model.document["spec"], re.M)
        # Plies that touch, on a circle.
        ring = 1.0 + 1.0 / np.sin(np.pi / int(plies[1])) if plies and int(plies[1]) > 1 else 1.0
        return model, ring * plywave._plywave.ply_radius_um(path)

    def asked(self, q):
        """Model, turn from the kit's azimuths to the ply's frame, and the arguments of a query at each offset."""
        name, _, rest = q["model"].partition(", ")
        model, radius = self.made(name)
        turn = 0.5 * np.pi - np.arctan2(q["wi"][1], q["wi"][0])
        h = np.array([q["h"]]) if q["field"] == "near" else OFFSETS
        # The kit's ray meets the ply at the azimuth of wi + asin h: for light from y that is at x = -h.
        theta = np.arctan2(q["wi"][2], np.hypot(q["wi"][0], q["wi"][1]))
        return model, turn, (theta, -h * radius), q["parameters"]["sigma_per_um"], {"edge": rest == "edge", "lambda_um": [LAMBDA_UM]}

    def shares(self, q):
        return np.ones(1) if q["field"] == "near" else SHARES

    def turned(self, w, turn):
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * w[..., 0] - s * w[..., 1], s * w[..., 0] + c * w[..., 1], w[..., 2]], axis=-1)

    def eval(self, q, wo):
        model, turn, (theta, h), sigma, more = self.asked(q)
        w = self.turned(wo, turn)
        if more["edge"]:
            return sum(s * model.eval(theta, hk, w, sigma, **more)[..., 0] for s, hk in zip(self.shares(q), h))
        parts = [model.terms(theta, hk, w, sigma, **more) for hk in h]
        return sum(s * np.stack([t.refl[..., 0], t.high[..., 0]], axis=-1) for s, t in zip(self.shares(q), parts))

    def pdf(self, q, wo):
        model, turn, (theta, h), sigma, more = self.asked(q)
        w = self.turned(wo, turn)
        return sum(s * model.pdf(theta, hk, w, sigma, **more) for s, hk in zip(self.shares(q), h))

    def straight(self, q):
        model, _, (theta, h), sigma, more = self.asked(q)
        return float(self.shares(q) @ model.straight(theta, h, sigma, **more)[..., 0])

    def sample(self, q, u):
        model, turn, (theta, h), sigma, more = self.asked(q)
        shares = self.shares(q)
        edges = np.concatenate([[0.0], np.cumsum(shares)])
        k = np.minimum(np.searchsorted(edges[1:], u[:, 0], side="right"), len(h) - 1)
        v = np.minimum(np.concatenate([((u[:, 0] - edges[k]) / shares[k])[:, None], u[:, 1:]], axis=1), 1.0 - 2.0**-24)
        s = model.sample(theta, h[k], v, sigma, **more)
        wo, scattered = self.turned(s.w.astype(float), -turn), s.event == plywave.SCATTERED
        if q["field"] == "near":
            pdf, weight = s.pdf, s.weight[..., 0]
        else:
            # The density of all offsets together.
            pdf = np.zeros(len(u))
            weight = np.zeros(len(u))
            pdf[scattered] = self.pdf(q, wo[scattered])
            weight[scattered] = self.eval(q, wo[scattered]).reshape(scattered.sum(), -1).sum(axis=1) / np.maximum(pdf[scattered], 1e-30)
        straight = np.where(s.event == plywave.STRAIGHT, s.weight[..., 0], 0.0)
        return {"wo": wo, "weight": np.where(scattered, weight, 0.0), "pdf": np.where(scattered, pdf, 0.0), "straight": straight}


if __name__ == "__main__":
    serve(Plies())
