//! One view at one pass of a run: photo, rendered depth, prior and the ordinal pairs, as the paper pictures them.

use std::path::Path;

use glam::DVec2;
use image::RgbImage;
use rand::Rng as _;

use super::scene::SceneStage;
use super::settings::HeightSettings;
use super::{FootprintStage, PipelineError, RunSettings, Stage, pictures};
use sizeup_heights::ordinal::{DepthOrder, Normaliser};
use sizeup_heights::raster::Raster;
use sizeup_heights::render::PlacedCamera;
use sizeup_heights::render::image::{DepthImage, SceneTracer};
use sizeup_heights::seed;
use sizeup_photos::prior::{DepthPrior, PriorSource as _};
use sizeup_results::output::picture::{PicturedPair, beside, pairs_picture, photo_of, write_png};

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
