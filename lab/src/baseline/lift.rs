//! The metric lift: each view's prior to metres on free ground, every roof pixel to its place, the median per building.
//!
//! ```text
//! depth   s = curve⁻¹(p)                 curve: fitted on rays that see the ground (module `curve`)
//! level   z = eye_z + s · d_z            for rays that see the roof
//! height  median over views of the view's median z, minus ground
//! ```
//!
//! Which rays see free ground and which a roof depends on the heights, so it goes in rounds. The first takes, of all
//! points that are lifted to over a footprint, a high percentile: roofs are above walls. Later ones take the rays that
//! see the roof with the heights found so far. Neither ordering nor silhouettes are used, and nothing is searched.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::curve::{PriorCurve, Sample};
use sizeup_heights::optimise::{EpochRecord, Problem, Reason, Solution, SolvedHeight, Solving};
use sizeup_heights::render::profile::{PrismInterval, Profiles};
use sizeup_heights::scene::Scene;
use sizeup_heights::stats;

/// Percentile of the points over a footprint that the first round takes for the roof's level.
const FIRST_PERCENTILE: f64 = 0.85;
/// Fewer views than this make a height doubtful.
const FEW_VIEWS: usize = 3;

/// Settings of the metric lift.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LiftConfig {
    /// Height that every building starts from, metres: what is taller hides ground that is not free.
    pub start_height_m: f32,
    /// Rounds of calibration and lifting, 1 or more.
    pub rounds: usize,
    /// Points nearer than this to where the ray enters or leaves the footprint are left out, metres in plan.
    pub edge_m: f32,
    /// At most this share of a ray's interval over the footprint is left out at each end, 0 to 0.5.
    pub edge_share: f32,
    /// Lifted points below which a view has no say in a building.
    pub min_points: usize,
}

impl Default for LiftConfig {
    fn default() -> Self {
        Self { start_height_m: 6.0, rounds: 4, edge_m: 1.0, edge_share: 0.25, min_points: 4 }
    }
}

/// One view, traced, with its prior along the rays.
struct LiftView<'a> {
    profiles: &'a Profiles,
    /// Per ray: the prior as inverse depth, image position −1..1, metres in plan per metre of z-depth.
    rays: Vec<LiftRay>,
}

#[derive(Clone, Copy)]
struct LiftRay {
    p: f32,
    x: f32,
    y: f32,
    plan_per_depth: f32,
}

/// Heights by lifting. `optimise` gives the sampling of rays only.
#[must_use]
pub fn metric_lift(problem: &Problem<'_>, config: &LiftConfig) -> Solution {
    let scene = problem.scene;
    let (views, failed_views) = load(problem);
    let n = scene.prisms.len();
    let mut heights_m = vec![config.start_height_m.clamp(scene.bounds.min_m, scene.bounds.max_m); n];
    let mut history = Vec::new();
    let mut lifted: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n];
    for round in 0..config.rounds.max(1) {
        (problem.progress)(Solving::Epochs, round, config.rounds.max(1));
        let roofs = scene.roofs(&heights_m);
        let per_view: Vec<Vec<(u32, f64)>> = views
            .par_iter()
            .map(|view| view.as_ref().map_or_else(Vec::new, |v| v.lift(scene, &roofs, round == 0, config)))
            .collect();
        lifted = vec![Vec::new(); n];
        for (view, levels) in per_view.iter().enumerate() {
            for &(building, height_m) in levels {
                lifted[building as usize].push((view, height_m));
            }
        }
        let before = heights_m.clone();
        for (height_m, levels) in heights_m.iter_mut().zip(&lifted) {
            if let Some(found) = median_height(levels) {
                *height_m = (found as f32).clamp(scene.bounds.min_m, scene.bounds.max_m);
            }
        }
        history.push(record(&before, &heights_m, &lifted, views.iter().flatten().count()));
    }
    (problem.progress)(Solving::Epochs, config.rounds.max(1), config.rounds.max(1));
    let heights = lifted.iter().zip(&heights_m).map(|(levels, height_m)| solved(levels, *height_m, scene)).collect();
    let used_views = (0..views.len()).filter(|&v| views[v].is_some()).collect();
    Solution { heights, history, used_views, failed_views, ..Solution::default() }
}

fn median_height(levels: &[(usize, f64)]) -> Option<f64> {
    stats::median(&levels.iter().map(|l| l.1).collect::<Vec<_>>())
}

/// Traces and samples every oblique view.
fn load<'a>(problem: &Problem<'a>) -> (Vec<Option<LiftView<'a>>>, Vec<(usize, String)>) {
    let n = problem.views.len();
    let mut views = Vec::with_capacity(n);
    let mut failed = Vec::new();
    for (i, input) in problem.views.iter().enumerate() {
        (problem.progress)(Solving::Priors, i, n);
        if !input.is_oblique {
            views.push(None);
            continue;
        }
        let prior = match (problem.load_prior)(i) {
            Ok(prior) => prior,
            Err(why) => {
                failed.push((i, why));
                views.push(None);
                continue;
            }
        };
        let profiles = problem.profiles(i);
        let camera = &input.placed.camera;
        let disparity = prior.to_disparity();
        let (scale_x, scale_y) = (
            disparity.width() as f64 / f64::from(camera.width_px),
            disparity.height() as f64 / f64::from(camera.height_px),
        );
        let ray = |pixel: [u16; 2]| {
            let at = glam::DVec2::new(f64::from(pixel[0]) + 0.5, f64::from(pixel[1]) + 0.5);
            let plan = input.placed.ray(at).map_or(f32::NAN, |ray| ray.direction.truncate().length());
            LiftRay {
                p: disparity.bilinear(at.x * scale_x, at.y * scale_y),
                x: (2.0 * at.x / f64::from(camera.width_px) - 1.0) as f32,
                y: (2.0 * at.y / f64::from(camera.height_px) - 1.0) as f32,
                plan_per_depth: plan,
            }
        };
        let rays = profiles.rays.iter().map(|r| ray(r.pixel)).collect();
        views.push(Some(LiftView { profiles, rays }));
    }
    (problem.progress)(Solving::Priors, n, n);
    (views, failed)
}

impl LiftView<'_> {
    /// Height above ground of each building's lifted points: their median, or a high percentile in the first round.
    fn lift(&self, scene: &Scene, roofs: &[f32], is_first: bool, config: &LiftConfig) -> Vec<(u32, f64)> {
        let Some(curve) = PriorCurve::fit(&self.free_ground(roofs)) else { return Vec::new() };
        let mut points: Vec<(u32, f64)> = Vec::new();
        for (i, ray) in self.rays.iter().enumerate().filter(|(_, ray)| ray.p.is_finite()) {
            let Some(depth) = curve.depth_m(f64::from(ray.p), f64::from(ray.x), f64::from(ray.y)) else { continue };
            let depth = depth as f32;
            let building = if is_first { self.lifted_over(i, depth, config) } else { self.roof_seen(i, roofs, config) };
            if let Some(building) = building {
                let level = self.profiles.eye_z + depth * self.profiles.rays[i].dz;
                points.push((building, f64::from(level - scene.prisms[building as usize].ground_z)));
            }
        }
        points.sort_by_key(|p| p.0);
        let quantile = if is_first { FIRST_PERCENTILE } else { 0.5 };
        points
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|of_one| of_one.len() >= config.min_points)
            .filter_map(|of_one| {
                let heights: Vec<f64> = of_one.iter().map(|p| p.1).collect();
                Some((of_one[0].0, stats::quantile(&heights, quantile)?))
            })
            .collect()
    }

    /// Rays that see the ground with the present roof levels (local frame).
    fn free_ground(&self, roofs: &[f32]) -> Vec<Sample> {
        let sample = |(i, ray): (usize, &LiftRay)| {
            let sight = self.profiles.sight(i, roofs);
            let is_free = sight.building.is_none() && sight.depth.is_finite() && ray.p.is_finite();
            let v = 1.0 / f64::from(sight.depth);
            is_free.then(|| Sample { v, p: f64::from(ray.p), x: f64::from(ray.x), y: f64::from(ray.y) })
        };
        self.rays.iter().enumerate().filter_map(sample).collect()
    }

    /// The building whose footprint a lifted point lies over, away from its walls.
    fn lifted_over(&self, i: usize, depth: f32, config: &LiftConfig) -> Option<u32> {
        self.profiles.intervals(i).iter().find(|c| self.is_inside(i, c, depth, config)).map(|c| c.building)
    }

    /// The building whose roof a ray sees with the present roof levels, away from its edges.
    fn roof_seen(&self, i: usize, roofs: &[f32], config: &LiftConfig) -> Option<u32> {
        let sight = self.profiles.sight(i, roofs);
        let building = sight.building.filter(|_| sight.is_roof)?;
        let of_building = self.profiles.intervals(i).iter().filter(|c| c.building == building);
        of_building.into_iter().any(|c| self.is_inside(i, c, sight.depth, config)).then_some(building)
    }

    fn is_inside(&self, i: usize, interval: &PrismInterval, depth: f32, config: &LiftConfig) -> bool {
        let edge = config.edge_m / self.rays[i].plan_per_depth;
        let edge = edge.min(config.edge_share * (interval.leave - interval.enter));
        depth > interval.enter + edge && depth < interval.leave - edge
    }
}

fn solved(levels: &[(usize, f64)], height_m: f32, scene: &Scene) -> SolvedHeight {
    let views: Vec<usize> = levels.iter().map(|l| l.0).collect();
    if views.is_empty() {
        return SolvedHeight { reasons: vec![Reason::SeenByNoView], ..SolvedHeight::default() };
    }
    let mut reasons = Vec::new();
    if views.len() < FEW_VIEWS {
        reasons.push(Reason::TooFewViews);
    }
    if height_m <= scene.bounds.min_m || height_m >= scene.bounds.max_m {
        reasons.push(Reason::RangeBound);
    }
    let off: Vec<f64> = levels.iter().map(|l| (l.1 - f64::from(height_m)).abs()).collect();
    let spread = stats::median(&off).map(|mad| stats::SIGMA_PER_MAD * mad / (views.len() as f64).sqrt());
    let sigma_m = spread.filter(|_| views.len() >= FEW_VIEWS);
    SolvedHeight { height_m: Some(f64::from(height_m)), sigma_m, views, reasons, ..SolvedHeight::default() }
}

/// One round for the history: the loss is the mean spread of the views' heights, metres.
fn record(before: &[f32], after: &[f32], lifted: &[Vec<(usize, f64)>], n_selected: usize) -> EpochRecord {
    let changes: Vec<f64> = before.iter().zip(after).map(|(a, b)| f64::from((b - a).abs() / a)).collect();
    let off = |(levels, height_m): (&Vec<(usize, f64)>, &f32)| {
        stats::median(&levels.iter().map(|l| (l.1 - f64::from(*height_m)).abs()).collect::<Vec<_>>())
    };
    let spreads: Vec<f64> = lifted.iter().zip(after).filter_map(off).collect();
    EpochRecord {
        loss: stats::mean(&spreads).unwrap_or(0.0),
        relative_change: stats::mean(&changes).unwrap_or(0.0),
        n_selected,
        active_pairs: None,
        heights_m: after.to_vec(),
    }
}
