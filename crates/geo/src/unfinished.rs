//! A mark in a folder whose results are being replaced: laid before the first of them is, taken away after the last.
//!
//! Each file is whole or absent, but a writer that is killed between two leaves files of two runs side by side. The mark
//! that it leaves too says so to whoever reads them.

use std::fs;
use std::path::{Path, PathBuf};

use crate::files::{FileError, write_whole};

/// The mark's name.
pub const NAME: &str = "UNFINISHED.txt";

/// A folder whose results are being replaced. Dropped without [`Self::finish`], the mark stays.
#[derive(Debug)]
#[must_use = "the mark stays until the results are finished"]
pub struct Unfinished {
    path: PathBuf,
}

impl Unfinished {
    /// Lays the mark.
    ///
    /// # Errors
    /// [`FileError`] where the folder cannot be written.
    pub fn begin(folder: &Path, command: &str) -> Result<Self, FileError> {
        let path = folder.join(NAME);
        let text = format!(
            "These results are not of one run: they were being replaced, and the writer has not come to its end.\n\
             If nothing is running, do it again: {command}\n"
        );
        write_whole(&path, |out| out.write_all(text.as_bytes()))?;
        Ok(Self { path })
    }

    /// Takes the mark away: the results are whole.
    ///
    /// # Errors
    /// [`FileError`] where it cannot be removed.
    pub fn finish(self) -> Result<(), FileError> {
        fs::remove_file(&self.path).map_err(FileError::on("cannot remove", &self.path))
    }
}

/// Whether results are marked: a folder's, or those of the folder that a file of results lies in.
#[must_use]
pub fn is_marked(path: &Path) -> bool {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    folder.join(NAME).is_file()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_marked_until_they_are_finished() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("city.gpkg");
        let mark = Unfinished::begin(folder.path(), "sizeup run").unwrap();
        assert!(is_marked(folder.path()) && is_marked(&file));
        mark.finish().unwrap();
        assert!(!is_marked(&file));
        drop(Unfinished::begin(folder.path(), "sizeup run").unwrap());
        assert!(is_marked(&file));
    }
}
