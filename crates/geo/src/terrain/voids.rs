//! Cells of a terrain model that hold no ground, and that no nodata tag names.
//!
//! ```text
//! impossible:  z < −1000 m or z > 9000 m                                   (−9999, −32767, 1e20, …)
//! filled in:   patch of cells that hold exactly v,  rise = min(z beside the patch) − v
//!              rise ≥ 3 m,  rise ≥ one cell,  rise ≥ 3 · (steps of the ground beside the patch)
//! ```
//!
//! A patch of the second kind is what a program leaves that fills in 0 under buildings: a floor to the bit level, with walls steeper
//! than 45° on all sides, in ground that has no such steps. Lakes are level too, and have shores. One patch may be a dock or a pit,
//! so `v` has to be 0 or the floor of several. Frame: cells of the file, in its own unit of heights.

use std::collections::BTreeMap;
use std::path::Path;

use crate::issue::{Issue, Severity, Subject};
use sizeup_heights::raster::Raster;
use sizeup_heights::stats;

/// Heights that ground can have, metres: the Dead Sea's shore is at −430, and −9999 feet are −3048.
const POSSIBLE_M: std::ops::RangeInclusive<f64> = -1000.0..=9000.0;
/// The least rise around a patch that is filled in, metres: more than a kerb or a bank beside water.
const LEAST_RISE_M: f64 = 3.0;
/// The rise around a patch that is filled in, in steps of the ground beside it.
const RISE_IN_STEPS: f64 = 3.0;
/// Share of the steps beside a patch that are no larger than the step of its ground.
const STEP_QUANTILE: f64 = 0.9;
/// Fewer cells of one value are chance.
const LEAST_CELLS: usize = 4;
/// Patches of one value other than 0.
const LEAST_PATCHES: usize = 2;

/// How the heights of a file are counted.
#[derive(Debug, Clone, Copy)]
pub(super) struct HeightCells {
    /// Metres per unit of heights.
    pub unit_m: f64,
    /// Width or height of a cell, the larger, metres.
    pub cell_m: f64,
}

/// Voids that were found, in the unit of the file.
#[derive(Debug, Default)]
pub(super) struct Voids {
    /// Cells that hold what no ground can have: how many, the lowest and the highest.
    impossible: Option<(usize, f32, f32)>,
    /// Values that were filled in, by their bits, with what they were found in.
    filled: BTreeMap<u32, Filled>,
}

/// Patches of one value.
#[derive(Debug, Clone, Copy, Default)]
struct Filled {
    n_cells: usize,
    n_patches: usize,
    least_rise: f64,
}

/// Cells that hold one value and share sides or corners.
struct Patch {
    value: f32,
    cells: Vec<usize>,
    rise: f64,
    is_cut: bool,
}

impl Voids {
    /// Takes the values of voids out of heights (`NaN` = no value).
    pub(super) fn blank(&mut self, heights: &mut Raster<f32>, counted: HeightCells) {
        for z in heights.data_mut() {
            if !z.is_nan() && !POSSIBLE_M.contains(&(f64::from(*z) * counted.unit_m)) {
                let (n, low, high) = self.impossible.unwrap_or((0, *z, *z));
                self.impossible = Some((n + 1, low.min(*z), high.max(*z)));
                *z = f32::NAN;
            }
        }
        let patches = pits(heights, counted);
        let mut whole: BTreeMap<u32, (usize, usize)> = BTreeMap::new();
        for patch in patches.iter().filter(|patch| !patch.is_cut) {
            let (n_patches, n_cells) = whole.entry(patch.value.to_bits()).or_default();
            (*n_patches, *n_cells) = (*n_patches + 1, *n_cells + patch.cells.len());
        }
        let is_filled = |value: f32| {
            let (n_patches, n_cells) = whole.get(&value.to_bits()).copied().unwrap_or_default();
            // Two floors of exactly one value in one part of a file tell of the others.
            let is_known = self.filled.contains_key(&value.to_bits());
            is_known || (n_cells >= LEAST_CELLS && (value == 0.0 || n_patches >= LEAST_PATCHES))
        };
        let filled: Vec<&Patch> = patches.iter().filter(|patch| is_filled(patch.value)).collect();
        for patch in filled {
            let found = self.filled.entry(patch.value.to_bits()).or_default();
            found.least_rise = if found.n_patches == 0 { patch.rise } else { found.least_rise.min(patch.rise) };
            (found.n_cells, found.n_patches) = (found.n_cells + patch.cells.len(), found.n_patches + 1);
            patch.cells.iter().for_each(|&i| heights.data_mut()[i] = f32::NAN);
        }
    }

    /// Issues of a file that holds voids.
    pub(super) fn issues(&self, path: &Path, counted: HeightCells) -> Vec<Issue> {
        let issue = |severity, code, message: String, hint: String| {
            Issue::new(severity, code, Subject::Input(path.display().to_string()), message).hint(hint)
        };
        let declare =
            |value: f32| format!("`gdal_edit.py -a_nodata {} {}` declares them", shown(value), path.display());
        let impossible = self.impossible.map(|(n, low, high)| {
            let what =
                if low.to_bits() == high.to_bits() { shown(low) } else { format!("{} to {}", shown(low), shown(high)) };
            let message = format!("{n} cells hold {what}, which no ground has: they count as cells without a value");
            issue(Severity::Note, "terrain_voids", message, declare(low))
        });
        let filled = self.filled.iter().map(|(bits, found)| {
            let (value, rise_m) = (f32::from_bits(*bits), found.least_rise * counted.unit_m);
            let message = format!(
                "{} cells in {} patches hold exactly {}, at least {rise_m:.1} m below the ground on all sides: they count as \
                 cells without a value",
                found.n_cells,
                found.n_patches,
                shown(value)
            );
            let hint = format!("{}; if they are ground, use a terrain model that slopes down to them", declare(value));
            issue(Severity::Warning, "terrain_filled_in", message, hint)
        });
        impossible.into_iter().chain(filled).collect()
    }
}

/// A value as it is written: the largest numbers with their powers of ten.
fn shown(value: f32) -> String {
    const LONG: f32 = 1e7;
    if value.abs() < LONG { value.to_string() } else { format!("{value:e}") }
}

/// Patches with walls on all sides, in ground without such steps.
fn pits(heights: &Raster<f32>, counted: HeightCells) -> Vec<Patch> {
    let least_rise = LEAST_RISE_M.max(counted.cell_m) / counted.unit_m;
    let z = heights.data();
    let mut is_done = vec![false; z.len()];
    let mut found = Vec::new();
    for start in 0..z.len() {
        let is_below_wall = |i: usize| heights.beside(i).any(|j| f64::from(z[j]) - f64::from(z[i]) >= least_rise);
        if is_done[start] || !is_below_wall(start) {
            continue;
        }
        let patch = patch_of(heights, start, &mut is_done);
        if patch.rise >= least_rise.max(RISE_IN_STEPS * step_beside(heights, &patch)) {
            found.push(patch);
        }
    }
    found
}

/// The patch that a cell belongs to.
fn patch_of(heights: &Raster<f32>, start: usize, is_done: &mut [bool]) -> Patch {
    let (z, value) = (heights.data(), heights.data()[start]);
    let mut patch = Patch { value, cells: vec![start], rise: f64::INFINITY, is_cut: false };
    is_done[start] = true;
    let mut next = 0;
    while let Some(&cell) = patch.cells.get(next) {
        next += 1;
        let (col, row) = (cell % heights.width(), cell / heights.width());
        patch.is_cut |= col == 0 || row == 0 || col + 1 == heights.width() || row + 1 == heights.height();
        for beside in around(heights, cell) {
            if z[beside] == value {
                if !is_done[beside] {
                    is_done[beside] = true;
                    patch.cells.push(beside);
                }
            } else if !z[beside].is_nan() {
                patch.rise = patch.rise.min(f64::from(z[beside]) - f64::from(value));
            }
        }
    }
    patch
}

/// The step of the ground from the cells around a patch to those behind them.
fn step_beside(heights: &Raster<f32>, patch: &Patch) -> f64 {
    let z = heights.data();
    let walls = patch.cells.iter().flat_map(|&cell| around(heights, cell)).filter(|&wall| z[wall] != patch.value);
    let steps: Vec<f64> = walls
        .flat_map(|wall| heights.beside(wall).map(move |behind| (wall, behind)))
        .filter(|&(wall, behind)| z[behind] != patch.value && !z[wall].is_nan() && !z[behind].is_nan())
        .map(|(wall, behind)| (f64::from(z[wall]) - f64::from(z[behind])).abs())
        .collect();
    stats::quantile(&steps, STEP_QUANTILE).unwrap_or(0.0)
}

/// Cells that share a side or a corner with one.
fn around(heights: &Raster<f32>, cell: usize) -> impl Iterator<Item = usize> + use<> {
    let (width, height) = (heights.width(), heights.height());
    let (col, row) = (cell % width, cell / width);
    let rows = row.saturating_sub(1)..=(row + 1).min(height - 1);
    rows.flat_map(move |r| (col.saturating_sub(1)..=(col + 1).min(width - 1)).map(move |c| r * width + c))
        .filter(move |&beside| beside != cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    const METRES: HeightCells = HeightCells { unit_m: 1.0, cell_m: 1.0 };

    /// 40 × 40 cells of ground that rises by 5 cm per cell eastwards, with `floor` where `is_floor`.
    fn ground(floor: f32, is_floor: impl Fn(usize, usize) -> bool) -> Raster<f32> {
        let z = |col: usize, row: usize| if is_floor(col, row) { floor } else { 24.0 + 0.05 * col as f32 };
        Raster::from_vec(
            40,
            40,
            (0..40).flat_map(|row| (0..40).map(move |col| (col, row))).map(|(c, r)| z(c, r)).collect(),
        )
        .unwrap()
    }

    fn house(col: usize, row: usize, at: (usize, usize)) -> bool {
        (at.0..at.0 + 6).contains(&col) && (at.1..at.1 + 4).contains(&row)
    }

    fn n_blank(heights: &Raster<f32>) -> usize {
        heights.data().iter().filter(|z| z.is_nan()).count()
    }

    #[test]
    fn what_no_ground_has_is_a_void_in_every_unit() {
        for (value, unit_m) in
            [(-9999.0, 1.0), (-9999.0, 0.3048), (-32767.0, 1.0), (-3.4e38, 1.0), (1e20, 1.0), (9999.0, 1.0)]
        {
            let (mut voids, counted) = (Voids::default(), HeightCells { unit_m, ..METRES });
            let mut heights = ground(value, |col, row| house(col, row, (10, 10)));
            voids.blank(&mut heights, counted);
            assert_eq!(n_blank(&heights), 24, "{value}");
            let issues = voids.issues(Path::new("dtm.tif"), counted);
            let message = &issues[0].message;
            assert!(issues.len() == 1 && message.starts_with(&format!("24 cells hold {},", shown(value))), "{message}");
        }
        // Denver in feet.
        let mut denver = ground(9_800.0, |_, _| true);
        Voids::default().blank(&mut denver, HeightCells { unit_m: 0.3048, ..METRES });
        assert_eq!(n_blank(&denver), 0);
    }

    #[test]
    fn floors_of_one_value_under_houses_are_voids() {
        let two = |col, row| house(col, row, (5, 5)) || house(col, row, (20, 25));
        let one = |col, row| house(col, row, (5, 5));
        // Beside them one that the edge of the file cuts.
        let and_a_cut_one = |col, row| two(col, row) || house(col, row, (36, 0));
        let blank = |floor: f32, is_floor: &dyn Fn(usize, usize) -> bool| {
            let (mut voids, mut heights) = (Voids::default(), ground(floor, is_floor));
            voids.blank(&mut heights, METRES);
            (n_blank(&heights), voids.issues(Path::new("dtm.tif"), METRES))
        };
        assert_eq!(blank(6.0, &two).0, 48);
        assert_eq!(blank(6.0, &and_a_cut_one).0, 48 + 16);
        assert_eq!(blank(0.0, &one).0, 24);
        assert_eq!(blank(6.0, &one).0, 0, "one floor of 6 m may be a dock");
        let issues = blank(0.0, &two).1;
        assert_eq!(
            (issues.len(), issues[0].severity, issues[0].code.as_str()),
            (1, Severity::Warning, "terrain_filled_in")
        );
        assert!(
            issues[0].message.starts_with("48 cells in 2 patches hold exactly 0, at least 24.2 m below"),
            "{issues:?}"
        );
    }

    #[test]
    fn water_terraces_and_whole_metres_are_ground() {
        let kept = |heights: Raster<f32>, what: &str| {
            let (mut voids, mut blanked) = (Voids::default(), heights.clone());
            voids.blank(&mut blanked, METRES);
            assert_eq!((n_blank(&blanked), voids.issues(Path::new("dtm.tif"), METRES).len()), (0, 0), "{what}");
        };
        let at = |f: &dyn Fn(f64, f64) -> f64| {
            let cells = (0..40).flat_map(|row| (0..40).map(move |col| (f64::from(col), f64::from(row))));
            Raster::from_vec(40, 40, cells.map(|(x, y)| f(x, y) as f32).collect()).unwrap()
        };
        let lake = |x: f64, y: f64| (x - 10.0).hypot(y - 20.0).min((x - 30.0).hypot(y - 20.0)) - 6.0;
        kept(at(&|x, y| 10.0 + 0.8 * lake(x, y).max(0.0)), "two lakes of one level in a hollow");
        kept(at(&|x, y| 10.0 + 4.0 * lake(x, y).max(0.0)), "two lakes between rocks");
        kept(at(&|x, y| if lake(x, y) < 0.0 { 10.0 } else { 12.5 }), "two basins with quays");
        kept(at(&|x, _| 10.0 + 4.0 * (x / 8.0).floor()), "terraces of whole metres");
        kept(at(&|x, y| (30.0 + 25.0 * (x / 4.0).sin() * (y / 3.0).cos()).round()), "mountains in whole metres");
        kept(at(&|_, _| 0.0), "the sea");
    }

    #[test]
    fn a_wall_is_no_steeper_than_a_coarse_cell_makes_any_bank() {
        let two = |col, row| house(col, row, (5, 5)) || house(col, row, (20, 25));
        let mut coarse = ground(6.0, two);
        Voids::default().blank(&mut coarse, HeightCells { cell_m: 30.0, ..METRES });
        assert_eq!(n_blank(&coarse), 0);
    }
}
