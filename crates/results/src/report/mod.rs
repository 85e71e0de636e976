//! The page that people judge a result by: one HTML file with the city in 3D, the map, what was measured and in which
//! photos, and everything that deserves a second look. Nothing is loaded from elsewhere.
//!
//! ```text
//! report.html = page/*.html with page/*.css, page/*.js and the data in it
//! ```
//!
//! What comes from the input (ids, attributes, messages) is data: it stands in a block that no browser runs, escaped so
//! that it cannot end that block, and the script puts it into the page as text. A content security policy allows the
//! page's own script and style by their hashes, pictures that are part of the page, and nothing else.
//!
//! [`Server`] shows cities that are too large for one file: it streams the 3D Tiles of a result to the same viewer.

mod backdrop;
mod city;
mod config;
mod data;
mod evidence;
mod page;
mod serve;
mod textured;
mod tileset;

pub use backdrop::Backdrop;
pub use config::ReportConfig;
pub use evidence::{BuildingEvidence, ComparedPair, Crop, EdgeLine, LineKind};
pub use serve::{ServeError, Server};
pub use tileset::tileset_of;

use std::path::Path;

use image::RgbImage;
use serde::Serialize;

use crate::output::textured::TexturedCity;
use crate::output::{BuildingRecord, CityModel, OutputError};
use sizeup_geo::files::{FileError, write_whole};
use sizeup_geo::terrain::Terrain;
use sizeup_survey::SurveyReport;
use textured::TexturedData;

/// Everything that the page shows.
#[derive(Debug)]
pub struct Report<'a> {
    /// The result that is reported.
    pub model: CityModel<'a>,
    /// Ground under the buildings.
    pub terrain: &'a Terrain,
    /// One per view of the survey: what became of it.
    pub views: Vec<ViewUse>,
    /// The passes of the solver.
    pub passes: Vec<SolverPass>,
    /// Position among the records of each building of a pass.
    pub solved: &'a [usize],
    /// Footprints that were split, as no single height fits them.
    pub levels: Vec<LevelFit>,
    /// Whether the poses look right, where that is known.
    pub survey: Option<SurveyReport>,
    /// Single buildings as the photos show them.
    pub evidence: Vec<BuildingEvidence>,
    /// The city as a picture, for print and for browsers without WebGL.
    pub overview: Option<RgbImage>,
    /// The ground as photos show it, under the map.
    pub backdrop: Option<Backdrop>,
    /// The city with textures from the photos, shown first where there is one.
    pub textured: Option<&'a TexturedCity>,
    /// The resolved configuration, TOML.
    pub config: String,
}

/// Use of a view.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "use", content = "why")]
pub enum ViewUse {
    /// Heights were measured in it, or it was selected to.
    Measured,
    /// It sees nothing that others do not see better.
    NotNeeded,
    /// It looks straight down, or up.
    NotOblique,
    /// It was selected, and its prior could not be used.
    Failed(String),
}

/// One pass of the solver over all buildings.
#[derive(Debug, Clone, PartialEq)]
pub struct SolverPass {
    /// Mean loss over the views.
    pub loss: f64,
    /// Mean relative change of the heights.
    pub relative_change: f64,
    /// Number of views selected.
    pub n_selected: usize,
    /// Share of ordinal pairs that cost something, where there are pairs.
    pub active_pairs: Option<f64>,
    /// Heights after the pass, metres, one per building of [`Report::solved`].
    pub heights_m: Vec<f32>,
}

/// Fit of one level to a footprint, and of two.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LevelFit {
    /// The building that was split.
    pub whole: String,
    /// Two levels above ground, metres.
    #[serde(rename = "heights")]
    pub heights_m: [f32; 2],
    /// Mean score over views of both together.
    pub two: f64,
    /// The same of one level: height, metres, and score.
    #[serde(rename = "curve")]
    pub one: Vec<(f32, f64)>,
    /// Views that had a say.
    pub n_views: usize,
}

/// Writes the page, whole or not at all.
///
/// # Errors
/// [`OutputError`]: a textured city that cannot be read, or the file system.
pub fn write(path: &Path, report: &Report<'_>) -> Result<(), OutputError> {
    let data = data::Data::of(report);
    let json =
        serde_json::to_string(&data).map_err(std::io::Error::other).map_err(FileError::on("cannot write", path))?;
    let html = page::report(&data.title, &json, &TexturedData::json(report.model.records, report.textured)?);
    Ok(write_whole(path, |out| out.write_all(html.as_bytes()))?)
}

/// Puts the textures of a city into a page that is there already, whole or not at all; whether there is one.
///
/// # Errors
/// As [`write()`].
pub fn retexture(
    path: &Path,
    records: &[BuildingRecord],
    textured: Option<&TexturedCity>,
) -> Result<bool, OutputError> {
    if !path.is_file() {
        return Ok(false);
    }
    let html = std::fs::read_to_string(path).map_err(FileError::on("cannot read", path))?;
    let Some(html) = page::retextured(&html, &TexturedData::json(records, textured)?) else { return Ok(false) };
    write_whole(path, |out| out.write_all(html.as_bytes()))?;
    Ok(true)
}
