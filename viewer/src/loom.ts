// A worker that makes cloths of specs.

import init, { Recipe } from "../pkg/plywave_weaver.js";

/** What the page asks: a spec's text, by what it is called, and files that it names which the user gave. */
export type Order = {
  text: string;
  file: string;
  given: Map<string, Uint8Array>;
  isDraft: boolean;
  /** Folder of the site's models. */
  site: string;
};

/** What it gets. */
export type Delivery =
  | { kind: "draft"; name: string; rows: string[] }
  | { kind: "cloth"; bytes: Uint8Array; notes: string[] }
  | { kind: "fault"; text: string };

function deliver(message: Delivery, transfer: Transferable[] = []): void {
  postMessage(message, { transfer });
}

/** A file that a spec names: of the user, by its last name, or of the site. */
async function file(name: string, { given, site }: Order): Promise<Uint8Array> {
  const own = given.get(name.replace(/^.*\//, ""));
  if (own) return own;
  const response = await fetch(site + name.split("/").map(encodeURIComponent).join("/"));
  if (!response.ok) throw new Error(`the spec names ${name}, which this site has not: open that file together with the spec`);
  return new Uint8Array(await response.arrayBuffer());
}

async function make(order: Order): Promise<void> {
  await init();
  const recipe = new Recipe(order.text, order.file);
  for (const name of recipe.needs()) recipe.give(name, await file(name, order));
  deliver({ kind: "draft", name: recipe.name, rows: recipe.rows() });
  const woven = recipe.weave(order.isDraft);
  const bytes = woven.bytes;
  deliver({ kind: "cloth", bytes, notes: woven.notes }, [bytes.buffer]);
}

addEventListener("message", (event: MessageEvent<Order>) => {
  make(event.data).catch((error: unknown) => deliver({ kind: "fault", text: error instanceof Error ? error.message : String(error) }));
});
