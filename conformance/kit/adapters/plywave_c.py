#!/usr/bin/env python3
"""Adapter of plywave's C interface through ctypes: ply models that ship, and a dielectric fiber.

    python3 conformance/kit/conform.py "python3 conformance/kit/adapters/plywave_c.py LIBRARY [NAME ..]"

LIBRARY is `libplywave.so` of `capi/install.sh`, or `target/release/libplywave_capi.so`. Sizes of structures are read from the
header of this tree, and the version of the interface is compared.
"""
import ctypes as c
import functools
import re
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
sys.path.insert(0, str(HERE.parent))
from pipe import serve

HEADER = (ROOT / "capi/include/plywave.h").read_text()
LAMBDA_UM, RADIUS_UM = 0.55, 10.0
SCATTERED, STRAIGHT = (int(re.search(rf"PLYWAVE_OUTCOME_{name} = (\d+)", HEADER)[1]) for name in ("SCATTERED", "STRAIGHT"))


def constant(name):
    return int(re.search(rf"#define PLYWAVE_{name} (\d+)", HEADER)[1])


N = constant("MAX_COUNT")


class Bsdf(c.Structure):
    _fields_ = [("tag", c.c_uint64), ("words", c.c_uint64 * constant("BSDF_WORDS"))]


class Error(c.Structure):
    _fields_ = [("status", c.c_int32), ("index", c.c_uint64), ("message", c.c_char * constant("MESSAGE_SIZE"))]


SAMPLE = np.dtype([("outcome", "<i4"), ("w", "<f4", 3), ("weight", "<f4", N), ("pdf", "<f4")])


class PlyInfo(c.Structure):
    _fields_ = [(name, c.c_double) for name in ("radius_um", "h_limit_um", "theta_limit", "sigma_limit_per_um", "w0_um", "d_cut_um")]
    _fields_ += [("rest", c.c_uint8 * 1024)]


class PlyQuery(c.Structure):
    _fields_ = [("theta_i", c.c_float), ("h_um", c.c_float), ("count", c.c_int32), ("sigma_per_um", c.c_float * N), ("lambda_um", c.c_float * N)]
    _fields_ += [(name, c.c_int32) for name in ("no_edge", "uncached", "no_relief", "no_speckle")]
    _fields_ += [(name, c.c_void_p) for name in ("slit", "place", "below")]


class FiberQuery(c.Structure):
    _fields_ = [("omega_i", c.c_float * 3), ("count", c.c_int32), ("lambda_um", c.c_float * N), ("h_rel", c.c_void_p), ("sigma_per_um", c.c_float * N)]


if len(sys.argv) < 2:
    sys.exit("plywave_c.py: give the path of libplywave.so (capi/install.sh) or target/release/libplywave_capi.so")
LIBRARY, NAMES = c.CDLL(sys.argv[1]), sys.argv[2:] or ["polyester", "cotton"]
if LIBRARY.plywave_abi_version() != constant("ABI_VERSION"):
    sys.exit(f"{sys.argv[1]}: not of the header's version; build it from this tree")
LIBRARY.plywave_version.restype = c.c_char_p


def must(function, *args):
    error = Error()
    if function(*args, c.byref(error)) != 0:
        raise ValueError(error.message.decode())


def floats(values):
    return np.ascontiguousarray(values, np.float32)


def pointer(array):
    return array.ctypes.data_as(c.c_void_p)


FIBER = """name = 'kit'
[filament]
kind = 'dielectric'
radius_um = {radius}
eta = {eta}
beta_m = [{beta_m}, {beta_m}, {beta_m}]
beta_n = {beta_n}
orders = 8
"""
NODES, SHARES = np.polynomial.legendre.leggauss(96)
OFFSETS, SHARES = np.sin(0.5 * np.pi * NODES), 0.25 * np.pi * SHARES * np.cos(0.5 * np.pi * NODES)


class FromC:
    def describe(self):
        models = []
        for name in NAMES:
            claims = ["lossless", "circular", "reciprocal", "half_turn", "far_is_mean", "traced"]
            model = dict(name=name, kind="ply", fields=["near", "far"], claims=claims, truth=name, accuracy={"reciprocal": 0.05})
            models.append({**model, "parameters": {"sigma_per_um": [0.0, 0.05, 0.0]}})
        width = [0.1, 1.0, 0.3]
        fiber = dict(name="dielectric", kind="fiber", fields=["near", "far"], claims=["lossless", "smooth_cylinder", "circular", "far_is_mean"])
        models.append({**fiber, "parameters": {"eta": [1.1, 2.0, 1.55], "tau": [0.0, 5.0, 0.0], "beta_m": width, "beta_n": width}})
        return {"protocol": 1, "name": "plywave, C", "version": LIBRARY.plywave_version().decode(), "models": models}

    @functools.lru_cache(maxsize=None)
    def ply(self, name):
        handle, info = c.c_void_p(), PlyInfo()
        must(LIBRARY.plywave_ply_load, str(ROOT / f"fabrics/models/{name}.pwm").encode(), c.byref(handle))
        must(LIBRARY.plywave_ply_info, handle, c.byref(info))
        return handle, info.radius_um

    @functools.lru_cache(maxsize=256)
    def fiber(self, parameters):
        text, handle = FIBER.format(radius=RADIUS_UM, **dict(parameters)).encode(), c.c_void_p()
        must(LIBRARY.plywave_fiber_from_bytes, text, c.c_size_t(len(text)), b"kit.toml", c.byref(handle))
        return handle

    def queries(self, q):
        """Prepared queries, their shares, and the turn from the kit's azimuths to theirs."""
        p = q["parameters"]
        if q["model"] == "dielectric":
            query, h = FiberQuery(count=1), c.c_float(q["h"])
            query.omega_i[:], query.lambda_um[0], query.sigma_per_um[0] = q["wi"], LAMBDA_UM, p["tau"] / (2.0 * RADIUS_UM)
            if q["field"] == "near":
                query.h_rel = c.addressof(h)
            bsdf = Bsdf()
            must(LIBRARY.plywave_fiber_at, self.fiber(tuple(sorted(p.items()))), c.byref(query), c.byref(bsdf))
            return [bsdf], np.ones(1), 0.0
        ply, radius = self.ply(q["model"])
        found, near = [], q["field"] == "near"
        theta = np.arctan2(q["wi"][2], np.hypot(q["wi"][0], q["wi"][1]))
        if not 0.5 < np.linalg.norm(q["wi"]) < 2.0:
            raise ValueError(f"wi = {q['wi']}: no direction")
        for h in [q["h"]] if near else OFFSETS:
            # The kit's ray meets the ply at the azimuth of wi + asin h: for light from y that is at x = -h.
            query = PlyQuery(theta_i=theta, h_um=-h * radius, count=1, no_edge=1)
            query.sigma_per_um[0], query.lambda_um[0] = p["sigma_per_um"], LAMBDA_UM
            found.append(Bsdf())
            must(LIBRARY.plywave_ply_at, ply, c.byref(query), c.byref(found[-1]))
        return found, np.ones(1) if near else SHARES, 0.5 * np.pi - np.arctan2(q["wi"][1], q["wi"][0])

    def turned(self, w, turn):
        k, s = np.cos(turn), np.sin(turn)
        return np.stack([k * w[:, 0] - s * w[:, 1], s * w[:, 0] + k * w[:, 1], w[:, 2]], axis=1)

    def both(self, q, wo):
        bsdfs, shares, turn = self.queries(q)
        w = floats(self.turned(np.asarray(wo, float), turn))
        f, pdf = np.zeros(len(w), np.float32), np.zeros(len(w), np.float32)
        sums = np.zeros((2, len(w)))
        for bsdf, share in zip(bsdfs, shares):
            must(LIBRARY.plywave_bsdf_eval_batch, c.byref(bsdf), c.c_size_t(len(w)), pointer(w), pointer(f), pointer(pdf))
            sums += share * np.array([f, pdf])
        return sums

    def eval(self, q, wo):
        return self.both(q, wo)[0]

    def pdf(self, q, wo):
        return self.both(q, wo)[1]

    def straight(self, q):
        bsdfs, shares, _ = self.queries(q)
        total, one = 0.0, c.c_float()
        for bsdf, share in zip(bsdfs, shares):
            must(LIBRARY.plywave_bsdf_straight, c.byref(bsdf), c.byref(one))
            total += share * one.value
        return total

    def sample(self, q, u):
        bsdfs, shares, turn = self.queries(q)
        edges = np.concatenate([[0.0], np.cumsum(shares)])
        chosen = np.minimum(np.searchsorted(edges[1:], u[:, 0], side="right"), len(bsdfs) - 1)
        found = np.zeros(len(u), SAMPLE)
        for k, (bsdf, share) in enumerate(zip(bsdfs, shares)):
            of = np.flatnonzero(chosen == k)
            v = u[of].copy()
            v[:, 0] = (v[:, 0] - edges[k]) / share
            v, out = floats(np.clip(v, 0.0, 1.0 - 2.0**-24)), np.zeros(len(of), SAMPLE)
            must(LIBRARY.plywave_bsdf_sample_batch, c.byref(bsdf), c.c_size_t(len(of)), pointer(v), pointer(out))
            found[of] = out
        wo, hit, weight = self.turned(found["w"].astype(float), -turn), found["outcome"] == SCATTERED, found["weight"][:, 0].astype(float)
        straight, pdf = np.where(found["outcome"] == STRAIGHT, weight, 0.0), np.where(hit, found["pdf"], 0.0)
        if len(bsdfs) > 1:
            f, density = self.both(q, wo[hit])
            pdf[hit], weight[hit] = density, f / np.maximum(density, 1e-30)
        return {"wo": wo, "weight": np.where(hit, weight, 0.0), "pdf": pdf, "straight": straight}


if __name__ == "__main__":
    serve(FromC())
