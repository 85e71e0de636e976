//! The whole path, from a configuration to a city: the only code that sees every stage.
//!
//! | stage | reads | leaves in `stages/` | files |
//! |---|---|---|---|
//! | survey | photos and poses | `survey.json` | `survey` |
//! | footprints | footprints, terrain | `footprints.json` | `dtm`, `footprints` |
//! | heights | priors | `heights.json` | `photo_ground`, `scene`, `priors`, `heights` |
//! | output | the three above | nothing: it writes the results | `output/` |
//!
//! `stages` is the loop over them, `settings` and `run_settings` are what each gets of the configuration, `artefacts` are their results on
//! disk, and `recipes` tell when these are stale. `tile` runs the stages for a part of a city.
//!
//! The survey report (`survey.json`, `pictures/survey.png`) lies beside the results; a survey that looks wrong stops the
//! run. A run can stop after any stage and start at any, from what earlier runs left behind.

mod artefacts;
mod checks;
mod commands;
mod dtm;
mod error;
mod footprints;
mod heights;
mod output;
mod photo_ground;
mod priors;
mod recipes;
mod run_settings;
mod scene;
mod settings;
mod stages;
mod survey;
mod tile;

pub use artefacts::{FootprintStage, HeightStage};
pub use checks::{check_city, check_fallback, check_lengths};
pub use commands::{PriorsDone, Wanted, compute_priors, look};
pub use dtm::{dtm_of_photos, write_dtm};
pub use error::PipelineError;
pub use output::records::{reviews_of, unstated_reference};
pub use output::report::{photos_for_city_report, write_city_report};
pub use output::textures::{BuildingTexture, PaintedTile, TextureScene, TextureSummary, Texturing, texture};
pub use output::write_project;
pub use photo_ground::PhotoGround;
pub use recipes::{files_of, footprint_files};
pub use run_settings::RunSettings;
pub use scene::{Frame, terrain_of_heights};
pub use settings::{
    DepthKind, DtmSettings, FootprintSettings, GroundSettings, HeightSettings, Origin, OutputSettings, PlaceSettings,
    RecordSettings, SceneSettings, SurveySettings,
};
pub use survey::terrain_around;
pub use tile::{CityPart, PartHashes, PartHeights, find_footprints, footprints_around, layer_of, refused_records};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::RunConfig;
use sizeup_geo::issue::Issue;
use sizeup_heights::optimise::{Solving, solve};
use sizeup_results::output::BuildingRecord;
pub use sizeup_results::output::RunSummary;

/// A part of the path, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Poses into the project's CRS.
    Survey,
    /// Footprints onto the ground.
    Footprints,
    /// One height per building.
    Heights,
    /// Results are written to disk.
    Output,
}

impl Stage {
    /// The name in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Survey => "survey",
            Self::Footprints => "footprints",
            Self::Heights => "heights",
            Self::Output => "output",
        }
    }
}

/// Which stages run, and what to write down about how they were called.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunOptions {
    /// The first stage; earlier ones are read from `stages/`.
    pub from: Stage,
    /// Last stage that is run.
    pub until: Stage,
    /// The command line, for the lineage.
    pub command: String,
}

/// Message of a run while it works.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// The beginning of a stage.
    Stage(Stage),
    /// So many sizes of the photos are done where poses are brought to agree with them.
    Align {
        /// Number of sizes of the photos done.
        done: usize,
        /// Number of sizes of the photos in all.
        total: usize,
    },
    /// So many photos were checked for blur and exposure.
    Photos {
        /// Number of photos done.
        done: usize,
        /// Number of photos in all.
        total: usize,
    },
    /// So many of the places are done where the ground is looked for in the photos.
    Ground {
        /// Number of places done.
        done: usize,
        /// Number of places in all.
        total: usize,
    },
    /// The first priors do not follow the ground; reported before the work that depends on them.
    PriorsDoubted {
        /// Number of views checked.
        n_views: usize,
    },
    /// So much of some work within a stage is done.
    Advance {
        /// Work that is under way.
        what: Solving,
        /// How much of it is done.
        done: usize,
        /// How much there is.
        total: usize,
    },
}

/// Callback for every [`Event`], from any thread.
pub type Tell<'a> = &'a (dyn Fn(Event) + Sync);

/// The result of a run in memory: what its files say.
#[derive(Debug, Clone)]
pub struct City {
    /// Numbers of the run, as `summary.json` has them.
    pub summary: RunSummary,
    /// One per building or part of one, in the order of the input; empty where the output stage did not run.
    pub records: Vec<BuildingRecord>,
    /// Issues of single items of the input, by weight; empty where the output stage did not run.
    pub issues: Vec<Issue>,
}

impl City {
    fn without_records(summary: RunSummary) -> Self {
        Self { summary, records: Vec::new(), issues: Vec::new() }
    }
}

/// Runs all stages of a configuration, writes the results, and returns them.
///
/// # Errors
/// As [`run`].
pub fn city(config: &RunConfig, tell: Tell<'_>) -> Result<City, PipelineError> {
    let options = RunOptions { from: Stage::Survey, until: Stage::Output, command: String::new() };
    stages::run(&RunSettings::of(config), &options, tell, &solve)
}

/// Runs the stages of a configuration.
///
/// # Errors
/// [`PipelineError`]: the input as a whole cannot be used, or a file cannot be written. Single photos and buildings that
/// cannot be used are issues in the output.
pub fn run(config: &RunConfig, options: &RunOptions, tell: Tell<'_>) -> Result<RunSummary, PipelineError> {
    run_with(config, options, tell, &solve)
}

pub use sizeup_heights::estimate::Solver;

/// As [`run`], with another solver in the optimiser's place. Its results belong in a folder of their own: the result of the heights
/// stage does not name the solver.
///
/// # Errors
/// As [`run`].
pub fn run_with(
    config: &RunConfig,
    options: &RunOptions,
    tell: Tell<'_>,
    solver: Solver<'_>,
) -> Result<RunSummary, PipelineError> {
    Ok(stages::run(&RunSettings::of(config), options, tell, solver)?.summary)
}
