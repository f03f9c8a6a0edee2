#!/usr/bin/env bash
# Packs the WebAssembly of models and pictures as the npm package plywave: viewer/npm.sh FOLDER makes FOLDER/plywave-VERSION.tgz and prints its path.
# Runs viewer/wasm.sh first; needs npm too. Its version is the workspace's. GITHUB_REPOSITORY, as GitHub sets it, names the repository in it.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:?the folder for the package is missing: viewer/npm.sh FOLDER}
command -v npm >/dev/null || { echo "npm is missing: install Node 20 or newer" >&2; exit 1; }
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
viewer/wasm.sh >&2
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
license=$(sed -n 's/^license = "\(.*\)"/\1/p' Cargo.toml | head -1)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
install -m 644 viewer/pkg/plywave_web.{js,d.ts} viewer/pkg/plywave_web_bg.wasm{,.d.ts} LICENSE-MIT LICENSE-APACHE "$scratch"
repository=${GITHUB_REPOSITORY:+,
  \"repository\": { \"type\": \"git\", \"url\": \"git+https://github.com/$GITHUB_REPOSITORY.git\" \}}
cat >"$scratch/package.json" <<JSON
{
  "name": "plywave",
  "version": "$version",
  "description": "Wave-aware cloth and fiber appearance: ply and cloth models, and pictures of cloths, in WebAssembly.",
  "license": "$license",
  "keywords": ["rendering", "cloth", "textile", "scattering", "BSDF", "wasm"]$repository,
  "type": "module",
  "main": "./plywave_web.js",
  "types": "./plywave_web.d.ts",
  "exports": {
    ".": { "types": "./plywave_web.d.ts", "default": "./plywave_web.js" },
    "./plywave_web_bg.wasm": "./plywave_web_bg.wasm"
  },
  "files": ["plywave_web.js", "plywave_web.d.ts", "plywave_web_bg.wasm", "plywave_web_bg.wasm.d.ts", "LICENSE-*"],
  "sideEffects": false
}
JSON
cat >"$scratch/README.md" <<'MD'
# plywave

Ply and cloth models of plywave in WebAssembly, for browsers and Node 20 or newer.

```js
import init, { Ply } from "plywave";

await init(); // in a browser
const file = "polyester.pwm";
const ply = new Ply(new Uint8Array(await (await fetch(file)).arrayBuffer()), file);
const f = ply.eval(0.5, 10, 0.004, 0.55, true, new Float32Array([0, 1, 0])); // [1/sr]
```

In Node, read the module from the package:

```js
import { readFileSync } from "node:fs";
import { initSync } from "plywave";

initSync({ module: readFileSync(new URL(import.meta.resolve("plywave/plywave_web_bg.wasm"))) });
```

`Ply` is a model of a ply (`.pwm`), `Cloth` a cloth file (`.pwc`), `Picture` a path-traced picture of a cloth.
Angles are in radians, lengths in um, absorption in 1/um, densities in 1/sr.
`plywave_web.d.ts` documents each argument.
MD
npm pack --loglevel=error --pack-destination "$folder" "$scratch" >/dev/null
echo "$folder/plywave-$version.tgz"
