//! How good a result is, against a reference: every number is reported with its definition.
//!
//! Heights are *differences* (roof minus ground), so the vertical references of result and truth need not agree;
//! footprints are only compared after both are in one horizontal CRS ([`read`]). Surfaces and volumes compare levels: those of
//! the reference are brought to what the result's count from (`levels`).
//!
//! | measure | module | compares |
//! |---|---|---|
//! | heights | `heights` | one number per building |
//! | footprints | [`footprints`] | areas, buildings found, corners |
//! | footprints in photos | [`photos`] | areas and buildings found, photo by photo |
//! | surface | `surface` | walls and roofs, by distance |
//! | volume | `volume`, `columns` | bodies, by what they have in common |
//!
//! Bodies come from [`solid`], references from point clouds from `clouds`.

mod bodies;
mod cloud_file;
mod clouds;
mod columns;
mod compare;
mod farthest;
pub mod footprints;
mod heights;
mod levels;
mod matching;
mod parts;
pub mod photos;
mod pictures;
pub mod read;
mod report;
pub mod solid;
mod statistics;
mod surface;
mod table;
mod volume;

use geo_types::MultiPolygon;
use serde::{Deserialize, Serialize};

pub use cloud_file::cloud_in_project;
pub use clouds::{CloudTruthOptions, truth_of_instances, truth_under_footprints};
pub use columns::{ColumnGrid, Columns};
pub use compare::{CompareError, ComparedFiles, compare_files};
pub use footprints::{FOOTPRINT_DEFINITIONS, FootprintEvaluation, evaluate_footprints};
pub use heights::{BuildingError, GroupStatistics, HeightEvaluation, HeightOptions, MatchCounts, evaluate_heights};
pub use levels::{DatumMatch, LevelAgreement, LevelError};
pub use matching::{Match, Matching, match_buildings};
pub use photos::{PHOTO_DEFINITIONS, PhotoAreas, PhotoEvaluation, evaluate_photos};
pub use pictures::{reliability, write_pictures};
pub use report::EvaluationReport;
pub use statistics::{DEFINITIONS, HeightStatistics};
pub use surface::{SURFACE_DEFINITIONS, SurfaceEvaluation, TargetSurface, evaluate_surface, nearest_on_triangle};
pub use volume::{VOLUME_DEFINITIONS, VolumeError, VolumeEvaluation, evaluate_volume, prism_iou};

/// One building of the reference, in the project's map frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthBuilding {
    /// Unique id in the reference.
    pub id: String,
    /// Footprint, metres; `None` for a reference that is only a table.
    pub footprint: Option<MultiPolygon<f64>>,
    /// Roof level minus ground level, metres.
    pub height_m: Option<f64>,
    /// Kind of building, for the table by group.
    pub group: Option<String>,
}

/// Why an evaluation is not possible.
#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
    /// Not one pair of buildings to compare.
    #[error(
        "no building of the reference ({n_truth}) matches any of the result ({n_results}) by {how}\n\
         hint: {hint}"
    )]
    NoMatch {
        /// Buildings of the reference.
        n_truth: usize,
        /// Buildings of the result.
        n_results: usize,
        /// Way in which they were matched: `id` or `overlap`.
        how: &'static str,
        /// Advice to the user: what to change or to look at.
        hint: &'static str,
    },
    /// An id stands for two buildings.
    #[error("two buildings of the {side} are called {id:?}\nhint: match by overlap, or choose another id attribute")]
    DuplicateId {
        /// Side on which the two are: `reference` or `result`.
        side: &'static str,
        /// The id that both have.
        id: String,
    },
}
