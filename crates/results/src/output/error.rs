//! Why a result cannot be written or read.

use std::path::PathBuf;

use sizeup_geo::files::FileError;
use sizeup_geo::geodata::gpkg::GpkgError;

/// Why a result cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// Two buildings share an id.
    #[error("two buildings are called {id:?}\nhint: choose an id attribute that is unique in the layer")]
    DuplicateId {
        /// The id that both have.
        id: String,
    },
    /// A coordinate or level that is no number.
    #[error("building {id:?} has a coordinate or level that is not a finite number")]
    NotFinite {
        /// Id of the building.
        id: String,
    },
    /// The scene is larger than the output grid.
    #[error(
        "the buildings span {span_m:.0} m, more than the {limit_m:.0} m that whole numbers of {scale_m} m reach\n\
         hint: look for a footprint far from all others, or write tiles"
    )]
    TooFarApart {
        /// Largest side of the scene's box, metres.
        span_m: f64,
        /// Largest side that fits, metres.
        limit_m: f64,
        /// Step of the grid, metres.
        scale_m: f64,
    },
    /// A setting outside its range.
    #[error("{name} is {value}: expected {expected}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// The value that was set.
        value: f64,
        /// Values that are allowed, in words.
        expected: &'static str,
    },
    /// A file is not what it should be.
    #[error(transparent)]
    Malformed(#[from] MalformedFile),
    /// The buildings to write cannot be read.
    #[error(transparent)]
    Input(Box<super::read::ReadError>),
    /// Positions cannot be brought to the earth's frame.
    #[error(transparent)]
    Crs(#[from] sizeup_geo::crs::CrsError),
    /// Vertical datum is not known.
    #[error(
        "{crs} does not say what its heights count from, and a globe must know\n\
         hint: state it: the geoid's height there (`--geoid-height 45.5`), or `--heights ellipsoidal`"
    )]
    HeightsNotStated {
        /// Definition of the result's CRS.
        crs: String,
    },
    /// A folder that holds something else.
    #[error("{} holds other files, and would be replaced\nhint: name a new folder, or one of an earlier export", path.display())]
    FolderInUse {
        /// The folder that was named.
        path: PathBuf,
    },
    /// GDAL cannot write the GeoPackage.
    #[error(transparent)]
    GeoPackage(#[from] GpkgError),
    /// The file system did not let the file be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

impl OutputError {
    /// 2 settings, 3 bad input, 4 what could not be written.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::HeightsNotStated { .. } | Self::Crs(_) | Self::FolderInUse { .. } | Self::Setting { .. } => 2,
            Self::Input(_)
            | Self::Malformed(_)
            | Self::DuplicateId { .. }
            | Self::NotFinite { .. }
            | Self::TooFarApart { .. } => 3,
            Self::File(error) if error.is_of_input() => 3,
            Self::GeoPackage(_) | Self::File(_) => 4,
        }
    }
}

/// A file that was found but is not what it should be.
#[derive(Debug, thiserror::Error)]
#[error("cannot read {}: {reason}", path.display())]
pub struct MalformedFile {
    /// The file that was read.
    pub path: PathBuf,
    /// The problem with it, and the place.
    pub reason: String,
}
