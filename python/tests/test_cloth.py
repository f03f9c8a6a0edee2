"""Cloths of curves: files, specs and the cache, queries on arrays, colors, and what is refused."""

import json
import os
import pickle
import shutil
import subprocess

import numpy as np
import pytest
from conftest import CLOTHS, FABRICS

import plywave

JERSEY = CLOTHS / "jersey.toml"
#: What is said of its plies, whose model the spec does not name.
FOUND = ["yarn: the model cotton_single of the library"]
YARN = {"model": "polyester_bundle", "fiber": "polyester", "count": "11.904 dtex", "packing": 0.65}
VOILE = {
    "name": "voile",
    "weave": {"kind": "plain", "ends_per_cm": 150, "picks_per_cm": 150},
    "warp": {**YARN, "color": [0.7, 0.1, 0.1]},
    "weft": {"as": "warp", "sigma_per_um": 0.002},
}


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cloths")


@pytest.fixture(autouse=True)
def cache_of_its_own(cache, monkeypatch):
    monkeypatch.setenv("PLYWAVE_CACHE", str(cache))


def made(kept_in, *args, **options):
    """A cloth of a spec, for longer than a test, whose cache is that folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PLYWAVE_CACHE", str(kept_in))
        return plywave.Cloth(*args, **options)


@pytest.fixture(scope="session")
def jersey(cache):
    steps = []
    cloth = made(cache, JERSEY, progress=lambda stage, unit, done, total: steps.append(stage))
    assert "mean over the cell" in steps, steps
    return cloth


@pytest.fixture(scope="session")
def pwc(jersey, tmp_path_factory):
    path = tmp_path_factory.mktemp("file") / "jersey.pwc"
    jersey.save(path)
    return path


@pytest.fixture(scope="session")
def voile(tmp_path_factory):
    # No folder can be made in place of a file.
    cache = tmp_path_factory.mktemp("none") / "file"
    cache.write_bytes(b"")
    cloth = made(cache, VOILE, folder=CLOTHS)
    assert "could not be kept" in cloth.notes[0], cloth.notes
    return cloth


def queries(n, seed=1):
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(2, n, 3))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    return 9000.0 * rng.uniform(size=(n, 2)), w[0], w[1]


def test_cloths_of_specs_are_made_once_and_kept(jersey, cache):
    kept = list(cache.iterdir())
    assert [path.suffix for path in kept] == [".pwc"]
    assert any("was made and is kept in" in note and str(kept[0]) in note for note in jersey.notes), jersey.notes
    again = plywave.Cloth(JERSEY)
    assert again.notes == FOUND and again.to_bytes() == jersey.to_bytes() == kept[0].read_bytes()
    text = plywave.Cloth(JERSEY.read_text(), folder=JERSEY.parent)
    assert text.notes == FOUND and text.to_bytes() == again.to_bytes()
    assert isinstance(plywave.load(JERSEY), plywave.Cloth) and list(cache.iterdir()) == kept


def test_weaving_gives_the_same_file(jersey, woven):
    made = plywave.Cloth(woven("jersey"))
    assert made.to_bytes() == jersey.to_bytes() and made.notes == []


@pytest.mark.slow(7)
def test_a_damaged_cloth_is_made_again(jersey, cache, tmp_path, monkeypatch):
    (kept,) = cache.iterdir()
    damaged = tmp_path / kept.name
    damaged.write_bytes(kept.read_bytes()[:-1])
    monkeypatch.setenv("PLYWAVE_CACHE", str(tmp_path))
    assert "was made" in plywave.Cloth(JERSEY).notes[-1] and damaged.read_bytes() == jersey.to_bytes()


def test_files_give_the_cloth(jersey, pwc):
    at, wo, wi = queries(300)
    read = plywave.load(pwc)
    assert isinstance(read, plywave.Cloth) and isinstance(read, plywave.Document)
    assert read.to_bytes() == jersey.to_bytes() == plywave.Cloth.from_bytes(pwc.read_bytes()).to_bytes()
    assert (read.eval(at, wo, wi) == jersey.eval(at, wo, wi)).all()
    tensors = read.tensors()
    assert tensors["far_f"].dtype == np.float16 and read.document["format"] == "plywave-cloth"
    assert plywave.Cloth.from_tensors(tensors, read.document).to_bytes() == read.to_bytes()
    assert read.name == "jersey" and "[knit]" in read.spec_text
    assert "jersey" in repr(read) and "thickness" in read._repr_html_()


def test_what_there_is_to_know(jersey, voile):
    (ax, ay), (bx, by) = jersey.cell_um
    assert ax > 100.0 and by > 100.0 and abs(ay) < 1.0 and abs(bx) < 1.0
    assert jersey.yarns == ("yarn",) and voile.yarns == ("warp", "weft")
    assert 100.0 < jersey.half_thickness_um < 1000.0 and jersey.has_far and jersey.memory_bytes > 1e6
    assert jersey.color_of == "even_sky"
    for model in (jersey.model_of(), jersey.model_of("yarn"), voile.model_of("weft")):
        assert isinstance(model, plywave.Model) and model.albedo(0.1, 0.0, 0.0)[0] > 0.5
    with pytest.raises(plywave.Error, match="use \"yarn\""):
        jersey.model_of("weft")
    noisy = plywave.Cloth.from_bytes(jersey.to_bytes(), noise=True)
    assert noisy.model_of().has_noise or any("stays smooth" in note for note in noisy.notes)


def test_queries_broadcast_and_do_not_depend_on_threads(jersey):
    at, wo, wi = queries(5000)
    plywave.set_threads(1)
    one = jersey.eval_pdf(at, wo, wi)
    plywave.set_threads(3)
    three = jersey.eval_pdf(at, wo, wi)
    assert (one[0] == three[0]).all() and (one[1] == three[1]).all()
    f, pdf = one
    assert f.shape == (5000, 3) and pdf.shape == (5000,) and (f == jersey.eval(at, wo, wi)).all()
    assert np.allclose(pdf, jersey.pdf(at, wo, wi), rtol=1e-5)
    grid = jersey.eval(at[:4, None], wo[:4, None], wi[None, :6], lambda_um=[0.45, 0.55, 0.65, 0.6], sigma_per_um=0.002)
    assert grid.shape == (4, 6, 4)
    alone = jersey.eval(at[2], wo[2], wi[5], lambda_um=[0.45, 0.55, 0.65, 0.6], sigma_per_um=0.002)
    assert np.allclose(grid[2, 5], alone, rtol=2e-5, atol=1e-7)


def test_turned_patterns(jersey):
    """The pattern turned with both directions is the same; turned alone it is not."""
    at, wo, wi = queries(200, seed=11)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    around = lambda w: np.concatenate([w[..., :2] @ turn.T, w[..., 2:]], -1)  # noqa: E731
    f, alone = jersey.eval(at, wo, wi), jersey.eval(at, wo, wi, turn_rad=0.7)
    g = jersey.eval(at @ turn.T, around(wo), around(wi), turn_rad=0.7)
    assert np.median(np.abs(f - g) / (np.abs(f) + 1e-3)) < 1e-3 and not np.allclose(alone, f)


def test_light_is_kept(jersey, voile):
    for cloth in (jersey, voile):
        diffracted = plywave.Cloth.from_bytes(cloth.to_bytes(), sigma_per_um=0.0)
        clear = plywave.Cloth.from_bytes(cloth.to_bytes(), sigma_per_um=0.0, gaps="straight")
        at, wo, _ = queries(3000)
        wo[:, 2] = np.copysign(np.maximum(abs(wo[:, 2]), 0.3), wo[:, 2])
        wo /= np.linalg.norm(wo, axis=-1, keepdims=True)
        kept = clear.albedo(at, wo, 0.55) + clear.straight(at, wo, 0.55)
        assert kept.shape == (3000, 1) and abs(kept.mean() - 1.0) < 0.03, kept.mean()
        samples = clear.sample(at, wo, np.random.default_rng(2).uniform(size=(3000, 3)), 0.55)
        assert abs(samples.weight.mean() - 1.0) < 0.05, samples.weight.mean()
        scattered = samples.event == plywave.SCATTERED
        f, pdf = clear.eval_pdf(at[scattered], wo[scattered], samples.w[scattered], 0.55)
        assert np.allclose(pdf, samples.pdf[scattered], rtol=5e-3)
        assert np.allclose(f, samples.weight[scattered] * samples.pdf[scattered, None], rtol=1e-2, atol=1e-5)
        chances = clear.outcomes(at, wo, 0.55)
        assert np.allclose(chances.scattered + chances.straight + chances.absorbed, 1.0, atol=1e-4)
        gaps = clear.is_gap(at, wo)
        assert gaps.dtype == bool and 0.0 < gaps.mean() < 0.6 and np.allclose(clear.straight(at, wo, 0.55)[gaps], 1.0)
        assert (diffracted.straight(at, wo, 0.55)[gaps] == 0.0).all() and np.allclose(diffracted.albedo(at, wo, 0.55)[gaps], 1.0)
        assert (samples.event[gaps] == plywave.STRAIGHT).all() and np.allclose(samples.w[gaps], -wo[gaps], atol=1e-6)


def test_footprints_give_the_mean_over_the_cell(jersey, pwc):
    at, wo, wi = queries(4000, seed=3)
    wo, wi = [0.0, 0.6, 0.8], [0.6, 0.0, 0.8]
    points, far = jersey.eval(at, wo, wi), jersey.eval(at, wo, wi, footprint_um=5000.0)
    assert np.ptp(far, axis=0).max() < 1e-6 < np.ptp(points, axis=0).max()
    assert np.allclose(points.mean(0), far[0], rtol=0.15), (points.mean(0), far[0])
    near = plywave.Cloth(pwc, far=False, relief=False)
    assert not near.has_far and (near.eval(at, wo, wi, footprint_um=5000.0) == near.eval(at, wo, wi)).all()


def test_options_change_what_they_should(jersey, pwc):
    at, wo, wi = queries(2000, seed=4)
    usual = jersey.eval(at, wo, wi)
    for option in ({"layers": False}, {"shadowing": False}, {"edges": False}, {"gaps": "straight"}, {"slits": plywave.Slit(0.6, 0.25)}, {"sigma_per_um": 0.01}):
        assert not np.allclose(plywave.Cloth(pwc, **option).eval(at, wo, wi), usual), option


def test_slits(voile):
    """Slits move light and lose none."""
    at, wo, _ = queries(400, seed=8)
    wi = -wo * [0.3, 0.3, 1.0]
    wi /= np.linalg.norm(wi, axis=-1, keepdims=True)
    slits, none = (plywave.Cloth.from_bytes(voile.to_bytes(), slits=plywave.Slit(0.6, share)) for share in (0.25, 0.0))
    f = voile.eval(at, wo, wi)
    assert (none.eval(at, wo, wi) == f).all() and (slits.eval(at, wo, wi) != f).any(-1).mean() > 0.1
    np.testing.assert_allclose(voile.albedo(at, wo), slits.albedo(at, wo), atol=0.025)
    back = pickle.loads(pickle.dumps(slits))
    assert (back.eval(at, wo, wi) == slits.eval(at, wo, wi)).all()


def test_colors(jersey, voile):
    at, wo, wi = queries(200)
    blue = jersey.with_colors([0.1, 0.2, 0.6])
    f, g = jersey.with_colors().eval(at, wo, wi), blue.eval(at, wo, wi)
    assert g[:, 0].sum() < g[:, 2].sum() and g.sum() < f.sum()
    reflectance = np.array([[0.0, 0.2], [0.5, 1.0]])
    sigma = jersey.sigma_of_reflectance(reflectance)
    assert sigma.shape == (2, 2) and (np.diff(sigma.ravel()) < 0.0).all()
    direct = jersey.with_colors(0.003)
    assert np.allclose(direct.eval(at, wo, wi), jersey.eval(at, wo, wi, sigma_per_um=[0.003] * 3), rtol=1e-5)
    # By kind of yarn.
    own = voile.eval(at, wo, wi, 0.55)
    assert np.allclose(own, voile.with_colors([0.7, 0.1, 0.1], 0.002).eval(at, wo, wi, 0.55))
    pair = voile.eval(at, wo, wi, 0.55, sigma_per_um=(None, 0.002))
    assert np.allclose(own, pair) and not np.allclose(own, voile.eval(at, wo, wi, 0.55, sigma_per_um=(0.01, 0.002)))
    folded = jersey.with_colors([0.5, 0.5, 0.5], color_of="folded")
    assert folded.color_of == "folded" and jersey.color_of == "even_sky"
    for cloth in (blue, folded, plywave.Cloth.from_bytes(jersey.to_bytes(), edges=False)):
        back = pickle.loads(pickle.dumps(cloth))
        assert (back.eval(at, wo, wi) == cloth.eval(at, wo, wi)).all() and back.color_of == cloth.color_of
    for call, words in [
        (lambda: jersey.with_colors(None, [0.1, 0.2, 0.3]), "one kind of yarn"),
        (lambda: jersey.eval(at, wo, wi, sigma_per_um=(0.1, 0.2)), "one kind of yarn"),
        (lambda: jersey.with_colors([0.1, 0.2, 1.3]), "use sRGB from 0 to 1"),
        (lambda: jersey.with_colors(-0.5), "must be 0 to 1e6"),
        (lambda: jersey.with_colors(color_of="bright"), "even_sky"),
        (lambda: jersey.eval(at[:7], wo[:8], wi[:8]), "broadcast"),
        (lambda: jersey.eval(at, wo, wi.astype(int)), "float32 or float64"),
    ]:
        with pytest.raises(plywave.Error, match=words) as refused:
            call()
        assert "\n" not in str(refused.value)


def test_bad_files_and_specs_are_refused_in_one_line(pwc, tmp_path):
    data = pwc.read_bytes()
    newer = bytearray(data)
    newer[data.index(b'version\\":3') + 10] = ord("9")
    (tmp_path / "no.toml").write_text("name = 1 = 2")
    (tmp_path / "cut.pwc").write_bytes(data[: len(data) // 2])
    yarn = JERSEY.read_text()
    for call, words in [
        (lambda: plywave.Cloth(tmp_path / "none.pwc"), "none.pwc: no such file; check the path"),
        (lambda: plywave.Cloth(tmp_path / "none.toml"), "none.toml: no such file; check the path"),
        (lambda: plywave.Cloth(FABRICS / "models" / "polyester.pwm"), "polyester.pwm"),
        (lambda: plywave.Cloth(FABRICS / "polyester.toml"), "polyester.toml"),
        (lambda: plywave.Cloth({**VOILE, "warp": {"model": "polyester", "spacing_um": 130.0}}), "cloth spec: warp"),
        (lambda: plywave.Cloth(tmp_path / "cut.pwc"), "cut.pwc"),
        (lambda: plywave.load(tmp_path / "cut.pwc"), "cut.pwc"),
        (lambda: plywave.Cloth.from_bytes(bytes(newer), "newer.pwc"), "newer.pwc.*version"),
        (lambda: plywave.Cloth.from_bytes(b"", "empty.pwc"), "empty.pwc"),
        (lambda: plywave.Cloth.from_bytes(data, sigma_per_um=float("nan")), "sigma_per_um"),
        (lambda: plywave.Cloth.from_bytes(data, gaps="open"), "gaps.*use \"diffracted\" or \"straight\""),
        (lambda: plywave.Cloth.from_bytes(data, slits=3), "slits: int: give a Slit"),
        (lambda: plywave.Cloth.from_bytes(data, slits=plywave.Slit(9.0)), "width_um"),
        (lambda: plywave.Cloth(tmp_path / "no.toml"), "no.toml"),
        (lambda: plywave.Cloth(yarn.replace("[yarn]", '[yarn]\nmodel = "plies/ply.pwm"'), folder=tmp_path), "plies/ply.pwm"),
        (lambda: plywave.Cloth({**VOILE, "warp": {**YARN, "model": 3}}), "cloth spec"),
        (lambda: plywave.weave({**VOILE, "warp": {**YARN, "model": "ply.toml"}}), "warp.model"),
        (lambda: plywave.weave({**VOILE, "warp": {**YARN, "density_g_per_cm3": 1.38}}), "warp.density_g_per_cm3.*write the fiber"),
        (lambda: plywave.Cloth({"name": object()}), "cloth spec"),
        (lambda: plywave.Cloth({"name": float("nan")}), "cloth spec"),
        (lambda: plywave.weave(3), "give a path"),
        (lambda: plywave.weave(JERSEY, progress=3), "progress"),
        (lambda: plywave.Model(pwc), "jersey.pwc"),
    ]:
        with pytest.raises(plywave.Error, match=words) as refused:
            call()
        assert "\n" not in str(refused.value)


def test_an_exception_of_progress_stops_the_work():
    def stop(stage, unit, done, total):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        plywave.weave(JERSEY, progress=stop)


def test_the_program_finds_what_the_package_kept(program, jersey, pwc, cache, tmp_path):
    env = {**os.environ, "PLYWAVE_CACHE": str(cache)}
    kept = list(cache.iterdir())
    args = ["--setup", "swatch", "--width", "8", "--height", "8", "--samples", "1", "--no-exr", "-o", str(tmp_path / "a.png")]
    told = subprocess.run([program, "render", str(JERSEY), *args], env=env, capture_output=True, text=True)
    assert told.returncode == 0 and "was made" not in told.stdout + told.stderr and list(cache.iterdir()) == kept, told
    said = json.loads(subprocess.run([program, "info", str(pwc), "--json"], check=True, capture_output=True).stdout)
    assert said["name"] == jersey.name and np.allclose(said["cell_um"], jersey.cell_um)
    assert np.isclose(said["half_thickness_um"], jersey.half_thickness_um) and said["far"] == jersey.has_far
    assert said["memory_bytes"] == jersey.memory_bytes
    # Of a spec elsewhere, with the same contents.
    shutil.copy(JERSEY, tmp_path / "other.toml")
    assert plywave.Cloth(tmp_path / "other.toml").notes == FOUND
