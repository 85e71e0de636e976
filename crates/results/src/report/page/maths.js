// Vectors and matrices: plain arrays, matrices column by column as WebGL wants them. Axes: x east, y north, z up.

const TAU = 2 * Math.PI;

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const mix = (a, b, t) => a + (b - a) * t;

const vec = {
  add: (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]],
  sub: (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
  scale: (a, s) => [a[0] * s, a[1] * s, a[2] * s],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  length: (a) => Math.hypot(a[0], a[1], a[2]),
  unit: (a) => vec.scale(a, 1 / (vec.length(a) || 1)),
};

const mat = {
  multiply(a, b) {
    const out = new Float32Array(16);
    for (let col = 0; col < 4; col += 1) {
      for (let row = 0; row < 4; row += 1) {
        let sum = 0;
        for (let k = 0; k < 4; k += 1) sum += a[4 * k + row] * b[4 * col + k];
        out[4 * col + row] = sum;
      }
    }
    return out;
  },
  // Camera at `eye` that looks at `target`; `up` is not along the line of sight.
  lookAt(eye, target, up) {
    const z = vec.unit(vec.sub(eye, target));
    const x = vec.unit(vec.cross(up, z));
    const y = vec.cross(z, x);
    return new Float32Array([
      x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0,
      -vec.dot(x, eye), -vec.dot(y, eye), -vec.dot(z, eye), 1,
    ]);
  },
  perspective(fovY, aspect, near, far) {
    const f = 1 / Math.tan(fovY / 2);
    return new Float32Array([
      f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0,
    ]);
  },
  orthographic(halfWidth, halfHeight, near, far) {
    return new Float32Array([
      1 / halfWidth, 0, 0, 0, 0, 1 / halfHeight, 0, 0, 0, 0, 2 / (near - far), 0, 0, 0, (far + near) / (near - far), 1,
    ]);
  },
  // Moves the part of the picture around a position (-1..1) to all of a picture of one pixel.
  zoomTo(x, y, scaleX, scaleY) {
    return new Float32Array([scaleX, 0, 0, 0, 0, scaleY, 0, 0, 0, 0, 1, 0, -x * scaleX, -y * scaleY, 0, 1]);
  },
  // A point through a matrix, divided: [x, y, z] of the picture, and whether it lies before the camera.
  project(m, p) {
    const w = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15];
    const at = (row) => (m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row]) / w;
    return [at(0), at(1), at(2), w > 0];
  },
};

// Corners of a box.
const cornersOf = (low, high) => Array.from({ length: 8 }, (_, i) => low.map((v, axis) => ((i >> axis) % 2 === 0 ? v : high[axis])));

// The largest of 1, 2, 5 times a power of ten that is at most `value`.
function roundDown(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [5, 2, 1].find((lead) => lead * power <= value * (1 + 1e-9)) * power;
}

// Round ticks within a range, about `n` of them.
function ticksOf(low, high, n) {
  if (!(high > low)) return [low];
  const wished = (0.8 * (high - low)) / n;
  const power = 10 ** Math.floor(Math.log10(wished));
  const step = ([1, 2, 2.5, 5].find((lead) => lead * power >= wished * (1 - 1e-9)) ?? 10) * power;
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1) ticks.push(i * step);
  return ticks;
}

function quantile(values, q) {
  const sorted = values.filter(Number.isFinite).sort((a, b) => a - b);
  if (sorted.length === 0) return undefined;
  const at = q * (sorted.length - 1);
  return mix(sorted[Math.floor(at)], sorted[Math.ceil(at)], at % 1);
}

// Whether a sphere may be in the picture: it is on the inner side of the planes that bound it.
function inSight(clip, centre, radius) {
  for (const [row, sign] of [[0, 1], [0, -1], [1, 1], [1, -1], [2, 1]]) {
    const plane = [0, 1, 2, 3].map((col) => clip[4 * col + 3] + sign * clip[4 * col + row]);
    const distance = vec.dot(plane, centre) + plane[3];
    if (distance < -radius * vec.length(plane)) return false;
  }
  return true;
}
