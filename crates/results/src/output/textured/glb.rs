//! A textured city as one binary glTF 2.0: a node per building, named by its id, its main attributes as `extras`.
//!
//! Axes are glTF's: x east, y up, z south, metres from the origin of the output grid: whole metres of the project's CRS, stated in the
//! `extras` of the root node. Materials are unlit (`KHR_materials_unlit`): the photos have the light of the day in them.

use std::cmp::Ordering;
use std::io::{self, Write};

use glam::{DVec3, Vec2};
use serde_json::{Value, json};

use super::super::attributes;
use super::super::facts::SolidFacts;
use super::super::palette::Palette;
use super::super::prism::{FaceKind, MIN_THICKNESS_M};
use super::super::tiles3d::glb::{Buffers, write_container};
use super::super::triangles;
use super::super::{BuildingRecord, CityModel};
use super::ground::GroundMesh;
use super::{CitySurfaces, PaintedCity, SolidBuilding, TexturedGround, UNSEEN};
use sizeup_geo::triangles::area_vector;
use sizeup_photos::textures::Textures;

/// Numbers of the format (glTF 2.0, 5.1 and 5.11).
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const UNLIT: &str = "KHR_materials_unlit";

/// Triangles of one material.
#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    uv: Vec<[f32; 2]>,
    indices: Vec<u32>,
}

/// The file, while its buildings are added.
#[derive(Default)]
struct File {
    buffers: Buffers,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    palette: Palette,
}

/// Writes the file of a city; one picture is in memory at a time, and that of the ground.
pub(super) fn write(
    out: &mut dyn Write,
    model: &CityModel<'_>,
    &PaintedCity { city, textures, ground }: &PaintedCity<'_>,
    ground_jpeg: Option<Vec<u8>>,
) -> io::Result<()> {
    let plain = textures.surfaces.iter().filter(|texture| texture.page.is_none()).map(|texture| texture.plain);
    let mut file = File { palette: Palette::of(plain.chain([UNSEEN])), ..File::default() };
    for building in &city.buildings {
        file.add(&model.records[building.record], building, city, textures);
    }
    let n_pages = textures.pages.len();
    if let Some(ground) = ground {
        file.add_ground(ground, city, n_pages + 1);
    }
    let root = file.nodes.len();
    let [east_m, north_m, up_m] = city.grid.origin_m;
    file.nodes.push(json!({
        "name": "city",
        "children": (0..root).collect::<Vec<usize>>(),
        "extras": {
            "crs": model.lineage.crs, "vertical_reference": model.lineage.vertical_reference,
            "origin_east_m": east_m, "origin_north_m": north_m, "origin_up_m": up_m,
            "axes": "x east, y up, z south",
        },
    }));
    if root == 0 {
        file.nodes[0]["children"].take();
        file.nodes[0].as_object_mut().map(|node| node.remove("children"));
    }
    let plain_png = file.palette.png();
    let mut picture =
        |n_bytes: usize, kind: &str| json!({ "bufferView": file.buffers.later(n_bytes), "mimeType": kind });
    let mut images: Vec<Value> = textures.pages.iter().map(|page| picture(page.n_bytes(), "image/jpeg")).collect();
    images.push(picture(plain_png.len(), "image/png"));
    images.extend(ground_jpeg.as_ref().map(|jpeg| picture(jpeg.len(), "image/jpeg")));
    let n_images = images.len();
    let material = |image: usize| {
        let name = match image.cmp(&n_pages) {
            Ordering::Less => format!("atlas-{image}"),
            Ordering::Equal => "plain".to_owned(),
            Ordering::Greater => "ground".to_owned(),
        };
        json!({
            "name": name,
            "pbrMetallicRoughness": { "baseColorTexture": { "index": image }, "metallicFactor": 0.0, "roughnessFactor": 1.0 },
            "extensions": { UNLIT: {} },
        })
    };
    let mut json = json!({
        "asset": { "version": "2.0", "generator": concat!("sizeup ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": [UNLIT],
        "scene": 0,
        "scenes": [{ "nodes": [root] }],
        "nodes": file.nodes,
        "materials": (0..n_images).map(material).collect::<Vec<Value>>(),
    });
    // 9729, 9987: linear, from smaller copies; 9728: the nearest pixel, so that plain colours do not mix; 33071: no repeat.
    let samplers = json!([
        { "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 },
        { "magFilter": 9728, "minFilter": 9728, "wrapS": 33071, "wrapT": 33071 },
    ]);
    let texture = |image: usize| json!({ "sampler": usize::from(image == n_pages), "source": image });
    json["samplers"] = samplers;
    json["textures"] = (0..n_images).map(texture).collect();
    json["images"] = Value::Array(images);
    let mut add = |name: &str, list: Vec<Value>| {
        // glTF forbids empty lists.
        if !list.is_empty() {
            json[name] = Value::Array(list);
        }
    };
    add("meshes", file.meshes);
    add("accessors", file.accessors);
    let [views, whole] = file.buffers.take_members();
    json["buffers"] = whole;
    json["bufferViews"] = views;
    let pages = (0..n_pages).map(|page| textures.jpeg(page).map_err(io::Error::other));
    write_container(out, &json, &file.buffers, pages.chain([Ok(plain_png)]).chain(ground_jpeg.map(Ok)))
}

impl File {
    /// Adds the node of a building.
    fn add(&mut self, record: &BuildingRecord, building: &SolidBuilding, city: &CitySurfaces, textures: &Textures) {
        let n_pages = textures.pages.len();
        let mut meshes: Vec<Mesh> = std::iter::repeat_with(Mesh::default).take(n_pages + 1).collect();
        for (face, i) in building.faces.iter().zip(building.first..) {
            let texture = &textures.surfaces[i];
            let mesh = &mut meshes[texture.page.unwrap_or(n_pages)];
            let corners = || face.rings.iter().flatten();
            let at = |p: &[i64; 3]| {
                let [x, y, z] = p.map(|v| v as f64 * city.grid.scale_m);
                DVec3::new(x, z, -y)
            };
            let exterior: Vec<DVec3> = face.rings[0].iter().map(at).collect();
            let normal = area_vector(&exterior).normalize_or(DVec3::Y).as_vec3().to_array();
            let first = mesh.positions.len();
            mesh.positions.extend(corners().map(|p| at(p).as_vec3().to_array()));
            mesh.normals.extend(corners().map(|_| normal));
            mesh.uv.extend(texture.uv.iter().flatten().map(|at| Vec2::new(at.x as f32, at.y as f32).to_array()));
            if texture.page.is_none() {
                let colour = if face.surface == FaceKind::Ground { UNSEEN } else { texture.plain };
                mesh.uv.extend(corners().map(|_| self.palette.uv(colour)));
            }
            mesh.indices.extend(triangles::of_face(face).iter().flatten().map(|k| (first + k) as u32));
        }
        let primitives: Vec<Value> = (meshes.iter().enumerate())
            .filter(|(_, mesh)| !mesh.indices.is_empty())
            .map(|(material, mesh)| self.primitive(mesh, material))
            .collect();
        let (_, facts) = SolidFacts::of(record, &city.grid, MIN_THICKNESS_M);
        let mut extras = attributes::own(record, &facts);
        if let Some(whole) = &record.part_of {
            extras.insert("part_of".to_owned(), json!(whole));
        }
        let mut node = json!({ "name": record.id, "extras": extras });
        if !primitives.is_empty() {
            node["mesh"] = json!(self.meshes.len());
            self.meshes.push(json!({ "name": record.id, "primitives": primitives }));
        }
        self.nodes.push(node);
    }

    /// Adds the node of the ground.
    fn add_ground(&mut self, ground: &TexturedGround, city: &CitySurfaces, material: usize) {
        let GroundMesh { positions, uv, indices } = ground.mesh(&city.grid);
        let primitive = self.primitive(&Mesh { positions, uv, indices, ..Mesh::default() }, material);
        self.nodes.push(json!({ "name": "ground", "mesh": self.meshes.len(), "extras": { "photos": ground.photos } }));
        self.meshes.push(json!({ "name": "ground", "primitives": [primitive] }));
    }

    fn primitive(&mut self, mesh: &Mesh, material: usize) -> Value {
        let position = self.vertices(&floats(&mesh.positions), "VEC3", FLOAT, mesh.positions.len());
        let of_axis = |axis: usize| mesh.positions.iter().map(move |p| p[axis]);
        self.accessors[position]["min"] = json!([0, 1, 2].map(|axis| of_axis(axis).fold(f32::INFINITY, f32::min)));
        self.accessors[position]["max"] = json!([0, 1, 2].map(|axis| of_axis(axis).fold(f32::NEG_INFINITY, f32::max)));
        let mut attributes = json!({ "POSITION": position });
        if !mesh.normals.is_empty() {
            attributes["NORMAL"] = json!(self.vertices(&floats(&mesh.normals), "VEC3", FLOAT, mesh.normals.len()));
        }
        attributes["TEXCOORD_0"] = json!(self.vertices(&floats(&mesh.uv), "VEC2", FLOAT, mesh.uv.len()));
        let bytes: Vec<u8> = mesh.indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = self.accessor(&bytes, ELEMENT_ARRAY_BUFFER, "SCALAR", UNSIGNED_INT, mesh.indices.len());
        json!({ "mode": 4, "material": material, "indices": indices, "attributes": attributes })
    }

    fn vertices(&mut self, bytes: &[u8], kind: &str, component: u32, count: usize) -> usize {
        self.accessor(bytes, ARRAY_BUFFER, kind, component, count)
    }

    /// Adds bytes as an accessor of their own; its index.
    fn accessor(&mut self, bytes: &[u8], target: u32, kind: &str, component: u32, count: usize) -> usize {
        let view = self.buffers.view(bytes);
        self.buffers.set_target(view, target);
        self.accessors.push(json!({ "bufferView": view, "componentType": component, "type": kind, "count": count }));
        self.accessors.len() - 1
    }
}

fn floats<const N: usize>(values: &[[f32; N]]) -> Vec<u8> {
    values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()
}
