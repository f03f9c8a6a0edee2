#!/usr/bin/env bash
# Makes capi/include/plywave.h of capi/src by cbindgen, of the version in capi/header/Cargo.lock. With --check it writes nothing and fails where the committed header differs.
set -euo pipefail
cd "$(dirname "$0")"
exec cargo run --locked --quiet --release --manifest-path header/Cargo.toml --target-dir ../target/header -- "$@"
