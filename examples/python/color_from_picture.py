# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # Color and roughness from pictures
# Three pictures of a jersey under known lamps, with noise, give its color and the roughness of its
# fibers. The pictures are made here, of a yarn that the search does not have, so that the answer can be
# compared.
#
# `python examples/python/color_from_picture.py -o FOLDER` runs all cells, in some minutes on two cores.

# %%
import argparse
import pathlib

import matplotlib.pyplot as plt
import numpy as np

import plywave

parser = argparse.ArgumentParser()
parser.add_argument("-o", "--output", type=pathlib.Path, default=pathlib.Path("."), help="folder for the models and the figure")
folder = parser.parse_known_args()[0].output
folder.mkdir(parents=True, exist_ok=True)


def jersey(alpha, seed):
    """A jersey of filaments of a roughness; `seed` is that of paths and packing."""
    yarn = {
        "name": "filament yarn",
        "fiber": {"shape": {"kind": "circle", "radius_um": 7.5}, "size_jitter": 0.03, "eta": 1.60, "alpha_fiber": alpha},
        "ply": {"fibers": 30, "radius_um": 50.0, "fiber_pitch_um": 3000.0},
    }
    plywave.build(yarn, "preview", paths=80_000, seed=seed).save(folder / f"yarn_{alpha}.pwm")
    cloth = {
        "name": "filament jersey",
        "knit": {"kind": "jersey", "wales_per_cm": 23, "courses_per_cm": 33, "loop_mm": 1.63},
        "yarn": {"model": f"yarn_{alpha}.pwm", "fiber": "polyester", "count": "7.3 tex", "packing": 0.675},
    }
    return plywave.Cloth(cloth, folder=folder, sigma_per_um=0.001)


# %% [markdown]
# ## The pictures
# Seen from above, with a lamp beside the camera, at 35 and at 65 degrees. A camera adds noise: one
# percent of the mean. No color is darker than black fibers, whose surfaces still reflect: here about
# 0.19.

# %%
LAMPS = [np.array([np.sin(a), 0.0, np.cos(a)]) for a in np.radians([5.0, 35.0, 65.0])]
x_um = np.linspace(0.0, 1740.0, 64)
POSITION_UM = np.stack(np.meshgrid(x_um, x_um), -1)


def pictures(cloth):
    return np.stack([cloth.eval(POSITION_UM, [0.0, 0.0, 1.0], lamp) for lamp in LAMPS])


ALPHA, COLOR = 0.22, np.array([0.60, 0.40, 0.28])
taken = pictures(jersey(ALPHA, seed=7).with_colors(COLOR))
taken += 0.01 * taken.mean() * np.random.default_rng(1).normal(size=taken.shape)

# %% [markdown]
# ## The search
# For each roughness of a few, the color whose pictures are nearest, by golden section in each channel:
# they do not depend on each other. The remaining misfit tells the roughness. Square roots keep a few
# bright highlights from deciding all.


# %%
def rooted(pictures):
    return np.sqrt(np.maximum(pictures, 0.0))


def misfit(cloth, color):
    return np.mean((rooted(pictures(cloth.with_colors(color))) - rooted(taken)) ** 2, (0, 1, 2))


def best_color(cloth):
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    low, high = np.zeros(3), np.ones(3)
    for _ in range(12):
        step = golden * (high - low)
        is_left = misfit(cloth, high - step) < misfit(cloth, low + step)
        low, high = np.where(is_left, low, high - step), np.where(is_left, low + step, high)
    return 0.5 * (low + high)


alphas = np.array([0.12, 0.18, 0.25, 0.35])
colors, left = [], []
for alpha in alphas:
    cloth = jersey(alpha, seed=1)
    colors.append(best_color(cloth))
    left.append(np.sqrt(misfit(cloth, colors[-1]).mean()) / rooted(taken).mean())
    print(f"alpha {alpha:.2f}: color {np.round(colors[-1], 3)}, misfit {left[-1]:.4f}")
colors, left = np.array(colors), np.array(left)

# %% [markdown]
# The least of a parabola through the three best.

# %%
best = int(np.clip(left.argmin(), 1, len(alphas) - 2))
near = slice(best - 1, best + 2)
a, b, _ = np.polyfit(alphas[near], left[near] ** 2, 2)
alpha = float(np.clip(-b / (2.0 * a), alphas[near][0], alphas[near][-1]))
color = np.array([np.interp(alpha, alphas, colors[:, c]) for c in range(3)])
print(f"roughness {alpha:.3f} (made with {ALPHA}), color {np.round(color, 3)} (made with {COLOR})")
plt.plot(alphas, left, "o-")
plt.axvline(ALPHA, color="gray")
plt.xlabel("alpha_fiber")
plt.ylabel("misfit, over the mean square root")
plt.savefig(folder / "color_from_picture.png", dpi=80)
assert abs(alpha - ALPHA) < 0.04 and np.abs(color - COLOR).max() < 0.03
