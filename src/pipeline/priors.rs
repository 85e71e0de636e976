//! Priors ahead of a run: the cache is filled with what the run will ask for.
//!
//! A view that is in the cache is passed over, so an interrupted work goes on where it stopped, and several processes
//! that start at different views share it.

use std::sync::atomic::{AtomicUsize, Ordering};

use serde::Serialize;

use super::heights::require_matched_photos;
use super::scene::SceneStage;
use super::settings::HeightSettings;
use super::{FootprintStage, PipelineError, RunOptions, RunSettings, Stage, Tell, stages};
use sizeup_heights::optimise::solve;
use sizeup_heights::optimise::{Problem, Rays, first_selection};
use sizeup_photos::prior::Priors;
use sizeup_survey::{Survey, View};

/// Which views' priors are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// Those that a run selects first.
    Selected,
    /// All oblique ones: what any run, and any part of a city, can ask for.
    AllOblique,
}

/// Numbers of priors that were wanted, found, computed and kept.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct PriorsDone {
    /// Views whose priors are wanted.
    pub n_wanted: usize,
    /// Number of these that were there already.
    pub n_found: usize,
    /// Number of these computed now.
    pub n_computed: usize,
    /// Those that are in the cache afterwards: fewer than found and computed where its limit is too low.
    pub n_kept: usize,
    /// Views without a prior, and why.
    pub failed: Vec<(String, String)>,
}

/// Computes priors into the cache. `start` shifts the view that is begun with: processes that share the work pass
/// different numbers. The stages before the heights are run, and leave their results as in a run.
///
/// # Errors
/// [`PipelineError`]: as a run up to the footprints, and for priors that are files or have no cache.
pub fn compute_priors(
    settings: &RunSettings<'_>,
    wanted: Wanted,
    start: usize,
    tell: Tell<'_>,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<PriorsDone, PipelineError> {
    let options = RunOptions { from: Stage::Survey, until: Stage::Footprints, command: String::new() };
    stages::run(settings, &options, tell, &solve)?;
    let survey = settings.artefacts.read_survey()?;
    let mut footprints: FootprintStage = settings.artefacts.read(Stage::Footprints, &survey)?;
    let settings = &settings.heights;
    // As a run computes them: over the terrain as the photos correct it.
    let stage = SceneStage::on_measured_ground(&settings.scene, &survey, &mut footprints)?;
    require_matched_photos(settings, &survey)?;
    let priors = settings.prior.open(&survey.views, &stage.terrain, stage.scene.bounds.max_m)?;
    if !priors.has_cache() {
        return Err(PipelineError::Settings {
            table: "prior",
            message: "there is nothing to compute ahead of time: the priors are files, or have no cache".to_owned(),
            hint: "`source` is \"network\" or \"stereo\", and `cache.limit_gb` above 0",
        });
    }
    let mut views = match wanted {
        Wanted::Selected => selected(settings, &survey, &stage),
        Wanted::AllOblique => survey.views_for_heights().collect(),
    };
    let n = views.len();
    views.rotate_left(start % n.max(1));
    Ok(compute(&priors, &views, progress))
}

fn selected<'a>(settings: &HeightSettings<'_>, survey: &'a Survey, stage: &SceneStage) -> Vec<&'a View> {
    let views = settings.view_inputs(survey, &stage.scene);
    let problem = Problem {
        scene: &stage.scene,
        views: &views,
        expect_priors: &|_| Vec::new(),
        without_prior: &|_| None,
        load_prior: &|_| Err("no prior is asked for".to_owned()),
        green: &|_| None,
        former: None,
        seed: settings.seed,
        rays: &Rays::new(views.len(), settings.method.optimise.stride_px),
        progress: &|_, _, _| {},
    };
    first_selection(&problem, &settings.method.optimise).into_iter().map(|view| &survey.views[view]).collect()
}

fn compute(priors: &Priors, views: &[&View], progress: &(dyn Fn(usize, usize) + Sync)) -> PriorsDone {
    let n_done = AtomicUsize::new(0);
    let done = || progress(n_done.fetch_add(1, Ordering::Relaxed) + 1, views.len());
    let results = priors.compute_ahead(views, &done);
    let count = |wanted: bool| results.iter().filter(|result| **result == Ok(wanted)).count();
    let mut failed: Vec<(String, String)> = views
        .iter()
        .zip(&results)
        .filter_map(|(view, result)| Some((view.id.to_string(), result.as_ref().err()?.clone())))
        .collect();
    failed.sort_unstable();
    PriorsDone {
        n_wanted: views.len(),
        n_found: count(true),
        n_computed: count(false),
        n_kept: views.iter().filter(|view| priors.is_kept(view).unwrap_or(false)).count(),
        failed,
    }
}
