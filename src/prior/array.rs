//! A numeric array out of a file: read with bounds known before anything is allocated.

use crate::raster::Raster;

/// Most values one depth map may have: twice the largest aerial frame camera (450 megapixels).
pub(super) const MAX_VALUES: usize = 1 << 29;

/// One map out of an array of shape `H × W` or a stack of them, `N × H × W`; further dimensions of one are dropped
/// from either end (`1 × 1 × H × W`, `H × W × 1`). Row-major, as stored, nothing blanked yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MapShape {
    /// How many maps.
    pub n: usize,
    /// Rows of each.
    pub height: usize,
    /// Columns of each.
    pub width: usize,
}

impl MapShape {
    /// From an array's shape.
    pub(super) fn of(shape: &[usize]) -> Result<Self, String> {
        let all = shape;
        let shape = shape.strip_suffix(&[1]).filter(|rest| rest.len() >= 2 && !rest.ends_with(&[1])).unwrap_or(shape);
        let n_leading = shape.iter().take_while(|&&n| n == 1).count().min(shape.len().saturating_sub(2));
        let (n, height, width) = match shape[n_leading..] {
            [height, width] => (1, height, width),
            [n, height, width] => (n, height, width),
            _ => return Err(format!("its shape is {all:?}, expected height × width or maps × height × width")),
        };
        let is_sane = height.checked_mul(width).is_some_and(|cells| 0 < cells && cells <= MAX_VALUES);
        if n == 0 || !is_sane {
            return Err(format!("its shape is {all:?}: empty, or more than any camera has pixels"));
        }
        Ok(Self { n, height, width })
    }

    /// Values in one map.
    pub(super) fn cells(&self) -> usize {
        self.height * self.width
    }

    /// The values of one map.
    pub(super) fn raster(&self, values: Vec<f32>) -> Raster<f32> {
        Raster::from_vec(self.width, self.height, values).expect("one value per cell")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_stacks_and_needless_dimensions() {
        let shape = |dims: &[usize]| MapShape::of(dims).map(|s| (s.n, s.height, s.width));
        assert_eq!(shape(&[3, 4]), Ok((1, 3, 4)));
        assert_eq!(shape(&[5, 3, 4]), Ok((5, 3, 4)));
        assert_eq!(shape(&[1, 1, 3, 4]), Ok((1, 3, 4)));
        assert_eq!(shape(&[3, 4, 1]), Ok((1, 3, 4)));
        for bad in [&[][..], &[4], &[0, 4], &[3, 4, 5, 6], &[usize::MAX, 2], &[1 << 20, 1 << 20]] {
            assert!(shape(bad).is_err(), "{bad:?}");
        }
    }
}
