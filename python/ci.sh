#!/usr/bin/env bash
# The Python package as a user gets it: a wheel built and installed in a fresh virtual environment outside the repository, its tests run against it. Run from anywhere;
# PYTHON chooses the interpreter. The program's words and numbers are compared where target/release/plywave has been built.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo fmt --manifest-path python/Cargo.toml --check
cargo clippy --manifest-path python/Cargo.toml --locked --release -- -D warnings

venv=$(mktemp -d)
trap 'rm -rf "$venv"' EXIT
"${PYTHON:-python3}" -m venv "$venv"
# The extension's build folder stays, python/target, so that a second run builds what has changed.
CARGO_TARGET_DIR="$PWD/python/target" "$venv/bin/pip" install --quiet "./python[test]"
"$venv/bin/pytest" -q -p no:cacheprovider python/tests
