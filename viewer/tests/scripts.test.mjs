// wasm.sh where an installation fails: programs of the same names that fail stand before the others.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { chmodSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import test, { after } from "node:test";

const viewer = new URL("..", import.meta.url).pathname;
const scratch = mkdtempSync(join(tmpdir(), "plywave-scripts-"));
after(() => rmSync(scratch, { recursive: true }));

/** Runs wasm.sh with programs, shell scripts by their path in a folder of this case: those of bin/ are found first. */
function wasm(name, programs) {
  const folder = join(scratch, name);
  for (const [path, script] of Object.entries(programs)) {
    const file = join(folder, path);
    mkdirSync(join(file, ".."), { recursive: true });
    writeFileSync(file, `#!/bin/sh\n${script}\n`);
    chmodSync(file, 0o755);
  }
  const env = { ...process.env, PATH: `${folder}/bin:${process.env.PATH}`, CARGO_TARGET_DIR: `${folder}/target` };
  return spawnSync("bash", [join(viewer, "wasm.sh")], { env, encoding: "utf8" });
}

const version = readFileSync(join(viewer, "../Cargo.lock"), "utf8").match(/name = "wasm-bindgen"\nversion = "(.*)"/)[1];

test("a failed installation of wasm-bindgen ends the script with its words", () => {
  const ended = wasm("bindgen", { "bin/cargo": 'echo "the registry is away: $*" >&2; exit 101' });
  assert.notEqual(ended.status, 0);
  assert.match(ended.stderr, /the registry is away: install .*wasm-bindgen-cli/);
  assert.match(ended.stderr, new RegExp(`wasm.sh: wasm-bindgen ${version.replaceAll(".", "\\.")} could not be installed: cargo install`));
});

test("a target that cannot be added ends the script with its words", () => {
  const ended = wasm("target", {
    "target/tools/bin/wasm-bindgen": `echo "wasm-bindgen ${version}"`,
    "bin/rustc": `echo "${scratch}/nothing"`,
    "bin/rustup": 'echo "no network: $*" >&2; exit 1',
    "bin/cargo": 'echo "cargo was run" >&2',
  });
  assert.notEqual(ended.status, 0);
  assert.match(ended.stderr, /no network: target add wasm32-unknown-unknown/);
  assert.match(ended.stderr, /wasm.sh: Rust's target wasm32-unknown-unknown could not be added/);
  assert.doesNotMatch(ended.stderr, /cargo was run/);
});
