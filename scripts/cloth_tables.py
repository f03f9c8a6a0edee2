#!/usr/bin/env python3
"""Makes the tables of docs/validation/cloth.md anew: each cloth that ships beside its twin, by `plywave check FABRIC --twin TWIN --json`.

    cargo build --release -p plywave-cli && scripts/cloth_tables.py
"""

import json
import math
import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
CLOTHS = {
    "Two straight layers of polyester": "polyester_layers",
    "Polyester satin": "polyester_satin",
    "Silk organza": "silk_organza",
    "Cotton muslin, two plies": "cotton_plain",
    "Cotton denim, three and four plies": "cotton_twill",
    "Worsted, two plies": "wool_plain",
    "Gold satin": "gold_satin",
    "Alpaca": "alpaca_plain",
    "Glass": "glass_plain",
}


def rows(name: str) -> list[str]:
    """The rows of a cloth's table."""
    command = ["target/release/plywave", "check", f"fabrics/{name}.toml", "--twin", f"fabrics/twins/{name}.pwx", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    # Status 1: a value is beyond its limit; the output is whole.
    if done.returncode not in (0, 1):
        raise SystemExit(done.stderr)
    lines = []
    for view in json.loads(done.stdout)["views"]:
        twin, model = view["twin"], view["model"]
        passed = [light["transmitted"] + light["straight"] for light in (twin, model)]
        lower = "" if view["lower"] is None or math.isnan(view["lower"]) else f"{view['lower']:.3f}"
        lines.append(
            f"| {view['tilt_deg']:.0f}, {view['azimuth_deg']:.0f} | {view['sigma_per_um'][0]:g} "
            f"| {twin['reflected']:.3f} / {model['reflected']:.3f} | {passed[0]:.3f} / {passed[1]:.3f} | {view['upper']:.3f} | {lower} |"
        )
    return lines


def main() -> None:
    """Rewrites the rows under each cloth's heading."""
    path = ROOT / "docs" / "validation" / "cloth.md"
    text = path.read_text()
    for heading, name in CLOTHS.items():
        table = re.compile(rf"(## {re.escape(heading)}\n\n\|.*\n\|[-|]+\|\n)(?:\|.*\n)+")
        text, found = table.subn(lambda m, name=name: m.group(1) + "\n".join(rows(name)) + "\n", text)
        if found != 1:
            raise SystemExit(f"docs/validation/cloth.md: no table under '{heading}'")
    path.write_text(text)


if __name__ == "__main__":
    main()
