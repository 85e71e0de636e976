//! Commands that need the stages of a run, but not its results: depth priors ahead of a run, and one view at one pass.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec2;
use image::RgbImage;
use rand::Rng as _;
use serde::Serialize;

use super::heights::require_matched_photos;
use super::output::pictures;
use super::scene::SceneStage;
use super::settings::HeightSettings;
use super::{FootprintStage, PipelineError, RunOptions, RunSettings, Stage, Tell, stages};
use sizeup_heights::optimise::{Problem, Rays, first_selection, solve};
use sizeup_heights::ordinal::{DepthOrder, Normaliser};
use sizeup_heights::raster::Raster;
use sizeup_heights::render::PlacedCamera;
use sizeup_heights::render::image::{DepthImage, SceneTracer};
use sizeup_heights::seed;
use sizeup_photos::prior::{DepthPrior, PriorSource as _, Priors};
use sizeup_results::output::picture::{PicturedPair, beside, pairs_picture, photo_of, write_png};
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
    require_matched_photos(settings, &survey)?;
    let open = |stage: &SceneStage| settings.prior.open(&survey.views, &stage.terrain, stage.scene.bounds.max_m);
    let mut stage = SceneStage::new(&settings.scene, &survey, &footprints)?;
    let mut priors = open(&stage)?;
    // As a run computes them: over the terrain as the photos correct it. Where neither the priors nor the choice of views depend on it,
    // no photo is read for that.
    if wanted == Wanted::Selected || priors.depend_on_terrain() {
        stage = SceneStage::on_measured_ground(&settings.scene, &survey, &mut footprints)?;
        priors = open(&stage)?;
    }
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

/// Width of each of the four pictures, pixels.
const PICTURE_PX: u32 = 640;

/// Draws a view of a finished run, by its name or a part of it, after a pass (counted from 1; the last by default).
///
/// # Errors
/// [`PipelineError`]: no run in the output folder, no such view or pass, or a file that cannot be read or written.
pub fn look(settings: &RunSettings<'_>, view: &str, pass: Option<usize>, path: &Path) -> Result<(), PipelineError> {
    let RunSettings { artefacts, heights: settings, .. } = settings;
    let survey = artefacts.read_survey()?;
    let mut footprints: FootprintStage = artefacts.read(Stage::Footprints, &survey)?;
    let heights = artefacts.read_heights(&survey, &footprints)?;
    let wrong = |message: String, hint| PipelineError::Settings { table: "look", message, hint };
    let found =
        survey.views.iter().find(|v| v.id.0 == view).or_else(|| survey.views.iter().find(|v| v.id.0.contains(view)));
    let found = found.ok_or_else(|| {
        wrong(
            format!("no view of the survey is called {view:?}"),
            "views are named as their photos; `sizeup survey inspect` lists them",
        )
    })?;
    let passes = heights.solution.history.clone();
    let pass = pass.unwrap_or(passes.len());
    let heights_m =
        pass.checked_sub(1).and_then(|i| passes.get(i)).map(|pass| pass.heights_m.clone()).ok_or_else(|| {
            wrong(
                format!("pass {pass} of {}", passes.len()),
                "passes are counted from 1; the last is taken where none is named",
            )
        })?;
    let (heights, stage) = SceneStage::of_heights(&settings.scene, &survey, &mut footprints, heights)?;
    if heights_m.len() != stage.solved.len() {
        let message =
            format!("pass {pass} has {} heights, the scene {} buildings", heights_m.len(), stage.solved.len());
        return Err(wrong(message, "run again from the heights stage (--from heights)"));
    }
    let priors = settings.prior.open(&survey.views, &stage.terrain, stage.scene.bounds.max_m)?;
    let prior = priors.load(found)?.to_z_depth(&found.camera);
    let placed = PlacedCamera::new(found.camera.reduced_to(PICTURE_PX), found.camera_from_map, stage.scene.origin)
        .moved(heights.moved_m());
    let rendered = SceneTracer::new(&stage.scene, &heights_m).render(&placed);
    let pairs = ordinal_pairs(settings, &rendered, &prior, pass as u64);
    let panel = pictures::panel_of(
        found,
        &rendered.depth,
        &prior,
        &format!("{}, pass {pass} of {}", found.id.0, passes.len()),
    )?;
    let photo: RgbImage = photo_of(found)?;
    write_png(path, &beside(&panel, &pairs_picture(&photo, &pairs, PICTURE_PX)))?;
    Ok(())
}

/// Random pairs of building pixels, as the `paper` preset draws them; those without a vote are left out.
fn ordinal_pairs(
    settings: &HeightSettings<'_>,
    rendered: &DepthImage,
    prior: &DepthPrior,
    pass: u64,
) -> Vec<PicturedPair> {
    let ordinal = &settings.method.optimise.ordinal;
    let (width, height) = (rendered.depth.width(), rendered.depth.height());
    let farness: Raster<f32> = prior.to_farness();
    let at = |i: usize| {
        DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5) / DVec2::new(width as f64, height as f64)
    };
    let of_prior = |i: usize| {
        let p = at(i) * DVec2::new(farness.width() as f64, farness.height() as f64);
        farness.bilinear(p.x, p.y)
    };
    let is_building =
        |i: &usize| rendered.face.data()[*i].building().is_some() && rendered.depth.data()[*i].is_finite();
    let compared: Vec<(usize, f32)> =
        (0..width * height).filter(is_building).map(|i| (i, of_prior(i))).filter(|(_, d)| d.is_finite()).collect();
    let depths: Vec<f32> = compared.iter().map(|(i, _)| rendered.depth.data()[*i]).collect();
    let values: Vec<f32> = compared.iter().map(|(_, d)| *d).collect();
    let (Some(of_depth), Some(of_prior)) = (Normaliser::from_values(&depths), Normaliser::from_values(&values)) else {
        return Vec::new();
    };
    let mut rng = seed::stream(settings.seed, "pictured pairs", &[pass]);
    let end = |k: usize| at(compared[k].0).as_vec2().to_array();
    let pair = |_| {
        let (p, q) = (rng.random_range(0..compared.len()), rng.random_range(0..compared.len()));
        let order = DepthOrder::from_prior(of_prior.apply(values[p]), of_prior.apply(values[q]), ordinal.min_contrast)?;
        let cost = order.cost(of_depth.contrast(depths[p], depths[q]), ordinal.margin);
        Some(PicturedPair { ends: [end(p), end(q)], cost })
    };
    (0..ordinal.n_pairs).filter_map(pair).collect()
}
