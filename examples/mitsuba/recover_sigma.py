"""The absorption of a jersey's fibers from one picture of it: rendered by Mitsuba 3, recovered by gradients through the rendering.

    python examples/mitsuba/recover_sigma.py
"""

import pathlib
import time

import mitsuba as mi
import numpy as np

#: A cloth spec, whose cloth is made once and kept.
CLOTH = str(pathlib.Path(__file__).resolve().parents[2] / "fabrics" / "cloths" / "jersey.toml")
KEY = "cloth.bsdf.sigma_per_um.value"
SIZE, BLOCK = 48, 8


def scene(sigma_per_um, filename=CLOTH):
    color = {"type": "rgb", "value": [float(s) for s in sigma_per_um]}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
            "sensor": {
                "type": "perspective",
                "fov": 30,
                "to_world": mi.ScalarTransform4f().look_at([0, -1.2, 2.2], [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}},
            },
            "lamp": {"type": "point", "position": [1, 1, 2], "intensity": 3.0},
            "cloth": {
                "type": "rectangle",
                "bsdf": {"type": "plywave_cloth", "filename": filename, "um_per_uv": 2e4, "gaps": "straight", "sigma_per_um": color},
            },
        }
    )


def recover(photograph, filename=CLOTH, start=0.005, steps=60, last=15, spp=8, told=None):
    """Absorptions [1/um] of the three channels by which the cloth looks as in the photograph, the mean of the last steps."""
    import drjit as dr

    blocks = lambda x: dr.mean(dr.reshape(mi.TensorXf(x), (SIZE // BLOCK, BLOCK, SIZE // BLOCK, BLOCK, 3)), axis=(1, 3))
    rendered = scene([start] * 3, filename)
    params = mi.traverse(rendered)
    want = blocks(photograph)
    adam = mi.ad.Adam(lr=0.3)
    adam["ln_sigma"] = mi.Color3f(float(np.log(start)))
    found = []
    for step in range(steps):
        adam.set_learning_rate(0.3 * 0.05 ** (step / steps))
        sigma = dr.exp(adam["ln_sigma"])
        params[KEY] = sigma
        params.update()
        image = blocks(mi.render(rendered, params, spp=spp, seed=step))
        dr.backward(dr.mean(dr.square((image - want) / (want + 1e-3))))
        adam.step()
        found.append(np.array(adam["ln_sigma"]).ravel())
        if told:
            told(step, np.exp(found[-1]))
    return np.exp(np.mean(found[-last:], 0))


def main():
    mi.set_variant("llvm_ad_rgb")
    import plywave.mitsuba  # noqa: F401  (registers the plugins)

    truth, begun = [0.002, 0.006, 0.012], time.time()
    photograph = mi.render(scene(truth), spp=256, seed=1000)
    got = recover(photograph, told=lambda step, sigma: step % 10 == 9 and print(f"{step + 1:3d} {sigma}", flush=True))
    print(f"sigma {truth} 1/um: got {got}, off by {100 * np.max(np.abs(got / truth - 1)):.1f} %, {time.time() - begun:.0f} s")


if __name__ == "__main__":
    main()
