// Lines in the scene: cameras, what their photos show, issues, and the sight lines of the picked building.

// Length of a drawn camera, in the radius of the city, and at most, metres.
const CAMERA_SHARE = 0.035;
const CAMERA_M = 25;

function addViewLayers(scene, data) {
  const [ox, oy, oz] = data.origin;
  const size = Math.min(CAMERA_SHARE * scene.radius, CAMERA_M);
  const cameras = { positions: [], tints: [] };
  const photos = { positions: [], tints: [] };
  const put = (set, a, b, tint) => { set.positions.push(...a, ...b); set.tints.push(...tint, ...tint); };
  const ground = quantile(data.buildings.map((b) => b.ground).filter((z) => z !== null), 0.5) ?? oz;
  for (const v of data.views) {
    const eye = [v.centre[0] - ox, v.centre[1] - oy, v.centre[2] - oz];
    const corners = [];
    for (let i = 0; i < v.footprint.length; i += 2) corners.push([v.footprint[i] - ox, v.footprint[i + 1] - oy, ground - oz + 0.5]);
    const tint = [...(v.use === "measured" ? STATUS_COLOURS.measured : [120, 120, 128]), 255];
    corners.forEach((corner, i) => {
      put(photos, corner, corners[(i + 1) % corners.length], [...tint.slice(0, 3), 120]);
    });
    // Every fourth point of the footprint is a corner of the photo.
    const rim = corners.filter((_, i) => i % 4 === 0).map((c) => vec.add(eye, vec.scale(vec.unit(vec.sub(c, eye)), size)));
    rim.forEach((corner, i) => {
      put(cameras, eye, corner, tint);
      put(cameras, corner, rim[(i + 1) % rim.length], tint);
    });
  }
  scene.setLines("photos", photos.positions, photos.tints, false);
  scene.setLines("cameras", cameras.positions, cameras.tints, false);
}

function addIssueLayer(scene, data) {
  const positions = [];
  const tints = [];
  const height = Math.min(0.08 * scene.radius, 40);
  for (const issue of data.issues) {
    if (!issue.place) continue;
    const { kind, id } = issue.subject;
    const b = kind === "building" ? data.buildings[data.byId.get(id) ?? partsOf(data, id)[0]] : null;
    const z = (b?.ground ?? data.origin[2]) - data.origin[2];
    const [x, y] = [issue.place[0] - data.origin[0], issue.place[1] - data.origin[1]];
    const top = z + (b?.height ?? 0) + height;
    const w = 0.12 * height;
    for (const [dx, dy] of [[0, 0], [w, 0], [-w, 0], [0, w], [0, -w]]) {
      positions.push(x, y, z + (b?.height ?? 0), x + dx, y + dy, top);
      tints.push(...ALERT, 255, ...ALERT, 255);
    }
  }
  scene.setLines("issues", positions, tints, false);
}

// Lines from a building to the cameras that it was measured with.
function showSights(scene, data, index) {
  const positions = [];
  const tints = [];
  const b = data.buildings[index];
  if (b) {
    const [low, high] = boxOf(b);
    const top = (b.ground ?? data.origin[2]) + (b.height ?? 0) - data.origin[2];
    for (const v of b.views) {
      const { centre } = data.views[v];
      positions.push((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, top, ...vec.sub(centre, data.origin));
      tints.push(255, 90, 16, 255, 255, 90, 16, 70);
    }
  }
  scene.setLines("sights", positions, tints);
}

// The box of a footprint, metres from the origin.
function boxOf(building) {
  const low = [Infinity, Infinity];
  const high = [-Infinity, -Infinity];
  for (const ring of building.rings) {
    ring.forEach((v, i) => {
      low[i % 2] = Math.min(low[i % 2], v / 100);
      high[i % 2] = Math.max(high[i % 2], v / 100);
    });
  }
  return [low, high];
}
