"""Writes scipy_lbfgsb.json: what SciPy's L-BFGS-B does on problems of More, Garbow, Hillstrom (ACM TOMS 7, 1981).

    python3 fit/tests/data/scipy_lbfgsb.py

Each problem is a sum of squared residuals, run from its standard start in seven settings: no bounds; a box that holds start and
minimum; the same box with the minimum cut off in every second variable; that box from an infeasible start; one bound a variable,
through the start or the minimum; the first variable fixed; a start at a vertex of its box. Gradients are complex-step derivatives, exact to rounding. `null` stands for no bound.
"""

import json
import pathlib

import numpy as np
import scipy
from scipy.optimize import minimize

OPTIONS = {"maxcor": 10, "ftol": 1e-13, "gtol": 1e-7, "maxls": 20, "maxiter": 15000, "maxfun": 100000}


def rosenbrock(x):
    return [10 * (x[1] - x[0] ** 2), 1 - x[0]]


def brown_badly_scaled(x):
    return [x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2]


def beale(x):
    return [y - x[0] * (1 - x[1] ** (i + 1)) for i, y in enumerate([1.5, 2.25, 2.625])]


def jennrich_sampson(x):
    return [2 + 2 * i - (np.exp(i * x[0]) + np.exp(i * x[1])) for i in range(1, 11)]


def helical_valley(x):
    theta = np.arctan(x[1] / x[0]) / (2 * np.pi) + (0.5 if x[0].real < 0 else 0.0)
    return [10 * (x[2] - 10 * theta), 10 * (np.sqrt(x[0] ** 2 + x[1] ** 2) - 1), x[2]]


BARD = [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39]


def bard(x):
    return [y - (x[0] + u / ((16 - u) * x[1] + min(u, 16 - u) * x[2])) for u, y in enumerate(BARD, 1)]


def box_3d(x):
    t = [0.1 * i for i in range(1, 11)]
    return [np.exp(-t * x[0]) - np.exp(-t * x[1]) - x[2] * (np.exp(-t) - np.exp(-10 * t)) for t in t]


def powell_singular(x):
    r = []
    for j in range(0, len(x), 4):
        a, b, c, d = x[j : j + 4]
        r += [a + 10 * b, np.sqrt(5.0) * (c - d), (b - 2 * c) ** 2, np.sqrt(10.0) * (a - d) ** 2]
    return r


def wood(x):
    a, b, c, d = x
    return [
        10 * (b - a**2), 1 - a, np.sqrt(90.0) * (d - c**2), 1 - c, np.sqrt(10.0) * (b + d - 2), (b - d) / np.sqrt(10.0)
    ]


KOWALIK_Y = [0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246]
KOWALIK_U = [4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625]


def kowalik_osborne(x):
    return [y - x[0] * (u * u + u * x[1]) / (u * u + u * x[2] + x[3]) for y, u in zip(KOWALIK_Y, KOWALIK_U)]


def brown_dennis(x):
    t = [i / 5 for i in range(1, 21)]
    return [(x[0] + t * x[1] - np.exp(t)) ** 2 + (x[2] + x[3] * np.sin(t) - np.cos(t)) ** 2 for t in t]


def biggs_exp6(x):
    r = []
    for i in range(1, 14):
        t = 0.1 * i
        y = np.exp(-t) - 5 * np.exp(-10 * t) + 3 * np.exp(-4 * t)
        r.append(x[2] * np.exp(-t * x[0]) - x[3] * np.exp(-t * x[1]) + x[5] * np.exp(-t * x[4]) - y)
    return r


def watson(x):
    r = []
    for i in range(1, 30):
        t = i / 29
        slope = sum(j * x[j] * t ** (j - 1) for j in range(1, len(x)))
        value = sum(x[j] * t**j for j in range(len(x)))
        r.append(slope - value**2 - 1)
    return r + [x[0], x[1] - x[0] ** 2 - 1]


def extended_rosenbrock(x):
    r = []
    for j in range(0, len(x), 2):
        r += [10 * (x[j + 1] - x[j] ** 2), 1 - x[j]]
    return r


def penalty_1(x):
    return [np.sqrt(1e-5) * (v - 1) for v in x] + [sum(v * v for v in x) - 0.25]


def variably_dimensioned(x):
    s = sum((j + 1) * (v - 1) for j, v in enumerate(x))
    return [v - 1 for v in x] + [s, s * s]


def trigonometric(x):
    n = len(x)
    total = sum(np.cos(v) for v in x)
    return [n - total + (i + 1) * (1 - np.cos(v)) - np.sin(v) for i, v in enumerate(x)]


def discrete_boundary_value(x):
    n = len(x)
    h = 1 / (n + 1)
    z = [0.0, *x, 0.0]
    return [2 * z[i] - z[i - 1] - z[i + 1] + h * h * (z[i] + i * h + 1) ** 3 / 2 for i in range(1, n + 1)]


def broyden_tridiagonal(x):
    z = [0.0, *x, 0.0]
    return [(3 - 2 * z[i]) * z[i] - z[i - 1] - 2 * z[i + 1] + 1 for i in range(1, len(x) + 1)]


def chebyquad(x):
    n = len(x)
    r = []
    before, now = [1.0] * n, [2 * v - 1 for v in x]
    for i in range(1, n + 1):
        r.append(sum(now) / n + (1 / (i * i - 1) if i % 2 == 0 else 0.0))
        before, now = now, [2 * (2 * v - 1) * t - b for v, t, b in zip(x, now, before)]
    return r


def half_steps(n):
    return [(i / (n + 1)) * (i / (n + 1) - 1) for i in range(1, n + 1)]


PROBLEMS = {
    "rosenbrock": (rosenbrock, [-1.2, 1.0]),
    "brown_badly_scaled": (brown_badly_scaled, [1.0, 1.0]),
    "beale": (beale, [1.0, 1.0]),
    "jennrich_sampson": (jennrich_sampson, [0.3, 0.4]),
    "helical_valley": (helical_valley, [-1.0, 0.0, 0.0]),
    "bard": (bard, [1.0, 1.0, 1.0]),
    "box_3d": (box_3d, [0.0, 10.0, 20.0]),
    "powell_singular": (powell_singular, [3.0, -1.0, 0.0, 1.0]),
    "wood": (wood, [-3.0, -1.0, -3.0, -1.0]),
    "kowalik_osborne": (kowalik_osborne, [0.25, 0.39, 0.415, 0.39]),
    "brown_dennis": (brown_dennis, [25.0, 5.0, -5.0, -1.0]),
    "biggs_exp6": (biggs_exp6, [1.0, 2.0, 1.0, 1.0, 1.0, 1.0]),
    "watson": (watson, [0.0] * 6),
    "extended_rosenbrock": (extended_rosenbrock, [-1.2, 1.0] * 25),
    "extended_powell_singular": (powell_singular, [3.0, -1.0, 0.0, 1.0] * 10),
    "penalty_1": (penalty_1, [float(i) for i in range(1, 11)]),
    "variably_dimensioned": (variably_dimensioned, [1 - i / 10 for i in range(1, 11)]),
    "trigonometric": (trigonometric, [0.1] * 10),
    "discrete_boundary_value": (discrete_boundary_value, half_steps(20)),
    "broyden_tridiagonal": (broyden_tridiagonal, [-1.0] * 30),
    "chebyquad": (chebyquad, [i / 9 for i in range(1, 9)]),
}


def cost_and_gradient(residuals):
    def evaluate(x):
        cost = sum(r * r for r in residuals(x.astype(complex))).real
        gradient = np.empty(len(x))
        for i in range(len(x)):
            z = x.astype(complex)
            z[i] += 1e-40j
            gradient[i] = sum(r * r for r in residuals(z)).imag / 1e-40
        return float(cost), gradient

    return evaluate


def settings(x0, best):
    n = len(x0)
    inf = np.full(n, np.inf)
    span = np.abs(best - x0)
    yield "free", x0, -inf, inf
    yield "inactive", x0, np.minimum(x0, best) - 1 - span, np.maximum(x0, best) + 1 + span
    # Bounded on all sides: cut on one side only, Bard's and Biggs's problems have their infimum at infinity.
    lower, upper = np.minimum(x0, best) - 1 - span, np.maximum(x0, best) + 1 + span
    for i in range(0, n, 2):
        halfway = 0.5 * (x0[i] + best[i])
        if best[i] >= x0[i]:
            upper[i] = halfway
        else:
            lower[i] = halfway
    yield "active", x0, lower, upper
    yield "infeasible", np.where(np.arange(n) % 3 == 0, upper + 1, lower - 1), lower, upper
    lower, upper = -inf, inf.copy()
    lower[::2] = np.minimum(x0, best)[::2]
    upper[1::2] = np.maximum(x0, best)[1::2]
    yield "one_sided", x0, lower, upper
    lower, upper = -inf, inf.copy()
    lower[0] = upper[0] = x0[0]
    yield "fixed", x0, lower, upper
    yield "vertex", x0, x0, x0 + 2 * span + 1


def main():
    runs = []
    for name, (residuals, start) in PROBLEMS.items():
        evaluate, x0 = cost_and_gradient(residuals), np.array(start)
        best = minimize(evaluate, x0, jac=True, method="L-BFGS-B", options=OPTIONS).x
        for setting, start, lower, upper in settings(x0, best):
            result = minimize(
                evaluate, start, jac=True, method="L-BFGS-B", bounds=scipy.optimize.Bounds(lower, upper), options=OPTIONS
            )
            runs.append(
                {
                    "problem": name,
                    "setting": setting,
                    "x0": list(start),
                    "lower": [v if np.isfinite(v) else None for v in lower],
                    "upper": [v if np.isfinite(v) else None for v in upper],
                    "cost_at_start": evaluate(np.clip(start, lower, upper))[0],
                    "x": list(result.x),
                    "cost": result.fun,
                    "evaluations": result.nfev,
                    "iterations": result.nit,
                    "message": result.message,
                }
            )
            print(f"{name:26} {setting:10} {result.nfev:5} {result.nit:5} {result.fun:.9e} {result.message}")
    out = {"scipy": scipy.__version__, "numpy": np.__version__, "options": OPTIONS, "runs": runs}
    text = json.dumps(out, allow_nan=False).replace('{"problem"', '\n{"problem"')
    pathlib.Path(__file__).with_suffix(".json").write_text(text + "\n")


main()
