"""Building, fitting, waves: values, progress, interruption and going on."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest

import plywave


def test_build_is_the_programs(built, tiny, program, tmp_path):
    (tmp_path / "tiny.toml").write_text(tiny)
    flags = ["--preset", "preview", "--keep-table", "--max-error-refl", "9", "--max-error-high", "9", "-o", "m.pwm"]
    subprocess.run([program, "build", "tiny.toml", *flags], cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "m.pwm").read_bytes() == built.to_bytes()
    assert (tmp_path / "m.pwt").read_bytes() == built.table.to_bytes()


def test_stages_make_what_build_makes(built, tiny):
    table = plywave.simulate(tiny, "preview")
    assert table.to_bytes() == built.table.to_bytes()
    plywave.set_threads(3)
    assert plywave.fit(table).to_bytes() == built.to_bytes()
    # The spec as a dict of its keys.
    keys = {
        "name": "tiny",
        "fiber": {"shape": {"kind": "circle", "radius_um": 7.5}, "eta": 1.58, "alpha_fiber": 0.2},
        "ply": {"fibers": 12, "radius_um": 40.0},
        "absorption": {"sigma_per_um": [0.0, 0.01, 0.1]},
        "simulation": {"instances": 2, "paths_per_theta": 6000, "theta_i_nodes": 3, "h_nodes": 5, "theta_o_bins": 12, "phi_o_bins": 24},
    }
    other = plywave.simulate(keys, "preview", seed=2, paths=5000)
    assert other.document["seed"] == 2 and (abs(other.tensors()["paths"].astype(int) - 5008) <= 8).all()
    assert other.tensors()["refl"].shape == table.tensors()["refl"].shape
    assert 'name = "tiny"' in other.spec_text and other.name == "tiny"


def test_progress_is_told(tiny, built, capsys):
    told = []
    plywave.simulate(tiny, "preview", progress=lambda *args: told.append(args))
    assert told and all(t[:2] == ("simulate", "paths") and 0 <= t[2] <= t[3] for t in told)
    assert [t[2] for t in told] == sorted(t[2] for t in told) and told[-1][2] == told[-1][3]
    plywave.fit(built.table, progress=True)
    assert "%" in capsys.readouterr().err
    with pytest.raises(plywave.Error, match="progress"):
        plywave.simulate(tiny, progress=3)


def test_exceptions_of_progress_stop_the_work(tiny):
    def fail(*_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        plywave.build(tiny, "standard", paths=10_000_000, progress=fail)


def test_options_are_checked(tiny, built):
    for call, part in [
        (lambda: plywave.build(tiny, "best"), "quality"),
        (lambda: plywave.build(tiny, seed=-1), "seed"),
        (lambda: plywave.build(tiny, seed=1.5), "seed"),
        (lambda: plywave.build(tiny, paths=0), "paths"),
        (lambda: plywave.build(tiny, instances=100_000_000_000), "instances"),
        (lambda: plywave.simulate(tiny, traced_plies=True), "yarn.plies"),
        (lambda: plywave.fit(built), "Table"),
        (lambda: plywave.check(built.table), "Model"),
        (lambda: plywave.check(built, incidences=0), "incidences"),
        (lambda: plywave.wave.tabulate(tiny, sigma_per_um=-1.0), "sigma_per_um"),
        (lambda: plywave.wave.tabulate(tiny, lambdas=0), "lambdas"),
        (lambda: plywave.wave.speckle(tiny, instances=1), "instances"),
    ]:
        with pytest.raises(plywave.Error, match=part):
            call()


SCRIPT = """
import sys, plywave
try:
    plywave.simulate(sys.argv[1], "preview", paths=int(sys.argv[3]), folder=sys.argv[2], progress=lambda *told: None)
except KeyboardInterrupt as stopped:
    print("stopped:", stopped, flush=True)
    sys.exit(7)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_interrupted_work_keeps_its_shards_and_goes_on(tiny, tmp_path):
    spec, folder, paths = tmp_path / "tiny.toml", tmp_path / "shards", 40_000
    spec.write_text(tiny)
    run = [sys.executable, "-c", textwrap.dedent(SCRIPT), str(spec), str(folder), str(paths)]
    process = subprocess.Popen(run, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not list(folder.rglob("*.pwp")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 7, (out, err)
    assert "stopped: stopped with" in out and "shards left" in out
    assert time.monotonic() - begun < 60
    kept = list(folder.rglob("*.pwp"))
    assert kept
    table = plywave.simulate(str(spec), "preview", paths=paths, folder=folder)
    assert not folder.exists(), list(folder.rglob("*"))
    assert table.to_bytes() == plywave.simulate(str(spec), "preview", paths=paths).to_bytes()


def test_folders_of_other_runs_are_refused(tiny, tmp_path):
    def stop(stage, unit, done, total):
        if list(folder.rglob("*.pwp")):
            raise InterruptedError

    folder = tmp_path / "shards"
    with pytest.raises(InterruptedError):
        plywave.simulate(tiny, "preview", paths=40_000, folder=folder, progress=stop)
    assert list(folder.rglob("*.pwp"))
    with pytest.raises(plywave.Error, match="shards of another run"):
        plywave.simulate(tiny, "preview", seed=2, folder=folder)
    plywave.simulate(tiny, "preview", seed=2, folder=folder, resume=False)
    assert not folder.exists()


@pytest.mark.slow(7)
@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_fits_stop_too(tiny):
    """A stage that does not look at the flag is left at its next progress."""
    table = plywave.simulate(tiny.replace("lobes_high = 2", "lobes_high = 8").replace("lobes_refl = 1", "lobes_refl = 4"), "preview")
    timer = threading.Timer(0.4, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            while True:
                plywave.fit(table, "reference")
    finally:
        timer.cancel()
    assert time.monotonic() - begun < 60
    lobes = plywave.fit(table, "preview").tensors()
    assert lobes.get("refl", lobes.get("cone_refl")).shape[2] == 4


def test_check_is_the_programs(polyester, fabrics, program):
    report = plywave.check(polyester, incidences=8)
    out = subprocess.run([program, "check", fabrics / "models" / "polyester.pwm", "--incidences", "8", "--json"], capture_output=True)
    want = json.loads(out.stdout)
    assert [tuple(line) for line in report] == [(c["check"], c["value"], c["allowed"], c["passed"]) for c in want["checks"]]
    assert bool(report) == want["passed"]
    assert report["furnace"].passed and "furnace" in repr(report) and "furnace" in report._repr_html_()


def test_waves_keep_energy(fabrics):
    """A clear cylinder: extinction is scattering; the far field's power is C_sca (its optical theorem is the solver's ledger)."""
    scene = {
        "lambda_um": [0.5],
        "theta_i_deg": [0.0, 30.0],
        "phi_i_deg": [0.0],
        "fiber": [{"shape": "circle", "radius_um": 1.0, "eta": 1.5}],
    }
    told = []
    found = plywave.wave.scatter(scene, progress=lambda *args: told.append(args))
    assert len(found) == 4 and {c.pol for c in found.cases} == {"TM", "TE"} and found.stats["unknowns"] >= 0
    for case in found.cases:
        assert case.f_co.dtype == np.complex128 and case.phi_o.shape == case.f_co.shape
        assert abs(case.c_ext_um - case.c_sca_um) < 1e-6 * case.c_ext_um
        # The power of the far field.
        power = 4.0 / (2.0 * np.pi / case.lambda_um) * np.mean(np.abs(case.f_co) ** 2 + np.abs(case.f_cross) ** 2)
        assert abs(power - case.c_sca_um) < 1e-9 * case.c_sca_um
    np.testing.assert_allclose([c.theta_i for c in found.cases], np.radians([0.0, 0.0, 30.0, 30.0]))
    assert "far fields" in found._repr_html_() and "cases" in repr(found)
    with pytest.raises(plywave.Error, match="phi_i_deg"):
        plywave.wave.scatter({"lambda_um": [0.5], "theta_i_deg": [0.0]})


def test_speckle_patterns(tiny):
    patterns = plywave.wave.speckle(tiny, instances=2)
    assert patterns.tensors()["patterns"].shape[3] == 2
    with pytest.raises(plywave.Error):
        plywave.Speckle.from_tensors({}, patterns.document)


def test_figures(built, fiber, polyester, tmp_path):
    pytest.importorskip("matplotlib")
    for k, figure in enumerate(
        [
            plywave.plot(built),
            plywave.plot(built.table, sigma_per_um=0.01),
            plywave.plot(built, table=built.table),
            plywave.plot(built, theta_i=0.3, h_rel=0.2, part="maps", sigma_per_um=[0.0, 0.01]),
            plywave.plot(polyester, part="noise"),
            plywave.plot(fiber),
        ]
    ):
        path = tmp_path / f"{k}.png"
        figure.savefig(path, dpi=50)
        assert path.stat().st_size > 5000
    for call, part in [
        (lambda: plywave.plot(built, part="noise"), "noise"),
        (lambda: plywave.plot(built, part="sky"), "sky"),
        (lambda: plywave.plot(built.table, table=built.table), "table"),
        (lambda: plywave.plot("model.pwm"), "str"),
        (lambda: plywave.plot(polyester, table=built.table), "table"),
    ]:
        with pytest.raises(plywave.Error, match=part):
            call()


def test_the_budget_adds_up(built):
    from plywave._plot import _Ply

    for source in (built, built.table):
        r_d, refl, high, absorbed = _Ply(source, None).energies(0.01)
        np.testing.assert_allclose(r_d + refl + high + absorbed, 1.0, atol=0.02)


def test_sources_of_the_package_are_not_imported():
    assert pathlib.Path(plywave.__file__).parent != pathlib.Path(__file__).parents[1] / "plywave", "run pytest from another folder than python/"
