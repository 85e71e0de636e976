//! Where a result looked: only there can a building be missing.
//!
//! A result does not say how far it looked. Its outlines do: what lies within their convex hull, or at most a margin beyond,
//! was looked at.

use geo::{Buffer as _, Centroid as _, Contains as _, ConvexHull as _};
use geo_types::{MultiPoint, MultiPolygon, Point};

use super::building::Building;

/// The area of a result; map frame.
pub struct SeenArea(MultiPolygon<f64>);

impl SeenArea {
    /// Around the outlines of a result.
    pub fn of(buildings: &[Building<'_>], margin_m: f64) -> Self {
        let rings = buildings.iter().flat_map(|building| building.outline.iter().map(geo_types::Polygon::exterior));
        let corners: MultiPoint<f64> = rings.flat_map(|ring| ring.coords().map(|&at| Point(at))).collect();
        Self(corners.convex_hull().buffer(margin_m))
    }

    /// Whether the centre of an outline lies in it.
    pub fn holds(&self, outline: &MultiPolygon<f64>) -> bool {
        outline.centroid().is_some_and(|centre| self.0.contains(&centre))
    }
}

#[cfg(test)]
mod tests {
    use super::super::building::{buildings, tests::house};
    use super::*;

    #[test]
    fn what_lies_between_the_buildings_was_looked_at_and_what_lies_beyond_was_not() {
        let records = [house("a", [0.0, 0.0, 9.0, 9.0], 5.0), house("b", [200.0, 0.0, 9.0, 9.0], 5.0)];
        let others = [[100.0, 1.0, 9.0, 5.0], [214.0, 0.0, 9.0, 9.0], [250.0, 0.0, 9.0, 9.0]];
        let others: Vec<_> = others.into_iter().map(|place| house("c", place, 5.0)).collect();
        let area = SeenArea::of(&buildings(&records, [0.0; 2]), 20.0);
        let found: Vec<bool> = buildings(&others, [0.0; 2]).iter().map(|b| area.holds(&b.outline)).collect();
        assert_eq!(found, [true, true, false]);
    }
}
