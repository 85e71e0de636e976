// Colours that colour-blind people can read: matplotlib's viridis and cividis (CC0), and Okabe and Ito's eight.

// Heights have classes, the same for every city and in every product: HEIGHT_CLASSES, the lowest first.
const HEIGHT_STEPS = HEIGHT_CLASSES.map(({ below_m, colour }) =>
  [below_m ?? Infinity, [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16))]);
const MAPS = {
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

const heightColour = (height) => (HEIGHT_STEPS.find(([below]) => height < below) ?? [0, NO_VALUE])[1];

const css = (rgb) => `rgb(${rgb[0]} ${rgb[1]} ${rgb[2]})`;

// Ways to colour buildings. `colour` answers for one; `steps`, `scale` or `classes` tell the legend what it means.
function colourings(buildings) {
  const known = (key) => buildings.map((b) => b[key]).filter((v) => v !== null);
  const sigmas = known("sigma");
  const views = buildings.map((b) => b.views.length);
  const top = (values, limit) => Math.max(Math.min(quantile(values, 0.98) ?? 1, limit), 1e-3);
  const scaled = (title, map, values, key, end, unit) => ({
    title,
    scale: { map, end, unit, more: values.some((v) => v > end) },
    colour: (b) => (key(b) === null ? NO_VALUE : colourAt(map, key(b) / end)),
  });
  const classes = [...new Set(buildings.map((b) => b.status))].sort();
  return {
    height: {
      title: "Height above ground, m",
      steps: HEIGHT_STEPS,
      colour: (b) => (b.height === null ? NO_VALUE : heightColour(b.height)),
    },
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
