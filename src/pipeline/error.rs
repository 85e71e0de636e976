//! Errors that stop a run, and their exit codes.

use std::path::PathBuf;

use crate::config::ConfigError;
use sizeup_footprints::{FootprintError, WriteFootprintsError};
use sizeup_geo::crs::CrsError;
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::WriteError;
use sizeup_geo::terrain::TerrainError;
use sizeup_photos::align::AlignError;
use sizeup_photos::dtm::DtmError;
use sizeup_photos::prior::PriorError;
use sizeup_results::output::OutputError;
use sizeup_results::output::reviews::ReviewsError;
use sizeup_survey::SurveyError;

/// Failure that stops a run.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// A configuration that cannot be read or used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A CRS that the project cannot have.
    #[error("[project] {0}")]
    Crs(#[from] CrsError),
    /// A survey that cannot be read.
    #[error("[survey] {0}")]
    Survey(#[from] SurveyError),
    /// The poses look wrong.
    #[error(
        "[survey] the poses look wrong\n{findings}\nhint: {cure}; the whole report is in {}",
        report.display()
    )]
    Unsound {
        /// Doubts, and other readings that look better; a line each.
        findings: String,
        /// Advice: what to change or to check.
        cure: &'static str,
        /// File of the survey's report.
        report: PathBuf,
    },
    /// The poses were to be aligned, and cannot be.
    #[error(transparent)]
    Align(#[from] AlignError),
    /// Footprints that cannot be read or found.
    #[error("[footprints] {0}")]
    Footprints(#[from] FootprintError),
    /// A terrain model that cannot be read or used.
    #[error("[terrain] {0}")]
    Terrain(#[from] TerrainError),
    /// A terrain model from the photos cannot be made.
    #[error(transparent)]
    Dtm(#[from] DtmError),
    /// Priors that cannot be set up.
    #[error("[prior] {0}")]
    Prior(#[from] PriorError),
    /// A file of decisions that cannot be read.
    #[error("[reviews] {0}")]
    Reviews(#[from] ReviewsError),
    /// The settings of a stage contradict each other or the data.
    #[error("[{table}] {message}\nhint: {hint}")]
    Settings {
        /// Table of the configuration.
        table: &'static str,
        /// Settings that do not go together, in words.
        message: String,
        /// Advice: what to change or to check.
        hint: &'static str,
    },
    /// Survey and footprints do not fit together.
    #[error("{message}\nhint: {hint}")]
    Mismatch {
        /// The expected and the found, in words.
        message: String,
        /// Advice: what to change or to check.
        hint: &'static str,
    },
    /// Input that cannot be used as it is, with advice that depends on it.
    #[error("{message}\nhint: {hint}")]
    Unusable {
        /// The expected and the found, in words.
        message: String,
        /// Advice: what to change or to check.
        hint: String,
    },
    /// No prior could be loaded.
    #[error("none of the {n} depth priors asked for could be used; the first, of {view}: {reason}")]
    NoPriors {
        /// Number of priors wanted.
        n: usize,
        /// Name of the first view without one.
        view: String,
        /// Why it could not be used.
        reason: String,
    },
    /// Artefact of an earlier stage that cannot be used.
    #[error("{}: {message}\nhint: run again from the {stage} stage (--from {stage})", path.display())]
    Artefact {
        /// Path of the stage's file.
        path: PathBuf,
        /// The problem with the file, in words.
        message: String,
        /// The stage that makes it.
        stage: &'static str,
    },
    /// A result cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The terrain model made from the photos cannot be written.
    #[error(transparent)]
    Model(#[from] WriteError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

impl From<WriteFootprintsError> for PipelineError {
    fn from(error: WriteFootprintsError) -> Self {
        match error {
            WriteFootprintsError::Gpkg(error) => Self::Output(error.into()),
            WriteFootprintsError::File(error) => Self::File(error),
        }
    }
}

impl PipelineError {
    /// 2 usage or configuration, 3 bad input, 4 failed.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Align(e) if e.is_usage() => 2,
            Self::Config(_)
            | Self::Crs(_)
            | Self::Settings { .. }
            | Self::Survey(SurveyError::Crs(CrsError::NotProjectedInMetres { .. })) => 2,
            Self::Survey(_)
            | Self::Unsound { .. }
            | Self::Footprints(_)
            | Self::Terrain(_)
            | Self::Prior(_)
            | Self::Reviews(_)
            | Self::Dtm(_)
            | Self::Align(_)
            | Self::Mismatch { .. }
            | Self::Unusable { .. }
            | Self::NoPriors { .. }
            | Self::Artefact { .. } => 3,
            Self::Output(error) => error.exit_code(),
            Self::File(error) if error.is_of_input() => 3,
            Self::Model(_) | Self::File(_) => 4,
        }
    }
}
