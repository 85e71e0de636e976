//! How far a city is.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::manifest::{Layout, Tile};
use super::{Lock, TilesError};

/// Where a tile stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Its files are there and whole.
    Done,
    /// Somebody is at it.
    Running,
    /// It was done, and its files are not those that were written.
    Damaged,
    /// There is nothing yet.
    Waiting,
}

/// A tile and where it stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TileStatus {
    /// The tile of the plan.
    pub tile: Tile,
    /// Where it stands.
    pub state: State,
    /// 0, or 5 where some items have no result; absent where it is not done.
    pub exit_code: Option<u8>,
    /// Who is at it.
    pub runner: Option<String>,
}

/// Where every tile stands, in the plan's order. Whether a tile's input has changed since is for its next run to see.
///
/// # Errors
/// [`TilesError::Plan`] where there is none.
pub fn status(layout: &Layout) -> Result<Vec<TileStatus>, TilesError> {
    let manifest = layout.read_manifest()?;
    let of_tile = |tile: Tile| {
        let runner = Lock::holder_of(&layout.lock(&tile.id));
        let done = layout.read_done(&tile.id);
        let state = match (&runner, &done) {
            (Some(_), _) => State::Running,
            (None, Some(done)) if done.is_intact(layout) => State::Done,
            (None, Some(_)) => State::Damaged,
            (None, None) => State::Waiting,
        };
        TileStatus { tile, state, exit_code: done.map(|done| done.exit_code), runner }
    };
    Ok(manifest.tiles.into_par_iter().map(of_tile).collect())
}
