"""``plywave_cloth`` against the Rust library, and against what every BSDF must be; the cloths are woven by the program."""

import functools
import os
import pathlib
import subprocess
import tempfile

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba")
dr = pytest.importorskip("drjit")
mi.set_variant("llvm_ad_rgb")

import plywave  # noqa: E402
import plywave.mitsuba  # noqa: E402  (registers the plugins)
from plywave.mitsuba import _native  # noqa: E402

from test_mitsuba import answers, arrays, close, directions, hold_gradient_of_picture, hold_gradients_by_scale, interaction, variable  # noqa: E402

CLOTHS = pathlib.Path(__file__).resolve().parents[2] / "fabrics" / "cloths"
FOLDER = tempfile.TemporaryDirectory()
QUERIES = 100_000
#: A knit of one kind of yarns; a thin plain weave of two; a basket of twisted plies.
NAMES = ("jersey", "organza", "hopsack")
#: A place of the organza in a gap [um].
GAP = (0.0, 0.0)


@pytest.fixture(autouse=True)
def _variant():
    mi.set_variant("llvm_ad_rgb")


@pytest.fixture(scope="session")
def woven(program):
    """The cloth file of a spec that ships."""

    @functools.cache
    def make(name):
        out = os.path.join(FOLDER.name, f"{name}.pwc")
        subprocess.run([program, "weave", str(CLOTHS / f"{name}.toml"), "-o", out, "-q"], check=True)
        return out

    return make


@pytest.fixture(scope="session")
def striped(program):
    """An organza of a warp of three colors, with slits in its weft."""
    text = (CLOTHS / "organza.toml").read_text().replace('"plies/', f'"{CLOTHS}/plies/')
    color = "srgb = [0.85, 0.78, 0.66]"
    stripes = "stripes = [{ count = 2, srgb = [0.6, 0.1, 0.1] }, { count = 1, srgb = [0.1, 0.2, 0.6] }, { count = 2, srgb = [0.8, 0.8, 0.7] }]"
    first, second, last = text.split(color)
    spec, out = (os.path.join(FOLDER.name, f"striped.{end}") for end in ("toml", "pwc"))
    pathlib.Path(spec).write_text(f"{first}{stripes}{second}{color}\nslit_um = 0.6{last}")
    subprocess.run([program, "weave", spec, "-o", out, "-q"], check=True)
    return out


def cloth(filename, **keys):
    return mi.load_dict({"type": "plywave_cloth", "filename": filename, "um_per_uv": 1.0, "gaps": "straight", **keys})


def library(filename, **keys):
    return _native.ClothTables(filename, keys.pop("gaps", "straight") == "diffracted", **keys)


@pytest.mark.parametrize(
    "name, keys, share",
    [*((name, {}, 1e-2) for name in NAMES), ("organza", {"edges": False}, 1e-2), ("hopsack", {"layers": False, "shadowing": False}, 1e-2)],
)
def test_cloth_is_the_librarys(name, keys, share, woven):
    """f, density and straight light of random places and directions to 1e-3, but for a hundredth of the queries: Newton's steps end in other places within their tolerance, and what is
    hit at a rim, or counts as followed by another ply, is a choice. The mean is the same to 5e-4."""
    rng, n = np.random.default_rng(3), QUERIES
    position = rng.uniform(-3000, 3000, (n, 2)).astype(np.float32)
    wo, wi = directions(rng, n), directions(rng, n)
    f, pdf, straight = library(woven(name), **keys).eval_pdf(position, wo, wi)
    got, density, passes = answers(cloth(woven(name), **keys), position, wo, wi)
    for what, a, b in (("f", got, f), ("pdf", density, pdf)):
        error = np.abs(a - b) / np.maximum(np.abs(b), 1e-3)
        print(f"{name}, {what}: beyond 1e-4, 1e-3, 1e-2: {[float((error > e).mean()) for e in (1e-4, 1e-3, 1e-2)]}")
    close("f", got, f, tolerance=1e-3, share=share)
    close("f", got, f, tolerance=3e-2, share=3e-3)
    close("pdf", density, pdf, tolerance=1e-3, share=share)
    assert (np.abs(passes - straight) > 1e-3).mean() <= 2e-4
    assert abs(got.mean(dtype=np.float64) / f.mean(dtype=np.float64) - 1.0) < 5e-4


@pytest.mark.parametrize("name", ["jersey", "organza"])
def test_light_of_gaps_is_the_librarys(name, woven):
    """Of lines that hit no ply, in directions of which half lie about the straight one, where it peaks within a few hundredths."""
    rng, n = np.random.default_rng(9), QUERIES
    position = rng.uniform(-3000, 3000, (n, 2)).astype(np.float32)
    wo, wi = directions(rng, n), directions(rng, n)
    wi[: n // 2] = -wo[: n // 2] + 0.04 * rng.normal(size=(n // 2, 3))
    wi = np.ascontiguousarray(wi / np.linalg.norm(wi, axis=1)[:, None], np.float32)
    alone = {"layers": False, "shadowing": False, "gaps": "diffracted"}
    f, pdf, straight = library(woven(name), **alone).eval_pdf(position, wo, wi)
    got, density, passes = answers(cloth(woven(name), **alone), position, wo, wi)
    without = library(woven(name)).eval_pdf(position, wo, wi)[2]
    gaps = without == 1.0
    assert gaps.mean() > 0.03 and (straight[gaps] == 0.0).all() and (passes[gaps] == 0.0).mean() > 0.999
    close("f", got[gaps], f[gaps], tolerance=1e-3, share=1e-2)
    close("f", got[gaps], f[gaps], tolerance=5e-2, share=2e-3)
    close("pdf", density[gaps], pdf[gaps], tolerance=1e-3, share=1e-2)
    assert abs(got[gaps].mean(dtype=np.float64) / f[gaps].mean(dtype=np.float64) - 1.0) < 1e-3


def test_stripes_and_slits_are_the_librarys(striped):
    rng, n = np.random.default_rng(10), QUERIES
    position = rng.uniform(-30_000, 30_000, (n, 2)).astype(np.float32)
    wo, wi = directions(rng, n), directions(rng, n)
    tables, bsdf = library(striped), cloth(striped)
    f, pdf, _ = tables.eval_pdf(position, wo, wi)
    got, density, _ = answers(bsdf, position, wo, wi)
    close("f", got, f, tolerance=1e-3, share=1.5e-2)
    close("pdf", density, pdf, tolerance=1e-3, share=1.5e-2)
    assert abs(got.mean(dtype=np.float64) / f.mean(dtype=np.float64) - 1.0) < 1e-3
    plain = library(striped, slits=False).eval_pdf(position, wo, wi)[0]
    assert (np.abs(plain - f).max(1) > 1e-3).mean() > 0.05
    far = {"far": True, "footprint_um": 1e5}
    f = library(striped, far=True).eval_pdf(position[:2000], wo[:2000], wi[:2000], footprint_um=1e5)[0]
    close("f", answers(cloth(striped, **far), position[:2000], wo[:2000], wi[:2000])[0], f, tolerance=1e-3, share=2e-3)


@pytest.mark.parametrize("name", ["jersey", "organza"])
def test_far_view_is_the_librarys(name, woven):
    """The mean over the cell, and between it and the point."""
    rng, n = np.random.default_rng(4), 20_000
    position = rng.uniform(-3000, 3000, (n, 2)).astype(np.float32)
    wo, wi = directions(rng, n), directions(rng, n)
    keys = {"far": True, "gaps": "diffracted" if name == "organza" else "straight"}
    tables = library(woven(name), **keys)
    longest = max(np.hypot(*v) for v in tables.tensors()["cell_um"])
    for footprint, share in ((0.8 * longest, 2e-2), (2.0 * longest, 2e-3 if name == "organza" else 1e-3)):
        f, pdf, straight = tables.eval_pdf(position, wo, wi, footprint_um=float(footprint))
        bsdf = cloth(woven(name), **keys, footprint_um=float(footprint))
        got, density, passes = answers(bsdf, position, wo, wi)
        close("f", got, f, tolerance=1e-3, share=share)
        close("pdf", density, pdf, tolerance=1e-3, share=share)
        assert (np.abs(passes - straight) > 1e-3).mean() <= share
    assert not bsdf.flags() & 0x20000 and cloth(woven(name), far=True).flags() & 0x20000


@pytest.mark.parametrize("wi, at", [((0.3, 0.2, 0.9), (60.0, 33.0)), ((0.8, 0.1, -0.2), (60.0, 33.0)), ((0.1, 0.05, 0.99), GAP)])
def test_samples_have_their_density(wi, at, woven):
    from mitsuba.chi2 import ChiSquareTest, SphericalDomain

    bsdf, context, null = cloth(woven("organza"), gaps="diffracted"), mi.BSDFContext(), int(mi.BSDFFlags.Null)
    wi = variable(wi)

    def sample(u, *_):
        si = interaction(dr.width(u), mi.Point2f(*at), wi)
        bs, _ = bsdf.sample(context, si, u.x, mi.Point2f(u.y, u.z))
        return bs.wo, dr.select((bs.pdf > 0) & (bs.sampled_type != null), 1.0, 0.0)

    def pdf(wo, *_):
        return bsdf.pdf(context, interaction(dr.width(wo), mi.Point2f(*at), wi), wo)

    test = ChiSquareTest(SphericalDomain(), sample, pdf, sample_dim=3, sample_count=500_000, res=101, ires=24)
    assert test.run(0.01 / 10), test.messages


def test_weights_are_f_over_pdf_and_keep_energy(woven):
    """Clear fibers under even light are as bright as what is around them, seen from any side."""
    rng, n = np.random.default_rng(5), 400_000
    for name, white in (("jersey", {"sigma_per_um": 0.0, "gaps": "diffracted"}), ("organza", {"warp_sigma_per_um": 0.0, "weft_sigma_per_um": 0.0})):
        bsdf, context = cloth(woven(name), **white), mi.BSDFContext()
        si = interaction(n, mi.Point2f(rng.uniform(-1500, 1500, (2, n)).astype(np.float32)), mi.Vector3f(directions(rng, n).T.copy()))
        u = rng.random((3, n), dtype=np.float32)
        bs, weight = bsdf.sample(context, si, mi.Float(u[0]), mi.Point2f(u[1:]))
        f, pdf = bsdf.eval_pdf(context, si, bs.wo)
        weight, of_sample, sampled, f, pdf = arrays(weight, bs.pdf, bs.sampled_type, f, pdf)
        scattered = np.broadcast_to(sampled != int(mi.BSDFFlags.Null), n)
        close("pdf", of_sample[scattered], pdf[scattered], tolerance=1e-5)
        close("f", (weight * of_sample)[:, scattered], f[:, scattered], tolerance=1e-4)
        mean = weight.mean(dtype=np.float64)
        print(f"{name}: {mean:.4f}")
        assert abs(mean - 1.0) < 0.01, f"{name}: {mean}"


@pytest.mark.parametrize("variant", ["scalar_rgb", "scalar_spectral", "llvm_ad_spectral"])
def test_variants_agree(variant, woven):
    """Where wavelengths do not count, all variants answer alike."""
    want = None
    for name in ("llvm_ad_rgb", variant):
        mi.set_variant(name)
        bsdf = cloth(woven("hopsack"), warp_sigma_per_um=0.003, weft_sigma_per_um=0.01)
        wi, wo = ([float(x) for x in v / np.linalg.norm(v)] for v in (np.array([0.3, 0.2, 0.9]), np.array([-0.4, 0.5, 0.6])))
        f, pdf = bsdf.eval_pdf(mi.BSDFContext(), interaction(1, mi.Point2f(60.0, 33.0), mi.Vector3f(*wi)), mi.Vector3f(*wo))
        got = [float(x.ravel()[0]) for x in arrays(f, pdf)]
        want = want or got
        assert np.allclose(got, want, rtol=1e-4), f"{got}, want {want}"


def test_colors_are_those_of_the_library(woven):
    """A color of all yarns, and of one kind, as absorptions by the library's own curve."""
    rng, n = np.random.default_rng(6), 2000
    position = rng.uniform(-3000, 3000, (n, 2)).astype(np.float32)
    wo, wi = directions(rng, n), directions(rng, n)
    tables, both = library(woven("organza")), [[0.001, 0.004, 0.02], [0.0, 0.05, 0.3]]
    f, _, _ = tables.eval_pdf(position, wo, wi, sigma_per_um=both)
    rgb = lambda sigma: {"type": "rgb", "value": sigma}
    bsdf = cloth(woven("organza"), warp_sigma_per_um=rgb(both[0]), weft_sigma_per_um=rgb(both[1]))
    close("f", answers(bsdf, position, wo, wi)[0], f, tolerance=2e-3, share=2e-2)
    one, two = (cloth(woven("organza"), **keys) for keys in ({"color": 0.4}, {"warp_color": 0.4, "weft_color": 0.4}))
    assert np.array_equal(*(answers(of, position, wo, wi)[0] for of in (one, two)))


def test_gradients_are_differences(woven):
    keys = {"type": "plywave_cloth", "filename": woven("jersey"), "um_per_uv": 2e4}
    hold_gradient_of_picture(lambda: {**keys, "sigma_per_um": {"type": "rgb", "value": [0.004] * 3}}, "cloth.bsdf.sigma_per_um.value")


def choices(bsdf, si):
    """What jumps with the place: the pieces of curve that are hit, the class of their light between plies, the block of the table that their lobes are of."""
    at, out = bsdf.walked(si, mi.Bool(True)), []
    for i in range(len(at["kept"]["piece"])):
        here, where = at["count"] > i, {key: at["kept"][key][i] for key in bsdf.cloth.WHERE}
        hit = bsdf.cloth.hit_at(where, *at["line"])
        cell = bsdf.cloth.plies._cell(bsdf.cloth.model_of(hit), hit["theta_i"], hit["h"])
        for x in (where["piece"], at["kept"]["class"][i], cell["high"]):
            out.append(dr.select(here, mi.Int(x), -1))
    return np.stack([np.broadcast_to(x, dr.width(si)) for x in arrays(*out)])


def test_gradients_by_the_scale_are_differences(woven):
    bsdf = cloth(woven("hopsack"))
    uv = np.random.default_rng(5).uniform(0.0, 0.2 * bsdf.longest_um, (2, QUERIES))
    hold_gradients_by_scale("hopsack", bsdf, choices, uv, (-0.4, 0.1, 0.8), 0.95)


def test_bad_keys_are_told(woven, tmp_path):
    jersey, organza = woven("jersey"), woven("organza")
    short = tmp_path / "short.pwc"
    short.write_bytes(pathlib.Path(jersey).read_bytes()[:5000])
    for keys, words in (
        ({}, "filename: give a cloth file"),
        ({"filename": "absent.pwc"}, "absent.pwc"),
        ({"filename": str(short)}, "short.pwc"),
        ({"filename": str(CLOTHS / "plies" / "cotton_single.pwm")}, "cotton_single.pwm"),
        ({"filename": jersey, "layer": True}, "layer: unknown key: did you mean 'layers'?"),
        ({"filename": jersey, "gaps": "open"}, "gaps: 'open': expected"),
        ({"filename": jersey, "speckle": True}, "no model of the cloth has speckle noise"),
        ({"filename": jersey, "footprint_um": 3.0}, "footprint_um: given without far"),
        ({"filename": jersey, "warp_color": 0.5}, "warp_color: all yarns of this cloth are alike: use 'color'"),
        ({"filename": organza, "warp_color": 0.5, "warp_sigma_per_um": 0.1}, "warp_color: given with warp_sigma_per_um"),
    ):
        with pytest.raises(Exception) as told:
            mi.load_dict({"type": "plywave_cloth", **keys})
        assert words in str(told.value), str(told.value)
