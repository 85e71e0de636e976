//! From dense rings to the outlines a planner would draw: few corners, straight walls, shared borders kept shared.
//!
//! 1. Rings are cut into *arcs* at junctions, so that a wall between two buildings exists once.
//! 2. Douglas-Peucker per arc, tolerance in metres on the ground (doi:10.3138/FM57-6770-U75U-7727).
//! 3. Each piece gets the line of least squares through its own points, ends left out, because corners of contours are
//!    round.
//! 4. Optionally, lines within a few degrees of their building's main direction or across it are turned into it.
//! 5. Each corner moves to where its lines meet: `min Σ (nᵢ·(x − cᵢ))² + λ |x − x₀|²`, with the small pull `λ` towards
//!    the contour that keeps nearly parallel lines from meeting far away.
//! 6. Where an outline then touches itself or a neighbour, or its area changed too much, its arcs step back: first
//!    without 4, then without 3 to 5, then with ever smaller tolerances, down to the contour itself.
//!
//! Frame: map, metres, `y` up.

use std::collections::HashMap;

use geo::{Area as _, Contains as _};
use geo_types::{Coord, LineString, Polygon};

use super::arcs::{Arc, Arcs};
use super::check;
use super::partition::{Key, Ring};

/// Pull of a corner towards its place on the contour, against a weight of 1 per line.
const PULL: f64 = 0.02;
/// Share of a piece's points left out at each end before its line is fitted.
const ROUND_END_SHARE: f64 = 0.15;
/// Corners that turn by less are none, degrees.
const STRAIGHT_DEG: f64 = 3.0;
/// Corners that turn by more are spikes, degrees.
const SPIKE_DEG: f64 = 165.0;
/// Least share of a building's walls along its main directions for these to be called so.
const MIN_ALIGNED_SHARE: f64 = 0.5;
/// Steps back of an arc: see the module.
const LAST_LEVEL: u8 = 6;

/// How outlines are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rules {
    /// Douglas-Peucker's tolerance, metres.
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

/// An outline and the region it is of.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shaped {
    /// The region's label.
    pub label: u32,
    /// Exterior counter-clockwise, holes clockwise; no ring touches itself or another.
    pub polygon: Polygon<f64>,
}

/// Draws all regions; a region of several parts gives several outlines, in the order of the rings.
pub(super) fn shape(rings: &[Ring], rules: Rules) -> Vec<Shaped> {
    let arcs = Arcs::of(rings);
    let contours = polygons(rings, &arcs, &vec![LAST_LEVEL; arcs.arcs.len()], rules);
    let contour_m2 =
        |label: u32, at: usize| contours.iter().find(|c| c.label == label && c.ring == at).map(|c| c.area_m2);
    let mut levels = vec![u8::from(rules.snap_deg <= 0.0); arcs.arcs.len()];
    for _ in 0..=usize::from(LAST_LEVEL) {
        let drawn = polygons(rings, &arcs, &levels, rules);
        let mut bad: Vec<usize> = Vec::new();
        for one in &drawn {
            let changed = contour_m2(one.label, one.ring)
                .is_none_or(|before| (one.area_m2 - before).abs() > rules.max_area_change * before);
            if changed || check::fault(&one.polygon).is_some() {
                bad.extend(&one.arcs);
            }
        }
        // A hole or part that vanished was too small for the tolerance.
        let is_drawn = |c: &Drawn| drawn.iter().any(|d| d.label == c.label && d.ring == c.ring);
        bad.extend(contours.iter().filter(|c| !is_drawn(c)).flat_map(|c| &c.arcs));
        bad.extend(crossings_between(&drawn));
        bad.sort_unstable();
        bad.dedup();
        bad.retain(|&arc| levels[arc] < LAST_LEVEL);
        if bad.is_empty() {
            return drawn.into_iter().map(|d| Shaped { label: d.label, polygon: d.polygon }).collect();
        }
        for arc in bad {
            levels[arc] += 1;
        }
    }
    contours.into_iter().map(|c| Shaped { label: c.label, polygon: c.polygon }).collect()
}

/// One polygon with where it came from.
struct Drawn {
    label: u32,
    /// Its exterior ring.
    ring: usize,
    polygon: Polygon<f64>,
    area_m2: f64,
    arcs: Vec<usize>,
}

/// Arcs of polygons of different regions that cross each other.
fn crossings_between(drawn: &[Drawn]) -> Vec<usize> {
    use geo::{BoundingRect as _, Intersects as _, Relate as _};
    let mut bad = Vec::new();
    for (i, a) in drawn.iter().enumerate() {
        let Some(box_a) = a.polygon.bounding_rect() else { continue };
        for b in &drawn[i + 1..] {
            let Some(box_b) = b.polygon.bounding_rect() else { continue };
            if !box_a.intersects(&box_b) {
                continue;
            }
            let is_apart = {
                let matrix = a.polygon.relate(&b.polygon);
                matrix.is_touches() || matrix.is_disjoint()
            };
            if !is_apart {
                bad.extend(a.arcs.iter().chain(&b.arcs));
            }
        }
    }
    bad
}

fn polygons(rings: &[Ring], arcs: &Arcs, levels: &[u8], rules: Rules) -> Vec<Drawn> {
    let corners = Corners::of(arcs, levels, rules);
    let closed: Vec<(usize, LineString<f64>, f64)> = (0..rings.len())
        .filter_map(|i| {
            let ring = corners.ring(arcs, i);
            let area = signed_area(&ring);
            (ring.0.len() >= 4).then_some((i, ring, area))
        })
        .collect();
    // The region is on the right of its rings with `y` up: exteriors have negative areas.
    let mut drawn: Vec<Drawn> = closed
        .iter()
        .filter(|(.., area)| *area < 0.0)
        .map(|(i, ring, area)| {
            let exterior = LineString::new(ring.0.iter().rev().copied().collect());
            let polygon = Polygon::new(exterior, Vec::new());
            Drawn { label: rings[*i].label, ring: *i, polygon, area_m2: -area, arcs: arcs.of_ring(*i) }
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

/// A line through a point.
#[derive(Debug, Clone, Copy)]
struct Line {
    centre: Coord<f64>,
    along: Coord<f64>,
    length_m: f64,
}

/// The corners of all arcs.
struct Corners {
    /// Per arc, positions of the kept points with their final places.
    arcs: Vec<Vec<Coord<f64>>>,
}

impl Corners {
    fn of(arcs: &Arcs, levels: &[u8], rules: Rules) -> Self {
        if levels.iter().all(|&level| level >= LAST_LEVEL) {
            return Self { arcs: arcs.arcs.iter().map(|arc| arc.points.clone()).collect() };
        }
        let kept: Vec<Vec<usize>> = arcs.arcs.iter().zip(levels).map(|(arc, &level)| keep(arc, level, rules)).collect();
        let mut lines: Vec<Vec<Line>> = arcs
            .arcs
            .iter()
            .zip(&kept)
            .map(|(arc, kept)| kept.windows(2).map(|w| fit(&arc.points[w[0]..=w[1]])).collect())
            .collect();
        if rules.snap_deg > 0.0 {
            turn(arcs, levels, &mut lines, rules);
        }
        // Lines that meet at each junction, with how far the arc may be moved.
        let mut at_junction: HashMap<Key, Vec<Line>> = HashMap::new();
        let mut is_fixed: HashMap<Key, bool> = HashMap::new();
        for ((arc, lines), &level) in arcs.arcs.iter().zip(&lines).zip(levels) {
            if arc.is_closed {
                continue;
            }
            for (key, line) in [(arc.first, lines.first()), (arc.last, lines.last())] {
                at_junction.entry(key).or_default().extend(line.copied());
                *is_fixed.entry(key).or_default() |= level > 1;
            }
        }
        let arcs = arcs
            .arcs
            .iter()
            .enumerate()
            .map(|(a, arc)| {
                let (kept, lines) = (&kept[a], &lines[a]);
                let last = kept.len() - 1;
                let place = |k: usize| {
                    let on_contour = arc.points[kept[k]];
                    let is_end = k == 0 || k == last;
                    if is_end && !arc.is_closed {
                        let key = if k == 0 { arc.first } else { arc.last };
                        return if is_fixed[&key] { on_contour } else { meet(&at_junction[&key], on_contour, rules) };
                    }
                    if levels[a] > 1 {
                        return on_contour;
                    }
                    let before = lines[if k == 0 { last - 1 } else { k - 1 }];
                    let after = lines[if k == last { 0 } else { k }];
                    meet(&[before, after], on_contour, rules)
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

/// Which points of an arc stay, first and last included.
fn keep(arc: &Arc, level: u8, rules: Rules) -> Vec<usize> {
    let last = arc.points.len() - 1;
    let tolerance_m = match level {
        0..=2 => rules.tolerance_m,
        3 => 0.5 * rules.tolerance_m,
        4 => 0.25 * rules.tolerance_m,
        5 => 0.1 * rules.tolerance_m,
        _ => return (0..=last).collect(),
    };
    let mut kept = vec![0, last];
    let split = |from: usize, to: usize, kept: &mut Vec<usize>| {
        let mut open = vec![(from, to)];
        while let Some((from, to)) = open.pop() {
            if let Some((far, distance_m)) = farthest(&arc.points, from, to)
                && distance_m > tolerance_m
            {
                kept.push(far);
                open.extend([(from, far), (far, to)]);
            }
        }
    };
    if arc.is_closed {
        // The arc starts at its point farthest from the middle; the point farthest from there is the other anchor.
        let start = arc.points[0];
        let distance = |i: &usize| (arc.points[*i] - start).x.hypot((arc.points[*i] - start).y);
        let anchor = (1..last).max_by(|a, b| distance(a).total_cmp(&distance(b)).then(b.cmp(a))).unwrap_or(last / 2);
        kept.push(anchor);
        split(0, anchor, &mut kept);
        split(anchor, last, &mut kept);
        if kept.len() < 4 {
            // Three corners at least.
            let far = [(0, anchor), (anchor, last)].into_iter().filter_map(|(a, b)| farthest(&arc.points, a, b));
            kept.extend(far.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i));
        }
    } else {
        split(0, last, &mut kept);
    }
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// The point between two that is farthest from the line through them.
fn farthest(points: &[Coord<f64>], from: usize, to: usize) -> Option<(usize, f64)> {
    let (a, b) = (points[from], points[to]);
    let along = b - a;
    let length = along.x.hypot(along.y);
    let distance = |p: Coord<f64>| {
        let q = p - a;
        if length == 0.0 {
            return q.x.hypot(q.y);
        }
        let t = ((q.x * along.x + q.y * along.y) / (length * length)).clamp(0.0, 1.0);
        (q.x - t * along.x).hypot(q.y - t * along.y)
    };
    (from + 1..to).map(|i| (i, distance(points[i]))).reduce(|best, next| if next.1 > best.1 { next } else { best })
}

/// The line of total least squares through the inner points of a piece.
fn fit(points: &[Coord<f64>]) -> Line {
    let n = points.len();
    let (first, last) = (points[0], points[n - 1]);
    let chord = last - first;
    let length_m = chord.x.hypot(chord.y);
    let skip = ((n as f64 * ROUND_END_SHARE).ceil() as usize).min(n.saturating_sub(3) / 2);
    let inner = &points[skip..n - skip];
    if inner.len() < 3 || length_m == 0.0 {
        let along = if length_m > 0.0 { chord / length_m } else { Coord { x: 1.0, y: 0.0 } };
        return Line { centre: (first + last) / 2.0, along, length_m };
    }
    let mean = inner.iter().fold(Coord::zero(), |sum, p| sum + *p) / inner.len() as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in inner {
        let d = *p - mean;
        xx += d.x * d.x;
        xy += d.x * d.y;
        yy += d.y * d.y;
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    Line { centre: mean, along: Coord { x: angle.cos(), y: angle.sin() }, length_m }
}

/// Turns the lines of each building into its main directions.
fn turn(arcs: &Arcs, levels: &[u8], lines: &mut [Vec<Line>], rules: Rules) {
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
            let off = off_direction(line, direction);
            let shift_m = 0.5 * line.length_m * off.sin().abs();
            if off.abs() <= rules.snap_deg.to_radians() && shift_m <= rules.max_shift_m {
                let angle = line.along.y.atan2(line.along.x) - off;
                line.along = Coord { x: angle.cos(), y: angle.sin() };
            }
        }
    }
}

/// By how much a line is off a direction or across it, radians, −45° to 45°.
fn off_direction(line: &Line, direction: f64) -> f64 {
    let quarter = std::f64::consts::FRAC_PI_2;
    let off = (line.along.y.atan2(line.along.x) - direction).rem_euclid(quarter);
    if off > 0.5 * quarter { off - quarter } else { off }
}

/// The direction (radians, modulo a right angle) that most of the walls follow, if any: the mean of the fourfold
/// angles by length, then the mean of those near it.
fn main_direction(lines: &[Line], within_deg: f64) -> Option<f64> {
    let mean_of = |weights: &dyn Fn(&Line) -> f64| {
        let (mut x, mut y) = (0.0, 0.0);
        for line in lines {
            let angle = 4.0 * line.along.y.atan2(line.along.x);
            x += weights(line) * angle.cos();
            y += weights(line) * angle.sin();
        }
        0.25 * y.atan2(x)
    };
    let total: f64 = lines.iter().map(|l| l.length_m).sum();
    let mut direction = mean_of(&|l| l.length_m * l.length_m);
    for _ in 0..3 {
        let is_near = |l: &Line| off_direction(l, direction).abs() <= within_deg.to_radians();
        direction = mean_of(&|l| if is_near(l) { l.length_m * l.length_m } else { 0.0 });
    }
    let aligned: f64 =
        lines.iter().filter(|l| off_direction(l, direction).abs() <= within_deg.to_radians()).map(|l| l.length_m).sum();
    (aligned >= MIN_ALIGNED_SHARE * total).then_some(direction)
}

/// Where lines meet, near `at`.
fn meet(lines: &[Line], at: Coord<f64>, rules: Rules) -> Coord<f64> {
    let (mut xx, mut xy, mut yy) = (PULL, 0.0, PULL);
    let (mut bx, mut by) = (0.0, 0.0);
    for line in lines {
        let n = Coord { x: -line.along.y, y: line.along.x };
        let d = (line.centre.x - at.x) * n.x + (line.centre.y - at.y) * n.y;
        xx += n.x * n.x;
        xy += n.x * n.y;
        yy += n.y * n.y;
        bx += n.x * d;
        by += n.y * d;
    }
    let det = xx * yy - xy * xy;
    let shift = Coord { x: (yy * bx - xy * by) / det, y: (xx * by - xy * bx) / det };
    if shift.x.hypot(shift.y) > rules.max_shift_m { at } else { at + shift }
}
