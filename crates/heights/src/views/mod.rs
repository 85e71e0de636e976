//! Dynamic view selection: few views that see every building well (`SiZeUp`, "Dynamic view selection").
//!
//! 1. [`visibility`]: which buildings each view sees with the present heights, and how much of them.
//! 2. Gate (`paper`): drop views whose number of visible buildings `Q_N` or visible surface `Q_A` lies below a
//!    percentile of all views that take part: oblique ones that have a prior.
//! 3. Spread: farthest point sampling of the rest to a fixed number.
//! 4. Cover: add views until each building is seen from `k` views, or from as many as there are.
//!
//! Only selected views ever need a depth prior, which is what selection saves. Where each building chooses for itself
//! ([`Choice::Each`]), or views are drawn ([`Choice::Random`]), gate, spread and cover have no part.

mod each;
mod kind;
mod select;
mod visibility;

pub use each::{CandidateView, from_all_sides, in_turn, select_each};
pub use kind::{NADIR_WITHIN_DEG, ViewKind};
pub use select::{Selection, drawn, select};
pub(crate) use visibility::corners_inside;
pub use visibility::{ViewSight, Visibility, visibility};

use serde::{Deserialize, Serialize};

/// Who chooses the views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Choice {
    /// One choice for the whole scene, of as few views as will do (the paper's).
    #[default]
    Cover,
    /// Each building for itself, so that its views do not depend on what else the scene holds. Neighbours prefer the
    /// same views, which keeps their number down.
    Each,
    /// `n_spread` views drawn at random, the same ones throughout: what a selection has to beat.
    Random,
}

/// Settings of the selection of views.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewsConfig {
    /// Rule by which views are chosen.
    pub choice: Choice,
    /// Views kept by farthest point sampling (the paper's #Sel: 50, 100 or 256), or drawn at random.
    pub n_spread: usize,
    /// Views below this percentile of `Q_N` or `Q_A` are dropped, 0..100.
    pub gate_percentile: f64,
    /// Views that each building should be seen from (the paper's k).
    pub min_views_per_building: usize,
    /// Sampled rays on a building from which it counts as seen.
    pub min_rays: usize,
    /// Share of a building's roof corners that must lie inside the image for the view to count, 0..1.
    pub min_corners_inside: f64,
    /// Weight of the viewing direction against the position in the spread, 0 = position only.
    pub direction_weight: f64,
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

/// Settings of the view selection; what is absent is the preset's own.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ViewsSettings {
    /// Who chooses: `cover` (the whole scene at once; `paper`), `each` (every building for itself; `robust`) or `random`
    /// (`n_spread` views, to compare with).
    pub choice: Option<Choice>,
    /// Views kept by farthest point sampling (the paper's #Sel: 50, 100 or 256; here 50), or drawn at random.
    pub n_spread: Option<usize>,
    /// Drop views below this percentile of `Q_N` or `Q_A`, taken over the oblique views that have a prior, 0..100 (paper: 50;
    /// robust: 0, no gate).
    pub gate_percentile: Option<f64>,
    /// Views that each building should be seen from (paper: 3; robust: 24).
    pub min_views_per_building: Option<usize>,
    /// Sampled rays on a building from which it counts as seen (paper: 1, unstated; robust: 4).
    pub min_rays: Option<usize>,
    /// Share of a building's roof corners that must lie inside the image for the view to count, 0..1 (paper: 0, unstated;
    /// robust: 0.5).
    pub min_corners_inside: Option<f64>,
    /// Weight of the viewing direction against the position in the spread, 0 = position only (0.5; the paper does not
    /// state it).
    pub direction_weight: Option<f64>,
}

impl ViewsSettings {
    /// A preset's selection with what these settings say instead.
    #[must_use]
    pub fn over(&self, preset: &ViewsConfig) -> ViewsConfig {
        ViewsConfig {
            choice: self.choice.unwrap_or(preset.choice),
            n_spread: self.n_spread.unwrap_or(preset.n_spread),
            gate_percentile: self.gate_percentile.unwrap_or(preset.gate_percentile),
            min_views_per_building: self.min_views_per_building.unwrap_or(preset.min_views_per_building),
            min_rays: self.min_rays.unwrap_or(preset.min_rays),
            min_corners_inside: self.min_corners_inside.unwrap_or(preset.min_corners_inside),
            direction_weight: self.direction_weight.unwrap_or(preset.direction_weight),
        }
    }
}
