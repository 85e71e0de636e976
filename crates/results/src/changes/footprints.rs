//! How much of a footprint is elsewhere, beyond what the accuracy of footprints explains.
//!
//! ```text
//! gained = area(new − old grown by t)        lost = area(old − new grown by t)
//! ```
//!
//! `t`: how far a footprint can reach without being another one ([`super::verdict::DecisionRules::reach_m`]). Slivers along
//! walls stay within `t`; a wing that was built does not.

use geo::{Area as _, BooleanOps as _, Buffer as _};
use geo_types::MultiPolygon;

/// Area that a footprint must have won or lost beyond the tolerance to be another one, m²: a corner that was cut differently is
/// less.
pub const LEAST_M2: f64 = 1.0;

/// An old footprint against a new one; m².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootprintDifference {
    /// Intersection over union of the two footprints, 0 to 1.
    pub iou: f64,
    /// Area of the new one that lies farther than the tolerance from the old one.
    pub gained_m2: f64,
    /// Area of the old one that lies farther than the tolerance from the new one.
    pub lost_m2: f64,
}

impl FootprintDifference {
    /// Compares two footprints that are not empty.
    #[must_use]
    pub fn of(old: &MultiPolygon<f64>, new: &MultiPolygon<f64>, tolerance_m: f64) -> Self {
        if old == new {
            return Self { iou: 1.0, gained_m2: 0.0, lost_m2: 0.0 };
        }
        let beyond =
            |of: &MultiPolygon<f64>, from: &MultiPolygon<f64>| of.difference(&from.buffer(tolerance_m)).unsigned_area();
        Self { iou: iou(old, new), gained_m2: beyond(new, old), lost_m2: beyond(old, new) }
    }
}

/// Intersection over union of two footprints; 0 where both are empty.
#[must_use]
pub fn iou(a: &MultiPolygon<f64>, b: &MultiPolygon<f64>) -> f64 {
    let shared_m2 = a.intersection(b).unsigned_area();
    let union_m2 = a.unsigned_area() + b.unsigned_area() - shared_m2;
    if union_m2 > 0.0 { shared_m2 / union_m2 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use geo_types::Rect;

    use super::*;

    fn rectangle([west, south, width, depth]: [f64; 4]) -> MultiPolygon<f64> {
        Rect::new((west, south), (west + width, south + depth)).to_polygon().into()
    }

    #[test]
    fn a_sliver_is_within_the_tolerance_and_a_wing_is_not() {
        let house = rectangle([0.0, 0.0, 10.0, 10.0]);
        let askew = FootprintDifference::of(&house, &rectangle([0.9, -0.9, 10.0, 10.0]), 1.3);
        assert!(askew.gained_m2 < 1e-6 && askew.lost_m2 < 1e-6 && askew.iou < 0.8, "{askew:?}");
        let wing = FootprintDifference::of(&house, &rectangle([0.0, 0.0, 14.0, 10.0]), 1.0);
        assert!((wing.gained_m2 - 30.0).abs() < 1e-6 && wing.lost_m2 == 0.0, "{wing:?}");
        assert!((wing.iou - 100.0 / 140.0).abs() < 1e-9);
    }

    #[test]
    fn a_courtyard_that_was_roofed_is_gained() {
        let courtyard = rectangle([0.0, 0.0, 30.0, 30.0]).difference(&rectangle([10.0, 10.0, 10.0, 10.0]));
        let roofed = FootprintDifference::of(&courtyard, &rectangle([0.0, 0.0, 30.0, 30.0]), 1.0);
        assert!((roofed.gained_m2 - 64.0).abs() < 1.0 && roofed.lost_m2 == 0.0, "{roofed:?}");
    }
}
