//! Surveys: photos with poses, in the project's map frame.
//!
//! One file per pose format turns what a tool wrote into poses in that file's world; conventions are converted in the
//! reader and nowhere else. `locate` then moves them to the project's CRS. What cannot be used becomes an [`Issue`]
//! in [`Survey::issues`].

pub mod angles;
mod blocks_exchange;
mod colmap;
mod compare;
mod config;
mod csv;
mod error;
pub mod ground;
mod heights;
mod inspect;
mod locate;
mod metashape;
mod opensfm;
mod opf;
mod photo;
mod photos;
mod pix4d;
mod poses;
mod report;
mod tables;
mod trials;
mod view;
mod whole;
mod write;
mod xml;

pub use compare::{CornerErrors, GroundPolygons};
pub use config::{
    CameraConfig, CsvConfig, Format, HeightConfig, HeightReference, PixelOrigin, SurveyConfig, TangentialOrder,
};
pub use error::{Hint, Place, SurveyError};
pub use inspect::{Reading, Site, inspect};
pub use report::{Spread, SurveyReport, Trial};
pub use view::{NADIR_WITHIN_DEG, View, ViewKind};
pub use write::{ColmapModel, Converted, Target, TiePoint, convert, write};

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::crs::Crs;
use crate::files::FileError;
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
    let config = &with_own_photos(config)?;
    let (survey, facts) = locate::locate(read_poses(config)?, config, project_crs)?;
    if survey.views.is_empty() {
        let first = survey.issues.first().map_or("the file lists none", |issue| issue.message.as_str()).to_owned();
        let hint = "check the survey's format, CRS and angle convention".into();
        return Err(SurveyError::NothingUsable { path: config.path.clone(), n_poses: facts.n_poses, first, hint });
    }
    Ok(survey)
}

/// Photos that bring their own poses are their own images: a folder of them, or the one.
fn with_own_photos(config: &SurveyConfig) -> Result<SurveyConfig, SurveyError> {
    let mut config = config.clone();
    if config.images.is_none() && format_of(&config)? == Format::Photos {
        config.images = Some(config.path.clone());
    }
    Ok(config)
}

/// The poses as the file has them.
fn read_poses(config: &SurveyConfig) -> Result<poses::Poses, SurveyError> {
    let path = config.path.as_path();
    let camera = config.camera.as_ref();
    match format_of(config)? {
        Format::Colmap | Format::Auto => colmap::read(path),
        Format::Csv => csv::read(path, &config.csv.clone().unwrap_or_default(), camera),
        Format::Photos => photo::read(config),
        Format::BlocksExchange => blocks_exchange::read(path, config.tangential),
        Format::Opensfm => opensfm::read(path),
        Format::Odm => opensfm::read_shots(path),
        Format::GeoTxt => tables::read_geo_txt(path, camera),
        Format::Metashape => metashape::read(path),
        Format::MetashapeOpk => tables::read_metashape_opk(path, camera),
        Format::Pix4d => pix4d::read(path, camera),
        Format::Opf => opf::read(path),
    }
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
    let unknown = || {
        let message = format!("the format of {} is not recognised", path.display());
        SurveyError::config(message, "set `format`; see the documentation for the list of formats")
    };
    if path.is_dir() {
        return if colmap::is_model(path) {
            Ok(Format::Colmap)
        } else if path.join("reconstruction.json").is_file() {
            Ok(Format::Opensfm)
        } else if pix4d::find(path).is_some() {
            Ok(Format::Pix4d)
        } else if opf::find(path).is_some() {
            Ok(Format::Opf)
        } else if photos::list(path)?.is_empty() {
            Err(unknown())
        } else {
            Ok(Format::Photos)
        };
    }
    let mut head = Vec::new();
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    file.take(HEAD_BYTES).read_to_end(&mut head).map_err(FileError::on("cannot read", path))?;
    let head = String::from_utf8_lossy(&head);
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_ascii_lowercase();
    let has_extension = |extension: &str| name.rsplit('.').next() == Some(extension);
    if has_extension("opf") {
        Ok(Format::Opf)
    } else if blocks_exchange::is_blocks_exchange(path, &head) {
        Ok(Format::BlocksExchange)
    } else if metashape::is_metashape(&head) {
        Ok(Format::Metashape)
    } else if pix4d::find(path).is_some() {
        Ok(Format::Pix4d)
    } else if name == "geo.txt" {
        Ok(Format::GeoTxt)
    } else if has_extension("geojson") && head.contains("\"filename\"") {
        Ok(Format::Odm)
    } else if has_extension("json") && head.trim_start().starts_with('[') {
        Ok(Format::Opensfm)
    } else if head.contains("PhotoID") {
        Ok(Format::MetashapeOpk)
    } else if has_extension("csv") || has_extension("tsv") {
        Ok(Format::Csv)
    } else {
        Err(unknown())
    }
}

/// So much of a file shows its format.
const HEAD_BYTES: u64 = 1 << 12;
