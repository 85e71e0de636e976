//! The heights stage: one scene solved, and solved again where heights change the footprints.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use super::above::mark_towers;
use super::footprints;
use super::kept::PriorStore;
use super::neighbours::mark_small;
use super::refinement::refine;
use super::stages::SceneStage;
use super::{
    Event, FootprintStage, GroundTold, HeightStage, PipelineError, Solver, Stage, Tell, artefact, ground_told, levels,
};
use crate::config::RunConfig;
use sizeup_footprints::FootprintSource;
use sizeup_geo::terrain::Terrain;
use sizeup_heights::optimise::{
    CalibrationRays, OptimiseConfig, Problem, Rays, SearchConfig, Solution, Solving, ViewInput,
};
use sizeup_heights::render::PlacedCamera;
use sizeup_heights::scene::Scene;
use sizeup_photos::prior::{
    GroundCorrelation, PriorConfig, PriorKind, Priors, ground_correlation, judge_tag, judge_unit, surely_inverted,
};
use sizeup_survey::{Survey, View, ViewKind, mismatch};

/// Full sweeps that parts get among buildings whose heights are known from the round before.
const RESUMED_SWEEPS: usize = 2;

/// Views whose priors are held against the ground before any ray is traced.
const N_SAMPLED: usize = 5;

/// Input of the search for heights.
pub(super) struct HeightSearch<'a> {
    pub config: &'a RunConfig,
    pub survey: &'a Survey,
    pub tell: Tell<'a>,
    pub solver: Solver<'a>,
    /// Whether it is measured how far the footprint layer lies from what the photos show.
    measures_shift: bool,
    /// How far the photos were moved onto the footprints, map frame, metres.
    moved_m: Cell<DVec3>,
}

impl<'a> HeightSearch<'a> {
    /// For a scene that stands alone.
    pub fn new(config: &'a RunConfig, survey: &'a Survey, tell: Tell<'a>, solver: Solver<'a>) -> Self {
        // Footprints that were found in the photos lie where these show them.
        let measures_shift =
            config.optimise.search.measure_shift && matches!(config.footprints, FootprintSource::Layer(_));
        Self { config, survey, tell, solver, measures_shift, moved_m: Cell::new(DVec3::ZERO) }
    }

    /// For a part of a city, where nothing is measured of the layer as a whole.
    pub fn within_a_city(config: &'a RunConfig, survey: &'a Survey, tell: Tell<'a>, solver: Solver<'a>) -> Self {
        Self { measures_shift: false, ..Self::new(config, survey, tell, solver) }
    }

    /// Settings of the first look at whole footprints.
    fn first_look(&self) -> OptimiseConfig {
        measuring_shift(&self.config.optimise, self.measures_shift)
    }

    /// The survey that heights are measured from.
    fn moved_survey(&self) -> Cow<'a, Survey> {
        moved(self.survey, self.moved_m.get())
    }

    /// Solves for the heights, again and again where they change the footprints; with the priors they were found in.
    pub fn in_rounds(
        &self,
        footprints: &mut FootprintStage,
        stage: &mut SceneStage,
    ) -> Result<(HeightStage, PriorStore), PipelineError> {
        // What is computed depends on the terrain.
        let opened: RefCell<Option<(Terrain, PriorStore)>> = RefCell::new(None);
        let find = |stage: &SceneStage, rays: &Rays, optimise: &OptimiseConfig, known: &KnownHeights| {
            let mut opened = opened.borrow_mut();
            let kept = opened.take().filter(|(terrain, _)| *terrain == stage.terrain);
            let (_, priors) = match kept {
                Some(kept) => opened.insert(kept),
                None => {
                    require_matched_photos(self.config, self.survey)?;
                    let store = PriorStore::open(self.config, self.survey, stage)?;
                    require_a_prior(self, &store, &stage.terrain)?;
                    opened.insert((stage.terrain.clone(), store))
                }
            };
            let heights = self.of_scene(stage, priors, rays, optimise, known);
            require_priors(self.survey, &heights.solution)?;
            Ok(heights)
        };
        // Roofs move with their heights, and heights are measured under their roofs.
        for _ in 0..footprints::roof_rounds(self.config, footprints) {
            let heights =
                find(stage, &self.untraced(), &keeping_whole(&self.config.optimise), &KnownHeights::default())?;
            let has_moved = footprints::move_roofs(self.config, self.survey, footprints, &heights)?;
            *stage = SceneStage::new(self.config, self.survey, footprints)?;
            if !has_moved {
                break;
            }
        }
        if footprints.tracks.is_some() {
            artefact::write(self.config, Stage::Footprints, self.survey, &footprints)?;
        }
        let mut heights = self.taking_apart(footprints, stage, find)?;
        heights.ground = ground_told::look(self.config, &self.moved_survey(), footprints, stage, None);
        let (_, priors) = opened.into_inner().expect("taking apart solves at least once");
        Ok((heights, priors))
    }

    /// Solves with `find`, takes apart the footprints with two roof levels (no one height fits them), and solves again.
    pub fn taking_apart(
        &self,
        footprints: &mut FootprintStage,
        stage: &mut SceneStage,
        find: impl Fn(&SceneStage, &Rays, &OptimiseConfig, &KnownHeights) -> Result<HeightStage, PipelineError>,
    ) -> Result<HeightStage, PipelineError> {
        let whole = footprints.clone();
        let mut cuts = Vec::new();
        let mut rays = self.untraced();
        let mut heights = find(stage, &rays, &self.first_look(), &KnownHeights::default())?;
        let layer_shift = heights.solution.layer_shift;
        if let Some(shift) = layer_shift {
            self.moved_m.set(shift.on_ground());
            rays = self.untraced();
            heights = find(stage, &rays, &measuring_shift(&self.config.optimise, false), &KnownHeights::default())?;
        }
        while cuts.len() < levels::MAX_ROUNDS {
            let round = levels::cuts(footprints, stage, &heights.solution);
            let known = KnownHeights::of(&heights, footprints.layer.footprints.len());
            let Some(stood) = levels::split_footprints(footprints, &round) else { break };
            *stage = SceneStage::in_frame(self.config, &stage.frame(), footprints)?;
            rays = rays.of_other_footprints();
            cuts.push(round);
            if cuts.len() < levels::MAX_ROUNDS {
                heights = find(stage, &rays, &looking_at_parts(&self.config.optimise), &known.moved(&stood))?;
            }
        }
        if !cuts.is_empty() || !heights.solution.other_levels.is_empty() {
            // From scratch: what was found with other footprints hides what stands behind them.
            heights = find(stage, &rays, &keeping_whole(&self.config.optimise), &KnownHeights::default())?;
        }
        let mut joined = BTreeSet::new();
        loop {
            let n_before = joined.len();
            joined.extend(levels::not_borne_out(footprints, &heights, &cuts));
            if joined.len() == n_before {
                break;
            }
            footprints.clone_from(&whole);
            let mut kept = Vec::new();
            for round in &cuts {
                let round = levels::without(round, footprints, &joined);
                if levels::split_footprints(footprints, &round).is_some() {
                    kept.push(round);
                }
            }
            cuts = kept;
            *stage = SceneStage::in_frame(self.config, &stage.frame(), footprints)?;
            rays = rays.of_other_footprints();
            heights = find(stage, &rays, &keeping_whole(&self.config.optimise), &KnownHeights::default())?;
        }
        // Photos show roofs where they are.
        for (prism, solved) in stage.scene.prisms.iter_mut().zip(&heights.solution.heights) {
            if let Some(shift) = solved.footprint_shift {
                *prism = shift.moved(prism);
            }
        }
        heights.unread_photos.extend(refine(self.config, &self.moved_survey(), stage, &mut heights.solution));
        heights.unread_photos.sort_unstable();
        heights.unread_photos.dedup_by_key(|(view, _)| *view);
        mark_towers(&stage.scene, &mut heights.solution);
        mark_small(&stage.scene, &mut heights.solution);
        footprints.issues.extend(joined.iter().map(|id| levels::joined_note(id)));
        Ok(HeightStage { cuts, joined: joined.into_iter().collect(), layer_shift, ..heights })
    }

    /// Rays of the survey's views through a scene that nobody has looked at yet.
    fn untraced(&self) -> Rays {
        Rays::new(self.survey.views.len(), self.config.optimise.stride_px)
    }

    /// Heights of the buildings of a scene.
    pub fn of_scene(
        &self,
        stage: &SceneStage,
        priors: &PriorStore,
        rays: &Rays,
        optimise: &OptimiseConfig,
        known: &KnownHeights,
    ) -> HeightStage {
        let views = view_inputs(self.config, &self.moved_survey(), &stage.scene);
        // By view, and each once, however often its prior is loaded.
        let correlations: Mutex<BTreeMap<usize, GroundCorrelation>> = Mutex::default();
        let load_prior = |view: usize| {
            let prior = priors.load(view).map_err(|e| e.to_string())?;
            if let Some(correlation) = ground_correlation(&prior, &self.survey.views[view], &stage.terrain) {
                correlations.lock().unwrap_or_else(PoisonError::into_inner).insert(view, correlation);
            }
            Ok(prior)
        };
        let problem = Problem {
            scene: &stage.scene,
            views: &views,
            expect_priors: &|views| {
                let done = |done, total| (self.tell)(Event::Advance { what: Solving::Priors, done, total });
                priors.expect(views, &done)
            },
            without_prior: &|view| priors.absence(view),
            load_prior: &load_prior,
            seed: self.config.seed,
            rays,
            green: &|view| priors.green(view),
            start_m: &known.of_scene(stage),
            progress: &|what, done, total| (self.tell)(Event::Advance { what, done, total }),
        };
        let mut optimise = for_priors(&self.config.prior, optimise);
        // Footprints that were found in the photos lie where these show them.
        optimise.search.measure_footprints &= matches!(self.config.footprints, FootprintSource::Layer(_));
        let mut solution = (self.solver)(&problem, &optimise);
        // Whatever solved it: no height outside the range is stated.
        let bounds = stage.scene.bounds;
        solution.heights.iter_mut().for_each(|solved| solved.keep_within(bounds, optimise.height_reference));
        let correlations = correlations.into_inner().unwrap_or_else(PoisonError::into_inner);
        let correlations: Vec<GroundCorrelation> = correlations.into_values().collect();
        let unit = self.config.prior.unit_of_files();
        HeightStage {
            origin: stage.scene.origin,
            solved: stage.solved.clone(),
            cuts: Vec::new(),
            joined: Vec::new(),
            solution,
            unread_photos: priors.unread_photos(),
            ground: GroundTold::default(),
            layer_shift: None,
            doubt: judge_tag(&correlations).or_else(|| judge_unit(&correlations, unit?)),
        }
    }
}

/// Heights from a round before, above ground, metres, by position in the layer; empty before the first.
#[derive(Debug, Clone, Default)]
pub(super) struct KnownHeights(Vec<Option<f32>>);

impl KnownHeights {
    fn of(heights: &HeightStage, n_footprints: usize) -> Self {
        let mut known = vec![None; n_footprints];
        let last = heights.solution.history.last();
        for (&at, height_m) in heights.solved.iter().zip(last.iter().flat_map(|pass| &pass.heights_m)) {
            known[at] = Some(*height_m);
        }
        Self(known)
    }

    /// For a layer whose footprints stood elsewhere in the old one.
    fn moved(&self, stood: &[Option<usize>]) -> Self {
        Self(stood.iter().map(|before| self.0[(*before)?]).collect())
    }

    /// By building of a scene; empty before the first round.
    fn of_scene(&self, stage: &SceneStage) -> Vec<Option<f32>> {
        if self.0.is_empty() { Vec::new() } else { stage.solved.iter().map(|&at| self.0[at]).collect() }
    }
}

/// Depth in metres is not calibrated.
pub(super) fn for_priors(priors: &PriorConfig, optimise: &OptimiseConfig) -> OptimiseConfig {
    let mut optimise = optimise.clone();
    if priors.is_in_metres() {
        optimise.search.calibrate_on = CalibrationRays::None;
    }
    optimise
}

/// Settings to see whether a new part has yet another level.
fn looking_at_parts(optimise: &OptimiseConfig) -> OptimiseConfig {
    let search = SearchConfig {
        full_sweeps: RESUMED_SWEEPS.min(optimise.search.full_sweeps),
        local_sweeps: 0,
        correct_edge_bleeding: false,
        measure_shift: false,
        measure_footprints: false,
        roof_forms: Vec::new(),
        ..optimise.search.clone()
    };
    OptimiseConfig { search, ..optimise.clone() }
}

fn keeping_whole(optimise: &OptimiseConfig) -> OptimiseConfig {
    let search = SearchConfig { split_levels: false, measure_shift: false, ..optimise.search.clone() };
    OptimiseConfig { search, ..optimise.clone() }
}

fn measuring_shift(optimise: &OptimiseConfig, measure_shift: bool) -> OptimiseConfig {
    OptimiseConfig { search: SearchConfig { measure_shift, ..optimise.search.clone() }, ..optimise.clone() }
}

/// A survey whose photos all lie elsewhere, by as much in the map frame, metres.
pub(super) fn moved(survey: &Survey, by: DVec3) -> Cow<'_, Survey> {
    if by == DVec3::ZERO {
        return Cow::Borrowed(survey);
    }
    let mut survey = survey.clone();
    for view in &mut survey.views {
        view.camera_from_map = view.camera_from_map.moved(by);
    }
    Cow::Owned(survey)
}

/// Every view of a survey at its working resolution.
pub(super) fn view_inputs(config: &RunConfig, survey: &Survey, scene: &Scene) -> Vec<ViewInput> {
    let of = |view: &View| {
        let camera = view.camera.reduced_to(config.optimise.working_px);
        let placed = PlacedCamera::new(camera, view.camera_from_map, scene.origin);
        ViewInput::new(&view.id.0, placed, view.kind() == ViewKind::Oblique)
    };
    survey.views.iter().map(of).collect()
}

/// Looks at some priors of oblique views before rays are traced for all of them: whether one can be used (without a single one there
/// is nothing to solve, and the settings are wrong, not single photos), and whether they follow the ground. Computed priors are told
/// of as they are computed; what they need is photos.
fn require_a_prior(
    &HeightSearch { config, survey, tell, .. }: &HeightSearch<'_>,
    priors: &PriorStore,
    terrain: &Terrain,
) -> Result<(), PipelineError> {
    if !matches!(priors.source(), Priors::Files(_)) {
        return require_photos(survey);
    }
    let mut oblique: Vec<usize> =
        (0..survey.views.len()).filter(|&view| survey.views[view].kind() == ViewKind::Oblique).collect();
    // Those of the sample first, spread evenly; the sort is stable.
    let step = oblique.len().div_ceil(N_SAMPLED).max(1);
    let sample: BTreeSet<usize> = oblique.iter().copied().step_by(step).collect();
    oblique.sort_by_key(|view| !sample.contains(view));
    let (mut first, mut n_usable, mut correlations) = (None, 0, Vec::new());
    for (i, &view) in oblique.iter().enumerate() {
        if i >= sample.len() && n_usable > 0 {
            break;
        }
        match priors.load(view) {
            Ok(prior) => {
                n_usable += 1;
                correlations.extend(ground_correlation(&prior, &survey.views[view], terrain));
            }
            Err(error) => drop(first.get_or_insert((view, error.to_string()))),
        }
    }
    if let Some(median) = surely_inverted(&correlations) {
        return Err(inverted(&config.prior, correlations.len(), median));
    }
    if judge_tag(&correlations).is_some() {
        tell(Event::PriorsDoubted { n_views: correlations.len() });
    }
    match first {
        Some((view, reason)) if n_usable == 0 => {
            Err(PipelineError::NoPriors { n: oblique.len(), view: survey.views[view].id.0.clone(), reason })
        }
        _ => Ok(()),
    }
}

/// Where a folder of photos is named, priors that are computed need one of a pose in it.
pub(super) fn require_matched_photos(config: &RunConfig, survey: &Survey) -> Result<(), PipelineError> {
    let has_photo = survey.views.iter().any(|view| view.image.is_some());
    match &config.survey.images {
        Some(folder) if !has_photo && !matches!(config.prior, PriorConfig::Files(_)) => {
            let cut_short = survey.issues.iter().find(|issue| issue.code == "photo_cut_short");
            let why = cut_short.map_or_else(|| mismatch(&survey.views, folder), |issue| issue.message.clone());
            Err(PipelineError::Mismatch {
                message: format!("depth is to be computed from the photos, and {why}"),
                hint: "photos are found by the names in the poses: the file's name, and the folders above it where photos share \
                       one; letter case does not matter. Name the photos as the poses do, or set survey.images to the folder of \
                       the photos that the poses are of",
            })
        }
        _ => Ok(()),
    }
}

/// A tag that all of some views contradict.
fn inverted(prior: &PriorConfig, n_views: usize, median: f64) -> PipelineError {
    let kind = match prior {
        PriorConfig::Files(files) => files.kind,
        PriorConfig::Network(_) | PriorConfig::Stereo(_) | PriorConfig::Auto(_) => None,
    };
    let (is, other) = match kind {
        Some(PriorKind::InverseDepth) => ("inverse_depth", "depth"),
        Some(PriorKind::Depth) | None => ("depth", "inverse_depth"),
    };
    PipelineError::Unusable {
        message: format!(
            "[prior] the prior is inverted: in all {n_views} photos that were looked at it says near where the ground is far (rank \
             correlation {median:.2}, median; expected it clearly positive)"
        ),
        hint: format!("the files hold the other kind: set prior.kind = \"{other}\" (now \"{is}\")"),
    }
}

/// Priors that are computed are computed from photos.
fn require_photos(survey: &Survey) -> Result<(), PipelineError> {
    if survey.views.iter().any(|view| view.image.is_some()) {
        return Ok(());
    }
    Err(PipelineError::Settings {
        table: "prior",
        message: "depth is to be computed from the photos, and the survey names none".to_owned(),
        hint: "set survey.images to the folder of the photos, or bring depth maps with source = \"files\"",
    })
}

/// Without a single prior there is nothing to solve: the settings are wrong, not single photos.
fn require_priors(survey: &Survey, solution: &Solution) -> Result<(), PipelineError> {
    match solution.failed_views.first() {
        Some((view, reason)) if solution.used_views.is_empty() => Err(PipelineError::NoPriors {
            n: solution.failed_views.len(),
            view: survey.views[*view].id.0.clone(),
            reason: reason.clone(),
        }),
        _ => Ok(()),
    }
}
