// The city in 3D with WebGL 2: merged meshes, one colour per building from a texture, a shadow map that is drawn once,
// and picking by drawing ids into one pixel. Nothing is drawn unless something has changed.

const COLOURS_WIDE = 1024;
const SHADOW_PX = 2048;
const FIELD_OF_VIEW = 0.7;
// Direction to the sun: in the west, so that walls to the south and to the west differ.
const SUN = vec.unit([-0.72, 0.12, 0.66]);
// While the view moves, frames slower than this are drawn with less effort, milliseconds. Below certain efforts there are
// no edges and no shadows; the resolution goes down with the effort.
const SLOW_FRAME_MS = 30;
const LEAST_EFFORT = 0.4;
const EDGES_FROM = 0.85;
const SHADOWS_FROM = 0.65;

const FACE_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in float feature;
uniform mat4 clipFromLocal, shadowFromLocal;
uniform vec3 sun;
uniform float first, selected, hovered;
uniform sampler2D colours;
flat out vec3 lit, shaded;
out vec3 inShadow;
void main() {
  gl_Position = clipFromLocal * vec4(position, 1.0);
  inShadow = (shadowFromLocal * vec4(position, 1.0)).xyz * 0.5 + 0.5;
  float id = feature + first;
  int i = int(id + 0.5);
  vec3 colour = texelFetch(colours, ivec2(i % ${COLOURS_WIDE}, i / ${COLOURS_WIDE}), 0).rgb;
  if (abs(id - selected) < 0.5) colour = mix(colour, vec3(1.0, 0.32, 0.05), 0.75);
  else if (abs(id - hovered) < 0.5) colour = mix(colour, vec3(1.0), 0.3);
  float sky = 0.56 + 0.1 * normal.z;
  shaded = colour * sky;
  lit = colour * (sky + 0.5 * max(dot(normal, sun), 0.0));
}`;
const FACE_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
flat in vec3 lit, shaded;
in vec3 inShadow;
uniform sampler2DShadow shadow;
uniform bool hasShadow;
out vec4 colour;
void main() {
  float sun = hasShadow ? texture(shadow, vec3(inShadow.xy, inShadow.z - 0.0012)) : 1.0;
  colour = vec4(mix(shaded, lit, sun), 1.0);
}`;
const GROUND_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
uniform mat4 clipFromLocal, shadowFromLocal;
out vec3 inShadow;
out vec3 at;
void main() {
  gl_Position = clipFromLocal * vec4(position, 1.0);
  inShadow = (shadowFromLocal * vec4(position, 1.0)).xyz * 0.5 + 0.5;
  at = position;
}`;
const GROUND_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
in vec3 inShadow;
in vec3 at;
uniform sampler2DShadow shadow;
uniform bool hasShadow;
uniform vec3 paper, background, sun;
uniform float step, reach;
uniform vec2 centre;
out vec4 colour;
void main() {
  vec3 n = normalize(cross(dFdx(at), dFdy(at)));
  float slope = dot(n.z < 0.0 ? -n : n, sun) / sun.z;
  float inside = all(greaterThan(inShadow.xy, vec2(0.0))) && all(lessThan(inShadow.xy, vec2(1.0))) ? 1.0 : 0.0;
  float lit = hasShadow && inside > 0.5 ? texture(shadow, vec3(inShadow.xy, inShadow.z - 0.0012)) : 1.0;
  vec2 cell = at.xy / step;
  vec2 line = abs(fract(cell - 0.5) - 0.5) / fwidth(cell);
  float grid = 1.0 - clamp(min(line.x, line.y), 0.0, 1.0);
  vec3 c = paper * mix(1.0, clamp(slope, 0.5, 1.15), 0.7) * mix(0.66, 1.0, lit) * (1.0 - 0.09 * grid);
  colour = vec4(mix(c, background, smoothstep(0.75, 1.0, length(at.xy - centre) / reach)), 1.0);
}`;
const LINE_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 tint;
uniform mat4 clipFromLocal;
uniform vec4 ink;
uniform bool hasTint;
uniform float fadeFrom;
out vec4 paint;
void main() {
  gl_Position = clipFromLocal * vec4(position, 1.0);
  paint = hasTint ? tint : ink;
  if (!hasTint) paint.a *= clamp(fadeFrom / gl_Position.w, 0.12, 1.0);
}`;
const LINE_FRAGMENT = `#version 300 es
precision mediump float;
in vec4 paint;
out vec4 colour;
void main() { colour = paint; }`;
const DEPTH_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
uniform mat4 clipFromLocal;
void main() { gl_Position = clipFromLocal * vec4(position, 1.0); }`;
const DEPTH_FRAGMENT = `#version 300 es
precision mediump float;
void main() {}`;
const PICK_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 2) in float feature;
uniform mat4 clipFromLocal;
uniform float first;
flat out float id;
void main() {
  gl_Position = clipFromLocal * vec4(position, 1.0);
  id = feature + first + 1.0;
}`;
const PICK_FRAGMENT = `#version 300 es
precision highp float;
flat in float id;
out vec4 colour;
void main() {
  int i = int(id + 0.5);
  colour = vec4(float(i & 255), float((i >> 8) & 255), float((i >> 16) & 255), 255.0) / 255.0;
}`;

function programOf(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i += 1) {
    const { name } = gl.getActiveUniform(program, i);
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return { program, uniforms };
}

// Throws where WebGL 2 is missing. Smooth edges take twice the time without a graphics card.
function createScene(canvas, antialias) {
  const gl = canvas.getContext("webgl2", { antialias, preserveDrawingBuffer: true, powerPreference: "high-performance" });
  if (!gl) throw new Error("this browser has no WebGL 2");
  const programs = {
    face: programOf(gl, FACE_VERTEX, FACE_FRAGMENT),
    ground: programOf(gl, GROUND_VERTEX, GROUND_FRAGMENT),
    line: programOf(gl, LINE_VERTEX, LINE_FRAGMENT),
    depth: programOf(gl, DEPTH_VERTEX, DEPTH_FRAGMENT),
    pick: programOf(gl, PICK_VERTEX, PICK_FRAGMENT),
  };
  const colours = gl.createTexture();
  const shadow = shadowTarget(gl);
  const pickTarget = pixelTarget(gl);
  const chunks = new Set();
  const lines = new Map();
  const scene = {
    gl, chunks, lines,
    camera: { target: [0, 0, 0], yaw: 0.6, pitch: 0.7, distance: 500 },
    look: { paper: [0.93, 0.92, 0.9], background: [1, 1, 1], ink: [0.1, 0.1, 0.14] },
    show: { buildings: true, edges: true, ground: true, shadows: true },
    // The ball that everything stands in.
    centre: [0, 0, 0], radius: 100,
    selected: -1, hovered: -1, ground: null,
    onframe: null,
  };
  let isDirty = false;
  let isShadowStale = true;
  let effort = 1;
  let moving = 0;
  let last = 0;

  function upload(target, data, usage = gl.STATIC_DRAW) {
    const buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, data, usage);
    return buffer;
  }

  function attribute(location, data, size, type = gl.FLOAT, normalised = false, stride = 0) {
    const buffer = upload(gl.ARRAY_BUFFER, data);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, type, normalised, stride, 0);
    return buffer;
  }

  // A mesh of buildings: `first` is added to its features to give their numbers in the city.
  scene.addChunk = (mesh, first = 0) => {
    const [low, high] = boundsOf(mesh.positions);
    const ball = { centre: low.map((v, i) => (v + high[i]) / 2), radius: vec.length(vec.sub(high, low)) / 2 };
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const isBytes = mesh.normals instanceof Int8Array;
    const buffers = [
      attribute(0, mesh.positions, 3),
      isBytes ? attribute(1, mesh.normals, 3, gl.BYTE, true, 4) : attribute(1, mesh.normals, 3),
      attribute(2, mesh.features, 1),
      upload(gl.ELEMENT_ARRAY_BUFFER, mesh.indices),
    ];
    const edges = gl.createVertexArray();
    gl.bindVertexArray(edges);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[0]);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    buffers.push(upload(gl.ELEMENT_ARRAY_BUFFER, mesh.edges));
    gl.bindVertexArray(null);
    const chunk = { array, edges, buffers, first, nIndices: mesh.indices.length, nEdges: mesh.edges.length, ball };
    chunks.add(chunk);
    isShadowStale = true;
    scene.redraw();
    return chunk;
  };

  scene.removeChunk = (chunk) => {
    chunk.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    gl.deleteVertexArray(chunk.array);
    gl.deleteVertexArray(chunk.edges);
    chunks.delete(chunk);
    isShadowStale = true;
    scene.redraw();
  };

  scene.setGround = (mesh) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    attribute(0, mesh.positions, 3);
    upload(gl.ELEMENT_ARRAY_BUFFER, mesh.indices);
    gl.bindVertexArray(null);
    scene.ground = { array, nIndices: mesh.indices.length };
    scene.redraw();
  };

  // A layer of straight lines: two positions and two colours (RGBA, bytes) each.
  scene.setLines = (name, positions, tints, isVisible) => {
    const old = lines.get(name);
    if (old) { old.buffers.forEach((buffer) => gl.deleteBuffer(buffer)); gl.deleteVertexArray(old.array); }
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [attribute(0, new Float32Array(positions), 3), attribute(1, new Uint8Array(tints), 4, gl.UNSIGNED_BYTE, true)];
    gl.bindVertexArray(null);
    lines.set(name, { array, buffers, count: positions.length / 3, isVisible: isVisible ?? old?.isVisible ?? true });
    scene.redraw();
  };

  scene.showLines = (name, isVisible) => {
    if (lines.has(name)) lines.get(name).isVisible = isVisible;
    scene.redraw();
  };

  // Colours of buildings from number `first` on, red, green and blue bytes each.
  let texels = new Uint8Array(0);
  scene.setColours = (rgb, first = 0) => {
    const row = 4 * COLOURS_WIDE;
    const high = Math.max(Math.ceil((first + rgb.length) / COLOURS_WIDE), 1);
    gl.bindTexture(gl.TEXTURE_2D, colours);
    const isGrown = high * row > texels.length;
    if (isGrown) {
      const grown = new Uint8Array(Math.max(high, (2 * texels.length) / row) * row);
      grown.set(texels);
      texels = grown;
    }
    rgb.forEach((c, i) => texels.set(c, 4 * (first + i)));
    if (isGrown) {
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, COLOURS_WIDE, texels.length / row, 0, gl.RGBA, gl.UNSIGNED_BYTE, texels);
      for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
    } else {
      const top = Math.floor(first / COLOURS_WIDE);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, top, COLOURS_WIDE, high - top, gl.RGBA, gl.UNSIGNED_BYTE, texels.subarray(top * row, high * row));
    }
    scene.redraw();
  };

  // Where the camera stands, and what brings positions to the picture.
  scene.eye = () => {
    const { target, yaw, pitch, distance } = scene.camera;
    const level = Math.cos(pitch);
    return vec.add(target, vec.scale([-Math.sin(yaw) * level, -Math.cos(yaw) * level, Math.sin(pitch)], distance));
  };
  scene.clipFromLocal = () => {
    const { target, yaw, pitch, distance } = scene.camera;
    // Straight down, north or the line of sight's bearing is up in the picture.
    const up = [Math.sin(yaw) * Math.sin(pitch), Math.cos(yaw) * Math.sin(pitch), Math.cos(pitch)];
    const far = distance + 6 * scene.radius;
    const near = Math.max(distance / 60, 0.5);
    const aspect = canvas.clientWidth / Math.max(canvas.clientHeight, 1);
    return mat.multiply(mat.perspective(FIELD_OF_VIEW, aspect, near, far), mat.lookAt(scene.eye(), target, up));
  };
  scene.metresPerPixel = () => (2 * scene.camera.distance * Math.tan(FIELD_OF_VIEW / 2)) / Math.max(canvas.clientHeight, 1);

  function use({ program, uniforms }, clipFromLocal) {
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.clipFromLocal, false, clipFromLocal);
    return uniforms;
  }

  function shadowFromLocal() {
    const r = scene.radius * 1.05;
    const view = mat.lookAt(vec.add(scene.centre, vec.scale(SUN, 2 * r)), scene.centre, [0, 0, 1]);
    return mat.multiply(mat.orthographic(r, r, 0.5 * r, 3.5 * r), view);
  }

  function drawShadow(matrix) {
    gl.bindFramebuffer(gl.FRAMEBUFFER, shadow.frame);
    gl.viewport(0, 0, SHADOW_PX, SHADOW_PX);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 4);
    use(programs.depth, matrix);
    for (const chunk of chunks) {
      gl.bindVertexArray(chunk.array);
      gl.drawElements(gl.TRIANGLES, chunk.nIndices, gl.UNSIGNED_INT, 0);
    }
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    isShadowStale = false;
  }

  function lighting(uniforms, shadowMatrix) {
    gl.uniformMatrix4fv(uniforms.shadowFromLocal, false, shadowMatrix);
    gl.uniform3fv(uniforms.sun, SUN);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, shadow.texture);
    gl.uniform1i(uniforms.shadow, 1);
    gl.uniform1i(uniforms.hasShadow, scene.show.shadows && scene.show.buildings && effort >= SHADOWS_FROM ? 1 : 0);
    gl.activeTexture(gl.TEXTURE0);
  }

  function drawGround(clip, shadowMatrix) {
    const u = use(programs.ground, clip);
    lighting(u, shadowMatrix);
    gl.uniform3fv(u.paper, scene.look.paper);
    gl.uniform3fv(u.background, scene.look.background);
    gl.uniform1f(u.step, roundDown(Math.max(scene.radius / 4, 1)));
    gl.uniform2f(u.centre, scene.centre[0], scene.centre[1]);
    gl.uniform1f(u.reach, scene.groundReach ?? 3 * scene.radius);
    gl.bindVertexArray(scene.ground.array);
    gl.drawElements(gl.TRIANGLES, scene.ground.nIndices, gl.UNSIGNED_INT, 0);
  }

  function drawFaces(clip, shadowMatrix) {
    const u = use(programs.face, clip);
    lighting(u, shadowMatrix);
    gl.bindTexture(gl.TEXTURE_2D, colours);
    gl.uniform1i(u.colours, 0);
    gl.uniform1f(u.selected, scene.selected);
    gl.uniform1f(u.hovered, scene.hovered);
    // Edges lie on faces: these step back a little.
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 2);
    drawTriangles(u, clip);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  function drawTriangles(uniforms, clip) {
    gl.enable(gl.CULL_FACE);
    for (const chunk of chunks) {
      if (!inSight(clip, chunk.ball.centre, chunk.ball.radius)) continue;
      gl.uniform1f(uniforms.first, chunk.first);
      gl.bindVertexArray(chunk.array);
      gl.drawElements(gl.TRIANGLES, chunk.nIndices, gl.UNSIGNED_INT, 0);
    }
    gl.disable(gl.CULL_FACE);
  }

  function drawLines(clip) {
    const u = use(programs.line, clip);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE);
    if (scene.show.buildings && scene.show.edges && effort >= EDGES_FROM) {
      gl.uniform1i(u.hasTint, 0);
      gl.uniform4f(u.ink, ...scene.look.ink, 0.75);
      gl.uniform1f(u.fadeFrom, 350);
      for (const chunk of chunks) {
        if (!inSight(clip, chunk.ball.centre, chunk.ball.radius)) continue;
        gl.bindVertexArray(chunk.edges);
        gl.drawElements(gl.LINES, chunk.nEdges, gl.UNSIGNED_INT, 0);
      }
    }
    gl.uniform1i(u.hasTint, 1);
    for (const set of lines.values()) {
      if (!set.isVisible || set.count === 0) continue;
      gl.bindVertexArray(set.array);
      gl.drawArrays(gl.LINES, 0, set.count);
    }
    gl.disable(gl.BLEND);
  }

  scene.draw = () => {
    const density = Math.min(window.devicePixelRatio || 1, 2) * effort;
    const width = Math.max(Math.round(canvas.clientWidth * density), 1);
    const height = Math.max(Math.round(canvas.clientHeight * density), 1);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const shadowMatrix = shadowFromLocal();
    if (isShadowStale && scene.show.shadows) drawShadow(shadowMatrix);
    const clip = scene.clipFromLocal();
    gl.viewport(0, 0, width, height);
    gl.clearColor(...scene.look.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    if (scene.ground && scene.show.ground) drawGround(clip, shadowMatrix);
    if (scene.show.buildings) drawFaces(clip, shadowMatrix);
    drawLines(clip);
    gl.bindVertexArray(null);
    scene.onframe?.(clip);
  };

  function frame(now) {
    isDirty = false;
    if (moving > 0) {
      const took = now - last;
      // Two frames in a row: the time between them is what a frame costs.
      if (last > 0 && took < 1000) effort = clamp(effort * (took > SLOW_FRAME_MS ? 0.8 : 1.02), LEAST_EFFORT, 1);
      last = now;
    }
    scene.draw();
  }

  scene.redraw = () => {
    if (isDirty) return;
    isDirty = true;
    requestAnimationFrame(frame);
  };

  // The view moves: with as little effort as it takes to keep up, and in full again once it rests.
  scene.moved = () => {
    clearTimeout(moving);
    moving = setTimeout(() => { moving = 0; last = 0; effort = 1; scene.redraw(); }, 180);
    scene.redraw();
  };

  // The building at a position of the canvas, CSS pixels; -1 if there is none.
  scene.pick = (x, y) => {
    if (!scene.show.buildings) return -1;
    const ndc = [(2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight];
    const zoom = mat.zoomTo(ndc[0], ndc[1], canvas.clientWidth, canvas.clientHeight);
    gl.bindFramebuffer(gl.FRAMEBUFFER, pickTarget);
    gl.viewport(0, 0, 1, 1);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const clip = mat.multiply(zoom, scene.clipFromLocal());
    drawTriangles(use(programs.pick, clip), clip);
    gl.bindVertexArray(null);
    const pixel = new Uint8Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return pixel[0] + 256 * pixel[1] + 65536 * pixel[2] - 1;
  };

  // Draws so many frames one after the other, each waited for, with an effort up to 1; frames per second.
  scene.measure = (nFrames, withEffort = 1) => {
    effort = withEffort;
    scene.draw();
    const pixel = new Uint8Array(4);
    const start = performance.now();
    for (let i = 0; i < nFrames; i += 1) {
      scene.camera.yaw += 0.02;
      scene.draw();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    }
    const seconds = (performance.now() - start) / 1000;
    effort = 1;
    scene.redraw();
    return nFrames / seconds;
  };
  scene.setColours([]);
  return scene;
}

function shadowTarget(gl) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_PX, SHADOW_PX);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
  for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
  const frame = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, texture, 0);
  gl.drawBuffers([gl.NONE]);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return { texture, frame };
}

function pixelTarget(gl) {
  const frame = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  for (const [format, point] of [[gl.RGBA8, gl.COLOR_ATTACHMENT0], [gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]]) {
    const buffer = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, format, 1, 1);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, point, gl.RENDERBUFFER, buffer);
  }
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return frame;
}
