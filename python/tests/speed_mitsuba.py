"""Processor time of the plugins, of Mitsuba's `principled` and `hair`, on a plane of 128 x 128 pixels and on a ball of 640 x 400, each with a sky and a lamp.

    python python/tests/speed_mitsuba.py [VARIANT [NAME,.. [plane|ball]]]

A NAME ends in `.dr` for a cloth with `native` off. Cloths are those of their specs, or of files that end in `.pwc`.
"""

import pathlib
import sys
import time

import drjit as dr
import mitsuba as mi

FABRICS = pathlib.Path(__file__).resolve().parents[2] / "fabrics"
SAMPLES = 16

BSDFS = {
    "ply": {"type": "plywave_ply", "filename": str(FABRICS / "models" / "polyester.pwm"), "sigma_per_um": 0.003},
    "principled": {"type": "principled", "roughness": 0.3, "anisotropic": 0.5, "spec_tint": 0.2},
    "hair": {"type": "hair"},
}
NAMES = ["satin", "jersey", "hopsack", "satin.dr", "jersey.dr", *BSDFS]


def bsdf(name):
    if name in BSDFS:
        return BSDFS[name]
    cloth = name.removesuffix(".dr")
    return {
        "type": "plywave_cloth",
        "filename": cloth if cloth.endswith(".pwc") else str(FABRICS / "cloths" / f"{cloth}.toml"),
        "um_per_uv": 2e4,
        "native": not name.endswith(".dr"),
    }


def scene(name, shape):
    width, height = (128, 128) if shape == "plane" else (640, 400)
    eye, lamp = ([0, -1.2, 2.2], [1, 1, 2]) if shape == "plane" else ([0, -4.5, 1.5], [1.5, -2, 2.5])
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4},
            "sensor": {
                "type": "perspective",
                "fov": 30,
                "fov_axis": "smaller",
                "to_world": mi.ScalarTransform4f().look_at(eye, [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
            },
            "sky": {"type": "constant", "radiance": 0.5},
            "lamp": {"type": "sphere", "center": lamp, "radius": 0.2, "emitter": {"type": "area", "radiance": 10.0}},
            "cloth": {"type": "rectangle" if shape == "plane" else "sphere", "bsdf": bsdf(name)},
        }
    )


def main():
    mi.set_variant(sys.argv[1] if len(sys.argv) > 1 else "llvm_ad_rgb")
    import plywave.mitsuba  # noqa: F401

    for shape in sys.argv[3:] or ("plane", "ball"):
        for name in sys.argv[2].split(",") if len(sys.argv) > 2 else NAMES:
            begun = time.process_time()
            of, times, walls = scene(name, shape), [], []
            loaded = time.process_time() - begun
            size = of.sensors()[0].film().size()
            # A second picture of a ball by Dr.Jit takes a minute.
            for seed in range(4 if shape == "plane" or not name.endswith(".dr") else 2):
                begun, clock = time.process_time(), time.perf_counter()
                dr.eval(mi.render(of, spp=SAMPLES, seed=seed))
                dr.sync_thread()
                times.append(time.process_time() - begun)
                walls.append(time.perf_counter() - clock)
            then, wall = min(times[1:]), min(walls[1:])
            print(
                f"{shape}, {name}: {1e6 * then / (size[0] * size[1] * SAMPLES):.3f} us a path, a picture {then:.2f} s on the processor, {wall:.2f} s by the clock, "
                f"first picture {times[0] - then:.1f} s more on the processor, {walls[0] - wall:.1f} s by the clock, loading {loaded:.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
