#!/usr/bin/env bash
# Installs the library into a scratch folder, compiles the C11 and the C++17 examples with the system's compilers, static and shared, with and without the address and undefined
# behavior sanitizers, runs them, and compares the C example of a ply with the Rust library digit by digit. The program makes the cloth that the examples of cloths load. CC, CXX
# choose other compilers.
set -euo pipefail
cd "$(dirname "$0")/.."
cc=${CC:-cc} cxx=${CXX:-c++}
for tool in "$cc" "$cxx"; do
    command -v "$tool" >/dev/null || { echo "$tool is missing: install a C and C++ compiler" >&2; exit 1; }
done
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
capi/install.sh "$scratch/prefix"
include=$scratch/prefix/include lib=$scratch/prefix/lib
warnings=(-Wall -Wextra -Werror -pedantic)
# The static library with what it asks of the system; the shared one with the place where it lies.
private=$(sed -n 's/^Libs.private: //p' "$lib/pkgconfig/plywave.pc")
read -ra static <<<"$lib/libplywave.a $private"
shared=("-L$lib" -lplywave "-Wl,-rpath,$lib")

read -ra scope <<<"${PLYWAVE_CARGO_SCOPE:--p plywave-capi}"
cargo build --locked --release --quiet "${scope[@]}" --example reference
"${CARGO_TARGET_DIR:-target}/release/examples/reference" >"$scratch/expected.txt"
read -ra program <<<"${PLYWAVE_CARGO_SCOPE:--p plywave-cli}"
cargo build --locked --release --quiet "${program[@]}" --bin plywave
"${CARGO_TARGET_DIR:-target}/release/plywave" weave fabrics/cloths/jersey.toml -q -o "$scratch/jersey.pwc"
for sanitize in "" "-fsanitize=address,undefined -fno-sanitize-recover=all -g"; do
    for kind in static shared; do
        declare -n link=$kind
        echo "-- $kind ${sanitize:+under the sanitizers}"
        # shellcheck disable=SC2086
        "$cc" -std=c11 -O1 "${warnings[@]}" $sanitize -I"$include" capi/examples/ply.c "${link[@]}" -lm -o "$scratch/ply"
        # shellcheck disable=SC2086
        "$cxx" -std=c++17 -O1 "${warnings[@]}" $sanitize -I"$include" capi/examples/cloth.cpp "${link[@]}" -pthread -o "$scratch/material"
        "$scratch/ply" >"$scratch/got.txt"
        diff "$scratch/expected.txt" "$scratch/got.txt"
        "$scratch/material" "$scratch/jersey.pwc"
        # shellcheck disable=SC2086
        "$cc" -std=c11 -O1 "${warnings[@]}" $sanitize -I"$include" capi/examples/cloth.c "${link[@]}" -lm -o "$scratch/cloth"
        "$scratch/cloth" "$scratch/jersey.pwc" fabrics/models/polyester.pwm
    done
done
echo "C and C++ examples: as the Rust library"
