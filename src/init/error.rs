//! Why a folder is no project, whatever is added to it.

use std::path::PathBuf;

use sizeup_geo::crs::CrsError;
use sizeup_geo::files::FileError;

/// Why nothing can be made of a folder.
#[derive(Debug, thiserror::Error)]
pub enum InitError {
    /// There is no such folder, or it is a file.
    #[error("{}: expected a folder of photos, found {found}\nhint: {hint}", path.display())]
    NoFolder {
        /// Path that was named.
        path: PathBuf,
        /// Kind of what the path leads to.
        found: &'static str,
        /// Advice to the user: what to change or to look at.
        hint: &'static str,
    },
    /// It holds neither photos nor poses.
    #[error("{}: expected photos (jpg, tif, png), found {found}\nhint: {hint}", path.display())]
    NoPhotos {
        /// The folder that was looked into.
        path: PathBuf,
        /// Files found in their place.
        found: String,
        /// Advice to the user: what to change or to look at.
        hint: &'static str,
    },
    /// It holds photos, and nothing says where they were taken from.
    #[error("{}: expected photos with poses, found {found}\nhint: {hint}", path.display())]
    NoPoses {
        /// The folder that was looked into.
        path: PathBuf,
        /// Properties of the photos.
        found: String,
        /// Advice to the user: what to change or to look at.
        hint: String,
    },
    /// A file or folder cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The CRS that was asked for cannot be the project's.
    #[error("--crs: {0}")]
    Crs(#[from] CrsError),
    /// A file that was named cannot be used.
    #[error("{option} {}: {reason}", path.display())]
    Named {
        /// Option that named the file.
        option: &'static str,
        /// The file that was named.
        path: PathBuf,
        /// Why not, with a hint.
        reason: String,
    },
}

impl InitError {
    /// The exit code that it stands for.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        if matches!(self, Self::Crs(_)) { 2 } else { 3 }
    }
}
