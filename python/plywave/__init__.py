"""plywave: wave-aware appearance of cloth and fibers on NumPy arrays.

    import numpy as np, plywave

    model = plywave.load("fabrics/models/polyester.pwm")
    f = model.eval(theta_i=0.5, h_um=10.0, omega_o=np.array([0.0, 1.0, 0.0]), sigma_per_um=[0.001, 0.004, 0.010])

Angles are in radians, lengths in um, absorption in 1/um, densities in 1/sr. `Model`, `Cloth` and `Fiber` have `eval`, `pdf`, `sample` and `albedo` on arrays that broadcast;
`build` makes a model of a yarn spec, `weave` a cloth of a cloth spec. Bad input raises `Error` with one line. Docs: docs/reference/python_api.md of the repository.
"""

from ._plywave import RGB_LAMBDA_UM, Error, __version__
from ._results import ABSORBED, SCATTERED, STRAIGHT, Exported, Layer, Outcomes, Place, Samples, Slit, Swatch, Terms
from ._threads import get_threads, set_threads
from ._files import Document, Speckle, Table, Twin
from ._model import Model
from ._fiber import Fiber
from ._family import Family, build_family
from ._load import load
from ._cloth import Cloth, weave
from ._work import CheckLine, CheckReport, build, check, fit, simulate
from ._plot import plot
from ._swatch import swatch
from . import wave

__all__ = [
    "ABSORBED",
    "RGB_LAMBDA_UM",
    "SCATTERED",
    "STRAIGHT",
    "CheckLine",
    "CheckReport",
    "Cloth",
    "Document",
    "Error",
    "Exported",
    "Family",
    "Fiber",
    "Layer",
    "Model",
    "Outcomes",
    "Place",
    "Samples",
    "Slit",
    "Speckle",
    "Swatch",
    "Table",
    "Terms",
    "Twin",
    "__version__",
    "build",
    "build_family",
    "check",
    "fit",
    "get_threads",
    "load",
    "plot",
    "set_threads",
    "simulate",
    "swatch",
    "wave",
    "weave",
]
