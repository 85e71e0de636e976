// Blocks from outlines: roof and walls as triangles with flat normals, and the edges between them.

// A plate this thick stands for a building whose height is not known, metres.
const PLATE_M = 0.3;

// `rings` hold centimetres from the origin, x and y in turn; exterior counter-clockwise, holes clockwise.
function buildingMesh(buildings, origin) {
  const corners = buildings.map((b) => b.rings.reduce((n, ring) => n + ring.length / 2, 0));
  const nCorners = corners.reduce((a, b) => a + b, 0);
  const nRoof = buildings.reduce((n, b) => n + b.triangles.length, 0);
  const mesh = {
    positions: new Float32Array(15 * nCorners),
    normals: new Int8Array(20 * nCorners),
    features: new Float32Array(5 * nCorners),
    indices: new Uint32Array(6 * nCorners + nRoof),
    edges: new Uint32Array(6 * nCorners),
  };
  let vertex = 0;
  let index = 0;
  let edge = 0;
  const put = (x, y, z, normal, feature) => {
    mesh.positions.set([x, y, z], 3 * vertex);
    mesh.normals.set(normal, 4 * vertex);
    mesh.features[vertex] = feature;
    vertex += 1;
  };
  buildings.forEach((b, feature) => {
    const ground = (b.ground ?? b.base ?? origin[2]) - origin[2];
    const base = (b.base ?? b.ground ?? origin[2]) - origin[2];
    const roof = b.height === null ? ground + PLATE_M : ground + b.height;
    const first = vertex;
    for (const ring of b.rings) for (let i = 0; i < ring.length; i += 2) put(ring[i] / 100, ring[i + 1] / 100, roof, [0, 0, 127], feature);
    for (const corner of b.triangles) { mesh.indices[index] = first + corner; index += 1; }
    for (const ring of b.rings) {
      for (let i = 0; i < ring.length; i += 2) {
        const next = (i + 2) % ring.length;
        const [x0, y0, x1, y1] = [ring[i], ring[i + 1], ring[next], ring[next + 1]].map((v) => v / 100);
        const length = Math.hypot(x1 - x0, y1 - y0) || 1;
        const normal = [Math.round((127 * (y1 - y0)) / length), Math.round((-127 * (x1 - x0)) / length), 0];
        const v = vertex;
        put(x0, y0, base, normal, feature);
        put(x1, y1, base, normal, feature);
        put(x1, y1, roof, normal, feature);
        put(x0, y0, roof, normal, feature);
        mesh.indices.set([v, v + 1, v + 2, v, v + 2, v + 3], index);
        index += 6;
        mesh.edges.set([v, v + 1, v + 3, v + 2, v, v + 3], edge);
        edge += 6;
      }
    }
  });
  return mesh;
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
