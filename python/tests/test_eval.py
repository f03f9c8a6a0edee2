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
def test_samples_keep_their_promises(polyester, satin, n):
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
    s = satin.sample(*at, u[:500], lambdas)
    f, pdf = satin.eval_pdf(*at, s.w, lambdas)
    hit = s.event == plywave.SCATTERED
    np.testing.assert_allclose(f[hit], (s.weight * s.pdf[:, None])[hit], rtol=5e-3, atol=1e-6)
    np.testing.assert_allclose(pdf[hit], s.pdf[hit], rtol=5e-3, atol=1e-6)


def test_light_that_goes_straight_on(polyester, satin):
    """Without its edge a ply lets what misses it pass, along the beam."""
    s = polyester.sample(0.5, 60.0, np.random.default_rng(3).uniform(size=(20000, 3)), 0.0, edge=False)
    straight = s.event == plywave.STRAIGHT
    assert straight.any()
    np.testing.assert_allclose(s.w[straight], np.tile([0.0, -np.cos(0.5), -np.sin(0.5)], (straight.sum(), 1)), atol=1e-6)
    np.testing.assert_allclose(polyester.straight(0.5, 60.0, 0.0, edge=False)[0], polyester.r_d(0.5, 60.0), rtol=1e-5)
    beside = polyester.sample(0.0, 1e4, [0.5, 0.5, 0.5], 0.01, edge=False)
    assert beside.event == plywave.STRAIGHT and beside.weight[0] == 1.0 and beside.pdf == 1.0


def test_what_is_no_number_gives_zero(polyester, satin):
    assert (polyester.eval(np.nan, 0.0, [0.0, 1.0, 0.0], 0.0, edge=False) == 0).all()
    assert (polyester.eval(0.3, 0.0, [np.inf, 1.0, 0.0], 0.0) == 0).all()
    assert np.isfinite(satin.eval([np.nan, np.inf], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0])).all()


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


def test_fabric_energy_and_colors(fabrics):
    white = plywave.Fabric(fabrics / "polyester_satin.toml", sigma_per_um=0.0)
    rng = np.random.default_rng(7)
    position = rng.uniform(0.0, 3000.0, (400, 2))
    kept = white.albedo(position, [0.3, 0.2, 0.933]) + white.straight(position, [0.3, 0.2, 0.933])
    assert abs(kept.mean() - 1.0) < 0.02
    red = white.with_colors([0.7, 0.1, 0.1], [0.7, 0.1, 0.1])
    rgb = red.albedo(position, [0.3, 0.2, 0.933]).mean(0)
    assert rgb[0] > 3 * rgb[1] and red.color_of in ("even_sky", "reflected", "folded")
    black = white.with_colors(10.0, 10.0)
    assert black.albedo(position, [0.3, 0.2, 0.933]).mean() < rgb[0]
    sigma = white.sigma_of_reflectance([0.9, 0.5, 0.1])
    assert (np.diff(sigma) > 0).all()
    own = white.albedo(position, [0.3, 0.2, 0.933], sigma_per_um=([0.5, 0.5, 0.5], None))
    assert (own <= kept + 1e-5).all() and own.mean() < kept.mean()


def test_turned_fabrics(satin):
    """The pattern turned with both directions is the same."""
    rng = np.random.default_rng(11)
    position, wo, wi = rng.uniform(0, 500, (200, 2)), directions(rng, 200), directions(rng, 200)
    a = 0.7
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    around = lambda w: np.concatenate([w[..., :2] @ turn.T, w[..., 2:]], -1)  # noqa: E731
    f = satin.eval(position, wo, wi)
    g = satin.eval(position @ turn.T, around(wo), around(wi), turn_rad=a)
    assert np.median(np.abs(f - g) / (np.abs(f) + 1e-3)) < 1e-3


def test_speckle(fabrics, polyester):
    """Instances differ from the smooth model and have its mean."""
    assert polyester.has_noise
    rng = np.random.default_rng(2)
    w = directions(rng, 50)
    smooth = polyester.eval(0.2, 3.0, w, 0.0, edge=False)[..., 0]
    many = polyester.eval(0.2, 3.0, w[:, None], 0.0, edge=False, instance=np.arange(4000))[..., 0]
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
