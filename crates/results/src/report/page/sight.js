// Where to stand so that a building is seen: higher ones may hide it.

// Places to try: turned and raised from where the camera is, the least change first. Radians.
const TURNS = [0, 0.4, -0.4, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4, Math.PI];
const RAISED = [0, 0.2, 0.4, 0.6];
// A turn costs this much of a rise.
const COST_OF_TURN = 0.3;
// Enough of a roof to recognise it.
const ENOUGH = 0.7;
// Triangles of a roof whose middles are looked at, the largest.
const MOST_SAMPLES = 12;

// What hides what: footprints and roofs of all buildings, metres from the origin.
class Sights {
  constructor(data) {
    this.walls = data.buildings.map((b) => ({
      rings: b.rings.map((ring) => ring.map((v) => v / 100)),
      box: boxOf(b),
      roof: (b.ground ?? b.base ?? data.origin[2]) - data.origin[2] + (b.height ?? 0),
    }));
  }

  // Whether anything but `self` stands between two points; `to` is the lower one.
  isBlocked(from, to, self) {
    return this.walls.some((wall, i) => {
      if (i === self || wall.rings.length === 0 || to[2] >= wall.roof) return false;
      // Only the last stretch of the sight line is below this roof.
      const share = from[2] > wall.roof ? (from[2] - wall.roof) / (from[2] - to[2]) : 0;
      const start = [mix(from[0], to[0], share), mix(from[1], to[1], share)];
      const [low, high] = wall.box;
      for (const k of [0, 1]) {
        if (Math.max(start[k], to[k]) < low[k] || Math.min(start[k], to[k]) > high[k]) return false;
      }
      return crossesFootprint(start, to, wall.rings);
    });
  }

  // Middles of the roof's largest triangles.
  samples(b, self) {
    const { rings, roof } = this.walls[self];
    const corners = rings.flat();
    const at = (i) => [corners[2 * i], corners[2 * i + 1]];
    const found = [];
    for (let t = 0; t < b.triangles.length; t += 3) {
      const [p, q, r] = [0, 1, 2].map((k) => at(b.triangles[t + k]));
      const area = Math.abs((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]));
      found.push({ area, point: [(p[0] + q[0] + r[0]) / 3, (p[1] + q[1] + r[1]) / 3, roof] });
    }
    return found.sort((x, y) => y.area - x.area).slice(0, MOST_SAMPLES).map((sample) => sample.point);
  }

  // The view of building `self` from around `view` with the least change that shows its roof; straight down at worst.
  clearView(scene, b, self, view) {
    const samples = this.samples(b, self);
    const seen = (tried) => {
      const { eye } = scene.pose(tried);
      return samples.filter((point) => !this.isBlocked(eye, point, self)).length / Math.max(samples.length, 1);
    };
    const tries = RAISED.flatMap((rise) => TURNS.map((turn) => ({ rise, turn, cost: rise + COST_OF_TURN * Math.abs(turn) })));
    let best = null;
    for (const { rise, turn } of tries.sort((x, y) => x.cost - y.cost)) {
      const tried = { ...view, yaw: view.yaw + turn, pitch: Math.min(view.pitch + rise, STRAIGHT_DOWN) };
      const share = seen(tried);
      if (!best || share > best.share) best = { share, tried };
      if (share >= ENOUGH) break;
    }
    const down = { ...view, pitch: STRAIGHT_DOWN };
    return best.share >= ENOUGH || best.share >= seen(down) ? best.tried : down;
  }
}

// Whether a stretch crosses the footprint, or begins and ends within it.
function crossesFootprint(a, b, rings) {
  let isInside = false;
  for (const ring of rings) {
    for (let i = 0, j = ring.length - 2; i < ring.length; j = i, i += 2) {
      const [p, q] = [[ring[j], ring[j + 1]], [ring[i], ring[i + 1]]];
      if (doCross(a, b, p, q)) return true;
      if (p[1] > a[1] !== q[1] > a[1] && a[0] < p[0] + ((a[1] - p[1]) / (q[1] - p[1])) * (q[0] - p[0])) isInside = !isInside;
    }
  }
  return isInside;
}

function doCross(a, b, p, q) {
  const side = (o, d, x) => Math.sign((d[0] - o[0]) * (x[1] - o[1]) - (d[1] - o[1]) * (x[0] - o[0]));
  return side(a, b, p) * side(a, b, q) < 0 && side(p, q, a) * side(p, q, b) < 0;
}
