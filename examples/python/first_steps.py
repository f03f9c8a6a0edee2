# %% [markdown]
# From a yarn to a picture of its light: build, check, plot, evaluate. Cells are for notebooks and editors;
# `python examples/python/first_steps.py` runs them all.

# %%
import argparse
import pathlib

import numpy as np

import plywave

parser = argparse.ArgumentParser()
parser.add_argument("-o", "--output", type=pathlib.Path, default=pathlib.Path("."), help="folder for the model and the figures")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)
fabrics = pathlib.Path(__file__).resolve().parents[2] / "fabrics"

# %% [markdown]
# A spec can be changed as text. Fewer fibers and paths than the polyester that ships: this takes seconds.

# %%
spec = (fabrics / "polyester.toml").read_text()
spec += "\n[simulation]\npaths_per_theta = 20000\ntheta_i_nodes = 5\nh_nodes = 7\n" if "[simulation]" not in spec else ""
model = plywave.build(spec, "preview", progress=True)
model.save(folder / "yarn.pwm")
print(model)

# %%
print(plywave.check(model, incidences=4))

# %%
plywave.plot(model, table=model.table).savefig(folder / "yarn.png", dpi=60)

# %% [markdown]
# Light of three colors that meets the yarn at 30 degrees, over a circle of outgoing directions across it.

# %%
phi = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
w = np.stack([np.cos(phi), np.sin(phi), np.zeros_like(phi)], -1)
f = model.eval(np.radians(30.0), 5.0, w, [0.001, 0.004, 0.010])
print("brightest azimuth [deg]:", np.degrees(phi[f[:, 0].argmax()]), "red over blue there:", f[f[:, 0].argmax(), 0] / f[f[:, 0].argmax(), 2])

# %% [markdown]
# A jersey, seen from above under a lamp: an image of 200 x 200 points. The cloth of a spec is made once, in
# some seconds, and kept.

# %%
jersey = plywave.Cloth(fabrics / "cloths" / "jersey.toml", progress=True)
x = np.linspace(0.0, 2000.0, 200)
position = np.stack(np.meshgrid(x, x), -1)
rgb = jersey.eval(position, [0.0, 0.0, 1.0], [0.5, 0.3, 0.81])
print("mean f of the jersey [1/sr], linear sRGB:", rgb.mean((0, 1)))
