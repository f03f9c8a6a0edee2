"""Values: those of the command line, of identities that any scattering function keeps, and of one query at a time."""

import json
import subprocess

import numpy as np
import pytest

import plywave


def directions(rng, *shape):
    w = rng.normal(size=(*shape, 3))
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def sphere(rows, columns):
    """Centers and solid angles of bins of the sphere."""
    edges = np.linspace(-np.pi / 2, np.pi / 2, rows + 1)
    theta = 0.5 * (edges[1:] + edges[:-1])[:, None]
    phi = (2 * np.pi / columns * (np.arange(columns) + 0.5))[None, :]
    area = np.broadcast_to(np.diff(np.sin(edges))[:, None] * 2 * np.pi / columns, (rows, columns))
    w = np.stack(np.broadcast_arrays(np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)), -1)
    return w, area


@pytest.mark.parametrize("theta_i, h_rel, theta_o, phi_o", [(30, 0.2, -30, 270), (0, 0, 10, 90), (60, -0.8, -50, 200)])
def test_values_are_those_of_the_program(polyester, fabrics, program, theta_i, h_rel, theta_o, phi_o):
    sigma = [0.0, 0.001, 0.02]
    flags = ["--theta-i", theta_i, "--h-rel", h_rel, "--sigma", "0,0.001,0.02", "--theta-o", theta_o, "--phi-o", phi_o]
    out = subprocess.run([program, "eval", fabrics / "models" / "polyester.pwm", *map(str, flags), "--json"], check=True, capture_output=True)
    want = json.loads(out.stdout)
    t, p = np.radians(theta_o), np.radians(phi_o)
    w = [np.cos(t) * np.cos(p), np.cos(t) * np.sin(p), np.sin(t)]
    at = (np.radians(theta_i), want["h_um"])
    f, pdf = polyester.eval_pdf(*at, w, sigma, edge=False)
    np.testing.assert_allclose(f, want["f_per_sr"], rtol=1e-5)
    np.testing.assert_allclose(pdf, want["pdf_per_sr"], rtol=1e-5)
    np.testing.assert_allclose(polyester.albedo(*at, sigma, edge=False), want["albedo"], rtol=1e-6)
    np.testing.assert_allclose(polyester.r_d(*at), want["r_d"], rtol=1e-5, atol=1e-7)
    terms = polyester.terms(*at, w, sigma, edge=False)
    np.testing.assert_allclose(terms.high, want["high_per_sr"], rtol=1e-5)
    np.testing.assert_allclose(terms.refl, want["refl_per_sr"], rtol=1e-5)


def test_stored_reference_values(polyester):
    """The values that the file's writer stored for readers of its format."""
    stored = polyester.document["reference_values"]
    assert len(stored) > 5
    got = [polyester.eval(v["theta_i"], v["h_um"], v["wo"], v["sigma_per_um"], edge=False) for v in stored]
    peak = max(np.max(v["value"]) for v in stored)
    np.testing.assert_allclose(np.ravel(got), np.ravel([v["value"] for v in stored]), atol=1e-4 * peak)
    assert polyester.reference_error < 1e-4


def test_white_furnace(polyester):
    """Integral of f is the albedo, and all light of clear fibers is kept."""
    w, area = sphere(240, 480)
    for theta_i, h_um in [(0.3, 5.0), (0.9, -30.0)]:
        f = polyester.eval(theta_i, h_um, w, 0.0)[..., 0]
        albedo = polyester.albedo(theta_i, h_um, 0.0)[0]
        assert abs((f * area).sum() - albedo) < 5e-3
        assert abs(albedo + polyester.straight(theta_i, h_um, 0.0)[0] - 1.0) < 5e-3


@pytest.mark.parametrize("n", range(1, 9))
def test_samples_keep_their_promises(polyester, jersey, n):
    """weight pdf = eval for any number of channels; outcomes add up to 1 and are those of the samples."""
    rng = np.random.default_rng(n)
    sigma = rng.uniform(0.0, 0.02, n).astype(np.float32)
    lambdas = np.linspace(0.45, 0.65, n)
    u = rng.uniform(size=(20000, 3))
    s = polyester.sample(0.4, 12.0, u, sigma, lambdas)
    hit = s.event == plywave.SCATTERED
    f, pdf = polyester.eval_pdf(0.4, 12.0, s.w[hit], sigma, lambdas)
    np.testing.assert_allclose(pdf, s.pdf[hit], rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(f, s.weight[hit] * s.pdf[hit][:, None], rtol=2e-3, atol=1e-6)
    chances = polyester.outcomes(0.4, 12.0, sigma, lambdas)
    assert abs(sum(chances) - 1.0) < 1e-6
    for event, chance in [(plywave.SCATTERED, chances.scattered), (plywave.STRAIGHT, chances.straight)]:
        assert abs((s.event == event).mean() - chance) < 5 * np.sqrt(0.25 / len(u))
    mean = np.where(hit[:, None], s.weight, 0.0).mean(0)
    np.testing.assert_allclose(mean, polyester.albedo(0.4, 12.0, sigma, lambdas), atol=5 * s.weight.std() / np.sqrt(len(u)))
    position = rng.uniform(0.0, 2000.0, (500, 2))
    at = (position, [0.0, 0.6, 0.8])
    s = jersey.sample(*at, u[:500], lambdas)
    f, pdf = jersey.eval_pdf(*at, s.w, lambdas)
    hit = s.event == plywave.SCATTERED
    np.testing.assert_allclose(f[hit], (s.weight * s.pdf[:, None])[hit], rtol=5e-3, atol=1e-6)
    np.testing.assert_allclose(pdf[hit], s.pdf[hit], rtol=5e-3, atol=1e-6)


def test_light_that_goes_straight_on(polyester):
    """Without its edge a ply lets what misses it pass, along the beam."""
    s = polyester.sample(0.5, 60.0, np.random.default_rng(3).uniform(size=(20000, 3)), 0.0, edge=False)
    straight = s.event == plywave.STRAIGHT
    assert straight.any()
    np.testing.assert_allclose(s.w[straight], np.tile([0.0, -np.cos(0.5), -np.sin(0.5)], (straight.sum(), 1)), atol=1e-6)
    np.testing.assert_allclose(polyester.straight(0.5, 60.0, 0.0, edge=False)[0], polyester.r_d(0.5, 60.0), rtol=1e-5)
    beside = polyester.sample(0.0, 1e4, [0.5, 0.5, 0.5], 0.01, edge=False)
    assert beside.event == plywave.STRAIGHT and beside.weight[0] == 1.0 and beside.pdf == 1.0


def test_what_is_no_number_gives_zero(polyester, jersey):
    assert (polyester.eval(np.nan, 0.0, [0.0, 1.0, 0.0], 0.0, edge=False) == 0).all()
    assert (polyester.eval(0.3, 0.0, [np.inf, 1.0, 0.0], 0.0) == 0).all()
    assert np.isfinite(jersey.eval([np.nan, np.inf], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0])).all()


def test_one_query_at_a_time_is_the_same(polyester):
    """Runs of equal queries, kernels for many incidences and single calls agree to rounding."""
    rng = np.random.default_rng(5)
    n = 300
    theta_i, h_um, w = rng.uniform(0, 1.4, n), rng.uniform(-60, 60, n), directions(rng, n)
    sigma = rng.uniform(0, 0.02, (n, 3))
    for edge in (True, False):
        many = polyester.eval(theta_i, h_um, w, sigma, edge=edge)
        one = np.stack([polyester.eval(theta_i[i], h_um[i], w[i], sigma[i], edge=edge) for i in range(n)])
        np.testing.assert_allclose(many, one, rtol=2e-4, atol=1e-6)
        f, pdf = polyester.eval_pdf(theta_i, h_um, w, sigma, edge=edge)
        np.testing.assert_allclose(f, many, rtol=2e-4, atol=1e-6)
        np.testing.assert_allclose(pdf, polyester.pdf(theta_i, h_um, w, sigma, edge=edge), rtol=2e-4, atol=1e-6)


def test_speckle(fabrics, polyester):
    """Places differ from the smooth model and have its mean."""
    assert polyester.has_noise
    rng = np.random.default_rng(2)
    w = directions(rng, 50)
    smooth = polyester.eval(0.2, 3.0, w, 0.0, edge=False)[..., 0]
    many = polyester.eval(0.2, 3.0, w[:, None], 0.0, edge=False, place=plywave.Place(np.arange(4000)), relief=False)[..., 0]
    same = polyester.eval(0.2, 3.0, w, 0.0, edge=False, place=plywave.Place(7), relief=False, speckle=False)[..., 0]
    np.testing.assert_allclose(same, smooth, rtol=1e-5)
    shown = polyester.eval(0.2, 3.0, w, 0.0, edge=False, place=plywave.Place(7, 0.5, 100.0, 2.0), speckle=False)[..., 0]
    assert np.abs(shown / smooth - 1.0).max() > 0.05
    assert many.std(1).max() > 0.05 * smooth.max()
    some = smooth > 0.05 * smooth.max()
    assert np.abs(many.mean(1)[some] / smooth[some] - 1.0).mean() < 0.1


def test_fibers(fiber):
    rng = np.random.default_rng(4)
    u = rng.uniform(size=(5000, 3))
    omega_i, lambdas = [0.6, 0.0, 0.8], [0.45, 0.6]
    s = fiber.sample(omega_i, u, lambdas)
    f, pdf = fiber.eval_pdf(omega_i, s.w, lambdas)
    np.testing.assert_allclose(f, s.weight * s.pdf[:, None], rtol=1e-3, atol=1e-6)
    w, area = sphere(360, 720)
    np.testing.assert_allclose((fiber.eval(omega_i, w, lambdas) * area[..., None]).sum((0, 1)), fiber.albedo(omega_i, lambdas), rtol=0.01)
    assert (fiber.width_um(omega_i, lambdas) <= fiber.max_width_um).all()
    narrow = fiber.with_beta_m(0.02)
    assert narrow.eval(omega_i, [-0.6, 0.0, -0.8], 0.5) > fiber.eval(omega_i, [-0.6, 0.0, -0.8], 0.5)
    assert sum(fiber.outcomes(omega_i, lambdas)) == 1.0


def test_a_second_layer_is_the_formula(polyester):
    """f over a second layer against its terms put together by hand: the ply's own lobes above, what it sends forward made diffuse and shared out between the layers (Yu 2025,
    5.4). The forward energy is that of the lobes, integrated."""
    w, area = sphere(240, 480)
    sigma, theta_i, h_um = np.array([0.0, 0.002, 0.02]), 0.4, 12.0
    first, second = polyester.layer(theta_i, sigma), polyester.layer(-0.9, 2.0 * sigma)
    for part in (first, second):
        np.testing.assert_allclose((part.reflected + part.transmitted)[0], 1.0, atol=1e-3)
        assert (np.diff(part.reflected) < 0.0).all() and (np.diff(part.transmitted_diffuse) < 0.0).all()
    terms = polyester.terms(theta_i, h_um, w, sigma, edge=False)
    own, y = terms.refl + terms.high, w[..., 1][..., None]
    forward = ((own * area[..., None]) * (y < 0.0)).sum((0, 1))
    between = 1.0 / (1.0 - first.reflected_diffuse * second.reflected_diffuse)
    through = first.transmitted * second.transmitted_diffuse * between
    back = first.transmitted * second.reflected_diffuse * first.transmitted_diffuse * between
    r_d = polyester.r_d(theta_i, h_um)
    below = (forward * through / first.transmitted + r_d * second.transmitted) * -y / np.pi
    above = own + (forward * back / first.transmitted + r_d * second.reflected) * y / np.pi
    f = polyester.eval(theta_i, h_um, w, sigma, below=second)
    want = np.where(y < 0.0, below, above)
    assert np.abs(f - want).max() < 5e-3 * want.max()
    albedo = polyester.albedo(theta_i, h_um, sigma, below=second)
    np.testing.assert_allclose((f * area[..., None]).sum((0, 1)), albedo, atol=5e-3)
    assert abs(albedo[0] - 1.0) < 2e-3 and (albedo[1:] < 0.99).all()
    # A layer a query is the same as one for all.
    many = polyester.layer(np.full(5, -0.9), 2.0 * sigma)
    np.testing.assert_allclose(polyester.eval(theta_i, h_um, w[7, :5], sigma, below=many), polyester.eval(theta_i, h_um, w[7, :5], sigma, below=second), rtol=1e-4)


def test_slits_take_from_high_what_they_send(polyester):
    """All light of a slit is of f_high; at no share nothing is; wavelengths count."""
    w, area = sphere(240, 480)
    sigma, lambdas, at = np.array([0.0, 0.002, 0.02]), [0.45, 0.55, 0.65], (0.4, 12.0)
    slit = plywave.Slit(2.0, 0.25)
    plain = polyester.terms(*at, w, sigma, lambdas)
    terms = polyester.terms(*at, w, sigma, lambdas, slit=slit)
    energy = lambda f: (f * area[..., None]).sum((0, 1))  # noqa: E731
    lost, sent = energy(plain.high) - energy(terms.high), energy(terms.slit)
    assert (sent > 0.005).all()
    np.testing.assert_allclose(lost, sent, rtol=0.02, atol=1e-4)
    f = polyester.eval(*at, w, sigma, lambdas, slit=slit)
    np.testing.assert_allclose(f, sum(terms), rtol=1e-4, atol=1e-5)
    assert np.abs(terms.slit[..., 0] / terms.slit[..., 0].max() - terms.slit[..., 2] / terms.slit[..., 2].max()).max() > 0.1
    none = polyester.eval(*at, w, sigma, lambdas, slit=plywave.Slit(2.0, 0.0))
    np.testing.assert_allclose(none, polyester.eval(*at, w, sigma, lambdas), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("more", ["below", "slit"])
def test_samples_of_layers_and_slits_keep_their_promises(polyester, more):
    sigma, at = np.array([0.0, 0.002, 0.02], np.float32), (0.4, 12.0)
    keys = {"below": polyester.layer(0.9, sigma)} if more == "below" else {"slit": plywave.Slit(3.0)}
    u = np.random.default_rng(3).uniform(size=(20000, 3))
    s = polyester.sample(*at, u, sigma, **keys)
    hit = s.event == plywave.SCATTERED
    f, pdf = polyester.eval_pdf(*at, s.w[hit], sigma, **keys)
    np.testing.assert_allclose(pdf, s.pdf[hit], rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(f, s.weight[hit] * s.pdf[hit][:, None], rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(s.weight[hit].sum(0) / len(u), polyester.albedo(*at, sigma, **keys), rtol=0.02)


def test_layers_and_slits_that_cannot_be_are_told(polyester):
    at = (0.4, 12.0, [0.0, 1.0, 0.0], [0.0, 0.01])
    for slit, words in [(plywave.Slit(9.0), "width_um"), (plywave.Slit(1.0, 2.0), "share"), ((1.0, 0.2), "slit: tuple: give a Slit")]:
        with pytest.raises(plywave.Error, match=words):
            polyester.eval(*at, slit=slit)
    layer = polyester.layer(0.4, [0.0, 0.01])
    with pytest.raises(plywave.Error, match="below: dict: give a Layer"):
        polyester.eval(*at, below=layer._asdict())
    with pytest.raises(plywave.Error, match="below: not finite"):
        polyester.eval(*at, below=layer._replace(reflected=np.array([np.nan, 0.0])))
    with pytest.raises(plywave.Error, match="last axes differ"):
        polyester.eval(*at, below=polyester.layer(0.4, [0.0, 0.01, 0.02]))
    bare = {name: value for name, value in polyester.tensors().items() if not name.startswith("layer")}
    single = plywave.Model.from_tensors(bare, polyester.document)
    assert polyester.has_layers and not single.has_layers
    for call in (lambda: single.layer(0.4, 0.0), lambda: single.eval(*at, below=layer)):
        with pytest.raises(plywave.Error, match="layers = absent: the model has no layer factors"):
            call()


FILAMENT = """
name = "hair"
lambda_um = [0.6, 0.55, 0.45]
sigma_per_um = [0.001, 0.004, 0.01]
[filament]
kind = "dielectric"
eta = 1.55
radius_um = 20
"""


def test_analytic_fibers(tmp_path):
    file = tmp_path / "hair.toml"
    file.write_text(FILAMENT)
    fiber = plywave.load(file)
    assert isinstance(fiber, plywave.Fiber) and fiber.max_width_um == 40.0
    assert np.allclose(fiber.lambda_um, [0.6, 0.55, 0.45])
    omega_i = np.array([0.6, 0.0, 0.8])
    # The sphere by a product rule: the integral of f is the albedo, which absorption lowers from one
    # wavelength to the next.
    z, weight = np.polynomial.legendre.leggauss(400)
    phi = 2 * np.pi * (np.arange(720) + 0.5) / 720
    radius = np.sqrt(1 - z**2)[:, None]
    w = np.stack([radius * np.cos(phi), radius * np.sin(phi), np.broadcast_to(z[:, None], (400, 720))], -1)
    f = fiber.eval(omega_i, w, fiber.lambda_um)
    albedo = fiber.albedo(omega_i, fiber.lambda_um)
    assert np.allclose((f * weight[:, None, None]).sum((0, 1)) * 2 * np.pi / 720, albedo, atol=0.01)
    assert albedo[0] > albedo[1] > albedo[2] > 0.2
    # The far field is the mean of the near field over the offsets.
    h = (np.arange(2000) + 0.5) / 1000 - 1
    near = fiber.albedo(omega_i, fiber.lambda_um, h_rel=h).mean(0)
    assert np.allclose(near, albedo, atol=2e-3)
    # The spec's color by hand; a clear fiber keeps its light, at any number of wavelengths.
    given = fiber.albedo(omega_i, fiber.lambda_um, sigma_per_um=[0.001, 0.004, 0.01])
    assert np.array_equal(given, albedo)
    assert np.allclose(fiber.albedo(omega_i, 0.55, sigma_per_um=0.0), 1.0, atol=2e-3)
    with pytest.raises(plywave.Error, match="3 wavelengths.*give sigma_per_um"):
        fiber.albedo(omega_i, 0.55)
    with pytest.raises(plywave.Error, match="no table"):
        fiber.save(tmp_path / "hair.pwf")
    with pytest.raises(plywave.Error, match="filament.eta = 0.5"):
        plywave.Fiber.from_bytes(FILAMENT.replace("1.55", "0.5").encode(), "x.toml")
    assert plywave.Fiber.from_bytes(FILAMENT.encode(), "x.toml").max_width_um == 40.0
