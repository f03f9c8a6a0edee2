"""The kit's data against what is known of it: schema, size, energy, and circles by waves against their series.

    python3 -m pytest conformance/kit/test_data.py
"""
import json
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
DATA = HERE.parent / "data"
sys.path.insert(0, str(HERE))


def load(name):
    return json.loads((DATA / f"{name}.json").read_text())


def test_files_say_what_they_are():
    files = sorted(DATA.glob("*.json"))
    assert len(files) >= 10
    assert sum(f.stat().st_size for f in files) < 300_000
    for f in files:
        head = json.loads(f.read_text())
        assert head["schema"] == "fiber-truth" and head["version"] == 1 and head["name"] == f.stem
        assert head["license"] == "CC0-1.0" and head["how"] and head["conventions"] and head["rows"]


def test_clear_plies_and_cloths_keep_the_light():
    for row in load("plies")["rows"]:
        assert abs(row["straight"] + row["refl"] + row["high"]["0.0"] - 1.0) < 1e-3, row["of"]
    seen = set()
    for row in load("cloths")["rows"]:
        total = row["R"] + row["T"] + row["straight"]
        assert total < 1.0 + 1e-4 and (row["sigma_per_um"] > 0.0 or total > 0.99), (row["of"], total)
        seen.add(row["of"])
    assert len(seen) >= 2


def test_densities_have_the_energies():
    for name in ("plies", "cloths"):
        found = 0
        for row in load(name)["rows"]:
            if "density" in row:
                density, found = np.array(row["density"]), found + 1
                light = density.sum() * 4.0 * np.pi / density.size
                expected = row["R"] + row["T"] if name == "cloths" else row["refl"] + row["high"]["0.0"]
                assert abs(light - expected) < 2e-3, (row["of"], light, expected)
        assert found >= 10


def test_light_of_a_traced_ply_comes_back_where_it_fell():
    """A clear ply sends most of its light on; what is only reflected goes back. h > 0 is at the azimuth asin h."""
    for row in load("plies")["rows"]:
        if "density" in row and row["theta_deg"] == 0.0 and abs(row["h"]) > 0.3:
            density = np.array(row["density"]).sum(axis=0)
            phi = (np.arange(len(density)) + 0.5) / len(density) * 2.0 * np.pi - 0.5 * np.pi
            # Light that is sent back, or to the side, leaves on the side on which it fell.
            back = np.cos(phi) > -0.5
            assert (density * np.sin(phi))[back].sum() * row["h"] > 0.0, (row["of"], row["h"])


def bessel(orders, x):
    """J_n and Y_n of n = 0 .. orders for real x: Bessel's integral, and Neumann's upward from Y_0 and Y_1."""
    t = (np.arange(4000) + 0.5) * np.pi / 4000
    n = np.arange(orders + 1)
    j = np.cos(n[:, None] * t - x * np.sin(t)).mean(axis=1)
    u, w = np.polynomial.legendre.leggauss(400)
    top = np.arcsinh(745.0 / x)
    s, ws = 0.5 * top * (u + 1.0), 0.5 * top * w
    tt, wt = 0.5 * np.pi * (u + 1.0), 0.5 * w
    y = np.empty(orders + 1)
    for k in (0, 1):
        y[k] = np.sin(x * np.sin(tt) - k * tt) @ wt - ((np.exp(k * s) + (-1.0) ** k * np.exp(-k * s)) * np.exp(-x * np.sinh(s))) @ ws / np.pi
    for k in range(1, orders):
        y[k + 1] = 2.0 * k / x * y[k] - y[k - 1]
    return j, y


def derivative(z, x):
    n = np.arange(len(z))
    return np.concatenate([[-z[1]], z[:-1] - n[1:] / x * z[1:]])


def circle(radius, eta, wavelength, theta, azimuths):
    """Widths and spreads of TM and TE by the series of Bohren and Huffman 1983, section 8.4, at latitude theta."""
    k0 = 2.0 * np.pi / wavelength
    zeta, x = 0.5 * np.pi - theta, k0 * radius
    xi, inner = x * np.sin(zeta), x * np.sqrt(eta**2 - np.cos(zeta) ** 2)
    count = int(xi + 4.0 * xi ** (1.0 / 3.0) + 12)
    n = np.arange(count + 1)
    j_in, _ = bessel(count, inner)
    j, y = bessel(count, xi)
    h = j + 1j * y
    dj_in, dj, dh = derivative(j_in, inner), derivative(j, xi), derivative(h, xi)
    m2, gap = eta**2, xi**2 / inner**2 - 1.0
    a = 1j * xi * (xi * dj_in * j - inner * j_in * dj)
    b = xi * (m2 * xi * dj_in * j - inner * j_in * dj)
    c = n * np.cos(zeta) * inner * j_in * j * gap
    d = n * np.cos(zeta) * inner * j_in * h * gap
    v = xi * (m2 * xi * dj_in * h - inner * j_in * dh)
    w = 1j * xi * (inner * j_in * dh - xi * dj_in * h)
    under = w * v + 1j * d**2
    turn = azimuths - np.pi
    found = {}
    for pol, own, other in (
        ("TM", (w * b + 1j * d * c) / under, (c * v - b * d) / under),
        ("TE", -(a * v - 1j * c * d) / under, -1j * (c * w + a * d) / under),
    ):
        width = 4.0 / k0 * (abs(own[0]) ** 2 + 2.0 * np.sum(abs(own[1:]) ** 2 + abs(other[1:]) ** 2))
        t = own[0] + 2.0 * np.cos(np.outer(turn, n[1:])) @ own[1:]
        cross = 2.0 * np.sin(np.outer(turn, n[1:])) @ other[1:]
        found[pol] = width, 2.0 / (np.pi * k0) * (abs(t) ** 2 + abs(cross) ** 2)
    return found


def test_circles_by_waves_equal_their_series():
    found = 0
    for row in load("ellipse_waves")["rows"]:
        assert abs(row["C_sca_um"] - row["C_ext_um"]) < 1e-4 * row["C_ext_um"]
        if row["ratio"] == 1.0:
            f = np.array(row["f"])
            azimuths = np.radians(row["phi_deg"]) + 2.0 * np.pi * np.arange(len(f)) / len(f)
            width, spread = circle(row["radius_um"], 1.55, 0.55, np.radians(row["theta_deg"]), azimuths)[row["pol"]]
            assert abs(row["C_sca_um"] - width) < 1e-6 * width + row["error"], (row["radius_um"], row["pol"], width)
            assert np.max(np.abs(f - spread)) < 2.0 * row["f_error"], (row["radius_um"], row["pol"])
            found += 1
    assert found >= 8
