// Shows a tileset in a real browser with CesiumJS, and says what the browser made of it.
//
//     node tests/web/show.mjs NODE_MODULES CHROMIUM TILESET_FOLDER picture.png
//
// Prints JSON: number of features, the properties of the feature in the middle of the picture, where it was picked.
// Everything is served from this machine; no imagery, no terrain, no account.

import { spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { extname, join, normalize } from "node:path";

const [modules, chromium, tileset, picture] = process.argv.slice(2);
const LIMIT_MS = 240_000;
const TYPES = { ".html": "text/html", ".js": "text/javascript", ".json": "application/json", ".css": "text/css",
  ".wasm": "application/wasm", ".glb": "model/gltf-binary", ".png": "image/png", ".jpg": "image/jpeg" };

const page = `<!doctype html><meta charset="utf-8">
<link rel="stylesheet" href="/cesium/Widgets/widgets.css">
<style>html, body, #map { margin: 0; width: 1000px; height: 700px; overflow: hidden }</style>
<div id="map"></div>
<script>window.CESIUM_BASE_URL = "/cesium/";</script>
<script src="/cesium/Cesium.js"></script>
<script>
const report = (body) => fetch("/report", { method: "POST", body: JSON.stringify(body) });
window.addEventListener("error", (event) => report({ error: String(event.message) }));
window.addEventListener("unhandledrejection", (event) => report({ error: String(event.reason) }));
(async () => {
  const viewer = new Cesium.Viewer("map", {
    baseLayer: false, animation: false, timeline: false, baseLayerPicker: false, geocoder: false, homeButton: false,
    sceneModePicker: false, navigationHelpButton: false, fullscreenButton: false, infoBox: false,
    selectionIndicator: false, contextOptions: { webgl: { preserveDrawingBuffer: true } },
  });
  const scene = viewer.scene;
  scene.globe.baseColor = Cesium.Color.fromCssColorString("#e8e4da");
  scene.globe.depthTestAgainstTerrain = false;
  scene.skyBox = undefined;
  scene.backgroundColor = Cesium.Color.fromCssColorString("#cfe0ee");
  const tiles = await Cesium.Cesium3DTileset.fromUrl("/tileset/tileset.json", { maximumScreenSpaceError: 1 });
  scene.primitives.add(tiles);
  const sphere = tiles.boundingSphere;
  viewer.camera.viewBoundingSphere(sphere, new Cesium.HeadingPitchRange(0.5, -0.6, sphere.radius * 1.9));
  viewer.camera.lookAtTransform(Cesium.Matrix4.IDENTITY);
  let nFeatures = 0;
  tiles.tileLoad.addEventListener((tile) => { nFeatures += tile.content.featuresLength; });
  await new Promise((resolve) => tiles.initialTilesLoaded.addEventListener(resolve));
  for (let i = 0; i < 5; i += 1) { viewer.render(); await new Promise((resolve) => setTimeout(resolve, 100)); }
  // From the middle outwards, the first building under the cursor.
  let picked;
  for (let r = 0; r < 300 && !picked; r += 10) {
    for (let a = 0; a < 6.2 && !picked; a += 0.5) {
      const at = new Cesium.Cartesian2(500 + r * Math.cos(a), 350 + r * Math.sin(a));
      const found = scene.pick(at);
      if (found instanceof Cesium.Cesium3DTileFeature) {
        const properties = Object.fromEntries(found.getPropertyIds().map((id) => [id, found.getProperty(id)]));
        const position = Cesium.Cartographic.fromCartesian(scene.pickPosition(at));
        picked = { properties, lon: Cesium.Math.toDegrees(position.longitude),
          lat: Cesium.Math.toDegrees(position.latitude), height: position.height };
      }
    }
  }
  viewer.render();
  await report({ nFeatures, picked, picture: scene.canvas.toDataURL("image/png") });
})();
</script>`;

const roots = { "/cesium/": join(modules, "cesium/Build/Cesium/"), "/tileset/": join(tileset, "/") };
const profile = mkdtempSync(join(tmpdir(), "sizeup-browser-"));
let browser;

function finish(code, text) {
  clearTimeout(limit);
  (code ? process.stderr : process.stdout).write(`${text}\n`);
  if (!browser) process.exit(code);
  browser.once("exit", () => { rmSync(profile, { recursive: true, force: true, maxRetries: 20 }); process.exit(code); });
  // The distribution starts the browser from a script: the whole group has to end.
  process.kill(-browser.pid, "SIGKILL");
}

const limit = setTimeout(() => finish(1, `the page did not report within ${LIMIT_MS / 1000} s`), LIMIT_MS);
const server = createServer((request, response) => {
  const path = normalize(decodeURIComponent(new URL(request.url, "http://localhost").pathname));
  if (path === "/report") {
    const parts = [];
    request.on("data", (part) => parts.push(part));
    request.on("end", () => {
      response.end();
      const { picture: url, ...rest } = JSON.parse(Buffer.concat(parts).toString());
      if (rest.error) return finish(1, rest.error);
      writeFileSync(picture, Buffer.from(url.split(",")[1], "base64"));
      return finish(0, JSON.stringify(rest, null, 1));
    });
    return;
  }
  if (path === "/") {
    response.writeHead(200, { "content-type": "text/html" }).end(page);
    return;
  }
  const root = Object.keys(roots).find((prefix) => path.startsWith(prefix));
  try {
    const bytes = readFileSync(join(roots[root], path.slice(root.length)));
    response.writeHead(200, { "content-type": TYPES[extname(path)] ?? "application/octet-stream" }).end(bytes);
  } catch {
    response.writeHead(404).end();
  }
});
server.listen(0, "127.0.0.1", () => {
  const flags = ["--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--window-size=1000,700",
    "--no-first-run", "--disable-extensions", "--disable-dev-shm-usage", `--user-data-dir=${profile}`];
  browser = spawn(chromium, [...flags, `http://127.0.0.1:${server.address().port}/`], { stdio: "ignore", detached: true });
});
