"""Woven fabrics on arrays."""

from __future__ import annotations

import os
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from . import _plywave
from ._arrays import Queries, call, channels, count_of, floats
from ._files import PathLike, html_table
from ._model import Model
from ._plywave import Error
from ._results import Outcomes, Samples, Slit
from ._spec import Spec, text_of
from ._threads import get_threads


class Fabric:
    """A woven fabric as a surface, ready for shading.

    Queries are arrays that broadcast against each other as NumPy's do:

    - `position_um` `[..., 2]`: point of the fabric [um], x along the weft, y along the warp.
    - `wo` `[..., 3]`: direction towards the viewer, unit; z is the normal of the fabric's face.
    - `wi` `[..., 3]`: direction towards the light, unit.
    - `lambda_um` `[..., N]`: wavelengths [um], N from 1 to 8. Without, results are linear sRGB, N = 3.
    - `sigma_per_um`: absorptions [1/um] `[..., N]` instead of those of the yarns' colors, or a pair of these (or `None`) for warp and weft.
    - `turn_rad` `[...]`: angle by which the pattern is turned about the normal at the point [rad].
    - `footprint_um` `[...]`: diameter of the part of the cloth that the point stands for [um]; beyond a repeat, a fabric made with `far` returns the mean over it.

    f is an energy density [1/sr], the BSDF times the cosine of `wi`. Results are float32. Whatever numbers come in, calls give numbers.
    """

    def __init__(
        self,
        spec: Spec,
        *,
        gaps: str = "diffracted",
        sigma_per_um: Optional[float] = None,
        noise: bool = False,
        layers: bool = True,
        shadowing: bool = True,
        edges: bool = True,
        slits: Optional[Slit] = None,
        far: bool = False,
        folder: Optional[PathLike] = None,
    ) -> None:
        """Of a fabric spec: its file's path, its text, or a dict of its keys.

        Args:
            spec: The spec. The models it names lie in its file's folder or below; those of a text or dict in `folder`, or anywhere.
            gaps: Light through gaps is "diffracted", or goes "straight" on.
            sigma_per_um: One absorption [1/um] for all yarns instead of their colors; 0 for a white furnace.
            noise: Whether models with speckle noise show it.
            layers: Whether the layer below blocks light that a ply transmits.
            shadowing: Whether yarns block light that their neighbors reflect.
            edges: Whether light that passes beside a ply is diffracted at its edge.
            slits: Slits between the fibers of all yarns instead of the spec's, `Slit(width_um, share)`; none for a share of 0. The mean over the repeat has no slits.
            far: Whether to compute the mean over the repeat, in some seconds, for queries with a footprint; otherwise footprints count as points.
            folder: Folder of the files that a text or dict names; by default the current folder.

        Raises:
            Error: for a spec or a model that is refused.
        """
        if slits is not None and not isinstance(slits, Slit):
            raise Error(f"slits: {type(slits).__name__}: give a Slit")
        options = {
            "gaps": gaps,
            "sigma_per_um": None if sigma_per_um is None else float(sigma_per_um),
            "noise": bool(noise),
            "layers": bool(layers),
            "shadowing": bool(shadowing),
            "edges": bool(edges),
            "slits": None if slits is None else (float(slits.width_um), float(slits.share)),
            "far": bool(far),
        }
        path, text = text_of(spec, "fabric spec")
        if path is not None:
            self._name = path
            self._rust = _plywave.Fabric.load(path, options)
        else:
            self._name = "fabric spec"
            self._rust = _plywave.Fabric.from_text(text, self._name, os.fspath(folder) if folder is not None else "", options)
        self._options = options

    def with_colors(self, warp: Any = None, weft: Any = None, color_of: Optional[str] = None) -> "Fabric":
        """The same fabric with other colors; nothing is traced anew.

        Args:
            warp: Color of the warp: three numbers of sRGB from 0 to 1, an absorption [1/um], or `None` for clear fibers.
            weft: Color of the weft.
            color_of: Light that the colors describe: "even_sky", "reflected" or "folded"; by default that of the spec.
        """
        made = Fabric.__new__(Fabric)
        made._name, made._options = self._name, self._options
        made._rust = self._rust.with_colors(_color(warp, "warp"), _color(weft, "weft"), color_of)
        return made

    @property
    def color_of(self) -> str:
        """Light that the spec's colors describe: "even_sky", "reflected" or "folded"."""
        return self._rust.color_of

    @property
    def notes(self) -> List[str]:
        """Notes of its loader, one line each."""
        return self._rust.notes

    @property
    def repeat_um(self) -> Tuple[float, float]:
        """Size of the pattern's repeat [um], along x and y."""
        return self._rust.repeat_um

    def model_of(self, family: str, yarn: int = 0) -> Model:
        """The ply model of a yarn of the "warp" or "weft"."""
        return Model._of(self._rust.model_of(family, yarn), self._name)

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
        warp, weft = sigma if isinstance(sigma, tuple) and len(sigma) == 2 else (sigma, sigma)
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

    def __repr__(self) -> str:
        x, y = self.repeat_um
        return f"<plywave.Fabric {os.path.basename(self._name)!r}, repeat {x:.0f} x {y:.0f} um>"

    def _repr_html_(self) -> str:
        x, y = self.repeat_um
        facts = {"repeat": f"{x:.1f} x {y:.1f} um", "colors are of": self.color_of}
        facts.update({key: str(value) for key, value in self._options.items()})
        facts.update({f"note {k + 1}": note for k, note in enumerate(self.notes)})
        return html_table(f"fabric: {os.path.basename(self._name)}", facts)


def _color(color: Any, name: str) -> Any:
    if color is None:
        return None
    given = floats(color, name)
    if given.shape not in ((), (1,), (3,)):
        raise Error(f"{name}: shape {given.shape}; give three numbers of sRGB, one absorption [1/um], or None")
    return float(given.reshape(())) if given.size == 1 else [float(c) for c in given]


