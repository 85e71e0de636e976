//! How far a city is.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::manifest::{Layout, Tile, read_json};
use super::merge::Merged;
use super::stale::{StaleCheck, Trust, known};
use super::{Lock, TilesError};
use sizeup_geo::unfinished::told_of;

/// State of a tile, or of the merge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TileState {
    /// It is there, whole, and what would be made now.
    Done,
    /// Somebody is at it.
    Running,
    /// It was made from something else than there is now, or its files are not those that were written.
    Stale,
    /// It was tried, and did not come to a good end.
    Failed,
    /// There is nothing yet.
    Waiting,
}

/// A tile and where it stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TileStatus {
    /// The tile of the plan.
    pub tile: Tile,
    /// State of the tile.
    pub state: TileState,
    /// Why it is stale, or has failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Exit code of a tile: of one that is done 0, or 5 where some items have no result; of one that failed that of its last try, if it came
    /// to its end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exit_code: Option<u8>,
    /// Tries of one that failed.
    pub n_tries: usize,
    /// Who is at it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub runner: Option<String>,
    /// Hash of what it would be made from now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input_sha256: Option<String>,
}

impl TileStatus {
    /// A tile without a known state.
    pub(super) fn of(tile: &Tile) -> Self {
        let (why, exit_code, runner, input_sha256) = (None, None, None, None);
        Self { tile: tile.clone(), state: TileState::Waiting, why, exit_code, n_tries: 0, runner, input_sha256 }
    }
}

/// State of a whole city.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CityStatus {
    /// Why the plan is stale; absent where it is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan_stale: Option<String>,
    /// Every tile, in the plan's order.
    pub tiles: Vec<TileStatus>,
    /// State of the merge.
    pub merge: TileState,
    /// Why the merge is stale, or not finished.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub merge_stale: Option<String>,
    /// Bytes that were read to learn what files hold.
    pub n_bytes_read: u64,
}

impl CityStatus {
    /// How many tiles stand somewhere.
    #[must_use]
    pub fn count(&self, state: TileState) -> usize {
        self.tiles.iter().filter(|one| one.state == state).count()
    }
}

/// Where a city stands. Nothing but what is known of files is written.
///
/// # Errors
/// [`TilesError::Plan`] where there is no plan.
pub fn status(layout: &Layout, trust: Trust) -> Result<CityStatus, TilesError> {
    let manifest = layout.read_manifest()?;
    let names = ["plan", "city"].into_iter().chain(manifest.tiles.iter().map(|tile| tile.id.as_str()));
    let hashes = known(layout, trust, names);
    let check = StaleCheck::new(layout, &manifest, &hashes);
    let of_tile = |tile: &Tile| {
        let n_before = hashes.n_bytes_read();
        let status = check.status(tile);
        // What had to be read need not be read by the next one.
        if let (true, Some(done), Ok(views)) =
            (hashes.n_bytes_read() > n_before, layout.read_done(&tile.id), check.views(tile))
        {
            check.keep_hashes(tile, &views, &done)?;
        }
        Ok(status)
    };
    let tiles: Vec<TileStatus> = manifest.tiles.par_iter().map(of_tile).collect::<Result<_, TilesError>>()?;
    let done: Vec<_> = tiles
        .iter()
        .map(|one| (one.state == TileState::Done).then(|| layout.read_done(&one.tile.id)).flatten())
        .collect();
    let merged: Option<Merged> = read_json(&layout.merged()).ok();
    let (merge, merge_stale) = match (told_of(layout.folder()), &merged) {
        // Whoever is at it, or was killed there, has begun to replace what was merged.
        (Some(_), _) if Lock::holder_of(&layout.lock("city")).is_some() => (TileState::Running, None),
        (told @ Some(_), _) => (TileState::Failed, told),
        (None, None) => (TileState::Waiting, None),
        (None, Some(merged)) => {
            match check.merge(&done, merged.tileset).map(|now| check.why_not_merged(&now, merged)) {
                Ok(None) => (TileState::Done, None),
                Ok(why) => (TileState::Stale, why),
                Err(error) => (TileState::Stale, Some(error.to_string())),
            }
        }
    };
    let plan_stale = check.plan();
    let n_bytes_read = hashes.n_bytes_read();
    if n_bytes_read > 0 {
        check.keep_hashes_of_city(merged.as_ref())?;
    }
    Ok(CityStatus { plan_stale, tiles, merge, merge_stale, n_bytes_read })
}
