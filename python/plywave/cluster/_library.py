"""Library files: what is to be made, as TOML."""

from __future__ import annotations

import json
import os
from typing import Any, Callable, Dict, List, Tuple, Union

from .. import _plywave
from .._files import PathLike
from .._plywave import Error
from ._items import Item, check_options, compare_item, family_item, fiber_item, speckle_item, twin_item, yarn_item

_TOP: Dict[str, type] = {"name": str, "quality": str, "seed": int, "yarn": list, "family": list, "fiber": list, "speckle": list, "twin": list, "compare": list}
_KEYS: Dict[str, Dict[str, Union[type, Tuple[type, ...]]]] = {
    "yarn": {"spec": str, "name": str, "quality": str, "seed": int, "paths": int, "instances": int, "speckle": (bool, int)},
    "family": {"spec": str, "name": str, "quality": str, "seed": int, "nodes": int, "paths": int, "instances": int},
    "fiber": {
        "spec": str,
        "name": str,
        "quality": str,
        "seed": int,
        "sigma_per_um": float,
        "rays": bool,
        "lambdas": int,
        "thetas": int,
        "azimuths": int,
        "ray_count": int,
        "beta_m_rad": float,
    },
    "speckle": {"spec": str, "name": str, "seed": int, "instances": int},
    "twin": {"cloth": str, "name": str, "seed": int, "paths": int},
    "compare": {
        "spec": str,
        "name": str,
        "seed": int,
        "instances": int,
        "lambda_um": (float, list),
        "h_rel": (float, list),
        "theta_i_deg": float,
        "sigma_per_um": float,
        "tolerance": float,
        "paths": int,
    },
}
_MAKE: Dict[str, Callable[..., Item]] = {
    "yarn": yarn_item,
    "family": family_item,
    "fiber": fiber_item,
    "speckle": speckle_item,
    "twin": twin_item,
    "compare": compare_item,
}


class Library:
    """Items of a library file (docs/howto/cluster.md); specs are looked for from the file's folder on."""

    def __init__(self, path: PathLike) -> None:
        """Reads and checks a library file and all specs it names.

        Raises:
            Error: for an unknown key, a value out of range, a spec that is refused, a name that is there twice.
        """
        file = os.fspath(path)
        try:
            with open(file, encoding="utf-8") as stream:
                text = stream.read()
        except (OSError, UnicodeDecodeError) as error:
            raise Error(f"{file}: {getattr(error, 'strerror', None) or error}") from None
        data = json.loads(_plywave.json_of_toml(text, file))
        for key, value in data.items():
            if key in _KEYS and not isinstance(value, list):
                raise Error(f"{file}: {key} is no list of tables; write [[{key}]]")
            check_options({key: value}, _TOP, file)
        self.name: str = data.get("name", os.path.splitext(os.path.basename(file))[0])
        self.items: List[Item] = []
        for kind in _KEYS:
            for at, entry in enumerate(data.get(kind, [])):
                self.items.append(_item(kind, entry, f"{file}: {kind}[{at + 1}]", data, os.path.dirname(file)))
        if not self.items:
            raise Error(f"{file}: nothing to make; give a [[yarn]] with a spec")
        seen: Dict[str, str] = {}
        for item in self.items:
            name = f"{item.name}.{item.extension}"
            if not item.name or os.path.basename(name) != name:
                raise Error(f"{file}: name = {item.name!r}: give a name without folders")
            if name in seen:
                raise Error(f"{file}: {name} is made twice; give one of them another name")
            seen[name] = name


def _item(kind: str, entry: Any, where: str, library: Dict[str, Any], folder: str) -> Item:
    if not isinstance(entry, dict):
        raise Error(f"{where}: no table; write [[{kind}]]")
    check_options(entry, _KEYS[kind], where)
    source = "cloth" if kind == "twin" else "spec"
    if source not in entry:
        raise Error(f"{where}: {source} is missing; give a path")
    options = dict(entry)
    for key in ("quality", "seed"):
        if key in library and key in _KEYS[kind]:
            options.setdefault(key, library[key])
    path = os.path.join(folder, options.pop(source))
    try:
        return _MAKE[kind](path, **options)
    except Error as error:
        # What names the spec itself needs no place in the library.
        raise Error(str(error) if path in str(error) else f"{where}: {error}") from None
