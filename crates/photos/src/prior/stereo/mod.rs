//! Depth from the calibrated photos alone, no network: a plane sweep over horizontal planes, from coarse to fine.
//!
//! 1. Photos are reduced, turned grey, freed of lens distortion and of slow brightness changes ([`picture`]).
//! 2. The neighbours that see the same ground under a fair angle are chosen ([`super::neighbours`]); where photos do not
//!    fit together by their poses, neighbours are turned until they do ([`alignment`]).
//! 3. For every height level the neighbours are projected through that level into the view ([`sweep`]), and compared
//!    with it by zero-mean normalised cross-correlation in a window ([`correlate`]); the better half of the neighbours
//!    counts, so that being hidden in some is no harm. Windows lie *in* the horizontal plane: they fit roofs and ground exactly.
//! 4. Levels are chosen under a smoothness that costs nothing on level roofs and ground: semi-global matching along
//!    eight paths (Hirschmüller 2008, doi:10.1109/TPAMI.2007.1166; [`semi_global`]).
//! 5. Steps 3 and 4 are done at a quarter and at half the size first ([`levels`]): the first says between which heights there are
//!    surfaces at all, the second which heights are worth trying nearby. What holds together over less than a window is no
//!    surface ([`speckles`]).
//! 6. Where level planes explain the pictures badly, planes of any slope are handed from pixel to pixel: pitched roofs ([`slanted`]).
//! 7. Heights that no other views, matched on their own, have there too are left out; the others are fused with theirs
//!    ([`consistency`]).

mod alignment;
mod consistency;
mod correlate;
mod levels;
mod picture;
mod semi_global;
mod slanted;
mod speckles;
mod sweep;

pub(crate) use self::picture::load_picture;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Once};

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::alignment::Alignment;
use self::consistency::MatchedSurface;
use self::levels::Levels;
use self::picture::ideal_camera;
use self::slanted::Slopes;
use self::sweep::{Coarse, Sweep, Unseen};
use super::album::Album;
use super::neighbours::Neighbours;
use super::{CacheConfig, CacheKey, DepthPrior, KeyHasher, PriorError, PriorGeometry, PriorKind, PriorSource};
use sizeup_geo::kept::Kept;
use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::ViewId;
use sizeup_heights::picture::{Picture, PosedCamera};
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Changes whenever the same photos and settings would give another depth.
const ALGORITHM: &[u8] = b"stereo 6";
/// A picture whose shorter side has fewer pixels is not asked between which heights there are surfaces.
const LEAST_SIDE_PX: usize = 60;
/// Part of a window below which what holds together is no surface: pixels so close share most of what they were
/// compared by.
const SPECKLE_DIVISOR: usize = 4;
/// Surfaces of so many windows are sure enough to say between which heights there are any, and what is higher than all of them by
/// less than this share of their range is looked for too.
const SURE_WINDOWS: usize = 2;
const TALLER_SHARE: f64 = 0.5;
/// So many views whose neighbours had to be turned, and one of so many that were matched, are no chance.
const MANY_TURNED: usize = 3;
const MANY_TURNED_OF: usize = 4;
/// Memory for reduced photos: neighbours follow each other in a survey.
const PICTURE_BYTES: usize = 128 << 20;
/// Memory for surfaces that neighbours are held against.
const SURFACE_BYTES: usize = 128 << 20;

/// Side of the comparison window, pixels.
const WINDOW_PX: usize = 9;
/// How far below the lowest ground in a view the search starts, metres.
const BELOW_GROUND_M: f64 = 5.0;
/// Least correlation at which a pixel keeps its depth.
const MIN_SCORE: f64 = 0.4;
/// Cost of a height change by one level between neighbouring pixels, in 1/255 of a full mismatch.
const SMALL_STEP_COST: i16 = 8;
/// Cost of a larger height change, in 1/255 of a full mismatch; less across edges of the photo.
const LARGE_STEP_COST: i16 = 48;
/// Neighbours that have to have the same height, by their own matching, or half of those that have the place in their picture
/// where that is less, but two at least.
const MIN_AGREEING: usize = 3;
/// Most neighbours a view is compared with, 1 to 16.
pub(crate) const N_NEIGHBOURS: usize = 6;

/// How depth is computed from the photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("x-expert" = true))]
pub struct StereoConfig {
    /// Longer side of the depth map, pixels, 64 to 2048.
    #[schemars(extend("x-expert" = false))]
    pub long_side_px: u32,
    /// Highest roof above the highest ground in the view, metres. Above 0. A run sets it to the greatest of the heights that
    /// are looked for.
    #[serde(skip, default = "default_max_height_m")]
    pub max_height_m: f64,
    /// Most height levels, 8 to 255: more are finer and slower.
    #[serde(skip)]
    pub max_levels: usize,
    /// Where computed depth is kept, so that each view is matched once.
    #[schemars(extend("x-expert" = false))]
    pub cache: CacheConfig,
}

fn default_max_height_m() -> f64 {
    StereoConfig::default().max_height_m
}

impl Default for StereoConfig {
    fn default() -> Self {
        Self { long_side_px: 672, max_height_m: 80.0, max_levels: 128, cache: CacheConfig::default() }
    }
}

impl StereoConfig {
    fn check(&self) -> Result<(), PriorError> {
        let in_range = [
            ("long_side_px", (64..=2048).contains(&self.long_side_px), "64 to 2048"),
            ("max_height_m", self.max_height_m.is_finite() && self.max_height_m > 0.0, "above 0 m"),
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
    surfaces: Kept<ViewId, MatchedSurface>,
    misfits: Misfits,
}

/// Views that were matched, and those of them whose neighbours had to be turned. Of exact poses single views are, too, where
/// patches were mistaken for others.
#[derive(Debug)]
struct Misfits {
    n_views: AtomicUsize,
    n_turned: AtomicUsize,
    told: Once,
}

impl Misfits {
    /// Counts a view; whether it is one of many by now that had to be turned.
    fn are_many(&self, is_turned: bool) -> bool {
        let n_views = 1 + self.n_views.fetch_add(1, Ordering::Relaxed);
        let n_turned = usize::from(is_turned) + self.n_turned.fetch_add(usize::from(is_turned), Ordering::Relaxed);
        is_turned && n_turned >= MANY_TURNED && n_turned * MANY_TURNED_OF >= n_views
    }
}

/// Files that a view's depth is made from.
struct StereoPlan<'a> {
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
            surfaces: Kept::up_to((SURFACE_BYTES / Album::bytes_of_one(config.long_side_px).max(1)).max(1)),
            misfits: Misfits { n_views: AtomicUsize::new(0), n_turned: AtomicUsize::new(0), told: Once::new() },
            config,
            survey: Neighbours::new(views, terrain),
            terrain: terrain.clone(),
        })
    }

    fn plan(&self, view: &View) -> Result<StereoPlan<'_>, PriorError> {
        let refuse = |problem: &str, hint: &str| Err(refusal(view, problem, hint));
        let others = self.survey.choose(view, N_NEIGHBOURS);
        if others.is_empty() {
            return refuse("no other photo sees the same ground under a fair angle", "photos have to overlap");
        }
        let ideal = |view: &View| ideal_camera(view, self.config.long_side_px);
        let ideals: Vec<PosedCamera> = others.iter().map(|other| ideal(other)).collect();
        let levels = self.levels(&ideal(view), &ideals).ok_or_else(|| refuse_sky(view))?;
        Ok(StereoPlan { others, levels })
    }
}

fn refusal(view: &View, problem: &str, hint: &str) -> PriorError {
    PriorError::Photo { view: view.id.to_string(), problem: problem.to_owned(), hint: hint.to_owned() }
}

impl StereoPriors {
    /// A view's surface by its own matching, computed once for all that ask soon.
    fn surface(&self, view: &View) -> Result<Arc<MatchedSurface>, PriorError> {
        self.surfaces.get(&view.id, || self.match_view(view))
    }

    fn match_view(&self, view: &View) -> Result<MatchedSurface, PriorError> {
        let plan = self.plan(view)?;
        let reference = self.pictures.picture(view)?;
        let others = plan.others.iter().map(|other| self.pictures.picture(other)).collect::<Result<Vec<_>, _>>()?;
        let half = reference.half();
        let halves: Vec<Arc<Picture>> = others.iter().map(|other| Arc::new(other.half())).collect();
        let stated: Vec<PosedCamera> = halves.iter().map(|other| other.posed().clone()).collect();
        let levels = self.levels(half.posed(), &stated).ok_or_else(|| refuse_sky(view))?;
        let levels = self.with_surfaces(&levels, &half, &halves);
        let aligned = alignment::align(&half, &halves, &levels);
        let is_turned = aligned.is_better();
        if self.misfits.are_many(is_turned) {
            self.tell_misfit(view, &aligned);
        }
        let ideals = if is_turned { aligned.neighbours } else { stated };
        let sweep = Sweep {
            reference: &half,
            others: &halves,
            ideals: &ideals,
            levels: &levels,
            coarse: None,
            unseen: Unseen::IsNothing,
        };
        let coarse = Self::choose(&sweep);

        let ideals: Vec<PosedCamera> =
            others.iter().zip(&ideals).map(|(other, at)| other.posed().posed_as(at)).collect();
        let fine = plan.levels.around(&coarse, 0.0, reference.posed(), &ideals, &self.config);
        let coarse = Some(Coarse { heights_m: &coarse, levels: &levels });
        let sweep = Sweep {
            reference: &reference,
            others: &others,
            ideals: &ideals,
            levels: &fine,
            coarse,
            unseen: Unseen::IsNothing,
        };
        let heights_m = Self::choose(&sweep);
        let slopes = Slopes {
            reference: &reference,
            others: &others,
            ideals: &ideals,
            levels: &fine,
            radius_px: WINDOW_PX / 2,
            min_score: MIN_SCORE,
        };
        let heights_m = Self::without_speckles(slopes.find(&heights_m), &fine);
        Ok(MatchedSurface { ideal: reference.posed().clone(), heights_m, levels: fine, is_turned })
    }

    /// The levels between which pictures of half the size show surfaces. They do not have to be precise for that, and poses
    /// that are a little off do no harm.
    fn with_surfaces(&self, levels: &Levels, view: &Picture, others: &[Arc<Picture>]) -> Levels {
        let half = view.half();
        if half.grey().width().min(half.grey().height()) < LEAST_SIDE_PX {
            return *levels;
        }
        let halves: Vec<Arc<Picture>> = others.iter().map(|other| Arc::new(other.half())).collect();
        let ideals =
            |pictures: &[Arc<Picture>]| -> Vec<PosedCamera> { pictures.iter().map(|p| p.posed().clone()).collect() };
        let Some(all) = self.levels(half.posed(), &ideals(&halves)) else { return *levels };
        let ideals_there = ideals(&halves);
        let sweep = Sweep {
            reference: &half,
            others: &halves,
            ideals: &ideals_there,
            levels: &all,
            coarse: None,
            unseen: Unseen::IsAgainst,
        };
        let mut found_m = Self::choose(&sweep);
        speckles::leave_out(&mut found_m, &all, SURE_WINDOWS * WINDOW_PX * WINDOW_PX);
        levels.around(&found_m, TALLER_SHARE, view.posed(), &ideals(others), &self.config)
    }

    /// Once: the photos of a flight are in the same case.
    fn tell_misfit(&self, view: &View, aligned: &Alignment) {
        self.misfits.told.call_once(|| {
            let [before, after] = aligned.misfit_px.unwrap_or_default();
            // Measured at half the size.
            let px = f64::from(view.camera.width_px.max(view.camera.height_px)) / f64::from(self.config.long_side_px);
            let per_half_px = 2.0 * px.max(1.0);
            tracing::warn!(
                "the poses are poorer than the photos: neighbours of {} lie {:.1} pixels of the photo off, {:.1} after small \
                 turns. Depth is matched with the turned ones; heights stay as good as the poses. `sizeup survey align` mends them",
                view.id,
                before * per_half_px,
                after * per_half_px
            );
        });
    }

    fn levels(&self, view: &PosedCamera, others: &[PosedCamera]) -> Option<Levels> {
        Levels::of(view, others, &self.terrain, &self.config)
    }

    fn choose(sweep: &Sweep<'_>) -> Raster<f32> {
        let volume = sweep.volume(WINDOW_PX / 2);
        let chosen = semi_global::choose_levels(&volume, sweep.reference.grey());
        Self::without_speckles(chosen.heights_m(sweep.levels, MIN_SCORE), sweep.levels)
    }

    fn without_speckles(mut heights_m: Raster<f32>, levels: &Levels) -> Raster<f32> {
        let least_px = WINDOW_PX * WINDOW_PX / SPECKLE_DIVISOR;
        speckles::leave_out(&mut heights_m, levels, least_px);
        heights_m
    }
}

fn refuse_sky(view: &View) -> PriorError {
    refusal(view, "it does not look down at the ground", "stereo needs views below the horizon")
}

impl PriorSource for StereoPriors {
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError> {
        let own = self.surface(view)?;
        // One that cannot be matched has no say.
        let others: Vec<_> = self.plan(view)?.others.into_iter().filter_map(|other| self.surface(other).ok()).collect();
        let heights = consistency::agreed(&own, &others, MIN_AGREEING);
        let values = in_photo(&own.ideal, view, &heights);
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
        key.bytes(ALGORITHM);
        key.json(&StereoConfig { cache: CacheConfig::default(), ..self.config.clone() });
        let plan = self.plan(view)?;
        Self::feed_plan(view, &plan, key)?;
        // Its neighbours are matched on their own, with neighbours of theirs.
        for other in &plan.others {
            match self.plan(other) {
                Ok(plan) => Self::feed_plan(other, &plan, key)?,
                Err(_) => key.bytes(b"not matched"),
            }
        }
        Ok(())
    }
}

impl StereoPriors {
    fn feed_plan(view: &View, plan: &StereoPlan<'_>, key: &mut KeyHasher) -> Result<(), PriorError> {
        key.json(&plan.levels);
        for seen in std::iter::once(view).chain(plan.others.iter().copied()) {
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
fn in_photo(reference: &PosedCamera, view: &View, heights_m: &Raster<f32>) -> Raster<f32> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_views_that_were_turned_are_no_misfit_of_the_flight() {
        let misfits = Misfits { n_views: AtomicUsize::new(0), n_turned: AtomicUsize::new(0), told: Once::new() };
        let told: Vec<bool> = (0..30).map(|i| misfits.are_many(i % 10 == 0)).collect();
        assert_eq!(told, [false; 30], "one of ten");
        let told: Vec<bool> = (0..30).map(|i| misfits.are_many(i % 2 == 0)).collect();
        assert!(told.contains(&true) && !told[1], "then every other one: {told:?}");
    }
}
