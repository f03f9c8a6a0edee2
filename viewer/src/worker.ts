// A worker that renders a part of a picture.

import init, { Cloth, Picture } from "../pkg/plywave_web.js";

/** What the page asks of a worker. */
export type Ask =
  | { kind: "load"; module: WebAssembly.Module; bytes: Uint8Array; file: string; part: number; parts: number }
  | { kind: "start"; id: number; scene: string; side: number; sizeMm: number; colors: [number[], number[]] | null }
  | { kind: "look"; id: number; from: number[]; to: number[] };

/** What a worker answers. */
export type Answer =
  | { kind: "loaded"; name: string; notes: string[]; kinds: number; colors: Float32Array; cellUm: Float64Array }
  | { kind: "started"; id: number; view: Float32Array }
  | { kind: "pass"; id: number; part: number; side: number; samples: number; linear: Float32Array }
  | { kind: "fault"; text: string };

/** Pixels of the picture for one of the coarse picture, along a side. */
const COARSE = 4;
/** Longest pass that a change of the scene should wait for [ms]. */
const LONGEST_MS = 250;

let cloth: Cloth | null = null;
let dyed: Cloth | null = null;
let picture: Picture | null = null;
/** The same picture of fewer pixels, shown until the first pass is through. */
let coarse: Picture | null = null;
let isNew = false;
let [scene, side] = ["", 0];
let [part, parts, id] = [0, 1, 0];
let most = 1;
let running = false;

function answer(message: Answer, transfer: Transferable[] = []): void {
  postMessage(message, { transfer });
}

function tell(shown: Picture, side: number): void {
  const linear = shown.linear();
  answer({ kind: "pass", id, part, side, samples: shown.samples, linear }, [linear.buffer]);
}

async function run(): Promise<void> {
  if (running) return;
  running = true;
  while (picture && coarse) {
    if (isNew) {
      isNew = false;
      coarse.pass(1);
      tell(coarse, side / COARSE);
    }
    const begun = performance.now();
    const before = picture.samples;
    const samples = picture.pass(most);
    const each = (performance.now() - begun) / (samples - before);
    most = Math.max(1, Math.min(16, Math.floor(LONGEST_MS / each)));
    tell(picture, side);
    // Messages come in between.
    await new Promise((resume) => setTimeout(resume));
  }
  running = false;
}

async function obey(ask: Ask): Promise<void> {
  switch (ask.kind) {
    case "load": {
      await init({ module_or_path: ask.module });
      [part, parts] = [ask.part, ask.parts];
      cloth = new Cloth(ask.bytes, ask.file);
      answer({ kind: "loaded", name: cloth.name, notes: cloth.notes, kinds: cloth.kinds, colors: cloth.colors(), cellUm: cloth.cellUm });
      break;
    }
    case "start": {
      if (!cloth) return;
      dyed?.free();
      dyed = ask.colors ? cloth.withColors(new Float32Array(ask.colors[0]), new Float32Array(ask.colors[1])) : null;
      const shown = dyed ?? cloth;
      const name = `${ask.scene} ${ask.side} ${ask.sizeMm}`;
      if (picture && name === scene) {
        picture.setCloth(shown);
        coarse?.setCloth(shown);
      } else {
        picture?.free();
        coarse?.free();
        const made = (side: number) => new Picture(shown, ask.scene, side, side, ask.sizeMm, 1, part, parts);
        [picture, coarse, side] = [made(ask.side), made(ask.side / COARSE), ask.side];
        answer({ kind: "started", id: ask.id, view: picture.view() });
      }
      [scene, id, isNew] = [name, ask.id, true];
      void run();
      break;
    }
    case "look":
      for (const each of [picture, coarse]) each?.look(new Float32Array(ask.from), new Float32Array(ask.to));
      [id, isNew] = [ask.id, true];
  }
}

addEventListener("message", (event: MessageEvent<Ask>) => {
  obey(event.data).catch((error: unknown) => answer({ kind: "fault", text: error instanceof Error ? error.message : String(error) }));
});
