#!/usr/bin/env bash
# Soak test: INPUTS mutated files through every loader, then KILLS runs killed with SIGKILL at random moments and resumed, whose results must be those of undisturbed
# runs to the bit; then KILLS merges of parts, killed alike, which leave the whole file or none; then KILLS workers of the farm, where the Python package is installed.
#
#     scripts/soak.sh [INPUTS] [KILLS] [SEED]        by default 19000000 inputs, a million a kind of file, 50 kills, seed 1
#     SOAK_SECONDS=3600 scripts/soak.sh              ends the inputs after an hour, if they are not done before
#
# Runs in a temporary folder, from copies of the programs, so that a build beside it changes nothing; the figures are for docs/validation/robustness.md, with the date.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
inputs=${1:-19000000} kills=${2:-50}
RANDOM=${3:-1}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cargo build --locked --quiet --release -p plywave-cli
cp target/release/plywave "$work/plywave"
fuzz=$(cargo test --locked --release -p plywave-fuzz --test run --no-run 2>&1 | sed -n 's/.*Executable.*(\(.*\))$/\1/p')
cp "$fuzz" "$work/fuzz"
plywave=$work/plywave

if [ "$inputs" -gt 0 ]; then
    echo "== $inputs inputs from seed ${3:-1}"
    export PLYWAVE_FUZZ_COUNT=$inputs PLYWAVE_FUZZ_SEED=${3:-1}
    if [ -n "${SOAK_SECONDS:-}" ]; then export PLYWAVE_FUZZ_SECONDS=$SOAK_SECONDS; fi
    (cd fuzz/harness && "$work/fuzz" --nocapture --test-threads 1 every_loader_keeps_its_promises)
fi

if [ "$kills" -eq 0 ]; then exit; fi
echo "== $kills kills"
cd "$work"
cp "$root/tests/data/small.toml" spec.toml
cat >thin.toml <<'TOML'
name = "thin"
[fiber]
shape = { kind = "circle", radius_um = 1.0 }
size_jitter = 0.1
eta = 1.5
alpha_fiber = 0.2
[ply]
fibers = 3
radius_um = 4.0
[beam]
w0_um = 2.0
TOML

"$plywave" weave "$root/fabrics/cloths/organza.toml" -o organza.pwc --quiet

# A run of each kind, without its output; each takes one to two seconds of a core.
simulate=(simulate spec.toml --preset preview --paths 200000 --quiet)
speckle=(wave speckle thin.toml --instances 480 --lambda 0.5 --w0 30 --quiet)
render=(render organza.pwc --width 64 --height 64 --samples 64 --quiet)
kinds=(simulate speckle render)
outputs=(pwt pws png)

declare -A seconds
for i in "${!kinds[@]}"; do
    begun=$(date +%s%N)
    declare -n run=${kinds[i]}
    "$plywave" "${run[@]}" -o "whole.${outputs[i]}"
    seconds[${kinds[i]}]=$((($(date +%s%N) - begun) / 1000000))
    echo "${kinds[i]}: undisturbed in ${seconds[${kinds[i]}]} ms"
done

landed=0
declare -A hits
for ((n = 0; n < kills; n++)); do
    i=$((n % ${#kinds[@]})) kind=${kinds[n % ${#kinds[@]}]}
    declare -n run=$kind
    out=killed.${outputs[i]}
    rm -rf killed.*
    # One to three kills of the same run, each at a random moment of what an undisturbed one takes.
    for ((k = 0; k <= RANDOM % 3; k++)); do
        "$plywave" "${run[@]}" -o "$out" --resume &
        child=$!
        sleep "$(awk -v ms="${seconds[$kind]}" -v r=$RANDOM 'BEGIN { printf "%.3f", ms * r / 32768e3 }')"
        kill -9 "$child" 2>/dev/null || true
        status=0
        wait "$child" 2>/dev/null || status=$?
        # 137: it was killed. A run that was faster than its kill ended well.
        if [ "$status" -eq 137 ]; then
            landed=$((landed + 1)) hits[$kind]=$((${hits[$kind]:-0} + 1))
        elif [ "$status" -ne 0 ]; then
            echo "kill $n: $kind ended with $status before its kill" >&2
            exit 1
        fi
    done
    "$plywave" "${run[@]}" -o "$out" --resume
    cmp "whole.${outputs[i]}" "$out" || { echo "kill $n: $kind differs from an undisturbed run" >&2; exit 1; }
    if [ "$kind" = render ]; then cmp whole.exr killed.exr; fi
    left=$(find . -maxdepth 1 -name 'killed*.parts' -o -maxdepth 1 -name 'killed*.sums' -o -maxdepth 1 -name '.*tmp*' | wc -l)
    [ "$left" -eq 0 ] || { echo "kill $n: $kind left files behind:" >&2; ls -A >&2; exit 1; }
done
echo "$kills runs killed and resumed, $landed kills while they ran: the bits of undisturbed runs"
for kind in "${kinds[@]}"; do echo "$kind: ${hits[$kind]:-0} kills while it ran"; done

# Merges: finer bins make them longer.
sed 's/phi_o_bins *= *[0-9]*/phi_o_bins = 360/' spec.toml >wide.toml
grep -q phi_o_bins wide.toml || printf '[simulation]\nphi_o_bins = 360\n' >>wide.toml
parts=()
for k in 1 2 3 4; do
    "$plywave" simulate wide.toml --preset preview --paths 20000 --shards $k/4 -o part$k.pwp --quiet
    parts+=(part$k.pwp)
done
begun=$(date +%s%N)
"$plywave" merge "${parts[@]}" -o whole_merge.pwt --quiet
ms=$((($(date +%s%N) - begun) / 1000000))
echo "merge: undisturbed in $ms ms"
landed=0 absent=0
for ((n = 0; n < kills; n++)); do
    rm -f merged.pwt
    "$plywave" merge "${parts[@]}" -o merged.pwt --quiet &
    child=$!
    sleep "$(awk -v ms=$ms -v r=$RANDOM 'BEGIN { printf "%.4f", ms * r / 32768e3 }')"
    kill -9 "$child" 2>/dev/null || true
    status=0
    wait "$child" 2>/dev/null || status=$?
    [ "$status" -eq 0 ] || [ "$status" -eq 137 ] || { echo "merge $n ended with $status" >&2; exit 1; }
    if [ "$status" -eq 137 ]; then landed=$((landed + 1)); fi
    if [ ! -e merged.pwt ]; then
        absent=$((absent + 1))
        "$plywave" merge "${parts[@]}" -o merged.pwt --quiet
    fi
    cmp whole_merge.pwt merged.pwt || { echo "merge $n: the file is not whole" >&2; exit 1; }
done
echo "$kills merges, $landed killed while they ran, $absent of them before their file was there: whole files or none"

# The farm, where the Python package is installed; PYTHON chooses the interpreter.
python=${PYTHON:-python3}
if "$python" -c 'import plywave.cluster, distributed' 2>/dev/null; then
    "$python" "$root/python/tests/soak_cluster.py" --specs spec.toml --workers 2 --kills "$kills" --seconds 1 --seed "${3:-1}"
else
    echo "farm: skipped, needs pip install \"./python[cluster]\""
fi
