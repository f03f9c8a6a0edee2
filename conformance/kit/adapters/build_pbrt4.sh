#!/bin/sh
# Builds the adapter of pbrt-v4 from a checkout of pbrt, without its submodules (a minute on one core).
#
#     conformance/kit/adapters/build_pbrt4.sh PBRT_CHECKOUT OUT_FOLDER
#
# Needs a C++17 compiler. media.h wants NanoVDB for volumes; a header of that name made of its class HGPhaseFunction
# alone goes before it, as bxdfs.h needs no more.
set -eu
pbrt=${1:?path of a pbrt-v4 checkout} out=${2:?folder for the program}
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out/include/pbrt"
{
    echo '#pragma once'
    for header in base/medium util/print util/sampling util/scattering; do echo "#include <pbrt/$header.h>"; done
    echo 'namespace pbrt {'
    sed -n '/^class HGPhaseFunction/,/^};/p' "$pbrt/src/pbrt/media.h"
    echo '}'
} >"$out/include/pbrt/media.h"
commit=$(git -C "$pbrt" log -1 --format=%h)
# Functions that no model here reaches are not linked, so that their callees may be missing.
flags="-std=c++17 -O2 -w -DNDEBUG -ffunction-sections -fdata-sections -I$out/include -I$pbrt/src -I$pbrt/src/ext"
${CXX:-c++} $flags -DPBRT_COMMIT="\"$commit\"" -c "$here/pbrt4.cpp" -o "$out/pbrt4.o"
${CXX:-c++} $flags -c "$pbrt/src/pbrt/bxdfs.cpp" -o "$out/bxdfs.o"
${CXX:-c++} -Wl,--gc-sections "$out/pbrt4.o" "$out/bxdfs.o" -o "$out/pbrt4"
