#!/usr/bin/env bash
# All tests: Rust's fast and slow ones, the C interface, Python with farm and Mitsuba. Prints the seconds of each part; ends with 1 where one fails.
set -uo pipefail
cd "$(dirname "$0")/.."

failed=0
summary=()
part() {
    local name=$1 begun=$SECONDS
    shift
    printf '\n== %s\n' "$name"
    if "$@"; then summary+=("$(printf '%5d s  passed  %s' $((SECONDS - begun)) "$name")"); else
        summary+=("$(printf '%5d s  FAILED  %s' $((SECONDS - begun)) "$name")")
        failed=1
    fi
}
part "compile" cargo test --locked --workspace --release --no-run --quiet
part "fast tests" cargo test --locked --workspace --release --quiet
part "slow tests" scripts/slow_tests.py
part "C interface" capi/run_examples.sh
part "Python, farm and Mitsuba" python/ci.sh
printf '\n'
printf '%s\n' "${summary[@]}"
exit $failed
