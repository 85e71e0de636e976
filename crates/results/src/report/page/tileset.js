// Streams a 3D Tiles tileset: tiles whose children would show more than some pixels are refined, those out of sight are not asked for, and the
// ones longest out of use go when there are too many. Buildings are added to those of coarser tiles; finer ground replaces coarser, and buildings
// with finer pictures the same with coarser ones.

// Children are loaded where what they add is larger than this, pixels.
const MOST_ERROR_PX = 12;
const MOST_VERTICES = 8e6;
const MOST_REQUESTS = 4;
// A byte of a picture takes so much of the graphics card's memory as vertices of 36 bytes: a JPEG of photos has some 2 bits a texel, and a
// texel is 5.3 bytes with its smaller copies.
const VERTICES_A_BYTE = 0.6;

// 4 × 4 matrices of doubles, column by column: positions on the earth need them.
const wide = {
  identity: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
  multiply(a, b) {
    return Array.from({ length: 16 }, (_, i) => [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + (i % 4)] * b[4 * Math.floor(i / 4) + k], 0));
  },
  // Of a rotation with a translation.
  inverse(m) {
    const t = [m[12], m[13], m[14]];
    const row = (i) => [m[4 * i], m[4 * i + 1], m[4 * i + 2]];
    const moved = [0, 1, 2].map((i) => -vec.dot(row(i), t));
    return [m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0, ...moved, 1];
  },
  direction: (m, p) => [0, 1, 2].map((i) => m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2]),
  point: (m, p) => vec.add(wide.direction(m, p), [m[12], m[13], m[14]]),
};

function createTileset(scene, on) {
  const tileset = { tiles: [], features: [], nLoaded: 0, frame: null };
  let nVertices = 0;
  let nRequests = 0;
  let clock = 0;

  function tileOf(json, parentTransform, base) {
    const transform = json.transform ? wide.multiply(parentTransform, json.transform) : parentTransform;
    const tile = { json, transform, base, state: "new", children: [], used: 0, error: json.geometricError };
    tile.content = json.content ?? null;
    tile.isReplaced = json.refine === "REPLACE";
    tile.children = (json.children ?? []).map((child) => tileOf(child, transform, base));
    // What replaces a tile has its buildings.
    if (tile.isReplaced) tile.children.forEach((child) => { child.coarse = tile; });
    return tile;
  }

  const localFrom = (tile) => wide.multiply(wide.inverse(tileset.frame), tile.transform);
  function sphereOf(tile) {
    if (!tile.sphere) {
      const box = tile.json.boundingVolume.box;
      const m = localFrom(tile);
      const half = [3, 6, 9].map((i) => vec.length(box.slice(i, i + 3)));
      tile.sphere = { centre: wide.point(m, box.slice(0, 3)), radius: Math.hypot(...half), low: box[2] - half[2] };
    }
    return tile.sphere;
  }

  tileset.open = async (address) => {
    const response = await fetch(address);
    if (!response.ok) throw new Error(`${address}: ${response.status}`);
    const json = await response.json();
    tileset.json = json;
    tileset.root = tileOf(json.root, wide.identity, new URL(".", new URL(address, location.href)).href);
    tileset.frame = firstFrame(tileset.root);
    // The middle of its box, and half axes of it.
    const { box } = tileset.root.json.boundingVolume;
    const corners = cornersOf([-1, -1, -1], [1, 1, 1]).map((signs) => [0, 1, 2].map((i) => box[i] + vec.dot(signs, [box[3 + i], box[6 + i], box[9 + i]])));
    return { ...sphereOf(tileset.root), corners: corners.map((p) => wide.point(localFrom(tileset.root), p)) };
  };

  // The first transform on the way down is the frame of the picture.
  function firstFrame(tile) {
    let at = tile;
    while (at.transform === wide.identity && at.children.length > 0) [at] = at.children;
    return at.transform;
  }

  // Asks for what the camera needs; called for every frame.
  tileset.update = (clip, eye, heightPx) => {
    if (!tileset.root) return;
    clock += 1;
    const wanted = [];
    const visit = (tile, isNeeded) => {
      const { centre, radius } = sphereOf(tile);
      const distance = Math.max(vec.length(vec.sub(centre, eye)) - radius, 1);
      const isSeen = inSight(clip, centre, radius);
      if (isNeeded && isSeen && tile.content) {
        tile.used = clock;
        if (tile.state === "new") wanted.push([distance, tile]);
      }
      const errorPx = (tile.error * heightPx) / (2 * distance * Math.tan(FIELD_OF_VIEW / 2));
      const isRefined = isSeen && errorPx > MOST_ERROR_PX && (!tile.isReplaced || tile.state === "shown");
      tile.children.forEach((child) => visit(child, isRefined));
      const isUsed = (of) => of.state === "shown" && of.used === clock;
      if (tile.state === "shown" && (tile.isReplaced || tile.coarse)) hide(chunkOf(tile), !isUsed(tile) || tile.children.some((child) => child.coarse && isUsed(child)));
    };
    visit(tileset.root, true);
    wanted.sort((a, b) => a[0] - b[0]);
    for (const [, tile] of wanted) {
      if (nRequests >= MOST_REQUESTS) break;
      load(tile);
    }
    makeRoom();
  };

  const chunkOf = ({ ground, chunk }) => ground ?? chunk;

  function hide(chunk, isHidden) {
    if (Boolean(chunk.isHidden) === isHidden) return;
    Object.assign(chunk, { isHidden });
    scene.redraw();
  }

  async function load(tile) {
    tile.state = "loading";
    nRequests += 1;
    try {
      const address = new URL(tile.content.uri, tile.base).href;
      const response = await fetch(address);
      if (!response.ok) throw new Error(`${tile.content.uri}: ${response.status}`);
      if (tile.content.uri.endsWith(".json")) {
        const json = await response.json();
        tile.children.push(tileOf(json.root, tile.transform, new URL(".", address).href));
        tile.state = "done";
      } else show(tile, readGlb(await response.arrayBuffer()));
    } catch (error) {
      tile.state = "failed";
      on.failed(error);
    }
    nRequests -= 1;
    scene.redraw();
  }

  function show(tile, glb) {
    const m = localFrom(tile);
    const mesh = meshOfGlb(glb, { point: (p) => wide.point(m, p), direction: (p) => wide.direction(m, p) });
    tileset.nLoaded += 1;
    tile.state = "shown";
    const nBytes = mesh.ranges.reduce((n, { picture }) => n + picture.blob.size, 0);
    tile.nVertices = mesh.positions.length / 3 + VERTICES_A_BYTE * nBytes;
    nVertices += tile.nVertices;
    tileset.tiles.push(tile);
    // The ground of a textured city.
    if (!mesh.features) {
      tile.ground = scene.addPhotoChunk(mesh);
      return;
    }
    const properties = propertiesOf(glb);
    tile.first ??= tile.coarse?.first;
    if (tile.first === undefined) {
      tile.first = tileset.features.length;
      const columns = Object.fromEntries(["height_m", "height_sigma_m", "status", "n_views"].map((name) => [name, properties.column(name)]));
      for (let i = 0; i < properties.count; i += 1) {
        tileset.features.push({ tile, row: i, height: columns.height_m[i], sigma: columns.height_sigma_m[i],
          status: columns.status[i] ?? "unknown", views: { length: columns.n_views[i] ?? 0 } });
      }
      on.features(tile.first, properties.count);
    }
    tile.properties = properties;
    tile.chunk = scene.addChunk(mesh, tile.first);
  }

  function makeRoom() {
    if (nVertices <= MOST_VERTICES) return;
    tileset.tiles.sort((a, b) => b.used - a.used);
    while (nVertices > MOST_VERTICES && tileset.tiles.length > 0 && tileset.tiles.at(-1).used < clock) {
      const tile = tileset.tiles.pop();
      if (tile.ground) scene.removePhotoChunk(tile.ground);
      else scene.removeChunk(tile.chunk);
      nVertices -= tile.nVertices;
      Object.assign(tile, { chunk: null, ground: null, properties: null, state: "new" });
    }
  }

  // All attributes of a building that is shown.
  tileset.attributes = (feature) => {
    const { properties } = feature.tile;
    return properties ? properties.names.map(([id, name]) => [name, properties.column(id)[feature.row]]) : [];
  };
  tileset.isIdle = () => nRequests === 0;
  return tileset;
}
