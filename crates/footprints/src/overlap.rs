//! Footprints that lie on top of each other: each would claim the other's roof. Of two that are the same one is kept.

use std::collections::BTreeMap;

use geo::{Area as _, BooleanOps as _, BoundingRect as _, Centroid as _};
use rayon::prelude::*;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::{Footprint, FootprintLayer, RefusedFootprint};
use sizeup_geo::issue::{Issue, Severity, Subject};

/// Share of the area that two footprints cover together from which they are the same building, drawn or listed twice.
const SAME_SHARE: f64 = 0.95;

/// Refuses every footprint that another one of the layer, listed before it, already is: both would stand in each other's place in
/// all photos, and neither could be measured.
pub(super) fn refuse_duplicates(layer: &mut FootprintLayer) {
    let same_as = duplicates(&layer.footprints);
    if same_as.is_empty() {
        return;
    }
    let footprints = std::mem::take(&mut layer.footprints);
    let ids: Vec<_> = footprints.iter().map(|footprint| footprint.id.clone()).collect();
    for (at, footprint) in footprints.into_iter().enumerate() {
        let Some(&(first, share)) = same_as.get(&at) else {
            layer.footprints.push(footprint);
            continue;
        };
        let message = format!(
            "it lies where building {} does and shares {:.0} % of the area with it: {0} is measured, this one is not",
            ids[first],
            100.0 * share,
        );
        let issue = Issue::new(Severity::Refused, DUPLICATE, Subject::Building(footprint.id.to_string()), message)
            .hint("the layer has the building twice: remove one of them");
        layer.issues.push(match footprint.polygon.centroid() {
            Some(place) => issue.at(place.x(), place.y()),
            None => issue,
        });
        let Footprint { id, part_of, attributes, .. } = footprint;
        let duplicate_of = Some(ids[first].clone());
        layer.refused.push(RefusedFootprint { id, part_of, reason: DUPLICATE.to_owned(), duplicate_of, attributes });
    }
}

const DUPLICATE: &str = "footprint_duplicate";

/// Footprints that are the same as one listed before them: which, and the share of the area that both cover.
fn duplicates(footprints: &[Footprint]) -> BTreeMap<usize, (usize, f64)> {
    let boxes: Vec<_> = footprints.iter().enumerate().filter_map(|(i, f)| bounds(f).map(|b| (i, b))).collect();
    let tree = tree_of(&boxes);
    let of_one = |&(i, bounds): &(usize, AABB<[f64; 2]>)| {
        let area_m2 = footprints[i].polygon.unsigned_area();
        let earlier = tree.locate_in_envelope_intersecting(&bounds).map(|other| other.data).filter(|&other| other < i);
        let mut same: Vec<(usize, f64)> = earlier
            .filter_map(|other| {
                let other_m2 = footprints[other].polygon.unsigned_area();
                // Areas alone rule nearly all pairs out.
                if area_m2.min(other_m2) < SAME_SHARE * area_m2.max(other_m2) {
                    return None;
                }
                let shared_m2 = footprints[i].polygon.intersection(&footprints[other].polygon).unsigned_area();
                let share = shared_m2 / (area_m2 + other_m2 - shared_m2);
                (share > SAME_SHARE).then_some((other, share))
            })
            .collect();
        same.sort_unstable_by_key(|(other, _)| *other);
        (i, same)
    };
    let same: Vec<(usize, Vec<(usize, f64)>)> = boxes.par_iter().map(of_one).collect();
    let mut found = BTreeMap::new();
    for (i, same) in same {
        // One that is itself refused keeps nobody out.
        if let Some(first) = same.into_iter().find(|(other, _)| !found.contains_key(other)) {
            found.insert(i, first);
        }
    }
    found
}

type Boxes = RTree<GeomWithData<Rectangle<[f64; 2]>, usize>>;

fn tree_of(boxes: &[(usize, AABB<[f64; 2]>)]) -> Boxes {
    RTree::bulk_load(boxes.iter().map(|&(i, b)| GeomWithData::new(Rectangle::from_aabb(b), i)).collect())
}

/// One warning per pair that shares more than `min_area_m2`, in the order of the footprints. Shared walls and
/// digitising slivers stay below it.
#[must_use]
pub fn overlaps(footprints: &[Footprint], min_area_m2: f64) -> Vec<Issue> {
    let boxes: Vec<_> = footprints.iter().enumerate().filter_map(|(i, f)| bounds(f).map(|b| (i, b))).collect();
    let tree = tree_of(&boxes);
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
    fn of_two_footprints_that_are_the_same_the_first_is_kept_and_the_other_names_it() {
        // Half a per cent of the length off, and another one exactly as the first; a row house is neither.
        let footprints = vec![house("b", 0.0), house("row", 10.0), house("a", 0.05), house("c", 0.0)];
        let mut layer = FootprintLayer { footprints, ..FootprintLayer::default() };
        refuse_duplicates(&mut layer);
        let kept: Vec<&str> = layer.footprints.iter().map(|f| f.id.0.as_str()).collect();
        assert_eq!(kept, ["b", "row"]);
        let refused: Vec<(&str, &str)> =
            layer.refused.iter().map(|r| (r.id.0.as_str(), r.duplicate_of.as_ref().unwrap().0.as_str())).collect();
        assert_eq!(refused, [("a", "b"), ("c", "b")]);
        assert_eq!(layer.issues[0].subject, Subject::Building("a".to_owned()));
        assert!(layer.issues[0].message.contains("building b") && layer.issues[0].hint.is_some());
        assert!(layer.issues[0].place.is_some());
        // What shares less is an overlap, and both are measured.
        let mut layer =
            FootprintLayer { footprints: vec![house("a", 0.0), house("b", 1.0)], ..FootprintLayer::default() };
        refuse_duplicates(&mut layer);
        assert_eq!((layer.footprints.len(), layer.refused.len()), (2, 0));
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
