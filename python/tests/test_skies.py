"""Lamps and skies of `plywave render` against Mitsuba's: a ball on a floor, both diffuse, under a lamp and a sky from a file, pixel block by pixel block within their noise.

Both hosts take the sky's texels as linear sRGB, so that colors on gray things agree too. Directions: Mitsuba's sky has y up, ours z; the middle column lies along x.
"""

import subprocess

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba")

SIDE, BLOCK, SAMPLES = 32, 4, 400

SCENE = """
name = "ball on a floor"
floor = {{ height_mm = 0.0, albedo = 0.35 }}
ball = {{ center_mm = [0.0, 0.0, 5.0], radius_mm = 5.0, albedo = 0.6 }}

[strands] # one, hidden below the floor
file = "strand.txt"
basis = "linear"
radius_um = 40.0

[fiber]
model = {{ kind = "dielectric" }}

[camera]
from_mm = [12.0, -60.0, 30.0]
to_mm = [0.0, 0.0, 4.0]
fov_deg = 20.0
{lamps}"""

LAMP = """
[[lamps]]
from_mm = [-20.0, -10.0, 30.0]
to_mm = [0.0, 0.0, 0.0]
size_mm = 10.0
radiance = {}
"""


def sky_of(texels):
    """A picture whose texels are so large that Mitsuba's interpolation between them does not count."""
    return np.repeat(np.repeat(np.asarray(texels, np.float32), 32, axis=0), 32, axis=1)


def of_mitsuba(sky, radiance):
    """Linear sRGB and its variance, `[y][x][3]`."""
    t = mi.ScalarTransform4f
    gray = lambda v: {"type": "diffuse", "reflectance": {"type": "rgb", "value": v}}  # noqa: E731
    scene = {
        "type": "scene",
        "integrator": {"type": "moment", "nested": {"type": "path", "max_depth": 65}},
        "sensor": {
            "type": "perspective", "fov": 20.0, "fov_axis": "y",
            "to_world": t().look_at(origin=[12, -60, 30], target=[0, 0, 4], up=[0, 0, 1]),
            "film": {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": SAMPLES},
        },
        "floor": {"type": "rectangle", "to_world": t().scale([1e4, 1e4, 1.0]), "bsdf": gray(0.35)},
        "ball": {"type": "sphere", "center": [0, 0, 5], "radius": 5.0, "bsdf": gray(0.6)},
        "sky": {
            "type": "envmap", "bitmap": mi.Bitmap(sky),
            "to_world": t([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
        },
    }
    if radiance:
        scene["lamp"] = {
            "type": "rectangle", "to_world": t().look_at(origin=[-20, -10, 30], target=[0, 0, 0], up=[0, 0, 1]).scale([5, 5, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
        }
    image = np.array(mi.render(mi.load_dict(scene), seed=3))
    channels = image.shape[2] // 2
    mean, square = image[..., :3], image[..., channels:channels + 3]
    return mean, np.maximum(square - mean**2, 0) / (SAMPLES - 1)


def of_host(program, folder, file, radiance):
    folder.joinpath("scene.toml").write_text(SCENE.format(lamps=LAMP.format(radiance) if radiance else ""))
    folder.joinpath("strand.txt").write_text("-1 0 -5 0.04\n1 0 -5 0.04\n")
    size = [str(SIDE)] * 2
    command = [program, "render", "scene.toml", "--sky", file, "--width", size[0], "--height", size[1], "--samples", str(SAMPLES), "-o", "out.exr", "--quiet"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    layers = dict(mi.Bitmap(str(folder / "out.exr")).split())
    return np.array(layers["<root>"])[..., :3], np.array(layers["variance"])[..., :3]


def blocks(image):
    n = SIDE // BLOCK
    return image.reshape(n, BLOCK, n, BLOCK, 3).mean(axis=(1, 3))


# Even gray; a blue sky with a yellow sun in one texel to the left of the camera; one color; a dim sky beside
# a lamp.
SUN = np.full((4, 8, 3), [0.02, 0.05, 0.2])
SUN[1, 1] = [9.0, 6.0, 1.0]
SKIES = {
    "even": (np.full((4, 8, 3), 0.1), 0.0, "sky.exr"),
    "sun": (SUN, 0.0, "sky.exr"),
    "sun of Radiance": (SUN, 0.0, "sky.hdr"),
    "blue": (np.full((4, 8, 3), [0.0, 0.0, 40.0]), 0.0, "sky.exr"),
    "lamp": (0.1 * SUN, 6.0, "sky.exr"),
}


@pytest.mark.parametrize("name", SKIES)
def test_balls_are_lit_as_by_mitsuba(name, program, tmp_path):
    before = mi.variant()
    mi.set_variant("scalar_rgb")
    try:
        texels, radiance, file = SKIES[name]
        sky = sky_of(texels)
        mi.Bitmap(sky).write(str(tmp_path / file))
        (a, a_variance), (b, b_variance) = of_mitsuba(sky, radiance), of_host(program, tmp_path, file, radiance)
    finally:
        if before:
            mi.set_variant(before)
    spread = np.sqrt(blocks(a_variance) + blocks(b_variance)) / BLOCK
    off = np.abs(blocks(a) - blocks(b))
    # Five standard errors; the rest is the eight bits of Radiance, and the difference of the hosts' sums of
    # the spectrum.
    allowed = 5 * spread + (4e-3 if file.endswith("hdr") else 5e-4) * blocks(a).max()
    assert (off <= allowed).all(), f"{name}: {(off / allowed).max()} of what noise explains, at {np.argwhere(off > allowed)[:5].tolist()}"
    assert spread.mean() < 0.04 * blocks(a).max(), f"{name}: noise hides what is wrong"
