#!/usr/bin/env bash
# How far the model of a yarn of several plies is from the path-traced yarn: scripts/yarn_twin.sh [PLIES] [PATHS] [FOLDER]
#
# Simulates one ply of 35 polyester fibers and the traced yarn of such plies at 0, 20 and 40 degrees, makes the yarn's table from the ply's, and prints the
# distances per incidence. With the usual 3 plies and 2000000 paths per latitude, some ten minutes on one core.
set -euo pipefail
cd "$(dirname "$0")/.."
plies=${1:-3}
paths=${2:-2000000}
folder=${3:-target/yarn_twin}
mkdir -p "$folder"

cargo build --release --quiet -p plywave-cli
cargo build --release --quiet -p plywave-studies --bin yarn_twin

# Polyester, with the packing of its 30 fibers. Angles in radians: 9 latitudes to 80 degrees, 3 to 40.
spec() {
    sed -e 's/^fibers = 30/fibers = 35/' -e 's/^radius_um = 50.0/radius_um = 54.01/' fabrics/polyester.toml
    printf '\n[yarn]\nplies = %s\n\n[absorption]\nsigma_per_um = [0.0, 0.01, 0.1]\n' "$plies"
    printf '\n[simulation]\ninstances = 16\nh_nodes = 25\ntheta_o_bins = 45\nphi_o_bins = 90\ntheta_i_nodes = %s\ntheta_i_max_rad = %s\n' "$1" "$2"
}
spec 9 1.3962634015954636 >"$folder/one.toml"
spec 3 0.6981317007977318 >"$folder/traced.toml"

plywave=target/release/plywave
"$plywave" simulate "$folder/one.toml" --paths $((paths / 2)) --resume -o "$folder/one.pwt"
"$plywave" simulate "$folder/traced.toml" --plies traced --paths "$paths" --seed 2 --resume -o "$folder/traced$plies.pwt"
target/release/yarn_twin "$folder/one.pwt" "$folder/traced$plies.pwt"
