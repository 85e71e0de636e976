//! Where contours in photos come from: masks of any tool, or a network.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::vectorise::{Contour, MaskFault};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_survey::View;

/// The contour of a building that masks follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ContourKind {
    /// Where walls meet the ground, hidden or not: the contour is laid on the terrain.
    #[default]
    Ground,
    /// The roof: the contour is laid at the roof's height, and moves when that changes.
    Roof,
}

/// Fineness with which a view is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContourFineness {
    /// Parts and holes below this are left out, pixels² of the photo.
    pub min_area_px2: f64,
    /// Tolerance of the contours, pixels of the photo.
    pub tolerance_px: f64,
    /// Ground that a pixel of the photo covers in its middle, metres.
    pub pixel_m: f64,
}

/// The buildings that a view shows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ViewContours {
    /// Buildings, in pixels of the photo.
    pub contours: Vec<Contour>,
    /// Why a network that takes depth had none of this view: it found the buildings by colours alone.
    pub without_depth: Option<String>,
}

impl From<Vec<Contour>> for ViewContours {
    fn from(contours: Vec<Contour>) -> Self {
        Self { contours, without_depth: None }
    }
}

/// Gives the buildings that a view shows.
pub trait ContourSource: Sync {
    /// Returns the buildings of one view, in pixels of its photo.
    ///
    /// # Errors
    /// [`ViewFault`]: the view then has no say, and the others go on.
    fn contours(&self, view: &View, look: ContourFineness) -> Result<ViewContours, ViewFault>;

    /// The file that a view's contours come from, for the lineage.
    fn file_of(&self, view: &View) -> Option<PathBuf>;
}

/// Why a view gives no contours.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ViewFault {
    /// No mask where one should be.
    #[error("there is no mask for it: {} does not exist", path.display())]
    Absent {
        /// Path at which it was looked for.
        path: PathBuf,
    },
    /// The file of all masks does not name the photo.
    #[error("{} does not list it", path.display())]
    Unlisted {
        /// The list that does not name the view's photo.
        path: PathBuf,
    },
    /// It is there and cannot be read.
    #[error("its mask {} cannot be used: {reason}", path.display())]
    Unreadable {
        /// Path of the mask's file.
        path: PathBuf,
        /// The problem with the file, in the reader's words.
        reason: String,
    },
    /// It is of another photo.
    #[error(
        "its mask {} has {} × {} pixels, the photo {} × {}: not the same shape",
        path.display(), mask.0, mask.1, photo.0, photo.1
    )]
    Size {
        /// Path of the mask's file.
        path: PathBuf,
        /// Columns and rows of the mask.
        mask: (usize, usize),
        /// Columns and rows of the photo.
        photo: (u32, u32),
    },
    /// A mask from which no contour can be drawn.
    #[error("its mask {} is of no use: {fault}", path.display())]
    Mask {
        /// Path of the mask's file.
        path: PathBuf,
        /// The problem with its labels.
        fault: MaskFault,
    },
    /// The photo itself is needed.
    #[error("its photo cannot be used: {reason}")]
    Photo {
        /// Why the photo cannot be read.
        reason: String,
    },
    /// The network stopped at it.
    #[error("{problem}")]
    Network {
        /// The problem with the network or its engine, in words.
        problem: String,
        /// Advice to the user: what to change or to look at.
        hint: String,
    },
    /// None of its pixels meets the terrain.
    #[error("it sees nothing of the terrain")]
    OffTerrain,
}

impl ViewFault {
    /// As an issue of the view.
    #[must_use]
    pub fn issue(&self, view: &View) -> Issue {
        let (severity, code, hint) = match self {
            Self::Absent { .. } => (
                Severity::Warning,
                "mask_absent",
                "`path` says where masks are; {stem} is the photo's name without its extension",
            ),
            Self::Unlisted { .. } => {
                (Severity::Warning, "mask_absent", "`images` of the COCO file names photos by `file_name`")
            }
            Self::Unreadable { path, .. } if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) => {
                (Severity::Refused, "mask_unreadable", "`segmentation` is polygons or run lengths of the whole photo")
            }
            Self::Unreadable { .. } => (Severity::Refused, "mask_unreadable", "`gdalinfo` shows what GDAL makes of it"),
            Self::Size { .. } => (
                Severity::Refused,
                "mask_wrong_size",
                "masks are of the whole photo as it is stored, at any size; never cropped or turned",
            ),
            Self::Mask { fault: MaskFault::AllBuilding, .. } => {
                (Severity::Refused, "mask_all_building", "check `above` and `kind`: is 0 the background?")
            }
            Self::Mask { fault: MaskFault::Noise { .. }, .. } => (
                Severity::Refused,
                "mask_noise",
                "check `kind`: probabilities need `kind = \"probability\"` and `above`",
            ),
            Self::Photo { .. } => (Severity::Refused, "photo_unusable", "a network needs the photo's file"),
            Self::Network { hint, .. } => (Severity::Refused, "network_failed", hint.as_str()),
            Self::OffTerrain => {
                (Severity::Warning, "view_off_terrain", "use a terrain model that covers what the views see")
            }
        };
        Issue::new(severity, code, Subject::View(view.id.0.clone()), self.to_string()).hint(hint)
    }
}
