"""Loading by what a file holds."""

from __future__ import annotations

import os
import re
from typing import Any, Union

from . import _plywave
from ._cloth import Cloth
from ._family import Family
from ._fiber import Fiber
from ._files import PathLike, Speckle, Table, Twin
from ._model import Model
from ._plywave import Error

_NAME = re.compile(r"[\w-]+")
_CLASSES: Any = {"table": Table, "model": Model, "fiber": Fiber, "speckle": Speckle, "twin": Twin, "family": Family, "cloth": Cloth}


def load(path: PathLike) -> "Union[Model, Cloth, Fiber, Table, Speckle, Twin, Family]":
    """Reads a file by what it holds: a model (.pwm), a cloth (.pwc, or its spec .toml, whose cloth may have to be made: see `Cloth`), a fiber (.pwf, or a spec .toml with `[filament]`),
    a table (.pwt), speckle patterns (.pws), the twin of a cloth (.pwx), a family of plies (.pwfam). A name without folder and ending, where there is no such file, is that of a model
    that ships, or of a folder of the variable PLYWAVE_MODELS: ``load("polyester")``.

    Raises:
        Error: when the file cannot be read, is damaged, or is of another kind, such as a yarn spec.
    """
    name = os.fspath(path)
    if name.endswith(".toml"):
        sections = _sections(name)
        if "[filament]" in sections:
            return Fiber(name)
        if "[[fiber]]" in sections:
            raise Error(f"{name}: a scene for waves (TOML); `plywave.wave.scatter` takes it")
        if not sections & {"[weave]", "[knit]", "[curves]"} and sections & {"[fiber]", "[fiber.shape]", "[ply]", "[absorption]", "[yarn]"}:
            raise Error(f"{name}: a yarn spec (TOML); `plywave.build` makes a model of it")
        return Cloth(name)
    if _NAME.fullmatch(name) and not os.path.exists(name):
        return Model(name)
    return _CLASSES[_plywave.file_kind(name)](name)  # type: ignore[no-any-return]


def _sections(name: str) -> "set[str]":
    """Headers of the sections of a spec."""
    try:
        with open(name, encoding="utf-8", errors="replace") as file:
            lines = (line.split("#")[0].strip() for line in file.read(1 << 20).splitlines())
            return {line for line in lines if line.startswith("[")}
    except OSError:
        # The loader says why.
        return set()
