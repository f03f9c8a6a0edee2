#!/usr/bin/env bash
# Every dependency has a license that deny.toml allows and comes from crates.io: what `cargo deny check licenses sources` asks, from `cargo metadata` alone.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo metadata --locked --format-version 1 | python3 -c '
import json, re, sys, tomllib

deny = tomllib.load(open("deny.toml", "rb"))
allowed = set(deny["licenses"]["allow"])
registries = {"registry+" + url for url in deny["sources"]["allow-registry"]}


def holds(expression):
    """SPDX: AND binds closer than OR; a slash is an old OR."""
    tokens = re.findall(r"[()]|[^\s()]+", expression.replace("/", " OR "))
    at = 0

    def one():
        nonlocal at
        token, at = tokens[at], at + 1
        if token == "(":
            value = either()
            at += 1
            return value
        if at < len(tokens) and tokens[at] == "WITH":
            token, at = token + " WITH " + tokens[at + 1], at + 2
        return token in allowed

    def both():
        nonlocal at
        value = one()
        while at < len(tokens) and tokens[at] == "AND":
            at += 1
            value = one() and value
        return value

    def either():
        nonlocal at
        value = both()
        while at < len(tokens) and tokens[at] == "OR":
            at += 1
            value = both() or value
        return value

    return either()


assert holds("MIT OR GPL-3.0") and not holds("MIT AND GPL-3.0") and not holds("GPL-3.0")
packages = json.load(sys.stdin)["packages"]
bad = []
for p in packages:
    name = "{name} {version}".format(**p)
    if not p["license"] or not holds(p["license"]):
        bad.append("{}: license {!r} is not in deny.toml".format(name, p["license"]))
    if p["source"] is not None and p["source"] not in registries:
        bad.append("{}: source {} is not in deny.toml".format(name, p["source"]))
print("\n".join(bad) or "{} packages: licenses and sources are allowed".format(len(packages)))
sys.exit(bool(bad))
'
