//! Semi-global matching: the level per pixel that fits the pictures and its surroundings.
//!
//! Along each of eight directions `r` (Hirschmüller 2008, equation 13), with the cost `C`, level `k`:
//!
//! ```text
//! L(p, k) = C(p, k) + min( L(p−r, k), L(p−r, k±1) + P1, min_i L(p−r, i) + P2 ) − min_i L(p−r, i)
//! ```
//!
//! Levels are heights, so a level roof or ground costs nothing. `P2` falls across edges of the picture, where heights
//! change. The winner minimises the sum of `L` over the directions; integers, so that order of summation is nothing.

use rayon::prelude::*;

use super::StereoConfig;
use super::sweep::{self, Volume};
use crate::raster::Raster;

/// Grey difference at which `P2` has fallen half-way to `P1`.
const EDGE_GREY: f32 = 10.0;

/// The levels chosen.
#[derive(Debug)]
pub(super) struct Chosen {
    width: usize,
    height: usize,
    /// Level with a fraction, and the correlation there.
    pixels: Vec<(f32, f64)>,
}

impl Chosen {
    /// Heights, metres; `NaN` where the correlation stays below `min_score`.
    pub(super) fn heights_m(&self, levels_m: &[f64], min_score: f64) -> Raster<f32> {
        let step_m = levels_m[1] - levels_m[0];
        let height = |&(level, score): &(f32, f64)| {
            if score < min_score { f32::NAN } else { (levels_m[0] + step_m * f64::from(level)) as f32 }
        };
        Raster::from_vec(self.width, self.height, self.pixels.iter().map(height).collect()).expect("one per pixel")
    }
}

/// Chooses a level for every pixel.
pub(super) fn choose_levels(volume: &Volume, grey: &Raster<f32>, config: &StereoConfig) -> Chosen {
    let steps = Steps { small: config.small_step_cost, large: config.large_step_cost, grey };
    let mut sums = vec![0_u16; volume.costs.len()];
    along_rows(volume, &steps, &mut sums);
    for sideways in [-1, 0, 1] {
        across_rows(volume, &steps, Downwards::Yes, sideways, &mut sums);
        across_rows(volume, &steps, Downwards::No, sideways, &mut sums);
    }
    let n = volume.n_levels;
    let pixels = sums
        .par_chunks_exact(n)
        .zip(volume.costs.par_chunks_exact(n))
        .map(|(sums, costs)| {
            let best = (0..n).min_by_key(|&k| sums[k]).expect("levels exist");
            (best as f32 + vertex(sums, best), sweep::score(costs[best]))
        })
        .collect();
    Chosen { width: volume.width, height: volume.height, pixels }
}

/// Where the parabola through the best level and its neighbours has its vertex, −0.5 to 0.5 from the best.
fn vertex(sums: &[u16], best: usize) -> f32 {
    if best == 0 || best + 1 == sums.len() {
        return 0.0;
    }
    let [a, b, c] = [sums[best - 1], sums[best], sums[best + 1]].map(f32::from);
    let bend = a - 2.0 * b + c;
    if bend <= 0.0 { 0.0 } else { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Downwards {
    Yes,
    No,
}

/// What changes of level cost.
struct Steps<'a> {
    small: u16,
    large: u16,
    grey: &'a Raster<f32>,
}

impl Steps<'_> {
    /// `P2` between two pixels.
    fn large_between(&self, a: usize, b: usize) -> u16 {
        let contrast = (self.grey.data()[a] - self.grey.data()[b]).abs();
        let above_small = f32::from(self.large - self.small) / (1.0 + contrast / EDGE_GREY);
        self.small + above_small as u16
    }

    /// One step along a path: `L` of a pixel from its costs and the `L` before it. Both paths carry one entry more at
    /// either end ([`new_path`]), so that the innermost loop has no cases and vectorises.
    fn advance(&self, costs: &[u8], before: &[u16], large: u16, path: &mut [u16]) {
        let n = costs.len();
        let same = &before[1..=n];
        let least = same.iter().copied().min().unwrap_or(0);
        let jump = least + large;
        let neighbours = before[..n].iter().zip(&before[2..n + 2]);
        for (((l, cost), same), (below, above)) in path[1..=n].iter_mut().zip(costs).zip(same).zip(neighbours) {
            let step = (*below).min(*above) + self.small;
            *l = u16::from(*cost) + ((*same).min(step).min(jump) - least);
        }
    }
}

/// A level that does not exist: dearer than any path, and far from overflow.
const NO_LEVEL: u16 = u16::MAX / 2;

/// Room for `L` of `n_pixels`, each with a level that does not exist at either end.
fn new_path(n_pixels: usize, n_levels: usize) -> Vec<u16> {
    let mut path = vec![0; n_pixels * (n_levels + 2)];
    for pixel in path.chunks_exact_mut(n_levels + 2) {
        pixel[0] = NO_LEVEL;
        pixel[n_levels + 1] = NO_LEVEL;
    }
    path
}

/// The first pixel of a path has nothing before it.
fn begin(costs: &[u8], path: &mut [u16]) {
    for (l, cost) in path[1..].iter_mut().zip(costs) {
        *l = u16::from(*cost);
    }
}

/// The two directions within rows.
fn along_rows(volume: &Volume, steps: &Steps<'_>, sums: &mut [u16]) {
    let (width, n) = (volume.width, volume.n_levels);
    sums.par_chunks_exact_mut(width * n).enumerate().for_each(|(row, sums)| {
        let mut before = new_path(1, n);
        let mut path = new_path(1, n);
        let mut walk = |columns: &mut dyn Iterator<Item = usize>| {
            let mut last: Option<usize> = None;
            for col in columns {
                let pixel = row * width + col;
                let costs = &volume.costs[pixel * n..][..n];
                match last {
                    Some(last) => steps.advance(costs, &before, steps.large_between(last, pixel), &mut path),
                    None => begin(costs, &mut path),
                }
                add(&mut sums[col * n..][..n], &path);
                std::mem::swap(&mut before, &mut path);
                last = Some(pixel);
            }
        };
        walk(&mut (0..width));
        walk(&mut (0..width).rev());
    });
}

/// One direction from row to row, straight (`sideways = 0`) or diagonal.
fn across_rows(volume: &Volume, steps: &Steps<'_>, downwards: Downwards, sideways: isize, sums: &mut [u16]) {
    let (width, n) = (volume.width, volume.n_levels);
    let mut before = new_path(width, n);
    let mut paths = new_path(width, n);
    for i in 0..volume.height {
        let (row, last_row) = match downwards {
            Downwards::Yes => (i, i.checked_sub(1)),
            Downwards::No => (volume.height - 1 - i, (i > 0).then(|| volume.height - i)),
        };
        let row_sums = &mut sums[row * width * n..][..width * n];
        paths.par_chunks_exact_mut(n + 2).zip(row_sums.par_chunks_exact_mut(n)).enumerate().with_min_len(64).for_each(
            |(col, (path, sums))| {
                let pixel = row * width + col;
                let costs = &volume.costs[pixel * n..][..n];
                let last_col = col.checked_add_signed(-sideways).filter(|c| *c < width);
                match last_row.zip(last_col) {
                    Some((last_row, last_col)) => {
                        let large = steps.large_between(last_row * width + last_col, pixel);
                        steps.advance(costs, &before[last_col * (n + 2)..][..n + 2], large, path);
                    }
                    None => begin(costs, path),
                }
                add(sums, path);
            },
        );
        std::mem::swap(&mut before, &mut paths);
    }
}

fn add(sums: &mut [u16], path: &[u16]) {
    for (sum, l) in sums.iter_mut().zip(&path[1..]) {
        *sum += l;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Costs of a row of pixels, `n` levels each.
    fn chosen(costs: &[&[u8]], grey: Vec<f32>) -> Vec<f32> {
        let n_levels = costs[0].len();
        let volume = Volume { width: costs.len(), height: 1, n_levels, costs: costs.concat() };
        let grey = Raster::from_vec(costs.len(), 1, grey).unwrap();
        choose_levels(&volume, &grey, &StereoConfig::default()).pixels.iter().map(|p| p.0.round()).collect()
    }

    #[test]
    fn an_undecided_pixel_follows_its_surroundings() {
        let (sure, undecided) = ([200, 200, 0, 200, 200_u8], [80; 5]);
        assert_eq!(chosen(&[&sure, &undecided, &undecided, &sure], vec![0.0; 4]), [2.0; 4]);
    }

    #[test]
    fn a_step_stays_where_the_pictures_insist() {
        let (low, high) = ([0, 200, 200, 200, 200_u8], [200, 200, 200, 200, 0_u8]);
        assert_eq!(chosen(&[&low, &low, &high, &high], vec![0.0, 0.0, 50.0, 50.0]), [0.0, 0.0, 4.0, 4.0]);
    }
}
