// Renders the pictures of check_looks.py in three.js: node three.mjs FILE.glb FOLDER NODE_MODULES
import { createReadStream, readFileSync, statSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { join } from "node:path";

const [glb, folder, modules] = process.argv.slice(2);
const { chromium } = createRequire(join(modules, "x"))("playwright-core");
const task = JSON.parse(readFileSync(join(folder, "task.json")));

const page = `<!doctype html><script type="importmap">{"imports": {"three": "/three/build/three.module.js",
  "three/addons/": "/three/examples/jsm/"}}</script>`;
const files = (url) => {
  if (url === "/cloth.glb") return glb;
  if (url === "/plugin.js") return join(import.meta.dirname, "diffuse_transmission.js");
  return url.startsWith("/three/") ? join(modules, url) : null;
};
const server = createServer((request, response) => {
  const path = files(new URL(request.url, "http://x").pathname);
  if (!path) {
    response.setHeader("Content-Type", "text/html");
    return response.end(page);
  }
  if (!statSync(path, { throwIfNoEntry: false })) return response.writeHead(404).end();
  response.setHeader("Content-Type", path.endsWith(".js") ? "text/javascript" : "application/octet-stream");
  createReadStream(path).pipe(response);
});
await new Promise((ready) => server.listen(0, "127.0.0.1", ready));
const args = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args });
try {
  const tab = await browser.newPage();
  tab.on("console", (message) => console.error(message.text()));
  tab.on("pageerror", (error) => console.error(String(error)));
  await tab.goto(`http://127.0.0.1:${server.address().port}/`);
  const pictures = await tab.evaluate(async (task) => {
    const THREE = await import("three");
    const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
    const { DiffuseTransmission } = await import("/plugin.js");
    const loader = new GLTFLoader().register((parser) => new DiffuseTransmission(parser));
    const gltf = await loader.loadAsync("/cloth.glb");
    let swatch;
    gltf.scene.traverse((thing) => { if (thing.isMesh) swatch = thing; });
    // The swatch says how long a unit of its texture coordinates is.
    const at = swatch.geometry.getAttribute("position"), uv = swatch.geometry.getAttribute("uv");
    const perUnit = [uv.getX(1) / (at.getX(1) - at.getX(0)), uv.getY(0) / (at.getY(2) - at.getY(1))];
    const renderer = new THREE.WebGLRenderer();
    const target = new THREE.WebGLRenderTarget(task.side, task.side, { type: THREE.FloatType, samples: 4 });
    const r = task.radius, camera = new THREE.OrthographicCamera(-r, r, r, -r, 0.01, 10);
    camera.position.z = 1;
    const meshes = {};
    for (const [name, shape] of Object.entries(task.shapes)) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.Float32BufferAttribute(shape.at, 3));
      geometry.setAttribute("normal", new THREE.Float32BufferAttribute(shape.normals, 3));
      const coordinates = shape.uv.map((v, k) => task.uv_m * perUnit[k % 2] * (k % 2 ? -v : v));
      geometry.setAttribute("uv", new THREE.Float32BufferAttribute(coordinates, 2));
      geometry.setIndex(shape.triangles);
      meshes[name] = new THREE.Mesh(geometry, swatch.material);
      if (swatch.geometry.hasAttribute("tangent")) geometry.computeTangents();
    }
    const out = {};
    for (const [name, shape, toLight] of task.scenes) {
      const scene = new THREE.Scene();
      const light = new THREE.DirectionalLight(0xffffff, 1);
      light.position.set(...toLight);
      scene.add(meshes[shape], light);
      renderer.setRenderTarget(target);
      renderer.setClearColor(0, 0);
      renderer.clear();
      renderer.render(scene, camera);
      const pixels = new Float32Array(4 * task.side * task.side);
      renderer.readRenderTargetPixels(target, 0, 0, task.side, task.side, pixels);
      out[name] = Array.from(pixels);
    }
    return out;
  }, task);
  for (const [name, pixels] of Object.entries(pictures)) {
    writeFileSync(join(folder, `${name}.f32`), Buffer.from(new Float32Array(pixels).buffer));
  }
} finally {
  await browser.close();
  server.close();
}
