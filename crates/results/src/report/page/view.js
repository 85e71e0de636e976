// The viewer of `sizeup view`: streams the tiles of the folder that is served.

const canvas = byId("scene");
const LAYERS = [["edges", "edges", true], ["shadows", "shadows", true], ["ground", "ground", true]];
const TEXTURES = ["textures", "textures from photos"];
const WAYS = [["height", "colour: height above ground"], ["sigma", "colour: uncertainty"], ["status", "colour: status"], ["views", "colour: photos"]];

let tileset = null;
let ways = null;
let way = "height";

function colour(scene, first, count) {
  ways ??= colourings(tileset.features);
  scene.setColours(tileset.features.slice(first, first + count).map((f) => ways[way].colour(f)), first);
}

function colourBy(scene, name) {
  scene.hasPhotos = name === TEXTURES[0];
  if (!scene.hasPhotos) way = name;
  ways = colourings(tileset.features);
  colour(scene, 0, tileset.features.length);
  showLegend(scene);
}

// Photos need no legend.
function showLegend(scene) {
  byId("legend").hidden = scene.hasPhotos;
  drawLegend(byId("legend"), ways[way]);
}

// A level plate under the city; below ground with photos by more than depths are rounded by.
function layGround(scene, { centre, low }) {
  const r = 2.5 * scene.radius;
  const level = low - (isOfPhotos() ? Math.min(scene.radius / 2000, 0.5) : 0);
  const corner = (x, y) => [centre[0] + x * r, centre[1] + y * r, level];
  const positions = new Float32Array([corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)].flat());
  scene.groundReach = r;
  scene.setGround({ positions, indices: new Uint32Array([0, 1, 2, 0, 2, 3]) });
}

function pick(scene, index) {
  const feature = tileset.features[index];
  scene.selected = feature ? index : -1;
  document.body.classList.toggle("has-picked", feature !== undefined);
  if (feature) describe(feature);
  scene.redraw();
}

function describe(feature) {
  const attributes = tileset.attributes(feature);
  const id = attributes.find(([name]) => name === "id")?.[1] ?? "";
  const known = attributes.filter(([name, value]) => name !== "id" && value !== null);
  byId("picked").replaceChildren(el("h2", { id: "picked-id", text: id }),
    el("p", { class: "big", id: "picked-height" }, metres(feature.height), feature.sigma !== null && el("small", { text: ` ± ${number(feature.sigma, 2)} m` })),
    facts(known.map(([name, value]) => [name, String(value)])));
}

// Opens the tileset and stands where all of it is seen.
async function openTiles(scene) {
  tileset = createTileset(scene, {
    features: (first, count) => {
      colour(scene, first, count);
      if (first === 0) showLegend(scene);
    },
    failed: (error) => { byId("hint").textContent = `A tile is missing: ${error.message}`; },
  });
  const whole = await tileset.open("tiles/tileset.json");
  scene.hasPhotos = isOfPhotos();
  scene.centre = whole.centre;
  scene.radius = Math.max(whole.radius, 20);
  layGround(scene, whole);
  return scene.fitted(whole.corners, OPENING);
}

const isOfPhotos = () => tileset.json.asset.extras?.sizeup?.textures === true;

function listen(scene, home) {
  controlCamera(canvas, scene, {
    zoomsFreely: true,
    pick: (x, y) => pick(scene, scene.pick(x, y)),
    hover: () => {},
    key: (event) => {
      const act = { t: () => flyTo(scene, { pitch: STRAIGHT_DOWN, yaw: 0 }), 0: () => flyTo(scene, home), Escape: () => pick(scene, -1) }[event.key];
      if (act) { act(); event.preventDefault(); }
    },
  });
  controlBox(byId("controls"), isOfPhotos() ? [TEXTURES, ...WAYS] : WAYS, LAYERS, {
    colour: (name) => colourBy(scene, name),
    layer: (name, isOn) => { scene.show[name] = isOn; scene.redraw(); },
    reset: () => flyTo(scene, home),
  });
  canvas.addEventListener("webglcontextlost", () => { byId("hint").textContent = "The graphics driver gave up: load the page again."; });
  new ResizeObserver(() => scene.redraw()).observe(canvas);
}

async function start() {
  let scene;
  try {
    scene = new Scene(canvas, false);
  } catch (error) {
    byId("hint").textContent = `No 3D here: ${error.message}.`;
    return;
  }
  followTheme(null, () => { scene.look = lookOf(isDark()); scene.redraw(); });
  scene.look = lookOf(isDark());
  const home = await openTiles(scene);
  Object.assign(scene.camera, home);
  const turnCompass = createCompass(byId("compass"));
  scene.onframe = (clip) => {
    turnCompass(scene.camera.yaw);
    tileset.update(clip, scene.eye(), canvas.clientHeight);
  };
  listen(scene, home);
  canvas.focus();
  window.sizeup = { scene, tileset, showsPhotos: () => scene.hasPhotos && tileset.nLoaded > 0 && tileset.isIdle() && scene.nPending === 0,
    framesPerSecond: (n, effort) => scene.measure(n, effort), turn: (seconds) => scene.turn(seconds) };
  scene.redraw();
}

start().catch((error) => { byId("hint").textContent = error.message; });
