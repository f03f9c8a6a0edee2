#!/usr/bin/env bash
# Times of rays against strands beside Embree's curves: the same strands, the same rays, one thread each, by turns; the best of two turns and their ratio.
# Embree is no dependency of the build: Debian's libembree-dev, or libembree4-dev, and a C++ compiler; without them this says so and ends.
#
# scripts/embree_strands.sh [strands [rays]]
set -euo pipefail
cd "$(dirname "$0")/.."
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

for major in 4 3; do
    if [ -e "/usr/include/embree$major/rtcore.h" ] && command -v c++ >/dev/null; then
        c++ -O2 "-DEMBREE=$major" -o "$scratch/strands" scripts/embree/strands.cpp "-lembree$major" && break
    fi
done
if [ ! -x "$scratch/strands" ]; then
    echo "skipped: needs Embree and a C++ compiler (Debian: apt-get install libembree-dev g++)"
    exit 0
fi
cargo build --locked --release ${PLYWAVE_CARGO_SCOPE:--p plywave-studies} --bin strand_speed
for turn in 1 2; do
    "${CARGO_TARGET_DIR:-target}/release/strand_speed" "$scratch/curves.txt" "${1:-10000}" "${2:-300000}" | tee "$scratch/ours.$turn"
    "$scratch/strands" "$scratch/curves.txt" "from all sides" "$scratch/sides.f32" "of a camera" "$scratch/camera.f32" | tee "$scratch/embree.$turn"
done
echo
cat "$scratch"/ours.* "$scratch"/embree.* | awk '
    /^Tube/ { who = "ours tube" } /^Band/ { who = "ours band" }
    /^Embree round/ { who = "embree tube" } /^Embree flat/ { who = "embree band" }
    /M\/s/ {
        match($0, /rays [^:]*/); key = who " " substr($0, RSTART + 5, RLENGTH - 5)
        match($0, /[0-9.]+ M\/s/); speed = substr($0, RSTART, RLENGTH) + 0
        if (speed > best[key]) best[key] = speed
    }
    END {
        for (key in best) if (key ~ /^embree/) {
            what = substr(key, 8)
            printf "%s: %.2f M/s, Embree %.2f M/s, ratio %.2f\n", what, best["ours " what], best[key], best["ours " what] / best[key]
        }
    }' | sort
