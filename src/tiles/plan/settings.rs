//! Settings of the cut of a city, and their limits.

use std::path::PathBuf;

use serde_json::json;

use crate::pipeline::{PipelineError, RunSettings};
use crate::tiles::TilesError;
use crate::tiles::manifest::Tileset;
use crate::tiles::stale::Trust;
use sizeup_heights::optimise::Preset;

/// Longest side of a tile that is accepted, metres.
const LARGEST_TILE_M: f64 = 100_000.0;
/// Memory of a tile at most where nobody says how large tiles are to be, megabytes: what a node of a cluster has for a core.
const DEFAULT_MEMORY_MB: u64 = 4000;

/// Settings of the cut of a city.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanSettings {
    /// Side of the tiles, metres.
    pub size_m: Option<f64>,
    /// Most buildings of a tile's core, where no size is given: squares are quartered until they hold few enough. Without
    /// either, tiles are as large as it takes to bound what their halos cost.
    pub n_buildings: Option<usize>,
    /// Width of the halo, metres; `None`: half as much again as a view shows at once.
    pub halo_m: Option<f64>,
    /// How far around a core views are taken in, metres; `None`: a third of the halo.
    pub view_margin_m: Option<f64>,
    /// Most memory that a tile may need, megabytes; tiles that need more are quartered.
    pub memory_mb: Option<u64>,
    /// Threads that a tile will run on.
    pub n_threads: usize,
    /// The file that the configuration comes from, which is then part of the input.
    pub config_file: Option<PathBuf>,
    /// Treatment of heights in the merge.
    pub tileset: Tileset,
    /// How much of what is known of files is believed.
    pub trust: Trust,
}

impl PlanSettings {
    /// Settings that decide how the city is cut.
    pub(super) fn cut(&self) -> serde_json::Value {
        let Self { size_m, n_buildings, halo_m, view_margin_m, memory_mb, .. } = self;
        json!({
            "size_m": size_m, "buildings": n_buildings, "halo_m": halo_m, "view_margin_m": view_margin_m,
            "memory_mb": memory_mb,
        })
    }

    /// Most memory that a tile may need, megabytes; `None` where only its size is set.
    pub(super) fn memory_limit_mb(&self) -> Option<u64> {
        let is_left_open = self.size_m.is_none() && self.n_buildings.is_none();
        self.memory_mb.or_else(|| is_left_open.then_some(DEFAULT_MEMORY_MB))
    }
}

/// Refuses what no plan can be made of.
///
/// # Errors
/// [`TilesError`]: the preset `paper`, a terrain model made by the run, sizes out of range, roof contours that move.
pub(super) fn check(run: &RunSettings<'_>, settings: &PlanSettings) -> Result<(), TilesError> {
    if run.heights.method.optimise.preset == Preset::Paper {
        return Err(TilesError::PaperPreset);
    }
    if run.dtm.model.is_some() {
        return Err(TilesError::Pipeline(PipelineError::Settings {
            table: "dtm",
            message: "a terrain model made by the run is not made tile by tile".to_owned(),
            hint: "make it once with `sizeup survey dtm`, name it as terrain.dtm, and take [dtm] out",
        }));
    }
    let refuse = |setting, found: String, expected| Err(TilesError::Setting { setting, found, expected });
    let is_within = |m: f64, low: f64| m.is_finite() && m >= low && m <= LARGEST_TILE_M;
    if let Some(size_m) = settings.size_m.filter(|&m| !is_within(m, 1.0)) {
        return refuse("--size", size_m.to_string(), "1 to 100000 metres");
    }
    if settings.n_buildings == Some(0) {
        return refuse("--buildings", "0".to_owned(), "1 or more");
    }
    let margins = [("--halo", settings.halo_m), ("--view-margin", settings.view_margin_m)];
    match margins.into_iter().find(|(_, m)| m.is_some_and(|m| !is_within(m, 0.0))) {
        Some((setting, m)) => refuse(setting, m.unwrap_or(0.0).to_string(), "0 to 100000 metres"),
        None => Ok(()),
    }
}
