//! `GeoPackage` 1.2 (OGC 12-128r15): what planners open in QGIS.
//!
//! | layer | geometry | content |
//! |---|---|---|
//! | `buildings` | Polygon | footprint and all attributes, one row per building of the input |
//! | `buildings_lod1` | `MultiPolygonZ` | faces of the solid as a block, where there is one |
//! | `buildings_lod13` | `MultiPolygonZ` | faces of the solid with the levels of its roof, a block where there is one level |
//! | `buildings_lod2` | `MultiPolygonZ` | faces of the solid with its roof, a block where no other form was found |
//! | `footprints_moved` | Polygon | footprints that are off, where the photos show their buildings; only where there are any |
//! | `tiles` | Polygon | areas that were worked on one by one; one row if the run was not divided |
//! | `cameras` | `PointZ` | projection centres, viewing directions, photo names |
//! | `qa_issues` | Point | what was wrong with single items of the input |
//!
//! Lineage is in the table `sizeup_lineage`, meanings of the columns in `gpkg_data_columns`, the default style in `layer_styles`.

mod layers;
mod project;
mod tables;

pub(crate) use layers::{FieldOf, field};
pub use project::{ProjectGround, write_project};
pub use tables::LINEAGE_TABLE;
pub(crate) use tables::lineage as write_lineage;

use crate::output::grid::SCALE_M;
use crate::output::prism::MIN_THICKNESS_M;
use std::path::Path;

use super::footprints::FootprintRows;
use super::grid::OutputGrid;
use super::roof_solid::Detail;
use super::{CityModel, OutputError, Overview, Records};
use sizeup_geo::files::write_whole_by_name;
use sizeup_geo::geodata::gpkg;

/// Time of the last change when the lineage has no reference date.
pub(crate) const NO_DATE: &str = "1970-01-01";

/// Whether a layer is part of a city's file.
fn is_written(layer: &str, overview: &Overview) -> bool {
    layer != "footprints_moved" || overview.has_shifts
}

/// Writes `path` (`….gpkg`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, GDAL, the file system.
pub fn write<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    write_divided(path, model, &[])
}

/// An area that was worked on by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct TileArea {
    /// Name of the area.
    pub name: String,
    /// `done`, or why not.
    pub status: &'static str,
    /// West, south, east, north; map frame, metres.
    pub corners_m: [f64; 4],
    /// Buildings that it brought.
    pub n_buildings: usize,
    /// Buildings with a height.
    pub n_heights: usize,
}

/// As [`write()`], of a run that was divided into `areas`.
///
/// # Errors
/// As [`write()`].
pub fn write_divided<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    areas: &[TileArea],
) -> Result<Overview, OutputError> {
    let overview = Overview::of(model.records)?;
    let grid = overview.grid(SCALE_M)?;
    let footprints = FootprintRows::new(&overview, grid, MIN_THICKNESS_M);
    let timestamp = format!("{}T00:00:00.000Z", model.lineage.reference_date.as_deref().unwrap_or(NO_DATE));
    write_whole_by_name(path, |temporary| {
        gpkg::create(temporary, model.crs.definition(), &timestamp, |writer| {
            writer.create_data_columns()?;
            layers::buildings(writer, model.records, &footprints)?;
            layers::blocks(writer, model.records, &grid)?;
            layers::roofed(writer, model.records, &grid, Detail::Levels)?;
            layers::roofed(writer, model.records, &grid, Detail::Slopes)?;
            if overview.has_shifts {
                layers::moved(writer, model.records)?;
            }
            layers::tiles(writer, &overview, areas)?;
            layers::cameras(writer, model.survey)?;
            layers::issues(writer, model.issues)?;
            tables::lineage(writer, model.lineage)?;
            tables::styles(writer, |layer| is_written(layer, &overview), &timestamp)
        })
    })?;
    Ok(overview)
}
