//! Where a result looked: only there can a building be missing.
//!
//! A result does not say how far it looked. Its footprints do, and its photos: what lies within the convex hull of the footprints,
//! or at most a margin beyond, or within that of the photos' projection centres, was looked at.

use geo::{Buffer as _, Centroid as _, Contains as _, ConvexHull as _};
use geo_types::{MultiPoint, MultiPolygon, Point, Polygon};

use super::building::ComparedBuilding;

/// The area of a result; map frame.
pub struct SeenArea {
    footprints: MultiPolygon<f64>,
    photos: Polygon<f64>,
}

impl SeenArea {
    /// Around the footprints of a result and `margin_m` beyond, and within its `cameras` (easting, northing).
    pub fn of(buildings: &[ComparedBuilding<'_>], margin_m: f64, cameras: &[[f64; 2]]) -> Self {
        let rings = buildings.iter().flat_map(|building| building.footprint.iter().map(Polygon::exterior));
        let corners: MultiPoint<f64> = rings.flat_map(|ring| ring.coords().map(|&at| Point(at))).collect();
        let centres: MultiPoint<f64> = cameras.iter().map(|&at| Point::from(at)).collect();
        Self { footprints: corners.convex_hull().buffer(margin_m), photos: centres.convex_hull() }
    }

    /// Whether the centre of a footprint lies in it.
    pub fn holds(&self, footprint: &MultiPolygon<f64>) -> bool {
        let holds = |centre: Point<f64>| self.footprints.contains(&centre) || self.photos.contains(&centre);
        footprint.centroid().is_some_and(holds)
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
        let found = |cameras: &[[f64; 2]]| -> Vec<bool> {
            let area = SeenArea::of(&buildings(&records, [0.0; 2]), 20.0, cameras);
            buildings(&others, [0.0; 2]).iter().map(|b| area.holds(&b.footprint)).collect()
        };
        assert_eq!(found(&[]), [true, true, false]);
        assert_eq!(found(&[[0.0, -50.0], [0.0, 50.0], [300.0, 50.0], [300.0, -50.0]]), [true, true, true]);
    }
}
