"""What the tests share: the models that ship, a ply that is built in a moment, and the program where it has been built."""

import os
import pathlib
import shutil

import pytest

import plywave

ROOT = pathlib.Path(__file__).resolve().parents[2]
FABRICS = ROOT / "fabrics"

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


_LOADED = {}


def fabrics_once():
    """Has `plywave.mitsuba` load each fabric once a process: its tables, and the mean over the repeat, take seconds."""
    from plywave.mitsuba import _native

    load = _native.FabricTables
    if isinstance(load, type):

        def once(filename=None, text=None, folder=".", diffracted=True, **parts):
            parts = {"layers": True, "shadowing": True, "edges": True, "slits": True, "speckle": False, "far": False} | parts
            key = (filename, text, folder, diffracted, *parts.items())
            if key not in _LOADED:
                _LOADED[key] = load(filename, text, folder, diffracted, **parts)
            return _LOADED[key]

        _native.FabricTables = once


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
def satin():
    return plywave.Fabric(FABRICS / "polyester_satin.toml")


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
