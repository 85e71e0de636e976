//! Party walls: the share of a building's walls that a neighbour's wall lies against.
//!
//! ```text
//! party wall of edge e = Σ over facing edges f of other buildings: overlap along e × overlap in height
//! ```
//!
//! Two walls lie against each other where they run in opposite directions, no farther apart than [`TOUCHING_M`]. A wall
//! reaches from its building's base to its roof. Of several neighbours' walls on one place of an edge (overlapping
//! footprints) no more counts than the wall has.

use geo_types::{Coord, Line};
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::BuildingRecord;

/// Walls no farther apart than this stand against each other, metres: what two surveys of one wall differ by.
const TOUCHING_M: f64 = 0.1;

/// One wall: whose, its foot, and the levels it reaches between.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Wall {
    building: usize,
    foot: Line<f64>,
    levels_m: [f64; 2],
}

/// States every building's party walls, zero for one that stands alone; not where footprint or levels are not known.
pub fn fill(records: &mut [BuildingRecord]) {
    let walls: Vec<Wall> = records.iter().enumerate().flat_map(|(i, record)| walls_of(i, record)).collect();
    let tree = RTree::bulk_load(walls.iter().map(|wall| GeomWithData::new(envelope(wall.foot), *wall)).collect());
    let mut shared_m2 = vec![0.0; records.len()];
    for wall in &walls {
        let [low, high] = corners(wall.foot);
        let near = tree.locate_in_envelope_intersecting(&AABB::from_corners(
            low.map(|v| v - TOUCHING_M),
            high.map(|v| v + TOUCHING_M),
        ));
        let mut parts_m2: Vec<f64> =
            near.map(|other| other.data).filter(|o| o.building != wall.building).map(|o| shared(wall, &o)).collect();
        // The tree's own order is no order, and sums depend on it.
        parts_m2.sort_unstable_by(f64::total_cmp);
        shared_m2[wall.building] += parts_m2.iter().sum::<f64>().min(area_m2(wall));
    }
    for (record, shared_m2) in records.iter_mut().zip(shared_m2) {
        record.party_wall_m2 = levels(record).is_some().then_some(shared_m2);
    }
}

fn levels(record: &BuildingRecord) -> Option<[f64; 2]> {
    record.footprint.as_ref()?;
    Some([record.base_z_m.or(record.ground_z_m)?, record.roof_z_m()?])
}

fn walls_of(building: usize, record: &BuildingRecord) -> Vec<Wall> {
    let Some((levels_m, footprint)) = levels(record).zip(record.footprint.as_ref()) else { return Vec::new() };
    let rings = std::iter::once(footprint.exterior()).chain(footprint.interiors());
    rings.flat_map(geo_types::LineString::lines).map(|foot| Wall { building, foot, levels_m }).collect()
}

fn corners(foot: Line<f64>) -> [[f64; 2]; 2] {
    let (a, b) = (foot.start, foot.end);
    [[a.x.min(b.x), a.y.min(b.y)], [a.x.max(b.x), a.y.max(b.y)]]
}

fn envelope(foot: Line<f64>) -> Rectangle<[f64; 2]> {
    let [low, high] = corners(foot);
    Rectangle::from_corners(low, high)
}

fn area_m2(wall: &Wall) -> f64 {
    wall.foot.dx().hypot(wall.foot.dy()) * (wall.levels_m[1] - wall.levels_m[0]).max(0.0)
}

/// Area of a wall that another one covers, m².
fn shared(wall: &Wall, other: &Wall) -> f64 {
    let length_m = wall.foot.dx().hypot(wall.foot.dy());
    if length_m == 0.0 {
        return 0.0;
    }
    let along = Coord { x: wall.foot.dx() / length_m, y: wall.foot.dy() / length_m };
    let place = |c: Coord<f64>| {
        let from = c - wall.foot.start;
        (from.x * along.x + from.y * along.y, from.y * along.x - from.x * along.y)
    };
    // In the wall's own axes; the facing wall runs the other way.
    let ((to, off_to), (from, off_from)) = (place(other.foot.start), place(other.foot.end));
    let (low, high) = (from.max(0.0), to.min(length_m));
    if to <= from || high <= low {
        return 0.0;
    }
    let off_at = |t: f64| off_from + (off_to - off_from) * (t - from) / (to - from);
    if off_at(low).abs() > TOUCHING_M || off_at(high).abs() > TOUCHING_M {
        return 0.0;
    }
    let rise_m = wall.levels_m[1].min(other.levels_m[1]) - wall.levels_m[0].max(other.levels_m[0]);
    (high - low) * rise_m.max(0.0)
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};
    use geo_types::Polygon;

    use super::*;
    use crate::output::record::tests::record;

    fn house(west: f64, south: f64, width: f64, depth: f64) -> Polygon<f64> {
        use geo::orient::{Direction, Orient as _};
        Rect::new(coord! { x: west, y: south }, coord! { x: west + width, y: south + depth })
            .to_polygon()
            .orient(Direction::Default)
    }

    fn party_walls_m2(mut records: Vec<BuildingRecord>) -> Vec<Option<f64>> {
        fill(&mut records);
        records.iter().map(|record| record.party_wall_m2.map(|m2| (m2 * 1e6).round() / 1e6)).collect()
    }

    #[test]
    fn row_houses_share_their_wall_up_to_the_lower_roof() {
        let row = vec![
            record("a", house(0.0, 0.0, 6.0, 10.0), 2.0, 2.0, 9.0),
            record("b", house(6.0, 1.0, 6.0, 10.0), 3.0, 3.0, 5.0),
            record("alone", house(50.0, 0.0, 6.0, 10.0), 2.0, 2.0, 9.0),
        ];
        // 9 m of the wall, from 3 m to 8 m.
        assert_eq!(party_walls_m2(row), [Some(45.0), Some(45.0), Some(0.0)]);
    }

    #[test]
    fn a_gap_a_person_fits_through_is_none_and_an_unknown_height_has_none() {
        let mut apart = vec![
            record("a", house(0.0, 0.0, 6.0, 10.0), 0.0, 0.0, 9.0),
            record("b", house(6.09, 0.0, 6.0, 10.0), 0.0, 0.0, 9.0),
            record("c", house(12.5, 0.0, 6.0, 10.0), 0.0, 0.0, 9.0),
            record("d", house(18.5, 0.0, 6.0, 10.0), 0.0, 0.0, 9.0),
        ];
        apart[3].height_m = None;
        assert_eq!(party_walls_m2(apart), [Some(90.0), Some(90.0), Some(0.0), None]);
    }
}
