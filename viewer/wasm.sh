#!/usr/bin/env bash
# Builds viewer/wasm for the browser into viewer/pkg: needs Rust with the target wasm32-unknown-unknown, and installs the wasm-bindgen of Cargo.lock into the
# target folder where it is missing.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
version=$(sed -n '/^name = "wasm-bindgen"$/{n;s/version = "\(.*\)"/\1/p}' Cargo.lock)
tools=$target/tools
if [ "$("$tools/bin/wasm-bindgen" --version 2>/dev/null)" != "wasm-bindgen $version" ]; then
    cargo install --quiet wasm-bindgen-cli --version "$version" --no-default-features --root "$tools"
fi
rustup target add wasm32-unknown-unknown >/dev/null 2>&1 || true
# Every browser since 2023 has these instructions.
RUSTFLAGS="-C target-feature=+simd128" cargo build --locked --quiet --profile web --target wasm32-unknown-unknown -p plywave-web
"$tools/bin/wasm-bindgen" --target web --out-dir viewer/pkg "$target/wasm32-unknown-unknown/web/plywave_web.wasm"
printf 'viewer/pkg/plywave_web_bg.wasm: %d bytes, %d by gzip\n' "$(wc -c <viewer/pkg/plywave_web_bg.wasm)" "$(gzip -9 -c viewer/pkg/plywave_web_bg.wasm | wc -c)"
