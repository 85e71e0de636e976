//! The folder of the results, and how paths are written into it.

use std::path::{Path, PathBuf};

use sizeup_geo::paths::OwnPaths;

/// Folder of the results.
#[derive(Debug, Clone, Copy)]
pub struct ResultFolder<'a> {
    pub(super) path: &'a Path,
    pub(super) own: &'a OwnPaths,
}

impl<'a> ResultFolder<'a> {
    /// Path of the folder.
    #[must_use]
    pub fn path(&self) -> &'a Path {
        self.path
    }

    /// Path of a file in it.
    #[must_use]
    pub fn join(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path.join(name)
    }

    /// Path of a picture in it.
    #[must_use]
    pub fn picture(&self, name: &str) -> PathBuf {
        self.path.join("pictures").join(name)
    }

    /// Path of a file that a stage leaves behind.
    #[must_use]
    pub fn stage_file(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path.join("stages").join(name)
    }

    /// Path of the terrain model that a run makes from its photos.
    #[must_use]
    pub fn dtm(&self) -> PathBuf {
        self.stage_file("dtm.tif")
    }

    /// Path of the ground in the photos that this model was made from.
    #[must_use]
    pub fn dtm_squares(&self) -> PathBuf {
        self.stage_file("dtm_squares.json")
    }

    /// How a path of the input is written into the results.
    #[must_use]
    pub fn saved(&self, path: &Path) -> PathBuf {
        self.own.saved(path, self.path)
    }

    /// The path of the input that was written so into the results.
    #[must_use]
    pub fn found(&self, saved: &Path) -> PathBuf {
        self.own.found(saved, self.path)
    }
}
