"""A page that shows a library: one HTML file that needs nothing else."""

from __future__ import annotations

import hashlib
import json
from html import escape
from typing import Any, Dict, List, Optional, Sequence

import numpy as np

from .. import _plywave
from .._family import Family
from .._model import Model
from ._farm import Made

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 62rem; padding: 0 1rem; color: #1c1c1c; background: #fff; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin: 0 0 .4rem; } pre { font-size: 12px; overflow-x: auto; margin: 0; }
section { border-top: 1px solid #ccc; padding: 1rem 0; display: flex; gap: 1.5rem; flex-wrap: wrap; } .facts { flex: 1 1 24rem; }
table { border-collapse: collapse; } th { text-align: left; font-weight: normal; color: #555; padding-right: 1rem; vertical-align: top; } td { padding-right: .8rem; }
.bad { color: #a40000; } summary { cursor: pointer; color: #555; } figure { margin: 0; max-width: 30rem; } figcaption { font-size: 12px; color: #555; max-width: 12rem; } svg text { font: 11px system-ui, sans-serif; fill: #555; }
"""
_SIGMAS = (0.0, 0.003, 0.01)
_WORDS = {
    "yarn": "an open plain weave of it, undyed, from above under two lamps",
    "family": "open plain weaves of three of its yarns, undyed: the first axis at its first node, the middle one and its last",
    "fiber": "light by wavelength (down) and azimuth, forward in the middle, four decades",
    "speckle": "light of single instances (down) by azimuth, forward at three quarters, middle wavelength, four decades",
    "twin": "reflected light over a repeat, first view, by absorption",
}
"""What a file's picture shows."""
_COLORS = ("#1f4e79", "#3f8f5f", "#b5651d")


def report(title: str, made: Sequence[Made], *, seconds: float, slots: int, price_per_core_hour: Optional[float] = None, damaged: int = 0) -> str:
    """The page of a farm's items: parameters, energies, errors of the fit, the light that a ply sends round, time and cost.

    Args:
        title: Name of the library.
        made: What the farm gave.
        seconds: Time that it took.
        slots: Cores that it had.
        price_per_core_hour: Price of a core for an hour, in any currency.
        damaged: Files of the cache that were made anew.
    """
    new = [one for one in made if not one.facts.get("cached")]
    core = sum(float(one.facts.get("shard_seconds", 0.0)) + float(one.facts.get("finish_seconds", 0.0)) for one in new)
    rows = {
        "made": f"{sum(one.data is not None for one in new)} of {len(made)}, {len(made) - len(new)} more were in the cache",
        "time": f"{_time(seconds)} with {slots} cores",
        "work": f"{_time(core)} of one core, {core / max(seconds * slots, 1e-9):.0%} of what there was",
        "lost tasks": str(sum(int(one.facts.get("retries", 0)) for one in new)),
        "damaged files": str(damaged),
        "plywave": _plywave.__version__,
    }
    if price_per_core_hour is not None:
        rows["cost"] = f"{seconds * slots / 3600.0 * price_per_core_hour:.4g}"
    failed = [one for one in made if one.data is None]
    if failed:
        rows["failed"] = ", ".join(one.item.name for one in failed)
    body = "".join(_section(one, price_per_core_hour) for one in made)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style></head>\n'
        f"<body><h1>{escape(title)}</h1>{_table(rows)}\n{body}</body></html>\n"
    )


def _time(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def _table(rows: Dict[str, str]) -> str:
    return "<table>" + "".join(f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in rows.items()) + "</table>"


def _section(one: Made, price: Optional[float]) -> str:
    item, facts = one.item, one.facts
    head = f"<h2>{escape(item.name)}.{item.extension}</h2>"
    if one.data is None:
        return f'<section><div class="facts">{head}<p class="bad">{escape(one.error)}</p></div></section>\n'
    core = float(facts.get("shard_seconds", 0.0)) + float(facts.get("finish_seconds", 0.0))
    rows = {
        "file": f"{len(one.data) / 1e6:.2f} MB, SHA-256 {hashlib.sha256(one.data).hexdigest()[:16]}",
        "work": f"{_time(core)} of one core, {facts.get('shards', 0)} shards; {'from the cache, ' if facts.get('cached') else ''}made {facts.get('finished', '')} UTC",
        **{key: str(value) for key, value in item.options if value is not None and key != "traced_plies"},
    }
    if price is not None:
        rows["cost"] = f"{core / 3600.0 * price:.4g}"
    more = picture = ""
    if item.kind == "yarn":
        model = Model.from_bytes(one.data, item.name)
        (refl, high), (most_refl, most_high) = _plywave.fit_quality(model._rust)
        rows["errors of the fit"] = f"f_refl {refl:.3f} (at most {most_refl:g}), f_high {high:.3f} (at most {most_high:g})"
        more, picture = _energies(model), _polar(model)
    elif item.kind == "compare":
        more = _similarity(json.loads(one.data))
    elif item.kind == "family":
        family = Family.from_bytes(one.data, item.name)
        rows.update({name: ", ".join(f"{value:.5g}" for value in values) for name, values in family.axes.items()})
        refl, high = _errors(family)
        rows["errors of the fit"] = f"f_refl {refl:.3f}, f_high {high:.3f}, rms over the slices of a node, the worst node"
        own = family.at()
        more, picture = _energies(own), _polar(own)
    if facts.get("picture"):
        words = _WORDS[item.kind]
        picture += f'<figure><img src="data:image/png;base64,{facts["picture"]}" alt="{words}"><figcaption>{words}</figcaption></figure>'
    spec = f"<details><summary>spec</summary><pre>{escape(item.spec_text)}</pre></details>"
    return f'<section><div class="facts">{head}{_table(rows)}{more}{spec}</div>{picture}</section>\n'


def _similarity(report: Dict[str, Any]) -> str:
    """How alike waves and rays are, in bins of one degree."""
    rows = ["<tr><th>lambda [um], h/R</th><td>correlation of averages</td><td>of single instances</td><td>distance of averages</td></tr>"]
    for case in report["cases"]:
        at = min(case["resolutions"], key=lambda r: abs(float(r["bin_deg"]) - 1.0))
        values = at["average"]["correlation"], at["single_correlation"]["mean"], at["average"]["relative_l2"]
        rows.append(f"<tr><th>{case['lambda_um']:g}, {case['h_rel']:g}</th>{''.join(f'<td>{v:.3f}</td>' for v in values)}</tr>")
    return f"<table>{''.join(rows)}</table><p>{report['instances']} instances</p>"


def _errors(family: Family) -> List[float]:
    """Errors of the fit of f_refl and of f_high of clear fibers: rms over the slices of a node, of the worst node."""
    arrays = family.tensors()
    slices = arrays["error_refl"], arrays["error_high"][..., 0]
    return [float(np.sqrt(np.square(errors.reshape(len(errors), -1)).mean(1)).max()) for errors in slices]


def _energies(model: Model) -> str:
    """What becomes of light at the middle of the ply, at three absorptions."""
    tilts = np.radians([0.0, 40.0, 70.0])
    rows = [f"<tr><th>light sent out, sigma [1/um]</th>{''.join(f'<td>{s:g}</td>' for s in _SIGMAS)}</tr>"]
    for tilt in tilts:
        albedo = model.albedo(theta_i=np.float32(tilt), h_um=np.float32(0.0), sigma_per_um=np.array(_SIGMAS, np.float32))
        rows.append(f"<tr><th>theta_i = {np.degrees(tilt):.0f} degrees</th>{''.join(f'<td>{a:.3f}</td>' for a in np.ravel(albedo))}</tr>")
    return f"<table>{''.join(rows)}</table>"


def _polar(model: Model) -> str:
    """Light in the plane across the ply, lit from the left of the picture at the ply's middle: f by azimuth, a square root scale."""
    phi = np.linspace(-np.pi, np.pi, 361)
    # The beam comes from (0, 1, 0); azimuth 0 is straight back.
    omega = np.stack([np.sin(phi), np.cos(phi), np.zeros_like(phi)], -1).astype(np.float32)
    f = np.asarray(model.eval(theta_i=np.float32(0.0), h_um=np.float32(0.0), omega_o=omega, sigma_per_um=np.array(_SIGMAS, np.float32), edge=False), float)
    top = float(f.max())
    if not top > 0.0:
        return ""
    lines: List[str] = []
    for k, color in enumerate(_COLORS):
        radius = 130.0 * np.sqrt(np.maximum(f[:, k], 0.0) / top)
        points = " ".join(f"{160.0 - r * np.cos(p):.1f},{150.0 - r * np.sin(p):.1f}" for r, p in zip(radius, phi))
        lines.append(f'<polyline points="{points}" fill="none" stroke="{color}"/><text x="{8 + 104 * k}" y="314" style="fill:{color}">sigma {_SIGMAS[k]:g} / um</text>')
    circles = "".join(f'<circle cx="160" cy="150" r="{130.0 * np.sqrt(s):.1f}" fill="none" stroke="#ddd"/>' for s in (0.25, 0.5, 1.0))
    arrow = '<path d="M2 150H24M24 150l-6 -4M24 150l-6 4" stroke="#555" fill="none"/>'
    return (
        f'<svg width="320" height="322" role="img" aria-label="light across the ply">{circles}{arrow}{"".join(lines)}'
        f'<text x="8" y="14">f across the ply, theta_i = 0; outer circle {top:.3g} / sr</text></svg>'
    )
