//! Depth from the calibrated photos alone, no network: a plane sweep over horizontal planes.
//!
//! 1. Photos are reduced, turned grey, freed of lens distortion and of slow brightness changes ([`picture`]).
//! 2. The neighbours that see the same ground under a fair angle are chosen ([`super::neighbours`]).
//! 3. For every height level the neighbours are projected through that level into the view ([`sweep`]), and compared
//!    with it by zero-mean normalised cross-correlation in a window ([`correlate`]); the better half of the neighbours
//!    counts, so that being hidden in some is no harm. Windows lie *in* the horizontal plane: they fit roofs and ground exactly.
//! 4. Levels are chosen under a smoothness that costs nothing on level roofs and ground: semi-global matching along
//!    eight paths (Hirschmüller 2008, doi:10.1109/TPAMI.2007.1166; [`semi_global`]).
//! 5. Pixels whose neighbours do not agree there are left without a value.

mod correlate;
mod picture;
mod semi_global;
mod sweep;

pub(crate) use self::picture::Picture;

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::picture::Ideal;
use self::sweep::Levels;
use super::album::Album;
use super::neighbours::Neighbours;
use super::{CacheConfig, CacheKey, DepthPrior, KeyHasher, PriorError, PriorGeometry, PriorKind, PriorSource};
use crate::raster::Raster;
use crate::survey::View;
use crate::terrain::Terrain;

/// Changes whenever the same photos and settings would give another depth.
const ALGORITHM: &[u8] = b"stereo 2";
/// Memory for reduced photos: neighbours follow each other in a survey.
const PICTURE_BYTES: usize = 128 << 20;

/// How depth is computed from the photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StereoConfig {
    /// Longer side of the depth map, pixels, 64 to 2048.
    pub long_side_px: u32,
    /// Most neighbours a view is compared with, 1 to 16.
    pub n_neighbours: usize,
    /// Side of the comparison window, pixels, odd, 3 to 15.
    pub window_px: usize,
    /// Highest roof above the highest ground in the view, metres. Above 0. A run sets it to the greatest of the heights that
    /// are looked for.
    #[serde(skip, default = "default_max_height_m")]
    pub max_height_m: f64,
    /// How far below the lowest ground in the view the search starts, metres. At least 0.
    pub below_ground_m: f64,
    /// Most height levels, 8 to 255: more are finer and slower.
    pub max_levels: usize,
    /// Least correlation at which a pixel keeps its depth, −1 to 1.
    pub min_score: f64,
    /// Cost of a height change by one level between neighbouring pixels, in 1/255 of a full mismatch.
    pub small_step_cost: u16,
    /// Cost of a larger height change, in 1/255 of a full mismatch; less across edges of the photo.
    pub large_step_cost: u16,
    /// Where computed depth is kept, so that each view is matched once.
    pub cache: CacheConfig,
}

fn default_max_height_m() -> f64 {
    StereoConfig::default().max_height_m
}

impl Default for StereoConfig {
    fn default() -> Self {
        Self {
            long_side_px: 448,
            n_neighbours: 4,
            window_px: 7,
            max_height_m: 80.0,
            below_ground_m: 5.0,
            max_levels: 128,
            min_score: 0.4,
            small_step_cost: 8,
            large_step_cost: 48,
            cache: CacheConfig::default(),
        }
    }
}

impl StereoConfig {
    fn check(&self) -> Result<(), PriorError> {
        let in_range = [
            ("long_side_px", (64..=2048).contains(&self.long_side_px), "64 to 2048"),
            ("n_neighbours", (1..=16).contains(&self.n_neighbours), "1 to 16"),
            ("window_px", (3..=15).contains(&self.window_px) && self.window_px % 2 == 1, "odd, 3 to 15"),
            ("max_height_m", self.max_height_m.is_finite() && self.max_height_m > 0.0, "above 0 m"),
            ("below_ground_m", self.below_ground_m.is_finite() && self.below_ground_m >= 0.0, "at least 0 m"),
            ("max_levels", (8..=255).contains(&self.max_levels), "8 to 255"),
            ("min_score", (-1.0..=1.0).contains(&self.min_score), "-1 to 1"),
            ("large_step_cost", self.large_step_cost >= self.small_step_cost, "at least small_step_cost"),
            ("large_step_cost", self.large_step_cost <= 1024, "at most 1024"),
        ];
        match in_range.iter().find(|(_, is_fine, _)| !is_fine) {
            None => Ok(()),
            Some((field, _, expected)) => Err(PriorError::Config {
                problem: format!("stereo: `{field}` is out of range"),
                hint: format!("expected {expected}"),
            }),
        }
    }
}

/// Depth from the photos of a survey.
#[derive(Debug)]
pub struct StereoPriors {
    config: StereoConfig,
    survey: Neighbours,
    terrain: Terrain,
    pictures: Album,
}

/// What a view's depth is made from.
struct Plan<'a> {
    others: Vec<&'a View>,
    levels: Levels,
}

impl StereoPriors {
    /// For a survey over a terrain. Views without a photo take no part.
    ///
    /// # Errors
    /// [`PriorError::Config`] for a setting out of range.
    pub fn new(config: StereoConfig, views: &[View], terrain: &Terrain) -> Result<Self, PriorError> {
        config.check()?;
        let views = views.iter().filter(|view| view.image.is_some()).cloned().collect();
        Ok(Self {
            pictures: Album::new(config.long_side_px, PICTURE_BYTES),
            config,
            survey: Neighbours::new(views, terrain),
            terrain: terrain.clone(),
        })
    }

    fn plan(&self, view: &View) -> Result<Plan<'_>, PriorError> {
        let refuse = |problem: &str, hint: &str| Err(refusal(view, problem, hint));
        let others = self.survey.choose(view, self.config.n_neighbours);
        if others.is_empty() {
            return refuse("no other photo sees the same ground under a fair angle", "photos have to overlap");
        }
        let ideal = |view: &View| Ideal::of(view, self.config.long_side_px);
        let ideals: Vec<Ideal> = others.iter().map(|other| ideal(other)).collect();
        match sweep::levels(&ideal(view), &ideals, &self.terrain, &self.config) {
            Some(levels) => Ok(Plan { others, levels }),
            None => refuse("it does not look down at the ground", "stereo needs views below the horizon"),
        }
    }
}

fn refusal(view: &View, problem: &str, hint: &str) -> PriorError {
    PriorError::Photo { view: view.id.to_string(), problem: problem.to_owned(), hint: hint.to_owned() }
}

impl PriorSource for StereoPriors {
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError> {
        let plan = self.plan(view)?;
        let reference = self.pictures.picture(view)?;
        let others = plan.others.iter().map(|other| self.pictures.picture(other)).collect::<Result<Vec<_>, _>>()?;
        let volume = sweep::volume(&reference, &others, &plan.levels, self.config.window_px / 2);
        let chosen = semi_global::choose_levels(&volume, reference.grey(), &self.config);
        drop(volume);
        let heights = chosen.heights_m(&plan.levels, self.config.min_score);
        let values = in_photo(reference.ideal(), view, &heights);
        if values.data().iter().all(|d| d.is_nan()) {
            let problem = "its neighbours agree with it nowhere";
            return Err(refusal(view, problem, "are poses and photos from the same flight?"));
        }
        Ok(DepthPrior { values, kind: PriorKind::Depth, geometry: PriorGeometry::ZDepth })
    }
}

impl CacheKey for StereoPriors {
    /// The terrain only decides where the search starts and ends, and which neighbours serve best: these are in the key.
    fn feed(&self, view: &View, key: &mut KeyHasher) -> Result<(), PriorError> {
        let plan = self.plan(view)?;
        key.bytes(ALGORITHM);
        key.json(&StereoConfig { cache: CacheConfig::default(), ..self.config.clone() });
        key.json(&plan.levels);
        for seen in std::iter::once(view).chain(plan.others) {
            key.json(&(&seen.camera, &seen.camera_from_map));
            if let Some(image) = &seen.image {
                key.file(image)?;
            }
        }
        Ok(())
    }
}

/// From heights in the distortion-free picture to z-depths on the photo's own pixel grid. The lens moves a pixel; it
/// does not change its depth.
fn in_photo(reference: &Ideal, view: &View, heights_m: &Raster<f32>) -> Raster<f32> {
    let (width, height) = (heights_m.width(), heights_m.height());
    let camera = view.camera.resized(width as u32, height as u32);
    let to_map = view.camera_from_map.rotation.transpose();
    let centre_z = view.camera_from_map.centre().z;
    let depth = |i: usize| {
        let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let Some(ray) = camera.unproject(pixel) else { return f32::NAN };
        let Some(ideal) = reference.camera.project(ray) else { return f32::NAN };
        let z = if reference.camera.contains(ideal) { nearest(heights_m, ideal) } else { f32::NAN };
        let depth = (f64::from(z) - centre_z) / (to_map * ray).z;
        if depth > 0.0 { depth as f32 } else { f32::NAN }
    };
    Raster::from_vec(width, height, (0..width * height).map(depth).collect()).expect("one value per pixel")
}

/// A mean of roof and ground would be neither.
fn nearest(raster: &Raster<f32>, at: DVec2) -> f32 {
    let cell = |v: f64, n: usize| (v.floor().max(0.0) as usize).min(n - 1);
    raster[(cell(at.x, raster.width()), cell(at.y, raster.height()))]
}
