"""Files as arrays and back, and what is told of bad ones: the line of the command line."""

import pickle
import subprocess

import numpy as np
import pytest

import plywave


def test_files_come_back_as_they_were(built, fiber, polyester, tmp_path):
    for made, name in [(built, "a.pwm"), (built.table, "a.pwt"), (fiber, "a.pwf"), (polyester, "b.pwm")]:
        made.save(tmp_path / name)
        again = plywave.load(tmp_path / name)
        assert type(again) is type(made) and again.to_bytes() == made.to_bytes()
        parts = type(made).from_tensors(made.tensors(), made.document)
        assert parts.to_bytes() == made.to_bytes()
        assert pickle.loads(pickle.dumps(made)).to_bytes() == made.to_bytes()
        assert repr(made).startswith("<plywave.") and "<table>" in made._repr_html_()
        assert not next(iter(made.tensors().values())).flags.writeable


def test_the_program_reads_what_is_written(built, program, tmp_path):
    tensors = built.tensors()
    tensors["error_refl"] = tensors["error_refl"] * 0.5
    plywave.Model.from_tensors(tensors, built.document).save(tmp_path / "m.pwm")
    out = subprocess.run([program, "info", "m.pwm", "--json"], cwd=tmp_path, check=True, capture_output=True)
    assert b"tiny" in out.stdout


def test_arrays_are_the_model(polyester):
    """A change of the arrays is a change of the model."""
    tensors, document = polyester.tensors(), polyester.document
    assert tensors["refl"].shape == (len(tensors["theta_i"]), len(tensors["h_um"]), document["lobes_refl"], 6)
    dim = dict(tensors, share_refl=tensors["share_refl"] * np.float32(0.5))
    # What layers do is told by these shares too.
    for key in ("layer_forward", "layer_diffuse"):
        del dim[key]
    dimmer = plywave.Model.from_tensors(dim, document)
    at = (0.2, 0.0, [0.0, 0.6, 0.8], 0.0)
    terms, dimmed = polyester.terms(*at, edge=False), dimmer.terms(*at, edge=False)
    np.testing.assert_allclose(dimmed.refl, 0.5 * terms.refl, rtol=1e-5)
    # The stored values are those of the new arrays.
    assert dimmer.reference_error < 1e-4


def refused(call, *parts):
    with pytest.raises(plywave.Error) as raised:
        call()
    message = str(raised.value)
    assert "\n" not in message
    for part in parts:
        assert part in message, message
    return message


def test_bad_tensors_are_refused(built, fiber):
    tensors, document = built.tensors(), built.document
    make = plywave.Model.from_tensors
    refused(lambda: make(dict(tensors, theta_i=tensors["theta_i"][:2]), document), "tensors")
    # Lobes are round or cones, whatever the fit found better.
    refl, high = ("refl", "high") if "refl" in tensors else ("cone_refl", "cone_high")
    refused(lambda: make({**tensors, refl: tensors[refl] * np.float32("nan")}, document), refl)
    refused(lambda: make({k: v for k, v in tensors.items() if k != high}, document), high, "missing")
    refused(lambda: make(dict(tensors, more=np.zeros(3)), document), "more")
    refused(lambda: make({**tensors, refl: tensors[refl].astype(complex)}, document), refl, "complex128")
    refused(lambda: make(tensors, {}), "tensors")
    refused(lambda: make(tensors, {"x": object()}), "document")
    refused(lambda: make(fiber.tensors(), fiber.document), "plywave-fiber", "plywave-ply")
    refused(lambda: plywave.Table.from_tensors(dict(built.table.tensors(), refl=-built.table.tensors()["refl"]), built.table.document), "refl")


def program_says(program, *args, cwd=None):
    out = subprocess.run([program, *map(str, args)], capture_output=True, text=True, cwd=cwd)
    assert out.returncode == 2, (args, out)
    line = out.stderr.strip()
    assert line.startswith("error: ") and "\n" not in line
    return line[len("error: ") :]


def test_the_words_are_those_of_the_program(built, tiny, program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    built.save("ok.pwm")
    data = built.to_bytes()
    (tmp_path / "cut.pwm").write_bytes(data[:-100])
    (tmp_path / "empty.pwm").write_bytes(b"")
    (tmp_path / "old.pwm").write_bytes(data.replace(b'\\"version\\":3', b'\\"version\\":1'))
    (tmp_path / "dir.pwm").mkdir()
    for name in ["cut.pwm", "empty.pwm", "old.pwm", "dir.pwm"]:
        assert refused(lambda: plywave.Model(name)) == program_says(program, "check", name)
    # Of a missing file the program names the kinds that its command takes, too.
    missing = [
        ("none.pwm", refused(lambda: plywave.Model("none.pwm")), program_says(program, "check", "none.pwm")),
        ("none.toml", refused(lambda: plywave.build("none.toml")), program_says(program, "build", "none.toml")),
    ]
    for name, *both in missing:
        for words in both:
            assert words.startswith(f"{name}: no such file") and words.endswith("check the path")
    for k, (was, now) in enumerate(
        [
            ("eta = 1.58", "eta = 0.2"),
            ("eta = 1.58", "eta = true"),
            ("fibers = 12", "fibers = 12\nfibres = 12"),
            ("[ply]", "[plies]"),
            ('name = "tiny"', "name = "),
            ("radius_um = 40.0", "radius_um = 9.0"),
            ("paths_per_theta = 6000", "paths_per_theta = 2"),
        ]
    ):
        name = f"bad{k}.toml"
        (tmp_path / name).write_text(tiny.replace(was, now))
        want = program_says(program, "build", name, "--preset", "preview", "-o", "x.pwm")
        assert refused(lambda: plywave.build(name, "preview")) == want
    weave = 'name = "x"\n[weave]\nkind = "plain"\nends_per_cm = 60\npicks_per_cm = 60\n[warp]\n%s\n[weft]\n%s\n'
    good = 'model = "ok.pwm"\nfiber = "polyester"\ncount = "10 tex"\ncolor = [0.5, 0.2, 0.2]'
    bad = ["", good.replace("ok.pwm", "none.pwm"), good + "\nplies = 9", good.replace("10", "-1"), good.replace("0.5", "1.5"), 'model = "ok.pwm"\nspacing_um = 90.0']
    for k, warp in enumerate(bad):
        name = f"cloth{k}.toml"
        (tmp_path / name).write_text(weave % (warp, good))
        assert refused(lambda: plywave.weave(name)) == program_says(program, "weave", name, "-o", "x.pwc")
    (tmp_path / "scene.toml").write_text('lambda_um = [0.5]\ntheta_i_deg = [0.0]\n[[fiber]]\nshape = { kind = "circle", radius_um = -1.0 }\neta = 1.5\n')
    assert refused(lambda: plywave.wave.scatter("scene.toml")) == program_says(program, "wave", "scatter", "scene.toml")


def test_files_are_loaded_by_what_they_hold(fabrics, program, tmp_path):
    twin = tmp_path / "organza.pwx"
    subprocess.run([program, "twin", fabrics / "cloths" / "organza.toml", "--paths", "64", "--views", "0", "--quiet", "-o", twin], check=True)
    assert isinstance(plywave.load(twin), plywave.Twin)
    refused(lambda: plywave.load(fabrics / "silk.toml"), "silk.toml", "plywave.build")
    scene = next((fabrics / "scenes").glob("*.toml"))
    refused(lambda: plywave.load(scene), "plywave.wave.scatter")
    (tmp_path / "x.bin").write_bytes(b"not a file of plywave's, whatever it is")
    refused(lambda: plywave.load(tmp_path / "x.bin"), "x.bin")
    refused(lambda: plywave.load(tmp_path / "none"), "no such file")
    refused(lambda: plywave.load(tmp_path / "none.toml"), "no such file")
    refused(lambda: plywave.Table(fabrics / "models" / "silk.pwm"), "plywave-ply", "plywave-table")
    refused(lambda: plywave.Model.from_bytes(b"abc", "here"), "here")


def test_models_that_ship_go_by_their_name(fabrics, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PLYWAVE_MODELS", raising=False)
    shipped = (fabrics / "models" / "silk.pwm").read_bytes()
    assert plywave.load("silk").to_bytes() == plywave.Model("silk").to_bytes() == plywave.Model.from_bytes(shipped).to_bytes()
    refused(lambda: plywave.load("sylk"), "sylk: no such file and no model of this name", "silk, silk_single, viscose")
    yarn = {"model": "silk", "fiber": "silk", "count": "8 tex", "packing": 0.6, "bundles": 1}
    weave = {"kind": "plain", "ends_per_cm": 20, "picks_per_cm": 20}
    named = {"name": "open", "weave": weave, "warp": yarn, "weft": {"as": "warp", "model": "sylk"}}
    refused(lambda: plywave.weave(named), "sylk", "there are: alpaca")
    # A folder of one's own, and the file beside.
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "sylk.pwm").write_bytes(shipped)
    monkeypatch.setenv("PLYWAVE_MODELS", str(tmp_path / "mine"))
    assert plywave.load("sylk").to_bytes() == plywave.load("silk").to_bytes()
    (tmp_path / "silk.pwm").write_bytes((fabrics / "models" / "wool.pwm").read_bytes())
    assert plywave.load("silk").to_bytes() == plywave.load(fabrics / "models" / "wool.pwm").to_bytes()
