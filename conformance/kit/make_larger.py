#!/usr/bin/env python3
"""Writes the truths of what is larger than a fiber: ../data/plies.json, cloths.json, ellipse_waves.json, measured.json.

    python3 conformance/kit/make_larger.py --plywave target/release/plywave [--only plies] [--folder WORK]

Plies and cloths are traced through explicit fibers by `plywave simulate` and `plywave twin`: no model is asked.
Each run is done with two seeds, which pack the fibers anew; the value is their mean, the error is from their difference.
Ellipses are solved by boundary integrals at two tolerances. Takes ten minutes.
"""
import argparse
import json
import struct
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np

from make_data import rounded, write

HERE = Path(__file__).resolve().parent
FABRICS = HERE.parents[1] / "fabrics"
SEEDS = (71, 72)
PLIES = ["polyester", "cotton"]
PLY_SIGMAS, CLOTH_SIGMAS = (0.0, 0.01), (0.0, 0.01)
CLOTHS = ["organza", "percale", "jersey"]
# Tilt from the normal and azimuth from the weft [degrees]; the last comes from the back.
VIEWS = [(0, 0), (60, 0), (60, 90), (45, 45), (75, 30), (135, 20)]
WITH_DENSITY = ["organza", "percale"]
BINS, PLY_BINS = (12, 24), (12, 18)


def tensors(path):
    """Arrays and the JSON document of a file of plywave (safetensors)."""
    data = path.read_bytes()
    size = struct.unpack("<Q", data[:8])[0]
    head, body = json.loads(data[8 : 8 + size]), data[8 + size :]
    types = {"F64": "<f8", "F32": "<f4", "U64": "<u8"}
    found = {}
    for name, t in head.items():
        if name != "__metadata__" and t["dtype"] in types:
            a, b = t["data_offsets"]
            found[name] = np.frombuffer(body[a:b], types[t["dtype"]]).reshape(t["shape"])
    return found, json.loads(head["__metadata__"]["plywave"])


def run(args, *command):
    subprocess.run([str(args.plywave.resolve()), *map(str, command), "--threads", str(args.threads), "-q"], check=True, cwd=args.folder)


def coarse(density, shape=BINS):
    """Means over blocks of bins, for the last two axes."""
    *lead, rows, columns = density.shape
    return density.reshape(*lead, shape[0], rows // shape[0], shape[1], columns // shape[1]).mean(axis=(-3, -1))


def in_equal_z(density):
    """Means over bins equal in z of a density in bins equal in latitude, by the overlap of their areas."""
    steps, columns = density.shape
    edges = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, steps + 1))
    out = np.zeros((PLY_BINS[0], columns))
    for k in range(PLY_BINS[0]):
        low, high = -1.0 + 2.0 * k / PLY_BINS[0], -1.0 + 2.0 * (k + 1) / PLY_BINS[0]
        share = np.clip(np.minimum(edges[1:], high) - np.maximum(edges[:-1], low), 0.0, None)
        out[k] = share @ density / (high - low)
    return coarse(out, PLY_BINS)


def without_comments(text):
    """The keys of a spec."""
    return "\n".join(line.split(" #")[0].rstrip() for line in text.splitlines() if line.strip() and not line.startswith("#"))


def plies(args):
    rows, specs = [], {}
    for name in PLIES:
        each = []
        for seed in SEEDS:
            out = args.folder / f"{name}_{seed}.pwt"
            if not out.exists():
                run(args, "simulate", FABRICS / f"{name}.toml", "--preset", "preview", "--paths", args.ply_paths, "--seed", seed, "-o", out)
            found, document = tensors(out)
            each.append(found)
        a, b = each
        specs[name] = without_comments(document["spec"])
        radius = tomllib.loads(specs[name])["ply"]["radius_um"]
        sigma = [int(np.argmin(np.abs(a["sigma_per_um"] - s))) for s in PLY_SIGMAS]
        chosen = [(m, n) for m in range(len(a["theta_i"])) for n in range(len(a["h_um"])) if abs(a["h_um"][n]) < 0.95 * radius]
        # Both seeds of all rows together: one pair alone says little of its own spread.
        pairs = [[(t["r_d"][i], t["energy_refl"][i], *t["energy_high"][i][sigma]) for i in chosen] for t in each]
        se = float(np.sqrt(np.mean((np.array(pairs[0]) - np.array(pairs[1])) ** 2) / 4.0))
        turn = len(a["theta_i"])
        for k, (m, n) in enumerate(chosen):
            mean = lambda key: 0.5 * (a[key][m, n] + b[key][m, n])
            h = -float(a["h_um"][n]) / radius
            row = dict(of=name, theta_deg=float(np.degrees(a["theta_i"][m])), h=h, straight=float(mean("r_d")), refl=float(mean("energy_refl")))
            row["high"] = {str(s): float(mean("energy_high")[i]) for s, i in zip(PLY_SIGMAS, sigma)}
            row = rounded({**row, "se": se}, 5)
            if m in (0, turn // 2, turn - 2) and abs(h) < 0.7:
                bins = [in_equal_z(np.array(t["refl"][m, n], float) + t["high"][m, n, sigma[0]]) for t in each]
                row["density"] = rounded(0.5 * (bins[0] + bins[1]), 3)
                row["noise"] = rounded(float(np.sum((bins[0] - bins[1]) ** 2) / 4.0), 3)
            rows.append(row)
    how = (
        f"plywave simulate, preset preview, seeds {SEEDS}: rays traced through the explicit fibers of random packings, in "
        "geometric optics, of a Gaussian beam at h. Means of both seeds. se: standard error of any energy here, from the "
        "seeds' differences over all rows of this ply. noise: sum over bins of "
        "the variance of density, from the seeds."
    )
    words = (
        "The axis is z. theta is the latitude of wi, whose azimuth is 90 degrees; h is the offset of the beam's middle over the "
        "radius of the ply: a ray meets the ply at the azimuth of wi + asin h. straight: share of the beam that hits no fiber; refl: that was only reflected at "
        "fibers; high: all other scattered light, by absorption of the fibers [1/um]. density: refl + high at sigma 0, means of f "
        f"[1/sr] over {PLY_BINS[0]} bins equal in z from -1 by {PLY_BINS[1]} of the azimuth from 0. specs: the yarn specs, lengths in um."
    )
    write("plies", how, words, rows, specs=specs)


def cloths(args):
    rows, specs = [], {}
    for name in CLOTHS:
        each = []
        for seed in SEEDS:
            out = args.folder / f"{name}_{seed}.pwx"
            if not out.exists():
                views = ",".join(f"{t}:{p}" for t, p in VIEWS)
                sigmas = ",".join(map(str, CLOTH_SIGMAS))
                run(args, "twin", FABRICS / "cloths" / f"{name}.toml", "--paths", args.paths, "--sigma", sigmas, "--views", views, "--seed", seed, "-o", out)
            each.append(tensors(out)[0])
        a, b = each
        specs[name] = without_comments((FABRICS / f"cloths/{name}.toml").read_text())
        for v, (tilt, azimuth) in enumerate(VIEWS):
            for k, sigma in enumerate(CLOTH_SIGMAS):
                row = dict(of=name, tilt_deg=float(min(tilt, 180 - tilt)), wi=[float(x) for x in a["views"][v]], sigma_per_um=sigma)
                for key, tensor in (("R", "reflected"), ("T", "transmitted")):
                    x, y = a[tensor][v, k], b[tensor][v, k]
                    row[key] = float(0.5 * (x + y))
                    # The greater of the rays' own and of what the packings differ by.
                    own = 0.5 * np.hypot(a[tensor + "_se"][v, k], b[tensor + "_se"][v, k])
                    row["se_" + key] = float(max(own, 0.5 * abs(x - y)))
                row["paths"] = int(a["paths"][v] + b["paths"][v])
                row["straight"] = float(0.5 * (a["straight"][v] + b["straight"][v]))
                p, n = row["straight"], float(a["paths"][v] + b["paths"][v])
                row["se_straight"] = float(max(np.sqrt(p * (1.0 - p) / n), 0.5 * abs(a["straight"][v] - b["straight"][v])))
                row = rounded(row, 5)
                if name in WITH_DENSITY and sigma == 0.0:
                    x, y = (coarse(np.array(t["density"][v, k], float)) for t in each)
                    row["density"] = rounded(0.5 * (x + y), 3)
                    half = BINS[0] // 2
                    row["noise"] = rounded([float(np.sum((x - y)[s] ** 2) / 4.0) for s in (slice(0, half), slice(half, None))], 3)
                rows.append(row)
    how = (
        f"plywave twin, seeds {SEEDS}, `paths` of both: rays traced through every fiber of the woven cloth, in geometric "
        "optics, without any model; means of both seeds. se: standard error of the rays, or half the seeds' difference where "
        "that is more. noise: sum of the variance of density over bins of z < 0, and of z > 0."
    )
    words = (
        "x along the weft or the courses, y along the warp or the wales, z the normal. wi: unit vector to the light, parallel and "
        "even over the cloth. sigma_per_um: absorption of all fibers [1/um]. straight: light that hit no fiber; R: leaves on wi's "
        "side; T: on the other, without what is straight. density: mean of f [1/sr], the BSDF times the cosine, over "
        f"{BINS[0]} bins equal in z from -1 by {BINS[1]} of the azimuth from 0. specs: the cloth specs."
    )
    write("cloths", how, words, rows, specs=specs)


LAMBDA_UM, ETA = 0.55, 1.55
RADII, RATIOS = (0.5, 1.5), (1.0, 0.5, 1.4)
OUT = 48


def waves(args):
    rows = []
    for radius in RADII:
        for ratio in RATIOS:
            a, b = radius * np.sqrt(ratio), radius / np.sqrt(ratio)
            shape = f'shape = "ellipse"\na_um = {a!r}\nb_um = {b!r}\n'.replace("np.float64(", "").replace(")", "")
            found = []
            for tolerance in (1e-5, 1e-8):
                turns = "[0]" if ratio == 1.0 else "[0, 45, 90]"
                text = f'lambda_um = [{LAMBDA_UM}]\ntheta_i_deg = [0, 40]\nphi_i_deg = {turns}\nn_phi_out = {OUT}\ntolerance = {tolerance}\n'
                scene, out = args.folder / "scene.toml", args.folder / "scene.json"
                scene.write_text(f'{text}method = "nystrom"\n[[fiber]]\n{shape}eta = {ETA}\nkappa = 0.0\n')
                run(args, "wave", "scatter", scene, "-o", out)
                found.append(json.loads(out.read_text())["cases"])
            for coarse_case, case in zip(*found):
                f, rough = (spread_of(c) for c in (case, coarse_case))
                row = dict(radius_um=radius, ratio=ratio, theta_deg=case["theta_i_deg"], phi_deg=case["phi_i_deg"], pol=case["pol"])
                row.update(C_sca_um=case["C_sca_um"], C_ext_um=case["C_ext_um"])
                row["error"] = max(abs(case["C_sca_um"] - coarse_case["C_sca_um"]), 1e-8)
                row = rounded(row, 9)
                row["f"], row["f_error"] = rounded(f, 4), rounded(max(float(np.max(np.abs(f - rough))), 5e-4 * f.max()), 2)
                rows.append(row)
    how = (
        "plywave wave scatter, boundary integrals (method nystrom) at tolerances 1e-5 and 1e-8: the value is the finer, error and "
        "f_error are their differences, and the rounding here. Rows of ratio 1 are circles, for which a series is known."
    )
    words = (
        f"Plane waves of {LAMBDA_UM} um fall on one clear fiber of index {ETA} along z, of half axes radius sqrt(ratio) along x and "
        "radius / sqrt(ratio) along y [um]. theta: latitude of the light, phi: azimuth it comes from. pol TM: the electric field in the "
        f"plane of axis and light. C: widths [um] of scattered and extinguished power. f: scattered width per azimuth [um/rad] at {OUT} "
        "azimuths from 0, even steps; its integral is C_sca."
    )
    write("ellipse_waves", how, words, rows)


def spread_of(case):
    k0 = 2.0 * np.pi / case["lambda_um"]
    power = sum(np.array(case[name])[:, 0] ** 2 + np.array(case[name])[:, 1] ** 2 for name in ("F_co", "F_cross"))
    return 2.0 / (np.pi * k0) * power


SHADE = "LBNL shade library (LBNL-ETA/AERCalc, WinCalc): Klems file, visible, hemispherical; straight is its incident bin, 5 degrees"
NETS = "Kotilainen, Robson and Hernandez 2018, PLOS ONE 13, e0199628: sunlight, 400 to 700 nm, elevation not given"
SPLIB = "USGS splib07a, public domain; the backing of thin cloths is not stated"


def measured(args):
    rows = [
        dict(of="NET 5 charcoal", what="vinyl-coated polyester, 5 % open, 0.8 mm", T=0.0544, straight=0.0509, R=0.0478, tolerance=0.02, source=SHADE),
        dict(of="NET 5 white", what="the same weave in white", T=0.1974, straight=0.0699, R=0.7803, tolerance=0.02, source=SHADE),
        dict(of="GreenScreen pewter", what="woven polyester, 1 % open, 1 mm", T=0.0949, straight=0.0153, R=0.106, R_back=0.117, tolerance=0.02, source=SHADE,
             T_by_angle={"0": 0.095, "10": 0.094, "20": 0.083, "30": 0.073, "40": 0.066, "50": 0.056, "60": 0.044, "70": 0.026, "82.5": 0.017}),
        dict(of="Sunbrella taupe", what="solution-dyed acrylic awning cloth, plain weave", T=0.0009, R=0.1487, tolerance=0.02, source=SHADE),
        dict(of="Urban Loft", what="woven textile, 0.381 mm", T=0.318, straight=0.0037, R=0.401, R_back=0.413, tolerance=0.02, source=SHADE),
    ]
    for of, what, t in (
        ("net black 16x16", "black HDPE of 360 den, 16 x 16 threads a cm, 140 g/m2", 0.280),
        ("net black 16x10", "black HDPE of 360 den, 16 x 10 threads a cm, 130 g/m2", 0.402),
        ("net amber 16x10", "amber HDPE, 16 x 10 threads a cm, 130 g/m2", 0.678),
        ("net clear 16x10", "clear HDPE, 16 x 10 threads a cm, 130 g/m2", 0.873),
        ("net clear 20x10", "clear HDPE, 20 x 10 threads a cm, 150 g/m2", 0.870),
        ("net clear 10x10", "clear HDPE, 10 x 10 threads a cm, 100 g/m2", 0.903),
    ):
        rows.append(dict(of=of, what=what, sunlight_T=t, tolerance=0.05, source=NETS))
    for of, r, t in (("nonwoven white", 0.544, 0.447), ("nonwoven white, two", 0.712, 0.269), ("nonwoven white, b", 0.602, 0.396), ("nonwoven white, b, two", 0.684, 0.301)):
        rows.append(dict(of=of, what="nonwoven, diffuse light; `two` is two layers of the one before", diffuse_R=r, diffuse_T=t, tolerance=0.02, source=SHADE))
    rows.append(dict(of="cotton table cloth", what="white cotton at 450, 550, 650, 850 nm", R_by_nm={"450": 0.634, "550": 0.597, "650": 0.618, "850": 0.640}, tolerance=0.02, source=SPLIB))
    how = (
        "Measurements in print, copied as numbers. tolerance: chosen. 0.02 is what `straight` of two dyes of one weave differs by; "
        "that of nets is for the sun's elevation, which is not given."
    )
    words = "Shares of light. T, R, straight: parallel light at the normal, T with what is straight. sunlight_T: sunlight. diffuse_R, diffuse_T: even light."
    write("measured", how, words, rows)


MAKERS = {"plies": plies, "cloths": cloths, "waves": waves, "measured": measured}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plywave", type=Path, default=HERE.parents[1] / "target/release/plywave")
    parser.add_argument("--folder", type=Path, default=Path("conformance.parts"), help="work files, which a second run takes")
    parser.add_argument("--only", choices=MAKERS)
    parser.add_argument("--paths", type=int, default=10000, help="paths of a view of a cloth")
    parser.add_argument("--ply-paths", type=int, default=100000, help="paths of a latitude of a ply")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    args.folder = args.folder.resolve()
    for name, make in MAKERS.items():
        if args.only in (None, name):
            make(args)


if __name__ == "__main__":
    sys.exit(main())
