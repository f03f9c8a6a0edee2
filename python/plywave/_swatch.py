"""Cloth specs from photographs of swatches."""

from __future__ import annotations

import json
import os
from typing import Optional

from . import _plywave
from ._files import PathLike
from ._progress import Progress, Told
from ._results import Swatch
from ._work import run_args


def swatch(
    front: PathLike,
    back: PathLike,
    *,
    geometry: Optional[PathLike] = None,
    fiber: Optional[str] = None,
    weave: Optional[str] = None,
    g_per_m2: Optional[float] = None,
    ends_per_cm: Optional[float] = None,
    picks_per_cm: Optional[float] = None,
    count: Optional[str] = None,
    progress: Progress = None,
) -> Swatch:
    """Fits a cloth to two photographs of a swatch: weave, sett, count, twist, roughness, color and unevenness, each with a bar (docs/howto/swatch.md).
    It takes one to three minutes.

    Args:
        front: Photograph of the face, lit from the front (PNG, sRGB).
        back: Photograph from the same place with the lamp behind the cloth.
        geometry: TOML file that says where camera and lamps stood.
        fiber: Fiber of the yarns, as in a cloth spec; by default cotton, and bright polyester for a satin.
        weave: Name of the weave; by default found in the pictures.
        g_per_m2: Mass per area.
        ends_per_cm: Warp yarns per centimeter; by default found in the pictures.
        picks_per_cm: Weft yarns per centimeter, likewise.
        count: Count of the yarns, such as "30 tex".
        progress: `True` for a bar, or a function of stage, unit, done and total.

    Raises:
        Error: for pictures that are refused, and for numbers that no cloth has.
        KeyboardInterrupt: when stopped.
    """
    args = {
        "geometry": None if geometry is None else os.fspath(geometry),
        "fiber": fiber,
        "weave": weave,
        "g_per_m2": g_per_m2,
        "ends_per_cm": ends_per_cm,
        "picks_per_cm": picks_per_cm,
        "count": count,
    }
    with Told(progress) as call:
        report, spec, picture = _plywave.swatch(os.fspath(front), os.fspath(back), args, run_args(None, True, call))
    read = json.loads(report)
    numbers = {number["name"]: (number["value"], number["sd"]) for number in read["numbers"]}
    return Swatch(spec, numbers, read, picture)
