"""Specs as they are given: a path, a text, or a dict of keys."""

from __future__ import annotations

import json
import os
from typing import Any, Dict, Mapping, Optional, Tuple, Union

from . import _plywave
from ._plywave import Error

Spec = Union[str, "os.PathLike[str]", Mapping[str, Any]]


def text_of(spec: Spec, name: str) -> Tuple[Optional[str], str]:
    """The path, or the text, of a spec. A string with a line break in it is a text, any other one a path."""
    if isinstance(spec, Mapping):
        try:
            given = json.dumps(spec, default=lambda value: value.tolist(), allow_nan=False)
        except (AttributeError, TypeError, ValueError) as error:
            raise Error(f"{name}: {error}; give a dict of numbers, texts, lists and dicts") from None
        return None, _plywave.toml_of_json(given, name)
    if isinstance(spec, str) and "\n" in spec:
        return None, spec
    if isinstance(spec, (str, os.PathLike)):
        return os.fspath(spec), ""
    raise Error(f"{name}: {type(spec).__name__}; give a path, the text of a spec, or a dict of its keys")


def spec_args(spec: Spec, name: str) -> Dict[str, Any]:
    """A spec for the extension module; files that a text or dict names are looked for in the current folder."""
    path, text = text_of(spec, name)
    return {"path": path, "text": text, "name": name, "folder": ""}
