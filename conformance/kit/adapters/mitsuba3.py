#!/usr/bin/env python3
"""Adapter of Mitsuba 3: hair and the surfaces without delta lobes that need no file.

    python3 conformance/kit/conform.py "python3 conformance/kit/adapters/mitsuba3.py"

Needs `pip install mitsuba`, and LLVM's library for the variant llvm_ad_rgb (DRJIT_LIBLLVM_PATH).
"""
import functools
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from pipe import serve

mi.set_variant("llvm_ad_rgb")
DEGREE = 180.0 / np.pi


def rgb(value):
    return {"type": "rgb", "value": [float(value)] * 3}


def hair(p):
    # Its sigma_a is per radius; tau is over the diameter. Its tilt is in degrees, and positive tilts shift R
    # along +y, so that y points to the root (as in pbrt); the kit's z points to the tip.
    return {
        "type": "hair", "int_ior": p["eta"], "ext_ior": 1.0, "sigma_a": rgb(0.5 * p["tau"]),
        "scale_tilt": -p["alpha"] * DEGREE, "longitudinal_roughness": p["beta_m"], "azimuthal_roughness": p["beta_n"],
    }


def rough_dielectric(p):
    return {"type": "roughdielectric", "distribution": "ggx", "alpha": p["alpha"], "int_ior": p["eta"], "ext_ior": 1.0}


def rough_conductor(p):
    return {"type": "roughconductor", "distribution": "ggx", "alpha": p["alpha"], "eta": rgb(p["eta"]), "k": rgb(p["kappa"])}


def diffuse(p):
    return {"type": "diffuse", "reflectance": rgb(p["albedo"])}


def principled(p):
    return {
        "type": "principled", "base_color": rgb(p["albedo"]), "roughness": p["roughness"], "metallic": p["metallic"],
        "sheen": p["sheen"], "eta": 1.5,
    }


def principled_thin(p):
    return {
        "type": "principledthin", "base_color": rgb(p["albedo"]), "roughness": p["roughness"], "eta": 1.5,
        "diff_trans": p["diff_trans"], "sheen": p["sheen"], "spec_trans": p["spec_trans"],
    }


def rough_plastic(p):
    return {"type": "roughplastic", "diffuse_reflectance": rgb(p["albedo"]), "alpha": p["alpha"], "int_ior": 1.5, "distribution": "ggx"}


def principled_glass(p):
    return {"type": "principled", "base_color": rgb(1.0), "roughness": p["roughness"], "spec_trans": p["spec_trans"], "eta": p["eta"]}


BETA = [0.15, 1.0, 0.3]
# Black is left out: a weight of 0 is how `sample` says that it failed, and a black model has no other.
ALBEDO = [0.05, 1.0, 0.5]
# GGX takes the square of it, and principledthin transmits with 0.39 of that, which the kit's grid must see.
ROUGH = [0.3, 1.0, 0.5]
# Name: plugin, kind, parameters [low, high, default], claims beyond what the plugin's flags say (`claims`).
MODELS = {
    # Its page: "an implementation of the hair model described in [..] Chiang et al.", a near field.
    "hair": (hair, "fiber", {"eta": [1.1, 2.0, 1.55], "tau": [0.0, 5.0, 0.0], "alpha": [-0.1, 0.1, 0.0], "beta_m": BETA, "beta_n": BETA},
             ["lossless", "smooth_cylinder", "chiang", "circular"]),
    # Its page: "based on the paper Microfacet Models for Refraction through Rough Surfaces by Walter et al.",
    # which is reciprocal but for the squares of the indices, and masks by G1(wi) G1(wo).
    "roughdielectric": (rough_dielectric, "surface", {"eta": [1.3, 2.0, 1.5], "alpha": [0.1, 0.8, 0.3]}, ["reciprocal", "ggx_plane"]),
    "roughconductor": (rough_conductor, "surface", {"eta": [0.2, 3.0, 0.4], "kappa": [0.0, 7.0, 2.5], "alpha": [0.1, 0.8, 0.3]}, []),
    "diffuse": (diffuse, "surface", {"albedo": ALBEDO}, []),
    "roughplastic": (rough_plastic, "surface", {"albedo": ALBEDO, "alpha": [0.1, 0.8, 0.3]}, []),
    "principled": (principled, "surface", {"albedo": ALBEDO, "roughness": ROUGH, "metallic": [0.0, 1.0, 0.0], "sheen": [0.0, 1.0, 0.0]}, []),
    "principled, glass": (principled_glass, "surface", {"roughness": [0.4, 1.0, 0.5], "spec_trans": [0.0, 1.0, 0.9], "eta": [1.3, 2.0, 1.5]}, []),
    "principledthin": (principled_thin, "surface", {"albedo": ALBEDO, "roughness": ROUGH, "diff_trans": [0.0, 2.0, 0.6], "sheen": [0.0, 1.0, 0.0],
                                                    "spec_trans": [0.0, 1.0, 0.0]}, []),
}


def claims(name):
    """What a plugin says of itself, in its flags at the defaults and, for `MODELS`, on its page."""
    make, kind, parameters, more = MODELS[name]
    flags, says = mi.load_dict(make({k: v[2] for k, v in parameters.items()})).flags(), list(more)
    if kind == "surface":
        says += ["circular"] if not mi.has_flag(flags, mi.BSDFFlags.Anisotropic) else []
        says += ["reciprocal"] if not mi.has_flag(flags, mi.BSDFFlags.NonSymmetric) else []
        says += ["two_sided"] if mi.has_flag(flags, mi.BSDFFlags.BackSide) else []
    return sorted(set(says))


class Mitsuba:
    def describe(self):
        models = [
            dict(name=n, kind=kind, fields=["near" if kind == "fiber" else "surface"], parameters=p, claims=claims(n))
            for n, (_, kind, p, _) in MODELS.items()
        ]
        return {"protocol": 1, "name": "Mitsuba 3", "version": f"{mi.__version__} llvm_ad_rgb", "models": models}

    @functools.lru_cache(maxsize=64)
    def made(self, name, parameters):
        return mi.load_dict(MODELS[name][0](dict(parameters)))

    def bsdf(self, q):
        return self.made(q["model"], tuple(sorted(q["parameters"].items())))

    def turn(self, q):
        """Angle that brings the kit's azimuths to the plugin's, whose normal is at pi/2 of its (x, z) plane.

        `hair` reads h from the azimuth between wi and the normal; the kit's ray meets the fiber at phi_i + asin h."""
        return 0.5 * np.pi - (np.arctan2(q["wi"][1], q["wi"][0]) + np.arcsin(np.clip(q["h"], -1.0, 1.0)))

    def local(self, q, w):
        """Directions in the plugin's frame: y along the fiber, z its normal; a surface's is the kit's own."""
        w = np.asarray(w, float).reshape(-1, 3)
        if MODELS[q["model"]][1] == "surface":
            return w
        c, s = np.cos(self.turn(q)), np.sin(self.turn(q))
        return np.stack([c * w[:, 0] - s * w[:, 1], w[:, 2], s * w[:, 0] + c * w[:, 1]], axis=1)

    def world(self, q, w):
        if MODELS[q["model"]][1] == "surface":
            return w
        c, s = np.cos(self.turn(q)), np.sin(self.turn(q))
        return np.stack([c * w[:, 0] + s * w[:, 2], -s * w[:, 0] + c * w[:, 2], w[:, 1]], axis=1)

    def interaction(self, q, count):
        si = mi.SurfaceInteraction3f()
        wi = np.repeat(self.local(q, q["wi"]), count, axis=0)
        si.wi = vectors(wi)
        si.t, si.uv, si.sh_frame = mi.Float(1.0), mi.Point2f(0.5, 0.5), mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
        si.n = mi.Normal3f(0.0, 0.0, 1.0)
        si.dp_du, si.dp_dv = mi.Vector3f(1.0, 0.0, 0.0), mi.Vector3f(0.0, 1.0, 0.0)
        return si

    # Flux that leaves, not radiance: no factor of eta^2 where light is refracted.
    context = mi.BSDFContext(mi.TransportMode.Importance)

    def eval(self, q, wo):
        f = self.bsdf(q).eval(self.context, self.interaction(q, len(wo)), vectors(self.local(q, wo)))
        return np.broadcast_to(np.array(f)[0], len(wo))

    def pdf(self, q, wo):
        pdf = self.bsdf(q).pdf(self.context, self.interaction(q, len(wo)), vectors(self.local(q, wo)))
        return np.broadcast_to(np.array(pdf), len(wo))

    def sample(self, q, u):
        n = len(u)
        s1, s2 = mi.Float(u[:, 0].astype(np.float32)), mi.Point2f(*(u[:, k].astype(np.float32) for k in (1, 2)))
        bs, weight = self.bsdf(q).sample(self.context, self.interaction(q, n), s1, s2)
        w = np.broadcast_to(np.array(weight)[0], n)
        wo = np.stack([np.broadcast_to(np.array(x), n) for x in (bs.wo.x, bs.wo.y, bs.wo.z)], axis=1)
        # `BSDF::sample`: "A zero spectrum indicates that sampling failed", "the contents are undefined" then.
        pdf = np.where(w == 0.0, 0.0, np.broadcast_to(np.array(bs.pdf), n))
        return {"wo": self.world(q, wo), "weight": w, "pdf": pdf}


def vectors(w):
    return mi.Vector3f(*(np.ascontiguousarray(w[:, k], dtype=np.float32) for k in range(3)))


if __name__ == "__main__":
    serve(Mitsuba())
