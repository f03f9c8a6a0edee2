"""Cloths of curves on arrays: woven, knitted, or read from a file."""

from __future__ import annotations

import os
from typing import Any, Dict, Optional, Tuple

from . import _plywave
from ._files import Document, PathLike
from ._model import Model
from ._plywave import Error
from ._progress import Progress, Told
from ._results import Slit
from ._spec import Spec, text_of
from ._surface import Surface
from ._work import run_args


def _options(
    gaps: str, sigma_per_um: Optional[float], noise: bool, layers: bool, shadowing: bool, edges: bool, slits: Optional[Slit], far: bool
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
        "far": bool(far),
    }


_USUAL = _options("diffracted", None, False, True, True, True, None, True)


def _spec_args(spec: Spec, folder: Optional[PathLike]) -> Dict[str, Any]:
    path, text = text_of(spec, "cloth spec")
    return {"path": path, "text": text, "name": "cloth spec", "folder": "" if folder is None else os.fspath(folder)}


class Cloth(Surface, Document):
    """A cloth as a surface, ready for shading: of a cloth file (.pwc), or of a cloth spec. Queries are those of `Surface`.

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
            far: Whether queries with a footprint get the mean over the cell, if it is in the file; otherwise footprints count as points.
            folder: Folder of the files that a text or dict names; by default the current folder.
            progress: `True` for a bar while a cloth is made, or a function of step, unit, done and total.

        Raises:
            Error: for a file or a spec that is refused.
            KeyboardInterrupt: when stopped.
        """
        self._options = _options(gaps, sigma_per_um, noise, layers, shadowing, edges, slits, far)
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
        far: bool = True,
    ) -> "Cloth":
        """From the bytes of a cloth file; `name` stands for it in messages. The options are those of `Cloth`."""
        options = _options(gaps, sigma_per_um, noise, layers, shadowing, edges, slits, far)
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
        """As `Surface.with_colors`; the bytes of its file keep the colors of its spec."""
        made = super().with_colors(warp, weft, color_of)
        made.__dict__["_colors"] = (warp, weft, made.color_of)
        return made

    @property
    def yarns(self) -> Tuple[str, ...]:
        """Kinds of its yarns: "warp" and "weft" of a woven cloth, else "yarn"."""
        return ("warp", "weft") if self._rust.kinds == 2 else ("yarn",)

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

    def model_of(self, yarn: Optional[str] = None) -> Model:
        """The ply model of a kind of yarn, one of `yarns`; by default of the first."""
        kind = self._index(self.yarns[0] if yarn is None else yarn)
        return Model._of(self._rust.model_of(kind), self._name)

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


def _restored(data: bytes, name: str, options: Dict[str, Any], colors: Any) -> Cloth:
    made = Cloth.from_bytes(data, name, **options)
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
