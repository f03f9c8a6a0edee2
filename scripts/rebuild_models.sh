#!/usr/bin/env bash
# Rebuilds the models that ship in fabrics/models/ from the specs in fabrics/: preset standard, seed 1, with speckle of single fibers. Yarns of several
# plies, NAME_Pply, are made of the table of one ply, NAME. Plies of the cloths that ship are of preview quality, that of satin at standard, without speckle.
#
#   scripts/rebuild_models.sh                  all yarns and plies
#   scripts/rebuild_models.sh silk wool_2ply   these only
#   PRESET=preview OUT=out scripts/rebuild_models.sh     for a try
#
# Interrupted, it goes on where it stopped. The tables, 150 MiB each at standard, and the patterns of fibers (NAME.pws) are kept in target/tables/ for the next run; TABLES names another folder.
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${PRESET:-standard}
seed=${SEED:-1}
out=${OUT:-fabrics/models}
tables=${TABLES:-target/tables}/$preset-$seed
yarns=("$@")
# Plies of cloths; their specs are in fabrics/models/plies.json.
plies=" cotton_bundle_ne40 cotton_bundle_ne7 cotton_single flax_bundle glass_bundle polyester_bundle silk_single worsted_bundle worsted_single "
is_ply() { [[ $plies == *" $1 "* ]]; }
[ ${#yarns[@]} -gt 0 ] || yarns=($plies polyester polyester_3ply cotton cotton_2ply cotton_3ply cotton_4ply silk wool wool_2ply viscose alpaca gold glass)

cargo build --locked --release -p plywave-cli
mkdir -p "$out" "$tables"
# Fibers whose patterns speckle is made from: all that build takes where circles are solved in moments; elsewhere what some minutes allow.
fibers() {
    case $1 in
        polyester | gold | glass) echo 200 ;;
        wool | alpaca) echo 100 ;;
        silk) echo 50 ;;
        *) echo 24 ;;
    esac
}
for yarn in "${yarns[@]}"; do
    is_ply "$yarn" || [ -f "fabrics/$yarn.toml" ] || { echo "fabrics/$yarn.toml: no such spec" >&2; exit 2; }
done
for yarn in "${yarns[@]}"; do
    if is_ply "$yarn"; then
        python3 -c 'import json, sys; print(json.load(open("fabrics/models/plies.json"))[sys.argv[1]], end="")' "$yarn" >"$tables/$yarn.toml"
        # Filaments of a satin need the finer grid.
        if [ "$yarn" = polyester_bundle ]; then
            target/release/plywave simulate "$tables/$yarn.toml" --preset "$preset" --seed "$seed" --resume -o "$tables/$yarn.pwt"
            target/release/plywave fit "$tables/$yarn.pwt" -o "$out/$yarn.pwm"
            continue
        fi
        # Few fibers in a bundle make sharp slices, which three lobes fit within .4.
        target/release/plywave build "$tables/$yarn.toml" --preset preview --seed "$seed" --max-error-refl 0.4 -o "$out/$yarn.pwm"
        continue
    fi
    ply=${yarn%_[2-7]ply}
    table=$tables/$ply.pwt
    # A table older than its spec is of another yarn.
    if [ ! -f "$table" ] || [ "fabrics/$ply.toml" -nt "$table" ]; then
        target/release/plywave simulate "fabrics/$ply.toml" --preset "$preset" --seed "$seed" --resume -o "$table"
    fi
    patterns=$tables/$ply-$(fibers "$ply").pws
    if [ ! -f "$patterns" ] || [ "fabrics/$ply.toml" -nt "$patterns" ]; then
        target/release/plywave wave speckle "fabrics/$ply.toml" --instances "$(fibers "$ply")" --seed "$seed" --resume -o "$patterns"
    fi
    target/release/plywave fit "$table" --spec "fabrics/$yarn.toml" -o "$tables/$yarn-smooth.pwm"
    target/release/plywave noise "$patterns" -m "$tables/$yarn-smooth.pwm" --seed "$seed" -o "$out/$yarn.pwm"
done
[ "$out" != fabrics/models ] || scripts/model_index.py

echo
for yarn in "${yarns[@]}"; do
    printf '%8d bytes  %s\n' "$(wc -c <"$out/$yarn.pwm")" "$out/$yarn.pwm"
done
