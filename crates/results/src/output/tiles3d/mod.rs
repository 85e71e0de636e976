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

pub(super) mod folder;
pub(super) mod glb;
mod mesh;
mod metadata;
mod place;
mod quadtree;
mod spool;

use crate::output::grid::SCALE_M;
use crate::output::prism::MIN_THICKNESS_M;
use std::path::Path;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::buildings::Wholes;
use super::footprints::FootprintRows;
use super::grid::OutputGrid;
use super::picture::colour::{Rgb, height_colour};
use super::prism::SnappedPrism;
use super::reports::write_json;
use super::roof_solid::{self, Detail};
use super::{CityModel, OutputError, Overview, Records};
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
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    let rows = FootprintRows::new(&overview, grid, MIN_THICKNESS_M);
    let centre_m = overview.extent.map_or(DVec3::ZERO, |extent| {
        let [low, high] = [extent.min_m, extent.max_m].map(DVec3::from_array);
        ((low + high) / 2.0).with_z(low.z)
    });
    let place = TilesetPlace::new(model.crs, config.heights, centre_m)?;
    folder::write_whole(path, folder::TILESET, |temporary| {
        let shown = ShownBuildings::of(model.records, temporary.parent().unwrap_or(temporary), &rows, &grid)?;
        let tree = Node::root(shown.items, config.max_buildings);
        let writer = TileWriter {
            spool: &shown.spool,
            grid: &grid,
            place: &place,
            properties: &NamedColumns::new(&rows.columns),
            precision: config.precision,
        };
        let root = match &tree {
            Some(tree) => writer.tile(tree, temporary)?.json,
            None => json!({ "boundingVolume": { "box": [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] }, "geometricError": 0 }),
        };
        let tileset = tileset(root, &overview, shown.hidden.n(), config, &place);
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
    /// The others, and those of which a part has nothing.
    hidden: Wholes,
}

impl ShownBuildings {
    fn of<R: Records + ?Sized>(
        records: &R,
        folder: &Path,
        rows: &FootprintRows,
        grid: &OutputGrid,
    ) -> Result<Self, OutputError> {
        let mut writer = SpoolWriter::new(folder)?;
        let (mut items, mut hidden) = (Vec::new(), Wholes::default());
        records.visit(&mut |record| {
            let prism = SnappedPrism::of(record, grid, MIN_THICKNESS_M);
            hidden.add_if(prism.is_err(), record);
            let Ok(prism) = prism else { return Ok(()) };
            let roofed = roof_solid::faces(record, &prism, grid, Detail::Slopes);
            let height_m = record.height_m.unwrap_or(0.0);
            let block = TileBuilding { prism, roofed, values: rows.row(record).values, height_m };
            items.push(item(items.len(), &block, grid));
            Ok(writer.push(&block).map_err(FileError::on("cannot write", folder))?)
        })?;
        let spool = writer.finish().map_err(FileError::on("cannot write", folder))?;
        Ok(Self { spool, items, hidden })
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

fn tileset(
    mut root: Value,
    overview: &Overview,
    n_without_solid: usize,
    config: &Tiles3dConfig,
    place: &TilesetPlace,
) -> Value {
    root["transform"] = json!(place.transform());
    root["refine"] = json!("ADD");
    // Without any tile the whole city is missing.
    let size_m = overview.extent.map_or(0.0, |e| (DVec3::from_array(e.max_m) - DVec3::from_array(e.min_m)).length());
    json!({
        "asset": {
            "version": "1.1",
            "extras": { "sizeup": {
                "lineage": LINEAGE,
                "heights": config.heights,
                "n_buildings": overview.n_buildings,
                "n_without_solid": n_without_solid,
            } },
        },
        "geometricError": size_m,
        "root": root,
    })
}

/// Writes tiles from the leaves up, so that each knows the box of those below.
struct TileWriter<'a> {
    spool: &'a Spool,
    grid: &'a OutputGrid,
    place: &'a TilesetPlace,
    properties: &'a NamedColumns,
    precision: Precision,
}

/// A tile that is written.
struct WrittenTile {
    json: Value,
    /// Box of the tile and all below, in glTF's axes.
    bounds: [DVec3; 2],
}

impl TileWriter<'_> {
    fn tile(&self, node: &Node, folder: &Path) -> Result<WrittenTile, OutputError> {
        let uri = format!("tiles/{}.glb", node.name);
        let own = self.content(node, &folder.join(&uri))?;
        let children: Vec<WrittenTile> =
            node.children.iter().map(|child| self.tile(child, folder)).collect::<Result<_, _>>()?;
        let bounds =
            children.iter().fold(own, |[low, high], child| [low.min(child.bounds[0]), high.max(child.bounds[1])]);
        let mut json = json!({
            "boundingVolume": { "box": bounding_box(bounds) },
            "geometricError": (node.error_m * STEPS_A_METRE).ceil() / STEPS_A_METRE,
            "content": { "uri": uri, "boundingVolume": { "box": bounding_box(own) } },
        });
        if !children.is_empty() {
            json["children"] = children.into_iter().map(|child| child.json).collect();
        }
        Ok(WrittenTile { json, bounds })
    }

    /// Writes what a tile shows itself; its box.
    fn content(&self, node: &Node, path: &Path) -> Result<[DVec3; 2], OutputError> {
        let blocks = self.spool.read(&node.members).map_err(FileError::on("cannot read back for", path))?;
        let mesh = TileMesh::of(blocks.iter(), self.grid, self.place)?;
        let rows: Vec<&[Value]> = blocks.iter().map(|block| block.values.as_slice()).collect();
        let colours: Vec<Rgb> = blocks.iter().map(|block| height_colour(block.height_m)).collect();
        let tile = glb::GlbTile { mesh: &mesh, rows: &rows, colours: &colours, properties: self.properties };
        let bytes = glb::glb(&tile, self.precision);
        write_whole_unflushed(path, |out| out.write_all(&bytes))?;
        Ok(mesh.bounds())
    }
}

/// Half a millimetre: rounding to single precision must not put a vertex outside its box.
const BOX_MARGIN_M: f64 = 5e-4;
/// Boxes begin and end at whole millimetres, so that one within another stays so, and numbers are short.
const STEPS_A_METRE: f64 = 1000.0;

/// Centre and half axes in the tileset's axes (z up), from a box in glTF's (y up).
fn bounding_box([low, high]: [DVec3; 2]) -> [f64; 12] {
    let enu_from_gltf = |p: DVec3| DVec3::new(p.x, -p.z, p.y);
    let (a, b) = (enu_from_gltf(low), enu_from_gltf(high));
    let low = ((a.min(b) - BOX_MARGIN_M) * STEPS_A_METRE).floor();
    let high = ((a.max(b) + BOX_MARGIN_M) * STEPS_A_METRE).ceil();
    let (centre, half) = ((low + high) / (2.0 * STEPS_A_METRE), (high - low) / (2.0 * STEPS_A_METRE));
    [centre.x, centre.y, centre.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z]
}
