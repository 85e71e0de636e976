//! The heights stage: the run's footprints, priors and photos handed to the method.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;

use super::artefacts::Artefacts;
use super::footprints;
use super::priors::PriorStore;
use super::scene::SceneStage;
use super::scene::buildings_of;
use super::settings::HeightSettings;
use super::{Event, FootprintStage, HeightStage, PipelineError, Solver, Stage, Tell, photo_ground};
use sizeup_footprints::FootprintSource;
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::Terrain;
use sizeup_heights::estimate::{
    Heights, LocalFrame, MethodSettings, NamedCamera, Photos, Priors as TaskPriors, Task, estimate_with,
};
use sizeup_heights::optimise::{CalibrationRays, OptimiseConfig, Solution, ViewInput};
use sizeup_heights::picture::Picture;
use sizeup_heights::raster::Raster;
use sizeup_heights::scene::Scene;
use sizeup_photos::prior::{
    Album, DepthPrior, GroundCorrelation, PriorConfig, PriorKind, Priors, ground_correlation, judge_tag, judge_unit,
    surely_inverted,
};
use sizeup_survey::{Survey, View, mismatch};

/// Views whose priors are compared with the ground before any ray is traced.
const N_SAMPLED: usize = 5;
/// Memory for reduced photos, bytes.
const PICTURE_BYTES: usize = 512 << 20;

/// Input of the search for heights.
pub(super) struct HeightSearch<'a> {
    settings: &'a HeightSettings<'a>,
    survey: &'a Survey,
    tell: Tell<'a>,
    solver: Solver<'a>,
    method: MethodSettings,
}

impl<'a> HeightSearch<'a> {
    /// For a scene that stands alone.
    pub fn new(settings: &'a HeightSettings<'a>, survey: &'a Survey, tell: Tell<'a>, solver: Solver<'a>) -> Self {
        let refinement = settings.method.refinement.clone();
        let mut method = MethodSettings { optimise: settings.optimise(), refinement };
        // Footprints that were found in the photos are where the photos show them.
        let is_layer = matches!(settings.footprints, FootprintSource::Layer(_));
        method.optimise.search.measure_shift &= is_layer;
        method.optimise.search.measure_footprints &= method.optimise.search.measure_shift;
        Self { settings, survey, tell, solver, method }
    }

    /// For a part of a city, where the shift of the layer as a whole is not measured: neighbouring tiles would come apart.
    pub fn within_a_city(
        settings: &'a HeightSettings<'a>,
        survey: &'a Survey,
        tell: Tell<'a>,
        solver: Solver<'a>,
    ) -> Self {
        let mut search = Self::new(settings, survey, tell, solver);
        search.method.optimise.search.measure_shift = false;
        search
    }

    /// Finds the heights, and moves roofs with them where footprints were found in photos; returns the priors as well.
    pub fn run(
        &self,
        footprints: &mut FootprintStage,
        artefacts: &Artefacts<'_>,
    ) -> Result<(HeightStage, SceneStage, PriorStore), PipelineError> {
        let HeightSettings { scene, footprints: source, .. } = self.settings;
        require_matched_photos(self.settings, self.survey)?;
        let mut stage = SceneStage::on_measured_ground(scene, self.survey, footprints)?;
        let mut priors = self.open_priors(&stage)?;
        let mut provisional = self.method.clone();
        provisional.optimise.search.split_levels = false;
        provisional.optimise.search.measure_shift = false;
        provisional.refinement.enabled = Some(false);
        // Roofs move with their heights, and heights are measured under their roofs.
        for _ in 0..footprints::roof_rounds(source, footprints) {
            let heights = self.estimate(footprints, &stage, &priors, &provisional);
            require_priors(self.survey, &heights.solution)?;
            let has_moved = footprints::move_roofs(source, &scene.ground, self.survey, footprints, &heights)?;
            let terrain = stage.terrain.clone();
            stage = SceneStage::new(scene, self.survey, footprints)?;
            // Computed priors depend on the terrain.
            if stage.terrain != terrain {
                priors = self.open_priors(&stage)?;
            }
            if !has_moved {
                break;
            }
        }
        if footprints.tracks.is_some() {
            artefacts.write(Stage::Footprints, self.survey, &footprints)?;
        }
        let heights = self.in_parts(footprints, &mut stage, &priors);
        require_priors(self.survey, &heights.solution)?;
        Ok((heights, stage, priors))
    }

    /// Finds the heights of a scene, and splits its footprints into the parts found.
    pub fn in_parts(
        &self,
        footprints: &mut FootprintStage,
        stage: &mut SceneStage,
        priors: &PriorStore,
    ) -> HeightStage {
        let mut heights = self.estimate(footprints, stage, priors, &self.method);
        stage.split(footprints, &mut heights);
        heights
    }

    fn open_priors(&self, stage: &SceneStage) -> Result<PriorStore, PipelineError> {
        let store = PriorStore::open(self.settings, self.survey, stage)?;
        require_a_prior(self, &store, &stage.terrain)?;
        Ok(store)
    }

    fn estimate(
        &self,
        footprints: &FootprintStage,
        stage: &SceneStage,
        priors: &PriorStore,
        method: &MethodSettings,
    ) -> HeightStage {
        let run_priors =
            RunPriors { store: priors, survey: self.survey, terrain: &stage.terrain, found: Mutex::default() };
        let album = Album::new(method.refinement.long_side_px, PICTURE_BYTES);
        let frame = stage.frame();
        let task = Task {
            buildings: &buildings_of(footprints),
            terrain: &stage.terrain,
            frame: LocalFrame { origin: frame.origin, bounds: frame.bounds },
            views: &cameras(self.survey),
            priors: &run_priors,
            photos: Some(&RunPhotos { album, survey: self.survey }),
            seed: self.settings.seed,
            progress: &|what, done, total| (self.tell)(Event::Advance { what, done, total }),
        };
        let Heights { parts, solution, splits, joined, layer_shift, mut unread_photos } =
            estimate_with(&task, method, self.solver);
        unread_photos.extend(priors.unread_photos());
        unread_photos.sort_unstable();
        unread_photos.dedup_by_key(|(view, _)| *view);
        HeightStage {
            origin: frame.origin,
            solved: stage.solved.clone(),
            parts,
            splits,
            joined,
            solution,
            unread_photos,
            ground: footprints.photo_ground.clone(),
            layer_shift,
            doubt: run_priors.doubt(self.settings.prior),
        }
    }
}

/// The run's priors as the method takes them; how each follows the ground is measured on the way.
struct RunPriors<'a> {
    store: &'a PriorStore,
    survey: &'a Survey,
    terrain: &'a Terrain,
    /// By view, each once, however often its prior is loaded.
    found: Mutex<BTreeMap<usize, GroundCorrelation>>,
}

impl RunPriors<'_> {
    /// Doubt about the declared direction or unit of the priors.
    fn doubt(self, prior: &PriorConfig) -> Option<Issue> {
        let found = self.found.into_inner().unwrap_or_else(PoisonError::into_inner);
        let correlations: Vec<GroundCorrelation> = found.into_values().collect();
        judge_tag(&correlations).or_else(|| judge_unit(&correlations, prior.unit_of_files()?))
    }
}

impl TaskPriors for RunPriors<'_> {
    fn load(&self, view: usize) -> Result<DepthPrior, String> {
        let prior = self.store.load(view).map_err(|e| e.to_string())?;
        if let Some(correlation) = ground_correlation(&prior, &self.survey.views[view], self.terrain) {
            self.found.lock().unwrap_or_else(PoisonError::into_inner).insert(view, correlation);
        }
        Ok(prior)
    }

    fn absence(&self, view: usize) -> Option<String> {
        self.store.absence(view)
    }

    fn green(&self, view: usize) -> Option<Arc<Raster<bool>>> {
        self.store.green(view)
    }
}

/// The run's photos as the method takes them.
struct RunPhotos<'a> {
    album: Album,
    survey: &'a Survey,
}

impl Photos for RunPhotos<'_> {
    fn has(&self, view: usize) -> bool {
        self.survey.views[view].image.is_some()
    }

    fn picture(&self, view: usize) -> Result<Arc<Picture>, String> {
        self.album.picture(&self.survey.views[view]).map_err(|e| e.to_string())
    }
}

impl HeightSettings<'_> {
    /// Memory that photos take at most where there are so many, bytes: those of roofs, then those of the ground.
    #[must_use]
    pub fn photo_bytes(&self, n_photos: usize) -> usize {
        let of_one = Album::bytes_of_one(self.method.refinement.long_side_px);
        PICTURE_BYTES.min(n_photos.saturating_mul(of_one)).max(photo_ground::photo_bytes(n_photos))
    }

    /// Settings of the solver for the run's depth: depth in metres is not calibrated.
    pub(super) fn optimise(&self) -> OptimiseConfig {
        let mut optimise = self.method.optimise.clone();
        if self.scene.depth.is_in_metres {
            optimise.search.calibrate_on = CalibrationRays::None;
        }
        optimise
    }

    /// Every view of a survey at its working resolution.
    pub(super) fn view_inputs(&self, survey: &Survey, scene: &Scene) -> Vec<ViewInput> {
        sizeup_heights::estimate::view_inputs(&cameras(survey), &self.optimise(), scene, DVec3::ZERO)
    }
}

fn cameras(survey: &Survey) -> Vec<NamedCamera> {
    let named = |view: &View| NamedCamera { name: view.id.0.clone(), posed: view.posed() };
    survey.views.iter().map(named).collect()
}

/// Checks some priors before rays are traced for all of them: that one can be used (else the settings are wrong, not single photos),
/// and that they follow the ground. Computed priors only need photos here; their computation reports its own errors.
fn require_a_prior(
    &HeightSearch { settings, survey, tell, .. }: &HeightSearch<'_>,
    priors: &PriorStore,
    terrain: &Terrain,
) -> Result<(), PipelineError> {
    if !matches!(priors.source(), Priors::Files(_)) {
        return require_photos(survey);
    }
    let kind = survey.kind_for_heights();
    let mut measuring: Vec<usize> = (0..survey.views.len()).filter(|&view| survey.views[view].kind() == kind).collect();
    // Those of the sample first, spread evenly; the sort is stable.
    let step = measuring.len().div_ceil(N_SAMPLED).max(1);
    let sample: BTreeSet<usize> = measuring.iter().copied().step_by(step).collect();
    measuring.sort_by_key(|view| !sample.contains(view));
    let (mut first, mut n_usable, mut correlations) = (None, 0, Vec::new());
    for (i, &view) in measuring.iter().enumerate() {
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
        return Err(inverted(settings.prior, correlations.len(), median));
    }
    if judge_tag(&correlations).is_some() {
        tell(Event::PriorsDoubted { n_views: correlations.len() });
    }
    match first {
        Some((view, reason)) if n_usable == 0 => {
            Err(PipelineError::NoPriors { n: measuring.len(), view: survey.views[view].id.0.clone(), reason })
        }
        _ => Ok(()),
    }
}

/// Where a folder of photos is named, priors that are computed need one of a pose in it.
pub(super) fn require_matched_photos(settings: &HeightSettings<'_>, survey: &Survey) -> Result<(), PipelineError> {
    let has_photo = survey.views.iter().any(|view| view.image.is_some());
    match settings.images {
        Some(folder) if !has_photo && !matches!(settings.prior, PriorConfig::Files(_)) => {
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
