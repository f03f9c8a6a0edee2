"""Fibers on arrays."""

from __future__ import annotations

import os
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from . import _plywave
from ._plywave import Error
from ._arrays import Queries, call, channels, count_of, floats
from ._files import Document, PathLike
from ._results import Outcomes, Samples
from ._threads import get_threads


class Fiber(Document):
    """A fiber: a table by wave optics or rays (.pwf), or an analytic fiber by its spec (.toml).

    - `omega_i` `[..., 3]`: direction that light comes from, unit, in the fiber's frame: z along it.
    - `omega_o` `[..., 3]`: outgoing directions, unit.
    - `lambda_um` `[..., N]`: wavelengths [um], N from 1 to 8. A number alone is N = 1.
    - `sigma_per_um` `[..., N]`: absorption of the inside of an analytic fiber [1/um]. Without it the spec's, which needs N = 3. Tables ignore it.
    - `h_rel` `[...]`: offset of the ray from the center line over half the fiber's width, -1 to 1. Without it the mean over all offsets, which tables always give.

    f is an energy density [1/sr] of the light that the fiber takes from the width `width_um`. Results are float32.
    """

    _kind, _words = "fiber", "fiber table"

    def __init__(self, path: PathLike) -> None:
        """Reads a fiber table, or the spec of an analytic fiber.

        Raises:
            Error: when the file cannot be read or holds something else.
        """
        self._name = os.fspath(path)
        self._rust = _plywave.Fiber.load(self._name)

    @classmethod
    def from_bytes(cls, data: bytes, name: str = "bytes") -> "Fiber":
        """From the bytes of a fiber file; `name` stands for it in messages, and ends in `.toml` for a spec."""
        return cls._of(_plywave.Fiber.from_bytes(bytes(data), name), name)

    @classmethod
    def _of(cls, rust: "_plywave.Fiber", name: str) -> "Fiber":
        made = cls.__new__(cls)
        made._rust, made._name = rust, name
        return made

    def to_bytes(self) -> bytes:
        """The bytes of its file."""
        known = self.__dict__.get("_bytes")
        if known is None:
            known = self.__dict__["_bytes"] = self._rust.to_bytes()
        return bytes(known)

    def with_beta_m(self, beta_m_rad: float) -> "Fiber":
        """The same with another longitudinal width [rad], clamped to [0.001, 2]."""
        return Fiber._of(self._rust.with_beta_m(beta_m_rad), self._name)

    @property
    def lambda_um(self) -> "Optional[Tuple[float, float, float]]":
        """Wavelengths [um] of an analytic fiber's spec; none of a table."""
        color = self._rust.color
        return None if color is None else color[0]

    @property
    def max_width_um(self) -> float:
        """Largest width from which it takes light [um]: the diameter of the cylinder to intersect."""
        return self._rust.max_width_um

    def _sigma(self, n: int) -> Any:
        color = self._rust.color
        if color is None or not any(color[1]):
            return 0.0
        if n != 3:
            raise Error(f"{self._name}: the spec's absorption has 3 wavelengths, lambda_um {n}; give sigma_per_um")
        return color[1]

    def _ask(self, what: str, widths: Tuple[int, ...], omega_i: Any, lambda_um: Any, sigma_per_um: Any, h_rel: Any, w: Any = None, w_name: str = "omega_o") -> Tuple[Queries, int, List[np.ndarray]]:
        vectors = {"omega_i": floats(omega_i, "omega_i", 3), "lambda_um": channels(lambda_um, "lambda_um")}
        given = self._sigma(vectors["lambda_um"].shape[-1]) if sigma_per_um is None else sigma_per_um
        vectors["sigma_per_um"] = channels(given, "sigma_per_um")
        n = count_of({name: vectors[name] for name in ("lambda_um", "sigma_per_um")})
        scalars: Dict[str, np.ndarray] = {} if h_rel is None else {"h_rel": floats(h_rel, "h_rel")}
        if w is not None:
            vectors[w_name] = floats(w, w_name, 3)
        q = Queries(scalars, vectors)
        ask = {
            "n": q.n,
            "channels": n,
            "omega_i": q.flat(vectors["omega_i"], (3,)),
            "lambda": q.flat(vectors["lambda_um"], (n,)),
            "sigma": q.flat(vectors["sigma_per_um"], (n,)),
            "h_rel": None if h_rel is None else q.flat(scalars["h_rel"]),
            "w": None if w is None else q.flat(vectors[w_name], (3,)),
            "threads": get_threads(),
        }
        return q, n, call(self._rust, what, ask, *(width or n for width in widths), events=what == "sample")

    def eval(self, omega_i: Any, omega_o: Any, lambda_um: Any, sigma_per_um: Any = None, h_rel: Any = None) -> np.ndarray:
        """f `[..., N]` [1/sr]."""
        q, n, (f,) = self._ask("eval", (0,), omega_i, lambda_um, sigma_per_um, h_rel, omega_o)
        return q.rows(f, n)

    def pdf(self, omega_i: Any, omega_o: Any, lambda_um: Any, sigma_per_um: Any = None, h_rel: Any = None) -> np.ndarray:
        """Density `[...]` [1/sr] with which `sample` gives `omega_o`."""
        q, _, (pdf,) = self._ask("pdf", (1,), omega_i, lambda_um, sigma_per_um, h_rel, omega_o)
        return q.rows(pdf)

    def eval_pdf(self, omega_i: Any, omega_o: Any, lambda_um: Any, sigma_per_um: Any = None, h_rel: Any = None) -> "tuple[np.ndarray, np.ndarray]":
        """`eval` and `pdf` in about the time of one."""
        q, n, (f, pdf) = self._ask("eval_pdf", (0, 1), omega_i, lambda_um, sigma_per_um, h_rel, omega_o)
        return q.rows(f, n), q.rows(pdf)

    def sample(self, omega_i: Any, u: Any, lambda_um: Any, sigma_per_um: Any = None, h_rel: Any = None) -> Samples:
        """What becomes of light, from three uniform numbers `u` `[..., 3]` in [0, 1) per query."""
        q, n, (w, weight, pdf, event) = self._ask("sample", (3, 0, 1), omega_i, lambda_um, sigma_per_um, h_rel, u, "u")
        return Samples(q.rows(w, 3), q.rows(weight, n), q.rows(pdf), q.rows(event))

    def albedo(self, omega_i: Any, lambda_um: Any, sigma_per_um: Any = None, h_rel: Any = None) -> np.ndarray:
        """Scattered over extinguished light `[..., N]`; 1 for a lossless fiber."""
        q, n, (albedo,) = self._ask("albedo", (0,), omega_i, lambda_um, sigma_per_um, h_rel)
        return q.rows(albedo, n)

    def outcomes(self, omega_i: Any, lambda_um: Any, sigma_per_um: Any = None, h_rel: Any = None) -> Outcomes:
        """Probabilities of the outcomes of `sample`, `[...]` each."""
        q, _, (all_of,) = self._ask("outcomes", (3,), omega_i, lambda_um, sigma_per_um, h_rel)
        rows = q.rows(all_of, 3)
        return Outcomes(rows[..., 0], rows[..., 1], rows[..., 2])

    def width_um(self, omega_i: Any, lambda_um: Any, sigma_per_um: Any = None, h_rel: Any = None) -> np.ndarray:
        """Width from which the fiber takes light [um] `[..., N]`: rays with a larger offset from the center line than half of it miss the fiber."""
        q, n, (width,) = self._ask("width_um", (0,), omega_i, lambda_um, sigma_per_um, h_rel)
        return q.rows(width, n)
