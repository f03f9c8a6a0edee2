#!/usr/bin/env bash
# Builds viewer/wasm and viewer/weaver for the browser into viewer/pkg: needs Rust. Where they are missing, it adds Rust's target wasm32-unknown-unknown by rustup, and installs
# the wasm-bindgen of Cargo.lock into the target folder.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
# WHAT COMMAND..: runs it; where it fails, its own words stand above the line that says what is missing.
needed() {
    local what=$1
    shift
    "$@" || { echo "viewer/wasm.sh: $what" >&2; exit 1; }
}
version=$(sed -n '/^name = "wasm-bindgen"$/{n;s/version = "\(.*\)"/\1/p}' Cargo.lock)
tools=$target/tools
if [ "$("$tools/bin/wasm-bindgen" --version 2>/dev/null)" != "wasm-bindgen $version" ]; then
    needed "wasm-bindgen $version could not be installed: cargo install wasm-bindgen-cli --version $version --root $tools" \
        cargo install --quiet wasm-bindgen-cli --version "$version" --no-default-features --root "$tools"
fi
if [ ! -d "$(rustc --print sysroot)/lib/rustlib/wasm32-unknown-unknown" ]; then
    needed "Rust's target wasm32-unknown-unknown could not be added: rustup target add wasm32-unknown-unknown, or install it with your Rust" \
        rustup target add wasm32-unknown-unknown >&2
fi
# Every browser since 2023 has these instructions.
# Apart: dependencies of the one get no features from the other.
for crate in plywave-web plywave-weaver; do
    RUSTFLAGS="-C target-feature=+simd128" cargo build --locked --quiet --profile web --target wasm32-unknown-unknown -p "$crate"
done
for module in plywave_web plywave_weaver; do
    "$tools/bin/wasm-bindgen" --target web --out-dir viewer/pkg "$target/wasm32-unknown-unknown/web/$module.wasm"
    made=viewer/pkg/${module}_bg.wasm
    printf '%s: %d bytes, %d by gzip\n' "$made" "$(wc -c <"$made")" "$(gzip -9 -c "$made" | wc -c)"
done
