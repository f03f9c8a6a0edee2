#!/usr/bin/env bash
# Checks and times the Mitsuba plugins on an NVIDIA GPU: parity with the native library, chi-square tests and
# gradients, throughput beside Mitsuba's own BSDFs, and the satin drape at 1280 x 800 with 256 samples.
# A part that fails prints one line, the others go on, and the exit status is 1.
#
#   scripts/gpu_check.sh [--variant V].. [--small] [--out FOLDER]
#
# Without --variant: cuda_ad_rgb and cuda_ad_spectral. A dry run on a CPU: --variant llvm_ad_rgb --small.
# PYTHON is the interpreter that has plywave and Mitsuba. Scenes need OptiX (libnvoptix.so.1, of the driver).
set -uo pipefail
cd "$(dirname "$0")/.."

variants=() small=() out=gpu_check
while [ $# -gt 0 ]; do
    case $1 in
        --variant) variants+=("$2"); shift ;;
        --small) small=(--small) ;;
        --out) out=$2; shift ;;
        *) echo "unknown option $1" >&2; exit 2 ;;
    esac
    shift
done
[ ${#variants[@]} -gt 0 ] || variants=(cuda_ad_rgb cuda_ad_spectral)
python=${PYTHON:-python3}
export PYTHONUNBUFFERED=1
mkdir -p "$out"
log=$out/gpu_check.log
: >"$log"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
status=0
say() { printf '%s\n' "$*" | tee -a "$log"; }

# Libraries of the driver may lie where the loader does not look.
for folder in /usr/local/nvidia/lib64 /usr/lib/x86_64-linux-gnu /usr/lib64 /usr/lib/wsl/lib; do
    for pair in DRJIT_LIBCUDA_PATH:libcuda.so DRJIT_LIBOPTIX_PATH:libnvoptix.so; do
        name=${pair%%:*} found=
        for file in "$folder/${pair##*:}.1" "$folder/${pair##*:}".[0-9]*; do
            [ -e "$file" ] && { found=$file; break; }
        done
        if [ -n "$found" ] && [ -z "${!name:-}" ]; then
            export "$name=$found" LD_LIBRARY_PATH="$folder${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
        fi
    done
done

say "date: $(date -u '+%Y-%m-%d %H:%M UTC')"
say "machine: $(uname -sr), $(nproc) threads, $(grep -m1 'model name' /proc/cpuinfo | cut -d: -f2- | xargs)"
if command -v nvidia-smi >/dev/null; then
    say "card: $(nvidia-smi --query-gpu=name,memory.total,driver_version,compute_cap --format=csv,noheader 2>&1 | head -1)"
    say "CUDA of the driver: $(nvidia-smi 2>/dev/null | grep -o 'CUDA Version: [0-9.]*' | grep -o '[0-9.]*$')"
else
    say "card: none (no nvidia-smi)"
fi
say "OptiX: ${DRJIT_LIBOPTIX_PATH:-not found in the usual folders}"
"$python" scripts/gpu_check.py versions >"$scratch/versions" 2>&1 || status=1
say "versions: $(tail -1 "$scratch/versions")"

# part VARIANT NAME SECONDS: one part in its own process, with an empty cache of kernels.
part() {
    local home=$scratch/$1.$2 begun=$SECONDS code
    mkdir -p "$home"
    {
        printf '\n== %s, %s\n' "$2" "$1"
        HOME=$home timeout "$3" "$python" scripts/gpu_check.py "$2" --variant "$1" --out "$out" \
            --mesh "$scratch/sheet.npy" ${small[@]+"${small[@]}"} 2>&1
        code=$?
        if [ $code -ne 0 ]; then printf 'FAILED: part %s, %s: exit status %s\n' "$2" "$1" "$code"; fi
        printf -- '-- %s s\n' $((SECONDS - begun))
    } >"$home/log"
    return $code
}
# What a part said, to the log. Its kernels are not needed any longer.
tell() { tee -a "$log" <"$scratch/$1.$2/log"; rm -rf "$scratch/$1.$2/.drjit" "$scratch/$1.$2/.nv"; }
# run SECONDS VARIANT:NAME..: parts, side by side where there are enough cores.
run() {
    local seconds=$1 pids=() which
    shift
    for which in "$@"; do
        if [ "$(nproc)" -ge 8 ]; then
            part "${which%%:*}" "${which##*:}" "$seconds" &
            pids+=($!)
        else
            part "${which%%:*}" "${which##*:}" "$seconds" || status=1
            tell "${which%%:*}" "${which##*:}"
        fi
    done
    [ ${#pids[@]} -gt 0 ] || return 0
    for which in "${pids[@]}"; do wait "$which" || status=1; done
    for which in "$@"; do tell "${which%%:*}" "${which##*:}"; done
}

# Kernels of gradients take minutes to compile: beside all others where there are enough cores, else last.
# A dry run does without.
gradients=()
[ ${#small[@]} -gt 0 ] || gradients=("${variants[@]}")
pids=()
if [ "$(nproc)" -ge 8 ]; then
    for v in ${gradients[@]+"${gradients[@]}"}; do
        part "$v" gradients "${GRADIENT_SECONDS:-300}" &
        pids+=($!)
    done
fi

# Checks, and the sheet of the drape; then times, one part at a time.
checks=("${variants[0]}:mesh")
for v in "${variants[@]}"; do
    for name in probe parity_plies parity_cloths parity_fibers samples weights; do checks+=("$v:$name"); done
done
run "${CHECK_SECONDS:-180}" "${checks[@]}"
for v in "${variants[@]}"; do
    if grep -q FAILED "$scratch/$v.probe/log"; then
        say "FAILED: scenes, $v: no rays can be traced, so no scene is rendered"
        status=1
    else
        run "${CURVE_SECONDS:-100}" "$v:curves"
        run "${DRAPE_SECONDS:-150}" "$v:drape"
    fi
    run "${SPEED_SECONDS:-120}" "$v:speed"
done
if [ ${#pids[@]} -gt 0 ]; then
    for pid in "${pids[@]}"; do wait "$pid" || status=1; done
    for v in "${gradients[@]}"; do tell "$v" gradients; done
else
    for v in ${gradients[@]+"${gradients[@]}"}; do run "${GRADIENT_SECONDS:-900}" "$v:gradients"; done
fi

say ""
say "log: $log"
if [ $status -eq 0 ]; then say "all parts passed"; else
    say "failed:"
    grep FAILED "$log" | sort -u | sed 's/^/    /' >"$scratch/failed"
    tee -a "$log" <"$scratch/failed"
fi
exit $status
