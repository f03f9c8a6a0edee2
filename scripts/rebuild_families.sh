#!/usr/bin/env bash
# Rebuilds the families of bundles that `plywave swatch` takes its yarns from, fabrics/families/: half a minute of one core each.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo build --locked --release -p plywave-cli
for family in cotton_bundle polyester_bundle; do
    target/release/plywave family "fabrics/families/$family.toml" --preset preview --nodes 3 --most-nodes 3 --paths 20000 --instances 16 --seed 1 --fresh -o "fabrics/families/$family.pwfam"
done
