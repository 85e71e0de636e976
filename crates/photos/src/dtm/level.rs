//! Ground level anywhere, from squares of open ground around.
//!
//! ```text
//! z(p)    plane(p) + f(p),   f: Gaussian process with covariance s² exp(−d² / 2 RANGE_M²)
//! plane   robust plane through the squares within REACH_M
//! σ_n     standard deviation of a square
//! s²      spread of the squares around the plane, squared, less σ_n²
//! σ²      s² − kᵀ (K + σ_n²/w)⁻¹ k + variance of the plane       w: biweight of a square's residual
//! ```
//!
//! Squares that agree shape the surface, squares that scatter are averaged: in photos of a real flight they scatter by
//! 0.7 to 1 m, and a plane of their own around each building was off by up to 3.9 m where they lie on one side of it.
//! Source: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), section 2.2.

use glam::{DVec2, DVec3};
use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::surface::plane;
use sizeup_heights::stats;

/// Squares within this of a place give its plane, metres, weighted by a Gaussian of half of it.
pub const REACH_M: f64 = 120.0;
/// So many of the nearest ones shape the surface: within 50 m where squares lie 12 m apart.
const N_NEAR: usize = 60;
/// Range of the covariance, metres: on hills of 120 m wave length and 90 m relief 30 m gave 0.215 m and 45 m 0.211.
const RANGE_M: f64 = 45.0;
/// Terrain differs from a plane at least by this, metres: kerbs, courts, embankments.
const LEAST_RELIEF_M: f64 = 0.2;
/// Matching is no better, metres.
const LEAST_SIGMA_M: f64 = 0.05;
/// Fewer squares tell no level.
const MIN_SQUARES: usize = 8;
/// Cut-off of the biweight in standard deviations. What stands above the ground was left out of the squares before.
const CUT_OFF: [f64; 2] = [4.0, 4.0];
/// Least weight of a square: an outlier stays in the equations.
const LEAST_WEIGHT: f64 = 1e-3;
/// Rounds of new weights, of the plane and of the surface.
const PLANE_ROUNDS: usize = 8;
const ROUNDS: usize = 4;

/// Surface of the ground between squares.
#[derive(Debug)]
pub struct GroundSurface {
    squares: RTree<GeomWithData<[f64; 2], f64>>,
    sigma_m: f64,
}

impl GroundSurface {
    /// Surface through squares: middles and heights, and the standard deviation of a height, metres.
    #[must_use]
    pub fn new(squares: impl Iterator<Item = ([f64; 2], f64)>, sigma_m: f64) -> Self {
        let squares = squares.map(|(at, z_m)| GeomWithData::new(at, z_m)).collect();
        Self {
            squares: RTree::bulk_load(squares),
            sigma_m: if sigma_m > LEAST_SIGMA_M { sigma_m } else { LEAST_SIGMA_M },
        }
    }

    /// Level of the ground at a place and its standard deviation, metres; `None` where fewer than eight squares are near.
    #[must_use]
    pub fn at(&self, place: DVec2) -> Option<(f64, f64)> {
        let near = self.squares.locate_within_distance(place.to_array(), REACH_M * REACH_M);
        let mut around: Vec<(DVec2, f64)> =
            near.map(|square| (DVec2::from_array(*square.geom()) - place, square.data)).collect();
        if around.len() < MIN_SQUARES {
            return None;
        }
        let key = |offset: DVec2| (offset.length_squared(), offset.x, offset.y);
        around.sort_by(|a, b| key(a.0).partial_cmp(&key(b.0)).unwrap_or(std::cmp::Ordering::Equal));
        let (plane, spread_m) = robust_plane(&around)?;
        let plane_variance = self.sigma_m.powi(2) * variance_of_plane(&around);
        around.truncate(N_NEAR);
        let (f_m, variance) = self.detail(&around, plane, spread_m)?;
        Some((plane.z + f_m, (variance + plane_variance).sqrt()))
    }

    /// Offset of the surface from the plane of its squares, here, and its variance.
    fn detail(&self, near: &[(DVec2, f64)], plane: DVec3, spread_m: f64) -> Option<(f64, f64)> {
        let relief2 = (spread_m.powi(2) - self.sigma_m.powi(2)).max(LEAST_RELIEF_M.powi(2));
        let covariance = |between: DVec2| relief2 * (-0.5 * between.length_squared() / RANGE_M.powi(2)).exp();
        let residuals: Vec<f64> = near.iter().map(|(at, z_m)| z_m - plane.truncate().dot(*at) - plane.z).collect();
        let to_place: Vec<f64> = near.iter().map(|(at, _)| covariance(*at)).collect();
        let mut noise = vec![self.sigma_m.powi(2); near.len()];
        let mut solved = None;
        for _ in 0..ROUNDS {
            let matrix = near.iter().enumerate().map(|(i, (a, _))| {
                let row = near[..=i].iter().map(|(b, _)| covariance(*a - *b));
                let mut row: Vec<f64> = row.collect();
                row[i] += noise[i];
                row
            });
            let factor = cholesky(matrix.collect())?;
            let weights = solve(&factor, &residuals);
            // The residual of a square is its noise times its weight.
            for (noise, weight) in noise.iter_mut().zip(&weights) {
                let left_m = *noise * weight;
                *noise = self.sigma_m.powi(2) / stats::biweight(left_m, self.sigma_m, CUT_OFF).max(LEAST_WEIGHT);
            }
            solved = Some((factor, weights));
        }
        let (factor, weights) = solved?;
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let known = dot(&to_place, &solve(&factor, &to_place));
        Some((dot(&to_place, &weights), (relief2 - known).max(0.0)))
    }
}

/// Plane through squares on the ground and their spread around it, metres.
fn robust_plane(around: &[(DVec2, f64)]) -> Option<(DVec3, f64)> {
    let width_m = 0.5 * REACH_M;
    let mut found = plane(around, width_m, |_| 1.0)?;
    let mut sigma_m = LEAST_SIGMA_M;
    for _ in 0..PLANE_ROUNDS {
        let residual = |(offset, z_m): &(DVec2, f64)| z_m - found.truncate().dot(*offset) - found.z;
        let sizes: Vec<f64> = around.iter().map(|square| residual(square).abs()).collect();
        sigma_m = (stats::SIGMA_PER_MAD * stats::median(&sizes)?).max(LEAST_SIGMA_M);
        found = plane(around, width_m, |square| stats::biweight(residual(square), sigma_m, CUT_OFF))?;
    }
    Some((found, sigma_m))
}

/// Variance of a plane at offset 0, in variances of a square: `(1 + |m|² / v) / n`, of the mean and the variance of the squares'
/// offsets.
fn variance_of_plane(around: &[(DVec2, f64)]) -> f64 {
    let weight = |offset: DVec2| (-0.5 * (offset / (0.5 * REACH_M)).length_squared()).exp();
    let n: f64 = around.iter().map(|(offset, _)| weight(*offset)).sum();
    let mean = around.iter().map(|(offset, _)| *offset * weight(*offset)).sum::<DVec2>() / n;
    let variance =
        around.iter().map(|(offset, _)| (*offset - mean).length_squared() * weight(*offset)).sum::<f64>() / n;
    (1.0 + mean.length_squared() / variance.max(1.0)) / n
}

/// Cholesky's factor of a symmetric positive definite matrix, by the rows of its lower triangle.
fn cholesky(mut rows: Vec<Vec<f64>>) -> Option<Vec<Vec<f64>>> {
    for i in 0..rows.len() {
        let (above, rest) = rows.split_at_mut(i);
        let row = &mut rest[0];
        for j in 0..i {
            let known: f64 = row[..j].iter().zip(&above[j][..j]).map(|(a, b)| a * b).sum();
            row[j] = (row[j] - known) / above[j][j];
        }
        let left = row[i] - row[..i].iter().map(|a| a * a).sum::<f64>();
        if left <= 0.0 {
            return None;
        }
        row[i] = left.sqrt();
    }
    Some(rows)
}

/// Solution of `L Lᵀ x = right`.
fn solve(factor: &[Vec<f64>], right: &[f64]) -> Vec<f64> {
    let mut x = right.to_vec();
    for i in 0..x.len() {
        let known: f64 = factor[i][..i].iter().zip(&x).map(|(a, b)| a * b).sum();
        x[i] = (x[i] - known) / factor[i][i];
    }
    for i in (0..x.len()).rev() {
        x[i] /= factor[i][i];
        let value = x[i];
        x[..i].iter_mut().zip(&factor[i]).for_each(|(x, a)| *x -= value * a);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squares 12 m apart over 480 m, all but those within a distance of the middle, with noise of a standard deviation.
    fn squares(ground: impl Fn(DVec2) -> f64, noise_m: f64, hole_m: f64) -> impl Iterator<Item = ([f64; 2], f64)> {
        let all = (0..1600_u32).map(|i| (i, DVec2::new(f64::from(i % 40), f64::from(i / 40)) * 12.0 - 234.0));
        let open = all.filter(move |(_, at)| at.length() > hole_m);
        open.map(move |(i, at)| {
            // Sum of uniform numbers: close to normal.
            let uniform = |k: u32| f64::from((i * 7919 + k * 104_729 + i * i * 31) % 1009) / 1009.0 - 0.5;
            let normal = (0..12).map(uniform).sum::<f64>();
            (at.to_array(), ground(at) + noise_m * normal)
        })
    }

    #[test]
    fn hills_are_followed_and_scatter_is_averaged_with_an_honest_sigma() {
        // Relief of 20 m over 200 m, a slope of one in three.
        let hills = |at: DVec2| 10.0 * (at.x / 32.0).sin() + 0.05 * at.y;
        let places = || (0..64).map(|i| DVec2::new(f64::from(i % 8), f64::from(i / 8)) * 17.0 - 60.0);
        for (name, ground, noise_m, most_m) in
            [("hills", &hills as &dyn Fn(DVec2) -> f64, 0.05, 0.1), ("level", &|_| 0.0, 1.0, 0.15)]
        {
            let surface = GroundSurface::new(squares(ground, noise_m, 0.0), noise_m);
            let of = |at: DVec2| surface.at(at).map(|(z_m, sigma_m)| ((z_m - ground(at)).abs(), sigma_m)).unwrap();
            let found: Vec<(f64, f64)> = places().map(of).collect();
            let mean_m = found.iter().map(|(error_m, _)| error_m).sum::<f64>() / 64.0;
            let n_within = found.iter().filter(|(error_m, sigma_m)| *error_m < 2.0 * sigma_m.hypot(0.15)).count();
            assert!(mean_m < most_m && n_within >= 55, "{name}: {mean_m} m, {n_within} of 64 within 2 sigma");
        }
    }

    #[test]
    fn far_from_squares_the_level_is_uncertain_and_without_them_unknown() {
        let at_hole = |hole_m: f64| GroundSurface::new(squares(|at| 0.02 * at.x, 0.5, hole_m), 0.5).at(DVec2::ZERO);
        let ((z_m, sigma_m), (_, sigma_beside_m)) = (at_hole(70.0).unwrap(), at_hole(0.0).unwrap());
        assert!(z_m.abs() < 2.0 * sigma_m, "{z_m} ± {sigma_m}");
        assert!(sigma_m > 1.3 * sigma_beside_m, "{sigma_m}, {sigma_beside_m} m");
        assert_eq!(at_hole(200.0), None);
    }

    #[test]
    fn a_few_squares_that_stand_out_do_not_raise_the_ground() {
        let raised =
            squares(|_| 0.0, 0.3, 0.0).enumerate().map(|(i, (at, z_m))| (at, if i % 9 == 0 { z_m + 4.0 } else { z_m }));
        let (z_m, sigma_m) = GroundSurface::new(raised, 0.3).at(DVec2::new(3.0, -5.0)).unwrap();
        assert!(z_m.abs() < 0.25 && sigma_m < 0.4, "{z_m} ± {sigma_m}");
    }
}
