// The map: footprints from above, north up, with a scale bar. Drag to move, wheel or pinch to zoom, click to pick.

// How much of a building's colour covers the photo below it.
const OVER_PHOTO = 0.62;

const pictureOf = async (src) => {
  const picture = new Image();
  picture.src = src;
  await picture.decode();
  return picture;
};

// Photos laid on the ground, transparent where none shows it.
async function loadBackdrop({ picture, shown }) {
  const photo = await pictureOf(picture);
  if (!shown) return photo;
  const mask = await pictureOf(shown);
  const canvas = el("canvas", { width: photo.naturalWidth, height: photo.naturalHeight });
  const context = canvas.getContext("2d");
  context.drawImage(photo, 0, 0);
  context.globalCompositeOperation = "destination-in";
  context.drawImage(mask, 0, 0);
  return canvas;
}

function createMap(canvas, data, on) {
  const context = canvas.getContext("2d");
  const [ox, oy] = data.origin;
  const footprints = data.buildings.map((b) => b.rings.map((ring) => ring.map((v) => v / 100)));
  const boxes = footprints.map(([outer]) => {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let i = 0; i < (outer?.length ?? 0); i += 2) {
      box[0] = Math.min(box[0], outer[i]); box[1] = Math.min(box[1], outer[i + 1]);
      box[2] = Math.max(box[2], outer[i]); box[3] = Math.max(box[3], outer[i + 1]);
    }
    return box;
  });
  const whole = boxes.filter((b) => Number.isFinite(b[0])).reduce(
    (w, b) => [Math.min(w[0], b[0]), Math.min(w[1], b[1]), Math.max(w[2], b[2]), Math.max(w[3], b[3])],
    [Infinity, Infinity, -Infinity, -Infinity]);
  const map = { selected: -1, colours: [], show: { cameras: false, photos: false, issues: true, backdrop: true }, sights: [] };
  const view = { x: 0, y: 0, perPixel: 1 };
  let isDirty = false;
  let backdrop = null;
  if (data.backdrop) loadBackdrop(data.backdrop).then((picture) => { backdrop = picture; map.redraw(); }, () => {});
  map.hasBackdrop = () => backdrop !== null;

  map.fit = () => {
    if (!Number.isFinite(whole[0])) return;
    view.x = (whole[0] + whole[2]) / 2;
    view.y = (whole[1] + whole[3]) / 2;
    view.perPixel = 1.12 * Math.max((whole[2] - whole[0]) / Math.max(canvas.clientWidth, 1),
      (whole[3] - whole[1]) / Math.max(canvas.clientHeight, 1), 0.01);
    map.redraw();
  };
  map.goTo = (x, y) => {
    const [px, py] = place(x, y);
    const isSeen = px > 40 && py > 40 && px < canvas.clientWidth - 40 && py < canvas.clientHeight - 40;
    if (!isSeen) [view.x, view.y] = [x, y];
    map.redraw();
  };
  const place = (x, y) => [
    (x - view.x) / view.perPixel + canvas.clientWidth / 2,
    canvas.clientHeight / 2 - (y - view.y) / view.perPixel,
  ];

  function trace(rings) {
    context.beginPath();
    for (const ring of rings) {
      for (let i = 0; i < ring.length; i += 2) {
        const [px, py] = place(ring[i], ring[i + 1]);
        if (i === 0) context.moveTo(px, py); else context.lineTo(px, py);
      }
      context.closePath();
    }
  }

  function drawBackdrop() {
    if (!backdrop || !map.show.backdrop) return;
    const [west, south, east, north] = data.backdrop.bounds;
    const [left, top] = place(west - ox, north - oy);
    const [right, bottom] = place(east - ox, south - oy);
    context.drawImage(backdrop, left, top, right - left, bottom - top);
  }

  function drawBuildings(ink) {
    const isOverPhoto = backdrop && map.show.backdrop;
    const thin = view.perPixel > 1.5 ? 0.35 : 0.8;
    footprints.forEach((rings, i) => {
      if (rings.length === 0) return;
      const [left, top] = place(boxes[i][0], boxes[i][3]);
      const [right, bottom] = place(boxes[i][2], boxes[i][1]);
      if (right < 0 || bottom < 0 || left > canvas.clientWidth || top > canvas.clientHeight) return;
      trace(rings);
      context.fillStyle = css(map.colours[i] ?? NO_VALUE);
      context.globalAlpha = isOverPhoto ? OVER_PHOTO : 1;
      context.fill("evenodd");
      context.globalAlpha = 1;
      const isDoubtful = data.buildings[i].status === "doubtful";
      context.strokeStyle = isDoubtful ? css(ALERT) : ink;
      context.lineWidth = isDoubtful ? 1.6 : thin;
      context.stroke();
    });
    if (map.selected >= 0 && footprints[map.selected].length > 0) {
      trace(footprints[map.selected]);
      context.strokeStyle = "#ff5a10";
      context.lineWidth = 4;
      context.stroke();
    }
  }

  function drawViews(ink) {
    if (map.show.photos) {
      context.strokeStyle = ink;
      context.globalAlpha = 0.35;
      context.lineWidth = 1;
      for (const v of data.views) trace([v.footprint.map((c, i) => c - (i % 2 ? oy : ox))]), context.stroke();
      context.globalAlpha = 1;
    }
    if (!map.show.cameras) return;
    for (const v of data.views) {
      const [px, py] = place(v.centre[0] - ox, v.centre[1] - oy);
      context.beginPath();
      context.arc(px, py, 3.2, 0, TAU);
      context.fillStyle = v.use === "measured" ? css(STATUS_COLOURS.measured) : css(NO_VALUE);
      context.strokeStyle = ink;
      context.lineWidth = 1;
      context.fill();
      context.stroke();
    }
  }

  function drawIssues() {
    if (!map.show.issues) return;
    for (const issue of data.issues) {
      if (!issue.place) continue;
      const [px, py] = place(issue.place[0] - ox, issue.place[1] - oy);
      context.beginPath();
      context.moveTo(px, py - 7); context.lineTo(px + 6, py + 4); context.lineTo(px - 6, py + 4); context.closePath();
      context.fillStyle = issue.severity === "note" ? css(STATUS_COLOURS.measured) : css(ALERT);
      context.strokeStyle = "#fff";
      context.lineWidth = 1.2;
      context.fill();
      context.stroke();
    }
  }

  function drawFrame(ink, paper) {
    const length = roundDown(0.25 * canvas.clientWidth * view.perPixel);
    const width = length / view.perPixel;
    const [left, y] = [16, canvas.clientHeight - 18];
    const label = length >= 1000 ? `${length / 1000} km` : `${length} m`;
    context.font = "13px system-ui, sans-serif";
    context.fillStyle = paper;
    context.globalAlpha = 0.86;
    context.fillRect(left - 8, y - 14, width + 24 + context.measureText(label).width, 26);
    context.fillRect(canvas.clientWidth - 46, 10, 34, 56);
    context.globalAlpha = 1;
    for (let i = 0; i < 4; i += 1) {
      context.fillStyle = i % 2 ? paper : ink;
      context.fillRect(left + (i * width) / 4, y - 4, width / 4, 7);
    }
    context.strokeStyle = ink;
    context.lineWidth = 1;
    context.strokeRect(left, y - 4, width, 7);
    context.fillStyle = ink;
    context.fillText(label, left + width + 8, y + 4);
    const x = canvas.clientWidth - 29;
    context.beginPath();
    context.moveTo(x, 16); context.lineTo(x + 9, 44); context.lineTo(x, 38); context.lineTo(x - 9, 44); context.closePath();
    context.fill();
    context.textAlign = "center";
    context.fillText("N", x, 60);
    context.textAlign = "left";
  }

  map.draw = () => {
    isDirty = false;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const size = [canvas.clientWidth * density, canvas.clientHeight * density].map((v) => Math.max(Math.round(v), 1));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim();
    const paper = style.getPropertyValue("--panel").trim();
    context.setTransform(density, 0, 0, density, 0, 0);
    context.fillStyle = paper;
    context.fillRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    drawBackdrop();
    drawBuildings(ink);
    drawViews(ink);
    drawIssues();
    drawFrame(ink, paper);
  };
  map.redraw = () => {
    if (isDirty) return;
    isDirty = true;
    requestAnimationFrame(map.draw);
  };

  // The building around a place, the last drawn first; -1 if there is none.
  map.at = (px, py) => {
    const x = (px - canvas.clientWidth / 2) * view.perPixel + view.x;
    const y = (canvas.clientHeight / 2 - py) * view.perPixel + view.y;
    for (let b = footprints.length - 1; b >= 0; b -= 1) {
      const box = boxes[b];
      if (x < box[0] || y < box[1] || x > box[2] || y > box[3]) continue;
      let inside = false;
      for (const ring of footprints[b]) {
        for (let i = 0, j = ring.length - 2; i < ring.length; j = i, i += 2) {
          const straddles = ring[i + 1] > y !== ring[j + 1] > y;
          if (straddles && x < ((ring[j] - ring[i]) * (y - ring[i + 1])) / (ring[j + 1] - ring[i + 1]) + ring[i]) inside = !inside;
        }
      }
      if (inside) return b;
    }
    return -1;
  };
  // Where the middle of a building is in the picture, CSS pixels.
  map.placeOf = (b) => place((boxes[b][0] + boxes[b][2]) / 2, (boxes[b][1] + boxes[b][3]) / 2);

  const zoom = (factor) => { view.perPixel = clamp(view.perPixel * factor, 0.005, 1000); map.redraw(); };
  const pointers = new Map();
  let travelled = 0;
  let span = 0;
  const placeIn = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, placeIn(event));
    if (pointers.size === 1) travelled = 0;
    span = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = placeIn(event);
    pointers.set(event.pointerId, now);
    travelled += Math.abs(now[0] - before[0]) + Math.abs(now[1] - before[1]);
    if (pointers.size === 2) {
      const [a, b] = [...pointers.values()];
      const next = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (span > 0) zoom(span / Math.max(next, 1));
      span = next;
    } else {
      view.x -= (now[0] - before[0]) * view.perPixel;
      view.y += (now[1] - before[1]) * view.perPixel;
      map.redraw();
    }
  });
  canvas.addEventListener("pointerup", (event) => {
    if (pointers.delete(event.pointerId) && travelled < CLICK_PX) on.pick(map.at(...placeIn(event)));
  });
  canvas.addEventListener("pointercancel", (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(clamp(event.deltaY, -200, 200) * 0.0015));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const step = 60 * view.perPixel;
    const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (moves[event.key]) { view.x += moves[event.key][0]; view.y += moves[event.key][1]; map.redraw(); }
    else if (event.key === "+" || event.key === "=") zoom(0.85);
    else if (event.key === "-") zoom(1.18);
    else if (event.key === "0") map.fit();
    else return;
    event.preventDefault();
  });
  return map;
}
