//! Straight walls through the points of a contour, their directions, and where they meet.
//!
//! Frame: map, metres.

use geo_types::Coord;

/// Pull of a corner towards its place on the contour, against a weight of 1 per line.
const PULL: f64 = 0.02;
/// Share of a piece's points left out at each end before its line is fitted.
const ROUND_END_SHARE: f64 = 0.15;
/// Least share of a building's walls along its main directions for these to be called so.
const MIN_ALIGNED_SHARE: f64 = 0.5;

/// A line through a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FittedLine {
    /// A point that the line goes through.
    pub centre: Coord<f64>,
    /// Direction, of length 1; which of its two ends is ahead is not told.
    pub along: Coord<f64>,
    /// Length of the piece that it was fitted to, metres.
    pub length_m: f64,
}

impl FittedLine {
    /// The line of total least squares through the inner points of a piece.
    pub(super) fn fit(points: &[Coord<f64>]) -> Self {
        let n = points.len();
        let (first, last) = (points[0], points[n - 1]);
        let chord = last - first;
        let length_m = chord.x.hypot(chord.y);
        let skip = ((n as f64 * ROUND_END_SHARE).ceil() as usize).min(n.saturating_sub(3) / 2);
        let inner = &points[skip..n - skip];
        if inner.len() < 3 || length_m == 0.0 {
            let along = if length_m > 0.0 { chord / length_m } else { Coord { x: 1.0, y: 0.0 } };
            return Self { centre: (first + last) / 2.0, along, length_m };
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
        Self { centre: mean, along: Coord { x: angle.cos(), y: angle.sin() }, length_m }
    }

    /// Distance of a point from it, metres.
    pub(super) fn distance_m(&self, at: Coord<f64>) -> f64 {
        let d = at - self.centre;
        (d.x * self.along.y - d.y * self.along.x).abs()
    }

    /// Point where it crosses another one; `None` for lines that are nearly parallel.
    pub(super) fn crossing(&self, other: &Self) -> Option<Coord<f64>> {
        /// Sine of the least angle between lines that cross: 30°.
        const LEAST_SIN: f64 = 0.5;
        let sin = self.along.x * other.along.y - self.along.y * other.along.x;
        if sin.abs() < LEAST_SIN {
            return None;
        }
        let d = other.centre - self.centre;
        Some(self.centre + self.along * ((d.x * other.along.y - d.y * other.along.x) / sin))
    }

    /// By how much it is off a direction or across it, radians, −45° to 45°.
    pub(super) fn off_direction(&self, direction: f64) -> f64 {
        let quarter = std::f64::consts::FRAC_PI_2;
        let off = (self.along.y.atan2(self.along.x) - direction).rem_euclid(quarter);
        if off > 0.5 * quarter { off - quarter } else { off }
    }
}

/// The direction (radians, modulo a right angle) that most of the walls follow, if any: the mean of the fourfold
/// angles by length, then the mean of those near it.
pub(super) fn main_direction(lines: &[FittedLine], within_deg: f64) -> Option<f64> {
    let mean_of = |weights: &dyn Fn(&FittedLine) -> f64| {
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
        let is_near = |l: &FittedLine| l.off_direction(direction).abs() <= within_deg.to_radians();
        direction = mean_of(&|l| if is_near(l) { l.length_m * l.length_m } else { 0.0 });
    }
    let aligned: f64 =
        lines.iter().filter(|l| l.off_direction(direction).abs() <= within_deg.to_radians()).map(|l| l.length_m).sum();
    (aligned >= MIN_ALIGNED_SHARE * total).then_some(direction)
}

/// Point where lines meet, near `at`; `at` itself if that is farther than `max_shift_m`.
pub(super) fn meet(lines: &[FittedLine], at: Coord<f64>, max_shift_m: f64) -> Coord<f64> {
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
    if shift.x.hypot(shift.y) > max_shift_m { at } else { at + shift }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_cross_where_walls_meet_and_parallel_ones_nowhere() {
        let wall = |x: f64, y: f64, degrees: f64| FittedLine {
            centre: Coord { x, y },
            along: Coord { x: degrees.to_radians().cos(), y: degrees.to_radians().sin() },
            length_m: 10.0,
        };
        let corner = wall(5.0, 0.0, 0.0).crossing(&wall(12.0, -7.0, 270.0)).unwrap();
        assert!((corner.x - 12.0).abs() < 1e-9 && corner.y.abs() < 1e-9, "{corner:?}");
        assert_eq!(wall(5.0, 0.0, 0.0).crossing(&wall(5.0, 1.0, 185.0)), None);
        assert!((wall(5.0, 0.0, 90.0).distance_m(Coord { x: 5.4, y: 33.0 }) - 0.4).abs() < 1e-9);
    }
}
