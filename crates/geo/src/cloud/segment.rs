//! Points by footprint.

use geo::{Area, BoundingRect, Contains};
use geo_types::{MultiPolygon, Point};
use glam::DVec3;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, PointDistance as _, RTree};

/// For each footprint, the points inside it and at least `inset_m` from its border, in the points' order.
#[must_use]
pub fn points_in(points: &[DVec3], footprints: &[MultiPolygon<f64>], inset_m: f64) -> Vec<Vec<DVec3>> {
    let boxes = footprints.iter().enumerate().filter_map(|(i, footprint)| {
        let bounds = footprint.bounding_rect()?;
        let corners = Rectangle::from_corners([bounds.min().x, bounds.min().y], [bounds.max().x, bounds.max().y]);
        Some(GeomWithData::new(corners, i))
    });
    let tree = RTree::bulk_load(boxes.collect());
    let mut found = vec![Vec::new(); footprints.len()];
    for &p in points {
        for candidate in tree.locate_all_at_point(&[p.x, p.y]) {
            let footprint = &footprints[candidate.data];
            if footprint.contains(&Point::new(p.x, p.y)) && border_distance_m(footprint, [p.x, p.y]) >= inset_m {
                found[candidate.data].push(p);
            }
        }
    }
    found
}

fn border_distance_m(footprint: &MultiPolygon<f64>, at: [f64; 2]) -> f64 {
    let rings = footprint.iter().flat_map(|polygon| std::iter::once(polygon.exterior()).chain(polygon.interiors()));
    let squares = rings.flat_map(geo_types::LineString::lines).map(|line| {
        let line = rstar::primitives::Line::new([line.start.x, line.start.y], [line.end.x, line.end.y]);
        line.distance_2(&at)
    });
    squares.fold(f64::INFINITY, f64::min).sqrt()
}

/// Level of the ground around each footprint: the median of the ground points within `reach_m` of its bounding box, or of
/// the nearest ones; `None` without any ground points.
#[must_use]
pub fn ground_near(ground: &[DVec3], footprints: &[MultiPolygon<f64>], reach_m: f64) -> Vec<Option<f64>> {
    /// Ground points that stand for the ground where none is within reach.
    const NEAREST: usize = 20;
    let tree = RTree::bulk_load(ground.iter().map(|p| GeomWithData::new([p.x, p.y], p.z)).collect());
    footprints
        .iter()
        .map(|footprint| {
            let bounds = footprint.bounding_rect().filter(|_| footprint.unsigned_area() > 0.0)?;
            let (low, high) = (bounds.min(), bounds.max());
            let around = AABB::from_corners([low.x - reach_m, low.y - reach_m], [high.x + reach_m, high.y + reach_m]);
            let mut levels: Vec<f64> = tree.locate_in_envelope(&around).map(|p| p.data).collect();
            if levels.is_empty() {
                let centre = bounds.center();
                levels = tree.nearest_neighbor_iter(&[centre.x, centre.y]).take(NEAREST).map(|p| p.data).collect();
            }
            sizeup_heights::stats::median(&levels)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;

    #[test]
    fn points_go_to_the_footprint_they_lie_in_and_edges_are_left_out() {
        let square = polygon![(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)];
        let footprints = [MultiPolygon::new(vec![square])];
        let points = [DVec3::new(5.0, 5.0, 9.0), DVec3::new(0.3, 5.0, 1.0), DVec3::new(-1.0, 5.0, 0.0)];
        assert_eq!(points_in(&points, &footprints, 0.5), [vec![points[0]]]);
        assert_eq!(points_in(&points, &footprints, 0.0)[0].len(), 2);
        assert_eq!(ground_near(&points[2..], &footprints, 2.0), [Some(0.0)]);
        assert_eq!(ground_near(&[DVec3::new(90.0, 0.0, 4.0)], &footprints, 2.0), [Some(4.0)]);
        assert_eq!(ground_near(&[], &footprints, 2.0), [None]);
    }
}
