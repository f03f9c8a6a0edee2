#!/usr/bin/env bash
# Rehearses a release and publishes nothing: scripts/rehearse_release.sh [--quick] makes every package for this machine into target/release_rehearsal, installs each as a user does,
# and compares one evaluation with the Rust library's. It ends with a table. Without --quick it also builds every crate from its package, compares public interfaces with the last
# release (a tag v*), compiles the source distribution, and cross compiles wheels by zig.
# Needs Rust 1.90 or newer, a C compiler, pkg-config, Node 20 with npm, Python 3.11 with pip; installs maturin, cmake and ziglang into the target folder.
set -euo pipefail
cd "$(dirname "$0")/.."
case ${1:-} in
"") quick= ;;
--quick) quick=1 ;;
*) echo "scripts/rehearse_release.sh [--quick]" >&2 && exit 2 ;;
esac

missing=()
need() { command -v "$1" >/dev/null || missing+=("$1 is missing: $2"); }
python=${PYTHON:-python3}
cc=${CC:-cc}
need cargo "install Rust 1.90 or newer"
need "$cc" "install a C compiler, or set CC"
need pkg-config "install pkg-config or pkgconf"
need node "install Node 20 or newer"
need npm "install npm, which comes with Node"
need "$python" "install Python 3.11 or newer, or set PYTHON"
"$python" -c 'import ensurepip, tomllib, venv' 2>/dev/null || missing+=("$python cannot make virtual environments: install Python 3.11 or newer with venv and pip")
if [ ! -d "$(rustc --print sysroot)/lib/rustlib/wasm32-unknown-unknown" ]; then
    rustup target add wasm32-unknown-unknown >/dev/null 2>&1 || missing+=("Rust has no target wasm32-unknown-unknown: rustup target add wasm32-unknown-unknown")
fi
release=$(git describe --tags --match 'v*' --abbrev=0 2>/dev/null || true)
if [ -z "$quick" ] && [ -n "$release" ]; then
    cargo semver-checks --version >/dev/null 2>&1 || missing+=("cargo semver-checks is missing: cargo install cargo-semver-checks")
fi
if [ ${#missing[@]} != 0 ]; then
    printf '%s\n' "${missing[@]}" >&2
    exit 1
fi

# Everything is built in one target folder.
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}
mkdir -p "$CARGO_TARGET_DIR"
CARGO_TARGET_DIR=$(cd "$CARGO_TARGET_DIR" && pwd)
out=$CARGO_TARGET_DIR/release_rehearsal
rm -rf "$out"
mkdir -p "$out"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
model=$PWD/fabrics/models/polyester.pwm
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)

step() {
    [ -z "${begun:-}" ] || printf -- '-- %d s\n' $((SECONDS - begun))
    begun=$SECONDS
    printf '\n== %s\n' "$*"
}
# COMMAND: its output is shown only where it fails.
quietly() { "$@" >"$scratch/log" 2>&1 || { cat "$scratch/log" >&2 && exit 1; }; }
# FILE MADE_BY TESTED: a row of the table.
rows=()
row() { rows+=("$(printf '%s\t%s\t%s\t%s' "$(basename "$1")" "$(du -k "$1" | cut -f1) KiB" "$2" "$3")"); }
# NAME NUMBERS: f at three wavelengths, and the density if it is given, are those of the Rust library.
same() {
    "$python" - "$1" "$expected" "$2" <<'PY'
import sys

name, expected, got = sys.argv[1], *([float(v) for v in text.split()] for text in sys.argv[2:])
if len(got) not in (3, 4) or any(not abs(a - b) <= 1e-5 * abs(b) for a, b in zip(got, expected)):
    sys.exit(f"{name}: {got}, but the Rust library has {expected}")
print(f"{name}: {got}, as the Rust library")
PY
}

step "versions"
"$python" - <<'PY'
import json, sys, tomllib

read = lambda file: tomllib.load(open(file, "rb"))
workspace = read("Cargo.toml")["workspace"]
version = workspace["package"]["version"]
others = {f"Cargo.toml, {name}": of["version"] for name, of in workspace["dependencies"].items() if "path" in of}
others["python/Cargo.toml"] = read("python/Cargo.toml")["package"]["version"]
others["viewer/package.json"] = json.load(open("viewer/package.json"))["version"]
wrong = [f"{place}: version {other}, but the workspace has {version}" for place, other in others.items() if other != version]
sys.exit("\n".join(wrong) or None)
PY
if [ "${GITHUB_REF_TYPE:-}" = tag ] && [ "${GITHUB_REF_NAME:-}" != "v$version" ]; then
    echo "the tag is ${GITHUB_REF_NAME:-}, but the version of the workspace is $version" >&2
    exit 1
fi
echo "$version"

step "what the Rust library evaluates"
read -ra scope <<<"${PLYWAVE_CARGO_SCOPE:--p plywave-capi}"
cargo build --locked --release --quiet "${scope[@]}" --example reference
"$CARGO_TARGET_DIR/release/examples/reference" "$model" >"$scratch/expected.txt"
expected=$(sed -n 's/^eval //p' "$scratch/expected.txt" | head -1)
echo "$expected"

step "crates"
# Changes that are not committed are packaged too: this is no release.
how=(cargo publish --workspace --locked --dry-run --allow-dirty)
[ -z "$quick" ] || how+=(--no-verify)
rm -rf "$CARGO_TARGET_DIR/package"
"${how[@]}" --quiet
mkdir "$out/crates"
find "$CARGO_TARGET_DIR/package" -name '*.crate' -exec cp {} "$out/crates" \;
for crate in "$out"/crates/*.crate; do
    row "$crate" "cargo publish --dry-run" "$([ -n "$quick" ] && echo "packaged" || echo "built from the package")"
done
if [ -z "$quick" ]; then
    if [ -z "$release" ]; then echo "no release yet to compare public interfaces with"; else
        cargo semver-checks --workspace --exclude plywave-fuzz --exclude plywave-studies --baseline-rev "$release"
    fi
fi

step "C"
tarball=$(capi/install.sh --tarball "$out")
tools=$CARGO_TARGET_DIR/tools/release
[ -x "$tools/bin/pip" ] || "$python" -m venv "$tools"
"$tools/bin/pip" install --quiet "maturin>=1.9,<2" cmake
mkdir "$scratch/c"
tar -C "$scratch/c" -xzf "$tarball"
prefix=$(echo "$scratch"/c/*)
for name in plywave plywave-static; do
    read -ra flags <<<"$(PKG_CONFIG_PATH=$prefix/lib/pkgconfig pkg-config --cflags --libs "$name")"
    "$cc" -std=c11 capi/examples/ply.c "${flags[@]}" -Wl,-rpath,"$prefix/lib" -lm -o "$scratch/c/ply"
    "$scratch/c/ply" "$model" | diff "$scratch/expected.txt" - || { echo "C by pkg-config $name: other numbers than the Rust library" >&2 && exit 1; }
    echo "C by pkg-config $name: as the Rust library, digit by digit"
done
cat >"$scratch/c/CMakeLists.txt" <<CMAKE
cmake_minimum_required(VERSION 3.16)
project(host C)
find_package(plywave $version REQUIRED)
foreach(kind plywave static)
  add_executable(host_\${kind} $PWD/capi/examples/ply.c)
  set_target_properties(host_\${kind} PROPERTIES C_STANDARD 11)
  target_link_libraries(host_\${kind} plywave::\${kind} m)
endforeach()
CMAKE
quietly "$tools/bin/cmake" -S "$scratch/c" -B "$scratch/c/build" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_C_COMPILER="$cc"
quietly "$tools/bin/cmake" --build "$scratch/c/build"
for kind in plywave static; do
    "$scratch/c/build/host_$kind" "$model" | diff "$scratch/expected.txt" - || { echo "C by CMake plywave::$kind: other numbers than the Rust library" >&2 && exit 1; }
    echo "C by CMake plywave::$kind: as the Rust library, digit by digit"
done
row "$tarball" "capi/install.sh --tarball" "pkg-config and CMake, static and shared; digit by digit"

step "npm"
package=$(viewer/npm.sh "$out")
[ -x viewer/node_modules/.bin/tsc ] || npm --prefix viewer ci --silent
mkdir "$scratch/npm"
echo '{ "private": true, "type": "module" }' >"$scratch/npm/package.json"
npm --prefix "$scratch/npm" install --silent --offline --no-audit --no-fund "$package"
cat >"$scratch/npm/host.ts" <<'TS'
import init, { initSync, Ply, version } from "plywave";

export async function host(bytes: Uint8Array, module: BufferSource): Promise<number[]> {
  if (version() === "") await init();
  initSync({ module });
  const ply: Ply = new Ply(bytes, "polyester.pwm");
  const f: Float32Array = ply.eval(0.5, 10, 0.004, 0.55, true, new Float32Array([0, 1, 0]));
  return [...f, ply.hMaxUm];
}
TS
viewer/node_modules/.bin/tsc --noEmit --strict --target ES2022 --lib ESNext,DOM --module NodeNext --moduleResolution NodeNext --types "" "$scratch/npm/host.ts"
cat >"$scratch/npm/host.mjs" <<'JS'
import { readFileSync } from "node:fs";
import { initSync, Ply, version } from "plywave";

initSync({ module: readFileSync(new URL(import.meta.resolve("plywave/plywave_web_bg.wasm"))) });
const [, , file, expected] = process.argv;
if (version() !== expected) throw new Error(`version ${version()}, not ${expected}`);
const ply = new Ply(readFileSync(file), file);
// Absorption and wavelength of red, green and blue.
const channels = [[0.001, 0.612], [0.004, 0.549], [0.01, 0.464]];
console.log(channels.map(([sigma, lambda]) => ply.eval(0.5, 10, sigma, lambda, true, [0, 1, 0])[0]).join(" "));
JS
same "npm" "$(node "$scratch/npm/host.mjs" "$model" "$version")"
row "$package" "viewer/npm.sh" "npm install; evaluated in Node $(node --version); types by tsc"

step "Python"
index=$out/python
quietly "$tools/bin/maturin" build --release --manifest-path python/Cargo.toml --interpreter "$python" --out "$index"
PATH=$tools/bin:$PATH quietly python/sdist.sh "$index"
# A local index: what wheel and source distribution depend on lies beside them.
"$tools/bin/pip" download --quiet --dest "$scratch/index" numpy "maturin>=1.9,<2"
cat >"$scratch/host.py" <<'PY'
import sys
import numpy as np
import plywave

assert plywave.__version__ == sys.argv[2], plywave.__version__
w, sigma_per_um = np.array([0.0, 1.0, 0.0]), [0.001, 0.004, 0.010]
f, pdf = plywave.load(sys.argv[1]).eval_pdf(0.5, 10.0, w, sigma_per_um)
assert (plywave.load("polyester").eval(0.5, 10.0, w, sigma_per_um) == f).all()
print(*f, pdf)
PY
# NAME PACKAGE: installs it from the local index into a fresh environment and evaluates.
try_python() {
    "$python" -m venv --clear "$scratch/venv"
    "$scratch/venv/bin/pip" install --quiet --no-index --find-links "$scratch/index" "$2"
    same "$1" "$(cd "$scratch" && venv/bin/python host.py "$model" "$version")"
}
wheel=$(echo "$index"/*.whl) source=$(echo "$index"/*.tar.gz)
try_python "$(basename "$wheel")" "$wheel"
row "$wheel" "maturin build" "pip install --no-index; evaluated in $("$python" --version)"
if [ -z "$quick" ]; then
    try_python "$(basename "$source")" "$source"
    row "$source" "python/sdist.sh" "compiled by pip install --no-index; evaluated in $("$python" --version)"
else
    tar -C "$scratch" -xzf "$source"
    # Without the extension itself: checked in another environment than maturin's, it would be compiled anew the next time.
    quietly cargo check --release --locked --manifest-path "$scratch/plywave-$version/python/Cargo.toml" -p plywave-pipeline
    row "$source" "python/sdist.sh" "cargo check of its crates"
fi

if [ -z "$quick" ]; then
    step "wheels of other platforms"
    # ARGUMENTS: builds a wheel and has its path in `made_wheel`.
    cross() {
        rm -rf "$scratch/wheel"
        PATH=$tools/bin:$PATH quietly maturin build --release --manifest-path python/Cargo.toml --out "$scratch/wheel" "$@"
        made_wheel=$index/$(basename "$scratch"/wheel/*.whl)
        mv "$scratch"/wheel/*.whl "$made_wheel"
    }
    # Python 3.14t has an interface of its own; maturin knows it where it is not installed.
    cross --interpreter python3.14t
    tested="audited by maturin; no python3.14t here"
    if command -v python3.14t >/dev/null; then
        "$tools/bin/pip" download --quiet --no-deps --dest "$scratch/index" --python-version 3.14 --abi cp314t --only-binary :all: numpy
        python=python3.14t try_python "$(basename "$made_wheel")" "$made_wheel"
        tested="pip install --no-index; evaluated in $(python3.14t --version)"
    fi
    row "$made_wheel" "maturin build -i python3.14t" "$tested"
    "$tools/bin/pip" install --quiet ziglang
    for built in "x86_64-unknown-linux-gnu manylinux2014" "aarch64-unknown-linux-gnu manylinux2014" "x86_64-unknown-linux-musl musllinux_1_2" "aarch64-unknown-linux-musl musllinux_1_2"; do
        read -r triple compatibility <<<"$built"
        rustup target add "$triple" >/dev/null 2>&1 || { echo "skipped: Rust's target $triple cannot be installed here"; continue; }
        cross --zig --target "$triple" --compatibility "$compatibility"
        tested="audited by maturin; of another platform"
        if [ "$triple" = "$(rustc --print host-tuple)" ]; then
            try_python "$(basename "$made_wheel")" "$made_wheel"
            tested="pip install --no-index; evaluated in $("$python" --version)"
        fi
        row "$made_wheel" "maturin build --zig" "$tested"
    done
fi

step "packages"
printf '%s\t%s\t%s\t%s\n' "package" "size" "made by" "tested" "-------" "----" "-------" "------" | cat - <(printf '%s\n' "${rows[@]}") | column -t -s $'\t'
echo "in $out; nothing was published"
