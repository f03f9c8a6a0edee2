#!/usr/bin/env python3
"""Opens what `plywave export` writes in other programs, and compares their numbers with the report's.

    scripts/check_exports.py [CLOTH ...] [--plywave PROGRAM] [--keep FOLDER]

A reader that is not installed is skipped: pywincalc, pyradiance, mitsuba, MaterialX and usd-core from PyPI, gltf-validator from npm (in a folder that
`node` finds, or NODE_PATH). The comparison of directions with Mitsuba needs the package plywave too. Ends with 1 where a limit is exceeded.
Prints the rows of docs/validation/exports.md.
"""
import argparse
import importlib.util
import json
import math
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parent.parent
VIEWS = "0,30:20,60:20,30:70,60:70,45:50,150:20,120:70"
rows, failed = [], []


def has(module):
    if importlib.util.find_spec(module) is None:
        print(f"skipped: {module} is not installed", file=sys.stderr)
        return False
    return True


def note(cloth, form, reader, quantity, measured, limit, path):
    size = path.stat().st_size
    holds = limit is None or measured <= limit
    shown = "" if limit is None else f"{limit:g}"
    rows.append(f"| {cloth} | {form} | {reader} | {quantity} | {shown} | {measured:.4f} | {size / 1024:.0f} KiB |")
    print(rows[-1] + ("" if holds else "  <-- beyond the limit"), flush=True)
    if not holds:
        failed.append(rows[-1])


class Cloth:
    def __init__(self, program, spec, folder):
        self.program, self.spec, self.folder, self.name = program, spec, folder, spec.stem

    def export(self, form, ending, *flags):
        path = self.folder / f"{self.name}_{form}.{ending}"
        run = [self.program, "export", self.spec, "--to", form, "-o", path, "--json", "--quiet", *flags]
        told = json.loads(subprocess.run([str(a) for a in run], check=True, capture_output=True, text=True).stdout)
        return path, told["facts"]


def report(cloth):
    path, _ = cloth.export("report", "json", "--views", VIEWS, "--samples", "65536")
    return json.loads(path.read_text())


def twin(cloth, twin_file, sigma):
    """The report beside path tracing of the cloth's explicit fibers, with one absorption."""
    told = json.loads(subprocess.run([str(cloth.program), "info", str(twin_file), "--json"], check=True, capture_output=True, text=True).stdout)
    views = ",".join(f"{v['tilt_deg']:.6g}:{v['azimuth_deg']:.6g}" for v in told["views"])
    path, _ = cloth.export("report", "json", "--views", views, "--samples", "65536", "--sigma", str(sigma))
    ours = json.loads(path.read_text())["rows"]
    worst = [0.0] * 3
    for view, row in zip(told["views"], ours):
        light = next(l for l in view["light"] if l["sigma_per_um"] == [sigma, sigma])
        pairs = (
            (row["reflected"]["value"], light["reflected"]),
            (row["transmitted"]["value"], light["transmitted"] + view["straight"]),
            (row["straight"]["value"], view["straight"]),
        )
        worst = [max(w, abs(a - b)) for w, (a, b) in zip(worst, pairs)]
    for quantity, off, limit in zip(("R", "T", "straight"), worst, (0.03, 0.03, 0.03)):
        note(cloth.name, "report", "`plywave twin`", f"{quantity}, sigma {sigma} per um: largest difference", off, limit, path)


def clear_pane(pywincalc):
    """3 mm of clear glass, the same at all wavelengths."""
    light = pywincalc.OpticalMeasurementComponent(0.83, 0.83, 0.075, 0.075)
    data = [pywincalc.WavelengthData(um / 100, light) for um in range(30, 251, 5)]
    optical = pywincalc.ProductDataOpticalNBand(
        material_type=pywincalc.MaterialType.MONOLITHIC, thickness_meters=0.003, wavelength_data=data, coated_side=pywincalc.CoatedSide.NEITHER,
        ir_transmittance_front=0.0, ir_transmittance_back=0.0, emissivity_front=0.84, emissivity_back=0.84, flipped=False)
    return pywincalc.ProductDataOpticalAndThermal(optical, pywincalc.ProductDataThermal(conductivity=1.0, thickness_meters=0.003, flipped=False))


def heat(cloth, pywincalc, layer, hemisphere, facts, path):
    """U and SHGC of a pane with the cloth behind it; a warning is an error."""
    pairs = (
        (layer.conductivity, "conductivity_w_per_m_k"), (layer.emissivity_front, "emissivity_front"), (layer.emissivity_back, "emissivity_back"),
        (layer.ir_transmittance, "ir_transmittance"), (layer.permeability_factor, "permeability"),
    )
    off = max(abs(got - facts[name]) for got, name in pairs)
    note(cloth.name, "klems", "pyWinCalc", "thermal fields: largest difference from those printed", off, 1e-6, path)
    numbers = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for more in ([], [layer]):
            parts = {"solid_layers": [clear_pane(pywincalc), *more], "gap_layers": [pywincalc.Layers.gap(thickness=0.0127)] * len(more), "bsdf_hemisphere": hemisphere}
            u = pywincalc.GlazingSystem(**parts).u()
            numbers.append((u, pywincalc.GlazingSystem(**parts, environment=pywincalc.nfrc_shgc_environments()).shgc()))
    (bare_u, bare_g), (u, g) = numbers
    # NFRC's clear pane of 3 mm has 5.91 W/(m2 K).
    note(cloth.name, "klems", "pyWinCalc", "U of a clear pane alone beside NFRC's 5.91 W/(m2 K)", abs(bare_u - 5.91), 0.02, path)
    note(cloth.name, "klems", "pyWinCalc", "U of the pane with the cloth behind it [W/(m2 K)]", u, bare_u, path)
    note(cloth.name, "klems", "pyWinCalc", "SHGC of the pane with the cloth behind it", g, bare_g, path)


def klems(cloth, ours):
    path, facts = cloth.export("klems", "xml")
    if has("pywincalc"):
        import pywincalc

        layer = pywincalc.parse_bsdf_xml_file(str(path))
        hemisphere = pywincalc.BSDFHemisphere.create(pywincalc.BSDFBasisType.FULL)
        system = pywincalc.GlazingSystem(solid_layers=[layer], bsdf_hemisphere=hemisphere)
        off = {"diffuse": 0.0, "normal": 0.0}
        for method, band in (("PHOTOPIC", ""), ("SOLAR", "solar_")):
            system_results = system.optical_method_results(method).system_results
            for side, at in (("front", 0), ("back", 1)):
                got = getattr(system_results, side)
                for name, part in (("transmitted", got.transmittance), ("reflected", got.reflectance)):
                    off["diffuse"] = max(off["diffuse"], abs(part.diffuse_diffuse - ours["diffuse"][at][band + name]["value"]))
                    off["normal"] = max(off["normal"], abs(part.direct_hemispherical - ours["normal"][at][band + name]["value"]))
        for light, limit in (("diffuse", 0.005), ("normal", 0.005)):
            note(cloth.name, "klems", "pyWinCalc", f"T and R, visible and solar, both sides, {light} light: largest difference", off[light], limit, path)
        heat(cloth, pywincalc, layer, hemisphere, facts, path)
        own = abs(system.optical_method_results("PHOTOPIC").system_results.front.transmittance.diffuse_diffuse - facts["front_visible_transmittance"])
        note(cloth.name, "klems", "pyWinCalc", "diffuse T: difference from the sum over the file", own, 1e-5, path)
    return path


def radiance(cloth, ours, klems_file):
    path, _ = cloth.export("tensortree", "xml")
    if not has("pyradiance"):
        return
    from pyradiance import bsdf

    files = [("klems", bsdf.load_file(str(klems_file)), klems_file), ("tensortree", bsdf.load_file(str(path)), path)]
    for form, data, file in files:
        off = 0.0
        for row in ours["rows"]:
            tilt, azimuth = row["view"]["tilt_rad"], row["view"]["azimuth_rad"]
            if tilt > 1.1:
                continue
            x, y = math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth)
            # Radiance's frame: X = -x, Y = y, Z = -z.
            theta = math.degrees(tilt) if not row["is_face"] else 180.0 - math.degrees(tilt)
            got = bsdf.direct_hemi(data, theta, math.degrees(math.atan2(y, -x)), bsdf.SAMPLE_ALL)
            off = max(off, abs(got - row["reflected"]["value"] - row["transmitted"]["value"]))
        note(cloth.name, form, "Radiance (pyradiance)", "R + T of directions, to 60 degrees, in patches: largest difference", off, 0.03, file)
    # Two readers of Radiance, two bases, one frame: the mean over pairs of directions, and straight light.
    random = Random(1)
    off, norm = 0.0, 0.0
    pairs = [(random.uniform(0, 60), random.uniform(0, 360), random.uniform(0, 60), random.uniform(0, 360)) for _ in range(20000)]
    for side in (0, 180):
        for ti, pi, to, po in pairs:
            a, b = (float(bsdf.query(data, abs(side - ti), pi, abs(side - to), po)[1]) for _, data, _ in files)
            off, norm = off + (a - b) ** 2, norm + a * a
    note(cloth.name, "tensortree", "Radiance (pyradiance)", "reflected f beside that of klems, 20000 pairs: relative L2 difference", math.sqrt(off / norm), None, files[1][2])
    for tilt, azimuth in ((7.0, 20.0), (22.0, 100.0), (41.0, 200.0), (52.0, 310.0)):
        values = [float(bsdf.query(data, tilt, azimuth, 180.0 - tilt, azimuth + 180.0)[1]) for _, data, _ in files]
        aside = [float(bsdf.query(data, tilt, azimuth, 180.0 - tilt, azimuth + 90.0)[1]) for _, data, _ in files]
        if min(values) < 3 * max(aside) and ours["normal"][0]["straight"]["value"] > 0.05:
            failed.append(f"{cloth.name}: straight light is not where it goes: {values} {aside}")


def mitsuba(cloth, ours):
    path, facts = cloth.export("rgl", "bsdf")
    if not has("mitsuba"):
        return
    import mitsuba as mi
    import numpy as np

    mi.set_variant("scalar_rgb")
    bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    off = 0.0
    for row in ours["rows"]:
        if not row["is_face"]:
            continue
        tilt, azimuth = row["view"]["tilt_rad"], row["view"]["azimuth_rad"]
        d = [math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt)]
        scene = mi.load_dict({
            "type": "scene", "integrator": {"type": "direct", "emitter_samples": 0, "bsdf_samples": 1},
            "light": {"type": "constant"},
            "sheet": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(100), "cloth": {"type": "measured", "filename": str(path)}},
            "sensor": {"type": "orthographic", "to_world": mi.ScalarTransform4f().look_at(origin=[3 * v for v in d], target=[0, 0, 0], up=[0, 1, 0] if abs(d[1]) < 0.9 else [1, 0, 0]) @ mi.ScalarTransform4f().scale(0.01),
                       "film": {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}}, "sampler": {"type": "independent", "sample_count": 256}},
        })
        picture = np.array(mi.render(scene))[..., :3].mean((0, 1))
        got = float(picture @ [0.212639, 0.715169, 0.072192])
        off = max(off, abs(got / row["reflected"]["value"] - 1))
    note(cloth.name, "rgl", "Mitsuba `measured`", "picture under an even sky by angle, to 60 degrees, beside the report: largest relative difference", off, 0.02, path)
    if not has("plywave"):
        return
    import plywave

    # Of one absorption, so that RGB and spectra are one.
    path, _ = cloth.export("rgl", "bsdf", "--sigma", "0.003")
    bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    model = plywave.Cloth(cloth.spec, sigma_per_um=0.003, gaps="straight", edges=False, slits=plywave.Slit(1.0, 0.0), uneven=False, relief=False)
    random = np.random.default_rng(1)

    def directions(count, most):
        z = np.cos(np.radians(most)) + (1 - np.cos(np.radians(most))) * random.uniform(size=count)
        phi = 2 * np.pi * random.uniform(size=count)
        r = np.sqrt(1 - z * z)
        return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)

    luminance = np.array([0.212639, 0.715169, 0.072192])
    wo, wi = directions(2000, 70), directions(2000, 75)
    f = model.eval([0.0, 0.0], wo, wi, footprint_um=1e9)
    si, context, got = mi.SurfaceInteraction3f(), mi.BSDFContext(), []
    for o, i in zip(wo, wi):
        si.wi = mi.Vector3f(*[float(v) for v in o])
        got.append([float(v) for v in bsdf.eval(context, si, mi.Vector3f(*[float(v) for v in i]))])
    got, f = np.array(got) @ luminance, f @ luminance
    note(cloth.name, "rgl", "Mitsuba `measured`", "f of 2000 pairs of directions beside the mean over the cell, sigma 0.003 per um: relative L2 difference", float(np.sqrt(((got - f) ** 2).sum() / (f ** 2).sum())), 0.05, path)
    note(cloth.name, "rgl", "Mitsuba `measured`", "the same: relative difference of the mean", abs(float(got.mean() / f.mean() - 1)), 0.02, path)


def materialx(cloth):
    path, facts = cloth.export("openpbr", "mtlx")
    if has("MaterialX"):
        import MaterialX as mx

        library = mx.createDocument()
        mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
        document = mx.createDocument()
        mx.readFromXmlFile(document, str(path))
        document.setDataLibrary(library)
        valid, message = document.validate()
        missing = [p for p in (i.getValueString() for n in document.traverseTree() if n.isA(mx.Input) and n.getType() == "filename" for i in [n]) if not (path.parent / p).is_file()]
        if not valid or missing or [m.getName() for m in document.getMaterialNodes()] == []:
            failed.append(f"{path}: {message} {missing}")
        note(cloth.name, "openpbr", "MaterialX", "faults that its reader finds", float(not valid) + len(missing), 0, path)
    note(cloth.name, "openpbr", "own fit", "reflected light: relative L2 error", facts["error_reflected"], None, path)
    note(cloth.name, "openpbr", "own fit", "transmitted light: relative L2 error", facts["error_transmitted"], None, path)
    note(cloth.name, "openpbr", "own fit", "R: difference", abs(facts["reflectance_of_the_material"] - facts["reflectance_of_the_cloth"]), None, path)
    note(cloth.name, "openpbr", "own fit", "T: difference", abs(facts["transmittance_of_the_material"] - facts["transmittance_of_the_cloth"]), None, path)


def gltf(cloth):
    path, _ = cloth.export("gltf", "glb")
    script = "const v=require('gltf-validator'),fs=require('fs');v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1]))).then(r=>console.log(JSON.stringify(r.issues)))"
    try:
        run = subprocess.run(["node", "-e", script, str(path)], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        print("skipped: gltf-validator is not installed", file=sys.stderr)
        return
    issues = json.loads(run.stdout)
    note(cloth.name, "gltf", "gltf-validator", "errors and warnings", issues["numErrors"] + issues["numWarnings"], 0, path)


def usd(cloth):
    path, _ = cloth.export("usd", "usda")
    if importlib.util.find_spec("pxr") is None:
        print("skipped: usd-core is not installed", file=sys.stderr)
        return
    from pxr import Usd, UsdShade, UsdUtils, UsdValidation

    stage = Usd.Stage.Open(str(path))
    root = stage.GetDefaultPrim()
    material = UsdShade.Material(root.GetChild("Cloth"))
    # usd-core reads no .mtlx.
    material.GetPrim().GetVariantSet("shading").SetVariantSelection("preview")
    shader, _, _ = material.ComputeSurfaceSource()
    faults = int(not shader)
    bound, _ = UsdShade.MaterialBindingAPI(root.GetChild("Swatch")).ComputeBoundMaterial()
    faults += int(bound.GetPath() != material.GetPath())
    checked = path.with_name(path.stem + "_preview.usda")
    stage.GetRootLayer().Export(str(checked))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    problems = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(checked)))
    for problem in problems:
        print(problem.GetErrorAsString(), file=sys.stderr)
    _, _, unresolved = UsdUtils.ComputeAllDependencies(str(checked))
    note(cloth.name, "usd", "usd-core", "faults of stage, material and textures, and those of all validators", faults + len(problems) + len(unresolved), 0, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cloths", nargs="*", type=Path, default=[ROOT / "fabrics/cloths/organza.toml", ROOT / "fabrics/cloths/satin.toml"])
    parser.add_argument("--plywave", default=ROOT / "target/release/plywave")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--twin", type=Path, help="a twin of the first cloth, traced with --sigma 0.003")
    parser.add_argument("--only", nargs="*", default=["twin", "klems", "radiance", "mitsuba", "materialx", "gltf", "usd"])
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.keep or Path(scratch)
        folder.mkdir(exist_ok=True)
        for k, spec in enumerate(args.cloths):
            cloth = Cloth(args.plywave, spec, folder)
            if "twin" in args.only and args.twin and k == 0:
                twin(cloth, args.twin, 0.003)
            if {"klems", "radiance", "mitsuba"} & set(args.only):
                ours = report(cloth)
                if "klems" in args.only or "radiance" in args.only:
                    file = klems(cloth, ours)
                if "radiance" in args.only:
                    radiance(cloth, ours, file)
                if "mitsuba" in args.only:
                    mitsuba(cloth, ours)
            for name, check in (("materialx", materialx), ("gltf", gltf), ("usd", usd)):
                if name in args.only:
                    check(cloth)
    print("\n".join(f"beyond the limit: {row}" for row in failed), file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
