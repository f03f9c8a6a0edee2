"""Families of plies: one file for any twist, roughness and index of its ranges (docs/howto/families.md)."""

from __future__ import annotations

from typing import Dict, Optional, Tuple

from . import _plywave
from ._files import Document, PathLike
from ._model import Model
from ._progress import Progress, Told
from ._spec import Spec, spec_args
from ._work import recipe_args, run_args, whole

_PARAMS = ("fiber_pitch_um", "alpha_fiber", "eta")


class Family(Document):
    """A family of plies (.pwfam)."""

    _kind, _words = "family", "family of plies"

    def _loaded(self) -> "_plywave.Family":
        known = self.__dict__.get("_rust")
        if known is None:
            known = self.__dict__["_rust"] = _plywave.Family.from_bytes(self.to_bytes(), self._name)
        return known

    @property
    def axes(self) -> Dict[str, Tuple[float, ...]]:
        """Nodes of the parameters that vary: `fiber_pitch_um` [um], `alpha_fiber`, `eta`; the ranges are from the first to the last."""
        return {name: tuple(values) for name, values in self._loaded().axes}

    @property
    def params(self) -> Dict[str, float]:
        """The parameters of the spec's own yarn."""
        return dict(zip(_PARAMS, self._loaded().params))

    def at(self, *, fiber_pitch_um: Optional[float] = None, alpha_fiber: Optional[float] = None, eta: Optional[float] = None) -> Model:
        """The model of one of the family's yarns; what is not given is as in the spec.

        Raises:
            Error: for a parameter outside its range, or one that does not vary.
        """
        given = {"fiber_pitch_um": fiber_pitch_um, "alpha_fiber": alpha_fiber, "eta": eta}
        params = [float(own if given[name] is None else given[name]) for name, own in self.params.items()]  # type: ignore[arg-type]
        return Model._of(self._loaded().at(params), self._name)


def build_family(
    spec: Spec,
    quality: str = "standard",
    *,
    nodes: int = 3,
    most_nodes: int = 7,
    seed: int = 1,
    paths: Optional[int] = None,
    instances: Optional[int] = None,
    folder: Optional[PathLike] = None,
    progress: Progress = None,
) -> Family:
    """Makes the family of a yarn spec with ranges (`[family]`, docs/howto/families.md): simulates nodes, adds some where interpolation is worst, fits all lobes together.

    Args:
        spec: Path of a yarn spec, its text, or a dict of its keys.
        quality: As of `build`.
        nodes: Initial number of nodes along each axis.
        most_nodes: Largest number of nodes along an axis.
        seed: Seed of all stages.
        paths: Paths per incident latitude, instead of the spec's and the quality's.
        instances: Instances of the ply, likewise.
        folder: Folder for finished tables and shards; the same call continues with them.
        progress: `True` for a bar, or a function of stage, unit, done and total.

    Raises:
        Error: for a spec that is refused.
        KeyboardInterrupt: when stopped.
    """
    recipe = recipe_args(quality, seed, paths, instances, False, False)
    with Told(progress) as call:
        data = _plywave.build_family(spec_args(spec, "yarn spec"), recipe, whole(nodes, "nodes"), whole(most_nodes, "most_nodes"), run_args(folder, True, call))
    return Family._trusted(data, "family")
