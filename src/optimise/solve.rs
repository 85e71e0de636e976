//! The epoch loop of both presets.

use glam::DVec3;
use rand::Rng;
use rand::seq::SliceRandom;
use rayon::prelude::*;

use super::adam::Adam;
use super::bleed;
use super::config::{Gradient, OptimiseConfig, Preset};
use super::evidence::Evidence;
use super::gradient::edge_sampled::Outlines;
use super::levels::{self, OtherLevel};
use super::ordinal::{StepInput, ViewStep, view_step};
use super::roof::Roof;
use super::score::Correlation;
use super::search::{Finding, Range, SweepView, find_roofs, sweep};
use super::solution::{EpochRecord, Reason, Solution, SolvedHeight};
use crate::prior::DepthPrior;
use crate::render::PlacedCamera;
use crate::render::profile::{CappedScene, Profiles, Sampling};
use crate::scene::Scene;
use crate::seed;
use crate::views::{Candidate, Choice, Selection, ViewsConfig, Visibility, in_turn, select, select_each, visibility};

/// A flat sum of correlations over the tried heights below which the score says nothing.
const FLAT_SCORE: f64 = 0.02;
/// A standard error over views above which a height is doubtful, metres.
const DOUBTFUL_SPREAD_M: f64 = 0.8;
/// A score below which no height explains the priors, and the same where a single view has a say. Of 315 simulated buildings
/// under 8 or 14 photos, half of the 21 below were off by more than 7 m, half of those above by less than 1.1 m.
const HOPELESS_SCORE: f64 = 0.2;
const HOPELESS_SCORE_ALONE: f64 = 0.6;
/// What the standard error over views counts for in the stated standard deviation, and what every height is off by
/// besides, in pixels on the building. Fitted to 640 simulated buildings (8 scenes, 4 levels of prior errors).
const SPREAD_SHARE: f64 = 0.5;
const SYSTEMATIC_PX: f64 = 0.65;
/// Spill that is left alone, and the most that is taken back, pixels of the working image.
const MIN_SPILL_PX: f64 = 0.5;
const MAX_SPILL_PX: f64 = 4.0;

/// A view that may take part.
#[derive(Debug, Clone)]
pub struct ViewInput {
    /// The camera at its working resolution, in the local frame.
    pub placed: PlacedCamera,
    /// Whether heights may be measured in it (oblique views).
    pub is_oblique: bool,
    /// A number for its name ([`seed::key_of`]): random choices about a view do not depend on its company.
    pub key: u64,
}

/// What is to be solved.
pub struct Problem<'a> {
    /// Footprints on the ground.
    pub scene: &'a Scene,
    /// Every view of the survey.
    pub views: &'a [ViewInput],
    /// Loads the prior of a view by its position; the text says why it cannot.
    pub load_prior: &'a (dyn Fn(usize) -> Result<DepthPrior, String> + Sync),
    /// By building: its height above ground in an earlier solution of almost the same scene, metres; may be empty.
    pub start_m: &'a [Option<f32>],
    /// Root seed.
    pub seed: u64,
    /// Told what is going on, how much of it is done and how much there is.
    pub progress: &'a (dyn Fn(Solving, usize, usize) + Sync),
}

/// What a solver is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solving {
    /// Tracing the rays of all views.
    Tracing,
    /// Loading the priors of selected views.
    Priors,
    /// Passing over buildings or views.
    Epochs,
}

/// Finds one height per building.
#[must_use]
pub fn solve(problem: &Problem<'_>, config: &OptimiseConfig) -> Solution {
    let profiles = trace_all(problem, config);
    let mut state = State::new(problem, config, &profiles);
    match config.preset {
        Preset::Paper => state.run_ordinal(),
        Preset::Robust => state.run_search(),
    }
    state.into_solution()
}

/// The views whose priors a solution asks for first, in ascending order; as heights become known it may ask for a few
/// more. No prior is loaded.
#[must_use]
pub fn first_selection(problem: &Problem<'_>, config: &OptimiseConfig) -> Vec<usize> {
    let profiles = trace_all(problem, config);
    let mut state = State::new(problem, config, &profiles);
    state.set_start_heights();
    let mut views = state.select(&state.visibilities()).views;
    views.sort_unstable();
    views
}

fn trace_all(problem: &Problem<'_>, config: &OptimiseConfig) -> Vec<Profiles> {
    let capped = CappedScene::new(problem.scene);
    let n = problem.views.len();
    let mut profiles = Vec::with_capacity(n);
    for (view, input) in problem.views.iter().enumerate() {
        (problem.progress)(Solving::Tracing, view, n);
        let sampling = Sampling { stride_px: config.stride_px, seed: problem.seed, view: input.key };
        profiles.push(if input.is_oblique {
            Profiles::trace(problem.scene, &capped, &input.placed, sampling)
        } else {
            Profiles::none()
        });
    }
    (problem.progress)(Solving::Tracing, n, n);
    profiles
}

struct State<'a> {
    problem: &'a Problem<'a>,
    config: &'a OptimiseConfig,
    views_config: ViewsConfig,
    profiles: &'a [Profiles],
    /// By view; filled as selection asks for them.
    evidence: Vec<Option<Evidence<'a>>>,
    failed: Vec<Option<String>>,
    heights_m: Vec<f32>,
    findings: Vec<Option<Finding>>,
    roofs: Vec<Option<Roof>>,
    views_of: Vec<Vec<usize>>,
    history: Vec<EpochRecord>,
    /// By view: by how many pixels of the working image its prior's near sides spill over their edges.
    spill_px: Vec<f64>,
    other_levels: Vec<OtherLevel>,
}

impl<'a> State<'a> {
    fn new(problem: &'a Problem<'a>, config: &'a OptimiseConfig, profiles: &'a [Profiles]) -> Self {
        let (n_views, n_buildings) = (problem.views.len(), problem.scene.prisms.len());
        Self {
            problem,
            config,
            views_config: config.views_in_force(),
            profiles,
            evidence: (0..n_views).map(|_| None).collect(),
            failed: vec![None; n_views],
            heights_m: vec![0.0; n_buildings],
            findings: vec![None; n_buildings],
            roofs: vec![None; n_buildings],
            views_of: vec![Vec::new(); n_buildings],
            history: Vec::new(),
            spill_px: vec![0.0; n_views],
            other_levels: Vec::new(),
        }
    }

    /// Heights that the search starts from.
    fn set_start_heights(&mut self) {
        let bounds = self.problem.scene.bounds;
        match self.config.preset {
            Preset::Paper => {
                self.heights_m = initial_heights(self.problem.seed, bounds.min_m, bounds.max_m, self.heights_m.len());
            }
            Preset::Robust => {
                for (b, height_m) in self.heights_m.iter_mut().enumerate() {
                    let known_m = self.problem.start_m.get(b).copied().flatten();
                    *height_m = known_m.unwrap_or(self.config.search.start_height_m).clamp(bounds.min_m, bounds.max_m);
                }
            }
        }
    }

    /// Selects views that see the buildings.
    fn select(&self, visibilities: &[Visibility]) -> Selection {
        let views = self.problem.views;
        let n_buildings = self.problem.scene.prisms.len();
        let axes: Vec<DVec3> = views.iter().map(|v| v.placed.axis()).collect();
        let ground_z = f64::from(self.problem.scene.prisms.first().map_or(0.0, |p| p.ground_z));
        let stations: Vec<DVec3> = views.iter().map(|v| v.placed.looks_at(ground_z)).collect();
        let candidates: Vec<Candidate> = views.iter().map(|v| Candidate { eye: v.placed.eye(), key: v.key }).collect();
        let centres: Vec<DVec3> = (0..n_buildings).map(|b| self.centre(b)).collect();
        match self.views_config.choice {
            Choice::Cover => select(&self.views_config, visibilities, &stations, &axes, n_buildings),
            Choice::Each => select_each(&self.views_config, visibilities, &candidates, &centres),
        }
    }

    /// Selects views for the present heights and loads the priors that are new; a view whose prior cannot be loaded is
    /// replaced by another.
    fn reselect(&mut self) -> Selection {
        let mut visibilities = self.visibilities();
        loop {
            let selection = self.select(&visibilities);
            self.load(&selection.views);
            let failed: Vec<usize> = selection.views.iter().copied().filter(|&v| self.failed[v].is_some()).collect();
            if failed.is_empty() {
                let of_building = selection.views_of_building.iter().enumerate();
                self.views_of = of_building.map(|(b, views)| self.best_views(b, views, &visibilities)).collect();
                return selection;
            }
            for view in failed {
                visibilities[view] = Visibility::default();
            }
        }
    }

    /// What each view sees with the present heights; views that take no part see nothing.
    fn visibilities(&self) -> Vec<Visibility> {
        let takes_part = |&v: &usize| self.problem.views[v].is_oblique && self.failed[v].is_none();
        let taking_part: Vec<usize> = (0..self.problem.views.len()).filter(takes_part).collect();
        let placed: Vec<_> = taking_part.iter().map(|&v| (&self.problem.views[v].placed, &self.profiles[v])).collect();
        let seen = visibility(self.problem.scene, &placed, &self.heights_m, self.config.stride_px);
        let mut visibilities = vec![Visibility::default(); self.problem.views.len()];
        for (view, seen) in taking_part.into_iter().zip(seen) {
            visibilities[view] = seen;
        }
        visibilities
    }

    fn load(&mut self, views: &[usize]) {
        let new: Vec<usize> =
            views.iter().copied().filter(|&v| self.evidence[v].is_none() && self.failed[v].is_none()).collect();
        let n_buildings = self.problem.scene.prisms.len();
        let n_done = std::sync::atomic::AtomicUsize::new(0);
        let loaded: Vec<_> = new
            .par_iter()
            .map(|&v| {
                let evidence = (self.problem.load_prior)(v).map(|prior| {
                    let placed = &self.problem.views[v].placed;
                    Evidence::new(
                        placed,
                        &self.profiles[v],
                        &prior,
                        self.spill_px[v],
                        self.config.stride_px,
                        n_buildings,
                    )
                });
                let done = n_done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
                (self.problem.progress)(Solving::Priors, done, new.len());
                evidence
            })
            .collect();
        for (v, evidence) in new.into_iter().zip(loaded) {
            match evidence {
                Ok(evidence) => self.evidence[v] = Some(evidence),
                Err(why) => self.failed[v] = Some(why),
            }
        }
    }

    /// The views a building is measured in: from each sector of azimuth in turn the one that sees most of it.
    fn best_views(&self, building: usize, candidates: &[usize], seen: &[Visibility]) -> Vec<usize> {
        let centre = self.centre(building);
        let n_rays = |view: usize| {
            let sights = &seen[view].buildings;
            sights.binary_search_by_key(&(building as u32), |s| s.building).map_or(0, |i| sights[i].n_rays)
        };
        let loaded = candidates.iter().copied().filter(|&v| self.evidence[v].is_some());
        let ranked = loaded.map(|view| {
            let from = self.problem.views[view].placed.eye() - centre;
            (view, from.truncate(), std::cmp::Reverse(n_rays(view)))
        });
        in_turn(ranked, self.config.search.max_views_per_building)
    }

    /// Middle of a building at its ground, local frame, metres.
    fn centre(&self, building: usize) -> DVec3 {
        let prism = &self.problem.scene.prisms[building];
        prism.centre_at(prism.ground_z).as_dvec3()
    }

    fn run_search(&mut self) {
        let config = &self.config.search;
        self.set_start_heights();
        let n_sweeps = config.full_sweeps + config.local_sweeps;
        let mut n_selected = 0;
        for i in 0..config.full_sweeps {
            (self.problem.progress)(Solving::Epochs, i, n_sweeps);
            if i % config.reselect_every.max(1) == 0 {
                n_selected = self.reselect().views.len();
            }
            self.sweep(Range::Full, Correlation::Linear, n_selected);
        }
        if config.split_levels {
            let (views, known_m) = (self.sweep_views(), self.problem.start_m);
            self.other_levels =
                levels::find(self.problem.scene, &views, &self.views_of, &self.heights_m, known_m, config);
            if !self.other_levels.is_empty() {
                return; // to be solved again with these outlines taken apart
            }
        }
        if config.take_back_spill {
            self.take_back_spill();
        }
        for i in 0..config.local_sweeps {
            (self.problem.progress)(Solving::Epochs, config.full_sweeps + i, n_sweeps);
            let is_rank = i >= config.local_sweeps.saturating_sub(config.rank_sweeps);
            let correlation = if is_rank { Correlation::Rank } else { Correlation::Linear };
            self.sweep(Range::Local { share: if i == 0 { 1.0 } else { 0.5 } }, correlation, n_selected);
        }
        if config.pitched_roofs {
            let views = self.sweep_views();
            self.roofs = find_roofs(self.problem.scene, &views, &self.views_of, &self.heights_m, config);
        }
        (self.problem.progress)(Solving::Epochs, n_sweeps, n_sweeps);
    }

    /// Measures how far each prior's near sides spill over known edges, and samples the priors anew without it.
    fn take_back_spill(&mut self) {
        let used: Vec<usize> = (0..self.evidence.len()).filter(|&v| self.evidence[v].is_some()).collect();
        let edges = bleed::Edges::new(self.problem.scene, &self.heights_m);
        let n_buildings = self.heights_m.len();
        let offsets_of = |&v: &usize| {
            let (Some(evidence), Ok(prior)) = (&self.evidence[v], (self.problem.load_prior)(v)) else {
                return Vec::new();
            };
            let seen = (0..n_buildings).filter(|&b| !evidence.rays_of(b as u32).is_empty());
            edges.offsets(&self.problem.views[v].placed, &prior, seen)
        };
        let offsets: Vec<Vec<f64>> = used.par_iter().map(offsets_of).collect();
        let mut changed = Vec::new();
        for (&v, spill_px) in used.iter().zip(bleed::spills(&offsets)) {
            if spill_px.abs() >= MIN_SPILL_PX {
                self.spill_px[v] = spill_px.clamp(-MAX_SPILL_PX, MAX_SPILL_PX);
                self.evidence[v] = None;
                changed.push(v);
            }
        }
        self.load(&changed);
    }

    /// Every view with a prior, with the roofs as they stand.
    fn sweep_views(&self) -> Vec<Option<SweepView<'_>>> {
        let roofs = self.problem.scene.roofs(&self.heights_m);
        let view_of = |v: usize| {
            let evidence = self.evidence[v].as_ref()?;
            let placed = &self.problem.views[v].placed;
            let stops = evidence.profiles.stops(&roofs);
            Some(SweepView::new(placed, evidence, stops, self.config.search.calibrate_on))
        };
        (0..self.evidence.len()).into_par_iter().map(view_of).collect()
    }

    /// One pass over all buildings: each takes the best height of the range.
    fn sweep(&mut self, range: Range, correlation: Correlation, n_selected: usize) {
        let views = self.sweep_views();
        let (scene, config) = (self.problem.scene, &self.config.search);
        let found = sweep(scene, &views, &self.views_of, &self.heights_m, range, correlation, config);
        drop(views);
        let before = self.heights_m.clone();
        for (b, finding) in found.into_iter().enumerate() {
            if let Some(finding) = finding {
                self.heights_m[b] = finding.height_m;
                // The full sweeps saw the whole range: only they can tell a flat score.
                let contrast = match (range, &self.findings[b]) {
                    (Range::Local { .. }, Some(previous)) => previous.contrast,
                    _ => finding.contrast,
                };
                self.findings[b] = Some(Finding { contrast, ..finding });
            }
        }
        let scores: Vec<f64> = self.findings.iter().flatten().map(|f| f.score).collect();
        let loss = 1.0 - crate::stats::mean(&scores).unwrap_or(0.0);
        self.record(loss, &before, n_selected, None);
    }

    fn run_ordinal(&mut self) {
        let config = &self.config.ordinal;
        let bounds = self.problem.scene.bounds;
        self.set_start_heights();
        let mut adam = Adam::new(self.heights_m.len());
        let mut selection = None;
        let mut n_steps = 0;
        for epoch in 0..config.epochs {
            (self.problem.progress)(Solving::Epochs, epoch, config.epochs);
            if epoch % config.reselect_every.max(1) == 0 {
                selection = Some(self.reselect());
            }
            let Some(selection) = &selection else { return };
            let mut order: Vec<usize> =
                selection.views.iter().copied().filter(|&v| self.evidence[v].is_some()).collect();
            order.shuffle(&mut seed::stream(self.problem.seed, "view order", &[epoch as u64]));
            let before = self.heights_m.clone();
            let n_total = (config.epochs * order.len()).max(2);
            let mut steps: Vec<ViewStep> = Vec::new();
            for view in order {
                let progress = (n_steps as f32 / (n_total - 1) as f32).min(1.0);
                let anneal = |ends: [f32; 2]| ends[0] * (ends[1] / ends[0]).powf(progress);
                let roofs = self.problem.scene.roofs(&self.heights_m);
                let mut rng = seed::stream(self.problem.seed, "pairs", &[epoch as u64, view as u64]);
                let evidence = self.evidence[view].as_ref().expect("only loaded views are in the order");
                let prior = match config.gradient {
                    Gradient::EdgeSampled => (self.problem.load_prior)(view).ok(),
                    Gradient::Interior | Gradient::CentralDifference => None,
                };
                let (scene, placed) = (self.problem.scene, &self.problem.views[view].placed);
                let outlines = prior.as_ref().map(|prior| Outlines { scene, placed, prior });
                let input = StepInput { evidence, roofs: &roofs, difference_m: anneal(config.difference_m), outlines };
                let Some(step) = view_step(&input, config, &mut rng) else { continue };
                for &(building, derivative) in &step.gradient {
                    let at = building as usize;
                    let change = adam.change(at, derivative, f64::from(anneal(config.step_m)));
                    self.heights_m[at] = (self.heights_m[at] + change as f32).clamp(bounds.min_m, bounds.max_m);
                }
                n_steps += 1;
                steps.push(step);
            }
            let losses: Vec<f64> = steps.iter().map(|s| s.loss).collect();
            let n_pairs: usize = steps.iter().map(|s| s.n_pairs).sum();
            let n_active: usize = steps.iter().map(|s| s.n_active).sum();
            let n_selected = selection.views.len();
            let active = n_active as f64 / n_pairs.max(1) as f64;
            self.record(crate::stats::mean(&losses).unwrap_or(0.0), &before, n_selected, Some(active));
        }
        (self.problem.progress)(Solving::Epochs, config.epochs, config.epochs);
    }

    fn record(&mut self, loss: f64, before: &[f32], n_selected: usize, active_pairs: Option<f64>) {
        let changes: Vec<f64> = before
            .iter()
            .zip(&self.heights_m)
            .map(|(a, b)| f64::from((b - a).abs() / a.max(f32::MIN_POSITIVE)))
            .collect();
        self.history.push(EpochRecord {
            loss,
            relative_change: crate::stats::mean(&changes).unwrap_or(0.0),
            n_selected,
            active_pairs,
            heights_m: self.heights_m.clone(),
        });
    }

    fn into_solution(self) -> Solution {
        let heights = (0..self.heights_m.len()).map(|b| self.solved(b)).collect();
        let used_views: Vec<usize> = (0..self.evidence.len()).filter(|&v| self.evidence[v].is_some()).collect();
        let spills: Vec<f64> = used_views.iter().map(|&v| self.spill_px[v]).collect();
        let spill_px = crate::stats::median(&spills).unwrap_or(0.0);
        let failed_views = self.failed.iter().enumerate().filter_map(|(v, why)| Some((v, why.clone()?))).collect();
        let other_levels = self.other_levels;
        Solution { heights, history: self.history, used_views, spill_px, spills_px: spills, other_levels, failed_views }
    }

    /// The standard deviation to state for a standard error over views, which knows nothing of what all views have in
    /// common, metres.
    fn calibrated_sigma(&self, building: usize, spread_m: f64) -> f64 {
        let centre = self.centre(building);
        let pixel_m = |&view: &usize| {
            let placed = &self.problem.views[view].placed;
            (placed.eye() - centre).length() / placed.camera.fx_px
        };
        let pixels_m: Vec<f64> = self.views_of[building].iter().map(pixel_m).collect();
        let systematic_m = SYSTEMATIC_PX * crate::stats::median(&pixels_m).unwrap_or(0.0);
        (SPREAD_SHARE * spread_m).hypot(systematic_m)
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
        let score = finding.map(|f| f.score);
        let least_score = if finding.is_some_and(|f| f.n_views < 2) { HOPELESS_SCORE_ALONE } else { HOPELESS_SCORE };
        if score.is_some_and(|s| s < least_score) {
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
        if is_at_bound {
            reasons.push(Reason::RangeBound);
        }
        if finding.is_some_and(|f| f.contrast < FLAT_SCORE) {
            reasons.push(Reason::FlatScore);
        }
        let spread_m = finding.and_then(|f| f.sigma_m);
        let sigma_m = spread_m.map(|spread_m| self.calibrated_sigma(building, spread_m));
        if spread_m.is_some_and(|s| s > DOUBTFUL_SPREAD_M) {
            reasons.push(Reason::ConflictingViews);
        }
        let roof = self.roofs[building].unwrap_or(Roof::flat(f64::from(height_m)));
        let height_m = roof.height_m(self.config.height_reference);
        SolvedHeight { height_m: Some(height_m), roof: Some(roof), sigma_m, views, score, raised_m: None, reasons }
    }
}

/// Heights from a normal distribution around mid-range, a quarter of the range wide, clamped (`SiZeUp`, "Initialisation";
/// the paper leaves mean and width open).
fn initial_heights(root: u64, min_m: f32, max_m: f32, n: usize) -> Vec<f32> {
    let mut rng = seed::stream(root, "initial heights", &[]);
    let (mean, sigma) = (0.5 * (min_m + max_m), 0.25 * (max_m - min_m));
    (0..n)
        .map(|_| {
            // Box and Muller.
            let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
            let angle = std::f32::consts::TAU * rng.random::<f32>();
            (mean + sigma * radius * angle.cos()).clamp(min_m, max_m)
        })
        .collect()
}
