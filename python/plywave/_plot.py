"""Figures: what `plywave plot` draws, by matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, List, Optional, Sequence, Tuple, Union

import numpy as np

from ._arrays import floats
from ._files import Document, Speckle, Table
from ._fiber import Fiber
from ._model import Model
from ._plywave import Error
from ._results import Place

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PARTS = ("all", "maps", "energy", "errors", "noise")


def _figure(width: float, height: float) -> Any:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise Error("plot: matplotlib is missing; install it with: pip install plywave[plot]") from None
    # Of no window: notebooks show it, `savefig` writes it.
    return Figure(figsize=(width, height), layout="constrained")


def plot(
    source: Union[Model, Table, Fiber, Speckle],
    *,
    table: Optional[Table] = None,
    part: str = "all",
    theta_i: Optional[float] = None,
    h_rel: Optional[float] = None,
    sigma_per_um: Any = None,
    decades: float = 3.0,
) -> "Figure":
    """Draws a model, a table, both side by side, a fiber or speckle patterns.

    Args:
        source: What to draw.
        table: With a model: the table to set beside it, with the residual.
        part: Of models and tables: "all", "maps" of f over the outgoing sphere, the "energy" budget, "errors" of the fit (of a table its noise), or "noise" (of a
            model with speckle: a place beside the smooth f).
        theta_i: One incidence: latitude [rad], to the nearest node of a table; by default an overview.
        h_rel: One incidence: offset of the beam's center over the last node of h.
        sigma_per_um: Absorptions [1/um]; the nearest of a table. By default 0 in maps, and one that takes a third of the light in the budget.
        decades: Decades of the color scale.

    Returns:
        A matplotlib figure, of no window: a notebook shows it, `figure.savefig("model.png")` writes it.

    Raises:
        Error: without matplotlib, and for what has no figure.
    """
    if part not in PARTS:
        raise Error(f"part = {part!r}: use one of {', '.join(PARTS)}")
    if table is not None and not (isinstance(source, Model) and isinstance(table, Table)):
        raise Error("table: goes with a model; give a plywave.Model and a plywave.Table")
    if isinstance(source, Fiber):
        return _fiber(source)
    if isinstance(source, Speckle):
        return _speckle(source)
    if isinstance(source, Model) and part == "noise":
        return _noise(source, theta_i or 0.0, decades)
    if not isinstance(source, (Model, Table)) or part == "noise":
        raise Error(f"{type(source).__name__}: has no figure; give a model, a table, a fiber or speckle patterns")
    return _ply(_Ply(source, table), part, theta_i, h_rel, sigma_per_um, decades)


def _nearest(axis: np.ndarray, value: float) -> int:
    return int(np.argmin(np.abs(axis - value)))


class _Ply:
    """A model, a table, or both."""

    def __init__(self, source: Union[Model, Table], table: Optional[Table]) -> None:
        self.model = source if isinstance(source, Model) else None
        self.table = source if isinstance(source, Table) else table
        self.source: Document = source
        arrays = source.tensors()
        self.theta_i, self.h_um, self.sigma = arrays["theta_i"], arrays["h_um"], arrays["sigma_per_um"]
        if self.table is not None:
            self.arrays = self.table.tensors()
            for key, axis in (("theta_i", self.theta_i), ("h_um", self.h_um), ("sigma_per_um", self.sigma)):
                if axis.shape != self.arrays[key].shape or not np.allclose(axis, self.arrays[key], rtol=1e-6, atol=1e-6):
                    raise Error(f"table: {key} = {len(self.arrays[key])} nodes, {len(axis)} in the model, or other values; give a table and a model of one yarn and preset")

    def grid(self) -> Tuple[np.ndarray, np.ndarray]:
        """Edges of the outgoing bins [rad]."""
        rows, columns = self.arrays["refl"].shape[-2:] if self.table is not None else (90, 180)
        return np.linspace(-np.pi / 2, np.pi / 2, rows + 1), np.linspace(0.0, 2 * np.pi, columns + 1)

    def place(self, theta_i: float, h_um: float) -> Tuple[float, float]:
        if self.table is None:
            return theta_i, h_um
        return float(self.theta_i[_nearest(self.theta_i, theta_i)]), float(self.h_um[_nearest(self.h_um, h_um)])

    def maps(self, theta_i: float, h_um: float, sigma: Optional[float]) -> List[Tuple[str, np.ndarray]]:
        """Named maps `[theta_o][phi_o]`: table, fit and residual, or the one there is; of f_refl without `sigma`."""
        made = []
        if self.table is not None:
            m, n = _nearest(self.theta_i, theta_i), _nearest(self.h_um, h_um)
            key = self.arrays["refl"][m, n] if sigma is None else self.arrays["high"][m, n, _nearest(self.sigma, sigma)]
            made.append(("table", key.astype(np.float64)))
        if self.model is not None:
            thetas, phis = (0.5 * (e[1:] + e[:-1]) for e in self.grid())
            w = _directions(thetas[:, None], phis[None, :])
            terms = self.model.terms(theta_i, h_um, w, sigma or 0.0, edge=False)
            made.append(("fit", (terms.refl if sigma is None else terms.high)[..., 0].astype(np.float64)))
        if len(made) == 2:
            made.append(("fit - table", made[1][1] - made[0][1]))
        return made

    def lobes(self, theta_i: float, h_um: float, sigma: Optional[float]) -> np.ndarray:
        if self.model is None:
            return np.zeros((0, 6))
        return np.array(self.model._rust.lobes(theta_i, h_um, sigma)).reshape(-1, 6)

    def energies(self, sigma: float) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """r_d, f_refl, f_high and what is absorbed at the nodes `[M][H]`."""
        if self.table is not None:
            high = self.arrays["energy_high"]
            at = high[..., _nearest(self.sigma, sigma)]
            return self.arrays["r_d"], self.arrays["energy_refl"], at, high[..., 0] - at
        assert self.model is not None
        shape = (len(self.theta_i), len(self.h_um))
        r_d, refl, high = (np.asarray(a) for a in self.model._rust.node_energies([0.0, sigma]))
        high = high.reshape(2, *shape)
        return r_d.reshape(shape), refl.reshape(shape), high[1], high[0] - high[1]

    def telling_sigma(self) -> float:
        """An absorption that takes about a third of the light at normal incidence in the middle."""
        n = len(self.h_um) // 2
        lost = []
        for sigma in self.sigma:
            _, _, high, absorbed = self.energies(float(sigma))
            lost.append(abs(high[0, n] / max(high[0, n] + absorbed[0, n], 1e-12) - 2 / 3))
        return float(self.sigma[int(np.argmin(lost))])

    def errors(self) -> Tuple[str, np.ndarray, np.ndarray]:
        """What is shown, of f_refl and of f_high at sigma = 0 `[M][H]`."""
        shape = (len(self.theta_i), len(self.h_um))
        what = "fit error, relative L2 without noise [%]"
        if self.model is not None and self.table is not None:
            refl, high = self.model._rust.fit_errors(self.table.to_bytes(), self.table._name)
            return what, np.reshape(refl, shape), np.reshape(high, (*shape, -1))[..., 0]
        if self.model is not None:
            arrays = self.model.tensors()
            return what, arrays["error_refl"], arrays["error_high"][..., 0]
        theta, phi = self.grid()
        solid_angle = np.diff(np.sin(theta))[:, None] * np.diff(phi)[None, :]

        def noise(of: np.ndarray, slices: np.ndarray) -> np.ndarray:
            norm = (slices.astype(np.float64) ** 2 * solid_angle).sum((-2, -1))
            return np.asarray(np.sqrt(of / np.maximum(norm, 1e-300)))

        high = noise(self.arrays["noise_high"][..., 0], self.arrays["high"][:, :, 0])
        return "noise, relative L2 [%]", noise(self.arrays["noise_refl"], self.arrays["refl"]), high


def _directions(theta: Any, phi: Any) -> np.ndarray:
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)], -1).astype(np.float32)


def _ply(ply: _Ply, part: str, theta_i: Optional[float], h_rel: Optional[float], sigma: Any, decades: float) -> "Figure":
    sigmas = [float(s) for s in np.atleast_1d(floats(sigma, "sigma_per_um"))] if sigma is not None else [0.0]
    shown: List[Optional[float]] = [None, *sigmas]
    last = float(ply.theta_i[-1])
    if theta_i is not None or h_rel is not None:
        places = [ply.place(theta_i or 0.0, (h_rel or 0.0) * float(ply.h_um[-1]))]
    else:
        radius = _radius(ply)
        wanted = [(t, h * radius) for t in np.radians([0.0, 30.0, 60.0]) if t <= last + 0.02 for h in (0.0, 0.5, 0.9)]
        places = list(dict.fromkeys(ply.place(float(t), float(h)) for t, h in wanted))
    parts = ["maps", "energy", "errors"] if part == "all" else [part]
    rows_of_maps = len(places) if "maps" in parts else 0
    heights = [1.9 * rows_of_maps] if rows_of_maps else []
    heights += [2.8 for p in parts if p != "maps"]
    figure = _figure(3.2 * len(shown) * (3 if ply.model is not None and ply.table is not None else 1) if rows_of_maps else 9.0, sum(heights) + 0.5)
    figure.set_size_inches(max(figure.get_size_inches()[0], 9.0), sum(heights) + 0.5)
    figure.suptitle(f"{ply.source._words}: {ply.source.name}")
    panes = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    at = 0
    if rows_of_maps:
        _maps(panes[0], ply, places, shown, decades)
        at = 1
    for name in parts:
        if name == "energy":
            _budget(panes[at], ply, next((s for s in sigmas if s > 0.0), None))
            at += 1
        elif name == "errors":
            _errors(panes[at], ply)
            at += 1
    return figure  # type: ignore[no-any-return]


def _radius(ply: _Ply) -> float:
    """R of the ply, from its edge lobes, or about that."""
    radius = ply.source.tensors().get("edge_radius_um")
    return float(radius[0]) if radius is not None else 0.6 * float(ply.h_um[-1])


def _maps(pane: Any, ply: _Ply, places: Sequence[Tuple[float, float]], shown: Sequence[Optional[float]], decades: float) -> None:
    from matplotlib.colors import LogNorm

    theta, phi = (np.degrees(e) for e in ply.grid())
    rows = [[cell for sigma in shown for cell in ((sigma, *m) for m in ply.maps(t, h, sigma))] for t, h in places]
    axes = pane.subplots(len(rows), len(rows[0]), squeeze=False, sharex=True, sharey=True)
    for column in range(len(rows[0])):
        sigma, name, _ = rows[0][column]
        residual = name.startswith("fit -")
        top = max(float(np.abs(row[column][2]).max()) for row in rows) or 1.0
        for r, row in enumerate(rows):
            axis, values = axes[r, column], row[column][2]
            if residual:
                image = axis.pcolormesh(phi, theta, values, cmap="RdBu_r", vmin=-top, vmax=top, rasterized=True)
            else:
                image = axis.pcolormesh(phi, theta, np.maximum(values, top * 10.0**-decades), cmap="viridis", norm=LogNorm(top * 10.0**-decades, top), rasterized=True)
            if name == "fit":
                lobes = ply.lobes(*places[r], sigma)
                axis.plot(np.degrees(lobes[:, 1]) % 360.0, np.degrees(np.arcsin(np.sin(lobes[:, 0]))), "w+", markersize=5)
            if r == 0:
                what = "f_refl" if sigma is None else f"f_high, sigma = {sigma:g} /um"
                axis.set_title(f"{what}: {name} [1/sr]", fontsize=8)
            if column == 0:
                t, h = places[r]
                axis.set_ylabel(f"theta_i {np.degrees(t):.0f} deg\nh = {h:.1f} um", fontsize=7)
            axis.set_xticks([0, 90, 180, 270, 360])
            axis.set_yticks([-90, 0, 90])
            axis.tick_params(labelsize=6)
        pane.colorbar(image, ax=list(axes[:, column]), location="bottom", shrink=0.8, aspect=40)


def _budget(pane: Any, ply: _Ply, sigma: Optional[float]) -> None:
    sigma = ply.telling_sigma() if sigma is None else sigma
    r_d, refl, high, absorbed = ply.energies(sigma)
    count = min(5, len(ply.theta_i))
    axes = pane.subplots(1, count, squeeze=False, sharey=True)[0]
    for axis, m in zip(axes, np.unique(np.linspace(0, len(ply.theta_i) - 1, count).round().astype(int))):
        stack = [refl[m], high[m], np.maximum(absorbed[m], 0.0), r_d[m]]
        axis.stackplot(ply.h_um, stack, labels=["f_refl", "f_high", "absorbed", "missed"], colors=["#c44e52", "#4c72b0", "#777777", "#dddddd"])
        axis.set_title(f"theta_i = {np.degrees(ply.theta_i[m]):.0f} deg", fontsize=8)
        axis.set_xlabel("h [um]", fontsize=7)
        axis.set_ylim(0.0, 1.0)
        axis.tick_params(labelsize=6)
    axes[0].set_ylabel(f"energy at sigma = {sigma:g} /um", fontsize=7)
    axes[0].legend(fontsize=6, loc="lower center")


def _errors(pane: Any, ply: _Ply) -> None:
    what, refl, high = ply.errors()
    axes = pane.subplots(1, 2)
    for axis, values, name in zip(axes, (refl, high), ("f_refl", "f_high, sigma = 0")):
        image = axis.pcolormesh(ply.h_um, np.degrees(ply.theta_i), 100.0 * values, cmap="magma_r", shading="nearest")
        axis.set_title(f"{name}: {what}", fontsize=8)
        axis.set_xlabel("h [um]", fontsize=7)
        axis.set_ylabel("theta_i [deg]", fontsize=7)
        axis.tick_params(labelsize=6)
        pane.colorbar(image, ax=axis)


def _noise(model: Model, theta_i: float, decades: float) -> "Figure":
    if not model.has_noise:
        raise Error(f"{model.name}: noise_spectrum = absent: the model has no speckle noise; add it with `plywave noise`")
    from matplotlib.colors import LogNorm

    theta, phi = np.linspace(-np.pi / 2, np.pi / 2, 361), np.linspace(0.0, 2 * np.pi, 721)
    w = _directions(0.5 * (theta[1:] + theta[:-1])[:, None], 0.5 * (phi[1:] + phi[:-1])[None, :])
    figure = _figure(10.0, 3.6)
    figure.suptitle(f"{model._words}: {model.name}, speckle at 0.55 um")
    maps = [model.eval(theta_i, 0.0, w, 0.0, edge=False, place=place, relief=False)[..., 0] for place in (None, Place(0))]
    top = float(maps[0].max()) or 1.0
    axes = figure.subplots(1, 2, sharey=True)
    for axis, values, name in zip(axes, maps, ("smooth", "one place")):
        image = axis.pcolormesh(np.degrees(phi), np.degrees(theta), np.maximum(values, top * 10.0**-decades), norm=LogNorm(top * 10.0**-decades, top), rasterized=True)
        axis.set_title(f"f [1/sr], {name}", fontsize=8)
        axis.set_xlabel("phi_o [deg]", fontsize=7)
    axes[0].set_ylabel("theta_o [deg]", fontsize=7)
    figure.colorbar(image, ax=list(axes))
    return figure  # type: ignore[no-any-return]


def _color(lambda_um: float) -> Any:
    from matplotlib import colormaps

    return colormaps["turbo"](float(np.clip((lambda_um - 0.38) / 0.4, 0.0, 1.0)))


def _fiber(fiber: Fiber) -> "Figure":
    arrays = fiber.tensors()
    lambdas, thetas, phis = arrays["lambda_um"], arrays["theta_i"], arrays["phi_i"]
    values = arrays["azimuthal"]
    shown = np.unique(np.linspace(0, len(lambdas) - 1, min(4, len(lambdas))).round().astype(int))
    rows = list(dict.fromkeys(_nearest(thetas, t) for t in np.radians([0.0, 35.0, 70.0])))
    sides = list(dict.fromkeys([0, len(phis) // 2]))
    figure = _figure(5.0 * len(sides), 2.6 * (len(rows) + 1))
    figure.suptitle(f"{fiber._words}: {fiber.name}")
    axes = figure.subplots(len(rows) + 1, len(sides), squeeze=False)
    relative = np.linspace(0.0, 360.0, values.shape[-1] + 1)
    for r, m in enumerate(rows):
        for s, p in enumerate(sides):
            axis = axes[r, s]
            for k in shown:
                axis.semilogy(relative, np.append(values[k, m, p], values[k, m, p, 0]), color=_color(float(lambdas[k])), label=f"{lambdas[k]:.2f} um", linewidth=1.0)
            axis.set_title(f"theta_i = {np.degrees(thetas[m]):.1f} deg, light from phi_i = {np.degrees(phis[p]):.0f} deg", fontsize=8)
            axis.set_xlabel("phi_r - phi_i [deg]", fontsize=7)
            axis.set_ylabel("N [1/rad]", fontsize=7)
    axes[0, 0].legend(fontsize=6)
    for s, p in enumerate(sides):
        for m in rows:
            axes[-1, s].plot(lambdas, arrays["c_x_um"][:, m, p], label=f"theta_i = {np.degrees(thetas[m]):.1f} deg")
        axes[-1, s].set_xlabel("wavelength [um]", fontsize=7)
        axes[-1, s].set_ylabel("C_x [um]", fontsize=7)
    axes[-1, 0].legend(fontsize=6)
    return figure  # type: ignore[no-any-return]


def _speckle(patterns: Speckle) -> "Figure":
    arrays = patterns.tensors()
    values = arrays["patterns"]
    figure = _figure(9.0, 5.0)
    figure.suptitle(f"{patterns._words}: {patterns.name}")
    top, bottom = figure.subplots(2, 1)
    lambdas = arrays["lambda_um"]
    degrees = np.linspace(0.0, 360.0, values.shape[-1], endpoint=False)
    for k in np.unique(np.linspace(0, len(lambdas) - 1, min(3, len(lambdas))).round().astype(int)):
        top.semilogy(degrees, values[0, k, 0, 0], color=_color(float(lambdas[k])), label=f"{lambdas[k]:.2f} um", linewidth=0.8)
    top.set_title("one instance, clear fiber, TM", fontsize=8)
    top.set_xlabel("azimuth [deg]", fontsize=7)
    top.legend(fontsize=6)
    mean = values[0].mean(axis=2)
    spread = values[0].std(axis=2) / np.maximum(mean, 1e-300)
    for k in range(len(lambdas)):
        bottom.plot(degrees, spread[k, 0], color=_color(float(lambdas[k])), linewidth=0.8)
    bottom.set_title("contrast over the instances, clear fiber, TM", fontsize=8)
    bottom.set_xlabel("azimuth [deg]", fontsize=7)
    return figure  # type: ignore[no-any-return]
