#!/usr/bin/env bash
# Writes the output of every command in docs/reference/commands.md anew, as the program prints it; cli/tests/it/docs.rs holds the page to it. Simulations make it take a minute.
set -euo pipefail
cd "$(dirname "$0")/.."
PLYWAVE_RENEW_DOCS=1 cargo test --release --workspace --test it -- --test-threads 1 --include-ignored docs::output_of
git diff --stat docs/reference/commands.md
