"""Parameters and attributes of the plugins of plywave.mitsuba, what their calls take, and the shapes that they can be on, in every variant.

What an attribute or a list does is held to Mitsuba's own BSDFs; what an update does, to a plugin that is loaded with the value.
"""

import math

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba")
dr = pytest.importorskip("drjit")

mi.set_variant("scalar_rgb")
import plywave  # noqa: E402
import plywave.mitsuba  # noqa: E402  (registers the plugins)

from conftest import FABRICS  # noqa: E402

VARIANTS = ["scalar_rgb", "scalar_spectral", "llvm_ad_rgb", "llvm_ad_spectral"]
PLY = {"type": "plywave_ply", "filename": str(FABRICS / "models" / "polyester.pwm")}


@pytest.fixture(autouse=True)
def _variant():
    yield
    mi.set_variant("llvm_ad_rgb")


@pytest.fixture(scope="session")
def organza(woven):
    return {"type": "plywave_cloth", "filename": woven("organza"), "um_per_uv": 1000.0}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A round fiber of one wavelength that sends the same to all azimuths."""
    tensors = {
        "lambda_um": np.array([0.55]),
        "theta_i": 0.5 * np.pi * (np.arange(2) + 0.5) / 2,
        "phi_i": np.zeros(1),
        "width_um": np.array([10.0]),
        "c_x_um": np.full((1, 2, 1), 8.0),
        "c_abs_um": np.full((1, 2, 1), 2.0),
        "azimuthal": np.full((1, 2, 1, 16), 0.75 / (2 * np.pi), np.float32),
    }
    document = {"format": "plywave-fiber", "version": 1, "program_version": "0", "preset": "test", "seed": 1, "spec": "made up"}
    document |= {"source": "wave", "symmetry": {"folds": 0, "mirror_rad": None}, "beta_m_rad": 0.15}
    filename = str(tmp_path_factory.mktemp("fiber") / "round.pwf")
    plywave.Fiber.from_tensors(tensors, document).save(filename)
    return {"type": "plywave_fiber", "filename": filename, "width": "curve"}


def hit(uv=(0.31, 0.17), wi=(0.3, 0.2, 0.9)):
    """A hit of a plane whose uv run along x and y."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.uv, si.wi, si.n = mi.Point2f(*uv), unit(wi), [0, 0, 1]
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.dp_du, si.dp_dv = [1, 0, 0], [0, 1, 0]
    if "spectral" in mi.variant():
        si.wavelengths = [450, 500, 550, 650]
    return si


def unit(w):
    return mi.Vector3f(*(float(x) for x in np.array(w) / np.linalg.norm(w)))


def f_of(bsdf, si, wo=(-0.4, 0.5, 0.6)):
    return np.array(bsdf.eval(mi.BSDFContext(), si, unit(wo))).ravel()


def value(x):
    return np.array(x, np.float64).ravel()


def answer(call):
    """What a call gives, or the words of what it raises."""
    try:
        return tuple(value(call()))
    except RuntimeError as error:
        return str(error)


@pytest.mark.parametrize("variant", VARIANTS)
def test_attributes(variant, table, organza):
    """Unknown names are answered as by Mitsuba's own BSDFs, textures by their value."""
    mi.set_variant(variant)
    own, si = mi.load_dict({"type": "diffuse"}), hit()
    color = {"type": "rgb", "value": [0.2, 0.3, 0.4]}
    plugins = [mi.load_dict(keys) for keys in (organza | {"warp_color": color, "weft_sigma_per_um": 0.003}, PLY | {"sigma_per_um": 0.004}, table)]
    for bsdf in plugins:
        for name in ("roughness", "", "um_per_uv.x"):
            assert answer(lambda: bsdf.has_attribute(name)) == answer(lambda: own.has_attribute(name)) == (0.0,)
            for call in ("eval_attribute", "eval_attribute_1", "eval_attribute_3"):
                got, want = (answer(lambda: getattr(b, call)(name, si)) for b in (bsdf, own))
                assert got == want, f"{call}: {got}, Mitsuba's own {want}"
                assert "llvm" in variant or "Invalid attribute requested" in got
    cloth, ply, fiber = plugins
    shown = [{"um_per_uv", "dyes_per_um", "warp_color", "weft_sigma_per_um"}, {"sigma_per_um"}, {"beta_m_rad"}]
    for bsdf, names in zip(plugins, shown):
        assert {key.partition(".value")[0] for key in mi.traverse(bsdf).keys()} == names
        assert all(answer(lambda: bsdf.has_attribute(name)) == (1.0,) for name in names)
        assert "\n" not in str(bsdf) and type(bsdf.to_string()) is str
    assert np.allclose(value(ply.eval_attribute_1("sigma_per_um", si)), 0.004)
    assert np.allclose(value(cloth.eval_attribute("weft_sigma_per_um", si)), 0.003)
    assert np.allclose(value(fiber.eval_attribute_1("beta_m_rad", si)), 0.15)
    if variant.endswith("rgb"):
        assert np.allclose(value(cloth.eval_attribute("warp_color", si)), [0.2, 0.3, 0.4])
        assert np.allclose(value(cloth.eval_attribute_3("warp_color", si)), [0.2, 0.3, 0.4])


def set_to(bsdf, key, new):
    params = mi.traverse(bsdf)
    params[key] = new
    params.update()
    return mi.traverse(bsdf)[key]


@pytest.mark.parametrize("variant", VARIANTS)
def test_updates(variant, table, organza):
    """A parameter that is set is that of a plugin loaded with it; in scalar variants so is f."""
    mi.set_variant(variant)
    is_scalar, si = variant.startswith("scalar"), hit()
    numbers = (lambda *x: np.array(x, np.float32)) if is_scalar else (lambda *x: mi.Float(x))

    fiber = mi.load_dict(table)
    for new in (0.3, numbers(0.25), 0.4):
        assert np.allclose(value(set_to(fiber, "beta_m_rad", new)), value(new)) and np.allclose(value(fiber.beta), value(new))
    ply = mi.load_dict(PLY | {"sigma_per_um": 0.004})
    assert np.allclose(value(set_to(ply, "sigma_per_um.value", 0.001)), 0.001)
    cloth = mi.load_dict(organza)
    assert np.allclose(value(set_to(cloth, "um_per_uv", [700.0, 800.0])), [700.0, 800.0])
    count = len(mi.traverse(cloth)["dyes_per_um"])
    assert np.allclose(value(set_to(cloth, "dyes_per_um", numbers(*[0.003] * count))), 0.003)

    pairs = [(fiber, table | {"beta_m_rad": 0.4}), (ply, PLY | {"sigma_per_um": 0.001})]
    sigma = {"sigma_per_um": 0.003}
    if is_scalar:
        pairs.append((cloth, organza | {"um_per_uv": mi.ScalarPoint3f(700.0, 800.0, 0.0)} | sigma))
    for bsdf, keys in pairs:
        got, want = f_of(bsdf, si), f_of(mi.load_dict(keys), si)
        assert want.max() > 0.0 and np.allclose(got, want, rtol=1e-5), f"{keys['type']}: {got}, want {want}"

    for key, bad in [("um_per_uv", [-1.0, 5.0]), ("um_per_uv", 0.0), ("um_per_uv", [1.0, math.inf]), ("dyes_per_um", 0.1)]:
        with pytest.raises(ValueError, match=f"plywave_cloth: {key}: ") as told:
            set_to(mi.load_dict(organza), key, bad)
        assert "\n" not in str(told.value)
    # In scalar variants Mitsuba itself refuses it.
    with pytest.raises((ValueError, RuntimeError), match="plywave_fiber: beta_m_rad: 2 values: expected 1|incompatible input sizes|Incompatible"):
        set_to(mi.load_dict(table), "beta_m_rad", numbers(0.1, 0.2))


@pytest.mark.parametrize("bad", [-1.0, 0.0, math.nan, math.inf, "1000, -1000"])
def test_lengths_of_uv_are_checked(bad, organza):
    with pytest.raises(Exception, match="plywave_cloth: um_per_uv: .*: expected one or two numbers above 0"):
        if isinstance(bad, str):
            mi.load_string(f'<bsdf version="3.0.0" type="plywave_cloth"><string name="filename" value="{organza["filename"]}"/><vector name="um_per_uv" value="{bad}, 0"/></bsdf>')
        else:
            mi.load_dict(organza | {"um_per_uv": bad})
    with pytest.raises(Exception, match="plywave_cloth: to_uv: .*: expected a transform that can be inverted"):
        mi.load_dict(organza | {"to_uv": mi.ScalarTransform4f([[1, 1, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])})


@pytest.mark.parametrize("bad", [-0.001, math.nan, math.inf])
def test_numbers_are_checked(bad, table, organza):
    for keys, key in [(PLY, "sigma_per_um"), (organza, "warp_sigma_per_um"), (organza, "weft_color"), (organza, "rotation_deg"), (table, "rotation_deg"), (table, "beta_m_rad")]:
        if key == "rotation_deg" and math.isfinite(bad):
            continue
        with pytest.raises(Exception, match=f"{keys['type']}: {key}: .*: expected "):
            mi.load_dict(keys | {key: bad})


@pytest.mark.parametrize("turn_deg, mirror", [(90.0, 1.0), (37.0, 1.0), (0.0, -1.0), (120.0, -1.0)])
def test_to_uv_turns_the_pattern(turn_deg, mirror, organza):
    """A cloth under turned or mirrored uv is the cloth itself, with directions and place turned or mirrored alike."""
    mi.set_variant("scalar_rgb")
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    matrix = np.array([[c, -s * mirror], [s, c * mirror]])
    to_uv = mi.ScalarTransform4f([[*matrix[0], 0, 0.1], [*matrix[1], 0, 0.08], [0, 0, 1, 0], [0, 0, 0, 1]])
    plain, turned = mi.load_dict(organza), mi.load_dict(organza | {"to_uv": to_uv})
    uv, wi, wo = np.array([0.31, 0.17]), (0.3, 0.2, 0.9), (-0.4, 0.5, 0.6)

    def image(w):
        return (*(matrix @ w[:2]), w[2])

    want = f_of(plain, hit(matrix @ uv + (0.1, 0.08), image(wi)), image(wo))
    got = f_of(turned, hit(uv, wi), wo)
    assert want.max() > 0.0 and np.allclose(got, want, rtol=2e-3), f"{got}, want {want}"
    # A sample of the one is the image of a sample of the other.
    drawn = turned.sample(mi.BSDFContext(), hit(uv, wi), 0.3, [0.6, 0.2])[0].wo
    of_plain = plain.sample(mi.BSDFContext(), hit(matrix @ uv + (0.1, 0.08), image(wi)), 0.3, [0.6, 0.2])[0].wo
    assert np.allclose(image(np.array(drawn)), np.array(of_plain), atol=2e-3)


@pytest.mark.parametrize("variant", ["scalar_rgb", "scalar_spectral", "llvm_ad_rgb"])
def test_calls_take_what_mitsubas_own_take(variant, table, organza):
    mi.set_variant(variant)
    context, si, wo = mi.BSDFContext(), hit(), unit((-0.4, 0.5, 0.6))
    own, plugins = mi.load_dict({"type": "roughplastic"}), [PLY, table] + ([organza] if variant == "scalar_rgb" else [])
    pairs = [[0.6, 0.2], (0.6, 0.2), np.array([0.6, 0.2], np.float32), mi.Point2f(0.6, 0.2)]
    for bsdf in (own, *(mi.load_dict(keys) for keys in plugins)):
        want = value(bsdf.sample(context, si, 0.3, pairs[-1])[0].wo)
        f, pdf = (value(x) for x in bsdf.eval_pdf(context, si, wo))
        for sample in pairs:
            assert np.allclose(value(bsdf.sample(context, si, mi.Float(0.3), sample, True)[0].wo), want)
        for direction in ([float(x) for x in value(wo)], tuple(float(x) for x in value(wo)), mi.Vector3f(wo)):
            assert np.allclose(value(bsdf.eval(context, si, direction)), f) and np.allclose(value(bsdf.pdf(context, si, direction)), pdf)
            first, density, bs, _ = bsdf.eval_pdf_sample(context, si, direction, 0.3, [0.6, 0.2])
            assert np.allclose(value(first), f) and np.allclose(value(density), pdf) and np.allclose(value(bs.wo), want)
        assert bsdf is own or not value(bsdf.eval(context, si, wo, False)).any()


class Heard(mi.Appender):
    """What Mitsuba logs."""

    def __init__(self):
        super().__init__()
        self.lines = []

    def append(self, level, text):
        self.lines.append(text)

    def log_progress(self, *_):
        pass


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb"])
def test_shapes_that_cannot_carry_their_plugin(variant, table):
    mi.set_variant(variant)
    ply, within = mi.load_dict(PLY), {"type": "mask", "opacity": 0.5, "bsdf": table}
    for shape, bsdf, words in [
        ("sphere", ply, "yarn: a Sphere: plywave_ply is for curves: use a bsplinecurve, or a tube with uv"),
        ("disk", within, "yarn: a Disk: plywave_fiber is for curves"),
        ("rectangle", {"type": "twosided", "bsdf": within}, None),
        ("cylinder", ply, None),
        ("cube", ply, None),
        ("sphere", {"type": "diffuse"}, None),
    ]:
        scene = {"type": "scene", "yarn": {"type": shape, "bsdf": bsdf}}
        try:
            scene = mi.load_dict(scene)
        except RuntimeError:
            # Mitsuba's `twosided` takes no BSDF that transmits.
            assert bsdf is not ply
            continue
        if words is None:
            plywave.mitsuba.check(scene)
            continue
        with pytest.raises(ValueError) as told:
            plywave.mitsuba.check(scene)
        assert words in str(told.value)
    # Without the check the same line comes with the first call, once.
    scene = mi.load_dict({"type": "scene", "yarn": {"type": "sphere", "bsdf": PLY}})
    bsdf, heard = scene.shapes()[0].bsdf(), Heard()
    mi.logger().add_appender(heard)
    try:
        si = hit()
        if variant.startswith("scalar"):
            si = scene.ray_intersect(mi.Ray3f([0, 0.2, 5], [0, 0, -1]))
        for _ in range(2):
            bsdf.say_misfit(si)
    finally:
        mi.logger().remove_appender(heard)
    assert len(heard.lines) == 1 and "yarn: a Sphere: plywave_ply is for curves" in heard.lines[0], heard.lines
