// Turning, moving and zooming by mouse, fingers and keys.

const CLICK_PX = 5;
const LOWEST_PITCH = 0.08;
const STRAIGHT_DOWN = Math.PI / 2;
// Direction of the first look at a city.
const OPENING = { yaw: 0.5, pitch: 0.5 };

// `on.pick(x, y)` and `on.hover(x, y)` get positions in CSS pixels; `on.key(event)` gets what is no movement.
function controlCamera(canvas, scene, on) {
  const { camera } = scene;
  const pointers = new Map();
  let travelled = 0;
  let pinch = null;

  const turn = (dx, dy) => {
    camera.yaw += dx;
    camera.pitch = clamp(camera.pitch + dy, LOWEST_PITCH, STRAIGHT_DOWN);
    scene.moved();
  };
  const move = (dx, dy) => {
    const perPixel = scene.metresPerPixel();
    const right = [Math.cos(camera.yaw), -Math.sin(camera.yaw)];
    const ahead = [Math.sin(camera.yaw), Math.cos(camera.yaw)];
    const forward = dy / Math.max(Math.sin(camera.pitch), 0.3);
    camera.target = [
      camera.target[0] - perPixel * (right[0] * dx - ahead[0] * forward),
      camera.target[1] - perPixel * (right[1] * dx - ahead[1] * forward),
      camera.target[2],
    ];
    scene.moved();
  };
  const zoom = (factor) => {
    camera.distance = clamp(camera.distance * factor, 5, 12 * scene.radius);
    scene.moved();
  };
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    if (pointers.size === 1) travelled = 0;
    pinch = null;
  });
  canvas.addEventListener("pointermove", (event) => {
    const now = place(event);
    const before = pointers.get(event.pointerId);
    if (!before) { on.hover(...now); return; }
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    travelled += Math.abs(dx) + Math.abs(dy);
    pointers.set(event.pointerId, now);
    if (pointers.size === 2) {
      const [a, b] = [...pointers.values()];
      const next = { span: Math.hypot(a[0] - b[0], a[1] - b[1]), middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] };
      if (pinch) {
        zoom(pinch.span / Math.max(next.span, 1));
        move(next.middle[0] - pinch.middle[0], next.middle[1] - pinch.middle[1]);
      }
      pinch = next;
    } else if (event.buttons & 6 || event.shiftKey || event.ctrlKey) move(dx, dy);
    else turn(0.006 * dx, 0.006 * dy);
  });
  const release = (event) => {
    if (pointers.delete(event.pointerId) && event.type === "pointerup" && travelled < CLICK_PX && pointers.size === 0) {
      on.pick(...place(event));
    }
    pinch = null;
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => on.hover(-1, -1));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    // A page that scrolls by is not a zoom: the picture is focused or Ctrl is held.
    if (document.activeElement !== canvas && !event.ctrlKey && !on.zoomsFreely) return;
    event.preventDefault();
    zoom(Math.exp(clamp(event.deltaY, -200, 200) * 0.0015));
  }, { passive: false });

  const keys = {
    ArrowLeft: (shift) => (shift ? move(40, 0) : turn(-0.1, 0)),
    ArrowRight: (shift) => (shift ? move(-40, 0) : turn(0.1, 0)),
    ArrowUp: (shift) => (shift ? move(0, 40) : turn(0, 0.08)),
    ArrowDown: (shift) => (shift ? move(0, -40) : turn(0, -0.08)),
    "+": () => zoom(0.85), "=": () => zoom(0.85), "-": () => zoom(1.18),
  };
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const act = keys[event.key];
    if (act) { act(event.shiftKey); event.preventDefault(); } else on.key(event);
  });
  return { turn, move, zoom };
}

// Moves the camera to another place within a moment, or at once where motion is not wanted.
function flyTo(scene, goal) {
  const start = { ...scene.camera, target: [...scene.camera.target] };
  const turn = ((((goal.yaw ?? start.yaw) - start.yaw) % TAU) + 3 * Math.PI) % TAU - Math.PI;
  const end = { target: start.target, pitch: start.pitch, distance: start.distance, ...goal, yaw: start.yaw + turn };
  const flight = {};
  scene.flight = flight;
  const at = (t) => {
    const s = t * t * (3 - 2 * t);
    for (const key of ["yaw", "pitch", "distance"]) scene.camera[key] = mix(start[key], end[key], s);
    scene.camera.target = start.target.map((v, i) => mix(v, end.target[i], s));
    scene.moved();
  };
  if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) { scene.flight = null; at(1); return; }
  const began = performance.now();
  const step = (now) => {
    if (scene.flight !== flight) return;
    const t = clamp((now - began) / 450, 0, 1);
    at(t);
    if (t < 1) requestAnimationFrame(step); else scene.flight = null;
  };
  requestAnimationFrame(step);
}
