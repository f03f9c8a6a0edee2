"""Cloths of curves on arrays: woven, knitted, or read from a file."""

from __future__ import annotations

import os
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from . import _plywave
from ._arrays import Queries, call, channels, count_of, floats
from ._files import Document, PathLike
from ._model import Model
from ._plywave import Error
from ._progress import Progress, Told
from ._results import Exported, Outcomes, Samples, Slit
from ._spec import Spec, text_of
from ._threads import get_threads
from ._work import run_args


def _options(
    gaps: str, sigma_per_um: Optional[float], noise: bool, layers: bool, shadowing: bool, edges: bool, slits: Optional[Slit], uneven: bool, relief: bool, far: bool
) -> Dict[str, Any]:
    if slits is not None and not isinstance(slits, Slit):
        raise Error(f"slits: {type(slits).__name__}: give a Slit")
    return {
        "gaps": gaps,
        "sigma_per_um": None if sigma_per_um is None else float(sigma_per_um),
        "noise": bool(noise),
        "layers": bool(layers),
        "shadowing": bool(shadowing),
        "edges": bool(edges),
        "slits": None if slits is None else (float(slits.width_um), float(slits.share)),
        "uneven": bool(uneven),
        "relief": bool(relief),
        "far": bool(far),
    }


_USUAL = _options("diffracted", None, False, True, True, True, None, True, True, True)


def _spec_args(spec: Spec, folder: Optional[PathLike]) -> Dict[str, Any]:
    path, text = text_of(spec, "cloth spec")
    return {"path": path, "text": text, "name": "cloth spec", "folder": "" if folder is None else os.fspath(folder)}


class Cloth(Document):
    """A cloth as a surface, ready for shading: of a cloth file (.pwc), or of a cloth spec.

    Queries are arrays that broadcast against each other as NumPy's do:

    - `position_um` `[..., 2]`: point of the cloth [um], x along the weft, y along the warp; of a knit x along the courses, y along the wales.
    - `wo` `[..., 3]`: direction towards the viewer, unit; z is the normal of the cloth's face.
    - `wi` `[..., 3]`: direction towards the light, unit.
    - `lambda_um` `[..., N]`: wavelengths [um], N from 1 to 8. Without, results are linear sRGB, N = 3.
    - `sigma_per_um`: absorptions [1/um] `[..., N]` instead of those of the yarns' colors, or a pair of these (or `None`) for warp and weft.
    - `turn_rad` `[...]`: angle by which the pattern is turned about the normal at the point [rad].
    - `footprint_um` `[...]`: diameter of the part of the cloth that the point stands for [um]; beyond a cell, one with the mean over the cell returns that mean.

    f is an energy density [1/sr], the BSDF times the cosine of `wi`. Results are float32. Whatever numbers come in, calls give numbers.

    Light that hits no ply is diffracted by the gap. With `gaps = "straight"` it goes straight on, as a delta: `straight` is its energy.
    """

    _kind, _words = "cloth", "cloth"
    _rust: "_plywave.Cloth"

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
        uneven: bool = True,
        relief: bool = True,
        far: bool = True,
        folder: Optional[PathLike] = None,
        progress: Progress = None,
    ) -> None:
        """Reads a cloth file, in about 10 ms, or finds the cloth of a spec.

        The cloth of a spec is looked up by the contents of spec and models in a cache folder, which the command line shares: that of the variable
        PLYWAVE_CACHE, or `plywave` in the user's cache folder. If it is not there, it is made, which takes 6 to 60 s, and kept there; `notes` says so.

        Args:
            spec: Path of a cloth file (.pwc) or a cloth spec (.toml), the text of a spec, or a dict of its keys (docs/reference/cloth_spec.md). The files
                that a spec names lie in its file's folder; those of a text or dict in `folder`.
            gaps: Light through gaps is "diffracted", or goes "straight" on.
            sigma_per_um: One absorption [1/um] for all yarns instead of their colors; 0 for a white furnace.
            noise: Whether models with speckle noise show it.
            layers: Whether plies block light that others send down.
            shadowing: Whether plies block light that others send up.
            edges: Whether light that passes beside a ply is diffracted at its edge.
            slits: Slits between the fibers of all yarns instead of the spec's, `Slit(width_um, share)`; none for a share of 0. The mean over the cell has no slits.
            uneven: Whether yarns are as uneven as the spec has them; otherwise every repeat is as the next.
            relief: Whether plies show the fibers on their surface; otherwise they are smooth tubes.
            far: Whether queries with a footprint get the mean over the cell, if it is in the file; otherwise they blur relief alone.
            folder: Folder of the files that a text or dict names; by default the current folder.
            progress: `True` for a bar while a cloth is made, or a function of step, unit, done and total.

        Raises:
            Error: for a file or a spec that is refused.
            KeyboardInterrupt: when stopped.
        """
        self._options = _options(gaps, sigma_per_um, noise, layers, shadowing, edges, slits, uneven, relief, far)
        path, _ = text_of(spec, "cloth spec")
        if path is not None and not path.endswith(".toml"):
            self._name = path
            self._rust = _plywave.Cloth.load(path, self._options)
            return
        args = _spec_args(spec, folder)
        self._name = path or "cloth spec"
        with Told(progress) as call:
            self._rust = _plywave.Cloth.of_spec(args, self._options, run_args(None, True, call))

    @classmethod
    def from_bytes(
        cls,
        data: bytes,
        name: str = "bytes",
        *,
        gaps: str = "diffracted",
        sigma_per_um: Optional[float] = None,
        noise: bool = False,
        layers: bool = True,
        shadowing: bool = True,
        edges: bool = True,
        slits: Optional[Slit] = None,
        uneven: bool = True,
        relief: bool = True,
        far: bool = True,
    ) -> "Cloth":
        """From the bytes of a cloth file; `name` stands for it in messages. The options are those of `Cloth`."""
        options = _options(gaps, sigma_per_um, noise, layers, shadowing, edges, slits, uneven, relief, far)
        return cls._of(_plywave.Cloth.from_bytes(bytes(data), name, options), name, options)

    @classmethod
    def _of(cls, rust: "_plywave.Cloth", name: str, options: Dict[str, Any]) -> "Cloth":
        made = cls.__new__(cls)
        made._rust, made._name, made._options = rust, name, options
        return made

    def to_bytes(self) -> bytes:
        """The bytes of its file, which has the colors of its spec."""
        known = self.__dict__.get("_bytes")
        if known is None:
            known = self.__dict__["_bytes"] = self._rust.to_bytes()
        return bytes(known)

    def with_colors(self, warp: Any = None, weft: Any = None, color_of: Optional[str] = None) -> "Cloth":
        """The same cloth with other colors; nothing is traced anew, and the bytes of its file keep the colors of its spec.

        Args:
            warp: Color of the warp, or of the only kind of yarn: three numbers of sRGB from 0 to 1, an absorption [1/um], or `None` for clear fibers.
            weft: Color of the weft.
            color_of: Light that the colors describe: "even_sky", "reflected" or "folded"; by default that of this one. Another one takes tenths of a second.
        """
        if weft is not None and len(self.yarns) == 1:
            raise Error(f"weft: {self._name} has one kind of yarn; give its color first")
        made = Cloth._of(self._rust.with_colors(_color(warp, "warp"), _color(weft, "weft"), color_of), self._name, self._options)
        made.__dict__["_colors"] = (warp, weft, made.color_of)
        return made

    @property
    def yarns(self) -> Tuple[str, ...]:
        """Kinds of its yarns: "warp" and "weft" of a woven cloth, else "yarn"."""
        return ("warp", "weft") if self._rust.kinds == 2 else ("yarn",)

    def _index(self, yarn: str) -> int:
        if yarn not in self.yarns:
            raise Error(f"yarn = {yarn!r}: use " + " or ".join(f'"{kind}"' for kind in self.yarns))
        return self.yarns.index(yarn)

    @property
    def cell_um(self) -> "Tuple[Tuple[float, float], Tuple[float, float]]":
        """Two vectors of the plane after which it repeats [um]."""
        return self._rust.cell_um

    @property
    def half_thickness_um(self) -> float:
        """Greatest distance of any fiber from its middle plane [um]."""
        return self._rust.half_thickness_um

    @property
    def has_far(self) -> bool:
        """Whether queries with a footprint get the mean over the cell."""
        return self._rust.has_far

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

    def model_of(self, yarn: Optional[str] = None) -> Model:
        """The ply model of a kind of yarn, one of `yarns`; by default of the first."""
        kind = self._index(self.yarns[0] if yarn is None else yarn)
        return Model._of(self._rust.model_of(kind), self._name)

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

    def export(
        self,
        path: Union[PathLike, Sequence[PathLike]],
        to: str,
        *,
        force: bool = False,
        sigma_uv_per_um: Optional[float] = None,
        sigma_ir_per_um: Optional[float] = None,
        samples: int = 16384,
        seed: int = 1,
        views: Optional[List[Tuple[float, float, bool]]] = None,
        squares: int = 16,
        spectral: bool = False,
        pixels: int = 256,
        mm_per_uv: float = 100.0,
        progress: Progress = None,
    ) -> Exported:
        """Writes it for other programs (docs/howto/export.md); of its options, `sigma_per_um` counts.

        Args:
            path: The file to write, or several files of a report; textures go into a folder beside it. Either all files are written or none.
            to: "report" (.md, .html, .json, .csv), "klems" or "tensortree" (.xml), "rgl" (.bsdf), "openpbr" (.mtlx), "gltf" (.glb), "usd" (.usda), "blender" (.py), "mitsuba" (.xml).
            force: Replace files that are not of an earlier export to the same format, which is an error without it.
            sigma_uv_per_um: Absorption of all yarns below 0.38 um [1/um], for solar numbers and the UPF; by default that at 0.38 um, and no UPF.
            sigma_ir_per_um: Absorption of all yarns above 0.78 um [1/um], for solar numbers; by default that at 0.78 um.
            samples: Samples of each direction of a report.
            seed: Seed of these.
            views: Directions of a report: tilt from the normal [rad], azimuth [rad], whether to the face; by default 32 of them.
            squares: Squares along an edge of the hemisphere of a tensor tree: 8, 16 or 32.
            spectral: Spectra instead of linear sRGB in an RGL file, for spectral renderers.
            pixels: Pixels of textures along the longer side of the repeat.
            mm_per_uv: Length of cloth per unit of a surface's texture coordinates in MaterialX [mm].
            progress: `True` for a bar, or a function of step, unit, done and total.

        Raises:
            Error: for options out of range, another ending, a file of another origin, or a cloth with colors other than those of its file.
            KeyboardInterrupt: when stopped.
        """
        if self.__dict__.get("_colors") is not None:
            raise Error(f"{self._name}: exported with the colors of its spec, not those of with_colors; change the spec, or give sigma_per_um")
        args = {
            "sigma_per_um": self._options["sigma_per_um"],
            "sigma_uv_per_um": None if sigma_uv_per_um is None else float(sigma_uv_per_um),
            "sigma_ir_per_um": None if sigma_ir_per_um is None else float(sigma_ir_per_um),
            "samples": int(samples),
            "seed": int(seed),
            "views": [(float(tilt), float(azimuth), bool(face)) for tilt, azimuth, face in views or []],
            "squares": int(squares),
            "spectral": bool(spectral),
            "pixels": int(pixels),
            "mm_per_uv": float(mm_per_uv),
            "force": bool(force),
        }
        paths = [path] if isinstance(path, (str, os.PathLike)) else list(path)
        with Told(progress) as call:
            files, notes, facts = self._rust.export(self._name, [os.fspath(one) for one in paths], str(to), args, run_args(None, True, call))
        return Exported([os.fspath(file) for file in files], list(notes), dict(facts))

    def __reduce__(self) -> Any:
        return _restored, (self.to_bytes(), self._name, self._options, self.__dict__.get("_colors"))

    def __repr__(self) -> str:
        (ax, ay), (bx, by) = self.cell_um
        return f"<plywave.Cloth {self.name!r}, cell ({ax:.0f}, {ay:.0f}) x ({bx:.0f}, {by:.0f}) um>"

    def _facts(self) -> Dict[str, str]:
        (ax, ay), (bx, by) = self.cell_um
        facts = {
            "cell": f"({ax:.1f}, {ay:.1f}) x ({bx:.1f}, {by:.1f}) um",
            "thickness": f"{2.0 * self.half_thickness_um:.0f} um",
            "yarns": " and ".join(self.yarns),
            "colors are of": self.color_of,
        }
        facts.update({key: str(value) for key, value in self._options.items()})
        facts.update({f"note {k + 1}": note for k, note in enumerate(self.notes)})
        return facts


def _color(color: Any, name: str) -> Any:
    if color is None:
        return None
    given = floats(color, name)
    if given.shape not in ((), (1,), (3,)):
        raise Error(f"{name}: shape {given.shape}; give three numbers of sRGB, one absorption [1/um], or None")
    return float(given.reshape(())) if given.size == 1 else [float(c) for c in given]


def _restored(data: bytes, name: str, options: Dict[str, Any], colors: Any) -> Cloth:
    made = Cloth._of(_plywave.Cloth.from_bytes(data, name, options), name, options)
    return made if colors is None else made.with_colors(*colors)


def weave(spec: Spec, *, folder: Optional[PathLike] = None, progress: Progress = None) -> Cloth:
    """Makes the cloth of a cloth spec: relaxes its yarns, then finds shadows, light between plies and the mean over the cell. It takes 6 to 60 s; nothing is
    looked up in the cache or kept there. `Cloth.save` writes its file, the one of `plywave weave`.

    Args:
        spec: Path of a cloth spec (.toml), its text, or a dict of its keys.
        folder: Folder of the files that a text or dict names; by default the current folder.
        progress: `True` for a bar, or a function of step, unit, done and total.

    Raises:
        Error: for a spec that is refused.
        KeyboardInterrupt: when stopped.
    """
    args = _spec_args(spec, folder)
    with Told(progress) as call:
        rust = _plywave.Cloth.weave(args, _USUAL, run_args(None, True, call))
    return Cloth._of(rust, args["path"] or "cloth spec", dict(_USUAL))
