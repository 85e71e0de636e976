//! A city in tiles: the contract that engines schedule, and nothing of the scheduling.
//!
//! ```text
//! plan   tiles.json, tiles/ID/views.json      what there is to do, from all of the input
//! run    tiles/ID/…, tiles/ID.done.json       one tile: idempotent, resumable, bounded memory
//! merge  city.gpkg, city.city.jsonl, …        what is done, in the plan's order
//! ```
//!
//! A building belongs to the tile whose core holds the middle of its footprint (west and south edge belong to the core).
//! Around the core lies a halo, whose buildings are solved too, because they block rays and are what
//! priors are brought to metres by; only the core's are written. What is done is decided by hashes of contents: the plan,
//! each tile and the merge keep the recipe that they were made by, and are stale where the recipe of now is another one.
//! Times of files only decide whether a known hash is computed again.

mod attempt;
mod error;
mod frame;
mod grid;
mod manifest;
mod memory;
mod merge;
mod merged;
mod plan;
mod pool;
mod run;
mod seams;
mod sight;
mod stale;
mod status;

pub use attempt::Attempt;
pub use error::TilesError;
pub use manifest::{Done, Layout, Manifest, Tile, TileViews, Tileset};
pub use merge::{MergeOptions, Merged, Missing, merge};
pub use plan::{PlanSettings, Planned, TileChange, inputs, plan, try_plan};
pub use pool::{PoolSettings, TileOutcome, available_memory_mb, run_all};
pub use run::{TileRun, run_tile};
pub use seams::{SeamClass, SeamReport};
pub use sizeup_geo::lock::Lock;
pub use stale::Trust;
pub use status::{CityStatus, TileState, TileStatus, status};
