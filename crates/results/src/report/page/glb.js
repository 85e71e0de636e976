// Binary glTF as our own writer makes it: one mesh of triangles that share their vertices, a material each, feature ids, and a property
// table with a row per building.

const COMPONENTS = { 5120: Int8Array, 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };
const NO_NUMBER = -Number.MAX_VALUE;

function readGlb(buffer) {
  const head = new DataView(buffer);
  if (head.getUint32(0, true) !== 0x46546c67) throw new Error("a tile is no binary glTF");
  const jsonLength = head.getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, jsonLength)));
  return { json, bin: new Uint8Array(buffer, 28 + jsonLength) };
}

// Values of an accessor, packed.
function accessorOf({ json, bin }, index) {
  const { bufferView, componentType, type, count, byteOffset = 0 } = json.accessors[index];
  const view = json.bufferViews[bufferView];
  const Component = COMPONENTS[componentType];
  const width = WIDTHS[type];
  const stride = view.byteStride ?? width * Component.BYTES_PER_ELEMENT;
  const values = new Component(width * count);
  const source = new DataView(bin.buffer, bin.byteOffset + (view.byteOffset ?? 0) + byteOffset);
  const read = { 5120: "getInt8", 5121: "getUint8", 5123: "getUint16", 5125: "getUint32", 5126: "getFloat32" }[componentType];
  for (let i = 0; i < count; i += 1) {
    for (let c = 0; c < width; c += 1) values[width * i + c] = source[read](i * stride + c * Component.BYTES_PER_ELEMENT, true);
  }
  return values;
}

// The mesh in axes x east, y north, z up, moved by `place`; edges are found where two faces meet at an angle.
function meshOfGlb(glb, place) {
  const { primitives } = glb.json.meshes[0];
  const [primitive] = primitives;
  const { translation = [0, 0, 0], scale = [1, 1, 1] } = glb.json.nodes[0];
  const raw = accessorOf(glb, primitive.attributes.POSITION);
  const turned = accessorOf(glb, primitive.attributes.NORMAL);
  const positions = new Float32Array(raw.length);
  const width = turned.length / (raw.length / 3);
  const normals = new Float32Array(raw.length);
  for (let i = 0; i < raw.length; i += 3) {
    const [x, y, z] = [0, 1, 2].map((c) => raw[i + c] * scale[c] + translation[c]);
    positions.set(place.point([x, -z, y]), i);
    const n = (width * i) / 3;
    normals.set(vec.unit(place.direction([turned[n], -turned[n + 2], turned[n + 1]])), i);
  }
  const parts = primitives.map((part) => ({ indices: accessorOf(glb, part.indices), picture: pictureOfMaterial(glb, part.material) }));
  const indices = new Uint32Array(parts.reduce((n, part) => n + part.indices.length, 0));
  let first = 0;
  const ranges = parts.map((part) => {
    indices.set(part.indices, first);
    first += part.indices.length;
    return { first: first - part.indices.length, count: part.indices.length, picture: part.picture };
  });
  const { _FEATURE_ID_0: ids, TEXCOORD_0: places } = primitive.attributes;
  const features = ids === undefined ? null : accessorOf(glb, ids);
  return { positions, normals, features, uv: accessorOf(glb, places), indices, ranges, edges: features ? rims(indices) : new Uint32Array() };
}

// The picture of a material, as a blob, and whether it is of photos.
function pictureOfMaterial({ json, bin }, material) {
  const of = json.materials[material];
  const { source } = json.textures[of.pbrMetallicRoughness.baseColorTexture.index];
  const { bufferView, mimeType } = json.images[source];
  const { byteOffset = 0, byteLength } = json.bufferViews[bufferView];
  return { blob: new Blob([bin.subarray(byteOffset, byteOffset + byteLength)], { type: mimeType }), isPhoto: mimeType === "image/jpeg" };
}

const isTextured = (mesh) => mesh.ranges.some((range) => range.picture.isPhoto);

// Edges that belong to one triangle only: faces do not share vertices, so these are the rims of faces.
function rims(indices) {
  const seen = new Map();
  for (let t = 0; t < indices.length; t += 3) {
    for (let i = 0; i < 3; i += 1) {
      const [a, b] = [indices[t + i], indices[t + ((i + 1) % 3)]];
      const key = Math.min(a, b) * 2 ** 26 + Math.max(a, b);
      seen.set(key, (seen.get(key) ?? 0) + 1);
    }
  }
  const edges = [];
  for (const [key, n] of seen) if (n === 1) edges.push(Math.floor(key / 2 ** 26), key % 2 ** 26);
  return new Uint32Array(edges);
}

// The buildings' attributes: `column(name)` gives one value per building, null where it is not known.
function propertiesOf({ json, bin }) {
  const extension = json.extensions.EXT_structural_metadata;
  const table = extension.propertyTables[0];
  const schema = extension.schema.classes[table.class].properties;
  const view = (index) => {
    const { byteOffset = 0, byteLength } = json.bufferViews[index];
    return bin.slice(byteOffset, byteOffset + byteLength);
  };
  const column = (id) => {
    const property = table.properties[id];
    if (!property) return new Array(table.count).fill(null);
    if (schema[id].type !== "STRING") return [...new Float64Array(view(property.values).buffer)].map((v) => (v === NO_NUMBER ? null : v));
    const text = view(property.values);
    const offsets = new Uint32Array(view(property.stringOffsets).buffer);
    const decoder = new TextDecoder();
    return Array.from({ length: table.count }, (_, i) => decoder.decode(text.subarray(offsets[i], offsets[i + 1])) || null);
  };
  const names = Object.entries(schema).map(([id, property]) => [id, property.name ?? id]);
  return { count: table.count, names, column };
}
