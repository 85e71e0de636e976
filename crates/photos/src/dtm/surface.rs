//! From single squares to a surface: what stands above its neighbours is left out, the rest carries planes.
//!
//! ```text
//! z(x, y) = c of the plane a·Δx + b·Δy + c of least Σ w·residual²,   w = exp(−d²/2h²) · biweight
//! ```
//!
//! What is not ground stands above it, so residuals have one heavy side: the biweight's spread is measured on the other.

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::trend::GroundTrend;
use super::{DtmConfig, GroundSquare, SquareOutcome};
use sizeup_geo::terrain::{Dem, DemError, MapBox, Terrain};
use sizeup_heights::raster::Raster;
use sizeup_heights::stats;

/// Bandwidth `h` in spacings, and how far squares still count, in bandwidths.
const BANDWIDTH: f64 = 1.8;
const REACH: f64 = 3.0;
/// Fewer neighbours make no plane.
const MIN_NEIGHBOURS: usize = 5;
/// Rounds of least squares with new weights.
const ROUNDS: usize = 8;
/// Cut-off of the biweight in standard deviations, above and below the surface.
const CUT_OFF: [f64; 2] = [2.5, 4.7];
/// The spread is taken to be at least this, metres: matching is no better.
const LEAST_SIGMA_M: f64 = 0.05;
/// A square this far from its neighbours' plane is not ground: in standard deviations, and at least in metres.
const OUTLIER_SIGMAS: f64 = 3.0;
const OUTLIER_M: f64 = 0.4;

/// The surface stays within this of the squares around it, metres.
const BEYOND_M: f64 = 0.5;

type HeightTree = RTree<GeomWithData<[f64; 2], f64>>;

/// Marks squares that their neighbours contradict; returns the spread of the others around their neighbours' planes, metres.
pub(super) fn leave_out_what_stands_above(squares: &mut [GroundSquare], trend: &GroundTrend, spacing_m: f64) -> f64 {
    let bandwidth_m = BANDWIDTH * spacing_m;
    trend.leave_out_what_is_off(squares);
    let heights = heights(squares);
    let against = |square: &GroundSquare| {
        let SquareOutcome::Ground(z_m) = square.outcome else { return None };
        let neighbours: Vec<_> =
            around(&heights, square.at, bandwidth_m).filter(|(offset, _)| *offset != DVec2::ZERO).collect();
        let (level_m, sigma_m) = robust_level(&neighbours, bandwidth_m)?;
        Some((z_m - level_m, sigma_m))
    };
    let residuals: Vec<Option<(f64, f64)>> = squares.par_iter().map(against).collect();
    let mut kept = Vec::new();
    for (square, residual) in squares.iter_mut().zip(residuals) {
        let SquareOutcome::Ground(z_m) = square.outcome else { continue };
        match residual {
            // One on its own cannot be told from a roof.
            None => square.outcome = SquareOutcome::Outlier(z_m),
            Some((off_m, sigma_m)) if off_m.abs() > (OUTLIER_SIGMAS * sigma_m).max(OUTLIER_M) => {
                square.outcome = SquareOutcome::Outlier(z_m);
            }
            Some((off_m, _)) => kept.push(off_m.abs()),
        }
    }
    stats::SIGMA_PER_MAD * stats::median(&kept).unwrap_or(f64::NAN)
}

/// The model over an area, from what the squares say that a rough one is off by. A level has no value farther from ground
/// than the squares reach; a model is shifted there by the median of the squares.
pub(super) fn model(
    squares: &[GroundSquare],
    rough: &Terrain,
    area: MapBox,
    config: &DtmConfig,
) -> Result<Dem, DemError> {
    let off = grid(squares, area, config)?;
    let (west_m, north_m) = off.corner_m();
    match rough {
        Terrain::Constant(level_m) => {
            let raised = off.heights_m().map(|off_m| off_m + *level_m as f32);
            Dem::new(raised, west_m, north_m, config.cell_m, config.cell_m)
        }
        Terrain::Grid(dem) => {
            let known: Vec<f64> = heights(squares).iter().map(|square| square.data).collect();
            let median_m = stats::median(&known).unwrap_or(0.0);
            let cell_m = dem.cell_m().0.min(dem.cell_m().1).min(config.cell_m);
            let n = |from: f64, to: f64| ((to - from) / cell_m).ceil().max(1.0) as usize;
            let (width, height) = (n(area.west_m, area.east_m), n(area.south_m, area.north_m));
            let value = |i: usize| {
                let (x, y) =
                    (west_m + cell_m * ((i % width) as f64 + 0.5), north_m - cell_m * ((i / width) as f64 + 0.5));
                let rough_m = dem.height_at(x, y)?;
                Some((rough_m + off.height_at(x, y).unwrap_or(median_m)) as f32)
            };
            let values = (0..width * height).into_par_iter().map(|i| value(i).unwrap_or(f32::NAN)).collect();
            let raster = Raster::from_vec(width, height, values).expect("one value per cell");
            Dem::new(raster, west_m, north_m, cell_m, cell_m)
        }
    }
}

/// The surface through the squares; no value farther from ground than they reach.
fn grid(squares: &[GroundSquare], area: MapBox, config: &DtmConfig) -> Result<Dem, DemError> {
    let heights = heights(squares);
    let bandwidth_m = BANDWIDTH * config.spacing_m;
    let n = |from: f64, to: f64| ((to - from) / config.cell_m).ceil().max(1.0) as usize;
    let (width, height) = (n(area.west_m, area.east_m), n(area.south_m, area.north_m));
    let at = |col: usize, row: usize| {
        let place = DVec2::new(col as f64 + 0.5, -(row as f64 + 0.5)) * config.cell_m;
        DVec2::new(area.west_m, area.north_m) + place
    };
    let level = |i: usize| {
        let place = at(i % width, i / width);
        // Under large roofs the nearest open ground is farther away.
        [1.0, 2.0].into_iter().find_map(|wider| {
            let neighbours: Vec<_> = around(&heights, place, wider * bandwidth_m).collect();
            let enough = neighbours.len() >= MIN_NEIGHBOURS;
            let level_m = enough.then(|| plane(&neighbours, wider * bandwidth_m, |_| 1.0)).flatten()?.z;
            let (low_m, high_m) = neighbours
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (_, z_m)| (low.min(*z_m), high.max(*z_m)));
            Some(level_m.clamp(low_m - BEYOND_M, high_m + BEYOND_M))
        })
    };
    let values = (0..width * height).into_par_iter().map(|i| level(i).map_or(f32::NAN, |z_m| z_m as f32)).collect();
    let raster = Raster::from_vec(width, height, values).expect("one value per cell");
    Dem::new(raster, area.west_m, area.north_m, config.cell_m, config.cell_m)
}

fn heights(squares: &[GroundSquare]) -> HeightTree {
    let ground = squares.iter().filter_map(|square| match square.outcome {
        SquareOutcome::Ground(z_m) => Some(GeomWithData::new(square.at.to_array(), z_m)),
        _ => None,
    });
    RTree::bulk_load(ground.collect())
}

/// Offsets and heights of the squares that count at a place.
fn around(heights: &HeightTree, place: DVec2, bandwidth_m: f64) -> impl Iterator<Item = (DVec2, f64)> + '_ {
    let reach_m = REACH * bandwidth_m;
    let close = heights.locate_within_distance(place.to_array(), reach_m * reach_m);
    close.map(move |square| (DVec2::from_array(*square.geom()) - place, square.data))
}

/// Level of the surface below what stands on it, and its spread, metres.
fn robust_level(neighbours: &[(DVec2, f64)], bandwidth_m: f64) -> Option<(f64, f64)> {
    if neighbours.len() < MIN_NEIGHBOURS {
        return None;
    }
    let mut surface = plane(neighbours, bandwidth_m, |_| 1.0)?;
    let mut sigma_m = LEAST_SIGMA_M;
    for _ in 0..ROUNDS {
        let residual = |(offset, z_m): &(DVec2, f64)| z_m - surface.truncate().dot(*offset) - surface.z;
        sigma_m = stats::far_side_sigma(neighbours.iter().map(residual))?.max(LEAST_SIGMA_M);
        surface = plane(neighbours, bandwidth_m, |sample| stats::biweight(residual(sample), sigma_m, CUT_OFF))?;
    }
    Some((surface.z, sigma_m))
}

/// The weighted plane through heights: slopes along x and y, and the level at offset 0.
pub(super) fn plane(
    samples: &[(DVec2, f64)],
    bandwidth_m: f64,
    weight: impl Fn(&(DVec2, f64)) -> f64,
) -> Option<DVec3> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for sample in samples {
        let scaled = sample.0 / bandwidth_m;
        let w = weight(sample) * (-0.5 * scaled.length_squared()).exp();
        let row = scaled.extend(1.0);
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * w;
        right += row * (w * sample.1);
    }
    // Squares in one line carry no slope across it: a little stiffness keeps the surface level there.
    let stiffness = 1e-3 * normal.z_axis.z;
    normal += DMat3::from_diagonal(DVec3::new(stiffness, stiffness, 0.0));
    (normal.determinant().abs() > 1e-12).then(|| {
        let p = normal.inverse() * right;
        DVec3::new(p.x / bandwidth_m, p.y / bandwidth_m, p.z)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slope with every fifth square on a tree, and one hole in the ground.
    fn slope() -> Vec<GroundSquare> {
        (0..15 * 15)
            .map(|i| {
                let at = DVec2::new(f64::from(i % 15), f64::from(i / 15)) * 12.0;
                let stands_m = if i % 5 == 0 { 2.0 + f64::from(i % 4) } else { 0.0 };
                let noise_m = 0.05 * (f64::from(i) * 1.7).sin();
                GroundSquare { at, outcome: SquareOutcome::Ground(ground(at) + stands_m + noise_m) }
            })
            .collect()
    }

    fn left_out(squares: &mut [GroundSquare], spacing_m: f64) -> f64 {
        let trend = GroundTrend::of(squares, spacing_m);
        leave_out_what_stands_above(squares, &trend, spacing_m)
    }

    fn ground(at: DVec2) -> f64 {
        100.0 + 0.05 * at.x - 0.02 * at.y
    }

    #[test]
    fn what_stands_on_the_ground_is_left_out_and_the_slope_stays() {
        let mut squares = slope();
        let sigma_m = left_out(&mut squares, 12.0);
        for (i, square) in squares.iter().enumerate() {
            let stands = i % 5 == 0;
            assert_eq!(matches!(square.outcome, SquareOutcome::Outlier(_)), stands, "square {i}: {square:?}");
        }
        assert!(sigma_m < 0.1, "{sigma_m}");
        let area = MapBox { west_m: 0.0, south_m: 0.0, east_m: 168.0, north_m: 168.0 };
        let dem = grid(&squares, area, &DtmConfig::default()).unwrap();
        for at in [DVec2::new(20.0, 30.0), DVec2::new(84.0, 84.0), DVec2::new(150.0, 20.0)] {
            let off_m = dem.height_at(at.x, at.y).unwrap() - ground(at);
            assert!(off_m.abs() < 0.05, "{off_m} at {at}");
        }
    }

    #[test]
    fn false_matches_that_outnumber_the_ground_are_left_out() {
        let mut squares = slope();
        for (i, square) in squares.iter_mut().enumerate() {
            // Three in five are anywhere between 15 m below and above.
            if i % 5 > 1 {
                let anywhere = ((i * 7919) % 3001) as f64 / 100.0 - 15.0;
                square.outcome = SquareOutcome::Ground(ground(square.at) + anywhere);
            } else {
                square.outcome = SquareOutcome::Ground(ground(square.at));
            }
        }
        left_out(&mut squares, 12.0);
        let off_m = |square: &GroundSquare| match square.outcome {
            SquareOutcome::Ground(z_m) => Some((z_m - ground(square.at)).abs()),
            _ => None,
        };
        let off: Vec<f64> = squares.iter().filter_map(off_m).collect();
        let n_false = off.iter().filter(|m| **m > 0.6).count();
        // Some false ones lie by chance close to the ground.
        assert!(off.len() >= 85 && n_false <= 5, "{} kept of 90, {n_false} of them false", off.len());
        assert!(off.iter().filter(|m| **m > 1.5).count() <= 1, "{off:?}");
    }

    /// Level ground, two squares in five of it open, and at its northern border, 64 m from the next open ground, seven squares in a row that
    /// stand higher: as over a real town of which nine buildings have footprints.
    fn beside_a_row(stands_m: f64) -> Vec<GroundSquare> {
        let all = (0..18 * 14).map(|i| (i % 18, i / 18));
        let is_in_row = |col: i32, row: i32| row == 13 && (5..12).contains(&col);
        let open = all.filter(|&(col, row)| is_in_row(col, row) || (row < 10 && (col * 7 + row * 3) % 5 < 2));
        let square = |(col, row): (i32, i32)| {
            let noise_m = 0.3 * (f64::from(col * 31 + row * 17) * 1.7).sin();
            let z_m = if is_in_row(col, row) { stands_m } else { 0.0 } + noise_m;
            GroundSquare { at: DVec2::new(f64::from(col), f64::from(row)) * 16.0, outcome: SquareOutcome::Ground(z_m) }
        };
        open.map(square).collect()
    }

    #[test]
    fn a_roof_without_a_footprint_on_which_all_squares_agree_is_not_ground() {
        let mut squares = beside_a_row(16.0);
        left_out(&mut squares, 16.0);
        assert_eq!(n_ground_in_row(&squares), 0);
        let n_ground = squares.iter().filter(|s| matches!(s.outcome, SquareOutcome::Ground(_))).count();
        assert!(n_ground >= 60, "{n_ground} of {}", squares.len());
    }

    fn n_ground_in_row(squares: &[GroundSquare]) -> usize {
        let in_row = squares.iter().filter(|square| square.at.y > 200.0);
        in_row.filter(|square| matches!(square.outcome, SquareOutcome::Ground(_))).count()
    }

    #[test]
    fn a_hillside_behind_a_gap_is_no_roof() {
        // One in six all the way, where the terrain is a constant: 35 m at the row, 11 m above the squares before the gap.
        let mut squares = beside_a_row(0.0);
        for square in &mut squares {
            let SquareOutcome::Ground(z_m) = square.outcome else { continue };
            square.outcome = SquareOutcome::Ground(z_m + square.at.y / 6.0);
        }
        GroundTrend::of(&squares, 16.0).leave_out_what_is_off(&mut squares);
        assert_eq!(n_ground_in_row(&squares), 7);
    }

    #[test]
    fn far_from_all_ground_there_is_none() {
        let squares = slope();
        let area = MapBox { west_m: 0.0, south_m: 0.0, east_m: 500.0, north_m: 168.0 };
        let dem = grid(&squares, area, &DtmConfig::default()).unwrap();
        assert_eq!(dem.height_at(480.0, 80.0), None);
    }
}
