// What stands over the picture in both pages: choices, legend, compass, theme.

// A box of choices: how to colour, and which layers to show. Closed on small screens.
function controlBox(box, colourNames, layers, on) {
  const select = el("select", { id: "colour", "aria-label": "Colour by", onchange: () => on.colour(select.value) },
    colourNames.map(([value, text]) => el("option", { value, text })));
  const boxes = layers.map(([name, text, isOn]) => {
    const check = el("input", { type: "checkbox", id: `layer-${name}`, onchange: () => on.layer(name, check.checked) });
    check.checked = isOn;
    return el("label", {}, check, el("span", { text }));
  });
  const details = el("details", {}, el("summary", { text: "Show" }), select, boxes,
    on.reset && el("button", { type: "button", id: "reset", text: "Whole city", onclick: on.reset }));
  details.open = window.innerWidth > 700;
  box.replaceChildren(details);
  box.hidden = false;
}

function drawLegend(box, colouring) {
  if (colouring.classes) {
    box.replaceChildren(el("div", { text: colouring.title }), ...colouring.classes.map(([name, rgb]) => {
      const swatch = el("span", { class: "swatch" });
      swatch.style.background = css(rgb);
      return el("div", { class: "class" }, swatch, el("span", { text: words(name) }));
    }));
    return;
  }
  const swatch = el("span", { class: "swatch" });
  swatch.style.background = css(NO_VALUE);
  const unknown = el("div", { class: "class quiet" }, swatch, el("span", { text: "not known" }));
  if (colouring.steps) {
    box.replaceChildren(el("div", { text: colouring.title }), drawSteps(colouring.steps), unknown);
    return;
  }
  const { map, end, unit, more } = colouring.scale;
  const ramp = el("canvas", { class: "ramp", width: 128, height: 1, "aria-hidden": "true" });
  const context = ramp.getContext("2d");
  for (let i = 0; i < 128; i += 1) {
    context.fillStyle = css(colourAt(map, i / 127));
    context.fillRect(i, 0, 1, 1);
  }
  box.replaceChildren(el("div", { text: colouring.title }), ramp,
    el("div", { class: "ends" }, el("span", { text: `0 ${unit}` }), el("span", { text: `${end} ${unit}${more ? " and more" : ""}` })), unknown);
}

// Classes as blocks, the lowest first, with the bounds between them.
function drawSteps(steps) {
  const width = 20;
  return svg("svg", { class: "steps", viewBox: `0 0 ${steps.length * width} 24`, role: "img", "aria-label": "Classes of heights" },
    ...steps.map(([, rgb], i) => svg("rect", { x: i * width, width, height: 11, fill: css(rgb) })),
    ...steps.slice(0, -1).map(([below], i) => svg("text", { x: (i + 1) * width, y: 22, "text-anchor": "middle", "font-size": 10, fill: "currentColor", text: String(below) })));
}

// A needle that points north; returns what turns it.
function createCompass(box) {
  const needle = svg("g", {}, svg("polygon", { points: "0,-15 6,6 0,2 -6,6", fill: "currentColor" }),
    svg("text", { y: 17, "text-anchor": "middle", "font-size": 10, fill: "currentColor", text: "N" }));
  box.replaceChildren(svg("svg", { viewBox: "-20 -20 40 40" }, needle));
  return (yaw) => needle.setAttribute("transform", `rotate(${(-yaw * 360) / TAU})`);
}

const isDark = () => document.documentElement.dataset.theme === "dark";

// Follows the system until somebody chooses; `changed` is told.
function followTheme(button, changed) {
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  const set = (dark) => { document.documentElement.dataset.theme = dark ? "dark" : "light"; changed(); };
  document.documentElement.dataset.theme = system.matches ? "dark" : "light";
  system.addEventListener("change", () => set(system.matches));
  button?.addEventListener("click", () => set(!isDark()));
}

// The scene's own colours.
const lookOf = (dark) => dark
  ? { paper: [0.24, 0.25, 0.28], background: [0.118, 0.125, 0.149], ink: [0.03, 0.03, 0.05] }
  : { paper: [0.93, 0.92, 0.9], background: [1, 1, 1], ink: [0.1, 0.1, 0.14] };
