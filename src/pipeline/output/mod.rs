//! The output stage: records, and the files that are written from them.

mod backdrop;
mod evidence;
mod overview;
pub(super) mod pictures;
pub(super) mod records;
pub(super) mod report;
pub(super) mod summary;
pub(super) mod textures;

use std::path::Path;

use super::PipelineError;
use super::settings::OutputSettings;
use crate::config::SAVED_NAME;
use sizeup_geo::files::{write_json, write_whole};
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_results::output::cityjson::CityJsonConfig;
use sizeup_results::output::geopackage::{self, ProjectGround};
use sizeup_results::output::reports::write_issues;
use sizeup_results::output::{CityModel, OutputError, Records, RunSummary, cityjson};

/// Writes the files of a result.
pub(super) fn write_results(
    settings: &OutputSettings<'_>,
    model: &CityModel<'_>,
    summary: &RunSummary,
) -> Result<(), PipelineError> {
    let folder = settings.folder.path();
    cityjson::write(&folder.join("city.city.json"), model, &CityJsonConfig::default())?;
    geopackage::write(&folder.join("city.gpkg"), model)?;
    write_project(settings, folder, "city.gpkg", model)?;
    write_issues(&folder.join("issues.json"), model.issues)?;
    write_json(&folder.join("lineage.json"), &model.lineage)?;
    summary.write(folder)?;
    write_whole(&folder.join(SAVED_NAME), |out| out.write_all(settings.config_toml.as_bytes()))?;
    Ok(())
}

/// Writes the QGIS project of a result into its folder, beside its `GeoPackage`, standing on the run's terrain.
///
/// # Errors
/// [`OutputError`].
pub fn write_project<R: Records + ?Sized>(
    settings: &OutputSettings<'_>,
    folder: &Path,
    geopackage: &str,
    model: &CityModel<'_, R>,
) -> Result<(), OutputError> {
    let terrain = &settings.ground.terrain;
    let own = terrain.dtm.as_ref().and_then(|path| RasterFile::open(path).ok()?.crs().ok()?);
    let own = own.or_else(|| terrain.crs.clone());
    let path = terrain.dtm.as_ref().map(|path| match path.strip_prefix(folder) {
        Ok(made) => made.to_owned(),
        Err(_) => settings.folder.saved(path),
    });
    let ground = match (&path, terrain.constant_m) {
        (Some(path), _) => ProjectGround::Model {
            path,
            crs: own.as_ref(),
            // A run has read it, so that its unit is known.
            unit_m: sizeup_geo::terrain::height_unit_m(terrain).unwrap_or(1.0),
            offset_m: terrain.vertical_offset_m.unwrap_or(0.0),
        },
        (None, Some(level_m)) => ProjectGround::Level(level_m),
        (None, None) => ProjectGround::LowestWall,
    };
    geopackage::write_project(&folder.join("city.qgs"), geopackage, model, ground)
}
