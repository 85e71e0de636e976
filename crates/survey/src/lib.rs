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
mod csv_header;
mod error;
mod first_look;
mod formats;
mod geo_txt;
pub mod ground;
mod heights;
mod inpho;
mod inspect;
mod locate;
mod metashape;
mod metashape_opk;
mod names;
mod nerfstudio;
mod odm;
mod odm_frame;
mod opensfm;
mod opf;
mod photo;
mod photos;
mod pix4d;
mod poses;
mod report;
mod stac;
mod text;
mod trials;
mod view;
mod viewpoints;
mod whole;
mod write;
mod xml;

pub use colmap::{SparseGround, sparse_ground};
pub use compare::{CornerErrors, GroundPolygons};
pub use config::{CameraConfig, CsvConfig, HeightConfig, PixelOrigin, SurveyConfig, TangentialOrder, VerticalDatum};
pub use error::{Hint, Place, SurveyError};
pub use first_look::{FirstLook, PoseWorld, StatedHeights, WorldGuess, first_look, recognise};
pub use formats::{Format, POSE_EXTENSIONS};
use formats::{format_of, read_poses};
pub use inspect::{Reading, Site, inspect};
pub use photo::{PhotoFacts, flight_day, photo_facts};
pub use photos::{PhotoIndex, is_photo, is_result, mismatch};
pub use report::{Spread, SurveyReport, Trial};
pub use view::{View, ViewKind};
pub use viewpoints::Viewpoints;
pub use write::{ColmapModel, Converted, Target, TiePoint, convert, write};

use serde::{Deserialize, Serialize};

use sizeup_geo::crs::Crs;
use sizeup_geo::issue::{Issue, Severity};

/// All usable views, in the order of their names, and what was refused.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Survey {
    /// Usable views, sorted by id.
    pub views: Vec<View>,
    /// Photos and poses that could not be used, and why.
    pub issues: Vec<Issue>,
}

impl Survey {
    /// Kind of the views that heights are measured in: oblique ones, or nadir ones in a flight that has no others.
    #[must_use]
    pub fn kind_for_heights(&self) -> ViewKind {
        ViewKind::for_heights(self.views.iter().map(View::kind))
    }

    /// The views that heights are measured in.
    pub fn views_for_heights(&self) -> impl Iterator<Item = &View> {
        let kind = self.kind_for_heights();
        self.views.iter().filter(move |view| view.kind() == kind)
    }
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
        // A photo that never had a pose says nothing of those that cannot be used.
        let without = |issue: &&Issue| issue.code != "photo_without_pose" && issue.severity == Severity::Refused;
        let first = survey.issues.iter().find(without).or(survey.issues.first());
        let first = first.map_or("the file lists none", |issue| issue.message.as_str()).to_owned();
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
