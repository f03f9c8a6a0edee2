#!/usr/bin/env bash
# Makes the source distribution of the Python package with the crates that it needs: python/sdist.sh FOLDER. Needs maturin and git.
# maturin lists the files of a crate by `cargo package --list`. In the root, cargo takes the workspace's default members, the program, in place of the runtime; and the root's manifest
# keeps benches that are not in its package. So maturin runs in a copy of git's files whose root manifest has neither.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:?the folder for the source distribution is missing: python/sdist.sh FOLDER}
for tool in maturin git; do
    command -v "$tool" >/dev/null || { echo "$tool is missing: install it" >&2 && exit 1; }
done
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
git ls-files -z --cached --others --exclude-standard | while IFS= read -r -d '' file; do if [ -e "$file" ]; then printf '%s\0' "$file"; fi; done | tar --null -T - -cf - | tar -C "$scratch" -xf -
awk '/^\[/ { bench = /^\[\[bench\]\]/ } !bench && !/^default-members/' Cargo.toml >"$scratch/Cargo.toml"
maturin sdist --manifest-path "$scratch/python/Cargo.toml" --out "$folder"
