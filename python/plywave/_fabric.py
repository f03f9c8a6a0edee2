"""Woven fabrics on arrays."""

from __future__ import annotations

import os
from typing import Optional, Tuple

from . import _plywave
from ._files import PathLike, html_table
from ._model import Model
from ._plywave import Error
from ._results import Slit
from ._spec import Spec, text_of
from ._surface import Surface


class Fabric(Surface):
    """A woven fabric of a fabric spec, as a surface ready for shading. Queries are those of `Surface`."""

    _rust: "_plywave.Fabric"

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

    @property
    def repeat_um(self) -> Tuple[float, float]:
        """Size of the pattern's repeat [um], along x and y."""
        return self._rust.repeat_um

    def model_of(self, family: str, yarn: int = 0) -> Model:
        """The ply model of a yarn of the "warp" or "weft"."""
        return Model._of(self._rust.model_of(family, yarn), self._name)

    def __repr__(self) -> str:
        x, y = self.repeat_um
        return f"<plywave.Fabric {os.path.basename(self._name)!r}, repeat {x:.0f} x {y:.0f} um>"

    def _repr_html_(self) -> str:
        x, y = self.repeat_um
        facts = {"repeat": f"{x:.1f} x {y:.1f} um", "colors are of": self.color_of}
        facts.update({key: str(value) for key, value in self._options.items()})
        facts.update({f"note {k + 1}": note for k, note in enumerate(self.notes)})
        return html_table(f"fabric: {os.path.basename(self._name)}", facts)
