//! Footprints on the output grid, valid by construction.
//!
//! A [`SnappedFootprint`] has rings of at least three distinct points, without repeated points or spikes; no two rings
//! and no two parts of one ring touch (a touching point would become a vertical edge with four walls, val3dity 303) or
//! come nearer than [`CLEARANCE_M`] (a reader would take them for touching); holes lie inside the exterior and not
//! inside each other. Exterior counter-clockwise, holes clockwise, seen from above. Contacts are found by exact integer
//! arithmetic.
//!
//! Snapping can break a footprint that was valid in metres; then it is cleaned once more as the input was
//! ([`sizeup_footprints::clean`]), on this grid, and its main part is kept. A repair that changes more than
//! [`REPAIR_LOSS_SHARE`] of the area is refused instead.

use geo::Area as _;
use geo_types::{Coord, LineString, Polygon};
use serde::{Deserialize, Serialize};

use super::grid::OutputGrid;
use super::planar::{cross, rings_are_disjoint_and_nested, twice_area};
use sizeup_footprints::clean::{self, CleaningRules};
use sizeup_footprints::clearance;

/// Least distance of a corner from all others and from the edges it does not end, metres: twice what validators take for
/// one point.
const CLEARANCE_M: f64 = 0.002;

/// Largest share of the area that a repair may change (slivers, not rooms).
const REPAIR_LOSS_SHARE: f64 = 1e-3;

/// The same while it is cleaned, where the rim of a hole that is drawn in counts too.
const CLEANING_CHANGE_SHARE: f64 = 1e-2;

/// Why a footprint does not survive on the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FootprintFault {
    /// Smaller than the grid resolves.
    #[error("the footprint has no area left on the output grid")]
    Collapsed,
    /// Crosses or touches itself beyond what the repair may change.
    #[error("the footprint crosses or touches itself on the output grid")]
    Invalid,
}

/// A closed ring without its last point; no two consecutive points are equal.
pub type Ring = Vec<[i64; 2]>;

/// A valid footprint on the grid: exterior first.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SnappedFootprint {
    rings: Vec<Ring>,
}

impl SnappedFootprint {
    /// Snaps a footprint (map frame, metres) to the grid and cleans it.
    ///
    /// # Errors
    /// [`FootprintFault`] when no faithful footprint is left.
    pub fn new(footprint: &Polygon<f64>, grid: &OutputGrid) -> Result<Self, FootprintFault> {
        let snap_ring = |ring: &LineString<f64>| -> Ring { ring.coords().map(|p| grid.snap(*p)).collect() };
        let rings = clean(snap_ring(footprint.exterior()), footprint.interiors().iter().map(snap_ring))?;
        let snapped = Self { rings };
        if snapped.is_fit(grid) { Ok(snapped) } else { repair(&snapped, grid) }
    }

    /// Whether a footprint touches itself once it is on the grid, so that [`Self::new`] changes more of it than rounding
    /// does.
    #[must_use]
    pub fn is_repaired(footprint: &Polygon<f64>, grid: &OutputGrid) -> bool {
        let snap_ring = |ring: &LineString<f64>| -> Ring { ring.coords().map(|p| grid.snap(*p)).collect() };
        let rings = clean(snap_ring(footprint.exterior()), footprint.interiors().iter().map(snap_ring));
        rings.is_ok_and(|rings| !Self { rings }.is_fit(grid))
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

    /// Whether no rings touch, nest or come too near.
    fn is_fit(&self, grid: &OutputGrid) -> bool {
        let unit = OutputGrid { scale_m: grid.scale_m, origin_m: [0.0; 3] };
        rings_are_disjoint_and_nested(&self.rings) && clearance::narrow(&self.to_polygon(&unit), CLEARANCE_M).is_none()
    }

    /// In the map frame, metres; rings closed.
    #[must_use]
    pub fn to_polygon(&self, grid: &OutputGrid) -> Polygon<f64> {
        let mut rings = self.rings.iter().map(|ring| {
            let closed = ring.iter().chain(ring.first());
            closed.map(|&[x, y]| grid.metres([x, y, 0])).map(|[x, y, _]| Coord { x, y }).collect::<LineString<f64>>()
        });
        let exterior = rings.next().unwrap_or_else(|| LineString::new(Vec::new()));
        Polygon::new(exterior, rings.collect())
    }
}

/// Tidies and orients all rings; holes without area vanish.
fn clean(exterior: Ring, holes: impl Iterator<Item = Ring>) -> Result<Vec<Ring>, FootprintFault> {
    let exterior = oriented(tidy(exterior), 1).ok_or(FootprintFault::Collapsed)?;
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

/// Cleans the footprint on the grid; keeps its main part if next to nothing else is lost.
fn repair(broken: &SnappedFootprint, grid: &OutputGrid) -> Result<SnappedFootprint, FootprintFault> {
    // Relative to the grid's origin, so that its points are multiples of its quantum.
    let local = OutputGrid { scale_m: grid.scale_m, origin_m: [0.0; 3] };
    let rules = CleaningRules { grid_m: grid.scale_m, min_area_m2: 0.0, max_area_change: CLEANING_CHANGE_SHARE };
    let wanted_m2 = broken.to_polygon(&local).unsigned_area();
    let cleaned = clean::clean(&broken.to_polygon(&local), rules).map_err(|_| FootprintFault::Invalid)?;
    let main = cleaned.parts.iter().max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area()));
    let main = main.ok_or(FootprintFault::Invalid)?;
    let snap_ring = |ring: &LineString<f64>| -> Ring { ring.coords().map(|p| local.snap(*p)).collect() };
    let rings = clean(snap_ring(main.exterior()), main.interiors().iter().map(snap_ring))?;
    let footprint = SnappedFootprint { rings };
    let is_faithful = (main.unsigned_area() - wanted_m2).abs() <= REPAIR_LOSS_SHARE * wanted_m2 + rim_m2(main, rules);
    if is_faithful && footprint.is_fit(grid) { Ok(footprint) } else { Err(FootprintFault::Invalid) }
}

/// Area that closing slits and drawing holes in may have changed: a rim along the rings, which is no loss of a part.
fn rim_m2(polygon: &Polygon<f64>, rules: CleaningRules) -> f64 {
    let length_m = |ring: &LineString<f64>| -> f64 { ring.lines().map(|l| l.dx().hypot(l.dy())).sum() };
    let holes_m = polygon.interiors().iter().map(length_m).sum::<f64>();
    clean::LEAST_CLEARANCE_M * length_m(polygon.exterior()) + 2.0 * clean::hole_gap_m(rules) * holes_m
}

#[cfg(test)]
mod tests {
    use geo::polygon;

    use super::*;

    const MILLIMETRES: OutputGrid = OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] };

    #[test]
    fn repeated_points_spikes_and_flat_holes_vanish() {
        let footprint = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 0.0001), (x: 10.0, y: 5.0), (x: 14.0, y: 5.0),
                       (x: 10.0, y: 5.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)],
            interiors: [[(x: 2.0, y: 2.0), (x: 2.0001, y: 2.0), (x: 2.0, y: 2.0002)]],
        );
        let snapped = SnappedFootprint::new(&footprint, &MILLIMETRES).unwrap();
        assert_eq!(snapped.rings().len(), 1);
        assert_eq!(snapped.area(), 1e8);
        assert!(!snapped.rings()[0].contains(&[14_000, 5_000]));
    }

    #[test]
    fn a_hole_that_touches_the_exterior_is_set_apart() {
        let footprint = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0)],
            interiors: [[(x: 5.0, y: 0.0), (x: 4.0, y: 4.0), (x: 6.0, y: 4.0)]],
        );
        let snapped = SnappedFootprint::new(&footprint, &MILLIMETRES).unwrap();
        assert!(rings_are_disjoint_and_nested(snapped.rings()));
        assert!((snapped.area() * 1e-6 - 96.0).abs() < 0.3, "{}", snapped.area() * 1e-6);
    }

    #[test]
    fn what_a_reader_would_take_for_touching_is_closed() {
        // A slit whose mouth is one quantum wide, and a corner one quantum from the next.
        let slit = polygon![
            (x: 0.0, y: 0.0), (x: 5.0, y: 0.0), (x: 5.0, y: 5.0), (x: 5.001, y: 0.0), (x: 10.0, y: 0.0),
            (x: 10.001, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0),
        ];
        let snapped = SnappedFootprint::new(&slit, &MILLIMETRES).unwrap();
        assert_eq!(snapped.rings()[0].len(), 4, "{snapped:?}");
        assert!((snapped.area() * 1e-6 - 100.0).abs() < 0.02, "{}", snapped.area() * 1e-6);
    }

    #[test]
    fn a_bow_tie_is_refused() {
        let footprint = polygon![(x: 0.0, y: 0.0), (x: 10.0, y: 10.0), (x: 10.0, y: 0.0), (x: 0.0, y: 8.0)];
        assert_eq!(SnappedFootprint::new(&footprint, &MILLIMETRES), Err(FootprintFault::Invalid));
    }

    #[test]
    fn a_footprint_smaller_than_the_grid_collapses() {
        let footprint = polygon![(x: 0.0, y: 0.0), (x: 3e-4, y: 0.0), (x: 0.0, y: 3e-4)];
        assert_eq!(SnappedFootprint::new(&footprint, &MILLIMETRES), Err(FootprintFault::Collapsed));
    }
}
