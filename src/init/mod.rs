//! A folder of photos as a project: what lies there, what is chosen from it and why, what is missing, and the configuration
//! that says so.
//!
//! ```text
//! folder ─ what lies there ─┬─ poses ─ frame (CRS) ─ datum (heights) ─┐
//!                           ├─ footprints ──────────────────────────────┼─ file (TOML) ─ Beginning
//!                           └─ ground ────────────────────────────────┘
//! ```
//!
//! Nothing is guessed in silence: what is not said by the files is left out and asked for, or taken from what the photos say
//! with its uncertainty beside it.

mod checks;
mod datum;
mod empty;
mod error;
mod file;
mod flight;
mod folder;
mod footprints;
mod frame;
mod ground;
mod place;
mod placing;
mod poses;
mod project;
mod sheet;

pub use error::InitError;
pub use project::{Beginning, Lack, begin};

use std::path::PathBuf;

/// Request to `sizeup init`: the folder, and whatever the user states.
#[derive(Debug, Clone)]
pub struct InitRequest {
    /// The folder to look into.
    pub folder: PathBuf,
    /// The configuration to write; paths in it count from its folder.
    pub output: PathBuf,
    /// The project's CRS, in place of the one that follows from what lies there.
    pub crs: Option<String>,
    /// Offset taken off the poses' positions, metres.
    pub offset: Option<[f64; 3]>,
    /// Footprints, in place of those that lie there.
    pub footprints: Option<PathBuf>,
    /// A terrain model, in place of one that lies there.
    pub dtm: Option<PathBuf>,
    /// One height of the ground, metres.
    pub ground_m: Option<f64>,
}
