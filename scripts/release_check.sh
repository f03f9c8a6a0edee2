#!/usr/bin/env bash
# Rehearses a release, and publishes nothing: packages every crate and builds it from its package, compares public
# interfaces with the last release, builds wheel and source distribution, and tries each in a fresh environment.
# Needs cargo 1.90 or newer, Python 3.11 with pip; cargo-semver-checks where there is a release (a tag v*).
set -euo pipefail
cd "$(dirname "$0")/.."

echo "== crates"
cargo publish --workspace --locked --dry-run

echo "== public interfaces"
release=$(git describe --tags --match 'v*' --abbrev=0 2>/dev/null || true)
if [ -z "$release" ]; then
    echo "no release yet"
else
    cargo semver-checks --version >/dev/null || { echo "cargo semver-checks is missing: cargo install cargo-semver-checks" >&2; exit 1; }
    cargo semver-checks --workspace --exclude plywave-fuzz --baseline-rev "$release"
fi

echo "== Python"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"${PYTHON:-python3}" -m venv "$scratch/build"
"$scratch/build/bin/pip" install --quiet build
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$PWD/target}"
"$scratch/build/bin/python" -m build python --outdir "$scratch/dist"
for package in "$scratch"/dist/*; do
    echo "-- $(basename "$package")"
    "${PYTHON:-python3}" -m venv --clear "$scratch/try"
    "$scratch/try/bin/pip" install --quiet "$package"
    (cd "$scratch" && try/bin/python - <<'EOF'
import numpy as np
import plywave

model = plywave.load("polyester")
f = model.eval(0.5, 10.0, np.array([0.0, 1.0, 0.0]), [0.001, 0.004, 0.010])
assert f.shape == (3,) and (f > 0.0).all(), f
print(f"plywave {plywave.__version__}: {f}")
EOF
    )
done
echo "nothing was published"
