"""The same jersey by both hosts, `plywave render` and Mitsuba 3: one mesh, one lamp, one camera; how far the pictures' means and pixels are apart.

    cargo build --release -p plywave-cli && pip install "./python[mitsuba]"
    python examples/mitsuba/both_hosts.py --width 96 --spp 256
"""

import argparse
import math
import pathlib
import subprocess
import tempfile

import mitsuba as mi
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
#: A cloth spec, whose cloth is made once and kept.
CLOTH = ROOT / "fabrics" / "cloths" / "jersey.toml"
#: Absorption of all fibers [1/um] at all wavelengths; width of the sheet [mm]; scatterings of a path.
SIGMA, SIZE, DEPTH = 0.003, 2.0, 4


def write_mesh(path):
    """A square sheet of SIZE mm about the origin whose uv are 0 to 1."""
    half = 0.5 * SIZE
    corners = [(-half, -half, 0, 0), (half, -half, 1, 0), (half, half, 1, 1), (-half, half, 0, 1)]
    lines = [f"v {x} {y} 0" for x, y, _, _ in corners] + [f"vt {u} {v}" for *_, u, v in corners]
    path.write_text("\n".join([*lines, "vn 0 0 1", "f 1/1/1 2/2/1 3/3/1", "f 1/1/1 3/3/1 4/4/1", ""]))


def by_plywave(program, cloth, folder, width, spp, seed):
    """The linear picture of `plywave render --setup front`."""
    out = folder / f"plywave_{seed}.exr"
    command = [program, "render", cloth, "--setup", "front", "--mesh", folder / "sheet.obj", "--cloth-mm", SIZE, "--size-mm", SIZE, "--sigma", SIGMA]
    command += ["--smooth", "--without", "far", "--width", width, "--height", width, "--samples", spp, "--depth", DEPTH, "--seed", seed, "-o", out]
    subprocess.run([str(part) for part in command], check=True, capture_output=True)
    layers = dict(mi.Bitmap(str(out)).split())
    root = layers.get("<root>") or next(iter(layers.values()))
    return np.array(root, np.float64)[..., :3]


def scene(cloth, folder, width):
    """The setup `front` of render/src/setup.rs."""
    T = mi.ScalarTransform4f
    place, side = np.array([-1.2, 0.9, 3.2]) * SIZE, 0.25 * SIZE
    n = -place / np.linalg.norm(place)
    # The lamp's edges as glam's any_orthonormal_vector has them.
    sign = math.copysign(1.0, n[2])
    a = -1.0 / (sign + n[2])
    across = np.array([n[0] * n[1] * a, sign + n[1] * n[1] * a, -n[1]])
    matrix = np.eye(4)
    matrix[:3, :] = np.stack([0.5 * side * across, 0.5 * side * np.cross(n, across), n, place], 1)
    radiance = math.pi * float(place @ place) / side**2
    bsdf = {"type": "plywave_cloth", "filename": str(cloth), "um_per_uv": 1000.0 * SIZE, "sigma_per_um": SIGMA, "footprint_rad": 2.0 * math.tan(0.5 * 0.27) / width}
    film = {"type": "hdrfilm", "width": width, "height": width, "rfilter": {"type": "box"}}
    camera = T().look_at([0, -1.5 * SIZE, 2.0 * SIZE], [0, 0, 0], [0, 1, 0])
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": DEPTH + 1, "rr_depth": 100},
            "sensor": {"type": "perspective", "fov": math.degrees(0.27), "fov_axis": "y", "to_world": camera, "film": film},
            "lamp": {"type": "rectangle", "to_world": T(matrix), "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}}},
            # Mitsuba turns v of an OBJ round by itself, which mirrors the pattern.
            "sheet": {"type": "obj", "filename": str(folder / "sheet.obj"), "face_normals": True, "flip_tex_coords": False, "bsdf": bsdf},
        }
    )


def compare(program, cloth, width, spp):
    """Of a cloth's file or spec: ratio of the means by channel; the mean squared difference of pixels between the hosts over that of two renders of one host, 1 where they differ by noise alone; the pictures."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        write_mesh(folder / "sheet.obj")
        a = [by_plywave(program, cloth, folder, width, spp, seed) for seed in (1, 2)]
        sheet = scene(cloth, folder, width)
        b = [np.array(mi.render(sheet, spp=spp, seed=seed), np.float64)[..., :3] for seed in (1, 2)]
    means = np.mean(b, (0, 1, 2)) / np.mean(a, (0, 1, 2))
    between = np.mean([(x - y) ** 2 for x in a for y in b])
    within = np.mean([(a[0] - a[1]) ** 2, (b[0] - b[1]) ** 2])
    return means, between / within, a, b


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plywave", default=str(ROOT / "target" / "release" / "plywave"))
    parser.add_argument("--width", type=int, default=96)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args()
    mi.set_variant(args.variant)
    import plywave.mitsuba  # noqa: F401  (registers the plugin)

    means, squares, a, b = compare(args.plywave, CLOTH, args.width, args.spp)
    print("means of Mitsuba's picture over plywave's, by channel:", np.round(means, 4))
    noise = np.sqrt(np.mean((a[0] - a[1]) ** 2) / 2) / np.mean(a), np.sqrt(np.mean((b[0] - b[1]) ** 2) / 2) / np.mean(b)
    print(f"noise of a pixel over the mean: plywave {noise[0]:.4f}, Mitsuba {noise[1]:.4f}")
    print(f"squared difference of pixels between the hosts over that within: {squares:.3f}")


if __name__ == "__main__":
    main()
