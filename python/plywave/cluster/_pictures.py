"""Small pictures for a farm's page: cloth of a yarn or of a family's yarns, the places of a twin, the light that a fiber or its instances scatter."""

from __future__ import annotations

import struct
import zlib
from typing import Optional

import numpy as np

from .._family import Family
from .._files import unpack
from .._model import Model

_SIDE = 160
_REPEATS = 3
_DECADES = 4.0
"""Of light in maps of it."""


def png(rgb: np.ndarray) -> bytes:
    """A PNG of `[height, width, 3]` values of sRGB from 0 to 1."""
    pixels = np.ascontiguousarray(np.clip(rgb, 0.0, 1.0) * 255.0 + 0.5, np.uint8)
    height, width, _ = pixels.shape

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")


def _srgb(linear: np.ndarray) -> np.ndarray:
    x = np.clip(linear, 0.0, 1.0)
    curved: np.ndarray = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)
    return curved


def _towards(tilt: float, azimuth: float) -> np.ndarray:
    return np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)], np.float32)


def swatch(model: bytes) -> Optional[bytes]:
    """A PNG of an open plain weave of a model's plies, undyed, seen from above under two lamps: light that they scatter once. `None` for a model without a radius."""
    rgb = _woven(model)
    return None if rgb is None else png(rgb)


def yarns(family: bytes) -> Optional[bytes]:
    """The same of three of a family's yarns, side by side: the first axis at its first node, at the middle one and at its last, the others as in the spec."""
    known = Family.from_bytes(family)
    name, values = next(iter(known.axes.items()))
    shown = (values[0], values[len(values) // 2], values[-1])
    tiles = [tile for value in shown if (tile := _woven(known.at(**{name: value}).to_bytes())) is not None]
    return png(np.concatenate(tiles, 1)) if len(tiles) == len(shown) else None


def _woven(model: bytes) -> Optional[np.ndarray]:
    """Pixels of a swatch, sRGB."""
    arrays, _ = unpack(model)
    if "edge_radius_um" not in arrays:
        return None
    ply, radius_um = Model.from_bytes(model), float(arrays["edge_radius_um"][0])
    spacing_um, amplitude_um = 3.2 * radius_um, 1.05 * radius_um
    # Two points a pixel each way.
    side = np.linspace(0.0, _REPEATS * 2.0 * spacing_um, 2 * _SIDE, endpoint=False)
    x, y = np.meshgrid(side, side[::-1])
    light, top_um = np.zeros_like(x), np.full_like(x, -np.inf)
    for is_warp, across, along in ((True, x, y), (False, y, x)):
        yarn = np.floor(across / spacing_um)
        off = across - (yarn + 0.5) * spacing_um
        # On top of the first crossing, below at the next, and the other way round of the next yarn.
        turn = np.pi * (along / spacing_um - 0.5 - yarn)
        rise = amplitude_um if is_warp else -amplitude_um
        height, slope = rise * np.cos(turn), -rise * np.pi / spacing_um * np.sin(turn)
        inside = np.abs(off) < radius_um
        height_um = height + np.sqrt(np.maximum(radius_um**2 - off**2, 0.0))
        seen = inside & (height_um > top_um)
        c = 1.0 / np.hypot(1.0, slope[seen])
        s, zero = slope[seen] * c, np.zeros_like(c)
        # The ply's axes, of a view from above: across it, up, along.
        axes = ((-1.0 + zero, zero, zero), (zero, -s, c), (zero, c, s)) if is_warp else ((zero, 1.0 + zero, zero), (-s, zero, c), (c, zero, s))
        h_um = -off[seen] if is_warp else off[seen]
        sums = np.zeros_like(c)
        for tilt, azimuth, weight in ((0.7, 2.2, 1.0), (0.5, -0.6, 0.25)):
            w = _towards(tilt, azimuth)
            towards = np.stack([sum(a * b for a, b in zip(axis, w)) for axis in axes], -1)
            sums += weight * np.asarray(ply.eval(np.arctan2(s, c), h_um, towards, 0.0, edge=False))[..., 0]
        light[seen], top_um[seen] = sums, height_um[seen]
    light = light.reshape(_SIDE, 2, _SIDE, 2).mean((1, 3))
    return _srgb(np.repeat(light[..., None] / max(float(np.percentile(light, 98.0)), 1e-9), 3, -1))


def _map(values: np.ndarray) -> Optional[bytes]:
    """A PNG of values by row and column, at a logarithmic scale of `_DECADES` from the greatest down; columns are averaged to twice `_SIDE` at most."""
    wide = -(-values.shape[1] // (2 * _SIDE))
    values = values[:, : values.shape[1] // wide * wide].astype(np.float64)
    values = values.reshape(len(values), -1, wide).mean(2)
    top = float(values.max())
    if not top > 0.0:
        return None
    grey = 1.0 + np.log10(np.maximum(values / top, 10.0**-_DECADES)) / _DECADES
    tall, broad = (max(1, side // size) for side, size in zip((_SIDE, 2 * _SIDE), grey.shape))
    return png(np.repeat(np.kron(grey, np.ones((tall, broad)))[..., None], 3, -1))


def azimuths(fiber: bytes) -> Optional[bytes]:
    """A PNG of a fiber table: N by wavelength, from the top down, and relative azimuth, forward in the middle, of the light nearest to the cross section's plane."""
    return _map(unpack(fiber)[0]["azimuthal"][:, 0, 0])


def patterns(speckle: bytes) -> Optional[bytes]:
    """A PNG of speckle patterns: instances, at most `_SIDE`, from the top down, by azimuth, of clear fibers, TM, at the middle wavelength."""
    values = unpack(speckle)[0]["patterns"]
    return _map(values[0, values.shape[1] // 2, 0, :_SIDE])


def places(twin: bytes) -> Optional[bytes]:
    """A PNG of a twin's reflected light over one repeat, at its first view, for each of its absorptions."""
    image = unpack(twin)[0]["image"][0].astype(np.float64)
    top = float(np.percentile(image, 99.0))
    if not top > 0.0:
        return None
    scale = max(1, _SIDE // image.shape[-1])
    # Rows of the file go up.
    tiles = [np.kron(one[::-1], np.ones((scale, scale))) for one in image[:3] / top]
    return png(_srgb(np.repeat(np.concatenate(tiles, 1)[..., None], 3, -1)))
