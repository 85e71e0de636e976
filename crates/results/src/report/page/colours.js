// Colours that colour-blind people can read: matplotlib's viridis and cividis (CC0), and Okabe and Ito's eight.

const MAPS = {
  viridis: [[68, 1, 84], [72, 36, 117], [65, 68, 135], [53, 95, 141], [42, 120, 142], [33, 145, 140], [34, 168, 132],
    [68, 191, 112], [122, 209, 81], [189, 223, 38], [253, 231, 37]],
  cividis: [[0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120], [165, 156, 116],
    [195, 179, 105], [225, 204, 85], [254, 232, 56]],
};
const NO_VALUE = [168, 168, 174];
const ALERT = [213, 94, 0];
const STATUS_COLOURS = {
  measured: [0, 114, 178],
  reviewed: [0, 158, 115],
  given: [86, 180, 233],
  doubtful: [230, 159, 0],
  fallback: [204, 121, 167],
  unknown: [150, 150, 156],
  refused: [90, 90, 96],
};

function colourAt(map, t) {
  const stops = MAPS[map];
  const at = clamp(t, 0, 1) * (stops.length - 1);
  const below = Math.min(Math.floor(at), stops.length - 2);
  return stops[below].map((value, i) => Math.round(mix(value, stops[below + 1][i], at - below)));
}

const css = (rgb) => `rgb(${rgb[0]} ${rgb[1]} ${rgb[2]})`;

// Ways to colour buildings. `colour` answers for one; `scale` or `classes` tell the legend what it means.
function colourings(buildings) {
  const known = (key) => buildings.map((b) => b[key]).filter((v) => v !== null);
  const heights = known("height");
  const sigmas = known("sigma");
  const views = buildings.map((b) => b.views.length);
  // All heights have a colour of their own; one tower does not flatten the town, as colours then go by the square root.
  const median = quantile(heights, 0.5) ?? 1;
  const highest = heights.reduce((a, b) => Math.max(a, b), 1);
  const isRoot = highest > 2.5 * median;
  const top = (values, limit) => Math.max(Math.min(quantile(values, 0.98) ?? 1, limit), 1e-3);
  const scaled = (title, map, values, key, end, unit, root = false) => ({
    title,
    scale: { map, end, unit, root, more: values.some((v) => v > end) },
    colour: (b) => (key(b) === null ? NO_VALUE : colourAt(map, root ? Math.sqrt(Math.max(key(b), 0) / end) : key(b) / end)),
  });
  const classes = [...new Set(buildings.map((b) => b.status))].sort();
  return {
    height: scaled("Height above ground", "viridis", heights, (b) => b.height, Math.ceil(highest), "m", isRoot),
    sigma: scaled("Uncertainty: one standard deviation", "cividis", sigmas, (b) => b.sigma,
      Math.ceil(10 * top(sigmas, Infinity)) / 10, "m"),
    status: {
      title: "Status",
      classes: classes.map((name) => [name, STATUS_COLOURS[name] ?? NO_VALUE]),
      colour: (b) => STATUS_COLOURS[b.status] ?? NO_VALUE,
    },
    views: scaled("Photos it was measured in", "cividis", views, (b) => b.views.length, Math.max(...views, 1), ""),
  };
}
