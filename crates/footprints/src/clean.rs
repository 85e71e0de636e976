//! From any polygon to one that can be extruded: snapped, simple, oriented, rings apart.
//!
//! 1. Snap corners to the output grid *first*: whatever is valid after that is valid in the files.
//! 2. Drop corners that coincide with their neighbour, and holes without area.
//! 3. Where rings cross, retrace or touch themselves: rebuild the area by the odd-even rule through a constrained
//!    triangulation (`geo::MakeValid`; Ledoux et al. 2014, doi:10.1016/j.cageo.2014.01.009), and accept it only if it
//!    is the area the footprint stated, within a tolerance: a bow-tie is refused, a crossing of a few centimetres is not.
//! 4. Where a hole touches another ring: draw it in by a centimetre.
//! 5. Where corners, or a corner and a wall, are nearer than [`LEAST_CLEARANCE_M`] (slits, spikes, necks, corners side by
//!    side): join them ([`super::clearance`]) and rebuild, so that no reader's tolerance makes them touch.

use std::cmp::Ordering;

use geo::buffer::{Buffer as _, BufferStyle, LineJoin};
use geo::orient::{Direction, Orient as _};
use geo::{Area as _, CoordsIter as _, MakeValid as _, Simplify as _};
use geo_types::{Coord, LineString, Polygon};

use super::check::{self, PolygonFault};
use super::clearance;

/// Beyond any projected coordinate on earth, metres: such numbers are damage, and triangulation would choke on them.
const FARTHEST_M: f64 = 1e9;
/// Distance by which a hole is drawn in from a ring it touches, metres: below what LOD1 means, above [`LEAST_CLEARANCE_M`].
const HOLE_GAP_M: f64 = 0.01;
/// The same in steps of the grid, where that is coarse: so many that rounding cannot close the gap again.
const HOLE_GAP_STEPS: f64 = 2.0;
/// Least distance of a corner from all others and from the edges it does not end, metres: twice the 1 mm that
/// validators take for one point, and the rounding of two corners to an output grid of 2 mm (1.4 mm each).
pub const LEAST_CLEARANCE_M: f64 = 0.005;
/// Holes and left-over parts below this are noise of digitising, m².
const SLIVER_M2: f64 = 0.01;

/// Rules that a polygon has to satisfy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CleaningRules {
    /// Corners lie on multiples of this, metres.
    pub grid_m: f64,
    /// Least area of a building, m².
    pub min_area_m2: f64,
    /// Most a repair may change the area, as a share of it.
    pub max_area_change: f64,
}

/// Polygons that can be extruded, and what had to be done to get there.
#[derive(Debug, Clone, PartialEq)]
pub struct Cleaned {
    /// Mostly one; several where the footprint fell apart at a point or a crossing.
    pub parts: Vec<Polygon<f64>>,
    /// In the order in which it was done.
    pub repairs: Vec<Repair>,
}

/// A change to a footprint that is worth telling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Repair {
    /// It crossed, touched or retraced itself here, and was rebuilt without change of area.
    Rebuilt(Coord<f64>),
    /// Holes without area were left out.
    HolesDropped(usize),
    /// A hole touched another ring here, and was drawn in by a centimetre.
    HoleDrawnIn(Coord<f64>),
    /// It had slits, spikes, necks or corners side by side, narrower than [`LEAST_CLEARANCE_M`], which were closed.
    Narrow {
        /// The first place of these, in the layer's CRS.
        place: Coord<f64>,
        /// Corners fewer than before; negative where a slit became a courtyard.
        n_corners: i64,
        /// Area more than before, m².
        area_m2: f64,
    },
}

/// Why a footprint cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Defect {
    /// A coordinate is `NaN`, infinite or off the planet.
    #[error("its footprint has coordinates that are no positions")]
    NotFinite,
    /// Fewer than three corners, or no area at all.
    #[error("its footprint encloses no area")]
    NoArea,
    /// Less than the least area.
    #[error("its area is {area_m2:.2} m², expected at least {min_area_m2} m²")]
    TooSmall {
        /// Area of the footprint, m².
        area_m2: f64,
        /// The least a building may have, m².
        min_area_m2: f64,
    },
    /// The rings cross, and it is not clear which area is meant.
    #[error("its footprint crosses itself, and {stated_m2:.2} m² of rings enclose {enclosed_m2:.2} m²")]
    Crossing {
        /// Area by the corners in their order, m².
        stated_m2: f64,
        /// Area by the odd-even rule, m².
        enclosed_m2: f64,
        /// Place where the rings meet.
        place: Coord<f64>,
    },
}

impl Defect {
    /// Machine-readable name of the defect, which stays the same from version to version.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotFinite => "footprint_not_finite",
            Self::NoArea => "footprint_no_area",
            Self::TooSmall { .. } => "footprint_too_small",
            Self::Crossing { .. } => "footprint_self_crossing",
        }
    }
}

/// Makes a polygon (map frame, metres) fit to be extruded: no ring touches itself or another, corners lie on the
/// grid, the exterior runs counter-clockwise and holes clockwise seen from above.
///
/// # Errors
/// [`Defect`] if there is no area, too little of it, or no telling which area is meant.
pub fn clean(polygon: &Polygon<f64>, rules: CleaningRules) -> Result<Cleaned, Defect> {
    let rings = || std::iter::once(polygon.exterior()).chain(polygon.interiors());
    let is_position = |c: &Coord<f64>| c.x.abs() < FARTHEST_M && c.y.abs() < FARTHEST_M; // false for NaN
    if !rings().flat_map(|ring| &ring.0).all(is_position) {
        return Err(Defect::NotFinite);
    }
    let mut repairs = Vec::new();
    let snapped = snap(polygon, rules.grid_m).ok_or(Defect::NoArea)?;
    let n_lost = polygon.interiors().len() - snapped.interiors().len();
    if n_lost > 0 {
        repairs.push(Repair::HolesDropped(n_lost));
    }
    let stated_m2 = stated_area_m2(&snapped);
    let n_corners = |polygons: &[Polygon<f64>]| polygons.iter().map(|p| p.coords_count() as i64).sum::<i64>();
    let n_stated = n_corners(std::slice::from_ref(&snapped));
    let parts = separate(snapped, rules, &mut repairs);
    let enclosed_m2: f64 = parts.iter().map(Polygon::unsigned_area).sum();
    for repair in &mut repairs {
        if let Repair::Narrow { n_corners: n_fewer, area_m2, .. } = repair {
            (*n_fewer, *area_m2) = (n_stated - n_corners(&parts), enclosed_m2 - stated_m2);
        }
    }

    if stated_m2.max(enclosed_m2) < SLIVER_M2 {
        return Err(Defect::NoArea);
    }
    // An area that the repair changed was not the area the footprint stated.
    if (enclosed_m2 - stated_m2).abs() > rules.max_area_change * stated_m2.max(enclosed_m2) {
        let place = repairs.iter().find_map(|repair| match repair {
            Repair::Rebuilt(place) | Repair::HoleDrawnIn(place) | Repair::Narrow { place, .. } => Some(*place),
            Repair::HolesDropped(_) => None,
        });
        let place = place.unwrap_or(polygon.exterior().0[0]);
        return Err(Defect::Crossing { stated_m2, enclosed_m2, place });
    }
    if enclosed_m2 < rules.min_area_m2 {
        return Err(Defect::TooSmall { area_m2: enclosed_m2, min_area_m2: rules.min_area_m2 });
    }
    // Of a footprint that fell apart, crumbs are no buildings of their own.
    let is_building = |part: &Polygon<f64>| part.unsigned_area() >= rules.min_area_m2.min(enclosed_m2 / 2.0);
    let parts = parts.iter().filter(|p| is_building(p)).map(|p| p.orient(Direction::Default)).collect();
    Ok(Cleaned { parts, repairs })
}

/// Area by the corners in their order: exterior minus holes.
fn stated_area_m2(polygon: &Polygon<f64>) -> f64 {
    let area = |ring: &LineString<f64>| Polygon::new(ring.clone(), Vec::new()).unsigned_area();
    area(polygon.exterior()) - polygon.interiors().iter().map(area).sum::<f64>()
}

/// Corners on the grid, without repetition; `None` if the exterior has no area left. Holes without area disappear.
fn snap(polygon: &Polygon<f64>, grid_m: f64) -> Option<Polygon<f64>> {
    let per_metre = 1.0 / grid_m;
    let on_grid = |v: f64| (v * per_metre).round() / per_metre + 0.0; // + 0.0 turns −0 into 0
    let ring = |ring: &LineString<f64>| {
        let mut corners: Vec<Coord<f64>> = ring.0.iter().map(|c| Coord { x: on_grid(c.x), y: on_grid(c.y) }).collect();
        corners.dedup();
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        let mut ring = LineString::new(corners);
        ring.close();
        (ring.0.len() >= 4).then_some(ring)
    };
    let is_hole = |hole: &LineString<f64>| Polygon::new(hole.clone(), Vec::new()).unsigned_area() >= SLIVER_M2;
    let holes = polygon.interiors().iter().filter_map(ring).filter(is_hole).collect();
    Some(Polygon::new(ring(polygon.exterior())?, holes))
}

/// Repairs until nothing touches or comes too near: a repair makes new corners, and snapping those can make new contacts.
fn separate(polygon: Polygon<f64>, rules: CleaningRules, repairs: &mut Vec<Repair>) -> Vec<Polygon<f64>> {
    const ROUNDS: usize = 8;
    let mut parts = vec![polygon];
    for _ in 0..ROUNDS {
        let mut next = Vec::with_capacity(parts.len());
        let mut is_done = true;
        for part in parts {
            let fixed = match (check::fault(&part), clearance::narrow(&part, LEAST_CLEARANCE_M)) {
                (None, None) => {
                    next.push(part);
                    continue;
                }
                (Some(fault), _) => repair(&part, fault, rules, repairs),
                (None, Some(place)) => {
                    tell(repairs, Repair::Narrow { place, n_corners: 0, area_m2: 0.0 });
                    widen(&part, rules)
                }
            };
            is_done = false;
            next.extend(fixed.iter().filter_map(|p| snap(p, rules.grid_m)).filter(|p| p.unsigned_area() >= SLIVER_M2));
        }
        parts = next;
        if is_done {
            return parts;
        }
    }
    parts.retain(|part| check::fault(part).is_none() && clearance::narrow(part, LEAST_CLEARANCE_M).is_none());
    parts
}

/// Each kind of repair is told once.
fn tell(repairs: &mut Vec<Repair>, repair: Repair) {
    let is_told = repairs.iter().any(|told| std::mem::discriminant(told) == std::mem::discriminant(&repair));
    if !is_told {
        repairs.push(repair);
    }
}

fn repair(
    polygon: &Polygon<f64>,
    fault: PolygonFault,
    rules: CleaningRules,
    repairs: &mut Vec<Repair>,
) -> Vec<Polygon<f64>> {
    match fault {
        PolygonFault::TooFewPoints => Vec::new(),
        PolygonFault::SelfContact(place) | PolygonFault::MisplacedHole(place) => {
            tell(repairs, Repair::Rebuilt(place));
            rebuilt(polygon)
        }
        PolygonFault::RingContact(place) => {
            // Rings that cross become rings that touch at most; only then is drawing in enough.
            tell(repairs, Repair::HoleDrawnIn(place));
            rebuilt(polygon).into_iter().map(|part| draw_holes_in(part, rules)).collect()
        }
    }
}

/// Polygons of what the rings enclose an odd number of times. They come in the order of a hash table, rings begin anywhere: both are sorted by corners.
fn rebuilt(polygon: &Polygon<f64>) -> Vec<Polygon<f64>> {
    let rebuilt = polygon.make_valid().map_or_else(|_| Vec::new(), |rebuilt| rebuilt.0);
    let before = |a: &Coord<f64>, b: &Coord<f64>| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y));
    let sorted = |ring: &LineString<f64>| {
        let edges = || ring.lines().enumerate();
        let first = edges().min_by(|(_, a), (_, b)| before(&a.start, &b.start).then_with(|| before(&a.end, &b.end)));
        let mut corners: Vec<Coord<f64>> = ring.lines().map(|edge| edge.start).collect();
        corners.rotate_left(first.map_or(0, |(at, _)| at));
        let mut ring = LineString::new(corners);
        ring.close();
        ring
    };
    let first_edges = |a: &LineString<f64>, b: &LineString<f64>| {
        a.0.iter().zip(&b.0).map(|(a, b)| before(a, b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
    };
    let part = |part: &Polygon<f64>| {
        let mut holes: Vec<LineString<f64>> = part.interiors().iter().map(sorted).collect();
        holes.sort_by(first_edges);
        Polygon::new(sorted(part.exterior()), holes)
    };
    let mut parts: Vec<Polygon<f64>> = rebuilt.iter().map(part).collect();
    parts.sort_by(|a, b| first_edges(a.exterior(), b.exterior()));
    parts
}

/// Joins what is too near; corners that then stand in a straight wall are left out.
fn widen(polygon: &Polygon<f64>, rules: CleaningRules) -> Vec<Polygon<f64>> {
    let Some(joined) = clearance::joined(polygon, LEAST_CLEARANCE_M) else { return Vec::new() };
    let sound = match check::fault(&joined) {
        Some(PolygonFault::SelfContact(_) | PolygonFault::MisplacedHole(_)) => rebuilt(&joined),
        // Rings that touch now are for the next round.
        Some(PolygonFault::RingContact(_) | PolygonFault::TooFewPoints) | None => vec![joined],
    };
    let tolerance_m = rules.grid_m.min(LEAST_CLEARANCE_M);
    sound.into_iter().map(|part| from_corners(&part).simplify(tolerance_m)).collect()
}

/// Rings that begin at a corner far from their middle: where they begin, nothing is ever left out.
fn from_corners(polygon: &Polygon<f64>) -> Polygon<f64> {
    let turned = |ring: &LineString<f64>| {
        let mut corners = ring.0[..ring.0.len().saturating_sub(1)].to_vec();
        let distance2 = |c: &Coord<f64>| (c.x - ring.0[0].x).powi(2) + (c.y - ring.0[0].y).powi(2);
        let farthest = (0..corners.len()).max_by(|&i, &j| distance2(&corners[i]).total_cmp(&distance2(&corners[j])));
        corners.rotate_left(farthest.unwrap_or(0));
        let mut ring = LineString::new(corners);
        ring.close();
        ring
    };
    Polygon::new(turned(polygon.exterior()), polygon.interiors().iter().map(turned).collect())
}

/// Distance by which holes are drawn in, metres.
#[must_use]
pub fn hole_gap_m(rules: CleaningRules) -> f64 {
    HOLE_GAP_M.max(HOLE_GAP_STEPS * rules.grid_m)
}

/// Every hole a centimetre smaller all round, so that it touches nothing.
fn draw_holes_in(polygon: Polygon<f64>, rules: CleaningRules) -> Polygon<f64> {
    if check::fault(&polygon).is_none() {
        return polygon;
    }
    let (exterior, holes) = polygon.into_inner();
    let inwards = BufferStyle::new(-hole_gap_m(rules)).line_join(LineJoin::Miter(0.5));
    let holes = holes
        .into_iter()
        .flat_map(|hole| Polygon::new(hole, Vec::new()).buffer_with_style(inwards.clone()).0)
        .map(|hole| hole.into_inner().0)
        .collect();
    Polygon::new(exterior, holes)
}

#[cfg(test)]
mod tests {
    use geo::Validation as _;
    use geo::polygon;
    use geo::winding_order::{Winding as _, WindingOrder};
    use proptest::prelude::*;

    use super::*;

    const RULES: CleaningRules = CleaningRules { grid_m: 0.001, min_area_m2: 1.0, max_area_change: 0.01 };

    fn square(side_m: f64) -> Polygon<f64> {
        polygon![(x: 0.0, y: 0.0), (x: 0.0, y: side_m), (x: side_m, y: side_m), (x: side_m, y: 0.0)]
    }

    #[test]
    fn a_clockwise_footprint_with_repeated_corners_comes_out_counter_clockwise_and_lean() {
        let mut corners = square(10.0).exterior().0.clone();
        corners.insert(1, Coord { x: 0.0002, y: 0.0001 });
        let cleaned = clean(&Polygon::new(LineString::new(corners), vec![]), RULES).unwrap();
        assert_eq!(cleaned.parts[0].exterior().0.len(), 5);
        assert_eq!(cleaned.parts[0].exterior().winding_order(), Some(WindingOrder::CounterClockwise));
        assert!(cleaned.repairs.is_empty());
    }

    #[test]
    fn a_bow_tie_is_refused_and_a_small_crossing_repaired() {
        let bow_tie = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 9.0), (x: 9.0, y: 0.0), (x: 0.0, y: 9.0)];
        assert!(matches!(clean(&bow_tie, RULES), Err(Defect::Crossing { .. })));
        // Closing the ring overshoots the first corner by 5 cm.
        let overshoot = polygon![
            (x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.05, y: 9.0), (x: 0.05, y: -0.05), (x: 0.0, y: 0.05),
        ];
        let cleaned = clean(&overshoot, RULES).unwrap();
        assert!(matches!(cleaned.repairs[..], [Repair::Rebuilt(_)]), "{cleaned:?}");
        assert_eq!(cleaned.parts.len(), 1);
    }

    #[test]
    fn a_repair_gives_the_same_rings_in_the_same_order_each_time() {
        // Two squares of 9 m that share a corner, and a courtyard that touches one of them.
        let courtyard = LineString::from(vec![(0.0, 4.0), (3.0, 2.0), (3.0, 6.0)]);
        let exterior =
            vec![(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (18.0, 9.0), (18.0, 18.0), (9.0, 18.0), (9.0, 9.0), (0.0, 9.0)];
        let touching = Polygon::new(LineString::from(exterior), vec![courtyard]);
        let parts = || clean(&touching, RULES).unwrap().parts;
        assert_eq!(parts().len(), 2);
        assert!((0..20).all(|_| parts() == parts()));
    }

    #[test]
    fn a_spike_disappears() {
        let spiky = polygon![
            (x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 15.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.0, y: 9.0),
        ];
        let cleaned = clean(&spiky, RULES).unwrap();
        assert!((cleaned.parts[0].unsigned_area() - 81.0).abs() < 1e-9);
        assert!(cleaned.parts[0].exterior().0.iter().all(|c| c.x <= 9.0));
    }

    #[test]
    fn a_hole_that_touches_the_footprint_is_drawn_in() {
        let courtyard = LineString::from(vec![(0.0, 4.0), (3.0, 2.0), (3.0, 6.0)]);
        let touching = Polygon::new(square(10.0).exterior().clone(), vec![courtyard]);
        let cleaned = clean(&touching, RULES).unwrap();
        assert!(matches!(cleaned.repairs[..], [Repair::HoleDrawnIn(_)]), "{cleaned:?}");
        assert_eq!(cleaned.parts[0].interiors().len(), 1);
        assert!((cleaned.parts[0].unsigned_area() - 94.0).abs() < 0.15, "{}", cleaned.parts[0].unsigned_area());
    }

    #[test]
    fn slits_and_spikes_thinner_than_a_reader_sees_are_closed_and_told_with_their_area() {
        let footprint = |tip_y: f64, width: f64| {
            polygon![
                (x: 0.0, y: 0.0), (x: 5.0, y: 0.0), (x: 5.0, y: tip_y), (x: 5.0 + width, y: 0.0), (x: 10.0, y: 0.0),
                (x: 10.0, y: 10.0), (x: 0.0, y: 10.0),
            ]
        };
        for (tip_y, width) in [(5.0, 0.001), (5.0, 0.004), (-3.0, 0.001), (-3.0, 0.004)] {
            let cleaned = clean(&footprint(tip_y, width), RULES).unwrap();
            let [Repair::Narrow { n_corners, area_m2, .. }] = cleaned.repairs[..] else { panic!("{cleaned:?}") };
            assert_eq!((cleaned.parts.len(), n_corners), (1, 3), "{cleaned:?}");
            assert!((area_m2 - tip_y * width / 2.0).abs() < 1e-6, "{area_m2}");
        }
        let kept = clean(&footprint(5.0, 0.02), RULES).unwrap();
        assert!(kept.repairs.is_empty(), "two centimetres are a joint between houses: {kept:?}");
    }

    #[test]
    fn corners_side_by_side_become_one() {
        let footprint = polygon![
            (x: 0.0, y: 0.0), (x: 10.0, y: 0.0), (x: 10.001, y: 0.0), (x: 10.0, y: 10.0), (x: 0.0, y: 10.0),
        ];
        let cleaned = clean(&footprint, RULES).unwrap();
        assert_eq!(cleaned.parts[0].exterior().0.len(), 5);
        assert!(matches!(cleaned.repairs[..], [Repair::Narrow { n_corners: 1, .. }]), "{cleaned:?}");
    }

    #[test]
    fn two_halves_that_meet_in_a_point_become_two_parts() {
        let hourglass = polygon![
            (x: 0.0, y: 0.0), (x: 4.0, y: 0.0), (x: 2.0, y: 2.0), (x: 4.0, y: 4.0), (x: 0.0, y: 4.0), (x: 2.0, y: 2.0),
        ];
        assert_eq!(clean(&hourglass, RULES).unwrap().parts.len(), 2);
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let not_a_number = polygon![(x: 0.0, y: 0.0), (x: f64::NAN, y: 1.0), (x: 1.0, y: 1.0)];
        assert_eq!(clean(&not_a_number, RULES), Err(Defect::NotFinite));
        let far = polygon![(x: 0.0, y: 0.0), (x: 1e300, y: 1.0), (x: 1.0, y: 1.0)];
        assert_eq!(clean(&far, RULES), Err(Defect::NotFinite));
        assert_eq!(clean(&Polygon::new(LineString::new(vec![]), vec![]), RULES), Err(Defect::NoArea));
        let line = polygon![(x: 0.0, y: 0.0), (x: 5.0, y: 5.0), (x: 9.0, y: 9.0)];
        assert_eq!(clean(&line, RULES), Err(Defect::NoArea));
        assert!(matches!(clean(&square(0.5), RULES), Err(Defect::TooSmall { .. })));
    }

    proptest! {
        /// Corners on a coarse lattice touch, coincide and cross far more often than real ones.
        #[test]
        fn whatever_comes_out_can_be_extruded(
            exterior in prop::collection::vec((0..12_i32, 0..12_i32), 3..12),
            hole in prop::collection::vec((0..12_i32, 0..12_i32), 0..6),
            shift in 0.0..1e6_f64,
            step in prop::sample::select(vec![1.0, 0.37, 0.000_4]),
        ) {
            let ring = |corners: &[(i32, i32)]| {
                corners.iter().map(|&(x, y)| (shift + step * x as f64, shift + step * y as f64)).collect::<LineString>()
            };
            let holes = if hole.len() < 3 { vec![] } else { vec![ring(&hole)] };
            let rules = CleaningRules { max_area_change: 1.0, min_area_m2: 0.01, ..RULES };
            if let Ok(cleaned) = clean(&Polygon::new(ring(&exterior), holes), rules) {
                prop_assert!(!cleaned.parts.is_empty());
                for part in &cleaned.parts {
                    prop_assert_eq!(check::fault(part), None);
                    prop_assert_eq!(clearance::narrow(part, LEAST_CLEARANCE_M), None);
                    prop_assert!(part.is_valid(), "geo disagrees: {:?}", part);
                    prop_assert_eq!(part.exterior().winding_order(), Some(WindingOrder::CounterClockwise));
                    prop_assert!(part.interiors().iter().all(geo::Winding::is_cw));
                }
            }
        }
    }
}
