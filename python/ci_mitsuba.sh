#!/usr/bin/env bash
# plywave.mitsuba as a user gets it: the package and Mitsuba 3 in a fresh virtual environment, the tests of the plugins run against it, one example rendered small. Installs LLVM's
# library where it is missing and apt-get is there (as root). PYTHON chooses the interpreter.
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

venv=$(mktemp -d)
trap 'rm -rf "$venv"' EXIT
"${PYTHON:-python3}" -m venv "$venv"
CARGO_TARGET_DIR="$PWD/python/target" "$venv/bin/pip" install --quiet "./python[mitsuba]" "pytest>=7"
"$venv/bin/pytest" -q -p no:cacheprovider python/tests/test_mitsuba.py
"$venv/bin/python" examples/mitsuba/render.py denim_close --width 64 --spp 2 -o "$venv/denim.png"
