#!/usr/bin/env bash
# The Python package and its Mitsuba plugins as a user gets them: one wheel, built and installed with Mitsuba 3 in a fresh virtual environment outside the repository, the tests run
# against it, one example rendered small. Installs LLVM's library where it is missing and apt-get is there (as root). Run from anywhere; PYTHON chooses the interpreter. The
# program's words, numbers and pictures are compared where target/release/plywave has been built.
# python/ci.sh [--minutes M] runs of the slow tests what fits into M minutes, in a rotation, and all without it.
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

# What the program has compiled, the extension takes, where versions and features are the same (python/Cargo.toml).
tree() { cargo tree --locked --edges normal,build --prefix none --format '{p} [{f}]' "$@" | sed 's/ (\*)$//' | sort -u; }
program=$(tree --package plywave-cli)
apart=$(comm -23 <(tree --manifest-path python/Cargo.toml) <(echo "$program") | while read -r name rest; do if grep -q "^$name " <<<"$program"; then echo "$name $rest"; fi; done)
[ -z "$apart" ] || { printf 'compiled twice, for the program and for the extension; give both the same features:\n%s\n' "$apart" >&2; exit 1; }

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
# PLYWAVE_VENV names an environment that has what the package needs.
[ -n "${PLYWAVE_VENV:-}" ] || "${PYTHON:-python3}" -m venv "$scratch/venv"
bin=${PLYWAVE_VENV:-$scratch/venv}/bin
# The extension is built in the workspace's target folder, whose dependencies it shares, and where a second run builds what has changed.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$PWD/target}"
cargo clippy --manifest-path python/Cargo.toml --locked --release -- -D warnings
"$bin/pip" install --quiet "./python[test,mitsuba,cluster]"

# One after the other: workers of the farm and times want the cores for themselves. Mitsuba's kernels are each compiled on one core: two processes.
# What hangs is told before the runner's own limit.
all=(-q -p no:cacheprovider --durations=5 "$@")
timeout 1200 "$bin/pytest" "${all[@]}" python/tests --ignore python/tests/test_mitsuba.py --ignore python/tests/test_mitsuba_cloth.py --ignore python/tests/test_mitsuba_native.py --ignore python/tests/test_cost.py
timeout 2400 "$bin/pytest" "${all[@]}" -n 2 python/tests/test_mitsuba.py python/tests/test_mitsuba_cloth.py python/tests/test_mitsuba_native.py
"$bin/pytest" "${all[@]}" python/tests/test_cost.py conformance/kit/test_data.py
"$bin/python" examples/mitsuba/render.py hopsack_close --width 64 --spp 2 -o "$scratch/hopsack.png"
