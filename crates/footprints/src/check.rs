//! Is a polygon fit to be extruded?
//!
//! Stricter than OGC Simple Features: rings may not even *touch* themselves or each other, because a point where two
//! walls meet four faces is a non-manifold edge of the solid (val3dity 303). `O(n log n)` through an R-tree of edges.

use geo::kernels::{Kernel as _, Orientation, RobustKernel};
use geo::line_intersection::{LineIntersection, line_intersection};
use geo::{Contains as _, Intersects as _};
use geo_types::{Coord, Line, LineString, Polygon};
use rstar::RTree;
use rstar::primitives::{GeomWithData, Line as TreeLine};

/// Fault of a polygon, and its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PolygonFault {
    /// A ring with fewer than three corners.
    TooFewPoints,
    /// A ring crosses, touches or retraces itself.
    SelfContact(Coord<f64>),
    /// Two rings cross or touch.
    RingContact(Coord<f64>),
    /// A hole lies outside the exterior ring or inside another hole.
    MisplacedHole(Coord<f64>),
}

impl PolygonFault {
    /// Place; `None` where a ring as a whole is wrong.
    pub(super) fn place(self) -> Option<Coord<f64>> {
        match self {
            Self::SelfContact(place) | Self::RingContact(place) => Some(place),
            Self::TooFewPoints | Self::MisplacedHole(_) => None,
        }
    }
}

/// Ring (0 = exterior) and position of an edge in it.
type IndexedEdge = GeomWithData<TreeLine<[f64; 2]>, (usize, usize)>;

/// The first fault, self-contacts before contacts between rings; `None` for a polygon that can be extruded.
pub(super) fn fault(polygon: &Polygon<f64>) -> Option<PolygonFault> {
    let rings: Vec<&LineString<f64>> = std::iter::once(polygon.exterior()).chain(polygon.interiors()).collect();
    if rings.iter().any(|ring| ring.0.len() < 4) {
        return Some(PolygonFault::TooFewPoints);
    }
    let contact = rings.iter().find_map(|ring| spike(ring)).map(PolygonFault::SelfContact);
    contact.or_else(|| contact_between_edges(&rings)).or_else(|| misplaced_hole(&rings))
}

/// Place where a ring turns back onto itself.
fn spike(ring: &LineString<f64>) -> Option<Coord<f64>> {
    let corners = &ring.0[..ring.0.len() - 1];
    let n = corners.len();
    (0..n).find_map(|i| {
        let (before, here, after) = (corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]);
        let (arriving, leaving) = (here - before, after - here);
        let turns_back = arriving.x * leaving.x + arriving.y * leaving.y < 0.0;
        (turns_back && RobustKernel::orient2d(before, here, after) == Orientation::Collinear).then_some(here)
    })
}

fn contact_between_edges(rings: &[&LineString<f64>]) -> Option<PolygonFault> {
    let edges = rings.iter().enumerate().flat_map(|(r, ring)| {
        ring.lines().enumerate().map(move |(i, line)| {
            IndexedEdge::new(TreeLine::new([line.start.x, line.start.y], [line.end.x, line.end.y]), (r, i))
        })
    });
    let tree = RTree::bulk_load(edges.collect());
    let line = |edge: &IndexedEdge| Line::new(Coord::from(edge.geom().from), Coord::from(edge.geom().to));
    let mut contacts: Vec<_> = tree
        .intersection_candidates_with_other_tree(&tree)
        .filter(|(a, b)| a.data < b.data && !are_neighbours(a.data, b.data, rings))
        .filter(|(a, b)| line(a).intersects(&line(b)))
        .map(|(a, b)| {
            let place = match line_intersection(line(a), line(b)) {
                Some(LineIntersection::SinglePoint { intersection, .. }) => intersection,
                Some(LineIntersection::Collinear { intersection }) => intersection.start,
                None => line(a).start,
            };
            (a.data.0 != b.data.0, a.data, b.data, place)
        })
        .collect();
    // The tree's own order is no order: report the first fault along the rings.
    contacts.sort_unstable_by_key(|&(between_rings, a, b, _)| (between_rings, a, b));
    contacts.first().map(|&(between_rings, _, _, place)| {
        if between_rings { PolygonFault::RingContact(place) } else { PolygonFault::SelfContact(place) }
    })
}

/// Edges that share a corner by construction; that they do not retrace each other is [`spike`]'s concern.
fn are_neighbours(a: (usize, usize), b: (usize, usize), rings: &[&LineString<f64>]) -> bool {
    let n_edges = rings[a.0].0.len() - 1;
    a.0 == b.0 && (b.1 - a.1 == 1 || b.1 - a.1 == n_edges - 1)
}

/// With rings free of contact, one corner tells on which side of another ring a whole ring lies.
fn misplaced_hole(rings: &[&LineString<f64>]) -> Option<PolygonFault> {
    let filled: Vec<Polygon<f64>> = rings.iter().map(|ring| Polygon::new((*ring).clone(), Vec::new())).collect();
    rings.iter().enumerate().skip(1).find_map(|(i, hole)| {
        let corner = hole.0[0];
        let is_outside = !filled[0].contains(&corner);
        let is_nested = (1..rings.len()).any(|other| other != i && filled[other].contains(&corner));
        (is_outside || is_nested).then_some(PolygonFault::MisplacedHole(corner))
    })
}

#[cfg(test)]
mod tests {
    use geo::polygon;

    use super::*;

    #[test]
    fn a_courtyard_house_has_no_fault() {
        let house = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.0, y: 9.0)],
            interiors: [[(x: 3.0, y: 3.0), (x: 3.0, y: 6.0), (x: 6.0, y: 6.0), (x: 6.0, y: 3.0)]],
        );
        assert_eq!(fault(&house), None);
    }

    #[test]
    fn crossings_spikes_and_self_touching_corners_are_self_contacts() {
        let bow_tie = polygon![(x: 0.0, y: 0.0), (x: 4.0, y: 4.0), (x: 4.0, y: 0.0), (x: 0.0, y: 4.0)];
        let spike = polygon![(x: 0.0, y: 0.0), (x: 4.0, y: 0.0), (x: 9.0, y: 0.0), (x: 4.0, y: 0.0), (x: 4.0, y: 4.0)];
        let pinched = polygon![
            (x: 0.0, y: 0.0), (x: 4.0, y: 0.0), (x: 2.0, y: 2.0), (x: 4.0, y: 4.0), (x: 0.0, y: 4.0), (x: 2.0, y: 2.0),
        ];
        for shape in [bow_tie, spike, pinched] {
            assert!(matches!(fault(&shape), Some(PolygonFault::SelfContact(_))), "{shape:?}");
        }
    }

    #[test]
    fn holes_that_touch_nest_or_lie_outside_are_faults() {
        let with_hole = |hole: [(f64, f64); 3]| {
            let footprint = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.0, y: 9.0)];
            let inner = polygon![(x: 1.0, y: 1.0), (x: 1.0, y: 5.0), (x: 5.0, y: 1.0)];
            let hole = LineString::from(hole.to_vec());
            Polygon::new(footprint.exterior().clone(), vec![inner.exterior().clone(), hole])
        };
        assert!(matches!(fault(&with_hole([(0.0, 7.0), (3.0, 8.0), (3.0, 6.0)])), Some(PolygonFault::RingContact(_))));
        assert!(matches!(
            fault(&with_hole([(2.0, 2.0), (2.0, 2.5), (2.5, 2.0)])),
            Some(PolygonFault::MisplacedHole(_))
        ));
        assert!(matches!(
            fault(&with_hole([(20.0, 2.0), (20.0, 3.0), (21.0, 2.0)])),
            Some(PolygonFault::MisplacedHole(_))
        ));
    }
}
