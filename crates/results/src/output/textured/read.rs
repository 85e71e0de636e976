//! The textures of a written city, for formats that are made from it later: 3D Tiles and OBJ.
//!
//! A building has the textured solid where its block is the one that was textured. So an export whose heights or footprints differ has no texture
//! there. Roofs are taken from the file: made again from rounded attributes, the same roof has other triangles.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use image::RgbImage;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::grid::{OutputGrid, SCALE_M};
use super::super::picture::colour::Rgb;
use super::super::prism::{FaceKind, GridFace, SnappedPrism};
use super::super::{MalformedFile, OutputError};
use super::{CITY, FOLDER, GROUND, GROUND_PICTURE, SUMMARY, THEME, TexturedGround};
use sizeup_geo::files::FileError;

/// Colour of faces that nobody sees: floors.
pub(in crate::output) const UNSEEN: Rgb = [128; 3];

/// Look of a face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(in crate::output) enum FacePaint {
    /// A part of a picture.
    Picture {
        /// Position among the pictures.
        page: usize,
        /// Shares from the picture's upper left corner, per corner of each ring.
        uv: Vec<Vec<[f32; 2]>>,
    },
    /// A single colour for the whole face.
    Plain(Rgb),
}

/// Blocks that differ by less than this are the same, millimetres: levels are sums of rounded ones.
const SAME_BLOCK_MM: i64 = 5;

/// Faces of a solid, and their looks.
pub(in crate::output) type PaintedFaces = (Vec<GridFace>, Vec<FacePaint>);

/// A solid with textures, millimetres in the map.
#[derive(Debug)]
struct TexturedSolid {
    /// Lowest and highest corner of its block.
    block: [[i64; 3]; 2],
    faces: Vec<GridFace>,
    /// Looks of the faces.
    paints: Vec<FacePaint>,
}

/// Solids of a folder by the ids of their buildings.
type Solids = HashMap<String, TexturedSolid>;

/// A textured city, read back: of one folder, or of one per tile. The solids of one folder are in memory at a time.
#[derive(Debug)]
pub struct TexturedCity {
    folders: Vec<PathBuf>,
    /// Pictures in the folders before each.
    n_before: Vec<usize>,
    /// Folder and tile of each building.
    buildings: HashMap<String, (usize, Option<String>)>,
    /// The folder that was read last, and its solids.
    last: Mutex<Option<(usize, Solids)>>,
    /// Files of the pictures.
    pub(in crate::output) pictures: Vec<PathBuf>,
    /// Side of a texel on the pictures of each folder, metres.
    texels_m: Vec<f64>,
    /// The folders that have a ground, and what the names of their tiles begin with.
    pub(in crate::output) grounds: Vec<(String, PathBuf)>,
}

/// Greatest side of a picture that is seen from far away, pixels; a first choice.
const FAR_PX: u32 = 512;
/// Most cells along a side of the mesh of a ground that is far away; a first choice.
const FAR_CELLS: usize = 32;

/// The numbers that are read.
#[derive(Deserialize)]
struct Numbers {
    texel_m: f64,
    buildings: BTreeMap<String, OfBuilding>,
}

#[derive(Deserialize)]
struct OfBuilding {
    tile: Option<String>,
}

impl TexturedCity {
    /// The textured city that belongs to a result: `input` is its folder, a file in it, or the textured city itself. `None` where there is
    /// none.
    ///
    /// # Errors
    /// [`OutputError`]: a file that cannot be read, or is not what sizeup writes.
    pub fn of_result(input: &Path) -> Result<Option<Self>, OutputError> {
        let folder = if input.is_dir() { input } else { input.parent().unwrap_or(Path::new("")) };
        let is_textured = |folder: &Path| folder.join(CITY).is_file() && folder.join(SUMMARY).is_file();
        let found = [folder.to_owned(), folder.join(FOLDER)].into_iter().find(|folder| is_textured(folder));
        found.map(|folder| Self::read(&folder)).transpose()
    }

    /// Opens the folder of a textured city.
    ///
    /// # Errors
    /// As [`Self::of_result`].
    pub fn read(folder: &Path) -> Result<Self, OutputError> {
        Self::of_tiles(&[folder.to_owned()])
    }

    /// Opens the folders of the tiles of a city.
    ///
    /// # Errors
    /// As [`Self::of_result`].
    pub fn of_tiles(folders: &[PathBuf]) -> Result<Self, OutputError> {
        let (mut buildings, mut pictures) = (HashMap::new(), Vec::new());
        let (mut n_before, mut texels_m, mut grounds) = (Vec::new(), Vec::new(), Vec::new());
        for (i, folder) in folders.iter().enumerate() {
            let numbers: Numbers = json(&folder.join(SUMMARY))?;
            let prefix = if folders.len() > 1 { format!("{i}/") } else { String::new() };
            let tile = |of: OfBuilding| of.tile.map(|tile| format!("{prefix}{tile}"));
            buildings.extend(numbers.buildings.into_iter().map(|(id, of)| (id, (i, tile(of)))));
            n_before.push(pictures.len());
            texels_m.push(numbers.texel_m);
            let all = (0..).map(|page| folder.join(super::picture_name(page)));
            pictures.extend(all.take_while(|picture| picture.is_file()));
            grounds.extend(folder.join(GROUND).is_file().then(|| (prefix.clone(), folder.clone())));
        }
        let folders = folders.to_vec();
        Ok(Self { folders, n_before, buildings, last: Mutex::new(None), pictures, texels_m, grounds })
    }

    /// Bytes of the pictures of buildings, and of the grounds.
    ///
    /// # Errors
    /// [`OutputError`]: a picture that is missing.
    pub(crate) fn n_bytes(&self) -> Result<[u64; 2], OutputError> {
        let size = |path: &PathBuf| Ok(fs::metadata(path).map_err(FileError::on("cannot read", path))?.len());
        let all = |paths: &[PathBuf]| paths.iter().map(size).sum::<Result<u64, OutputError>>();
        let grounds: Vec<PathBuf> = self.grounds.iter().map(|(_, folder)| folder.join(GROUND_PICTURE)).collect();
        Ok([all(&self.pictures)?, all(&grounds)?])
    }

    /// A ground and its picture, JPEG.
    ///
    /// # Errors
    /// [`OutputError`]: a file that cannot be read.
    pub(in crate::output) fn ground(&self, i: usize) -> Result<(TexturedGround, Vec<u8>), OutputError> {
        let folder = &self.grounds[i].1;
        let picture = folder.join(GROUND_PICTURE);
        Ok((json(&folder.join(GROUND))?, fs::read(&picture).map_err(FileError::on("cannot read", &picture))?))
    }

    /// The same as it is shown from far away, and the side of its pixels, metres; `None` where that is hardly smaller.
    ///
    /// # Errors
    /// As [`Self::ground`].
    pub(in crate::output) fn far_ground(
        &self,
        i: usize,
    ) -> Result<Option<(TexturedGround, Vec<u8>, f64)>, OutputError> {
        let (ground, jpeg) = self.ground(i)?;
        let Some((picture, _)) = far_picture(&self.grounds[i].1.join(GROUND_PICTURE), &jpeg)? else { return Ok(None) };
        let far = ground.coarser(picture, FAR_CELLS);
        let px_m = (far.bounds_m[2] - far.bounds_m[0]) / f64::from(far.picture.width());
        let jpeg = far.jpeg();
        Ok(Some((far, jpeg, px_m)))
    }

    /// A picture of buildings, JPEG.
    ///
    /// # Errors
    /// [`OutputError`]: a file that cannot be read.
    pub(in crate::output) fn picture(&self, page: usize) -> Result<Vec<u8>, OutputError> {
        let path = &self.pictures[page];
        Ok(fs::read(path).map_err(FileError::on("cannot read", path))?)
    }

    /// The same as it is shown from far away, and the side of its pixels, metres; `None` where that is hardly smaller.
    ///
    /// # Errors
    /// As [`Self::picture`], and for one that is no picture.
    pub(in crate::output) fn far_picture(&self, page: usize) -> Result<Option<(Vec<u8>, f64)>, OutputError> {
        let folder = self.n_before.partition_point(|n_before| *n_before <= page) - 1;
        let far = far_picture(&self.pictures[page], &self.picture(page)?)?;
        Ok(far.map(|(picture, share)| (super::jpeg(&picture), self.texels_m[folder] / share)))
    }

    /// Solids of a folder.
    fn solids(&self, folder: usize) -> Result<Solids, OutputError> {
        let path = self.folders[folder].join(CITY);
        let city: Value = json(&path)?;
        let malformed = |reason: &str| malformed(&path, reason);
        let document = Document::new(&city).ok_or_else(|| malformed("it has no textures as sizeup writes them"))?;
        if document.n_pictures > self.pictures.len() - self.n_before[folder] {
            return Err(malformed("pictures that it names are missing"));
        }
        let objects = city["CityObjects"].as_object().ok_or_else(|| malformed("it has no buildings"))?;
        let mut solids = HashMap::new();
        for (id, object) in objects {
            let Some(geometry) = painted_geometry(object) else { continue };
            let solid = document.solid(geometry).ok_or_else(|| malformed(&format!("building {id}: bad textures")))?;
            solids.insert(id.clone(), solid);
        }
        Ok(solids)
    }

    /// Faces of a building's solid and their looks; `None` where its block is not the one that was textured.
    ///
    /// # Errors
    /// [`OutputError`]: a file that cannot be read.
    ///
    /// # Panics
    /// Where another thread panicked while it read.
    pub(in crate::output) fn solid(
        &self,
        id: &str,
        block: &SnappedPrism,
        grid: &OutputGrid,
    ) -> Result<Option<PaintedFaces>, OutputError> {
        let Some((folder, _)) = self.buildings.get(id) else { return Ok(None) };
        let mut last = self.last.lock().expect("no thread panics while it reads");
        if last.as_ref().is_none_or(|(read, _)| read != folder) {
            *last = None;
            *last = Some((*folder, self.solids(*folder)?));
        }
        let solid = last.as_ref().and_then(|(_, solids)| solids.get(id));
        Ok(solid.and_then(|solid| solid.on(block, grid, self.n_before[*folder])))
    }

    /// Name of a building's tile.
    pub(in crate::output) fn tile(&self, id: &str) -> Option<&str> {
        self.buildings.get(id)?.1.as_deref()
    }
}

impl TexturedSolid {
    /// Faces on a grid and their looks, with so many pictures before those of its folder; `None` where the block is another one.
    fn on(&self, block: &SnappedPrism, grid: &OutputGrid, n_before: usize) -> Option<PaintedFaces> {
        let origin = origin(grid);
        let corners = block.faces().into_iter().flat_map(|face| face.rings.into_iter().flatten());
        let own = bounds(corners.map(|p| std::array::from_fn(|axis| p[axis] + origin[axis])))?;
        let is_near = |(a, b): (&i64, &i64)| (a - b).abs() <= SAME_BLOCK_MM;
        let is_same = own.iter().flatten().zip(self.block.iter().flatten()).all(is_near);
        let on_grid = |face: &GridFace| {
            let corner = |p: &[i64; 3]| std::array::from_fn(|axis| p[axis] - origin[axis]);
            let rings = face.rings.iter().map(|ring| ring.iter().map(corner).collect()).collect();
            GridFace { rings, ..*face }
        };
        let paint = |paint: &FacePaint| match paint {
            FacePaint::Picture { page, uv } => FacePaint::Picture { page: n_before + page, uv: uv.clone() },
            plain @ FacePaint::Plain(_) => plain.clone(),
        };
        is_same.then(|| (self.faces.iter().map(on_grid).collect(), self.paints.iter().map(paint).collect()))
    }
}

fn json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, OutputError> {
    let bytes = fs::read(path).map_err(FileError::on("cannot read", path))?;
    serde_json::from_slice(&bytes).map_err(|e| malformed(path, &e.to_string()))
}

/// A picture as it is shown from far away, and its width as a share of the given one's; `None` where that is hardly smaller.
fn far_picture(path: &Path, jpeg: &[u8]) -> Result<Option<(RgbImage, f64)>, OutputError> {
    let picture = image::load_from_memory(jpeg).map_err(|e| malformed(path, &e.to_string()))?;
    if picture.width().max(picture.height()) <= 2 * FAR_PX {
        return Ok(None);
    }
    let far = picture.thumbnail(FAR_PX, FAR_PX).into_rgb8();
    let share = f64::from(far.width()) / f64::from(picture.width());
    Ok(Some((far, share)))
}

fn malformed(path: &Path, reason: &str) -> OutputError {
    MalformedFile { path: path.to_owned(), reason: reason.to_owned() }.into()
}

/// Origin of a grid, in its steps.
fn origin(grid: &OutputGrid) -> [i64; 3] {
    grid.origin_m.map(|v| (v / grid.scale_m).round() as i64)
}

/// Lowest and highest coordinates.
fn bounds(corners: impl Iterator<Item = [i64; 3]>) -> Option<[[i64; 3]; 2]> {
    let with = |pick: fn(i64, i64) -> i64, a: [i64; 3], b: [i64; 3]| std::array::from_fn(|i| pick(a[i], b[i]));
    corners.map(|p| [p, p]).reduce(|[low, high], [p, q]| [with(i64::min, low, p), with(i64::max, high, q)])
}

/// Textures and colours of the faces of a solid.
fn looks(solid: &Value) -> (&Value, &Value) {
    (&solid["texture"][THEME]["values"][0], &solid["material"][THEME]["values"][0])
}

/// The block of an object and its solid with the most detail; `None` for an object without textures.
fn painted_geometry(object: &Value) -> Option<[&Value; 2]> {
    let solids = || object["geometry"].as_array().into_iter().flatten().filter(|solid| solid["type"] == "Solid");
    let (block, solid) = (solids().next()?, solids().next_back()?);
    let (textures, materials) = looks(solid);
    (!textures.is_null() || !materials.is_null()).then_some([block, solid])
}

/// A CityJSON file with textures.
struct Document {
    vertices: Vec<[i64; 3]>,
    /// Origin of the vertices, millimetres.
    origin: [i64; 3],
    places: Vec<[f32; 2]>,
    colours: Vec<Rgb>,
    n_pictures: usize,
}

impl Document {
    fn new(city: &Value) -> Option<Self> {
        let appearance = &city["appearance"];
        let numbers = |value: &Value| serde_json::from_value::<[f64; 3]>(value.clone()).ok();
        let place = |at: &Value| Some([at[0].as_f64()? as f32, (1.0 - at[1].as_f64()?) as f32]);
        let colour = |of: &Value| Some(numbers(&of["diffuseColor"])?.map(|v| (v * 255.0).round() as u8));
        Some(Self {
            vertices: serde_json::from_value(city["vertices"].clone()).ok()?,
            origin: origin(&OutputGrid { scale_m: SCALE_M, origin_m: numbers(&city["transform"]["translate"])? }),
            places: appearance["vertices-texture"].as_array()?.iter().map(place).collect::<Option<_>>()?,
            colours: appearance["materials"].as_array()?.iter().map(colour).collect::<Option<_>>()?,
            n_pictures: appearance["textures"].as_array()?.len(),
        })
    }

    /// A solid with its looks, of an object's block and of its solid with the most detail.
    fn solid(&self, [block, solid]: [&Value; 2]) -> Option<TexturedSolid> {
        let (textures, materials) = looks(solid);
        let block = self.faces(block)?;
        let block = bounds(block.iter().flat_map(|face| face.rings.iter().flatten()).copied())?;
        let faces = self.faces(solid)?;
        let paint = |(i, face): (usize, &GridFace)| {
            let paint = self.paint(&textures[i], &materials[i])?;
            let fits = match &paint {
                FacePaint::Picture { uv, .. } => uv.iter().map(Vec::len).eq(face.rings.iter().map(Vec::len)),
                FacePaint::Plain(_) => true,
            };
            fits.then_some(paint)
        };
        let paints = faces.iter().enumerate().map(paint).collect::<Option<_>>()?;
        Some(TexturedSolid { block, faces, paints })
    }

    /// Faces of a solid.
    fn faces(&self, solid: &Value) -> Option<Vec<GridFace>> {
        let kinds = &solid["semantics"];
        let face = |(i, face): (usize, &Value)| {
            let kind = &kinds["surfaces"][kinds["values"][0][i].as_u64()? as usize]["type"];
            let surface = match kind.as_str()? {
                "GroundSurface" => FaceKind::Ground,
                "RoofSurface" => FaceKind::Roof,
                _ => FaceKind::Wall,
            };
            let rings: Vec<Vec<[i64; 3]>> =
                face.as_array()?.iter().map(|ring| self.ring(ring)).collect::<Option<_>>()?;
            rings
                .iter()
                .all(|ring| ring.len() >= 3)
                .then(|| GridFace::new(surface, rings))
                .filter(|face| !face.rings.is_empty())
        };
        solid["boundaries"][0].as_array()?.iter().enumerate().map(face).collect()
    }

    fn ring(&self, ring: &Value) -> Option<Vec<[i64; 3]>> {
        let corner = |i: &Value| {
            let vertex = self.vertices.get(i.as_u64()? as usize)?;
            Some(std::array::from_fn(|axis| vertex[axis] + self.origin[axis]))
        };
        ring.as_array()?.iter().map(corner).collect()
    }

    /// Look of a face.
    fn paint(&self, texture: &Value, material: &Value) -> Option<FacePaint> {
        if let Some(colour) = material.as_u64() {
            return Some(FacePaint::Plain(*self.colours.get(colour as usize)?));
        }
        let Some(page) = texture[0][0].as_u64() else { return Some(FacePaint::Plain(UNSEEN)) };
        let place = |i: &Value| self.places.get(i.as_u64()? as usize).copied();
        let ring = |ring: &Value| ring.as_array()?.iter().skip(1).map(place).collect();
        let uv: Vec<Vec<[f32; 2]>> = texture.as_array()?.iter().map(ring).collect::<Option<_>>()?;
        let page = page as usize;
        (page < self.n_pictures).then_some(FacePaint::Picture { page, uv })
    }
}
