#!/usr/bin/env bash
# Builds plywave for C and installs it without cargo-c: capi/install.sh [PREFIX], /usr/local if none is given. DESTDIR is put before it, as packagers like it.
# include/plywave.h, lib/libplywave.a, lib/libplywave.so (macOS: .dylib) with its version, lib/pkgconfig/plywave.pc and plywave-static.pc, lib/cmake/plywave. It needs Rust alone.
# capi/install.sh --tarball FOLDER packs the same as FOLDER/plywave-VERSION-ARCH-OS.tar.gz, which works wherever it is unpacked, and prints its path.
set -euo pipefail
cd "$(dirname "$0")/.."
tarball=
if [ "${1:-}" = --tarball ]; then
    tarball=${2:?the folder for the tarball is missing: capi/install.sh --tarball FOLDER}
    mkdir -p "$tarball"
    tarball=$(cd "$tarball" && pwd)
fi
case $(uname -s) in
Linux | FreeBSD | NetBSD | OpenBSD | Darwin) ;;
*) echo "capi/install.sh knows Linux, BSD and macOS; elsewhere build with cargo build --release -p plywave-capi and link what is in target/release" >&2 && exit 1 ;;
esac
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
# As cargo-c has it: what changes the first number that is not 0 may break programs.
abi=$(cut -d. -f1 <<<"$version")
[ "$abi" != 0 ] || abi=$(cut -d. -f1,2 <<<"$version")
built=${CARGO_TARGET_DIR:-target}/release
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# The shared library's own name is set by capi/build.rs.
case $(uname -s) in
Darwin) system=macos shared=libplywave.$abi.dylib made=libplywave_capi.dylib name=libplywave.dylib soname=@rpath/libplywave.$abi.dylib ;;
*) system=$(uname -s | tr '[:upper:]' '[:lower:]') shared=libplywave.so.$abi made=libplywave_capi.so name=libplywave.so soname=libplywave.so.$abi ;;
esac
machine=$(uname -m)
package=plywave-$version-${machine/arm64/aarch64}-$system
if [ -n "$tarball" ]; then
    # Relative to the file plywave.pc itself.
    prefix='${pcfiledir}/../..' to=$scratch/$package
else
    prefix=${1:-/usr/local}
    case $prefix in /*) ;; *) prefix=$PWD/$prefix ;; esac
    to=${DESTDIR:-}$prefix
fi

# PLYWAVE_CARGO_SCOPE, as .ci/run has it, takes what a build of the whole workspace has left.
read -ra scope <<<"${PLYWAVE_CARGO_SCOPE:--p plywave-capi}"
cargo build --locked --release --quiet "${scope[@]}" --lib

# The size of a pointer [bits], and what a static library asks of the system, in rustc's words.
pointer=$(rustc --print cfg | sed -n 's/^target_pointer_width="\(.*\)"$/\1/p')
libs=$(rustc --print native-static-libs --crate-type staticlib --crate-name none -o "$scratch/none.a" - <<<'' 2>&1 | sed -n 's/.*native-static-libs: //p')

mkdir -p "$to/include" "$to/lib/pkgconfig" "$to/lib/cmake/plywave"
install -m 644 capi/include/plywave.h "$to/include/plywave.h"
install -m 644 "$built/libplywave_capi.a" "$to/lib/libplywave.a"
install -m 755 "$built/$made" "$to/lib/$shared"
ln -sf "$shared" "$to/lib/$name"

# FILE NAME LIBS LIBS_PRIVATE
pc() {
    cat >"$to/lib/pkgconfig/$1.pc" <<PC
prefix=$prefix
libdir=\${prefix}/lib
includedir=\${prefix}/include

Name: $1
Description: Wave-aware cloth and fiber appearance: evaluates and samples ply, cloth and fiber models.
Version: $version
Libs: $2
Libs.private: $3
Cflags: -I\${includedir}
PC
}
pc plywave "-L\${libdir} -lplywave" "$libs"
pc plywave-static "\${libdir}/libplywave.a $libs" ""

cat >"$to/lib/cmake/plywave/plywaveConfig.cmake" <<CMAKE
# plywave $version: the targets plywave::plywave (shared) and plywave::static.
get_filename_component(_plywave_prefix "\${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
foreach(_plywave_file include/plywave.h lib/$shared lib/libplywave.a)
  if(NOT EXISTS "\${_plywave_prefix}/\${_plywave_file}")
    set(plywave_FOUND FALSE)
    set(plywave_NOT_FOUND_MESSAGE "\${_plywave_prefix}/\${_plywave_file} is missing: install plywave anew")
    return()
  endif()
endforeach()
if(NOT TARGET plywave::plywave)
  add_library(plywave::plywave SHARED IMPORTED)
  set_target_properties(plywave::plywave PROPERTIES
    IMPORTED_LOCATION "\${_plywave_prefix}/lib/$shared"
    IMPORTED_SONAME "$soname"
    INTERFACE_INCLUDE_DIRECTORIES "\${_plywave_prefix}/include")
endif()
if(NOT TARGET plywave::static)
  add_library(plywave::static STATIC IMPORTED)
  set_target_properties(plywave::static PROPERTIES
    IMPORTED_LOCATION "\${_plywave_prefix}/lib/libplywave.a"
    INTERFACE_LINK_LIBRARIES "${libs// /;}"
    INTERFACE_INCLUDE_DIRECTORIES "\${_plywave_prefix}/include")
endif()
unset(_plywave_file)
unset(_plywave_prefix)
CMAKE

# Programs for this first number that is not 0, and no newer version, find it.
cat >"$to/lib/cmake/plywave/plywaveConfigVersion.cmake" <<CMAKE
set(PACKAGE_VERSION "$version")
if(PACKAGE_FIND_VERSION VERSION_EQUAL PACKAGE_VERSION)
  set(PACKAGE_VERSION_EXACT TRUE)
endif()
if(PACKAGE_FIND_VERSION VERSION_GREATER PACKAGE_VERSION OR NOT "\${PACKAGE_FIND_VERSION}." MATCHES "^${abi//./\\\\.}\\\\.")
  set(PACKAGE_VERSION_COMPATIBLE FALSE)
else()
  set(PACKAGE_VERSION_COMPATIBLE TRUE)
endif()
# What is linked has this size of pointers.
if(CMAKE_SIZEOF_VOID_P AND NOT CMAKE_SIZEOF_VOID_P EQUAL $((pointer / 8)))
  set(PACKAGE_VERSION_UNSUITABLE TRUE)
endif()
CMAKE

if [ -n "$tarball" ]; then
    install -m 644 LICENSE-MIT LICENSE-APACHE "$to"
    tar -C "$scratch" -czf "$tarball/$package.tar.gz" "$package"
    echo "$tarball/$package.tar.gz"
fi
