//! A building with known truth: footprint, heights, and the triangles that the cameras see.

use std::collections::BTreeMap;

use geo::{BoundingRect, Contains};
use geo_types::{Coord, LineString, Point, Polygon};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use sizeup_geo::terrain::Terrain;
use sizeup_geo::triangles;
use sizeup_heights::ids::BuildingId;

use super::form::{BuildingForm, FormFace, RoofKind};

/// Walls go this far below the lowest ground under the footprint, metres: no gap on a slope.
const FOUNDATION_M: f64 = 1.0;
/// Corners closer than this are the same corner, metres.
const SAME_CORNER_M: f64 = 1e-4;
/// Ground samples per side of a footprint's bounding box.
const GROUND_SAMPLES: usize = 24;

/// Kind of a building.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BuildingKind {
    /// A detached house with a pitched roof.
    House,
    /// One of several houses in a row that share walls.
    RowHouse,
    /// A long block of flats.
    Slab,
    /// An L- or U-shaped building.
    Angled,
    /// A block around a courtyard.
    Courtyard,
    /// A high-rise, with or without a podium.
    Tower,
    /// A low building with a flat roof.
    Pavilion,
    /// A large hall for industry or trade.
    Hall,
    /// From a file of real buildings.
    Real,
}

impl BuildingKind {
    /// The name under which files have it.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::House => "house",
            Self::RowHouse => "row_house",
            Self::Slab => "slab",
            Self::Angled => "angled",
            Self::Courtyard => "courtyard",
            Self::Tower => "tower",
            Self::Pavilion => "pavilion",
            Self::Hall => "hall",
            Self::Real => "real",
        }
    }
}

/// Which part of a building a triangle belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RoofOrWall {
    /// Whatever is seen from above.
    Roof,
    /// Upright, or seen from below only.
    Wall,
}

/// A triangle in the map frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// Corners, counter-clockwise seen from outside.
    pub corners: [DVec3; 3],
    /// Whether the triangle is roof or wall.
    pub part: RoofOrWall,
}

impl Triangle {
    /// Area of the projection onto the horizontal plane, m²: positive if it faces up.
    #[must_use]
    pub fn plan_area_m2(&self) -> f64 {
        let [a, b, c] = self.corners.map(DVec3::truncate);
        0.5 * (b - a).perp_dot(c - a)
    }
}

/// A building and the truth about it. Map frame, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedBuilding {
    /// Unique in the scene.
    pub id: BuildingId,
    /// Kind of building, as the town's plan has it.
    pub kind: BuildingKind,
    /// The shape of its roof.
    pub roof: RoofKind,
    /// Footprint on the ground, courtyards as holes.
    pub footprint: Polygon<f64>,
    /// Mean ground under the footprint: heights count from here.
    pub ground_z_m: f64,
    /// Area-mean roof height over the ground.
    pub height_m: f64,
    /// Lowest edge of the roof over the ground.
    pub eave_m: f64,
    /// Highest point of the roof over the ground.
    pub ridge_m: f64,
    /// Direction of its long side, radians from east: textures follow it.
    pub heading_rad: f64,
    /// Triangles of roofs and walls, map frame, metres.
    pub triangles: Vec<Triangle>,
    /// Horizontal faces of a stepped roof; empty for the others.
    pub levels: Vec<RoofLevel>,
}

/// A horizontal face of a stepped roof.
#[derive(Debug, Clone, PartialEq)]
pub struct RoofLevel {
    /// Outline of the face in the map, metres.
    pub footprint: Polygon<f64>,
    /// Height over the building's ground, metres.
    pub height_m: f64,
}

/// Placement of a form: its plane turned by `angle_rad` (counter-clockwise) and moved to `origin`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// The plane's origin in the map frame, metres.
    pub origin: DVec2,
    /// Turn of the plane, radians, counter-clockwise from east.
    pub angle_rad: f64,
}

impl Placement {
    /// A position of the form's plane in the map frame.
    #[must_use]
    pub fn point(&self, p: DVec2) -> DVec2 {
        self.origin + DVec2::from_angle(self.angle_rad).rotate(p)
    }

    /// A placement given in this one's plane.
    #[must_use]
    pub fn then(&self, origin: DVec2, angle_rad: f64) -> Self {
        Self { origin: self.point(origin), angle_rad: self.angle_rad + angle_rad }
    }
}

impl SimulatedBuilding {
    /// Raises a form on the terrain.
    #[must_use]
    pub fn raise(form: &BuildingForm, at: &Placement, terrain: &Terrain, kind: BuildingKind, id: BuildingId) -> Self {
        let footprint = polygon(form.footprint.iter().map(|ring| ring.iter().map(|&p| at.point(p)).collect()));
        let (ground_z_m, lowest_z_m) = ground_under(&footprint, terrain);
        let in_map = |p: DVec3| at.point(p.truncate()).extend(ground_z_m + p.z);
        let base_m = lowest_z_m - ground_z_m - FOUNDATION_M;
        let roofs = form.faces.iter().flat_map(|face| triangulate(&face.rings));
        let mut triangles: Vec<Triangle> =
            roofs.map(|corners| Triangle { corners: corners.map(in_map), part: RoofOrWall::Roof }).collect();
        triangles.extend(
            walls(form, base_m)
                .into_iter()
                .map(|corners| Triangle { corners: corners.map(in_map), part: RoofOrWall::Wall }),
        );
        let rings = |face: &FormFace| -> Vec<Vec<DVec2>> {
            face.rings.iter().map(|ring| ring.iter().map(|p| at.point(p.truncate())).collect()).collect()
        };
        let level = |face: &FormFace| RoofLevel { footprint: polygon(rings(face)), height_m: face.rings[0][0].z };
        let levels = if form.roof == RoofKind::Stepped { form.faces.iter().map(level).collect() } else { Vec::new() };
        let z = || form.faces.iter().flat_map(|f| &f.rings).flatten().map(|p| p.z);
        Self {
            id,
            kind,
            roof: form.roof,
            height_m: mean_roof_z_m(&triangles).unwrap_or(ground_z_m) - ground_z_m,
            eave_m: z().fold(f64::INFINITY, f64::min),
            ridge_m: z().fold(f64::NEG_INFINITY, f64::max),
            footprint,
            ground_z_m,
            heading_rad: at.angle_rad,
            triangles,
            levels,
        }
    }
}

/// The buildings with a stepped roof in the place of which stand their levels, each with a flat roof of its own. Only footprints and
/// heights are those of the levels; what cameras see stays with the buildings.
#[must_use]
pub fn by_roof_level(buildings: &[SimulatedBuilding], terrain: &Terrain) -> Vec<SimulatedBuilding> {
    let parts = |building: &SimulatedBuilding| {
        let part = |(i, level): (usize, &RoofLevel)| {
            let (ground_z_m, _) = ground_under(&level.footprint, terrain);
            let height_m = building.ground_z_m + level.height_m - ground_z_m;
            SimulatedBuilding {
                id: BuildingId(format!("{}_{}", building.id, i + 1)),
                roof: RoofKind::Flat,
                footprint: level.footprint.clone(),
                ground_z_m,
                height_m,
                eave_m: height_m,
                ridge_m: height_m,
                triangles: Vec::new(),
                levels: Vec::new(),
                ..building.clone()
            }
        };
        match building.levels.len() {
            0 | 1 => vec![building.clone()],
            _ => building.levels.iter().enumerate().map(part).collect(),
        }
    };
    buildings.iter().flat_map(parts).collect()
}

/// `Σ A·z / Σ A` over roof triangles, with plan areas `A` and mean heights `z`; `None` without a roof.
pub(super) fn mean_roof_z_m(triangles: &[Triangle]) -> Option<f64> {
    let roofs = || triangles.iter().filter(|t| t.part == RoofOrWall::Roof);
    let area: f64 = roofs().map(Triangle::plan_area_m2).sum();
    let volume: f64 = roofs().map(|t| t.plan_area_m2() * t.corners.iter().map(|p| p.z).sum::<f64>() / 3.0).sum();
    (area > 0.0).then(|| volume / area)
}

/// A polygon from open rings, exterior first.
pub(super) fn polygon(rings: impl IntoIterator<Item = Vec<DVec2>>) -> Polygon<f64> {
    let mut closed = rings.into_iter().map(|ring| {
        let mut coords: Vec<Coord<f64>> = ring.iter().map(|p| Coord { x: p.x, y: p.y }).collect();
        coords.extend(coords.first().copied());
        LineString(coords)
    });
    let exterior = closed.next().unwrap_or_else(|| LineString(Vec::new()));
    Polygon::new(exterior, closed.collect())
}

/// Mean and lowest ground under a footprint, metres; 0 where there is no terrain at all.
pub(super) fn ground_under(footprint: &Polygon<f64>, terrain: &Terrain) -> (f64, f64) {
    let corners = footprint.exterior().points().filter_map(|p| terrain.height_at(p.x(), p.y()));
    let mut lowest = corners.fold(f64::INFINITY, f64::min);
    let (mut sum, mut n) = (0.0, 0_u32);
    if let Some(bounds) = footprint.bounding_rect() {
        for i in 0..GROUND_SAMPLES * GROUND_SAMPLES {
            let share = |k: usize| (k as f64 + 0.5) / GROUND_SAMPLES as f64;
            let x = bounds.min().x + bounds.width() * share(i % GROUND_SAMPLES);
            let y = bounds.min().y + bounds.height() * share(i / GROUND_SAMPLES);
            if !footprint.contains(&Point::new(x, y)) {
                continue;
            }
            if let Some(z) = terrain.height_at(x, y) {
                sum += z;
                n += 1;
                lowest = lowest.min(z);
            }
        }
    }
    match (n, lowest.is_finite()) {
        (0, false) => (0.0, 0.0),
        (0, true) => (lowest, lowest),
        _ => (sum / f64::from(n), lowest),
    }
}

/// Triangles of a planar polygon, by ear clipping of its plan.
pub(super) fn triangulate(rings: &[Vec<DVec3>]) -> Vec<[DVec3; 3]> {
    let points: Vec<DVec3> = rings.iter().flatten().copied().collect();
    // A ring without area has no triangles; the caller then has no face, which is what it is.
    let triangles = triangles::triangulate(rings.iter().map(|ring| ring.iter().map(|p| [p.x, p.y])));
    let corners = triangles.into_iter().map(|t| t.map(|i| points[i]));
    corners
        .map(|t| if (t[1] - t[0]).truncate().perp_dot((t[2] - t[0]).truncate()) < 0.0 { [t[0], t[2], t[1]] } else { t })
        .collect()
}

/// Upright triangles below every roof edge: down to the next roof, or to the base.
fn walls(form: &BuildingForm, base_m: f64) -> Vec<[DVec3; 3]> {
    // Both faces of an inner edge meet under one key; the map's order makes the result reproducible.
    let key = |p: DVec3| [p.x, p.y].map(|v| (v / SAME_CORNER_M).round() as i64);
    let mut sides: BTreeMap<_, Vec<[DVec3; 2]>> = BTreeMap::new();
    for ring in form.faces.iter().flat_map(|f| &f.rings) {
        for (i, &a) in ring.iter().enumerate() {
            let b = ring[(i + 1) % ring.len()];
            sides.entry([key(a).min(key(b)), key(a).max(key(b))]).or_default().push([a, b]);
        }
    }
    let mut triangles = Vec::new();
    for edges in sides.values() {
        for &[a, b] in edges {
            let other = edges.iter().find(|[c, d]| key(*c) == key(b) && key(*d) == key(a));
            let (za, zb) = other.map_or((base_m, base_m), |[c, d]| (d.z, c.z));
            if a.z + b.z > za + zb + SAME_CORNER_M {
                let (low_a, low_b) = (a.truncate().extend(za), b.truncate().extend(zb));
                triangles.extend([[a, low_a, low_b], [a, low_b, b]]);
            }
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use geo::Area;

    use super::*;
    use crate::simulate::SimulateConfig;
    use crate::simulate::blocks;
    use crate::simulate::config::TownKind;
    use crate::simulate::form::{self, Rect, Wing};

    fn raised(form: &BuildingForm) -> SimulatedBuilding {
        let at = Placement { origin: DVec2::new(565_000.0, 5_932_000.0), angle_rad: 0.3 };
        SimulatedBuilding::raise(form, &at, &Terrain::Constant(20.0), BuildingKind::House, "a".into())
    }

    #[test]
    fn the_mean_height_of_a_gable_is_half_way_up() {
        let b = raised(&form::gable(Rect::sized(0.0, 0.0, 12.0, 8.0), 6.0, 9.0));
        assert!((b.height_m - 7.5).abs() < 1e-9 && b.eave_m == 6.0 && b.ridge_m == 9.0);
    }

    #[test]
    fn levels_tile_their_building_and_have_its_mean_height() {
        let config = SimulateConfig::preset("downtown").unwrap();
        let world = super::super::world(&config).unwrap();
        let stepped: Vec<_> = world.buildings.iter().filter(|b| b.levels.len() > 1).cloned().collect();
        assert!(!stepped.is_empty());
        for building in stepped {
            let parts = by_roof_level(std::slice::from_ref(&building), &Terrain::Constant(building.ground_z_m));
            let area_m2: f64 = parts.iter().map(|p| p.footprint.unsigned_area()).sum();
            let volume_m3: f64 = parts.iter().map(|p| p.footprint.unsigned_area() * p.height_m).sum();
            assert!((area_m2 - building.footprint.unsigned_area()).abs() < 1e-3, "{}", building.id);
            assert!((volume_m3 / area_m2 - building.height_m).abs() < 1e-6, "{}", building.id);
            assert!(parts.iter().all(|p| p.id.0.starts_with(&building.id.0)));
        }
    }

    #[test]
    fn the_mean_height_of_a_hip_follows_from_its_volume() {
        // Over the eave: a prism over (12 − 8) × 8 m with half the rise, and a pyramid over 8 × 8 m with a third.
        let b = raised(&form::hip(Rect::sized(0.0, 0.0, 12.0, 8.0), 6.0, 9.0));
        let expected = 6.0 + (4.0 * 8.0 * 1.5 + 8.0 * 8.0 * 1.0) / (12.0 * 8.0);
        assert!((b.height_m - expected).abs() < 1e-9, "{}", b.height_m);
    }

    #[test]
    fn a_wing_adds_its_own_roof_and_the_part_that_runs_into_the_main_one() {
        // Half-width w = 3 m, pitch 1: the part over the main slope has volume w³ / 3 (integral of (w − t)²).
        let wing = Wing { x0: 0.0, x1: 6.0, reach: 5.0 };
        let b = raised(&form::gable_with_wings(Rect::sized(0.0, 0.0, 20.0, 10.0), 4.0, 9.0, &[wing]));
        let over_the_eave = 20.0 * 10.0 * 2.5 + 6.0 * 5.0 * 1.5 + 27.0 / 3.0;
        assert!((b.height_m - (4.0 + over_the_eave / 230.0)).abs() < 1e-9, "{}", b.height_m);
    }

    #[test]
    fn roofs_tile_their_footprints_whatever_stands_in_a_block() {
        for kind in [TownKind::Village, TownKind::Suburb, TownKind::District, TownKind::Downtown, TownKind::Industry] {
            for i in 0..40 {
                let mut rng = sizeup_heights::seed::stream(5, "test", &[i]);
                for (form, ..) in blocks::fill(kind, DVec2::new(85.0, 74.0), &mut rng) {
                    let b = raised(&form);
                    let roofs = b.triangles.iter().filter(|t| t.part == RoofOrWall::Roof);
                    let area: f64 = roofs.map(Triangle::plan_area_m2).sum();
                    let expected = b.footprint.unsigned_area();
                    assert!((area - expected).abs() < 1e-3, "{kind:?} {i}: {area} {expected} {form:?}");
                }
            }
        }
    }
}
