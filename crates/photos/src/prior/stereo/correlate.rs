//! Zero-mean normalised cross-correlation between a view and a neighbour seen through one plane, a tile at a time.
//!
//! Over a window around a pixel, with the view's brightness `a`, the neighbour's `b`:
//!
//! ```text
//! s = (mean(ab) − mean(a)·mean(b)) / sqrt(var(a)·var(b))
//! ```
//!
//! The innermost loops run along rows of plain arrays, without cases, so that the compiler uses the processor's vectors.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined where the processor's registers are known is not made for them"
)]

use std::ops::Range;

use fearless_simd::{Level, dispatch};
use glam::{DMat3, DVec3};

use sizeup_heights::raster::Raster;

/// Cost of a full mismatch, or of a level that no neighbour can see.
pub(super) const WORST: u8 = 255;
/// Variance below which a window has no texture to compare, grey levels².
pub(super) const LEAST_VARIANCE: f32 = 0.05;

/// A neighbour's brightness, ready for interpolation: per pixel its value, what it changes by to the right and
/// downwards, and what is left diagonally. One read per lookup instead of four.
#[derive(Debug)]
pub(super) struct NeighbourImage {
    width: usize,
    height: usize,
    corners: Vec<[f32; 4]>,
}

impl NeighbourImage {
    pub(super) fn new(grey: &Raster<f32>) -> Self {
        let (width, height) = (grey.width(), grey.height());
        let corner = |i: usize| {
            let (col, row) = (i % width, i / width);
            let at = |dx: usize, dy: usize| grey[((col + dx).min(width - 1), (row + dy).min(height - 1))];
            let (a, b, c, d) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
            [a, b - a, c - a, (d - c) - (b - a)]
        };
        Self { width, height, corners: (0..width * height).map(corner).collect() }
    }

    /// Last column and row; brightness is known before them.
    pub(super) fn last(&self) -> (f32, f32) {
        (self.width as f32 - 1.0, self.height as f32 - 1.0)
    }

    /// Brightness between pixels, in cells from the first one's centre, from 0 to less than the last.
    #[inline(always)]
    pub(super) fn at(&self, x: f32, y: f32) -> f32 {
        let (col, row) = (x as i32, y as i32);
        let (fx, fy) = (x - col as f32, y - row as f32);
        let [here, right, below, diagonal] = self.corners[row as usize * self.width + col as usize];
        here + fx * right + fy * (below + fx * diagonal)
    }
}

/// Windows of a view that every comparison with it needs.
#[derive(Debug)]
pub(super) struct Windows<'a> {
    grey: &'a Raster<f32>,
    radius_px: usize,
    /// Mean over each pixel's window.
    mean: Vec<f32>,
    /// One by the standard deviation over it; 0 where there is no texture.
    per_deviation: Vec<f32>,
    /// Columns in the window, as a factor: `1 / n`.
    per_columns: Vec<f32>,
}

impl<'a> Windows<'a> {
    pub(super) fn new(grey: &'a Raster<f32>, radius_px: usize) -> Self {
        let (width, height) = (grey.width(), grey.height());
        let per = |i: usize, n: usize| 1.0 / span(i, radius_px, n).len() as f32;
        let per_columns: Vec<f32> = (0..width).map(|col| per(col, width)).collect();
        let squares: Vec<f32> = grey.data().iter().map(|v| v * v).collect();
        let mut sums = [vec![0.0; width * height], vec![0.0; width * height]];
        for (values, sums) in [grey.data(), &squares].into_iter().zip(&mut sums) {
            for (row, sums) in values.chunks_exact(width).zip(sums.chunks_exact_mut(width)) {
                sum_along_row(row, radius_px, sums);
            }
        }
        let (mut mean, mut per_deviation) = (Vec::with_capacity(width * height), Vec::with_capacity(width * height));
        let mut down = [vec![0.0; width], vec![0.0; width]];
        for row in 0..height {
            let rows = span(row, radius_px, height);
            for (sums, down) in sums.iter().zip(&mut down) {
                sum_rows(&sums[rows.start * width..rows.end * width], down);
            }
            let per_rows = per(row, height);
            for col in 0..width {
                let m = down[0][col] * per_rows * per_columns[col];
                let variance = down[1][col] * per_rows * per_columns[col] - m * m;
                mean.push(m);
                per_deviation.push(if variance < LEAST_VARIANCE { 0.0 } else { 1.0 / variance.sqrt() });
            }
        }
        Self { grey, radius_px, mean, per_deviation, per_columns }
    }
}

/// Rows or columns of a window around `i`, cut off at the border.
fn span(i: usize, radius: usize, n: usize) -> Range<usize> {
    i.saturating_sub(radius)..(i + radius + 1).min(n)
}

/// Sum over a window along a row, cut off at its ends. Plain sums: they vectorise, and nothing accumulates.
#[inline(always)]
fn sum_along_row(row: &[f32], radius: usize, sums: &mut [f32]) {
    let width = row.len();
    let inside = radius.min(width)..width.saturating_sub(radius).max(radius.min(width));
    if inside.is_empty() {
        (0..width).for_each(|col| sums[col] = row[span(col, radius, width)].iter().sum());
        return;
    }
    for col in (0..inside.start).chain(inside.end..width) {
        sums[col] = row[span(col, radius, width)].iter().sum();
    }
    let sums = &mut sums[inside];
    match radius {
        1 => sum_of::<3>(row, sums),
        2 => sum_of::<5>(row, sums),
        3 => sum_of::<7>(row, sums),
        4 => sum_of::<9>(row, sums),
        5 => sum_of::<11>(row, sums),
        6 => sum_of::<13>(row, sums),
        7 => sum_of::<15>(row, sums),
        _ => sums.iter_mut().enumerate().for_each(|(i, sum)| *sum = row[i..=i + 2 * radius].iter().sum()),
    }
}

/// Sum of the `N` values from each one on: one pass, all in registers.
#[inline(always)]
fn sum_of<const N: usize>(row: &[f32], sums: &mut [f32]) {
    let n = sums.len();
    let shifted: [&[f32]; N] = std::array::from_fn(|k| &row[k..k + n]);
    for i in 0..n {
        let mut sum = 0.0;
        for shifted in &shifted {
            sum += shifted[i];
        }
        sums[i] = sum;
    }
}

/// Sum over whole rows.
#[inline(always)]
fn sum_rows(rows: &[f32], sums: &mut [f32]) {
    sums.fill(0.0);
    for row in rows.chunks_exact(sums.len()) {
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum += value;
        }
    }
}

/// A rectangle of a view, and how well its neighbours agree with it at one level.
#[derive(Debug)]
pub(super) struct CorrelationTile<'a> {
    level: Level,
    view: &'a Windows<'a>,
    rows: Range<usize>,
    cols: Range<usize>,
    /// The rows and columns that their windows reach.
    row_reach: Range<usize>,
    col_reach: Range<usize>,
    /// Best correlations so far, best first, `rank × pixel`: as many as can count.
    best: Vec<Vec<f32>>,
    /// Number of neighbours that see a pixel.
    n_seen: Vec<f32>,
    warp: Warp,
    /// Sums of `b`, `b²` and `a·b` along the rows within reach.
    along: [Vec<f32>; 3],
    /// The columns that the neighbour sees, per row within reach, counted from the first within reach.
    seen: Vec<Range<usize>>,
}

impl<'a> CorrelationTile<'a> {
    pub(super) fn new(view: &'a Windows<'a>, rows: Range<usize>, cols: Range<usize>, n_neighbours: usize) -> Self {
        let (width, height) = (view.grey.width(), view.grey.height());
        let reach = |part: &Range<usize>, n: usize| {
            part.start.saturating_sub(view.radius_px)..(part.end + view.radius_px).min(n)
        };
        let (row_reach, col_reach) = (reach(&rows, height), reach(&cols, width));
        let along = || vec![0.0; row_reach.len() * col_reach.len()];
        let n_pixels = rows.len() * cols.len();
        Self {
            level: Level::new(),
            view,
            best: vec![vec![0.0; n_pixels]; n_neighbours.div_ceil(2)],
            n_seen: vec![0.0; n_pixels],
            warp: Warp::new(col_reach.clone()),
            along: [along(), along(), along()],
            seen: vec![0..0; row_reach.len()],
            rows,
            cols,
            row_reach,
            col_reach,
        }
    }

    /// Ready for the next level.
    pub(super) fn forget(&mut self) {
        self.n_seen.fill(0.0);
        for best in &mut self.best {
            best.fill(-1.0);
        }
    }

    /// Takes in how well a neighbour agrees, seen through a plane: `homography` leads from the view's pixels to its.
    pub(super) fn compare(&mut self, neighbour: &NeighbourImage, homography: &DMat3) {
        dispatch!(self.level, _simd => self.compare_wide(neighbour, homography));
    }

    /// With whatever registers the caller was made for.
    #[inline(always)]
    fn compare_wide(&mut self, neighbour: &NeighbourImage, homography: &DMat3) {
        let (width, n_cols, radius_px) = (self.view.grey.width(), self.col_reach.len(), self.view.radius_px);
        for (i, row) in self.row_reach.clone().enumerate() {
            self.seen[i] = self.warp.look(neighbour, homography, row);
            let a = &self.view.grey.data()[row * width + self.col_reach.start..][..n_cols];
            let Warp { values: b, products, .. } = &mut self.warp;
            let [of_b, of_squares, of_products] = &mut self.along;
            let part = i * n_cols..(i + 1) * n_cols;
            sum_along_row(b, radius_px, &mut of_b[part.clone()]);
            products.iter_mut().zip(&*b).for_each(|(p, b)| *p = b * b);
            sum_along_row(products, radius_px, &mut of_squares[part.clone()]);
            products.iter_mut().zip(&*b).zip(a).for_each(|((p, b), a)| *p = a * b);
            sum_along_row(products, radius_px, &mut of_products[part]);
        }
        for row in self.rows.clone() {
            self.take_in(row);
        }
    }

    /// Correlations of one row, sorted in among the best of their pixels.
    #[inline(always)]
    fn take_in(&mut self, row: usize) {
        let Self { view, warp, along, .. } = self;
        let (width, height) = (view.grey.width(), view.grey.height());
        let rows = span(row, view.radius_px, height);
        let (n_cols, n_wide) = (self.cols.len(), self.col_reach.len());
        let per_rows = 1.0 / rows.len() as f32;
        let reached = (rows.start - self.row_reach.start) * n_wide..(rows.end - self.row_reach.start) * n_wide;
        for (sums, along) in warp.sums.iter_mut().zip(along) {
            sum_rows(&along[reached.clone()], sums);
        }
        let first_col = self.cols.start - self.col_reach.start;
        let [of_b, of_squares, of_products] = warp.sums.each_ref().map(|sums| &sums[first_col..][..n_cols]);
        let of_view = row * width + self.cols.start;
        let (mean_a, per_deviation) = (&view.mean[of_view..][..n_cols], &view.per_deviation[of_view..][..n_cols]);
        let per_columns = &view.per_columns[self.cols.clone()];
        let scores = &mut warp.values[..n_cols];
        for col in 0..n_cols {
            let per_pixels = per_rows * per_columns[col];
            let mean = of_b[col] * per_pixels;
            let variance = of_squares[col] * per_pixels - mean * mean;
            let covariance = of_products[col] * per_pixels - mean * mean_a[col];
            let score = covariance * per_deviation[col] / variance.max(LEAST_VARIANCE).sqrt();
            scores[col] = if variance < LEAST_VARIANCE { 0.0 } else { score.clamp(-1.0, 1.0) };
        }
        let seen = &self.seen[row - self.row_reach.start];
        let seen = seen.start.max(first_col) - first_col..seen.end.min(first_col + n_cols).max(first_col) - first_col;
        if seen.is_empty() {
            return;
        }
        let first = (row - self.rows.start) * n_cols;
        let part = first + seen.start..first + seen.end;
        let scores = &mut scores[seen];
        self.n_seen[part.clone()].iter_mut().for_each(|n| *n += 1.0);
        for best in &mut self.best {
            for (best, score) in best[part.clone()].iter_mut().zip(&mut *scores) {
                let (better, worse) = if *score > *best { (*score, *best) } else { (*best, *score) };
                (*best, *score) = (better, worse);
            }
        }
    }

    /// Votes of the neighbours on each pixel of the tile at the level, row by row.
    pub(super) fn votes(&self) -> impl Iterator<Item = NeighbourVote> + '_ {
        let mut sums = vec![0.0_f32; self.n_seen.len()];
        for (rank, best) in self.best.iter().enumerate() {
            for ((sum, score), n) in sums.iter_mut().zip(best).zip(&self.n_seen) {
                *sum += if rank as f32 * 2.0 < *n { *score } else { 0.0 };
            }
        }
        sums.into_iter().zip(&self.n_seen).map(|(sum, n)| NeighbourVote { sum, n_seen: *n as u8 })
    }
}

/// Vote of the neighbours on a pixel at a level.
#[derive(Debug, Clone, Copy)]
pub(super) struct NeighbourVote {
    /// Sum of the better half of the correlations.
    sum: f32,
    /// Number of neighbours that see it.
    pub n_seen: u8,
}

impl NeighbourVote {
    /// Cost of the level: the mean of the better half of the correlations, turned round. `n_most` neighbours count, those
    /// that see the pixel at this level or more; the others agree with nothing.
    pub(super) fn cost(self, n_most: u8) -> u8 {
        if self.n_seen == 0 {
            return WORST;
        }
        ((1.0 - self.sum / f32::from(n_most.div_ceil(2))) * (0.5 * f32::from(WORST)) + 0.5) as u8
    }
}

/// Correlation that a cost stands for: the inverse of [`NeighbourVote::cost`].
pub(super) fn score(cost: u8) -> f64 {
    1.0 - 2.0 * f64::from(cost) / f64::from(WORST)
}

/// One row of the view as a neighbour sees it, and room to work with it.
#[derive(Debug)]
struct Warp {
    /// Column numbers as they are computed with.
    columns: Vec<f32>,
    x: Vec<f32>,
    y: Vec<f32>,
    /// The neighbour's brightness; 0 where it does not look.
    values: Vec<f32>,
    products: Vec<f32>,
    sums: [Vec<f32>; 3],
}

impl Warp {
    fn new(cols: Range<usize>) -> Self {
        let room = || vec![0.0; cols.len()];
        Self {
            columns: cols.clone().map(|col| col as f32).collect(),
            x: room(),
            y: room(),
            values: room(),
            products: room(),
            sums: [room(), room(), room()],
        }
    }

    /// Looks up a row; the columns that the neighbour sees.
    #[inline(always)]
    fn look(&mut self, neighbour: &NeighbourImage, homography: &DMat3, row: usize) -> Range<usize> {
        let seen = self.place(neighbour, homography, row);
        self.values[..seen.start].fill(0.0);
        self.values[seen.end..].fill(0.0);
        let positions = self.x[seen.clone()].iter().zip(&self.y[seen.clone()]);
        for (value, (x, y)) in self.values[seen.clone()].iter_mut().zip(positions) {
            *value = neighbour.at(*x, *y);
        }
        seen
    }

    /// Places of the row's pixels in the neighbour, in cells from the first one's centre. A plane's horizon aside, what
    /// it sees of a line is one stretch.
    #[inline(always)]
    fn place(&mut self, neighbour: &NeighbourImage, homography: &DMat3, row: usize) -> Range<usize> {
        let start = *homography * DVec3::new(0.5, row as f64 + 0.5, 1.0);
        let step = homography.col(0);
        // Scaled so that single precision holds a thousandth of a pixel anywhere in the row.
        let scale =
            1.0 / start.z.abs().max((start.z + step.z * f64::from(self.columns[self.columns.len() - 1] + 1.0)).abs());
        let (p, s) = ((start * scale).as_vec3(), (step * scale).as_vec3());
        for ((x, y), col) in self.x.iter_mut().zip(&mut self.y).zip(&self.columns) {
            let z = p.z + col * s.z;
            // Behind the camera is nowhere.
            let per_z = if z > 0.0 { 1.0 / z } else { f32::NAN };
            *x = (p.x + col * s.x) * per_z - 0.5;
            *y = (p.y + col * s.y) * per_z - 0.5;
        }
        let (last_x, last_y) = neighbour.last();
        let is_seen = |(x, y): (&f32, &f32)| *x >= 0.0 && *y >= 0.0 && *x < last_x && *y < last_y;
        let first = self.x.iter().zip(&self.y).position(is_seen).unwrap_or(0);
        let n = self.x[first..].iter().zip(&self.y[first..]).take_while(|(x, y)| is_seen((x, y))).count();
        first..first + n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Raster<f32> {
        let values = (0..width * height).map(|i| value(i % width, i / width));
        Raster::from_vec(width, height, values.collect()).unwrap()
    }

    /// A grey value without pattern at each pixel.
    fn noise(x: usize, y: usize) -> f32 {
        ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32 - 125.0
    }

    /// As the formula above says, in double precision, pixel by pixel.
    fn expected(a: &Raster<f32>, b: &Raster<f32>, col: usize, row: usize, radius: usize) -> f64 {
        let cells = span(row, radius, a.height())
            .flat_map(|y| span(col, radius, a.width()).map(move |x| (x, y)))
            .map(|at| (f64::from(a[at]), f64::from(b[at])))
            .collect::<Vec<_>>();
        let mean = |f: &dyn Fn(&(f64, f64)) -> f64| cells.iter().map(f).sum::<f64>() / cells.len() as f64;
        let (ma, mb) = (mean(&|c| c.0), mean(&|c| c.1));
        let (va, vb) = (mean(&|c| c.0 * c.0) - ma * ma, mean(&|c| c.1 * c.1) - mb * mb);
        (mean(&|c| c.0 * c.1) - ma * mb) / (va * vb).sqrt()
    }

    #[test]
    fn costs_are_correlations_to_a_255th_also_at_the_border_of_tile_and_picture() {
        let a = grey(33, 21, noise);
        let b = grey(33, 21, |x, y| 0.5 * noise(x, y) + noise(y, x + 3));
        let windows = Windows::new(&a, 2);
        for cols in [0..33, 0..7, 5..30, 29..33] {
            let mut tile = CorrelationTile::new(&windows, 15..21, cols.clone(), 1);
            tile.forget();
            tile.compare(&NeighbourImage::new(&b), &DMat3::IDENTITY);
            let costs: Vec<u8> = tile.votes().map(|vote| vote.cost(1)).collect();
            let at = |col: usize, row: usize| costs[(row - 15) * cols.len() + col - cols.start];
            let places = [(0, 15), (16, 15), (29, 17), (5, 16)];
            for (col, row) in places.into_iter().filter(|(col, _)| cols.contains(col)) {
                let (found, expected) = (score(at(col, row)), expected(&a, &b, col, row, 2));
                assert!((found - expected).abs() < 1.01 / 255.0, "{cols:?} {col} {row}: {found} {expected}");
            }
            // Between four pixels there is none beyond the last centre.
            assert!(!cols.contains(&32) || at(32, 15) == WORST);
            assert_eq!(at(cols.start, 20), WORST);
        }
    }

    #[test]
    fn a_shift_by_half_a_pixel_is_a_mean() {
        let a = grey(20, 9, |x, y| 0.5 * (noise(x, y) + noise(x + 1, y)));
        let windows = Windows::new(&a, 1);
        let mut tile = CorrelationTile::new(&windows, 3..5, 0..20, 1);
        tile.forget();
        let half = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.5, 0.0, 1.0));
        tile.compare(&NeighbourImage::new(&grey(20, 9, noise)), &half);
        let costs: Vec<u8> = tile.votes().map(|vote| vote.cost(1)).collect();
        assert!(costs[2..17].iter().all(|cost| *cost == 0), "{costs:?}");
    }

    #[test]
    fn the_better_half_decides() {
        let cost = |sum: f32, n_seen: u8| NeighbourVote { sum, n_seen }.cost(n_seen);
        assert_eq!(cost(2.0, 4), 0);
        assert_eq!(cost(2.0, 3), 0);
        assert_eq!(cost(-1.0, 1), WORST);
        assert_eq!(cost(0.0, 0), WORST);
        assert!((score(cost(0.5, 2)) - 0.5).abs() < 0.005);
    }

    #[test]
    fn one_neighbour_that_is_left_of_six_counts_for_one_of_the_three_that_would_have_to_agree() {
        let alone = NeighbourVote { sum: 0.9, n_seen: 1 };
        assert!((score(alone.cost(1)) - 0.9).abs() < 0.005);
        assert!((score(alone.cost(6)) - 0.3).abs() < 0.005);
    }
}
