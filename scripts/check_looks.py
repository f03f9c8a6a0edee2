#!/usr/bin/env python3
"""Renders exported materials in the programs that read them, beside the cloth, and compares the pictures.

    scripts/check_looks.py                                 the usual cloths
    scripts/check_looks.py fabrics/cloths/denim.toml --keep looks --only cycles
    scripts/check_looks.py --page docs/validation/pictures/looks.jpg

A ball, a drape and two folds (cylinders along warp and weft) are seen from far away under one distant light, in front
and behind. The cloth's own pictures are those of its mean over the cell. Prints rows of a Markdown table:
cloth, program, quantity, limit, measured. Needs the program (cargo build --release -p plywave-cli) and the
Python package of plywave with numpy; for Cycles bpy 5.0, for Mitsuba mitsuba 3.9, for three.js node with
three and playwright-core, and Chromium (CHROMIUM, usually /usr/bin/chromium). Others are skipped.
"""
import argparse
import importlib.util
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
CLOTHS = ("satin", "denim", "organza")
LUMINANCE = np.array([0.212639, 0.715169, 0.072192])
# Pixels a side, radius of ball and folds [m], length of cloth in a unit of texture coordinates [m].
SIDE, RADIUS, UV = 128, 0.05, 0.1
# Directions of light [degrees from the viewer, azimuth]; above 90 behind the cloth.
FRONT = ((15, 200), (45, 30), (45, 120), (45, 210), (45, 300))
BACK = ((180, 0), (150, 0), (150, 90), (150, 180), (150, 270))
FOLD = (-50, 20)
SHAPES = ("ball", "drape", "fold_warp", "fold_weft")
# Smallest cosines of viewer and light for a pixel that counts; from behind, sides of the ball shade each
# other.
COSINE, COSINE_BACK = 0.1, 0.6
LIMITS = {"color": 0.05, "place": 5.0, "width": 0.25, "transmission": 0.1}
failed = []


def direction(tilt, azimuth):
    s = math.sin(math.radians(tilt))
    return np.array([s * math.cos(math.radians(azimuth)), s * math.sin(math.radians(azimuth)), math.cos(math.radians(tilt))])


def grid(shape):
    """Gives normals, directions of u, and a mask of a picture's pixels, the first row on top."""
    t = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    x, y = np.meshgrid(t, -t)
    if shape == "ball":
        r2 = x * x + y * y
        n = np.stack([x, y, np.sqrt(np.maximum(1 - r2, 1e-9))], -1)
        u = np.stack([n[..., 2], 0 * x, -n[..., 0]], -1)
        return n, u / np.linalg.norm(u, axis=-1, keepdims=True), r2 < 0.995
    if shape == "drape":
        n, u = drape(x, y)[1:]
        return n, u, np.ones_like(x, bool)
    across = x if shape == "fold_warp" else y
    z = np.sqrt(np.maximum(1 - across * across, 1e-9))
    zero = 0 * x
    if shape == "fold_warp":
        return np.stack([x, zero, z], -1), np.stack([z, zero, -x], -1), abs(across) < 0.995
    return np.stack([zero, y, z], -1), np.stack([zero + 1, zero, zero], -1), abs(across) < 0.995


def drape(x, y):
    """Gives heights, normals and directions of u of a hanging cloth: folds that fan out downwards.

    Slopes stay below 42 degrees, so that a light 45 degrees off throws no shadow."""
    wide = 1.6 - 0.6 * y
    phase = 7.5 * x / wide + 0.6 * np.sin(2.2 * y)
    deep = 0.085 * wide * (1 - 0.3 * y)
    slope_x = deep * np.cos(phase) * 7.5 / wide
    slope_y = deep * np.cos(phase) * (7.5 * x * 0.6 / wide**2 + 1.32 * np.cos(2.2 * y)) + np.sin(phase) * 0.085 * (-0.6 * (1 - 0.3 * y) - 0.3 * wide)
    n = np.stack([-slope_x, -slope_y, np.ones_like(x)], -1)
    u = np.stack([np.ones_like(x), 0 * x, slope_x], -1)
    return deep * np.sin(phase), n / np.linalg.norm(n, axis=-1, keepdims=True), u / np.linalg.norm(u, axis=-1, keepdims=True)


def mesh(shape, steps=96):
    """Gives positions, normals, texture coordinates and triangles; texture coordinates are lengths of cloth."""
    a = np.linspace(-0.5, 0.5, steps + 1) * math.pi
    b = a if shape == "ball" else np.linspace(-1, 1, steps + 1)
    if shape == "drape":
        a = b = np.linspace(-1.05, 1.05, steps + 1)
    p, q = np.meshgrid(a, b)
    if shape == "ball":
        n = np.stack([np.sin(p) * np.cos(q), np.sin(q), np.cos(p) * np.cos(q)], -1)
        at, uv = n, np.stack([p, q], -1)
    elif shape == "drape":
        z, n, _ = drape(p, q)
        at, uv = np.stack([p, q, z], -1), np.stack([p, q], -1)
    elif shape == "fold_warp":
        n = np.stack([np.sin(p), 0 * p, np.cos(p)], -1)
        at, uv = n + np.stack([0 * p, q, 0 * p], -1), np.stack([p, q], -1)
    else:
        n = np.stack([0 * p, np.sin(p), np.cos(p)], -1)
        at, uv = n + np.stack([q, 0 * p, 0 * p], -1), np.stack([q, p], -1)
    k = np.arange((steps + 1) ** 2).reshape(steps + 1, steps + 1)
    quads = np.stack([k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]], -1).reshape(-1, 4)
    # Faces look out.
    if shape == "fold_weft":
        quads = quads[:, ::-1]
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    flat = lambda v, size: (RADIUS * size * v).reshape(-1, v.shape[-1])
    return flat(at, 1), flat(n, 1 / RADIUS), flat(uv, 1 / UV), triangles


def scenes():
    """Gives (name, shape, direction of the light) of all pictures."""
    for k, light in enumerate(FRONT):
        yield f"ball_front{k}", "ball", direction(*light)
    for k, light in enumerate(BACK):
        yield f"ball_back{k}", "ball", direction(*light)
    yield "drape_front", "drape", direction(45, 30)
    yield "drape_back", "drape", direction(150, 20)
    for tilt in FOLD:
        yield f"fold_warp{tilt:+d}", "fold_warp", direction(tilt, 0)
        yield f"fold_weft{tilt:+d}", "fold_weft", direction(tilt, 90)


def spectral(wavelengths):
    """Gives the weights of linear sRGB under D65 for values at wavelengths [um], of the tables of the CIE."""
    text = (ROOT / "src/color/tables.rs").read_text()
    table = lambda name: np.array([float(v) for v in re.search(rf"const {name}: .*? = \[(.*?)\];", text, re.DOTALL)[1].split(",") if v.strip()])
    nodes = 0.38 + 0.005 * np.arange(81)
    xyz = np.array([np.interp(wavelengths, nodes, table(f"{axis}_BAR") * table("D65")) for axis in "XYZ"])
    white = np.array([0.950456, 1.0, 1.089058])
    xyz *= (white / xyz.sum(1))[:, None]
    to_rgb = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.969266, 1.8760108, 0.041556], [0.0556434, -0.2040259, 1.0572252]])
    return to_rgb @ xyz


def ours(spec):
    """Pictures of the cloth by its mean over the cell."""
    import plywave

    wavelengths = np.linspace(0.39, 0.735, 24)
    weights = spectral(wavelengths)

    cloth = plywave.Cloth(spec, gaps="straight", edges=False, slits=plywave.Slit(1.0, 0.0), uneven=False, relief=False)
    pictures = {}
    for name, shape, light in scenes():
        n, u, mask = grid(shape)
        n, u = n[mask], u[mask]
        local = lambda w: np.stack([u @ w, np.cross(n, u) @ w, n @ w], -1)
        picture = np.zeros((SIDE, SIDE, 3))
        for k in range(0, 24, 8):
            wo, wi = local(np.array([0.0, 0.0, 1.0])), local(light)
            picture[mask] += cloth.eval([0.0, 0.0], wo, wi, wavelengths[k : k + 8], footprint_um=1e9) @ weights[:, k : k + 8].T
        pictures[name] = picture
    return pictures


def cycles(job):
    """In a process of its own: pictures of an exported .py in Cycles, as arrays in job["folder"]."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    space = importlib.util.spec_from_file_location("cloth", job["file"])
    cloth = importlib.util.module_from_spec(space)
    space.loader.exec_module(cloth)
    made = cloth.material()
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = job["samples"], False, 0
    scene.cycles.transparent_max_bounces, scene.cycles.filter_width = 16, 1.5
    scene.cycles.sample_clamp_direct = 0
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.world = bpy.data.worlds.new("dark")
    for node in scene.world.node_tree.nodes:
        if node.type == "BACKGROUND":
            node.inputs["Strength"].default_value = 0.0
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 2 * RADIUS, (0, 0, 1)
    lamp = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    lamp.data.energy, lamp.data.angle, lamp.rotation_mode = 1.0, 0.0, "QUATERNION"
    for each in (camera, lamp):
        scene.collection.objects.link(each)
    scene.camera = camera
    import mathutils

    objects = {}
    for name, shape, light in scenes():
        if shape not in objects:
            at, normals, uv, triangles = mesh(shape)
            data = bpy.data.meshes.new(shape)
            data.from_pydata(at.tolist(), [], triangles.tolist())
            layer = data.uv_layers.new(name="UVMap")
            layer.data.foreach_set("uv", uv[triangles.reshape(-1)].reshape(-1))
            data.normals_split_custom_set_from_vertices(normals.tolist())
            data.materials.append(made)
            objects[shape] = bpy.data.objects.new(shape, data)
            scene.collection.objects.link(objects[shape])
        for other, thing in objects.items():
            thing.hide_render = other != shape
        lamp.rotation_quaternion = mathutils.Vector(light.tolist()).to_track_quat("Z", "Y")
        path = f"{job['folder']}/{name}.exr"
        scene.render.filepath = path
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(path)
        pixels = np.array(picture.pixels[:]).reshape(SIDE, SIDE, 4)[::-1, :, :3]
        np.save(f"{job['folder']}/{name}.npy", pixels)


def mitsuba(job):
    """In a process of its own: pictures of an exported .xml in Mitsuba."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    path = Path(job["file"])
    name = re.search(r'id="(\w+)"', path.read_text())[1]
    for shape in SHAPES:
        at, normals, uv, triangles = mesh(shape)
        made = mi.Mesh(shape, len(at), len(triangles), has_vertex_normals=True, has_vertex_texcoords=True)
        values = mi.traverse(made)
        for key, value in (("vertex_positions", at), ("vertex_normals", normals), ("vertex_texcoords", uv)):
            values[key] = mi.Float(value.astype(np.float32).reshape(-1))
        values["faces"] = mi.UInt(triangles.astype(np.uint32).reshape(-1))
        values.update()
        made.write_ply(str(path.parent / f"{shape}.ply"))
    scene = path.with_name("scene.xml")
    for picture, shape, light in scenes():
        away = ",".join(str(-v) for v in light)
        scene.write_text(f"""<scene version="3.0.0"><include filename="{path.name}"/>
<integrator type="direct"><integer name="emitter_samples" value="1"/><integer name="bsdf_samples" value="0"/></integrator>
<emitter type="directional"><vector name="direction" value="{away}"/><rgb name="irradiance" value="1"/></emitter>
<shape type="ply"><string name="filename" value="{shape}.ply"/><ref id="{name}"/></shape>
<sensor type="orthographic"><transform name="to_world"><scale x="{RADIUS}" y="{RADIUS}"/><lookat origin="0,0,1" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="{SIDE}"/><integer name="height" value="{SIDE}"/><rfilter type="gaussian"/></film>
<sampler type="independent"><integer name="sample_count" value="{job['samples']}"/></sampler></sensor></scene>""")
        np.save(f"{job['folder']}/{picture}.npy", np.array(mi.render(mi.load_file(str(scene))))[..., :3])


def three(job):
    """In a process of its own: pictures of a .glb in three.js."""
    shapes = {}
    for shape in SHAPES:
        at, normals, uv, triangles = mesh(shape)
        shapes[shape] = {"at": at.reshape(-1).tolist(), "normals": normals.reshape(-1).tolist(), "uv": uv.reshape(-1).tolist(), "triangles": triangles.reshape(-1).tolist()}
    task = {"side": SIDE, "radius": RADIUS, "uv_m": UV, "shapes": shapes, "scenes": [[n, s, list(map(float, d))] for n, s, d in scenes()]}
    text = json.dumps(task)
    (Path(job["folder"]) / "task.json").write_text(text)
    command = ["node", str(ROOT / "scripts/looks/three.mjs"), job["file"], job["folder"], job["modules"]]
    subprocess.run(command, check=True)
    for name, _, _ in scenes():
        pixels = np.fromfile(f"{job['folder']}/{name}.f32", np.float32).reshape(SIDE, SIDE, 4)[::-1, :, :3]
        np.save(f"{job['folder']}/{name}.npy", pixels)


def streak(values):
    """Place and width of the streak in a row of (angle, value), as plywave's fit measures them, or None."""
    angle, value = values
    low, median, high, top = value.min(), np.median(value), value.max(), int(value.argmax())
    if high < 2 * median or top in (0, len(value) - 1):
        return None
    level = (low + high) / 2
    left = next((k for k in range(top, 0, -1) if value[k - 1] < level), None)
    right = next((k for k in range(top, len(value) - 1) if value[k + 1] < level), None)
    if left is None or right is None:
        return None
    cross = lambda a, b: angle[a] + (angle[b] - angle[a]) * (level - value[a]) / (value[b] - value[a])
    left, right = cross(left - 1, left), cross(right + 1, right)
    return (left + right) / 2, right - left


def row(picture, shape, light):
    """The mean profile of a fold: angles of the normal [degrees] and luminances, smoothed over 3 degrees."""
    values = (picture @ LUMINANCE).mean(0 if shape == "fold_warp" else 1)
    t = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    angle = np.degrees(np.arcsin(t if shape == "fold_warp" else -t))
    at = np.arange(-80, 80.1, 1.0)
    weight = np.exp(-0.5 * ((angle[None] - at[:, None]) / 1.5) ** 2)
    lit = np.cos(np.radians(at)) * light[2] + np.sin(np.radians(at)) * (light[0] + light[1]) > COSINE
    return at[lit], ((weight * values).sum(1) / weight.sum(1))[lit]


def note(cloth, program, quantity, measured, limit):
    shown = f"{measured:.3f}"
    if not measured <= limit:
        failed.append(f"{cloth}, {program}: {quantity}: {measured:.3f}")
        shown += ", not met"
    print(f"| {cloth} | {program} | {quantity} | {limit} | {shown} |", flush=True)


def compare(cloth, program, want, got):
    """Notes the distances of pictures from the cloth's."""
    sums, largest, place, width, none = np.zeros((2, 2, 3)), [0.0, 0.0], 0.0, 0.0, 0
    drapes = []
    for name, shape, light in scenes():
        n, _, mask = grid(shape)
        counts = mask & (n[..., 2] > (COSINE if light[2] > 0 else COSINE_BACK)) & (n @ light * math.copysign(1, light[2]) > COSINE)
        a, b = want[name][counts].mean(0), got[name][counts].mean(0)
        if shape == "drape":
            drapes.append(float(np.linalg.norm(b - a) / np.linalg.norm(a)))
        elif shape == "ball":
            behind = int(light[2] < 0)
            sums[behind] += (a, b)
            largest[behind] = max(largest[behind], float(np.linalg.norm(b - a) / np.linalg.norm(a)))
        else:
            of_cloth = streak(row(want[name], shape, light))
            if of_cloth is None:
                none += 1
                continue
            of_program = streak(row(got[name], shape, light)) or (1e3, 0.0)
            place = max(place, abs(of_program[0] - of_cloth[0]))
            width = max(width, abs(of_program[1] / of_cloth[1] - 1))
    for behind, (where, limit) in enumerate((("in front", LIMITS["color"]), ("behind", LIMITS["transmission"]))):
        off = float(np.linalg.norm(sums[behind, 1] - sums[behind, 0]) / np.linalg.norm(sums[behind, 0]))
        note(cloth, program, f"color of a ball, mean of five lights {where}: relative difference", off, limit)
        note(cloth, program, f"the same, of the light {where} that is farthest off", largest[behind], limit)
        note(cloth, program, f"color of a drape, light {where}: relative difference", drapes[behind], limit)
    if none < 2 * len(FOLD):
        note(cloth, program, "place of the streak of a fold: largest difference [degrees]", place, LIMITS["place"])
        note(cloth, program, "width of the streak: largest relative difference", width, LIMITS["width"])


PROGRAMS = {"cycles": ("blender", "py", "Cycles"), "three": ("gltf", "glb", "three.js"), "mitsuba": ("mitsuba", "xml", "Mitsuba")}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cloths", nargs="*", type=Path)
    parser.add_argument("--plywave", default=ROOT / "target/release/plywave")
    parser.add_argument("--keep", type=Path, help="folder of exports and pictures")
    parser.add_argument("--only", nargs="*", default=list(PROGRAMS))
    parser.add_argument("--modules", default=ROOT / "viewer/node_modules", help="node_modules with three and playwright-core")
    parser.add_argument("--samples", type=int, default=64, help="samples of a pixel in Cycles and Mitsuba")
    parser.add_argument("--page", type=Path, help="JPEG of pairs")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        job = json.loads(args.child)
        return {"cycles": cycles, "three": three, "mitsuba": mitsuba}[job["program"]](job)
    specs = args.cloths or [ROOT / f"fabrics/cloths/{name}.toml" for name in CLOTHS]
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.keep or Path(scratch)
        pairs = []
        for spec in specs:
            cloth = spec.stem
            of = folder / cloth
            of.mkdir(parents=True, exist_ok=True)
            want = ours(str(spec))
            np.savez_compressed(of / "ours.npz", **want)
            shown = {"plywave": want}
            for program in args.only:
                to, ending, title = PROGRAMS[program]
                path = of / f"{cloth}_{to}.{ending}"
                subprocess.run([args.plywave, "export", spec, "--to", to, "-o", path, "--quiet", "--threads", "2", "--force"], check=True)
                out = of / program
                out.mkdir(exist_ok=True)
                job = {"program": program, "file": str(path.resolve()), "folder": str(out.resolve()), "samples": args.samples, "modules": str(Path(args.modules).resolve())}
                run = subprocess.run([sys.executable, __file__, "--child", json.dumps(job)], stdout=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": ""})
                if run.returncode:
                    print(f"skipped: {title} did not render {path}", file=sys.stderr)
                    continue
                got = {name: np.load(out / f"{name}.npy") for name, _, _ in scenes()}
                compare(cloth, title, want, got)
                shown[title] = got
            pairs.append((cloth, shown))
        if args.page:
            page(pairs, args.page)
    print("\n".join(f"beyond the limit: {row}" for row in failed), file=sys.stderr)
    return int(bool(failed))


def page(pairs, path):
    """Writes pictures of ball and folds, with light in front and behind: a cloth's programs side by side."""
    from PIL import Image, ImageDraw

    names = ("ball_front1", "fold_warp-50", "fold_weft-50", "drape_front", "drape_back")
    tiles = [(cloth, program, pictures) for cloth, shown in pairs for program, pictures in shown.items()]
    sheet = Image.new("RGB", (len(names) * (SIDE + 4) + 90, len(tiles) * (SIDE + 4)), "white")
    draw = ImageDraw.Draw(sheet)
    for y, (cloth, program, pictures) in enumerate(tiles):
        own = dict(pairs)[cloth]["plywave"]
        draw.text((4, y * (SIDE + 4) + SIDE // 2), f"{cloth}\n{program}", "black")
        for x, name in enumerate(names):
            # One exposure for all programs.
            white = np.percentile(own[name], 99.5)
            v = np.clip(pictures[name] / max(white, 1e-9), 0, 1)
            v = np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
            sheet.paste(Image.fromarray((255 * v + 0.5).astype(np.uint8)), (90 + x * (SIDE + 4), y * (SIDE + 4)))
    for quality in (92, 86, 80, 70, 60):
        sheet.save(path, quality=quality)
        if path.stat().st_size < 300_000:
            break


if __name__ == "__main__":
    sys.exit(main())
