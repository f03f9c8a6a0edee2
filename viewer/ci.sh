#!/usr/bin/env bash
# Builds the viewer and tests it: values beside native ones, and the page in headless Chromium, which is installed where it is missing and apt-get is there (as root).
# Needs Rust, Node, and the program in target/release.
set -euo pipefail
cd "$(dirname "$0")"
if [ -z "${CHROMIUM:-}" ]; then
    command -v chromium >/dev/null || { apt-get update -qq && apt-get install -y -qq chromium >/dev/null; } || true
    CHROMIUM=$(command -v chromium) || echo "Chromium is missing and the page is not tested: install it, or set CHROMIUM" >&2
    export CHROMIUM
fi
program=${CARGO_TARGET_DIR:-$PWD/../target}/release/plywave
[ -x "$program" ] || { echo "$program is missing: cargo build --release" >&2; exit 1; }
# Not --silent: npm would fail without a word.
npm ci --loglevel=error --no-audit --no-fund >/dev/null
./wasm.sh
npm run --loglevel=error build
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"$program" weave ../fabrics/cloths/jersey.toml -q -o "$scratch/jersey.pwc"
node --test tests/scripts.test.mjs
PLYWAVE=$program PLYWAVE_CLOTH=$scratch/jersey.pwc node --test tests/values.test.mjs
[ -z "$CHROMIUM" ] || PLYWAVE=$program node --test tests/page.test.mjs
