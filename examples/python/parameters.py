# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # Which parameter does what
# One yarn, and one key of its spec at a time: roughness of the fibers, twist, number of fibers,
# absorption. Each cell says what to expect, and shows it.
#
# `python examples/python/parameters.py -o FOLDER` runs all cells, in some minutes on two cores.

# %%
import argparse
import copy
import pathlib

import matplotlib.pyplot as plt
import numpy as np

import plywave

parser = argparse.ArgumentParser()
parser.add_argument("-o", "--output", type=pathlib.Path, default=pathlib.Path("."), help="folder for the figures")
folder = parser.parse_known_args()[0].output
folder.mkdir(parents=True, exist_ok=True)

BASE = {
    "name": "yarn",
    "fiber": {"shape": {"kind": "circle", "radius_um": 7.5}, "size_jitter": 0.03, "eta": 1.55, "alpha_fiber": 0.15},
    "ply": {"fibers": 30, "radius_um": 50.0, "fiber_pitch_um": 2500.0},
}
SIGMA = [0.0, 0.003, 0.02]
BUILT = {}


def made(section, key, value):
    """The model of the yarn with one key changed."""
    spec = copy.deepcopy(BASE)
    spec[section][key] = value
    if key == "fibers":
        # As densely packed: the ply's area follows.
        spec["ply"]["radius_um"] = 50.0 * np.sqrt(value / 30)
    if str(spec) not in BUILT:
        BUILT[str(spec)] = plywave.build(spec, "preview", paths=20_000)
    return BUILT[str(spec)]


def directions(theta, phi):
    """Unit vectors at latitudes and azimuths [rad]; the ply's axis is z."""
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)], -1)


# %% [markdown]
# ## Roughness of the fibers: how wide the highlight is
# `alpha_fiber` is the GGX roughness of a fiber's surface. The highlight of light at latitude theta_i lies
# about the latitude -theta_i. A rougher fiber spreads it in latitude.

# %%
theta_i = np.radians(30.0)
theta_o = np.radians(np.linspace(-89.0, 89.0, 357))
figure, axes = plt.subplots(1, 3, figsize=(15, 4))
widths = []
for alpha in (0.08, 0.15, 0.3):
    f = made("fiber", "alpha_fiber", alpha).eval(theta_i, 0.0, directions(theta_o, np.radians(90.0)), SIGMA)[:, 1]
    axes[0].plot(np.degrees(theta_o), f, label=f"alpha_fiber = {alpha}")
    above = theta_o[f > 0.5 * f.max()]
    widths.append(np.degrees(above.max() - above.min()))
axes[0].set(title="Roughness", xlabel="theta_o [deg]", ylabel="f [1/sr]")
axes[0].legend()
print("full width at half of the highlight [deg]:", np.round(widths, 1))

# %% [markdown]
# ## Twist: where the highlight goes
# Fibers on the ply's surface lean by atan(2 pi R / pitch). Light sees leaning fibers: on the left of the
# ply they lean one way, on the right the other, so that the highlight moves with h. Without twist all of
# it
# stays at -theta_i.

# %%
for pitch in (10_000.0, 2500.0, 1000.0):
    model = made("ply", "fiber_pitch_um", pitch)
    lean = np.degrees(np.arctan(2.0 * np.pi * 50.0 / pitch))
    peaks = []
    for h in (-0.7, 0.0, 0.7):
        # Beside the ply's middle, the surface faces the side.
        phi = np.pi / 2 - np.arcsin(h)
        f = model.eval(theta_i, 50.0 * h, directions(theta_o, phi), SIGMA)[:, 2]
        peaks.append(np.degrees(theta_o[f.argmax()]))
    axes[1].plot([-0.7, 0.0, 0.7], peaks, "o-", label=f"pitch {pitch:.0f} um, lean {lean:.0f} deg")
axes[1].set(title="Twist", xlabel="h/R", ylabel="latitude of the highlight [deg]")
axes[1].legend()

# %% [markdown]
# ## Number of fibers and absorption: how dark a color is
# A beam passes more fibers in a thick ply, so that the same absorption makes it darker. Absorption acts
# along the path within fibers: their radius counts, too.

# %%
sigma = np.geomspace(1e-4, 0.1, 30)
for fibers in (12, 30, 60):
    model = made("ply", "fibers", fibers)
    axes[2].semilogx(sigma, model.albedo(theta_i, 0.0, sigma[:, None])[:, 0], label=f"{fibers} fibers")
axes[2].set(title="Fibers and absorption", xlabel="sigma [1/um]", ylabel="albedo at h = 0")
axes[2].legend()
figure.tight_layout()
figure.savefig(folder / "parameters.png", dpi=80)
