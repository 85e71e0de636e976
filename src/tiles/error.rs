//! What stops a plan, a tile or a merge.

use std::path::PathBuf;

use crate::pipeline::PipelineError;
use sizeup_footprints::FootprintError;
use sizeup_geo::files::FileError;
use sizeup_results::output::OutputError;

/// Failure that stops a plan, a tile or a merge.
#[derive(Debug, thiserror::Error)]
pub enum TilesError {
    /// As in a run of the whole.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// A setting that cannot be.
    #[error("{setting} is {found}: expected {expected}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// The value that was set.
        found: String,
        /// Values that are allowed, in words.
        expected: &'static str,
    },
    /// The `paper` preset, which cannot be run in tiles.
    #[error(
        "optimise.preset is \"paper\": its steps are shared by all buildings of a scene, so tiles would not give the same \
         heights\nhint: use the preset \"robust\""
    )]
    PaperPreset,
    /// A file of the plan that is not what it should be.
    #[error("{}: {message}\nhint: make the plan again with `sizeup tiles plan`", path.display())]
    Plan {
        /// Path of the plan's file.
        path: PathBuf,
        /// The problem with the file, in words.
        message: String,
    },
    /// A name that the plan does not have.
    #[error("the plan has no tile {id:?}\nhint: `sizeup tiles status` lists the tiles")]
    NoSuchTile {
        /// Id that was wanted.
        id: String,
    },
    /// Input of a plan or a tile that has changed.
    #[error("{what} is stale: {why}\nhint: {hint}")]
    Stale {
        /// Plan or tile that is out of date.
        what: String,
        /// The change since then, in words.
        why: String,
        /// Advice: what to change or to check.
        hint: &'static str,
    },
    /// Something that a tile reads changed while it was run.
    #[error("while tile {id} was run: {why}\nhint: run it again once nobody writes to its input")]
    ChangedMeanwhile {
        /// Id of the tile.
        id: String,
        /// The change meanwhile, in words.
        why: String,
    },
    /// Tiles that are not done.
    #[error(
        "{} of {n_tiles} tiles are not done, the first of them {first}\nhint: run them, or merge what there is with \
         --allow-missing; `sizeup tiles status` tells of each why",
        n_missing
    )]
    Missing {
        /// Number of missing tiles.
        n_missing: usize,
        /// Number of all tiles.
        n_tiles: usize,
        /// The first of them, and why.
        first: String,
    },
    /// A tile that needs more memory than there is.
    #[error(
        "tile {id} needs about {needs_mb} MB, and {has_mb} MB may be used\nhint: allow more with --memory (of a tile) or \
         --total-memory (of all that run at a time), or plan smaller tiles with --buildings"
    )]
    TooLarge {
        /// Id of the tile.
        id: String,
        /// Estimate of its need.
        needs_mb: u64,
        /// Memory that may be used.
        has_mb: u64,
    },
    /// 3D Tiles that cannot be placed on the earth.
    #[error(
        "3D Tiles of this city cannot be written: {source}\nhint: get the grid, or state what heights are: --geoid-height \
         45.5, --heights ellipsoidal, or --heights none for a city without 3D Tiles"
    )]
    Heights {
        /// Why heights are not known above the ellipsoid.
        source: OutputError,
    },
    /// A program that cannot be started.
    #[error("cannot start {}", program.display())]
    Start {
        /// The program that was to be started.
        program: PathBuf,
        /// Error that the system reported.
        #[source]
        source: std::io::Error,
    },
    /// A result cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

impl From<FootprintError> for TilesError {
    fn from(error: FootprintError) -> Self {
        Self::Pipeline(error.into())
    }
}

impl TilesError {
    /// 2 usage or configuration, 3 bad input, 4 failed.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Pipeline(error) => error.exit_code(),
            Self::Setting { .. }
            | Self::PaperPreset
            | Self::NoSuchTile { .. }
            | Self::TooLarge { .. }
            | Self::Heights { .. } => 2,
            Self::Plan { .. } | Self::Stale { .. } | Self::Missing { .. } => 3,
            Self::Output(error) => error.exit_code(),
            Self::File(error) if error.is_of_input() => 3,
            Self::ChangedMeanwhile { .. } | Self::Start { .. } | Self::File(_) => 4,
        }
    }
}
