// A static site of relative addresses in dist/; the models that ship lie in models/ beside it.
import { copyFileSync, mkdirSync, readdirSync, writeFileSync } from "node:fs";
import { defineConfig } from "vite";

const fabrics = "../fabrics";

function copied(from, to, end) {
  const names = readdirSync(from).filter((name) => name.endsWith(end)).sort();
  mkdirSync(to, { recursive: true });
  for (const name of names) copyFileSync(`${from}/${name}`, `${to}/${name}`);
  return names;
}

/** Ply models, cloth specs, and the list of both. */
const models = {
  name: "models",
  closeBundle() {
    const to = "dist/models";
    const cloths = copied(`${fabrics}/cloths`, to, ".toml");
    // The page opens with the first: one that is made in a moment.
    const names = [...new Set(["jersey.toml", ...cloths, ...copied(`${fabrics}/models`, to, ".pwm")])];
    writeFileSync(`${to}/index.json`, JSON.stringify(names));
  },
};

export default defineConfig({
  base: "./",
  build: { target: "es2022", assetsInlineLimit: 0 },
  worker: { format: "es" },
  plugins: [models],
});
