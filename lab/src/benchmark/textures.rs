//! Textures against photos that they were not made from.
//!
//! Every fifth photo is left out; the textured town is then rendered from there and compared with it, over the pixels that buildings fill in
//! the rendering. The plain method paints each surface with the photo of the greatest worth, whatever stands in front.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use image::{GenericImage as _, RgbImage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::accuracy::word;
use super::scene::{simulated, user_seconds};
use super::{BenchmarkError, SceneJob, SuitePlan, TellScenes};
use sizeup::config::RunConfig;
use sizeup::pipeline::{self, RunOptions, RunSettings, Stage, TextureScene, TextureSummary};
use sizeup_geo::files::{FileError, write_json, write_whole};
use sizeup_heights::render::PlacedCamera;
use sizeup_photos::textures::{Choice, SurfaceKind, SurfaceScene, TexturedTown, Textures, similarity};
use sizeup_results::output::picture::{photo_of, write_png};
use sizeup_survey::View;
use sizeup_truth::simulate::{SimulateConfig, TownKind};

/// One photo of so many is left out.
const LEFT_OUT_OF: usize = 5;

/// Which scenes are textured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TexturesConfig {
    /// Kinds of towns that are simulated.
    pub towns: Vec<TownKind>,
    /// Configurations of real flights, besides.
    pub real: Vec<PathBuf>,
    /// Buildings of a simulated town.
    pub n_buildings: usize,
    /// Photos of a simulated town.
    pub n_views: usize,
    /// Size of its photos: width and height, pixels.
    pub photo_px: [u32; 2],
    /// Root of the random choices.
    pub seed: u64,
    /// Side of a texel, metres; by default as the program chooses it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texel_m: Option<f64>,
}

impl Default for TexturesConfig {
    fn default() -> Self {
        Self {
            towns: vec![TownKind::Village, TownKind::District, TownKind::Downtown],
            real: Vec::new(),
            n_buildings: 41,
            n_views: 60,
            photo_px: [1280, 960],
            seed: 1,
            texel_m: None,
        }
    }
}

impl TexturesConfig {
    /// Seconds instead of minutes. On a village's low walls half-metre texels are too few to tell methods apart.
    #[must_use]
    pub fn small() -> Self {
        Self { towns: vec![TownKind::District], n_buildings: 6, n_views: 25, photo_px: [320, 240], ..Self::default() }
    }
}

/// Figures of one method on one scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TextureRow {
    /// Name of the scene.
    pub scene: String,
    /// `plain` or `agreeing`.
    pub method: String,
    /// Side of a texel, metres.
    pub texel_m: f64,
    /// Structural similarity over all pixels of buildings in the photos left out.
    pub ssim: f64,
    /// Peak signal-to-noise ratio over the same, decibels.
    pub psnr_db: f64,
    /// Photos left out that show buildings.
    pub n_photos: usize,
    /// Share of the roofs' area that a photo shows, of all photos.
    pub roofs_seen: Option<f64>,
    /// Share of the walls' area that a photo shows, of all photos.
    pub walls_seen: Option<f64>,
    /// Processor seconds in user mode per building, of all photos; `None` where the system does not tell.
    pub user_s: Option<f64>,
    /// Bytes of pictures per building, of all photos.
    pub bytes: f64,
}

/// Figures of all scenes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TextureTable {
    /// Two per scene.
    pub rows: Vec<TextureRow>,
}

impl TextureTable {
    /// The table in Markdown.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let mut text = String::from(
            "| scene | method | texel m | SSIM | PSNR dB | photos left out | roofs from photos | walls from photos | CPU s per building | kB per building |\n\
             |---|---|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        );
        for row in &self.rows {
            let share = |share: Option<f64>| share.map_or_else(|| "–".to_owned(), |v| format!("{:.1} %", 100.0 * v));
            let seconds = row.user_s.map_or_else(|| "–".to_owned(), |s| format!("{s:.3}"));
            let _ = writeln!(
                text,
                "| {} | `{}` | {:.2} | {:.3} | {:.2} | {} | {} | {} | {seconds} | {:.0} |",
                row.scene,
                row.method,
                row.texel_m,
                row.ssim,
                row.psnr_db,
                row.n_photos,
                share(row.roofs_seen),
                share(row.walls_seen),
                row.bytes / 1000.0
            );
        }
        text
    }
}

/// Measures all scenes, and writes `textures.md`, `textures.json` and a photo left out of each beside its rendering.
///
/// # Errors
/// [`BenchmarkError`].
pub fn run(config: &TexturesConfig, plan: &SuitePlan, tell: TellScenes<'_>) -> Result<TextureTable, BenchmarkError> {
    if config.towns.is_empty() && config.real.is_empty() {
        return Err(BenchmarkError::Empty { setting: "towns" });
    }
    let total = config.towns.len() + config.real.len();
    let mut rows = Vec::new();
    for (done, kind) in config.towns.iter().enumerate() {
        let name = word(kind);
        tell(done, total, &name);
        let folder = simulated(&job(config, *kind, &name), plan)?;
        rows.extend(measure(config, &name, &folder.join("sizeup.toml"), plan)?);
        if !plan.keep_scenes {
            fs::remove_dir_all(&folder).map_err(FileError::on("remove", &folder))?;
        }
    }
    for (i, file) in config.real.iter().enumerate() {
        let stem = file.file_stem().map_or_else(|| format!("real-{i}"), |stem| stem.to_string_lossy().into_owned());
        tell(config.towns.len() + i, total, &stem);
        rows.extend(measure(config, &stem, file, plan)?);
    }
    let table = TextureTable { rows };
    write_json(&plan.folder.join("textures.json"), &table)?;
    write_whole(&plan.folder.join("textures.md"), |out| out.write_all(table.to_markdown().as_bytes()))?;
    Ok(table)
}

/// A simulated town with photos, on which nothing but textures is measured.
fn job(config: &TexturesConfig, kind: TownKind, name: &str) -> SceneJob {
    let mut town = SimulateConfig { seed: config.seed, ..SimulateConfig::default() };
    (town.town.kind, town.town.n_buildings) = (kind, config.n_buildings);
    town.flight.n_views = Some(config.n_views);
    [town.camera.width_px, town.camera.height_px] = config.photo_px;
    town.images.enabled = true;
    town.prior.longest_px = config.photo_px[0] / 2;
    SceneJob::of_scene(name, town)
}

/// Both methods on the result of a configuration.
fn measure(
    config: &TexturesConfig,
    name: &str,
    file: &Path,
    plan: &SuitePlan,
) -> Result<Vec<TextureRow>, BenchmarkError> {
    let failed = |source| BenchmarkError::Run { scene: name.to_owned(), method: "robust", source };
    let mut run =
        RunConfig::load(file, &[]).map_err(|source| BenchmarkError::Config { scene: name.to_owned(), source })?;
    (run.output.pictures, run.output.report.page) = (false, false);
    run.project.output = plan.folder.join("results").join(name);
    let command = format!("sizeup-lab benchmark textures: {name}");
    let options = RunOptions { from: Stage::Survey, until: Stage::Output, command };
    let scene = match TextureScene::of_result(&RunSettings::of(&run)) {
        // Of an earlier benchmark by this program, from the same input.
        Ok(scene) => scene,
        Err(_) => {
            pipeline::run(&run, &options, &|_| {}).map_err(failed)?;
            TextureScene::of_result(&RunSettings::of(&run)).map_err(failed)?
        }
    };
    let with_photo = scene.survey.views.iter().filter(|view| view.image.is_some());
    let is_left_out = |i: usize| i % LEFT_OUT_OF == LEFT_OUT_OF - 1;
    let (left_out, used): (Vec<_>, Vec<_>) = with_photo.cloned().enumerate().partition(|(i, _)| is_left_out(*i));
    let plain = |views: Vec<(usize, View)>| views.into_iter().map(|(_, view)| view).collect::<Vec<View>>();
    let (left_out, used) = (plain(left_out), plain(used));
    [("plain", Choice::BestPerSurface), ("agreeing", Choice::Agreeing)]
        .into_iter()
        .map(|(method, choice)| {
            let before = user_seconds();
            let full = scene.bake(&scene.survey.views, config.texel_m, choice, &plan.folder)?;
            let user_s = user_seconds().zip(before).map(|(after, before)| after - before);
            let textures = scene.bake(&used, config.texel_m, choice, &plan.folder)?;
            let pictures = plan.folder.join("pictures").join(format!("{name}-{method}.png"));
            let near = compare(&scene, &textures, &left_out, &pictures, name)?;
            let summary = TextureSummary::of(&scene, &full);
            let n = summary.buildings.len().max(1) as f64;
            Ok(TextureRow {
                scene: name.to_owned(),
                method: method.to_owned(),
                texel_m: full.texel_m,
                ssim: near.ssim,
                psnr_db: near.psnr_db(),
                n_photos: near.n_photos,
                roofs_seen: summary.roofs.seen_share(),
                walls_seen: summary.walls.seen_share(),
                user_s: user_s.map(|s| s / n),
                bytes: summary.n_bytes as f64 / n,
            })
        })
        .collect()
}

/// Nearness over the pixels of several photos.
struct Nearness {
    ssim: f64,
    mean_square: f64,
    n_photos: usize,
}

impl Nearness {
    fn psnr_db(&self) -> f64 {
        similarity::Similarity { ssim: self.ssim, mean_square: self.mean_square, n_pixels: 1 }.psnr_db()
    }
}

/// Renders the town from the photos left out; the first that shows most of it is pictured beside its rendering.
fn compare(
    scene: &TextureScene,
    textures: &Textures,
    left_out: &[View],
    picture: &Path,
    name: &str,
) -> Result<Nearness, BenchmarkError> {
    let unusable = |reason: String| BenchmarkError::Picture { scene: name.to_owned(), reason };
    let traced = SurfaceScene::new(&scene.surfaces, scene.ground.clone(), scene.origin);
    let town = TexturedTown::new(&traced, textures).map_err(unusable)?;
    let (mut ssim, mut square, mut n_pixels, mut n_photos) = (0.0, 0.0, 0_usize, 0);
    let mut best: Option<(usize, RgbImage)> = None;
    for view in left_out {
        let photo = photo_of(view).map_err(|e| unusable(e.to_string()))?;
        let camera = view.camera.resized(photo.width(), photo.height());
        let placed = PlacedCamera::new(camera, view.camera_from_map, scene.origin);
        let rendered = town.render(&placed, Some(&photo));
        let is_outside = |i: &usize| scene.surfaces[*i].kind != SurfaceKind::Ground;
        let counts: Vec<bool> = rendered.surfaces.iter().map(|s| s.as_ref().is_some_and(is_outside)).collect();
        let Some(near) = similarity::similarity(&photo, &rendered.picture, &counts) else { continue };
        n_photos += 1;
        n_pixels += near.n_pixels;
        ssim += near.ssim * near.n_pixels as f64;
        square += near.mean_square * near.n_pixels as f64;
        if best.as_ref().is_none_or(|(n, _)| near.n_pixels > *n) {
            let mut both = RgbImage::new(2 * photo.width(), photo.height());
            let _ = both.copy_from(&photo, 0, 0);
            let _ = both.copy_from(&rendered.picture, photo.width(), 0);
            best = Some((near.n_pixels, both));
        }
    }
    let (_, both) = best.ok_or_else(|| unusable("no photo that was left out shows a building".to_owned()))?;
    write_png(picture, &both).map_err(|e| unusable(e.to_string()))?;
    let n = n_pixels as f64;
    Ok(Nearness { ssim: ssim / n, mean_square: square / n, n_photos })
}
