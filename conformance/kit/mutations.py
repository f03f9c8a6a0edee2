#!/usr/bin/env python3
"""Proves the kit: changes single lines of reference.py, one fault at a time, and shows which check finds each.

    python3 conformance/kit/mutations.py [--markdown OUT.md] [--all-checks]

The unchanged reference must pass every check, and every mutation must fail one. Ends with 1 otherwise.
A mutation stops at the first check that fails, or, with --all-checks, runs all and lists those that fail.
"""
import argparse
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

# Where a fault of this kind was reported in public code.
SOURCES = {
    1: "MaterialX issue 2960, `chiang_hair_bsdf`",
    2: "OpenShadingLanguage issue 2054, physical hair: weights and densities of lobes are mixed",
    3: "pbrt-v3 issue 121, hair",
    4: "MaterialX issue 3027, thin-walled OpenPBR: the color twice",
    5: "Godot pull request 11748, Burley's diffuse term without its cosine",
    6: "Tungsten issue 50, sign of the scales' tilt in pbrt and Tungsten",
}


def mutated(source, old, new, name):
    """The reference with one fault, as an adapter."""
    if source.count(old) != 1:
        raise SystemExit(f"mutations.py: {name}: {old!r} stands {source.count(old)} times in reference.py; name one place")
    space = {"__name__": "mutation", "__file__": str(HERE / "reference.py")}
    exec(compile(source.replace(old, new), name, "exec"), space)
    return space["Reference"]()


def judge(adapter, stop):
    model = {**adapter.describe()["models"][0], "mutation": True}
    return [r for r in conform.run_model(adapter, model, fast=True, stop=stop) if r["failed"]]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--markdown", type=Path, help="write the table here")
    parser.add_argument("--all-checks", action="store_true", help="list every check that finds a fault")
    args = parser.parse_args()
    source = (HERE / "reference.py").read_text()
    begun = time.time()
    wrong = judge(mutated(source, "LOBES = 4\n", "LOBES = 4\n", "unchanged"), False)
    for r in wrong:
        print(f"the unchanged reference fails {r['check']}: {r['value']:.3g} of {r['limit']:.3g} at {r['where']}")
    lines, missed = ["| fault | found by | worst | limit |", "|---|---|---|---|"], 0
    for name, old, new in FAULTS:
        found = judge(mutated(source, old, new, name), not args.all_checks)
        missed += not found
        by = ", ".join(r["check"] for r in found) or "NOT FOUND"
        value, limit = (f"{found[0]['value']:.3g}", f"{found[0]['limit']:.3g}") if found else ("", "")
        lines.append(f"| {name} | {by} | {value} | {limit} |")
        print(f"  {name:62} {by}")
    if args.markdown:
        notes = [f"- [{number}] {text}" for number, text in SOURCES.items()]
        args.markdown.write_text("\n".join([*lines, "", *notes]) + "\n")
    state = "passes" if not wrong else "FAILS"
    print(f"reference {state}; {len(FAULTS) - missed} of {len(FAULTS)} faults found, {time.time() - begun:.0f} s")
    return int(bool(wrong) or missed > 0)


if __name__ == "__main__":
    sys.exit(main())
