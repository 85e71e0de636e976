//! Depth priors: per-view maps whose *ordering* is trusted, not their scale (`SiZeUp`, "Depth prior").
//!
//! What a number means is declared, never guessed: [`PriorKind`] and [`PriorGeometry`] come from the configuration.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::raster::Raster;

/// What a prior's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PriorKind {
    /// Depth up to scale: higher is farther (Depth Anything 3, `Metric3D`, MoGe).
    Depth,
    /// Inverse depth (disparity) up to scale and shift: higher is nearer (Depth Anything 2, MiDaS).
    InverseDepth,
}

/// Along which line a prior measures depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PriorGeometry {
    /// Along the optical axis, as nearly all networks do.
    #[default]
    ZDepth,
    /// Along each pixel's ray, as laser scanners do.
    Range,
}

/// The prior of one view: as large as the photo or smaller, same aspect.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthPrior {
    /// `H × W`, row-major; `NaN` = no value (sky, holes).
    pub values: Raster<f32>,
    /// What the numbers are.
    pub kind: PriorKind,
    /// Along which line they are measured.
    pub geometry: PriorGeometry,
}
