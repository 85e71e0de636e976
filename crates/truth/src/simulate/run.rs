//! From configuration to files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;
use serde::Serialize;

use sizeup_geo::crs::Crs;
use sizeup_geo::files::{FileError, write_whole_unflushed};
use sizeup_geo::template::bare_stem;
use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::ViewId;
use sizeup_survey::{ColmapModel, View, ViewKind};

use super::building::by_roof_level;
use super::config::{FootprintsOf, MaskContour, SimulateConfig};
use super::mask_errors::masks_with_errors;
use super::photo::{self, Photographer};
use super::scene::TracedScene;
use super::texture::Palette;
use super::town::{self, SimulatedTown};
use super::trace::TrueDepth;
use super::{SimulateError, clutter, corrupt, disturb, files, flight, masks, mosaic, points, real, tie_points, trace};

/// Views rendered between two reports of progress: enough to keep every core busy.
const BATCH: usize = 16;
/// The COLMAP model is local to the map position rounded down to this, metres.
const OFFSET_STEP_M: f64 = 1000.0;
/// Tie points per view.
const TIE_POINTS_PER_VIEW: usize = 40;

/// Numbers of what a simulation wrote.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SimulationSummary {
    /// Buildings in the truth.
    pub n_buildings: usize,
    /// Number of views, nadir and oblique.
    pub n_views: usize,
    /// Views that look straight down.
    pub n_nadir: usize,
    /// Lowest and highest area-mean building height, metres.
    pub height_range_m: [f64; 2],
    /// Triangles that rays were traced against, ground not counted.
    pub n_triangles: usize,
    /// The run configuration: what `sizeup run` takes.
    pub run_config: PathBuf,
    /// The truth: what `sizeup evaluate` takes.
    pub truth: PathBuf,
}

/// Simulates a scene with the flight that the configuration describes.
///
/// `progress` is told `(views done, views in all)` from the calling thread.
///
/// # Errors
/// [`SimulateError`] for settings out of range and files that cannot be written.
pub fn simulate(
    config: &SimulateConfig,
    out_dir: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<SimulationSummary, SimulateError> {
    config.validate()?;
    if let Some(towns) = &config.mosaic {
        return mosaic::simulate(config, towns, out_dir, progress);
    }
    let world = world(config)?;
    let views = flight::plan(config, &world);
    write_scene(config, &world, &views, out_dir, progress)
}

/// Simulates what given cameras would see: `views` are in the scene's CRS, and their images are reduced to the
/// longer side of `config.camera`. Names keep their stems and become `.jpg`.
///
/// # Errors
/// As [`simulate`].
pub fn simulate_with_views(
    config: &SimulateConfig,
    views: &[View],
    out_dir: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<SimulationSummary, SimulateError> {
    config.validate()?;
    if config.mosaic.is_some() {
        let expected = "unset where views are given";
        return Err(SimulateError::Setting { setting: "mosaic", found: "set".to_owned(), expected });
    }
    let world = world(config)?;
    let longest_px = config.camera.width_px.max(config.camera.height_px);
    let reduce = |view: &View| View {
        id: ViewId(format!("{}.jpg", stem(view))),
        camera: Arc::new(view.camera.reduced_to(longest_px)),
        camera_from_map: view.camera_from_map,
        image: None,
    };
    let mut names = BTreeSet::new();
    if let Some(stem) = views.iter().map(stem).find(|stem| !names.insert(stem.clone())) {
        return Err(SimulateError::DuplicateView { stem });
    }
    let views: Vec<View> = views.iter().map(reduce).collect();
    write_scene(config, &world, &views, out_dir, progress)
}

/// The buildings and the ground of a configuration, without photos: what the truth is made from.
///
/// # Errors
/// As [`simulate`].
pub fn world(config: &SimulateConfig) -> Result<SimulatedTown, SimulateError> {
    match &config.cityjson {
        Some(source) => real::build(config, source),
        None => town::build(config),
    }
}

pub(super) fn stem(view: &View) -> String {
    bare_stem(&view.id.0).to_owned()
}

fn write_scene(
    config: &SimulateConfig,
    world: &SimulatedTown,
    views: &[View],
    out: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<SimulationSummary, SimulateError> {
    if views.is_empty() {
        return Err(SimulateError::NoViews);
    }
    let crs = Crs::parse(&world.crs)?;
    crs.require_projected_metres()?;
    let amounts = clutter::Amounts::of(config, world);
    let scene = TracedScene::new(world, &clutter::scatter(world, amounts, config.seed));
    let palette = Palette::new(world, scene.origin.0.truncate(), config);
    let studio = Photographer {
        scene: &scene,
        palette: &palette,
        config: &config.images,
        seed: config.seed,
        towards_sun: photo::towards_sun(&config.images),
    };

    progress(0, views.len());
    for first in (0..views.len()).step_by(BATCH) {
        let batch = first..(first + BATCH).min(views.len());
        let done = batch.end;
        batch.into_par_iter().try_for_each(|i| write_view(config, world, &studio, &views[i], i, out))?;
        progress(done, views.len());
    }

    let offset = map_offset(world);
    let given_views = disturb::poses(views, &config.errors, config.seed);
    let points = tie_points::collect(&scene, views, TIE_POINTS_PER_VIEW * views.len(), config.seed);
    let model = ColmapModel { views: &given_views, points: &points, offset };
    if let Some(issue) = model.write(&out.join("sparse"))?.into_iter().next() {
        let expected = "a lens that COLMAP can express";
        return Err(SimulateError::Setting { setting: "lens of the given views", found: issue.message, expected });
    }
    if config.points.per_view > 0 {
        let cloud = points::scatter(&scene, views, &config.points, config.seed);
        sizeup_geo::cloud::write_text(&out.join("points.xyz"), &cloud)?;
    }
    let drawn = match config.town.footprints {
        FootprintsOf::Buildings => world.buildings.clone(),
        FootprintsOf::RoofLevels => by_roof_level(&world.buildings, &world.terrain),
    };
    let footprints = disturb::footprints(&drawn, &config.errors, config.seed);
    files::write_footprints(&out.join("footprints.gpkg"), &crs, &drawn, &footprints)?;
    files::write_dtm(&out.join("dtm.tif"), &crs, &world.terrain)?;
    files::write_truth(&out.join("truth.geojson"), &crs, &drawn)?;
    files::write_georef(&out.join("georef.json"), &crs, offset)?;
    let has_dtm = matches!(world.terrain, Terrain::Grid(_));
    files::write_run_config(&out.join("sizeup.toml"), config, &crs, offset, has_dtm)?;
    Ok(summary(world, views, &scene, out))
}

/// Everything that belongs to one view: photo, prior, mask.
fn write_view(
    config: &SimulateConfig,
    world: &SimulatedTown,
    studio: &Photographer,
    view: &View,
    idx: usize,
    out: &Path,
) -> Result<(), SimulateError> {
    let stem = stem(view);
    if config.images.enabled {
        let photo = studio.take(view, idx);
        let path = out.join("images").join(&view.id.0);
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, config.images.jpeg_quality)
            .encode_image(&photo)
            .map_err(|source| SimulateError::Image { path: path.clone(), source })?;
        write_bytes(&path, &jpeg)?;
    }
    let truth = write_prior(config, studio.scene, view, idx, &out.join("priors").join(format!("{stem}.npy")))?;
    if config.prior.write_true_depth {
        files::write_npy(&out.join("depth").join(format!("{stem}.npy")), &truth.depth_m)?;
    }
    if config.masks.enabled && view.kind() == ViewKind::Nadir {
        let mask = match config.masks.contour {
            MaskContour::Roof => masks::roofs(view, &world.buildings),
            MaskContour::Ground => {
                let errors = config.masks.level.errors();
                masks_with_errors(view, idx, &world.buildings, &world.terrain, &errors, config.seed)
            }
        };
        let path = out.join("masks").join(format!("{stem}.png"));
        let bytes: Vec<u8> = mask.data().iter().flat_map(|id| id.to_ne_bytes()).collect();
        let mut png = Vec::new();
        image::codecs::png::PngEncoder::new(&mut png)
            .write_image(&bytes, mask.width() as u32, mask.height() as u32, ExtendedColorType::L16)
            .map_err(|source| SimulateError::Image { path: path.clone(), source })?;
        write_bytes(&path, &png)?;
    }
    Ok(())
}

/// Writes the prior of one view; gives the depth that it was made from.
pub(super) fn write_prior(
    config: &SimulateConfig,
    scene: &TracedScene,
    view: &View,
    idx: usize,
    path: &Path,
) -> Result<TrueDepth, SimulateError> {
    let truth = trace::true_depth(scene, view, &view.camera.reduced_to(config.prior.longest_px));
    let prior = corrupt::prior(&truth, &config.prior.level.corruption(), config.prior.kind, config.seed, idx);
    files::write_npy(path, &prior)?;
    Ok(truth)
}

fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_whole_unflushed(path, |w| w.write_all(bytes))
}

/// Map position that the COLMAP model's coordinates count from.
pub(super) fn map_offset(world: &SimulatedTown) -> DVec3 {
    let centre = world.extent.centre();
    let down = |v: f64| (v / OFFSET_STEP_M).floor() * OFFSET_STEP_M;
    DVec3::new(down(centre.x), down(centre.y), 0.0)
}

pub(super) fn summary(world: &SimulatedTown, views: &[View], scene: &TracedScene, out: &Path) -> SimulationSummary {
    let heights = || world.buildings.iter().map(|b| b.height_m);
    SimulationSummary {
        n_buildings: world.buildings.len(),
        n_views: views.len(),
        n_nadir: views.iter().filter(|v| v.kind() == ViewKind::Nadir).count(),
        height_range_m: [heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max)],
        n_triangles: scene.n_triangles(),
        run_config: out.join("sizeup.toml"),
        truth: out.join("truth.geojson"),
    }
}
