// The viewer of `sizeup view`: streams the tiles of the folder that is served.

const canvas = byId("scene");
const LAYERS = [["edges", "edges", true], ["shadows", "shadows", true], ["ground", "ground", true]];

async function start() {
  let scene;
  try {
    scene = createScene(canvas, false);
  } catch (error) {
    byId("hint").textContent = `No 3D here: ${error.message}.`;
    return;
  }
  followTheme(null, () => { scene.look = lookOf(isDark()); scene.redraw(); });
  scene.look = lookOf(isDark());
  let ways = null;
  let way = "height";
  const colour = (first, count) => {
    ways ??= colourings(tileset.features);
    scene.setColours(tileset.features.slice(first, first + count).map((f) => ways[way].colour(f)), first);
  };
  const tileset = createTileset(scene, {
    features: (first, count) => {
      colour(first, count);
      if (first === 0) drawLegend(byId("legend"), ways[way]);
    },
    failed: (error) => { byId("hint").textContent = `A tile is missing: ${error.message}`; },
  });
  const whole = await tileset.open("tiles/tileset.json");
  scene.centre = whole.centre;
  scene.radius = Math.max(whole.radius, 20);
  const home = { target: [whole.centre[0], whole.centre[1], whole.low], yaw: 0.5, pitch: 0.62, distance: 1.7 * scene.radius };
  Object.assign(scene.camera, home);
  const r = 2.5 * scene.radius;
  const corner = (x, y) => [whole.centre[0] + x * r, whole.centre[1] + y * r, whole.low];
  scene.groundReach = r;
  scene.setGround({ positions: new Float32Array([corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)].flat()), indices: new Uint32Array([0, 1, 2, 0, 2, 3]) });
  const turnCompass = createCompass(byId("compass"));
  scene.onframe = (clip) => {
    turnCompass(scene.camera.yaw);
    tileset.update(clip, scene.eye(), canvas.clientHeight);
  };
  const pick = (index) => {
    const feature = tileset.features[index];
    scene.selected = feature ? index : -1;
    document.body.classList.toggle("has-picked", feature !== undefined);
    if (feature) {
      const attributes = tileset.attributes(feature);
      const id = attributes.find(([name]) => name === "id")?.[1] ?? "";
      byId("picked").replaceChildren(el("h2", { id: "picked-id", text: id }),
        el("p", { class: "big", id: "picked-height" }, metres(feature.height), feature.sigma !== null && el("small", { text: ` ± ${number(feature.sigma, 2)} m` })),
        facts(attributes.filter(([name, value]) => name !== "id" && value !== null).map(([name, value]) => [name, String(value)])));
    }
    scene.redraw();
  };
  controlCamera(canvas, scene, {
    zoomsFreely: true,
    pick: (x, y) => pick(scene.pick(x, y)),
    hover: () => {},
    key: (event) => {
      const act = { t: () => flyTo(scene, { pitch: STRAIGHT_DOWN, yaw: 0 }), 0: () => flyTo(scene, home), Escape: () => pick(-1) }[event.key];
      if (act) { act(); event.preventDefault(); }
    },
  });
  controlBox(byId("controls"), [["height", "colour: height above ground"], ["sigma", "colour: uncertainty"], ["status", "colour: status"], ["views", "colour: photos"]], LAYERS, {
    colour: (name) => { way = name; ways = colourings(tileset.features); colour(0, tileset.features.length); drawLegend(byId("legend"), ways[way]); },
    layer: (name, isOn) => { scene.show[name] = isOn; scene.redraw(); },
    reset: () => flyTo(scene, home),
  });
  canvas.addEventListener("webglcontextlost", () => { byId("hint").textContent = "The graphics driver gave up: load the page again."; });
  new ResizeObserver(() => scene.redraw()).observe(canvas);
  canvas.focus();
  window.sizeup = { scene, tileset, framesPerSecond: (n, effort) => scene.measure(n, effort) };
  scene.redraw();
}

start().catch((error) => { byId("hint").textContent = error.message; });
