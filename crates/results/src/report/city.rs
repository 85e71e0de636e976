//! Buildings and ground as the page's script wants them: small whole numbers around an origin.

use std::collections::HashMap;

use geo::BoundingRect as _;
use geo_types::{LineString, Polygon};
use serde::Serialize;
use serde_json::{Map as JsonMap, Value};

use crate::output::attributes::round_m;
use crate::output::grid::OutputGrid;
use crate::output::prism::{FaceKind, GridFace, SnappedPrism};
use crate::output::roof_solid::{self, Detail};
use crate::output::{BuildingRecord, triangles};
use sizeup_geo::terrain::Terrain;

/// Steps of a footprint's coordinates in a metre: centimetres.
const PER_METRE: f64 = 100.0;
/// Ground around the buildings, in their larger side, and at least, metres.
const MARGIN_SHARE: f64 = 0.35;
const LEAST_MARGIN_M: f64 = 40.0;
/// Cells of the ground along its longer side, at most, and their least size, metres.
const GROUND_CELLS: f64 = 96.0;
const LEAST_CELL_M: f64 = 2.0;

/// A building as the report's map shows it.
#[derive(Debug, Serialize)]
pub struct MapBuilding<'a> {
    id: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    part_of: Option<&'a str>,
    /// Centimetres east and north of the origin in turn, rings open; exterior first, counter-clockwise.
    rings: Vec<Vec<i64>>,
    /// Corners of the roof's triangles, counted through all rings.
    triangles: Vec<usize>,
    /// Faces with the roof's form, the floor left out; empty where the building is a block.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    faces: Vec<SolidFace>,
    ground: Option<f64>,
    base: Option<f64>,
    height: Option<f64>,
    sigma: Option<f64>,
    status: &'static str,
    reasons: &'a [String],
    /// Positions among the views.
    views: Vec<usize>,
    #[serde(skip_serializing_if = "JsonMap::is_empty")]
    attributes: &'a JsonMap<String, Value>,
}

/// A face of a solid with a roof.
#[derive(Debug, Serialize)]
struct SolidFace {
    /// Centimetres east and north of the origin and above the base in turn, ring by ring.
    corners: Vec<i64>,
    /// Number of corners of each ring.
    rings: Vec<usize>,
    /// Corners of its triangles, counter-clockwise seen from outside.
    triangles: Vec<usize>,
}

/// Heights of the ground at the nodes of a grid, row by row from the south-west; `None` = not known.
#[derive(Debug, Serialize)]
pub struct GroundHeights {
    west: f64,
    south: f64,
    step: f64,
    columns: usize,
    z: Vec<Option<f64>>,
}

/// To a centimetre: below anything that is seen in a picture.
pub fn round_cm(value_m: f64) -> f64 {
    (value_m * PER_METRE).round() / PER_METRE + 0.0
}

/// The middle of the footprints at the lowest ground, whole metres; zero without footprints.
pub fn origin(records: &[BuildingRecord]) -> [f64; 3] {
    let Some([low, high]) = extent(records) else { return [0.0; 3] };
    let lowest = records.iter().filter_map(|r| r.base_z_m).fold(f64::INFINITY, f64::min);
    let z = if lowest.is_finite() { lowest.floor() } else { 0.0 };
    [(0.5 * (low[0] + high[0])).floor(), (0.5 * (low[1] + high[1])).floor(), z]
}

fn extent(records: &[BuildingRecord]) -> Option<[[f64; 2]; 2]> {
    let boxes = records.iter().filter_map(|r| r.footprint.as_ref()?.bounding_rect());
    boxes.map(|b| [[b.min().x, b.min().y], [b.max().x, b.max().y]]).reduce(|[low, high], [other_low, other_high]| {
        let with = |pick: fn(f64, f64) -> f64, a: [f64; 2], b: [f64; 2]| [pick(a[0], b[0]), pick(a[1], b[1])];
        [with(f64::min, low, other_low), with(f64::max, high, other_high)]
    })
}

impl<'a> MapBuilding<'a> {
    /// Building of a record; `views` knows the position of each photo.
    pub fn of(record: &'a BuildingRecord, origin: [f64; 3], grid: &OutputGrid, views: &HashMap<&str, usize>) -> Self {
        let rings = record.footprint.as_ref().map_or_else(Vec::new, |footprint| rings(footprint, origin));
        let triangles = triangles_of(&rings);
        Self {
            id: &record.id,
            part_of: record.part_of.as_deref(),
            triangles,
            rings,
            faces: faces(record, origin, grid),
            ground: record.ground_z_m.map(round_m),
            base: record.base_z_m.map(round_m),
            height: record.height_m.map(round_m),
            sigma: record.height_sigma_m.map(round_m),
            status: record.status.as_str(),
            reasons: &record.reasons,
            views: record.views.iter().filter_map(|name| views.get(name.as_str()).copied()).collect(),
            attributes: &record.attributes,
        }
    }
}

fn faces(record: &BuildingRecord, [east_m, north_m, _]: [f64; 3], grid: &OutputGrid) -> Vec<SolidFace> {
    let Ok(block) = SnappedPrism::of(record, grid, grid.scale_m) else { return Vec::new() };
    let [_, _, base_m] = grid.metres([0, 0, block.base()]);
    let corner = |p: &[i64; 3]| -> [i64; 3] {
        let [x, y, z] = grid.metres(*p);
        [x - east_m, y - north_m, z - base_m].map(|v| (v * PER_METRE).round() as i64)
    };
    let face = |face: GridFace| SolidFace {
        corners: face.rings.iter().flatten().flat_map(corner).collect(),
        rings: face.rings.iter().map(Vec::len).collect(),
        triangles: triangles::of_face(&face).into_iter().flatten().collect(),
    };
    let faces = roof_solid::faces(record, &block, grid, Detail::Slopes).into_iter().flatten();
    faces.filter(|face| face.surface != FaceKind::Ground).map(face).collect()
}

fn rings(footprint: &Polygon<f64>, origin: [f64; 3]) -> Vec<Vec<i64>> {
    let ring = |ring: &LineString<f64>| -> Vec<i64> {
        let mut corners: Vec<[i64; 2]> =
            ring.coords().map(|c| [c.x - origin[0], c.y - origin[1]].map(|v| (v * PER_METRE).round() as i64)).collect();
        corners.dedup();
        if corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        corners.into_iter().flatten().collect()
    };
    let rings = std::iter::once(footprint.exterior()).chain(footprint.interiors()).map(ring);
    rings.filter(|corners| corners.len() >= 6).collect()
}

/// Triangles of rings, counter-clockwise seen from above.
fn triangles_of(rings: &[Vec<i64>]) -> Vec<usize> {
    let corners = |ring: &Vec<i64>| ring.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    let rings: Vec<Vec<[i64; 2]>> = rings.iter().map(corners).collect();
    if rings.is_empty() { Vec::new() } else { triangles::of_rings(&rings).concat() }
}

impl GroundHeights {
    /// Around the footprints; `None` without any.
    pub fn around(records: &[BuildingRecord], terrain: &Terrain) -> Option<Self> {
        let [low, high] = extent(records)?;
        let side_m = (high[0] - low[0]).max(high[1] - low[1]);
        let margin_m = (MARGIN_SHARE * side_m).max(LEAST_MARGIN_M);
        let longest_m = side_m + 2.0 * margin_m;
        let step = match terrain {
            Terrain::Constant(_) => longest_m,
            Terrain::Grid(_) => (longest_m / GROUND_CELLS).max(LEAST_CELL_M),
        };
        let nodes = |axis: usize| ((high[axis] - low[axis] + 2.0 * margin_m) / step).ceil() as usize + 1;
        let (columns, rows) = (nodes(0), nodes(1));
        let (west, south) = (low[0] - margin_m, low[1] - margin_m);
        let node = |i: usize| {
            let (column, row) = (i % columns, i / columns);
            terrain.height_at(west + step * column as f64, south + step * row as f64).map(round_cm)
        };
        let z = (0..columns * rows).map(node).collect();
        Some(Self { west: round_cm(west), south: round_cm(south), step: round_cm(step), columns, z })
    }
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;

    #[test]
    fn a_courtyard_is_triangulated_around_its_hole() {
        let footprint = polygon!(
            exterior: [(x: 100.0, y: 200.0), (x: 110.0, y: 200.0), (x: 110.0, y: 210.0), (x: 100.0, y: 210.0)],
            interiors: [[(x: 103.0, y: 203.0), (x: 103.0, y: 207.0), (x: 107.0, y: 207.0), (x: 107.0, y: 203.0)]],
        );
        let rings = rings(&footprint, [100.0, 200.0, 0.0]);
        assert_eq!(rings[0], [0, 0, 1000, 0, 1000, 1000, 0, 1000]);
        let corners: Vec<i64> = rings.concat();
        let twice_area: i64 = triangles_of(&rings)
            .chunks_exact(3)
            .map(|t| {
                let [a, b, c] = [t[0], t[1], t[2]].map(|i| [corners[2 * i], corners[2 * i + 1]]);
                (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            })
            .inspect(|twice| assert!(*twice > 0, "clockwise"))
            .sum();
        assert_eq!(twice_area, 2 * (1000 * 1000 - 400 * 400));
    }

    #[test]
    fn a_level_ground_is_four_nodes_that_hold_every_footprint() {
        let footprint = polygon![(x: 0.0, y: 0.0), (x: 60.0, y: 0.0), (x: 60.0, y: 20.0), (x: 0.0, y: 20.0)];
        let unknown = BuildingRecord::without_height("a", crate::output::Status::Unknown);
        let record = BuildingRecord { footprint: Some(footprint), ..unknown };
        let ground = GroundHeights::around(&[record], &Terrain::Constant(7.0)).unwrap();
        assert_eq!((ground.columns, ground.z), (2, vec![Some(7.0); 4]));
        assert!(ground.west <= 0.0 && ground.south <= 0.0 && ground.west + ground.step >= 60.0);
    }
}
