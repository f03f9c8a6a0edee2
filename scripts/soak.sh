#!/usr/bin/env bash
# Soak test: INPUTS mutated files through every loader, then TRIALS kills and faults of runs (scripts/kills.py).
#
#     scripts/soak.sh [INPUTS] [TRIALS] [SEED]       by default 19000000 inputs, a million a kind of file, 100 trials, seed 1
#     SOAK_SECONDS=3600 scripts/soak.sh              ends the inputs after an hour, if they are not done before
#
# Runs from copies of the programs, so that a build beside it changes nothing; the figures are for docs/validation/robustness.md, with the date.
set -euo pipefail
cd "$(dirname "$0")/.."
inputs=${1:-19000000} trials=${2:-100} seed=${3:-1}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cargo build --locked --quiet --release -p plywave-cli
cp target/release/plywave "$work/plywave"
fuzz=$(cargo test --locked --release -p plywave-fuzz --test run --no-run 2>&1 | sed -n 's/.*Executable.*(\(.*\))$/\1/p')
cp "$fuzz" "$work/fuzz"

if [ "$inputs" -gt 0 ]; then
    echo "== $inputs inputs from seed $seed"
    export PLYWAVE_FUZZ_COUNT=$inputs PLYWAVE_FUZZ_SEED=$seed
    if [ -n "${SOAK_SECONDS:-}" ]; then export PLYWAVE_FUZZ_SECONDS=$SOAK_SECONDS; fi
    (cd fuzz/harness && "$work/fuzz" --nocapture --test-threads 1 every_loader_keeps_its_promises)
fi

if [ "$trials" -eq 0 ]; then exit; fi
# Without the farm where its Python package is not installed; PYTHON names the interpreter.
python=${PYTHON:-python3}
farm=()
if ! "$python" -c 'import plywave.cluster, distributed' 2>/dev/null; then
    echo "farm: left out, needs pip install \"./python[cluster]\""
    farm=(--no-farm)
fi
PYTHON=$python "$python" scripts/kills.py --plywave "$work/plywave" --times "$(awk -v n="$trials" 'BEGIN { print n / 100 }')" --seed "$seed" "${farm[@]}"
