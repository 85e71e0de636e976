//! What is said of each building in the end.

use std::collections::BTreeMap;

use super::{Kept, SolverState};
use crate::config::{CalibrationRays, Preset};
use crate::optimise::solution::{Doubts, Reason, Solution, SolvedHeight};
use crate::roofs::Roof;
use crate::search::Finding;

/// A flat sum of correlations over the tried heights below which the score says nothing.
const FLAT_SCORE: f64 = 0.02;
/// A standard error over views above which a height is doubtful, metres.
const DOUBTFUL_SPREAD_M: f64 = 0.8;
/// A score below which no height explains the priors, and the same where a single view has a say. Of 315 simulated buildings
/// under 8 or 14 photos, half of the 21 below were off by more than 7 m, half of those above by less than 1.1 m.
const HOPELESS_SCORE: f64 = 0.2;
const HOPELESS_SCORE_ALONE: f64 = 0.6;
/// Share of a footprint, and metres squared, above which nobody has looked through: a roof of its own, and no chimney.
const BLIND_SHARE: f64 = 0.15;
const BLIND_M2: f64 = 30.0;
impl SolverState<'_> {
    pub(super) fn into_solution(self) -> Solution {
        let former = self.problem.former;
        let kept = |b: usize| match (former, self.problem.kept(b)) {
            (Some(former), Kept::All(at)) => Some(&former.solution.heights[at]),
            _ => None,
        };
        let n = self.heights_m.len();
        let heights = (0..n).map(|b| kept(b).map_or_else(|| self.solved(b), SolvedHeight::clone)).collect();
        // Views and their states that kept heights rest on.
        let before = former.map(|former| former.solution).filter(|_| (0..n).any(|b| kept(b).is_some()));
        let mut used: BTreeMap<usize, f64> =
            before.iter().flat_map(|of| of.used_views.iter().map(|&v| (v, of.bleeding_of(v)))).collect();
        used.extend((0..self.evidence.len()).filter(|&v| self.evidence[v].is_some()).map(|v| (v, self.bleeding_px[v])));
        let (used_views, bleedings_px): (Vec<usize>, Vec<f64>) = used.into_iter().unzip();
        let bleeding_px = crate::stats::median(&bleedings_px).unwrap_or(0.0);
        let mut failed_views: BTreeMap<usize, String> =
            before.iter().flat_map(|of| of.failed_views.iter().cloned()).collect();
        failed_views.extend(self.failed.iter().enumerate().filter_map(|(v, why)| Some((v, why.clone()?))));
        let n_straightened = self.evidence.iter().flatten().filter(|evidence| evidence.was_bent).count();
        let n_straightened = before.map_or(0, |of| of.n_straightened).max(n_straightened);
        let other_levels = self.other_levels;
        Solution {
            heights,
            history: self.history,
            used_views,
            bleeding_px,
            bleedings_px,
            prior_shape: self.prior_shape.unwrap_or_default(),
            n_straightened,
            layer_shift: self.layer_shift,
            level_off: self.level_off,
            other_levels,
            disagreeing_views: self.disagreeing.into_iter().flatten().collect(),
            failed_views: failed_views.into_iter().collect(),
        }
    }

    /// Size of the working image's pixel on a building, metres, median of its views.
    fn pixel_m(&self, building: usize) -> f64 {
        let centre = self.centre(building);
        let pixel_m = |&view: &usize| self.problem.views[view].placed.pixel_m_at(centre);
        let pixels_m: Vec<f64> = self.views_of[building].iter().map(pixel_m).collect();
        crate::stats::median(&pixels_m).unwrap_or(0.0)
    }

    /// Edge bleeding in a building's views, pixels, median; 0 where surfaces shrink.
    fn bleeding_px(&self, building: usize) -> f64 {
        let of_views: Vec<f64> = self.views_of[building].iter().map(|&view| self.bleeding_px[view]).collect();
        crate::stats::median(&of_views).unwrap_or(0.0).max(0.0)
    }

    /// The spread of the heights of a building's roofs that its views do not tell apart, each with its likelihood, around
    /// the one that is taken, metres.
    fn form_m(&self, building: usize, taken: &Roof) -> f64 {
        let reference = self.config.height_reference;
        let rivals = &self.roofs[building].rivals;
        let squares = rivals.iter().map(|(roof, w)| w * (roof.height_m(reference) - taken.height_m(reference)).powi(2));
        let weights = 1.0 + rivals.iter().map(|(_, weight)| weight).sum::<f64>();
        (squares.sum::<f64>() / weights).sqrt()
    }

    /// Whether its views conflict over a building's height, or another one explains them better.
    pub(super) fn is_contested(&self, building: usize) -> bool {
        let finding = self.findings[building].as_ref();
        finding.is_some_and(|f| is_conflicting(f) || is_outdone(f, self.heights_m[building]))
    }

    fn solved(&self, building: usize) -> SolvedHeight {
        let views = self.views_of[building].clone();
        let finding = self.findings[building].as_ref();
        let is_measured = match self.config.preset {
            Preset::Paper => !views.is_empty(),
            // A building may have left all views since a sweep found it: then nothing holds its height up.
            Preset::Robust => finding.is_some() && !views.is_empty(),
        };
        if !is_measured {
            return SolvedHeight::unknown(Vec::new(), None, Reason::SeenByNoView);
        }
        if self.config.preset == Preset::Paper && !self.is_voted_on[building] {
            // It still stands where it was put at random.
            return SolvedHeight::unknown(views, None, Reason::FlatScore);
        }
        let score = finding.map(|f| f.score);
        if finding.is_some_and(is_hopeless) {
            return SolvedHeight::unknown(views, score, Reason::PoorScore);
        }
        let mut reasons = Vec::new();
        let n_views = finding.map_or(views.len(), |f| f.n_views);
        if n_views < 3 {
            reasons.push(Reason::TooFewViews);
        }
        let bounds = self.problem.scene.bounds;
        let height_m = self.heights_m[building];
        let is_at_bound = finding.map_or(height_m <= bounds.min_m || height_m >= bounds.max_m, |f| f.at_bound);
        let has_no_peak = |f: &Finding| f.whole.fall_to_top(height_m).is_some_and(|fall| fall < FLAT_SCORE);
        if is_at_bound || finding.is_some_and(|f| f.whole.is_at_top(height_m) || has_no_peak(f)) {
            reasons.push(Reason::RangeBound);
        }
        if finding.is_some_and(|f| f.contrast < FLAT_SCORE) {
            reasons.push(Reason::FlatScore);
        }
        let spread_m = finding.and_then(|f| f.sigma_m);
        if finding.is_some_and(is_conflicting) {
            reasons.push(Reason::ConflictingViews);
        }
        if finding.is_some_and(|f| is_outdone(f, height_m)) {
            reasons.push(Reason::OtherHeight);
        }
        let area_m2 = f64::from(self.problem.scene.prisms[building].area_m2());
        if self.blind_m2[building] > (BLIND_SHARE * area_m2).max(BLIND_M2) {
            reasons.push(Reason::UnseenAbove);
        }
        if self.is_green[building] {
            reasons.push(Reason::Vegetation);
        }
        let roof = self.roofs[building].roof.unwrap_or(Roof::flat(f64::from(height_m)));
        let pixel_m = self.pixel_m(building);
        let doubts = Doubts {
            views_m: spread_m.unwrap_or(0.0),
            pixel_m,
            form_m: self.form_m(building, &roof),
            unexplained: score.map_or(1.0, |score| (1.0 - score.clamp(0.0, 1.0).powi(2)).sqrt()),
            bleeding_m: self.bleeding_px(building) * pixel_m,
            height_m: roof.mean_m,
            is_in_metres: self.config.search.calibrate_on == CalibrationRays::None,
        };
        let sigma_m = spread_m.map(|_| doubts.sigma_m());
        let height_m = roof.height_m(self.config.height_reference);
        let mut solved = SolvedHeight {
            height_m: Some(height_m),
            roof: Some(roof),
            sigma_m,
            doubts,
            views,
            score,
            raised_m: None,
            form_certainty: self.roofs[building].certainty,
            footprint_shift: self.footprint_shifts[building],
            reasons,
        };
        solved.keep_within(bounds, self.config.height_reference);
        if finding.is_some_and(|f| f.is_like_ground) {
            solved.doubt(Reason::NothingStandsHere);
        }
        if let Some(reason) = self.order_doubts[building] {
            solved.doubt(reason);
        }
        solved
    }
}

/// Whether its score says nothing for a height.
pub(super) fn is_hopeless(finding: &Finding) -> bool {
    finding.score < if finding.n_views < 2 { HOPELESS_SCORE_ALONE } else { HOPELESS_SCORE }
}

/// Whether the views' heights are far apart.
fn is_conflicting(finding: &Finding) -> bool {
    finding.sigma_m.is_some_and(|spread_m| spread_m > DOUBTFUL_SPREAD_M)
}

/// Whether another height than this has a better score in the whole range.
fn is_outdone(finding: &Finding, height_m: f32) -> bool {
    finding.whole.lead(height_m).is_some_and(|lead| lead < 0.0)
}
