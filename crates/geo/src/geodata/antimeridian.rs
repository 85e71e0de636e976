//! Shapes across 180° of longitude, cut there as [RFC 7946](https://www.rfc-editor.org/rfc/rfc7946#section-3.1.9) wants it.
//!
//! Longitudes first run on beyond 180°, so that a shape is in one piece; then each turn of 360° is cut out and moved back.

use geo::orient::Direction;
use geo::{BooleanOps as _, BoundingRect as _, Closest, ClosestPoint as _, Distance as _, Euclidean, Orient as _};
use geo_types::{Coord, Line, LineString, Point, Polygon, Rect};
use geojson::Position;

const TURN_DEG: f64 = 360.0;
const HALF_TURN_DEG: f64 = 180.0;

/// Lets longitudes run on: none is more than half a turn from the one before it, the first from `near_deg`.
pub(super) fn run_on(line: &mut [Position], near_deg: f64) {
    let mut before_deg = near_deg;
    for at in line {
        at[0] -= TURN_DEG * ((at[0] - before_deg) / TURN_DEG).round();
        before_deg = at[0];
    }
}

/// The first and the last turn that a line reaches into, counted from the one around 0°; what ends at 180° stays before it.
fn turns<'a>(line: impl Iterator<Item = &'a Position>) -> (i64, i64) {
    let start = (f64::INFINITY, f64::NEG_INFINITY);
    let (west, east) = line.fold(start, |(west, east), at| (west.min(at[0]), east.max(at[0])));
    let turns = |lon_deg: f64| (lon_deg + HALF_TURN_DEG) / TURN_DEG;
    let (first, last) = (turns(west).floor() as i64, turns(east).ceil() as i64 - 1);
    (first, last.max(first))
}

fn is_whole((first, last): (i64, i64)) -> bool {
    (first, last) == (0, 0)
}

/// The pieces of a line whose longitudes run on.
pub(super) fn cut_line(line: Vec<Position>) -> Vec<Vec<Position>> {
    let (first, last) = turns(line.iter());
    if is_whole((first, last)) {
        return vec![line];
    }
    let within = |turn: i64| {
        let [west, east] = limits(turn);
        let mut pieces: Vec<Vec<Position>> = vec![Vec::new()];
        for pair in line.windows(2) {
            let (from, to) = (&pair[0], &pair[1]);
            let share = |lon_deg: f64| ((lon_deg - from[0]) / (to[0] - from[0])).clamp(0.0, 1.0);
            let is_outside = (from[0] <= west && to[0] <= west) || (from[0] >= east && to[0] >= east);
            if is_outside {
                pieces.push(Vec::new());
                continue;
            }
            let at = |share: f64| -> Position {
                let part = from.as_slice().iter().zip(to.as_slice()).map(|(a, b)| a + share * (b - a));
                part.collect::<Vec<f64>>().into()
            };
            let enters =
                |lon_deg: f64| if (west..=east).contains(&lon_deg) { None } else { Some(lon_deg.clamp(west, east)) };
            let start = enters(from[0]).map_or_else(|| from.clone(), |limit| at(share(limit)));
            let end = enters(to[0]).map_or_else(|| to.clone(), |limit| at(share(limit)));
            let piece = pieces.last_mut().expect("there is one from the start");
            if piece.last() != Some(&start) {
                piece.push(start);
            }
            piece.push(end);
        }
        pieces.into_iter().filter(|piece| piece.len() > 1).map(move |piece| moved_back(piece, turn)).collect::<Vec<_>>()
    };
    (first..=last).flat_map(within).collect()
}

/// The parts of a polygon (rings, the outer one first) whose longitudes run on. One around a pole stays as it is.
pub(super) fn cut_polygon(rings: Vec<Vec<Position>>) -> Vec<Vec<Vec<Position>>> {
    let (first, last) = turns(rings.iter().flatten());
    let is_closed = rings.iter().all(|ring| ring.first() == ring.last());
    let line = |ring: &Vec<Position>| ring.iter().map(|at| Coord { x: at[0], y: at[1] }).collect::<LineString<f64>>();
    let mut lines = rings.iter().map(line);
    let polygon = lines.next().map(|exterior| Polygon::new(exterior, lines.collect()));
    let (Some(polygon), true, false) = (polygon, is_closed, is_whole((first, last))) else { return vec![rings] };
    let Some(bounds) = polygon.bounding_rect() else { return vec![rings] };
    let within = |turn: i64| {
        // No larger than the polygon: positions on the way are whole numbers over what there is.
        let [west, east] = limits(turn);
        let [west, east] = [west.max(bounds.min().x - 1e-3), east.min(bounds.max().x + 1e-3)];
        let window = Rect::new((west, bounds.min().y - 1e-3), (east, bounds.max().y + 1e-3)).to_polygon();
        let parts = polygon.intersection(&window).orient(Direction::Default);
        let ring = |ring: &LineString<f64>| {
            let corners = ring.coords().map(|corner| with_height(*corner, &rings)).collect();
            moved_back(corners, turn)
        };
        let part = |part: &Polygon<f64>| -> Vec<Vec<Position>> {
            std::iter::once(part.exterior()).chain(part.interiors()).map(ring).collect()
        };
        parts.iter().map(part).collect::<Vec<_>>()
    };
    (first..=last).flat_map(within).collect()
}

fn limits(turn: i64) -> [f64; 2] {
    let middle_deg = TURN_DEG * turn as f64;
    [middle_deg - HALF_TURN_DEG, middle_deg + HALF_TURN_DEG]
}

fn moved_back(mut line: Vec<Position>, turn: i64) -> Vec<Position> {
    line.iter_mut().for_each(|at| at[0] -= TURN_DEG * turn as f64);
    line
}

/// A corner of a cut polygon with the height of the edge that it lies on, where there are heights.
fn with_height(corner: Coord<f64>, rings: &[Vec<Position>]) -> Position {
    let flat = |at: &Position| Coord { x: at[0], y: at[1] };
    let edges = rings.iter().flat_map(|ring| ring.windows(2)).filter(|pair| pair.iter().all(|at| at.len() > 2));
    let of_edge = |pair: &[Position]| {
        let line = Line::new(flat(&pair[0]), flat(&pair[1]));
        let nearest = match line.closest_point(&Point(corner)) {
            Closest::Intersection(at) | Closest::SinglePoint(at) => at,
            Closest::Indeterminate => Point(line.start),
        };
        let length = Euclidean.distance(line.start, line.end);
        let share = if length > 0.0 { Euclidean.distance(Point(line.start), nearest) / length } else { 0.0 };
        (Euclidean.distance(nearest, Point(corner)), pair[0][2] + share * (pair[1][2] - pair[0][2]))
    };
    match edges.map(of_edge).min_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((_, z_m)) => Position::from([corner.x, corner.y, z_m]),
        None => Position::from([corner.x, corner.y]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(places: &[[f64; 3]]) -> Vec<Position> {
        let mut line: Vec<Position> = places.iter().map(|at| Position::from(*at)).collect();
        run_on(&mut line, places[0][0]);
        line
    }

    #[test]
    fn what_does_not_cross_stays_to_the_bit() {
        for places in [
            [[7.0, 53.0, 1.0], [7.1, 53.1, 2.0]],
            [[180.0, 1.0, 0.0], [179.0, 2.0, 0.0]],
            [[-180.0, 1.0, 0.0], [-179.5, 0.0, 0.0]],
        ] {
            let whole: Vec<Position> = places.map(Position::from).into();
            assert_eq!(cut_line(line(&places)), [whole]);
        }
    }

    #[test]
    fn a_line_across_ends_and_begins_at_180_with_a_height_between() {
        let pieces = cut_line(line(&[[179.0, 10.0, 0.0], [-179.0, 12.0, 4.0], [-178.0, 12.0, 4.0]]));
        let expected = [
            vec![Position::from([179.0, 10.0, 0.0]), Position::from([180.0, 11.0, 2.0])],
            vec![
                Position::from([-180.0, 11.0, 2.0]),
                Position::from([-179.0, 12.0, 4.0]),
                Position::from([-178.0, 12.0, 4.0]),
            ],
        ];
        assert_eq!(pieces, expected);
    }

    #[test]
    fn a_polygon_across_is_two_that_meet_at_180_and_keeps_its_hole() {
        let square = |half: f64, z: f64| {
            let mut ring = line(&[
                [180.0 - half, -half, z],
                [half - 180.0, -half, z],
                [half - 180.0, half, z],
                [180.0 - half, half, z],
                [180.0 - half, -half, z],
            ]);
            run_on(&mut ring, 180.0);
            ring
        };
        let parts = cut_polygon(vec![square(0.002, 7.0), square(0.001, 7.0)]);
        assert_eq!(parts.len(), 2);
        for part in &parts {
            assert_eq!(part.len(), 1, "the hole reaches the cut, and is a bay of each part");
            assert!(
                part[0].iter().all(|at| (at[0].abs() - 180.0).abs() < 0.003 && (at[2] - 7.0).abs() < 1e-9),
                "{part:?}"
            );
            let west_and_east = part[0].iter().fold((f64::MAX, f64::MIN), |(w, e), at| (w.min(at[0]), e.max(at[0])));
            assert!(west_and_east.1 - west_and_east.0 < 0.003, "{west_and_east:?}");
        }
    }
}
