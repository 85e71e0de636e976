//! Local search: one building at a time, over its height, with all others as they are.
//!
//! ```text
//! S_b(h) = Σ_k ρ_k(h)        over the building's views, a plain sum
//! ```
//!
//! Sweeps are Jacobi: every building looks at the heights of the sweep before, so the order does not matter and all
//! cores work. Full sweeps try the whole range, because a wrong neighbour can hide the right answer; local sweeps settle.
//! The last ones can compare ranks only, which takes the prior's monotone distortion out but raises blurred edges.

use rayon::prelude::*;

use super::calibrate::Calibration;
use super::config::{CalibrationRays, SearchConfig};
use super::evidence::Evidence;
use super::roof::{self, Roof};
use super::score::{Correlation, Window};
use crate::render::PlacedCamera;
use crate::render::profile::Stops;
use crate::scene::{HeightBounds, Scene};
use crate::stats::{jackknife_sigma, parabola_peak};

/// The stretch of heights a sweep tries for one building.
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

/// What a sweep finds for one building.
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
    /// How far the mean correlation falls within the tried stretch: 0 = flat.
    pub contrast: f64,
    /// The best height is an end of the full range.
    pub at_bound: bool,
}

/// The views of every building, as positions in the evidence.
pub type ViewsOf<'a> = &'a [Vec<usize>];

/// One view as a sweep uses it.
pub struct SweepView<'a> {
    /// The camera.
    pub placed: &'a PlacedCamera,
    /// Its rays and prior.
    pub evidence: &'a Evidence<'a>,
    /// Where the roofs as they stand stop the rays.
    pub stops: Stops,
    /// How the prior maps to metres.
    calibration: Option<Calibration>,
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
        let calibration = match config.calibrate_on {
            CalibrationRays::All => Calibration::fit(evidence, &stops, CalibrationRays::All),
            CalibrationRays::Ground => *evidence.on_ground.get_or_init(|| {
                let roofs = scene.roofs(&vec![config.start_height_m; scene.prisms.len()]);
                Calibration::fit(evidence, &evidence.profiles.stops(&roofs), CalibrationRays::Ground)
            }),
        };
        Self { placed, evidence, stops, calibration }
    }

    /// The score of each height of one building, as the local sweeps have it; empty where the view cannot tell.
    #[must_use]
    pub fn scores(&self, scene: &Scene, building: usize, heights_m: &[f32], config: &SearchConfig) -> Vec<f64> {
        let Some(window) = self.window(scene, building, config.dilate_px, Correlation::Linear) else {
            return Vec::new();
        };
        let weight = f64::from(config.local_agreement_weight + config.unmodelled_agreement_weight * window.unmodelled);
        let score = |h: &f32| window.score(*h, weight, Correlation::Linear);
        heights_m.iter().map(score).collect()
    }

    /// One building in this view; `None` if it has nothing to say.
    pub(super) fn window(
        &self,
        scene: &Scene,
        building: usize,
        dilate_px: usize,
        correlation: Correlation,
    ) -> Option<Window> {
        let ground_z = scene.prisms[building].ground_z;
        let building = building as u32;
        Window::new(self.evidence, building, ground_z, &self.stops, self.calibration, dilate_px, correlation)
    }
}

/// The views of a sweep by their position in the survey; `None` for those that take no part.
pub type SweepViews<'a> = &'a [Option<SweepView<'a>>];

/// Tries heights for every building and returns what was found; `None` where no view has a say.
#[must_use]
pub fn sweep(
    scene: &Scene,
    views: SweepViews<'_>,
    views_of: ViewsOf<'_>,
    heights_m: &[f32],
    range: Range,
    correlation: Correlation,
    config: &SearchConfig,
) -> Vec<Option<Finding>> {
    let find = |b: usize| {
        let of_building = views_of[b].iter().filter_map(|&v| views[v].as_ref());
        let windows: Vec<Window> =
            of_building.filter_map(|v| v.window(scene, b, config.dilate_px, correlation)).collect();
        let agreement_weight = match range {
            Range::Full => config.agreement_weight,
            Range::Local { .. } => config.local_agreement_weight,
        };
        let weight_of = |w: &Window| f64::from(agreement_weight + config.unmodelled_agreement_weight * w.unmodelled);
        let score = |h: f32| windows.iter().map(|w| w.score(h, weight_of(w), correlation)).collect::<Vec<f64>>();
        (!windows.is_empty()).then(|| match range {
            Range::Full => full(scene.bounds, config, score),
            Range::Local { share } => local(scene.bounds, heights_m[b], share, config, score),
        })
    };
    (0..scene.prisms.len()).into_par_iter().map(find).collect()
}

/// The pitched roof of every building around the height that the sweeps have found; `None` where a flat one is as good.
#[must_use]
pub fn find_roofs(
    scene: &Scene,
    views: SweepViews<'_>,
    views_of: ViewsOf<'_>,
    heights_m: &[f32],
    config: &SearchConfig,
) -> Vec<Option<Roof>> {
    let find = |b: usize| {
        let of_building = views_of[b].iter().filter_map(|&v| views[v].as_ref());
        let windows: Vec<_> = of_building
            .filter_map(|v| Some((v.window(scene, b, config.dilate_px, Correlation::Linear)?, v.placed, v.evidence)))
            .collect();
        roof::find(&scene.prisms[b], heights_m[b], config, &windows)
    };
    (0..scene.prisms.len()).into_par_iter().map(find).collect()
}

fn full(bounds: HeightBounds, config: &SearchConfig, score: impl Fn(f32) -> Vec<f64>) -> Finding {
    let n = config.n_coarse.max(3);
    let ratio = bounds.max_m / bounds.min_m;
    let coarse: Vec<f32> = (0..n).map(|i| bounds.min_m * ratio.powf(i as f32 / (n - 1) as f32)).collect();
    let totals: Vec<f64> = coarse.iter().map(|&h| score(h).iter().sum()).collect();
    let best = argmax(&totals);
    let low = coarse[best.saturating_sub(1)];
    let high = coarse[(best + 1).min(n - 1)];
    let fine = scan(low, high, config.n_fine, bounds, &score);
    let fall = totals.iter().copied().fold(f64::INFINITY, f64::min);
    Finding { contrast: (fine.score - fall / fine.n_views as f64).max(0.0), ..fine }
}

fn local(
    bounds: HeightBounds,
    at_m: f32,
    share: f32,
    config: &SearchConfig,
    score: impl Fn(f32) -> Vec<f64>,
) -> Finding {
    let half_width = share * (config.local_half_width_m + config.local_half_width_share * at_m);
    let low = (at_m - half_width).max(bounds.min_m);
    let high = (at_m + half_width).min(bounds.max_m);
    scan(low, high, config.n_fine, bounds, &score)
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
    let best = totals[argmax(&totals)];
    let least = totals.iter().copied().fold(f64::INFINITY, f64::min);
    let tolerance = 0.01 * (bounds.max_m - bounds.min_m).min(50.0);
    Finding {
        height_m,
        score: best / n_views as f64,
        n_views,
        sigma_m: jackknife_sigma(&leave_one_out),
        contrast: (best - least) / n_views as f64,
        at_bound: height_m - bounds.min_m < 0.2 * tolerance || bounds.max_m - height_m < tolerance,
    }
}

/// Position of the greatest value, the first of equals.
fn argmax(values: &[f64]) -> usize {
    values.iter().enumerate().fold(0, |best, (i, &v)| if v > values[best] { i } else { best })
}
