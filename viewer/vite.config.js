// A static site of relative addresses in dist/; the models that ship lie in models/ beside it.
import { copyFileSync, mkdirSync, readdirSync, writeFileSync } from "node:fs";
import { defineConfig } from "vite";

const shipped = "../fabrics/models";

/** Models and their list, as `plywave view` serves them from the program. */
const models = {
  name: "models",
  closeBundle() {
    const names = readdirSync(shipped).filter((name) => name.endsWith(".pwm")).sort();
    mkdirSync("dist/models", { recursive: true });
    for (const name of names) copyFileSync(`${shipped}/${name}`, `dist/models/${name}`);
    writeFileSync("dist/models/index.json", JSON.stringify(names));
  },
};

export default defineConfig({
  base: "./",
  build: { target: "es2022", assetsInlineLimit: 0 },
  worker: { format: "es" },
  plugins: [models],
});
