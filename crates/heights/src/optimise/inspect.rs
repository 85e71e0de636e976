//! Single buildings as the solver saw them at the end: how every height scores in every view, and which pixels of a view
//! stand in the wrong order. For looking at; nothing is solved here.

use std::collections::BTreeMap;

use rand::Rng as _;
use rayon::prelude::*;

use crate::config::{OptimiseConfig, Preset, Region};
use crate::evidence::Evidence;
use crate::evidence::straighten::GroundFits;
use crate::optimise::solution::Solution;
use crate::optimise::solve::Problem;
use crate::ordinal::DepthOrder;
use crate::paper::ordinal::ComparedPixels;
use crate::search::{SweepView, standing};
use crate::seed;

/// Heights that are scored: evenly spaced from the least to somewhat above the height found.
const N_HEIGHTS: usize = 61;
/// The scored heights end at this multiple of the height found, and at least this much above it, metres.
const REACH_SHARE: f32 = 2.0;
const REACH_M: f32 = 12.0;
/// Pairs that are drawn at random, and those of them with a vote that are kept.
const N_DRAWN: usize = 160;
const N_KEPT: usize = 48;
/// Distance around a building within which its pixels are compared, pixels of the working image.
const AROUND_PX: usize = 16;

/// Scores of one building over the heights, view by view.
#[derive(Debug, Clone, PartialEq)]
pub struct Inspection {
    /// Position in the scene.
    pub building: usize,
    /// Heights above ground, metres, ascending.
    pub heights_m: Vec<f32>,
    /// The views that it was measured in, in their order.
    pub views: Vec<InspectedView>,
}

/// A building in one view.
#[derive(Debug, Clone, PartialEq)]
pub struct InspectedView {
    /// Position of the view.
    pub view: usize,
    /// Sampled rays that meet the building first, with all heights as found.
    pub n_rays: usize,
    /// Correlation and weighted agreement of every height; empty where the view cannot tell.
    pub scores: Vec<f64>,
    /// Pairs with a vote, one pixel of each on the building.
    pub pairs: Vec<InspectedPair>,
}

/// Two pixels, and what their order costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InspectedPair {
    /// Both ends in shares of the image's width and height.
    pub ends: [[f32; 2]; 2],
    /// Cost of the hinge; 0 is in the right order by the margin.
    pub cost: f32,
}

/// Looks at some buildings of a solved problem: each by its position in the scene, in some of the views that it was
/// measured in.
#[must_use]
pub fn inspect(
    problem: &Problem<'_>,
    config: &OptimiseConfig,
    solution: &Solution,
    wanted: &[(usize, Vec<usize>)],
) -> Vec<Inspection> {
    let heights_m: Vec<f32> = match solution.history.last() {
        Some(pass) => pass.heights_m.clone(),
        None => solution.heights.iter().map(|h| h.height_m.unwrap_or_default() as f32).collect(),
    };
    let roofs = problem.scene.roofs(&heights_m);
    let mut views: Vec<usize> = wanted.iter().flat_map(|(_, views)| views.iter().copied()).collect();
    views.sort_unstable();
    views.dedup();
    let evidence: Vec<(usize, Evidence<'_>)> = views
        .par_iter()
        .filter_map(|&view| {
            let prior = (problem.load_prior)(view).ok()?;
            let prior = problem.sampled(view, &prior, solution.bleeding_of(view), config.stride_px);
            let mut evidence = problem.evidence(view, &prior, config.stride_px);
            let fits = GroundFits::along_ground(&evidence);
            evidence.straighten(&fits, solution.prior_shape);
            Some((view, evidence))
        })
        .collect();
    let sweeps: BTreeMap<usize, SweepView<'_>> = evidence
        .par_iter()
        .map(|(view, evidence)| {
            let stops = evidence.profiles.stops(&roofs);
            let placed = &problem.views[*view].placed;
            (*view, SweepView::new(problem.scene, placed, evidence, stops, &config.search))
        })
        .collect::<Vec<_>>()
        .into_iter()
        .collect();
    let look = Inspector { problem, config, roofs: &roofs, sweeps: &sweeps };
    wanted.par_iter().map(|(b, views)| look.at(*b, heights_m[*b], views)).collect()
}

/// Means by which all buildings are looked at.
struct Inspector<'a> {
    problem: &'a Problem<'a>,
    config: &'a OptimiseConfig,
    roofs: &'a [f32],
    sweeps: &'a BTreeMap<usize, SweepView<'a>>,
}

impl Inspector<'_> {
    fn at(&self, building: usize, height_m: f32, views: &[usize]) -> Inspection {
        let bounds = self.problem.scene.bounds;
        let top_m = (REACH_SHARE * height_m).max(height_m + REACH_M).min(bounds.max_m);
        let step_m = (top_m - bounds.min_m) / (N_HEIGHTS - 1) as f32;
        let heights_m: Vec<f32> = (0..N_HEIGHTS).map(|i| bounds.min_m + step_m * i as f32).collect();
        let standing = standing(self.problem.scene, views.iter().filter_map(|v| self.sweeps.get(v)), building);
        let in_view = |view: &usize| {
            let sweep = self.sweeps.get(view)?;
            let evidence = sweep.evidence;
            let is_seen =
                |ray: &&u32| evidence.profiles.sight(**ray as usize, self.roofs).building == Some(building as u32);
            Some(InspectedView {
                view: *view,
                n_rays: evidence.rays_of(building as u32).iter().filter(is_seen).count(),
                scores: sweep.scores(self.problem.scene, building, &heights_m, standing, &self.config.search),
                pairs: self.pairs(evidence, *view, building as u32),
            })
        };
        Inspection { building, views: views.iter().filter_map(in_view).collect(), heights_m }
    }

    /// Random pairs between the building and what is around it, as the `paper` preset compares them. What `robust`
    /// correlates takes in the ground around a building, so its pairs do too.
    fn pairs(&self, evidence: &Evidence<'_>, view: usize, building: u32) -> Vec<InspectedPair> {
        let ordinal = &self.config.ordinal;
        let region = if self.config.preset == Preset::Paper { ordinal.region } else { Region::BuildingsAndGround };
        let Some(compared) = ComparedPixels::new(evidence, self.roofs, region) else { return Vec::new() };
        let place = |ray: &u32| compared.rays.binary_search(ray).ok();
        let is_seen = |ray: &&u32| evidence.profiles.sight(**ray as usize, self.roofs).building == Some(building);
        let own: Vec<usize> = evidence.rays_of(building).iter().filter(is_seen).filter_map(place).collect();
        let around: Vec<usize> =
            evidence.rays_around(evidence.rays_of(building), AROUND_PX).iter().filter_map(place).collect();
        if own.is_empty() || around.is_empty() {
            return Vec::new();
        }
        let camera = &self.problem.views[view].placed.camera;
        let size = glam::DVec2::new(f64::from(camera.width_px), f64::from(camera.height_px));
        let end = |at: usize| (evidence.profiles.rays[compared.rays[at] as usize].centre() / size).as_vec2().to_array();
        let mut rng = seed::stream(self.problem.seed, "inspected pairs", &[view as u64, u64::from(building)]);
        let draw = |_| {
            let (p, q) = (own[rng.random_range(0..own.len())], around[rng.random_range(0..around.len())]);
            let order = DepthOrder::from_prior(compared.prior[p], compared.prior[q], ordinal.min_contrast)?;
            let contrast = compared.of_rendered.contrast(compared.rendered[p], compared.rendered[q]);
            Some(InspectedPair { ends: [end(p), end(q)], cost: order.cost(contrast, ordinal.margin) })
        };
        (0..N_DRAWN).filter_map(draw).take(N_KEPT).collect()
    }
}
