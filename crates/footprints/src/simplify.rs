//! Which points of an arc become corners.
//!
//! 1. Douglas-Peucker, tolerance in metres on the ground (doi:10.3138/FM57-6770-U75U-7727).
//! 2. What noise left of a contour's walls is put right, each step within the same bounds:
//!    - a bend goes if one line fits both of its walls within the tolerance;
//!    - a step goes if one line fits all three of its walls within the tolerance;
//!    - a corner that was cut off comes back where its walls meet, if that is no farther than a corner may move.
//!
//! Frame: map, metres.

use std::borrow::Cow;

use geo_types::Coord;

use super::arcs::Arc;
use super::lines::FittedLine;
use super::shape::DrawingRules;

/// Walls that turn by more are no bend of one wall: cosine of 25°.
const COS_BEND: f64 = 0.906;

/// Closeness with which an arc is followed: see [`super::shape`].
pub(super) type DetailLevel = u8;
/// From here on corners stay on the contour.
pub(super) const ON_CONTOUR: DetailLevel = 2;
/// The closest level: all points of the contour.
pub(super) const LAST_LEVEL: DetailLevel = 6;

/// An arc's points and which of them are corners, first and last included.
pub(super) struct Traced<'a> {
    /// Those of the arc; of a closed one they may start at another corner.
    pub points: Cow<'a, [Coord<f64>]>,
    /// Positions among them, rising.
    pub corners: Vec<usize>,
}

impl Traced<'_> {
    /// The points of each wall, in order.
    pub(super) fn walls(&self) -> impl Iterator<Item = &[Coord<f64>]> {
        self.corners.windows(2).map(|w| &self.points[w[0]..=w[1]])
    }
}

/// The corners of an arc.
pub(super) fn trace(arc: &Arc, level: DetailLevel, rules: DrawingRules) -> Traced<'_> {
    let tolerance_m = match level {
        0..=2 => rules.tolerance_m,
        3 => 0.5 * rules.tolerance_m,
        4 => 0.25 * rules.tolerance_m,
        5 => 0.1 * rules.tolerance_m,
        _ => {
            return Traced { points: Cow::Borrowed(&arc.points), corners: (0..arc.points.len()).collect() };
        }
    };
    let mut traced = Traced {
        corners: douglas_peucker(&arc.points, arc.is_closed, tolerance_m),
        points: Cow::Borrowed(&arc.points),
    };
    if level >= ON_CONTOUR {
        return traced;
    }
    let least = if arc.is_closed { 4 } else { 2 };
    tidy(&mut traced, least, rules);
    if arc.is_closed {
        // The corner at which it starts may be as superfluous as any other.
        start_elsewhere(&mut traced);
        tidy(&mut traced, least, rules);
    }
    traced
}

fn douglas_peucker(points: &[Coord<f64>], is_closed: bool, tolerance_m: f64) -> Vec<usize> {
    let last = points.len() - 1;
    let mut kept = vec![0, last];
    let split = |from: usize, to: usize, kept: &mut Vec<usize>| {
        let mut open = vec![(from, to)];
        while let Some((from, to)) = open.pop() {
            if let Some((far, distance_m)) = farthest(points, from, to)
                && distance_m > tolerance_m
            {
                kept.push(far);
                open.extend([(from, far), (far, to)]);
            }
        }
    };
    if is_closed {
        // The arc starts at its point farthest from the middle; the point farthest from there is the other anchor.
        let start = points[0];
        let distance = |i: &usize| (points[*i] - start).x.hypot((points[*i] - start).y);
        let anchor = (1..last).max_by(|a, b| distance(a).total_cmp(&distance(b)).then(b.cmp(a))).unwrap_or(last / 2);
        kept.push(anchor);
        split(0, anchor, &mut kept);
        split(anchor, last, &mut kept);
        if kept.len() < 4 {
            // Three corners at least.
            let far = [(0, anchor), (anchor, last)].into_iter().filter_map(|(a, b)| farthest(points, a, b));
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

/// Starts a closed arc at the corner half way round.
fn start_elsewhere(traced: &mut Traced<'_>) {
    let (n, half) = (traced.points.len() - 1, (traced.corners.len() - 1) / 2);
    let start = traced.corners[half];
    let points = (0..=n).map(|i| traced.points[(start + i) % n]).collect();
    let n_corners = traced.corners.len() - 1;
    let mut corners: Vec<usize> =
        (0..n_corners).map(|k| (traced.corners[(half + k) % n_corners] + n - start) % n).collect();
    corners.push(n);
    *traced = Traced { points: Cow::Owned(points), corners };
}

/// Takes out what is no corner; the first and the last stay.
fn tidy(traced: &mut Traced<'_>, least: usize, rules: DrawingRules) {
    let mut k = 1;
    while k + 1 < traced.corners.len() {
        let room = traced.corners.len().saturating_sub(least);
        if room >= 1 && is_bend(traced, k, rules) {
            traced.corners.remove(k);
        } else if room >= 2 && k + 2 < traced.corners.len() && is_step(traced, k, rules) {
            traced.corners.drain(k..k + 2);
        } else if let Some(corner) = cut_off_corner(traced, k, rules).filter(|_| room >= 1) {
            traced.corners[k] = corner;
            traced.corners.remove(k + 1);
        } else {
            k += 1;
            continue;
        }
        // The walls before have changed.
        k = k.saturating_sub(2).max(1);
    }
}

/// Whether the walls on both sides of a corner are one.
fn is_bend(traced: &Traced<'_>, k: usize, rules: DrawingRules) -> bool {
    let at = &traced.corners;
    goes_on(traced, k - 1, k) && is_one_wall(&traced.points[at[k - 1]..=at[k + 1]], rules.tolerance_m)
}

/// Whether the wall after a corner is a small step within one.
fn is_step(traced: &Traced<'_>, k: usize, rules: DrawingRules) -> bool {
    let at = &traced.corners;
    length_m(chord(traced, k)) <= 2.0 * rules.max_shift_m
        && goes_on(traced, k - 1, k + 1)
        && is_one_wall(&traced.points[at[k - 1]..=at[k + 2]], rules.tolerance_m)
}

/// The point nearest to the corner that the wall after `k` cuts off, if it does.
fn cut_off_corner(traced: &Traced<'_>, k: usize, rules: DrawingRules) -> Option<usize> {
    let (at, points) = (&traced.corners, &traced.points);
    let cut_m = length_m(chord(traced, k));
    let is_short = k + 2 < at.len() && cut_m <= 2.0 * rules.max_shift_m;
    if !is_short || cut_m > length_m(chord(traced, k - 1)) || cut_m > length_m(chord(traced, k + 1)) {
        return None;
    }
    let line = |k: usize| FittedLine::fit(&points[at[k]..=at[k + 1]]);
    let corner = line(k - 1).crossing(&line(k + 1))?;
    let distance_m = |i: usize| length_m(points[i] - corner);
    let is_near = distance_m(at[k]) <= rules.max_shift_m && distance_m(at[k + 1]) <= rules.max_shift_m;
    if !is_near {
        return None;
    }
    (at[k]..=at[k + 1]).min_by(|&a, &b| distance_m(a).total_cmp(&distance_m(b)))
}

/// Whether one wall has nearly the direction of another.
fn goes_on(traced: &Traced<'_>, a: usize, b: usize) -> bool {
    let (u, v) = (chord(traced, a), chord(traced, b));
    u.x * v.x + u.y * v.y > COS_BEND * length_m(u) * length_m(v)
}

fn is_one_wall(points: &[Coord<f64>], tolerance_m: f64) -> bool {
    let line = FittedLine::fit(points);
    points.iter().all(|p| line.distance_m(*p) <= tolerance_m)
}

/// From the corner at which a wall starts to the next one.
fn chord(traced: &Traced<'_>, k: usize) -> Coord<f64> {
    traced.points[traced.corners[k + 1]] - traced.points[traced.corners[k]]
}

fn length_m(v: Coord<f64>) -> f64 {
    v.x.hypot(v.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULES: DrawingRules =
        DrawingRules { tolerance_m: 0.4, snap_deg: 0.0, max_shift_m: 0.8, max_area_change: 0.1, min_hole_m2: 4.0 };

    /// A closed contour with a point every 0.2 m.
    fn contour(corners: &[(f64, f64)]) -> Traced<'static> {
        let mut points = Vec::new();
        for (i, &(x, y)) in corners.iter().enumerate() {
            let (to_x, to_y) = corners[(i + 1) % corners.len()];
            let n = ((to_x - x).hypot(to_y - y) / 0.2).ceil();
            points.extend((0..n as usize).map(|k| {
                let t = k as f64 / n;
                Coord { x: x + t * (to_x - x), y: y + t * (to_y - y) }
            }));
        }
        points.push(points[0]);
        Traced { corners: douglas_peucker(&points, true, RULES.tolerance_m), points: Cow::Owned(points) }
    }

    fn n_corners(corners: &[(f64, f64)]) -> usize {
        let mut traced = contour(corners);
        tidy(&mut traced, 4, RULES);
        start_elsewhere(&mut traced);
        tidy(&mut traced, 4, RULES);
        assert!(traced.corners.is_sorted() && traced.corners[0] == 0);
        assert_eq!(*traced.corners.last().unwrap(), traced.points.len() - 1);
        traced.corners.len() - 1
    }

    #[test]
    fn cut_off_corners_come_back_wherever_the_contour_starts() {
        let cut = [(0.5, 0.0), (20.0, 0.0), (20.0, 9.5), (19.4, 10.0), (0.0, 10.0), (0.0, 0.6)];
        for turn in 0..cut.len() {
            let mut corners = cut;
            corners.rotate_left(turn);
            assert_eq!(n_corners(&corners), 4, "{turn}");
        }
        // A slanted wall of two metres is no cut-off corner.
        assert_eq!(n_corners(&[(1.5, 0.0), (20.0, 0.0), (20.0, 10.0), (0.0, 10.0), (0.0, 1.5)]), 5);
    }

    #[test]
    fn a_bump_of_half_a_metre_goes_and_a_bay_of_one_stays() {
        let with_bay = |depth: f64| {
            n_corners(&[
                (0.0, 0.0),
                (9.0, 0.0),
                (9.3, -depth),
                (12.0, -depth),
                (12.3, 0.0),
                (20.0, 0.0),
                (20.0, 10.0),
                (0.0, 10.0),
            ])
        };
        assert_eq!(with_bay(0.45), 4);
        assert_eq!(with_bay(1.0), 8);
    }

    #[test]
    fn a_step_within_the_tolerance_goes_and_a_larger_one_stays() {
        let with_step = |depth: f64| {
            n_corners(&[(0.0, 0.0), (10.0, 0.0), (10.0, -depth), (20.0, -depth), (20.0, 10.0), (0.0, 10.0)])
        };
        assert_eq!(with_step(0.45), 4);
        assert_eq!(with_step(1.2), 6);
    }
}
