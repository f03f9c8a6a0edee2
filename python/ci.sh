#!/usr/bin/env bash
# The Python package and its Mitsuba plugins as a user gets them: one wheel, built and installed with Mitsuba 3 in a fresh virtual environment outside the repository, the tests run
# against it, one example rendered small. Installs LLVM's library where it is missing and apt-get is there (as root). Run from anywhere; PYTHON chooses the interpreter. The
# program's words, numbers and pictures are compared where target/release/plywave has been built.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ -z "${DRJIT_LIBLLVM_PATH:-}" ]; then
    find_llvm() { ls /usr/lib/*/libLLVM.so.{19,2}* /usr/lib/llvm-{19,2}*/lib/libLLVM*.so* 2>/dev/null | sort -V | head -n 1 || true; }
    library=$(find_llvm)
    if [ -z "$library" ] && command -v apt-get >/dev/null; then
        apt-get update -qq && apt-get install -y -qq libllvm19
        library=$(find_llvm)
    fi
    [ -n "$library" ] || { echo "LLVM's shared library 19 or newer is missing: install libllvm19, or set DRJIT_LIBLLVM_PATH" >&2; exit 1; }
    export DRJIT_LIBLLVM_PATH=$library
fi

cargo fmt --manifest-path python/Cargo.toml --check

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"${PYTHON:-python3}" -m venv "$scratch/venv"
bin=$scratch/venv/bin
# The extension's build folder stays, python/target, so that a second run builds what has changed.
export CARGO_TARGET_DIR="$PWD/python/target"
cargo clippy --manifest-path python/Cargo.toml --locked --release -- -D warnings
"$bin/pip" install --quiet "./python[test,mitsuba,cluster]"

# One after the other: workers of the farm and times want the cores for themselves. Mitsuba's kernels are each compiled on one core: two processes.
# What hangs is told before the runner's own limit.
all=(-q -p no:cacheprovider --durations=5)
timeout 1200 "$bin/pytest" "${all[@]}" python/tests --ignore python/tests/test_mitsuba.py --ignore python/tests/test_cost.py
timeout 2400 "$bin/pytest" "${all[@]}" -n 2 python/tests/test_mitsuba.py
"$bin/pytest" "${all[@]}" python/tests/test_cost.py
"$bin/python" examples/mitsuba/render.py denim_close --width 64 --spp 2 -o "$scratch/denim.png"
