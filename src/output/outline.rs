//! Outlines on the output grid, valid by construction.
//!
//! A [`SnappedOutline`] has rings of at least three distinct points, without repeated points or spikes; no two rings
//! and no two parts of one ring touch (a touching point would become a vertical edge with four walls, val3dity 303);
//! holes lie inside the exterior and not inside each other. Exterior counter-clockwise, holes clockwise, seen from
//! above. All checks are exact integer arithmetic.
//!
//! Snapping can break an outline that was valid in metres; then the outline is repaired once by the union of its even
//! parts, and where rings touch by an inset of [`INSET_QUANTA`]. A repair that loses more than
//! [`REPAIR_LOSS_SHARE`] of the area is refused instead.

use geo::orient::Direction;
use geo::{Area, BooleanOps, Buffer, Orient};
use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use serde::{Deserialize, Serialize};

use super::grid::Grid;
use super::planar::{cross, rings_are_disjoint_and_nested, twice_area};

/// How far a touching outline is moved inwards, in quanta: two, so that rounding cannot close the gap again.
const INSET_QUANTA: f64 = 2.0;

/// Largest share of the area that a repair may lose (slivers, not rooms).
const REPAIR_LOSS_SHARE: f64 = 1e-3;

/// Why an outline does not survive on the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum OutlineFault {
    /// Smaller than the grid resolves.
    #[error("the outline has no area left on the output grid")]
    Collapsed,
    /// Crosses or touches itself beyond what the repair may change.
    #[error("the outline crosses or touches itself on the output grid")]
    Invalid,
}

/// A closed ring without its last point; no two consecutive points are equal.
pub type Ring = Vec<[i64; 2]>;

/// A valid outline on the grid: exterior first.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SnappedOutline {
    rings: Vec<Ring>,
}

impl SnappedOutline {
    /// Snaps an outline (map frame, metres) to the grid and cleans it.
    ///
    /// # Errors
    /// [`OutlineFault`] when no faithful outline is left.
    pub fn new(outline: &Polygon<f64>, grid: &Grid) -> Result<Self, OutlineFault> {
        let snap_ring = |ring: &LineString<f64>| -> Ring { ring.coords().map(|p| grid.snap(*p)).collect() };
        let rings = clean(snap_ring(outline.exterior()), outline.interiors().iter().map(snap_ring))?;
        if rings_are_disjoint_and_nested(&rings) {
            return Ok(Self { rings });
        }
        repair(&rings)
    }

    /// The rings, exterior first.
    #[must_use]
    pub fn rings(&self) -> &[Ring] {
        &self.rings
    }

    /// Area in square quanta.
    #[must_use]
    pub fn area(&self) -> f64 {
        // The holes are clockwise, so their areas are negative.
        self.rings.iter().map(|ring| twice_area(ring) as f64 / 2.0).sum()
    }

    /// In the map frame, metres; rings closed.
    #[must_use]
    pub fn to_polygon(&self, grid: &Grid) -> Polygon<f64> {
        let mut rings = self.rings.iter().map(|ring| {
            let closed = ring.iter().chain(ring.first());
            closed.map(|&[x, y]| grid.metres([x, y, 0])).map(|[x, y, _]| Coord { x, y }).collect::<LineString<f64>>()
        });
        let exterior = rings.next().unwrap_or_else(|| LineString::new(Vec::new()));
        Polygon::new(exterior, rings.collect())
    }
}

/// Tidies and orients all rings; holes without area vanish.
fn clean(exterior: Ring, holes: impl Iterator<Item = Ring>) -> Result<Vec<Ring>, OutlineFault> {
    let exterior = oriented(tidy(exterior), 1).ok_or(OutlineFault::Collapsed)?;
    Ok(std::iter::once(exterior).chain(holes.filter_map(|hole| oriented(tidy(hole), -1))).collect())
}

/// Drops the closing point, repeated points and spikes (`a b a`, or `a b` and back along it).
fn tidy(points: Ring) -> Ring {
    let mut ring = Ring::with_capacity(points.len());
    for point in points {
        push_tidy(&mut ring, point);
    }
    // The seam: the same rules hold across the ring's end.
    while ring.len() >= 3 {
        let n = ring.len();
        if ring[0] == ring[n - 1] || is_spike(ring[n - 2], ring[n - 1], ring[0]) {
            ring.pop();
        } else if is_spike(ring[n - 1], ring[0], ring[1]) {
            ring.remove(0);
        } else {
            break;
        }
    }
    ring
}

fn push_tidy(ring: &mut Ring, point: [i64; 2]) {
    while ring.len() >= 2 && is_spike(ring[ring.len() - 2], ring[ring.len() - 1], point) {
        ring.pop();
    }
    if ring.last() != Some(&point) {
        ring.push(point);
    }
}

/// Whether the walk `a → b → c` turns straight back at `b`.
fn is_spike(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> bool {
    let ahead = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1]);
    ahead < 0 && cross(a, b, c) == 0
}

/// Turned so that its area has the given sign; `None` without area.
fn oriented(mut ring: Ring, sign: i128) -> Option<Ring> {
    let area = twice_area(&ring);
    if ring.len() < 3 || area == 0 {
        return None;
    }
    if area.signum() != sign {
        ring.reverse();
    }
    Some(ring)
}

/// Rebuilds the region that the rings enclose; keeps its main part if next to nothing else is lost.
fn repair(rings: &[Ring]) -> Result<SnappedOutline, OutlineFault> {
    let to_line = |ring: &Ring| -> LineString<f64> {
        ring.iter().chain(ring.first()).map(|&[x, y]| Coord { x: x as f64, y: y as f64 }).collect()
    };
    let broken = Polygon::new(to_line(&rings[0]), rings[1..].iter().map(to_line).collect());
    // Even-odd, so that both lobes of a bow tie count and losing one of them shows.
    let nothing = MultiPolygon::<f64>::new(Vec::new());
    let united = broken.union(&nothing);
    let wanted = united.unsigned_area();
    for candidate in [united.clone(), united.buffer(-INSET_QUANTA)] {
        let Some(main) = largest(&candidate) else { continue };
        let unit = Grid { scale_m: 1.0, origin_m: [0.0; 3] };
        let main = main.orient(Direction::Default);
        let snap_ring = |ring: &LineString<f64>| -> Ring { ring.coords().map(|p| unit.snap(*p)).collect() };
        let Ok(rings) = clean(snap_ring(main.exterior()), main.interiors().iter().map(snap_ring)) else { continue };
        let outline = SnappedOutline { rings };
        // An inset takes a rim of its own width all round, which is no loss of a part.
        let rim = 2.0 * INSET_QUANTA * perimeter(&main);
        let is_faithful = (outline.area() - wanted).abs() <= REPAIR_LOSS_SHARE * wanted + rim;
        if is_faithful && rings_are_disjoint_and_nested(&outline.rings) {
            return Ok(outline);
        }
    }
    Err(OutlineFault::Invalid)
}

fn largest(parts: &MultiPolygon<f64>) -> Option<&Polygon<f64>> {
    parts.iter().max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area()))
}

fn perimeter(polygon: &Polygon<f64>) -> f64 {
    let length = |ring: &LineString<f64>| -> f64 { ring.lines().map(|l| l.dx().hypot(l.dy())).sum() };
    length(polygon.exterior()) + polygon.interiors().iter().map(length).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use geo::polygon;

    use super::*;

    const MILLIMETRES: Grid = Grid { scale_m: 0.001, origin_m: [0.0; 3] };

    #[test]
    fn repeated_points_spikes_and_flat_holes_vanish() {
        let outline = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 0.0001), (x: 10.0, y: 5.0), (x: 14.0, y: 5.0),
                       (x: 10.0, y: 5.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)],
            interiors: [[(x: 2.0, y: 2.0), (x: 2.0001, y: 2.0), (x: 2.0, y: 2.0002)]],
        );
        let snapped = SnappedOutline::new(&outline, &MILLIMETRES).unwrap();
        assert_eq!(snapped.rings().len(), 1);
        assert_eq!(snapped.area(), 1e8);
        assert!(!snapped.rings()[0].contains(&[14_000, 5_000]));
    }

    #[test]
    fn a_hole_that_touches_the_exterior_is_set_apart() {
        let outline = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)],
            interiors: [[(x: 5.0, y: 0.0), (x: 4.0, y: 4.0), (x: 6.0, y: 4.0)]],
        );
        let snapped = SnappedOutline::new(&outline, &MILLIMETRES).unwrap();
        assert!(rings_are_disjoint_and_nested(snapped.rings()));
        assert!((snapped.area() * 1e-6 - 96.0).abs() < 0.3, "{}", snapped.area() * 1e-6);
    }

    #[test]
    fn a_bow_tie_is_refused() {
        let outline = polygon![(x: 0.0, y: 0.0), (x: 10.0, y: 10.0), (x: 10.0, y: 0.0), (x: 0.0, y: 8.0)];
        assert_eq!(SnappedOutline::new(&outline, &MILLIMETRES), Err(OutlineFault::Invalid));
    }

    #[test]
    fn an_outline_smaller_than_the_grid_collapses() {
        let outline = polygon![(x: 0.0, y: 0.0), (x: 3e-4, y: 0.0), (x: 0.0, y: 3e-4)];
        assert_eq!(SnappedOutline::new(&outline, &MILLIMETRES), Err(OutlineFault::Collapsed));
    }
}
