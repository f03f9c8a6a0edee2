#!/usr/bin/env python3
"""Runs the conformance kit on a renderer's adapter and prints a table (docs/howto/conformance.md). Needs numpy.

    python3 conformance/kit/conform.py "python3 conformance/kit/reference.py"
    python3 conformance/kit/conform.py COMMAND --markdown OUT.md --html OUT.html --model NAME --only CHECK --fast

Ends with 1 where a check fails.
"""
import argparse
import html
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import checks
import truth  # noqa: F401  (registers its checks)
import cloths  # noqa: F401
from pipe import Pipe


def applies(model, claims, kinds, needs):
    answers = set(model.get("methods", checks.METHODS))
    return model["kind"] in kinds and claims <= set(model.get("claims", [])) and needs <= answers


def run_model(adapter, model, fast=False, only=None, stop=False, seed=1):
    """Results of all checks that apply: dicts of check, value, limit, where, count, failed."""
    subject, results = checks.Subject(adapter, model, fast, seed), []
    for name, claims, kinds, needs, function in checks.CHECKS:
        if not applies(model, claims, kinds, needs) or (only and only not in name):
            continue
        worst, count, failed, begun, ratios = None, 0, 0, time.time(), []
        try:
            with np.errstate(all="ignore"):
                for value, limit, where in function(subject):
                    value = float(value)
                    ratio = np.inf if np.isnan(value) else value / limit if limit > 0.0 else (np.inf if value > 0.0 else 0.0)
                    count, failed = count + 1, failed + (ratio > 1.0)
                    ratios.append(ratio)
                    if worst is None or ratio > worst[0]:
                        worst = (ratio, value, limit, where)
                    if stop and failed:
                        break
        except RuntimeError as error:
            worst, count, failed = (np.inf, np.nan, 0.0, str(error)), count + 1, failed + 1
        if count:
            _, value, limit, where = worst
            row = dict(check=name, value=value, limit=limit, where=where, count=count, failed=failed)
            results.append({**row, "seconds": time.time() - begun, "ratios": ratios})
        if stop and failed:
            break
    return results


def cells(r):
    state = "passes" if not r["failed"] else f"FAILS {r['failed']} of {r['count']}"
    return [r["check"], state, str(r["count"]), f"{r['value']:.3g}", f"{r['limit']:.3g}", r["where"]]


HEAD = ["check", "result", "asked", "worst", "limit", "where"]


def markdown(described, tables):
    """A table of checks by models, and a line for each check that fails, with its worst query."""
    names = list(dict.fromkeys(r["check"] for _, results in tables for r in results))
    found = {(model["name"], r["check"]): r for model, results in tables for r in results}
    lines = ["| check | " + " | ".join(f"`{model['name']}`" for model, _ in tables) + " |", "|---" * (len(tables) + 1) + "|"]
    for name in names:
        row = [found.get((model["name"], name)) for model, _ in tables]
        lines.append("| " + " | ".join([name] + ["" if r is None else entry(r) for r in row]) + " |")
    lines += ["", f"{described['name']} {described['version']}; value of the worst query, and its limit in parentheses.", ""]
    for (model, name), r in found.items():
        if r["failed"]:
            lines.append(f"- `{model}`, {name}: {r['value']:.3g} of {r['limit']:.3g} at `{r['where']}`")
    return "\n".join(lines) + "\n"


def entry(r):
    text = f"{r['value']:.2g} ({r['limit']:.2g})"
    return f"**misses {r['failed']} of {r['count']}**: {text}" if r["failed"] else text


def strip(ratios):
    """An SVG of all queries: value over limit on a log scale, each factor of 10 is 25 px and 100 px is the limit."""
    x = [100.0 + 25.0 * np.log10(np.clip(r, 1e-4, 1e4)) if np.isfinite(r) else 200.0 for r in ratios]
    y = [4.0 + 12.0 * (k * 0.618 % 1.0) for k in range(len(x))]
    colors = ["#b00020" if not r <= 1.0 else "#4a7" for r in ratios]
    dots = "".join(f"<circle cx={a:.1f} cy={b:.1f} r=2.5 fill='{color}' fill-opacity=.6 />" for a, b, color in zip(x, y, colors))
    return f"<svg width=206 height=20><path d='M100 0V20' stroke='#888'/>{dots}</svg>"


def page(described, tables):
    """An HTML page: the same tables, with a plot of all queries of each check."""
    out = [f"<!doctype html><meta charset=utf-8><title>{html.escape(described['name'])}</title>"]
    out.append("<style>body{font:14px sans-serif;margin:2em}td,th{padding:.2em .6em;text-align:left}"
               ".f{color:#b00020}</style>")
    out.append(f"<h1>{html.escape(described['name'])} {html.escape(described['version'])}</h1>")
    for model, results in tables:
        out.append(f"<h2>{html.escape(model['name'])}</h2><table><tr>" + "".join(f"<th>{h}" for h in HEAD + ["all queries, value / limit, log"]))
        for r in results:
            row = "".join(f"<td>{html.escape(c)}" for c in cells(r))
            out.append(f"<tr{' class=f' if r['failed'] else ''}>{row}<td>{strip(r['ratios'])}")
        out.append("</table><p>A dot is a query: left of the line it is within the limit; each 25 px are a factor of 10.")
    return "\n".join(out)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", help="the adapter's command")
    parser.add_argument("--fast", action="store_true", help="fewer cases, samples and nodes")
    parser.add_argument("--model", help="only models whose name has this in it")
    parser.add_argument("--only", help="only checks whose name has this in it")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--html", type=Path)
    args = parser.parse_args()
    adapter = Pipe(args.command)
    try:
        described, tables = adapter.describe(), []
    except RuntimeError as error:
        sys.exit(str(error))
    for model in described["models"]:
        if not args.model or args.model in model["name"]:
            results = run_model(adapter, model, args.fast, args.only, seed=args.seed)
            tables.append((model, results))
            print(f"\n{described['name']} {described['version']}: {model['name']}", flush=True)
            for r in results:
                c = cells(r)
                print(f"  {c[0]:26} {c[1]:18} {c[3]:>9} of {c[4]:>8}  {r['seconds']:5.1f} s  {c[5]}")
    adapter.close()
    if args.markdown:
        args.markdown.write_text(markdown(described, tables))
    if args.html:
        args.html.write_text(page(described, tables))
    if not tables:
        sys.exit(f"--model {args.model}: none of {[m['name'] for m in described['models']]}")
    if not any(results for _, results in tables):
        sys.exit(f"--only {args.only}: none of {sorted({c[0] for c in checks.CHECKS})} that applies" if args.only else "no check applies")
    return int(any(r["failed"] for _, results in tables for r in results))


if __name__ == "__main__":
    sys.exit(main())
