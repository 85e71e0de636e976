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

mod content;
mod files;
pub(super) mod folder;
pub(super) mod glb;
mod map_view;
mod mesh;
mod metadata;
mod place;
pub(super) mod quadtree;
mod shown;
mod volume;

use std::path::Path;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::footprints::FootprintRows;
use super::grid::SCALE_M;
use super::prism::MIN_THICKNESS_M;
use super::reports::write_json;
use super::textured::TexturedCity;
use super::{CityModel, OutputError, Overview, Records};
use content::Contents;
use files::TileFiles;
pub use glb::Precision;
pub(crate) use map_view::MapView;
use metadata::NamedColumns;
pub use place::Heights;
use place::TilesetPlace;
use shown::ShownBuildings;
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_whole_unflushed;

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
        let scratch = temporary.parent().unwrap_or(temporary);
        let mut shown = ShownBuildings::of(model.records, (scratch, textured), &rows, &grid)?;
        let tree = shown.take_tree(textured, config.max_buildings);
        let files = TileFiles {
            contents: Contents {
                grid: &grid,
                place: &place,
                properties: Some(&NamedColumns::new(&rows.columns)),
                precision: config.precision,
                textured,
            },
            shown: &shown,
            folder: temporary,
        };
        let root = match &tree {
            Some(tree) => files.write(tree, size_m)?,
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
