"""What the tests share: the models that ship, a ply that is built in a moment, cloths, and the program where it has been built."""

import os
import pathlib
import shutil
import subprocess

import pytest

import plywave

ROOT = pathlib.Path(__file__).resolve().parents[2]
FABRICS = ROOT / "fabrics"
CLOTHS = FABRICS / "cloths"

TINY = """
name = "tiny"

[fiber]
shape = { kind = "circle", radius_um = 7.5 }
eta = 1.58
alpha_fiber = 0.2

[ply]
fibers = 12
radius_um = 40.0

[absorption]
sigma_per_um = [0.0, 0.01, 0.1]

[simulation]
instances = 2
paths_per_theta = 6000
theta_i_nodes = 3
h_nodes = 5
theta_o_bins = 12
phi_o_bins = 24
lobes_refl = 1
lobes_high = 2
"""


@pytest.fixture(scope="session")
def tiny():
    return TINY


@pytest.fixture(scope="session")
def fabrics():
    return FABRICS


@pytest.fixture(scope="session")
def polyester():
    return plywave.Model(FABRICS / "models" / "polyester.pwm")


@pytest.fixture(scope="session")
def woven(tmp_path_factory):
    """Files of cloths: of a spec that ships, by its name, or of another one. Each is woven once."""
    folder, made = tmp_path_factory.mktemp("woven"), {}

    def weave(name, spec=None):
        if name not in made:
            cloth = plywave.weave(CLOTHS / f"{name}.toml" if spec is None else spec)
            made[name] = str(folder / f"{name}.pwc")
            cloth.save(made[name])
        return made[name]

    return weave


@pytest.fixture(scope="session")
def jersey(woven):
    return plywave.Cloth(woven("jersey"))


@pytest.fixture(scope="session")
def built(tiny):
    return plywave.build(tiny, "preview")


@pytest.fixture(scope="session")
def fiber(tiny):
    return plywave.wave.tabulate(tiny, "preview", rays=True, lambdas=2, thetas=3, azimuths=4, ray_count=2000)


@pytest.fixture(scope="session")
def program():
    """The command line, whose words and numbers the package's are held to."""
    found = os.environ.get("PLYWAVE_PROGRAM") or shutil.which("plywave", path=str(ROOT / "target" / "release"))
    if not found:
        pytest.skip("needs the program: cargo build --release, or PLYWAVE_PROGRAM")
    return found


@pytest.fixture(autouse=True)
def threads():
    """No test leaves another number of threads behind."""
    yield
    plywave.set_threads(None)


def pytest_addoption(parser):
    parser.addoption("--minutes", type=float, help="of the tests marked slow(SECONDS), run as many as fit, in a rotation by the number of commits; without it, all")


def pytest_configure(config):
    config.addinivalue_line("markers", "slow(seconds): takes that long on two cores; see --minutes")


def pytest_collection_modifyitems(config, items):
    minutes = config.getoption("--minutes")
    slow = [(item, item.get_closest_marker("slow").args[0]) for item in items if item.get_closest_marker("slow")]
    if minutes is None or not slow:
        return
    commits = subprocess.run(["git", "rev-list", "--count", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    turn = int(commits) % len(slow)
    left, taken = 60.0 * minutes, set()
    for item, seconds in slow[turn:] + slow[:turn]:
        if seconds <= left:
            left -= seconds
            taken.add(item)
    leave = [item for item, _ in slow if item not in taken]
    config.hook.pytest_deselected(items=leave)
    items[:] = [item for item in items if item not in leave]
