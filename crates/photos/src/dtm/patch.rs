//! The height of one level square: where the photos that see it look alike.

use glam::{DVec2, DVec3};

use super::{MIN_MARGIN, MIN_SCORE, PATCH_M, SquareOutcome};
use sizeup_heights::photo_consistency::{PhotoConsistency, ground_sample_m};
use sizeup_heights::picture::Picture;

/// Samples along a side of the square.
const SAMPLES: std::ops::RangeInclusive<f64> = 8.0..=20.0;

/// Height of a square, searched up to `within_m` above and below a rough one.
pub(super) fn height(pictures: &[&Picture], near: DVec3, within_m: f64) -> SquareOutcome {
    if pictures.len() < 3 {
        return SquareOutcome::Unseen;
    }
    let gsd_m = ground_sample_m(pictures, near);
    let n_side = (PATCH_M / gsd_m).clamp(*SAMPLES.start(), *SAMPLES.end()) as usize;
    let offset_m = |i: usize| PATCH_M * ((i as f64 + 0.5) / n_side as f64 - 0.5);
    let square = (0..n_side).flat_map(|row| (0..n_side).map(move |col| (row, col)));
    let square: Vec<DVec3> =
        square.map(|(row, col)| near + DVec2::new(offset_m(col), offset_m(row)).extend(0.0)).collect();
    match PhotoConsistency::new(pictures, &square, within_m, gsd_m).peak() {
        Some(peak) if peak.score > MIN_SCORE && peak.lead > MIN_MARGIN => SquareOutcome::Ground(near.z + peak.raised_m),
        _ => SquareOutcome::Unclear,
    }
}
