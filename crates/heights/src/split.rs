//! Footprints split along a polygon.

use geo::{Area as _, BooleanOps as _, CoordsIter as _, Distance as _, Euclidean};
use geo_types::{Coord, LineString, MultiPolygon, Point, Polygon};

/// Corners this near to an edge are on it, metres: results are written in millimetres.
const ON_EDGE_M: f64 = 1e-3;

/// A region inside and outside of another polygon; `None` if either side has no piece of `min_m2`. Smaller pieces go to the other side,
/// so that both share their border and cover the region.
#[must_use]
pub fn divide(region: &MultiPolygon<f64>, other: &Polygon<f64>, min_m2: f64) -> Option<[MultiPolygon<f64>; 2]> {
    let by_size = |pieces: MultiPolygon<f64>| -> (MultiPolygon<f64>, MultiPolygon<f64>) {
        let (large, small) = pieces.0.into_iter().partition(|piece| piece.unsigned_area() >= min_m2);
        (MultiPolygon::new(large), MultiPolygon::new(small))
    };
    let (inner, inner_slivers) = by_size(region.intersection(other));
    let (outer, outer_slivers) = by_size(region.difference(other));
    if inner.0.is_empty() || outer.0.is_empty() {
        return None;
    }
    Some([inner.union(&outer_slivers), outer.union(&inner_slivers)])
}

/// The footprint with corners of its neighbours that lie on its edges made corners of its own, so that rounding moves both
/// alike: they would overlap by a hair else.
#[must_use]
pub fn with_corners_of(neighbours: &[&Polygon<f64>], footprint: &Polygon<f64>) -> Polygon<f64> {
    let corners: Vec<Coord<f64>> = neighbours.iter().flat_map(|n| n.coords_iter()).collect();
    let ring = |ring: &LineString<f64>| {
        let mut joined: Vec<Coord<f64>> = Vec::with_capacity(ring.0.len());
        for edge in ring.lines() {
            joined.push(edge.start);
            let along = |c: &Coord<f64>| Euclidean.distance(*c, edge.start);
            let is_on = |c: &&Coord<f64>| {
                let is_at = |end: Coord<f64>| Euclidean.distance(**c, end) <= ON_EDGE_M;
                !is_at(edge.start) && !is_at(edge.end) && Euclidean.distance(&Point(**c), &edge) <= ON_EDGE_M
            };
            let mut on_edge: Vec<Coord<f64>> = corners.iter().filter(is_on).copied().collect();
            on_edge.sort_by(|a, b| along(a).total_cmp(&along(b)));
            on_edge.dedup_by(|a, b| Euclidean.distance(*a, *b) <= ON_EDGE_M);
            joined.extend(on_edge);
        }
        joined.extend(ring.0.last());
        LineString::new(joined)
    };
    Polygon::new(ring(footprint.exterior()), footprint.interiors().iter().map(ring).collect())
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};
    use geo_types::polygon;

    use super::*;

    fn rectangle(x0: f64, y0: f64, x1: f64, y1: f64) -> Polygon<f64> {
        Rect::new(coord! { x: x0, y: y0 }, coord! { x: x1, y: y1 }).to_polygon()
    }

    /// A footprint of 40 × 30 m.
    fn divided(other: &Polygon<f64>) -> Option<[MultiPolygon<f64>; 2]> {
        divide(&rectangle(0.0, 0.0, 40.0, 30.0).into(), other, 12.0)
    }

    #[test]
    fn a_tower_inside_its_podium_leaves_a_ring_around_it() {
        let [tower, podium] = divided(&rectangle(10.0, 8.0, 22.0, 20.0)).unwrap();
        assert_eq!((tower.0.len(), podium.0.len()), (1, 1));
        assert!((tower.unsigned_area() - 144.0).abs() < 1e-6);
        assert_eq!(podium.0[0].interiors().len(), 1);
        assert!((podium.unsigned_area() - (1200.0 - 144.0)).abs() < 1e-6);
    }

    #[test]
    fn slivers_beside_the_cut_go_to_the_part_they_touch() {
        // 0.2 m of the footprint stay beyond the rectangle on three sides.
        let sides = divided(&rectangle(20.0, 0.2, 39.8, 29.8)).unwrap();
        let area: f64 = sides.iter().map(geo::Area::unsigned_area).sum();
        assert!((area - 1200.0).abs() < 1e-6, "nothing is lost");
        assert!(sides.iter().flatten().all(|piece| piece.unsigned_area() > 12.0), "no slivers");
    }

    #[test]
    fn corners_of_a_neighbour_on_an_edge_become_its_own() {
        let west = rectangle(0.0, 0.0, 10.0, 30.0);
        // Its border to the west has two corners more, one of them a hair off; a third stands apart.
        let east: Polygon<f64> = polygon![
            (x: 10.0, y: 0.0), (x: 25.0, y: 0.0), (x: 25.0, y: 30.0), (x: 10.0, y: 30.0),
            (x: 9.9996, y: 20.0), (x: 18.0, y: 15.0), (x: 10.0, y: 12.0),
        ];
        let joined = with_corners_of(&[&east], &west);
        let corners: Vec<(f64, f64)> = joined.exterior().coords().map(geo_types::Coord::x_y).collect();
        assert_eq!(corners.len(), west.exterior().0.len() + 2, "{corners:?}");
        assert!(corners.windows(2).any(|edge| edge.contains(&(10.0, 12.0)) && edge.contains(&(9.9996, 20.0))));
        assert_eq!(joined.intersection(&east).unsigned_area(), 0.0, "nothing is shared but the border");
        assert_eq!(with_corners_of(&[&west], &rectangle(40.0, 0.0, 50.0, 9.0)), rectangle(40.0, 0.0, 50.0, 9.0));
    }

    #[test]
    fn a_cut_that_misses_or_swallows_the_footprint_is_none() {
        assert_eq!(divided(&rectangle(50.0, 0.0, 60.0, 30.0)), None);
        assert_eq!(divided(&rectangle(-1.0, -1.0, 41.0, 31.0)), None);
    }
}
