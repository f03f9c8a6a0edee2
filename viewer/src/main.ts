// The page: which file is shown, and by which view.

import { ClothView } from "./cloth_view";
import { element } from "./dom";
import { Link } from "./link";
import { PlyView } from "./ply_view";
import { initSync, kindOf, version } from "../pkg/plywave_web.js";
import wasm from "../pkg/plywave_web_bg.wasm?url";
import "./style.css";

/** Largest file that is read [bytes]. */
const LARGEST = 64 * 2 ** 20;

const link = new Link();
const models = element<HTMLSelectElement>("models");
const about = element("about");
const faultLine = element<HTMLElement>("fault");

function fault(text: string): void {
  faultLine.textContent = text;
  faultLine.hidden = text === "";
}

function sentence(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

class Page {
  private ply: PlyView | null = null;
  private readonly cloth: ClothView;

  constructor(module: WebAssembly.Module) {
    this.cloth = new ClothView(link, module, fault);
  }

  /** Shows a file. */
  async show(bytes: Uint8Array, file: string): Promise<void> {
    fault("");
    const kind = kindOf(bytes);
    this.cloth.close();
    element<HTMLElement>("ply").hidden = kind !== "ply";
    element<HTMLElement>("cloth").hidden = kind !== "cloth";
    try {
      if (kind === "ply") {
        this.ply ??= new PlyView(link);
        about.textContent = this.ply.open(bytes, file);
      } else if (kind === "cloth") {
        about.textContent = await this.cloth.open(bytes, file);
      } else if (/\.(toml|wif)$/i.test(file)) {
        about.textContent = "";
        fault(`${file}: a spec becomes a model by the program: plywave weave ${file} -o cloth.pwc, or plywave build. Open that file here, or run plywave view ${file}.`);
      } else {
        about.textContent = "";
        fault(`${file}: not a model of plywave. Open a ply model (.pwm) or a cloth (.pwc).`);
      }
    } catch (error) {
      element<HTMLElement>("ply").hidden = element<HTMLElement>("cloth").hidden = true;
      about.textContent = "";
      fault(sentence(error));
    }
  }

  /** Shows a file of the site. */
  async fetch(name: string): Promise<void> {
    about.textContent = `${name} is being loaded`;
    try {
      const response = await fetch(`models/${encodeURIComponent(name)}`);
      if (!response.ok) throw new Error(`${name}: the site answers ${response.status}.`);
      await this.show(new Uint8Array(await response.arrayBuffer()), name);
    } catch (error) {
      about.textContent = "";
      fault(sentence(error));
    }
  }

  /** Shows a file of the user's. */
  async read(file: File): Promise<void> {
    if (file.size > LARGEST) {
      fault(`${file.name}: ${(file.size / 2 ** 20).toFixed(0)} MiB; models have at most ${LARGEST / 2 ** 20} MiB.`);
      return;
    }
    models.value = "";
    await this.show(new Uint8Array(await file.arrayBuffer()), file.name);
  }
}

async function begin(): Promise<void> {
  const module = await WebAssembly.compileStreaming(fetch(wasm));
  initSync({ module });
  document.title = `plywave ${version()}`;
  const page = new Page(module);
  const names = (await (await fetch("models/index.json")).json()) as string[];
  models.replaceChildren(...["", ...names].map((name) => new Option(name || "(a file of yours)", name)));
  models.addEventListener("change", () => {
    if (!models.value) return;
    link.set("model", models.value);
    void page.fetch(models.value);
  });
  const input = element<HTMLInputElement>("file");
  input.addEventListener("change", () => {
    const file = input.files?.[0];
    if (file) void page.read(file);
    input.value = "";
  });
  addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  addEventListener("dragleave", () => document.body.classList.remove("dropping"));
  addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dropping");
    const file = event.dataTransfer?.files[0];
    if (file) void page.read(file);
  });
  element("link").addEventListener("click", () => {
    void navigator.clipboard?.writeText(location.href).catch(() => fault("The browser does not allow copying: copy the address."));
  });
  const wanted = link.text("model", names[0] ?? "");
  if (names.includes(wanted)) models.value = wanted;
  await page.fetch(wanted);
}

begin().catch((error: unknown) => fault(sentence(error)));
