#!/usr/bin/env python3
"""Fails where tests of the workspace compile a dependency that `cargo build --release` compiled with other features.

Run after both, from anywhere: what is there already is only listed. Needs Rust and Python 3.11.
"""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def libraries(*command: str) -> dict[tuple[str, ...], set[str]]:
    """Files of the libraries from registries that a cargo command uses, by package, target and optimization, which differs for what macros use."""
    run = subprocess.run(
        ["cargo", *command, "--locked", "--release", "--message-format", "json"],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=True,
    )
    found: dict[tuple[str, ...], set[str]] = {}
    for line in run.stdout.splitlines():
        message = json.loads(line)
        if message["reason"] == "compiler-artifact" and message["package_id"].startswith(("registry", "git")):
            files = (name for name in message["filenames"] if name.endswith((".rlib", ".so", ".dylib", ".dll")))
            key = message["package_id"], message["target"]["name"], message["profile"]["opt_level"]
            found.setdefault(key, set()).update(files)
    return found


def main() -> None:
    build, tests = libraries("build"), libraries("test", "--workspace", "--no-run")
    again = sorted(key[0] for key, files in tests.items() if files - build.get(key, files))
    for package in again:
        print(f"{package.rsplit('#')[-1]} is compiled for the program and again for tests", file=sys.stderr)
    if again:
        sys.exit("give both the same features: pipeline/Cargo.toml pins those that differ")
    print(f"{len(tests)} libraries of others, none compiled twice")


if __name__ == "__main__":
    main()
