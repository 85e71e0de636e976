// The report: reads the page's data, draws everything, and keeps the pictures and the address in step.

const data = JSON.parse(byId("data").textContent);
data.textured = JSON.parse(byId("textured").textContent) ?? undefined;
data.byId = new Map(data.buildings.map((b, i) => [b.id, i]));
data.parts = partsByWhole(data.buildings);
data.buildings.forEach((b) => { for (const key of ["ground", "base", "height", "sigma"]) b[key] ??= null; });
const ways = colourings(data.buildings);
const LAYERS = [["buildings", "buildings", true], ["edges", "edges", true], ["shadows", "shadows", true], ["ground", "ground", true],
  ["cameras", "cameras", false], ["photos", "footprints of photos", false], ["sights", "sight lines", true], ["issues", "issues", false]];

const TEXTURES = "textures";

// Up to so many buildings are drawn with smooth edges.
const MOST_SMOOTH = 3000;

let scene = null;
let sights = null;
let map = null;
let home = null;
let selected = -1;
let order = [];

function start3d() {
  const canvas = byId("scene");
  try {
    scene = new Scene(canvas, data.buildings.length <= MOST_SMOOTH);
  } catch (error) {
    const picture = data.overview ? el("img", { src: data.overview, alt: "The city from the south-west" }) : null;
    canvas.replaceWith(...[picture, el("p", { class: "overlay", id: "no-3d", text: `No 3D here: ${error.message}. The map below shows the same.` })].filter(Boolean));
    return;
  }
  const [low, high] = fillScene();
  home = scene.fitted(cornersOf(low, high), OPENING);
  Object.assign(scene.camera, home);
  const turnCompass = createCompass(byId("compass"));
  scene.onframe = () => turnCompass(scene.camera.yaw);
  controlCamera(canvas, scene, {
    pick: (x, y) => pick(scene.pick(x, y)),
    hover,
    key: (event) => {
      const act = { n: () => next(1), p: () => next(-1), t: () => flyTo(scene, { pitch: STRAIGHT_DOWN, yaw: 0 }), 0: () => flyTo(scene, home), Escape: () => pick(-1) }[event.key];
      if (act) { act(); event.preventDefault(); }
    },
  });
  canvas.addEventListener("webglcontextlost", () => { byId("hint").textContent = "The graphics driver gave up: load the page again."; });
  new ResizeObserver(() => scene.redraw()).observe(canvas);
}

// Puts everything into the scene; the box around the buildings.
function fillScene() {
  // Buildings that are seen with textures have blocks of their own, which are not drawn then.
  const textured = new Set(data.textured?.shown);
  const blocks = [false, true].flatMap((isTextured) => blocksOf(data.buildings, (i) => textured.has(i) === isTextured));
  const meshes = blocks.map((block) => buildingMesh(data.buildings, block, data.origin));
  const boxes = meshes.map((mesh) => boundsOf(mesh.positions));
  const low = boxes.length > 0 ? [0, 1, 2].map((i) => Math.min(...boxes.map((box) => box[0][i]))) : [-50, -50, 0];
  const high = boxes.length > 0 ? [0, 1, 2].map((i) => Math.max(...boxes.map((box) => box[1][i]))) : [50, 50, 10];
  scene.centre = low.map((v, i) => (v + high[i]) / 2);
  scene.radius = Math.max(vec.length(vec.sub(high, low)) / 2, 20);
  meshes.forEach((mesh, i) => { scene.addChunk(mesh).isReplaced = textured.has(blocks[i][0]); });
  addTextures();
  if (data.ground) {
    const ground = groundMesh(data.ground, data.origin);
    const far = boundsOf(ground.positions);
    scene.groundReach = Math.min(...[0, 1].flatMap((i) => [-far[0][i], far[1][i]]));
    scene.setGround(ground, true);
  }
  addViewLayers(scene, data);
  addIssueLayer(scene, data);
  return [low, high];
}

// The city and its ground with the colours of photos.
function addTextures() {
  const inMap = { point: (p) => p, direction: (p) => p };
  if (!data.textured) return;
  for (const text of [data.textured.buildings, ...data.textured.grounds]) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    scene.addPhotoChunk(meshOfGlb(readGlb(bytes.buffer), inMap));
  }
}

let hoverTimer = 0;
function hover(x, y) {
  clearTimeout(hoverTimer);
  hoverTimer = setTimeout(() => {
    const found = x < 0 ? -1 : scene.pick(x, y);
    if (found === scene.hovered) return;
    scene.hovered = found;
    const b = data.buildings[found];
    byId("hint").textContent = b ? `${b.id}: ${metres(b.height)}` : "";
    // Where a picture takes long, the words are enough.
    if (!scene.pace.isSlow) scene.redraw();
  }, 60);
}

// Picks a building, -1 for none; the address follows, so that it can be shared.
function pick(index, { fly = false, setHash = true } = {}) {
  selected = data.buildings[index] ? index : -1;
  const b = data.buildings[selected];
  if (scene) { scene.selected = selected; showSights(scene, data, selected); }
  if (map) { map.selected = selected; map.redraw(); }
  const box = byId("picked");
  if (b) {
    drawBuilding(box, data, selected);
    if (b.rings.length > 0 && fly) goTo(b);
  } else {
    box.classList.remove("has-building");
    box.replaceChildren(el("p", { text: "Pick a building: in the picture, on the map, or from a list below." }),
      el("p", { class: "quiet", text: "Drag to turn, with the right button or two fingers to move; the wheel zooms once the picture is clicked. Keys: arrows turn, with Shift they move, + and − zoom, N and P go from one doubtful building to the next, T looks straight down, 0 shows all." }));
  }
  if (setHash) history.replaceState(null, "", b ? `#building=${encodeURIComponent(b.id)}` : location.pathname + location.search);
}

function goTo(b) {
  const [low, high] = boxOf(b);
  const middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
  const top = (b.ground ?? data.origin[2]) - data.origin[2] + (b.height ?? 0);
  const size = Math.hypot(high[0] - low[0], high[1] - low[1], b.height ?? 0);
  if (scene) {
    sights ??= new Sights(data);
    const view = { target: [...middle, top / 2], distance: Math.max(3.2 * size, 60), pitch: clamp(scene.camera.pitch, 0.45, 1.0), yaw: scene.camera.yaw };
    flyTo(scene, sights.clearView(scene, b, data.buildings.indexOf(b), view));
  }
  map?.goTo(...middle);
}

// The next building by doubt: doubtful ones first.
function next(step) {
  const at = order.indexOf(selected);
  pick(order[(Math.max(at, step > 0 ? -1 : 0) + step + order.length) % order.length], { fly: true });
}

function colourBy(name) {
  const isPhotos = name === TEXTURES;
  if (scene) scene.hasPhotos = isPhotos;
  // Photos need no legend, and the map has heights meanwhile.
  byId("legend").hidden = isPhotos;
  const way = ways[isPhotos ? "height" : name];
  const colours = data.buildings.map((b) => way.colour(b));
  scene?.setColours(colours);
  if (map) { map.colours = colours; map.redraw(); }
  drawLegend(byId("legend"), way);
}

function showLayer(name, isOn) {
  if (scene) {
    if (name in scene.show) scene.show[name] = isOn;
    else scene.showLines(name, isOn);
    scene.redraw();
  }
  if (map && name in map.show) { map.show[name] = isOn; map.redraw(); }
}

function followAddress() {
  const wanted = /^#building=(.*)$/.exec(location.hash);
  if (!wanted) return;
  let id = null;
  try { id = decodeURIComponent(wanted[1]); } catch { return; }
  // The first part of a building that was split.
  const index = data.byId.get(id) ?? partsOf(data, id)[0];
  if (index === undefined) return;
  pick(index, { fly: true, setHash: false });
  byId("city").scrollIntoView();
}

// The switch of the photos under the map.
function drawBackdropSwitch() {
  if (!data.backdrop) return;
  const check = el("input", { type: "checkbox", id: "show-backdrop", onchange: () => showLayer("backdrop", check.checked) });
  check.checked = true;
  const { photos } = data.backdrop;
  const named = photos.length > 4 ? `${photos.length} photos` : photos.join(", ");
  byId("backdrop").replaceChildren(el("label", {}, check, el("span", { text: " photos under the map" })),
    el("span", { class: "quiet", text: ` ${named}, laid on the ground: what stands on it leans away from the camera` }));
  byId("backdrop").hidden = false;
}

// Draws both pictures at once in a theme.
function drawIn(theme) {
  document.documentElement.dataset.theme = theme;
  if (scene) { scene.look = lookOf(isDark()); scene.draw(); }
  map.draw();
}

function start() {
  followTheme(byId("theme"), () => {
    if (scene) { scene.look = lookOf(isDark()); scene.redraw(); }
    map?.redraw();
  });
  start3d();
  if (scene) scene.look = lookOf(isDark());
  map = createMap(byId("plan"), data, { pick: (b) => pick(b) });
  map.fit();
  new ResizeObserver(() => map.redraw()).observe(byId("plan"));
  order = data.buildings.map((_, i) => i).sort((a, b) => byDoubt(data.buildings[a], data.buildings[b]));
  const named = Object.entries(ways).map(([name, way]) => [name, `colour: ${way.title.toLowerCase()}`]);
  const isTextured = scene !== null && data.textured !== undefined;
  controlBox(byId("controls"), isTextured ? [[TEXTURES, "textures from photos"], ...named] : named, LAYERS,
    { colour: colourBy, layer: showLayer, reset: () => { if (scene) flyTo(scene, home); map.fit(); } });
  colourBy(isTextured ? TEXTURES : "height");
  drawBackdropSwitch();
  drawImplausible(data);
  drawSummary(data);
  drawBuildings(data);
  drawIssues(data);
  drawSurvey(data);
  drawViews(data);
  drawPasses(data);
  drawLineage(data);
  pick(-1, { setHash: false });
  window.addEventListener("hashchange", followAddress);
  // A link to the building that is picked already changes no address.
  document.addEventListener("click", (event) => {
    const link = event.target.closest("a");
    if (link && link.hash === location.hash) followAddress();
  });
  // Paper is light, and shows every row.
  let theme = null;
  window.addEventListener("beforeprint", () => {
    theme = document.documentElement.dataset.theme;
    drawIn("light");
    showAllRows();
  });
  window.addEventListener("afterprint", () => drawIn(theme));
  followAddress();
}

start();
// For tests and for the curious.
window.sizeup = {
  data,
  placeOf: (id) => {
    const b = data.buildings[data.byId.get(id)];
    const [low, high] = boxOf(b);
    const roof = (b.ground ?? 0) - data.origin[2] + (b.height ?? 0);
    const [x, y] = mat.project(scene.clipFromLocal(), [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, roof]);
    return [((x + 1) / 2) * byId("scene").clientWidth, ((1 - y) / 2) * byId("scene").clientHeight];
  },
  // The share of a building's roof that is in the picture and not hidden.
  shows: (id) => {
    const index = data.byId.get(id);
    sights ??= new Sights(data);
    const points = sights.samples(data.buildings[index], index);
    const isSeen = (point) => {
      const [x, y, , isAhead] = mat.project(scene.clipFromLocal(), point);
      if (!isAhead || Math.max(Math.abs(x), Math.abs(y)) > 1) return false;
      return scene.pick(((x + 1) / 2) * byId("scene").clientWidth, ((1 - y) / 2) * byId("scene").clientHeight) === index;
    };
    return points.filter(isSeen).length / Math.max(points.length, 1);
  },
  isFlying: () => scene.flight !== null,
  hasBackdrop: () => map.hasBackdrop(),
  showsPhotos: () => scene.hasPhotos && scene.photoChunks.size > 0 && scene.nPending === 0,
  placeOnMap: (id) => map.placeOf(data.byId.get(id)),
  framesPerSecond: (n, effort) => scene.measure(n, effort),
  turn: (seconds) => scene.turn(seconds),
};
