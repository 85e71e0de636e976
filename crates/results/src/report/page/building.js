// The picked building: what is known of it, how every height scores, and the photos that show it.

const REASONS = {
  seen_by_no_view: "No oblique photo with a depth prior shows enough of it.",
  too_few_views: "Fewer than three photos had a say.",
  range_bound: "The best height is at an end of the heights that are looked for.",
  flat_score: "All heights explain the depth priors about equally well.",
  wrong_order: "With the heights found, the depths stand in the wrong order.",
  conflicting_views: "The photos disagree with each other, or with the depth priors: the height is uncertain.",
  poor_score: "The depth priors are explained badly by any height.",
  other_height: "Over the whole range another height explains the depth priors better.",
  unseen_above: "No photo's depth looks through the space above it: it may be taller.",
  vegetation: "Nearly all that stands there is as green as leaves: trees over the roof, or a green roof.",
  above_all_around: "It stands far above all that is around.",
  nothing_stands_here: "The photos show no building there: the bare ground explains them as well.",
  roof_of_neighbour: "So small a footprint may show the roof of another building beside it.",
  ground_differs: "The photos do not agree on the level of the ground around it.",
  ground_unknown: "The terrain has no height under it.",
};

// Parts by the building that they are parts of.
function partsByWhole(buildings) {
  const parts = new Map();
  buildings.forEach((b, i) => { if (b.part_of) parts.set(b.part_of, [...(parts.get(b.part_of) ?? []), i]); });
  return parts;
}

// The parts of a building that was split: all of it, or of a part that was split once more (`ID#1`).
function partsOf(data, id) {
  const all = data.parts.get(id);
  if (all) return all;
  return data.buildings.flatMap((b, i) => (b.part_of && b.id.startsWith(`${id}#`) ? [i] : []));
}

// Links to buildings, with commas between.
const linksTo = (data, positions) => positions.flatMap((i, n) => [n > 0 ? ", " : null, linkTo(data.buildings[i])]);

// Whether an issue is about a building, or about the whole that it is a part of.
function isAbout(issue, b) {
  const { kind, id } = issue.subject;
  return kind === "building" && (id === b.id || (b.part_of && (id === b.part_of || b.id.startsWith(`${id}#`))));
}

function drawBuilding(box, data, index) {
  const b = data.buildings[index];
  const evidence = data.evidence.find((e) => e.building === index);
  const badge = el("span", { class: `badge ${b.status}`, text: b.status });
  badge.style.background = css(STATUS_COLOURS[b.status] ?? NO_VALUE);
  const roof = b.ground !== null && b.height !== null ? b.ground + b.height : null;
  const height = el("p", { class: "big", id: "picked-height" }, metres(b.height),
    b.sigma !== null && el("small", { text: ` ± ${number(b.sigma, 2)} m` }));
  box.classList.add("has-building");
  box.replaceChildren(
    el("h2", { id: "picked-id", text: b.id }),
    badge,
    height,
    ...b.reasons.map((code) => el("p", { class: "reason" }, el("b", { text: words(code) }),
      REASONS[code] ? el("span", { text: `: ${REASONS[code]}` }) : null)),
    ...data.issues.filter((issue) => isAbout(issue, b))
      .map((issue) => el("p", { class: "reason", text: issue.subject.id === b.id ? issue.message : `${issue.subject.id}: ${issue.message}` })),
    ...crops(data, evidence),
    facts([
      ["Ground", metres(b.ground, 2)], ["Lowest ground", metres(b.base, 2)], ["Roof", metres(roof, 2)],
      ["Part of", wholeOf(data, b, index)], ["Measured in", `${b.views.length} photos`],
    ]),
    ...charts(data, b, index, evidence),
    ...attributes(b),
  );
}

// The building that this is a part of, and its other parts.
function wholeOf(data, b, index) {
  if (!b.part_of) return null;
  const others = partsOf(data, b.part_of).filter((i) => i !== index);
  return el("span", { id: "whole" }, b.part_of, others.length > 0 && [", beside ", linksTo(data, others)]);
}

function attributes(b) {
  const own = Object.entries(b.attributes ?? {});
  if (own.length === 0) return [];
  const text = (value) => (typeof value === "string" ? value : JSON.stringify(value));
  return [el("h3", { text: "Attributes of the input" }), facts(own.map(([name, value]) => [name, text(value)]))];
}

function charts(data, b, index, evidence) {
  const drawn = [];
  if (evidence && evidence.scores.length > 0) {
    const of = (scores) => evidence.heights.map((h, i) => [h, scores[i]]);
    const mean = evidence.heights.map((_, i) => evidence.scores.reduce((sum, s) => sum + s.score[i], 0) / evidence.scores.length);
    const faint = evidence.scores.map((s) => ({ kind: "faint", points: of(s.score) }));
    drawn.push(lineChart({ title: "How well a flat roof at each height explains the priors", x: "height, m", y: "score" },
      [...faint, { kind: "main", name: `mean of ${evidence.scores.length} photos`, points: of(mean) }],
      { fromZero: false, marks: b.height === null ? [] : [{ x: b.height, kind: "second", name: "stated height" }] }));
  }
  drawn.push(...levelCharts(data, b));
  const at = data.solved.indexOf(index);
  const track = data.passes.filter((p) => at >= 0 && p.heights.length > at).map((p, i) => [i + 1, p.heights[at] / 10]);
  if (track.length > 1) {
    drawn.push(lineChart({ title: "Its height over the passes", x: "pass", y: "height, m" }, [{ kind: "main", points: track }]));
  }
  return drawn;
}

// What one level for the whole footprint explains, and what two do: why it was split.
function levelCharts(data, b) {
  const found = data.levels.filter((levels) => b.part_of && (levels.whole === b.part_of || b.id.startsWith(`${levels.whole}#`)));
  return found.map((levels) => {
    const heights = levels.curve.map(([height]) => height);
    const [low, high] = [Math.min(...heights), Math.max(...heights)];
    return lineChart({ title: `${levels.whole} as a whole: how well one level explains the priors, and how well two do`, x: "height, m", y: "score" },
      [{ kind: "main", name: `one level, mean of ${levels.n_views} photos`, points: levels.curve },
        { kind: "second", name: `two levels: ${levels.heights.map((h) => metres(h)).join(" and ")}`, points: [[low, levels.two], [high, levels.two]] }],
      { fromZero: false, marks: levels.heights.map((x) => ({ x, kind: "second" })) });
  });
}

function crops(data, evidence) {
  if (!evidence || evidence.crops.length === 0) {
    return [el("p", { class: "quiet", text: "No photos of it are in this page: it holds those of the most doubtful buildings." })];
  }
  const box = el("div", { id: "crops" });
  const toggle = (name, text) => {
    const check = el("input", { type: "checkbox", checked: true, onchange: () => box.classList.toggle(`without-${name}`, !check.checked) });
    return el("label", {}, check, el("span", { text: ` ${text} ` }));
  };
  box.append(...evidence.crops.map((crop) => drawCrop(data, crop)));
  return [
    el("h3", { text: "In the photos" }),
    el("p", { class: "quiet" }, toggle("edges", "blocks"), toggle("pairs", "ordinal pairs"),
      el("span", { class: "key second", text: "active: in the wrong order, or right by less than the margin " }), el("span", { class: "key main", text: "settled" })),
    box,
  ];
}

function drawCrop(data, crop) {
  const view = data.views[crop.view];
  const overlay = svg("svg", { viewBox: "0 0 1000 1000", preserveAspectRatio: "none", "aria-hidden": "true" });
  const lines = (numbers, step) => {
    let d = "";
    for (let i = 0; i + 3 < numbers.length; i += step) d += `M${numbers[i]} ${numbers[i + 1]}L${numbers[i + 2]} ${numbers[i + 3]}`;
    return d;
  };
  for (const [kind, numbers] of crop.lines) {
    if (kind === "roof") overlay.append(svg("path", { class: "edge halo", d: lines(numbers, 4) }));
    overlay.append(svg("path", { class: `edge ${kind}`, d: lines(numbers, 4) }));
  }
  for (const [isActive, kind] of [[0, "settled"], [1, "active"]]) {
    overlay.append(svg("path", { class: `edge pair ${kind}`, d: lines(crop.pairs.filter((p) => p[4] === isActive).flatMap((p) => p.slice(0, 4)), 4) }));
  }
  const frame = (source, text, ...more) => el("div", { class: "frame" }, el("img", { src: source, alt: `${text}, ${view.id}`, width: crop.size[0], height: crop.size[1] }),
    ...more, el("span", { text }));
  const nActive = crop.pairs.filter((p) => p[4] === 1).length;
  return el("figure", { class: "crop" },
    el("div", { class: "frames" },
      crop.photo ? frame(crop.photo, "photo", overlay) : frame(crop.rendered, "depth of the result", overlay),
      frame(crop.rendered, "depth of the result"),
      crop.prior ? frame(crop.prior, "prior") : el("div", { class: "frame quiet", text: "no prior" })),
    el("figcaption", {}, el("span", { text: view.id }), el("span", { text: `${number(view.off_nadir, 0)}° off straight down` }),
      el("span", { text: `${nActive} of ${crop.pairs.length} pairs active` })));
}
