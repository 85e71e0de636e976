//! Footprints that lie on top of each other: each would claim the other's roof.

use geo::{Area as _, BooleanOps as _, BoundingRect as _, Centroid as _};
use rayon::prelude::*;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::Footprint;
use sizeup_geo::issue::{Issue, Severity, Subject};

/// One warning per pair that shares more than `min_area_m2`, in the order of the footprints. Shared walls and
/// digitising slivers stay below it.
#[must_use]
pub fn overlaps(footprints: &[Footprint], min_area_m2: f64) -> Vec<Issue> {
    let boxes: Vec<_> = footprints.iter().enumerate().filter_map(|(i, f)| bounds(f).map(|b| (i, b))).collect();
    let tree =
        RTree::bulk_load(boxes.iter().map(|&(i, b)| GeomWithData::new(Rectangle::from_aabb(b), i)).collect::<Vec<_>>());
    let of_one = |&(i, bounds): &(usize, AABB<[f64; 2]>)| {
        let mut others: Vec<usize> =
            tree.locate_in_envelope_intersecting(&bounds).map(|other| other.data).filter(|&other| other > i).collect();
        others.sort_unstable();
        others.into_iter().filter_map(|other| overlap(&footprints[i], &footprints[other], min_area_m2)).collect()
    };
    let per_footprint: Vec<Vec<Issue>> = boxes.par_iter().map(of_one).collect();
    per_footprint.into_iter().flatten().collect()
}

fn bounds(footprint: &Footprint) -> Option<AABB<[f64; 2]>> {
    let rect = footprint.polygon.bounding_rect()?;
    Some(AABB::from_corners(rect.min().into(), rect.max().into()))
}

fn overlap(a: &Footprint, b: &Footprint, min_area_m2: f64) -> Option<Issue> {
    // Told of the same one in whatever order the layer lists them.
    let (a, b) = if a.id <= b.id { (a, b) } else { (b, a) };
    let shared = a.polygon.intersection(&b.polygon);
    let shared_m2 = shared.unsigned_area();
    if shared_m2 < min_area_m2 {
        return None;
    }
    let smaller_m2 = a.polygon.unsigned_area().min(b.polygon.unsigned_area());
    let place = shared.centroid()?;
    let message = format!(
        "overlaps building {} by {shared_m2:.1} m², {:.0} % of the smaller",
        b.id,
        100.0 * shared_m2 / smaller_m2
    );
    Some(
        Issue::new(Severity::Warning, "footprint_overlap", Subject::Building(a.id.to_string()), message)
            .hint("stacked or duplicated footprints share one roof: keep one of them, or cut one out of the other")
            .at(place.x(), place.y()),
    )
}

#[cfg(test)]
mod tests {
    use geo::polygon;

    use super::*;
    use sizeup_heights::ids::BuildingId;

    fn house(id: &str, west_m: f64) -> Footprint {
        let polygon = polygon![
            (x: west_m, y: 0.0), (x: west_m + 10.0, y: 0.0), (x: west_m + 10.0, y: 8.0), (x: west_m, y: 8.0),
        ];
        Footprint { id: BuildingId::from(id), part_of: None, polygon, attributes: serde_json::Map::default() }
    }

    #[test]
    fn row_houses_share_a_wall_and_stacked_ones_a_roof() {
        let row = [house("a", 0.0), house("b", 10.0), house("c", 19.95)];
        assert!(overlaps(&row, 1.0).is_empty());
        let stacked = overlaps(&[house("a", 0.0), house("b", 7.0), house("c", 30.0)], 1.0);
        assert_eq!(stacked.len(), 1);
        assert_eq!(stacked[0].subject, Subject::Building("a".to_owned()));
        assert!(stacked[0].message.contains("b by 24.0 m², 30 %"), "{}", stacked[0].message);
        assert_eq!(stacked[0].place, Some([8.5, 4.0]));
    }
}
