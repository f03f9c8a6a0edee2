"""Plies and fibers of plywave.mitsuba against the Rust library, term by term, and against what every BSDF must be; cloths are in test_mitsuba_cloth.py.

Chain of trust: the library is held to its reference implementation and to chi-square tests by its own tests; here the Dr.Jit form is held to the library at 10^5 random
queries a term, then to Mitsuba's own tests: chi-square, weight times pdf, a white furnace, gradients against differences.

    DRJIT_LIBLLVM_PATH=/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1 pytest python/tests/test_mitsuba.py
"""

import functools
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba")
dr = pytest.importorskip("drjit")

FABRICS = pathlib.Path(__file__).resolve().parents[2] / "fabrics"
PLY = str(FABRICS / "models" / "polyester.pwm")
QUERIES = 100_000
RGB_LAMBDA_UM = [0.612, 0.549, 0.464]

mi.set_variant("llvm_ad_rgb")
import plywave  # noqa: E402
import plywave.mitsuba  # noqa: E402  (registers the plugins)
from plywave.mitsuba import _native  # noqa: E402


@pytest.fixture(autouse=True)
def _variant():
    mi.set_variant("llvm_ad_rgb")


def directions(rng, n):
    v = rng.normal(size=(n, 3))
    return np.ascontiguousarray(v / np.linalg.norm(v, axis=1)[:, None], np.float32)


def interaction(n, uv, wi):
    """Hits of a plane whose uv run along x and y."""
    si = dr.zeros(mi.SurfaceInteraction3f, n) if "llvm" in mi.variant() else dr.zeros(mi.SurfaceInteraction3f)
    si.uv, si.wi, si.n = uv, wi, [0, 0, 1]
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.dp_du, si.dp_dv = [1, 0, 0], [0, 1, 0]
    if "spectral" in mi.variant():
        si.wavelengths = [450, 500, 550, 650]
    return si


def variable(w):
    """A direction that kernels read: as a constant in them, each direction has its own to be compiled."""
    w = mi.Vector3f(*(float(x) for x in np.array(w) / np.linalg.norm(w)))
    dr.make_opaque(w)
    return w


def arrays(*values):
    """Results as NumPy's, of one kernel: each by itself would have its own to be compiled."""
    dr.eval(*values)
    return [np.array(v) for v in values]


def close(name, got, want, floor=1e-3, tolerance=1e-4, share=0.0):
    """Relative difference, ``floor`` counting as the least value, beyond the tolerance at ``share`` of the queries at most."""
    error = np.abs(got - want) / np.maximum(np.abs(want), floor)
    beyond = float((error > tolerance).mean())
    assert beyond <= share, f"{name}: {beyond} of the queries are off by more than {tolerance}: worst {error.max()}"


FOLDER = tempfile.TemporaryDirectory()


@functools.cache
def cones(sharp):
    """The file of a model of cones: polyester's weights, ln mu2 by ``sharp`` more than its lobes'."""
    tensors, rng = plywave.Model(PLY).tensors(), np.random.default_rng(41)
    for kind in ("refl", "high"):
        lobes = tensors.pop(kind).copy()
        for k in (0, 2):
            lobes[..., k] = 0.3 * rng.normal(size=lobes.shape[:-1])
        lobes[..., 4] = np.minimum(lobes[..., 4] + sharp, 13.0)
        tensors[f"cone_{kind}"] = lobes
    document = plywave.Model(PLY).document | {"family": "cone"}
    document.pop("reference_values")
    filename = os.path.join(FOLDER.name, f"cones_{sharp:g}.pwm")
    plywave.Model.from_tensors(tensors, document).save(filename)
    return filename


@pytest.fixture(scope="session")
def glass(tiny):
    """The file of a model that the fit made of cones: of smooth parallel fibers."""
    smooth = tiny.replace("alpha_fiber = 0.2", "alpha_fiber = 0.0").replace("theta_o_bins = 12", "theta_o_bins = 36").replace("lobes_high = 2", "lobes_high = 4")
    model = plywave.build(smooth, "preview")
    assert "cone_refl" in model.tensors()
    model.save(os.path.join(FOLDER.name, "glass.pwm"))
    return os.path.join(FOLDER.name, "glass.pwm")


@pytest.mark.slow(5)
@pytest.mark.parametrize("name", ["polyester", "cotton", "silk", "cotton_2ply", 0.0, 5.0, "glass"])
def test_ply_terms_are_the_librarys(name, request):
    """f_refl, f_high, f_edge and the density, a quarter of the directions about the edge lobe, of cones a half about the cone. Where a lobe's tail or the edge's narrow peak
    multiplies the rounding of an angle, both sides of f32 differ by up to 1e-3 at 3e-4 of the queries. A cone is as narrow as 0.001 rad and multiplies that of sin theta_o by
    hundreds: beyond 1e-4 are 3e-3 of the queries of the made-up models and 8e-3 of the smooth fibers', beyond 1e-3 some 3e-4."""
    from plywave.mitsuba._kit import Kit
    from plywave.mitsuba._ply import Plies, read_container

    is_cone = name == "glass" or isinstance(name, float)
    filename = request.getfixturevalue("glass") if name == "glass" else cones(name) if is_cone else str(FABRICS / "models" / f"{name}.pwm")
    rng, n = np.random.default_rng(1), QUERIES
    tensors, _ = read_container(bytes(_native.ply_file(filename)), name)
    h_last = float(tensors["h_um"][-1])
    theta = rng.uniform(-1.5, 1.5, n).astype(np.float32)
    h = rng.uniform(-1.02 * h_last, 1.02 * h_last, n).astype(np.float32)
    sigma = (10.0 ** rng.uniform(-5, -1, (n, 3))).astype(np.float32)
    lam = np.ascontiguousarray(np.broadcast_to(np.float32(RGB_LAMBDA_UM), (n, 3)))
    wo, k = directions(rng, n), n // 4
    wo[:k] = np.stack([0.03 * rng.normal(size=k), -np.cos(theta[:k]), -np.sin(theta[:k])], 1) + 0.02 * rng.normal(size=(k, 3))
    if is_cone:
        latitude, azimuth = (0.2 * rng.normal(size=2 * k) - theta[k : 3 * k]), rng.uniform(0.0, 2.0 * np.pi, 2 * k)
        wo[k : 3 * k] = np.stack([np.cos(latitude) * np.cos(azimuth), np.cos(latitude) * np.sin(azimuth), np.sin(latitude)], 1)
    wo = np.ascontiguousarray(wo / np.linalg.norm(wo, axis=1)[:, None], np.float32)
    refl, high, edge, pdf = _native.ply_terms(filename, theta, h, sigma, lam, wo, True)
    kit = Kit()
    plies = Plies(kit, [tensors])
    t, x, v, s = mi.Float(theta), mi.Float(h), mi.Vector3f(wo.T.copy()), mi.Color3f(sigma.T.copy())
    # Unrolled, kernels of many cones take minutes to compile.
    for unrolled in (False, True) if not isinstance(name, float) else (False,):
        e = plies.energies(0, t, x)
        got_refl, got_high, density = plies.lobes(0, t, x, s, [v.x, v.y, v.z], e, unrolled)
        got_edge, of_edge = plies.edge(0, t, x, RGB_LAMBDA_UM, [v.x, v.y, v.z])
        total = e[1] + kit.mean(plies.high_energy(e[2], plies.transmittances(0, s))) + e[0]
        got = arrays(got_refl, got_high, got_edge * e[0], (density + e[0] * of_edge) / total)
        got = dict(zip(("f_refl", "f_high", "f_edge", "pdf"), (x.T for x in got)))
        share = {"f_refl": 3e-4, "f_high": 1e-4, "pdf": 3e-4} if not is_cone else dict.fromkeys(("f_refl", "f_high", "pdf"), {0.0: 1e-3, 5.0: 3e-3}.get(name, 1e-2))
        for term, want in (("f_refl", refl), ("f_high", high), ("f_edge", edge), ("pdf", pdf)):
            close(term, got[term], want, share=share.get(term, 3e-4))
            assert abs(got[term].mean(dtype=np.float64) / want.mean(dtype=np.float64) - 1.0) < 1e-5, term
        for term, want in (("f_refl", refl), ("f_high", high)):
            close(term, got[term], want, tolerance=1e-3, share=5e-4 if is_cone else 0.0)


def of_kind(kind, **more):
    return mi.load_dict({"type": "plywave_ply", "filename": PLY if kind == "ply" else cones(0.0), "sigma_per_um": 0.003, **more})


def hold_density(bsdf, at, wi, runs):
    """Mitsuba's chi-square test of samples at a place, one of so many tests."""
    from mitsuba.chi2 import ChiSquareTest, SphericalDomain

    context, wi = mi.BSDFContext(), variable(wi)
    null, uv = int(mi.BSDFFlags.Null), mi.Point2f(*at)

    def sample(u, *_):
        bs, _ = bsdf.sample(context, interaction(dr.width(u), uv, wi), u.x, mi.Point2f(u.y, u.z))
        return bs.wo, dr.select((bs.pdf > 0) & (bs.sampled_type != null), 1.0, 0.0)

    def pdf(wo, *_):
        return bsdf.pdf(context, interaction(dr.width(wo), uv, wi), wo)

    test = ChiSquareTest(SphericalDomain(), sample, pdf, sample_dim=3, sample_count=500_000, res=101, ires=24)
    assert test.run(0.01 / runs), test.messages
    # A place where no light is scattered would test nothing.
    assert test.histogram_sum[0] > 0.01, (at, wi)


def hold_weights(bsdf, si, rng):
    """Weight times density is f, and of straight light its energy; the weights, and which samples go straight on."""
    n, context = dr.width(si), mi.BSDFContext()
    u = rng.random((3, n), dtype=np.float32)
    bs, weight = bsdf.sample(context, si, mi.Float(u[0]), mi.Point2f(u[1:]))
    f, pdf = bsdf.eval_pdf(context, si, bs.wo)
    weight, of_sample, sampled, f, pdf, passes = arrays(weight, bs.pdf, bs.sampled_type, f, pdf, bsdf.eval_null_transmission(si))
    straight = np.broadcast_to(sampled == int(mi.BSDFFlags.Null), n)
    close("pdf", of_sample[~straight], pdf[~straight], tolerance=1e-5)
    close("f", (weight * of_sample)[:, ~straight], f[:, ~straight], tolerance=1e-4)
    if straight.any():
        close("straight", (weight * of_sample)[:, straight], np.broadcast_to(passes, (3, n))[:, straight], tolerance=1e-4)
    return weight, straight


@pytest.mark.slow(4)
@pytest.mark.parametrize("kind", ["ply", "cone"])
@pytest.mark.parametrize("wi", [(0.3, 0.2, 0.9), (0.8, 0.1, 0.2)])
def test_samples_have_their_density(kind, wi):
    hold_density(of_kind(kind), (0.0, 0.0), wi, 10)


def places_of_plies(rng, n, size=500.0):
    """Hits of a ply from all directions outside it."""
    wi = directions(rng, n)
    wi[:, 2] = np.abs(wi[:, 2])
    return interaction(n, mi.Point2f(rng.uniform(-size, size, (2, n)).astype(np.float32)), mi.Vector3f(wi.T.copy()))


@pytest.mark.slow(8)
@pytest.mark.parametrize("kind", ["ply", "cone"])
def test_weights_and_white_furnace(kind):
    """Clear fibers under even light are as bright as what is around them."""
    rng = np.random.default_rng(4)
    hold_weights(of_kind(kind), places_of_plies(rng, 20_000), rng)
    weight, _ = hold_weights(of_kind(kind, sigma_per_um=0.0), places_of_plies(rng, 400_000), rng)
    assert abs(weight.mean(dtype=np.float64) - 1.0) < 0.01, weight.mean()


@pytest.mark.parametrize("variant", ["scalar_rgb", "scalar_spectral", "llvm_ad_spectral"])
def test_variants_agree(variant):
    """A variant set after the import has the plugins, and answers as llvm_ad_rgb does where wavelengths do not count."""
    want = {}
    for name in ("llvm_ad_rgb", variant):
        mi.set_variant(name)
        for kind in ("ply", "cone"):
            bsdf = of_kind(kind)
            wi, wo = ([float(x) for x in v / np.linalg.norm(v)] for v in (np.array([0.3, 0.2, 0.9]), np.array([-0.4, 0.5, 0.6])))
            si = interaction(1, mi.Point2f(60.0, 33.0), mi.Vector3f(*wi))
            f, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(*wo))
            got = [float(x.ravel()[0]) for x in arrays(f, pdf)]
            if name == "llvm_ad_rgb":
                want[kind] = got
            assert np.allclose(got, want[kind], rtol=1e-4), f"{kind}: {got}, want {want[kind]}"


def test_missing_mitsuba_is_told():
    code = "import sys; sys.modules['mitsuba'] = None; import plywave.mitsuba"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
    assert done.returncode == 1 and "pip install plywave[mitsuba]" in done.stderr.splitlines()[-1]


def fiber_table(symmetry, shape, absorbing, folder, seed=1, beta=0.15):
    """A made-up fiber: random azimuthal functions with a forward peak and dark stretches, widths and absorption that vary. Its file, and the fiber in the library."""
    rng, (l, t, p, d) = np.random.default_rng(seed), shape
    folds, mirror = symmetry
    step = 0.0 if folds == 0 else np.pi / (folds * (p - 1)) if mirror is not None else 2 * np.pi / (folds * p)
    width = 1.0 + rng.random(p)
    c_x = width * rng.uniform(0.5, 7.5, (l, t, p))
    absorbed = rng.uniform(0.0, 0.9, (l, t, p)) if absorbing else np.zeros((l, t, p))
    j = np.arange(d)
    values = rng.random((l, t, p, d)) + rng.uniform(0, 30, (l, t, p, 1)) * np.exp(-0.5 * ((2 * np.pi * j / d - np.pi) / 0.1) ** 2)
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
    document = {"format": "plywave-fiber", "version": 1, "program_version": "0", "preset": "test", "seed": seed, "spec": "made up"}
    document |= {"source": "wave", "symmetry": {"folds": folds, "mirror_rad": mirror}, "beta_m_rad": beta}
    filename = str(pathlib.Path(folder) / f"fiber_{folds}_{mirror}_{d}_{absorbing}.pwf")
    fiber = plywave.Fiber.from_tensors(tensors, document)
    fiber.save(filename)
    return filename, fiber


CIRCLE, ELLIPSE, KIDNEY, SWIRL, BARE = (0, None), (2, 0.0), (1, np.pi / 2), (3, None), (1, None)


def outline_directions(uv, w):
    """Directions of the shading frame in the fiber's: z along v; the normal has the azimuth 2 pi u in the outline."""
    turn = 2 * np.pi * uv[:, 0].astype(np.float64)
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([c * w[:, 2] - s * w[:, 0], s * w[:, 2] + c * w[:, 0], w[:, 1]], 1)


@pytest.mark.parametrize("beta", [0.02, 0.15, 1.2])
@pytest.mark.parametrize("symmetry, shape", [(CIRCLE, (3, 6, 1, 100)), (ELLIPSE, (4, 5, 7, 90)), (KIDNEY, (1, 4, 9, 37)), (SWIRL, (2, 3, 5, 120)), (BARE, (2, 2, 12, 16)), (CIRCLE, (1, 1, 1, 2))])
def test_fibers_are_the_librarys(symmetry, shape, beta, tmp_path):
    """f, density, width and what passes beside, of outlines with and without symmetries, a third of the directions about the forward peak. Where N is next to 0 between bright
    nodes, or M_0 is the tail of a narrow peak, the rounding of angles counts: 0.06 % of the values are beyond 1e-4,
    none beyond 1e-2."""
    filename, fiber = fiber_table(symmetry, shape, True, tmp_path)
    fiber = fiber.with_beta_m(beta)
    bsdf = mi.load_dict({"type": "plywave_fiber", "filename": filename, "beta_m_rad": beta, "width": "curve"})
    narrow = mi.load_dict({"type": "plywave_fiber", "filename": filename, "beta_m_rad": beta})
    rng, n = np.random.default_rng(11), QUERIES
    uv = rng.random((n, 2), dtype=np.float32)
    wi, wo = directions(rng, n), directions(rng, n)
    wi[:, 2] = np.abs(wi[:, 2])
    k = n // 3
    wo[:k] = np.stack([-wi[:k, 0], -wi[:k, 1], -wi[:k, 2]], 1) + 0.5 * beta * rng.normal(size=(k, 3))
    wo = np.ascontiguousarray(wo / np.linalg.norm(wo, axis=1)[:, None], np.float32)
    to = lambda w: outline_directions(uv, w)
    want, pdf = fiber.eval_pdf(to(wi), to(wo), RGB_LAMBDA_UM)
    si = interaction(n, mi.Point2f(uv.T.copy()), mi.Vector3f(wi.T.copy()))
    got, density = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(wo.T.copy()))
    got, density = arrays(got, density)
    got = got.T
    close("f", got, want, share=3e-3)
    close("f", got, want, tolerance=1e-2)
    close("pdf", density, pdf, share=3e-3)
    assert abs(got.mean(dtype=np.float64) / want.mean(dtype=np.float64) - 1.0) < 1e-5
    # Beside the width at a wavelength the light passes, and is not scattered.
    width = fiber.width_um(to(wi), RGB_LAMBDA_UM)
    offset = np.abs(wi[:, 0]) / np.hypot(wi[:, 0], wi[:, 2]) * fiber.max_width_um
    clear = np.abs(offset[:, None] - width) > 1e-4 * width
    met = offset[:, None] <= width
    passes = np.array(narrow.eval_null_transmission(si)).T
    assert (passes == 1.0 - met)[clear].all() and (max(shape[:3]) == 1 or 0.05 < passes.mean() < 0.95)
    f, density = narrow.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(wo.T.copy()))
    f, density = arrays(f, density)
    close("f", f.T[clear], (want * met)[clear], share=2e-3)
    albedo = fiber.albedo(to(wi), RGB_LAMBDA_UM)
    chance = (~met).sum(1) + (met * albedo).sum(1)
    close("pdf", density[clear.all(1)], ((want * met).sum(1) / chance)[clear.all(1)], share=2e-3)


@pytest.mark.parametrize("wi", [(0.3, 0.2, 0.9), (0.05, 0.85, 0.3)])
@pytest.mark.parametrize("symmetry, shape", [(CIRCLE, (3, 6, 1, 100)), (KIDNEY, (1, 4, 9, 37))])
@pytest.mark.parametrize("width", ["curve", "wave"])
def test_samples_of_fibers_have_their_density(symmetry, shape, wi, width, tmp_path):
    filename, _ = fiber_table(symmetry, shape, True, tmp_path, beta=0.25)
    bsdf = mi.load_dict({"type": "plywave_fiber", "filename": filename, "width": width, "rotation_deg": 20.0})
    hold_density(bsdf, (0.3, 0.7), wi, 8)


@pytest.mark.parametrize("width", ["curve", "wave"])
def test_fibers_weights_and_furnace(width, tmp_path):
    """Weight times density is f, straight light by its chance too; a lossless fiber is as bright as what is around it."""
    filename, _ = fiber_table(KIDNEY, (2, 4, 9, 37), False, tmp_path)
    bsdf, rng = mi.load_dict({"type": "plywave_fiber", "filename": filename, "width": width}), np.random.default_rng(4)
    weight, straight = hold_weights(bsdf, places_of_plies(rng, 400_000, 1.0), rng)
    assert straight.any() == (width == "wave")
    assert abs(weight.mean(dtype=np.float64) - 1.0) < 0.01, weight.mean()


def test_fibers_in_all_variants(tmp_path):
    """A round fiber of one wavelength answers alike in all variants; where there are as many channels, the same numbers give the same samples."""
    filename, fiber = fiber_table(CIRCLE, (1, 6, 1, 100), True, tmp_path)
    wi, wo = (v / np.linalg.norm(v) for v in (np.array([0.3, 0.2, 0.9]), np.array([-0.4, 0.5, 0.6])))
    drawn = {}
    want, pdf = fiber.eval_pdf(*(outline_directions( np.zeros((1, 2)), w[None]) for w in (wi, wo)), [0.5])
    for variant in ("scalar_rgb", "scalar_spectral", "llvm_ad_spectral", "llvm_ad_rgb"):
        mi.set_variant(variant)
        bsdf = mi.load_dict({"type": "plywave_fiber", "filename": filename, "width": "curve"})
        si = interaction(1, mi.Point2f(0.0, 0.0), mi.Vector3f(*map(float, wi)))
        f, density = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(*map(float, wo)))
        assert np.allclose(np.array(f).ravel(), want.ravel()[0], rtol=1e-4) and np.allclose(np.array(density), pdf, rtol=1e-4), variant
        bs, _ = bsdf.sample(mi.BSDFContext(), si, 0.3, mi.Point2f(0.6, 0.2))
        got = np.array(bs.wo).ravel()
        kind = variant.split("_")[-1]
        assert np.allclose(got, drawn.setdefault(kind, got), atol=1e-4), variant


def test_fibers_gradients_are_differences(tmp_path):
    filename, _ = fiber_table(CIRCLE, (1, 6, 1, 100), True, tmp_path)
    bsdf = mi.load_dict({"type": "plywave_fiber", "filename": filename, "width": "curve"})
    params = mi.traverse(bsdf)
    rng, n = np.random.default_rng(6), 10_000
    wi = directions(rng, n)
    si = interaction(n, mi.Point2f(0.2, 0.3), mi.Vector3f(np.abs(wi).T.copy()))
    wo = mi.Vector3f(directions(rng, n).T.copy())

    def mean(beta):
        params["beta_m_rad"] = mi.Float(beta)
        params.update()
        return np.array(bsdf.eval(mi.BSDFContext(), si, wo))[0, : n // 2].mean(dtype=np.float64)

    want = (mean(0.202) - mean(0.198)) / 0.004
    beta = mi.Float(0.2)
    dr.enable_grad(beta)
    params["beta_m_rad"] = beta
    params.update()
    f = bsdf.eval(mi.BSDFContext(), si, wo)
    dr.backward(dr.mean(dr.select(dr.arange(mi.UInt32, n) < n // 2, f[0], 0.0)) * 2.0)
    got = dr.grad(beta)[0]
    assert abs(got / want - 1.0) < 1e-2, f"{got}, by differences {want}"


@pytest.mark.parametrize(
    "keys, words",
    [
        ({}, "filename: absent"),
        ({"filename": "absent.pwf"}, "absent.pwf"),
        ({"filename": PLY}, "plywave-ply"),
        ({"filename": "made", "widht": "wave"}, "widht: unknown key: did you mean 'width'?"),
        ({"filename": "made", "width": "thick"}, "width: 'thick': expected 'wave' or 'curve'"),
        ({"filename": "made", "axis": "w"}, "axis: 'w': expected 'u' or 'v'"),
        ({"filename": "made", "beta_m_rad": 3.0}, "beta_m_rad: 3.0: expected 0.001 to 2.0"),
        ({"filename": "made", "beta_m_rad": True}, "beta_m_rad: True: expected a number"),
    ],
)
def test_bad_keys_of_fibers_are_told(keys, words, tmp_path):
    if keys.get("filename") == "made":
        keys = keys | {"filename": fiber_table(CIRCLE, (1, 1, 1, 2), False, tmp_path)[0]}
    with pytest.raises(Exception) as told:
        mi.load_dict({"type": "plywave_fiber", **keys})
    assert words in str(told.value), str(told.value)


def straight_curve(folder, kind, radius):
    """A line along y with a hair's radius."""
    path = pathlib.Path(folder) / "line.txt"
    path.write_text("".join(f"0 {y} 0 {radius}\n" for y in np.linspace(-4, 4, 9)))
    return {"type": kind, "filename": str(path)}


def test_curves_have_the_outlines_frame(tmp_path):
    """The shading frame of a bsplinecurve's hits is what the plugin takes it for: the second axis along the curve, the normal at the azimuth 2 pi u."""
    scene = mi.load_dict({"type": "scene", "curve": straight_curve(tmp_path, "bsplinecurve", 0.5)})
    rng, n = np.random.default_rng(8), 5000
    a = rng.uniform(0, 2 * np.pi, n)
    o = mi.Point3f(np.stack([2 * np.cos(a), rng.uniform(-2, 2, n), 2 * np.sin(a)]).astype(np.float32))
    d = mi.Vector3f(np.stack([-np.cos(a + 0.1), np.zeros(n), -np.sin(a + 0.1)]).astype(np.float32))
    si = scene.ray_intersect(mi.Ray3f(o, d))
    assert np.array(si.is_valid()).all()
    along = np.array(si.sh_frame.t)
    sign = np.sign(along[1].mean())
    assert np.abs(along[1] * sign - 1.0).max() < 1e-3
    # Around the axis, right-handed about it, u grows as the normal's azimuth.
    normal, u = np.array(si.n), np.array(si.uv.x)
    azimuth = np.arctan2(normal[0], normal[2]) * sign
    off = (u - azimuth / (2 * np.pi)) % 1.0
    off = (off - off[0] + 0.5) % 1.0 - 0.5
    assert np.abs(off).max() < 1e-3, off


def test_fibers_on_curves_in_a_furnace(tmp_path):
    """A lossless fiber on a curve under even light cannot be seen, with either width."""
    filename, _ = fiber_table(CIRCLE, (2, 4, 1, 100), False, tmp_path)
    for width in ("wave", "curve"):
        curve = straight_curve(tmp_path, "bsplinecurve", 0.5) | {"bsdf": {"type": "plywave_fiber", "filename": filename, "width": width}}
        sensor = {"type": "perspective", "fov": 12, "to_world": mi.ScalarTransform4f().look_at([0, 0, 6], [0, 0, 0], [0, 1, 0])}
        sensor["film"] = {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}}
        even = mi.load_dict({"type": "scene", "integrator": {"type": "path", "max_depth": 16}, "sensor": sensor, "sky": {"type": "constant"}, "curve": curve})
        mean = np.array(mi.render(even, spp=256)).mean(dtype=np.float64)
        assert abs(mean - 1.0) < 0.01, f"{width}: {mean}"


@pytest.mark.parametrize("name", ["polyester", "silk", "cotton"])
def test_speckle_factors_are_the_librarys(name):
    """Factors of f_refl and f_high by the hashes, the sources, the seams, the footprint and the fading over wavelengths, relative to 1 and themselves. Half of the
    directions are about the seams, a third of the places are points."""
    from plywave.mitsuba._kit import Kit
    from plywave.mitsuba._speckle import Speckle

    rng, n, kit = np.random.default_rng(31), QUERIES, Kit()
    theta = rng.uniform(-1.5, 1.5, n).astype(np.float32)
    ply = rng.integers(0, 1 << 32, n, dtype=np.uint32)
    place = rng.uniform([-10.0, -1e4, -20.0, -60.0], [10.0, 1e4, 40.0, 60.0], (n, 4)).astype(np.float32)
    wo, k = directions(rng, n), n // 2
    wo[:k, 0] *= 0.1
    wo = np.ascontiguousarray(wo / np.linalg.norm(wo, axis=1)[:, None], np.float32)
    lam = np.ascontiguousarray(np.broadcast_to(np.float32(RGB_LAMBDA_UM), (n, 3)))
    noise, *want = _native.speckle_factors(str(FABRICS / "models" / f"{name}.pwm"), ply, place, theta, lam, wo)
    speckle = Speckle(kit, [None, noise])
    model = mi.UInt32(1)
    patterns = speckle.at(model, mi.UInt32(ply), *(mi.Float(np.ascontiguousarray(x)) for x in place.T))
    v = mi.Vector3f(wo.T.copy())
    got = speckle.factors(model, patterns, dr.sin(mi.Float(theta)), [v.x, v.y, v.z], RGB_LAMBDA_UM)
    for kind, a, b in zip(("refl", "high"), got, want):
        a, scale = np.array(a).T, 1.0 + b
        error = np.abs(a - b) / scale
        assert error.max() < 2e-3, f"{kind}: {error.max()}"
        assert b.std() > 0.01 and abs(a.mean(dtype=np.float64) - 1.0) < 0.05
    without = speckle.factors(mi.UInt32(0), patterns, dr.sin(mi.Float(theta)), [v.x, v.y, v.z], RGB_LAMBDA_UM)
    assert all(np.allclose(np.array(f), 1.0) for f in without)
