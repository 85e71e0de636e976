//! Accuracy that anyone can measure again: scenes with known truth, every method on each, tables for the documentation.
//!
//! | suite | scenes | table |
//! |---|---|---|
//! | [`accuracy`] | seeds × towns, simulated and real, × levels of prior errors | `accuracy.md` |
//! | [`passes`] | simulated towns and configurations of others, one pass of the solver changed at a time | `passes.md` |
//! | [`textures`] | simulated towns and real flights, every fifth photo left out | `textures.md` |
//! | [`paper`] | as the paper's seven scenes, small scenes, a flight without a grid; [`studies`] | `paper.md`, `studies.md` |
//!
//! A suite leaves one file per scene and method behind. A run that was stopped goes on where it was; a file is made anew
//! if the scene's or the method's settings changed. One that another program made is taken over, since most changes of a
//! program change no figure; but each says which program made it, every table says of which programs its outcomes are, and
//! [`SuitePlan::again`] makes them anew.

pub mod accuracy;
mod bodies;
mod method;
pub mod paper;
pub mod passes;
mod programs;
mod real;
mod reliability;
mod scene;
pub mod studies;
pub mod textures;

use std::path::PathBuf;

pub use bodies::BodyScores;
pub use method::{Aids, Answer, Method};
pub use programs::Programs;
pub use real::{RealCameras, RealTown};
pub use reliability::SigmaClass;
pub use scene::{Outcome, Pass, SceneJob, Variant, run_scene};
pub use studies::{Study, StudyConfig, StudyTables};

use sizeup::config::ConfigError;
use sizeup::pipeline::PipelineError;
use sizeup_geo::files::FileError;
use sizeup_results::output::read::ReadError;
use sizeup_truth::evaluate::EvaluationError;
use sizeup_truth::evaluate::solid::SolidError;
use sizeup_truth::simulate::SimulateError;

/// Folder of a suite, and what it keeps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SuitePlan {
    /// Folder of scenes, outcomes and tables.
    pub folder: PathBuf,
    /// This program: its version and what tells its builds apart. Written into each outcome.
    pub program: String,
    /// Which outcomes are made anew even where they are there.
    pub again: Again,
    /// Keep the scenes (tens of megabytes each), so that another run need not simulate them again.
    pub keep_scenes: bool,
}

/// Which outcomes are made anew although they are there.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Again {
    /// All of these methods.
    pub methods: Vec<Method>,
    /// Outcomes that another program made, of all methods.
    pub outdated: bool,
}

/// Told `(scenes done, scenes in all, what is being done)`.
pub type TellScenes<'a> = &'a dyn Fn(usize, usize, &str);

/// Why a suite ended early.
#[derive(Debug, thiserror::Error)]
pub enum BenchmarkError {
    /// Settings out of range.
    #[error("{setting} is empty\nhint: name at least one")]
    Empty {
        /// Name of the setting.
        setting: &'static str,
    },
    /// A scene could not be simulated.
    #[error("scene {scene}: {source}")]
    Simulate {
        /// Name of the scene.
        scene: String,
        /// Why the scene could not be simulated.
        source: SimulateError,
    },
    /// The cameras of a scene could not be read.
    #[error("cameras of scene {scene}: {source}")]
    Cameras {
        /// Name of the scene.
        scene: String,
        /// Why its survey could not be read.
        source: sizeup_survey::SurveyError,
    },
    /// The configuration of a simulated scene could not be read.
    #[error("scene {scene}: {source}")]
    Config {
        /// Name of the scene.
        scene: String,
        /// Why its configuration could not be read.
        source: ConfigError,
    },
    /// A method failed on a scene.
    #[error("scene {scene}, {method}: {source}")]
    Run {
        /// Name of the scene.
        scene: String,
        /// Name of the method.
        method: &'static str,
        /// Why the method did not run.
        source: PipelineError,
    },
    /// A photo that was left out cannot be compared with its rendering.
    #[error("scene {scene}: {reason}")]
    Picture {
        /// Name of the scene.
        scene: String,
        /// The problem with the picture.
        reason: String,
    },
    /// A change that the suite of passes does not have.
    #[error("no change {name:?} of a pass\nhint: the changes are {known}")]
    UnknownChange {
        /// Name that was asked for.
        name: String,
        /// Names of the changes.
        known: String,
    },
    /// A scene that no suite has.
    #[error("unknown scene {name:?}\nhint: the scenes are {known}")]
    UnknownScene {
        /// Name that was asked for.
        name: String,
        /// Names of all scenes, with commas.
        known: String,
    },
    /// A point cloud could not be read.
    #[error(transparent)]
    Cloud(#[from] sizeup_geo::cloud::CloudError),
    /// A result could not be read back.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Bodies of a result could not be read back.
    #[error(transparent)]
    Solids(#[from] SolidError),
    /// A result could not be compared with the truth.
    #[error(transparent)]
    Evaluate(#[from] EvaluationError),
    /// A file could not be written or removed.
    #[error(transparent)]
    File(#[from] FileError),
}
