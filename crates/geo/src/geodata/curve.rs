//! Circular arcs as chains of short lines.

use geo_types::Coord;

/// Largest turn between two points of a linearised arc, radians (GDAL's own default of 4°).
const MAX_STEP_RAD: f64 = 4.0 * std::f64::consts::PI / 180.0;

/// Appends the arc from `start` through `via` to `end`, without `start` itself. Where both ends coincide it is the
/// full circle with `start` and `via` opposite; three points in a line are a line.
pub(super) fn append_arc(line: &mut Vec<Coord<f64>>, start: Coord<f64>, via: Coord<f64>, end: Coord<f64>) {
    let Some((centre, turn_rad)) = centre_and_turn(start, via, end) else {
        line.extend([via, end]);
        return;
    };
    let n_steps = (turn_rad.abs() / MAX_STEP_RAD).ceil().clamp(2.0, 200.0) as usize;
    let radius = start - centre;
    for step in 1..n_steps {
        let (sin, cos) = (turn_rad * step as f64 / n_steps as f64).sin_cos();
        line.push(centre + Coord { x: cos * radius.x - sin * radius.y, y: sin * radius.x + cos * radius.y });
    }
    line.push(end);
}

/// Centre of the circle through three points, and the signed angle from the first past the second to the third.
fn centre_and_turn(a: Coord<f64>, b: Coord<f64>, c: Coord<f64>) -> Option<(Coord<f64>, f64)> {
    const FULL: f64 = std::f64::consts::TAU;
    if a == c {
        return (a != b).then(|| ((a + b) / 2.0, FULL));
    }
    // Relative to `a`, so that large map coordinates cost no digits.
    let (u, v) = (b - a, c - a);
    let cross = u.x * v.y - u.y * v.x;
    let (uu, vv) = (u.x * u.x + u.y * u.y, v.x * v.x + v.y * v.y);
    if cross.abs() <= 1e-9 * uu.max(vv) {
        return None;
    }
    let centre = a + Coord { x: v.y * uu - u.y * vv, y: u.x * vv - v.x * uu } / (2.0 * cross);
    let bearing = |p: Coord<f64>| (p.y - centre.y).atan2(p.x - centre.x);
    let left_turn_rad = (bearing(c) - bearing(a)).rem_euclid(FULL);
    Some((centre, if cross > 0.0 { left_turn_rad } else { left_turn_rad - FULL }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc(start: (f64, f64), via: (f64, f64), end: (f64, f64)) -> Vec<Coord<f64>> {
        let mut line = vec![start.into()];
        append_arc(&mut line, start.into(), via.into(), end.into());
        line
    }

    #[test]
    fn points_lie_on_the_circle_on_the_side_of_the_middle_point() {
        for (via_y, expected_sign) in [(1.0, 1.0), (-1.0, -1.0)] {
            let line = arc((1.0, 0.0), (0.0, via_y), (-1.0, 0.0));
            assert_eq!(line.len(), 46, "180° in steps of 4°");
            assert!(line.iter().all(|p| (p.x.hypot(p.y) - 1.0).abs() < 1e-12));
            assert!(line[1..45].iter().all(|p| p.y * expected_sign > 0.0));
        }
    }

    #[test]
    fn coinciding_ends_are_a_circle_and_collinear_points_a_line() {
        let circle = arc((1.0, 0.0), (-1.0, 0.0), (1.0, 0.0));
        assert!(circle.len() > 80 && circle.iter().all(|p| (p.x.hypot(p.y) - 1.0).abs() < 1e-12));
        assert_eq!(arc((0.0, 0.0), (1.0, 1.0), (2.0, 2.0)).len(), 3);
    }
}
