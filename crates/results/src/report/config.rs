//! Settings of the report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Content of the report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ReportConfig {
    /// Whether `report.html` is written.
    pub page: bool,
    /// Buildings shown with photos, depths and score curves, at most: doubtful ones first, then the least certain. Each
    /// adds some 100 kB to the page.
    #[schemars(extend("x-expert" = true))]
    pub evidence_buildings: usize,
    /// Photos of each of them, at most.
    #[schemars(extend("x-expert" = true))]
    pub evidence_views: usize,
    /// Width of their cut-outs, pixels, at most.
    #[schemars(extend("x-expert" = true))]
    pub picture_px: u32,
    /// Longer side of the picture under the map, pixels, at most: nadir photos laid on the ground, where there are some.
    /// 1,400 make some 500 kB; 0 leaves it out.
    #[schemars(extend("x-expert" = true))]
    pub backdrop_px: u32,
}

impl Default for ReportConfig {
    fn default() -> Self {
        Self { page: true, evidence_buildings: 40, evidence_views: 4, picture_px: 320, backdrop_px: 1400 }
    }
}
