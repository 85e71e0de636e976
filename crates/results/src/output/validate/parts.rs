//! 601: parts of one building that share volume.
//!
//! ```text
//! shared = area(footprint_a ∩ footprint_b) × (lower roof − higher base) > 0
//! ```
//!
//! Exact for upright prisms, which is what LOD1 parts are; parts of another form are passed over. What is thinner than the snap
//! tolerance is a wall that two parts have in common.

use geo::{Area as _, BooleanOps as _, BoundingRect as _, Centroid as _, Euclidean, Length as _, unary_union};
use geo_types::{Coord, LineString, MultiPolygon, Polygon};

use super::super::cityjson::read::{CityFile, CityGeometry, CityObject};
use super::{Code, Fault, ValidateConfig};

/// A face is level or upright if its normal is within this of it (the sine of 0.06°).
const LEVEL: f64 = 1e-3;

/// A part that is an upright prism.
pub struct PrismPart {
    object: String,
    lod: String,
    footprint: MultiPolygon<f64>,
    levels_m: [f64; 2],
}

impl PrismPart {
    /// The prism that a geometry is; `None` if it is of another form.
    pub fn of(city: &CityFile, object: &CityObject, geometry: &CityGeometry, config: &ValidateConfig) -> Option<Self> {
        let position = |i: &u32| city.vertices.get(*i as usize).copied();
        let mut levels_m = [f64::INFINITY, f64::NEG_INFINITY];
        let mut level_faces: Vec<(f64, Polygon<f64>)> = Vec::new();
        for surface in &geometry.surfaces {
            let rings: Vec<Vec<[f64; 3]>> =
                surface.rings.iter().map(|ring| ring.iter().map(position).collect()).collect::<Option<_>>()?;
            let up = upness(rings.first()?)?;
            let z_m = rings[0][0][2];
            if up.abs() > 1.0 - LEVEL {
                levels_m = [levels_m[0].min(z_m), levels_m[1].max(z_m)];
                level_faces.push((z_m, polygon(&rings)));
            } else if up.abs() > LEVEL {
                return None;
            }
        }
        let is_at = |z_m: f64, level_m: f64| (z_m - level_m).abs() <= config.snap_tolerance_m;
        let is_prism = level_faces.iter().all(|(z_m, _)| is_at(*z_m, levels_m[0]) || is_at(*z_m, levels_m[1]));
        let bottom: Vec<Polygon<f64>> =
            level_faces.into_iter().filter(|(z_m, _)| is_at(*z_m, levels_m[0])).map(|(_, polygon)| polygon).collect();
        let (object, lod) = (object.id.clone(), geometry.lod.clone());
        is_prism.then(|| Self { object, lod, footprint: unary_union(&bottom), levels_m })
    }

    /// Place where it shares volume with another part.
    fn overlap(&self, other: &Self, config: &ValidateConfig) -> Option<[f64; 3]> {
        let base_m = self.levels_m[0].max(other.levels_m[0]);
        let is_stacked = self.levels_m[1].min(other.levels_m[1]) - base_m <= config.snap_tolerance_m;
        let boxes = self.footprint.bounding_rect().zip(other.footprint.bounding_rect());
        let is_apart = boxes.is_none_or(|(a, b)| {
            a.min().x > b.max().x || b.min().x > a.max().x || a.min().y > b.max().y || b.min().y > a.max().y
        });
        if self.lod != other.lod || is_stacked || is_apart {
            return None;
        }
        let shared = self.footprint.intersection(&other.footprint);
        let border_m: f64 = shared.iter().map(|polygon| Euclidean.length(polygon.exterior())).sum();
        let is_thick = 2.0 * shared.unsigned_area() > config.snap_tolerance_m * border_m;
        shared.centroid().filter(|_| is_thick).map(|at| [at.x(), at.y(), base_m])
    }
}

/// The parts of one building against each other.
pub fn overlaps(parts: &[PrismPart], config: &ValidateConfig) -> Vec<Fault> {
    let fault = |part: &PrismPart, position: [f64; 3]| Fault {
        number: Code::BuildingPartsOverlap.number(),
        code: Code::BuildingPartsOverlap,
        object: part.object.clone(),
        lod: part.lod.clone(),
        solid: 0,
        shell: 0,
        surface: None,
        position: Some(position),
    };
    let first = |(i, part): (usize, &PrismPart)| {
        parts[..i].iter().find_map(|other| part.overlap(other, config)).map(|at| fault(part, at))
    };
    parts.iter().enumerate().filter_map(first).collect()
}

/// The vertical component of a ring's unit normal; `None` where it has no area.
fn upness(ring: &[[f64; 3]]) -> Option<f64> {
    let point = |i: usize| glam::DVec3::from_array(ring[i % ring.len()]);
    let origin = point(0);
    let area: glam::DVec3 = (0..ring.len()).map(|i| (point(i) - origin).cross(point(i + 1) - origin)).sum();
    area.try_normalize().map(|normal| normal.z)
}

fn polygon(rings: &[Vec<[f64; 3]>]) -> Polygon<f64> {
    let line = |ring: &Vec<[f64; 3]>| ring.iter().map(|p| Coord { x: p[0], y: p[1] }).collect::<LineString<f64>>();
    Polygon::new(line(&rings[0]), rings[1..].iter().map(line).collect())
}
