// The page in headless Chromium, served by the program: CHROMIUM and PLYWAVE name other files than /usr/bin/chromium and target/release/plywave.
import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, truncateSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import test, { after, before } from "node:test";
import { chromium } from "playwright-core";
import { Cloth, initSync, Picture, Ply } from "../pkg/plywave_web.js";
import { printed } from "./program.mjs";

const root = new URL("../..", import.meta.url).pathname;
const plywave = process.env.PLYWAVE ?? `${root}target/release/plywave`;
const scratch = mkdtempSync(join(tmpdir(), "plywave-viewer-"));
const shots = process.env.PLYWAVE_SHOTS;
const models = `${root}fabrics/models`;
const said = [];
let [program, browser, page, site] = [];

before(async () => {
  initSync({ module: readFileSync(new URL("../pkg/plywave_web_bg.wasm", import.meta.url)) });
  program = spawn(plywave, ["view", `${models}/polyester.pwm`, "--site", `${root}viewer/dist`]);
  program.stderr.resume();
  for await (const line of createInterface({ input: program.stdout })) {
    site = line;
    break;
  }
  const args = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
  browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args });
  page = await browser.newPage({ viewport: { width: 1400, height: 1000 } });
  page.on("console", (message) => said.push(message.text()));
  page.on("pageerror", (error) => said.push(error.message));
  page.setDefaultTimeout(90_000);
});

after(async () => {
  await browser?.close();
  program?.kill();
  rmSync(scratch, { recursive: true });
});

const text = (id) => page.textContent(`#${id}`);
const slice = () => page.getAttribute("#slice", "d");
const shot = (name) => shots && page.screenshot({ path: join(shots, `${name}.png`) });
const samples = () => page.waitForFunction(() => Number(document.getElementById("picture").dataset.side) === 512);

/** Opens the page afresh. Returns how long it took until `ready` holds of the page [ms]. */
async function open(hash, ready) {
  await page.goto("about:blank");
  const begun = performance.now();
  await page.goto(site + hash);
  await page.waitForFunction(ready);
  return performance.now() - begun;
}

test("a ply's lobes: the first picture in 3 s", async () => {
  const ms = await open("", () => document.getElementById("slice")?.getAttribute("d"));
  console.log(`first picture of a ply: ${ms.toFixed(0)} ms`);
  assert.ok(ms < 3000, `${ms} ms`);
  // The radius of fabrics/polyester.toml.
  assert.equal(await text("about"), "polyester: a ply of radius 50 um");
  await shot("ply");
});

test("sliders move the lobes by keyboard, and the link keeps them", async () => {
  const before = await slice();
  await page.focus("#theta");
  for (let k = 0; k < 20; k++) await page.keyboard.press("ArrowRight");
  await page.waitForFunction((before) => document.getElementById("slice").getAttribute("d") !== before, before);
  await page.waitForFunction(() => location.hash.includes("theta=30"));
  const now = await slice();
  const link = await page.evaluate(() => location.hash);
  await open(link, () => document.getElementById("slice")?.getAttribute("d"));
  assert.equal(await slice(), now);
});

test("the slice is the library's", async () => {
  const ply = new Ply(readFileSync(`${models}/polyester.pwm`), "polyester.pwm");
  const theta = (30 * Math.PI) / 180;
  const points = (await slice()).match(/[-\d.]+ [-\d.]+/g).map((pair) => pair.split(" ").map(Number));
  const directions = points.flatMap((_, k) => {
    const phi = (2 * Math.PI * k) / points.length;
    return [Math.cos(theta) * Math.cos(phi), Math.cos(theta) * Math.sin(phi), -Math.sin(theta)];
  });
  const f = ply.eval(theta, 0, 10 ** (-5 + 4 * 0.4), 0.55, true, Float32Array.from(directions));
  const top = Math.ceil(Math.log10(Math.max(...f)));
  points.forEach(([x, y], k) => {
    const expected = Math.max(0, 100 * (1 - (top - Math.log10(f[k])) / 4));
    assert.ok(Math.abs(Math.hypot(x, y) - expected) < 0.02, `${k}: ${Math.hypot(x, y)}, ${expected}`);
  });
});

test("offsets and shares of light are those that the program prints", async () => {
  const polyester = `${models}/polyester.pwm`;
  const points = async () => (await slice()).match(/[-\d.]+ [-\d.]+/g).map((pair) => Math.hypot(...pair.split(" ").map(Number)));
  // At the middle, across the ply, without absorption.
  await open("#model=polyester.pwm&theta=0&h=0&sigma=0&edge=0", () => document.getElementById("slice")?.getAttribute("d"));
  const energies = printed("info", polyester).energies;
  const middle = (energies.r_d[0].length - 1) / 2;
  const shares = [energies.energy_refl[0][middle], energies.energy_high[0][middle][0], energies.r_d[0][middle]];
  const shown = (await text("energies")).match(/[\d.]+ %/g).map((share) => Number.parseFloat(share));
  assert.match(await text("energies"), /only reflected at fibers/);
  shares.forEach((share, k) => assert.ok(Math.abs(100 * share - shown[k]) < 0.06, `${shown[k]} % for ${share}`));
  // Beams at 0.9 R and at the rim meet fewer fibers.
  for (const h of [0.5, 0.9, 1.2]) {
    await open(`#model=polyester.pwm&theta=30&h=${h}&sigma=0&edge=0`, () => document.getElementById("slice")?.getAttribute("d"));
    const radii = await points();
    const every = 40;
    const directions = [0, 1, 2, 3, 4, 5, 6, 7, 8].map((k) => (360 * k * every) / radii.length);
    const f = directions.map((phi) => printed("eval", polyester, "--theta-i", 30, "--h-rel", h, "--sigma", 0, "--theta-o", -30, "--phi-o", phi).f_per_sr[0]);
    const top = Number((await page.textContent("#decades text")).slice(2)) + 3;
    f.forEach((value, k) => {
      const expected = Math.max(0, 100 * (1 - (top - Math.log10(value)) / 4));
      assert.ok(Math.abs(radii[k * every] - expected) < 0.1, `h ${h} R, phi ${directions[k]}: ${radii[k * every]}, ${expected}`);
    });
  }
  assert.equal(await page.getAttribute("#h", "max"), "1.400000");
});

test("a table lies beside its model", async () => {
  const table = join(scratch, "polyester.pwt");
  execFileSync(plywave, ["simulate", `${root}fabrics/polyester.toml`, "--preset", "preview", "--paths", "100000", "-q", "-o", table]);
  await page.setInputFiles("#file", [table, `${models}/polyester.pwm`]);
  await page.waitForFunction(() => document.getElementById("traced")?.getAttribute("d"));
  await shot("traced");
  // Radii are by powers of ten, 25 each.
  const mean = async (id) => {
    const points = (await page.getAttribute(`#${id}`, "d")).match(/[-\d.]+ [-\d.]+/g);
    const values = points.map((pair) => 10 ** (Math.hypot(...pair.split(" ").map(Number)) / 25));
    return values.reduce((a, b) => a + b, 0) / values.length;
  };
  const ratio = (await mean("traced")) / (await mean("slice"));
  console.log(`mean of the slice by paths over the model's: ${ratio.toFixed(3)}`);
  assert.ok(Math.abs(ratio - 1) < 0.15);
  await page.setInputFiles("#file", `${models}/silk.pwm`);
  await page.waitForFunction(() => document.getElementById("about").textContent.startsWith("silk"));
  await page.setInputFiles("#file", table);
  await page.waitForFunction(() => document.getElementById("fault").textContent.includes("another yarn spec"));
  await page.setInputFiles("#file", `${models}/polyester.pwm`);
  await page.waitForFunction(() => document.getElementById("fault").hidden);
});

test("30 frames a second of the lobes", async () => {
  const rate = await page.evaluate(async () => {
    const input = document.getElementById("h");
    const begun = performance.now();
    let frames = 0;
    while (performance.now() - begun < 3000) {
      input.valueAsNumber = Math.sin(frames / 20);
      input.dispatchEvent(new Event("input"));
      await new Promise((drawn) => requestAnimationFrame(drawn));
      frames++;
    }
    return frames / ((performance.now() - begun) / 1000);
  });
  console.log(`changes of the lobes, drawn by software: ${rate.toFixed(0)} a second`);
  // Two cores that do the work of the graphics processor, too, and may be shared, are held to a third of the 30.
  assert.ok(rate > 10, `${rate}`);
});

test("a spec becomes a cloth, and its draft can be changed", async () => {
  const ms = await open("#model=organza.toml", () => Number(document.getElementById("picture").dataset.samples) > 0);
  console.log(`first picture of organza, made of its spec: ${ms.toFixed(0)} ms`);
  await samples();
  await shot("organza");
  for (const id of ["ends", "picks"]) {
    await page.fill(`#${id}`, "4");
    await page.press(`#${id}`, "Enter");
  }
  const box = page.getByLabel("warp on top at end 2, pick 4");
  const was = await box.isChecked();
  await box.focus();
  await page.keyboard.press("Space");
  // Four yarns at 40 a centimeter.
  await page.waitForFunction(() => document.getElementById("about").textContent.includes("1.00 mm and 1.00 mm"));
  assert.equal(await page.getByLabel("warp on top at end 2, pick 4").isChecked(), !was);
  assert.equal((await page.inputValue("#spec")).match(/"[X.]{4}"/g).length, 4);
  await samples();
  await shot("draft");
  const link = await page.evaluate(() => location.hash);
  await open(link, () => document.getElementById("spec")?.value.includes("...X") && document.querySelectorAll("#draft input").length === 16);
  await page.waitForFunction(() => document.getElementById("about").textContent.includes("1.00 mm and 1.00 mm"));
});

test("a spec that is wrong is told, with its key", async () => {
  const spec = await page.inputValue("#spec");
  await page.fill("#spec", spec.replace("fibers = 16", "packing = 7"));
  await page.waitForFunction(() => /packing/.test(document.getElementById("loom").textContent));
  assert.match(await text("loom"), /organza\.toml: .*packing.*7/);
});

test("a picture has the library's pixels", async () => {
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.click("#keep"),
  ]);
  const bytes = readFileSync(await download.path());
  const file = join(scratch, "mine.pwc");
  writeFileSync(file, bytes);
  await page.setInputFiles("#file", file);
  await page.waitForFunction(() => document.getElementById("picture").dataset.side === "512" && document.getElementById("weaving").hidden);
  // Workers are a sample apart at times.
  const taken = await page.waitForFunction(() => {
    const canvas = document.getElementById("picture");
    if (canvas.dataset.even !== "1") return null;
    const image = canvas.getContext("2d").getImageData(0, 0, 512, 512);
    return { samples: Number(canvas.dataset.samples), rgba: [...image.data] };
  });
  const shown = await taken.jsonValue();
  assert.ok(shown.samples >= 1);
  const picture = new Picture(new Cloth(bytes, "mine.pwc"), "swatch", 512, 512, 0, 1, 0, 1);
  while (picture.samples < shown.samples) picture.pass(1);
  const linear = picture.linear();
  let worst = 0;
  linear.forEach((value, k) => {
    const v = Math.max(0, Math.min(1, value));
    const expected = Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
    worst = Math.max(worst, Math.abs(expected - shown.rgba[4 * Math.floor(k / 3) + (k % 3)]));
  });
  console.log(`${shown.samples} samples a pixel: largest difference ${worst} of 255`);
  assert.ok(worst <= 1, `${worst}`);
});

test("foreign files are told in a sentence", async () => {
  const fault = async (name, bytes, expected) => {
    const file = join(scratch, name);
    writeFileSync(file, bytes);
    if (name === "large.pwc") truncateSync(file, 500 * 2 ** 20);
    await page.setInputFiles("#file", file);
    await page.waitForFunction((name) => !document.getElementById("fault").hidden && document.getElementById("fault").textContent.includes(name), name);
    const told = await text("fault");
    console.log(told);
    assert.match(told, expected);
  };
  const ply = readFileSync(`${models}/polyester.pwm`);
  await fault("garbage.pwc", "not a cloth at all", /not a file of plywave/);
  await fault("large.pwc", "", /500 MiB/);
  await fault("short.pwm", ply.subarray(0, ply.length / 2), /short\.pwm: /);
  const version = Buffer.from(ply);
  const at = version.indexOf('\\"version\\":3');
  version.write('\\"version\\":9', at);
  await fault("other.pwm", version, /version/);
  await shot("fault");
  await page.setInputFiles("#file", `${models}/polyester.pwm`);
  await page.waitForFunction(() => document.getElementById("fault").hidden);
});

test("a weavers' file is woven", async () => {
  await page.setInputFiles("#file", `${root}tests/data/field/wif_utf16/draft.wif`);
  await page.waitForFunction(() => /Made|:/.test(document.getElementById("loom").textContent));
  console.log(await text("loom"));
  assert.match(await text("loom"), /^Made in/);
});

test("every control has a name", async () => {
  const nameless = await page.evaluate(() =>
    [...document.querySelectorAll("input, select, textarea, button, canvas, svg")]
      .filter((e) => !(e.labels?.length || e.getAttribute("aria-label") || (e.tagName === "BUTTON" && e.textContent.trim())))
      .map((e) => e.outerHTML),
  );
  assert.deepEqual(nameless, []);
});

test("nothing was said on the console", () => assert.deepEqual(said, []));
