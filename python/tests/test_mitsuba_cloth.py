"""``plywave_cloth`` against the Rust library, and against what every BSDF must be.

The chain of trust is that of test_mitsuba.py.
"""

import math
import pathlib
import sys

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba")
dr = pytest.importorskip("drjit")
mi.set_variant("llvm_ad_rgb")

import plywave  # noqa: E402
import plywave.mitsuba  # noqa: E402  (registers the plugins)
from plywave.mitsuba import _native  # noqa: E402

from conftest import CLOTHS, FABRICS, ROOT  # noqa: E402
from test_mitsuba import arrays, close, cones, directions, hold_density, hold_weights, interaction  # noqa: E402

QUERIES = 100_000
#: A knit of one kind of yarns; a thin plain weave of two; a basket of twisted plies; a plain weave of a warp
#: of cones in three colors, uneven and with speckle, and a weft with slits.
NAMES = ("jersey", "organza", "hopsack", "mixed")
#: A place of the organza in a gap, and one on a ply [um].
GAP, PLACE = (0.0, 0.0), (60.0, 33.0)


@pytest.fixture(autouse=True)
def _variant():
    mi.set_variant("llvm_ad_rgb")


@pytest.fixture(scope="session")
def file(woven):
    """The cloth file of a name."""

    def of(name):
        if name != "mixed":
            return woven(name)
        yarn = {"fiber": "polyester", "packing": 0.65, "bundles": 1, "stiffness": 4.0}
        stripes = [{"count": count, "color": color} for count, color in ((2, [0.6, 0.1, 0.1]), (1, [0.1, 0.2, 0.6]), (2, [0.8, 0.8, 0.7]))]
        # Counts of plies as wide as the models'.
        uneven = {"count_cv": 0.2, "spacing_cv": 0.05, "uneven_mm": 0.5}
        warp = {**yarn, **uneven, "model": cones(0.0), "count": "70.45 dtex", "stripes": stripes}
        weft = {**yarn, "model": str(FABRICS / "models" / "cotton.pwm"), "count": "62.25 dtex", "color": [0.5, 0.5, 0.3], "slit_um": 1.5}
        return woven(name, {"name": name, "weave": {"kind": "plain", "ends_per_cm": 60, "picks_per_cm": 60}, "warp": warp, "weft": weft})

    return of


def cloth(filename, **keys):
    return mi.load_dict({"type": "plywave_cloth", "filename": filename, "um_per_uv": 1.0, "gaps": "straight", "native": False, **keys})


def library(filename, **keys):
    return _native.ClothTables(filename, keys.pop("gaps", "straight") == "diffracted", **keys)


def queries(seed, n=QUERIES, size=3000.0, about=0):
    """Places of the plane [um] and two directions each, the second about the straight one of so many."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-size, size, (n, 2)).astype(np.float32)
    wo, wi = directions(rng, n), directions(rng, n)
    wi[:about] = -wo[:about] + 0.04 * rng.normal(size=(about, 3))
    return position, wo, np.ascontiguousarray(wi / np.linalg.norm(wi, axis=1)[:, None], np.float32)


def places(rng, n, size=1500.0):
    """Hits of a plane from all directions."""
    return interaction(n, mi.Point2f(rng.uniform(-size, size, (2, n)).astype(np.float32)), mi.Vector3f(directions(rng, n).T.copy()))


def clear(name):
    """Keys of a cloth of clear fibers."""
    return {"sigma_per_um": 0.0} if name == "jersey" else {"warp_sigma_per_um": 0.0, "weft_sigma_per_um": 0.0}


def answers(bsdf, position, wo, wi):
    """f `[n, 3]`, density and straight light of a cloth at places [um] of a plane, by the plugin."""
    si = interaction(len(wo), mi.Point2f(position.T.copy()), mi.Vector3f(wo.T.copy()))
    f, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(wi.T.copy()))
    f, pdf, straight = arrays(f, pdf, bsdf.eval_null_transmission(si))
    return f.T, pdf, straight[0]


@pytest.mark.slow(16)
@pytest.mark.parametrize("name, share", [("jersey", 5e-4), ("hopsack", 5e-4)])
def test_lines_hit_what_they_hit_in_the_library(name, share, file):
    """The first curve, how many plies there are, and where it is hit, to a two-hundredth of the lines: theta_i to 1e-3 rad, the offset to
    0.1 um, the way to 0.1 um and what 1e-3 rad makes of it: sqrt(R^2 - h^2) / cos(theta_i) is the way from the wall to the axis.
    """
    from plywave.mitsuba._curves import Curves
    from plywave.mitsuba._kit import Kit
    from plywave.mitsuba._lines import HITS

    kit, n = Kit(), QUERIES
    tables = library(file(name))
    curves = Curves(kit, tables.tensors())
    position, wo, _ = queries(2)
    start, _ = curves.begin_line(list(mi.Point2f(position.T.copy())), list(mi.Vector3f(wo.T.copy())))
    d = [-x for x in mi.Vector3f(wo.T.copy())]
    found, count = curves.follow(start, d, mi.Bool(True), lambda *_: mi.Float(1.0))
    hit = curves.hit_at({key: found[key][0] for key in curves.WHERE}, start, d)
    *at, curve, theta_i, h_um, enter, radius, several = arrays(*start, hit["curve"], hit["theta_i"], hit["h_um"], found["enter"][0], hit["radius"], count)
    want = tables.hits(np.stack([np.broadcast_to(x, n) for x in at], 1), -wo)
    met = several > 0
    assert (met != (want[:, 0] > 0)).mean() <= share
    both = met & (want[:, 0] > 0)
    same = both & (curve == want[:, 1])
    assert both.mean() > 0.5 and (both & ~same).mean() <= share
    assert (several[same] != np.minimum(want[same, 9], HITS)).mean() <= 1e-2
    # Of grazing lines, which start far away, ways have no such digits.
    same &= np.abs(wo[:, 2]) > 0.1
    theta, across = want[same, 2], np.sqrt(np.maximum(radius[same] ** 2 - want[same, 3] ** 2, 0.0))
    way = 0.1 + 1e-3 * across * np.abs(np.sin(theta)) / np.maximum(np.cos(theta), 1e-3) ** 2
    for got, column, error in ((theta_i, 2, 1e-3), (h_um, 3, 0.1), (enter, 4, way)):
        off = (np.abs(got[same] - want[same, column]) > error).mean()
        assert off <= 5e-3, (column, off)


@pytest.mark.slow(12)
@pytest.mark.parametrize(
    "name, keys, share",
    [
        *((name, {"relief": False}, 1e-2) for name in NAMES),
        ("organza", {"relief": False, "edges": False}, 1e-2),
        ("hopsack", {"relief": False, "layers": False, "shadowing": False}, 1e-2),
        ("jersey", {}, 1.5e-2),
        ("flannel", {"relief": False}, 4e-3),
        ("mixed", {}, 1.5e-2),
    ],
)
def test_cloth_is_the_librarys(name, keys, share, file):
    """f, density and straight light of random places and directions to 1e-3, but for a hundredth of the queries: Newton's steps end in other places within their tolerance, and what is
    hit at a rim, or counts as followed by another ply, is a choice. The mean is the same to 5e-4. Highlights
    of single fibers, a micrometer wide, show more of what differs."""
    at = queries(3)
    f, pdf, straight = library(file(name), **keys).eval_pdf(*at)
    got, density, passes = answers(cloth(file(name), **keys), *at)
    for what, a, b in (("f", got, f), ("pdf", density, pdf)):
        error = np.abs(a - b) / np.maximum(np.abs(b), 1e-3)
        print(f"{name}, {what}: beyond 1e-4, 1e-3, 1e-2: {[float((error > e).mean()) for e in (1e-4, 1e-3, 1e-2)]}")
    close("f", got, f, tolerance=1e-3, share=share)
    close("f", got, f, tolerance=3e-2, share=5e-3 if keys.get("relief", True) else 3e-3)
    close("pdf", density, pdf, tolerance=1e-3, share=share)
    assert (np.abs(passes - straight) > 1e-3).mean() <= 2e-4
    assert abs(got.mean(dtype=np.float64) / f.mean(dtype=np.float64) - 1.0) < 5e-4
    if name == "mixed":
        plain = library(file(name), slits=False, **keys).eval_pdf(*at)[0]
        assert (np.abs(plain - f).max(1) > 1e-3).mean() > 0.02


@pytest.mark.parametrize("name", ["jersey", "organza"])
def test_light_of_gaps_is_the_librarys(name, file):
    """Of lines that hit no ply, in directions of which half lie about the straight one, where it peaks within a few hundredths."""
    at = queries(9, about=QUERIES // 2)
    alone = {"layers": False, "shadowing": False, "gaps": "diffracted"}
    f, pdf, straight = library(file(name), **alone).eval_pdf(*at)
    got, density, passes = answers(cloth(file(name), **alone), *at)
    gaps = library(file(name)).eval_pdf(*at)[2] == 1.0
    assert gaps.mean() > 0.03 and (straight[gaps] == 0.0).all() and (passes[gaps] == 0.0).mean() > 0.999
    close("f", got[gaps], f[gaps], tolerance=1e-3, share=1e-2)
    close("f", got[gaps], f[gaps], tolerance=5e-2, share=2e-3)
    close("pdf", density[gaps], pdf[gaps], tolerance=1e-3, share=1e-2)
    assert abs(got[gaps].mean(dtype=np.float64) / f[gaps].mean(dtype=np.float64) - 1.0) < 1e-3


@pytest.mark.slow(20)
@pytest.mark.parametrize("variant", ["llvm_ad_rgb", "scalar_rgb"])
def test_speckle_is_the_librarys(variant, file):
    """f of the whole cloth with speckle: another than the smooth one, and the library's. Patterns lie by the place on the ply, in which both differ as in
    test_cloth_is_the_librarys."""
    mi.set_variant(variant)
    at = queries(32, QUERIES if variant != "scalar_rgb" else 12)
    f, pdf, _ = library(file("mixed"), speckle=True).eval_pdf(*at)
    bsdf = cloth(file("mixed"), speckle=True)
    if variant == "scalar_rgb":
        calls = [bsdf.eval_pdf(mi.BSDFContext(), interaction(1, mi.Point2f(*map(float, p)), mi.Vector3f(*map(float, a))), mi.Vector3f(*map(float, b))) for p, a, b in zip(*at)]
        close("f", np.array([np.array(c[0]) for c in calls]), f, tolerance=1e-2, share=0.1)
        close("pdf", np.array([c[1] for c in calls]), pdf, tolerance=1e-2, share=0.1)
        return
    smooth, _, _ = library(file("mixed")).eval_pdf(*at)
    got, density, _ = answers(bsdf, *at)
    assert np.abs(smooth - f).mean() > 0.03 * f.mean()
    close("f", got, f, tolerance=3e-3, share=2e-2)
    close("pdf", density, pdf, tolerance=1e-3, share=1e-2)
    assert abs(got.mean(dtype=np.float64) / f.mean(dtype=np.float64) - 1.0) < 1e-3


@pytest.mark.slow(16)
@pytest.mark.parametrize("name", ["jersey", "organza", "mixed", "flannel"])
def test_far_view_is_the_librarys(name, file):
    """The mean over the cell, and between it and the point; of absorptions that textures give, too."""
    at = queries(4, 60_000)
    keys = {"far": True, "gaps": "diffracted" if name == "organza" else "straight"}
    tables = library(file(name), **keys)
    longest = max(np.hypot(*v) for v in tables.tensors()["cell_um"])
    own = [[0.0008, 0.004, 0.02], [0.05, 0.0, 4.0]]
    textures = {f"{kind}_sigma_per_um": {"type": "rgb", "value": sigma} for kind, sigma in zip(("warp", "weft"), own)}
    cases = [(0.0, None, 1e-2), (0.8, None, 2e-2), (2.0, None, 2e-3 if name != "jersey" else 1e-3)]
    for size, sigma, share in (*cases, *([(2.0, own, 2e-3)] if name == "organza" else [])):
        footprint = float(size * longest)
        f, pdf, straight = tables.eval_pdf(*at, sigma_per_um=sigma, footprint_um=footprint)
        bsdf = cloth(file(name), **keys, footprint_um=footprint, **(textures if sigma else {}))
        got, density, passes = answers(bsdf, *at)
        close("f", got, f, tolerance=1e-3, share=share)
        close("pdf", density, pdf, tolerance=1e-3, share=share)
        assert (np.abs(passes - straight) > 1e-3).mean() <= share
    assert not bsdf.needs_differentials() and cloth(file(name), far=True).needs_differentials()


@pytest.mark.slow(8)
@pytest.mark.parametrize(
    "name, keys, wi, at",
    [
        ("organza", {}, (0.3, 0.2, 0.9), PLACE),
        ("organza", {}, (0.8, 0.1, -0.2), PLACE),
        ("organza", {}, (0.1, 0.05, 0.99), GAP),
        ("organza", {"far": True, "footprint_um": 400.0}, (0.3, 0.2, 0.9), PLACE),
        ("organza", {"far": True, "footprint_um": 1e5}, (0.8, 0.1, 0.2), PLACE),
        ("jersey", {"far": True, "footprint_um": 1e5, "gaps": "straight"}, (0.3, 0.2, 0.9), PLACE),
        ("flannel", {}, (0.3, 0.2, 0.9), PLACE),
        ("flannel", {}, (0.3, 0.8, -0.2), PLACE),
        # A weft with slits on top, of one layer.
        ("mixed", {}, (0.8, 0.1, 0.6), (0.0, 90.0)),
    ],
)
def test_samples_have_their_density(name, keys, wi, at, file):
    hold_density(cloth(file(name), **{"gaps": "diffracted", **keys}), at, wi, 10)


FAR = {"far": True, "footprint_um": 400.0}


@pytest.mark.slow(6)
@pytest.mark.parametrize(
    "name, keys",
    [
        ("jersey", {"gaps": "diffracted"}),
        ("organza", {}),
        ("mixed", {}),
        ("flannel", {}),
        ("organza", FAR),
        ("organza", {**FAR, "gaps": "diffracted"}),
        ("organza", {**FAR, "footprint_um": 1e5}),
        ("organza", {**FAR, "footprint_um": 1e5, "gaps": "diffracted"}),
    ],
)
def test_weights_are_f_over_pdf_and_keep_energy(name, keys, file):
    """Clear fibers under even light are as bright as what is around them, seen from any side."""
    rng = np.random.default_rng(5)
    weight, _ = hold_weights(cloth(file(name), **clear(name), **keys), places(rng, 400_000), rng)
    mean = weight.mean(dtype=np.float64)
    print(f"{name}: {mean:.4f}")
    assert abs(mean - 1.0) < 0.01, f"{name}: {mean}"


@pytest.mark.parametrize("name", ["hopsack", "mixed"])
@pytest.mark.parametrize("variant", ["scalar_rgb", "scalar_spectral", "llvm_ad_spectral"])
def test_variants_agree(variant, name, file):
    """Where wavelengths do not count, all variants answer alike."""
    want = None
    for of in ("llvm_ad_rgb", variant):
        mi.set_variant(of)
        bsdf = cloth(file(name), warp_sigma_per_um=0.003, weft_sigma_per_um=0.01, slits=variant.endswith("rgb"))
        wi, wo = ([float(x) for x in v / np.linalg.norm(v)] for v in (np.array([0.3, 0.2, 0.9]), np.array([-0.4, 0.5, 0.6])))
        f, pdf = bsdf.eval_pdf(mi.BSDFContext(), interaction(1, mi.Point2f(60.0, 33.0), mi.Vector3f(*wi)), mi.Vector3f(*wo))
        got = [float(x.ravel()[0]) for x in arrays(f, pdf)]
        want = want or got
        assert np.allclose(got, want, rtol=1e-4), f"{got}, want {want}"


@pytest.mark.slow(6)
def test_colors_are_those_of_the_library(file):
    """A color of all yarns, and of one kind, as absorptions by the library's own curve."""
    at = queries(6, 2000)
    tables, both = library(file("organza")), [[0.001, 0.004, 0.02], [0.0, 0.05, 0.3]]
    f, _, _ = tables.eval_pdf(*at, sigma_per_um=both)
    rgb = lambda sigma: {"type": "rgb", "value": sigma}
    bsdf = cloth(file("organza"), warp_sigma_per_um=rgb(both[0]), weft_sigma_per_um=rgb(both[1]))
    close("f", answers(bsdf, *at)[0], f, tolerance=2e-3, share=2e-2)
    one, two = (cloth(file("organza"), **keys) for keys in ({"color": 0.4}, {"warp_color": 0.4, "weft_color": 0.4}))
    assert np.array_equal(*(answers(of, *at)[0] for of in (one, two)))


def scene(bsdf, integrator="direct", size=32):
    T = mi.ScalarTransform4f()
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": integrator},
            "sensor": {
                "type": "perspective",
                "fov": 30,
                "to_world": T.look_at([0, -1.2, 2.2], [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
            },
            "lamp": {"type": "point", "position": [1, 1, 2], "intensity": 3.0},
            "cloth": {"type": "rectangle", "bsdf": bsdf},
        }
    )


def hold_gradient_of_picture(bsdf, key):
    """The gradient of a picture by the red channel of an absorption of 0.004 against differences, through Mitsuba's calls, of a function that makes the BSDF's dictionary; the picture is
    the same function of it in both, light by light."""
    rendered = scene(bsdf())
    params = mi.traverse(rendered)
    dr.enable_grad(params[key])
    params.update()
    dr.backward(dr.mean(mi.render(rendered, params, spp=64)))
    got, values = np.array(dr.grad(params[key])).ravel()[0], []
    for step in (2e-4, -2e-4):
        rendered = scene(bsdf())
        params = mi.traverse(rendered)
        params[key] = mi.Color3f(0.004 + step, 0.004, 0.004)
        params.update()
        values.append(np.array(mi.render(rendered, spp=64)).mean(dtype=np.float64))
    want = (values[0] - values[1]) / 4e-4
    assert abs(got / want - 1.0) < 1e-2, f"{got}, by differences {want}"


@pytest.mark.slow(17)
def test_gradients_are_differences(file):
    keys = {"type": "plywave_cloth", "filename": file("jersey"), "um_per_uv": 2e4}
    assert {"sigma_per_um.value", "um_per_uv", "dyes_per_um"} <= set(mi.traverse(cloth(file("jersey"), sigma_per_um=0.004)).keys())
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


def hold_gradients_by_scale(name, bsdf, choices, uv, wo, least):
    """Gradients of f's mean by either scale of uv, over the points at which no choice is another one step on either side, ``least`` of them at least; to 1e-2 of the gradient's length."""
    params, n, step = mi.traverse(bsdf), uv.shape[1], 5e-4
    assert params.flags("um_per_uv") & mi.ParamFlags.NonDifferentiable.value == 0
    si = interaction(n, mi.Point2f(np.float32(uv)), dr.normalize(mi.Vector3f(0.3, 0.2, 0.9)))
    wo = dr.normalize(mi.Vector3f(*wo))

    def at(scale):
        params["um_per_uv"] = mi.Point2f(*scale)
        params.update()
        return arrays(bsdf.eval(mi.BSDFContext(), si, wo))[0].astype(np.float64).mean(0), choices(bsdf, si)

    (_, first), ends = at((1.0, 1.0)), [[at(scale) for scale in ((a, 1.0), (1.0, a))] for a in (1.0 + step, 1.0 - step)]
    gots, wants = [], []
    for (above, chosen_above), (below, chosen_below), axis in zip(*ends, (0, 1)):
        same = (first == chosen_above).all(0) & (first == chosen_below).all(0)
        assert same.mean() > least
        wants.append(np.where(same, above - below, 0.0).mean() / (2.0 * step))
        scale = mi.Point2f(1.0, 1.0)
        dr.enable_grad(scale)
        params["um_per_uv"] = scale
        params.update()
        dr.backward(dr.mean(dr.select(mi.Bool(same), bsdf.eval(mi.BSDFContext(), si, wo), 0.0), axis=None))
        gots.append(float(arrays(dr.grad(params["um_per_uv"]))[0].ravel()[axis]))
        print(f"{name}, {'uv'[axis]}: {gots[-1]:.6g}, by differences {wants[-1]:.6g}, {100.0 * same.mean():.2f} % of the points")
    assert np.hypot(*wants) > 1e-3
    assert np.hypot(*np.subtract(gots, wants)) < 1e-2 * np.hypot(*wants), f"{gots}, by differences {wants}"


@pytest.mark.slow(30)
def test_gradients_by_the_scale_are_differences(file):
    # Gradients take relief as given.
    bsdf = cloth(file("hopsack"), relief=False)
    uv = np.random.default_rng(5).uniform(0.0, 0.2 * bsdf.longest_um, (2, QUERIES))
    hold_gradients_by_scale("hopsack", bsdf, choices, uv, (-0.4, 0.1, 0.8), 0.95)


def test_bad_keys_are_told(file, tmp_path):
    jersey, organza = file("jersey"), file("organza")
    short = tmp_path / "short.pwc"
    short.write_bytes(pathlib.Path(jersey).read_bytes()[:5000])
    for keys, words in (
        ({}, "filename: give a cloth file"),
        ({"filename": "absent.pwc"}, "absent.pwc"),
        ({"filename": str(short)}, "short.pwc"),
        ({"filename": str(FABRICS / "models" / "cotton_single.pwm")}, "cotton_single.pwm"),
        ({"filename": jersey, "layer": True}, "layer: unknown key: did you mean 'layers'?"),
        ({"filename": jersey, "layers": 3.0}, "layers: 3.0: expected true or false"),
        ({"filename": jersey, "gaps": "open"}, "gaps: 'open': expected"),
        ({"filename": jersey, "um_per_uv": 0.0}, "um_per_uv: 0.0: expected one or two numbers above 0"),
        ({"filename": jersey, "speckle": True}, "no model of the cloth has speckle noise"),
        ({"filename": jersey, "relief": False, "footprint_um": 3.0}, "footprint_um: given without far, relief and speckle"),
        ({"filename": jersey, "far": True, "footprint_um": -1.0}, "footprint_um: -1.0: expected a number that is not negative"),
        ({"filename": jersey, "far": True, "footprint_um": 10.0, "footprint_rad": 0.1}, "footprint_rad: given with footprint_um"),
        ({"filename": jersey, "far": True, "footprint_scale": "wide"}, "footprint_scale: 'wide': expected a number"),
        ({"filename": jersey, "warp_color": 0.5}, "warp_color: all yarns of this cloth are alike: use 'color'"),
        ({"filename": organza, "warp_color": 0.5, "warp_sigma_per_um": 0.1}, "warp_color: given with warp_sigma_per_um"),
    ):
        with pytest.raises(Exception) as told:
            mi.load_dict({"type": "plywave_cloth", **keys})
        assert words in str(told.value), str(told.value)


def test_meshes_without_uv_are_told(file):
    mesh = mi.Mesh("bare", 3, 1)
    params = mi.traverse(mesh)
    params["vertex_positions"], params["faces"] = [0, 0, 0, 1, 0, 0, 0, 1, 0], [0, 1, 2]
    params.update()
    mesh.set_bsdf(cloth(file("jersey")))
    with pytest.raises(ValueError, match="mesh: no texture coordinates"):
        plywave.mitsuba.check(mi.load_dict({"type": "scene", "mesh": mesh}))
    plywave.mitsuba.check(scene(cloth(file("jersey"))))


def plane(bsdf, distance, integrator, size=16):
    """A plane under a lamp, seen from ``distance`` so that it fills the picture."""
    T = mi.ScalarTransform4f()
    sensor = {"type": "perspective", "fov": 1.0, "to_world": T.look_at([0, -0.6 * distance, 0.8 * distance], [0, 0, 0], [0, 1, 0])}
    sensor["film"] = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    lamp = {"type": "directional", "direction": [0.3, -0.2, -0.9], "irradiance": 3.0}
    sheet = {"type": "rectangle", "to_world": T.scale(0.1 * distance), "bsdf": bsdf}
    return mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, "lamp": lamp, "cloth": sheet})


@pytest.mark.slow(60)
def test_footprints_are_those_of_rays(file):
    """By the angle of a pixel, pixels that cover a cell and more see the mean, and near ones see points; scaled to nothing all see points, of the same mean. The share of the mean
    by the differentials of a ray is that by the angle. (Mitsuba 3.9 hands differentials to BSDFs in scalar variants only.)"""
    integrator, angle = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}, math.radians(1.0 / 16.0)
    # 20 mm away, a pixel is 22 um wide; 2 m away, 2.2 mm. A unit of uv is a fifth of the distance long.
    for distance, is_far in ((0.02, False), (0.22, None), (2.0, True)):
        at = {"far": True, "relief": False, "um_per_uv": 0.2 * distance * 1e6}
        by_rays, by_angle, points = (cloth(file("organza"), **at, **more) for more in ({}, {"footprint_rad": angle}, {"footprint_rad": angle, "footprint_scale": 0.0}))
        seen = plane(by_angle, distance, integrator)
        ray, _ = seen.sensors()[0].sample_ray_differential(mi.Float([0.0, 0.0]), mi.Float([0.5, 0.5]), mi.Point2f([0.1, 0.7], [0.4, 0.5]), mi.Point2f(0.5))
        si = seen.ray_intersect(mi.Ray3f(ray))
        si.compute_uv_partials(ray)
        shares = [np.array(bsdf.far_share(bsdf.footprint(si))) for bsdf in (by_rays, by_angle)]
        assert np.allclose(*shares, rtol=0.02), shares
        assert np.allclose(shares[0], is_far, atol=1e-6) if is_far is not None else (0.05 < shares[0][0] < 0.95), shares
        if is_far is None:
            continue
        images = [np.array(mi.render(plane(bsdf, distance, integrator), spp=1, seed=2)) for bsdf in (by_angle, points)]
        if not is_far:
            assert np.allclose(*images, rtol=1e-3, atol=1e-6)
            continue
        spread = [image[..., 1].std() / image[..., 1].mean() for image in images]
        assert spread[0] < 0.02 and spread[1] > 5.0 * spread[0], spread
        want = np.array(mi.render(plane(points, distance, integrator), spp=1024, seed=3))
        error = abs(images[0].mean() / want.mean() - 1.0)
        assert error < 0.03, error


def example(name):
    """A script of examples/mitsuba."""
    sys.path.insert(0, str(ROOT / "examples" / "mitsuba"))
    return __import__(name)


@pytest.mark.slow(27)
def test_sigma_is_recovered_from_a_picture(file):
    """Inverse rendering: the absorption of three channels from one picture, to 5 %."""
    recover_sigma = example("recover_sigma")
    truth, filename = [0.002, 0.006, 0.012], file("jersey")
    photograph = mi.render(recover_sigma.scene(truth, filename), spp=256, seed=1000)
    got = recover_sigma.recover(photograph, filename)
    assert np.abs(got / truth - 1.0).max() < 0.05, f"{got}, want {truth}"


@pytest.mark.slow(8)
def test_both_hosts_agree(program, file):
    """The same cloth by `plywave render` and by Mitsuba: means within 1 %, pixels within noise."""
    means, squares, _, _ = example("both_hosts").compare(program, file("jersey"), 48, 64)
    assert np.abs(means - 1.0).max() < 0.01, means
    assert 0.8 < squares < 1.25, squares
