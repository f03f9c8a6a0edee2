#!/usr/bin/env python3
"""Proves the kit: changes single lines of reference.py and reference_larger.py, one fault at a time, and shows which check finds each.

    python3 conformance/kit/mutations.py [--markdown OUT.md] [--all-checks]

The unchanged reference must pass every check, and every mutation must fail one. Ends with 1 otherwise.
A mutation stops at the first check that fails, or, with --all-checks, runs all and lists those that fail.
"""
import argparse
import concurrent.futures
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import conform

# What is wrong, the line as it is, and as it is with the fault. Numbers are those of SOURCES.
FAULTS = [
    ("later orders: N is pi/2 in place of 1/(2 pi), 9.9 times too large [1]", "if lobe < 3 else 1.0 / TAU", "if lobe < 3 else 0.5 * PI"),
    ("R is 1 % too large", "    a_r = f\n", "    a_r = 1.01 * f\n"),
    ("1/pi too much in N", " if lobe < 3 else 1.0 / TAU", " / PI if lobe < 3 else 1.0 / TAU"),
    ("weight is f, without the density [2]", "f / np.maximum(pdf, 1e-300)", "f"),
    ("weight is f times the density", "f / np.maximum(pdf, 1e-300)", "f * pdf"),
    ("transmittance of TT squared: a color applied twice [4]", "a_tt = (1.0 - f) ** 2 * t\n", "a_tt = (1.0 - f) ** 2 * t**2\n"),
    ("scales tilt TT by 2 alpha and R by alpha", "np.array([2.0, -1.0, -4.0, 0.0])", "np.array([1.0, -2.0, -4.0, 0.0])"),
    ("scales tilt TRT the wrong way [6]", "np.array([2.0, -1.0, -4.0, 0.0])", "np.array([2.0, -1.0, 4.0, 0.0])"),
    ("tilt added to the latitude of the wrong direction", "self.tilted = list(zip(sin_l, cos_l))", "self.tilted = list(zip(sin_l, cos_l[::-1]))"),
    ("half of the turn at the surface: gamma for 2 gamma", "return 2.0 * gamma - p", "return gamma - p"),
    ("TT and TRT not turned back: p pi missing", "(2.0 * gamma_t - PI)", "(2.0 * gamma_t)"),
    ("gamma_t in place of 2 gamma_t", "p * (2.0 * gamma_t - PI)", "p * (gamma_t - PI)"),
    ("a cosine too much in f", "out[:, lobe] = m * n", "out[:, lobe] = m * n * cos_o"),
    ("a cosine missing in f: the BCSDF [5]", "out[:, lobe] = m * n", "out[:, lobe] = m * n / np.maximum(cos_o, 1e-6)"),
    ("azimuth not wrapped", "trimmed_logistic(wrap(phi - self.phi_p[lobe])", "trimmed_logistic((phi - self.phi_p[lobe])"),
    ("M without its 1/v", "np.log1p(-np.exp(-2.0 / v))) / v", "np.log1p(-np.exp(-2.0 / v)))"),
    ("M without the cut at the poles", "exponent - np.log1p(-np.exp(-2.0 / v))", "exponent"),
    ("N without the cut at pi", " / (logistic_cdf(PI, s) - logistic_cdf(-PI, s))", ""),
    ("path inside not longer for tilted light", "np.cos(gamma_t) / max(cos_theta_t, 1e-9)", "np.cos(gamma_t)"),
    ("path inside through the axis at every h", "np.cos(gamma_t) / max(cos_theta_t, 1e-9)", "1.0 / max(cos_theta_t, 1e-9)"),
    ("absorption over the radius in place of the diameter", "np.exp(-tau * path)", "np.exp(-0.5 * tau * path)"),
    ("eta in place of Bravais' index", "np.sqrt(eta**2 - sin_i**2) / max(cos_i, 1e-9)", "eta"),
    ("Bravais' index upside down", "np.sqrt(eta**2 - sin_i**2) / max(cos_i, 1e-9)", "np.sqrt(eta**2 - sin_i**2) * cos_i"),
    ("TRT without Fresnel's reflection inside", "a_trt = a_tt * t * f\n", "a_trt = a_tt * t\n"),
    ("TT through one surface: (1 - F) once", "a_tt = (1.0 - f) ** 2 * t\n", "a_tt = (1.0 - f) * t\n"),
    ("later orders cut after one", "a_rest = a_trt * t * f / max(1.0 - t * f, 1e-12)", "a_rest = a_trt * t * f"),
    ("later orders not absorbed", "a_rest = a_trt * t * f / max(1.0 - t * f, 1e-12)", "a_rest = a_trt * f / max(1.0 - f, 1e-12)"),
    ("Fresnel of the cross section, without theta", "fresnel(cos_i * np.cos(gamma), eta)", "fresnel(np.cos(gamma), eta)"),
    ("Fresnel without gamma", "fresnel(cos_i * np.cos(gamma), eta)", "fresnel(cos_i, eta)"),
    ("Fresnel of one polarization", "0.5 * (parallel**2 + perpendicular**2)", "perpendicular**2"),
    ("lobes sampled with even chances, density as before", "np.cumsum(self.chance)", "np.cumsum(np.full(4, 0.25))"),
    ("density with even chances, samples as before", "at.shapes(wo) @ at.chance", "at.shapes(wo) @ np.full(4, 0.25)"),
    ("density without the later orders", "at.shapes(wo) @ at.chance", "at.shapes(wo)[:, :3] @ at.chance[:3]"),
    ("density with a floor", "sum(w * at.shapes(wo) @ at.chance", "sum(w * 1e-2 + w * at.shapes(wo) @ at.chance"),
    ("tangent flipped: M around +theta_i", "- sin_i * sin_o / v", "+ sin_i * sin_o / v"),
    ("sampled around +theta_i", "-along * sin_i + across", "along * sin_i + across"),
    ("side of h lost", "np.arcsin(np.clip(h, -1.0, 1.0)),", "np.arcsin(np.clip(abs(h), -1.0, 1.0)),"),
    ("sampled azimuth not relative to wi", "phi = self.phi_i + turn\n", "phi = turn\n"),
    ("azimuth of wo not relative to wi", "np.arctan2(wo[:, 1], wo[:, 0]) - self.phi_i", "np.arctan2(wo[:, 1], wo[:, 0])"),
    ("TT as wide as R along the fiber", "np.array([v, 0.25 * v, 4.0 * v, 4.0 * v])", "np.array([v, v, 4.0 * v, 4.0 * v])"),
    ("roughness not squared", "v = base**2", "v = base"),
    ("roughness around the fiber without sqrt(pi / 8)", "np.sqrt(PI / 8.0) * spread", "spread"),
    ("sampled azimuth half as wide", "turn = self.phi_p[k] + sample", "turn = self.phi_p[k] + 0.5 * sample"),
    ("cosine beyond the pole cut to 0", "cos_l = np.abs(self.cos_i", "cos_l = np.maximum(0.0, self.cos_i"),
    ("scales turn the sampled latitude, not the light's, which the density has [3]", "sin_o = sample_longitudinal(sin_l, cos_l, self.v[k], u1[of], u2[of])", "sin_o = np.sin(np.arcsin(sample_longitudinal(self.sin_i, self.cos_i, self.v[k], u1[of], u2[of])) + np.arcsin(self.sin_i) - np.arcsin(sin_l))"),
    ("far field: offsets weighted evenly", "WEIGHTS /= WEIGHTS.sum()", "WEIGHTS = np.full(48, 1.0 / 48.0)"),
    ("random number not used again from its lobe's start", "(u0 - edges[lobe]) /", "u0 /"),
    ("not a number at grazing light", "cos_i * cos_o / v) - sin_i", "cos_i * cos_o / v) * (0.0 * cos_i / np.float64(cos_i > 1e-6) + 1.0) - sin_i"),
]

# The same of reference_larger.py: name of the model, fault, line, line with the fault.
FAULTS_LARGER = [
    ("sheet", "reflected light 1 % too much", "        self.r, self.t = r, t", "        self.r, self.t = 1.01 * r, t"),
    ("sheet", "BSDF without its cosine", "np.where(same, self.r, self.t) * np.abs(wo[:, 2]) / PI", "np.where(same, self.r, self.t) / PI"),
    ("sheet", "straight light counted in f too", "        t = (1.0 - self.gap) * p[\"albedo\"] * p[\"through\"]", "        t = (1.0 - self.gap) * p[\"albedo\"] * p[\"through\"] + self.gap"),
    ("sheet", "lit from the back as from the front: sides not turned with wi", "wo[:, 2] * wi[2] > 0.0", "wo[:, 2] > 0.0"),
    ("sheet", "samples of the back on the wrong side", " * (1.0 if wi[2] >= 0.0 else -1.0)", ""),
    ("sheet", "cosine sampled by its angle: z = 1 - u", "z, phi = np.sqrt(1.0 - u[:, 1]), 2.0 * PI * u[:, 2]\n        c = np.sqrt(u[:, 1])", "z, phi = 1.0 - u[:, 1], 2.0 * PI * u[:, 2]\n        c = np.sqrt(1.0 - z**2)"),
    ("sheet", "straight samples weighted with f", "return wo, scattered, np.where(straight, 1.0, 0.0)\n\n\nclass Strand", "return wo, scattered, np.where(straight, self.r + self.t, 0.0)\n\n\nclass Strand"),
    ("sheet", "a gap that is never sampled", "straight = ~scattered & (u[:, 0] < self.r + self.t + self.gap)", "straight = ~scattered & (u[:, 0] < 0.0)"),
    ("sheet", "two layers: straight light of both added", "self.gap = self.gap**2", "self.gap = 2.0 * self.gap"),
    ("sheet", "two layers: one path between them in place of all", "down = (t + r**2 * self.gap) / (1.0 - r**2)", "down = t + r**2 * self.gap"),
    ("sheet", "two layers: even light does not pass the gaps", "(t + self.gap) * down + t * self.gap", "t * down + t * self.gap"),
    ("sheet", "two layers: light that fell straight on the lower one is lost", "up = r * (down + self.gap)", "up = r * down"),
    ("sheet", "two layers: R and T of each multiplied", "r, t = r + (t + self.gap) * up, (t + self.gap) * down + t * self.gap", "r, t = r, (t + self.gap) ** 2 - self.gap**2"),
    ("sheet", "not reciprocal: brighter toward a grazing viewer", "self.t) * np.abs(wo[:, 2]) / PI", "self.t) * np.abs(wo[:, 2]) / PI * (1.5 - np.abs(wo[:, 2])) / (1.5 - 2.0 / 3.0)"),
    ("sheet", "a marked direction: brighter to +x", "self.t) * np.abs(wo[:, 2]) / PI", "self.t) * np.abs(wo[:, 2]) / PI * (1.0 + 0.05 * wo[:, 0])"),
    ("sheet", "numbers that are not finite are taken", "    if not all(np.all(np.isfinite(v)) for v in values):", "    if False:"),
    ("sheet", "not a number where wi is grazing", "same = wo[:, 2] * wi[2] > 0.0", "same = wo[:, 2] / np.float64(wi[2] if abs(wi[2]) > 2e-3 else np.nan) > 0.0\n        wo = wo / (wo[:, :1] * 0.0 + (1.0 if abs(wi[2]) > 2e-3 else np.nan))"),
    ("thin sheet", "gap not taken off what is scattered", "        r = (1.0 - self.gap) * p[\"albedo\"] * (1.0 - p[\"through\"])", "        r = p[\"albedo\"] * (1.0 - p[\"through\"])"),
    ("thin sheet", "authored color taken twice", "r = (1.0 - self.gap) * p[\"albedo\"] *", "r = (1.0 - self.gap) * p[\"albedo\"] ** 2 *"),
    ("thin sheet", "authored color of the cloth with its gaps", "        self.r, self.t = r, t", "        self.r, self.t = r * (1.0 - self.gap), t * (1.0 - self.gap)"),
    ("thin sheet", "cover in place of the gap", "        self.r, self.t = r, t", "        self.r, self.t, self.gap = r, t, (1.0 - r - t) * self.gap"),
    ("strand", "offset's sign lost", "0.5 * p[\"twist\"] * h", "0.5 * p[\"twist\"] * abs(h)"),
    ("strand", "twist of one hand only", "0.5 * p[\"twist\"] * h", "0.5 * abs(p[\"twist\"]) * h"),
    ("strand", "light that passes not taken off", "self.kept = (1.0 - self.gap) * p[\"albedo\"]", "self.kept = p[\"albedo\"]"),
    ("strand", "even over the sphere: not reciprocal", "cos = np.sqrt(np.maximum(0.0, 1.0 - wo[:, 2] ** 2))\n        return self.kept * cos / PI**2", "return self.kept / (4.0 * PI)"),
    ("strand", "latitude sampled evenly in its sine", "z = np.sqrt(u[:, 1]) * np.cos(2.0 * PI * u[:, 2])", "z = 2.0 * u[:, 1] - 1.0"),
    ("strand", "far field at the middle in place of the mean", "x, w = np.polynomial.legendre.leggauss(8)", "x, w = np.array([0.0]), np.array([2.0])"),
    ("strand", "straight light of the rim everywhere", "return sum(w * m.gap for w, m in self.parts(q))", "return q[\"parameters\"][\"gap\"]"),
]

# Where a fault of this kind was reported in public code.
SOURCES = {
    1: "MaterialX issue 2960, `chiang_hair_bsdf`",
    2: "OpenShadingLanguage issue 2054, physical hair: weights and densities of lobes are mixed",
    3: "pbrt-v3 issue 121, hair",
    4: "MaterialX issue 3027, thin-walled OpenPBR: the color twice",
    5: "Godot pull request 11748, Burley's diffuse term without its cosine",
    6: "Tungsten issue 50, sign of the scales' tilt in pbrt and Tungsten",
}


FILES = {"Reference": "reference.py", "Larger": "reference_larger.py"}
# Name, model, its class, line, line with the fault.
CASES = [(name, "reference", "Reference", old, new) for name, old, new in FAULTS]
CASES += [(f"{of}: {name}", of, "Larger", old, new) for of, name, old, new in FAULTS_LARGER]


def mutated(name, made, old, new):
    """A reference with one fault, as an adapter."""
    file = HERE / FILES[made]
    source = file.read_text()
    if old != new and source.count(old) != 1:
        raise ValueError(f"mutations.py: {name}: {old!r} stands {source.count(old)} times in {file.name}; name one place")
    space = {"__name__": "mutation", "__file__": str(file)}
    exec(compile(source.replace(old, new), name, "exec"), space)
    return space[made]()


def judge(case, stop):
    """Checks that a case fails."""
    name, of, made, old, new = case
    adapter = mutated(name, made, old, new)
    model = next(m for m in adapter.describe()["models"] if m["name"] == of)
    return [r for r in conform.run_model(adapter, {**model, "mutation": True}, fast=True, stop=stop) if r["failed"]]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--markdown", type=Path, help="write the table here")
    parser.add_argument("--all-checks", action="store_true", help="list every check that finds a fault")
    args = parser.parse_args()
    begun = time.time()
    unchanged = [("the unchanged reference", of, made, "PI", "PI") for of, made in sorted({c[1:3] for c in CASES})]
    with concurrent.futures.ProcessPoolExecutor() as pool:
        wrong = [r for found in pool.map(judge, unchanged, [False] * len(unchanged)) for r in found]
        results = list(pool.map(judge, CASES, [not args.all_checks] * len(CASES)))
    for r in wrong:
        print(f"the unchanged reference fails {r['check']}: {r['value']:.3g} of {r['limit']:.3g} at {r['where']}")
    lines, missed = ["| fault | found by | worst | limit |", "|---|---|---|---|"], 0
    for (name, *_), found in zip(CASES, results):
        missed += not found
        by = ", ".join(r["check"] for r in found) or "NOT FOUND"
        value, limit = (f"{found[0]['value']:.3g}", f"{found[0]['limit']:.3g}") if found else ("", "")
        lines.append(f"| {name} | {by} | {value} | {limit} |")
        print(f"  {name:62} {by}")
    if args.markdown:
        notes = [f"- [{number}] {text}" for number, text in SOURCES.items()]
        args.markdown.write_text("\n".join([*lines, "", *notes]) + "\n")
    state = "passes" if not wrong else "FAILS"
    print(f"reference {state}; {len(CASES) - missed} of {len(CASES)} faults found, {time.time() - begun:.0f} s")
    return int(bool(wrong) or missed > 0)


if __name__ == "__main__":
    sys.exit(main())
