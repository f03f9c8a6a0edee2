# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # From a yarn to a picture
# A yarn spec becomes a ply model, a cloth spec names it, and the cloth is shaded under a lamp and a sky.
#
# Cells are for notebooks (`jupytext --to ipynb`) and editors; `python examples/python/yarn_to_picture.py
# -o FOLDER` runs them all, in a minute.

# %%
import argparse
import pathlib

import matplotlib.pyplot as plt
import numpy as np

import plywave

parser = argparse.ArgumentParser()
parser.add_argument("-o", "--output", type=pathlib.Path, default=pathlib.Path("."), help="folder for the model and the figures")
folder = parser.parse_known_args()[0].output
folder.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## The yarn
# Thirty round polyester filaments of 15 um, twisted once in 3 mm. Lengths are in um. Real fibers are
# never equal: `size_jitter` is the spread of their radius.

# %%
yarn = {
    "name": "filament yarn",
    "fiber": {"shape": {"kind": "circle", "radius_um": 7.5}, "size_jitter": 0.03, "eta": 1.60, "alpha_fiber": 0.2},
    "ply": {"fibers": 30, "radius_um": 50.0, "fiber_pitch_um": 3000.0},
}
model = plywave.build(yarn, "preview", paths=200_000, progress=True)
model.save(folder / "yarn.pwm")
print(model)
print(plywave.check(model, incidences=4))

# %% [markdown]
# Beside the model's lobes, the table of paths that it was fitted to.

# %%
plywave.plot(model, table=model.table).savefig(folder / "yarn.png", dpi=60)

# %% [markdown]
# Light of three colors that meets the yarn at 30 degrees, over a circle of outgoing directions across it.
# Fibers have no color: absorption makes it.

# %%
phi = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
w = np.stack([np.cos(phi), np.sin(phi), np.zeros_like(phi)], -1)
f = model.eval(np.radians(30.0), 5.0, w, [0.001, 0.004, 0.010])
print("brightest azimuth [deg]:", np.degrees(phi[f[:, 0].argmax()]), "red over blue there:", f[f[:, 0].argmax(), 0] / f[f[:, 0].argmax(), 2])

# %% [markdown]
# ## The cloth
# A jersey in a knitter's units. The yarn's count is that of its fibers: 30 of 177 um2, of 1.38 g/cm3, are
# 7.3 tex. The cloth is made once, in some seconds, and kept in a cache.

# %%
jersey = plywave.Cloth(
    {
        "name": "filament jersey",
        "knit": {"kind": "jersey", "wales_per_cm": 23, "courses_per_cm": 33, "loop_mm": 1.63},
        "yarn": {"model": "yarn.pwm", "fiber": "polyester", "count": "7.3 tex", "packing": 0.675, "color": [0.12, 0.30, 0.55]},
    },
    folder=folder,
    progress=True,
)
print(jersey)

# %% [markdown]
# ## The picture
# Two millimeters from above, by a lamp and by an even sky of 24 directions. `eval` has the cosine in it;
# a lamp of irradiance E adds E f.

# %%
x_um = np.linspace(0.0, 2000.0, 320)
position_um = np.stack(np.meshgrid(x_um, x_um), -1)
up = [0.0, 0.0, 1.0]
picture = 2.0 * jersey.eval(position_um, up, [0.6, 0.3, 0.74])
golden = np.pi * (3.0 - np.sqrt(5.0))
for k in range(24):
    z = (k + 0.5) / 24
    s = np.sqrt(1.0 - z * z)
    picture += 2.0 * np.pi / 24 * 0.4 * jersey.eval(position_um, up, [s * np.cos(golden * k), s * np.sin(golden * k), z])
print("mean radiance, linear sRGB:", picture.mean((0, 1)))
srgb = np.where(picture <= 0.0031308, 12.92 * picture, 1.055 * np.maximum(picture, 1e-9) ** (1 / 2.4) - 0.055)
plt.imsave(folder / "jersey.png", np.clip(srgb, 0.0, 1.0), origin="lower")
