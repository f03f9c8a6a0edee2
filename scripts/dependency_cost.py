#!/usr/bin/env python3
"""Prints what each library that the workspace names costs to compile: seconds of its own and of the crates that it alone brings, after `cargo build --release --timings` of a clean target.

Seconds are the elapsed ones of each crate with two at a time, so their sum is more than the CPU seconds of the build. Needs Python 3.11.
"""
import collections
import json
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def seconds():
    """Elapsed seconds of each package in the last build with timings."""
    page = (ROOT / "target/cargo-timings/cargo-timing.html").read_text(encoding="utf-8")
    of = collections.Counter()
    for unit in json.loads(re.search(r"UNIT_DATA = (\[.*?\]);\n", page, re.S)[1]):
        of[unit["name"]] += unit["duration"]
    return of


def graph():
    """Members of the program, and the packages that each package needs to be built, by name."""
    tree = subprocess.run(["cargo", "tree", "--locked", "--package", "plywave-cli", "--edges", "normal,build", "--prefix", "depth", "--no-dedupe", "--format", " {p}"],
                          cwd=ROOT, check=True, capture_output=True, text=True).stdout
    needs, above = collections.defaultdict(set), []
    for line in tree.splitlines():
        depth, name = re.match(r"(\d+) (\S+)", line).groups()
        above[int(depth):] = [name]
        if int(depth):
            needs[above[int(depth) - 1]].add(name)
    return needs


def reached(needs, roots, without=None):
    found, todo = set(), [root for root in roots if root != without]
    while todo:
        name = todo.pop()
        if name not in found:
            found.add(name)
            todo += needs[name] - {without}
    return found


def main():
    of, needs = seconds(), graph()
    members = {name for name in reached(needs, ["plywave-cli"]) if name.startswith("plywave")}
    everything = reached(needs, ["plywave-cli"])
    rows = []
    for name in {d for member in members for d in needs[member]} - members:
        alone = everything - reached(needs, ["plywave-cli"], name)
        rows.append((sum(of[crate] for crate in alone), name, len(alone)))
    print(f"{sum(of.values()):6.1f} s in all, {sum(of[m] for m in members):.1f} of the workspace's crates")
    for cost, name, crates in sorted(rows, reverse=True):
        print(f"{cost:6.1f} s  {name}" + (f" and {crates - 1} that it alone brings" if crates > 1 else ""))


if __name__ == "__main__":
    main()
