"""Parts of scripts/gpu_check.sh: checks and times of the Mitsuba plugins in one JIT variant, most of all on a GPU.

    python scripts/gpu_check.py PART [--variant cuda_ad_rgb] [--small] [--out FOLDER]

A case that fails prints one line, and the others go on; the exit status is then 1. Lengths are in um.
"""

import argparse
import os
import pathlib
import platform
import sys
import tempfile
import time

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[1]
FABRICS = ROOT / "fabrics"
#: Cloth specs.
JERSEY, ORGANZA, HOPSACK, SATIN = (str(FABRICS / "cloths" / f"{name}.toml") for name in ("jersey", "organza", "hopsack", "satin"))
PLY = str(FABRICS / "models" / "polyester.pwm")
#: Wavelengths of spectral variants where a case has the same ones for all queries [nm].
LAMBDA_NM = [450.0, 500.0, 550.0, 650.0]
FAILED = []


def say(text):
    print(text, flush=True)


def fail(text):
    FAILED.append(text)
    say(f"FAILED: {text}")


def case(name, call, *args):
    """Runs one case; an error is one line."""
    begun = time.perf_counter()
    try:
        return call(name, *args)
    except Exception as error:
        lines = str(error).split("\n")
        fail(f"{name}: {type(error).__name__}: {' '.join(' '.join(lines).split())[:300]}")
    finally:
        if time.perf_counter() - begun > 20.0:
            say(f"    ({name}: {time.perf_counter() - begun:.0f} s)")
    return None


# Queries


def directions(rng, n):
    v = rng.normal(size=(n, 3))
    return unit(v)


def unit(v):
    return np.ascontiguousarray(v / np.linalg.norm(v, axis=1)[:, None], np.float32)


def is_spectral():
    return "spectral" in mi.variant()


def interaction(n, uv, wi, lambda_nm=None):
    """Hits of a plane whose uv run along x and y."""
    si = dr.zeros(mi.SurfaceInteraction3f, n)
    si.uv, si.wi, si.n = uv, wi, [0, 0, 1]
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.dp_du, si.dp_dv = [1, 0, 0], [0, 1, 0]
    if is_spectral():
        si.wavelengths = LAMBDA_NM if lambda_nm is None else mi.Spectrum(lambda_nm.T.copy())
    return si


def points(values):
    return mi.Point2f(np.ascontiguousarray(values.T, np.float32))


def vectors(values):
    return mi.Vector3f(np.ascontiguousarray(values.T, np.float32))


def arrays(*values):
    """NumPy's arrays, of one kernel."""
    dr.eval(*values)
    return [np.array(v) for v in values]


def wavelengths(rng, n):
    """Wavelengths of n queries [nm], and what the library is given for them [um]: none for linear sRGB."""
    if not is_spectral():
        return None, None
    nm = rng.uniform(400.0, 700.0, (n, 4)).astype(np.float32)
    return nm, nm * np.float32(1e-3)


# Parity with the native library

HEAD = f"{'':46s} {'mean':>9s} {'>1e-4':>9s} {'>1e-3':>9s} {'>1e-2':>9s} {'largest':>9s}"
#: Limits: relative difference of the means, and the share of queries off by more than 1e-2; of cloths more,
#: where what is hit at a rim is a choice.
MEAN_LIMIT, SHARE_LIMIT, CLOTH_LIMIT = 5e-4, 2e-3, 1e-2


def compare(name, got, want, floor=1e-3, share_limit=SHARE_LIMIT):
    """Relative differences, values below ``floor`` counting as ``floor``; got and want are [n] or [n, channels]."""
    got, want = np.asarray(got), np.asarray(want)
    if got.shape != want.shape:
        got = np.broadcast_to(got, want.shape)
    bad = int((~np.isfinite(got)).sum())
    error = np.abs(got.astype(np.float64) - want) / np.maximum(np.abs(want), floor)
    error = np.where(np.isfinite(error), error, np.inf)
    total = want.mean(dtype=np.float64)
    mean = abs(got.mean(dtype=np.float64) / total - 1.0) if total else float(np.abs(got).mean())
    shares = [float((error > t).mean()) for t in (1e-4, 1e-3, 1e-2)]
    say(f"{name:46s} {mean:9.1e} " + " ".join(f"{s:9.1e}" for s in shares) + f" {error.max():9.1e}")
    if bad or not mean < MEAN_LIMIT or shares[2] > share_limit:
        fail(f"{name}: {bad} values not finite, means differ by {mean:.1e}, {shares[2]:.1e} of the values by more than 1e-2")


def parity_ply(name, model, n):
    """``plywave_ply`` against ``Model.eval_pdf``; a quarter of the directions are about the edge's light."""
    rng = np.random.default_rng(1)
    channels = 4 if is_spectral() else 3
    nm, um = wavelengths(rng, n)
    sigma = 0.003 if is_spectral() else [0.001, 0.004, 0.010]
    texture = sigma if is_spectral() else {"type": "rgb", "value": sigma}
    filename = str(FABRICS / "models" / f"{model}.pwm")
    bsdf = mi.load_dict({"type": "plywave_ply", "filename": filename, "sigma_per_um": texture})
    wi, wo, k = directions(rng, n), directions(rng, n), n // 4
    wi[:, 2] = np.abs(wi[:, 2])
    wo[:k] = unit(-wi[:k] + 0.03 * rng.normal(size=(k, 3)))
    # The frame of the ply about v: x across it and across the light, z along it.
    w = wi.astype(np.float64)
    across = np.hypot(w[:, 0], w[:, 2])
    x = np.stack([-w[:, 2] / across, np.zeros(n), w[:, 0] / across], 1)
    z = np.array([0.0, 1.0, 0.0])
    theta, h = np.arctan2(w[:, 1], across), x[:, 2] * 0.99999 * bsdf.radius
    v = np.stack([(x * wo).sum(1), (np.cross(z, x) * wo).sum(1), wo[:, 1]], 1)
    v /= np.linalg.norm(v, axis=1)[:, None]
    want, density = plywave.Model(filename).eval_pdf(theta, h, v, np.broadcast_to(np.float64(sigma), channels), um)
    si = interaction(n, mi.Point2f(0.0), vectors(wi), nm)
    f, pdf = arrays(*bsdf.eval_pdf(mi.BSDFContext(), si, vectors(wo)))
    compare(f"{name}: f", f.T, want)
    compare(f"{name}: density", pdf, density)


def parity_cloth(name, spec, options, n):
    """``plywave_cloth`` against ``Cloth.eval_pdf``; of diffracted gaps half of the directions are about forward."""
    rng = np.random.default_rng(3)
    nm, um = wavelengths(rng, n)
    cloth = plywave.Cloth(spec, **options)
    bsdf = mi.load_dict({"type": "plywave_cloth", "filename": spec, "um_per_uv": 1.0, **options})
    position = rng.uniform(-3000, 3000, (n, 2)).astype(np.float32)
    wi, wo = directions(rng, n), directions(rng, n)
    if options["gaps"] == "diffracted":
        wo[: n // 2] = unit(-wi[: n // 2] + 0.04 * rng.normal(size=(n // 2, 3)))
    # The library's wo is the side of the viewer, which Mitsuba calls wi.
    want, density = cloth.eval_pdf(position, wi, wo, um)
    straight = cloth.straight(position, wi, um)
    si = interaction(n, points(position), vectors(wi), nm)
    f, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, vectors(wo))
    f, pdf, passes = arrays(f, pdf, bsdf.eval_null_transmission(si))
    compare(f"{name}: f", f.T, want, share_limit=CLOTH_LIMIT)
    compare(f"{name}: density", pdf, density, share_limit=CLOTH_LIMIT)
    compare(f"{name}: straight light", passes.T, straight)


def fiber_table(symmetry, shape, folder, beta=0.15, absorbing=1.0):
    """The file of a made-up fiber, and the fiber in the library: random azimuthal functions with a forward peak, widths and absorption that vary."""
    rng, (l, t, p, d), (folds, mirror) = np.random.default_rng(1), shape, symmetry
    step = 0.0 if folds == 0 else np.pi / (folds * (p - 1)) if mirror is not None else 2 * np.pi / (folds * p)
    width = 1.0 + rng.random(p)
    c_x, absorbed = width * rng.uniform(0.5, 7.5, (l, t, p)), rng.uniform(0.0, 0.9 * absorbing, (l, t, p))
    j = np.arange(d)
    peak = np.exp(-0.5 * ((2 * np.pi * j / d - np.pi) / 0.1) ** 2)
    values = rng.random((l, t, p, d)) + rng.uniform(0, 30, (l, t, p, 1)) * peak
    values[..., j % 40 > 30] = 0.0
    values *= ((1.0 - absorbed) / (values.sum(-1) * 2 * np.pi / d))[..., None]
    tensors = {
        "lambda_um": 0.38 + (np.arange(l) + 0.5) * 0.4 / l,
        "theta_i": 0.5 * np.pi * (np.arange(t) + 0.5) / t,
        "phi_i": (mirror or 0.0) + step * np.arange(p),
        "width_um": width,
        "c_x_um": c_x,
        "c_abs_um": c_x * absorbed,
        "azimuthal": values.astype(np.float32),
    }
    document = {"format": "plywave-fiber", "version": 1, "program_version": "0", "preset": "test", "seed": 1, "spec": "made up"}
    document |= {"source": "wave", "symmetry": {"folds": folds, "mirror_rad": mirror}, "beta_m_rad": beta}
    fiber = plywave.Fiber.from_tensors(tensors, document)
    filename = os.path.join(folder, f"fiber_{folds}_{l}_{t}_{p}_{d}.pwf")
    fiber.save(filename)
    return filename, fiber


#: Symmetries of made-up fibers with the sizes of their tables.
FIBERS = {"round": ((0, None), (3, 6, 1, 100)), "ellipse": ((2, 0.0), (4, 5, 7, 90)), "kidney": ((1, np.pi / 2), (1, 4, 9, 37))}


def parity_fiber(name, kind, beta, n):
    """``plywave_fiber`` against ``Fiber.eval_pdf``; a third of the directions are about forward."""
    rng = np.random.default_rng(11)
    nm, um = wavelengths(rng, n)
    um = np.array([0.612, 0.549, 0.464], np.float32) if um is None else um
    with tempfile.TemporaryDirectory() as folder:
        filename, fiber = fiber_table(*FIBERS[kind], folder, beta)
        bsdf = mi.load_dict({"type": "plywave_fiber", "filename": filename, "width": "curve"})
    uv = rng.random((n, 2), dtype=np.float32)
    wi, wo, k = directions(rng, n), directions(rng, n), n // 3
    wi[:, 2] = np.abs(wi[:, 2])
    wo[:k] = unit(-wi[:k] + 0.5 * beta * rng.normal(size=(k, 3)))
    # The fiber runs along y; the normal has the azimuth 2 pi u in the outline.
    turn = 2 * np.pi * uv[:, 0].astype(np.float64)
    c, s = np.cos(turn), np.sin(turn)
    to = lambda w: np.stack([c * w[:, 2] - s * w[:, 0], s * w[:, 2] + c * w[:, 0], w[:, 1]], 1)
    want, density = fiber.eval_pdf(to(wi), to(wo), um)
    si = interaction(n, points(uv), vectors(wi), nm)
    f, pdf = arrays(*bsdf.eval_pdf(mi.BSDFContext(), si, vectors(wo)))
    compare(f"{name}: f", f.T, want)
    compare(f"{name}: density", pdf, density)


def head(n):
    say(f"{n} queries; relative differences, values below 1e-3 counting as 1e-3; shares of values beyond a difference")
    say(HEAD)


def queries(args):
    return 20_000 if args.small else 1_000_000


def parity_plies(args):
    head(n := queries(args))
    for model in ("polyester",) if args.small else ("polyester", "cotton", "silk", "cotton_2ply"):
        case(f"ply {model}", parity_ply, model, n)


def parity_cloths(args):
    head(n := queries(args))
    straight, diffracted = {"gaps": "straight"}, {"gaps": "diffracted"}
    case("jersey", parity_cloth, JERSEY, straight, n)
    if not args.small:
        case("jersey, no edges", parity_cloth, JERSEY, {**straight, "edges": False}, n)
        plain = {**straight, "edges": False, "layers": False, "shadowing": False}
        case("the same, no layers, no shadows", parity_cloth, JERSEY, plain, n)
        case("organza, gaps diffracted", parity_cloth, ORGANZA, diffracted, n)
        case("hopsack, two plies", parity_cloth, HOPSACK, straight, n)
        case("satin, seven bundles", parity_cloth, SATIN, straight, n)


def parity_fibers(args):
    head(n := queries(args))
    for kind, beta in (("round", 0.15),) if args.small else (("round", 0.15), ("ellipse", 0.15), ("kidney", 1.2)):
        case(f"fiber {kind}, beta {beta}", parity_fiber, kind, beta, n)


# Samples


def variable(w):
    """A direction in memory: as a constant, each direction would have its own kernel."""
    w = mi.Vector3f(*(float(x) for x in np.array(w) / np.linalg.norm(w)))
    dr.make_opaque(w)
    return w


def chi_square(name, bsdf, uv, wi, small, tests):
    """Mitsuba's chi-square test of the directions of one incidence, as in python/tests/test_mitsuba.py."""
    from mitsuba.chi2 import ChiSquareTest, SphericalDomain

    context, wi, null = mi.BSDFContext(), variable(wi), int(mi.BSDFFlags.Null)

    def sample(u, *_):
        bs, _ = bsdf.sample(context, interaction(dr.width(u), mi.Point2f(*uv), wi), u.x, mi.Point2f(u.y, u.z))
        return bs.wo, dr.select((bs.pdf > 0) & (bs.sampled_type != null), 1.0, 0.0)

    def pdf(wo, *_):
        return bsdf.pdf(context, interaction(dr.width(wo), mi.Point2f(*uv), wi), wo)

    counts = {"sample_count": 50_000, "res": 51, "ires": 16} if small else {"sample_count": 500_000, "res": 101, "ires": 24}
    test = ChiSquareTest(SphericalDomain(), sample, pdf, sample_dim=3, **counts)
    accepted = test.run(0.01 / tests, quiet=True)
    sums = f"samples {test.histogram_sum[0]:.5f}, density {test.pdf_sum[0]:.5f}"
    say(f"chi-square {name}: p = {test.p_value or 0.0:.4f}, sums: {sums}: {'accepted' if accepted else 'REJECTED'}")
    if accepted and not test.histogram_sum[0] > 0.01:
        fail(f"chi-square {name}: no samples: nothing was tested")
    if not accepted:
        fail(f"chi-square {name}: {test.messages.strip().splitlines()[-1]}")


def weights_of(name, bsdf, extent, n):
    """Weight times density is f, and the density of a sample is that of its direction."""
    rng, context = np.random.default_rng(4), mi.BSDFContext()
    wi = directions(rng, n)
    if not extent:
        wi[:, 2] = np.abs(wi[:, 2])
    uv = rng.uniform(-extent, extent, (n, 2)) if extent else rng.random((n, 2))
    si = interaction(n, points(uv), vectors(wi))
    u = rng.random((n, 3), dtype=np.float32)
    bs, weight = bsdf.sample(context, si, mi.Float(u[:, 0].copy()), points(u[:, 1:]))
    wo, weight, of_sample, sampled = arrays(bs.wo, weight, bs.pdf, bs.sampled_type)
    f, pdf = arrays(*bsdf.eval_pdf(context, si, mi.Vector3f(wo)))
    scattered = np.broadcast_to(sampled != int(mi.BSDFFlags.Null), n) & (of_sample > 0)
    compare(f"{name}: density of samples", of_sample[scattered], pdf[scattered])
    compare(f"{name}: weight x density", (weight * of_sample)[:, scattered], f[:, scattered])


def sampled_kinds(args, folder):
    """By name a BSDF, a point in uv, and how far around points are drawn [um]; 0 where uv are those of a curve."""
    cloth = {"type": "plywave_cloth", "um_per_uv": 1.0}
    fiber = {"type": "plywave_fiber", "rotation_deg": 20.0}
    round_one, kidney = (fiber_table(*FIBERS[kind], folder, 0.25)[0] for kind in ("round", "kidney"))
    kinds = {
        "ply": ({"type": "plywave_ply", "filename": PLY, "sigma_per_um": 0.003}, (0.0, 0.0), 0.0),
        "cloth": ({**cloth, "filename": JERSEY}, (60.0, 33.0), 500.0),
        "fiber": ({**fiber, "filename": kidney, "width": "wave"}, (0.3, 0.7), 0.0),
        "gap": ({**cloth, "filename": ORGANZA}, (0.0, 0.0), 500.0),
        "round fiber": ({**fiber, "filename": round_one, "width": "curve"}, (0.3, 0.7), 0.0),
    }
    made = {}
    for name in ("ply", "cloth") if args.small else kinds:
        keys, uv, extent = kinds[name]
        loaded = case(name, lambda _, keys: mi.load_dict(keys), keys)
        if loaded is not None:
            made[name] = (loaded, uv, extent)
    return made


def samples(args):
    incidences = [(0.3, 0.2, 0.9), (0.8, 0.1, 0.2)][: 1 if args.small else 2]
    with tempfile.TemporaryDirectory() as folder:
        made = sampled_kinds(args, folder)
    for name, (bsdf, uv, _) in made.items():
        for wi in incidences:
            # From the flatter direction, light at that point passes beside the fiber.
            wi = (0.1, 0.8, 0.5) if "fiber" in name and wi[0] > 0.5 else wi
            case(f"{name}, from {wi}", chi_square, bsdf, uv, wi, args.small, len(made) * len(incidences))


def weights(args):
    head(n := 20_000 if args.small else 400_000)
    with tempfile.TemporaryDirectory() as folder:
        made = sampled_kinds(args, folder)
    for name, (bsdf, _, extent) in made.items():
        case(name, weights_of, bsdf, extent, n)


# Gradients


def gradient(name, keys, key, extent, n):
    """Of the mean of f by an absorption, against central differences, to 1 %."""
    rng, context, sigma, step = np.random.default_rng(6), mi.BSDFContext(), 0.004, 2e-4
    bsdf = mi.load_dict({**keys, key: sigma})
    params, key = mi.traverse(bsdf), f"{key}.value"
    wi = directions(rng, n)
    wi[:, 2] = np.abs(wi[:, 2])
    uv = rng.uniform(-extent, extent, (n, 2)) if extent else rng.random((n, 2))
    si, wo = interaction(n, points(uv), vectors(wi)), vectors(directions(rng, n))

    def mean(value):
        params[key] = mi.Float(value)
        params.update()
        return arrays(bsdf.eval(context, si, wo))[0].mean(dtype=np.float64)

    want = (mean(sigma + step) - mean(sigma - step)) / (2 * step)
    params[key] = mi.Float(sigma)
    dr.enable_grad(params[key])
    params.update()
    dr.backward(dr.mean(bsdf.eval(context, si, wo), axis=None))
    got = float(np.array(dr.grad(params[key])).ravel()[0])
    say(f"gradient of {name} by {key}: {got:.5g}, by differences {want:.5g}: {abs(got / want - 1.0):.1e} off")
    if not abs(got / want - 1.0) < 1e-2:
        fail(f"gradient of {name}: {got}, by differences {want}")


def picture_gradient(name):
    """Of the mean of a rendered picture of a jersey by its absorption, against central differences, to 1 %."""
    sensor = {"type": "perspective", "fov": 30, "to_world": mi.ScalarTransform4f().look_at([0, -1.2, 2.2], [0, 0, 0], [0, 0, 1])}
    sensor["film"] = {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}}
    lamp = {"type": "point", "position": [1, 1, 2], "intensity": 3.0}
    key, sigma, step = "cloth.bsdf.sigma_per_um.value", 0.004, 2e-4
    cloth = {"type": "plywave_cloth", "filename": JERSEY, "um_per_uv": 2e4, "gaps": "straight", "sigma_per_um": sigma}
    scene = {"type": "scene", "integrator": {"type": "direct"}, "sensor": sensor, "lamp": lamp}
    scene["cloth"] = {"type": "rectangle", "bsdf": cloth}
    scene = mi.load_dict(scene)
    params = mi.traverse(scene)

    def mean(value):
        params[key] = mi.Float(value)
        params.update()
        return np.array(mi.render(scene, spp=16)).mean(dtype=np.float64)

    want = (mean(sigma + step) - mean(sigma - step)) / (2 * step)
    params[key] = mi.Float(sigma)
    dr.enable_grad(params[key])
    params.update()
    # Dr.Jit warns of every loop within a call.
    dr.set_log_level(dr.LogLevel.Error)
    dr.backward(dr.mean(mi.render(scene, params, spp=16), axis=None))
    got = float(np.array(dr.grad(params[key])).ravel()[0])
    say(f"gradient of {name} by {key}: {got:.5g}, by differences {want:.5g}: {abs(got / want - 1.0):.1e} off")
    if not abs(got / want - 1.0) < 1e-2:
        fail(f"gradient of {name}: {got}, by differences {want}")


def gradients(args):
    n = 5_000 if args.small else 200_000
    case("ply", gradient, {"type": "plywave_ply", "filename": PLY}, "sigma_per_um", 0.0, n)
    if not args.small:
        jersey = {"type": "plywave_cloth", "filename": JERSEY, "um_per_uv": 1.0, "gaps": "straight"}
        case("cloth", gradient, jersey, "sigma_per_um", 3000.0, n)
        case("a picture", picture_gradient)


# Throughput


class Kernels:
    """Times of the kernels that run within the block, from Dr.Jit's history [s]."""

    def __enter__(self):
        dr.sync_thread()
        dr.kernel_history_clear()
        dr.set_flag(dr.JitFlag.KernelHistory, True)
        self.begun = time.perf_counter()
        return self

    def __exit__(self, *_):
        dr.sync_thread()
        self.wall = time.perf_counter() - self.begun
        history = dr.kernel_history()
        dr.set_flag(dr.JitFlag.KernelHistory, False)
        self.run = sum(k.get("execution_time", 0.0) for k in history) * 1e-3
        made = [k for k in history if "codegen_time" in k]
        compiled = [k for k in made if not k.get("cache_hit")]
        self.compile = sum(k.get("codegen_time", 0.0) + k.get("backend_time", 0.0) for k in compiled) * 1e-3
        self.from_disk = sum(bool(k.get("cache_disk")) for k in compiled)


def inputs(n, is_curve, is_opaque):
    """Random queries, made within the kernel: uv, directions of viewer and light, numbers of a sample."""
    index, count = dr.arange(mi.UInt32, n), [0]

    def number():
        count[0] += 1
        x = index * mi.UInt32(0x9E3779B9) + mi.UInt32(0x85EBCA6B * count[0] & 0xFFFFFFFF)
        for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
            x = (x ^ (x >> shift)) * mi.UInt32(factor)
        return mi.Float((x ^ (x >> 16)) >> 8) * (1.0 / (1 << 24))

    uv, viewer, light, second = (mi.Point2f(number(), number()) for _ in range(4))
    wo = mi.warp.square_to_uniform_hemisphere(light) if is_opaque else mi.warp.square_to_uniform_sphere(light)
    return uv if is_curve else 6000.0 * uv - 3000.0, mi.warp.square_to_uniform_hemisphere(viewer), wo, number(), second


def throughput(name, keys, is_curve, is_opaque, n, repeats):
    """A kernel makes queries, answers them and writes one number each, so memory does not limit it."""
    bsdf, context = mi.load_dict(keys) if keys else None, mi.BSDFContext()
    total = lambda *values: dr.eval(sum(sum(v) if dr.depth_v(v) > 1 else mi.Float(v) for v in values))

    def evaluated():
        uv, wi, wo, _, _ = inputs(n, is_curve, is_opaque)
        total(uv, wi, wo) if bsdf is None else total(*bsdf.eval_pdf(context, interaction(n, uv, wi), wo))

    def sampled():
        uv, wi, _, first, second = inputs(n, is_curve, is_opaque)
        if bsdf is None:
            return total(uv, wi, first, second)
        bs, weight = bsdf.sample(context, interaction(n, uv, wi), first, second)
        return total(bs.wo, bs.pdf, bs.sampled_type, weight)

    row = []
    for call in (evaluated, sampled):
        with Kernels() as cold:
            call()
        runs = []
        for _ in range(repeats):
            with Kernels() as warm:
                call()
            runs.append((warm.run or warm.wall, warm.wall))
        run, wall = (min(x) for x in zip(*runs))
        row.append((1e-6 * n / run, cold.compile, wall - run, cold.from_disk))
    text = " ".join(f"{rate:10.1f} {compiled:9.2f} {host:9.3f}" for rate, compiled, host, _ in row)
    say(f"{name:36s} {text}" + ("  (compiled kernels found on disk)" if any(r[3] for r in row) else ""))


def native_rate(name, n):
    """The native library on all threads of the processor, jersey."""
    rng, cloth = np.random.default_rng(3), plywave.Cloth(JERSEY)
    position = rng.uniform(-3000, 3000, (n, 2)).astype(np.float32)
    wi, wo, u = directions(rng, n), directions(rng, n), rng.random((n, 3), dtype=np.float32)
    wi[:, 2] = np.abs(wi[:, 2])
    um = np.array(LAMBDA_NM) * 1e-3 if is_spectral() else None
    rates = []
    for call in (lambda: cloth.eval_pdf(position, wi, wo, um), lambda: cloth.sample(position, wi, u, um)):
        times = []
        for _ in range(3):
            begun = time.perf_counter()
            call()
            times.append(time.perf_counter() - begun)
        rates.append(1e-6 * n / min(times))
    say(f"{name:36s} {rates[0]:10.1f} {'':19s} {rates[1]:10.1f}   ({os.cpu_count()} threads)")


def speed(args):
    many, few, repeats = (1 << 16, 1 << 14, 2) if args.small else (1 << 28, 1 << 24, 3)
    cloth = {"type": "plywave_cloth", "um_per_uv": 1.0}
    say(f"{many} random queries, {few} of cloth, wi above the surface, wo all around, for principled above")
    say("millions a second by the time of the kernel; seconds of compilation; seconds of tracing and launch a call")
    say(f"{'':36s} {'eval_pdf':>10s} {'compile':>9s} {'host':>9s} {'sample':>10s} {'compile':>9s} {'host':>9s}")
    principled = {"type": "principled", "roughness": 0.3, "anisotropic": 0.5, "spec_tint": 0.2}
    case("native library, jersey", native_rate, queries(args))
    with tempfile.TemporaryDirectory() as folder:
        table = fiber_table(*FIBERS["ellipse"], folder)[0]
        rows = [
            ("queries alone", None, True, False, many),
            ("principled", principled, True, True, many),
            ("hair", {"type": "hair"}, True, False, many),
            ("plywave_ply", {"type": "plywave_ply", "filename": PLY, "sigma_per_um": 0.003}, True, False, many),
            ("plywave_cloth jersey", {**cloth, "filename": JERSEY}, False, False, few),
            ("plywave_fiber", {"type": "plywave_fiber", "filename": table}, True, False, many),
            ("plywave_cloth jersey, gaps straight", {**cloth, "filename": JERSEY, "gaps": "straight"}, False, False, few),
            ("plywave_cloth satin", {**cloth, "filename": SATIN}, False, False, few),
            ("plywave_cloth organza", {**cloth, "filename": ORGANZA}, False, False, few),
        ]
        for name, keys, is_curve, is_opaque, n in rows[:6] if args.small or is_spectral() else rows:
            case(name, throughput, keys, is_curve, is_opaque, n, repeats)


# Scenes


def probe(args):
    """Whether rays can be traced: OptiX in CUDA variants."""
    sphere = mi.load_dict({"type": "scene", "sphere": {"type": "sphere"}})
    hit = sphere.ray_intersect(mi.Ray3f(mi.Point3f(dr.opaque(mi.Float, 0.0), 0.0, -3.0), mi.Vector3f(0.0, 0.0, 1.0)))
    t = float(np.array(hit.t).ravel()[0])
    say(f"a ray meets a sphere at {t:.4f}, want 2")
    if not abs(t - 2.0) < 1e-3:
        fail("probe: the ray misses")


def examples():
    sys.path.insert(0, str(ROOT / "examples" / "mitsuba"))


def mesh(args):
    """The sheet of the drape, which takes a while, as points in a file."""
    examples()
    import drape

    np.save(args.mesh, drape.fallen(16) if args.small else drape.fallen())


def drape_scene(size, cloth=None, mesh=None):
    """The scene of examples/mitsuba/render.py, with another cloth where one is given."""
    examples()
    import drape
    import render

    if mesh and os.path.exists(mesh):
        drape.fallen = lambda *_: np.load(mesh)
    with tempfile.TemporaryDirectory() as folder:
        keys = render.satin_drape(size, pathlib.Path(folder))
        if cloth is not None:
            keys["cloth"]["bsdf"] = cloth
        return mi.load_dict(keys)


def rendered(name, scene, width, height, spp, path):
    """Renders in as few passes as memory allows; a pass that is not counted compiles the kernels."""
    passes = 1
    while True:
        try:
            with Kernels() as cold:
                dr.eval(mi.render(scene, spp=spp // passes, seed=1000))
            image, run, wall = 0.0, 0.0, 0.0
            for seed in range(passes):
                with Kernels() as warm:
                    picture = mi.render(scene, spp=spp // passes, seed=seed)
                    dr.eval(picture)
                run, wall = run + warm.run, wall + warm.wall
                image = image + np.array(picture, dtype=np.float64) / passes
            break
        except Exception as error:
            say(f"    {name}: {passes} passes: {' '.join(str(error).split())[:300]}")
            if passes >= 64 or spp // passes < 2:
                raise
            passes *= 4
            dr.flush_malloc_cache()
    paths = width * height * spp
    say(
        f"{name}: {width} x {height}, {spp} samples in {passes} passes: {wall:.2f} s, of these {run:.2f} s of kernels, "
        f"{1e-6 * paths / wall:.1f} million paths a second; a first pass, with compilation, {cold.wall - wall / passes:.1f} s more; "
        f"mean {' '.join(f'{x:.4f}' for x in image.mean((0, 1)))}"
    )
    if not np.isfinite(image).all():
        fail(f"{name}: {int((~np.isfinite(image)).any(-1).sum())} pixels are not finite")
    mi.util.write_bitmap(path, mi.TensorXf(image.astype(np.float32)), write_async=False)
    say(f"    {path}")


def line(folder):
    """A curve along y, of radius 0.5."""
    path = os.path.join(folder, "line.txt")
    pathlib.Path(path).write_text("".join(f"0 {y} 0 0.5\n" for y in np.linspace(-4, 4, 9)))
    return {"type": "bsplinecurve", "filename": path}


def frame_of_curves(name, curve):
    """The second axis of the shading frame runs along the curve; the normal has the azimuth 2 pi u."""
    scene, rng, n = mi.load_dict({"type": "scene", "curve": curve}), np.random.default_rng(8), 5000
    a = rng.uniform(0, 2 * np.pi, n)
    o = np.stack([2 * np.cos(a), rng.uniform(-2, 2, n), 2 * np.sin(a)], 1)
    d = np.stack([-np.cos(a + 0.1), np.zeros(n), -np.sin(a + 0.1)], 1)
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(vectors(o)), vectors(d)))
    valid, along, normal, u = arrays(si.is_valid(), si.sh_frame.t, si.n, si.uv.x)
    sign = np.sign(along[1].mean())
    off = (u - np.arctan2(normal[0], normal[2]) * sign / (2 * np.pi)) % 1.0
    off = np.abs((off - off[0] + 0.5) % 1.0 - 0.5).max()
    tilt = np.abs(along[1] * sign - 1.0).max()
    say(f"{name}: {valid.mean():.3f} of the rays hit, axis {tilt:.1e} off, azimuth {off:.1e} turns off")
    if not (valid.all() and tilt < 1e-3 and off < 1e-3):
        fail(name)


def furnace(name, curve, bsdf, limit):
    """A curve that absorbs nothing cannot be seen under even light."""
    sensor = {"type": "perspective", "fov": 12, "to_world": mi.ScalarTransform4f().look_at([0, 0, 6], [0, 0, 0], [0, 1, 0])}
    sensor["film"] = {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}}
    integrator = {"type": "path", "max_depth": 16}
    sky = {"type": "constant", "radiance": 1.0}
    scene = {"type": "scene", "integrator": integrator, "sensor": sensor, "sky": sky, "curve": curve | {"bsdf": bsdf}}
    image = np.array(mi.render(mi.load_dict(scene), spp=1024))
    # In spectral variants an even spectrum is not white: the channels are compared with those of the sky.
    scene.pop("curve")
    of_sky = np.array(mi.render(mi.load_dict(scene), spp=1024)).mean((0, 1), dtype=np.float64)
    mean = float((image.mean((0, 1), dtype=np.float64) / of_sky).mean())
    say(f"{name}: {mean:.4f} of the sky's brightness")
    if not abs(mean - 1.0) < limit:
        fail(f"{name}: {mean}, want 1 to {limit}")


def curves(args):
    with tempfile.TemporaryDirectory() as folder:
        curve, table = line(folder), fiber_table(*FIBERS["round"], folder, absorbing=0.0)[0]
        case("frame of a bsplinecurve", frame_of_curves, curve)
        for width in ("wave", "curve"):
            bsdf = {"type": "plywave_fiber", "filename": table, "width": width}
            case(f"furnace of a fiber on a curve, width {width}", furnace, curve, bsdf, 0.01)
        # CUDA variants of Mitsuba 3.9.1 fail here by 1 %: `ray_test` stops rays that start within a curve and
        # run nearly along it, and `ray_intersect` does not.
        bsdf = {"type": "plywave_ply", "filename": PLY, "sigma_per_um": 0.0}
        case("furnace of a ply on a curve", furnace, curve, bsdf, 0.01)


def drape(args):
    width, height, spp = (64, 40, 4) if args.small else (1280, 800, 256)
    name = f"satin drape, {args.variant}"
    path = lambda kind: os.path.join(args.out, f"drape_{kind}_{args.variant}.png")

    def one(name, cloth, kind):
        rendered(name, drape_scene((width, height, spp), cloth, args.mesh), width, height, spp, path(kind))

    case(name, one, None, "satin")
    if not args.small:
        principled = {"type": "principled", "base_color": {"type": "rgb", "value": [0.4, 0.03, 0.04]}, "roughness": 0.3, "anisotropic": 0.5}
        case(f"the same with principled, {args.variant}", one, principled, "principled")


def versions(args):
    say(f"Python {platform.python_version()}, NumPy {np.__version__}, Mitsuba {mi.__version__}, Dr.Jit {dr.__version__}, plywave {plywave.__version__}")


PARTS = (versions, probe, mesh, parity_plies, parity_cloths, parity_fibers, samples, weights, gradients, curves, speed, drape)
PARTS = {f.__name__: f for f in PARTS}


def main():
    global dr, mi, plywave
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--variant", default="cuda_ad_rgb")
    parser.add_argument("--small", action="store_true", help="few queries and cases, for a dry run on a CPU")
    parser.add_argument("--out", default=".", help="folder of the pictures")
    parser.add_argument("--mesh", default="", help="file of the sheet of the drape (part mesh makes it)")
    args = parser.parse_args()
    # Each cloth is made once for all parts.
    os.environ.setdefault("PLYWAVE_CACHE", os.path.join(os.path.abspath(args.out), "cloths"))
    if args.part != "mesh":
        import drjit as dr
        import mitsuba as mi

        import plywave

        if args.part != "versions":
            mi.set_variant(args.variant)
            import plywave.mitsuba  # noqa: F401
    PARTS[args.part](args)
    if FAILED:
        say(f"{args.part}, {args.variant}: {len(FAILED)} failed")
    sys.exit(bool(FAILED))


if __name__ == "__main__":
    main()
