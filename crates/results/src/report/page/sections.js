// The sections below the pictures: figures, lists, tables.

// More heights over the passes than these are drawn as a band.
const MOST_TRACKS = 300;

const linkTo = (b) => el("a", { href: `#building=${encodeURIComponent(b.id)}`, text: b.id });

// What speaks against the result as a whole comes before all else.
function drawImplausible(data) {
  const told = data.issues.filter((issue) => issue.code === "result_implausible");
  byId("implausible").hidden = told.length === 0;
  byId("implausible").replaceChildren(...told.map((issue) =>
    el("p", {}, el("b", { text: `Implausible: ${issue.message}.` }), el("span", { text: ` ${issue.hint ?? ""}` }))));
}

function drawSummary(data) {
  const { summary } = data;
  const tile = (value, text) => el("div", { class: "tile" }, el("b", { text: value }), el("span", { class: "quiet", text }));
  const tiles = [tile(summary.n_buildings, "buildings")];
  if (summary.n_parts > 0) tiles.push(tile(summary.n_parts, "parts of buildings"));
  for (const [status, n] of Object.entries(summary.n_by_status)) if (n > 0) tiles.push(tile(n, words(status)));
  if (summary.heights) {
    tiles.push(tile(metres(summary.heights.median_m), "median height"), tile(metres(summary.heights.max_m), "highest"));
    if (summary.heights.median_sigma_m !== null) tiles.push(tile(`± ${number(summary.heights.median_sigma_m, 2)} m`, "median uncertainty"));
  }
  tiles.push(tile(`${summary.n_views_used} of ${summary.n_views}`, "photos with a say"));
  byId("summary").replaceChildren(el("div", { class: "tiles" }, tiles));
  byId("charts").replaceChildren(
    histogram({ title: "Heights above ground", x: "height, m", y: "buildings" }, data.buildings.map((b) => b.height ?? NaN)),
    histogram({ title: "Uncertainty: one standard deviation", x: "metres", y: "buildings" }, data.buildings.map((b) => b.sigma ?? NaN)),
    histogram({ title: "Photos that had a say", x: "photos", y: "buildings" }, data.buildings.map((b) => b.views.length)));
  const reasons = Object.entries(summary.n_by_reason);
  if (reasons.length > 0) {
    byId("summary").append(el("h3", { text: "Why heights are doubtful or missing" }),
      table(["Reason", "Buildings", "Meaning"], reasons.map(([code, n]) => [words(code), String(n), REASONS[code] ?? ""])));
  }
  byId("headline").textContent = summary.heights
    ? `median height ${metres(summary.heights.median_m)}, ${summary.n_by_status.doubtful ?? 0} doubtful, ${(summary.n_by_status.unknown ?? 0) + (summary.n_by_status.refused ?? 0)} without a height`
    : "no building has a height";
  const { highest, unlikely } = extremes(data.buildings);
  const told = highest ? ["Highest: ", linkTo(highest), ` with ${metres(highest.height)}. `] : [];
  if (unlikely) {
    const why = unlikely.reasons.length > 0 ? `: ${unlikely.reasons.map(words).join(", ")}` : "";
    const sigma = (unlikely.sigma ?? null) === null ? "" : ` ± ${number(unlikely.sigma, 2)} m`;
    told.push("Most unlikely: ", linkTo(unlikely), ` with ${metres(unlikely.height)}${sigma} (${words(unlikely.status)}${why}).`);
  }
  byId("extremes").replaceChildren(...told);
  byId("crs").textContent = `${data.crs}. Heights: ${data.lineage.vertical_reference}.`;
}

function drawBuildings(data) {
  const section = byId("buildings");
  const box = el("div");
  const search = el("input", { type: "search", id: "search", placeholder: "part of an id", "aria-label": "Find buildings by a part of their id" });
  const statuses = [...new Set(data.buildings.map((b) => b.status))].sort();
  const status = el("select", { "aria-label": "Status" }, el("option", { value: "", text: "all" }), statuses.map((s) => el("option", { value: s, text: words(s) })));
  const orders = {
    worst: ["worst first", byDoubt],
    highest: ["highest first", (a, b) => (b.height ?? -1) - (a.height ?? -1)],
    lowest: ["lowest first", (a, b) => (a.height ?? Infinity) - (b.height ?? Infinity)],
  };
  const order = el("select", { "aria-label": "Order" }, Object.entries(orders).map(([value, [text]]) => el("option", { value, text })));
  const draw = () => {
    const part = search.value.trim().toLowerCase();
    const found = data.buildings.filter((b) => (status.value === "" || b.status === status.value) && b.id.toLowerCase().includes(part));
    found.sort(orders[order.value][1]);
    const rows = found.map((b) => [linkTo(b), metres(b.height), b.sigma === null ? "–" : `± ${number(b.sigma, 2)} m`, words(b.status),
      b.reasons.map(words).join(", "), String(b.views.length)]);
    box.replaceChildren(table(["Building", "Height", "Uncertainty", "Status", "Reasons", "Photos"], rows, { first: 25, caption: `${found.length} of ${data.buildings.length}${data.summary.n_parts > 0 ? ", parts of buildings among them" : ""}` }));
  };
  [search, status, order].forEach((input) => input.addEventListener("input", draw));
  section.append(el("div", { class: "filters" }, search, status, order), box);
  draw();
}

function drawIssues(data) {
  const section = byId("issues");
  if (data.issues.length === 0) { section.append(el("p", { text: "None." })); return; }
  const { issues } = data; // by weight
  const subject = ({ kind, id }) => {
    if (kind !== "building") return el("span", { text: `${kind === "view" ? "photo" : words(kind)} ${id}` });
    const b = data.buildings[data.byId.get(id)];
    if (b) return linkTo(b);
    const parts = partsOf(data, id);
    return el("span", {}, parts.length > 0 ? [`${id}: `, linksTo(data, parts)] : `building ${id}`);
  };
  const place = (issue) => (issue.place ? `${issue.place[0].toFixed(0)}, ${issue.place[1].toFixed(0)}` : "");
  const text = (issue) => el("span", {}, issue.message, issue.hint ? el("span", { class: "quiet", text: ` ${issue.hint}` }) : null);
  section.append(table(["Severity", "What about", "What", "Where"], issues.map((issue) => [
    el("span", { class: `severity-${issue.severity}`, text: issue.severity }), subject(issue.subject), text(issue), place(issue)]), { first: 50 }));
}

function drawSurvey(data) {
  const section = byId("survey");
  const { survey } = data;
  if (!survey) { section.append(el("p", { class: "quiet", text: "No survey report was found beside the results." })); return; }
  const spread = (s, unit) => (s ? `${number(s.min, 2)} to ${number(s.max, 2)} ${unit}, median ${number(s.median, 2)} ${unit}` : null);
  const counts = (map) => Object.entries(map ?? {}).map(([name, n]) => `${words(name)}: ${n}`).join(", ");
  section.append(
    survey.findings.length === 0
      ? el("p", { text: "Nothing looks wrong with the poses." })
      : el("div", {}, el("p", { text: "The poses look wrong:" }), el("ul", {}, survey.findings.map((f) => el("li", { class: "reason", text: f })))),
    facts([
      ["Poses from", survey.path], ["Format", survey.format], ["CRS of the poses", survey.poses_crs], ["CRS of the project", survey.project_crs],
      ["Heights", survey.heights], ["Poses", String(survey.n_poses)],
      ["Photos", `${survey.n_views} usable, ${survey.n_photos} with a file, ${survey.n_nadir} straight down, ${survey.n_oblique} oblique, ${survey.n_cameras} camera${survey.n_cameras === 1 ? "" : "s"}`],
      ["Look down", `${number(100 * survey.looks_down, 0)} %`], ["See the area", survey.sees_area === null ? null : `${number(100 * survey.sees_area, 0)} %`],
      ["Flying level", spread(survey.height_m, "m")], ["Above ground", spread(survey.above_ground_m, "m")],
      ["Grid convergence", spread(survey.convergence_deg, "°")], ["Positioning", counts(survey.rtk)], ["Focal lengths", counts(survey.focal)],
      ["Noted", counts(survey.issue_counts)],
    ]));
  if (survey.trials.length > 0) {
    section.append(el("h3", { text: "Readings that look better" }),
      table(["Change", "Look down"], survey.trials.map((t) => [t.change, `${number(100 * t.looks_down, 0)} %`])));
  }
}

const USES = {
  measured: "heights were measured in it",
  not_needed: "others show the same buildings as well",
  not_oblique: "shows no walls: heights come from oblique photos",
  failed: "its depth prior cannot be used",
};

function drawViews(data) {
  const says = new Array(data.views.length).fill(0);
  const shown = new Array(data.views.length).fill(0);
  data.buildings.forEach((b) => b.views.forEach((v) => { says[v] += 1; }));
  data.evidence.forEach((e) => e.crops.forEach((c) => { shown[c.view] += 1; }));
  const order = data.views.map((_, i) => i).sort((a, b) => says[b] - says[a] || a - b);
  const why = (v, i) => {
    if (v.use === "failed") return `${USES.failed}: ${v.why}`;
    if (v.use === "measured" && says[i] === 0) return "was selected; no building's height rests on it";
    return USES[v.use];
  };
  byId("views").append(table(["Photo", "Kind", "Off straight down", "Buildings measured in it", "Why"],
    order.map((i) => [data.views[i].id, data.views[i].kind, `${number(data.views[i].off_nadir, 0)}°`, String(says[i]), why(data.views[i], i)]), { first: 25 }));
}

function drawPasses(data) {
  const section = byId("passes");
  if (data.passes.length < 2) { section.append(el("p", { class: "quiet", text: "The heights were found in one go." })); return; }
  const of = (key) => data.passes.map((p, i) => [i + 1, p[key] ?? NaN]);
  const tracks = data.passes[0].heights.length;
  const heights = (b) => data.passes.map((p, i) => [i + 1, p.heights[b] / 10]);
  let series;
  if (tracks === 0) series = [];
  else if (tracks <= MOST_TRACKS) series = Array.from({ length: tracks }, (_, b) => ({ kind: "faint", points: heights(b) }));
  else {
    series = [0.1, 0.25, 0.75, 0.9].map((q) => ({ kind: "faint", points: data.passes.map((p, i) => [i + 1, quantile(p.heights, q) / 10]) }));
  }
  if (tracks > 0) series.push({ kind: "main", name: "median", points: data.passes.map((p, i) => [i + 1, quantile(p.heights, 0.5) / 10]) });
  const charted = [
    lineChart({ title: "Loss", x: "pass" }, [{ kind: "main", name: "loss", points: of("loss") },
      { kind: "second", name: "mean relative change of heights", points: of("change") }]),
    lineChart({ title: tracks <= MOST_TRACKS ? "Heights of all buildings" : "Heights: 10, 25, 75 and 90 %", x: "pass", y: "height, m" }, series),
    lineChart({ title: "Photos selected", x: "pass" }, [{ kind: "main", points: of("selected") }]),
  ];
  if (data.passes.some((p) => p.active !== undefined)) {
    charted.push(lineChart({ title: "Share of ordinal pairs that are active", x: "pass" }, [{ kind: "main", points: of("active") }]));
  }
  section.append(el("div", { class: "row" }, charted));
}

function drawLineage(data) {
  const { lineage } = data;
  const size = (bytes) => (bytes >= 1e6 ? `${number(bytes / 1e6)} MB` : `${number(bytes / 1e3)} kB`);
  byId("lineage").append(
    facts([
      ["Program", `sizeup ${lineage.version}`], ["Command", lineage.command], ["CRS", lineage.crs], ["Vertical reference", lineage.vertical_reference],
      ["Height", lineage.height_definition], ["Date of the data", lineage.reference_date], ["Seed", String(lineage.seed)],
      ["Configuration", el("span", { class: "hash", text: lineage.config_sha256 })],
    ]),
    el("details", {}, el("summary", { text: "Every setting as used" }), el("pre", { text: data.config })),
    el("h3", { text: "Files that were read" }),
    table(["Role", "File", "Size", "SHA-256"], lineage.inputs.map((f) => [f.role, f.path, size(f.size_bytes), el("span", { class: "hash", text: f.sha256 })]), { first: 20 }));
}
