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

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use fearless_simd::{Level, dispatch};

use super::correlate;
use super::levels::Levels;
use super::sweep::Volume;
use super::{LARGE_STEP_COST, SMALL_STEP_COST};
use sizeup_heights::raster::Raster;

/// Grey difference at which `P2` has fallen half-way to `P1`.
const EDGE_GREY: f32 = 10.0;

/// The level chosen for each pixel.
#[derive(Debug)]
pub(super) struct Chosen {
    width: usize,
    height: usize,
    /// Level with a fraction, and the correlation there.
    pixels: Vec<(f32, f64)>,
}

impl Chosen {
    /// Heights, metres; `NaN` where the correlation stays below `min_score`.
    pub(super) fn heights_m(&self, levels: &Levels, min_score: f64) -> Raster<f32> {
        let height = |&(level, score): &(f32, f64)| {
            if score < min_score { f32::NAN } else { levels.height_m(f64::from(level)) as f32 }
        };
        Raster::from_vec(self.width, self.height, self.pixels.iter().map(height).collect()).expect("one per pixel")
    }
}

/// Chooses a level for every pixel.
pub(super) fn choose_levels(volume: &Volume, grey: &Raster<f32>) -> Chosen {
    let steps = Steps { small: SMALL_STEP_COST, large: LARGE_STEP_COST, grey };
    let mut sums = vec![0_i16; volume.costs.len()];
    dispatch!(Level::new(), _simd => {
        along_rows(volume, &steps, &mut sums);
        across_rows(volume, &steps, Downwards::Yes, &mut sums);
        across_rows(volume, &steps, Downwards::No, &mut sums);
    });
    let n = volume.n_levels;
    let pixels = sums.chunks_exact(n).zip(volume.costs.chunks_exact(n)).map(|(sums, costs)| {
        let least = sums.iter().copied().fold(i16::MAX, i16::min);
        let best = sums.iter().position(|sum| *sum == least).expect("levels exist");
        (best as f32 + vertex(sums, best), correlate::score(costs[best]))
    });
    Chosen { width: volume.width, height: volume.height, pixels: pixels.collect() }
}

/// Vertex of the parabola through the best level and its neighbours, −0.5 to 0.5 from the best.
fn vertex(sums: &[i16], best: usize) -> f32 {
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

/// Costs of changes of level.
struct Steps<'a> {
    small: i16,
    large: i16,
    grey: &'a Raster<f32>,
}

impl Steps<'_> {
    /// `P2` between two pixels.
    #[inline(always)]
    fn large_between(&self, a: usize, b: usize) -> i16 {
        let contrast = (self.grey.data()[a] - self.grey.data()[b]).abs();
        let above_small = f32::from(self.large - self.small) / (1.0 + contrast / EDGE_GREY);
        self.small + above_small as i16
    }

    /// One step along a path: `L` of a pixel from its costs and the `L` before it, added to the pixel's sums.
    #[inline(always)]
    fn advance(&self, costs: &[u8], before: &Path, large: i16, path: &mut Path, sums: &mut [i16]) {
        let n = costs.len();
        let jump = before.least.saturating_add(large);
        // Slices of one length: the loop then has no checks, and vectorises.
        let (below, same, above) = (&before.costs[..n], &before.costs[1..=n], &before.costs[2..n + 2]);
        let (now, sums) = (&mut path.costs[1..=n], &mut sums[..n]);
        let mut least = i16::MAX;
        for k in 0..n {
            // Saturating: nothing comes near the limits, and plain sums are checked in some builds, which is slow.
            let step = below[k].min(above[k]).saturating_add(self.small);
            let cheapest = same[k].min(step).min(jump).saturating_sub(before.least);
            let l = cheapest.saturating_add(i16::from(costs[k]));
            now[k] = l;
            sums[k] = sums[k].saturating_add(l);
            least = least.min(l);
        }
        path.least = least;
    }
}

/// `L` of one pixel, with a level that does not exist at either end, so that the innermost loop has no cases.
#[derive(Debug, Clone)]
struct Path {
    costs: Vec<i16>,
    least: i16,
}

impl Path {
    /// A level that does not exist: dearer than any path, and far from overflow.
    const NO_LEVEL: i16 = i16::MAX / 2;

    fn new(n_levels: usize) -> Self {
        Self { costs: vec![Self::NO_LEVEL; n_levels + 2], least: 0 }
    }

    /// The first pixel of a path has nothing before it.
    #[inline(always)]
    fn begin(&mut self, costs: &[u8], sums: &mut [i16]) {
        self.least = i16::MAX;
        for ((l, cost), sum) in self.costs[1..].iter_mut().zip(costs).zip(sums) {
            *l = i16::from(*cost);
            *sum += *l;
            self.least = self.least.min(*l);
        }
    }
}

/// The two directions within rows.
#[inline(always)]
fn along_rows(volume: &Volume, steps: &Steps<'_>, sums: &mut [i16]) {
    let (width, n) = (volume.width, volume.n_levels);
    let (mut before, mut path) = (Path::new(n), Path::new(n));
    let mut walk = |row: usize, columns: &mut dyn Iterator<Item = usize>| {
        let mut last: Option<usize> = None;
        for col in columns {
            let pixel = row * width + col;
            let (costs, sums) = (&volume.costs[pixel * n..][..n], &mut sums[pixel * n..][..n]);
            match last {
                Some(last) => steps.advance(costs, &before, steps.large_between(last, pixel), &mut path, sums),
                None => path.begin(costs, sums),
            }
            std::mem::swap(&mut before, &mut path);
            last = Some(pixel);
        }
    };
    for row in 0..volume.height {
        walk(row, &mut (0..width));
        walk(row, &mut (0..width).rev());
    }
}

/// The three directions that come from one side of a row, straight and diagonal, together: a pixel's costs and sums
/// are then touched once.
#[inline(always)]
fn across_rows(volume: &Volume, steps: &Steps<'_>, downwards: Downwards, sums: &mut [i16]) {
    let (width, n) = (volume.width, volume.n_levels);
    let mut before = vec![[Path::new(n), Path::new(n), Path::new(n)]; width];
    let mut paths = before.clone();
    for i in 0..volume.height {
        let (row, last_row) = match downwards {
            Downwards::Yes => (i, i.checked_sub(1)),
            Downwards::No => (volume.height - 1 - i, (i > 0).then(|| volume.height - i)),
        };
        for (col, paths) in paths.iter_mut().enumerate() {
            let pixel = row * width + col;
            let (costs, sums) = (&volume.costs[pixel * n..][..n], &mut sums[pixel * n..][..n]);
            for (direction, path) in paths.iter_mut().enumerate() {
                // From the column before, the same, the next one.
                let last_col = (col + direction).checked_sub(1).filter(|c| *c < width);
                match last_row.zip(last_col) {
                    Some((last_row, last_col)) => {
                        let large = steps.large_between(last_row * width + last_col, pixel);
                        steps.advance(costs, &before[last_col][direction], large, path, sums);
                    }
                    None => path.begin(costs, sums),
                }
            }
        }
        std::mem::swap(&mut before, &mut paths);
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
        choose_levels(&volume, &grey).pixels.iter().map(|p| p.0.round()).collect()
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
