#!/usr/bin/env python3
"""Time of a call of plywave's models and of Mitsuba's `hair` and `principled`, on arrays of the same number of queries.

    python scripts/speed_peers.py                   a table of ns an eval, a pdf and a sample, one thread
    python scripts/speed_peers.py --variant scalar_rgb --queries 4096
    python scripts/speed_peers.py --threads 0       all cores

All models take turns, and the least processor time of each counts. Every query has its own incidence, direction and
random numbers. plywave is its Python package, three wavelengths; `sample` includes weight and pdf on both sides. An LLVM
variant evaluates arrays, compiled at the first call, which does not count; a scalar one is called from Python for each
query, whose own time is taken off. Needs NumPy, plywave and Mitsuba 3 (`pip install mitsuba`), for LLVM its library.
"""
import argparse
import os
import platform
import time
from pathlib import Path

import numpy as np

import plywave

FABRICS = Path(__file__).resolve().parent.parent / "fabrics"
FIBER = """
name = "hair"
lambda_um = [0.61, 0.55, 0.465]
sigma_per_um = [0.001, 0.004, 0.01]
[filament]
kind = "dielectric"
eta = 1.55
radius_um = 20
"""
CALLS = ("eval", "pdf", "sample")
TURNS = 7


def directions(rng, n):
    """Uniform on the sphere."""
    z = rng.uniform(-1.0, 1.0, n)
    phi = rng.uniform(0.0, 2.0 * np.pi, n)
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1).astype(np.float32)


def upper(w):
    """The same directions, above the surface and not in it."""
    w = w.copy()
    w[:, 2] = np.maximum(np.abs(w[:, 2]), 1e-3)
    return w


def ours(n, rng):
    """Calls of plywave's models, by name."""
    w, v, u = directions(rng, n), directions(rng, n), rng.random((n, 3), np.float32)
    sigma = np.array([0.001, 0.004, 0.010], np.float32)
    ply = plywave.load(FABRICS / "models" / "polyester.pwm")
    theta, h = rng.uniform(-1.4, 1.4, n).astype(np.float32), rng.uniform(-65.0, 65.0, n).astype(np.float32)
    fiber, at = plywave.Fiber.from_bytes(FIBER.encode(), "fiber.toml"), [0.61, 0.55, 0.465]
    models = {
        "plywave ply (polyester)": (lambda: ply.eval(theta, h, w, sigma), lambda: ply.pdf(theta, h, w, sigma), lambda: ply.sample(theta, h, u, sigma)),
        "plywave fiber (dielectric)": (lambda: fiber.eval(v, w, at), lambda: fiber.pdf(v, w, at), lambda: fiber.sample(v, u, at)),
    }
    wo, place = upper(v), rng.uniform(0.0, 3e4, (n, 2)).astype(np.float32)
    for name in ("satin", "jersey"):
        cloth = plywave.load(FABRICS / "cloths" / f"{name}.toml")
        models[f"plywave cloth ({name})"] = (
            lambda c=cloth: c.eval(place, wo, w),
            lambda c=cloth: c.pdf(place, wo, w),
            lambda c=cloth: c.sample(place, wo, u),
        )
    return models


def theirs(n, rng, variant, threads):
    """Calls of Mitsuba's models, by name, and the time that calls from Python alone take [s]."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(variant)
    scalar = variant.startswith("scalar")
    if not scalar:
        dr.set_thread_count(threads)
    w, v, u = directions(rng, n), directions(rng, n), rng.random((n, 3), np.float32)
    bsdfs = {
        "Mitsuba hair": ({"type": "hair"}, v, w),
        "Mitsuba principled": ({"type": "principled", "roughness": 0.3, "anisotropic": 0.5, "spec_tint": 0.2}, upper(v), upper(w)),
    }
    models = {}
    for name, (description, wi, wo) in bsdfs.items():
        bsdf, context = mi.load_dict(description), mi.BSDFContext()

        def surface(wi, uv):
            si = dr.zeros(mi.SurfaceInteraction3f)
            si.t, si.wi, si.uv = 1.0, wi, uv
            si.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Vector3f(0, 0, 1))
            si.n = mi.Normal3f(0, 0, 1)
            return si

        if scalar:
            at = [(surface(mi.Vector3f(*a), mi.Point2f(*b[:2])), mi.Vector3f(*c), b) for a, b, c in zip(wi.tolist(), u.tolist(), wo.tolist())]
            points = [mi.Point2f(*b[:2]) for _, _, b in at]
            models[name] = (
                lambda f=bsdf.eval, at=at, c=context: [f(c, si, d) for si, d, _ in at],
                lambda f=bsdf.pdf, at=at, c=context: [f(c, si, d) for si, d, _ in at],
                lambda f=bsdf.sample, at=at, c=context, points=points: [f(c, si, b[2], p) for (si, _, b), p in zip(at, points)],
            )
            continue
        si = surface(mi.Vector3f(wi.T), mi.Point2f(u[:, :2].T))
        d, u1, u2 = mi.Vector3f(wo.T), mi.Float(u[:, 2].copy()), mi.Point2f(u[:, :2].T)
        dr.eval(si, d, u1, u2)

        def run(f, *arguments, si=si, context=context):
            dr.eval(f(context, si, *arguments))
            dr.sync_thread()

        models[name] = (
            lambda b=bsdf, d=d, run=run: run(b.eval, d),
            lambda b=bsdf, d=d, run=run: run(b.pdf, d),
            lambda b=bsdf, u1=u1, u2=u2, run=run: run(b.sample, u1, u2),
        )
    # The binding that does least, as often.
    empty = mi.BSDFContext() if scalar else None
    return models, (lambda: [empty.is_enabled(mi.BSDFFlags.Null) for _ in range(n)]) if scalar else None


def seconds(call):
    begun = time.process_time()
    call()
    return time.process_time() - begun


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba")
    parser.add_argument("--queries", type=int, default=1 << 17)
    parser.add_argument("--threads", type=int, default=1, help="of both; 0: all cores")
    parser.add_argument("--turns", type=int, default=TURNS)
    options = parser.parse_args()
    threads = options.threads or os.cpu_count() or 1
    plywave.set_threads(threads)
    rng = np.random.default_rng(1)
    models = ours(options.queries, rng)
    peers, binding = theirs(options.queries, rng, options.variant, threads)
    models.update(peers)
    least = {}
    for turn in range(options.turns + 1):
        for name, calls in models.items():
            for call, of in zip(CALLS, calls):
                taken = seconds(of)
                # The first turn compiles and loads.
                if turn:
                    least[name, call] = min(taken, least.get((name, call), np.inf))
    off = min(seconds(binding) for _ in range(options.turns)) if binding else 0.0
    import mitsuba as mi

    print(f"plywave {plywave.__version__}, Mitsuba {mi.__version__} ({options.variant}), {platform.machine()}, threads: {threads}, queries: {options.queries}")
    print("\n| ns a query | " + " | ".join(CALLS) + " |\n|---|" + "---|" * len(CALLS))
    for name in models:
        taken_off = off if name.startswith("Mitsuba") else 0.0
        print(f"| {name} | " + " | ".join(f"{1e9 * max(least[name, call] - taken_off, 0.0) / options.queries:.0f}" for call in CALLS) + " |")


if __name__ == "__main__":
    main()
