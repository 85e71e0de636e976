//! The city with textures from its photos: a folder that is whole or absent.
//!
//! | file | what |
//! |---|---|
//! | `city.city.json` | `CityJSON` 2.0 with an `appearance`: theme `photos` |
//! | `appearance/atlas-N.jpg` | its pictures |
//! | `textures.json` | which photos paint each building, and how much of it they show |
//! | `city.glb` | binary glTF 2.0, one named node per building and one for the ground, pictures embedded ([`glb`]) |
//! | `ground.json`, `appearance/ground.jpg` | the ground: heights at the nodes of a grid, and its picture |
//!
//! The buildings of a page are those of a tile of a [`quadtree`](super::tiles3d): 3D Tiles that are made of the folder take whole pages.
//!
//! The textures are those of the solids with roofs (LOD 2.0), or of the blocks (LOD 1.2) of a city without roofs. Faces that lower
//! levels of detail share with them have the same texture there; their other faces have none.

mod glb;
mod ground;
mod read;

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use glam::DVec3;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use indexmap::IndexSet;
use serde::Serialize;
use serde_json::{Value, json};

use super::cityjson::{self, CityJsonConfig};
use super::grid::{OutputGrid, SCALE_M};
use super::prism::{FaceKind, GridFace, MIN_THICKNESS_M, SnappedPrism};
use super::reports::write_json;
use super::roof_solid::{self, Detail};
use super::tiles3d::folder;
use super::tiles3d::quadtree::{Node, TreeItem};
use super::{BuildingRecord, CityModel, OutputError, Overview};
pub use ground::TexturedGround;
pub use read::TexturedCity;
pub(in crate::output) use read::{FacePaint, UNSEEN};
use sizeup_geo::files::{FileError, write_whole_unflushed};
use sizeup_photos::textures::{Surface, SurfaceKind, SurfaceTexture, Textures};

/// Name of the textured city in the folder of the results.
pub const FOLDER: &str = "textured";
const CITY: &str = "city.city.json";
const GLB: &str = "city.glb";
/// Name of the file of its numbers, which makes a folder a textured city.
pub const SUMMARY: &str = "textures.json";
const PICTURES: &str = "appearance";
const GROUND: &str = "ground.json";
const GROUND_PICTURE: &str = "appearance/ground.jpg";
/// Quality of JPEG that is made here, 1 to 100, as that of the buildings' pictures.
const JPEG_QUALITY: u8 = 85;
/// Most buildings whose textures are in one file of 3D Tiles: 2 to 5 MB at 0.1 m texels.
const MOST_BUILDINGS: usize = 50;
/// Theme of textures and of colours where there are none.
const THEME: &str = "photos";
/// Digits of a place on a page: a hundredth of a texel on the largest.
const UV_STEPS: f64 = 1e6;

/// A building with a solid.
struct SolidBuilding {
    /// Position of its record.
    record: usize,
    faces: Vec<GridFace>,
    /// Position of its first surface.
    first: usize,
}

/// Surfaces of a city's solids, in the order of its buildings and of their faces.
pub struct CitySurfaces {
    /// The surfaces; each `building` is the position of a record.
    pub surfaces: Vec<Surface>,
    /// Tile of each building, by the position of its record; 0 for one without a solid.
    pub tile_of: Vec<usize>,
    /// Names of the tiles.
    tiles: Vec<String>,
    grid: OutputGrid,
    buildings: Vec<SolidBuilding>,
}

impl CitySurfaces {
    /// Surfaces of the solids that records have, with their roofs where those are known.
    ///
    /// # Errors
    /// As [`Overview::of`].
    pub fn of(records: &[BuildingRecord]) -> Result<Self, OutputError> {
        let grid = Overview::of(records)?.grid(SCALE_M)?;
        let tile_of = vec![0; records.len()];
        let mut city = Self { surfaces: Vec::new(), tile_of, tiles: Vec::new(), grid, buildings: Vec::new() };
        for (i, record) in records.iter().enumerate() {
            let Ok(prism) = SnappedPrism::of(record, &grid, MIN_THICKNESS_M) else { continue };
            let faces = roof_solid::faces(record, &prism, &grid, Detail::Slopes).unwrap_or_else(|| prism.faces());
            let first = city.surfaces.len();
            city.surfaces.extend(faces.iter().map(|face| surface(i, record, face, &grid)));
            city.buildings.push(SolidBuilding { record: i, faces, first });
        }
        city.cut();
        Ok(city)
    }

    /// Cuts the city into tiles.
    fn cut(&mut self) {
        let item = |building: &SolidBuilding| {
            let corners = || building.faces.iter().flat_map(|face| face.rings.iter().flatten());
            let corners = || corners().map(|p| DVec3::from_array(self.grid.metres(*p)));
            let low = corners().fold(DVec3::INFINITY, DVec3::min);
            let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
            let middle = (low + high) / 2.0;
            TreeItem { idx: building.record, centre: [middle.x, middle.y], size_m: (high - low).length() }
        };
        let tree = Node::root(self.buildings.iter().map(item).collect(), MOST_BUILDINGS);
        let mut open: Vec<Node> = tree.into_iter().collect();
        while let Some(node) = open.pop() {
            node.members.iter().for_each(|&record| self.tile_of[record] = self.tiles.len());
            self.tiles.push(node.name);
            open.extend(node.children);
        }
    }

    /// Name of the tile of a building, by the position of its record; `None` in a city without solids.
    #[must_use]
    pub fn tile(&self, record: usize) -> Option<&str> {
        self.tiles.get(self.tile_of[record]).map(String::as_str)
    }
}

fn surface(building: usize, record: &BuildingRecord, face: &GridFace, grid: &OutputGrid) -> Surface {
    let kind = match face.surface {
        FaceKind::Ground => SurfaceKind::Ground,
        FaceKind::Roof => SurfaceKind::Roof,
        FaceKind::Wall => SurfaceKind::Wall,
    };
    let corner = |p: &[i64; 3]| DVec3::from_array(grid.metres(*p));
    let rings = face.rings.iter().map(|ring| ring.iter().map(corner).collect()).collect();
    Surface { building, kind, rings, sigma_m: record.roof_sigma_m.or(record.height_sigma_m).unwrap_or(0.0) }
}

/// A city, its textures, and its ground where photos show it.
#[derive(Clone, Copy)]
pub struct PaintedCity<'a> {
    /// Surfaces of the solids.
    pub city: &'a CitySurfaces,
    /// Textures of these surfaces.
    pub textures: &'a Textures,
    /// The ground around them.
    pub ground: Option<&'a TexturedGround>,
}

/// Writes the textured city into `folder`, whole or not at all; an earlier one is replaced.
///
/// # Errors
/// [`OutputError`]: a folder with other files, or the file system.
pub fn write(
    folder: &Path,
    model: &CityModel<'_>,
    config: &CityJsonConfig,
    painted: &PaintedCity<'_>,
    summary: &impl Serialize,
) -> Result<(), OutputError> {
    let PaintedCity { city, textures, ground } = *painted;
    folder::write_whole(folder, CITY, |new| {
        let pictures = new.join(PICTURES);
        fs::create_dir_all(&pictures).map_err(FileError::on("cannot write", &pictures))?;
        for page in 0..textures.pages.len() {
            let jpeg = textures.jpeg(page)?;
            write_whole_unflushed(&new.join(picture_name(page)), |out| out.write_all(&jpeg))?;
        }
        let painting = Painting::new(model.records, city, textures);
        cityjson::write_painted(&new.join(CITY), model, config, &painting)?;
        let ground_jpeg = ground.map(TexturedGround::jpeg);
        if let (Some(ground), Some(jpeg)) = (ground, &ground_jpeg) {
            write_whole_unflushed(&new.join(GROUND_PICTURE), |out| out.write_all(jpeg))?;
            write_json(&new.join(GROUND), ground)?;
        }
        write_whole_unflushed(&new.join(GLB), |out| glb::write(out, model, painted, ground_jpeg))?;
        Ok(write_json(&new.join(SUMMARY), summary)?)
    })
}

/// Removes a textured city that an earlier run left in `folder`: it does not belong to the results that are written now.
///
/// # Errors
/// [`OutputError::File`] where it cannot be removed.
pub fn remove(folder: &Path) -> Result<(), OutputError> {
    if folder.join(CITY).is_file() && folder.join(SUMMARY).is_file() {
        fs::remove_dir_all(folder).map_err(FileError::on("cannot remove", folder))?;
    }
    Ok(())
}

/// A picture as JPEG.
///
/// # Panics
/// Never: memory takes every byte, and pictures are smaller than the format's limit.
fn jpeg(picture: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(picture).expect("a picture is a JPEG");
    bytes
}

fn picture_name(page: usize) -> String {
    format!("{PICTURES}/atlas-{page}.jpg")
}

/// Positions of surfaces by the rings of their faces.
type SurfaceByRings<'a> = HashMap<&'a [Vec<[i64; 3]>], usize>;

/// Textures as `CityJSON` refers to them.
pub(in crate::output) struct Painting<'a> {
    textures: &'a Textures,
    /// Surfaces of each building, by its id and the rings of the face.
    surface_of: HashMap<&'a str, SurfaceByRings<'a>>,
    /// Position of each surface's first corner among those of all textures.
    first_corner: Vec<usize>,
    colours: IndexSet<[u8; 3]>,
}

impl<'a> Painting<'a> {
    fn new(records: &'a [BuildingRecord], city: &'a CitySurfaces, textures: &'a Textures) -> Self {
        let of_building = |building: &'a SolidBuilding| {
            let faces = building.faces.iter().zip(building.first..).map(|(face, i)| (face.rings.as_slice(), i));
            (records[building.record].id.as_str(), faces.collect())
        };
        let n_corners = |texture: &SurfaceTexture| texture.uv.iter().map(Vec::len).sum::<usize>();
        let first_corner = textures.surfaces.iter().scan(0, |next, texture| {
            let first = *next;
            *next += n_corners(texture);
            Some(first)
        });
        let plain = city.surfaces.iter().zip(&textures.surfaces);
        let plain = plain.filter(|(surface, texture)| surface.kind != SurfaceKind::Ground && texture.page.is_none());
        Self {
            textures,
            surface_of: city.buildings.iter().map(of_building).collect(),
            first_corner: first_corner.collect(),
            colours: plain.map(|(_, texture)| texture.plain).collect(),
        }
    }

    /// The member `appearance` of the file.
    pub fn appearance(&self) -> Value {
        let pictures = (0..self.textures.pages.len())
            .map(|i| json!({ "type": "JPG", "image": picture_name(i), "wrapMode": "none", "textureType": "specific" }));
        let rounded = |v: f64| (v * UV_STEPS).round() / UV_STEPS;
        // The origin is the lower left corner of the picture.
        let corners = self.textures.surfaces.iter().flat_map(|texture| texture.uv.iter().flatten());
        let corners = corners.map(|at| json!([rounded(at.x), rounded(1.0 - at.y)]));
        let colour = |c: &[u8; 3]| json!(c.map(|v| rounded(f64::from(v) / 255.0)));
        let materials = self
            .colours
            .iter()
            .enumerate()
            .map(|(i, c)| json!({ "name": format!("plain {i}"), "diffuseColor": colour(c) }));
        json!({
            "default-theme-texture": THEME,
            "default-theme-material": THEME,
            "materials": materials.collect::<Vec<_>>(),
            "textures": pictures.collect::<Vec<_>>(),
            "vertices-texture": corners.collect::<Vec<_>>(),
        })
    }

    /// Adds `texture` and `material` to a solid of one shell.
    pub fn paint(&self, id: &str, faces: &[GridFace], solid: &mut Value) {
        let Some(surface_of) = self.surface_of.get(id) else { return };
        let of = |face: &GridFace| {
            let i = *surface_of.get(face.rings.as_slice())?;
            Some((i, &self.textures.surfaces[i])).filter(|_| face.surface != FaceKind::Ground)
        };
        let texture = |face: &GridFace| match of(face) {
            Some((i, SurfaceTexture { page: Some(page), uv, .. })) => {
                let mut next = self.first_corner[i];
                let ring = |ring: &Vec<_>| {
                    let corners = next..next + ring.len();
                    next = corners.end;
                    json!(std::iter::once(*page).chain(corners).collect::<Vec<usize>>())
                };
                json!(uv.iter().map(ring).collect::<Vec<_>>())
            }
            _ => json!([[Value::Null]]),
        };
        let material = |face: &GridFace| match of(face) {
            Some((_, SurfaceTexture { page: None, plain, .. })) => json!(self.colours.get_index_of(plain)),
            _ => Value::Null,
        };
        let textures: Vec<Value> = faces.iter().map(texture).collect();
        let materials: Vec<Value> = faces.iter().map(material).collect();
        if textures.iter().any(|face| !face[0][0].is_null()) {
            solid["texture"] = json!({ THEME: { "values": [textures] } });
        }
        if materials.iter().any(|face| !face.is_null()) {
            solid["material"] = json!({ THEME: { "values": [materials] } });
        }
    }
}
