"""Files: what is in them as arrays and a document, and back."""

from __future__ import annotations

import copy
import json
import os
from typing import Any, ClassVar, Dict, Mapping, Tuple, Type, TypeVar, Union

import numpy as np

from . import _plywave
from ._plywave import Error

PathLike = Union[str, "os.PathLike[str]"]
Self = TypeVar("Self", bound="Document")

_DTYPES = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "U64": "<u8", "U8": "|u1"}
_NAMES = {np.dtype(v): k for k, v in _DTYPES.items()}


def unpack(data: bytes) -> Tuple[Dict[str, np.ndarray], Dict[str, Any]]:
    """Arrays by name, read-only views of the bytes, and the JSON document of a file."""
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size])
    document = json.loads(header.pop("__metadata__")["plywave"])
    arrays = {}
    for name, info in header.items():
        begin, end = info["data_offsets"]
        flat = np.frombuffer(data, _DTYPES[info["dtype"]], offset=8 + size + begin, count=_count(info["shape"]))
        arrays[name] = flat.reshape(info["shape"])
    return arrays, document


def _count(shape: Any) -> int:
    count = 1
    for length in shape:
        count *= length
    return count


def pack(arrays: Mapping[str, Any], document: Mapping[str, Any], name: str) -> bytes:
    """The bytes of a file; what is in it is checked by who reads it."""
    header: Dict[str, Any] = {"__metadata__": {"plywave": _json(document, name)}}
    blobs, at = [], 0
    # As the Rust side writes them: by the size of their numbers, then by name.
    made = {key: _tensor(value, key, name) for key, value in arrays.items()}
    for key in sorted(made, key=lambda k: (-made[k].dtype.itemsize, k)):
        blob = made[key].tobytes()
        header[key] = {"dtype": _NAMES[made[key].dtype], "shape": list(made[key].shape), "data_offsets": [at, at + len(blob)]}
        blobs.append(blob)
        at += len(blob)
    text = json.dumps(header, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return b"".join([len(text).to_bytes(8, "little"), text, *blobs])


def _json(document: Mapping[str, Any], name: str) -> str:
    try:
        return json.dumps(document, ensure_ascii=False, default=lambda v: v.tolist(), allow_nan=False)
    except (AttributeError, TypeError, ValueError) as error:
        raise Error(f"{name}: document: {error}; use values that JSON can hold") from None


def _tensor(value: Any, key: str, name: str) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype.newbyteorder("=") in (np.dtype("f8"), np.dtype("f4"), np.dtype("f2"), np.dtype("u8"), np.dtype("u1")):
        return np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    raise Error(f"{name}: {key} = dtype {array.dtype}: give float64, float32, float16, uint64 or uint8 as the file has it")


class Document:
    """What is in a file: arrays by name, and a JSON document with its axes, its statistics and where it comes from."""

    _kind: ClassVar[str] = ""
    _words: ClassVar[str] = ""
    _bytes: bytes
    _name: str

    def __init__(self, path: PathLike) -> None:
        """Reads a file.

        Raises:
            Error: when the file cannot be read or holds something else.
        """
        self._name = os.fspath(path)
        self._bytes = _plywave.read_checked(self._kind, self._name)

    @classmethod
    def from_bytes(cls: Type[Self], data: bytes, name: str = "bytes") -> Self:
        """From the bytes of a file; `name` stands for it in messages."""
        _plywave.check_bytes(cls._kind, bytes(data), name)
        made = cls.__new__(cls)
        made._bytes, made._name = bytes(data), name
        return made

    @classmethod
    def _trusted(cls: Type[Self], data: bytes, name: str) -> Self:
        """Of bytes that the extension module just made."""
        made = cls.__new__(cls)
        made._bytes, made._name = data, name
        return made

    @classmethod
    def from_tensors(cls: Type[Self], tensors: Mapping[str, Any], document: Mapping[str, Any], name: str = "tensors") -> Self:
        """From arrays by name and a document, as `tensors()` and `document` give them; checked as a file is. Axes and
        statistics of the document are made anew.

        Raises:
            Error: when a file with them would be refused.
        """
        return cls.from_bytes(_plywave.rewritten(cls._kind, pack(tensors, document, name), name), name)

    def to_bytes(self) -> bytes:
        """The bytes of its file."""
        return self._bytes

    def save(self, path: PathLike) -> None:
        """Writes its file, whole or not at all.

        Raises:
            Error: when the file cannot be written.
        """
        _plywave.write_file(os.fspath(path), self.to_bytes())

    def _unpacked(self) -> Tuple[Dict[str, np.ndarray], Dict[str, Any]]:
        known = self.__dict__.get("_parts")
        if known is None:
            known = self.__dict__["_parts"] = unpack(self.to_bytes())
        return known

    def tensors(self) -> Dict[str, np.ndarray]:
        """Arrays by name, read-only, as the pages of docs/reference/format have them: shapes, units and meanings are there."""
        return dict(self._unpacked()[0])

    @property
    def document(self) -> Dict[str, Any]:
        """The JSON document of the file, a copy: format, preset, seed, the spec's text, axes, statistics."""
        return copy.deepcopy(self._unpacked()[1])

    @property
    def spec_text(self) -> str:
        """Text of the yarn spec, cloth spec or scene that it was made of."""
        return str(self._unpacked()[1]["spec"])

    @property
    def name(self) -> str:
        """Name of its yarn, fiber or cloth, where its spec has one; else of its file."""
        for line in self.spec_text.splitlines():
            key, _, value = line.partition("=")
            if key.strip() == "name":
                return value.split("#")[0].strip().strip("\"'")
        return os.path.basename(self._name)

    def __reduce__(self) -> Any:
        return type(self).from_bytes, (self.to_bytes(), self._name)

    def __repr__(self) -> str:
        return f"<plywave.{type(self).__name__} {self.name!r}, {len(self.to_bytes()) / 1e6:.1f} MB>"

    def _facts(self) -> Dict[str, str]:
        arrays, document = self._unpacked()
        facts = {"preset": str(document["preset"]), "seed": str(document["seed"]), "plywave": str(document["program_version"])}
        for key, array in arrays.items():
            facts[key] = f"{array.dtype} {list(array.shape)}"
        return facts

    def _repr_html_(self) -> str:
        return html_table(f"{self._words}: {self.name}", self._facts())


def html_table(title: str, facts: Mapping[str, str]) -> str:
    """A table for notebooks."""
    from html import escape

    rows = "".join(f"<tr><th style='text-align:left'>{escape(k)}</th><td style='text-align:left'>{escape(v)}</td></tr>" for k, v in facts.items())
    return f"<table><caption>{escape(title)}</caption>{rows}</table>"


class Table(Document):
    """Simulated scattering of a ply (.pwt): `tensors()` has `refl` `[theta_i][h][theta_o][phi_o]`, `high` `[theta_i][h][sigma][theta_o][phi_o]`
    (energy densities [1/sr]), their energies and axes."""

    _kind, _words = "table", "table of a ply"


class Speckle(Document):
    """Speckle patterns of single fibers (.pws)."""

    _kind, _words = "speckle", "speckle patterns"


class Twin(Document):
    """Path-traced scattering of a cloth's explicit fibers (.pwx)."""

    _kind, _words = "twin", "twin of a cloth"
