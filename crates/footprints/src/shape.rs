//! From dense rings to the footprints a planner would draw: few corners, straight walls, shared borders kept shared.
//!
//! 1. Rings are cut into *arcs* at junctions, so that a wall between two buildings exists once.
//! 2. Corners are chosen per arc: see [`simplify`].
//! 3. Each piece gets the line of least squares through its own points, ends left out, because corners of contours are
//!    round.
//! 4. Optionally, lines within a few degrees of their building's main direction or across it are turned into it.
//! 5. Each corner moves to where its lines meet: `min Σ (nᵢ·(x − cᵢ))² + λ |x − x₀|²`, with the small pull `λ` towards
//!    the contour that keeps nearly parallel lines from meeting far away.
//! 6. Where a footprint then touches itself or a neighbour, the arcs that meet there step back, and all of its arcs where
//!    its area changed too much: first without 4, then without 3 to 5, then with ever smaller tolerances, down to the
//!    contour itself.
//!
//! Frame: map, metres, `y` up.

use std::collections::HashMap;

use geo::line_measures::{Distance as _, Euclidean};
use geo::{Area as _, BooleanOps as _, BoundingRect as _, Contains as _, Intersects as _, Relate as _};
use geo_types::{Coord, Geometry, LineString, Point, Polygon};

use super::arcs::Arcs;
use super::check;
use super::lines::{FittedLine, main_direction, meet};
use super::partition::{Key, LabelledRing};
use super::simplify::{DetailLevel, LAST_LEVEL, ON_CONTOUR, Traced, trace};

/// Corners that turn by less are none, degrees.
const STRAIGHT_DEG: f64 = 3.0;
/// Corners that turn by more are spikes, degrees.
const SPIKE_DEG: f64 = 165.0;
/// Arcs this close to a fault take part in it, metres.
const AT_FAULT_M: f64 = 0.01;
/// Rounds of steps back; more are needed only where faults wander, and then the contours themselves are taken.
const MAX_ROUNDS: u8 = 4 * LAST_LEVEL;

/// Rules for drawing footprints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DrawingRules {
    /// Tolerance of Douglas and Peucker's simplification, metres.
    pub tolerance_m: f64,
    /// Walls within this of a main direction are turned into it, degrees; 0: none.
    pub snap_deg: f64,
    /// Most that a corner may move off its contour, metres.
    pub max_shift_m: f64,
    /// Most that the area may change against the contour's, as a share of it.
    pub max_area_change: f64,
    /// Courtyards below this are filled, m².
    pub min_hole_m2: f64,
}

/// A footprint and the region it is of.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shaped {
    /// Label of the region.
    pub label: u32,
    /// Exterior counter-clockwise, holes clockwise; no ring touches itself or another.
    pub polygon: Polygon<f64>,
}

/// Draws all regions; a region of several parts gives several footprints, in the order of the rings.
pub(super) fn shape(rings: &[LabelledRing], rules: DrawingRules) -> Vec<Shaped> {
    let arcs = Arcs::of(rings);
    let as_they_are = ArcCorners::of(&arcs, &vec![LAST_LEVEL; arcs.arcs.len()], rules);
    let contours = polygons(rings, &arcs, &as_they_are, rules);
    let mut levels: Vec<DetailLevel> = vec![DetailLevel::from(rules.snap_deg <= 0.0); arcs.arcs.len()];
    for _ in 0..MAX_ROUNDS {
        let corners = ArcCorners::of(&arcs, &levels, rules);
        let drawn = polygons(rings, &arcs, &corners, rules);
        let bad = Faults { contours: &contours, drawn: &drawn, corners: &corners, levels: &levels }.arcs(rules);
        if bad.is_empty() {
            return drawn.into_iter().map(DrawnPolygon::shaped).collect();
        }
        for arc in bad {
            levels[arc] += 1;
        }
    }
    contours.into_iter().map(DrawnPolygon::shaped).collect()
}

/// Faults of a drawing.
struct Faults<'a> {
    contours: &'a [DrawnPolygon],
    drawn: &'a [DrawnPolygon],
    corners: &'a ArcCorners,
    levels: &'a [DetailLevel],
}

impl Faults<'_> {
    /// The arcs that have to follow their contours more closely.
    fn arcs(&self, rules: DrawingRules) -> Vec<usize> {
        let mut bad: Vec<usize> = Vec::new();
        let mut valid: Vec<&DrawnPolygon> = Vec::new();
        for one in self.drawn {
            let before = self.contours.iter().find(|c| c.is_same(one)).map(|c| c.area_m2);
            if before.is_none_or(|before| (one.area_m2 - before).abs() > rules.max_area_change * before) {
                bad.extend(&one.arcs);
            }
            match check::fault(&one.polygon) {
                Some(fault) => bad.extend(self.at(&one.arcs, fault.place().map(|c| Point::from(c).into()))),
                None => valid.push(one),
            }
        }
        // A hole or part that vanished was too small for the tolerance.
        let is_drawn = |c: &DrawnPolygon| self.drawn.iter().any(|d| d.is_same(c));
        bad.extend(self.contours.iter().filter(|c| !is_drawn(c)).flat_map(|c| &c.arcs));
        for (a, b) in pairs_that_overlap(&valid) {
            let arcs: Vec<usize> = a.arcs.iter().chain(&b.arcs).copied().collect();
            let shared = a.polygon.intersection(&b.polygon);
            bad.extend(self.at(&arcs, (!shared.0.is_empty()).then_some(Geometry::MultiPolygon(shared))));
        }
        bad.sort_unstable();
        bad.dedup();
        bad.retain(|&arc| self.levels[arc] < LAST_LEVEL);
        bad
    }

    /// Those of the arcs that pass by a place and can step back; all of them if none can.
    fn at(&self, arcs: &[usize], place: Option<Geometry<f64>>) -> Vec<usize> {
        let Some(place) = place else { return arcs.to_vec() };
        let passes = |&&arc: &&usize| {
            let line = LineString::new(self.corners.arcs[arc].clone());
            self.levels[arc] < LAST_LEVEL && Euclidean.distance(&line, &place) <= AT_FAULT_M
        };
        let near: Vec<usize> = arcs.iter().filter(passes).copied().collect();
        if near.is_empty() { arcs.to_vec() } else { near }
    }
}

/// Polygons of different regions that share more than a border.
fn pairs_that_overlap<'a>(drawn: &[&'a DrawnPolygon]) -> Vec<(&'a DrawnPolygon, &'a DrawnPolygon)> {
    let boxes: Vec<_> = drawn.iter().map(|d| d.polygon.bounding_rect()).collect();
    let mut pairs = Vec::new();
    for (i, &a) in drawn.iter().enumerate() {
        for (j, &b) in drawn.iter().enumerate().skip(i + 1) {
            let may_meet = matches!((&boxes[i], &boxes[j]), (Some(p), Some(q)) if p.intersects(q));
            if !may_meet {
                continue;
            }
            let matrix = a.polygon.relate(&b.polygon);
            if !(matrix.is_touches() || matrix.is_disjoint()) {
                pairs.push((a, b));
            }
        }
    }
    pairs
}

/// One polygon with where it came from.
struct DrawnPolygon {
    label: u32,
    /// Position of the exterior ring among the rings.
    ring: usize,
    polygon: Polygon<f64>,
    area_m2: f64,
    arcs: Vec<usize>,
}

impl DrawnPolygon {
    /// Whether both are the same part of the same region.
    fn is_same(&self, other: &Self) -> bool {
        self.label == other.label && self.ring == other.ring
    }

    fn shaped(self) -> Shaped {
        Shaped { label: self.label, polygon: self.polygon }
    }
}

fn polygons(rings: &[LabelledRing], arcs: &Arcs, corners: &ArcCorners, rules: DrawingRules) -> Vec<DrawnPolygon> {
    let closed: Vec<(usize, LineString<f64>, f64)> = (0..rings.len())
        .filter_map(|i| {
            let ring = corners.ring(arcs, i);
            let area = signed_area(&ring);
            (ring.0.len() >= 4).then_some((i, ring, area))
        })
        .collect();
    // The region is on the right of its rings with `y` up: exteriors have negative areas.
    let mut drawn: Vec<DrawnPolygon> = closed
        .iter()
        .filter(|(.., area)| *area < 0.0)
        .map(|(i, ring, area)| {
            let exterior = LineString::new(ring.0.iter().rev().copied().collect());
            let polygon = Polygon::new(exterior, Vec::new());
            DrawnPolygon { label: rings[*i].label, ring: *i, polygon, area_m2: -area, arcs: arcs.of_ring(*i) }
        })
        .collect();
    for (i, ring, area) in closed.iter().filter(|(.., area)| *area > 0.0) {
        let holds_others = rings[*i].beyond.iter().any(|&b| b != 0);
        if *area < rules.min_hole_m2 && !holds_others {
            continue;
        }
        let corner = ring.0[0];
        let around = drawn
            .iter_mut()
            .filter(|d| {
                d.label == rings[*i].label && Polygon::new(d.polygon.exterior().clone(), vec![]).contains(&corner)
            })
            .min_by(|a, b| a.polygon.unsigned_area().total_cmp(&b.polygon.unsigned_area()));
        if let Some(around) = around {
            around.polygon.interiors_push(LineString::new(ring.0.iter().rev().copied().collect()));
            around.area_m2 -= area;
            around.arcs.extend(arcs.of_ring(*i));
        }
    }
    drawn
}

fn signed_area(ring: &LineString<f64>) -> f64 {
    let Some(&first) = ring.0.first() else { return 0.0 };
    0.5 * ring
        .lines()
        .map(|l| (l.start.x - first.x) * (l.end.y - first.y) - (l.end.x - first.x) * (l.start.y - first.y))
        .sum::<f64>()
}

/// The corners of all arcs.
struct ArcCorners {
    /// Per arc, positions of the kept points with their final places.
    arcs: Vec<Vec<Coord<f64>>>,
}

impl ArcCorners {
    fn of(arcs: &Arcs, levels: &[DetailLevel], rules: DrawingRules) -> Self {
        if levels.iter().all(|&level| level >= LAST_LEVEL) {
            return Self { arcs: arcs.arcs.iter().map(|arc| arc.points.clone()).collect() };
        }
        let traced: Vec<Traced<'_>> =
            arcs.arcs.iter().zip(levels).map(|(arc, &level)| trace(arc, level, rules)).collect();
        let mut lines: Vec<Vec<FittedLine>> = traced.iter().map(|t| t.walls().map(FittedLine::fit).collect()).collect();
        if rules.snap_deg > 0.0 {
            turn(arcs, levels, &mut lines, rules);
        }
        // Lines that meet at each junction, with how far the arc may be moved.
        let mut at_junction: HashMap<Key, Vec<FittedLine>> = HashMap::new();
        let mut is_fixed: HashMap<Key, bool> = HashMap::new();
        for ((arc, lines), &level) in arcs.arcs.iter().zip(&lines).zip(levels) {
            if arc.is_closed {
                continue;
            }
            for (key, line) in [(arc.first, lines.first()), (arc.last, lines.last())] {
                at_junction.entry(key).or_default().extend(line.copied());
                *is_fixed.entry(key).or_default() |= level >= ON_CONTOUR;
            }
        }
        let arcs = arcs
            .arcs
            .iter()
            .enumerate()
            .map(|(a, arc)| {
                let (traced, lines) = (&traced[a], &lines[a]);
                let last = traced.corners.len() - 1;
                let place = |k: usize| {
                    let on_contour = traced.points[traced.corners[k]];
                    let is_end = k == 0 || k == last;
                    if is_end && !arc.is_closed {
                        let key = if k == 0 { arc.first } else { arc.last };
                        let is_fixed = is_fixed[&key];
                        return if is_fixed {
                            on_contour
                        } else {
                            meet(&at_junction[&key], on_contour, rules.max_shift_m)
                        };
                    }
                    if levels[a] >= ON_CONTOUR {
                        return on_contour;
                    }
                    let before = lines[if k == 0 { last - 1 } else { k - 1 }];
                    let after = lines[if k == last { 0 } else { k }];
                    meet(&[before, after], on_contour, rules.max_shift_m)
                };
                let corners: Vec<Coord<f64>> = (0..=last).map(place).collect();
                lean(corners, arc.is_closed, 0.25 * rules.tolerance_m)
            })
            .collect();
        Self { arcs }
    }

    /// A ring of the partition, closed.
    fn ring(&self, arcs: &Arcs, ring: usize) -> LineString<f64> {
        let mut corners: Vec<Coord<f64>> = Vec::new();
        for &(arc, is_reversed) in &arcs.rings[ring] {
            let points = &self.arcs[arc];
            let n = points.len() - 1;
            if is_reversed {
                corners.extend(points[1..=n].iter().rev());
            } else {
                corners.extend(&points[..n]);
            }
        }
        let mut ring = LineString::new(corners);
        ring.close();
        ring
    }
}

/// Corners that turn and are no spikes; ends stay.
fn lean(mut corners: Vec<Coord<f64>>, is_closed: bool, width_m: f64) -> Vec<Coord<f64>> {
    let least = if is_closed { 4 } else { 2 };
    let (cos_straight, cos_spike) = (STRAIGHT_DEG.to_radians().cos(), SPIKE_DEG.to_radians().cos());
    if is_closed {
        corners.pop();
    }
    let is_superfluous = |corners: &[Coord<f64>], i: usize| {
        let n = corners.len();
        let (a, b, c) = (corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]);
        let (u, v, chord) = (b - a, c - b, c - a);
        let lengths = ((u.x * u.x + u.y * u.y) * (v.x * v.x + v.y * v.y)).sqrt();
        let cos_turn = (u.x * v.x + u.y * v.y) / lengths;
        // A corner's offset from the line between its neighbours.
        let is_narrow = (u.x * v.y - u.y * v.x).powi(2) < width_m * width_m * (chord.x * chord.x + chord.y * chord.y);
        lengths == 0.0 || cos_turn < cos_spike || (cos_turn > cos_straight && is_narrow)
    };
    let mut i = 0;
    while i < corners.len() && corners.len() > least {
        let is_end = !is_closed && (i == 0 || i + 1 == corners.len());
        if !is_end && is_superfluous(&corners, i) {
            corners.remove(i);
            // The neighbours' turns have changed.
            i = i.saturating_sub(1);
        } else {
            i += 1;
        }
    }
    if is_closed {
        corners.push(corners[0]);
    }
    corners
}

/// Turns the lines of each building into its main directions.
fn turn(arcs: &Arcs, levels: &[DetailLevel], lines: &mut [Vec<FittedLine>], rules: DrawingRules) {
    let mut of_label: HashMap<u32, Option<f64>> = HashMap::new();
    for label in arcs.arcs.iter().flat_map(|arc| [arc.label, arc.beyond]).filter(|&l| l != 0) {
        of_label.entry(label).or_insert_with(|| {
            let own = arcs.arcs.iter().zip(lines.iter()).filter(|(arc, _)| arc.label == label || arc.beyond == label);
            main_direction(&own.flat_map(|(_, lines)| lines).copied().collect::<Vec<_>>(), rules.snap_deg)
        });
    }
    for ((arc, lines), &level) in arcs.arcs.iter().zip(lines).zip(levels) {
        let direction = [arc.label, arc.beyond].iter().find_map(|label| of_label.get(label).copied().flatten());
        let Some(direction) = direction.filter(|_| level == 0) else { continue };
        for line in lines {
            let off = line.off_direction(direction);
            let shift_m = 0.5 * line.length_m * off.sin().abs();
            if off.abs() <= rules.snap_deg.to_radians() && shift_m <= rules.max_shift_m {
                let angle = line.along.y.atan2(line.along.x) - off;
                line.along = Coord { x: angle.cos(), y: angle.sin() };
            }
        }
    }
}
