//! Depth priors: per-view maps whose *ordering* is trusted, not their scale (`SiZeUp`, "Depth prior").
//!
//! What a number means is declared, never guessed: [`PriorKind`] and [`PriorGeometry`] come from the configuration.

mod ahead;
mod album;
mod array;
mod auto;
mod cache;
mod check;
#[cfg(feature = "exr")]
mod exr_map;
pub mod files;
mod neighbours;
pub mod network;
mod npy;
mod pfm;
mod source;
pub mod stereo;

pub use album::Album;
pub use auto::AutoConfig;
pub use cache::{CacheConfig, CacheKey, CachedPriors, KeyHasher, PriorCache};
pub use check::{GroundCorrelation, ground_correlation, judge_tag, judge_unit, surely_inverted};
pub use files::{DepthUnit, FilePriorConfig, FilePriors};
pub(crate) use neighbours::Neighbours;
pub use network::{NetworkConfig, NetworkPriors};
pub use source::{PriorConfig, Priors};
pub use stereo::{StereoConfig, StereoPriors};

pub use sizeup_heights::prior::{DepthPrior, PriorGeometry, PriorKind};

use std::path::PathBuf;

use crate::onnx::OnnxError;
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::raster::RasterError;
use sizeup_survey::View;

/// Where priors come from: files, a network, or the photos alone.
pub trait PriorSource {
    /// The prior of one view.
    ///
    /// # Errors
    /// [`PriorError`]: the view then has no vote, and the others go on.
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError>;
}

/// Why a view has no usable prior.
#[derive(Debug, thiserror::Error)]
pub enum PriorError {
    /// A setting that cannot be.
    #[error("prior: {problem}\nhint: {hint}")]
    Config {
        /// The problem with the setting, in words.
        problem: String,
        /// Text to write in its place.
        hint: String,
    },
    /// No file where one should be.
    #[error("no prior for {view}: {} does not exist\nhint: `path` says where they are; {{stem}} is the photo's name without its extension", path.display())]
    Absent {
        /// Name of the photo's view.
        view: String,
        /// Path at which it was looked for.
        path: PathBuf,
    },
    /// A file that cannot be read or is not what its name says.
    #[error("prior {}: {problem}", path.display())]
    File {
        /// The prior's file.
        path: PathBuf,
        /// Fault: expected against found.
        problem: String,
    },
    /// A raster that GDAL cannot read.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// Shape other than the photo's.
    #[error(
        "prior {}: it has {width} × {height} pixels, the photo {view} {photo_width} × {photo_height}: not the same shape\n\
         hint: priors are resized photos, never cropped or padded; their shape may be off by half a patch where both sides are multiples of a network's patch, 14 or 16 pixels",
        path.display()
    )]
    Shape {
        /// The prior's file.
        path: PathBuf,
        /// Name of the photo's view.
        view: String,
        /// Columns of the prior.
        width: usize,
        /// Rows of the prior.
        height: usize,
        /// Columns of the photo.
        photo_width: u32,
        /// Rows of the photo.
        photo_height: u32,
    },
    /// A file that a cached prior depends on cannot be read.
    #[error(transparent)]
    Cache(#[from] FileError),
    /// A network that cannot be loaded or run.
    #[error(transparent)]
    Network(#[from] OnnxError),
    /// A photo that gives no depth.
    #[error("no depth for {view}: {problem}\nhint: {hint}")]
    Photo {
        /// Name of the photo's view.
        view: String,
        /// The problem with the photo or the network's answer.
        problem: String,
        /// Place to look at.
        hint: String,
    },
    /// Nothing in it to go by.
    #[error("prior {}: {problem}\nhint: are `key`, `scale`, `nodata` and the file itself right?", path.display())]
    NoInformation {
        /// The prior's file.
        path: PathBuf,
        /// No value at all, or one and the same everywhere.
        problem: String,
    },
}
