// Buffers, textures and targets on the graphics card.

const SHADOW_PX = 2048;

function upload(gl, target, data) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(target, buffer);
  gl.bufferData(target, data, gl.STATIC_DRAW);
  return buffer;
}

// An array of vertices: one buffer per attribute, `[data, size, type, normalised, stride]` each, and indices.
function vertexArray(gl, attributes, indices = null) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const buffers = attributes.map(([data, size, type = gl.FLOAT, normalised = false, stride = 0], location) => {
    const buffer = data instanceof WebGLBuffer ? data : upload(gl, gl.ARRAY_BUFFER, data);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, type, normalised, stride, 0);
    return buffer;
  });
  if (indices) buffers.push(upload(gl, gl.ELEMENT_ARRAY_BUFFER, indices));
  gl.bindVertexArray(null);
  return { array, buffers };
}

function release(gl, { array, buffers }) {
  buffers.forEach((buffer) => gl.deleteBuffer(buffer));
  gl.deleteVertexArray(array);
}

// A picture as a texture: of photos with smaller copies of it, of plain colours pixel by pixel. It is grey until it is decoded.
function pictureTexture(gl, { blob, isPhoto }, decoded) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([200, 200, 200, 255]));
  for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  createImageBitmap(blob).then((picture) => {
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    if (isPhoto) {
      gl.generateMipmap(gl.TEXTURE_2D);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
      const sharp = gl.getExtension("EXT_texture_filter_anisotropic");
      if (sharp) gl.texParameterf(gl.TEXTURE_2D, sharp.TEXTURE_MAX_ANISOTROPY_EXT, 4);
    }
    decoded(picture.width * picture.height);
    picture.close();
  });
  return texture;
}

// One colour per building, red, green and blue bytes each, from number `first` on.
function colourTable(gl) {
  const texture = gl.createTexture();
  let texels = new Uint8Array(0);
  const row = 4 * COLOURS_WIDE;
  const grow = (high) => {
    const grown = new Uint8Array(Math.max(high, (2 * texels.length) / row) * row);
    grown.set(texels);
    texels = grown;
  };
  return {
    texture,
    set(rgb, first) {
      const high = Math.max(Math.ceil((first + rgb.length) / COLOURS_WIDE), 1);
      const isGrown = high * row > texels.length;
      if (isGrown) grow(high);
      rgb.forEach((c, i) => texels.set(c, 4 * (first + i)));
      gl.bindTexture(gl.TEXTURE_2D, texture);
      if (isGrown) {
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, COLOURS_WIDE, texels.length / row, 0, gl.RGBA, gl.UNSIGNED_BYTE, texels);
        for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
      } else {
        const top = Math.floor(first / COLOURS_WIDE);
        gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, top, COLOURS_WIDE, high - top, gl.RGBA, gl.UNSIGNED_BYTE, texels.subarray(top * row, high * row));
      }
    },
  };
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
