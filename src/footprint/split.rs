//! Outlines taken apart where a building has more than one roof level.

use geo::{Area as _, BooleanOps as _};
use geo_types::{MultiPolygon, Polygon};

/// Pieces smaller than this go to the other side of the cut, m².
const MIN_PIECE_M2: f64 = 12.0;

/// The pieces of an outline inside and outside of another polygon, the inner ones first; `None` if either side has none
/// of a useful size. The pieces share their border and cover the outline.
#[must_use]
pub fn pieces(outline: &Polygon<f64>, other: &Polygon<f64>) -> Option<Vec<Polygon<f64>>> {
    let (inner, inner_slivers) = by_size(outline.intersection(other));
    let (outer, outer_slivers) = by_size(outline.difference(other));
    if inner.0.is_empty() || outer.0.is_empty() {
        return None;
    }
    let inner = inner.union(&outer_slivers);
    let outer = outer.union(&inner_slivers);
    Some(inner.0.into_iter().chain(outer.0).collect())
}

fn by_size(pieces: MultiPolygon<f64>) -> (MultiPolygon<f64>, MultiPolygon<f64>) {
    let (large, small) = pieces.0.into_iter().partition(|piece| piece.unsigned_area() >= MIN_PIECE_M2);
    (MultiPolygon::new(large), MultiPolygon::new(small))
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};

    use super::*;

    fn rectangle(x0: f64, y0: f64, x1: f64, y1: f64) -> Polygon<f64> {
        Rect::new(coord! { x: x0, y: y0 }, coord! { x: x1, y: y1 }).to_polygon()
    }

    #[test]
    fn a_tower_inside_its_podium_leaves_a_ring_around_it() {
        let pieces = pieces(&rectangle(0.0, 0.0, 40.0, 30.0), &rectangle(10.0, 8.0, 22.0, 20.0)).unwrap();
        assert_eq!(pieces.len(), 2);
        assert!((pieces[0].unsigned_area() - 144.0).abs() < 1e-6);
        assert_eq!(pieces[1].interiors().len(), 1);
        assert!((pieces[1].unsigned_area() - (1200.0 - 144.0)).abs() < 1e-6);
    }

    #[test]
    fn slivers_beside_the_cut_go_to_the_part_they_touch() {
        // 0.2 m of the outline stay beyond the rectangle on three sides.
        let pieces = pieces(&rectangle(0.0, 0.0, 40.0, 30.0), &rectangle(20.0, 0.2, 39.8, 29.8)).unwrap();
        let area: f64 = pieces.iter().map(geo::Area::unsigned_area).sum();
        assert!((area - 1200.0).abs() < 1e-6, "nothing is lost");
        assert!(pieces.iter().all(|p| p.unsigned_area() > 12.0), "no slivers");
    }

    #[test]
    fn a_cut_that_misses_or_swallows_the_outline_is_none() {
        let outline = rectangle(0.0, 0.0, 40.0, 30.0);
        assert_eq!(pieces(&outline, &rectangle(50.0, 0.0, 60.0, 30.0)), None);
        assert_eq!(pieces(&outline, &rectangle(-1.0, -1.0, 41.0, 31.0)), None);
    }
}
