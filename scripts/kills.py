#!/usr/bin/env python3
"""Kills and faults: each ends with the bits of an undisturbed run, or with one line that says what to do.

    python3 scripts/kills.py                                  100 trials over all kinds
    python3 scripts/kills.py --only changed full --times 3    three times as many of two kinds
    python3 scripts/kills.py --no-farm                        without the Python package and Dask

A trial disturbs one command in a folder of its own. Most disturbances are set off by scripts/faults.c, which is
preloaded into the command and counts its file operations, so that they come at a random operation and not only at
a random time; hence Linux and a C compiler (cc). After the disturbance every output is whole, the old one, or
absent; the command is run again, undisturbed, and its outputs must have the bits of an undisturbed run, with
nothing else left in the folder. Prints a line a trial and a table; exit code 1 where one of these fails.

PYTHON names the interpreter of the farm, which has plywave and distributed.
"""

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 600.0
YEAR_S = 365 * 86400

THIN = (ROOT / "tests/data/thin.toml").read_text()
TINY = (ROOT / "tests/data/tiny.toml").read_text()
CLOTH = """name = "open cotton"
[weave]
kind = "plain"
ends_per_cm = 20
picks_per_cm = 20
[warp]
model = "cotton.pwm"
fiber = "cotton"
count = "5.27 tex"
packing = 0.5
color = [0.88, 0.88, 0.86]
[weft]
as = "warp"
"""


class Miss(Exception):
    """A promise that was not kept."""


@dataclass
class Command:
    """A command of the program, run in a folder that has its inputs."""

    args: list
    inputs: dict
    """Name to bytes."""
    outputs: list
    resumes: bool = False
    """Whether it takes --resume."""
    changes: list = field(default_factory=list)
    """Inputs that trials change, each with another valid content."""
    whole: dict = field(default_factory=dict)
    """The outputs of an undisturbed run."""
    steps: int = 0
    """Operations of it that change files."""
    seconds: float = 0.0


@dataclass
class Ended:
    code: int
    err: str


class Bench:
    """The program, the preloaded faults, and a folder for the trials."""

    def __init__(self, folder, program, rng):
        self.folder, self.program, self.rng, self.number = Path(folder), program, rng, 0
        self.faults = self.folder / "faults.so"
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", str(ROOT / "scripts/faults.c"), "-o", str(self.faults), "-ldl"], check=True)

    def fresh(self, command, old=None):
        """A folder with the inputs of a command, and the outputs of an older run."""
        self.number += 1
        path = self.folder / f"trial{self.number}"
        path.mkdir()
        for name, data in {**command.inputs, **(old or {})}.items():
            (path / name).parent.mkdir(exist_ok=True)
            (path / name).write_bytes(data)
        return path

    def env(self, path, faults):
        env = {**os.environ, "PLYWAVE_CACHE": str(path / "cache")}
        if faults:
            env.update({key: str(value) for key, value in faults.items()}, LD_PRELOAD=str(self.faults))
        return env

    def run(self, command, path, faults=None, resume=False, kill_after=None):
        """Runs a command to its end, or kills it after so many seconds."""
        args = [self.program, *command.args, "--quiet", *(["--resume"] if resume and command.resumes else [])]
        child = subprocess.Popen(args, cwd=path, env=self.env(path, faults), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        try:
            err = child.communicate(timeout=kill_after or TIMEOUT_S)[1]
        except subprocess.TimeoutExpired:
            child.kill()
            err = child.communicate()[1]
            if kill_after is None:
                raise Miss(f"no end within {TIMEOUT_S:.0f} s") from None
        return Ended(child.returncode, err.decode(errors="replace"))

    def steps(self, command, faults):
        """Steps of an undisturbed run, and how it ends."""
        path, count = self.fresh(command), self.folder / "count"
        faults = {key: str(value).replace("{}", str(path)) for key, value in faults.items()}
        ended = self.run(command, path, {**faults, "FAULT_COUNT": count})
        shutil.rmtree(path)
        return int(count.read_text()), ended


def outputs_of(command, path):
    return {name: (path / name).read_bytes() if (path / name).is_file() else None for name in command.outputs}


def one_line(ended):
    """Whether a command has refused its work in one line."""
    lines = ended.err.strip().splitlines()
    if ended.code not in (1, 2) or len(lines) != 1 or "panicked" in ended.err or "Traceback" in ended.err:
        raise Miss(f"exit code {ended.code}, {len(lines)} lines: {ended.err.strip()[:300]}")
    if not re.match(r"(error|.*): .+", lines[0]):
        raise Miss(f"not an error: {lines[0]}")
    return lines[0]


def whole_or_old(command, path, old, together):
    """Every output is new and whole, as it was before, or absent where there was none."""
    kinds = set()
    for name, data in outputs_of(command, path).items():
        if data == command.whole[name]:
            kinds.add("new")
        elif data == old.get(name):
            kinds.add("old")
        else:
            size = "absent" if data is None else f"{len(data)} bytes"
            raise Miss(f"{name} is neither old nor new ({size}, whole {len(command.whole[name])})")
    if together and len(kinds) > 1:
        raise Miss("a part of the outputs is new, the others are old")


def same_bits(bench, command, path, faults=None):
    """The command, undisturbed, comes to the bits of an undisturbed run, and nothing else stays."""
    ended = bench.run(command, path, faults, resume=True)
    if ended.code:
        raise Miss(f"the run after the disturbance: exit code {ended.code}: {ended.err.strip()[:300]}")
    if outputs_of(command, path) != command.whole:
        raise Miss("the run after the disturbance has other bits")
    shutil.rmtree(path / "cache", ignore_errors=True)
    names = {str(file.relative_to(path)) for file in path.rglob("*") if file.is_file()}
    left = names - set(command.inputs) - set(command.outputs)
    if left:
        raise Miss(f"left behind: {', '.join(sorted(left)[:4])}")


def older(bench, command):
    """The outputs of an older run, for half of the trials: the same file with a byte more, or none."""
    return {name: data + b"\n" for name, data in command.whole.items()} if bench.rng.random() < 0.5 else {}


def killed(bench, command, _):
    """Killed one to three times, at a file operation or at a time, and run again."""
    old = older(bench, command)
    path, hits = bench.fresh(command, old), 0
    for _ in range(bench.rng.randint(1, 3)):
        if bench.rng.random() < 0.6:
            faults = {"FAULT_UNDER": path, "FAULT_DIE": bench.rng.randint(1, command.steps)}
            ended = bench.run(command, path, faults, resume=True)
        else:
            ended = bench.run(command, path, resume=True, kill_after=max(0.002, bench.rng.random() * command.seconds))
        hits += ended.code == -signal.SIGKILL
        if ended.code not in (0, -signal.SIGKILL):
            raise Miss(f"exit code {ended.code} before its kill: {ended.err.strip()[:300]}")
        whole_or_old(command, path, old, together=False)
    same_bits(bench, command, path)
    return f"same bits, {hits} kills", hits


def full(bench, command, _):
    """The disk is full from a file operation on; then there is room again."""
    old = older(bench, command)
    path = bench.fresh(command, old)
    ended = bench.run(command, path, {"FAULT_UNDER": path, "FAULT_FULL": bench.rng.randint(1, command.steps)})
    whole_or_old(command, path, old, together=True)
    # What needs no room, such as the removal of shards, may follow.
    line = one_line(ended) if ended.code else "no room needed"
    if ended.code and "No space left" not in line:
        raise Miss(f"does not name the cause: {line}")
    if any(file.name.endswith(".tmp") for file in path.rglob("*")):
        raise Miss("a temporary file is left")
    same_bits(bench, command, path)
    return f"one line, then same bits: {line}", int(ended.code != 0)


def clock(bench, command, _):
    """The time of day jumps by a day ten times a second, and all files are dated up to a year off, through a kill."""
    path = bench.fresh(command)
    jumps = {"FAULT_CLOCK": 1, "FAULT_UNDER": path}
    bench.run(command, path, {**jumps, "FAULT_DIE": bench.rng.randint(1, command.steps)}, resume=True)
    for file in path.rglob("*"):
        then = time.time() + bench.rng.uniform(-YEAR_S, YEAR_S)
        os.utime(file, (then, then))
    same_bits(bench, command, path, jumps)
    return "same bits", 1


def changed(bench, command, known):
    """An input gets another content at one of the operations that open, examine or read it."""
    name, other = bench.rng.choice(command.changes)
    old = command.inputs[name]
    what, new = bench.rng.choice([("another", other), ("half", old[: len(old) // 2]), ("longer", old + old[: len(old) // 3])])
    how = bench.rng.choice(["replace", "rewrite"])
    key = (command.outputs[0], name, what)
    if key not in known:
        changed_command = Command(command.args, {**command.inputs, name: new}, command.outputs)
        path = bench.fresh(changed_command)
        ended = bench.run(changed_command, path)
        known[key] = None if ended.code else outputs_of(command, path)
        if ended.code:
            one_line(ended)
        shutil.rmtree(path)
    steps_key = (command.outputs[0], name)
    if steps_key not in known:
        known[steps_key] = bench.steps(command, {"FAULT_FILE": f"{{}}/{name}"})[0]
    at = bench.rng.randint(1, known[steps_key])
    path, beside = bench.fresh(command), bench.folder / "next"
    beside.write_bytes(new)
    ended = bench.run(command, path, {"FAULT_FILE": path / name, "FAULT_NEXT": beside, "FAULT_STEP": at, "FAULT_HOW": how})
    told, got = f"{name}, {what}, {how}, at {at} of {known[steps_key]}", outputs_of(command, path)
    try:
        if ended.code:
            end = f"one line: {one_line(ended)}"
            if any(data is not None for data in got.values()):
                raise Miss("an output of a command that failed")
        elif got == command.whole:
            end = "bits of the old"
        elif got == known[key]:
            end = "bits of the new"
        else:
            raise Miss("bits of neither the old nor the new")
        if (path / name).read_bytes() != new:
            raise Miss("the trial itself: the input did not change")
        # What the cache has from this run is of the old content or of the new one, and known as such.
        for file in command.outputs:
            (path / file).unlink(missing_ok=True)
        again = bench.run(command, path)
        if (None if again.code else outputs_of(command, path)) != known[key]:
            raise Miss(f"a second run has other bits than the new content's: {again.err.strip()[:200]}")
    except Miss as miss:
        raise Miss(f"{miss} ({told})") from None
    return f"{end} ({told})", 1


class Farm:
    """Trials of the farm: one small yarn on two workers."""

    def __init__(self, bench):
        self.bench, self.python = bench, os.environ.get("PYTHON", sys.executable)
        self.library = bench.folder / "farm.toml"
        self.library.write_text(f'name = "farm"\nquality = "preview"\n[[yarn]]\nspec = "{bench.folder}/tiny.toml"\n')
        (bench.folder / "tiny.toml").write_text(TINY.replace("fiber_pitch_um = 800.0\n", "") + "# farm\n")
        self.whole, self.steps, self.seconds = None, 0, 0.0

    def begin(self):
        path, count = self.bench.folder / "farm", self.bench.folder / "count"
        begun = time.monotonic()
        ended = self.run(path, faults={"FAULT_UNDER": path / "cache", "FAULT_COUNT": count})
        if ended.code:
            sys.exit(f"farm: {ended.err.strip()}; the farm needs pip install './python[cluster]' for PYTHON, or give --no-farm")
        self.seconds, self.steps, self.whole = time.monotonic() - begun, int(count.read_text()), (path / "tiny.pwm").read_bytes()

    def start(self, path, faults=None, where=("--local", "2")):
        args = [self.python, "-m", "plywave.farm", str(self.library), "-o", str(path), *where, "--quiet"]
        env = self.bench.env(path, faults)
        return subprocess.Popen(args, env=env, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def run(self, path, faults=None, where=("--local", "2"), kill_after=None):
        farm = self.start(path, faults, where)
        try:
            err = farm.communicate(timeout=kill_after or TIMEOUT_S)[1]
        except subprocess.TimeoutExpired:
            os.killpg(farm.pid, signal.SIGKILL)
            err = farm.communicate()[1]
            if kill_after is None:
                raise Miss(f"the farm has no end within {TIMEOUT_S:.0f} s") from None
        return Ended(farm.returncode, err.decode(errors="replace"))

    def goes_on(self, path, where=("--local", "2")):
        ended = self.run(path, where=where)
        if ended.code or (path / "tiny.pwm").read_bytes() != self.whole:
            raise Miss(f"the farm after the disturbance: exit code {ended.code}, or other bits: {ended.err.strip()[:300]}")

    def path(self):
        self.bench.number += 1
        return self.bench.folder / f"trial{self.bench.number}"

    def workers(self, at):
        """Workers killed at one moment of their life."""
        kills = self.bench.rng.randint(1, 3)
        args = ["--specs", str(self.bench.folder / "tiny.toml"), "--workers", "2", "--kills", str(kills), "--at", at, "--seconds", "0.5"]
        soak = [self.python, str(ROOT / "python/tests/soak_cluster.py"), *args, "--seed", str(self.bench.rng.randint(1, 10**6))]
        ended = subprocess.run(soak, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        if ended.returncode:
            raise Miss(f"{ended.stdout.strip()[-300:]} {ended.stderr.strip()[-300:]}")
        return f"same bits, {kills} kills", kills

    def scheduler(self, *_):
        """The scheduler, with workers of its own, is killed while the farm runs; another one goes on."""
        path, hit = self.path(), 0
        for turn in range(2):
            with self.dask() as (scheduler, address):
                where = ("--scheduler", address)
                if turn == 1:
                    self.goes_on(path, where)
                    break
                farm = self.start(path, where=where)
                try:
                    # Its start takes about half of the time of a whole run.
                    err = farm.communicate(timeout=self.bench.rng.uniform(0.4, 0.9) * self.seconds)[1]
                except subprocess.TimeoutExpired:
                    scheduler.kill()
                    hit = 1
                    err = farm.communicate(timeout=TIMEOUT_S)[1]
                ended = Ended(farm.returncode, err.decode(errors="replace"))
                told = one_line(ended) if ended.code else "done all the same"
        return f"{told}; then same bits", hit

    def dask(self):
        return Dask(self.python)

    def whole_farm(self, *_):
        """Command, scheduler and workers die together."""
        path, hits = self.path(), 0
        for _ in range(self.bench.rng.randint(1, 2)):
            hits += self.run(path, kill_after=self.bench.rng.uniform(0.2, 1.0) * self.seconds).code == -signal.SIGKILL
            if (path / "tiny.pwm").exists() and (path / "tiny.pwm").read_bytes() != self.whole:
                raise Miss("tiny.pwm is not whole")
        self.goes_on(path)
        return f"same bits, {hits} kills", hits

    def full(self, *_):
        """The disk of the cache is full from a file operation on."""
        path = self.path()
        ended = self.run(path, {"FAULT_UNDER": path / "cache", "FAULT_FULL": self.bench.rng.randint(1, self.steps)})
        told = one_line(ended) if ended.code else "no room needed"
        if ended.code and "No space left" not in told:
            raise Miss(f"does not name the cause: {told}")
        self.goes_on(path)
        return f"{told}; then same bits", int(ended.code != 0)

    def clock(self, *_):
        """The time of day jumps in the farm, its scheduler and its workers."""
        path = self.path()
        ended = self.run(path, {"FAULT_CLOCK": 1, "FAULT_UNDER": path})
        told = f"{one_line(ended)}; then " if ended.code else ""
        if not ended.code and (path / "tiny.pwm").read_bytes() != self.whole:
            raise Miss("other bits")
        if ended.code:
            self.goes_on(path)
        return f"{told}same bits", 1


class Dask:
    """A scheduler and two workers as processes, for the time of a `with`."""

    CODE = "import sys, asyncio, distributed\nasync def main():\n async with distributed.Scheduler(host='127.0.0.1', port=0, dashboard_address=':0') as s:\n  print(s.address, flush=True)\n  await s.finished()\nasyncio.run(main())"
    WORK = "import asyncio, distributed, sys\nasync def main():\n async with distributed.Worker(sys.argv[1], nthreads=1, host='127.0.0.1', memory_limit=0) as w:\n  await w.finished()\nif __name__ == '__main__': asyncio.run(main())"

    def __init__(self, python):
        self.python = python

    def __enter__(self):
        quiet = {"stderr": subprocess.DEVNULL, "start_new_session": True, "env": {**os.environ, "OMP_NUM_THREADS": "1"}}
        self.scheduler = subprocess.Popen([self.python, "-c", self.CODE], stdout=subprocess.PIPE, text=True, **quiet)
        address = self.scheduler.stdout.readline().strip()
        work = [self.python, "-c", self.WORK, address]
        self.workers = [subprocess.Popen(work, stdout=subprocess.DEVNULL, **quiet) for _ in range(2)]
        return self.scheduler, address

    def __exit__(self, *_):
        for process in [self.scheduler, *self.workers]:
            process.kill()
            process.wait()


def commands(bench):
    """The commands that are disturbed, with their inputs; each takes a few seconds at most."""
    model = (ROOT / "fabrics/models/cotton.pwm").read_bytes()
    other_model = (ROOT / "fabrics/models/polyester.pwm").read_bytes()
    tiny, cloth = TINY.encode(), CLOTH.encode()
    few = ["--preset", "preview", "--paths", "3000"]
    any_fit = ["--max-error-refl", "9", "--max-error-high", "9"]
    thick = tiny.replace(b"radius_um = 7.5", b"radius_um = 6.5")
    made = {
        "simulate": Command(["simulate", "tiny.toml", *few, "-o", "t.pwt"], {"tiny.toml": tiny}, ["t.pwt"], True, [("tiny.toml", thick)]),
        "speckle": Command(
            ["wave", "speckle", "thin.toml", "--instances", "60", "--lambda", "0.5", "--w0", "30", "-o", "s.pws"],
            {"thin.toml": THIN.encode()},
            ["s.pws"],
            True,
            [("thin.toml", THIN.replace("1.5", "1.4").encode())],
        ),
        "build": Command(["build", "tiny.toml", *few, *any_fit, "-o", "m.pwm", "--keep-table"], {"tiny.toml": tiny}, ["m.pwm", "m.pwt"], True, [("tiny.toml", thick)]),
    }
    files = {"cloth.toml": cloth, "cotton.pwm": model}
    loose = cloth.replace(b"ends_per_cm = 20", b"ends_per_cm = 16")
    made["weave"] = Command(["weave", "cloth.toml", "--draft", "-o", "c.pwc"], files, ["c.pwc"], changes=[("cloth.toml", loose), ("cotton.pwm", other_model)])
    made["weave curves"] = Command(["weave", "cloth.toml", "-o", "c.toml"], files, ["c.toml"], changes=[("cloth.toml", loose)])
    for name, shards in (("part1.pwp", "1/3"), ("part2.pwp", "2/3"), ("part3.pwp", "3/3"), ("other.pwp", "2/3")):
        spec = "thick.toml" if name == "other.pwp" else "tiny.toml"
        made[name] = Command(["simulate", spec, *few, "--shards", shards, "-o", name], {"tiny.toml": tiny, "thick.toml": thick}, [name])
    makers = {name: made.pop(name) for name in list(made) if name.endswith(".pwp")}
    cloths = {"c.pwc": made["weave"], "other.pwc": Command(made["weave"].args, {**files, "cloth.toml": loose}, ["c.pwc"])}
    inputs = {}
    for name, maker in {**makers, "m.pwt": made["build"], **cloths, "other.pwt": Command(made["simulate"].args, {"tiny.toml": thick}, ["t.pwt"])}.items():
        path = bench.fresh(maker)
        ended = bench.run(maker, path)
        if ended.code:
            sys.exit(f"{name}: {ended.err}")
        inputs[name] = (path / maker.outputs[-1]).read_bytes()
    parts = {name: inputs[name] for name in ("part1.pwp", "part2.pwp", "part3.pwp")}
    made["merge"] = Command(["merge", *parts, "-o", "t.pwt"], parts, ["t.pwt"], changes=[("part2.pwp", inputs["other.pwp"]), ("part3.pwp", parts["part1.pwp"])])
    made["fit"] = Command(["fit", "t.pwt", "-o", "m.pwm"], {"t.pwt": inputs["m.pwt"]}, ["m.pwm"], changes=[("t.pwt", inputs["other.pwt"])])
    cell = {"c.pwc": inputs["c.pwc"]}
    small = ["--width", "48", "--height", "48", "--samples", "8"]
    made["render"] = Command(["render", "c.pwc", *small, "-o", "p.png"], cell, ["p.png", "p.exr"], True, [("c.pwc", inputs["other.pwc"])])
    # A mesh, a sky and curves of another program are read in pieces.
    places = [(x, y) for y in range(30) for x in range(30)]
    corners = "".join(f"vt {x / 29} {y / 29}\n" for x, y in places)
    faces = "".join("f " + " ".join(f"{k}/{k}" for k in (i, i + 1, i + 31, i + 30)) + "\n" for i in range(1, 870) if i % 30)
    mesh, bent = ("".join(f"v {x} {y} {z * (x % 7)}\n" for x, y in places) + corners + faces for z in (0.0, 0.1))
    skies = [b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60 +X 120\n" + bytes(v for k in range(7200) for v in (rgb, k % 200, 90, 128)) for rgb in (100, 180)]
    lit = ["render", "c.pwc", *small, "--mesh", "m.obj", "--sky", "s.hdr", "-o", "p.png"]
    made["render sky"] = Command(lit, {**cell, "m.obj": mesh.encode(), "s.hdr": skies[0]}, ["p.png", "p.exr"], True, [("s.hdr", skies[1]), ("m.obj", bent.encode())])
    made["export"] = Command(["export", "c.pwc", "--to", "openpbr", "-o", "o.mtlx", "--pixels", "32"], cell, [], changes=[("c.pwc", inputs["other.pwc"])])
    # A cloth that is made and kept in the cache, of a draft that a spec names.
    wif = "[WIF]\nVersion=1.1\n[CONTENTS]\nWEAVING=true\nWARP=true\nWEFT=true\nTHREADING=true\nTIEUP=true\nTREADLING=true\n[WEAVING]\nShafts=2\nTreadles=2\n"
    wif += "[WARP]\nThreads=2\n[WEFT]\nThreads=2\n[THREADING]\n1=1\n2=2\n[TIEUP]\n1=1\n2=2\n[TREADLING]\n1=1\n2=2\n"
    rep = wif.replace("[WEFT]\nThreads=2", "[WEFT]\nThreads=4").replace("[TREADLING]\n1=1\n2=2\n", "[TREADLING]\n1=1\n2=1\n3=2\n4=2\n")
    drawn = CLOTH.replace('kind = "plain"', 'kind = "wif"\nfile = "d.wif"').encode()
    made["cached cloth"] = Command(
        ["render", "cloth.toml", *small, "-o", "p.png"], {"cloth.toml": drawn, "cotton.pwm": model, "d.wif": wif.encode()}, ["p.png", "p.exr"], True, [("d.wif", rep.encode())]
    )
    return made


KINDS = {
    # Trials in all, and the commands that have them in turn.
    "killed": (killed, 33, ["simulate", "speckle", "build", "render", "weave", "weave curves", "export", "merge", "fit"]),
    "full": (full, 12, ["simulate", "build", "render", "export", "weave curves", "merge", "fit"]),
    "clock": (clock, 8, ["simulate", "speckle", "build", "render"]),
    "changed": (changed, 21, ["simulate", "speckle", "build", "weave curves", "merge", "fit", "render", "render sky", "export", "cached cloth", "weave"]),
}
FARM = {"start": 5, "scatter": 5, "shards": 5, "scheduler": 4, "whole farm": 3, "full": 2, "clock": 2}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=[*KINDS, "farm"], help="kinds of trials; by default all")
    parser.add_argument("--commands", nargs="+", help="disturb these commands only")
    parser.add_argument("--times", type=float, default=1.0, help="so many times the 100 trials")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--no-farm", action="store_true")
    parser.add_argument("--plywave", help="the program; by default it is built")
    args = parser.parse_args()
    kinds = args.only or [*KINDS, *([] if args.no_farm else ["farm"])]
    program = args.plywave
    if program is None:
        subprocess.run(["cargo", "build", "--locked", "--quiet", "--release", "-p", "plywave-cli"], cwd=ROOT, check=True)
        program = ROOT / "target/release/plywave"
    with tempfile.TemporaryDirectory(prefix="plywave-kills-") as folder:
        return disturb(args, kinds, program, folder)


def disturb(args, kinds, program, folder):
    """Runs all trials and prints the table."""
    # A copy, so that a build beside it changes nothing.
    shutil.copy(program, folder)
    bench = Bench(folder, os.path.join(folder, Path(program).name), random.Random(args.seed))
    trials = []
    if set(kinds) - {"farm"}:
        made = commands(bench)
        wanted = {name for kind in kinds if kind in KINDS for name in KINDS[kind][2] if not args.commands or name in args.commands}
        made = {name: command for name, command in made.items() if name in wanted}
        for name, command in made.items():
            path = bench.fresh(command)
            begun = time.monotonic()
            ended = bench.run(command, path)
            command.seconds = time.monotonic() - begun
            if ended.code:
                sys.exit(f"{name}, undisturbed: {ended.err}")
            if not command.outputs:
                found = {str(file.relative_to(path)) for file in path.rglob("*") if file.is_file()}
                command.outputs = sorted(found - set(command.inputs))
            command.whole = outputs_of(command, path)
            command.steps = bench.steps(command, {"FAULT_UNDER": "{}"})[0]
            print(f"{name}: {command.seconds:.2f} s, {command.steps} file operations, {', '.join(command.outputs[:3])}", flush=True)
        for kind, (trial, count, names) in KINDS.items():
            names = [name for name in names if not args.commands or name in args.commands]
            known = {}
            if kind in kinds and names:
                trials += [(kind, names[k % len(names)], trial, made[names[k % len(names)]], known) for k in range(round(args.times * count))]
    if "farm" in kinds:
        farm = Farm(bench)
        farm.begin()
        print(f"farm: {farm.seconds:.1f} s, {farm.steps} file operations in its cache", flush=True)
        each = {"scheduler": farm.scheduler, "whole farm": farm.whole_farm, "full": farm.full, "clock": farm.clock}
        for name, count in FARM.items():
            if not args.commands or name in args.commands:
                trial = each.get(name, lambda _, at, __: farm.workers(at))
                trials += [("farm", name, trial, name, None)] * round(args.times * count)
    done, hits, missed = Counter(), Counter(), []
    begun = time.monotonic()
    for number, (kind, name, trial, command, known) in enumerate(trials, 1):
        # Each trial has numbers of its own, whatever the ones before it have drawn.
        bench.rng = random.Random(f"{args.seed} {kind} {name} {number}")
        row = f"{kind}: {name}" if kind == "farm" else kind
        try:
            told, landed = trial(bench, command, known)
            hits[row] += landed
        except Miss as miss:
            told = f"MISSED: {miss}"
            missed.append((number, kind, name, told))
        done[row] += 1
        print(f"{number} of {len(trials)}, {kind} {name}: {told}", flush=True)
        shutil.rmtree(Path(folder) / f"trial{bench.number}", ignore_errors=True)
    print(f"\n{len(trials)} trials in {time.monotonic() - begun:.0f} s, seed {args.seed}\n\n| kind | trials | faults that landed | missed |\n|---|---|---|---|")
    for row in done:
        print(f"| {row} | {done[row]} | {hits[row]} | {sum(row in (m[1], f'{m[1]}: {m[2]}') for m in missed)} |")
    for miss in missed:
        print("{}, {} {}: {}".format(*miss))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
