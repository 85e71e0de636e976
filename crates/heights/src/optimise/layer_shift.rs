//! Shift of the footprint layer as a whole against the photos: layers that were drawn over other photos, or in another realisation of
//! a datum, are off by metres.
//!
//! ```text
//! S(d) = mean over buildings of their best score near the present height, all photos moved by d along the ground
//! d*   = place of its maximum, by parabolas along east and north, in rounds;   σ: leaving out one building at a time
//! ```
//!
//! A first search along every [`THIN`]th ray that comes to rest clearly nearer than what is told is the last. Priors are in metres as
//! they were before the photos moved.
//!
//! Seen from all sides a footprint that is off shows: what stands out does so beside it, on the same side of the map in every photo.
//! Seen from one side it would pass for another height, so only buildings with photos from around them are asked.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::{DILATE_PX, SearchConfig};
use crate::evidence::Evidence;
use crate::optimise::solve::{Problem, ViewInput};
use crate::render::profile::{CappedScene, Profiles};
use crate::search::shift::{PeakSearch, evenly_around, lead_all_around};
use crate::search::{Finding, Range, SweepView, SweepViews, around, find_roofs, sweep};
use crate::stats::jackknife_sigma;

/// Buildings that are asked at most, and views of each.
const N_BUILDINGS: usize = 24;
const N_VIEWS: usize = 6;
/// Fewer views of a building do not tell a shift from a height.
const MIN_VIEWS: usize = 3;
/// So many buildings bring their views along, the others take part where these see them: priors of few views are held in memory.
const N_LEADING: usize = 6;
/// Fewer buildings than this say nothing about a layer.
const MIN_BUILDINGS: usize = 8;
/// First step of the search, metres, if not a pixel of the working image on the ground.
const STEP_M: f64 = 1.0;
/// Rounds of the search at most, and the share of a step within which it has come to rest.
const MAX_ROUNDS: usize = 12;
const AT_REST: f64 = 0.5;
/// The first search takes one ray of so many.
const THIN: usize = 3;
/// Least distance that is told: metres, if not so many standard deviations.
const LEAST_SHIFT_M: f64 = 0.75;
const SIGMAS: f64 = 3.0;
/// Least share of the buildings that are explained better there, whatever the forms of their roofs.
const MIN_AGREEING: f64 = 0.7;

/// How far a layer of footprints lies from where the photos show its buildings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LayerShift {
    /// Footprints lie so far east of what the photos show, metres: photos that are moved by as much see them in place.
    pub east_m: f64,
    /// The same to the north, metres.
    pub north_m: f64,
    /// One standard deviation along each axis, metres.
    pub sigma_m: f64,
    /// Buildings that it was measured on.
    pub n_buildings: usize,
}

/// Least error of the ground's level that is told, metres, if not three standard deviations.
const LEAST_LEVEL_M: f64 = 1.0;

/// How far the ground lies from where depth shows it, all buildings together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LevelOff {
    /// Height of the ground above the level that was given, metres.
    pub up_m: f64,
    /// One standard deviation, metres.
    pub sigma_m: f64,
    /// Buildings that it was measured on.
    pub n_buildings: usize,
}

/// Buildings, views and priors that distances are measured with.
struct ShiftTrial<'a> {
    problem: &'a Problem<'a>,
    config: &'a SearchConfig,
    heights_m: &'a [f32],
    views_of: Vec<Vec<usize>>,
    /// By view, where photos and footprints stand as they are, with the buildings that are asked in it.
    views: BTreeMap<usize, (&'a SweepView<'a>, Vec<usize>)>,
    capped: CappedScene,
    /// One ray of so many takes part.
    thin: usize,
}

/// Measures how far the photos lie from the footprints with the heights as they stand; `None` where they fit, or too little is seen
/// to say.
pub(super) fn measure(
    problem: &Problem<'_>,
    views: SweepViews<'_>,
    views_of: &[Vec<usize>],
    heights_m: &[f32],
    config: &SearchConfig,
) -> Option<LayerShift> {
    let (trial, asked, step_m) = ShiftTrial::new(problem, views, views_of, heights_m, config)?;
    let (peak, sigma_m) = trial.peak(&asked, step_m)?;
    if peak.length() + SIGMAS * sigma_m < LEAST_SHIFT_M {
        return None;
    }
    ShiftTrial { thin: 1, ..trial }.search(&asked, step_m)
}

/// Measures how far the ground lies above or below its given level; `None` where it fits, or too little is seen to say.
///
/// All photos are moved up or down, and each building takes its best height near the present one. Over a ground that is too high, a wall's
/// foot is drawn too high in every photo, whereas the depth's jump at the roof's edge is as high as the building.
pub(super) fn measure_level(
    problem: &Problem<'_>,
    views: SweepViews<'_>,
    views_of: &[Vec<usize>],
    heights_m: &[f32],
    config: &SearchConfig,
) -> Option<LevelOff> {
    let (trial, asked, step_m) = ShiftTrial::new(problem, views, views_of, heights_m, config)?;
    trial.search_level(&asked, step_m)
}

/// Views of the buildings that are asked, from all around them; none for the others.
fn sample(problem: &Problem<'_>, views_of: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let way = |b: usize, view: usize| -> DVec2 {
        let prism = &problem.scene.prisms[b];
        (problem.views[view].placed.eye() - prism.centre_at(prism.ground_z).as_dvec3()).truncate()
    };
    let is_all_around = |b: usize, views: &[usize]| {
        let ways: Vec<DVec2> = views.iter().map(|&v| way(b, v)).collect();
        views.len() >= MIN_VIEWS && lead_all_around(&ways)
    };
    let mut sampled = vec![Vec::new(); views_of.len()];
    let mut known: BTreeSet<usize> = BTreeSet::new();
    let mut n_taken = 0;
    // Evenly over the layer: every `step`-th, then those after them, and so on.
    let step = views_of.len().div_ceil(N_BUILDINGS).max(1);
    for b in (0..step).flat_map(|first| (first..views_of.len()).step_by(step)) {
        if n_taken == N_BUILDINGS {
            break;
        }
        let is_leading = n_taken < N_LEADING;
        let wanted = |view: &usize| is_leading || known.contains(view);
        let wanted = views_of[b].iter().copied().filter(wanted);
        let views = evenly_around(wanted.map(|v| (v, way(b, v))), N_VIEWS);
        if is_all_around(b, &views) {
            known.extend(&views);
            sampled[b] = views;
            n_taken += 1;
        }
    }
    sampled
}

/// Size of the working image's pixel on the buildings, metres, median.
fn pixel_on_ground_m(problem: &Problem<'_>, views_of: &[Vec<usize>]) -> f64 {
    let of_building = |(b, views): (usize, &Vec<usize>)| {
        let prism = &problem.scene.prisms[b];
        let centre = prism.centre_at(prism.ground_z).as_dvec3();
        views.iter().map(|&v| problem.views[v].placed.pixel_m_at(centre)).collect::<Vec<_>>()
    };
    let all: Vec<f64> = views_of.iter().enumerate().flat_map(of_building).collect();
    crate::stats::median(&all).unwrap_or(0.0)
}

impl<'a> ShiftTrial<'a> {
    /// A trial with few of the rays, the buildings that are asked, and the first step, metres.
    fn new(
        problem: &'a Problem<'a>,
        views: SweepViews<'a>,
        views_of: &[Vec<usize>],
        heights_m: &'a [f32],
        config: &'a SearchConfig,
    ) -> Option<(Self, Vec<usize>, f64)> {
        let views_of = sample(problem, views_of);
        let asked: Vec<usize> = (0..views_of.len()).filter(|&b| !views_of[b].is_empty()).collect();
        if asked.len() < MIN_BUILDINGS {
            return None;
        }
        let mut asked_in: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for &b in &asked {
            views_of[b].iter().for_each(|view| asked_in.entry(*view).or_default().push(b));
        }
        let of_view = |(view, asked): (usize, Vec<usize>)| Some((view, (views[view].as_ref()?, asked)));
        let views = asked_in.into_iter().filter_map(of_view).collect();
        let step_m = STEP_M.max(pixel_on_ground_m(problem, &views_of));
        let capped = CappedScene::new(problem.scene);
        Some((Self { problem, config, heights_m, views_of, views, capped, thin: THIN }, asked, step_m))
    }

    fn search_level(&self, asked: &[usize], step_m: f64) -> Option<LevelOff> {
        let search = PeakSearch { axes: &[DVec3::Z], step_m, at_rest: AT_REST, max_rounds: MAX_ROUNDS };
        let (around, cross) = search.run(|d| self.scores(d, asked))?;
        let peak_m = (around + cross.to_peak(|_| true)).z;
        let without: Vec<f64> = (0..asked.len()).map(|out| (around + cross.to_peak(|i| i != out)).z).collect();
        let sigma_m = jackknife_sigma(&without)?;
        if peak_m.abs() < LEAST_LEVEL_M.max(SIGMAS * sigma_m) {
            return None;
        }
        let (here, there) = (self.scores(DVec3::ZERO, asked), self.scores(peak_m * DVec3::Z, asked));
        let n_better = here.iter().zip(&there).filter(|(here, there)| there > here).count();
        let is_told = n_better as f64 >= MIN_AGREEING * asked.len() as f64;
        // Photos that are moved up see the ground as much lower.
        is_told.then_some(LevelOff { up_m: -peak_m, sigma_m, n_buildings: asked.len() })
    }

    /// The place where the scores have their peak, and its standard deviation, metres.
    fn peak(&self, asked: &[usize], step_m: f64) -> Option<(DVec2, f64)> {
        let search = PeakSearch { axes: &[DVec3::X, DVec3::Y], step_m, at_rest: AT_REST, max_rounds: MAX_ROUNDS };
        let (around, cross) = search.run(|d| self.scores(d, asked))?;
        let peak = (around + cross.to_peak(|_| true)).truncate();
        let without: Vec<DVec2> =
            (0..asked.len()).map(|out| (around + cross.to_peak(|i| i != out)).truncate()).collect();
        let sigma_of = |axis: fn(&DVec2) -> f64| jackknife_sigma(&without.iter().map(axis).collect::<Vec<_>>());
        Some((peak, sigma_of(|d| d.x)?.max(sigma_of(|d| d.y)?)))
    }

    fn search(&self, asked: &[usize], step_m: f64) -> Option<LayerShift> {
        let (peak, sigma_m) = self.peak(asked, step_m)?;
        if peak.length() < LEAST_SHIFT_M.max(SIGMAS * sigma_m) {
            return None;
        }
        // Houses that all have a low annex on the same side seem to be off, too, until their roofs may have two levels.
        let (here, there) = (self.scores_of_roofs(DVec2::ZERO, asked), self.scores_of_roofs(peak, asked));
        let gains: Vec<f64> = here.iter().zip(&there).filter_map(|(here, there)| Some((*there)? - (*here)?)).collect();
        let n_better = gains.iter().filter(|gain| **gain > 0.0).count();
        let is_told =
            n_better as f64 >= MIN_AGREEING * gains.len().max(MIN_BUILDINGS) as f64 && gains.iter().sum::<f64>() > 0.0;
        is_told.then_some(LayerShift { east_m: peak.x, north_m: peak.y, sigma_m, n_buildings: asked.len() })
    }

    /// The best score of each building near its present height, all photos moved by `by_m`; 0 where no view sees it there.
    fn scores(&self, by_m: DVec3, asked: &[usize]) -> Vec<f64> {
        self.moved(by_m, |_, found| asked.iter().map(|&b| found[b].as_ref().map_or(0.0, |f| f.score)).collect())
    }

    /// The same of the best roof of any form.
    fn scores_of_roofs(&self, by_m: DVec2, asked: &[usize]) -> Vec<Option<f64>> {
        self.moved(by_m.extend(0.0), |views, found| {
            let height_m = |(found, before): (&Option<Finding>, &f32)| found.as_ref().map_or(*before, |f| f.height_m);
            let heights_m: Vec<f32> = found.iter().zip(self.heights_m).map(height_m).collect();
            let is_asked = |b: usize| asked.binary_search(&b).is_ok();
            let roofs = find_roofs(self.problem.scene, views, &self.views_of, &heights_m, is_asked, self.config);
            asked.iter().map(|&b| roofs[b].as_ref().and_then(|judged| judged.score)).collect()
        })
    }

    /// Pixels of a view in and around the buildings that are asked in it, as far around as they are moved, of which one in so many.
    fn pixels(&self, seen: &SweepView<'_>, asked: &[usize], by_m: DVec3) -> Vec<[u16; 2]> {
        let scene = self.problem.scene;
        let of_building = |&b: &usize| {
            let prism = &scene.prisms[b];
            let moved_px = by_m.length() / seen.placed.pixel_m_at(prism.centre_at(prism.ground_z).as_dvec3());
            let (_, highest_m) = around(self.heights_m[b], 1.0, scene.bounds);
            // Forms of roofs are judged in whole windows too.
            let top_z = if self.thin > 1 { prism.ground_z + highest_m } else { f32::INFINITY };
            seen.evidence.rays_around(&seen.evidence.rays_below(b as u32, top_z), DILATE_PX + moved_px.ceil() as usize)
        };
        let rays: BTreeSet<u32> = asked.iter().flat_map(of_building).collect();
        rays.into_iter().step_by(self.thin).map(|ray| seen.evidence.profiles.rays[ray as usize].pixel).collect()
    }

    /// Hands the views, all moved by `by_m`, and what a local sweep finds in them to `look`.
    fn moved<T>(&self, by_m: DVec3, look: impl FnOnce(SweepViews<'_>, &[Option<Finding>]) -> T) -> T {
        let views: BTreeMap<usize, ViewInput> =
            self.views.keys().map(|&view| (view, self.problem.views[view].moved(by_m))).collect();
        let scene = self.problem.scene;
        let profiles: BTreeMap<usize, Profiles> = self
            .views
            .par_iter()
            .map(|(&view, (seen, asked))| {
                let pixels = self.pixels(seen, asked, by_m);
                (view, Profiles::through(scene, &self.capped, &views[&view].placed, &pixels))
            })
            .collect();
        let evidence: BTreeMap<usize, Evidence<'_>> =
            profiles.par_iter().map(|(view, profiles)| (*view, self.views[view].0.evidence.along(profiles))).collect();
        // Roofs stay where the photos show them.
        let start_m = |height_m: &f32| (height_m + by_m.z as f32).clamp(scene.bounds.min_m, scene.bounds.max_m);
        let start_m: Vec<f32> = self.heights_m.iter().map(start_m).collect();
        let roofs = scene.roofs(&start_m);
        let sweep_view = |view: usize| {
            let evidence = evidence.get(&view)?;
            Some(self.views[&view].0.along(&views[&view].placed, evidence, evidence.profiles.stops(&roofs)))
        };
        let sweep_views: Vec<_> = (0..self.problem.views.len()).into_par_iter().map(sweep_view).collect();
        let range = Range::Local { share: 1.0 };
        let found = sweep(scene, &sweep_views, &self.views_of, &start_m, |_| true, range, self.config);
        look(&sweep_views, &found)
    }
}

impl LayerShift {
    /// The shift as a vector on the ground, east and north, metres.
    #[must_use]
    pub fn on_ground(&self) -> DVec3 {
        DVec3::new(self.east_m, self.north_m, 0.0)
    }
}
