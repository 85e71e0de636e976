//! How much of each cell of a grid a polygon covers, exactly.
//!
//! ```text
//! coverage(cell) = area(polygon ∩ cell) / area(cell)
//! ```
//!
//! Every edge is cut at the rows and columns it crosses. A piece that falls by `dy` at mean position `x` within its
//! column covers `dy · (1 − x)` of its own cell and `dy` of every cell to the right of it; the running sum along a row
//! then is the coverage (Green's theorem, cell by cell). Costs one step per crossed cell and one per cell of the window.
//! Frame: map; row 0 of a window is the *southernmost*.

use geo_types::{Coord, MultiPolygon};

use super::clearance::rings;

/// Squares of a grid that all windows share: cell `(i, j)` spans `cell_m · [i, i + 1] × cell_m · [j, j + 1]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GridWindow {
    /// First column of the shared grid.
    pub first_col: i64,
    /// First (southernmost) row of the shared grid.
    pub first_row: i64,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Side of a cell, metres.
    pub cell_m: f64,
}

impl GridWindow {
    /// The smallest one around a box, with so many cells more on every side.
    pub(super) fn around(low: [f64; 2], high: [f64; 2], cell_m: f64, margin: i64) -> Self {
        let first = |v: f64| (v / cell_m).floor() as i64 - margin;
        let after = |v: f64| (v / cell_m).ceil() as i64 + margin;
        let [first_col, first_row] = low.map(first);
        let [after_col, after_row] = high.map(after);
        let n = |from: i64, to: i64| usize::try_from(to - from).unwrap_or(0).max(1);
        Self { first_col, first_row, width: n(first_col, after_col), height: n(first_row, after_row), cell_m }
    }

    /// Number of cells, columns times rows.
    pub(super) fn len(&self) -> usize {
        self.width * self.height
    }

    /// A map position in cells from the window's south-western corner.
    fn in_cells(&self, at: Coord<f64>) -> [f64; 2] {
        [at.x / self.cell_m - self.first_col as f64, at.y / self.cell_m - self.first_row as f64]
    }
}

/// Room for the running sums, kept between calls.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    steps: Vec<f32>,
}

/// Writes the coverage of polygons (exteriors counter-clockwise, holes clockwise; disjoint) into `cover`, row-major
/// from the south-west.
pub(super) fn cover(shape: &MultiPolygon<f64>, window: &GridWindow, scratch: &mut Scratch, cover: &mut Vec<f32>) {
    // Two more columns take what lies to the right of the window.
    let stride = window.width + 2;
    scratch.steps.clear();
    scratch.steps.resize(stride * window.height, 0.0);
    for ring in shape.0.iter().flat_map(rings) {
        for line in ring.lines() {
            edge(window.in_cells(line.start), window.in_cells(line.end), window, &mut scratch.steps);
        }
    }
    cover.resize(window.len(), 0.0);
    for (row, covered) in scratch.steps.chunks_exact(stride).zip(cover.chunks_exact_mut(window.width)) {
        let mut sum = 0.0;
        for (covered, step) in covered.iter_mut().zip(row) {
            sum += step;
            // Rounding leaves a few millionths beside the polygon.
            *covered = if sum > 1e-5 { sum.min(1.0) } else { 0.0 };
        }
    }
}

/// Adds one edge: pieces between rows, then between columns.
fn edge(from: [f64; 2], to: [f64; 2], window: &GridWindow, steps: &mut [f32]) {
    if from[1] == to[1] {
        return;
    }
    // Falling edges have the polygon on their right: they add.
    let (low, high, sign) = if from[1] > to[1] { (to, from, 1.0) } else { (from, to, -1.0) };
    let slope = (high[0] - low[0]) / (high[1] - low[1]);
    let (bottom, top) = (low[1].max(0.0), high[1].min(window.height as f64));
    if bottom >= top {
        return;
    }
    let width = window.width as f64;
    let x_at = |y: f64| low[0] + slope * (y - low[1]);
    let mut y = bottom;
    let mut row = bottom as usize;
    while y < top {
        let next = ((row + 1) as f64).min(top);
        let steps = &mut steps[row * (window.width + 2)..][..window.width + 2];
        span(x_at(y), x_at(next), sign * (next - y), width, steps);
        y = next;
        row += 1;
    }
}

/// Adds a piece within one row that runs from `x0` to `x1` over the signed height `dy`.
fn span(x0: f64, x1: f64, dy: f64, width: f64, steps: &mut [f32]) {
    let (left, right) = (x0.min(x1), x0.max(x1));
    if right <= 0.0 {
        steps[0] += dy as f32;
        return;
    }
    if left >= width {
        return;
    }
    let per_x = if right > left { dy / (right - left) } else { 0.0 };
    let mut x = left;
    if left < 0.0 {
        steps[0] += (per_x * -left) as f32;
        x = 0.0;
    }
    let mut rest = if right > left { per_x * (right - x) } else { dy };
    loop {
        let col = x as usize;
        let next = ((col + 1) as f64).min(right);
        let piece = if next >= right { rest } else { per_x * (next - x) };
        let mean = 0.5 * (x + next) - col as f64;
        steps[col] += (piece * (1.0 - mean)) as f32;
        steps[col + 1] += (piece * mean) as f32;
        rest -= piece;
        x = next;
        if x >= right || x >= width {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use geo::{Area as _, BooleanOps as _};
    use geo_types::polygon;
    use proptest::prelude::*;

    use geo_types::Polygon;

    use super::*;

    fn covered(shape: &Polygon<f64>, window: &GridWindow) -> Vec<f32> {
        let mut found = Vec::new();
        cover(&MultiPolygon::new(vec![shape.clone()]), window, &mut Scratch::default(), &mut found);
        found
    }

    fn cell(window: &GridWindow, col: usize, row: usize) -> Polygon<f64> {
        let low = |first: i64, i: usize| (first as f64 + i as f64) * window.cell_m;
        let (w, s) = (low(window.first_col, col), low(window.first_row, row));
        let (e, n) = (w + window.cell_m, s + window.cell_m);
        polygon![(x: w, y: s), (x: e, y: s), (x: e, y: n), (x: w, y: n)]
    }

    proptest! {
        /// Against polygon overlay, cell by cell, for triangles that may leave the window on any side.
        #[test]
        fn coverage_is_the_overlap_with_each_cell(corners in prop::collection::vec((-2.0..8.0_f64, -2.0..8.0_f64), 3)) {
            let window = GridWindow::around([0.3, 0.4], [5.2, 6.1], 0.5, 0);
            let mut triangle = Polygon::new(corners.into_iter().collect(), vec![]);
            if triangle.signed_area() < 0.0 {
                triangle = Polygon::new(triangle.exterior().0.iter().rev().copied().collect(), vec![]);
            }
            prop_assume!(triangle.unsigned_area() > 0.01);
            let found = covered(&triangle, &window);
            for row in 0..window.height {
                for col in 0..window.width {
                    let cell = cell(&window, col, row);
                    let expected = triangle.intersection(&cell).unsigned_area() / 0.25;
                    let found = f64::from(found[row * window.width + col]);
                    prop_assert!((found - expected).abs() < 1e-4, "{col} {row}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_courtyard_is_not_covered() {
        let house = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 4.0, y: 0.0), (x: 4.0, y: 4.0), (x: 0.0, y: 4.0)],
            interiors: [[(x: 1.0, y: 1.0), (x: 1.0, y: 3.0), (x: 3.0, y: 3.0), (x: 3.0, y: 1.0)]],
        );
        let window = GridWindow::around([0.0, 0.0], [4.0, 4.0], 1.0, 1);
        let found = covered(&house, &window);
        assert_eq!(found.iter().sum::<f32>(), 12.0);
        assert_eq!(found[3 * window.width + 3], 0.0);
        assert_eq!(found[3 * window.width + 4], 1.0);
    }
}
