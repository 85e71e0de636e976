// What runs on the graphics card.

// Width of the texture that holds one colour per building.
const COLOURS_WIDE = 1024;

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
// Faces with the colours of photos, which have the light of the day in them.
const PHOTO_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 2) in float feature;
layout(location = 3) in vec2 uv;
uniform mat4 clipFromLocal;
uniform float first, selected, hovered;
uniform bool hasFeatures;
flat out vec4 tint;
out vec2 at;
void main() {
  gl_Position = clipFromLocal * vec4(position, 1.0);
  at = uv;
  float id = feature + first;
  tint = vec4(0.0);
  if (hasFeatures && abs(id - selected) < 0.5) tint = vec4(1.0, 0.32, 0.05, 0.45);
  else if (hasFeatures && abs(id - hovered) < 0.5) tint = vec4(1.0, 1.0, 1.0, 0.25);
}`;
const PHOTO_FRAGMENT = `#version 300 es
precision highp float;
flat in vec4 tint;
in vec2 at;
uniform sampler2D picture;
out vec4 colour;
void main() { colour = vec4(mix(texture(picture, at).rgb, tint.rgb, tint.a), 1.0); }`;
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

// A building as a box within one point: each pixel of the point asks whether its ray meets the box. So a small building
// costs one vertex instead of some forty, whatever the renderer.
const BOX_VERTEX = `#version 300 es
layout(location = 0) in vec4 place;
layout(location = 1) in vec4 reach;
layout(location = 2) in float feature;
uniform mat4 clipFromLocal;
uniform vec3 eye, sun;
uniform float first, selected, hovered, focalPx;
uniform sampler2D colours;
flat out vec3 from, half_;
flat out vec2 axis;
flat out vec3 top, alongU, alongV;
void main() {
  half_ = vec3(reach.zw, 0.5 * (place.w - place.z));
  vec3 centre = vec3(place.xy, place.z + half_.z);
  gl_Position = clipFromLocal * vec4(centre, 1.0);
  gl_PointSize = 2.0 * length(half_) * focalPx / max(gl_Position.w, 0.1) + 1.0;
  axis = reach.xy;
  vec3 d = eye - centre;
  from = vec3(dot(d.xy, axis), dot(d.xy, vec2(-axis.y, axis.x)), d.z);
  int i = int(feature + first + 0.5);
  vec3 colour = texelFetch(colours, ivec2(i % ${COLOURS_WIDE}, i / ${COLOURS_WIDE}), 0).rgb;
  if (abs(feature + first - selected) < 0.5) colour = mix(colour, vec3(1.0, 0.32, 0.05), 0.75);
  else if (abs(feature + first - hovered) < 0.5) colour = mix(colour, vec3(1.0), 0.3);
  // The light of the three sides that are seen.
  vec2 u = from.x < 0.0 ? -axis : axis;
  vec2 v = from.y < 0.0 ? vec2(axis.y, -axis.x) : vec2(-axis.y, axis.x);
  top = colour * (0.66 + 0.5 * sun.z);
  alongU = colour * (0.56 + 0.5 * max(dot(u, sun.xy), 0.0));
  alongV = colour * (0.56 + 0.5 * max(dot(v, sun.xy), 0.0));
}`;
const BOX_FRAGMENT = `#version 300 es
precision highp float;
flat in vec3 from, half_;
flat in vec2 axis;
flat in vec3 top, alongU, alongV;
// The ray of the pixel at the origin, and its change per pixel; ahead by 1 along the optical axis.
uniform vec3 ray, rayPerX, rayPerY;
// Depth of the picture at a distance t along the ray: depths.x + depths.y / t.
uniform vec2 depths;
out vec4 colour;
void main() {
  vec3 r = ray + gl_FragCoord.x * rayPerX + gl_FragCoord.y * rayPerY;
  vec3 turned = vec3(dot(r.xy, axis), dot(r.xy, vec2(-axis.y, axis.x)), r.z);
  vec3 perMetre = 1.0 / turned;
  vec3 middle = -from * perMetre;
  vec3 spread = half_ * abs(perMetre);
  vec3 enter = middle - spread;
  vec3 leave = middle + spread;
  float at = max(max(enter.x, enter.y), enter.z);
  if (at > min(min(leave.x, leave.y), leave.z) || at <= 0.0) discard;
  colour = vec4(at == enter.z ? top : at == enter.x ? alongU : alongV, 1.0);
  gl_FragDepth = depths.x + depths.y / at;
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

const programsOf = (gl) => ({
  face: programOf(gl, FACE_VERTEX, FACE_FRAGMENT),
  photo: programOf(gl, PHOTO_VERTEX, PHOTO_FRAGMENT),
  box: programOf(gl, BOX_VERTEX, BOX_FRAGMENT),
  ground: programOf(gl, GROUND_VERTEX, GROUND_FRAGMENT),
  line: programOf(gl, LINE_VERTEX, LINE_FRAGMENT),
  depth: programOf(gl, DEPTH_VERTEX, DEPTH_FRAGMENT),
  pick: programOf(gl, PICK_VERTEX, PICK_FRAGMENT),
});
