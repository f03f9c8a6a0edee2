#!/usr/bin/env bash
# Rebuilds the models that ship in fabrics/models/ from the specs in fabrics/: preset standard, seed 1, without speckle tiles.
#
#   scripts/rebuild_models.sh                  all six yarns
#   scripts/rebuild_models.sh silk wool        these only
#   PRESET=preview OUT=out scripts/rebuild_models.sh     for a try
#
# Interrupted, it goes on where it stopped: finished shards are kept beside the models until each is done.
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${PRESET:-standard}
seed=${SEED:-1}
out=${OUT:-fabrics/models}
yarns=("$@")
[ ${#yarns[@]} -gt 0 ] || yarns=(polyester polyester_3ply cotton silk wool viscose)

cargo build --locked --release -p plywave-cli
mkdir -p "$out"
for yarn in "${yarns[@]}"; do
    [ -f "fabrics/$yarn.toml" ] || { echo "fabrics/$yarn.toml: no such spec" >&2; exit 2; }
done
for yarn in "${yarns[@]}"; do
    target/release/plywave build "fabrics/$yarn.toml" --preset "$preset" --seed "$seed" --smooth --resume -o "$out/$yarn.pwm"
done

echo
for yarn in "${yarns[@]}"; do
    printf '%8d bytes  %s\n' "$(wc -c <"$out/$yarn.pwm")" "$out/$yarn.pwm"
done
