"""What a farm makes: an item is a file, made of the shards of its jobs. What runs on workers is here."""

from __future__ import annotations

import hashlib
import json
import math
import os
import tempfile
import time
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from .. import _plywave
from .._files import PathLike
from .._plywave import Error
from .._spec import Spec, spec_args
from .._work import recipe_args, whole
from ..wave import tabulate_args
from ._pictures import azimuths, patterns, places, swatch, yarns


@dataclass(frozen=True)
class Job:
    """One long computation, cut into shards."""

    stage: str
    """Name of its folder in what `build` and its like resume from."""
    description: str
    """All that its shards depend on: spec, options, seed, version of the program."""
    extent: int
    digest: str
    """SHA-256 of the description: the shards' place in a cache."""
    shards: int
    group: int
    """Shards that are added up and can be one file."""


@dataclass(frozen=True)
class Item:
    """A file to make; it holds texts, no paths, and can be sent anywhere."""

    kind: str
    """"yarn", "family", "fiber", "speckle", "twin" or "compare"."""
    name: str
    jobs: Tuple[Job, ...]
    spec_text: str
    options: Tuple[Tuple[str, Any], ...]
    """What `build` is told beside the spec."""

    @property
    def extension(self) -> str:
        return {"yarn": "pwm", "family": "pwfam", "fiber": "pwf", "speckle": "pws", "twin": "pwx", "compare": "json"}[self.kind]

    @property
    def file_kind(self) -> str:
        """What `_plywave.check_bytes` calls its file; empty for a comparison's, which is JSON."""
        return {"yarn": "model", "family": "family", "fiber": "fiber", "speckle": "speckle", "twin": "twin", "compare": ""}[self.kind]

    @property
    def key(self) -> str:
        """SHA-256 of all that the file depends on, the program's version included."""
        parts = [_plywave.__version__, self.kind, [job.digest for job in self.jobs], [job.shards for job in self.jobs], self.spec_text, self.options]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _jobs(rows: Any) -> Tuple[Job, ...]:
    return tuple(Job(stage, description, extent, digest, shards, group) for stage, description, extent, digest, shards, group, _ in rows)


def _name(spec: Spec, name: Optional[str], otherwise: str) -> str:
    if name is not None:
        return str(name)
    if isinstance(spec, (str, os.PathLike)) and "\n" not in str(spec):
        return os.path.splitext(os.path.basename(os.fspath(spec)))[0]
    return otherwise


def yarn_item(
    spec: Spec,
    quality: str = "standard",
    *,
    name: Optional[str] = None,
    seed: int = 1,
    paths: Optional[int] = None,
    instances: Optional[int] = None,
    speckle: Any = True,
) -> Item:
    """The model of a yarn spec; arguments as of `plywave.build`, but for patterns in `speckle`.

    Raises:
        Error: for what `plywave.build` would refuse.
    """
    if not isinstance(speckle, bool):
        speckle = whole(speckle, "speckle")
    recipe = recipe_args(quality, seed, paths, instances, False, speckle)
    rows, text = _plywave.plan_build(spec_args(spec, "yarn spec"), recipe)
    return Item("yarn", _name(spec, name, "yarn"), _jobs(rows), text, tuple(sorted(recipe.items())))


def family_item(
    spec: Spec,
    quality: str = "standard",
    *,
    name: Optional[str] = None,
    nodes: int = 3,
    seed: int = 1,
    paths: Optional[int] = None,
    instances: Optional[int] = None,
) -> Item:
    """The family of a yarn spec with ranges, with `nodes` nodes along each axis: where workers share the work, nodes are not chosen by error. Other arguments as of `plywave.build_family`.

    Raises:
        Error: for what `plywave.build_family` would refuse.
    """
    recipe = recipe_args(quality, seed, paths, instances, False, False)
    count = whole(nodes, "nodes")
    rows, text = _plywave.plan_family(spec_args(spec, "yarn spec"), recipe, count)
    return Item("family", _name(spec, name, "family"), _jobs(rows), text, tuple(sorted({**recipe, "nodes": count}.items())))


def fiber_item(spec: Spec, quality: str = "standard", *, name: Optional[str] = None, **options: Any) -> Item:
    """The table of a fiber; arguments as of `plywave.wave.tabulate`."""
    args = tabulate_args(quality, **options)
    rows, text = _plywave.plan_tabulate(spec_args(spec, "spec"), args)
    return Item("fiber", _name(spec, name, "fiber"), _jobs(rows), text, ())


def speckle_item(spec: Spec, *, name: Optional[str] = None, instances: int = 200, seed: int = 1) -> Item:
    """Speckle patterns of a fiber; arguments as of `plywave.wave.speckle`."""
    rows, text = _plywave.plan_speckle(spec_args(spec, "yarn spec"), min(whole(instances, "instances"), 1 << 31), whole(seed, "seed"))
    return Item("speckle", _name(spec, name, "speckle"), _jobs(rows), text, ())


def twin_item(cloth: PathLike, *, name: Optional[str] = None, paths: Optional[int] = None, seed: int = 1) -> Item:
    """The twin of a cloth spec: explicit fibers, path-traced at the standard views and absorptions (docs/validation/cloth.md)."""
    path = os.fspath(cloth)
    rows, text = _plywave.plan_twin(path, None if paths is None else whole(paths, "paths"), whole(seed, "seed"))
    return Item("twin", _name(path, name, "twin"), _jobs(rows), text, ())


def compare_item(
    spec: Spec,
    *,
    name: Optional[str] = None,
    instances: int = 50,
    seed: int = 1,
    lambda_um: Sequence[float] = (0.4, 0.694),
    h_rel: Sequence[float] = (0.0, 0.5, 0.9),
    theta_i_deg: float = 0.0,
    sigma_per_um: float = 0.0,
    tolerance: float = 1e-4,
    paths: int = 200_000,
) -> Item:
    """Waves against rays over instances of a ply's cross section, as `plywave compare` (docs/howto/wave.md); the file is its report.json.

    A shard is one instance at one wavelength. What they depend on has no number of instances in it: a longer run goes on with those of a shorter one.

    Args:
        spec: A yarn spec: its path, text or keys.
        name: Of the file; by default the spec's.
        instances: Of the cross section.
        seed: Of sections and rays.
        lambda_um: One to eight wavelengths [um].
        h_rel: One to sixteen offsets of the beam over the ply's radius.
        theta_i_deg: Latitude of the incidence [degrees], -80 to 80.
        sigma_per_um: Absorption of the fibers [1/um].
        tolerance: Error of the waves' far field.
        paths: Rays of an instance, wavelength and offset.

    Raises:
        Error: for what `plywave compare` would refuse.
    """
    args = {
        "instances": min(whole(instances, "instances"), 1 << 31),
        "seed": whole(seed, "seed"),
        "lambda_um": _numbers(lambda_um, "lambda_um"),
        "h_rel": _numbers(h_rel, "h_rel"),
        "theta_i": math.radians(theta_i_deg),
        "sigma_per_um": float(sigma_per_um),
        "tolerance": float(tolerance),
        "paths": whole(paths, "paths"),
    }
    rows, text = _plywave.plan_compare(spec_args(spec, "yarn spec"), args)
    return Item("compare", _name(spec, name, "compare"), _jobs(rows), text, ())


def _numbers(values: Any, name: str) -> List[float]:
    try:
        return [float(value) for value in ([values] if isinstance(values, (int, float)) else values)]
    except (TypeError, ValueError):
        raise Error(f"options: {name} = {values!r}: give numbers") from None


class Blocks(NamedTuple):
    """Files of shards that a worker made."""

    files: List[Tuple[int, int, bytes]]
    """First shard, number of shards, bytes."""
    seconds: float
    """Time of one core."""


def _run(folder: Optional[str]) -> Dict[str, Any]:
    # A worker has as many slots as it may use cores: a task is one core's.
    return {"folder": folder, "resume": True, "threads": 1, "progress": None}


def run_blocks(description: str, extent: int, blocks: List[Tuple[int, int]]) -> Blocks:
    """Runs shards on a worker: single ones, or groups."""
    begun = time.perf_counter()
    files = [(first, count, _plywave.run_block(description, extent, first, count, _run(None))) for first, count in blocks]
    return Blocks(files, time.perf_counter() - begun)


class Finished(NamedTuple):
    """A file that a worker made of all shards."""

    data: bytes
    seconds: float
    """Time of one core."""
    picture: Optional[bytes]
    """A PNG for the page."""


_PICTURES: Dict[str, Callable[[bytes], Optional[bytes]]] = {"yarn": swatch, "family": yarns, "twin": places, "fiber": azimuths, "speckle": patterns}


def finish(item: Item, shards: List[List[Tuple[int, int, bytes]]]) -> Finished:
    """Makes an item's file on a worker, of the shards of its jobs: they are laid where a run that was interrupted would have left them, and the run goes on."""
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="plywave-") as folder:
        for job, files in zip(item.jobs, shards):
            os.mkdir(os.path.join(folder, job.stage))
            for first, count, data in files:
                with open(os.path.join(folder, job.stage, _plywave.block_name(first, count)), "wb") as file:
                    file.write(data)
        spec = {"path": None, "text": item.spec_text, "name": item.name, "folder": ""}
        options = dict(item.options)
        if item.kind == "yarn":
            data, _, _ = _plywave.build(spec, options, _run(folder))
        elif item.kind == "family":
            nodes = options.pop("nodes")
            data = _plywave.build_family(spec, options, nodes, nodes, _run(folder))
        else:
            job = item.jobs[0]
            data = _plywave.run_job(job.description, job.extent, job.stage, _run(folder))
    draw = _PICTURES.get(item.kind)
    picture = None if draw is None else draw(data)
    return Finished(data, time.perf_counter() - begun, picture)


def version() -> str:
    """Of plywave on a worker."""
    return _plywave.__version__


def one_line(error: Optional[BaseException]) -> str:
    """An error's kind and its words."""
    text = " ".join(str(error).split())[:300]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def check_options(given: Dict[str, Any], known: Mapping[str, Union[type, Tuple[type, ...]]], where: str) -> None:
    """Refuses keys that are not known, and values of another type than one of the key's."""
    import difflib

    words = {str: "a text", int: "a whole number", bool: "true or false", float: "a number", list: "a list"}
    for key, value in given.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            raise Error(f"{where}.{key} = {value!r}: unknown key; {hint}")
        want = known[key]
        kinds = want if isinstance(want, tuple) else (want,)
        kind = type(value)
        if kind not in kinds and not (kind is int and float in kinds):
            raise Error(f"{where}.{key} = {value!r}: give {' or '.join(words[one] for one in kinds)}")
