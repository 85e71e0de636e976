//! A plain 2D array: `height × width`, row-major, row 0 on top.

use serde::{Deserialize, Serialize};

/// `height × width` values, row-major. For `f32` maps `NaN` means *no value*, unless the field says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Raster<T> {
    width: usize,
    height: usize,
    data: Vec<T>,
}

impl<T: Clone> Raster<T> {
    /// A raster whose cells all have this value.
    #[must_use]
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }
}

impl<T> Raster<T> {
    /// From row-major data; `None` if the length is not `width · height`.
    #[must_use]
    pub fn from_vec(width: usize, height: usize, data: Vec<T>) -> Option<Self> {
        (data.len() == width * height).then_some(Self { width, height, data })
    }

    /// Number of columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All cells, row-major, row 0 on top.
    #[must_use]
    pub fn data(&self) -> &[T] {
        &self.data
    }

    /// All cells to be changed, row-major, row 0 on top.
    pub fn data_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The cell, or `None` outside.
    #[must_use]
    pub fn get(&self, col: usize, row: usize) -> Option<&T> {
        (col < self.width && row < self.height).then(|| &self.data[row * self.width + col])
    }

    /// Positions in the data of the up to four cells that share a side with one: left, right, above, below.
    pub fn beside(&self, i: usize) -> impl Iterator<Item = usize> + use<T> {
        let (col, row) = (i % self.width, i / self.width);
        [
            (col > 0).then(|| i - 1),
            (col + 1 < self.width).then(|| i + 1),
            (row > 0).then(|| i - self.width),
            (row + 1 < self.height).then(|| i + self.width),
        ]
        .into_iter()
        .flatten()
    }

    /// Every cell through `f`.
    #[must_use]
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Raster<U> {
        Raster { width: self.width, height: self.height, data: self.data.iter().map(f).collect() }
    }
}

impl<T> std::ops::Index<(usize, usize)> for Raster<T> {
    type Output = T;

    /// The cell at `raster[(col, row)]`.
    fn index(&self, (col, row): (usize, usize)) -> &T {
        assert!(col < self.width, "column {col} of a raster {} wide", self.width);
        &self.data[row * self.width + col]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Raster<T> {
    fn index_mut(&mut self, (col, row): (usize, usize)) -> &mut T {
        assert!(col < self.width, "column {col} of a raster {} wide", self.width);
        &mut self.data[row * self.width + col]
    }
}

impl Raster<f32> {
    /// Bilinear value at a position in pixels (first cell's centre at (0.5, 0.5)). `NaN` where any of the four
    /// cells has no value; positions beyond the outermost centres take the border's value; `NaN` outside the raster.
    #[must_use]
    #[inline]
    pub fn bilinear(&self, x_px: f64, y_px: f64) -> f32 {
        if !(x_px >= 0.0 && y_px >= 0.0 && x_px <= self.width as f64 && y_px <= self.height as f64) {
            return f32::NAN;
        }
        let (col, fx) = cell_and_fraction(x_px, self.width);
        let (row, fy) = cell_and_fraction(y_px, self.height);
        let next_col = (col + 1).min(self.width - 1);
        let next_row = (row + 1).min(self.height - 1);
        let (upper, lower) = (&self.data[row * self.width..], &self.data[next_row * self.width..]);
        let top = lerp(upper[col], upper[next_col], fx);
        let bottom = lerp(lower[col], lower[next_col], fx);
        lerp(top, bottom, fy)
    }
}

#[inline]
fn cell_and_fraction(position_px: f64, n_cells: usize) -> (usize, f32) {
    let from_first_centre = (position_px - 0.5).clamp(0.0, (n_cells - 1) as f64);
    // Never negative, so that cutting off rounds down: without a call, which `floor` is on older processors.
    let cell = from_first_centre as u32;
    (cell as usize, (from_first_centre - f64::from(cell)) as f32)
}

/// Exact at the ends, and free of the far end's `NaN` at `t = 0`.
#[inline]
fn lerp(a: f32, b: f32, t: f32) -> f32 {
    if t == 0.0 { a } else { a + (b - a) * t }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_share_sides_with_those_beside_them_and_none_beyond_the_border() {
        let raster = Raster::filled(3, 2, 0_u8);
        let beside = |i: usize| raster.beside(i).collect::<Vec<usize>>();
        assert_eq!([beside(0), beside(4), beside(5)], [vec![1, 3], vec![3, 5, 1], vec![4, 2]]);
    }

    #[test]
    fn bilinear_is_exact_at_centres_and_linear_between() {
        let r = Raster::from_vec(2, 2, vec![0.0_f32, 1.0, 2.0, 3.0]).unwrap();
        assert_eq!(r.bilinear(0.5, 0.5), 0.0);
        assert_eq!(r.bilinear(1.0, 1.0), 1.5);
        assert_eq!(r.bilinear(1.5, 0.5), 1.0);
        assert_eq!(r.bilinear(0.0, 0.0), 0.0);
        assert!(r.bilinear(2.1, 0.5).is_nan());
    }

    #[test]
    fn a_missing_cell_makes_its_neighbourhood_missing() {
        let r = Raster::from_vec(2, 1, vec![1.0_f32, f32::NAN]).unwrap();
        assert_eq!(r.bilinear(0.5, 0.5), 1.0);
        assert!(r.bilinear(0.6, 0.5).is_nan());
    }
}
