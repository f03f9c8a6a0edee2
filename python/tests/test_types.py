"""Types for editors and checkers, and the examples of the docs."""

import pathlib
import re
import subprocess
import sys
import textwrap

import pytest

import plywave

USER = '''
from typing import Tuple
import numpy as np
import plywave

def shade(path: str, w: np.ndarray) -> Tuple[np.ndarray, float]:
    model = plywave.Model(path)
    samples: plywave.Samples = model.sample(0.1, 0.0, np.random.rand(5, 3), [0.01, 0.02])
    woven: plywave.Cloth = plywave.weave("jersey.toml", progress=True).with_colors([0.5, 0.2, 0.1])
    cloth = woven if woven.has_far else plywave.Cloth("satin.toml", gaps="straight")
    rgb: np.ndarray = cloth.eval([0.0, 0.0], [0.0, 0.0, 1.0], samples.w)
    found = plywave.wave.scatter("scene.toml", progress=True)
    width: float = found[0].c_sca_um
    made: plywave.Model = plywave.build("yarn.toml", "preview", progress=lambda stage, unit, done, total: print(stage, done))
    return model.eval(0.1, 0.0, w, 0.01) + rgb, width + float(made.has_edge) + plywave.check(made)["furnace"].value
'''

WRONG = """
import plywave
plywave.Model("a").eval()
plywave.build("a", seed="one")
x: int = plywave.Model("a").reference_error
"""


def mypy(path, text):
    pytest.importorskip("mypy")
    path.write_text(text)
    run = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(path.parent / "cache"), str(path)]
    return subprocess.run(run, capture_output=True, text=True)


def test_users_are_checked(tmp_path):
    good = mypy(tmp_path / "user.py", USER)
    assert good.returncode == 0, good.stdout + good.stderr
    wrong = mypy(tmp_path / "wrong.py", WRONG)
    assert [f"wrong.py:{line}:" in wrong.stdout for line in (3, 4, 5)] == [True] * 3, wrong.stdout


def test_the_package_itself_is_checked():
    pytest.importorskip("mypy")
    run = [sys.executable, "-m", "mypy", "--strict", "-p", "plywave", "--exclude", "mitsuba"]
    out = subprocess.run(run, capture_output=True, text=True)
    ours = [line for line in out.stdout.splitlines() if "error:" in line and "mitsuba" not in line]
    assert not ours, out.stdout + out.stderr


def test_stubs_are_those_of_the_extension():
    pytest.importorskip("mypy")
    run = [sys.executable, "-m", "mypy.stubtest", "plywave._plywave", "--ignore-disjoint-bases"]
    out = subprocess.run(run, capture_output=True, text=True)
    assert out.returncode == 0, out.stdout + out.stderr


def test_everything_public_is_told():
    for name in plywave.__all__:
        thing = getattr(plywave, name)
        if callable(thing):
            assert thing.__doc__, name
            for method, member in vars(thing).items() if isinstance(thing, type) else ():
                if not method.startswith("_") and callable(member):
                    assert member.__doc__, f"{name}.{method}"


ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("page", [pytest.param("docs/reference/python_api.md", marks=pytest.mark.slow(15)), "python/README.md"])
def test_examples_of_the_docs_run(page, tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.S)
    assert blocks
    # Examples that take long are `python no_run`. Files that examples write go elsewhere; the specs and
    # models of the repository are where the page says.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fabrics").symlink_to(ROOT / "fabrics", target_is_directory=True)
    told = {}
    for block in blocks:
        exec(compile(textwrap.dedent(block), page, "exec"), told)


@pytest.mark.parametrize(("name", "made"), [
    pytest.param("yarn_to_picture", [".png", ".png", ".pwm"], marks=pytest.mark.slow(45)),
    pytest.param("parameters", [".png"], marks=pytest.mark.slow(50)),
    pytest.param("color_from_picture", [".png"] + 5 * [".pwm"], marks=pytest.mark.slow(60)),
])
def test_notebooks_run(tmp_path, name, made):
    script = ROOT / "examples" / "python" / f"{name}.py"
    out = subprocess.run([sys.executable, str(script), "-o", str(tmp_path)], capture_output=True, text=True, cwd=ROOT)
    assert out.returncode == 0, out.stderr
    assert sorted(p.suffix for p in tmp_path.iterdir()) == made, list(tmp_path.iterdir())
