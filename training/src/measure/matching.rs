//! Which instances of a photo are the same building.

use std::collections::BTreeMap;

use sizeup_heights::raster::Raster;

use crate::dataset::labels::UNKNOWN;

/// Least intersection over union of a pair.
const SAME: f64 = 0.5;

/// One photo's instances.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Counts {
    /// Buildings on the ground.
    pub n_true: usize,
    /// Instances found.
    pub n_found: usize,
    /// Pairs.
    pub n_pairs: usize,
    /// Sum of the pairs' intersections over union.
    pub iou_of_pairs: f64,
    /// Pixels of a building in both, and in either.
    pub overlap_px: (usize, usize),
}

impl Counts {
    /// Of all buildings' pixels; 1 where there are none in either.
    #[must_use]
    pub fn iou(&self) -> f64 {
        share(self.overlap_px.0, self.overlap_px.1)
    }

    /// Share of what was found that is a building; 1 where nothing was.
    #[must_use]
    pub fn precision(&self) -> f64 {
        share(self.n_pairs, self.n_found)
    }

    /// Share of the buildings that were found; 1 where there are none.
    #[must_use]
    pub fn recall(&self) -> f64 {
        share(self.n_pairs, self.n_true)
    }

    /// Harmonic mean of both.
    #[must_use]
    pub fn f1(&self) -> f64 {
        share(2 * self.n_pairs, self.n_found + self.n_true)
    }
}

fn share(part: usize, whole: usize) -> f64 {
    if whole == 0 { 1.0 } else { part as f64 / whole as f64 }
}

/// Compares labels of the same size; unknown pixels count for nothing, nor do instances below `least_px`.
#[must_use]
pub fn compare(truth: &Raster<u16>, found: &Raster<u32>, least_px: usize) -> Counts {
    let mut areas: (BTreeMap<u16, usize>, BTreeMap<u32, usize>) = Default::default();
    let mut common: BTreeMap<(u16, u32), usize> = BTreeMap::new();
    let mut counts = Counts::default();
    for (&t, &f) in truth.data().iter().zip(found.data()).filter(|(t, _)| **t != UNKNOWN) {
        if t != 0 {
            *areas.0.entry(t).or_default() += 1;
        }
        if f != 0 {
            *areas.1.entry(f).or_default() += 1;
        }
        if t != 0 && f != 0 {
            *common.entry((t, f)).or_default() += 1;
        }
        counts.overlap_px.0 += usize::from(t != 0 && f != 0);
        counts.overlap_px.1 += usize::from(t != 0 || f != 0);
    }
    areas.0.retain(|_, n| *n >= least_px);
    areas.1.retain(|_, n| *n >= least_px);
    (counts.n_true, counts.n_found) = (areas.0.len(), areas.1.len());
    for ((t, f), both) in common {
        let (Some(of_t), Some(of_f)) = (areas.0.get(&t), areas.1.get(&f)) else { continue };
        let iou = both as f64 / (of_t + of_f - both) as f64;
        // Above a half there is no second partner; at exactly a half there may be two, and the first is taken.
        if iou > SAME {
            counts.n_pairs += 1;
            counts.iou_of_pairs += iou;
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two houses side by side found as one, one found half a house to the right, one found well, and one unknown.
    #[test]
    fn pairs_are_what_overlaps_by_more_than_half() {
        let truth = |i: usize| match i % 40 {
            0..4 => 1,
            4..8 => 2,
            12..16 => 3,
            20..30 => 4,
            34..40 => UNKNOWN,
            _ => 0,
        };
        let found = |i: usize| match i % 40 {
            0..8 => 1,
            14..18 => 2,
            21..31 => 3,
            35..39 => 9,
            _ => 0,
        };
        let labels = Raster::from_vec(40, 4, (0..160).map(truth).collect()).unwrap();
        let counts = compare(&labels, &Raster::from_vec(40, 4, (0..160).map(found).collect()).unwrap(), 4);
        assert_eq!((counts.n_true, counts.n_found, counts.n_pairs), (4, 3, 1));
        assert!((counts.iou_of_pairs - 9.0 / 11.0).abs() < 1e-12);
        assert!((counts.iou() - 19.0 / 25.0).abs() < 1e-12);
        assert!((counts.f1() - 2.0 / 7.0).abs() < 1e-12);
    }
}
