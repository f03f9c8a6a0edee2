// The numbers of WebAssembly beside those of this machine's own code, `cargo run -p plywave-web --example values`.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import test from "node:test";
import { Cloth, initSync, kindOf, Picture, Ply } from "../pkg/plywave_web.js";
import { printed } from "./program.mjs";

const root = new URL("../..", import.meta.url).pathname;
initSync({ module: readFileSync(new URL("../pkg/plywave_web_bg.wasm", import.meta.url)) });

/** Values count as at least this: sines, cosines and exponentials of the two are off by their last bit, and far below a lobe's peak these add up. */
const LEAST = 1e-4;

/** As `values` of wasm/examples/values.rs. */
function values(bytes, file) {
  const out = [];
  const add = (numbers) => {
    for (const number of numbers) out.push(number);
  };
  if (file.endsWith(".pwm")) {
    const ply = new Ply(bytes, file);
    for (const [theta, hRel, sigma] of [
      [0, 0, 0],
      [0.5, 0.3, 0.004],
      [-1, -0.8, 0.02],
    ]) {
      const h = Math.fround(Math.fround(hRel) * Math.fround(ply.hMaxUm));
      add(ply.map(theta, h, sigma, 0.55, true, 90, 180));
      add(ply.energies(theta, h, sigma));
    }
    return Float32Array.from(out);
  }
  const cloth = new Cloth(bytes, file).withSigma(0.005);
  for (const [theta, phi] of [
    [0, 0],
    [0.8, 0.5],
    [1.4, 2],
    [2.2, 4],
  ]) {
    add(cloth.map(theta, phi, 0.55, 45, 90));
  }
  const wi = readDirections();
  for (let k = 0; k < 64; k++) add(cloth.eval(new Float32Array([37 * k, 91 * k]), 5, new Float32Array([0.48, 0.36, 0.8]), 0.55, wi));
  for (const scene of ["swatch", "front"]) {
    const picture = new Picture(cloth, scene, 32, 32, 0, 1, 0, 1);
    while (picture.pass(16) < 8);
    add(picture.linear());
  }
  return Float32Array.from(out);
}

function readDirections() {
  const f = Math.fround;
  const wi = new Float32Array(192);
  for (let k = 0; k < 64; k++) {
    const z = f(1 - f((k + 0.5) / 32));
    const phi = f(f(2.4) * k);
    const sin = f(Math.sqrt(f(1 - f(z * z))));
    wi.set([f(sin * f(Math.cos(phi))), f(sin * f(Math.sin(phi))), z], 3 * k);
  }
  return wi;
}

function compare(file, most) {
  const bytes = readFileSync(file);
  const own = execFileSync(
    "cargo",
    ["run", "--locked", "--release", "--quiet", "-p", "plywave-web", "--example", "values", "--", file],
    { cwd: root, maxBuffer: 1 << 28 },
  );
  const native = new Float32Array(own.buffer.slice(own.byteOffset, own.byteOffset + own.length));
  const web = values(bytes, file);
  assert.equal(web.length, native.length);
  let [same, worst] = [0, 0];
  native.forEach((value, k) => {
    if (Object.is(value, web[k])) same++;
    else worst = Math.max(worst, Math.abs(value - web[k]) / Math.max(Math.abs(value), LEAST));
  });
  console.log(`${file}: ${native.length} numbers, ${((100 * same) / native.length).toFixed(2)} % of the same bits, largest relative difference ${worst.toExponential(1)}`);
  assert.ok(worst < most, `${worst}`);
}

test("a ply's numbers", () => compare(`${root}fabrics/models/polyester.pwm`, 1e-5));

test("a ply has the radius that the program prints", () => {
  // Those of the specs in fabrics/.
  const radii = { polyester: 50, cotton: 47, cotton_2ply: 47, gold: 50 };
  for (const [name, radius] of Object.entries(radii)) {
    const file = `${root}fabrics/models/${name}.pwm`;
    assert.equal(printed("info", file).ply_radius_um, radius);
    assert.equal(new Ply(readFileSync(file), file).radiusUm, radius);
  }
});

test("a cloth's numbers", { skip: !process.env.PLYWAVE_CLOTH && "PLYWAVE_CLOTH names no cloth file" }, () =>
  compare(process.env.PLYWAVE_CLOTH, 1e-4),
);

test("foreign and damaged files are refused in a sentence", () => {
  assert.equal(kindOf(new Uint8Array(0)), undefined);
  assert.equal(kindOf(new TextEncoder().encode("not a model at all")), undefined);
  const bytes = readFileSync(`${root}fabrics/models/polyester.pwm`);
  assert.equal(kindOf(bytes), "ply");
  assert.throws(() => new Ply(bytes.subarray(0, bytes.length - 100), "short.pwm"), /^Error: short\.pwm: /);
  assert.throws(() => new Cloth(bytes, "polyester.pwm"), /polyester\.pwm: /);
});
