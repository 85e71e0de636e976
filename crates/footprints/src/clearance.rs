//! The clearance of a footprint: how far its corners may move before it touches itself.
//!
//! ```text
//! clearance = min over corners c and edges e that do not end in c of distance(c, e)
//! ```
//!
//! Between corners it is their distance; where a footprint has a slit, a spike or a neck it is that one's width. A footprint
//! whose clearance is below what a reader of the file takes for one point (val3dity: 1 mm) is valid in numbers and
//! invalid to that reader. [`joined`] closes what is too narrow without making new positions: corners that are too near
//! become one, and an edge that passes a corner too near is led through it. What encloses no area then falls away when
//! the rings are rebuilt.

use geo::{Distance as _, Euclidean};
use geo_types::{Coord, Line, LineString, Point, Polygon};
use rstar::primitives::GeomWithData;
use rstar::{AABB, RTree};

/// A corner and which one it is.
type Corner = GeomWithData<[f64; 2], usize>;

/// Place where the clearance of a footprint is first below `least_m`, along its rings; `None` where it is nowhere. Rings are
/// closed and have no repeated corners; units as those of the coordinates.
#[must_use]
pub fn narrow(polygon: &Polygon<f64>, least_m: f64) -> Option<Coord<f64>> {
    let rings: Vec<&LineString<f64>> = rings(polygon).collect();
    let corners = CornerTree::of(&rings);
    rings.iter().flat_map(|ring| ring.lines()).find_map(|edge| corners.near(edge, least_m).into_iter().next())
}

/// The footprint with its corners and edges joined where they are nearer than `least_m`. It may touch or retrace itself
/// there afterwards. `None` where no exterior is left; holes without area vanish.
#[must_use]
pub fn joined(polygon: &Polygon<f64>, least_m: f64) -> Option<Polygon<f64>> {
    let merged = merge_corners(polygon, least_m);
    let lean: Vec<Vec<Coord<f64>>> = merged.into_iter().map(|ring| without_short_edges(ring, least_m)).collect();
    let closed: Vec<LineString<f64>> = lean.into_iter().map(close).collect();
    let all: Vec<&LineString<f64>> = closed.iter().collect();
    let corners = CornerTree::of(&all);
    let mut rings = closed.iter().map(|ring| {
        let led = ring.lines().flat_map(|edge| {
            let mut through = corners.near(edge, least_m);
            let along = |c: &Coord<f64>| Euclidean.distance(Point(*c), Point(edge.start));
            through.sort_by(|a, b| along(a).total_cmp(&along(b)));
            std::iter::once(edge.start).chain(through)
        });
        close(led.collect())
    });
    let exterior = rings.next().filter(|ring| ring.0.len() > 3)?;
    Some(Polygon::new(exterior, rings.filter(|ring| ring.0.len() > 3).collect()))
}

/// The exterior and the holes.
pub(super) fn rings(polygon: &Polygon<f64>) -> impl Iterator<Item = &LineString<f64>> {
    std::iter::once(polygon.exterior()).chain(polygon.interiors())
}

/// Corners of one ring or of several that are nearer than `least_m` take the position of the first of them.
fn merge_corners(polygon: &Polygon<f64>, least_m: f64) -> Vec<Vec<Coord<f64>>> {
    let mut kept: RTree<[f64; 2]> = RTree::new();
    let mut merged = |at: &Coord<f64>| {
        let near = kept.nearest_neighbor(&[at.x, at.y]).copied().map(Coord::from);
        near.filter(|near| Euclidean.distance(Point(*near), Point(*at)) < least_m).unwrap_or_else(|| {
            kept.insert([at.x, at.y]);
            *at
        })
    };
    rings(polygon).map(|ring| open(ring).iter().map(&mut merged).collect()).collect()
}

/// Without corners that repeat or are nearer than `least_m` to the one before.
fn without_short_edges(mut ring: Vec<Coord<f64>>, least_m: f64) -> Vec<Coord<f64>> {
    ring.dedup_by(|b, a| Euclidean.distance(Point(*a), Point(*b)) < least_m);
    while ring.len() > 1 && Euclidean.distance(Point(ring[0]), Point(ring[ring.len() - 1])) < least_m {
        ring.pop();
    }
    ring
}

fn open(ring: &LineString<f64>) -> &[Coord<f64>] {
    let n = ring.0.len();
    &ring.0[..n - usize::from(n > 1 && ring.0[0] == ring.0[n - 1])]
}

fn close(corners: Vec<Coord<f64>>) -> LineString<f64> {
    let mut ring = LineString::new(corners);
    ring.close();
    ring
}

/// The distinct corners of all rings, to be looked up by place.
struct CornerTree(RTree<Corner>);

impl CornerTree {
    fn of(rings: &[&LineString<f64>]) -> Self {
        let mut places: Vec<[f64; 2]> = rings.iter().flat_map(|ring| open(ring)).map(|c| [c.x, c.y]).collect();
        places.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        places.dedup();
        Self(RTree::bulk_load(places.into_iter().enumerate().map(|(i, at)| Corner::new(at, i)).collect()))
    }

    /// Corners nearer than `least_m` to an edge that does not end in them, by place.
    fn near(&self, edge: Line<f64>, least_m: f64) -> Vec<Coord<f64>> {
        let (low, high) = (
            [edge.start.x.min(edge.end.x) - least_m, edge.start.y.min(edge.end.y) - least_m],
            [edge.start.x.max(edge.end.x) + least_m, edge.start.y.max(edge.end.y) + least_m],
        );
        let is_near =
            |at: &Coord<f64>| *at != edge.start && *at != edge.end && Euclidean.distance(&Point(*at), &edge) < least_m;
        let mut found: Vec<(usize, Coord<f64>)> = self
            .0
            .locate_in_envelope_intersecting(&AABB::from_corners(low, high))
            .map(|corner| (corner.data, Coord::from(*corner.geom())))
            .filter(|(_, at)| is_near(at))
            .collect();
        // The tree's own order is no order.
        found.sort_unstable_by_key(|(i, _)| *i);
        found.into_iter().map(|(_, at)| at).collect()
    }
}

#[cfg(test)]
mod tests {
    use geo::MakeValid as _;
    use geo::{Area as _, polygon};

    use super::*;

    fn slit(mouth_m: f64) -> Polygon<f64> {
        polygon![
            (x: 0.0, y: 0.0), (x: 5.0, y: 0.0), (x: 5.0, y: 5.0), (x: 5.0 + mouth_m, y: 0.0), (x: 10.0, y: 0.0),
            (x: 10.0, y: 10.0), (x: 0.0, y: 10.0),
        ]
    }

    #[test]
    fn the_clearance_of_a_slit_is_its_mouth() {
        assert_eq!(narrow(&slit(0.02), 0.01), None);
        assert_eq!(narrow(&slit(0.004), 0.005), Some(Coord { x: 5.004, y: 0.0 }));
    }

    #[test]
    fn a_neck_is_as_narrow_as_a_corner_is_near_the_wall_across() {
        let neck = polygon![
            (x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 4.0), (x: 5.0, y: 0.003), (x: 0.0, y: 4.0),
        ];
        assert_eq!(narrow(&neck, 0.005), Some(Coord { x: 5.0, y: 0.003 }));
        assert_eq!(narrow(&neck, 0.002), None);
    }

    #[test]
    fn a_closed_slit_leaves_the_area_and_no_new_position() {
        let before = slit(0.004);
        let after = joined(&before, 0.005).unwrap();
        assert!(after.exterior().coords().all(|c| before.exterior().0.contains(c)));
        let rebuilt = after.make_valid().unwrap();
        assert_eq!(rebuilt.0.len(), 1);
        assert!((rebuilt.unsigned_area() - 100.0).abs() < 0.03, "{}", rebuilt.unsigned_area());
    }

    #[test]
    fn what_is_smaller_than_the_clearance_vanishes() {
        let crumb = polygon![(x: 0.0, y: 0.0), (x: 0.003, y: 0.0), (x: 0.0, y: 0.003)];
        assert_eq!(joined(&crumb, 0.005), None);
    }
}
