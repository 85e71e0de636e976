//! Buildings of a result as they are compared: parts of one are one building, with the footprints of all of them.

use std::collections::HashMap;

use geo::{Area as _, BooleanOps as _, BoundingRect as _, Intersects as _, Translate as _, unary_union};
use geo_types::{MultiPolygon, Polygon, Rect};

use crate::output::BuildingRecord;

/// Attribute of a record whose footprint was found in photos: standard deviation of its corners, metres.
const FOOTPRINT_SIGMA: &str = "footprint_sigma_m";

/// A record with its footprint where it is compared.
#[derive(Debug, Clone)]
pub struct ComparedPart<'a> {
    /// As the result has it.
    pub record: &'a BuildingRecord,
    /// Map frame, metres; without the shift in plan that is common to all buildings.
    pub footprint: Option<Polygon<f64>>,
}

/// A building of a result.
#[derive(Debug, Clone)]
pub struct ComparedBuilding<'a> {
    /// Id, that of the whole where it has parts.
    pub id: &'a str,
    /// Parts of the building; the building itself where it has none.
    pub parts: Vec<ComparedPart<'a>>,
    /// Around all parts; empty if none has a footprint.
    pub footprint: MultiPolygon<f64>,
}

/// The buildings of some records, in the order of their first parts. Footprints are moved by `shift_m` (easting, northing).
pub fn buildings(records: &[BuildingRecord], shift_m: [f64; 2]) -> Vec<ComparedBuilding<'_>> {
    let mut position: HashMap<&str, usize> = HashMap::new();
    let mut buildings: Vec<ComparedBuilding<'_>> = Vec::with_capacity(records.len());
    for record in records {
        let footprint = record.footprint.as_ref().map(|footprint| footprint.translate(shift_m[0], shift_m[1]));
        let part = ComparedPart { record, footprint };
        match record.part_of.as_deref().map(|whole| (whole, position.get(whole))) {
            Some((_, Some(&at))) => buildings[at].parts.push(part),
            whole => {
                let id = whole.map_or(record.id.as_str(), |(whole, _)| whole);
                if whole.is_some() {
                    position.insert(id, buildings.len());
                }
                buildings.push(ComparedBuilding { id, parts: vec![part], footprint: MultiPolygon::new(Vec::new()) });
            }
        }
    }
    for building in &mut buildings {
        building.footprint = joined(building.parts.iter().filter_map(|part| part.footprint.as_ref()));
    }
    buildings
}

/// Several footprints as one; a single one stays as it is.
pub fn joined<'p>(footprints: impl Iterator<Item = &'p Polygon<f64>>) -> MultiPolygon<f64> {
    let footprints: Vec<Polygon<f64>> = footprints.cloned().collect();
    if footprints.len() < 2 { MultiPolygon::new(footprints) } else { unary_union(&footprints) }
}

impl ComparedBuilding<'_> {
    /// The box around it, if it has a footprint.
    pub fn bounds(&self) -> Option<Rect<f64>> {
        self.footprint.bounding_rect()
    }

    /// One standard deviation of its footprint: the largest that its parts state, else `unstated_m`.
    pub fn footprint_sigma_m(&self, unstated_m: f64) -> f64 {
        let stated = self.parts.iter().filter_map(|part| part.record.attributes.get(FOOTPRINT_SIGMA)?.as_f64());
        stated.filter(|sigma_m| *sigma_m >= 0.0).max_by(f64::total_cmp).unwrap_or(unstated_m)
    }

    /// Mean height over the area of the parts that have one, metres.
    pub fn height_m(&self) -> Option<f64> {
        let known = || {
            self.parts.iter().filter_map(|part| {
                let area_m2 = part.footprint.as_ref().map_or(0.0, geo::Area::unsigned_area);
                Some((area_m2, part.record.height_m?))
            })
        };
        let known_m2: f64 = known().map(|(area_m2, _)| area_m2).sum();
        let mean = || known().map(|(area_m2, height_m)| area_m2 * height_m).sum::<f64>() / known_m2;
        if known_m2 > 0.0 { Some(mean()) } else { known().next().map(|(_, height_m)| height_m) }
    }
}

/// Area that two polygons share, m²; without work where their boxes do not touch.
pub fn shared_m2(a: &Polygon<f64>, b: &Polygon<f64>) -> f64 {
    let touch = a.bounding_rect().zip(b.bounding_rect()).is_some_and(|(a, b)| a.intersects(&b));
    if touch { a.intersection(b).unsigned_area() } else { 0.0 }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A measured building on level ground: west, south, width, depth, height; sigma 0.25 m.
    pub fn house(id: &str, [west, south, width, depth]: [f64; 4], height_m: f64) -> BuildingRecord {
        let footprint = Rect::new((west, south), (west + width, south + depth)).to_polygon();
        BuildingRecord { height_sigma_m: Some(0.25), ..BuildingRecord::measured(id, footprint, 3.0, height_m) }
    }

    #[test]
    fn parts_are_one_building_under_the_id_of_the_whole() {
        let part = |id: &str, west: f64, height_m| BuildingRecord {
            part_of: Some("hall".to_owned()),
            ..house(id, [west, 0.0, 10.0, 10.0], height_m)
        };
        let records = [part("hall#1", 0.0, 8.0), house("b", [90.0, 0.0, 9.0, 9.0], 5.0), part("hall#2", 10.0, 12.0)];
        let found = buildings(&records, [1.0, 0.0]);
        assert_eq!(found.iter().map(|b| (b.id, b.parts.len())).collect::<Vec<_>>(), [("hall", 2), ("b", 1)]);
        assert!((found[0].footprint.unsigned_area() - 200.0).abs() < 1e-9);
        assert_eq!(found[0].bounds().unwrap().min().x, 1.0);
        assert_eq!(found[0].height_m(), Some(10.0));
    }

    #[test]
    fn a_footprint_is_as_accurate_as_it_says() {
        let mut records = [house("a", [0.0, 0.0, 9.0, 9.0], 5.0)];
        assert_eq!(buildings(&records, [0.0; 2])[0].footprint_sigma_m(0.3), 0.3);
        records[0].attributes.insert(FOOTPRINT_SIGMA.to_owned(), 0.7.into());
        assert_eq!(buildings(&records, [0.0; 2])[0].footprint_sigma_m(0.3), 0.7);
    }
}
