"""From specs to tables and models."""

from __future__ import annotations

import operator
import os
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Union

from . import _plywave
from ._files import PathLike, Speckle, Table, html_table
from ._model import Model
from ._plywave import Error
from ._progress import Progress, Told
from ._spec import Spec, spec_args
from ._threads import get_threads


def whole(value: Any, name: str) -> int:
    """A whole number from 0 to 2^63 - 1."""
    try:
        number = operator.index(value)
    except TypeError:
        number = -1
    if isinstance(value, bool) or not 0 <= number < 1 << 63:
        raise Error(f"options: {name} = {value!r}: must be a whole number, 0 or more")
    return number


def run_args(folder: Optional[PathLike], resume: bool, call: Any) -> Dict[str, Any]:
    """How a run goes, for the extension module."""
    return {"folder": None if folder is None else os.fspath(folder), "resume": bool(resume), "threads": get_threads(), "progress": call}


def recipe_args(quality: str, seed: int, paths: Optional[int], instances: Optional[int], traced: bool, speckle: Any) -> Dict[str, Any]:
    """What to make, for the extension module."""
    if isinstance(speckle, Speckle):
        speckle = (speckle.to_bytes(), speckle._name)
    elif not isinstance(speckle, bool):
        # No fibers, no speckle.
        speckle = min(whole(speckle, "speckle"), 1 << 31) or False
    return {
        "quality": str(quality),
        "seed": whole(seed, "seed"),
        "paths": None if paths is None else whole(paths, "paths"),
        "instances": None if instances is None else min(whole(instances, "instances"), 1 << 31),
        "traced_plies": bool(traced),
        "speckle": speckle,
    }


def build(
    spec: Spec,
    quality: str = "standard",
    *,
    seed: int = 1,
    paths: Optional[int] = None,
    instances: Optional[int] = None,
    speckle: Union[bool, int, Speckle] = True,
    folder: Optional[PathLike] = None,
    resume: bool = True,
    progress: Progress = None,
) -> Model:
    """Makes the model of a yarn spec: simulates its ply, fits lobes to the table, adds edge light and, but at preview quality, speckle.

    The result depends bit for bit only on spec, quality, seed and overrides, not on threads or interruptions. Ctrl-C stops the work and raises
    `KeyboardInterrupt`; with `folder`, finished work stays there, and the same call continues it.

    Args:
        spec: Path of a yarn spec, its text, or a dict of its keys (docs/reference/spec.md).
        quality: "preview" (under a minute for polyester), "standard" (minutes) or "reference" (hours).
        seed: Seed of all stages.
        paths: Paths per incident latitude, instead of the spec's and the quality's.
        instances: Instances of the ply, likewise.
        speckle: Whether to solve patterns of the spec's fiber (never at preview quality); or a number of fibers to solve at any quality, 0 for none; or patterns.
        folder: Folder for finished shards until the model is made.
        resume: Whether to use the shards in `folder`; otherwise they are deleted.
        progress: `True` for a bar, or a function of stage, unit, done and total.

    Returns:
        The model; its `table` is the simulated ply.

    Raises:
        Error: for a spec that is refused, and a folder of another run.
        KeyboardInterrupt: when stopped.
    """
    recipe = recipe_args(quality, seed, paths, instances, False, speckle)
    with Told(progress) as call:
        model, table, _ = _plywave.build(spec_args(spec, "yarn spec"), recipe, run_args(folder, resume, call))
    made = Model.from_bytes(model, "model")
    made.table = Table._trusted(table, "table")
    return made


def simulate(
    spec: Spec,
    quality: str = "standard",
    *,
    seed: int = 1,
    paths: Optional[int] = None,
    instances: Optional[int] = None,
    traced_plies: bool = False,
    folder: Optional[PathLike] = None,
    resume: bool = True,
    progress: Progress = None,
) -> Table:
    """Simulates the ply of a yarn spec; with `traced_plies` the plies of its yarn together. The other arguments are those of `build`."""
    recipe = recipe_args(quality, seed, paths, instances, traced_plies, False)
    with Told(progress) as call:
        return Table._trusted(_plywave.simulate(spec_args(spec, "yarn spec"), recipe, run_args(folder, resume, call)), "table")


def fit(table: Table, quality: Optional[str] = None, *, progress: Progress = None) -> Model:
    """Fits a model to a table, of the yarn where the table's spec has several plies.

    Args:
        table: The table.
        quality: Effort of the fit; by default that of the table.
        progress: `True` for a bar, or a function of stage, unit, done and total.
    """
    if not isinstance(table, Table):
        raise Error(f"table: {type(table).__name__}; give a plywave.Table")
    with Told(progress) as call:
        data = _plywave.fit(table.to_bytes(), table._name, quality, run_args(None, True, call))
    made = Model.from_bytes(data, "model")
    made.table = table
    return made


class CheckLine(NamedTuple):
    """One check: the measured value and its limit."""

    check: str
    value: float
    allowed: float
    passed: bool


class CheckReport:
    """Results of `check`; true if every line passed."""

    def __init__(self, lines: List[CheckLine]) -> None:
        self.lines = lines
        self.passed = all(line.passed for line in lines)

    def __bool__(self) -> bool:
        return self.passed

    def __iter__(self) -> Iterator[CheckLine]:
        return iter(self.lines)

    def __getitem__(self, check: str) -> CheckLine:
        for line in self.lines:
            if line.check == check:
                return line
        raise KeyError(check)

    def __repr__(self) -> str:
        rows = (f"{'pass' if line.passed else 'FAIL'}  {line.check:<17} {line.value:>12.4g}  allowed {line.allowed:.4g}" for line in self.lines)
        return "\n".join(rows)

    def _repr_html_(self) -> str:
        rows = {line.check: f"{'pass' if line.passed else 'FAIL'}: {line.value:.4g}, allowed {line.allowed:.4g}" for line in self.lines}
        return html_table("check", rows)


def check(model: Model, *, seed: int = 1, incidences: int = 100) -> CheckReport:
    """Tests a model: energy, density and weights of the sampler, chi-square of the samples, stored values, errors of the fit. The lines are those of `plywave check`."""
    if not isinstance(model, Model):
        raise Error(f"model: {type(model).__name__}; give a plywave.Model")
    count = whole(incidences, "incidences")
    if not 1 <= count <= 100_000:
        raise Error(f"options: incidences = {count}: must be 1 to 100000")
    return CheckReport([CheckLine(*line) for line in _plywave.check(model._rust, whole(seed, "seed"), count)])
