//! Dynamic view selection: few views that see every building well (`SiZeUp`, "Dynamic view selection").
//!
//! 1. [`visibility`]: which buildings each view sees with the present heights, and how much of them.
//! 2. Gate (`paper`): drop views whose number of visible buildings `Q_N` or visible surface `Q_A` lies below a
//!    percentile.
//! 3. Spread: farthest point sampling of the rest to a fixed number.
//! 4. Cover: add views until each building is seen from `k` views, or from as many as there are.
//!
//! Only selected views ever need a depth prior, which is what selection saves. Where each building chooses for itself
//! ([`Choice::Each`]), gate, spread and cover have no part.

mod each;
mod select;
mod visibility;

pub use each::{Candidate, in_turn, select_each};
pub use select::{Selection, select};
pub(crate) use visibility::corners_inside;
pub use visibility::{ViewSight, Visibility, visibility};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Who chooses the views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Choice {
    /// One choice for the whole scene, of as few views as will do (the paper's).
    #[default]
    Cover,
    /// Each building for itself, so that its views do not depend on what else the scene holds. Neighbours prefer the
    /// same views, which keeps their number down.
    Each,
}

/// Settings of the view selection.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ViewsConfig {
    /// Who chooses: `cover` (the whole scene at once) or `each` (every building for itself).
    pub choice: Choice,
    /// Views kept by farthest point sampling (the paper's #Sel: 50, 100 or 256).
    pub n_spread: usize,
    /// Drop views below this percentile of `Q_N` or `Q_A`, 0..100 (paper: 50; robust: 0, no gate).
    pub gate_percentile: f64,
    /// Views that each building should be seen from (paper: 3; robust: 24).
    pub min_views_per_building: usize,
    /// Sampled rays on a building from which it counts as seen (paper: 1; robust: 4).
    pub min_rays: usize,
    /// Share of a building's roof corners that must lie inside the image for the view to count, 0..1 (paper: 0).
    pub min_corners_inside: f64,
    /// Weight of the viewing direction against the position in the spread, 0 = position only (paper: unstated).
    pub direction_weight: f64,
}

impl Default for ViewsConfig {
    fn default() -> Self {
        Self::robust()
    }
}

impl ViewsConfig {
    /// As published, with what the paper leaves open chosen as documented.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            choice: Choice::Cover,
            n_spread: 50,
            gate_percentile: 50.0,
            min_views_per_building: 3,
            min_rays: 1,
            min_corners_inside: 0.0,
            direction_weight: 0.5,
        }
    }

    /// Every building from many informative views: the local search averages over views.
    #[must_use]
    pub fn robust() -> Self {
        Self {
            choice: Choice::Each,
            n_spread: 0,
            gate_percentile: 0.0,
            min_views_per_building: 24,
            min_rays: 4,
            min_corners_inside: 0.5,
            direction_weight: 0.5,
        }
    }
}
