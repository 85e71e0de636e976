//! 3D Tiles 1.1 (OGC 22-025r4): the city for Cesium and other globes, streamed tile by tile.
//!
//! A folder with `tileset.json` and one binary glTF per tile of a [`quadtree`]. Every building is one feature with all
//! its attributes. Buildings without a solid have nothing to show and are left out; the tileset says how many.
//!
//! ```text
//! ecef = tileset transform · node translation · vertex          node and vertex in the city's local frame
//! ```
//!
//! The buildings wait on disk while their tiles are chosen: in memory there is one tile, and some 50 bytes per building.
//!
//! Buildings have the colours of the legend, or the textures of a [`TexturedCity`]; its tiles are then those of the tileset, and its grounds are
//! tiles without features, each replaced by a finer one from close by.

pub(super) mod folder;
pub(super) mod glb;
mod mesh;
mod metadata;
mod place;
pub(super) mod quadtree;
mod spool;

use crate::output::grid::SCALE_M;
use crate::output::prism::MIN_THICKNESS_M;
use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::buildings::Wholes;
use super::footprints::FootprintRows;
use super::grid::OutputGrid;
use super::palette::Palette;
use super::prism::SnappedPrism;
use super::reports::write_json;
use super::roof_solid::{self, Detail};
use super::textured::{TexturedCity, TexturedGround};
use super::{BuildingRecord, CityModel, OutputError, Overview, Records};
pub use glb::Precision;
use mesh::{TileBuilding, TileMesh};
use metadata::NamedColumns;
pub use place::Heights;
use place::TilesetPlace;
use quadtree::{Node, TreeItem};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::{FileError, write_whole_unflushed};
use spool::{Spool, SpoolWriter};

/// Settings of 3D Tiles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Tiles3dConfig {
    /// How heights become heights above the ellipsoid.
    pub heights: Heights,
    /// Buildings of a tile, at most; 1 and more.
    pub max_buildings: usize,
    /// Precision of written vertices.
    pub precision: Precision,
}

impl Default for Tiles3dConfig {
    fn default() -> Self {
        let (heights, precision) = (Heights::default(), Precision::default());
        Self { heights, max_buildings: 500, precision }
    }
}

/// Whether a city of a CRS can be placed on the earth, asked at one place of its map (metres), before any of it is there.
///
/// # Errors
/// As [`write()`]: [`OutputError::HeightsNotStated`], or [`OutputError::Crs`] such as a grid that PROJ lacks.
pub fn check_place(crs: &Crs, heights: Heights, at_m: DVec3) -> Result<(), OutputError> {
    TilesetPlace::new(crs, heights, at_m).map(drop)
}

/// Lineage of the result, beside the tileset: every globe loads that, and nobody's globe needs this.
const LINEAGE: &str = "lineage.json";
/// Name of the tile of the ground.
const GROUND: &str = "ground";
const FAR_GROUND: &str = "ground-far";
/// After the name of a tile that is seen from far away.
const FAR: &str = "-far";
/// Error of what is seen from far away, in its pixels: viewers go on to the near one where an error is larger than some 16 pixels of
/// the screen, so where one of its pixels covers two of them.
const FAR_PIXELS: f64 = 8.0;

/// Whether something is seen from close by or from far away.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Distance {
    Near,
    Far,
}

/// A textured city as it is shown in the map: binary glTF around an origin.
pub(crate) struct MapView {
    /// Buildings; features are positions of records.
    pub buildings: Vec<u8>,
    /// The ground around the buildings, piece by piece.
    pub grounds: Vec<Vec<u8>>,
    /// Positions of the records that it shows.
    pub shown: Vec<usize>,
}

impl MapView {
    /// View of the records that have textures; `None` where none has, or where it would have more than some bytes. What is too much is as from
    /// far away: first the ground, then the buildings.
    ///
    /// # Errors
    /// [`OutputError`]: pictures that cannot be read.
    pub fn of(
        records: &[BuildingRecord],
        grid: &OutputGrid,
        textured: &TexturedCity,
        most_bytes: usize,
    ) -> Result<Option<Self>, OutputError> {
        let [of_buildings, of_grounds] = textured.n_bytes()?.map(|n| n as usize);
        let distance_of = |n_bytes: usize| if n_bytes > most_bytes { Distance::Far } else { Distance::Near };
        let distance = distance_of(of_buildings + of_grounds);
        let block = |record: &BuildingRecord| {
            let prism = SnappedPrism::of(record, grid, MIN_THICKNESS_M).ok()?;
            let found = textured.solid(&record.id, &prism, grid).transpose()?;
            let block = |(faces, paints)| TileBuilding {
                prism,
                roofed: Some(faces),
                paints,
                values: Vec::new(),
                height_m: 0.0,
            };
            Some(found.map(block))
        };
        let found = records.iter().enumerate().filter_map(|(i, record)| Some((i, block(record)?)));
        let found = found.map(|(i, block)| Ok((i, block?))).collect::<Result<Vec<_>, OutputError>>()?;
        let (shown, blocks): (Vec<usize>, Vec<TileBuilding>) = found.into_iter().unzip();
        if shown.is_empty() {
            return Ok(None);
        }
        let writer = TileWriter {
            spool: None,
            grid,
            place: &TilesetPlace::in_map(DVec3::from_array(grid.origin_m)),
            properties: None,
            precision: Precision::Float,
            textured: Some(textured),
        };
        let mut mesh = writer.mesh_of(&blocks)?;
        mesh.of.features.iter_mut().for_each(|feature| *feature = shown[*feature as usize] as u32);
        let far = if distance_of(of_buildings) == Distance::Far { writer.far_pictures(&mesh.of)? } else { None };
        let pictures = far.map_or_else(|| writer.pictures(&mesh.of), |(far, _)| Ok(far))?;
        let buildings = writer.glb_of(&mesh, &blocks, "buildings", &pictures);
        let mut grounds = Vec::new();
        for i in 0..textured.grounds.len() {
            let far = if distance == Distance::Far { writer.far_ground(textured, i)? } else { None };
            let ground = far.map_or_else(|| writer.near_ground(textured, i), |(ground, _)| Ok(ground));
            grounds.push(ground?.0);
        }
        let view = Self { buildings, grounds, shown };
        let n_bytes = view.buildings.len() + view.grounds.iter().map(Vec::len).sum::<usize>();
        Ok((n_bytes <= most_bytes).then_some(view))
    }
}

/// Writes the folder `path` whole or not at all; a tileset that is there already is replaced.
///
/// # Errors
/// [`OutputError`]: duplicate ids, heights that are not stated, a CRS that PROJ cannot bring to the earth's frame, a
/// folder with other files, the file system.
pub fn write<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &Tiles3dConfig,
) -> Result<Overview, OutputError> {
    write_textured(path, model, config, None)
}

/// As [`write()`], with the textures of a city where it has some. Its pictures are in the tiles as they are.
///
/// # Errors
/// As [`write()`], and for pictures that cannot be read.
pub fn write_textured<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &Tiles3dConfig,
    textured: Option<&TexturedCity>,
) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    let size_m = size_m(&overview);
    let rows = FootprintRows::new(&overview, grid, MIN_THICKNESS_M);
    let centre_m = overview.extent.map_or(DVec3::ZERO, |extent| {
        let [low, high] = [extent.min_m, extent.max_m].map(DVec3::from_array);
        ((low + high) / 2.0).with_z(low.z)
    });
    let place = TilesetPlace::new(model.crs, config.heights, centre_m)?;
    folder::write_whole(path, folder::TILESET, |temporary| {
        let spool = temporary.parent().unwrap_or(temporary);
        let shown = ShownBuildings::of(model.records, (spool, textured), &rows, &grid)?;
        let tree = match textured {
            Some(_) => Node::named(shown.items.into_iter().zip(shown.tiles).collect()),
            None => Node::root(shown.items, config.max_buildings),
        };
        let writer = TileWriter {
            spool: Some(&shown.spool),
            grid: &grid,
            place: &place,
            properties: Some(&NamedColumns::new(&rows.columns)),
            precision: config.precision,
            textured,
        };
        let root = match &tree {
            Some(tree) => writer.root(tree, size_m, temporary)?,
            None => json!({ "boundingVolume": { "box": [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] }, "geometricError": 0 }),
        };
        let tileset = tileset(root, &overview, (shown.hidden.n(), textured.is_some()), config, &place);
        write_json(&temporary.join(LINEAGE), model.lineage)?;
        // Every viewer loads it first: without white space.
        Ok(write_whole_unflushed(&temporary.join(folder::TILESET), |out| {
            Ok(serde_json::to_writer(&mut *out, &tileset)?)
        })?)
    })?;
    Ok(overview)
}

/// The buildings that have something to show.
struct ShownBuildings {
    spool: Spool,
    items: Vec<TreeItem>,
    /// Names of their tiles in a textured city.
    tiles: Vec<String>,
    /// The others, and those of which a part has nothing.
    hidden: Wholes,
}

impl ShownBuildings {
    fn of<R: Records + ?Sized>(
        records: &R,
        (folder, textured): (&Path, Option<&TexturedCity>),
        rows: &FootprintRows,
        grid: &OutputGrid,
    ) -> Result<Self, OutputError> {
        let mut writer = SpoolWriter::new(folder)?;
        let (mut items, mut tiles, mut hidden) = (Vec::new(), Vec::new(), Wholes::default());
        records.visit(&mut |record| {
            let prism = SnappedPrism::of(record, grid, MIN_THICKNESS_M);
            hidden.add_if(prism.is_err(), record);
            let Ok(prism) = prism else { return Ok(()) };
            let tile = textured.and_then(|textured| textured.tile(&record.id));
            tiles.push(tile.unwrap_or_default().to_owned());
            let painted = textured.map(|textured| textured.solid(&record.id, &prism, grid)).transpose()?;
            let (roofed, paints) = match painted.flatten() {
                Some((faces, paints)) => (Some(faces), paints),
                None => (roof_solid::faces(record, &prism, grid, Detail::Slopes), Vec::new()),
            };
            let height_m = record.height_m.unwrap_or(0.0);
            let block = TileBuilding { prism, roofed, paints, values: rows.row(record).values, height_m };
            items.push(item(items.len(), &block, grid));
            Ok(writer.push(&block).map_err(FileError::on("cannot write", folder))?)
        })?;
        let spool = writer.finish().map_err(FileError::on("cannot write", folder))?;
        Ok(Self { spool, items, tiles, hidden })
    }
}

fn item(idx: usize, block: &TileBuilding, grid: &OutputGrid) -> TreeItem {
    let exterior = &block.prism.footprint().rings()[0];
    let low: [i64; 2] = std::array::from_fn(|a| exterior.iter().map(|p| p[a]).min().unwrap_or(0));
    let high: [i64; 2] = std::array::from_fn(|a| exterior.iter().map(|p| p[a]).max().unwrap_or(0));
    let low = DVec3::from_array(grid.metres([low[0], low[1], block.prism.base()]));
    let top = block.roofed.iter().flatten().flat_map(|face| face.rings.iter().flatten()).map(|p| p[2]);
    let high = DVec3::from_array(grid.metres([high[0], high[1], top.fold(block.prism.roof(), i64::max)]));
    let middle = (low + high) / 2.0;
    TreeItem { idx, centre: [middle.x, middle.y], size_m: (high - low).length() }
}

/// Size of a city, metres.
fn size_m(overview: &Overview) -> f64 {
    overview.extent.map_or(0.0, |e| (DVec3::from_array(e.max_m) - DVec3::from_array(e.min_m)).length())
}

fn tileset(
    mut root: Value,
    overview: &Overview,
    (n_without_solid, has_textures): (usize, bool),
    config: &Tiles3dConfig,
    place: &TilesetPlace,
) -> Value {
    root["transform"] = json!(place.transform());
    root["refine"] = json!("ADD");
    let root_error_m = root["geometricError"].as_f64().unwrap_or(0.0);
    json!({
        "asset": {
            "version": "1.1",
            "extras": { "sizeup": {
                "lineage": LINEAGE,
                "heights": config.heights,
                "n_buildings": overview.n_buildings,
                "n_without_solid": n_without_solid,
                "textures": has_textures,
            } },
        },
        // Without any tile the whole city is missing.
        "geometricError": size_m(overview).max(root_error_m),
        "root": root,
    })
}

/// Writes tiles from the leaves up, so that each knows the box of those below.
struct TileWriter<'a> {
    /// Buildings of the city; `None` where they come from elsewhere.
    spool: Option<&'a Spool>,
    grid: &'a OutputGrid,
    place: &'a TilesetPlace,
    /// Columns of the buildings' attributes, which not every picture needs.
    properties: Option<&'a NamedColumns>,
    precision: Precision,
    textured: Option<&'a TexturedCity>,
}

/// Pictures of triangles, JPEG, by their position among all.
type Pictures = BTreeMap<usize, Vec<u8>>;

/// Triangles and their plain colours.
struct PaintedMesh {
    of: TileMesh,
    palette: Palette,
}

/// Binary glTF, and its box in glTF's axes.
type BoxedGlb = (Vec<u8>, [DVec3; 2]);

/// A tile that is written.
struct WrittenTile {
    json: Value,
    /// Box of the tile and all below, in glTF's axes.
    bounds: [DVec3; 2],
}

impl TileWriter<'_> {
    /// Writes the tree, and the ground beside it.
    fn root(&self, tree: &Node, size_m: f64, folder: &Path) -> Result<Value, OutputError> {
        let WrittenTile { json, bounds: [low, high] } = self.tile(tree, size_m, folder)?;
        let Some(textured) = self.textured.filter(|textured| !textured.grounds.is_empty()) else { return Ok(json) };
        let grounds: Vec<WrittenTile> =
            (0..textured.grounds.len()).map(|i| self.ground(textured, i, folder)).collect::<Result<_, _>>()?;
        let all = grounds.iter().fold([low, high], |[low, high], of| [low.min(of.bounds[0]), high.max(of.bounds[1])]);
        let size_m = (all[1] - all[0]).length();
        let children: Vec<Value> = std::iter::once(json).chain(grounds.into_iter().map(|of| of.json)).collect();
        Ok(json!({
            "boundingVolume": { "box": bounding_box(all) },
            "geometricError": rounded_up(size_m),
            "children": children,
        }))
    }

    /// Writes a ground of a textured city: near, and for far away where that is smaller.
    fn ground(&self, textured: &TexturedCity, i: usize, folder: &Path) -> Result<WrittenTile, OutputError> {
        let near = self.near_ground(textured, i)?;
        let name = |name: &str| format!("{}{name}", textured.grounds[i].0);
        let written = write_content(folder, &name(GROUND), &near)?;
        let Some((far, px_m)) = self.far_ground(textured, i)? else { return Ok(written) };
        Ok(written.after(write_content(folder, &name(FAR_GROUND), &far)?, px_m))
    }

    /// A ground of a textured city, and its box.
    fn near_ground(&self, textured: &TexturedCity, i: usize) -> Result<BoxedGlb, OutputError> {
        let (ground, jpeg) = textured.ground(i)?;
        self.ground_glb(&ground, jpeg)
    }

    /// The same for far away, and the side of its pixels, metres.
    fn far_ground(&self, textured: &TexturedCity, i: usize) -> Result<Option<(BoxedGlb, f64)>, OutputError> {
        let far = textured.far_ground(i)?;
        far.map(|(ground, jpeg, px_m)| Ok((self.ground_glb(&ground, jpeg)?, px_m))).transpose()
    }

    fn ground_glb(&self, ground: &TexturedGround, jpeg: Vec<u8>) -> Result<BoxedGlb, OutputError> {
        let mut points = ground.nodes();
        self.place.to_local(&mut points)?;
        let mesh = TileMesh::of_ground(ground, &points);
        let tile = glb::GlbTile {
            mesh: &mesh,
            rows: &[],
            palette: &Palette::default(),
            pictures: &BTreeMap::from([(0, jpeg)]),
            properties: None,
            name: GROUND,
        };
        Ok((glb::glb(&tile, self.precision), mesh.bounds()))
    }

    /// Writes a tile and all below it; without it errors are as large as `size_m`.
    fn tile(&self, node: &Node, size_m: f64, folder: &Path) -> Result<WrittenTile, OutputError> {
        // A tile of another tree's may have lost all its buildings.
        let own = if node.members.is_empty() { None } else { Some(self.content(node, folder)?) };
        let below: Vec<WrittenTile> =
            node.children.iter().map(|child| self.tile(child, node.error_m, folder)).collect::<Result<_, _>>()?;
        let boxes = own.iter().chain(&below).map(|tile| tile.bounds);
        let union = |a: [DVec3; 2], b: [DVec3; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let bounds = boxes.reduce(union).unwrap_or_default();
        let mut json =
            json!({ "boundingVolume": { "box": bounding_box(bounds) }, "geometricError": rounded_up(node.error_m) });
        let mut children: Vec<Value> = below.into_iter().map(|tile| tile.json).collect();
        if let Some(mut own) = own {
            if own.json["children"].is_array() {
                // A nearer one replaces it alone, not the tiles below.
                let error_m = own.json["geometricError"].as_f64().unwrap_or(0.0);
                json["geometricError"] = json!(rounded_up(size_m).max(error_m));
                children.insert(0, own.json);
            } else {
                json["content"] = own.json["content"].take();
            }
        }
        if !children.is_empty() {
            json["children"] = Value::Array(children);
        }
        Ok(WrittenTile { json, bounds })
    }

    /// Writes what a tile shows itself: near, and for far away where that is smaller.
    fn content(&self, node: &Node, folder: &Path) -> Result<WrittenTile, OutputError> {
        let Some(spool) = self.spool else { return Ok(WrittenTile { json: Value::Null, bounds: [DVec3::ZERO; 2] }) };
        let blocks = spool.read(&node.members).map_err(FileError::on("cannot read back for", folder))?;
        let mesh = self.mesh_of(&blocks)?;
        let write = |name: &str, pictures: &Pictures| {
            let bytes = self.glb_of(&mesh, &blocks, &node.name, pictures);
            write_content(folder, name, &(bytes, mesh.of.bounds()))
        };
        let written = write(&node.name, &self.pictures(&mesh.of)?)?;
        let Some((far, px_m)) = self.far_pictures(&mesh.of)? else { return Ok(written) };
        Ok(written.after(write(&format!("{}{FAR}", node.name), &far)?, px_m))
    }

    /// Triangles of some blocks; feature `i` is block `i`.
    fn mesh_of(&self, blocks: &[TileBuilding]) -> Result<PaintedMesh, OutputError> {
        let palette = Palette::of(blocks.iter().flat_map(TileBuilding::colours));
        Ok(PaintedMesh { of: TileMesh::of(blocks, &palette, self.grid, self.place)?, palette })
    }

    fn glb_of(&self, mesh: &PaintedMesh, blocks: &[TileBuilding], name: &str, pictures: &Pictures) -> Vec<u8> {
        let rows: Vec<&[Value]> = blocks.iter().map(|block| block.values.as_slice()).collect();
        let tile = glb::GlbTile {
            mesh: &mesh.of,
            rows: &rows,
            palette: &mesh.palette,
            pictures,
            properties: self.properties,
            name,
        };
        glb::glb(&tile, self.precision)
    }

    /// Reads the pictures that a mesh has.
    fn pictures(&self, mesh: &TileMesh) -> Result<Pictures, OutputError> {
        let Some(textured) = self.textured else { return Ok(BTreeMap::new()) };
        mesh.pages().map(|page| Ok((page, textured.picture(page)?))).collect()
    }

    /// The same as they are seen from far away, and the side of the largest of their pixels, metres; `None` where those are hardly smaller.
    fn far_pictures(&self, mesh: &TileMesh) -> Result<Option<(Pictures, f64)>, OutputError> {
        let Some(textured) = self.textured else { return Ok(None) };
        let (mut pictures, mut most_m) = (BTreeMap::new(), 0.0_f64);
        for page in mesh.pages() {
            let picture = match textured.far_picture(page)? {
                Some((far, px_m)) => {
                    most_m = most_m.max(px_m);
                    far
                }
                None => textured.picture(page)?,
            };
            pictures.insert(page, picture);
        }
        Ok((most_m > 0.0).then_some((pictures, most_m)))
    }
}

/// Writes a file of a tileset, and the tile that it is.
fn write_content(folder: &Path, name: &str, (bytes, bounds): &BoxedGlb) -> Result<WrittenTile, OutputError> {
    let uri = format!("tiles/{name}.glb");
    write_whole_unflushed(&folder.join(&uri), |out| out.write_all(bytes))?;
    let volume = json!({ "box": bounding_box(*bounds) });
    let json = json!({
        "boundingVolume": volume, "geometricError": 0, "content": { "uri": uri, "boundingVolume": volume },
    });
    Ok(WrittenTile { json, bounds: *bounds })
}

impl WrittenTile {
    /// This tile after one that shows the same from far away, with pixels of a size in metres.
    fn after(self, far: Self, px_m: f64) -> Self {
        let Self { mut json, bounds: [low, high] } = far;
        let bounds = [low.min(self.bounds[0]), high.max(self.bounds[1])];
        json["boundingVolume"] = json!({ "box": bounding_box(bounds) });
        json["geometricError"] = json!(rounded_up(FAR_PIXELS * px_m));
        json["refine"] = json!("REPLACE");
        json["children"] = json!([self.json]);
        Self { json, bounds }
    }
}

/// Half a millimetre: rounding to single precision must not put a vertex outside its box.
const BOX_MARGIN_M: f64 = 5e-4;
/// Boxes begin and end at whole millimetres, so that one within another stays so, and numbers are short.
const STEPS_A_METRE: f64 = 1000.0;

fn rounded_up(metres: f64) -> f64 {
    (metres * STEPS_A_METRE).ceil() / STEPS_A_METRE
}

/// Centre and half axes in the tileset's axes (z up), from a box in glTF's (y up).
fn bounding_box([low, high]: [DVec3; 2]) -> [f64; 12] {
    let enu_from_gltf = |p: DVec3| DVec3::new(p.x, -p.z, p.y);
    let (a, b) = (enu_from_gltf(low), enu_from_gltf(high));
    let low = ((a.min(b) - BOX_MARGIN_M) * STEPS_A_METRE).floor();
    let high = ((a.max(b) + BOX_MARGIN_M) * STEPS_A_METRE).ceil();
    let (centre, half) = ((low + high) / (2.0 * STEPS_A_METRE), (high - low) / (2.0 * STEPS_A_METRE));
    [centre.x, centre.y, centre.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z]
}
