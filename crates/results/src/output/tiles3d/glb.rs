//! One tile as binary glTF 2.0: a mesh with feature ids (`EXT_mesh_features`) and a property table.
//!
//! All colours are pictures, also those of the legend ([`Palette`]). Pictures of photos are unlit, as the light of the day is in them.
//!
//! ```text
//! file = "glTF" 2 length | length "JSON" json | length "BIN\0" buffer        little-endian, chunks to 4 bytes
//! ```
//!
//! With [`Precision::Quantised`], positions are 16-bit steps of the tile's longest side and normals 8-bit
//! (`KHR_mesh_quantization`): half the size, and an error of at most half a step, 4 mm in a tile of 500 m.

use std::collections::BTreeMap;
use std::io::{self, Write};

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::super::palette::Palette;
use super::mesh::{Material, TileMesh};
use super::metadata::NamedColumns;

/// Numbers of the format (glTF 2.0, 5.1 and 5.11).
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const BYTE: u32 = 5120;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const UNLIT: &str = "KHR_materials_unlit";
/// Property tables want their values to begin at multiples of 8 bytes.
const ALIGNMENT: usize = 8;

/// Precision of written vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// Reals of 32 bits.
    #[default]
    Float,
    /// Whole steps of 16 bits, of the tile's longest side.
    Quantised,
}

/// The binary chunk and its views.
#[derive(Debug, Default)]
pub struct Buffers {
    bytes: Vec<u8>,
    /// Length of the chunk: those bytes, and later ones.
    n_bytes: usize,
    views: Vec<Value>,
}

impl Buffers {
    /// Adds bytes as a view of their own; its index.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        debug_assert_eq!(self.bytes.len(), self.n_bytes, "no bytes of its own follow later ones");
        let view = self.later(bytes.len());
        self.bytes.resize(self.n_bytes - bytes.len(), 0);
        self.bytes.extend_from_slice(bytes);
        view
    }

    /// Adds a view of bytes that [`write_container`] gets; its index.
    pub fn later(&mut self, n_bytes: usize) -> usize {
        let first_byte = self.n_bytes.next_multiple_of(ALIGNMENT);
        self.n_bytes = first_byte + n_bytes;
        self.views.push(json!({ "buffer": 0, "byteOffset": first_byte, "byteLength": n_bytes }));
        self.views.len() - 1
    }

    /// States how a view is used: `ARRAY_BUFFER` or `ELEMENT_ARRAY_BUFFER`.
    pub fn set_target(&mut self, view: usize, target: u32) {
        self.views[view]["target"] = target.into();
    }

    /// Takes the members `bufferViews` and `buffers` of the file's JSON.
    pub fn take_members(&mut self) -> [Value; 2] {
        [Value::Array(std::mem::take(&mut self.views)), json!([{ "byteLength": self.n_bytes }])]
    }

    fn vertices(&mut self, bytes: &[u8], stride: usize) -> usize {
        let view = self.view(bytes);
        self.views[view]["target"] = ARRAY_BUFFER.into();
        self.views[view]["byteStride"] = stride.into();
        view
    }
}

/// Content of a tile.
pub struct GlbTile<'a> {
    /// Triangles of the tile's buildings.
    pub mesh: &'a TileMesh,
    /// One row per building.
    pub rows: &'a [&'a [Value]],
    /// Palette of the plain colours of the tile.
    pub palette: &'a Palette,
    /// Pictures that the tile's triangles have, JPEG, by their position.
    pub pictures: &'a BTreeMap<usize, Vec<u8>>,
    /// Columns of the rows; `None` for a tile without attributes.
    pub properties: Option<&'a NamedColumns>,
    /// Name of the tile.
    pub name: &'a str,
}

/// The file of a tile.
///
/// # Panics
/// Never: memory takes every byte.
#[must_use]
pub fn glb(tile: &GlbTile<'_>, precision: Precision) -> Vec<u8> {
    let mut parts = GlbParts::default();
    let (mut node, position, normal) = match precision {
        Precision::Float => parts.reals(tile.mesh),
        Precision::Quantised => parts.steps(tile.mesh),
    };
    node["name"] = json!(tile.name);
    let mut attributes = json!({ "POSITION": position, "NORMAL": normal, "TEXCOORD_0": parts.places(&tile.mesh.uv) });
    if !tile.mesh.features.is_empty() {
        attributes["_FEATURE_ID_0"] = json!(parts.feature_ids(&tile.mesh.features));
    }
    let materials: Vec<Material> = tile.mesh.indices.keys().copied().collect();
    let primitive = |(material, indices): (usize, &Vec<u32>)| {
        let indices = parts.indices(indices);
        let mut primitive = json!({ "mode": 4, "material": material, "indices": indices, "attributes": attributes });
        if tile.properties.is_some() {
            primitive["extensions"] = json!({ "EXT_mesh_features": { "featureIds": [
                { "featureCount": tile.rows.len(), "attribute": 0, "propertyTable": 0, "label": "building" },
            ] } });
        }
        primitive
    };
    let primitives: Vec<Value> = tile.mesh.indices.values().enumerate().map(primitive).collect();
    let mut extensions = Vec::new();
    let mut json = json!({
        "asset": { "version": "2.0", "generator": concat!("sizeup ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "name": tile.name, "primitives": primitives }],
    });
    parts.pictures(tile, &materials, &mut json);
    if tile.mesh.indices.keys().any(|material| *material != Material::Palette) {
        extensions.push(UNLIT);
    }
    if let Some(properties) = tile.properties {
        let table = properties.table(tile.rows, &mut parts.buffers);
        json["extensions"] =
            json!({ "EXT_structural_metadata": { "schema": properties.schema(), "propertyTables": [table] } });
        extensions.extend(["EXT_mesh_features", "EXT_structural_metadata"]);
    }
    if precision == Precision::Quantised {
        extensions.push("KHR_mesh_quantization");
        json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    }
    if !extensions.is_empty() {
        json["extensionsUsed"] = json!(extensions);
    }
    json["accessors"] = Value::Array(parts.accessors);
    [json["bufferViews"], json["buffers"]] = parts.buffers.take_members();
    let mut file = Vec::new();
    write_container(&mut file, &json, &parts.buffers, []).expect("memory takes every byte");
    file
}

/// The binary chunk and the accessors into it.
#[derive(Debug, Default)]
struct GlbParts {
    buffers: Buffers,
    accessors: Vec<Value>,
}

impl GlbParts {
    /// Adds an accessor; its index.
    fn accessor(&mut self, value: Value) -> usize {
        self.accessors.push(value);
        self.accessors.len() - 1
    }

    fn indices(&mut self, indices: &[u32]) -> usize {
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let view = self.buffers.view(&bytes);
        self.buffers.views[view]["target"] = ELEMENT_ARRAY_BUFFER.into();
        self.accessor(
            json!({ "bufferView": view, "componentType": UNSIGNED_INT, "type": "SCALAR", "count": indices.len() }),
        )
    }

    /// The node, and accessors of positions around the tile's middle and of normals.
    fn reals(&mut self, mesh: &TileMesh) -> (Value, usize, usize) {
        let (n, [low, high]) = (mesh.positions.len(), mesh.bounds());
        let origin = (low + high) / 2.0;
        let floats = |points: &[DVec3], origin: DVec3| -> Vec<[f32; 3]> {
            points.iter().map(|p| (*p - origin).as_vec3().to_array()).collect()
        };
        let bytes = |v: &[[f32; 3]]| v.iter().flatten().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>();
        let positions = floats(&mesh.positions, origin);
        let [min, max] = extremes(&positions);
        let view = self.buffers.vertices(&bytes(&positions), 12);
        let position = self.accessor(json!({ "bufferView": view, "componentType": FLOAT, "type": "VEC3", "count": n,
                                             "min": min, "max": max }));
        let view = self.buffers.vertices(&bytes(&floats(&mesh.normals, DVec3::ZERO)), 12);
        let normal = self.accessor(json!({ "bufferView": view, "componentType": FLOAT, "type": "VEC3", "count": n }));
        (json!({ "mesh": 0, "translation": origin.to_array() }), position, normal)
    }

    /// The node, and accessors of positions in steps from the tile's lowest corner and of normals.
    fn steps(&mut self, mesh: &TileMesh) -> (Value, usize, usize) {
        let (n, [low, high]) = (mesh.positions.len(), mesh.bounds());
        let step = ((high - low).max_element() / f64::from(u16::MAX)).max(f64::MIN_POSITIVE);
        let steps: Vec<[u16; 3]> =
            mesh.positions.iter().map(|p| ((*p - low) / step).to_array().map(|v| v.round() as u16)).collect();
        // A fourth component fills each vertex up to a multiple of 4 bytes.
        let bytes: Vec<u8> = steps.iter().flat_map(|&[x, y, z]| [x, y, z, 0]).flat_map(u16::to_le_bytes).collect();
        let view = self.buffers.vertices(&bytes, 8);
        let [min, max] = extremes(&steps);
        let position = self.accessor(json!({ "bufferView": view, "componentType": UNSIGNED_SHORT, "type": "VEC3",
                                             "count": n, "min": min, "max": max }));
        let byte = |v: f64| ((v * 127.0).round() as i8).to_le_bytes()[0];
        let bytes: Vec<u8> = mesh.normals.iter().flat_map(|p| [byte(p.x), byte(p.y), byte(p.z), 0]).collect();
        let view = self.buffers.vertices(&bytes, 4);
        let normal = self.accessor(json!({ "bufferView": view, "componentType": BYTE, "normalized": true,
                                           "type": "VEC3", "count": n }));
        (json!({ "mesh": 0, "translation": low.to_array(), "scale": [step, step, step] }), position, normal)
    }

    /// Reals hold every id below 2^24, and unlike 32-bit integers are allowed for attributes.
    fn feature_ids(&mut self, features: &[u32]) -> usize {
        let bytes: Vec<u8> = features.iter().flat_map(|&id| (id as f32).to_le_bytes()).collect();
        let view = self.buffers.vertices(&bytes, 4);
        self.accessor(json!({ "bufferView": view, "componentType": FLOAT, "type": "SCALAR", "count": features.len() }))
    }

    /// Places on pictures.
    fn places(&mut self, uv: &[[f32; 2]]) -> usize {
        let bytes: Vec<u8> = uv.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.buffers.vertices(&bytes, 8);
        self.accessor(json!({ "bufferView": view, "componentType": FLOAT, "type": "VEC2", "count": uv.len() }))
    }

    /// Adds materials with their textures, samplers and images.
    fn pictures(&mut self, tile: &GlbTile<'_>, materials: &[Material], json: &mut Value) {
        let is_photographic = materials.iter().any(|material| *material != Material::Palette);
        let mut image = |material: &Material| match material {
            Material::Palette => {
                json!({ "bufferView": self.buffers.view(&tile.palette.png()), "mimeType": "image/png" })
            }
            Material::Page(page) => {
                json!({ "bufferView": self.buffers.view(&tile.pictures[page]), "mimeType": "image/jpeg" })
            }
        };
        json["images"] = materials.iter().map(&mut image).collect();
        // 9728: the nearest pixel, so that colours do not mix; 9729, 9987: linear, from smaller copies; 33071: no repeat.
        json["samplers"] = json!([
            { "magFilter": 9728, "minFilter": 9728, "wrapS": 33071, "wrapT": 33071 },
            { "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 },
        ]);
        let sampler = |material: &Material| usize::from(*material != Material::Palette);
        json["textures"] =
            materials.iter().enumerate().map(|(i, of)| json!({ "sampler": sampler(of), "source": i })).collect();
        let material = |(i, of): (usize, &Material)| {
            let name = match of {
                Material::Palette => "building".to_owned(),
                Material::Page(page) => format!("photos-{page}"),
            };
            let mut material = json!({
                "name": name,
                "pbrMetallicRoughness": { "baseColorTexture": { "index": i }, "metallicFactor": 0.0, "roughnessFactor": 1.0 },
            });
            if is_photographic {
                material["extensions"] = json!({ UNLIT: {} });
            }
            material
        };
        json["materials"] = materials.iter().enumerate().map(material).collect();
    }
}

/// Smallest and largest of each component.
fn extremes<T: Copy + PartialOrd>(points: &[[T; 3]]) -> [Vec<T>; 2] {
    let pick = |keep: fn(&T, &T) -> bool| -> Vec<T> {
        let of = |axis: usize| points.iter().map(|p| p[axis]).reduce(|a, b| if keep(&a, &b) { a } else { b });
        (0..3).filter_map(of).collect()
    };
    [pick(|a, b| a <= b), pick(|a, b| a >= b)]
}

/// Writes a binary glTF: its JSON, the bytes of its binary chunk, and the later ones in the order of their views.
///
/// # Errors
/// Those of the writer, and of the later bytes.
pub fn write_container(
    out: &mut dyn Write,
    json: &Value,
    buffers: &Buffers,
    later: impl IntoIterator<Item = io::Result<Vec<u8>>>,
) -> io::Result<()> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let n_bytes = buffers.n_bytes.next_multiple_of(4);
    out.write_all(b"glTF")?;
    for number in [2, 12 + 8 + text.len() + 8 + n_bytes, text.len()] {
        out.write_all(&(number as u32).to_le_bytes())?;
    }
    out.write_all(b"JSON")?;
    out.write_all(&text)?;
    out.write_all(&(n_bytes as u32).to_le_bytes())?;
    out.write_all(b"BIN\0")?;
    out.write_all(&buffers.bytes)?;
    let mut end = buffers.bytes.len();
    for bytes in later {
        let bytes = bytes?;
        out.write_all(&[0; ALIGNMENT][..end.next_multiple_of(ALIGNMENT) - end])?;
        out.write_all(&bytes)?;
        end = end.next_multiple_of(ALIGNMENT) + bytes.len();
    }
    out.write_all(&[0; ALIGNMENT][..n_bytes - end])
}
