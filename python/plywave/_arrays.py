"""Arrays of queries: checked, broadcast against each other, and flat for the extension module."""

from __future__ import annotations

from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from ._plywave import MAX_CHANNELS, RGB_LAMBDA_UM, Error

Shape = Tuple[int, ...]


def floats(value: Any, name: str, last: Optional[int] = None) -> np.ndarray:
    """An array of float32 or float64. Python's own numbers and lists of them may be integers; arrays of anything but floats are refused."""
    given = value if isinstance(value, np.ndarray) else _array(value, name)
    # Lists and numbers of Python hold whatever was typed; an array has a type that somebody chose.
    typed = hasattr(value, "dtype") or hasattr(value, "__array__") or hasattr(value, "__array_interface__")
    if given.dtype.kind != "f":
        if typed or given.dtype.kind not in "iu":
            raise Error(f"{name}: dtype {given.dtype}, shape {given.shape}; give float32 or float64")
        given = given.astype(np.float64)
    if given.dtype not in (np.float32, np.float64) or not given.dtype.isnative:
        given = given.astype(np.float32 if given.dtype.itemsize == 4 else np.float64)
    if last is not None and (given.ndim == 0 or given.shape[-1] != last):
        raise Error(f"{name}: shape {given.shape}; give [..., {last}]")
    return given


def _array(value: Any, name: str) -> np.ndarray:
    try:
        return np.asarray(value)
    except (TypeError, ValueError) as error:
        raise Error(f"{name}: not an array of numbers: {' '.join(str(error).split())}") from None


def channels(value: Any, name: str) -> np.ndarray:
    """An array [..., N]; a number alone is N = 1."""
    given = floats(value, name)
    return given.reshape(1) if given.ndim == 0 else given


def lambdas(value: Any, count: int) -> np.ndarray:
    """Wavelengths [..., N]; where there are none, those of R, G, B for three channels and 0.55 um for other numbers."""
    if value is not None:
        return channels(value, "lambda_um")
    return np.array(RGB_LAMBDA_UM if count == 3 else [0.55], np.float32)


def integers(value: Any, name: str) -> np.ndarray:
    """An array of whole numbers, 0 or more, as uint64."""
    given = value if isinstance(value, np.ndarray) else _array(value, name)
    if given.dtype.kind not in "iu" or (given.dtype.kind == "i" and given.size and int(given.min()) < 0):
        raise Error(f"{name}: dtype {given.dtype}, shape {given.shape}; give whole numbers, 0 or more")
    return given.astype(np.uint64)


def count_of(arrays: Dict[str, np.ndarray]) -> int:
    """N of arrays [..., N] or [..., 1]."""
    counts = {name: a.shape[-1] for name, a in arrays.items()}
    count = 1
    for n in counts.values():
        if n != 1:
            count = n
    if any(n not in (1, count) for n in counts.values()):
        told = ", ".join(f"{name} {arrays[name].shape}" for name in arrays)
        raise Error(f"the last axes differ: {told}; give one absorption and one wavelength per channel")
    if not 1 <= count <= MAX_CHANNELS:
        told = ", ".join(f"{name} {arrays[name].shape}" for name in arrays)
        raise Error(f"{told}: the last axis is N absorptions or wavelengths; give 1 to {MAX_CHANNELS}")
    return count


class Queries:
    """Arrays of queries, flat, and the shape that they broadcast to."""

    def __init__(self, scalars: Dict[str, np.ndarray], vectors: Dict[str, np.ndarray]) -> None:
        """`scalars` have a value a query, `vectors` a row in their last axis."""
        leads = [(name, a.shape) for name, a in scalars.items()] + [(name, a.shape[:-1]) for name, a in vectors.items()]
        try:
            self.shape: Shape = np.broadcast_shapes(*(lead for _, lead in leads))
        except ValueError:
            told = ", ".join(f"{name} {a.shape}" for name, a in {**scalars, **vectors}.items())
            raise Error(f"shapes do not broadcast: {told}; the last axis of {', '.join(vectors)} is its own") from None
        self.n = 1
        for length in self.shape:
            self.n *= length

    def flat(self, array: np.ndarray, core: Shape = ()) -> np.ndarray:
        """One row for all queries, or a row a query; `core` is the shape of a row."""
        rank = array.ndim - len(core)
        lead = array.shape[:rank]
        if lead == self.shape and array.shape[rank:] == core:
            return np.ascontiguousarray(array).reshape(-1)
        if all(length == 1 for length in lead):
            return np.ascontiguousarray(np.broadcast_to(array.reshape(array.shape[rank:]), core)).reshape(-1)
        return np.ascontiguousarray(np.broadcast_to(array, self.shape + core)).reshape(-1)

    def rows(self, flat: np.ndarray, *core: int) -> np.ndarray:
        """A flat result in the shape of the queries."""
        return flat.reshape(self.shape + core)


def call(rust: Any, what: str, ask: Dict[str, Any], *widths: int, events: bool = False) -> List[np.ndarray]:
    """Asks the extension module; gives its results flat, `n` rows of each width."""
    n = ask["n"]
    made = [np.empty(n * width, np.float32) for width in widths]
    event = np.empty(n, np.uint8) if events else None
    rust.ask(what, ask, {"floats": made, "events": event})
    return made if event is None else [*made, event]
