//! A numeric array out of a file: read with bounds known before anything is allocated.

use sizeup_geo::limits;
use sizeup_heights::raster::Raster;

/// Most values of a map that we computed ourselves: twice the largest aerial frame camera (450 megapixels).
pub(super) const MOST: u64 = 1 << 29;
/// Most pixels that a prior may have for each of its photo's: twice as many along each side. It knows no more than the photo,
/// and what is larger than that is another photo's, or damaged.
const MOST_PER_PIXEL: u64 = 4;

/// Most values of a photo's map.
pub(super) fn most_values(width_px: u32, height_px: u32) -> u64 {
    MOST_PER_PIXEL * u64::from(width_px) * u64::from(height_px)
}

/// One map out of an array of shape `H × W` or a stack of them, `N × H × W`; further dimensions of one are dropped
/// from either end (`1 × 1 × H × W`, `H × W × 1`). Row-major, as stored, nothing blanked yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MapShape {
    /// Number of maps in the array.
    pub n: usize,
    /// Rows of each map.
    pub height: usize,
    /// Columns of each map.
    pub width: usize,
}

impl MapShape {
    /// From an array's shape; a map of more than `most` values is refused, before anything is taken for it.
    pub(super) fn of(shape: &[usize], most: u64) -> Result<Self, String> {
        let all = shape;
        let shape = shape.strip_suffix(&[1]).filter(|rest| rest.len() >= 2 && !rest.ends_with(&[1])).unwrap_or(shape);
        let n_leading = shape.iter().take_while(|&&n| n == 1).count().min(shape.len().saturating_sub(2));
        let (n, height, width) = match shape[n_leading..] {
            [height, width] => (1, height, width),
            [n, height, width] => (n, height, width),
            _ => return Err(format!("its shape is {all:?}, expected height × width or maps × height × width")),
        };
        let is_sane = height.checked_mul(width).is_some_and(|cells| 0 < cells && cells as u64 <= most);
        if n == 0 || !is_sane {
            return Err(format!("its shape is {all:?}: empty, or more than four times the photo's pixels"));
        }
        Ok(Self { n, height, width })
    }

    /// Holds the memory of one map, `each` bytes per value on the way, against what one input may take.
    pub(super) fn check_memory(&self, each: u64) -> Result<(), String> {
        limits::check((self.cells() as u64).saturating_mul(each), None).map_err(|excess| excess.to_string())
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
        let shape = |dims: &[usize]| MapShape::of(dims, 1 << 20).map(|s| (s.n, s.height, s.width));
        assert_eq!(shape(&[3, 4]), Ok((1, 3, 4)));
        assert_eq!(shape(&[5, 3, 4]), Ok((5, 3, 4)));
        assert_eq!(shape(&[1, 1, 3, 4]), Ok((1, 3, 4)));
        assert_eq!(shape(&[3, 4, 1]), Ok((1, 3, 4)));
        for bad in [&[][..], &[4], &[0, 4], &[3, 4, 5, 6], &[usize::MAX, 2], &[1 << 20, 1 << 20]] {
            assert!(shape(bad).is_err(), "{bad:?}");
        }
    }
}
