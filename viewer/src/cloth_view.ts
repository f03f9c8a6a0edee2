// A picture of a cloth, path traced by workers.

import { element, slider, turning } from "./dom";
import type { Link } from "./link";
import type { Answer, Ask } from "./worker";

/** Widths of the scenes' cloths [mm]. */
const SIZES: Record<string, number> = { swatch: 3, front: 30, back: 30, grazing: 200, folds: 90, drape: 400 };
const SIDE = 512;
const MAX_WORKERS = 16;

function srgbOf(hex: string): number[] {
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
}

function hexOf(srgb: ArrayLike<number>): string {
  return "#" + [0, 1, 2].map((k) => Math.round(255 * (srgb[k] ?? 0.8)).toString(16).padStart(2, "0")).join("");
}

/** The view of a cloth. */
export class ClothView {
  private workers: Worker[] = [];
  /** By width of the picture, what each worker has of it. */
  private parts = new Map<number, { samples: number; linear: Float32Array }[]>();
  private readonly canvas = element<HTMLCanvasElement>("picture");
  private readonly scene = element<HTMLSelectElement>("scene");
  private readonly own = element<HTMLInputElement>("own");
  private readonly colors = [element<HTMLInputElement>("warp"), element<HTMLInputElement>("weft")] as const;
  private readonly setSize: (value: number) => void;
  private readonly setExposure: (value: number) => void;
  private exposure = 0;
  private sizeMm = 3;
  /** Of the picture under way: answers of others are late. */
  private id = 0;
  private from = [0, 0, 1];
  private to = [0, 0, 0];
  private begun = 0;
  private asked = false;
  /** Whether the scene has told where its camera is. */
  private hasView = false;
  /** Whether the camera stays where it is though the picture is new. */
  private isKept = false;

  constructor(
    private readonly link: Link,
    private readonly module: WebAssembly.Module,
    private readonly fault: (text: string) => void,
  ) {
    this.canvas.width = this.canvas.height = SIDE;
    this.setSize = slider("size", (v) => `${(10 ** v).toPrecision(2)} mm`, (v) => {
      this.sizeMm = 10 ** v;
      link.set("size", v);
      this.start();
    });
    this.setExposure = slider("exposure", (v) => `${v.toFixed(1)} stops`, (v) => {
      this.exposure = v;
      link.set("exposure", v);
      this.ask();
    });
    this.scene.addEventListener("change", () => {
      link.set("scene", this.scene.value);
      this.resize(SIZES[this.scene.value] ?? 3);
    });
    this.own.addEventListener("change", () => {
      link.set("own", Number(this.own.checked));
      this.start();
    });
    this.colors.forEach((input) =>
      input.addEventListener("change", () => {
        link.set(input.id, input.value.slice(1));
        this.own.checked = false;
        link.set("own", 0);
        this.start();
      }),
    );
    element("reset").addEventListener("click", () => this.resize(SIZES[this.scene.value] ?? 3));
    element("save").addEventListener("click", () => this.save());
    turning(this.canvas, (about, up) => this.turn(about, up));
  }

  /** Loads a cloth into every worker, `anew` or where the camera is. Resolves to what it is once the first has it. */
  open(bytes: Uint8Array, file: string, anew = true): Promise<string> {
    this.isKept = !anew && this.hasView;
    this.close();
    const count = Math.max(1, Math.min(MAX_WORKERS, navigator.hardwareConcurrency || 1));
    let known = false;
    return new Promise((resolve, reject) => {
      for (let part = 0; part < count; part++) {
        const worker = new Worker(new URL("./worker.ts", import.meta.url), { type: "module" });
        worker.addEventListener("message", (event: MessageEvent<Answer>) => {
          const message = event.data;
          if (message.kind === "fault") {
            reject(new Error(message.text));
            this.fault(message.text);
          } else if (message.kind === "loaded") {
            // The first that has it sets the scene, which all others then start with.
            if (!known) resolve(this.loaded(message));
            known = true;
            this.send(worker, this.startOf());
            if (this.isKept) this.send(worker, { kind: "look", id: this.id, from: this.from, to: this.to });
          } else {
            this.heard(message);
          }
        });
        worker.addEventListener("error", (event) => this.fault(event.message || "a worker failed"));
        this.workers.push(worker);
        this.send(worker, { kind: "load", module: this.module, bytes, file, part, parts: count });
      }
    });
  }

  /** Stops all work; the picture stays. */
  close(): void {
    this.workers.forEach((worker) => worker.terminate());
    this.workers = [];
    this.parts.clear();
  }

  /** Stops all work and forgets the picture. */
  clear(): void {
    this.close();
    this.hasView = false;
    this.canvas.width = this.canvas.height = SIDE;
  }

  private loaded(about: Answer & { kind: "loaded" }): string {
    const { link } = this;
    this.scene.value = link.text("scene", "swatch");
    if (!this.scene.value) this.scene.value = "swatch";
    const size = link.number("size", Math.log10(SIZES[this.scene.value] ?? 3));
    this.sizeMm = 10 ** size;
    this.setSize(size);
    this.exposure = link.number("exposure", 0);
    this.setExposure(this.exposure);
    this.own.checked = link.number("own", 1) !== 0;
    this.colors.forEach((input, kind) => {
      const given = link.text(input.id, "");
      const colors = about.colors.length > 3 * kind ? about.colors.subarray(3 * kind) : about.colors;
      input.value = /^[0-9a-f]{6}$/.test(given) ? "#" + given : hexOf(colors);
    });
    this.colors[1].disabled = about.kinds < 2;
    element("notes").replaceChildren(
      ...about.notes.map((note) => Object.assign(document.createElement("li"), { textContent: note })),
    );
    this.begin();
    const [ax, ay, bx, by] = about.cellUm;
    const long = (x = 0, y = 0) => (Math.hypot(x, y) / 1000).toFixed(2);
    return `${about.name}: a cloth that repeats after ${long(ax, ay)} mm and ${long(bx, by)} mm`;
  }

  private send(worker: Worker, ask: Ask): void {
    worker.postMessage(ask);
  }

  private begin(): void {
    this.id++;
    this.begun = performance.now();
    this.parts.clear();
    this.canvas.dataset.side = this.canvas.dataset.samples = "0";
  }

  private startOf(): Ask {
    const colors: [number[], number[]] | null = this.own.checked ? null : [srgbOf(this.colors[0].value), srgbOf(this.colors[1].value)];
    return { kind: "start", id: this.id, scene: this.scene.value, side: SIDE, sizeMm: this.sizeMm, colors };
  }

  private start(): void {
    this.begin();
    this.workers.forEach((worker) => this.send(worker, this.startOf()));
  }

  private resize(mm: number): void {
    this.sizeMm = mm;
    this.setSize(Math.log10(mm));
    this.link.set("size", Math.log10(mm));
    this.isKept = false;
    // Another size than the last, however little: the camera is the scene's again.
    this.sizeMm *= 1 + 1e-6 * (this.id % 7);
    this.start();
  }

  private turn(about: number, up: number): void {
    const arm = this.from.map((v, k) => v - (this.to[k] ?? 0));
    const [x = 0, y = 0, z = 1] = arm;
    const long = Math.hypot(x, y, z);
    const azimuth = Math.atan2(y, x) + about;
    const height = Math.max(-1.55, Math.min(1.55, Math.asin(z / long) + up));
    this.from = [Math.cos(height) * Math.cos(azimuth), Math.cos(height) * Math.sin(azimuth), Math.sin(height)].map(
      (v, k) => (this.to[k] ?? 0) + long * v,
    );
    this.begin();
    this.workers.forEach((worker) => this.send(worker, { kind: "look", id: this.id, from: this.from, to: this.to }));
  }

  private heard(message: Answer): void {
    if (message.kind === "started" && message.id === this.id && !this.isKept) {
      this.hasView = true;
      this.from = [...message.view.subarray(0, 3)];
      this.to = [...message.view.subarray(3, 6)];
    } else if (message.kind === "pass" && message.id === this.id) {
      const parts = this.parts.get(message.side) ?? [];
      parts[message.part] = message;
      this.parts.set(message.side, parts);
      this.ask();
    }
  }

  private ask(): void {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  private draw(): void {
    const whole = (parts: unknown[]) => parts.filter((part) => part).length === this.workers.length;
    // The finest that all workers have.
    const side = Math.max(0, ...[...this.parts].filter(([, parts]) => whole(parts)).map(([side]) => side));
    const parts = this.parts.get(side);
    if (!parts) return;
    const scale = 2 ** this.exposure;
    if (this.canvas.width !== side) this.canvas.width = this.canvas.height = side;
    const image = new ImageData(side, side);
    for (let pixel = 0; pixel < side * side; pixel++) {
      for (let c = 0; c < 3; c++) {
        let sum = 0;
        for (const part of parts) sum += part.linear[3 * pixel + c] ?? 0;
        const v = Math.max(0, Math.min(1, scale * sum));
        image.data[4 * pixel + c] = Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
      }
      image.data[4 * pixel + 3] = 255;
    }
    this.canvas.getContext("2d")?.putImageData(image, 0, 0);
    const samples = parts.map((part) => part.samples);
    const seconds = (performance.now() - this.begun) / 1000;
    const rate = (samples.reduce((a, b) => a + b, 0) * side * side) / this.workers.length / seconds / 1000;
    element("progress").textContent =
      `${Math.min(...samples)} samples a pixel in ${seconds.toFixed(1)} s, ${rate.toFixed(0)} k paths/s by ${this.workers.length} workers`;
    this.canvas.dataset.side = String(side);
    this.canvas.dataset.samples = String(Math.min(...samples));
    this.canvas.dataset.even = String(Number(samples.every((count) => count === samples[0])));
  }

  private save(): void {
    this.canvas.toBlob((blob) => {
      if (!blob) return;
      const anchor = document.createElement("a");
      anchor.href = URL.createObjectURL(blob);
      anchor.download = `${this.link.text("model", "cloth").replace(/\.\w+$/, "")}_${this.scene.value}.png`;
      anchor.click();
      setTimeout(() => URL.revokeObjectURL(anchor.href), 1000);
    }, "image/png");
  }
}
