#!/usr/bin/env python3
"""Writes fabrics/models/plies.json: the spec of the ply of every model in fabrics/models, by name.

Programs without a file system find the model of a yarn by it.

Usage: model_index.py [PLYWAVE], by default target/release/plywave.
"""
import json
import subprocess
import sys
from pathlib import Path

root = Path(__file__).resolve().parent.parent
program = sys.argv[1] if len(sys.argv) > 1 else root / "target/release/plywave"
index = {}
for model in sorted((root / "fabrics/models").glob("*.pwm")):
    info = json.loads(subprocess.run([program, "info", model, "--json"], check=True, capture_output=True).stdout)
    index[model.stem] = info["spec"]
path = root / "fabrics/models/plies.json"
path.write_text(json.dumps(index, indent=1) + "\n")
print(f"{path.relative_to(root)}: {len(index)} models")
