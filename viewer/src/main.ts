// The page: which file is shown, and by which view.

import { ClothView } from "./cloth_view";
import { element } from "./dom";
import { Link } from "./link";
import { PlyView } from "./ply_view";
import { specOfWif, WeaveView } from "./weave_view";
import { initSync, kindOf, version } from "../pkg/plywave_web.js";
import wasm from "../pkg/plywave_web_bg.wasm?url";
import "./style.css";

/** Largest file that is read [bytes]. */
const LARGEST = 64 * 2 ** 20;
const LARGEST_SPEC = 2 ** 20;

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
  private readonly weave = new WeaveView(
    link,
    // The loom has all cores.
    () => this.cloth.close(),
    (bytes, file) => this.showCloth(bytes, file),
  );

  constructor(module: WebAssembly.Module) {
    this.cloth = new ClothView(link, module, fault);
  }

  /** Shows a cloth, in the scene of the last. */
  private async showCloth(bytes: Uint8Array, file: string): Promise<void> {
    try {
      about.textContent = await this.cloth.open(bytes, file, false);
    } catch (error) {
      about.textContent = "";
      fault(sentence(error));
    }
  }

  /** Opens a spec, or a weavers' file. */
  private openSpec(bytes: Uint8Array, file: string, given: Map<string, Uint8Array>): void {
    if (bytes.length > LARGEST_SPEC) {
      fault(`${file}: ${(bytes.length / 2 ** 20).toFixed(1)} MiB; a spec has at most 1 MiB.`);
      return;
    }
    this.cloth.clear();
    element<HTMLElement>("ply").hidden = true;
    element<HTMLElement>("cloth").hidden = false;
    about.textContent = file;
    const isWif = /\.wif$/i.test(file);
    this.weave.open(isWif ? specOfWif(file) : new TextDecoder().decode(bytes), isWif ? file.replace(/\.wif$/i, ".toml") : file, given);
  }

  /** Shows tables beside the ply that is shown. */
  private besides(tables: [string, Uint8Array][]): void {
    for (const [name, bytes] of tables) {
      try {
        if (element<HTMLElement>("ply").hidden || !this.ply) throw new Error(`${name}: open the model of this table first, or both together.`);
        this.ply.openTable(bytes, name);
      } catch (error) {
        fault(sentence(error));
      }
    }
  }

  /** Shows a file; `given` are those that came with it. */
  async show(bytes: Uint8Array, file: string, given = new Map<string, Uint8Array>()): Promise<void> {
    fault("");
    this.weave.close();
    if (/\.(toml|wif)$/i.test(file)) {
      this.openSpec(bytes, file, given);
      return;
    }
    const kind = kindOf(bytes);
    if (kind === "table") {
      this.besides([[file, bytes]]);
      return;
    }
    this.cloth.close();
    element<HTMLElement>("ply").hidden = kind !== "ply";
    element<HTMLElement>("cloth").hidden = kind !== "cloth";
    try {
      if (kind === "ply") {
        this.ply ??= new PlyView(link);
        about.textContent = this.ply.open(bytes, file);
        this.besides([...given].filter(([, bytes]) => kindOf(bytes) === "table"));
      } else if (kind === "cloth") {
        about.textContent = await this.cloth.open(bytes, file);
      } else {
        about.textContent = "";
        fault(`${file}: not a file of plywave. Open a ply model (.pwm), its table (.pwt), a cloth (.pwc), a cloth spec (.toml) or a weavers' file (.wif).`);
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

  /** Shows a file of the user's: a spec if there is one, with the files that it names. */
  async read(files: FileList | undefined): Promise<void> {
    const all = [...(files ?? [])];
    const large = all.find((file) => file.size > LARGEST);
    if (large) {
      fault(`${large.name}: ${(large.size / 2 ** 20).toFixed(0)} MiB; models have at most ${LARGEST / 2 ** 20} MiB.`);
      return;
    }
    const main = [".toml", ".wif", ".pwc", ".pwm", ""].map((end) => all.find((file) => file.name.toLowerCase().endsWith(end))).find((file) => file);
    if (!main) return;
    const given = new Map<string, Uint8Array>();
    for (const file of all) given.set(file.name, new Uint8Array(await file.arrayBuffer()));
    models.value = "";
    link.set("rows", "");
    await this.show(given.get(main.name) ?? new Uint8Array(), main.name, given);
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
    link.set("rows", "");
    void page.fetch(models.value);
  });
  const input = element<HTMLInputElement>("file");
  input.addEventListener("change", () => {
    void page.read(input.files ?? undefined).finally(() => (input.value = ""));
  });
  addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  addEventListener("dragleave", () => document.body.classList.remove("dropping"));
  addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dropping");
    void page.read(event.dataTransfer?.files);
  });
  element("link").addEventListener("click", () => {
    void navigator.clipboard?.writeText(location.href).catch(() => fault("The browser does not allow copying: copy the address."));
  });
  const wanted = link.text("model", names[0] ?? "");
  if (names.includes(wanted)) models.value = wanted;
  await page.fetch(wanted);
}

begin().catch((error: unknown) => fault(sentence(error)));
