"""Processor time of the plugins, of Mitsuba's `principled` and `hair`, on one scene.

    python python/tests/speed_mitsuba.py [VARIANT [NAME,..]]
"""

import pathlib
import sys
import time

import drjit as dr
import mitsuba as mi

FABRICS = pathlib.Path(__file__).resolve().parents[2] / "fabrics"
SIZE, SAMPLES = 128, 16

BSDFS = {
    **{name: {"type": "plywave_cloth", "filename": str(FABRICS / "cloths" / f"{name}.toml"), "um_per_uv": 2e4} for name in ("satin", "jersey", "hopsack")},
    "ply": {"type": "plywave_ply", "filename": str(FABRICS / "models" / "polyester.pwm"), "sigma_per_um": 0.003},
    "principled": {"type": "principled", "roughness": 0.3, "anisotropic": 0.5, "spec_tint": 0.2},
    "hair": {"type": "hair"},
}


def scene(bsdf):
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4},
            "sensor": {
                "type": "perspective",
                "fov": 30,
                "to_world": mi.ScalarTransform4f().look_at([0, -1.2, 2.2], [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}},
            },
            "sky": {"type": "constant", "radiance": 0.5},
            "lamp": {"type": "sphere", "center": [1, 1, 2], "radius": 0.2, "emitter": {"type": "area", "radiance": 10.0}},
            "cloth": {"type": "rectangle", "bsdf": bsdf},
        }
    )


def main():
    mi.set_variant(sys.argv[1] if len(sys.argv) > 1 else "llvm_ad_rgb")
    import plywave.mitsuba  # noqa: F401

    for name in sys.argv[2].split(",") if len(sys.argv) > 2 else BSDFS:
        of, times = scene(BSDFS[name]), []
        for seed in range(4):
            begun = time.process_time()
            dr.eval(mi.render(of, spp=SAMPLES, seed=seed))
            dr.sync_thread()
            times.append(time.process_time() - begun)
        then = min(times[1:])
        print(f"{name}: {1e6 * then / (SIZE * SIZE * SAMPLES):.2f} us a path, first picture {times[0] - then:.1f} s more")


if __name__ == "__main__":
    main()
