#!/usr/bin/env bash
# Builds plywave for C and installs it without cargo-c: capi/install.sh [PREFIX], /usr/local if none is given. DESTDIR is put before it, as packagers like it.
# include/plywave.h, lib/libplywave.a, lib/libplywave.so (macOS: .dylib) with its version, lib/pkgconfig/plywave.pc. It needs Rust alone.
set -euo pipefail
cd "$(dirname "$0")/.."
prefix=${1:-/usr/local}
case $prefix in /*) ;; *) prefix=$PWD/$prefix ;; esac
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
# As cargo-c has it: what changes the first number that is not 0 may break programs.
abi=$(cut -d. -f1 <<<"$version")
[ "$abi" != 0 ] || abi=$(cut -d. -f1,2 <<<"$version")
built=${CARGO_TARGET_DIR:-target}/release
system=$(uname -s)

# The shared library's own name is set by capi/build.rs.
case $system in
Darwin) shared=libplywave.$abi.dylib made=libplywave_capi.dylib name=libplywave.dylib ;;
*) shared=libplywave.so.$abi made=libplywave_capi.so name=libplywave.so ;;
esac
# PLYWAVE_CARGO_SCOPE, as .ci/run has it, takes what a build of the whole workspace has left.
read -ra scope <<<"${PLYWAVE_CARGO_SCOPE:--p plywave-capi}"
cargo build --locked --release --quiet "${scope[@]}" --lib

# What a static library asks of the system, in rustc's words.
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
libs=$(rustc --print native-static-libs --crate-type staticlib --crate-name none -o "$scratch/none.a" - <<<'' 2>&1 | sed -n 's/.*native-static-libs: //p')

to=${DESTDIR:-}$prefix
mkdir -p "$to/include" "$to/lib/pkgconfig"
install -m 644 capi/include/plywave.h "$to/include/plywave.h"
install -m 644 "$built/libplywave_capi.a" "$to/lib/libplywave.a"
install -m 755 "$built/$made" "$to/lib/$shared"
ln -sf "$shared" "$to/lib/$name"
cat >"$to/lib/pkgconfig/plywave.pc" <<PC
prefix=$prefix
libdir=\${prefix}/lib
includedir=\${prefix}/include

Name: plywave
Description: Wave-aware cloth and fiber appearance: evaluates and samples ply, cloth and fiber models.
Version: $version
Libs: -L\${libdir} -lplywave
Libs.private: $libs
Cflags: -I\${includedir}
PC
