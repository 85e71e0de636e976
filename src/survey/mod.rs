//! Surveys: photos with poses, in the project's map frame.
//!
//! One file per pose format turns what a tool wrote into poses in that file's world; conventions are converted in the
//! reader and nowhere else. [`locate`] then moves them to the project's CRS. What cannot be used becomes an [`Issue`]
//! in [`Survey::issues`].

pub mod angles;
mod colmap;
mod config;
mod csv;
mod error;
mod locate;
mod photos;
mod poses;
mod view;

pub use config::{CameraConfig, CsvConfig, Format, PixelOrigin, SurveyConfig};
pub use error::{Hint, Place, SurveyError};
pub use view::{NADIR_WITHIN_DEG, View, ViewKind};

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::crs::Crs;
use crate::issue::Issue;

/// All usable views, in the order of their names, and what was refused.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Survey {
    /// Usable views, sorted by id.
    pub views: Vec<View>,
    /// Photos and poses that could not be used, and why.
    pub issues: Vec<Issue>,
}

/// Reads a survey and moves it to the project's CRS.
///
/// # Errors
/// [`SurveyError`] when the file as a whole cannot be read, its CRS cannot be reached, or no pose is usable. A single
/// photo that cannot be used is an issue of the survey.
pub fn read(config: &SurveyConfig, project_crs: &Crs) -> Result<Survey, SurveyError> {
    project_crs.require_projected_metres()?;
    let poses = match format_of(config)? {
        Format::Colmap | Format::Auto => colmap::read(&config.path)?,
        Format::Csv => csv::read(&config.path, &config.csv.clone().unwrap_or_default())?,
    };
    let (views, issues) = locate::locate(poses, config, project_crs)?;
    Ok(Survey { views, issues })
}

fn format_of(config: &SurveyConfig) -> Result<Format, SurveyError> {
    if config.format != Format::Auto {
        return Ok(config.format);
    }
    if config.csv.is_some() {
        return Ok(Format::Csv);
    }
    detect(&config.path)
}

/// The format of a file or folder, from its name and first bytes.
fn detect(path: &Path) -> Result<Format, SurveyError> {
    if colmap::is_model(path) {
        return Ok(Format::Colmap);
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "csv" | "tsv" => Ok(Format::Csv),
        _ => Err(SurveyError::config(
            format!("the format of {} is not recognised", path.display()),
            "set `format` to colmap or csv",
        )),
    }
}
