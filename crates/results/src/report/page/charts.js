// Small charts as SVG, in the colours of the page.

const CHART = { width: 460, height: 220, left: 46, right: 12, top: 14, bottom: 38 };

// Axes with ticks; `x` and `y` are ranges. Returns the drawing and the way from values to pixels.
function axes(x, y, labels, size = CHART) {
  const inner = [size.width - size.left - size.right, size.height - size.top - size.bottom];
  const at = ([vx, vy]) => [
    size.left + ((vx - x[0]) / (x[1] - x[0] || 1)) * inner[0],
    size.top + (1 - (vy - y[0]) / (y[1] - y[0] || 1)) * inner[1],
  ];
  const text = (value) => String(Number(value.toPrecision(6)));
  const drawing = svg("svg", { viewBox: `0 0 ${size.width} ${size.height}`, class: "chart", role: "img",
    "aria-label": labels.title });
  for (const tick of ticksOf(x[0], x[1], 6)) {
    const [px] = at([tick, 0]);
    drawing.append(svg("line", { x1: px, x2: px, y1: size.top, y2: size.top + inner[1], class: "grid" }),
      svg("text", { x: px, y: size.height - 22, class: "tick middle", text: text(tick) }));
  }
  for (const tick of ticksOf(y[0], y[1], 5)) {
    const [, py] = at([0, tick]);
    drawing.append(svg("line", { x1: size.left, x2: size.left + inner[0], y1: py, y2: py, class: "grid" }),
      svg("text", { x: size.left - 6, y: py + 4, class: "tick end", text: text(tick) }));
  }
  drawing.append(svg("text", { x: size.left + inner[0] / 2, y: size.height - 5, class: "tick middle", text: labels.x }));
  if (labels.y) drawing.append(svg("text", { x: 4, y: 10, class: "tick", text: labels.y }));
  return { drawing, at };
}

function path(points, at) {
  let pen = "M";
  return points.map((p) => {
    if (!p.every(Number.isFinite)) { pen = "M"; return ""; }
    const [px, py] = at(p);
    const step = `${pen}${px.toFixed(1)} ${py.toFixed(1)}`;
    pen = "L";
    return step;
  }).join("");
}

const rangeOf = (values, fromZero) => {
  const known = values.filter(Number.isFinite);
  if (known.length === 0) return [0, 1];
  let [low, high] = known.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  if (fromZero) low = Math.min(low, 0);
  const room = 0.04 * (high > low ? high - low : Math.abs(high) || 1);
  return [fromZero && low === 0 ? 0 : low - room, high + room];
};

// Lines: [{ points: [[x, y], …], kind: "main" | "second" | "faint", name }].
function lineChart(labels, series, { fromZero = true, marks = [] } = {}) {
  const all = series.flatMap((s) => s.points);
  const x = rangeOf(all.map((p) => p[0]), fromZero);
  const y = rangeOf(all.map((p) => p[1]), fromZero);
  const { drawing, at } = axes(x, y, labels);
  for (const s of series) drawing.append(svg("path", { d: path(s.points, at), class: `line ${s.kind}` }));
  for (const mark of marks) {
    const [px] = at([mark.x, y[0]]);
    drawing.append(svg("line", { x1: px, x2: px, y1: at([0, y[1]])[1], y2: at([0, y[0]])[1], class: `mark ${mark.kind}` }));
  }
  const named = series.filter((s) => s.name);
  const legend = el("figcaption", {}, el("span", { text: labels.title }),
    named.map((s) => el("span", { class: `key ${s.kind}`, text: s.name })),
    marks.filter((m) => m.name).map((m) => el("span", { class: `key ${m.kind}`, text: m.name })));
  return el("figure", {}, drawing, legend);
}

function histogram(labels, values, nBins = 24) {
  const known = values.filter(Number.isFinite);
  if (known.length === 0) return el("p", { class: "quiet", text: `${labels.title}: nothing to show` });
  const high = Math.max(...known, 1e-6);
  const step = ticksOf(0, high, nBins)[1] ?? high;
  const counts = new Array(Math.floor(high / step) + 1).fill(0);
  for (const value of known) counts[Math.floor(value / step)] += 1;
  const { drawing, at } = axes([0, counts.length * step], [0, Math.max(...counts)], labels);
  counts.forEach((count, i) => {
    const [x0, y0] = at([i * step, count]);
    const [x1, y1] = at([(i + 1) * step, 0]);
    const bar = svg("rect", { x: x0 + 0.5, y: y0, width: Math.max(x1 - x0 - 1, 0.5), height: y1 - y0, class: "bar" });
    bar.append(svg("title", { text: `${number(i * step, 2)} to ${number((i + 1) * step, 2)}: ${count}` }));
    drawing.append(bar);
  });
  return el("figure", {}, drawing, el("figcaption", { text: labels.title }));
}
