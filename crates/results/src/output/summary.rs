//! `summary.json`: a result in numbers, of a run and of a city of tiles.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Status;
use sizeup_footprints::DetectionSummary;
use sizeup_geo::files::{FileError, write_json};
use sizeup_geo::issue::{Issue, Severity, Subject};

/// Codes of the issues of photos that nobody could read.
const PHOTO_MISSING: [&str; 2] = ["pose_without_photo", "photo_unreadable"];

/// Photos that the survey names and nobody could read.
#[must_use]
pub fn n_photos_missing(issues: &[Issue]) -> usize {
    let photos: BTreeSet<&Subject> =
        issues.iter().filter(|i| PHOTO_MISSING.contains(&i.code.as_str())).map(|i| &i.subject).collect();
    photos.len()
}

/// A result in numbers. A city of tiles leaves out what its tiles do not tell.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RunSummary {
    /// Objections to the result as a whole, one sentence each; empty where there are none.
    #[serde(default)]
    pub implausible: Vec<String>,
    /// Folder of the results.
    pub output: PathBuf,
    /// Changes to poses that did not fit the photos, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<String>,
    /// Where depth priors come from, in words.
    #[serde(default)]
    pub priors_from: String,
    /// Views with a usable pose.
    pub n_views: usize,
    /// Oblique ones among these, in which heights can be measured.
    pub n_oblique: usize,
    /// Distinct views whose prior was used (the paper's #Used).
    pub n_used_views: usize,
    /// Heights that the photos refined.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n_refined: Option<usize>,
    /// Buildings of the input.
    pub n_buildings: usize,
    /// Numbers of what was found in the nadir photos, where footprints come from there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detection: Option<DetectionSummary>,
    /// Buildings of the input by status, one in parts as its worst part; empty where the output stage did not run.
    pub by_status: BTreeMap<Status, usize>,
    /// Parts of buildings that came in several pieces or were split, by status.
    #[serde(default)]
    pub parts_by_status: BTreeMap<Status, usize>,
    /// Median height above ground of all buildings with one, and parts of such, metres.
    pub median_height_m: Option<f64>,
    /// Issues of all stages by severity.
    pub n_refused: usize,
    /// Warnings of all stages.
    pub n_warnings: usize,
    /// The file of the issues in the folder, where it is not `issues.json`: a run that ended early leaves the results of an
    /// earlier one, and theirs, as they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub issues_in: Option<PathBuf>,
    /// Photos that the survey names and nobody could read.
    #[serde(default)]
    pub n_photos_missing: usize,
    /// The most important problem, one sentence; `None` if all is well, or the output stage did not run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst: Option<String>,
    /// Seconds per stage that ran; in the results they are in `timing.json`, the only file that differs from run to run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seconds: Vec<(String, f64)>,
    /// The tiles of a city that was computed in such.
    #[serde(flatten)]
    pub tiles: Option<TilesSummary>,
}

/// The tiles of a city in numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TilesSummary {
    /// Tiles of the plan.
    pub n_tiles: usize,
    /// Tiles that are not done.
    pub missing_tiles: Vec<String>,
    /// Parts of buildings that came in several pieces or were split.
    pub n_parts: usize,
    /// Buildings, and parts of such, with a height.
    pub n_heights: usize,
    /// How well neighbouring tiles agree, as `tiles merge` measured it.
    pub seams: Value,
}

impl RunSummary {
    /// Whether some items of the input have no result.
    #[must_use]
    pub fn has_failed_items(&self) -> bool {
        let count = |status| self.by_status.get(&status).copied().unwrap_or(0);
        self.n_refused > 0 || self.n_photos_missing > 0 || count(Status::Unknown) > 0 || count(Status::Refused) > 0
    }

    /// Counts the issues by severity, and the photos among them that nobody could read.
    pub fn count_issues(&mut self, issues: &[Issue]) {
        self.n_refused = issues.iter().filter(|i| i.severity == Severity::Refused).count();
        self.n_warnings = issues.iter().filter(|i| i.severity == Severity::Warning).count();
        self.n_photos_missing = n_photos_missing(issues);
    }

    /// Writes `summary.json` into the folder of the results. Seconds and folders differ from run to run and stay away: the file
    /// is the same for the same input.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn write(&self, folder: &Path) -> Result<(), FileError> {
        let lasting = Self { seconds: Vec::new(), output: PathBuf::from("."), ..self.clone() };
        write_json(&folder.join("summary.json"), &lasting)
    }
}
