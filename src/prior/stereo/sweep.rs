//! How well the neighbours agree with a view at every height level.
//!
//! A pixel `u` of the view, seen through the plane at height `z`, lies in a neighbour at `H(z)·u`. With projection
//! centres `C`, `M = Rᵣᵀ·Kᵣ⁻¹` (pixel to direction in the map), `m` its third row and `B = Kₛ·Rₛ·M`:
//!
//! ```text
//! H(z) = (Kₛ·Rₛ·(Cᵣ − Cₛ)) ⊗ m + (z − Cᵣ.z)·B
//! ```

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::StereoConfig;
use super::picture::Picture;
use crate::camera::Camera;
use crate::raster::Raster;
use crate::terrain::Terrain;

/// Cost of a full mismatch, or of a level that no neighbour can see.
pub(super) const WORST: u8 = 255;
/// How far a neighbour's pixels may move from one level to the next, pixels: less repeats, more skips.
const STEP_PX: f64 = 0.75;
/// Variance below which a window has no texture to compare, grey levels².
const LEAST_VARIANCE: f32 = 0.05;

/// Mismatch per pixel and level: pixel-major, so that a pixel's levels lie together.
#[derive(Debug)]
pub(super) struct Volume {
    pub width: usize,
    pub height: usize,
    pub n_levels: usize,
    /// 0 (same) to [`WORST`], `[(row · width + col) · n_levels + level]`.
    pub costs: Vec<u8>,
}

/// Heights of the planes, evenly spaced, ascending; `None` if the view has no ground in sight.
pub(super) fn levels(
    reference: &Picture,
    others: &[Arc<Picture>],
    terrain: &Terrain,
    config: &StereoConfig,
) -> Option<Vec<f64>> {
    let (lowest, highest) = ground_in_sight(reference, terrain)?;
    let camera_z = reference.camera_from_map().centre().z;
    let from = lowest - config.below_ground_m;
    // A roof as high as the camera could not be seen from above.
    let to = (highest + config.max_height_m).min(camera_z - 0.05 * (camera_z - highest).abs());
    if to <= from {
        return None;
    }
    let middle = DVec2::new(f64::from(reference.camera().width_px), f64::from(reference.camera().height_px)) / 2.0;
    let moved_px = others.iter().filter_map(|other| {
        let at = |z: f64| position(&homography(reference, other, z), middle);
        Some((at(to)? - at(from)?).length())
    });
    let longest_px = moved_px.fold(0.0, f64::max);
    let n = ((longest_px / STEP_PX).ceil() as usize + 1).clamp(8, config.max_levels);
    Some((0..n).map(|i| from + (to - from) * i as f64 / (n - 1) as f64).collect())
}

/// Lowest and highest ground where the view looks; the whole terrain's where it says nothing there.
fn ground_in_sight(reference: &Picture, terrain: &Terrain) -> Option<(f64, f64)> {
    const SIDE: u32 = 16;
    let (lowest, highest) = terrain.range()?;
    let pose = reference.camera_from_map();
    let (centre, to_map) = (pose.centre(), pose.rotation.transpose());
    let camera = reference.camera();
    let mut sees_ground = false;
    let mut range: Option<(f64, f64)> = None;
    for i in 0..SIDE * SIDE {
        let at = |i: u32, extent: u32| (f64::from(i) + 0.5) / f64::from(SIDE) * f64::from(extent);
        let pixel = DVec2::new(at(i % SIDE, camera.width_px), at(i / SIDE, camera.height_px));
        let Some(ray) = camera.unproject(pixel).map(|ray| to_map * ray) else { continue };
        // Both ends of the terrain's range, since the ray may meet the ground anywhere between.
        for z in [lowest, highest] {
            let depth = (z - centre.z) / ray.z;
            if depth <= 0.0 || !depth.is_finite() {
                continue;
            }
            sees_ground = true;
            let place = centre + depth * ray;
            if let Some(ground) = terrain.height_at(place.x, place.y) {
                let (low, high) = range.unwrap_or((ground, ground));
                range = Some((low.min(ground), high.max(ground)));
            }
        }
    }
    sees_ground.then(|| range.unwrap_or((lowest, highest)))
}

/// The mismatch of every pixel with its neighbours at every level.
pub(super) fn volume(reference: &Picture, others: &[Arc<Picture>], levels_m: &[f64], radius_px: usize) -> Volume {
    let (width, height) = (reference.grey().width(), reference.grey().height());
    let windows = Windows::new(reference.grey(), radius_px);
    let per_level: Vec<Vec<u8>> = levels_m
        .par_iter()
        .map(|z| {
            let scores: Vec<Vec<f32>> =
                others.iter().map(|other| windows.correlate(other.grey(), &homography(reference, other, *z))).collect();
            (0..width * height).map(|i| cost(scores.iter().map(|s| s[i]))).collect()
        })
        .collect();
    let n_levels = levels_m.len();
    let mut costs = vec![0; width * height * n_levels];
    costs.par_chunks_exact_mut(n_levels).enumerate().for_each(|(i, pixel)| {
        for (cost, level) in pixel.iter_mut().zip(&per_level) {
            *cost = level[i];
        }
    });
    Volume { width, height, n_levels, costs }
}

/// Mean of the better half of the correlations (`NaN` = not seen) as a cost.
fn cost(scores: impl Iterator<Item = f32>) -> u8 {
    const MOST: usize = 16;
    let mut seen = [0.0_f32; MOST];
    let mut n = 0;
    for score in scores.filter(|s| !s.is_nan()).take(MOST) {
        seen[n] = score;
        n += 1;
    }
    if n == 0 {
        return WORST;
    }
    let seen = &mut seen[..n];
    seen.sort_unstable_by(|a, b| b.total_cmp(a));
    let better = &seen[..n.div_ceil(2)];
    let mean = better.iter().sum::<f32>() / better.len() as f32;
    ((1.0 - mean) * 0.5 * f32::from(WORST)).round() as u8
}

/// Correlation that a cost stands for: the inverse of [`cost`].
pub(super) fn score(cost: u8) -> f64 {
    1.0 - 2.0 * f64::from(cost) / f64::from(WORST)
}

fn homography(reference: &Picture, other: &Picture, z_m: f64) -> DMat3 {
    let calibration = |camera: &Camera| {
        DMat3::from_cols(
            DVec3::new(camera.fx_px, 0.0, 0.0),
            DVec3::new(0.0, camera.fy_px, 0.0),
            DVec3::new(camera.cx_px, camera.cy_px, 1.0),
        )
    };
    let (here, there) = (reference.camera_from_map(), other.camera_from_map());
    let map_from_pixel = here.rotation.transpose() * calibration(reference.camera()).inverse();
    let pixel_from_map = calibration(other.camera()) * there.rotation;
    let shift = pixel_from_map * (here.centre() - there.centre());
    let m = map_from_pixel.row(2);
    let through = pixel_from_map * map_from_pixel;
    // Negated, because rays go down (`m·u < 0`) and a point in front shall have a positive last coordinate.
    let outer = DMat3::from_cols(shift * m.x, shift * m.y, shift * m.z);
    -(outer + through * (z_m - here.centre().z))
}

fn position(homography: &DMat3, pixel: DVec2) -> Option<DVec2> {
    let p = *homography * pixel.extend(1.0);
    (p.z > 0.0).then(|| p.truncate() / p.z)
}

/// Sums over the windows of the view, which every comparison needs.
struct Windows<'a> {
    grey: &'a Raster<f32>,
    radius_px: usize,
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl<'a> Windows<'a> {
    fn new(grey: &'a Raster<f32>, radius_px: usize) -> Self {
        let width = grey.width();
        let squares: Vec<f32> = grey.data().iter().map(|v| v * v).collect();
        let mean = window_means(grey.data(), width, radius_px);
        let of_squares = window_means(&squares, width, radius_px);
        let variance = of_squares.iter().zip(&mean).map(|(s, m)| s - m * m).collect();
        Self { grey, radius_px, mean, variance }
    }

    /// Zero-mean normalised cross-correlation with a neighbour; `NaN` where it does not see the place.
    fn correlate(&self, other: &Raster<f32>, homography: &DMat3) -> Vec<f32> {
        let width = self.grey.width();
        let (warped, is_seen) = self.warp(other, homography);
        let squares: Vec<f32> = warped.iter().map(|v| v * v).collect();
        let products: Vec<f32> = warped.iter().zip(self.grey.data()).map(|(a, b)| a * b).collect();
        let mean = window_means(&warped, width, self.radius_px);
        let of_squares = window_means(&squares, width, self.radius_px);
        let of_products = window_means(&products, width, self.radius_px);
        let correlation = |i: usize| {
            if !is_seen[i] {
                return f32::NAN;
            }
            let variance = of_squares[i] - mean[i] * mean[i];
            if variance < LEAST_VARIANCE || self.variance[i] < LEAST_VARIANCE {
                return 0.0;
            }
            let covariance = of_products[i] - mean[i] * self.mean[i];
            (covariance / (variance * self.variance[i]).sqrt()).clamp(-1.0, 1.0)
        };
        (0..warped.len()).map(correlation).collect()
    }

    /// The neighbour as seen from the view through the plane, and where it sees that at all.
    fn warp(&self, other: &Raster<f32>, homography: &DMat3) -> (Vec<f32>, Vec<bool>) {
        let (width, height) = (self.grey.width(), self.grey.height());
        let mut values = vec![0.0; width * height];
        let mut is_seen = vec![false; width * height];
        let (last_x, last_y) = (other.width() as f64 - 1.0, other.height() as f64 - 1.0);
        let step = homography.col(0);
        for (row, line) in values.chunks_exact_mut(width).enumerate() {
            let mut p = *homography * DVec3::new(0.5, row as f64 + 0.5, 1.0);
            for (col, value) in line.iter_mut().enumerate() {
                // From pixel positions (first centre at 0.5) to cell numbers.
                let per_z = 1.0 / p.z;
                let (x, y) = (p.x * per_z - 0.5, p.y * per_z - 0.5);
                if p.z > 0.0 && x >= 0.0 && y >= 0.0 && x < last_x && y < last_y {
                    *value = bilinear(other, x, y);
                    is_seen[row * width + col] = true;
                }
                p += step;
            }
        }
        (values, is_seen)
    }
}

/// Between four cells, all of which exist.
fn bilinear(raster: &Raster<f32>, x: f64, y: f64) -> f32 {
    let (col, row) = (x as usize, y as usize);
    let (fx, fy) = ((x - col as f64) as f32, (y - row as f64) as f32);
    let first = row * raster.width() + col;
    let [a, b] = [raster.data()[first], raster.data()[first + 1]];
    let [c, d] = [raster.data()[first + raster.width()], raster.data()[first + raster.width() + 1]];
    let top = a + (b - a) * fx;
    let bottom = c + (d - c) * fx;
    top + (bottom - top) * fy
}

/// Mean over a square window, cut off at the border. Plain sums: they vectorise, and nothing accumulates.
fn window_means(values: &[f32], width: usize, radius: usize) -> Vec<f32> {
    let height = values.len() / width;
    let span = |i: usize, n: usize| (i.saturating_sub(radius), (i + radius + 1).min(n));
    let mut along_rows = vec![0.0_f32; values.len()];
    for (sums, row) in along_rows.chunks_exact_mut(width).zip(values.chunks_exact(width)) {
        for offset in 0..=2 * radius {
            // sums[col] += row[col + offset − radius], for all columns where that exists.
            let (to, from) = (radius.saturating_sub(offset), offset.saturating_sub(radius));
            let n = width - to.max(from);
            for (sum, value) in sums[to..to + n].iter_mut().zip(&row[from..from + n]) {
                *sum += value;
            }
        }
    }
    let mut means = vec![0.0_f32; values.len()];
    for (row, sums) in means.chunks_exact_mut(width).enumerate() {
        let (first, end) = span(row, height);
        for line in along_rows[first * width..end * width].chunks_exact(width) {
            for (sum, value) in sums.iter_mut().zip(line) {
                *sum += value;
            }
        }
        for (col, sum) in sums.iter_mut().enumerate() {
            let (left, right) = span(col, width);
            *sum /= ((end - first) * (right - left)) as f32;
        }
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn window_means_are_means_also_at_the_border() {
        let values: Vec<f32> = (0..12).map(|v| v as f32).collect(); // 4 wide, 3 high
        let means = window_means(&values, 4, 1);
        assert_eq!(means[0], (0.0 + 1.0 + 4.0 + 5.0) / 4.0);
        assert_eq!(means[5], 5.0);
        assert_eq!(means[11], (6.0 + 7.0 + 10.0 + 11.0) / 4.0);
    }

    #[test]
    fn the_better_half_decides_and_a_cost_is_a_correlation() {
        assert_eq!(cost([1.0, 1.0, -1.0, -0.5].into_iter()), 0);
        assert_eq!(cost([f32::NAN, -1.0].into_iter()), 255);
        assert_eq!(cost([f32::NAN; 2].into_iter()), WORST);
        assert!((score(cost([0.5].into_iter())) - 0.5).abs() < 0.005);
    }
}
