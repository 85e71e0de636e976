//! The height of one level square: where the photos that see it look alike.
//!
//! ```text
//! p(u, v, z) = K·R·((x + u, y + v, z) − C)          where a photo shows the square at height z
//! s(z)       = mean of the better 60 % of the photo pairs' zero-mean normalised cross-correlations
//! ```
//!
//! The better pairs, because something may hide the square in some photos. Heights are tried in steps that move the
//! photos against each other by about half a pixel.

use glam::{DVec2, DVec3};

use super::{DtmConfig, Outcome};
use crate::prior::Picture;
use crate::raster::Raster;
use crate::stats::parabola_peak;
use crate::survey::View;
use crate::views::in_turn;

/// Photos that look at the ground flatter than this (tangent of the angle off nadir) are not asked.
const FLATTEST: f64 = 1.5;
/// Share of an image's sides within which the square has to lie.
const BORDER: f64 = 0.03;
/// How far photos move against each other from one height to the next, pixels.
const STEP_PX: f64 = 0.5;
/// Most heights tried.
const MAX_LEVELS: usize = 1000;
/// Samples along a side of the square.
const SAMPLES: std::ops::RangeInclusive<f64> = 8.0..=20.0;
/// Fewer pairs that show a square cannot be outvoted.
const MIN_PAIRS: usize = 2;
/// Share of the pairs that counts.
const BETTER_SHARE: f64 = 0.6;
/// Variance below which a photo shows nothing to compare, grey levels².
const LEAST_VARIANCE: f32 = 1.0;
/// Heights closer than this to the best one are the same answer: in metres, and in pixels that the photos part.
const SAME_M: f64 = 1.0;
const SAME_PX: f64 = 3.0;
/// Pairs that part by less than this share of the most that any pair does look alike at all heights, and have no say.
const LEAST_SHIFT_SHARE: f64 = 0.4;

/// The photos to ask about a place: from all sides, steep ones first.
pub(super) fn choose(views: &[&View], place: DVec3, config: &DtmConfig) -> Vec<usize> {
    let seeing = views.iter().enumerate().filter_map(|(i, view)| {
        let from = view.camera_from_map.centre() - place;
        let slope = from.truncate().length() / from.z;
        if !(0.0..FLATTEST).contains(&slope) {
            return None;
        }
        let pixel = view.camera.project(view.camera_from_map.point(place))?;
        let size = DVec2::new(f64::from(view.camera.width_px), f64::from(view.camera.height_px));
        let share = pixel / size;
        let is_inside = share.min_element() > BORDER && share.max_element() < 1.0 - BORDER;
        is_inside.then_some((i, from.truncate(), (slope * 1e6) as u64))
    });
    in_turn(seeing, config.n_views)
}

/// The square's height around a rough one.
pub(super) fn height(pictures: &[&Picture], near: DVec3, config: &DtmConfig) -> Outcome {
    if pictures.len() < 3 {
        return Outcome::Unseen;
    }
    let gsd_m = pictures.iter().map(|p| ground_sample_m(p, near)).sum::<f64>() / pictures.len() as f64;
    let (pairs, shift) = telling_pairs(pictures, near);
    let step_m = (STEP_PX * gsd_m / shift).max(2.0 * config.within_m / MAX_LEVELS as f64);
    let n_levels = (2.0 * config.within_m / step_m).ceil() as usize + 1;
    let level_m = |i: usize| near.z - config.within_m + step_m * i as f64;
    let n_side = (config.patch_m / gsd_m).clamp(*SAMPLES.start(), *SAMPLES.end()) as usize;
    let mut scratch = vec![Vec::new(); pictures.len()];
    let mut score = |level_m: f64| {
        for (picture, values) in pictures.iter().zip(&mut scratch) {
            sample(picture, near.truncate().extend(level_m), n_side, config.patch_m, values);
        }
        score(&scratch, &pairs)
    };
    let scores: Vec<f64> = (0..n_levels).map(|i| score(level_m(i))).collect();
    let best = (0..n_levels).fold(0, |best, i| if scores[i] > scores[best] { i } else { best });
    let same = (SAME_M / step_m).max(SAME_PX / STEP_PX).ceil() as usize;
    let others = scores.iter().enumerate().filter(|(i, _)| i.abs_diff(best) > same).map(|(_, s)| *s);
    let runner_up = others.fold(f64::NEG_INFINITY, f64::max);
    let is_clear = scores[best] > config.min_score && scores[best] - runner_up > config.min_margin;
    if !is_clear || best < 1 || best + 1 >= n_levels {
        return Outcome::Unclear;
    }
    let around = [scores[best - 1], scores[best], scores[best + 1]];
    Outcome::Ground(parabola_peak(level_m(best), step_m, around))
}

/// Metres of ground to a pixel, across the line of sight.
fn ground_sample_m(picture: &Picture, place: DVec3) -> f64 {
    (picture.camera_from_map().centre() - place).length() / picture.camera().fx_px
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

/// How much the photos look alike on the square at one height, −1..1; less if too few show it.
fn score(seen: &[Vec<f32>], pairs: &[[usize; 2]]) -> f64 {
    let dot = |a: &[f32], b: &[f32]| f64::from(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>());
    let both_show = |[i, j]: &&[usize; 2]| !(seen[*i].is_empty() || seen[*j].is_empty());
    let mut scores: Vec<f64> = pairs.iter().filter(both_show).map(|&[i, j]| dot(&seen[i], &seen[j])).collect();
    if scores.len() < MIN_PAIRS {
        return -1.0;
    }
    scores.sort_unstable_by(|a, b| b.total_cmp(a));
    let n = (BETTER_SHARE * scores.len() as f64).ceil() as usize;
    scores[..n].iter().sum::<f64>() / n as f64
}

/// The square as a photo shows it, with mean 0 and norm 1; nothing if it lies outside or has no texture.
fn sample(picture: &Picture, middle: DVec3, n_side: usize, patch_m: f64, values: &mut Vec<f32>) {
    let (pose, camera, grey) = (picture.camera_from_map(), picture.camera(), picture.grey());
    // Homogeneous image positions are linear in the map's.
    let to_image =
        |v: DVec3| DVec3::new(camera.fx_px * v.x + camera.cx_px * v.z, camera.fy_px * v.y + camera.cy_px * v.z, v.z);
    let origin = to_image(pose.rotation * (middle - pose.centre()));
    let (east, north) = (to_image(pose.rotation * DVec3::X), to_image(pose.rotation * DVec3::Y));
    let offset = |i: usize| patch_m * ((i as f64 + 0.5) / n_side as f64 - 0.5);
    values.clear();
    for row in 0..n_side {
        for col in 0..n_side {
            let p = origin + offset(col) * east + offset(row) * north;
            values.push(bilinear(grey, p.x / p.z, p.y / p.z));
        }
    }
    let n = values.len() as f32;
    let mean = values.iter().sum::<f32>() / n;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / n;
    if variance.is_nan() || variance <= LEAST_VARIANCE {
        values.clear(); // also for `NaN`, where the square leaves the photo
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
