"""Ply models on arrays."""

from __future__ import annotations

import os
from typing import Any, List, Optional, Tuple

import numpy as np

from . import _plywave
from ._plywave import Error
from ._arrays import Queries, call, channels, count_of, floats, integers, lambdas
from ._files import Document, PathLike, Table
from ._results import Layer, Outcomes, Place, Samples, Slit, Terms
from ._threads import get_threads


class Model(Document):
    """A ply model (.pwm), ready for evaluation.

    Queries are arrays that broadcast against each other as NumPy's do; `omega_o`, `u`, `sigma_per_um` and `lambda_um` have a last axis of their own:

    - `theta_i` `[...]`: incident latitude [rad]; the beam comes from `(0, cos theta_i, sin theta_i)`, z along the ply.
    - `h_um` `[...]`: x coordinate of the beam's center [um].
    - `omega_o` `[..., 3]`: outgoing directions, unit.
    - `sigma_per_um` `[..., N]`: absorptions of the fibers [1/um], N from 1 to 8: the color. A number alone is N = 1.
    - `lambda_um` `[..., N]`: wavelengths [um]; by default those of R, G, B for N = 3, else 0.55. Edge light, slits and speckle depend on them.
    - `place`: a `Place`, where on the ply: its fibers show by their relief, and by speckle in a model with noise (`has_noise`); by default the smooth model.
      `relief=False` and `speckle=False` leave one out. Sampling, pdf and albedo are those of the smooth model.
    - `edge`: light that passes beside the ply is diffracted at its edge; otherwise it goes straight on.
    - `below`: a second layer of yarn below (Yu 2025, 5.4): a `Layer`, from `layer` of its model. Not for a model without layer factors (`has_layers`).
    - `slit`: a `Slit`, small gaps between the fibers; has no effect over a second layer.

    f is an energy density [1/sr], the BSDF times the cosine. Results are float32. Whatever numbers come in, calls give numbers: where a query is not finite, the
    beam misses and f = 0. Arrays that are not of floats, or do not broadcast, raise `Error`.
    """

    _kind, _words = "model", "ply model"
    table: Optional[Table] = None
    """The table it was fitted to, of a model that `build` made."""

    def __init__(self, path: PathLike) -> None:
        """Reads a model file, or a model by its name: "polyester" of those that ship, or of the folders of the variable PLYWAVE_MODELS.

        Raises:
            Error: when the file cannot be read or holds something else.
        """
        self._name = os.fspath(path)
        self._rust = _plywave.Model.load(self._name)

    @classmethod
    def from_bytes(cls, data: bytes, name: str = "bytes") -> "Model":
        """From the bytes of a model file; `name` stands for it in messages."""
        return cls._of(_plywave.Model.from_bytes(bytes(data), name), name)

    @classmethod
    def _of(cls, rust: "_plywave.Model", name: str) -> "Model":
        made = cls.__new__(cls)
        made._rust, made._name = rust, name
        return made

    def to_bytes(self) -> bytes:
        """The bytes of its file."""
        known = self.__dict__.get("_bytes")
        if known is None:
            known = self.__dict__["_bytes"] = self._rust.to_bytes()
        return bytes(known)

    @property
    def has_edge(self) -> bool:
        """Whether it has edge lobes."""
        return self._rust.has_edge

    @property
    def has_noise(self) -> bool:
        """Whether it carries speckle."""
        return self._rust.has_noise

    @property
    def has_layers(self) -> bool:
        """Whether it has layer factors: `layer` and `below` need them."""
        return self._rust.has_layers

    @property
    def reference_error(self) -> float:
        """Greatest difference of eval from the values stored in the file, over the greatest of them; 0 when none are stored."""
        return self._rust.reference_error

    def _ask(self, what: str, widths: Tuple[int, ...], theta_i: Any, h_um: Any, sigma: Any, lambda_um: Any, edge: bool, w: Any = None, w_name: str = "omega_o", place: Optional[Place] = None, relief: bool = True, speckle: bool = True, below: Optional[Layer] = None, slit: Optional[Slit] = None) -> Tuple[Queries, int, List[np.ndarray]]:
        scalars = {"theta_i": floats(theta_i, "theta_i"), "h_um": floats(h_um, "h_um")}
        sigmas = channels(sigma, "sigma_per_um")
        wavelengths = lambdas(lambda_um, sigmas.shape[-1])
        vectors = {"sigma_per_um": sigmas, "lambda_um": wavelengths}
        if below is not None:
            if not isinstance(below, Layer):
                raise Error(f"below: {type(below).__name__}: give a Layer, as `Model.layer` makes it")
            vectors |= {f"below.{part}": channels(value, f"below.{part}") for part, value in below._asdict().items()}
            if not all(np.isfinite(vectors[f"below.{part}"]).all() for part in Layer._fields):
                raise Error("below: not finite; give a Layer, as `Model.layer` makes it")
        if slit is not None and not isinstance(slit, Slit):
            raise Error(f"slit: {type(slit).__name__}: give a Slit")
        n = count_of(vectors)
        if w is not None:
            vectors[w_name] = floats(w, w_name, 3)
        if place is not None:
            if not isinstance(place, Place):
                raise Error(f"place: {type(place).__name__}: give a Place")
            scalars["place.ply"] = integers(place.ply, "place.ply")
            scalars |= {f"place.{part}": floats(getattr(place, part), f"place.{part}") for part in Place._fields[1:]}
        q = Queries(scalars, vectors)
        ask = {
            "n": q.n,
            "channels": n,
            "theta_i": q.flat(scalars["theta_i"]),
            "h_um": q.flat(scalars["h_um"]),
            "sigma": q.flat(sigmas, (n,)),
            "lambda": q.flat(wavelengths, (n,)),
            "w": None if w is None else q.flat(vectors[w_name], (3,)),
            "place": None if place is None else tuple(q.flat(scalars[f"place.{part}"]) for part in Place._fields),
            "shown": (bool(relief), bool(speckle)),
            "below": None if below is None else [q.flat(vectors[f"below.{part}"], (n,)) for part in Layer._fields],
            "slit": None if slit is None else (float(slit.width_um), float(slit.share)),
            "edge": bool(edge),
            "threads": get_threads(),
        }
        return q, n, call(self._rust, what, ask, *(width or n for width in widths), events=what == "sample")

    def eval(self, theta_i: Any, h_um: Any, omega_o: Any, sigma_per_um: Any, lambda_um: Any = None, *, edge: bool = True, place: Optional[Place] = None, relief: bool = True, speckle: bool = True, below: Optional[Layer] = None, slit: Optional[Slit] = None) -> np.ndarray:
        """f `[..., N]` [1/sr] in the directions `omega_o`."""
        q, n, (f,) = self._ask("eval", (0,), theta_i, h_um, sigma_per_um, lambda_um, edge, omega_o, place=place, relief=relief, speckle=speckle, below=below, slit=slit)
        return q.rows(f, n)

    def pdf(self, theta_i: Any, h_um: Any, omega_o: Any, sigma_per_um: Any, lambda_um: Any = None, *, edge: bool = True, below: Optional[Layer] = None, slit: Optional[Slit] = None) -> np.ndarray:
        """Density `[...]` [1/sr] with which `sample` gives `omega_o`."""
        q, _, (pdf,) = self._ask("pdf", (1,), theta_i, h_um, sigma_per_um, lambda_um, edge, omega_o, below=below, slit=slit)
        return q.rows(pdf)

    def eval_pdf(self, theta_i: Any, h_um: Any, omega_o: Any, sigma_per_um: Any, lambda_um: Any = None, *, edge: bool = True, place: Optional[Place] = None, relief: bool = True, speckle: bool = True, below: Optional[Layer] = None, slit: Optional[Slit] = None) -> "tuple[np.ndarray, np.ndarray]":
        """`eval` and `pdf` in about the time of one."""
        q, n, (f, pdf) = self._ask("eval_pdf", (0, 1), theta_i, h_um, sigma_per_um, lambda_um, edge, omega_o, place=place, relief=relief, speckle=speckle, below=below, slit=slit)
        return q.rows(f, n), q.rows(pdf)

    def sample(self, theta_i: Any, h_um: Any, u: Any, sigma_per_um: Any, lambda_um: Any = None, *, edge: bool = True, place: Optional[Place] = None, relief: bool = True, speckle: bool = True, below: Optional[Layer] = None, slit: Optional[Slit] = None) -> Samples:
        """What becomes of light, from three uniform numbers `u` `[..., 3]` in [0, 1) per query."""
        q, n, (w, weight, pdf, event) = self._ask("sample", (3, 0, 1), theta_i, h_um, sigma_per_um, lambda_um, edge, u, "u", place, relief, speckle, below=below, slit=slit)
        return Samples(q.rows(w, 3), q.rows(weight, n), q.rows(pdf), q.rows(event))

    def albedo(self, theta_i: Any, h_um: Any, sigma_per_um: Any, lambda_um: Any = None, *, edge: bool = True, below: Optional[Layer] = None, slit: Optional[Slit] = None) -> np.ndarray:
        """Integral of f over the sphere `[..., N]`."""
        q, n, (albedo,) = self._ask("albedo", (0,), theta_i, h_um, sigma_per_um, lambda_um, edge, below=below, slit=slit)
        return q.rows(albedo, n)

    def straight(self, theta_i: Any, h_um: Any, sigma_per_um: Any, lambda_um: Any = None, *, edge: bool = True, below: Optional[Layer] = None, slit: Optional[Slit] = None) -> np.ndarray:
        """Fraction of the light that goes straight on, unscattered `[..., N]`."""
        q, n, (straight,) = self._ask("straight", (0,), theta_i, h_um, sigma_per_um, lambda_um, edge, below=below, slit=slit)
        return q.rows(straight, n)

    def outcomes(self, theta_i: Any, h_um: Any, sigma_per_um: Any, lambda_um: Any = None, *, edge: bool = True, below: Optional[Layer] = None, slit: Optional[Slit] = None) -> Outcomes:
        """Probabilities of the outcomes of `sample`, `[...]` each."""
        q, _, (all_of,) = self._ask("outcomes", (3,), theta_i, h_um, sigma_per_um, lambda_um, edge, below=below, slit=slit)
        rows = q.rows(all_of, 3)
        return Outcomes(rows[..., 0], rows[..., 1], rows[..., 2])

    def terms(self, theta_i: Any, h_um: Any, omega_o: Any, sigma_per_um: Any, lambda_um: Any = None, *, edge: bool = True, slit: Optional[Slit] = None) -> Terms:
        """The terms of f apart, `[..., N]` each [1/sr], smooth and without a second layer."""
        q, n, parts = self._ask("terms", (0, 0, 0, 0), theta_i, h_um, sigma_per_um, lambda_um, edge, omega_o, slit=slit)
        return Terms(*(q.rows(part, n) for part in parts))

    def layer(self, theta_i: Any, sigma_per_um: Any) -> Layer:
        """A layer of this ply's yarns at latitudes `theta_i` `[...]` [rad], for absorptions `[..., N]`: what lies below another ply.

        Raises:
            Error: when the model has no layer factors.
        """
        q, n, parts = self._ask("layer", (0, 0, 0, 0), theta_i, 0.0, sigma_per_um, None, False)
        return Layer(*(q.rows(part, n) for part in parts))

    def r_d(self, theta_i: Any, h_um: Any) -> np.ndarray:
        """Fraction of the beam that hits no fiber `[...]`."""
        q, _, (r_d,) = self._ask("r_d", (1,), theta_i, h_um, 0.0, None, False)
        return q.rows(r_d)
