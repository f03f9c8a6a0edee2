#!/usr/bin/env python3
"""Differences of the runtime's numbers between instruction sets: the machine's own, AVX2 alone, and neither (SSE 4.2).

    scripts/bits.py [FILE..]        by default all models that ship; .pwm and .pwc are read

The two others are a Haswell and a Nehalem that qemu-user emulates (`apt-get install qemu-user`, 7.2 or newer, for AVX2). Values are those of `viewer/wasm/examples/values.rs`: whole spheres and energies of plies; maps, places and pictures of cloths. A difference counts beside the value or LEAST, whichever is larger. Ends with 1 beyond a limit: an exponential of f32 whose argument is 40 is off by 40 roundings, 2.4e-6, and a value is a sum of products of four of these; a cloth multiplies a few such values."""

import array
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LEAST = 1e-4
LIMITS = {".pwm": 2e-5, ".pwc": 1e-4}
PROCESSORS = {"AVX2": "Haswell", "neither": "Nehalem"}


def values(program: Path, file: Path, before: list[str]) -> array.array:
    numbers = array.array("f")
    numbers.frombytes(subprocess.run([*before, program, file], check=True, capture_output=True, stdin=subprocess.DEVNULL).stdout)
    return numbers


def main() -> int:
    files = [Path(a).resolve() for a in sys.argv[1:]] or sorted((ROOT / "fabrics/models").glob("*.pwm"))
    for file in files:
        if not file.is_file() or file.suffix not in LIMITS:
            sys.exit(f"{file}: give files that end in {' or '.join(LIMITS)}")
    emulator = shutil.which("qemu-x86_64")
    if emulator is None:
        sys.exit("qemu-x86_64 is missing: install qemu-user")
    subprocess.run(["cargo", "build", "--locked", "--release", "--quiet", "-p", "plywave-web", "--example", "values"], cwd=ROOT, check=True)
    program = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release/examples/values"
    flags = Path("/proc/cpuinfo").read_text()
    own_set = "AVX-512" if "avx512vl" in flags else "AVX2" if "avx2" in flags else "neither"
    print(f"| file | {own_set} beside | numbers | same bits | largest difference | limit |\n|---|---|---|---|---|---|")
    is_over = False
    for file in files:
        own = values(program, file, [])
        for name, processor in PROCESSORS.items():
            other = values(program, file, [emulator, "-cpu", processor])
            assert len(own) == len(other) > 1000
            same = sum(a == b for a, b in zip(own, other)) / len(own)
            worst = max(abs(a - b) / max(abs(a), LEAST) for a, b in zip(own, other))
            limit = LIMITS[file.suffix]
            is_over |= not worst <= limit
            print(f"| {file.name} | {name} | {len(own)} | {100 * same:.1f} % | {worst:.1e} | {limit:g} |", flush=True)
    return int(is_over)


if __name__ == "__main__":
    sys.exit(main())
