#!/usr/bin/env python3
"""Runs slow tests: those marked `#[ignore = "slow: SECONDS s: what it holds"]`.

slow_tests.py                 all of them, one binary after the other
slow_tests.py --minutes 8     as many as fit: first those of crates that changed since the last tag `ci-*`, then the others in a rotation by the number of commits
slow_tests.py --list          prints them

The seconds are those on two cores. Ends with 1 where a test fails. Needs Python 3.11 and git.
"""
import argparse
import json
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MARK = re.compile(r'#\[ignore = "slow: (\d+) s: ([^"]+)"\]\s*(?:#\[[^\n]*\]\s*)*fn (\w+)')


def output(*command):
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def crate_of(path):
    """The folder of the crate that a file belongs to."""
    return next(folder for folder in path.parents if (folder / "Cargo.toml").exists())


def marked():
    """Slow tests: file, name, seconds, what each holds."""
    for name in sorted(output("git", "ls-files", "*.rs").split()):
        text = (ROOT / name).read_text(encoding="utf-8")
        for found in MARK.finditer(text):
            seconds, holds, function = found.groups()
            line = text[text.rfind("\n", 0, found.start(3)) + 1 : found.start(3)]
            # Of a module in the file, as `mod tests { ... }`, an indented function has that module's name.
            around = re.findall(r"^mod (\w+) \{", text[: found.start()], re.M) if line.startswith(" ") else []
            full = "::".join([*around[-1:], function])
            yield {"file": ROOT / name, "name": full, "seconds": int(seconds), "holds": holds}


def binaries():
    """Test programs by the folder or file of their sources."""
    made = output("cargo", "test", "--locked", "--release", "--workspace", "--no-run", "--message-format=json", "--quiet")
    for line in made.splitlines():
        target = json.loads(line)
        if target.get("executable") and target["profile"]["test"]:
            yield Path(target["target"]["src_path"]), target["executable"]


def program(test, programs):
    """The program that has a test: of its own file, else of the main file whose folder holds it."""
    own = [exe for source, exe in programs if source == test["file"]]
    around = [(len(source.parts), exe) for source, exe in programs
              if source.name in ("lib.rs", "main.rs") and source.parent in test["file"].parents]
    return own[0] if own else max(around)[1]


def changed_crates():
    """Crates with changes since the last tag `ci-*`; none without such a tag."""
    tag = subprocess.run(["git", "describe", "--tags", "--match", "ci-*", "--abbrev=0"], cwd=ROOT, capture_output=True, text=True)
    if tag.returncode:
        return set()
    names = output("git", "diff", "--name-only", tag.stdout.strip(), "HEAD", "--", "*.rs", "*.toml").split()
    return {crate_of(ROOT / name) for name in names if (ROOT / name).exists()}


def chosen(tests, minutes):
    """Tests that fit into some minutes."""
    changed, commits = changed_crates(), int(output("git", "rev-list", "--count", "HEAD"))
    turn = commits % max(len(tests), 1)
    turned = tests[turn:] + tests[:turn]
    turned.sort(key=lambda t: crate_of(t["file"]) not in changed)
    left, take = 60 * minutes, []
    for test in turned:
        if test["seconds"] <= left:
            left -= test["seconds"]
            take.append(test)
    return take


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--minutes", type=float, help="run as many as fit")
    parser.add_argument("--list", action="store_true", help="print the slow tests and end")
    args = parser.parse_args()
    tests = list(marked())
    if args.minutes:
        tests = chosen(tests, args.minutes)
    for test in tests:
        print(f"{test['seconds']:4} s  {test['file'].relative_to(ROOT)}  {test['name']}: {test['holds']}", flush=True)
    if args.list:
        return 0
    programs = list(binaries())
    by_program = {}
    for test in tests:
        by_program.setdefault((program(test, programs), crate_of(test["file"])), []).append(test["name"])
    passed, failed = 0, 0
    for (exe, folder), names in by_program.items():
        known = subprocess.run([exe, "--list", "--ignored"], cwd=folder, check=True, capture_output=True, text=True).stdout
        known = [line.removesuffix(": test") for line in known.splitlines() if line.endswith(": test")]
        full = [k for k in known if any(f"::{k}".endswith(f"::{name}") for name in names)]
        if len(full) < len(names):
            sys.exit(f"{exe}: of {names} only {full} are there")
        begun = time.monotonic()
        run = subprocess.run([exe, "--ignored", "--exact", *full], cwd=folder)
        print(f"-- {time.monotonic() - begun:.0f} s", flush=True)
        if run.returncode:
            failed += 1
        else:
            passed += len(full)
    print(f"{passed} passed, {failed} failed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
