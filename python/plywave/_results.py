"""Results of calls."""

from __future__ import annotations

from typing import Any, Dict, List, NamedTuple, Tuple

import numpy as np

ABSORBED = 0
"""`Samples.event` of light that ends."""
SCATTERED = 1
"""`Samples.event` of light that leaves in a sampled direction."""
STRAIGHT = 2
"""`Samples.event` of light that goes straight on, as if nothing were there: a delta."""


class Samples(NamedTuple):
    """Outcomes of sampling, one entry per query."""

    w: np.ndarray
    """Directions `[..., 3]`, unit; of light that goes straight on the onward one, of absorbed light 0."""
    weight: np.ndarray
    """f over pdf `[..., N]`; of light that goes straight on its energy over the chance of it."""
    pdf: np.ndarray
    """Density `[...]` [1/sr]; of light that goes straight on the chance of it."""
    event: np.ndarray
    """`ABSORBED`, `SCATTERED` or `STRAIGHT` `[...]`, uint8."""


class Terms(NamedTuple):
    """Terms of a ply model [1/sr], `[..., N]` each; their sum is f."""

    refl: np.ndarray
    """Single reflection, the same at every absorption."""
    high: np.ndarray
    """All other light that hit fibers."""
    edge: np.ndarray
    """Light that passed beside the ply and was diffracted."""
    slit: np.ndarray
    """Light of f_high that small slits diffract, where the query has a `Slit`; `high` is then without it."""


class Layer(NamedTuple):
    """What one layer of yarn does to the light that hits its fibers, `[..., N]` each; `Model.layer` gives it, `below=` takes it."""

    reflected: np.ndarray
    """Fraction reflected into the half space from which the light came."""
    transmitted: np.ndarray
    """Fraction transmitted."""
    reflected_diffuse: np.ndarray
    """The same of diffuse light."""
    transmitted_diffuse: np.ndarray


class Exported(NamedTuple):
    """What `Cloth.export` wrote."""

    files: List[str]
    """Paths, the main file first."""
    notes: List[str]
    """What is assumed and what the format leaves out, one line each."""
    facts: Dict[str, float]
    """Numbers by name."""


class Swatch(NamedTuple):
    """A cloth that `swatch` fitted to photographs."""

    spec: str
    """The cloth spec with a bar at each number, for `Cloth`, `weave` and the program."""
    numbers: Dict[str, Tuple[float, float]]
    """Values and standard deviations by name; names end in units, as in the program's report."""
    report: Dict[str, Any]
    """The program's report: weaves with probabilities, figures of photographs and fit, notes."""
    picture: bytes
    """A PNG: photographs above, the fit below; front on the left, lamp behind on the right."""


class Slit(NamedTuple):
    """Small gaps between the fibers of a ply (Yu 2025, 7.3): a part of the forward light of f_high is diffracted by a slit along the ply."""

    width_um: float
    """Above 0, at most 5."""
    share: float = 0.25
    """Share of the forward light that goes through, 0 to 1."""


class Place(NamedTuple):
    """Places on plies, which have their own relief and speckle, `[...]` each; `place=` takes it."""

    ply: Any
    """Numbers of the plies, whole, 0 or more: others have other fibers."""
    azimuth: Any = 0.0
    """Azimuth of the viewer, the frame's y axis, among the fibers [rad]: from an axis that turns with the twist, counterclockwise as seen from the end of z."""
    along_um: Any = 0.0
    """Place along the ply's axis [um], from any origin that is the same all along the ply."""
    footprint_um: Any = 0.0
    """Diameter of the part of the ply that a query stands for [um]; 0 for a point."""


class Outcomes(NamedTuple):
    """Probabilities of the outcomes of `sample`, `[...]` each; they add up to 1."""

    scattered: np.ndarray
    straight: np.ndarray
    absorbed: np.ndarray
