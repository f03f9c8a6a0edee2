#!/usr/bin/env python3
"""References of what is larger than a fiber, in closed form: a sheet and a strand. No cloth looks like them.

Sheet: a share `gap` of it is open. The rest sends `albedo` of the light out, evenly by Lambert's law, the share
`through` of that on the other side. Two layers are added by hand: light between them is even, so that the adding
method (van de Hulst 1980, chapter 4) has numbers in place of operators.

Strand: light that meets it leaves evenly around it, as cos(theta_o) along it, with a part that a twist turns to one
end where it meets the strand beside its middle. A share gap h^2 of the light passes it.

It answers the kit's protocol (docs/howto/conformance.md); `mutations.py` changes single lines of this file.
"""
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from pipe import serve

PI = np.pi


def finite(*values):
    if not all(np.all(np.isfinite(v)) for v in values):
        raise ValueError("a number that is not finite")


class Sheet:
    """A sheet at its parameters."""

    def __init__(self, p):
        self.gap = p["gap"]
        r = (1.0 - self.gap) * p["albedo"] * (1.0 - p["through"])
        t = (1.0 - self.gap) * p["albedo"] * p["through"]
        if p["layers"] == 2:
            # Even light between the layers: down, and up.
            down = (t + r**2 * self.gap) / (1.0 - r**2)
            up = r * (down + self.gap)
            r, t = r + (t + self.gap) * up, (t + self.gap) * down + t * self.gap
            self.gap = self.gap**2
        self.r, self.t = r, t

    def eval(self, wi, wo):
        same = wo[:, 2] * wi[2] > 0.0
        return np.where(same, self.r, self.t) * np.abs(wo[:, 2]) / PI

    def pdf(self, wi, wo):
        return self.eval(wi, wo)

    def sample(self, wi, u):
        side = np.where(u[:, 0] < self.r, 1.0, -1.0) * (1.0 if wi[2] >= 0.0 else -1.0)
        z, phi = np.sqrt(1.0 - u[:, 1]), 2.0 * PI * u[:, 2]
        c = np.sqrt(u[:, 1])
        wo = np.stack([c * np.cos(phi), c * np.sin(phi), side * z], axis=1)
        scattered = u[:, 0] < self.r + self.t
        straight = ~scattered & (u[:, 0] < self.r + self.t + self.gap)
        return wo, scattered, np.where(straight, 1.0, 0.0)


class Strand:
    """A strand at its parameters, at one offset."""

    def __init__(self, p, h):
        self.gap = p["gap"] * h**2
        self.kept = (1.0 - self.gap) * p["albedo"]
        self.turn = 0.5 * p["twist"] * h

    def eval(self, wi, wo):
        cos = np.sqrt(np.maximum(0.0, 1.0 - wo[:, 2] ** 2))
        return self.kept * cos / PI**2 * (1.0 + self.turn * wo[:, 2])

    def pdf(self, wi, wo):
        return self.kept * np.sqrt(np.maximum(0.0, 1.0 - wo[:, 2] ** 2)) / PI**2

    def sample(self, wi, u):
        scattered = u[:, 0] < self.kept
        straight = ~scattered & (u[:, 0] < self.kept + self.gap)
        # The sine of a latitude of density cos^2 is one coordinate of an even point of the disk.
        z = np.sqrt(u[:, 1]) * np.cos(2.0 * PI * u[:, 2])
        phi = 2.0 * PI * np.clip(u[:, 0] / max(self.kept, 1e-30), 0.0, 1.0)
        c = np.sqrt(1.0 - z**2)
        return np.stack([c * np.cos(phi), c * np.sin(phi), z], axis=1), scattered, np.where(straight, 1.0, 0.0)


class Larger:
    """Answers the kit's protocol."""

    def describe(self):
        share = [0.0, 1.0, 0.5]
        sheet = {"albedo": [0.0, 1.0, 1.0], "through": share, "gap": [0.0, 0.5, 0.1], "layers": [1, 2, 1]}
        strand = {"albedo": [0.0, 1.0, 0.8], "gap": [0.0, 0.5, 0.2], "twist": [-1.0, 1.0, 0.4]}
        models = [
            dict(name="sheet", kind="cloth", fields=["mean"], parameters=sheet, claims=["circular", "reciprocal", "half_turn", "layers"]),
            dict(name="thin sheet", kind="cloth", fields=["mean"], parameters={**sheet, "layers": [1, 1, 1]}, claims=["albedo", "thin_gap"]),
            dict(name="strand", kind="ply", fields=["near", "far"], parameters=strand, claims=["circular", "reciprocal", "half_turn", "mirror", "far_is_mean"]),
        ]
        return {"protocol": 1, "name": "reference_larger.py", "version": "1", "models": models}

    def parts(self, q):
        """Models of a query and their shares."""
        finite(q["wi"], q["h"], list(q["parameters"].values()))
        if not np.linalg.norm(q["wi"]) > 0.5:
            raise ValueError("wi has no length")
        p = q["parameters"]
        if "sheet" in q["model"]:
            return [(1.0, Sheet({**p, "layers": round(p["layers"])}))]
        if q["field"] == "near":
            return [(1.0, Strand(p, q["h"]))]
        x, w = np.polynomial.legendre.leggauss(8)
        return [(0.5 * wk, Strand(p, hk)) for hk, wk in zip(x, w)]

    def eval(self, q, wo):
        finite(wo)
        return sum(w * m.eval(q["wi"], wo) for w, m in self.parts(q))

    def pdf(self, q, wo):
        finite(wo)
        return sum(w * m.pdf(q["wi"], wo) for w, m in self.parts(q))

    def straight(self, q):
        return sum(w * m.gap for w, m in self.parts(q))

    def sample(self, q, u):
        parts = self.parts(q)
        edges = np.concatenate([[0.0], np.cumsum([w for w, _ in parts])])
        chosen = np.minimum(np.searchsorted(edges[1:], u[:, 0], side="right"), len(parts) - 1)
        wo, hit, straight = np.empty((len(u), 3)), np.zeros(len(u), bool), np.zeros(len(u))
        for k, (w, m) in enumerate(parts):
            of = chosen == k
            v = u[of].copy()
            v[:, 0] = np.clip((v[:, 0] - edges[k]) / w, 0.0, 1.0)
            wo[of], hit[of], straight[of] = m.sample(q["wi"], v)
        f, pdf = self.eval(q, wo), self.pdf(q, wo)
        pdf = np.where(hit, pdf, 0.0)
        return {"wo": wo, "weight": np.where(hit, f / np.maximum(pdf, 1e-300), 0.0), "pdf": pdf, "straight": straight}


if __name__ == "__main__":
    serve(Larger())
