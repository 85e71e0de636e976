//! The last try to run a tile: written when it starts and when it fails, and removed when the tile is done.
//!
//! A try that is killed (memory, a time limit, a node) leaves the file that it wrote at its start.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::TilesError;
use super::manifest::{Layout, read_json};
use sizeup_geo::files::FileError;
use sizeup_results::output::reports::write_json;

/// Outcome of the last try.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Attempt {
    /// Id of the tile.
    pub tile: String,
    /// Tries since the tile was last done.
    pub n_tries: usize,
    /// Exit code; `None` where the try did not come to its end.
    pub exit_code: Option<u8>,
    /// Why the last try failed.
    pub cause: String,
}

/// Message on a try that was killed.
const KILLED: &str = "it was started and has not come to its end: killed, for memory or a time limit?";

impl Attempt {
    /// The last one of a tile, if it has not come to a good end.
    #[must_use]
    pub fn read(layout: &Layout, id: &str) -> Option<Self> {
        read_json(&layout.attempt(id)).ok()
    }

    /// Lays a new one down.
    pub(super) fn start(layout: &Layout, id: &str) -> Result<Self, TilesError> {
        let n_tries = Self::read(layout, id).map_or(0, |last| last.n_tries) + 1;
        let attempt = Self { tile: id.to_owned(), n_tries, exit_code: None, cause: KILLED.to_owned() };
        write_json(&layout.attempt(id), &attempt)?;
        Ok(attempt)
    }

    /// Records why it failed.
    pub(super) fn fail(mut self, layout: &Layout, error: &TilesError) {
        self.exit_code = Some(error.exit_code());
        self.cause = error.to_string();
        // The caller reports the error itself; a full disk takes no second one.
        let _ = write_json(&layout.attempt(&self.tile), &self);
    }

    /// Takes it away: the tile is done.
    pub(super) fn forget(layout: &Layout, id: &str) -> Result<(), FileError> {
        let path = layout.attempt(id);
        remove_if_there(&path)
    }
}

/// Removes a file that may not be there.
pub(super) fn remove_if_there(path: &Path) -> Result<(), FileError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(FileError::on("cannot remove", path)(e)),
        _ => Ok(()),
    }
}
