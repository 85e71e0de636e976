//! Stepped roofs: a penthouse, a terrace, a lower annex under one footprint.
//!
//! ```text
//! height  outer + share · (inner − outer),  share: of the footprint's area that lies in the inner rectangle (the area mean)
//! ```
//!
//! One level that fits both ends near the upper one, because its edges stand out most. Steps that are large enough for two
//! buildings are split before.

use crate::roofs::two_levels::{AlignedFootprint, N_MORE, PatternStep, TwoLevelLimits, TwoLevelView, TwoLevels};
use crate::roofs::{Margin, Roof, RoofFit, RoofView, Terrace};
use crate::scene::{HeightBounds, Prism, RoofForm};

/// Least area of either level, m²: an annex or a penthouse of one room. Less is a dormer or a bay.
const MIN_PART_M2: f64 = 15.0;
/// Least side of the inner rectangle, metres.
const MIN_SIDE_M: f32 = 3.0;
/// Least share of the footprint's area on either level.
const MIN_SHARE: f64 = 0.05;
/// Least difference in height between two levels of a stepped roof, metres.
const MIN_STEP_M: f32 = 1.5;
/// Greatest distance of each level from the one that the search has found, metres.
const REACH_M: f32 = 8.0;
/// Views that the first guesses are tried in, and guesses that are followed up.
const N_FIRST_VIEWS: usize = 6;
const N_FOLLOWED: usize = 3;
/// First inner and outer levels against the one level, metres.
const FIRST_M: [[f32; 2]; 4] = [[3.0, -1.0], [-3.0, 1.0], [1.0, -2.0], [-1.0, 2.0]];
/// Steps of the search, for the followed guesses and for the best of them.
const COARSE_STEPS: [PatternStep; 2] = [step(0.15, 1.0), step(0.07, 0.5)];
const FINE_STEPS: [PatternStep; 3] = [step(0.05, 0.4), step(0.025, 0.2), step(0.012, 0.1)];
/// Lead that a stepped roof needs over a flat one, and over a pitched one that is believed.
const MARGIN: Margin = Margin { gain: 0.002, standard_errors: 1.0, n_more: N_MORE };

const fn step(side_share: f32, height_m: f32) -> PatternStep {
    PatternStep { side_share, height_m, height_share: 0.0 }
}

/// The stepped roof of one building that its views show best around a flat one; `None` where there is none to speak of.
pub(crate) fn best<'a>(
    prism: &'a Prism,
    bounds: HeightBounds,
    flat_m: f32,
    views: &[RoofView<'_>],
) -> Option<RoofFit<'a>> {
    let area_m2 = f64::from(prism.area_m2());
    if area_m2 < 2.0 * MIN_PART_M2 {
        return None;
    }
    let flat_m = flat_m.clamp(bounds.min_m, bounds.max_m);
    let heights = HeightBounds { min_m: bounds.min_m.max(flat_m - REACH_M), max_m: bounds.max_m.min(flat_m + REACH_M) };
    let plan = AlignedFootprint::new(prism, TwoLevelLimits { heights, side_m: MIN_SIDE_M });
    let seen = seen_in(views, &plan);
    let all: Vec<&TwoLevelView<'_>> = seen.iter().collect();
    let first: Vec<&TwoLevelView<'_>> = seen.iter().step_by(seen.len().div_ceil(N_FIRST_VIEWS)).collect();
    let pairs_m = FIRST_M.map(|pair| pair.map(|above_m| flat_m + above_m));
    let (_, found) = plan.best_of(plan.guesses(&pairs_m), N_FOLLOWED, &first, &COARSE_STEPS)?;
    let (_, found) = plan.climb(&all, found, &FINE_STEPS);
    let share = plan.inner_share(&found);
    let lesser_share = share.min(1.0 - share);
    if lesser_share < MIN_SHARE.max(MIN_PART_M2 / area_m2) || found.upper_m() - found.lower_m() < MIN_STEP_M {
        return None;
    }
    let scores = scores(&seen, &found);
    let roof = roof(&plan, &found, share);
    let scores_in = move |others: &[RoofView<'_>]| self::scores(&seen_in(others, &plan), &found);
    Some(RoofFit { roof, is_told: true, margin: MARGIN, scores, scores_in: Box::new(scores_in) })
}

fn seen_in<'v>(views: &'v [RoofView<'_>], plan: &AlignedFootprint<'_>) -> Vec<TwoLevelView<'v>> {
    views.iter().map(|view| TwoLevelView::new(view, view.weight, plan)).collect()
}

fn scores(seen: &[TwoLevelView<'_>], levels: &TwoLevels) -> Vec<f64> {
    seen.iter().map(|s| s.two_levels(levels)).collect()
}

fn roof(plan: &AlignedFootprint<'_>, levels: &TwoLevels, inner_share: f64) -> Roof {
    let [inner_m, outer_m] = [levels.inner_m, levels.outer_m].map(f64::from);
    Roof {
        form: RoofForm::Stepped,
        eave_m: inner_m.min(outer_m),
        ridge_m: inner_m.max(outer_m),
        mean_m: outer_m + inner_share * (inner_m - outer_m),
        terrace: Some(Terrace { corners: plan.corners(levels.low, levels.high), is_upper: inner_m > outer_m }),
        ridge_along: None,
    }
}
