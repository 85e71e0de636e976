//! A problem, and how both presets go about it: [`views`] chooses and loads, [`epochs`] and [`sweeps`] are the two
//! solvers' loops, [`outcome`] says what is known in the end.

mod epochs;
mod outcome;
mod sweeps;
mod views;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use crate::config::{OptimiseConfig, Preset, START_HEIGHT_M};
use crate::evidence::straighten::PriorShape;
use crate::evidence::{Evidence, SampledPrior};
use crate::optimise::layer_shift::{LayerShift, LevelOff};
use crate::optimise::rays::Rays;
use crate::optimise::solution::{EpochRecord, Reason, Solution};
use crate::prior::DepthPrior;
use crate::raster::Raster;
use crate::render::PlacedCamera;
use crate::render::profile::Profiles;
use crate::roofs::Judged;
use crate::scene::Scene;
use crate::search::Finding;
use crate::search::disagreeing::DisagreeingView;
use crate::search::footprint_shift::FootprintShift;
use crate::search::levels::OtherLevel;
use crate::seed;
use crate::views::{Choice, ViewsConfig};

/// A view that may take part.
#[derive(Debug, Clone)]
pub struct ViewInput {
    /// The camera at its working resolution, in the local frame.
    pub placed: PlacedCamera,
    /// Whether heights may be measured in it: oblique views, or nadir views with depth in metres where there are no others.
    pub is_oblique: bool,
    /// A number for its name ([`seed::key_of`]): random choices about a view do not depend on its company.
    pub key: u64,
}

impl ViewInput {
    /// From its name and its camera at the working resolution.
    #[must_use]
    pub fn new(name: &str, placed: PlacedCamera, is_oblique: bool) -> Self {
        Self { placed, is_oblique, key: seed::key_of(name) }
    }

    /// The same view from elsewhere, moved in the local frame, metres.
    #[must_use]
    pub fn moved(&self, by: DVec3) -> Self {
        Self { placed: self.placed.moved(by), ..self.clone() }
    }
}

/// Task of a solver.
pub struct Problem<'a> {
    /// Footprints on the ground.
    pub scene: &'a Scene,
    /// Every view of the survey.
    pub views: &'a [ViewInput],
    /// Why a view is known to have no prior before anything is loaded or computed (its file is missing); `None`: it may
    /// have one.
    pub without_prior: &'a (dyn Fn(usize) -> Option<String> + Sync),
    /// Loads the prior of a view by its position; the text says why it cannot.
    pub load_prior: &'a (dyn Fn(usize) -> Result<DepthPrior, String> + Sync),
    /// Pixels of a view's photo, by its position, that are as green as leaves, at any size; `None` where that is not known.
    pub green: &'a (dyn Fn(usize) -> Option<Arc<Raster<bool>>> + Sync),
    /// An earlier solution to go on from.
    pub former: Option<Former<'a>>,
    /// Root seed of all random streams.
    pub seed: u64,
    /// The views' rays through the scene, traced by need.
    pub rays: &'a Rays,
    /// Told what is going on, how much of it is done and how much there is.
    pub progress: &'a (dyn Fn(Solving, usize, usize) + Sync),
}

/// An earlier solution of almost the same scene, in the same views (`robust` only).
#[derive(Clone, Copy)]
pub struct Former<'a> {
    /// The solution of that scene.
    pub solution: &'a Solution,
    /// By building of this scene: what is kept of it.
    pub kept: &'a [Kept],
}

/// Part of an earlier solution that is kept for one building.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// Nothing: its height is searched for from the start.
    Nothing,
    /// The height of the building at this position: of the full sweeps it takes part in the last one.
    Height(usize),
    /// All that was found for the building at this position: it is not searched for again.
    All(usize),
}

impl Former<'_> {
    /// Height that a former building was left with by the last pass, above ground, metres.
    #[must_use]
    pub fn height_m(&self, former: usize) -> Option<f32> {
        self.solution.history.last()?.heights_m.get(former).copied()
    }
}

/// Work of a solver.
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
    problem.trace_oblique();
    let mut state = SolverState::new(problem, config);
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
    problem.trace_oblique();
    let mut state = SolverState::new(problem, config);
    state.set_start_heights();
    let mut views = state.select(&state.visibilities()).views;
    views.sort_unstable();
    views
}

impl<'a> Problem<'a> {
    /// Part of an earlier solution that is kept for a building.
    pub(super) fn kept(&self, building: usize) -> Kept {
        self.former.map_or(Kept::Nothing, |former| former.kept[building])
    }

    /// Whether a building is searched for, and not taken from an earlier solution.
    pub(super) fn is_searched(&self, building: usize) -> bool {
        !matches!(self.kept(building), Kept::All(_))
    }

    /// Rays of a view, given by its position among the views.
    #[must_use]
    pub fn profiles(&self, view: usize) -> &'a Profiles {
        self.rays.of(self, view)
    }

    /// A view's prior, loaded and sampled along its rays when first asked for; the text says why it cannot be.
    pub(super) fn prior(&self, view: usize, stride_px: usize) -> Result<&'a SampledPrior, String> {
        if let Some(known) = self.rays.prior(view) {
            return Ok(known);
        }
        let prior = (self.load_prior)(view)?;
        Ok(self.rays.keep_prior(view, self.sampled(view, &prior, 0.0, stride_px)))
    }

    /// A prior along the rays of its view, without what its near sides bleed over their edges, pixels of the working image.
    pub(super) fn sampled(&self, view: usize, prior: &DepthPrior, bleeding_px: f64, stride_px: usize) -> SampledPrior {
        SampledPrior::new(&self.views[view].placed, self.profiles(view), prior, bleeding_px, stride_px)
    }

    /// A view with its prior.
    pub(super) fn evidence(&self, view: usize, prior: &SampledPrior, stride_px: usize) -> Evidence<'a> {
        let placed = &self.views[view].placed;
        let mut evidence = Evidence::new(placed, self.profiles(view), prior, stride_px);
        if let Some(green) = (self.green)(view) {
            evidence.see_green(placed, &green);
        }
        evidence
    }

    /// Traces the rays of all oblique views, and tells of it.
    fn trace_oblique(&self) {
        let n = self.views.len();
        (self.progress)(Solving::Tracing, 0, n);
        let n_done = AtomicUsize::new(0);
        (0..n).into_par_iter().for_each(|view| {
            if self.views[view].is_oblique {
                let _ = self.profiles(view);
            }
            (self.progress)(Solving::Tracing, n_done.fetch_add(1, Ordering::Relaxed) + 1, n);
        });
    }
}

struct SolverState<'a> {
    problem: &'a Problem<'a>,
    config: &'a OptimiseConfig,
    views_config: ViewsConfig,
    /// By view; filled as selection asks for them.
    evidence: Vec<Option<Evidence<'a>>>,
    failed: Vec<Option<String>>,
    /// By view: whether its prior shows something else than the others' (`robust`); it then takes no part.
    disagreeing: Vec<Option<DisagreeingView>>,
    heights_m: Vec<f32>,
    findings: Vec<Option<Finding>>,
    /// By building: whether the ordinal loss ever had a slope by its height.
    is_voted_on: Vec<bool>,
    /// By building: what its pairs have against its height (`paper`).
    order_doubts: Vec<Option<Reason>>,
    roofs: Vec<Judged>,
    /// By building: the area above its roof that no view has looked through, metres squared (`robust`).
    blind_m2: Vec<f64>,
    /// By building: whether hardly anything stands on it that is not as green as leaves (`robust`).
    is_green: Vec<bool>,
    views_of: Vec<Vec<usize>>,
    history: Vec<EpochRecord>,
    /// By view: by how many pixels of the working image its prior's near sides bleed over their edges.
    bleeding_px: Vec<f64>,
    other_levels: Vec<OtherLevel>,
    layer_shift: Option<LayerShift>,
    level_off: Option<LevelOff>,
    /// By building: how far its footprint is off, where that was measured (`robust`).
    footprint_shifts: Vec<Option<FootprintShift>>,
    /// Shape of the priors along the ground, by which they are straightened; `None` before the first are loaded.
    prior_shape: Option<PriorShape>,
}

/// By view: whether its prior was found to disagree in an earlier solution.
fn disagreeing_before(problem: &Problem<'_>, n_views: usize) -> Vec<Option<DisagreeingView>> {
    let mut disagreeing = vec![None; n_views];
    for found in problem.former.iter().flat_map(|former| &former.solution.disagreeing_views) {
        disagreeing[found.view] = Some(*found);
    }
    disagreeing
}

impl<'a> SolverState<'a> {
    fn new(problem: &'a Problem<'a>, config: &'a OptimiseConfig) -> Self {
        let (n_views, n_buildings) = (problem.views.len(), problem.scene.prisms.len());
        let views_config = config.views_in_force();
        // A choice for the whole scene hangs on all views that take part, so those that cannot are left out from the start.
        let is_left_out = |v: &usize| views_config.choice != Choice::Each && problem.views[*v].is_oblique;
        let why = |v: usize| Some(v).filter(is_left_out).and_then(problem.without_prior);
        Self {
            problem,
            config,
            evidence: (0..n_views).map(|_| None).collect(),
            failed: (0..n_views).map(why).collect(),
            disagreeing: disagreeing_before(problem, n_views),
            views_config,
            heights_m: vec![0.0; n_buildings],
            findings: vec![None; n_buildings],
            is_voted_on: vec![false; n_buildings],
            order_doubts: vec![None; n_buildings],
            roofs: vec![Judged::default(); n_buildings],
            blind_m2: vec![0.0; n_buildings],
            is_green: vec![false; n_buildings],
            views_of: vec![Vec::new(); n_buildings],
            history: Vec::new(),
            bleeding_px: vec![0.0; n_views],
            other_levels: Vec::new(),
            layer_shift: None,
            level_off: None,
            footprint_shifts: vec![None; n_buildings],
            prior_shape: if config.may_straighten() {
                problem.former.map(|former| former.solution.prior_shape)
            } else {
                Some(PriorShape::Line)
            },
        }
    }

    /// Heights that the search starts from.
    fn set_start_heights(&mut self) {
        let bounds = self.problem.scene.bounds;
        match self.config.preset {
            Preset::Paper => {
                self.heights_m =
                    epochs::initial_heights(self.problem.seed, bounds, &self.config.ordinal, self.heights_m.len());
            }
            Preset::Robust => {
                let problem = self.problem;
                for b in 0..self.heights_m.len() {
                    let known_m = problem.former.and_then(|former| match former.kept[b] {
                        Kept::Nothing => None,
                        Kept::Height(at) => former.height_m(at),
                        Kept::All(at) => {
                            self.roofs[b].roof = former.solution.heights[at].roof;
                            former.height_m(at)
                        }
                    });
                    let height_m = known_m.unwrap_or(START_HEIGHT_M);
                    self.heights_m[b] = height_m.clamp(bounds.min_m, bounds.max_m);
                }
            }
        }
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
}
