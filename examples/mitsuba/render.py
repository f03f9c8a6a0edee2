"""Pictures by Mitsuba 3: a satin drape, back-lit organza, a hopsack from near by, loops of explicit yarns, a strand of plies, a lock of hairs.

    pip install "./python[mitsuba]"
    python examples/mitsuba/render.py satin_drape --width 1280 --spp 64 -o satin_drape.png
"""

import argparse
import pathlib
import sys
import tempfile
import time

import mitsuba as mi
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
FABRICS = HERE.parents[1] / "fabrics"
#: Cloth specs. A cloth is made when it is first rendered, in up to a minute, and kept.
CLOTHS = FABRICS / "cloths"


def base(origin, target, up, fov, width, height, spp, depth, distance=None):
    T = mi.ScalarTransform4f()
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth},
        "sensor": {
            "type": "perspective",
            "fov": fov,
            "to_world": T.look_at(origin, target, up),
            "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "gaussian"}},
            "sampler": {"type": "independent", "sample_count": spp},
        },
    }


def lamp(at, radius, radiance):
    return {"type": "sphere", "center": at, "radius": radius, "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}}}


def satin_drape(size, folder):
    """A sheet of 60 mm that has fallen over a ball."""
    sys.path.insert(0, str(HERE))
    import drape

    drape.save(folder / "drape.ply", drape.finer(drape.fallen()))
    s = base([0.75, -1.15, 0.62], [0, 0, -0.06], [0, 0, 1], 33, *size, 6)
    s["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.45, 0.5, 0.58]}}
    s["lamp"] = lamp([-1.6, -1.2, 2.2], 0.3, [75, 70, 62])
    s["floor"] = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0, drape.FLOOR]).scale(8.0),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.35, 0.34, 0.33]}},
    }
    cloth = {"type": "plywave_cloth", "filename": str(CLOTHS / "satin.toml"), "um_per_uv": 60_000.0}
    s["cloth"] = {"type": "ply", "filename": str(folder / "drape.ply"), "bsdf": cloth}
    return s


def sheet(folder, waves, side=256):
    """A square of width 2 with gentle waves, with uv."""
    sys.path.insert(0, str(HERE))
    import drape

    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    z = waves * (np.sin(2.6 * x + 0.7 * y) + 0.5 * np.sin(4.1 * x - 1.3 * y + 1.0))
    drape.save(folder / "sheet.ply", np.stack([x, y, z], -1))
    return str(folder / "sheet.ply")


def organza_backlit(size, folder):
    """12 mm of silk organza between the camera and a lamp."""
    s = base([0.5, -0.8, 2.6], [0, 0.05, 0], [0, 1, 0], 32, *size, 8)
    s["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.05, 0.055, 0.07]}}
    s["lamp"] = lamp([-0.9, 0.8, -3.0], 0.4, [14, 12.5, 10])
    s["front"] = lamp([3.0, 2.0, 4.0], 0.3, [6, 6, 6])
    cloth = {"type": "plywave_cloth", "filename": str(CLOTHS / "organza.toml"), "um_per_uv": 12_000.0}
    s["cloth"] = {"type": "ply", "filename": sheet(folder, 0.12), "bsdf": cloth}
    return s


def hopsack_close(size, folder):
    """8 mm of a woollen hopsack."""
    s = base([0.0, -1.5, 1.6], [0, 0.0, 0], [0, 0, 1], 40, *size, 6)
    s["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.25, 0.27, 0.3]}}
    s["lamp"] = lamp([-2.0, 1.0, 1.6], 0.25, [30, 28, 25])
    cloth = {"type": "plywave_cloth", "filename": str(CLOTHS / "hopsack.toml"), "um_per_uv": 8_000.0}
    s["cloth"] = {"type": "ply", "filename": sheet(folder, 0.03), "bsdf": cloth}
    return s


def helices(center, radius, pitch, plies, turn=0.0):
    """Plies about a curve ``[n, 3]``: by parallel transport of a frame along it."""
    t = np.gradient(center, axis=0)
    length = np.linalg.norm(t, axis=1)
    t /= length[:, None]
    n = np.cross(t[0], [0.3, 0.2, 0.9])
    frames = []
    for v in t:
        n = n - v * (n @ v)
        n /= np.linalg.norm(n)
        frames.append((n, np.cross(v, n)))
    a, b = (np.array(f) for f in zip(*frames))
    s = np.cumsum(length)
    for k in range(plies):
        psi = (2 * np.pi * (s / pitch + k / plies) + turn)[:, None]
        yield center + radius * (np.cos(psi) * a + np.sin(psi) * b)


def write_curves(path, curves, radius):
    with open(path, "w") as file:
        for curve in curves:
            file.writelines(f"{x:.6g} {y:.6g} {z:.6g} {radius}\n" for x, y, z in curve)
            file.write("\n")
    return str(path)


def knit_swatch(size, folder):
    """Loops of wool yarns of three plies, each ply a curve."""
    rows, loops, n = 12, 11, 48
    curves, radius = [], 0.035
    for row in range(rows):
        t = np.linspace(0, 2 * np.pi * loops, n * loops)
        x = t / (2 * np.pi) + 0.28 * np.sin(2 * t)
        y = 0.62 * row - 0.62 * np.cos(t)
        z = 0.16 * np.cos(2 * t)
        center = np.stack([x, y, z], 1)
        curves += helices(center, radius * 1.16, 0.75, 3, 1.3 * row)
    middle = np.concatenate(curves).mean(0)
    curves = [(c - middle) for c in curves]
    s = base([1.0, -3.0, 7.0], [0, 0, 0], [0, 1, 0], 42, *size, 8)
    s["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.32, 0.35]}}
    s["lamp"] = lamp([-6.0, 5.0, 7.0], 0.8, [34, 31, 27])
    ply = {"type": "plywave_ply", "filename": str(FABRICS / "models" / "wool.pwm"), "sigma_per_um": {"type": "rgb", "value": [0.0016, 0.006, 0.011]}}
    s["yarns"] = {"type": "bsplinecurve", "filename": write_curves(folder / "knit.txt", curves, radius), "bsdf": ply}
    return s


def strand(size, folder):
    """A strand of 600 silk plies, as hair."""
    rng = np.random.default_rng(7)
    t = np.linspace(0, 1, 40)
    curves = []
    for _ in range(600):
        a, r = rng.uniform(0, 2 * np.pi), 0.32 * np.sqrt(rng.uniform())
        fan = 1.0 + 0.9 * t
        x = r * np.cos(a) * fan + 0.55 * np.sin(3.2 * t) + 0.05 * np.sin(9 * t + rng.uniform(0, 6))
        y = r * np.sin(a) * fan + 0.05 * np.cos(8 * t + rng.uniform(0, 6))
        curves.append(np.stack([x, y, 1.4 - 2.8 * t], 1))
    s = base([0.4, -5.0, 0.4], [0.25, 0, 0], [0, 0, 1], 36, *size, 10)
    s["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.15, 0.17, 0.2]}}
    s["lamp"] = lamp([-3.0, -3.0, 3.0], 0.5, [34, 32, 28])
    s["rim"] = lamp([3.0, 3.0, 1.5], 0.4, [40, 42, 48])
    ply = {"type": "plywave_ply", "filename": str(FABRICS / "models" / "silk.pwm"), "sigma_per_um": {"type": "rgb", "value": [0.003, 0.008, 0.02]}}
    s["hair"] = {"type": "bsplinecurve", "filename": write_curves(folder / "strand.txt", curves, 0.012), "bsdf": ply}
    return s


#: Semi-axes of a hair's section [um], and its absorption [1/um] by wavelength [um]: light brown, half of that
#: of fabrics/strands/hair_ball.toml.
HAIR, BROWN = (38.0, 29.0), [(0.40, 0.010), (0.45, 0.007), (0.55, 0.0033), (0.65, 0.0018), (0.70, 0.0014)]
HAIR_SPEC = """
name = "hair"

[fiber]
shape = {{ kind = "ellipse", a_um = {}, b_um = {} }}
eta = 1.55
alpha_fiber = 0.0

[ply]
fibers = 4
radius_um = 200.0
"""


def hair_table(path):
    """A hair by rays: its table at three wavelengths, of an absorption each."""
    import plywave

    lambdas = np.linspace(0.464, 0.612, 3)
    sigmas = np.interp(lambdas, *np.transpose(BROWN))
    fibers = [plywave.wave.tabulate(HAIR_SPEC.format(*HAIR), "preview", rays=True, sigma_per_um=sigma, thetas=30, azimuths=36, ray_count=4000, beta_m_rad=0.12) for sigma in sigmas]
    tables = [fiber.tensors() for fiber in fibers]
    tensors = dict(tables[0], lambda_um=lambdas)
    tensors |= {key: np.concatenate([table[key] for table in tables]) for key in ("c_x_um", "c_abs_um", "azimuthal")}
    plywave.Fiber.from_tensors(tensors, fibers[0].document).save(path)
    return str(path)


def fibers(size, folder):
    """Locks of 7000 brown hairs over a roll 4 cm thick, in cm: every hair a curve, as wide as it is."""
    rng, count, roll, n, locks_ = np.random.default_rng(3), 7000, 2.0, 48, 26
    x, depth = rng.uniform(-2.6, 2.6, count), 0.12 * rng.random(count)
    locks = np.linspace(-2.5, 2.5, locks_) + rng.uniform(-0.08, 0.08, locks_)
    lock = np.abs(x[:, None] - locks).argmin(1)
    phase, lean = rng.uniform(0, 2 * np.pi, (2, locks_)), rng.normal(0, 0.12, locks_)
    along = np.linspace(-2.9, rng.normal(3.6, 0.18, locks_)[lock] + rng.normal(0, 0.1, count), n).T
    # Down from the roll hairs draw near to their lock, which sways; a hair strays.
    below = np.maximum(along, 0.0)
    draws = 0.5 * np.clip(below / 3.6, 0, 1) ** 1.5
    sway = lean[lock, None] * (below / 3.0) ** 2 + 0.04 * below * np.sin(1.6 * below + phase[0][lock, None])
    turn, wave = rng.uniform(0, 2 * np.pi, (2, count, 1)), rng.uniform(0.7, 2.2, (2, count, 1))
    stray = 0.012 * (1 + below) * np.sin(wave * along + turn)
    across = x[:, None] + draws * (locks[lock] - x)[:, None] + sway + stray[0]
    out = roll + 0.03 + depth[:, None] * (1 + 0.4 * below) + 0.05 * below * np.sin(1.3 * below + phase[1][lock, None]) + 0.03 + stray[1]
    angle = np.minimum(along, 0.0) / roll
    curves = np.stack([across, -out * np.cos(angle), -np.maximum(along, 0.0) - out * np.sin(angle)], -1)
    s = base([1.5, -17.0, 2.5], [0.0, -1.5, -0.85], [0, 0, 1], 25, *size, 12)
    s["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.05, 0.055, 0.065]}}
    s["lamp"] = lamp([-6.0, -13.0, 12.0], 2.5, [42, 39, 35])
    s["fill"] = lamp([9.0, -14.0, -5.0], 3.0, [14, 13.5, 12.5])
    s["rim"] = lamp([9.0, 9.0, 3.0], 2.0, [36, 37, 40])
    cylinder = {"type": "cylinder", "p0": [-2.5, 0, 0], "p1": [2.5, 0, 0], "radius": roll}
    s["roll"] = cylinder | {"bsdf": {"type": "twosided", "material": {"type": "diffuse", "reflectance": 0.04}}}
    filename = hair_table(folder / "hair.pwf")
    # Sections turned four ways about their hairs.
    for k in range(4):
        bsdf = {"type": "plywave_fiber", "filename": filename, "rotation_deg": 45.0 * k}
        s[f"hair{k}"] = {"type": "bsplinecurve", "filename": write_curves(folder / f"hair{k}.txt", curves[k::4], 1e-4 * HAIR[0]), "bsdf": bsdf}
    return s


SCENES = {f.__name__: f for f in (satin_drape, organza_backlit, hopsack_close, knit_swatch, strand, fibers)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=0, help="default: 5/8 of the width")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--passes", type=int, default=1, help="renders of --spp samples that are averaged: less memory")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("-o", "--output", default=None)
    args = parser.parse_args()
    mi.set_variant(args.variant)
    import plywave.mitsuba

    with tempfile.TemporaryDirectory() as folder:
        size = (args.width, args.height or args.width * 5 // 8, args.spp)
        scene = mi.load_dict(SCENES[args.scene](size, pathlib.Path(folder)))
    plywave.mitsuba.check(scene)
    output = args.output or f"{args.scene}.png"
    begun, image = time.time(), 0.0
    # Written after each pass, so that it can be stopped.
    for seed in range(args.passes):
        image = image + np.array(mi.render(scene, spp=args.spp, seed=seed))
        mi.util.write_bitmap(output, mi.TensorXf((image / (seed + 1)).astype(np.float32)), write_async=False)
        print(f"{output}: {args.width} x {size[1]}, {args.spp * (seed + 1)} samples, {time.time() - begun:.1f} s", flush=True)


if __name__ == "__main__":
    main()
