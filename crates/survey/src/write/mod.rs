//! Writing a survey for other tools: COLMAP text, CSV, and GIS layers of cameras, view axes and image footprints.
//!
//! Poses are written in the project's CRS. Every conversion that can be read back comes with a `survey.toml` that says
//! how: nobody has to remember an offset or a convention.

mod colmap;
mod layers;
mod table;

pub use colmap::{ColmapModel, TiePoint};

use std::path::{Path, PathBuf};

use super::{Format, Survey, SurveyConfig, SurveyError, View};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_whole;
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::Terrain;

/// A form to write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// A COLMAP text model, positions minus a rounded offset: `path` is its folder.
    Colmap,
    /// A table with quaternions and complete cameras: `path` is the file.
    Csv,
    /// Three layers in longitude and latitude: `path` is their folder.
    GeoJson,
    /// Three layers in the project's CRS: `path` is the file.
    GeoPackage,
}

impl Target {
    /// The target an output path asks for by its extension; a folder is a COLMAP model.
    #[must_use]
    pub fn of_path(path: &Path) -> Self {
        match path.extension().and_then(|e| e.to_str()) {
            Some(e) if e.eq_ignore_ascii_case("csv") => Self::Csv,
            Some(e) if e.eq_ignore_ascii_case("gpkg") => Self::GeoPackage,
            Some(e) if e.eq_ignore_ascii_case("geojson") => Self::GeoJson,
            _ => Self::Colmap,
        }
    }
}

/// Files written, and what could not be.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Converted {
    /// Files, in the order they were written.
    pub files: Vec<PathBuf>,
    /// Views the target cannot express.
    pub issues: Vec<Issue>,
}

/// Reads a survey and writes it in another form.
///
/// # Errors
/// [`SurveyError`] when it cannot be read, or the files cannot be written.
pub fn convert(
    config: &SurveyConfig,
    project_crs: &Crs,
    terrain: &Terrain,
    target: Target,
    path: &Path,
) -> Result<Converted, SurveyError> {
    let survey = super::read(config, project_crs)?;
    write(&survey, project_crs, terrain, target, path)
}

/// Writes a survey that is already in the project's CRS.
///
/// # Errors
/// [`SurveyError`] when the files cannot be written or the CRS cannot be reached.
pub fn write(
    survey: &Survey,
    project_crs: &Crs,
    terrain: &Terrain,
    target: Target,
    path: &Path,
) -> Result<Converted, SurveyError> {
    match target {
        Target::Colmap => colmap::write(survey, project_crs, path),
        Target::Csv => table::write(survey, project_crs, path),
        Target::GeoJson => layers::write_geojson(survey, project_crs, terrain, path),
        Target::GeoPackage => layers::write_geopackage(survey, project_crs, terrain, path),
    }
}

/// The folder that holds all photos, from the root, where they are known.
fn images_folder(views: &[View]) -> Option<PathBuf> {
    let mut folders =
        views.iter().filter_map(|view| Some(std::path::absolute(view.image.as_ref()?).ok()?.parent()?.to_owned()));
    let first = folders.next()?;
    folders
        .try_fold(first, |shared, folder| Some(shared.ancestors().find(|above| folder.starts_with(above))?.to_owned()))
}

/// The configuration that reads a conversion back, beside it.
fn write_config(config: &SurveyConfig, path: &Path) -> Result<PathBuf, SurveyError> {
    debug_assert_ne!(config.format, Format::Auto, "a conversion knows its format");
    let text = toml::to_string(config).map_err(|e| SurveyError::config(e.to_string(), ""))?;
    write_whole(path, |file| {
        writeln!(file, "# Reads this conversion back: the [survey] table of a configuration.\n{text}")
    })?;
    Ok(path.to_owned())
}
