//! The parts of a footprint that lie under one plane of a roof each.

use geo::{Area as _, BooleanOps as _};
use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use glam::DVec2;

use sizeup_heights::optimise::{RoofPlane, RoofPlanes, Rule};

/// Area of the footprint that may be left open, m²: what rounding makes.
const OPEN_M2: f64 = 1e-4;
/// Planes that differ by less over all of a rectangle are one, metres.
const SAME_PLANE_M: f64 = 0.002;

/// By plane; `None` where they do not cover the footprint. Metres.
pub(super) fn of(footprint: &Polygon<f64>, planes: &RoofPlanes) -> Option<Vec<MultiPolygon<f64>>> {
    let whole = MultiPolygon::new(vec![footprint.clone()]);
    let patches = match planes.rule {
        Rule::Highest => highest(&whole, &planes.planes),
        Rule::Lowest => planes.planes.iter().map(|plane| lowest(&whole, plane, &planes.planes)).collect(),
        Rule::First => {
            let mut left = whole.clone();
            let mut take = |plane: &RoofPlane| match plane.over {
                None => std::mem::replace(&mut left, MultiPolygon::new(Vec::new())),
                Some(corners) => {
                    let over = polygon(&corners);
                    let patch = left.intersection(&over);
                    left = left.difference(&over);
                    patch
                }
            };
            planes.planes.iter().map(&mut take).collect::<Vec<_>>()
        }
    };
    let covered_m2: f64 = patches.iter().map(geo::Area::unsigned_area).sum();
    ((covered_m2 - footprint.unsigned_area()).abs() <= OPEN_M2.max(1e-6 * covered_m2)).then_some(patches)
}

/// By plane, the part of a region under it where it is the highest of those that reach there.
fn highest(region: &MultiPolygon<f64>, planes: &[RoofPlane]) -> Vec<MultiPolygon<f64>> {
    let over: Vec<Vec<DVec2>> = planes.iter().map(|plane| plane.over.map_or_else(Vec::new, Vec::from)).collect();
    let patch = |i: usize| {
        let others = (0..planes.len()).filter(|j| *j != i);
        others.fold(region.intersection(&polygon(&over[i])), |patch, j| {
            let lead = above(&planes[j], &planes[i]);
            // Slopes of bodies that are in line are one plane but for rounding: the first has them.
            let is_same = over[j].iter().all(|corner| lead.height_m(*corner).abs() < SAME_PLANE_M);
            let higher = match (is_same, j < i) {
                (true, true) => over[j].clone(),
                (true, false) => Vec::new(),
                (false, _) => clipped(&over[j], &lead),
            };
            if higher.len() < 3 { patch } else { patch.difference(&polygon(&higher)) }
        })
    };
    (0..planes.len()).map(patch).collect()
}

/// The part of a region where a plane is the lowest.
fn lowest(region: &MultiPolygon<f64>, plane: &RoofPlane, planes: &[RoofPlane]) -> MultiPolygon<f64> {
    let corners = region.iter().flat_map(|polygon| polygon.exterior().coords()).map(|c| DVec2::new(c.x, c.y));
    let (low, high) =
        corners.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), corner| (low.min(corner), high.max(corner)));
    let around =
        vec![low - 1.0, DVec2::new(high.x + 1.0, low.y - 1.0), high + 1.0, DVec2::new(low.x - 1.0, high.y + 1.0)];
    let others = planes.iter().filter(|other| *other != plane);
    let part = others.fold(around, |part, other| clipped(&part, &above(other, plane)));
    if part.len() < 3 { MultiPolygon::new(Vec::new()) } else { region.intersection(&polygon(&part)) }
}

/// By how much one plane is above another.
fn above(one: &RoofPlane, other: &RoofPlane) -> RoofPlane {
    RoofPlane { over: None, slope: one.slope - other.slope, level_m: one.level_m - other.level_m }
}

/// The part of a convex ring where a plane is above zero.
fn clipped(ring: &[DVec2], plane: &RoofPlane) -> Vec<DVec2> {
    let mut part = Vec::with_capacity(ring.len() + 1);
    for (i, &from) in ring.iter().enumerate() {
        let to = ring[(i + 1) % ring.len()];
        let (at_from, at_to) = (plane.height_m(from), plane.height_m(to));
        if at_from > 0.0 {
            part.push(from);
        }
        if (at_from > 0.0) != (at_to > 0.0) {
            part.push(from + at_from / (at_from - at_to) * (to - from));
        }
    }
    part
}

fn polygon(ring: &[DVec2]) -> Polygon<f64> {
    let closed = ring.iter().chain(ring.first()).map(|p| Coord { x: p.x, y: p.y });
    Polygon::new(closed.collect::<LineString<f64>>(), Vec::new())
}
