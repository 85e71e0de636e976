//! Regression of normalised depth: the paper's loss without its ordinal part.
//!
//! ```text
//! e = R' − D'       R', D': rendered inverse depth and the prior's, negated, each (x − median_Ω) / MAD_Ω
//!                   Ω: building pixels
//! L1: |e|,  L2: e²   mean over Ω, its derivative through roofs only (depth falls by 1/d_z per metre), Adam over views and epochs
//! ```
//!
//! Inverse depth, because regression compares values, and priors are affine in that. The same rays, epochs and steps as the `paper` preset, all oblique views.

use rand::seq::SliceRandom as _;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::optimise::{EpochRecord, Problem, Reason, Solution, SolvedHeight, Solving};
use crate::render::profile::Profiles;
use crate::{seed, stats};

/// Building pixels below which a view says nothing.
const MIN_PIXELS: usize = 32;
/// Decay rates of Adam (Kingma and Ba, ICLR 2015).
const BETAS: [f64; 2] = [0.9, 0.999];

/// Which distance is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Norm {
    /// Absolute.
    L1,
    /// Squared.
    L2,
}

/// Settings of the regression.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RegressionConfig {
    /// Which distance.
    pub norm: Norm,
    /// Passes over all views, one step each.
    pub epochs: usize,
    /// Adam's step, metres.
    pub step_m: f64,
    /// Height that every building starts from, metres.
    pub start_height_m: f32,
}

impl Default for RegressionConfig {
    fn default() -> Self {
        Self { norm: Norm::L1, epochs: 20, step_m: 1.0, start_height_m: 12.0 }
    }
}

struct View<'a> {
    profiles: &'a Profiles,
    /// Prior along the rays, growing away from the camera.
    farness: Vec<f32>,
}

/// Heights by regression. `optimise` gives the sampling of rays only.
#[must_use]
pub fn regression(problem: &Problem<'_>, config: &RegressionConfig) -> Solution {
    let bounds = problem.scene.bounds;
    let n = problem.scene.prisms.len();
    let (views, failed_views) = load(problem);
    let mut heights_m = vec![config.start_height_m.clamp(bounds.min_m, bounds.max_m); n];
    let (mut mean, mut square, mut steps) = (vec![0.0; n], vec![0.0; n], vec![0_i32; n]);
    let mut seen_in: Vec<Vec<usize>> = vec![Vec::new(); n];
    let mut history = Vec::new();
    for epoch in 0..config.epochs {
        (problem.progress)(Solving::Epochs, epoch, config.epochs);
        let mut order: Vec<usize> = (0..views.len()).filter(|&v| views[v].is_some()).collect();
        let n_selected = order.len();
        order.shuffle(&mut seed::stream(problem.seed, "regression order", &[epoch as u64]));
        let before = heights_m.clone();
        let mut losses = Vec::new();
        for v in order {
            let roofs = problem.scene.roofs(&heights_m);
            let Some((loss, gradient)) = views[v].as_ref().and_then(|view| view.step(&roofs, config.norm)) else {
                continue;
            };
            losses.push(loss);
            for (building, derivative) in gradient {
                let b = building as usize;
                steps[b] += 1;
                mean[b] = BETAS[0] * mean[b] + (1.0 - BETAS[0]) * derivative;
                square[b] = BETAS[1] * square[b] + (1.0 - BETAS[1]) * derivative * derivative;
                let unbiased = [mean[b] / (1.0 - BETAS[0].powi(steps[b])), square[b] / (1.0 - BETAS[1].powi(steps[b]))];
                let change = config.step_m * unbiased[0] / (unbiased[1].sqrt() + 1e-12);
                heights_m[b] = (heights_m[b] - change as f32).clamp(bounds.min_m, bounds.max_m);
                if epoch == 0 {
                    seen_in[b].push(v);
                }
            }
        }
        let changes: Vec<f64> = before.iter().zip(&heights_m).map(|(a, b)| f64::from((b - a).abs() / a)).collect();
        history.push(EpochRecord {
            loss: stats::mean(&losses).unwrap_or(0.0),
            relative_change: stats::mean(&changes).unwrap_or(0.0),
            n_selected,
            active_pairs: None,
            heights_m: heights_m.clone(),
        });
    }
    (problem.progress)(Solving::Epochs, config.epochs, config.epochs);
    let solved = |(height_m, mut views): (&f32, Vec<usize>)| {
        views.sort_unstable();
        let is_seen = !views.is_empty();
        let is_bound = is_seen && (*height_m <= bounds.min_m || *height_m >= bounds.max_m);
        let reasons = if is_seen { is_bound.then_some(Reason::RangeBound) } else { Some(Reason::SeenByNoView) };
        let height_m = is_seen.then_some(f64::from(*height_m));
        SolvedHeight {
            height_m,
            roof: None,
            sigma_m: None,
            views,
            score: None,
            raised_m: None,
            doubts: crate::optimise::Doubts::default(),
            reasons: reasons.into_iter().collect(),
        }
    };
    let heights = heights_m.iter().zip(seen_in).map(solved).collect();
    let used_views = (0..views.len()).filter(|&v| views[v].is_some()).collect();
    Solution { heights, history, used_views, failed_views, ..Solution::default() }
}

fn load<'a>(problem: &Problem<'a>) -> (Vec<Option<View<'a>>>, Vec<(usize, String)>) {
    let load_one = |(i, input): (usize, &crate::optimise::ViewInput)| {
        if !input.is_oblique {
            return Ok(None);
        }
        let prior = (problem.load_prior)(i).map_err(|why| (i, why))?;
        let profiles = problem.profiles(i);
        let camera = &input.placed.camera;
        let value = |pixel: [u16; 2]| {
            let at = glam::DVec2::new(f64::from(pixel[0]) + 0.5, f64::from(pixel[1]) + 0.5);
            -prior.disparity(prior.value_at(camera, at))
        };
        let farness = profiles.rays.iter().map(|r| value(r.pixel)).collect();
        Ok(Some(View { profiles, farness }))
    };
    let loaded: Vec<Result<Option<View<'a>>, (usize, String)>> =
        problem.views.par_iter().enumerate().map(load_one).collect();
    let mut failed = Vec::new();
    let views = loaded
        .into_iter()
        .map(|view| {
            view.unwrap_or_else(|why| {
                failed.push(why);
                None
            })
        })
        .collect();
    (views, failed)
}

impl View<'_> {
    /// Loss and derivative by building; `None` where too few building pixels have a prior.
    fn step(&self, roofs: &[f32], norm: Norm) -> Option<(f64, Vec<(u32, f64)>)> {
        struct Pixel {
            building: u32,
            /// Change of inverse depth (negated, so growing away from the camera) per metre of height.
            slope: f64,
            rendered: f32,
            prior: f32,
        }
        let mut pixels = Vec::new();
        for (i, &prior) in self.farness.iter().enumerate().filter(|(_, p)| p.is_finite()) {
            let sight = self.profiles.sight(i, roofs);
            if let Some(building) = sight.building {
                let (depth, dz) = (f64::from(sight.depth), f64::from(self.profiles.rays[i].dz));
                let slope = if sight.is_roof { 1.0 / (dz * depth * depth) } else { 0.0 };
                pixels.push(Pixel { building, slope, rendered: -sight.depth.recip(), prior });
            }
        }
        if pixels.len() < MIN_PIXELS {
            return None;
        }
        let (r_median, r_mad) = stats::median_and_mad(&pixels.iter().map(|p| p.rendered).collect::<Vec<_>>())?;
        let (d_median, d_mad) = stats::median_and_mad(&pixels.iter().map(|p| p.prior).collect::<Vec<_>>())?;
        if r_mad <= 0.0 || d_mad <= 0.0 {
            return None;
        }
        let mut gradient = std::collections::BTreeMap::<u32, f64>::new();
        let mut loss = 0.0;
        for p in &pixels {
            let e = f64::from((p.rendered - r_median) / r_mad - (p.prior - d_median) / d_mad);
            let (cost, slope) = match norm {
                Norm::L1 => (e.abs(), if e == 0.0 { 0.0 } else { e.signum() }),
                Norm::L2 => (e * e, 2.0 * e),
            };
            loss += cost;
            if p.slope != 0.0 {
                *gradient.entry(p.building).or_default() += slope * p.slope / f64::from(r_mad);
            }
        }
        let n = pixels.len() as f64;
        Some((loss / n, gradient.into_iter().map(|(b, g)| (b, g / n)).collect()))
    }
}
