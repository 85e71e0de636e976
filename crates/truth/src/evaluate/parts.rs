//! Parts of one building as the one building that the reference has.

use std::collections::{BTreeSet, HashMap};

use geo::{Area as _, unary_union};
use geo_types::Polygon;

use super::TruthBuilding;
use sizeup_results::output::{BuildingRecord, Status};

/// The result with the parts of a building joined to one record under the building's id, wherever the reference knows
/// none of the parts by its own id. Parts count by the area of their footprints:
///
/// ```text
/// h = Σ A_i h_i / Σ A_i        σ = Σ A_i σ_i / Σ A_i   (as if all erred the same way)
/// ```
///
/// A building has no height if parts with more than half of its area have none. Its status is the worst of its parts'.
#[must_use]
pub(super) fn joined(results: &[BuildingRecord], truth: &[TruthBuilding]) -> Vec<BuildingRecord> {
    let known: BTreeSet<&str> = truth.iter().map(|t| t.id.as_str()).collect();
    let mut families: HashMap<&str, Vec<&BuildingRecord>> = HashMap::new();
    for record in results {
        if let Some(whole) = record.part_of.as_deref() {
            families.entry(whole).or_default().push(record);
        }
    }
    families.retain(|_, parts| parts.iter().all(|part| !known.contains(part.id.as_str())));
    let mut joined = Vec::with_capacity(results.len());
    for record in results {
        // A family stands where its first part stood.
        match record.part_of.as_deref().and_then(|whole| families.get(whole).map(|parts| (whole, parts))) {
            None => joined.push(record.clone()),
            Some((whole, parts)) if parts[0].id == record.id => joined.push(join(whole, parts)),
            Some(_) => {}
        }
    }
    joined
}

fn join(whole: &str, parts: &[&BuildingRecord]) -> BuildingRecord {
    let area = |part: &BuildingRecord| part.footprint.as_ref().map_or(0.0, geo::Area::unsigned_area);
    let total_m2: f64 = parts.iter().map(|part| area(part)).sum();
    let mean = |value: fn(&BuildingRecord) -> Option<f64>| {
        let known = || parts.iter().filter_map(|part| Some((area(part), value(part)?)));
        let known_m2: f64 = known().map(|(area_m2, _)| area_m2).sum();
        (known_m2 > 0.5 * total_m2).then(|| known().map(|(area_m2, v)| area_m2 * v).sum::<f64>() / known_m2)
    };
    let footprints: Vec<Polygon<f64>> = parts.iter().filter_map(|part| part.footprint.clone()).collect();
    let footprint =
        unary_union(&footprints).0.into_iter().max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area()));
    let union = |names: fn(&BuildingRecord) -> &[String]| -> Vec<String> {
        parts.iter().flat_map(|part| names(part)).collect::<BTreeSet<_>>().into_iter().cloned().collect()
    };
    BuildingRecord {
        id: whole.to_owned(),
        part_of: None,
        footprint,
        height_m: mean(|part| part.height_m),
        height_sigma_m: mean(|part| part.height_sigma_m),
        roof: None,
        status: parts.iter().map(|part| part.status).max_by_key(|s| severity(*s)).unwrap_or(Status::Unknown),
        reasons: union(|part| &part.reasons),
        views: union(|part| &part.views),
        ..parts[0].clone()
    }
}

fn severity(status: Status) -> u8 {
    match status {
        Status::Measured => 0,
        Status::Reviewed => 1,
        Status::Given => 2,
        Status::Doubtful => 3,
        Status::Fallback => 4,
        Status::Unknown => 5,
        Status::Refused => 6,
    }
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};

    use super::*;

    fn part(id: &str, x0: f64, x1: f64, height_m: f64) -> BuildingRecord {
        let footprint = Rect::new(coord! { x: x0, y: 0.0 }, coord! { x: x1, y: 10.0 }).to_polygon();
        BuildingRecord { part_of: Some("tower".to_owned()), ..BuildingRecord::measured(id, footprint, 3.0, height_m) }
    }

    fn truth(id: &str) -> TruthBuilding {
        TruthBuilding { id: id.to_owned(), footprint: None, height_m: Some(1.0), group: None }
    }

    #[test]
    fn parts_become_the_building_the_reference_has_weighted_by_area() {
        let parts = [part("tower#1", 0.0, 10.0, 60.0), part("tower#2", 10.0, 40.0, 8.0)];
        let joined = joined(&parts, &[truth("tower")]);
        assert_eq!(joined.len(), 1);
        assert_eq!(joined[0].id, "tower");
        assert!((joined[0].height_m.unwrap() - (100.0 * 60.0 + 300.0 * 8.0) / 400.0).abs() < 1e-9);
        assert!((joined[0].footprint.as_ref().unwrap().unsigned_area() - 400.0).abs() < 1e-9);
    }

    #[test]
    fn parts_that_the_reference_knows_stay_apart() {
        let parts = [part("tower#1", 0.0, 10.0, 60.0), part("tower#2", 10.0, 40.0, 8.0)];
        assert_eq!(joined(&parts, &[truth("tower#1"), truth("tower#2")]), parts);
    }

    #[test]
    fn a_building_is_as_doubtful_as_its_worst_part() {
        let mut parts = [part("tower#1", 0.0, 10.0, 60.0), part("tower#2", 10.0, 40.0, 8.0)];
        (parts[0].status, parts[0].height_m) = (Status::Unknown, None);
        let joined = joined(&parts, &[truth("tower")]);
        assert_eq!((joined[0].status, joined[0].height_m), (Status::Unknown, Some(8.0)));
    }
}
