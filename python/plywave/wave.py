"""The wave simulator: far fields of parallel fibers, tables and speckle patterns of single fibers (docs/howto/wave.md)."""

from __future__ import annotations

import json
from typing import Any, Dict, List, NamedTuple, Optional

import numpy as np

from . import _plywave
from ._fiber import Fiber
from ._files import PathLike, Speckle, html_table
from ._progress import Progress, Told
from ._spec import Spec, spec_args
from ._work import run_args, whole

__all__ = ["Case", "Scattering", "scatter", "speckle", "tabulate"]


class Case(NamedTuple):
    """What one source scatters."""

    lambda_um: float
    """Vacuum wavelength [um]."""
    theta_i: float
    """Latitude of the incidence [rad]."""
    phi_i: float
    """Azimuth the light comes from [rad]."""
    h_um: Optional[float]
    """Offset of the beam [um]; None for plane waves."""
    pol: str
    """Polarization, "TM" or "TE"."""
    f_co: np.ndarray
    """Amplitude of the incident polarization at azimuths 2 pi j / n, complex `[n]`."""
    f_cross: np.ndarray
    """Amplitude of the other polarization, likewise."""
    c_sca_um: float
    """Scattering width [um]."""
    c_abs_um: float
    """Absorption width [um]."""
    c_ext_um: float
    """Extinction width [um]."""

    @property
    def phi_o(self) -> np.ndarray:
        """Azimuths of the amplitudes [rad] `[n]`."""
        return 2.0 * np.pi * np.arange(len(self.f_co)) / len(self.f_co)


class Scattering:
    """Far fields of a scene: `cases` by wavelength, within it by theta_i, phi_i, h and polarization; `stats` describes the run."""

    def __init__(self, cases: List[Case], stats: Dict[str, Any]) -> None:
        self.cases, self.stats = cases, stats

    def __len__(self) -> int:
        return len(self.cases)

    def __getitem__(self, index: int) -> Case:
        return self.cases[index]

    def __repr__(self) -> str:
        return f"<plywave.wave.Scattering, {len(self.cases)} cases by {self.stats['method']}>"

    def _repr_html_(self) -> str:
        return html_table("far fields", {"cases": str(len(self.cases)), **{key: str(value) for key, value in self.stats.items()}})


def scatter(scene: Spec, *, progress: Progress = None) -> Scattering:
    """Solves a scene of parallel fibers: its far fields and widths, in every case.

    Args:
        scene: Path of a scene, its text, or a dict of its keys (docs/howto/wave.md). Its angles are in degrees, those of the result in radians.
        progress: `True` for a bar, or a function of stage, unit, done and total.

    Raises:
        Error: for a scene that is refused, and solves that do not converge.
    """
    with Told(progress) as call:
        report = json.loads(_plywave.wave_scatter(spec_args(scene, "scene"), run_args(None, True, call)))
    return Scattering([_case(case) for case in report["cases"]], report["stats"])


def _amplitudes(pairs: Any) -> np.ndarray:
    return np.ascontiguousarray(pairs, np.float64).reshape(-1, 2).view(np.complex128)[:, 0]


def _case(case: Dict[str, Any]) -> Case:
    return Case(
        case["lambda_um"],
        float(np.radians(case["theta_i_deg"])),
        float(np.radians(case["phi_i_deg"])),
        case.get("h_um"),
        case["pol"],
        _amplitudes(case["F_co"]),
        _amplitudes(case["F_cross"]),
        case["C_sca_um"],
        case["C_abs_um"],
        case["C_ext_um"],
    )


def tabulate(
    spec: Spec,
    quality: str = "standard",
    *,
    sigma_per_um: float = 0.0,
    rays: bool = False,
    lambdas: Optional[int] = None,
    thetas: Optional[int] = None,
    azimuths: Optional[int] = None,
    ray_count: Optional[int] = None,
    seed: int = 1,
    beta_m_rad: float = 0.1,
    folder: Optional[PathLike] = None,
    resume: bool = True,
    progress: Progress = None,
) -> Fiber:
    """Tabulates the scattering of a yarn spec's mean fiber, or of the one fiber of a scene (Xia 2020).

    Args:
        spec: Path of a yarn spec or scene, its text, or a dict of its keys.
        quality: "preview", "standard" or "reference".
        sigma_per_um: Absorption of a spec's fiber [1/um].
        rays: Trace rays instead of solving waves.
        lambdas: Bands of wavelength, instead of the quality's.
        thetas: Latitudes, likewise.
        azimuths: Largest number of azimuths around the fiber, likewise.
        ray_count: Rays of a slice, likewise.
        seed: Seed of the rays.
        beta_m_rad: Longitudinal width [rad].
        folder: Folder for finished shards.
        resume: Whether to use the shards in `folder`; otherwise they are deleted.
        progress: `True` for a bar, or a function of stage, unit, done and total.
    """
    args = tabulate_args(
        quality,
        sigma_per_um=sigma_per_um,
        rays=rays,
        lambdas=lambdas,
        thetas=thetas,
        azimuths=azimuths,
        ray_count=ray_count,
        seed=seed,
        beta_m_rad=beta_m_rad,
    )
    with Told(progress) as call:
        return Fiber.from_bytes(_plywave.wave_tabulate(spec_args(spec, "spec"), args, run_args(folder, resume, call)), "fiber")


def _count(value: Any, name: str) -> Optional[int]:
    return None if value is None else whole(value, name)


def tabulate_args(
    quality: str = "standard",
    *,
    sigma_per_um: float = 0.0,
    rays: bool = False,
    lambdas: Optional[int] = None,
    thetas: Optional[int] = None,
    azimuths: Optional[int] = None,
    ray_count: Optional[int] = None,
    seed: int = 1,
    beta_m_rad: float = 0.1,
) -> Dict[str, Any]:
    """What to tabulate, for the extension module."""
    return {
        "quality": str(quality),
        "sigma_per_um": float(sigma_per_um),
        "rays": bool(rays),
        "lambdas": _count(lambdas, "lambdas"),
        "thetas": _count(thetas, "thetas"),
        "azimuths": _count(azimuths, "azimuths"),
        "ray_count": _count(ray_count, "ray_count"),
        "seed": whole(seed, "seed"),
        "beta_m_rad": float(beta_m_rad),
    }


def speckle(
    spec: Spec,
    *,
    instances: int = 200,
    seed: int = 1,
    folder: Optional[PathLike] = None,
    resume: bool = True,
    progress: Progress = None,
) -> Speckle:
    """Solves speckle patterns of `instances` instances of a yarn spec's fiber."""
    count = min(whole(instances, "instances"), 1 << 31)
    with Told(progress) as call:
        data = _plywave.wave_speckle(spec_args(spec, "yarn spec"), count, whole(seed, "seed"), run_args(folder, resume, call))
    return Speckle._trusted(data, "speckle patterns")
