//! LOD1 solids: a footprint extruded between two levels, as faces on the output grid.
//!
//! The solid is a closed 2-manifold whose faces are counter-clockwise seen from outside, and its volume is the
//! footprint's area times `roof − base`: the footprint is valid by construction ([`super::footprint`]), all ground vertices
//! share one level and all roof vertices another, so every face is exactly planar.

use serde::{Deserialize, Serialize};

use super::BuildingRecord;
use super::footprint::{FootprintFault, SnappedFootprint};
use super::grid::OutputGrid;

/// Smallest distance between base and roof of a solid, metres; a lower building has no geometry.
pub const MIN_THICKNESS_M: f64 = 0.5;

/// Kind of a face of the solid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum FaceKind {
    /// Bottom face, seen from below.
    Ground,
    /// The top face of a block.
    Roof,
    /// Vertical face; courtyard walls face the courtyard.
    Wall,
}

/// A planar face: exterior ring, then holes; rings on the grid, not closed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GridFace {
    /// Whether the face is roof, wall or ground.
    pub surface: FaceKind,
    /// Plane of the roof that it is a part of: roof faces of one plane have the same number. 0 for all other faces.
    #[serde(default)]
    pub plane: usize,
    /// Exterior counter-clockwise seen from outside the solid, holes clockwise.
    pub rings: Vec<Vec<[i64; 3]>>,
}

impl GridFace {
    /// Returns a face that is no part of a roof of several planes.
    #[must_use]
    pub fn new(surface: FaceKind, rings: Vec<Vec<[i64; 3]>>) -> Self {
        Self { surface, plane: 0, rings }
    }
}

/// Why a building has no solid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoSolid {
    /// There is no footprint to extrude.
    #[error("it has no usable footprint")]
    NoFootprint,
    /// There is no level to extrude to.
    #[error("its height is not known")]
    NoHeight,
    /// Roof and base nearly coincide.
    #[error("its roof is less than the smallest thickness above its base")]
    TooLow,
    /// The footprint does not survive on the output grid.
    #[error(transparent)]
    Footprint(#[from] FootprintFault),
}

impl NoSolid {
    /// Stable name in files.
    #[must_use]
    pub fn code(self) -> &'static str {
        match self {
            Self::NoFootprint => "no_footprint",
            Self::NoHeight => "no_height",
            Self::TooLow => "too_low_for_a_solid",
            Self::Footprint(FootprintFault::Collapsed) => "footprint_collapsed_on_grid",
            Self::Footprint(FootprintFault::Invalid) => "footprint_invalid_on_grid",
        }
    }
}

/// An extruded footprint on the output grid. Its serialised form is for files that the same run reads back.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SnappedPrism {
    footprint: SnappedFootprint,
    base: i64,
    roof: i64,
}

impl SnappedPrism {
    /// The solid of a building between its lowest ground and its roof.
    ///
    /// # Errors
    /// [`NoSolid`], for a building that stays without geometry.
    pub fn of(record: &BuildingRecord, grid: &OutputGrid, min_thickness_m: f64) -> Result<Self, NoSolid> {
        let footprint = record.footprint.as_ref().ok_or(NoSolid::NoFootprint)?;
        let roof_z_m = record.roof_z_m().ok_or(NoSolid::NoHeight)?;
        let base_z_m = record.base_z_m.or(record.ground_z_m).ok_or(NoSolid::NoHeight)?;
        let (base, roof) = (grid.level(base_z_m), grid.level(roof_z_m));
        let min_thickness = (min_thickness_m / grid.scale_m).round().max(1.0) as i64;
        if roof - base < min_thickness {
            return Err(NoSolid::TooLow);
        }
        Ok(Self { footprint: SnappedFootprint::new(footprint, grid)?, base, roof })
    }

    /// The footprint on the grid.
    #[must_use]
    pub fn footprint(&self) -> &SnappedFootprint {
        &self.footprint
    }

    /// Level of the ground face, grid index.
    #[must_use]
    pub fn base(&self) -> i64 {
        self.base
    }

    /// Level of the roof face, grid index.
    #[must_use]
    pub fn roof(&self) -> i64 {
        self.roof
    }

    /// Ground, roof, then one wall per edge of the footprint, ring by ring.
    #[must_use]
    pub fn faces(&self) -> Vec<GridFace> {
        let rings = self.footprint.rings();
        let at = |[x, y]: [i64; 2], z: i64| [x, y, z];
        let ground = rings.iter().map(|ring| ring.iter().rev().map(|&p| at(p, self.base)).collect()).collect();
        let roof = rings.iter().map(|ring| ring.iter().map(|&p| at(p, self.roof)).collect()).collect();
        let walls = rings.iter().flat_map(|ring| {
            ring.iter().enumerate().map(move |(i, &from)| {
                let to = ring[(i + 1) % ring.len()];
                let corners = vec![at(from, self.base), at(to, self.base), at(to, self.roof), at(from, self.roof)];
                GridFace::new(FaceKind::Wall, vec![corners])
            })
        });
        [GridFace::new(FaceKind::Ground, ground), GridFace::new(FaceKind::Roof, roof)]
            .into_iter()
            .chain(walls)
            .collect()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::HashMap;

    use geo::{Area, Rotate, polygon};
    use geo_types::{Coord, LineString, Polygon};
    use proptest::prelude::*;

    use super::*;
    use crate::output::record::tests::record;

    /// Six times the volume, by the divergence theorem over fans of the faces; exact.
    pub(in crate::output) fn six_volumes(faces: &[GridFace]) -> i128 {
        let determinant = |a: [i64; 3], b: [i64; 3], c: [i64; 3]| {
            let [a, b, c] = [a, b, c].map(|p| p.map(i128::from));
            a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        };
        let rings = faces.iter().flat_map(|face| &face.rings);
        rings.map(|r| r.windows(2).map(|edge| determinant(r[0], edge[0], edge[1])).sum::<i128>()).sum()
    }

    /// Every directed edge once, and its opposite once: closed, 2-manifold along edges, consistently oriented.
    pub(in crate::output) fn is_closed_manifold(faces: &[GridFace]) -> bool {
        let mut edges: HashMap<([i64; 3], [i64; 3]), u32> = HashMap::new();
        for ring in faces.iter().flat_map(|face| &face.rings) {
            for (i, &from) in ring.iter().enumerate() {
                *edges.entry((from, ring[(i + 1) % ring.len()])).or_default() += 1;
            }
        }
        edges.iter().all(|(&(a, b), &n)| n == 1 && a != b && edges.get(&(b, a)) == Some(&1))
    }

    /// A star-shaped footprint around (0, 0) between radius 5 and 20 m, with up to two star-shaped courtyards, each in
    /// its own half, anywhere in the map.
    fn footprints() -> impl Strategy<Value = Polygon<f64>> {
        let star = |min_m: f64, max_m: f64| {
            prop::collection::vec((min_m..max_m, 0.0..0.9_f64), 3..24).prop_map(|spokes| {
                let step = std::f64::consts::TAU / spokes.len() as f64;
                let at = |(i, &(r, shift)): (usize, &(f64, f64))| {
                    let angle = (i as f64 + shift) * step;
                    Coord { x: r * angle.cos(), y: r * angle.sin() }
                };
                spokes.iter().enumerate().map(at).collect::<LineString<f64>>()
            })
        };
        let courtyards = prop::collection::vec(star(0.2, 1.0), 0..=2);
        (star(8.0, 20.0), courtyards, -1e5..1e6_f64, -1e5..7e6_f64, 0.0..360.0_f64).prop_filter_map(
            "spokes too far apart leave the middle outside",
            |(exterior, courtyards, east, north, turn_deg)| {
                let shift =
                    |ring: LineString<f64>, by: f64| ring.coords().map(|p| Coord { x: p.x + by, y: p.y }).collect();
                let holes = courtyards.into_iter().zip([-1.2, 1.2]).map(|(ring, by)| shift(ring, by)).collect();
                let polygon =
                    Polygon::new(exterior, holes).rotate_around_point(turn_deg, geo_types::Point::new(0.0, 0.0));
                let is_usable = geo::Validation::is_valid(&polygon) && polygon.unsigned_area() > 1.0;
                let place = |ring: &LineString<f64>| {
                    ring.coords().map(|p| Coord { x: p.x + east, y: p.y + north }).collect::<LineString<f64>>()
                };
                is_usable
                    .then(|| Polygon::new(place(polygon.exterior()), polygon.interiors().iter().map(place).collect()))
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn any_valid_footprint_becomes_a_closed_outward_solid_of_area_times_height(
            footprint in footprints(),
            ground in -50.0..3000.0_f64,
            below in 0.0..5.0_f64,
            height in 0.5..300.0_f64,
        ) {
            let area_m2 = footprint.unsigned_area();
            let building = record("a", footprint, ground, ground - below, height);
            let (grid, _) = OutputGrid::over(std::slice::from_ref(&building), 0.001).unwrap();
            let prism = SnappedPrism::of(&building, &grid, 0.1).unwrap();
            let faces = prism.faces();
            prop_assert!(is_closed_manifold(&faces));
            // Exact on the grid, and outward because positive.
            let thickness = i128::from(prism.roof() - prism.base());
            prop_assert_eq!(six_volumes(&faces), (prism.footprint().area() * 2.0) as i128 * 3 * thickness);
            prop_assert!(prism.footprint().area() > 0.0);
            // And the same building as before snapping: half a quantum along a footprint of at most 1 km.
            let volume_m3 = six_volumes(&faces) as f64 / 6.0 * 1e-9;
            let expected_m3 = area_m2 * (height + below);
            prop_assert!((volume_m3 - expected_m3).abs() < 1.0 * (height + below) + 0.001 * area_m2, "{volume_m3} {expected_m3}");
        }
    }

    #[test]
    fn courtyard_walls_face_the_courtyard() {
        let footprint = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.0, y: 9.0)],
            interiors: [[(x: 3.0, y: 3.0), (x: 3.0, y: 6.0), (x: 6.0, y: 6.0), (x: 6.0, y: 3.0)]],
        );
        let building = record("a", footprint, 0.0, 0.0, 3.0);
        let (grid, _) = OutputGrid::over(std::slice::from_ref(&building), 1.0).unwrap();
        let faces = SnappedPrism::of(&building, &grid, 0.5).unwrap().faces();
        assert_eq!(faces.len(), 2 + 8);
        assert_eq!(six_volumes(&faces), 6 * (81 - 9) * 3);
        assert!(is_closed_manifold(&faces));
    }

    #[test]
    fn what_cannot_be_a_solid_says_why() {
        let footprint = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0)];
        let grid = OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] };
        let low = record("a", footprint.clone(), 5.0, 5.0, 0.2);
        assert_eq!(SnappedPrism::of(&low, &grid, 0.5), Err(NoSolid::TooLow));
        let mut unknown = record("b", footprint, 5.0, 5.0, 4.0);
        unknown.height_m = None;
        assert_eq!(SnappedPrism::of(&unknown, &grid, 0.5), Err(NoSolid::NoHeight));
        unknown.footprint = None;
        assert_eq!(SnappedPrism::of(&unknown, &grid, 0.5), Err(NoSolid::NoFootprint));
    }
}
