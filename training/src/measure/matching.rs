//! What instances of a photo cover, alone and together.

use std::collections::BTreeMap;

use sizeup_heights::raster::Raster;
use sizeup_truth::evaluate::PhotoAreas;

use crate::dataset::labels::UNKNOWN;

/// Areas of one photo's instances, found and true, and their overlap.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Compared {
    /// Areas of the instances, pixels.
    pub areas: PhotoAreas,
    /// Pixels of a building in both, and in either.
    pub overlap_px: (usize, usize),
}

impl Compared {
    /// Intersection over union of all buildings' pixels; 1 where there are none in either.
    #[must_use]
    pub fn iou_of_pixels(&self) -> f64 {
        let (both, either) = self.overlap_px;
        if either == 0 { 1.0 } else { both as f64 / either as f64 }
    }
}

/// Compares labels of the same size; unknown pixels count for nothing, nor do instances below `least_px`.
#[must_use]
pub fn compare(truth: &Raster<u16>, found: &Raster<u32>, least_px: usize) -> Compared {
    let mut areas: (BTreeMap<u16, usize>, BTreeMap<u32, usize>) = Default::default();
    let mut common: BTreeMap<(u16, u32), usize> = BTreeMap::new();
    let mut compared = Compared::default();
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
        compared.overlap_px.0 += usize::from(t != 0 && f != 0);
        compared.overlap_px.1 += usize::from(t != 0 || f != 0);
    }
    areas.0.retain(|_, n| *n >= least_px);
    areas.1.retain(|_, n| *n >= least_px);
    let as_floats = |n: &usize| *n as f64;
    compared.areas.truth = areas.0.values().map(as_floats).collect();
    compared.areas.found = areas.1.values().map(as_floats).collect();
    let nth = |label: &u16| areas.0.keys().position(|l| l == label);
    let nth_found = |label: &u32| areas.1.keys().position(|l| l == label);
    let shared = common.iter().filter_map(|((t, f), both)| Some((nth(t)?, nth_found(f)?, *both as f64)));
    compared.areas.shared = shared.collect();
    compared
}

#[cfg(test)]
mod tests {
    use sizeup_truth::evaluate::evaluate_photos;

    use super::*;

    /// By hand, four rows of 40 pixels: two houses of 4 side by side found as one of 8, one of 4 found two to the right, one of
    /// 10 found one to the right, and one where nothing is known.
    #[test]
    fn areas_of_labels_give_the_measures_of_a_hand_calculation() {
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
        let compared = compare(&labels, &Raster::from_vec(40, 4, (0..160).map(found).collect()).unwrap(), 4);
        assert!((compared.iou_of_pixels() - 19.0 / 25.0).abs() < 1e-12);
        let measured = evaluate_photos(&[compared.areas]);
        // Houses and their counterparts: 4 of 8; none; 2 of 6; 9 of 11. The half is a hit, as 9 of 11 is.
        assert_eq!((measured.n_truth, measured.n_found, measured.n_pairs, measured.n_hits), (4, 3, 3, 2));
        let (area, detection) = (measured.area_by_building, measured.detection);
        for (found, expected) in [
            (area.iou, (0.5 + 1.0 / 3.0 + 9.0 / 11.0) / 4.0),
            (area.precision, (0.5 + 0.5 + 0.9) / 4.0),
            (area.recall, (1.0 + 0.5 + 0.9) / 4.0),
            (area.f1, (2.0 / 3.0 + 0.5 + 0.9) / 4.0),
            (detection.precision, 2.0 / 3.0),
            (detection.recall, 0.5),
            (detection.f1, 4.0 / 7.0),
            (measured.iou_of_hits, f64::midpoint(0.5, 9.0 / 11.0)),
        ] {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }
}
