//! Local search: one building at a time, over its height, with all others as they are.
//!
//! ```text
//! S_b(h) = Σ_k ρ_k(h)        over the building's views, a plain sum
//! ```
//!
//! Sweeps are Jacobi: every building looks at the heights of the sweep before, so the order does not matter and all
//! cores work. Full sweeps try the whole range, because a wrong neighbour can hide the right answer; local sweeps settle.
//! The last ones can compare ranks only, which takes the prior's monotone distortion out but raises blurred edges.

pub(crate) mod disagreeing;
pub(crate) mod empty_space;
pub(crate) mod footprint_shift;
pub(crate) mod levels;
pub(crate) mod shift;

use rayon::prelude::*;

use crate::config::{
    CalibrationRays, LOCAL_HALF_WIDTH_M, LOCAL_HALF_WIDTH_SHARE, N_COARSE, N_FINE, START_HEIGHT_M, SearchConfig,
};
use crate::evidence::Evidence;
use crate::evidence::calibrate::Calibration;
use crate::evidence::vegetation::Standing;
use crate::render::PlacedCamera;
use crate::render::profile::Stops;
use crate::roofs::{self, Judged, RoofView};
use crate::scene::{HeightBounds, Scene};
use crate::score::peak::ScoreCurve;
use crate::score::{Scope, Window, unmodelled_share};
use crate::stats::{jackknife_sigma, parabola_peak};

/// By how much the views agree better on a building than on the bare ground, on average. Of buildings that were pulled down they agree
/// better on the ground; of sheds of 2.5 m that cover a few rays they agree better on these by 0.006 and more.
const MIN_GAIN: f64 = 0.002;
/// Fewer views do not tell the two apart.
const MIN_VIEWS: usize = 3;
/// Share of a view's open rays that look at something the scene does not have: up to the first it counts as errors of the prior, from the second
/// on as such. Nine tenths of the views have less than 0.03 in towns with all footprints, and three quarters more than 0.05 over Warsaw, with nine.
const UNMODELLED_SHARES: [f32; 2] = [0.025, 0.075];

/// The interval of heights a sweep tries for one building.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// From the least to the greatest height.
    Full,
    /// Within a share of the local half width around the present height.
    Local {
        /// 1 for the first local sweep, less for later ones.
        share: f32,
    },
}

/// Finding of a sweep for one building.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Best height above ground, metres.
    pub height_m: f32,
    /// Mean correlation at the best height, −1..1.
    pub score: f64,
    /// Views that had a say.
    pub n_views: usize,
    /// Standard error over views (jackknife), metres.
    pub sigma_m: Option<f64>,
    /// Fall of the mean correlation within the tried interval: 0 = flat.
    pub contrast: f64,
    /// The best height is an end of the full range, or the first that was tried above the least.
    pub at_bound: bool,
    /// The views agree on the bare ground about as well as on the best height.
    pub is_like_ground: bool,
    /// The best height is an end of the tried interval: the score has no peak there.
    pub at_end: bool,
    /// Mean scores over the full range, as the last full sweep had them.
    pub whole: ScoreCurve,
    /// Views that had a say, each with its score at the best height as a share of the greatest there is.
    pub by_view: Vec<(usize, f64)>,
}

impl Scope {
    /// All heights, with all that they could hide.
    pub(crate) fn whole() -> Self {
        Self { up_to_m: None, leave_out_crowns: false }
    }

    /// Heights up to one not far above the present.
    pub(crate) fn near(up_to_m: f32) -> Self {
        Self { up_to_m: Some(up_to_m), leave_out_crowns: false }
    }

    /// Without the crowns of trees, where these stand over a building.
    pub(crate) fn without_crowns(self, standing: Standing) -> Self {
        Self { leave_out_crowns: standing.are_crowns(), ..self }
    }
}

/// The views of every building, as positions in the evidence.
pub type ViewsOf<'a> = &'a [Vec<usize>];

/// One view as a sweep uses it.
pub struct SweepView<'a> {
    /// Camera of the view, local frame.
    pub placed: &'a PlacedCamera,
    /// The view's rays and prior.
    pub evidence: &'a Evidence<'a>,
    /// Where the roofs as they stand stop the rays.
    pub stops: Stops,
    /// Mapping of the prior to metres.
    calibration: Option<Calibration>,
    /// How far what stands out in it is taken for something that the scene does not have, 0 to 1, and not for errors of the prior.
    belief: f32,
}

impl<'a> SweepView<'a> {
    /// Calibrates a view for the roofs as they stand; on the ground alone, for roofs where all searches start, once.
    #[must_use]
    pub fn new(
        scene: &Scene,
        placed: &'a PlacedCamera,
        evidence: &'a Evidence<'a>,
        stops: Stops,
        config: &SearchConfig,
    ) -> Self {
        let fitted = |stops: &Stops, rays: CalibrationRays| {
            let calibration = Calibration::fit(evidence, stops, rays)?;
            Some((calibration, belief(unmodelled_share(evidence, stops, calibration))))
        };
        let calibrated = match config.calibrate_on {
            CalibrationRays::All => fitted(&stops, CalibrationRays::All),
            CalibrationRays::Ground => *evidence.on_ground.get_or_init(|| {
                let roofs = scene.roofs(&vec![START_HEIGHT_M; scene.prisms.len()]);
                fitted(&evidence.profiles.stops(&roofs), CalibrationRays::Ground)
            }),
            CalibrationRays::None => Some((Calibration::IN_METRES, 1.0)),
        };
        let (calibration, belief) = calibrated.unzip();
        Self { placed, evidence, stops, calibration, belief: belief.unwrap_or(1.0) }
    }

    /// The same view with rays that run elsewhere; what its prior stands for in metres stays.
    pub(crate) fn along<'b>(
        &self,
        placed: &'b PlacedCamera,
        evidence: &'b Evidence<'b>,
        stops: Stops,
    ) -> SweepView<'b> {
        SweepView { placed, evidence, stops, calibration: self.calibration, belief: self.belief }
    }

    /// The score of each height of one building, as a local sweep up to the highest of them has it; empty where the view
    /// cannot tell.
    #[must_use]
    pub(crate) fn scores(
        &self,
        scene: &Scene,
        building: usize,
        heights_m: &[f32],
        standing: Standing,
        config: &SearchConfig,
    ) -> Vec<f64> {
        let highest_m = heights_m.iter().copied().fold(0.0, f32::max);
        let scope = Scope::near(highest_m).without_crowns(standing);
        let Some(window) = self.window(scene, building, scope) else { return Vec::new() };
        let weight = window.agreement_weight(config.local_agreement(), config);
        let score = |h: &f32| window.score(*h, weight);
        heights_m.iter().map(score).collect()
    }

    /// One building in this view; `None` if it has nothing to say.
    pub(crate) fn window(&self, scene: &Scene, building: usize, scope: Scope) -> Option<Window> {
        let ground_z = scene.prisms[building].ground_z;
        let mut window = Window::new(self.evidence, building as u32, ground_z, &self.stops, self.calibration, scope)?;
        window.unmodelled *= self.belief;
        Some(window)
    }

    /// The same for roofs of any form.
    pub(crate) fn roof_view(
        &self,
        scene: &Scene,
        building: usize,
        scope: Scope,
        config: &SearchConfig,
    ) -> Option<RoofView<'a>> {
        let window = self.window(scene, building, scope)?;
        let weight = window.agreement_weight(config.local_agreement(), config);
        Some(RoofView { window, weight, placed: self.placed, evidence: self.evidence })
    }
}

/// How far something that stands out is taken for what the scene does not have, 0 to 1, where so large a share of a photo's open
/// rays looks at such things.
fn belief(unmodelled_share: f32) -> f32 {
    let [low, high] = UNMODELLED_SHARES;
    ((unmodelled_share - low) / (high - low)).clamp(0.0, 1.0)
}

/// The views of a sweep by their position in the survey; `None` for those that take no part.
pub type SweepViews<'a> = &'a [Option<SweepView<'a>>];

/// Share of green in what stands on a building, over its views.
pub(crate) fn standing<'a, 'b: 'a>(
    scene: &Scene,
    views: impl Iterator<Item = &'a SweepView<'b>>,
    building: usize,
) -> Standing {
    let mut standing = Standing::default();
    for view in views {
        if let Some(calibration) = view.calibration {
            standing.add(view.evidence, building as u32, scene.prisms[building].ground_z, calibration);
        }
    }
    standing
}

/// Tries heights for every building that is asked for and returns what was found; `None` where no view has a say.
#[must_use]
pub fn sweep(
    scene: &Scene,
    views: SweepViews<'_>,
    views_of: ViewsOf<'_>,
    heights_m: &[f32],
    is_asked: impl Fn(usize) -> bool + Sync,
    range: Range,
    config: &SearchConfig,
) -> Vec<Option<Finding>> {
    let find = |b: usize| {
        if !is_asked(b) {
            return None;
        }
        let standing = standing(scene, views_of[b].iter().filter_map(|&v| views[v].as_ref()), b);
        let look = |scope: Scope| {
            let scope = scope.without_crowns(standing);
            let of_building = views_of[b].iter().filter_map(|&v| Some((v, views[v].as_ref()?)));
            let windows = of_building.filter_map(|(v, view)| Some((v, view.window(scene, b, scope)?))).collect();
            BuildingWindows::new(windows, range, config)
        };
        let whole = || look(Scope::whole());
        let Range::Local { share } = range else {
            return whole().map(|looked| looked.found(full(scene.bounds, |h| looked.scores(h)), scene.bounds));
        };
        let (low, high) = around(heights_m[b], share, scene.bounds);
        let scan = |looked: &BuildingWindows| {
            looked.found(scan(low, high, N_FINE, scene.bounds, |h| looked.scores(h)), scene.bounds)
        };
        // A score that still rises where the interval ends would go on rising sweep by sweep, as over trees around a low
        // block: then what the building could hide farther up has a say too.
        let near = look(Scope::near(high)).map(|looked| scan(&looked));
        near.filter(|finding| !finding.at_end).or_else(|| whole().map(|looked| scan(&looked)))
    };
    (0..scene.prisms.len()).into_par_iter().map(find).collect()
}

/// A building's views, made ready.
struct BuildingWindows {
    views: Vec<usize>,
    windows: Vec<Window>,
    /// Weights of the agreement in each window.
    weights: Vec<f64>,
}

impl BuildingWindows {
    /// The views with the weights of their agreement; `None` where no view has a window.
    fn new(windows: Vec<(usize, Window)>, range: Range, config: &SearchConfig) -> Option<Self> {
        let (views, windows): (Vec<usize>, Vec<Window>) = windows.into_iter().unzip();
        let agreement_weight = match range {
            Range::Full => config.agreement_weight,
            Range::Local { .. } => config.local_agreement(),
        };
        let weights = windows.iter().map(|w| w.agreement_weight(agreement_weight, config)).collect();
        (!windows.is_empty()).then_some(Self { views, windows, weights })
    }

    /// A finding with the views' part in it.
    fn found(&self, finding: Finding, bounds: HeightBounds) -> Finding {
        let scores = self.scores(finding.height_m);
        let share = |((view, weight), score): ((&usize, &f64), &f64)| (*view, score / (1.0 + weight));
        let by_view = self.views.iter().zip(&self.weights).zip(&scores).map(share).collect();
        let on_ground = self.scores(0.0);
        let is_better = |scores: &[f64]| {
            let gain: f64 = scores.iter().zip(&on_ground).map(|(score, ground)| score - ground).sum();
            gain > MIN_GAIN * scores.len() as f64
        };
        // Something may stand there that is lower than all heights that are looked for.
        let is_like_ground =
            scores.len() >= MIN_VIEWS && !is_better(&scores) && !is_better(&self.scores(0.5 * bounds.min_m));
        Finding { is_like_ground, by_view, ..finding }
    }

    /// Score of a height, metres above the ground level, in each view, in their order.
    fn scores(&self, height_m: f32) -> Vec<f64> {
        let score = |(w, weight): (&Window, &f64)| w.score(height_m, *weight);
        self.windows.iter().zip(&self.weights).map(score).collect()
    }
}

/// The interval of heights that a local sweep tries, metres.
pub(crate) fn around(at_m: f32, share: f32, bounds: HeightBounds) -> (f32, f32) {
    let half_width = share * (LOCAL_HALF_WIDTH_M + LOCAL_HALF_WIDTH_SHARE * at_m);
    ((at_m - half_width).max(bounds.min_m), (at_m + half_width).min(bounds.max_m))
}

/// The pitched or stepped roof around the height that the sweeps have found, and its rivals, of every building that is asked for.
#[must_use]
pub(crate) fn find_roofs(
    scene: &Scene,
    views: SweepViews<'_>,
    views_of: ViewsOf<'_>,
    heights_m: &[f32],
    is_asked: impl Fn(usize) -> bool + Sync,
    config: &SearchConfig,
) -> Vec<Option<Judged>> {
    let find = |b: usize| {
        if !is_asked(b) {
            return None;
        }
        let standing = standing(scene, views_of[b].iter().filter_map(|&v| views[v].as_ref()), b);
        let seen = |scope: Scope| -> Vec<RoofView<'_>> {
            let scope = scope.without_crowns(standing);
            let of_building = views_of[b].iter().filter_map(|&v| views[v].as_ref());
            of_building.filter_map(|v| v.roof_view(scene, b, scope, config)).collect()
        };
        let near = seen(Scope::near(heights_m[b] + roofs::REACH_M));
        let whole = || seen(Scope::whole());
        Some(roofs::find(&scene.prisms[b], scene.bounds, heights_m[b], config, &near, whole))
    };
    (0..scene.prisms.len()).into_par_iter().map(find).collect()
}

fn full(bounds: HeightBounds, score: impl Fn(f32) -> Vec<f64>) -> Finding {
    let n = N_COARSE;
    let ratio = bounds.max_m / bounds.min_m;
    let coarse: Vec<f32> = (0..n).map(|i| bounds.min_m * ratio.powf(i as f32 / (n - 1) as f32)).collect();
    let totals: Vec<f64> = coarse.iter().map(|&h| score(h).iter().sum()).collect();
    let best = argmax(&totals);
    let low = coarse[best.saturating_sub(1)];
    let high = coarse[(best + 1).min(n - 1)];
    let fine = scan(low, high, N_FINE, bounds, &score);
    let fall = totals.iter().copied().fold(f64::INFINITY, f64::min);
    let n_views = fine.n_views as f64;
    let whole = ScoreCurve(coarse.into_iter().zip(totals.iter().map(|total| total / n_views)).collect());
    Finding { contrast: (fine.score - fall / n_views).max(0.0), whole, ..fine }
}

/// Evenly spaced heights, the best one refined by a parabola, its standard error by leaving one view out at a time.
fn scan(low: f32, high: f32, n: usize, bounds: HeightBounds, score: impl Fn(f32) -> Vec<f64>) -> Finding {
    let n = n.max(3);
    let spacing = (high - low) / (n - 1) as f32;
    let per_view: Vec<Vec<f64>> = (0..n).map(|i| score(low + spacing * i as f32)).collect();
    let n_views = per_view[0].len();
    let totals: Vec<f64> = per_view.iter().map(|s| s.iter().sum()).collect();
    let peak = |totals: &[f64]| {
        let best = argmax(totals).clamp(1, n - 2);
        let around = [totals[best - 1], totals[best], totals[best + 1]];
        parabola_peak(f64::from(low + spacing * best as f32), f64::from(spacing), around) as f32
    };
    let height_m = peak(&totals).clamp(bounds.min_m, bounds.max_m);
    let leave_one_out: Vec<f64> = (0..n_views)
        .map(|view| {
            let without: Vec<f64> = totals.iter().zip(&per_view).map(|(total, views)| total - views[view]).collect();
            f64::from(peak(&without))
        })
        .collect();
    let at = argmax(&totals);
    let best = totals[at];
    let least = totals.iter().copied().fold(f64::INFINITY, f64::min);
    let tolerance = 0.01 * (bounds.max_m - bounds.min_m).min(50.0);
    Finding {
        height_m,
        score: best / n_views as f64,
        n_views,
        sigma_m: jackknife_sigma(&leave_one_out),
        contrast: (best - least) / n_views as f64,
        // A score that falls from the least height on has its vertex, by three samples, at the second one.
        at_bound: (at <= 1 && low <= bounds.min_m)
            || height_m - bounds.min_m < 0.2 * tolerance
            || bounds.max_m - height_m < tolerance,
        is_like_ground: false,
        at_end: at == 0 || at == n - 1,
        whole: ScoreCurve::default(),
        by_view: Vec::new(),
    }
}

/// Position of the greatest value, the first of equals.
fn argmax(values: &[f64]) -> usize {
    values.iter().enumerate().fold(0, |best, (i, &v)| if v > values[best] { i } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_score_that_falls_from_the_least_height_on_is_at_the_bound() {
        let bounds = HeightBounds { min_m: 2.0, max_m: 150.0 };
        let found = |score: fn(f32) -> f32| scan(2.0, 6.0, 17, bounds, |h| vec![f64::from(score(h)); 3]);
        // Hollow, as over open ground: three samples have no vertex, and the second one is taken.
        let falling = found(|h| (-h).exp());
        assert!(falling.at_bound && falling.height_m < 2.3, "{falling:?}");
        let peak = found(|h| -(h - 3.1).powi(2));
        assert!(!peak.at_bound && (peak.height_m - 3.1).abs() < 0.01, "{peak:?}");
    }
}
