//! Depth of a network made to look as if photos had been matched for it: edges that wander, steps, blobs, holes, specks.
//!
//! Simulated priors are smooth and dense, as networks give them. What stereo gives of the same roofs is not, and a network that never
//! saw it takes every speck for a building.

use rand::Rng;
use sizeup_footprints::segment::holes;
use sizeup_heights::raster::Raster;

/// Most holes that are torn into a crop anywhere.
const MOST_HOLES: usize = 10;
/// A step of the relief between neighbours from which on one photo alone may see it, spreads.
const EDGE: f32 = 0.35;

/// A field of about standard deviation 1 that changes over some pixels: random numbers on a grid, bilinear between.
pub(super) fn smooth((columns, rows): (usize, usize), cell_px: f32, rng: &mut impl Rng) -> Vec<f32> {
    let n = |pixels: usize| (pixels as f32 / cell_px) as usize + 2;
    let (n_columns, n_rows) = (n(columns), n(rows));
    let grid = (0..n_columns * n_rows).map(|_| 2.45 * (rng.random::<f32>() + rng.random::<f32>() - 1.0)).collect();
    let grid = Raster::from_vec(n_columns, n_rows, grid).expect("one value per cell");
    let at = |i: usize| {
        let (col, row) = ((i % columns) as f32 / cell_px, (i / columns) as f32 / cell_px);
        grid.bilinear(f64::from(col) + 0.5, f64::from(row) + 0.5)
    };
    (0..columns * rows).map(at).collect()
}

/// The relief of a crop, row by row, as matching might give it. Holes are filled as sizeup fills them.
pub(super) fn as_if_matched(relief: &[f32], size: (usize, usize), rng: &mut impl Rng) -> Vec<f32> {
    let mut relief = wandering(relief, size, rng);
    let (bumps, waves) = (rng.random_range(0.0..0.25_f32), rng.random_range(0.0..0.2_f32));
    let (small, large) = (smooth(size, rng.random_range(3.0..9.0), rng), smooth(size, 60.0, rng));
    for (value, (small, large)) in relief.iter_mut().zip(small.iter().zip(&large)) {
        *value += bumps * small + waves * large;
    }
    if rng.random_bool(0.3) {
        let step = rng.random_range(0.05..0.4_f32);
        relief.iter_mut().for_each(|v| *v = (*v / step).round() * step);
    }
    tear(&mut relief, size, rng);
    let mut map = Raster::from_vec(size.0, size.1, relief).expect("one value per pixel");
    holes::fill(&mut map);
    map.data().to_vec()
}

/// Each value from some pixels away, near ones from nearly the same direction.
fn wandering(relief: &[f32], (columns, rows): (usize, usize), rng: &mut impl Rng) -> Vec<f32> {
    let (reach, cell) = (rng.random_range(0.0..2.5_f32), rng.random_range(4.0..12.0_f32));
    let (across, down) = (smooth((columns, rows), cell, rng), smooth((columns, rows), cell, rng));
    let moved = |at: usize, by: f32, n: usize| (at as f32 + reach * by).round().clamp(0.0, n as f32 - 1.0) as usize;
    let from = |i: usize| moved(i / columns, down[i], rows) * columns + moved(i % columns, across[i], columns);
    (0..relief.len()).map(|i| relief[from(i)]).collect()
}

/// Holes along edges and anywhere, with specks in them.
fn tear(relief: &mut [f32], (columns, rows): (usize, usize), rng: &mut impl Rng) {
    let (width, torn) = (rng.random_range(1..=4_usize), smooth((columns, rows), rng.random_range(3.0..10.0), rng));
    let level = rng.random_range(-0.8..1.0_f32);
    let is_edge = |i: usize| {
        let (col, row) = (i % columns, i / columns);
        let beside = [(col + 1 < columns).then_some(i + 1), (row + 1 < rows).then_some(i + columns)];
        beside.into_iter().flatten().any(|j| (relief[i] - relief[j]).abs() > EDGE)
    };
    let edges: Vec<usize> = (0..relief.len()).filter(|&i| is_edge(i)).collect();
    let mut holes: Vec<(usize, usize, usize)> =
        edges.into_iter().filter(|&i| torn[i] > level).map(|i| (i % columns, i / columns, width)).collect();
    for _ in 0..rng.random_range(0..=MOST_HOLES) {
        holes.push((rng.random_range(0..columns), rng.random_range(0..rows), rng.random_range(1..12)));
    }
    let specks = rng.random_range(0.0..0.08);
    for (col, row, reach) in holes {
        for r in row.saturating_sub(reach)..(row + reach + 1).min(rows) {
            for c in col.saturating_sub(reach)..(col + reach + 1).min(columns) {
                if r.abs_diff(row).pow(2) + c.abs_diff(col).pow(2) <= reach.pow(2) {
                    relief[r * columns + c] =
                        if rng.random_bool(specks) { rng.random_range(-1.0..5.0) } else { f32::NAN };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_heights::seed;

    /// A house of relief 3 in a plane: its edges change, its middle and the far plane hardly do, and nothing is left unknown.
    #[test]
    fn a_house_stays_one_and_its_edges_do_not() {
        let size = (64, 64);
        let inside = |i: usize| (20..44).contains(&(i % 64)) && (20..44).contains(&(i / 64));
        let house: Vec<f32> = (0..64 * 64).map(|i| if inside(i) { 3.0 } else { 0.0 }).collect();
        let (mut n_changed, mut n_kept) = (0, 0);
        for key in 0..20 {
            let found = as_if_matched(&house, size, &mut seed::stream(key, "test", &[]));
            assert!(found.iter().all(|v| v.is_finite()));
            let changed = |i: &usize| (found[*i] - house[*i]).abs() > 1.0;
            n_changed += (0..64).map(|r| r * 64 + 20).filter(changed).count();
            n_kept += (0..9).map(|r| (28 + r) * 64 + 32).filter(|i| !changed(i)).count();
        }
        assert!(n_changed > 100 && n_kept > 20 * 9 * 3 / 4, "{n_changed} changed, {n_kept} kept");
    }
}
