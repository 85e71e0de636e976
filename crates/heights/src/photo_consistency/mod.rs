//! Heights from the photos alone: a surface is where the photos that see it look alike.
//!
//! ```text
//! p(X, z) = K·R·(X + z·up − C)          where a photo shows a point of the surface raised by z
//! ρ(z)    = zero-mean normalised cross-correlation of two photos over the surface's points
//! s(z)    = mean of the better 60 % of the pairs' ρ
//! ```
//!
//! The better pairs, because something may hide the surface in some photos. A pair of which a photo shows a part of the surface
//! is compared on what both show. Heights are tried in steps that move the photos against each other by about half a pixel.
//! Frame: the map, metres.

mod levels;
mod local;
mod refine;

pub use levels::{LevelPart, Levels, find_levels};
pub use local::{PhotoAgreement, agreement};
pub use refine::RefinementConfig;
pub use refine::{MIN_PHOTOS, MIN_PLACES, Refined, elsewhere_share, refine};

use glam::{DVec2, DVec3};

use crate::picture::{Picture, PosedCamera};
use crate::raster::Raster;
use crate::stats::parabola_peak;
use crate::views::in_turn;

/// Photos that look at the surface flatter than this (tangent of the angle off nadir) are not asked.
pub const FLATTEST: f64 = 1.5;
/// The same for roofs that too few photos show more steeply.
pub const FLATTEST_OF_FEW: f64 = 2.5;
/// Share of an image's sides within which the place has to lie.
const BORDER: f64 = 0.03;
/// Move of photos against each other from one height to the next, pixels.
const STEP_PX: f64 = 0.5;
/// Most heights tried in one search; the step grows beyond.
const MAX_LEVELS: usize = 1000;
/// Fewer pairs that show a surface cannot be outvoted.
const MIN_PAIRS: usize = 2;
/// Share of the pairs that counts.
const BETTER_SHARE: f64 = 0.6;
/// Share of the surface's points that both photos of a pair have to show: large roofs reach beyond many a photo.
const LEAST_SHARED: f64 = 0.3;
/// Variance below which a photo shows nothing to compare, grey levels².
const LEAST_VARIANCE: f32 = 1.0;
/// Heights closer than this to the best one are the same answer: in metres, and in pixels that the photos part.
const SAME_M: f64 = 1.0;
const SAME_PX: f64 = 3.0;
/// Pairs that part by less than this share of the most that any pair does look alike at all heights, and have no say.
const LEAST_SHIFT_SHARE: f64 = 0.4;

/// The photos to ask about a place: from all sides, steep ones first, none flatter than `flattest` (tangent of the angle off nadir);
/// `sees` may refuse more.
pub fn choose(
    cameras: &[PosedCamera],
    place: DVec3,
    n_views: usize,
    flattest: f64,
    sees: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let seeing = cameras.iter().enumerate().filter_map(|(i, view)| {
        let from = view.camera_from_map.centre() - place;
        let slope = from.truncate().length() / from.z;
        if !(0.0..flattest).contains(&slope) {
            return None;
        }
        let pixel = view.pixel_of(place)?;
        let size = DVec2::new(f64::from(view.camera.width_px), f64::from(view.camera.height_px));
        let share = pixel / size;
        let is_inside = share.min_element() > BORDER && share.max_element() < 1.0 - BORDER;
        (is_inside && sees(i)).then_some((i, from.truncate(), (slope * 1e6) as u64))
    });
    in_turn(seeing, n_views)
}

/// Metres on a surface to a pixel, across the line of sight, mean of the pictures.
#[must_use]
pub fn ground_sample_m(pictures: &[&Picture], place: DVec3) -> f64 {
    let of_one = |p: &&Picture| (p.camera_from_map().centre() - place).length() / p.camera().fx_px;
    pictures.iter().map(of_one).sum::<f64>() / pictures.len() as f64
}

/// Likeness of the photos on a surface that is raised and lowered.
pub struct PhotoConsistency {
    /// Height of the first try against the surface as given, and from one to the next, metres.
    low_m: f64,
    step_m: f64,
    pairs: Vec<[usize; 2]>,
    /// By height and pair; `NaN` where the photos of a pair do not show enough of the surface.
    of_pairs: Vec<Vec<f64>>,
}

/// Height at which the photos look alike most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Against the surface as given, metres.
    pub raised_m: f64,
    /// Mean correlation of the better pairs, −1..1.
    pub score: f64,
    /// By how much that is more than at any other height.
    pub lead: f64,
}

impl PhotoConsistency {
    /// Compares pictures over the points of a surface, up to so many metres above and below it; `gsd_m` metres to a pixel.
    #[must_use]
    pub fn new(pictures: &[&Picture], surface: &[DVec3], within_m: f64, gsd_m: f64) -> Self {
        let middle = surface.iter().sum::<DVec3>() / surface.len() as f64;
        let (pairs, shift) = telling_pairs(pictures, middle);
        let step_m = (STEP_PX * gsd_m / shift).max(2.0 * within_m / MAX_LEVELS as f64);
        let n_levels = (2.0 * within_m / step_m).ceil() as usize + 1;
        let shown: Vec<ProjectedSurface<'_>> =
            pictures.iter().map(|picture| ProjectedSurface::new(picture, surface)).collect();
        let of_pairs = (0..n_levels).map(|i| {
            let raised_m = step_m * i as f64 - within_m;
            let seen: Vec<Seen> = shown.iter().map(|shown| Seen::new(shown.greys(raised_m).collect())).collect();
            pairs.iter().map(|&[a, b]| likeness(&seen[a], &seen[b])).collect()
        });
        let of_pairs = of_pairs.collect();
        Self { low_m: -within_m, step_m, pairs, of_pairs }
    }

    /// The best height; `None` at an end of the range, or where too few photos show the surface.
    #[must_use]
    pub fn peak(&self) -> Option<Peak> {
        self.peak_without(None)
    }

    /// Likeness of the photos on the surface raised by so much, metres; of the heights tried the nearest.
    #[must_use]
    pub fn score_at(&self, raised_m: f64) -> f64 {
        let at = ((raised_m - self.low_m) / self.step_m).round().clamp(0.0, (self.of_pairs.len() - 1) as f64) as usize;
        better_pairs(&self.of_pairs[at], &vec![true; self.pairs.len()])
    }

    /// The best height for each photo left out; `None` where there is none for some.
    #[must_use]
    pub fn peaks_without_one(&self) -> Option<Vec<f64>> {
        let n_pictures = self.pairs.iter().flatten().max().map_or(0, |last| last + 1);
        (0..n_pictures).map(|left_out| Some(self.peak_without(Some(left_out))?.raised_m)).collect()
    }

    fn peak_without(&self, picture: Option<usize>) -> Option<Peak> {
        let counts: Vec<bool> = self.pairs.iter().map(|pair| picture.is_none_or(|p| !pair.contains(&p))).collect();
        let scores: Vec<f64> = self.of_pairs.iter().map(|of_pairs| better_pairs(of_pairs, &counts)).collect();
        let best = (0..scores.len()).fold(0, |best, i| if scores[i] > scores[best] { i } else { best });
        if best < 1 || best + 1 >= scores.len() {
            return None;
        }
        let same = (SAME_M / self.step_m).max(SAME_PX / STEP_PX).ceil() as usize;
        let others = scores.iter().enumerate().filter(|(i, _)| i.abs_diff(best) > same).map(|(_, s)| *s);
        let runner_up = others.fold(f64::NEG_INFINITY, f64::max);
        let around = [scores[best - 1], scores[best], scores[best + 1]];
        let raised_m = parabola_peak(self.low_m + self.step_m * best as f64, self.step_m, around);
        Some(Peak { raised_m, score: scores[best], lead: scores[best] - runner_up })
    }
}

/// The pairs of photos that part as heights change, and by how much the images of a point part for each metre of its
/// height, metres on the ground; the most of all pairs.
fn telling_pairs(pictures: &[&Picture], place: DVec3) -> (Vec<[usize; 2]>, f64) {
    let from = |p: &&Picture| p.camera_from_map().centre() - place;
    let slopes: Vec<DVec2> = pictures.iter().map(from).map(|from| from.truncate() / from.z).collect();
    let shift = |[i, j]: [usize; 2]| (slopes[i] - slopes[j]).length();
    let all: Vec<[usize; 2]> = (0..slopes.len()).flat_map(|i| (0..i).map(move |j| [i, j])).collect();
    let greatest = all.iter().map(|&pair| shift(pair)).fold(1e-3, f64::max);
    (all.into_iter().filter(|&pair| shift(pair) >= LEAST_SHIFT_SHARE * greatest).collect(), greatest)
}

/// Mean of the better pairs among those that count, −1 if too few show the surface.
fn better_pairs(of_pairs: &[f64], counts: &[bool]) -> f64 {
    let mut scores: Vec<f64> =
        of_pairs.iter().zip(counts).filter(|(s, counts)| **counts && !s.is_nan()).map(|(s, _)| *s).collect();
    if scores.len() < MIN_PAIRS {
        return -1.0;
    }
    scores.sort_unstable_by(|a, b| b.total_cmp(a));
    let n = (BETTER_SHARE * scores.len() as f64).ceil() as usize;
    scores[..n].iter().sum::<f64>() / n as f64
}

/// A surface as a picture shows it.
enum Seen {
    /// Grey levels with mean 0 and norm 1; none where there is no texture.
    Whole(Vec<f32>),
    /// Grey levels, `NaN` outside the picture.
    InPart(Vec<f32>),
}

impl Seen {
    fn new(mut greys: Vec<f32>) -> Self {
        if greys.iter().any(|grey| grey.is_nan()) {
            return Self::InPart(greys);
        }
        normalise(&mut greys);
        Self::Whole(greys)
    }

    fn greys(&self) -> &[f32] {
        match self {
            Self::Whole(greys) | Self::InPart(greys) => greys,
        }
    }
}

/// Correlation of two pictures of a surface over what both show of it; `NaN` where that is too little.
fn likeness(a: &Seen, b: &Seen) -> f64 {
    if let (Seen::Whole(a), Seen::Whole(b)) = (a, b) {
        return correlation(a, b);
    }
    let in_both = a.greys().iter().zip(b.greys()).filter(|(a, b)| !a.is_nan() && !b.is_nan());
    let (mut of_a, mut of_b): (Vec<f32>, Vec<f32>) = in_both.unzip();
    let n_points = a.greys().len().max(b.greys().len());
    if (of_a.len() as f64) < LEAST_SHARED * n_points as f64 {
        return f64::NAN;
    }
    normalise(&mut of_a);
    normalise(&mut of_b);
    correlation(&of_a, &of_b)
}

/// Correlation of values with mean 0 and norm 1; `NaN` where one of them is not shown.
fn correlation(a: &[f32], b: &[f32]) -> f64 {
    if a.is_empty() || b.is_empty() {
        return f64::NAN;
    }
    f64::from(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>())
}

/// A surface in a picture. Homogeneous image positions are linear in the map's: raising a point adds a multiple of one
/// vector.
struct ProjectedSurface<'a> {
    grey: &'a Raster<f32>,
    at_zero: Vec<DVec3>,
    per_metre: DVec3,
}

impl<'a> ProjectedSurface<'a> {
    fn new(picture: &'a Picture, surface: &[DVec3]) -> Self {
        let (pose, camera) = (picture.camera_from_map(), picture.camera());
        let to_image = |v: DVec3| {
            DVec3::new(camera.fx_px * v.x + camera.cx_px * v.z, camera.fy_px * v.y + camera.cy_px * v.z, v.z)
        };
        let (rotation, centre) = (pose.rotation, pose.centre());
        Self {
            grey: picture.grey(),
            at_zero: surface.iter().map(|point| to_image(rotation * (*point - centre))).collect(),
            per_metre: to_image(rotation * DVec3::Z),
        }
    }

    /// The grey levels of the surface's points raised by so much; `NaN` outside the picture.
    fn greys(&self, raised_m: f64) -> impl Iterator<Item = f32> {
        let raised = raised_m * self.per_metre;
        self.at_zero.iter().map(move |at_zero| {
            let p = *at_zero + raised;
            bilinear(self.grey, p.x / p.z, p.y / p.z)
        })
    }
}

/// Makes the mean of grey levels 0 and their norm 1; clears them where one lies outside its picture, or where there is no texture.
fn normalise(values: &mut Vec<f32>) {
    let n = values.len() as f32;
    let mean = values.iter().sum::<f32>() / n;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / n;
    if variance.is_nan() || variance <= LEAST_VARIANCE {
        values.clear(); // also for `NaN`, where the surface leaves the photo
        return;
    }
    let scale = (n * variance).sqrt().recip();
    for value in values.iter_mut() {
        *value = (*value - mean) * scale;
    }
}

fn bilinear(grey: &Raster<f32>, x: f64, y: f64) -> f32 {
    if x < 0.0 || y < 0.0 || x > grey.width() as f64 || y > grey.height() as f64 {
        f32::NAN
    } else {
        grey.bilinear(x, y)
    }
}
