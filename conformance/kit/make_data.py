#!/usr/bin/env python3
"""Writes ../data/*.json, the truths of the kit, from rays through cylinders (walk.py). Takes two minutes.

    python3 conformance/kit/make_data.py [--quick]

Every file has a schema, how its values were found, and the error of each.
"""
import argparse
import json
from pathlib import Path

import numpy as np

import walk

SCHEMA, VERSION = "fiber-truth", 1
FOLDER = Path(__file__).resolve().parent.parent / "data"
ETAS = [1.1, 1.3, 1.55, 2.0]
DEGREES = [0.0, 30.0, 60.0, 80.0, 89.0]
TAUS = [0.0, 0.5, 2.0, 5.0]
LOBES = ["R", "TT", "TRT", "later"]


def rounded(values, digits):
    if isinstance(values, dict):
        return {k: rounded(v, digits) for k, v in values.items()}
    if isinstance(values, (list, tuple, np.ndarray)):
        return [rounded(v, digits) for v in values]
    return float(f"{float(values):.{digits}g}") if isinstance(values, (float, np.floating)) else values


def write(name, how, conventions, rows, **more):
    head = {"schema": SCHEMA, "version": VERSION, "name": name, "license": "CC0-1.0", "how": how}
    head["conventions"] = conventions
    head.update(more)
    lines = ",\n".join("  " + json.dumps(row) for row in rows)
    text = json.dumps(head, indent=1)[:-2] + ',\n "rows": [\n' + lines + "\n ]\n}\n"
    (FOLDER / f"{name}.json").write_text(text)
    print(f"{name}: {len(rows)} rows, {len(text)} bytes")


def with_absorption(found, tau):
    """Energies of R, TT, TRT and the later orders, whose number is enough for 1e-15 of the light."""
    each = [energy * np.exp(-tau * way) for energy, _, way in found]
    return np.array([each[0], each[1], each[2], sum(each[3:])])


def closed_form(theta, h, eta, tau):
    """The same by Bravais' effective index (Marschner 2003), which is the second derivation of the near field."""
    sin, cos = np.sin(theta), np.cos(theta)
    eta_p = np.sqrt(eta**2 - sin**2) / cos
    cos_gt = np.sqrt(1.0 - (h / eta_p) ** 2)
    f = walk.fresnel_vector(np.array([cos * np.sqrt(1.0 - h**2)]), eta)[0]
    t = np.exp(-tau * cos_gt / np.sqrt(1.0 - (sin / eta) ** 2))
    a = [f, (1 - f) ** 2 * t, (1 - f) ** 2 * t**2 * f]
    later = a[2] * t * f / (1.0 - t * f) if t * f < 1.0 else 0.0
    return np.array(a + [later])


CYLINDER = (
    "The axis is z. theta is the latitude of wi, asin(wi.z); both wi and wo point away from the fiber. "
    "h in [-1, 1] is the offset of the ray: it meets the fiber at the azimuth of wi + asin h. "
    "phi is the azimuth of wo less that of wi. tau is absorption times diameter. "
    "Energies are shares of the light that falls on the fiber at h (near) or over its width (far)."
)


def near():
    rows = []
    for eta in ETAS:
        for degrees in DEGREES:
            for h in [0.0, 0.3, 0.6, 0.9, 0.99, -0.6]:
                theta = np.radians(degrees)
                found = walk.orders(theta, 0.0, [h], eta, 2000)
                a = {str(tau): with_absorption(found, tau)[:, 0] for tau in TAUS}
                error = max(np.abs(a[str(tau)] - closed_form(theta, h, eta, tau)).max() for tau in TAUS)
                phi = [float(np.arctan2(w[0, 1], w[0, 0])) for _, w, _ in found[:3]]
                row = dict(eta=eta, theta_deg=degrees, h=h, phi=phi, way=float(found[1][2][0]), energy=a)
                rows.append({**rounded(row, 10), "error": rounded(max(error, 1e-10), 2)})
    how = (
        "One ray, traced by Snell's law and Fresnel's formulas in three dimensions (walk.orders, 2000 orders). "
        "error: largest difference from the closed form with Bravais' index, or 1e-10, the rounding here."
    )
    write("cylinder_near", how, CYLINDER + " way: length of one pass in diameters.", rows, lobes=LOBES)


def mean_over_width(theta, eta, tau, nodes, a=1.0, b=1.0, phi=0.0, orders=400):
    """Energies of the lobes as a mean over h, with nodes in asin h."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    gamma = 0.5 * np.pi * x
    found = walk.orders(theta, phi, np.sin(gamma), eta, orders, a, b)
    weight = 0.5 * np.pi * w * np.cos(gamma) / 2.0
    return with_absorption(found, tau) @ weight


def histogram(theta, eta, tau, count, bins=24):
    """Energy in equal bins of |phi| for R, TT, TRT, by equal steps of h."""
    h = (np.arange(count) + 0.5) / count
    found = walk.orders(theta, 0.0, h, eta, 3)
    out = []
    for energy, w, way in found:
        phi = np.abs(np.arctan2(w[:, 1], w[:, 0]))
        light = energy * np.exp(-tau * way)
        out.append(np.histogram(phi, bins, (0.0, np.pi), weights=light)[0] / count)
    return np.array(out)


def far(quick):
    rows, count = [], 20000 if quick else 400000
    for eta in ETAS:
        for degrees in DEGREES:
            theta = np.radians(degrees)
            a, error = {}, 0.0
            for tau in TAUS:
                coarse, fine = (mean_over_width(theta, eta, tau, n) for n in (400, 800))
                a[str(tau)], error = fine, max(error, np.abs(coarse - fine).max())
            row = dict(eta=eta, theta_deg=degrees, energy=a)
            if degrees in (0.0, 60.0):
                coarse, fine = (histogram(theta, eta, 0.5, n) for n in (count, 2 * count + 1))
                row["azimuth_tau_0.5"] = fine
                row["azimuth_error"] = float(np.abs(coarse - fine).max())
            rows.append(rounded({**rounded(row, 6), "error": max(error, 1e-6)}, 6))
    how = (
        "Means of walk.orders over h: energies by Gauss-Legendre in asin h, error by half the nodes. "
        "azimuth_tau_0.5: light at tau 0.5 in 24 equal bins of |phi| from 0 to pi for R, TT, TRT, by equal steps of h."
    )
    write("cylinder_far", how, CYLINDER, rows, lobes=LOBES)


def metals():
    rows = []
    for name, eta, kappa in [("gold at 0.55 um", 0.43, 2.46), ("aluminium at 0.55 um", 0.96, 6.7), ("iron", 2.9, 3.0)]:
        for degrees in DEGREES:
            theta = np.radians(degrees)
            h = np.array([0.0, 0.3, 0.6, 0.9, 0.99])
            near_field = walk.fresnel_conductor(np.cos(theta) * np.sqrt(1.0 - h**2), eta, kappa)
            x, w = np.polynomial.legendre.leggauss(400)
            gamma = 0.5 * np.pi * x
            r = walk.fresnel_conductor(np.cos(theta) * np.cos(gamma), eta, kappa)
            mean = float((r * 0.25 * np.pi * w * np.cos(gamma)).sum())
            row = dict(metal=name, eta=eta, kappa=kappa, theta_deg=degrees, h=h, near=near_field, far=mean, error=1e-6)
            rows.append(rounded(row, 7))
    how = "Fresnel's formulas with a complex index at the hit of each h, and their mean over h by Gauss-Legendre."
    write("metal_cylinder", how, CYLINDER, rows)


def ellipses():
    rows = []
    for ratio in (0.5, 0.7, 1.4):
        for eta in (1.3, 1.55):
            for degrees in (0.0, 45.0, 75.0):
                for phi in (0.0, 45.0, 90.0):
                    args = (np.radians(degrees), eta)
                    a, b = np.sqrt(ratio), 1.0 / np.sqrt(ratio)
                    energy, error = {}, 0.0
                    for tau in (0.0, 1.0):
                        each = [mean_over_width(*args, tau, n, a, b, np.radians(phi), 200) for n in (800, 1600)]
                        energy[str(tau)], error = each[1], max(error, np.abs(each[0] - each[1]).max())
                    row = dict(ratio=ratio, eta=eta, theta_deg=degrees, phi_deg=phi, energy=energy)
                    rows.append(rounded({**rounded(row, 6), "error": max(error, 1e-6)}, 6))
    how = (
        "Means of walk.orders over the width of an ellipse, 200 orders; error by half the nodes. What stays inside "
        "beyond them, at tau 0 totally reflected light, is missing from `later`."
    )
    words = CYLINDER + " The ellipse's half axis along x is `ratio` times that along y; tau is for the diameter 2 sqrt(ab)."
    write("ellipse_far", how, words, rows, lobes=LOBES)


def rough(quick):
    count, rows = (20000 if quick else 300000), []
    for eta in (1.3, 1.55, 2.0):
        for alpha in (0.1, 0.3, 0.5, 0.8):
            for degrees in (0.0, 45.0, 80.0):
                rng = np.random.default_rng(int(1000 * eta + 100 * alpha + degrees))
                order, out, way = walk.rough_cylinder(np.radians(degrees), alpha, eta, count, rng)
                row = dict(eta=eta, alpha=alpha, theta_deg=degrees, energy={}, se={})
                for tau in (0.0, 1.0):
                    light = np.exp(-tau * way) * (order < 60)
                    lobes = np.array([light * (order == k) for k in range(3)] + [light * (order > 2)])
                    row["energy"][str(tau)] = lobes.mean(axis=1)
                    row["se"][str(tau)] = lobes.std(axis=1) / np.sqrt(count)
                row["mean_sin_theta_o"] = [float(out[order == k, 2].mean()) for k in range(3)]
                row["stopped"] = float((order == 60).mean())
                bins = np.histogram(np.abs(np.arctan2(out[:, 1], out[:, 0])), 12, (0.0, np.pi))[0] / count
                row["azimuth"] = bins
                rows.append(rounded(row, 4))
    how = (
        f"{count} rays a row, each with a random walk on a Smith surface of GGX slopes at every hit "
        "(Heitz et al. 2016), so that no light is lost; se: standard error. azimuth: all light at tau 0 in 12 equal "
        "bins of |phi|. stopped: rays still inside after 60 hits."
    )
    write("rough_cylinder", how, CYLINDER + " alpha: GGX roughness of the surface.", rows, lobes=LOBES)


def plane(quick):
    count, rows = (50000 if quick else 1000000), []
    for eta in (1.5, 1.0 / 1.5):
        for alpha in (0.05, 0.1, 0.3, 0.5, 0.8):
            for degrees in (0.0, 45.0, 75.0):
                rng = np.random.default_rng(int(1000 * eta + 100 * alpha + degrees))
                theta = np.radians(degrees)
                wi = np.tile([np.sin(theta), 0.0, np.cos(theta)], (count, 1))
                w, crossed, bounces = walk.rough_surface(wi, alpha, eta, rng)
                done = bounces < 200
                m = walk.visible_normal(wi, alpha, rng)
                f = walk.fresnel_vector(np.clip(walk.dot(wi, m), 0.0, 1.0), np.full(count, eta))
                g1 = lambda w: 1.0 / (1.0 + walk.smith_lambda(w, alpha))
                up, down = walk.reflect(-wi, m), walk.refract(-wi, m, eta) * np.array([1.0, 1.0, -1.0])
                r1 = np.where(up[:, 2] > 0.0, f * g1(up), 0.0)
                with np.errstate(invalid="ignore"):
                    t1 = np.where((down[:, 2] > 0.0) & (f < 1.0), (1.0 - f) * g1(down), 0.0)
                row = dict(eta=eta, alpha=alpha, theta_deg=degrees)
                row["all"] = [float((~crossed & done).mean()), float((crossed & done).mean())]
                row["single"] = [float(r1.mean()), float(t1.mean())]
                row["se_single"] = [float(x.std() / np.sqrt(count)) for x in (r1, t1)]
                row["se_all"] = float(np.sqrt(0.25 / count))
                rows.append(rounded(row, 6))
    how = (
        f"{count} rays a row. all: reflected and transmitted light after a random walk on the Smith surface, "
        "whose sum is 1. single: after one hit, with separable masking G1(wi) G1(wo). GGX slopes; eta is the index "
        "beyond over that of wi's side."
    )
    write("rough_plane", how, "wi points away from the plane; theta is from its normal. Shares of the light that falls in.", rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer rays, for a look")
    quick = parser.parse_args().quick
    near()
    far(quick)
    metals()
    ellipses()
    rough(quick)
    plane(quick)


if __name__ == "__main__":
    main()
