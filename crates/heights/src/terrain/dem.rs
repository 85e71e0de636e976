//! A digital elevation model on a regular north-up grid.

use crate::raster::Raster;

/// Why a grid cannot be a terrain.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DemError {
    /// Cells without extent, or nothing but nodata.
    #[error("terrain grid of {width} × {height} cells of {cell_x_m} × {cell_y_m} m: {reason}")]
    Unusable {
        /// Number of columns.
        width: usize,
        /// Number of rows.
        height: usize,
        /// Width of a cell, metres.
        cell_x_m: f64,
        /// Height of a cell, metres.
        cell_y_m: f64,
        /// The problem with the grid, in words.
        reason: &'static str,
    },
}

/// Ground heights at cell centres; row 0 is the northernmost. `NaN` = no value.
#[derive(Debug, Clone, PartialEq)]
pub struct Dem {
    heights_m: Raster<f32>,
    /// Map position of the grid's top-left *corner*, metres.
    west_m: f64,
    north_m: f64,
    cell_x_m: f64,
    cell_y_m: f64,
    /// Lowest and highest value: every ray asks for them.
    range_m: (f64, f64),
}

impl Dem {
    /// From heights (row 0 northernmost, `NaN` = no value), the top-left corner and the cell size, all metres.
    ///
    /// # Errors
    /// [`DemError`] for an empty grid, cells without extent, or no value at all.
    pub fn new(
        heights_m: Raster<f32>,
        west_m: f64,
        north_m: f64,
        cell_x_m: f64,
        cell_y_m: f64,
    ) -> Result<Self, DemError> {
        let unusable = |reason| DemError::Unusable {
            width: heights_m.width(),
            height: heights_m.height(),
            cell_x_m,
            cell_y_m,
            reason,
        };
        let is_size = |m: f64| m.is_finite() && m > 0.0;
        if heights_m.data().is_empty() {
            return Err(unusable("it has no cells"));
        }
        if !(is_size(cell_x_m) && is_size(cell_y_m)) {
            return Err(unusable("cells need a positive size"));
        }
        let values = || heights_m.data().iter().copied().filter(|z| !z.is_nan()).map(f64::from);
        let (Some(low), Some(high)) = (values().reduce(f64::min), values().reduce(f64::max)) else {
            return Err(unusable("every cell is nodata"));
        };
        Ok(Self { heights_m, west_m, north_m, cell_x_m, cell_y_m, range_m: (low, high) })
    }

    /// Heights at cell centres, row 0 northernmost.
    #[must_use]
    pub fn heights_m(&self) -> &Raster<f32> {
        &self.heights_m
    }

    /// Map position of the top-left corner: west, north; metres.
    #[must_use]
    pub fn corner_m(&self) -> (f64, f64) {
        (self.west_m, self.north_m)
    }

    /// Cell width and height, metres.
    #[must_use]
    pub fn cell_m(&self) -> (f64, f64) {
        (self.cell_x_m, self.cell_y_m)
    }

    /// Bilinear height, `None` outside the grid or beside nodata.
    #[must_use]
    pub fn height_at(&self, easting_m: f64, northing_m: f64) -> Option<f64> {
        let x = (easting_m - self.west_m) / self.cell_x_m;
        let y = (self.north_m - northing_m) / self.cell_y_m;
        let z = self.heights_m.bilinear(x, y);
        (!z.is_nan()).then_some(f64::from(z))
    }

    /// Lowest and highest value.
    #[must_use]
    pub fn range(&self) -> (f64, f64) {
        self.range_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_reproduced_exactly_between_cell_centres() {
        let plane = |e: f64, n: f64| 10.0 + 0.5 * (e - 100.0) - 0.25 * (n - 200.0);
        // 4 × 3 cells of 2 × 2 m, top-left corner (100, 206).
        let centres =
            (0..3).flat_map(|row| (0..4).map(move |col| (101.0 + 2.0 * col as f64, 205.0 - 2.0 * row as f64)));
        let heights = Raster::from_vec(4, 3, centres.map(|(e, n)| plane(e, n) as f32).collect()).unwrap();
        let dem = Dem::new(heights, 100.0, 206.0, 2.0, 2.0).unwrap();
        for (e, n) in [(101.0, 205.0), (103.7, 202.1), (106.9, 201.1)] {
            assert!((dem.height_at(e, n).unwrap() - plane(e, n)).abs() < 1e-5);
        }
        assert_eq!(dem.height_at(99.0, 203.0), None);
    }
}
