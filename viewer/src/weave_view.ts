// A cloth's spec and draft, which the user may change; the cloth follows.

import { element } from "./dom";
import type { Link } from "./link";
import type { Delivery, Order } from "./loom";

/** Largest repeat that is shown as a grid [yarns]. */
const LARGEST = 32;
/** Time after a change before the cloth is made [ms]. */
const PAUSE_MS = 500;

/** The text of a spec with another weave: rows of `X` and `.`, the last woven first. Ends and picks per centimeter stay. */
export function withRows(text: string, rows: string[]): string {
  const drawn = `[weave]\nkind = "draft"\nrows = [\n${rows.map((row) => `    "${row}",\n`).join("")}]\n`;
  const weaveWith = (old: string[]) => drawn + (old.map((line) => line.split("#")[0]).join("\n").match(/\b(?:ends|picks)_per_cm\s*=\s*[\d.eE+]+/g) ?? []).map((key) => `${key}\n`).join("");
  // The table [weave] ends before the next one; it may also be a line `weave = {..}`.
  const lines = text.split("\n");
  const first = lines.findIndex((line) => /^\s*\[weave\]/.test(line));
  if (first >= 0) {
    const length = lines.slice(first + 1).findIndex((line) => /^\s*\[\[?\w/.test(line));
    const last = length < 0 ? lines.length : first + 1 + length;
    lines.splice(first, last - first, ...weaveWith(lines.slice(first, last)).split("\n"));
    return lines.join("\n");
  }
  const isWeave = (line: string) => /^\s*weave\s*=/.test(line);
  const kept = lines.filter((line) => !isWeave(line));
  const table = kept.findIndex((line) => /^\s*\[/.test(line));
  kept.splice(table < 0 ? kept.length : table, 0, ...weaveWith(lines.filter(isWeave)).split("\n"));
  return kept.join("\n");
}

/** A spec for a weavers' file: cotton yarns of the sheet's count, which the user may change. */
export function specOfWif(file: string): string {
  const yarn = `model = "cotton_single"\nfiber = "cotton"\ncount = "Ne 30"\ntwist = "Z 750/m"\nbundles = 1`;
  return (
    `# The draft is the file's; yarns and their number are of this page.\nname = ${JSON.stringify(file.replace(/\.wif$/i, ""))}\n\n` +
    `[weave]\nkind = "wif"\nfile = ${JSON.stringify(file)}\nends_per_cm = 36\npicks_per_cm = 32\n\n[warp]\n${yarn}\n\n[weft]\nas = "warp"\n`
  );
}

/** Rows of another size: what is new continues the repeat. */
function resized(rows: string[], ends: number, picks: number): string[] {
  const [width, height] = [rows[0]?.length ?? 0, rows.length];
  return Array.from({ length: picks }, (_, down) => {
    const pick = picks - 1 - down;
    const row = rows[height - 1 - (pick % height)] ?? "";
    return Array.from({ length: ends }, (_, end) => row[end % width]).join("");
  });
}

/** The view of a spec. */
export class WeaveView {
  private worker: Worker | null = null;
  private readonly spec = element<HTMLTextAreaElement>("spec");
  private readonly grid = element<HTMLTableElement>("draft");
  private readonly loom = element("loom");
  private readonly sizes = [element<HTMLInputElement>("ends"), element<HTMLInputElement>("picks")] as const;
  private rows: string[] = [];
  private given = new Map<string, Uint8Array>();
  private file = "";
  private cloth: Uint8Array | null = null;
  private pending = 0;

  /** `begin` is called before a cloth is made; `show` is given each that was, with its file's name. */
  constructor(
    private readonly link: Link,
    private readonly begin: () => void,
    private readonly show: (bytes: Uint8Array, file: string) => Promise<void>,
  ) {
    this.spec.addEventListener("input", () => this.later());
    for (const size of this.sizes) {
      size.addEventListener("change", () => {
        const [ends, picks] = this.sizes.map((input) => Math.max(2, Math.min(LARGEST, Math.round(input.valueAsNumber) || 2)));
        this.change(resized(this.rows, ends ?? 2, picks ?? 2));
      });
    }
    this.grid.addEventListener("change", (event) => {
      const box = event.target as HTMLInputElement;
      const [row = 0, end = 0] = (box.dataset.at ?? "").split(",").map(Number);
      const line = this.rows[row] ?? "";
      this.rows[row] = line.slice(0, end) + (box.checked ? "X" : ".") + line.slice(end + 1);
      this.change(this.rows);
    });
    element("weave").addEventListener("click", () => this.make(false));
    element("keep").addEventListener("click", () => this.save());
  }

  /** Opens a spec; `given` are files that it may name. */
  open(text: string, file: string, given: Map<string, Uint8Array>): void {
    this.close();
    const rows = this.link.text("rows", "");
    [this.file, this.given, this.spec.value] = [file, given, /^[X.]+(_[X.]+)+$/.test(rows) ? withRows(text, rows.split("_")) : text];
    element<HTMLElement>("weaving").hidden = false;
    this.make(true);
  }

  close(): void {
    clearTimeout(this.pending);
    this.worker?.terminate();
    this.worker = null;
    this.cloth = null;
    this.loom.textContent = "";
    element<HTMLElement>("weaving").hidden = true;
  }

  private change(rows: string[]): void {
    this.spec.value = withRows(this.spec.value, rows);
    this.link.set("rows", rows.join("_"));
    this.draw(rows);
    this.later();
  }

  private later(): void {
    clearTimeout(this.pending);
    this.pending = window.setTimeout(() => this.make(true), PAUSE_MS);
  }

  private make(isDraft: boolean): void {
    clearTimeout(this.pending);
    this.worker?.terminate();
    this.begin();
    const begun = performance.now();
    const worker = new Worker(new URL("./loom.ts", import.meta.url), { type: "module" });
    this.worker = worker;
    this.loom.textContent = isDraft ? "The cloth is being made." : "The cloth is being made at full quality: a minute or two.";
    worker.addEventListener("message", (event: MessageEvent<Delivery>) => {
      const message = event.data;
      if (message.kind === "draft") {
        this.draw(message.rows);
      } else if (message.kind === "fault") {
        this.loom.textContent = message.text;
      } else {
        this.cloth = message.bytes;
        const seconds = ((performance.now() - begun) / 1000).toFixed(1);
        this.loom.textContent = [`Made in ${seconds} s${isDraft ? ", as a draft" : ""}.`, ...message.notes].join(" ");
        void this.show(message.bytes, this.file);
      }
      if (message.kind !== "draft") worker.terminate();
    });
    worker.addEventListener("error", (event) => (this.loom.textContent = event.message || "the loom failed"));
    const order: Order = { text: this.spec.value, file: this.file, given: this.given, isDraft, site: new URL("models/", location.href).href };
    worker.postMessage(order);
  }

  private draw(rows: string[]): void {
    this.rows = [...rows];
    const [ends, picks] = [rows[0]?.length ?? 0, rows.length];
    const fits = ends > 0 && ends <= LARGEST && picks <= LARGEST;
    element<HTMLElement>("woven").hidden = !fits;
    if (!fits) return;
    [this.sizes[0].value, this.sizes[1].value] = [String(ends), String(picks)];
    const had = document.activeElement instanceof HTMLInputElement ? document.activeElement.dataset.at : undefined;
    this.grid.replaceChildren(
      ...rows.map((line, row) => {
        const tr = document.createElement("tr");
        tr.replaceChildren(
          ...[...line].map((mark, end) => {
            const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: mark === "X" });
            box.dataset.at = `${row},${end}`;
            box.setAttribute("aria-label", `warp on top at end ${end + 1}, pick ${picks - row}`);
            const td = document.createElement("td");
            td.append(box);
            return td;
          }),
        );
        return tr;
      }),
    );
    // The grid is new: whoever moves through it by keys stays where they were.
    if (had) this.grid.querySelector<HTMLInputElement>(`[data-at="${had}"]`)?.focus();
  }

  private save(): void {
    if (!this.cloth) {
      this.loom.textContent = "No cloth has been made yet.";
      return;
    }
    const anchor = document.createElement("a");
    anchor.href = URL.createObjectURL(new Blob([this.cloth.slice()]));
    anchor.download = this.file.replace(/\.\w+$/, "") + ".pwc";
    anchor.click();
    setTimeout(() => URL.revokeObjectURL(anchor.href), 1000);
  }
}
