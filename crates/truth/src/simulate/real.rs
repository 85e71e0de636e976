//! Real buildings from a `CityJSON` file, on a ground made from the heights they stand on.
//!
//! Footprint: union of the ground surfaces, or of everything's plan where there are none. Truth: area-mean roof height
//! over the mean ground of the DTM under the footprint.

use geo::{Area, Centroid, Contains, Simplify, Validation, unary_union};
use geo_types::{LineString, Point, Polygon};
use glam::{DVec2, DVec3};
use rstar::{RTree, primitives::GeomWithData};

use sizeup_geo::terrain::Terrain;
use sizeup_geo::triangles::area_vector;
use sizeup_heights::ids::BuildingId;

use super::SimulateError;
use super::building::{self, BuildingKind, RoofOrWall, SimulatedBuilding, Triangle};
use super::cityjson::{self, RawBuilding, RawSurface, Role};
use super::config::{CityJsonTown, SimulateConfig};
use super::disturb::open_ring;
use super::form::RoofKind;
use super::relief::{self, MapRect};
use super::town::SimulatedTown;

/// Without semantics, a surface this much turned upwards (z of the unit normal) is roof, downwards ground.
const ROOF_NORMAL_Z: f64 = 0.15;
/// Smaller footprints and courtyards are noise of the file, m².
const LEAST_AREA_M2: f64 = 4.0;
/// Corners of a union this near to a line are noise of the computation, metres.
const COLLINEAR_M: f64 = 0.01;
/// Buildings whose ground levels make the terrain at one place, and the distance that smooths them, metres.
const NEAREST: usize = 12;
const SMOOTHING_M: f64 = 20.0;
/// Walls are carried down this far below the lowest ground under them, metres.
const SKIRT_M: f64 = 1.0;

/// A building before it stands on its ground.
struct Draft {
    id: BuildingId,
    footprint: Polygon<f64>,
    triangles: Vec<Triangle>,
    /// Place in its file.
    foot_z_m: f64,
}

/// The buildings of a file, moved, selected and set on a terrain.
///
/// # Errors
/// [`SimulateError`] for a file that cannot be used or a selection without buildings.
pub(super) fn build(config: &SimulateConfig, source: &CityJsonTown) -> Result<SimulatedTown, SimulateError> {
    let city = cityjson::read(&source.path)?;
    let shift = DVec3::from(source.translation_m);
    let drafts: Vec<Draft> = city.buildings.iter().filter_map(|b| draft(b, shift)).collect();
    let drafts = select(drafts, source, shift.truncate());
    let corners = drafts.iter().flat_map(|d| d.footprint.exterior().0.iter().map(|c| DVec2::new(c.x, c.y)));
    let wanted = source.max_buildings.unwrap_or(city.buildings.len());
    let extent = MapRect::of(corners).ok_or(SimulateError::NoBuildings { wanted })?;
    let terrain = terrain(config, &drafts, &extent)?;
    let buildings = drafts.into_iter().map(|d| settle(d, &terrain)).collect();
    Ok(SimulatedTown { buildings, terrain, streets: None, extent, crs: city.crs.unwrap_or_else(|| config.crs.clone()) })
}

/// Footprint and triangles; `None` for a building without either.
fn draft(raw: &RawBuilding, shift: DVec3) -> Option<Draft> {
    let surfaces: Vec<RawSurface> = raw
        .surfaces
        .iter()
        .map(|s| RawSurface {
            rings: s.rings.iter().map(|r| r.iter().map(|&p| p + shift).collect()).collect(),
            role: if s.role == Role::Unsaid { role_of(&s.rings) } else { s.role },
        })
        .collect();
    let plans = |role: Option<Role>| -> Vec<Polygon<f64>> {
        surfaces
            .iter()
            .filter(|s| role.is_none_or(|role| s.role == role))
            .map(|s| building::polygon(s.rings.iter().map(|r| r.iter().map(|p| p.truncate()).collect())))
            .filter(|p| p.unsigned_area() > 1e-3)
            .collect()
    };
    let ground = plans(Some(Role::Ground));
    let union = unary_union(&if ground.is_empty() { plans(None) } else { ground });
    // A building in several pieces is its largest one: one footprint, one height.
    let largest = union.0.into_iter().max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area()))?;
    let footprint = tidy(&largest)?;
    let mut triangles: Vec<Triangle> = surfaces.iter().flat_map(triangles_of).collect();
    let is_over = |t: &Triangle| {
        let p = (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
        footprint.contains(&Point::new(p.x, p.y))
    };
    for t in &mut triangles {
        if t.part == RoofOrWall::Roof && !is_over(t) {
            // Overhangs and lesser pieces are seen, but do not count.
            t.part = RoofOrWall::Wall;
        }
    }
    building::mean_roof_z_m(&triangles)?;
    let foot_z_m = surfaces.iter().flat_map(|s| s.rings.iter().flatten()).map(|p| p.z).fold(f64::INFINITY, f64::min);
    Some(Draft { id: BuildingId(raw.id.clone()), footprint, triangles, foot_z_m })
}

fn role_of(rings: &[Vec<DVec3>]) -> Role {
    match area_vector(&rings[0]).normalize_or_zero().z {
        z if z > ROOF_NORMAL_Z => Role::Roof,
        z if z < -ROOF_NORMAL_Z => Role::Ground,
        _ => Role::Wall,
    }
}

/// Triangles of a planar surface of any attitude; roofs face up, ground is never seen.
fn triangles_of(surface: &RawSurface) -> Vec<Triangle> {
    let n = area_vector(&surface.rings[0]).normalize_or_zero();
    if surface.role == Role::Ground || n == DVec3::ZERO {
        return Vec::new();
    }
    let (part, is_turned) = (
        if surface.role == Role::Roof { RoofOrWall::Roof } else { RoofOrWall::Wall },
        surface.role == Role::Roof && n.z < 0.0,
    );
    // Ear clipping works in a plane: turn the surface into it, and the triangles back.
    let across = n.any_orthonormal_vector();
    let up = n.cross(across);
    let origin = surface.rings[0][0];
    let flat: Vec<Vec<DVec3>> = surface
        .rings
        .iter()
        .map(|ring| {
            ring.iter()
                .map(|&p| DVec3::new((p - origin).dot(across), (p - origin).dot(up), (p - origin).dot(n)))
                .collect()
        })
        .collect();
    let back = |p: DVec3| origin + across * p.x + up * p.y + n * p.z;
    building::triangulate(&flat)
        .into_iter()
        .map(|[a, b, c]| {
            let corners = [back(a), back(b), back(c)];
            let corners = if is_turned { [corners[0], corners[2], corners[1]] } else { corners };
            Triangle { corners, part }
        })
        .collect()
}

/// Without noise of the computation; `None` if nothing usable is left.
fn tidy(polygon: &Polygon<f64>) -> Option<Polygon<f64>> {
    let simple = polygon.simplify(COLLINEAR_M);
    let holes = simple
        .interiors()
        .iter()
        .filter(|ring| Polygon::new((*ring).clone(), Vec::new()).unsigned_area() >= LEAST_AREA_M2);
    let tidied = Polygon::new(simple.exterior().clone(), holes.cloned().collect());
    let tidied = geo::Orient::orient(&tidied, geo::orient::Direction::Default);
    (tidied.unsigned_area() >= LEAST_AREA_M2 && tidied.is_valid()).then_some(tidied)
}

/// By bounds, then the nearest to the middle; in the order of the file.
fn select(drafts: Vec<Draft>, source: &CityJsonTown, shift: DVec2) -> Vec<Draft> {
    let centre = |d: &Draft| d.footprint.centroid().map_or(DVec2::NAN, |p| DVec2::new(p.x(), p.y()) - shift);
    let within = |p: DVec2| {
        source
            .bounds_m
            .is_none_or(|[west, south, east, north]| p.x >= west && p.x <= east && p.y >= south && p.y <= north)
    };
    let mut chosen: Vec<Draft> = drafts.into_iter().filter(|d| within(centre(d))).collect();
    let n = source.max_buildings.unwrap_or(usize::MAX);
    if chosen.len() > n {
        let middle = MapRect::of(chosen.iter().map(centre)).map_or(DVec2::ZERO, |e| e.centre());
        let mut distances: Vec<f64> = chosen.iter().map(|d| centre(d).distance(middle)).collect();
        distances.sort_by(f64::total_cmp);
        let limit = distances[n - 1];
        chosen.retain(|d| centre(d).distance(middle) <= limit);
        chosen.truncate(n);
    }
    chosen
}

/// Weighted mean of the nearest buildings' ground levels, `w = 1 / (distance² + smoothing²)`.
fn terrain(config: &SimulateConfig, drafts: &[Draft], extent: &MapRect) -> Result<Terrain, SimulateError> {
    let points = drafts.iter().filter_map(|d| {
        let c = d.footprint.centroid()?;
        Some(GeomWithData::new([c.x(), c.y()], d.foot_z_m))
    });
    let tree = RTree::bulk_load(points.collect());
    let height = |p: DVec2| {
        let near = tree.nearest_neighbor_iter_with_distance_2(&[p.x, p.y]).take(NEAREST);
        let (sum, weight) = near.fold((0.0, 0.0), |(sum, weight), (point, distance2)| {
            let w = 1.0 / (distance2 + SMOOTHING_M * SMOOTHING_M);
            (sum + w * point.data, weight + w)
        });
        sum / weight
    };
    let wide = extent.grown(config.terrain.margin_m);
    let middle = wide.centre();
    relief::grid(&wide, config.terrain.cell_m, |from_middle| height(middle + from_middle))
}

/// Measures a building against the terrain, and closes what gap lies between them.
fn settle(draft: Draft, terrain: &Terrain) -> SimulatedBuilding {
    let (ground_z_m, lowest_z_m) = building::ground_under(&draft.footprint, terrain);
    let mut triangles = draft.triangles;
    let roof_z = || triangles.iter().filter(|t| t.part == RoofOrWall::Roof).flat_map(|t| t.corners).map(|p| p.z);
    let (eave, ridge) = (roof_z().fold(f64::INFINITY, f64::min), roof_z().fold(f64::NEG_INFINITY, f64::max));
    let mean = building::mean_roof_z_m(&triangles).unwrap_or(ground_z_m);
    triangles.extend(skirt(&draft.footprint, draft.foot_z_m, lowest_z_m - SKIRT_M));
    SimulatedBuilding {
        id: draft.id,
        kind: BuildingKind::Real,
        roof: RoofKind::Surveyed,
        heading_rad: longest_edge_rad(&draft.footprint),
        footprint: draft.footprint,
        ground_z_m,
        height_m: mean - ground_z_m,
        eave_m: eave - ground_z_m,
        ridge_m: ridge - ground_z_m,
        triangles,
        levels: Vec::new(),
    }
}

/// Walls below the building's own, where the ground falls away.
fn skirt(footprint: &Polygon<f64>, top_z_m: f64, base_z_m: f64) -> Vec<Triangle> {
    if top_z_m <= base_z_m {
        return Vec::new();
    }
    let rings = std::iter::once(footprint.exterior()).chain(footprint.interiors());
    let edges = rings.flat_map(LineString::lines);
    edges
        .flat_map(|line| {
            let (a, b) = (DVec2::new(line.start.x, line.start.y), DVec2::new(line.end.x, line.end.y));
            let [a1, b1, a0, b0] = [a.extend(top_z_m), b.extend(top_z_m), a.extend(base_z_m), b.extend(base_z_m)];
            [[a1, a0, b0], [a1, b0, b1]].map(|corners| Triangle { corners, part: RoofOrWall::Wall })
        })
        .collect()
}

fn longest_edge_rad(footprint: &Polygon<f64>) -> f64 {
    let ring = open_ring(footprint.exterior());
    let edges = (0..ring.len()).map(|i| ring[(i + 1) % ring.len()] - ring[i]);
    edges.max_by(|a, b| a.length().total_cmp(&b.length())).map_or(0.0, DVec2::to_angle)
}
