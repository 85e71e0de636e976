//! Heights and footprints of buildings from their surfaces.
//!
//! ```text
//! roof_mean = ∫ z dA / ∫ dA over the roof surfaces, dA in plan       ground = min z over the ground surfaces
//! ```
//!
//! Roof and ground come from the semantics; where a building has none, from the normals (up and down within 60° of the
//! vertical, so steep roofs count and walls do not), turned round where the surfaces enclose a negative volume and so look inwards:
//!
//! ```text
//! volume = ∫ (z − lowest) n_z dA over all surfaces
//! ```
//!
//! The footprint is the union of the ground surfaces in plan, or of
//! the roof surfaces where there is no ground.

use std::collections::HashMap;

use geo::orient::Direction;
use geo::{Area, Orient as _, unary_union};
use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use indexmap::IndexMap;

use super::super::cityjson::EXTENSION_PREFIX;
use super::super::cityjson::read::{CityFile, CityObject, CitySurface};
use super::super::prism::FaceKind;
use super::FoundBuilding;
use super::own::is_ours;

/// Kinds of objects that are buildings.
const BUILDING: &str = "Building";
const PART: &str = "BuildingPart";

/// Cosine of the angle to the vertical within which a surface without semantics is roof or ground.
const MIN_VERTICAL_COSINE: f64 = 0.5;

/// Levels of one building, metres in the file's vertical reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BuildingLevels {
    /// Lowest point of the ground surfaces (of all surfaces if there is none).
    pub ground_m: f64,
    /// Mean of the roof over its area in plan.
    pub roof_mean_m: f64,
    /// Lowest point of the roof.
    pub roof_min_m: f64,
    /// Highest point of the roof.
    pub roof_max_m: f64,
}

impl BuildingLevels {
    /// Levels of a file whose unit is so many metres.
    #[must_use]
    pub fn scaled(self, unit_m: f64) -> Self {
        Self {
            ground_m: unit_m * self.ground_m,
            roof_mean_m: unit_m * self.roof_mean_m,
            roof_min_m: unit_m * self.roof_min_m,
            roof_max_m: unit_m * self.roof_max_m,
        }
    }
}

/// All buildings of a file. Parts with a status of ours are buildings with heights of their own; parts of others are
/// counted to their parent.
pub fn buildings(city: &CityFile, lod: Option<&str>) -> Vec<FoundBuilding> {
    let mut position: HashMap<&str, usize> = HashMap::new();
    let mut groups: Vec<(&CityObject, Vec<&CityObject>)> = Vec::new();
    for object in city.objects.iter().filter(|o| o.kind == BUILDING) {
        position.insert(&object.id, groups.len());
        groups.push((object, Vec::new()));
    }
    for part in city.objects.iter().filter(|o| o.kind == PART) {
        if let Some(&at) = part.parents.iter().find_map(|parent| position.get(parent.as_str())) {
            groups[at].1.push(part);
        }
    }
    groups.into_iter().flat_map(|(building, parts)| of_group(building, &parts, &city.vertices, lod)).collect()
}

/// The buildings of a file as its objects come by: a building whose parts are still to come waits for them.
#[derive(Debug, Default)]
pub struct BuildingGathering {
    waiting: IndexMap<String, (Option<CityObject>, Vec<CityObject>)>,
}

impl BuildingGathering {
    /// Building that an object completes.
    pub fn add(&mut self, object: CityObject, vertices: &[[f64; 3]], lod: Option<&str>) -> Vec<FoundBuilding> {
        let whole = match (object.kind.as_str(), object.parents.first()) {
            (BUILDING, _) if object.children.is_empty() => return of_group(&object, &[], vertices, lod),
            (BUILDING, _) => object.id.clone(),
            (PART, Some(parent)) => parent.clone(),
            _ => return Vec::new(),
        };
        let (building, parts) = self.waiting.entry(whole.clone()).or_default();
        if object.kind == BUILDING {
            *building = Some(object);
        } else {
            parts.push(object);
        }
        let is_complete =
            building.as_ref().is_some_and(|b| b.children.iter().all(|id| parts.iter().any(|p| p.id == *id)));
        if !is_complete {
            return Vec::new();
        }
        self.waiting.shift_remove(&whole).map_or_else(Vec::new, |group| Self::found(&group, vertices, lod))
    }

    /// Buildings whose file names parts that it does not have (installations, say).
    pub fn rest(self, vertices: &[[f64; 3]], lod: Option<&str>) -> Vec<FoundBuilding> {
        self.waiting.values().flat_map(|group| Self::found(group, vertices, lod)).collect()
    }

    fn found(
        (building, parts): &(Option<CityObject>, Vec<CityObject>),
        vertices: &[[f64; 3]],
        lod: Option<&str>,
    ) -> Vec<FoundBuilding> {
        let Some(building) = building else { return Vec::new() };
        // In the order in which the building names them.
        let position = |part: &CityObject| building.children.iter().position(|id| *id == part.id);
        let mut parts: Vec<&CityObject> = parts.iter().collect();
        parts.sort_by_key(|part| position(part));
        of_group(building, &parts, vertices, lod)
    }
}

/// A building with its parts: as one, or where they are ours each on its own.
fn of_group(
    building: &CityObject,
    parts: &[&CityObject],
    vertices: &[[f64; 3]],
    lod: Option<&str>,
) -> Vec<FoundBuilding> {
    let found = |named: &CityObject, objects: &[&CityObject]| {
        let surfaces: Vec<&CitySurface> = objects.iter().flat_map(|object| object.surfaces(lod)).collect();
        let (levels, footprint) = measure(&surfaces, vertices);
        let (id, attributes) = (named.id.clone(), named.attributes.clone());
        FoundBuilding { id, part_of: None, footprint, levels, attributes }
    };
    let own_parts: Vec<&CityObject> = parts.iter().copied().filter(|part| has_own_status(part)).collect();
    if own_parts.is_empty() {
        let all: Vec<&CityObject> = std::iter::once(building).chain(parts.iter().copied()).collect();
        return vec![found(building, &all)];
    }
    let of_part = |part: &CityObject| {
        let mut found = FoundBuilding { part_of: Some(building.id.clone()), ..found(part, &[part]) };
        // What the user knew of the whole is true of its parts.
        let theirs = building.attributes.iter().filter(|(name, _)| !is_ours(name));
        found.attributes.extend(theirs.map(|(name, value)| (name.clone(), value.clone())));
        found
    };
    own_parts.into_iter().map(of_part).collect()
}

fn has_own_status(object: &CityObject) -> bool {
    ["status".to_owned(), format!("{EXTENSION_PREFIX}status")].iter().any(|name| object.attributes.contains_key(name))
}

/// Levels and footprint of one building from its surfaces.
#[must_use]
pub fn measure(
    surfaces: &[&CitySurface],
    vertices: &[[f64; 3]],
) -> (Option<BuildingLevels>, Option<MultiPolygon<f64>>) {
    let has_roof = surfaces.iter().any(|s| s.kind == Some(FaceKind::Roof));
    let looks_inwards = !has_roof && looks_inwards(surfaces, vertices);
    let mut roof = RoofSum::default();
    let (mut ground_m, mut lowest_m) = (f64::INFINITY, f64::INFINITY);
    let (mut ground_plan, mut roof_plan) = (Vec::new(), Vec::new());
    for surface in surfaces {
        let rings: Vec<Vec<[f64; 3]>> =
            surface.rings.iter().map(|ring| ring.iter().map(|&i| vertices[i as usize]).collect()).collect();
        let Some(exterior) = rings.first() else { continue };
        let low_m = exterior.iter().map(|p| p[2]).fold(f64::INFINITY, f64::min);
        lowest_m = lowest_m.min(low_m);
        let kind =
            if has_roof { surface.kind } else { surface.kind.or_else(|| kind_by_normal(exterior, looks_inwards)) };
        match kind {
            Some(FaceKind::Ground) => {
                ground_m = ground_m.min(low_m);
                ground_plan.extend(plan(&rings));
            }
            Some(FaceKind::Roof) => {
                roof.add(&rings);
                roof_plan.extend(plan(&rings));
            }
            Some(FaceKind::Wall) | None => {}
        }
    }
    let footprint = if ground_plan.is_empty() { roof_plan } else { ground_plan };
    let footprint = match footprint.len() {
        0 => None,
        // By far the most frequent, and a union would only cost time.
        1 => Some(MultiPolygon::new(footprint)),
        // A union takes polygons of one way round only.
        _ => Some(unary_union(&footprint.iter().map(|part| part.orient(Direction::Default)).collect::<Vec<_>>())),
    };
    let ground_m = if ground_m.is_finite() { ground_m } else { lowest_m };
    (roof.levels(ground_m), footprint)
}

/// Whether the volume that surfaces enclose is negative: they are clockwise seen from outside. Open surfaces enclose what is
/// between them and the level of the lowest corner.
fn looks_inwards(surfaces: &[&CitySurface], vertices: &[[f64; 3]]) -> bool {
    let rings = || surfaces.iter().flat_map(|surface| &surface.rings);
    let corner = |i: &u32| vertices[*i as usize];
    let lowest = rings().flatten().map(|i| corner(i)[2]).fold(f64::INFINITY, f64::min);
    let above =
        |ring: &Vec<u32>| -> Vec<[f64; 3]> { ring.iter().map(corner).map(|[x, y, z]| [x, y, z - lowest]).collect() };
    rings().map(|ring| plan_moment(&above(ring)).1).sum::<f64>() < 0.0
}

/// Roof or ground by the direction a surface faces (counter-clockwise seen from outside, or clockwise where all are).
fn kind_by_normal(ring: &[[f64; 3]], looks_inwards: bool) -> Option<FaceKind> {
    let normal = newell(ring);
    let length = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
    let cosine = if looks_inwards { -normal[2] } else { normal[2] } / length;
    if cosine > MIN_VERTICAL_COSINE {
        Some(FaceKind::Roof)
    } else if cosine < -MIN_VERTICAL_COSINE {
        Some(FaceKind::Ground)
    } else {
        None
    }
}

/// Area vector of a ring (Newell's method), twice the area long.
fn newell(ring: &[[f64; 3]]) -> [f64; 3] {
    let Some(origin) = ring.first() else { return [0.0; 3] };
    let from_origin = |p: &[f64; 3]| [p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]];
    let mut sum = [0.0; 3];
    for pair in ring.windows(2) {
        let (a, b) = (from_origin(&pair[0]), from_origin(&pair[1]));
        sum[0] += a[1] * b[2] - a[2] * b[1];
        sum[1] += a[2] * b[0] - a[0] * b[2];
        sum[2] += a[0] * b[1] - a[1] * b[0];
    }
    sum
}

/// The surface seen from above; `None` where it has no area there.
fn plan(rings: &[Vec<[f64; 3]>]) -> Option<Polygon<f64>> {
    let line = |ring: &Vec<[f64; 3]>| ring.iter().map(|p| Coord { x: p[0], y: p[1] }).collect::<LineString<f64>>();
    let polygon = Polygon::new(line(rings.first()?), rings[1..].iter().map(line).collect());
    (polygon.unsigned_area() > 0.0).then_some(polygon)
}

/// Running `∫ z dA` and `∫ dA` in plan.
#[derive(Default)]
struct RoofSum {
    area: f64,
    moment: f64,
    range_m: Option<(f64, f64)>,
}

impl RoofSum {
    fn add(&mut self, rings: &[Vec<[f64; 3]>]) {
        for (i, ring) in rings.iter().enumerate() {
            let (area, moment) = plan_moment(ring);
            // A hole takes away whichever way round it is given.
            let sign = if i == 0 { area.signum() } else { -area.signum() };
            self.area += sign * area;
            self.moment += sign * moment;
        }
        for p in rings.iter().flatten() {
            let (low, high) = self.range_m.unwrap_or((p[2], p[2]));
            self.range_m = Some((low.min(p[2]), high.max(p[2])));
        }
    }

    fn levels(&self, ground_m: f64) -> Option<BuildingLevels> {
        let (roof_min_m, roof_max_m) = self.range_m?;
        (self.area > 0.0).then(|| BuildingLevels {
            ground_m,
            roof_mean_m: self.moment / self.area,
            roof_min_m,
            roof_max_m,
        })
    }
}

/// Signed area in plan, and `∫ z dA`, of a planar ring by a fan of triangles.
fn plan_moment(ring: &[[f64; 3]]) -> (f64, f64) {
    let Some(o) = ring.first() else { return (0.0, 0.0) };
    ring.windows(2).fold((0.0, 0.0), |(area, moment), pair| {
        let [a, b] = [pair[0], pair[1]];
        let part = 0.5 * ((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]));
        (area + part, moment + part * (o[2] + a[2] + b[2]) / 3.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(kind: Option<FaceKind>, ring: Vec<u32>) -> CitySurface {
        CitySurface { place: [0; 3], kind, rings: vec![ring] }
    }

    /// A house of 10 × 6 m with a gable along x: eaves at 3 m, ridge at 5 m over the middle, ground at 1 m.
    fn gable_house() -> (Vec<[f64; 3]>, Vec<CitySurface>) {
        let vertices = vec![
            [0.0, 0.0, 1.0],
            [10.0, 0.0, 1.0],
            [10.0, 6.0, 1.0],
            [0.0, 6.0, 1.0],
            [0.0, 0.0, 3.0],
            [10.0, 0.0, 3.0],
            [10.0, 6.0, 3.0],
            [0.0, 6.0, 3.0],
            [0.0, 3.0, 5.0],
            [10.0, 3.0, 5.0],
        ];
        let surfaces = vec![
            surface(Some(FaceKind::Ground), vec![3, 2, 1, 0]),
            surface(Some(FaceKind::Roof), vec![4, 5, 9, 8]),
            surface(Some(FaceKind::Roof), vec![8, 9, 6, 7]),
            surface(Some(FaceKind::Wall), vec![0, 1, 5, 4]),
            surface(Some(FaceKind::Wall), vec![2, 3, 7, 6]),
            surface(Some(FaceKind::Wall), vec![1, 2, 6, 9, 5]),
            surface(Some(FaceKind::Wall), vec![3, 0, 4, 8, 7]),
        ];
        (vertices, surfaces)
    }

    #[test]
    fn a_gable_roof_has_its_mean_halfway_between_eave_and_ridge() {
        let (vertices, surfaces) = gable_house();
        let (levels, footprint) = measure(&surfaces.iter().collect::<Vec<_>>(), &vertices);
        let expected = BuildingLevels { ground_m: 1.0, roof_mean_m: 4.0, roof_min_m: 3.0, roof_max_m: 5.0 };
        assert_eq!(levels, Some(expected));
        assert_eq!(footprint.unwrap().unsigned_area(), 60.0);
    }

    #[test]
    fn without_semantics_the_normals_tell_roof_from_wall() {
        let (vertices, mut surfaces) = gable_house();
        for surface in &mut surfaces {
            surface.kind = None;
        }
        let (levels, footprint) = measure(&surfaces.iter().collect::<Vec<_>>(), &vertices);
        assert_eq!(levels.map(|l| (l.ground_m, l.roof_mean_m)), Some((1.0, 4.0)));
        assert_eq!(footprint.unwrap().unsigned_area(), 60.0);
    }

    #[test]
    fn a_body_that_is_inside_out_has_the_levels_of_one_that_is_not() {
        let (vertices, mut surfaces) = gable_house();
        for surface in &mut surfaces {
            surface.kind = None;
            surface.rings.iter_mut().for_each(|ring| ring.reverse());
        }
        let (levels, footprint) = measure(&surfaces.iter().collect::<Vec<_>>(), &vertices);
        let expected = BuildingLevels { ground_m: 1.0, roof_mean_m: 4.0, roof_min_m: 3.0, roof_max_m: 5.0 };
        assert_eq!(levels, Some(expected));
        assert_eq!(footprint.unwrap().unsigned_area(), 60.0);
        let roofs: Vec<&CitySurface> = surfaces[1..3].iter().collect();
        assert_eq!(measure(&roofs, &vertices).0.map(|l| l.roof_mean_m), Some(4.0), "roofs alone");
    }
}
