// The city in 3D with WebGL 2: merged meshes, one colour per building from a texture, a shadow map that is drawn once,
// and picking by drawing ids into one pixel. Nothing is drawn unless something has changed.
//
// While the view moves and the machine cannot keep up, small buildings are drawn as boxes, one point each; below certain
// efforts there are no edges and no shadows, and the resolution goes down with the effort.

const FIELD_OF_VIEW = 0.7;
// Direction to the sun: in the west, so that walls to the south and to the west differ.
const SUN = vec.unit([-0.72, 0.12, 0.66]);
const EDGES_FROM = 0.85;
const SHADOWS_FROM = 0.65;
// Share of the picture that the city fills at first.
const FILLED = 0.9;
// Buildings smaller than this are boxes in a simple picture, pixels of the canvas.
const BOX_PX = 18;

class Scene {
  // Throws where WebGL 2 is missing. Smooth edges take twice the time without a graphics card.
  constructor(canvas, antialias) {
    const gl = canvas.getContext("webgl2", { antialias, preserveDrawingBuffer: true, powerPreference: "high-performance" });
    if (!gl) throw new Error("this browser has no WebGL 2");
    Object.assign(this, {
      canvas, gl,
      programs: programsOf(gl),
      colours: colourTable(gl),
      shadow: shadowTarget(gl),
      pickTarget: pixelTarget(gl),
      chunks: new Set(),
      photoChunks: new Set(),
      lines: new Map(),
      camera: { target: [0, 0, 0], yaw: 0.6, pitch: 0.7, distance: 500 },
      look: { paper: [0.93, 0.92, 0.9], background: [1, 1, 1], ink: [0.1, 0.1, 0.14] },
      show: { buildings: true, edges: true, ground: true, shadows: true },
      // Whether faces have the colours of photos where there are some, and pictures that are not decoded yet.
      hasPhotos: false, nPending: 0,
      // The ball that everything stands in.
      centre: [0, 0, 0], radius: 100,
      selected: -1, hovered: -1, ground: null,
      onframe: null,
      // The flight to another place that is under way.
      flight: null,
      isDirty: false, isShadowStale: true,
    });
    this.pace = new Pace({ rest: () => this.redraw(), slow: () => this.chunks.forEach((chunk) => this.addBoxes(chunk)) });
    this.setColours([]);
  }

  // A mesh of buildings: `first` is added to its features to give their numbers in the city.
  addChunk(mesh, first = 0) {
    const { gl } = this;
    const [low, high] = boundsOf(mesh.positions);
    const ball = { centre: low.map((v, i) => (v + high[i]) / 2), radius: vec.length(vec.sub(high, low)) / 2 };
    const isBytes = mesh.normals instanceof Int8Array;
    const normals = isBytes ? [mesh.normals, 3, gl.BYTE, true, 4] : [mesh.normals, 3];
    const faces = vertexArray(gl, [[mesh.positions, 3], normals, [mesh.features, 1]], mesh.indices);
    const edges = vertexArray(gl, [[faces.buffers[0], 3]], mesh.edges);
    const chunk = { faces, edges, boxes: null, mesh, first, nIndices: mesh.indices.length, nEdges: mesh.edges.length, ball, pictures: [] };
    if (mesh.ranges && isTextured(mesh)) this.addPictures(chunk, mesh);
    if (this.pace.isSlow) this.addBoxes(chunk);
    this.chunks.add(chunk);
    this.isShadowStale = true;
    this.redraw();
    return chunk;
  }

  // A mesh that is seen with the colours of photos only; instead of a chunk of `replaced`, and of the ground.
  addPhotoChunk(mesh) {
    const [low, high] = boundsOf(mesh.positions);
    const ball = { centre: low.map((v, i) => (v + high[i]) / 2), radius: vec.length(vec.sub(high, low)) / 2 };
    const vertices = mesh.features ? [[mesh.positions, 3], [mesh.normals, 3], [mesh.features, 1]] : [[mesh.positions, 3]];
    const chunk = { faces: vertexArray(this.gl, vertices, mesh.indices), first: 0, ball, pictures: [], isGround: !mesh.features };
    this.addPictures(chunk, mesh);
    this.photoChunks.add(chunk);
    this.redraw();
    return chunk;
  }

  // The pictures of a chunk, and places on them.
  addPictures(chunk, mesh) {
    const { gl } = this;
    gl.bindVertexArray(chunk.faces.array);
    const places = upload(gl, gl.ARRAY_BUFFER, mesh.uv);
    gl.enableVertexAttribArray(3);
    gl.vertexAttribPointer(3, 2, gl.FLOAT, false, 0, 0);
    gl.bindVertexArray(null);
    chunk.faces.buffers.push(places);
    chunk.hasFeatures = Boolean(mesh.features);
    chunk.pictures = mesh.ranges.map(({ first, count, picture }) => {
      this.nPending += 1;
      const decoded = () => { this.nPending -= 1; this.redraw(); };
      return { first, count, texture: pictureTexture(gl, picture, decoded) };
    });
  }

  removePhotoChunk(chunk) {
    release(this.gl, chunk.faces);
    chunk.pictures.forEach(({ texture }) => this.gl.deleteTexture(texture));
    this.photoChunks.delete(chunk);
    this.redraw();
  }

  removeChunk(chunk) {
    for (const part of [chunk.faces, chunk.edges, chunk.boxes]) if (part) release(this.gl, part);
    chunk.pictures.forEach(({ texture }) => this.gl.deleteTexture(texture));
    this.chunks.delete(chunk);
    this.isShadowStale = true;
    this.redraw();
  }

  setGround(mesh, isTerrain = false) {
    this.ground = { ...vertexArray(this.gl, [[mesh.positions, 3]], mesh.indices), nIndices: mesh.indices.length, isTerrain };
    this.redraw();
  }

  // A layer of straight lines: two positions and two colours (RGBA, bytes) each.
  setLines(name, positions, tints, isVisible) {
    const { gl, lines } = this;
    const old = lines.get(name);
    if (old) release(gl, old);
    const made = vertexArray(gl, [[new Float32Array(positions), 3], [new Uint8Array(tints), 4, gl.UNSIGNED_BYTE, true]]);
    lines.set(name, { ...made, count: positions.length / 3, isVisible: isVisible ?? old?.isVisible ?? true });
    this.redraw();
  }

  showLines(name, isVisible) {
    if (this.lines.has(name)) this.lines.get(name).isVisible = isVisible;
    this.redraw();
  }

  // Colours of buildings from number `first` on, red, green and blue bytes each.
  setColours(rgb, first = 0) {
    this.colours.set(rgb, first);
    this.redraw();
  }

  // Where the camera stands and how it is turned; what brings positions to the picture.
  pose({ target, yaw, pitch, distance } = this.camera) {
    const [level, steep] = [Math.cos(pitch), Math.sin(pitch)];
    const forward = [Math.sin(yaw) * level, Math.cos(yaw) * level, -steep];
    // Straight down, north or the line of sight's bearing is up in the picture.
    const up = [Math.sin(yaw) * steep, Math.cos(yaw) * steep, level];
    return { eye: vec.sub(target, vec.scale(forward, distance)), forward, right: vec.cross(forward, up), up };
  }

  // The camera that looks into a direction and shows some points as large as they fit, in the middle of the picture.
  fitted(points, { yaw, pitch }) {
    const { forward, right, up } = this.pose({ target: [0, 0, 0], yaw, pitch, distance: 0 });
    const tall = FILLED * Math.tan(FIELD_OF_VIEW / 2);
    const depths = points.map((p) => vec.dot(p, forward));
    // A point is in the picture where |(p - eye) · axis| <= reach · (p - eye) · forward.
    const along = (axis, reach) => {
      const side = (sign) => Math.max(...points.map((p, i) => sign * vec.dot(p, axis) - reach * depths[i]));
      const [a, b] = [side(1), side(-1)];
      return { place: (a - b) / 2, depth: -(a + b) / (2 * reach) };
    };
    const [across, upwards] = [along(right, tall * this.aspect()), along(up, tall)];
    const depth = Math.min(across.depth, upwards.depth);
    const eye = vec.add(vec.add(vec.scale(right, across.place), vec.scale(up, upwards.place)), vec.scale(forward, depth));
    // The target lies on the ground: coming closer would lead beneath it, or over the city, otherwise.
    const distance = Math.max((eye[2] - Math.min(...points.map((p) => p[2]))) / -forward[2], 20);
    return { target: vec.add(eye, vec.scale(forward, distance)), yaw, pitch, distance };
  }

  depthRange() {
    const { distance } = this.camera;
    return { near: Math.max(distance / 60, 0.5), far: distance + 6 * this.radius };
  }

  aspect() { return this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1); }

  eye() { return this.pose().eye; }

  clipFromLocal() {
    const { eye, up } = this.pose();
    const { near, far } = this.depthRange();
    return mat.multiply(mat.perspective(FIELD_OF_VIEW, this.aspect(), near, far), mat.lookAt(eye, this.camera.target, up));
  }

  metresPerPixel() {
    return (2 * this.camera.distance * Math.tan(FIELD_OF_VIEW / 2)) / Math.max(this.canvas.clientHeight, 1);
  }

  use({ program, uniforms }, clip) {
    this.gl.useProgram(program);
    this.gl.uniformMatrix4fv(uniforms.clipFromLocal, false, clip);
    return uniforms;
  }

  shadowFromLocal() {
    const r = this.radius * 1.05;
    const view = mat.lookAt(vec.add(this.centre, vec.scale(SUN, 2 * r)), this.centre, [0, 0, 1]);
    return mat.multiply(mat.orthographic(r, r, 0.5 * r, 3.5 * r), view);
  }

  drawShadow(matrix) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow.frame);
    gl.viewport(0, 0, SHADOW_PX, SHADOW_PX);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 4);
    this.use(this.programs.depth, matrix);
    for (const chunk of this.chunks) {
      gl.bindVertexArray(chunk.faces.array);
      gl.drawElements(gl.TRIANGLES, chunk.nIndices, gl.UNSIGNED_INT, 0);
    }
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.isShadowStale = false;
  }

  lighting(uniforms, shadowMatrix) {
    const { gl, show } = this;
    gl.uniformMatrix4fv(uniforms.shadowFromLocal, false, shadowMatrix);
    gl.uniform3fv(uniforms.sun, SUN);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.shadow.texture);
    gl.uniform1i(uniforms.shadow, 1);
    gl.uniform1i(uniforms.hasShadow, show.shadows && show.buildings && this.pace.effort >= SHADOWS_FROM ? 1 : 0);
    gl.activeTexture(gl.TEXTURE0);
  }

  colouring(uniforms) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.colours.texture);
    gl.uniform1i(uniforms.colours, 0);
    gl.uniform1f(uniforms.selected, this.selected);
    gl.uniform1f(uniforms.hovered, this.hovered);
  }

  drawGround(clip, shadowMatrix) {
    const { gl, look, ground } = this;
    const u = this.use(this.programs.ground, clip);
    this.lighting(u, shadowMatrix);
    gl.uniform3fv(u.paper, look.paper);
    gl.uniform3fv(u.background, look.background);
    gl.uniform1f(u.step, roundDown(Math.max(this.radius / 4, 1)));
    gl.uniform2f(u.centre, this.centre[0], this.centre[1]);
    gl.uniform1f(u.reach, this.groundReach ?? 3 * this.radius);
    gl.bindVertexArray(ground.array);
    gl.drawElements(gl.TRIANGLES, ground.nIndices, gl.UNSIGNED_INT, 0);
  }

  drawFaces(clip, shadowMatrix, chunks) {
    const { gl } = this;
    const u = this.use(this.programs.face, clip);
    this.lighting(u, shadowMatrix);
    this.colouring(u);
    // Edges lie on faces: these step back a little.
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 2);
    this.drawTriangles(u, chunks);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  // Faces with the colours of photos.
  drawPhotos(clip, chunks) {
    if (chunks.length === 0) return;
    const { gl } = this;
    const u = this.use(this.programs.photo, clip);
    gl.uniform1f(u.selected, this.selected);
    gl.uniform1f(u.hovered, this.hovered);
    gl.uniform1i(u.picture, 0);
    gl.enable(gl.CULL_FACE);
    for (const chunk of chunks) {
      gl.uniform1f(u.first, chunk.first);
      gl.uniform1i(u.hasFeatures, chunk.hasFeatures ? 1 : 0);
      gl.bindVertexArray(chunk.faces.array);
      for (const { first, count, texture } of chunk.pictures) {
        gl.bindTexture(gl.TEXTURE_2D, texture);
        gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * first);
      }
    }
    gl.disable(gl.CULL_FACE);
  }

  drawTriangles(uniforms, chunks) {
    const { gl } = this;
    gl.enable(gl.CULL_FACE);
    for (const chunk of chunks) {
      gl.uniform1f(uniforms.first, chunk.first);
      gl.bindVertexArray(chunk.faces.array);
      gl.drawElements(gl.TRIANGLES, chunk.nIndices, gl.UNSIGNED_INT, 0);
    }
    gl.disable(gl.CULL_FACE);
  }

  drawBoxes(clip, chunks) {
    if (chunks.length === 0) return;
    const { gl, canvas } = this;
    const u = this.use(this.programs.box, clip);
    this.colouring(u);
    const { eye, forward, right, up } = this.pose();
    const tall = Math.tan(FIELD_OF_VIEW / 2);
    const across = vec.scale(right, tall * this.aspect());
    const upwards = vec.scale(up, tall);
    const { near, far } = this.depthRange();
    gl.uniform3fv(u.eye, eye);
    gl.uniform3fv(u.sun, SUN);
    gl.uniform1f(u.focalPx, canvas.height / (2 * tall));
    gl.uniform3fv(u.ray, vec.sub(vec.sub(forward, across), upwards));
    gl.uniform3fv(u.rayPerX, vec.scale(across, 2 / canvas.width));
    gl.uniform3fv(u.rayPerY, vec.scale(upwards, 2 / canvas.height));
    gl.uniform2f(u.depths, far / (far - near), (-far * near) / (far - near));
    for (const chunk of chunks) {
      gl.uniform1f(u.first, chunk.first);
      gl.bindVertexArray(chunk.boxes.array);
      gl.drawArrays(gl.POINTS, 0, chunk.boxes.count);
    }
  }

  // The same with boxes instead of faces where a chunk's buildings are small enough.
  splitBySize(chunks) {
    const { eye } = this.pose();
    const focalPx = this.canvas.height / (2 * Math.tan(FIELD_OF_VIEW / 2));
    const isSmall = (chunk) => {
      this.addBoxes(chunk);
      const away = Math.max(vec.length(vec.sub(chunk.ball.centre, eye)) - chunk.ball.radius, 1);
      return (chunk.boxes.sizeM * focalPx) / away < BOX_PX;
    };
    return [chunks.filter((chunk) => !isSmall(chunk)), chunks.filter(isSmall)];
  }

  addBoxes(chunk) {
    if (chunk.boxes) return;
    const { places, reaches, features, sizeM } = boxesOfMesh(chunk.mesh);
    chunk.boxes = { ...vertexArray(this.gl, [[places, 4], [reaches, 4], [features, 1]]), count: features.length, sizeM };
    chunk.mesh = null;
  }

  drawLines(clip, chunks) {
    const { gl, show } = this;
    const u = this.use(this.programs.line, clip);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE);
    if (show.buildings && show.edges && this.pace.effort >= EDGES_FROM) {
      gl.uniform1i(u.hasTint, 0);
      gl.uniform4f(u.ink, ...this.look.ink, 0.75);
      gl.uniform1f(u.fadeFrom, 350);
      for (const chunk of chunks) {
        gl.bindVertexArray(chunk.edges.array);
        gl.drawElements(gl.LINES, chunk.nEdges, gl.UNSIGNED_INT, 0);
      }
    }
    gl.uniform1i(u.hasTint, 1);
    for (const set of this.lines.values()) {
      if (!set.isVisible || set.count === 0) continue;
      gl.bindVertexArray(set.array);
      gl.drawArrays(gl.LINES, 0, set.count);
    }
    gl.disable(gl.BLEND);
  }

  inSight(clip) {
    return [...this.chunks].filter(({ ball, isHidden }) => !isHidden && inSight(clip, ball.centre, ball.radius));
  }

  resize() {
    const { canvas } = this;
    const density = Math.min(window.devicePixelRatio || 1, 2) * this.pace.effort;
    const width = Math.max(Math.round(canvas.clientWidth * density), 1);
    const height = Math.max(Math.round(canvas.clientHeight * density), 1);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  }

  // `isSimple`: small buildings as boxes, without edges.
  draw(isSimple = this.pace.isSimple) {
    const { gl, show } = this;
    this.resize();
    const shadowMatrix = this.shadowFromLocal();
    if (this.isShadowStale && show.shadows) this.drawShadow(shadowMatrix);
    const clip = this.clipFromLocal();
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...this.look.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    const seen = show.buildings ? this.inSight(clip) : [];
    const isPhoto = (chunk) => this.hasPhotos && (chunk.isReplaced || chunk.pictures.length > 0);
    const plain = seen.filter((chunk) => !isPhoto(chunk));
    const [large, small] = isSimple ? this.splitBySize(plain) : [plain, []];
    const photos = this.hasPhotos ? [...this.photoChunks].filter(({ isGround, isHidden }) => !isHidden && (isGround ? show.ground : show.buildings)) : [];
    if (this.ground && show.ground && !photos.some(({ isGround }) => isGround && this.ground.isTerrain)) this.drawGround(clip, shadowMatrix);
    this.drawFaces(clip, shadowMatrix, large);
    this.drawBoxes(clip, small);
    this.drawPhotos(clip, [...photos, ...seen.filter((chunk) => isPhoto(chunk) && chunk.pictures.length > 0)]);
    this.drawLines(clip, large);
    gl.bindVertexArray(null);
    this.pace.watch(gl);
    this.onframe?.(clip);
  }

  redraw() {
    if (this.isDirty) return;
    this.isDirty = true;
    requestAnimationFrame((now) => {
      this.isDirty = false;
      this.pace.frame(now);
      this.draw();
    });
  }

  // The view moves: with as little effort as it takes to keep up, and in full again once it rests.
  moved() {
    this.pace.moved();
    this.redraw();
  }

  // The building at a position of the canvas, CSS pixels; -1 if there is none.
  pick(x, y) {
    if (!this.show.buildings) return -1;
    const { gl, canvas } = this;
    const ndc = [(2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight];
    const zoom = mat.zoomTo(ndc[0], ndc[1], canvas.clientWidth, canvas.clientHeight);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.pickTarget);
    gl.viewport(0, 0, 1, 1);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const clip = mat.multiply(zoom, this.clipFromLocal());
    this.drawTriangles(this.use(this.programs.pick, clip), this.inSight(clip));
    gl.bindVertexArray(null);
    const pixel = new Uint8Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return pixel[0] + 256 * pixel[1] + 65536 * pixel[2] - 1;
  }

  // Draws so many frames one after the other, each waited for, in full or with a lesser effort; frames per second.
  measure(nFrames, effort = 1) {
    this.pace.effort = effort;
    const pixel = new Uint8Array(4);
    const one = () => {
      this.camera.yaw += 0.02;
      this.draw(effort < 1);
      this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, pixel);
    };
    one();
    const start = performance.now();
    for (let i = 0; i < nFrames; i += 1) one();
    const seconds = (performance.now() - start) / 1000;
    this.pace.effort = 1;
    this.redraw();
    return nFrames / seconds;
  }

  // Turns as under a hand for some seconds; what came of it: frames per second, the effort at the end.
  async turn(seconds) {
    const nextFrame = () => new Promise((resolve) => { requestAnimationFrame(resolve); });
    const start = await nextFrame();
    let [now, n] = [start, 0];
    while (now - start < 1000 * seconds) {
      this.camera.yaw += 0.01;
      this.moved();
      now = await nextFrame();
      n += 1;
    }
    return { framesPerSecond: (1000 * n) / (now - start), effort: this.pace.moving };
  }
}
