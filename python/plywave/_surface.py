"""Fabrics and cloths on arrays: what they share."""

from __future__ import annotations

from typing import Any, Dict, List, Optional, Tuple, TypeVar

import numpy as np

from ._arrays import Queries, call, channels, count_of, floats
from ._plywave import Error
from ._results import Outcomes, Samples
from ._threads import get_threads

Self = TypeVar("Self", bound="Surface")


class Surface:
    """A fabric or a cloth as a surface, ready for shading.

    Queries are arrays that broadcast against each other as NumPy's do:

    - `position_um` `[..., 2]`: point of the cloth [um], x along the weft, y along the warp; of a knit x along the courses, y along the wales.
    - `wo` `[..., 3]`: direction towards the viewer, unit; z is the normal of the cloth's face.
    - `wi` `[..., 3]`: direction towards the light, unit.
    - `lambda_um` `[..., N]`: wavelengths [um], N from 1 to 8. Without, results are linear sRGB, N = 3.
    - `sigma_per_um`: absorptions [1/um] `[..., N]` instead of those of the yarns' colors, or a pair of these (or `None`) for warp and weft.
    - `turn_rad` `[...]`: angle by which the pattern is turned about the normal at the point [rad].
    - `footprint_um` `[...]`: diameter of the part of the cloth that the point stands for [um]; beyond a repeat, a surface with `far` returns the mean over it.

    f is an energy density [1/sr], the BSDF times the cosine of `wi`. Results are float32. Whatever numbers come in, calls give numbers.
    """

    _name: str
    _rust: Any
    _options: Dict[str, Any]

    @property
    def yarns(self) -> Tuple[str, ...]:
        """Kinds of its yarns: "warp" and "weft" of what is woven, else "yarn"."""
        return ("warp", "weft")

    def _index(self, yarn: str) -> int:
        if yarn not in self.yarns:
            raise Error(f"yarn = {yarn!r}: use " + " or ".join(f'"{kind}"' for kind in self.yarns))
        return self.yarns.index(yarn)

    def with_colors(self: Self, warp: Any = None, weft: Any = None, color_of: Optional[str] = None) -> Self:
        """The same with other colors; nothing is traced anew.

        Args:
            warp: Color of the warp, or of the only kind of yarn: three numbers of sRGB from 0 to 1, an absorption [1/um], or `None` for clear fibers.
            weft: Color of the weft.
            color_of: Light that the colors describe: "even_sky", "reflected" or "folded"; by default that of this one. Another one takes tenths of a second.
        """
        if weft is not None and len(self.yarns) == 1:
            raise Error(f"weft: {self._name} has one kind of yarn; give its color first")
        made = type(self).__new__(type(self))
        made.__dict__.update(self.__dict__)
        made._rust = self._rust.with_colors(_color(warp, "warp"), _color(weft, "weft"), color_of)
        return made

    @property
    def color_of(self) -> str:
        """Light that its colors describe: "even_sky", "reflected" or "folded"."""
        return str(self._rust.color_of)

    @property
    def notes(self) -> List[str]:
        """Notes of its loader, one line each."""
        return list(self._rust.notes)

    @property
    def memory_bytes(self) -> int:
        """Memory it takes, without its models."""
        return int(self._rust.memory_bytes)

    def sigma_of_reflectance(self, reflectance: Any) -> np.ndarray:
        """Absorptions [1/um] with which the cloth has these reflectances, of any shape; reflectances out of reach are clamped to clear or black fibers."""
        given = floats(reflectance, "reflectance")
        flat = np.ascontiguousarray(given).reshape(-1)
        return np.asarray(self._rust.sigma_of_reflectance(flat)).reshape(given.shape)

    def _ask(self, what: str, widths: Tuple[int, ...], position: Any, wo: Any, lambda_um: Any, sigma: Any, turn: Any, footprint: Any, w: Any = None, w_name: str = "wi") -> Tuple[Queries, int, List[np.ndarray]]:
        scalars = {"turn_rad": floats(turn, "turn_rad"), "footprint_um": floats(footprint, "footprint_um")}
        vectors = {"position_um": floats(position, "position_um", 2), "wo": floats(wo, "wo", 3)}
        counted: Dict[str, np.ndarray] = {}
        if lambda_um is None:
            counted["lambda_um (linear sRGB)"] = np.zeros(3, np.float32)
        else:
            counted["lambda_um"] = channels(lambda_um, "lambda_um")
        is_pair = isinstance(sigma, tuple) and len(sigma) == 2
        if is_pair and len(self.yarns) == 1:
            raise Error(f"sigma_per_um: a pair, for warp and weft; {self._name} has one kind of yarn")
        warp, weft = sigma if is_pair else (sigma, sigma)
        for name, value in (("sigma_per_um of the warp", warp), ("sigma_per_um of the weft", weft)):
            if value is not None:
                counted[name] = channels(value, name)
        n = count_of(counted)
        vectors.update(counted)
        if w is not None:
            vectors[w_name] = floats(w, w_name, 3)
        q = Queries(scalars, vectors)

        def row(name: str) -> Optional[np.ndarray]:
            return q.flat(counted[name], (n,)) if name in counted else None

        ask = {
            "n": q.n,
            "channels": n,
            "position": q.flat(vectors["position_um"], (2,)),
            "wo": q.flat(vectors["wo"], (3,)),
            "lambda": row("lambda_um"),
            "warp": row("sigma_per_um of the warp"),
            "weft": row("sigma_per_um of the weft"),
            "turn": q.flat(scalars["turn_rad"]),
            "footprint": q.flat(scalars["footprint_um"]),
            "w": None if w is None else q.flat(vectors[w_name], (3,)),
            "threads": get_threads(),
        }
        return q, n, call(self._rust, what, ask, *(width or n for width in widths), events=what == "sample")

    def eval(self, position_um: Any, wo: Any, wi: Any, lambda_um: Any = None, *, sigma_per_um: Any = None, turn_rad: Any = 0.0, footprint_um: Any = 0.0) -> np.ndarray:
        """f `[..., N]` [1/sr] for light from `wi`."""
        q, n, (f,) = self._ask("eval", (0,), position_um, wo, lambda_um, sigma_per_um, turn_rad, footprint_um, wi)
        return q.rows(f, n)

    def pdf(self, position_um: Any, wo: Any, wi: Any, lambda_um: Any = None, *, sigma_per_um: Any = None, turn_rad: Any = 0.0, footprint_um: Any = 0.0) -> np.ndarray:
        """Density `[...]` [1/sr] with which `sample` gives `wi`."""
        q, _, (pdf,) = self._ask("pdf", (1,), position_um, wo, lambda_um, sigma_per_um, turn_rad, footprint_um, wi)
        return q.rows(pdf)

    def eval_pdf(self, position_um: Any, wo: Any, wi: Any, lambda_um: Any = None, *, sigma_per_um: Any = None, turn_rad: Any = 0.0, footprint_um: Any = 0.0) -> "tuple[np.ndarray, np.ndarray]":
        """`eval` and `pdf` in about the time of one."""
        q, n, (f, pdf) = self._ask("eval_pdf", (0, 1), position_um, wo, lambda_um, sigma_per_um, turn_rad, footprint_um, wi)
        return q.rows(f, n), q.rows(pdf)

    def sample(self, position_um: Any, wo: Any, u: Any, lambda_um: Any = None, *, sigma_per_um: Any = None, turn_rad: Any = 0.0, footprint_um: Any = 0.0) -> Samples:
        """Directions towards light, from three uniform numbers `u` `[..., 3]` in [0, 1) per query."""
        q, n, (w, weight, pdf, event) = self._ask("sample", (3, 0, 1), position_um, wo, lambda_um, sigma_per_um, turn_rad, footprint_um, u, "u")
        return Samples(q.rows(w, 3), q.rows(weight, n), q.rows(pdf), q.rows(event))

    def albedo(self, position_um: Any, wo: Any, lambda_um: Any = None, *, sigma_per_um: Any = None, turn_rad: Any = 0.0, footprint_um: Any = 0.0) -> np.ndarray:
        """Integral of f over the sphere `[..., N]`."""
        q, n, (albedo,) = self._ask("albedo", (0,), position_um, wo, lambda_um, sigma_per_um, turn_rad, footprint_um)
        return q.rows(albedo, n)

    def straight(self, position_um: Any, wo: Any, lambda_um: Any = None, *, sigma_per_um: Any = None, turn_rad: Any = 0.0, footprint_um: Any = 0.0) -> np.ndarray:
        """Fraction of the light that goes straight through, unscattered `[..., N]`."""
        q, n, (straight,) = self._ask("straight", (0,), position_um, wo, lambda_um, sigma_per_um, turn_rad, footprint_um)
        return q.rows(straight, n)

    def outcomes(self, position_um: Any, wo: Any, lambda_um: Any = None, *, sigma_per_um: Any = None, turn_rad: Any = 0.0, footprint_um: Any = 0.0) -> Outcomes:
        """Probabilities of the outcomes of `sample`, `[...]` each."""
        q, _, (all_of,) = self._ask("outcomes", (3,), position_um, wo, lambda_um, sigma_per_um, turn_rad, footprint_um)
        rows = q.rows(all_of, 3)
        return Outcomes(rows[..., 0], rows[..., 1], rows[..., 2])

    def is_gap(self, position_um: Any, wo: Any, *, turn_rad: Any = 0.0) -> np.ndarray:
        """Whether the point lies in a gap `[...]`, bool: the line from the viewer hits no ply."""
        q, _, (gap,) = self._ask("is_gap", (1,), position_um, wo, None, None, turn_rad, 0.0)
        return np.asarray(q.rows(gap) > 0.5)


def _color(color: Any, name: str) -> Any:
    if color is None:
        return None
    given = floats(color, name)
    if given.shape not in ((), (1,), (3,)):
        raise Error(f"{name}: shape {given.shape}; give three numbers of sRGB, one absorption [1/um], or None")
    return float(given.reshape(())) if given.size == 1 else [float(c) for c in given]


