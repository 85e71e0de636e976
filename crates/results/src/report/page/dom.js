// Elements of the page. Text goes in as text, never as markup.

const SVG = "http://www.w3.org/2000/svg";

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") node.textContent = value;
    else if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return node;
}

const el = (name, attributes = {}, ...children) => fill(document.createElement(name), attributes, children);
const svg = (name, attributes = {}, ...children) => fill(document.createElementNS(SVG, name), attributes, children);
const byId = (id) => document.getElementById(id);

const number = (value, decimals = 1) =>
  value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(decimals);
const metres = (value, decimals = 1) => (number(value, decimals) === "–" ? "–" : `${number(value, decimals)} m`);
const words = (code) => code.replaceAll("_", " ");

// A table; `rows` are lists of cells: text or elements. Only the first rows are made until more are asked for.
function table(heads, rows, { first = 100, caption = null } = {}) {
  const body = el("tbody");
  const add = (from, to) => {
    for (const row of rows.slice(from, to)) {
      body.append(el("tr", {}, row.map((cell) => (cell instanceof Node ? el("td", {}, cell) : el("td", { text: cell })))));
    }
  };
  add(0, first);
  const whole = el("div", { class: "table", tabindex: 0, role: "group", "aria-label": caption ?? heads.join(", ") },
    el("table", {}, caption && el("caption", { text: caption }),
      el("thead", {}, el("tr", {}, heads.map((head) => el("th", { scope: "col", text: head })))), body));
  if (rows.length > first) {
    const more = el("button", { type: "button", class: "more", text: `Show all ${rows.length}`, onclick: () => { add(first); more.remove(); } });
    whole.append(more);
  }
  return whole;
}

// Makes the rows of all tables, as paper has no buttons.
const showAllRows = () => document.querySelectorAll("button.more").forEach((button) => button.click());

// Terms and what they are.
const facts = (pairs) =>
  el("dl", {}, pairs.filter(([, value]) => value !== null && value !== undefined && value !== "")
    .map(([name, value]) => [el("dt", { text: name }), value instanceof Node ? el("dd", {}, value) : el("dd", { text: value })]));
