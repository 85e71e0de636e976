// Blocks from footprints, and solids with roofs: roof and walls as triangles with flat normals, and the edges between them.

// A plate this thick stands for a building whose height is not known, metres.
const PLATE_M = 0.3;
// Walls go this far below the lowest ground, so that no gap shows where the drawn ground is coarser, metres.
const SKIRT_M = 1.0;

// Buildings of a block of the mesh: blocks out of sight are not drawn.
const BLOCK_BUILDINGS = 250;

// `rings` hold centimetres from the origin, x and y in turn; exterior counter-clockwise, holes clockwise. `chosen` are
// positions in `buildings`.
//
// Faces are flat: a triangle has the normal of its last corner. So a wall's normal stands at its upper first corner, which
// both its triangles end with, and walls share corners; roofs have corners of their own.
function buildingMesh(buildings, chosen, origin) {
  let nCorners = 0;
  let nOfFaces = 0;
  let nRoof = 0;
  for (const i of chosen) {
    if (buildings[i].faces) {
      for (const face of buildings[i].faces) {
        nOfFaces += face.corners.length / 3;
        nRoof += face.triangles.length;
      }
      continue;
    }
    nCorners += buildings[i].rings.reduce((n, ring) => n + ring.length / 2, 0);
    nRoof += buildings[i].triangles.length;
  }
  const nVertices = 3 * nCorners + nOfFaces;
  const mesh = {
    positions: new Float32Array(3 * nVertices),
    normals: new Int8Array(4 * nVertices),
    features: new Float32Array(nVertices),
    indices: new Uint32Array(6 * nCorners + nRoof),
    edges: new Uint32Array(4 * nCorners + 2 * nOfFaces),
  };
  let vertex = 0;
  let index = 0;
  let edge = 0;
  for (const feature of chosen) {
    const b = buildings[feature];
    const ground = (b.ground ?? b.base ?? origin[2]) - origin[2];
    const base = (b.base ?? b.ground ?? origin[2]) - origin[2] - SKIRT_M;
    const roof = b.height === null ? ground + PLATE_M : ground + b.height;
    const put = (x, y, z, nx, ny, nz) => {
      mesh.positions.set([x, y, z], 3 * vertex);
      mesh.normals.set([nx, ny, nz], 4 * vertex);
      mesh.features[vertex] = feature;
      vertex += 1;
    };
    if (b.faces) {
      for (const face of b.faces) {
        const [first, up] = [vertex, normalOf(face)];
        for (let i = 0; i < face.corners.length; i += 3) {
          const [x, y, z] = [0, 1, 2].map((axis) => face.corners[i + axis] / 100);
          put(x, y, z === 0 ? base : z + base + SKIRT_M, ...up);
        }
        for (const corner of face.triangles) { mesh.indices[index] = first + corner; index += 1; }
        let start = first;
        for (const n of face.rings) {
          for (let i = 0; i < n; i += 1) { mesh.edges.set([start + i, start + ((i + 1) % n)], edge); edge += 2; }
          start += n;
        }
      }
      continue;
    }
    const first = vertex;
    for (const ring of b.rings) for (let i = 0; i < ring.length; i += 2) put(ring[i] / 100, ring[i + 1] / 100, roof, 0, 0, 127);
    for (const corner of b.triangles) { mesh.indices[index] = first + corner; index += 1; }
    for (const ring of b.rings) {
      const start = vertex;
      for (let i = 0; i < ring.length; i += 2) {
        const next = (i + 2) % ring.length;
        const [x, y] = [ring[i] / 100, ring[i + 1] / 100];
        const [dx, dy] = [ring[next] - ring[i], ring[next + 1] - ring[i + 1]];
        const scale = 127 / (Math.hypot(dx, dy) || 1);
        const v = vertex;
        const w = start + next;
        put(x, y, base, 0, 0, 0);
        put(x, y, roof, Math.round(dy * scale), Math.round(-dx * scale), 0);
        mesh.indices.set([v, w, v + 1, w, w + 1, v + 1], index);
        index += 6;
        mesh.edges.set([v + 1, w + 1, v, v + 1], edge);
        edge += 4;
      }
    }
  }
  return mesh;
}

// Where a face of a solid with a roof looks, in bytes.
function normalOf({ corners, rings }) {
  const at = (i) => [0, 1, 2].map((axis) => corners[3 * i + axis] - corners[axis]);
  const sum = [0, 0, 0];
  for (let i = 1; i + 1 < rings[0]; i += 1) {
    const [a, b] = [at(i), at(i + 1)];
    for (let axis = 0; axis < 3; axis += 1) {
      const [j, k] = [(axis + 1) % 3, (axis + 2) % 3];
      sum[axis] += a[j] * b[k] - a[k] * b[j];
    }
  }
  const scale = 127 / (Math.hypot(...sum) || 1);
  return sum.map((v) => Math.round(v * scale));
}

// Buildings that stand together, at most so many in a block.
function blocksOf(buildings, isWanted) {
  const shown = buildings.map((_, i) => i).filter((i) => buildings[i].rings.length > 0 && isWanted(i));
  const split = (chosen) => {
    if (chosen.length <= BLOCK_BUILDINGS) return [chosen];
    const spread = [0, 1].map((axis) => {
      const values = chosen.map((i) => buildings[i].rings[0][axis]);
      return Math.max(...values) - Math.min(...values);
    });
    const axis = spread[0] > spread[1] ? 0 : 1;
    const sorted = [...chosen].sort((a, b) => buildings[a].rings[0][axis] - buildings[b].rings[0][axis]);
    const half = sorted.length >> 1;
    return [...split(sorted.slice(0, half)), ...split(sorted.slice(half))];
  };
  return shown.length > 0 ? split(shown) : [];
}

// The ground as a grid of triangles; cells with an unknown corner are left out.
function groundMesh(grid, origin) {
  const positions = new Float32Array(3 * grid.z.length);
  grid.z.forEach((z, i) => {
    const x = grid.west + grid.step * (i % grid.columns) - origin[0];
    const y = grid.south + grid.step * Math.floor(i / grid.columns) - origin[1];
    positions.set([x, y, (z ?? origin[2]) - origin[2]], 3 * i);
  });
  const indices = [];
  for (let row = 0; row + 1 < grid.z.length / grid.columns; row += 1) {
    for (let column = 0; column + 1 < grid.columns; column += 1) {
      const a = row * grid.columns + column;
      const quad = [a, a + 1, a + grid.columns + 1, a + grid.columns];
      if (quad.every((i) => grid.z[i] !== null)) indices.push(quad[0], quad[1], quad[2], quad[0], quad[2], quad[3]);
    }
  }
  return { positions, indices: new Uint32Array(indices) };
}

// The box around positions.
function boundsOf(positions) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i += 1) {
    low[i % 3] = Math.min(low[i % 3], positions[i]);
    high[i % 3] = Math.max(high[i % 3], positions[i]);
  }
  return [low, high];
}

// Every building of a mesh as an upright box of the same area: along the wall whose rectangle is smallest. `places` hold
// x, y, lowest and highest level; `reaches` a unit vector along the box and half its sides along and across.
function boxesOfMesh(mesh) {
  const boxes = footprintsOfMesh(mesh).map(([feature, footprint]) => ({ feature, ...boxAround(footprint) }));
  const diagonals = boxes.map((box) => 2 * Math.hypot(box.reach[2], box.reach[3], (box.place[3] - box.place[2]) / 2));
  return {
    places: new Float32Array(boxes.flatMap((box) => box.place)),
    reaches: new Float32Array(boxes.flatMap((box) => box.reach)),
    features: new Float32Array(boxes.map((box) => box.feature)),
    sizeM: quantile(diagonals, 0.5) ?? 0,
  };
}

// By feature: positions, directions of walls, and the area of the roof.
function footprintsOfMesh({ positions, normals, features, indices }) {
  const found = new Map();
  const stride = (normals.length / positions.length) * 3;
  const scale = normals instanceof Int8Array ? 127 : 1;
  const at = (vertex) => [positions[3 * vertex], positions[3 * vertex + 1], positions[3 * vertex + 2]];
  for (let v = 0; v < features.length; v += 1) {
    const one = found.get(features[v]) ?? { points: [], ways: [], area: 0 };
    found.set(features[v], one);
    one.points.push(at(v));
    const [nx, ny, nz] = [0, 1, 2].map((c) => normals[stride * v + c] / scale);
    if (Math.abs(nz) < 0.1 && Math.hypot(nx, ny) > 0.5) one.ways.push([nx / Math.hypot(nx, ny), ny / Math.hypot(nx, ny)]);
  }
  for (let t = 0; t < indices.length; t += 3) {
    const last = indices[t + 2];
    if (normals[stride * last + 2] / scale < 0.5) continue;
    const [a, b, c] = [indices[t], indices[t + 1], last].map(at);
    found.get(features[last]).area += Math.abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2;
  }
  return [...found];
}

function boxAround({ points, ways, area }) {
  const range = (of) => points.reduce(([low, high], p) => [Math.min(low, of(p)), Math.max(high, of(p))], [Infinity, -Infinity]);
  const along = (ux, uy) => {
    const [u, v] = [range((p) => ux * p[0] + uy * p[1]), range((p) => ux * p[1] - uy * p[0])];
    return { ux, uy, u, v, area: (u[1] - u[0]) * (v[1] - v[0]) };
  };
  const tried = (ways.length > 0 ? ways : [[1, 0]]).map(([ux, uy]) => along(ux, uy));
  const { ux, uy, u, v, area: whole } = tried.reduce((best, one) => (one.area < best.area ? one : best));
  const share = whole > 0 && area > 0 ? Math.min(Math.sqrt(area / whole), 1) : 1;
  const [middleU, middleV] = [(u[0] + u[1]) / 2, (v[0] + v[1]) / 2];
  return {
    place: [ux * middleU - uy * middleV, uy * middleU + ux * middleV, ...range((p) => p[2])],
    reach: [ux, uy, (share * (u[1] - u[0])) / 2, (share * (v[1] - v[0])) / 2],
  };
}
