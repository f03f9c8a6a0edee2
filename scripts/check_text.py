#!/usr/bin/env python3
"""Checks the project's prose: width of comments, one sentence a line in Markdown, words that say little.

Comments of Rust and Python are at most 110 columns wide, but for tables, code and lines without a space to break at.
A line of a paragraph in Markdown holds one sentence. The words in `VAGUE` are refused everywhere but in research notes.
Ends with 1 and a line a finding. Needs Python 3.11 and git.
"""
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WIDTH = 110
VAGUE = re.compile(r"\b(what is left|is had|taken back|code that is not kept|is asked for|was asked for|good and bad in them|gone off)\b", re.I)
COMMENT = {".rs": re.compile(r"\s*(///|//!|//)\s?(.*)"), ".py": re.compile(r"\s*(#)\s?(.*)")}
SENTENCE = re.compile(r"(?<![A-Z])(?<!\b[a-z])(?<!Eq)(?<!Fig)(?<!etc)(?<!e\.g)(?<!i\.e)(?<!vs)(?<!al)[.?!] +[A-Z`*\[]")
# Numbers of a list, and abbreviations in titles of journals, end no sentence.
NO_END = re.compile(r"^\s*\d+\. |\b(Sci|Numer|Phys|Comput|Adv|Rev|Arch|Math)\. ")
# Specs whose text is part of models that ship change with these alone; notes are of their day.
SKIPPED = ("docs/research/", "fabrics/", "tests/data/", "CHANGELOG.md")


def files(*patterns):
    listed = subprocess.run(["git", "ls-files", *patterns], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [name for name in listed.split("\n") if name and not name.startswith(SKIPPED) and (ROOT / name).exists()]


def lines(name):
    """Number, line, whether it is in a block of code."""
    in_code = False
    for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), 1):
        fence = re.match(r"\s*(///|//!|//|#)?\s*(```|~~~)", line)
        yield number, line, in_code or fence is not None
        in_code ^= fence is not None


def wide_comments():
    for name in files("*.rs", "*.py"):
        for number, line, in_code in lines(name):
            comment = COMMENT[Path(name).suffix].fullmatch(line)
            if comment is None or in_code or len(line) <= WIDTH or comment[2].startswith(("|", "!")):
                continue
            if " " in line[len(line) - len(comment[2]) : WIDTH]:
                yield f"{name}:{number}: a comment of {len(line)} columns; wrap it at {WIDTH}"


def sentences():
    for name in files("*.md"):
        for number, line, in_code in lines(name):
            if in_code or line.lstrip().startswith(("|", "#", "    ", "![")):
                continue
            if SENTENCE.search(NO_END.sub("x ", re.sub(r"`[^`]*`|\([^()]*\)", "code", line))):
                yield f"{name}:{number}: two sentences in a line; begin a line with each"


def vague():
    for name in files("*.rs", "*.py", "*.md", "*.sh", ":!scripts/check_text.py"):
        for number, line, _ in lines(name):
            if found := VAGUE.search(line):
                yield f"{name}:{number}: {found[0]!r}; say what it is"


def main():
    found = [*wide_comments(), *sentences(), *vague()]
    print("\n".join(found))
    if found:
        print(f"{len(found)} findings", file=sys.stderr)
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
