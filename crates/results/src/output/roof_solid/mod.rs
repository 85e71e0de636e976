//! Solids whose roofs have the levels (LOD 1.3) or the whole form that was found (LOD 2.0: gables, hips, levels), as faces on the
//! output grid.
//!
//! ```text
//! planes   of the roof over the footprint ([`sizeup_heights::optimise::RoofPlanes`])
//! patches  parts of the footprint under one plane each; together they cover it, none twice ([`patches`])
//! nodes    corners of patches and of the footprint; every edge ends at the nodes that lie on it ([`plan`])
//! levels   of a plane at a node; those of several planes that nearly meet there are one
//! walls    from base to roof along the footprint; upright between patches where one is higher than the other ([`walls`])
//! exact    faces that the grid has bent are divided into triangles ([`exact`])
//! ```
//!
//! A solid is given only where it is closed and nothing is found in it by [`super::validate`]; other buildings stay blocks
//! ([`super::prism`]).

mod exact;
mod facets;
mod patches;
mod plan;
mod walls;

use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use glam::{DVec2, DVec3};

use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::optimise::{Roof, RoofPlanes, Terrace};
use sizeup_heights::scene::{Prism as ScenePrism, RoofForm};
use sizeup_heights::terrain::GroundLevel;

use super::footprint::{Ring, SnappedFootprint};
use super::grid::OutputGrid;
use super::prism::{FaceKind, GridFace, SnappedPrism};
use super::{BuildingRecord, RoofShape, validate};
pub use facets::{RoofFacet, RoofSurface, facets, surfaces};
use plan::{NodeLevels, RoofPlan};

/// Least height of a wall, metres.
const LEAST_WALL_M: f64 = 0.2;

/// How much of a roof its solid has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// Levels of the roof, each of them flat: LOD 1.3.
    Levels,
    /// Slopes too: LOD 2.0.
    Slopes,
}

/// A position on the grid.
type Point = [i64; 2];

/// Faces of the solid of a building with its roof, ground first, then roof, then walls; `None` where the block shows as much: its roof
/// is flat, at one level where levels are asked for, or not known, or makes no valid solid with its footprint.
#[must_use]
pub fn faces(
    record: &BuildingRecord,
    block: &SnappedPrism,
    grid: &OutputGrid,
    detail: Detail,
) -> Option<Vec<GridFace>> {
    let (shape, ground_z_m) = (record.roof?, record.ground_z_m?);
    let has_solid = match detail {
        Detail::Levels => shape.form == RoofForm::Stepped,
        Detail::Slopes => shape.form != RoofForm::Flat,
    };
    if !has_solid {
        return None;
    }
    let footprint = block.footprint();
    let PlannedRoof { frame, planes, patches } = PlannedRoof::of(shape, block, grid)?;
    let plan = RoofPlan::of(footprint, &patches, &frame)?;
    let levels = NodeLevels::of(&plan, &planes.planes, ground_z_m, &frame);
    let least = block.base() + (LEAST_WALL_M / grid.scale_m) as i64;
    if levels.lowest()? < least {
        return None;
    }
    let floor = footprint.rings().iter().map(|ring| ring.iter().rev().map(|[x, y]| [*x, *y, block.base()]).collect());
    let mut faces = vec![GridFace::new(FaceKind::Ground, floor.collect())];
    faces.extend(plan.patches.iter().map(|patch| {
        let ring = |ring: &Ring| ring.iter().map(|node| levels.at(*node, patch.plane)).collect();
        GridFace { surface: FaceKind::Roof, plane: patch.plane, rings: patch.rings.iter().map(ring).collect() }
    }));
    faces.extend(walls::outer(&plan, &levels, block.base()));
    faces.extend(walls::inner(&plan, &levels)?);
    let is_valid = |faces: &Vec<GridFace>| validate::faults_of(faces, grid).is_empty();
    exact::split_bent(&faces).filter(is_valid).or_else(|| is_valid(&faces).then_some(faces))
}

/// A roof as planes, and the part of the footprint under each.
struct PlannedRoof<'a> {
    frame: BuildingFrame<'a>,
    planes: RoofPlanes,
    patches: Vec<MultiPolygon<f64>>,
}

impl<'a> PlannedRoof<'a> {
    /// `None` where the form does not fit the footprint.
    fn of(shape: RoofShape, block: &SnappedPrism, grid: &'a OutputGrid) -> Option<Self> {
        let frame = BuildingFrame { grid, origin: block.footprint().rings()[0][0] };
        let polygon = frame.polygon(block.footprint());
        let ground = GroundLevel::flat(0.0);
        let scene = ScenePrism::new(&polygon, ground, LocalOrigin(DVec3::ZERO));
        let planes = RoofPlanes::of(&roof(shape, frame.corner_m()), &scene)?;
        let patches = patches::of(&polygon, &planes)?;
        Some(Self { frame, planes, patches })
    }
}

/// The roof in a frame that begins at a place of the map, metres.
fn roof(shape: RoofShape, [east_m, north_m]: [f64; 2]) -> Roof {
    let RoofShape { form, eave_height_m: eave_m, ridge_height_m: ridge_m, ridge_azimuth_deg, step, .. } = shape;
    let along = |azimuth_deg: f64| {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        [sin, cos]
    };
    let moved = |step: Terrace| Terrace { corners: step.corners.map(|[x, y]| [x - east_m, y - north_m]), ..step };
    let mean_m = f64::midpoint(eave_m, ridge_m);
    Roof { form, eave_m, ridge_m, mean_m, terrace: step.map(moved), ridge_along: ridge_azimuth_deg.map(along) }
}

/// A building's own frame: metres from a corner of its footprint.
struct BuildingFrame<'a> {
    grid: &'a OutputGrid,
    origin: Point,
}

impl BuildingFrame<'_> {
    /// Origin of it in the map, metres.
    fn corner_m(&self) -> [f64; 2] {
        let [x, y, _] = self.grid.metres([self.origin[0], self.origin[1], 0]);
        [x, y]
    }

    fn metres(&self, point: Point) -> DVec2 {
        let of = |axis: usize| (point[axis] - self.origin[axis]) as f64 * self.grid.scale_m;
        DVec2::new(of(0), of(1))
    }

    fn point(&self, at: DVec2) -> Point {
        let of = |axis: usize| (at[axis] / self.grid.scale_m).round() as i64 + self.origin[axis];
        [of(0), of(1)]
    }

    fn polygon(&self, footprint: &SnappedFootprint) -> Polygon<f64> {
        let ring = |ring: &Ring| -> LineString<f64> {
            let closed = ring.iter().chain(ring.first());
            closed.map(|p| self.metres(*p)).map(|p| Coord { x: p.x, y: p.y }).collect()
        };
        let mut rings = footprint.rings().iter().map(ring);
        let exterior = rings.next().unwrap_or_else(|| LineString::new(Vec::new()));
        Polygon::new(exterior, rings.collect())
    }
}

#[cfg(test)]
mod tests {
    use geo::{Area as _, Contains as _, Rotate as _};
    use geo_types::{Point, polygon};
    use proptest::prelude::*;

    use super::super::prism::tests::{is_closed_manifold, six_volumes};
    use super::super::record::tests::record;
    use super::*;

    const MAP_M: [f64; 2] = [389_412.0, 5_819_874.0];
    const GROUND_M: f64 = 34.2;
    const BASE_M: f64 = 33.9;

    fn in_map(footprint: &Polygon<f64>, turn_deg: f64) -> Polygon<f64> {
        use geo::MapCoords as _;
        let turned = footprint.rotate_around_point(turn_deg, Point::new(0.0, 0.0));
        turned.map_coords(|c| Coord { x: c.x + MAP_M[0], y: c.y + MAP_M[1] })
    }

    /// A roof's volume above the base by a second way: its planes looked at on a lattice, as if it were rain that falls on it.
    fn rained_m3(record: &BuildingRecord, step_m: f64) -> f64 {
        let footprint = record.footprint.as_ref().unwrap();
        let (min, max) = {
            use geo::BoundingRect as _;
            let around = footprint.bounding_rect().unwrap();
            (around.min(), around.max())
        };
        let scene = {
            use geo::MapCoords as _;
            let local = footprint.map_coords(|c| Coord { x: c.x - min.x, y: c.y - min.y });
            let ground = GroundLevel::flat(0.0);
            ScenePrism::new(&local, ground, LocalOrigin(DVec3::ZERO))
        };
        let planes = RoofPlanes::of(&roof(record.roof.unwrap(), [min.x, min.y]), &scene).unwrap();
        let mut volume_m3 = 0.0;
        let (n_x, n_y) = (((max.x - min.x) / step_m) as usize, ((max.y - min.y) / step_m) as usize);
        for (i, j) in (0..=n_y).flat_map(|j| (0..=n_x).map(move |i| (i, j))) {
            let at = DVec2::new((i as f64 + 0.5) * step_m, (j as f64 + 0.5) * step_m);
            if footprint.contains(&Point::new(at.x + min.x, at.y + min.y)) {
                let height_m = planes.height_m(at).unwrap_or(record.roof.unwrap().eave_height_m);
                volume_m3 += (GROUND_M + height_m - BASE_M) * step_m * step_m;
            }
        }
        volume_m3
    }

    fn solid(record: &BuildingRecord) -> Option<(Vec<GridFace>, f64)> {
        solid_of(record, Detail::Slopes)
    }

    fn solid_of(record: &BuildingRecord, detail: Detail) -> Option<(Vec<GridFace>, f64)> {
        let (grid, _) = OutputGrid::over(std::slice::from_ref(record), 0.001).unwrap();
        let block = SnappedPrism::of(record, &grid, 0.1).unwrap();
        let faces = faces(record, &block, &grid, detail)?;
        assert!(is_closed_manifold(&faces), "{faces:?}");
        let volume_m3 = six_volumes(&faces) as f64 / 6.0 * 1e-9;
        Some((faces, volume_m3))
    }

    fn house(footprint: &Polygon<f64>, turn_deg: f64, shape: RoofShape) -> BuildingRecord {
        let mean_m = f64::midpoint(shape.eave_height_m, shape.ridge_height_m);
        let mut house = record("a", in_map(footprint, turn_deg), GROUND_M, BASE_M, mean_m);
        house.roof = Some(shape);
        house
    }

    /// A direction as an azimuth, of an angle from the east, counter-clockwise.
    fn azimuth_deg(turn_deg: f64) -> f64 {
        (90.0 - turn_deg).rem_euclid(180.0)
    }

    fn rectangle() -> Polygon<f64> {
        polygon![(x: 0.0, y: 0.0), (x: 12.0, y: 0.0), (x: 12.0, y: 8.0), (x: 0.0, y: 8.0)]
    }

    fn n_roofs(faces: &[GridFace]) -> usize {
        faces.iter().filter(|face| face.surface == FaceKind::Roof).count()
    }

    #[test]
    fn a_gable_has_two_slopes_and_gable_ends_of_five_corners() {
        let shape =
            RoofShape { ridge_azimuth_deg: Some(azimuth_deg(0.0)), ..RoofShape::new(RoofForm::Gable, 4.0, 8.0) };
        let (faces, volume_m3) = solid(&house(&rectangle(), 0.0, shape)).unwrap();
        assert_eq!((n_roofs(&faces), faces.len()), (2, 7));
        let mut corners: Vec<usize> =
            faces.iter().filter(|f| f.surface == FaceKind::Wall).map(|f| f.rings[0].len()).collect();
        corners.sort_unstable();
        assert_eq!(corners, [4, 4, 5, 5]);
        // 96 m2, 6 m high in the mean above ground, which is 0.3 m above the base.
        assert!((volume_m3 - 96.0 * 6.3).abs() < 0.1, "{volume_m3}");
        let across = RoofShape { ridge_azimuth_deg: Some(azimuth_deg(90.0)), ..shape };
        let (_, volume_m3) = solid(&house(&rectangle(), 0.0, across)).unwrap();
        assert!((volume_m3 - 96.0 * 6.3).abs() < 0.1, "{volume_m3}");
    }

    #[test]
    fn planes_of_a_roof_have_area_slope_and_aspect() {
        // 12 x 8 m turned by 20 degrees, the ridge along the longer side, 4 m above the eaves.
        let shape =
            RoofShape { ridge_azimuth_deg: Some(azimuth_deg(20.0)), ..RoofShape::new(RoofForm::Gable, 4.0, 8.0) };
        let record = house(&rectangle(), 20.0, shape);
        let (grid, _) = OutputGrid::over(std::slice::from_ref(&record), 0.001).unwrap();
        let block = SnappedPrism::of(&record, &grid, 0.1).unwrap();
        let found = facets(&record, &block, &grid);
        assert_eq!(found.len(), 2);
        for facet in &found {
            assert!((facet.area_m2 - 48.0 * 2.0_f64.sqrt()).abs() < 0.05, "{facet:?}");
            assert!((facet.slope_deg - 45.0).abs() < 0.05, "{facet:?}");
        }
        // Upright to the ridge, which runs from 70 to 250 degrees.
        let mut aspects: Vec<f64> = found.iter().filter_map(|facet| facet.aspect_deg).collect();
        aspects.sort_by(f64::total_cmp);
        assert!((aspects[0] - 160.0).abs() < 0.1 && (aspects[1] - 340.0).abs() < 0.1, "{aspects:?}");
        let flat = RoofShape::new(RoofForm::Flat, 4.0, 4.0);
        let found = facets(&house(&rectangle(), 20.0, flat), &block, &grid);
        assert_eq!(found.len(), 1);
        assert!((found[0].area_m2 - 96.0).abs() < 1e-6 && found[0].aspect_deg.is_none(), "{found:?}");
    }

    #[test]
    fn faces_of_one_plane_are_one_surface_with_its_area_slope_and_aspect() {
        // Slopes of 45 degrees over 96 m2; the grid has bent two of them, which are two triangles each.
        let record = house(&rectangle(), 20.0, RoofShape::new(RoofForm::Hip, 4.0, 8.0));
        let (grid, _) = OutputGrid::over(std::slice::from_ref(&record), 0.001).unwrap();
        let block = SnappedPrism::of(&record, &grid, 0.1).unwrap();
        let faces = faces(&record, &block, &grid, Detail::Slopes).unwrap();
        let found = surfaces(&faces, &grid);
        assert_eq!((found.len(), n_roofs(&faces)), (4, 6));
        let members: std::collections::BTreeSet<usize> = found.iter().flat_map(|s| s.faces.iter().copied()).collect();
        assert!(members.len() == 6 && members.iter().all(|i| faces[*i].surface == FaceKind::Roof), "{members:?}");
        let area_m2: f64 = found.iter().map(|surface| surface.facet.area_m2).sum();
        assert!((area_m2 - 96.0 * 2.0_f64.sqrt()).abs() < 0.5, "{area_m2}");
        // Turned by 20 degrees: they look to 70, 160, 250 and 340 degrees.
        let mut aspects: Vec<f64> = found.iter().filter_map(|surface| surface.facet.aspect_deg).collect();
        aspects.sort_by(f64::total_cmp);
        for (aspect, expected) in aspects.iter().zip([70.0, 160.0, 250.0, 340.0]) {
            assert!((aspect - expected).abs() < 0.5, "{aspects:?}");
        }
        assert!(found.iter().all(|surface| (surface.facet.slope_deg - 45.0).abs() < 1.0), "{found:?}");
    }

    #[test]
    fn a_hip_has_a_slope_to_every_wall() {
        let shape = RoofShape::new(RoofForm::Hip, 4.0, 8.0);
        let (faces, volume_m3) = solid(&house(&rectangle(), 20.0, shape)).unwrap();
        // Two slopes of three corners, and two of four that the grid has bent: two triangles each.
        assert_eq!((n_roofs(&faces), faces.len()), (6, 11));
        // Over a rectangle a · b, b the lesser: rise · b (3 a − b) / 6. The farthest place is known to some centimetres.
        let above_eave_m3 = 4.0 * 8.0 * (3.0 * 12.0 - 8.0) / 6.0;
        assert!((volume_m3 - 96.0 * 4.3 - above_eave_m3).abs() < 0.02 * above_eave_m3, "{volume_m3}");
        let winged = polygon![
            (x: 0.0, y: -5.0), (x: 6.0, y: -5.0), (x: 6.0, y: 0.0), (x: 12.0, y: 0.0), (x: 12.0, y: 8.0), (x: 0.0, y: 8.0),
        ];
        assert!(solid(&house(&winged, 0.0, shape)).is_none(), "a hip with a valley stays a block");
    }

    #[test]
    fn a_house_with_a_courtyard_and_a_gable_has_walls_to_it() {
        let mut footprint = rectangle();
        let yard = [(3.0, 2.0), (3.0, 6.0), (6.0, 6.0), (6.0, 2.0), (3.0, 2.0)];
        footprint.interiors_push(yard.iter().map(|&(x, y)| Coord { x, y }).collect::<LineString<f64>>());
        let shape =
            RoofShape { ridge_azimuth_deg: Some(azimuth_deg(30.0)), ..RoofShape::new(RoofForm::Gable, 4.0, 8.0) };
        let house = house(&footprint, 30.0, shape);
        let (_, volume_m3) = solid(&house).unwrap();
        let expected_m3 = rained_m3(&house, 0.02);
        assert!((volume_m3 / expected_m3 - 1.0).abs() < 0.01, "{volume_m3} {expected_m3}");
    }

    #[test]
    fn flat_roofs_and_those_without_their_plan_stay_blocks() {
        for form in [RoofForm::Flat, RoofForm::Gable, RoofForm::Stepped] {
            assert!(solid(&house(&rectangle(), 0.0, RoofShape::new(form, 4.0, 8.0))).is_none(), "{form:?}");
        }
    }

    #[test]
    fn levels_are_flat() {
        // An annex of 4 x 8 m, 3 m high, beside a house of 8 x 8 m.
        let corners = [[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]].map(|[x, y]| [x + MAP_M[0], y + MAP_M[1]]);
        let step = Some(Terrace { corners, is_upper: true });
        let stepped = house(&rectangle(), 0.0, RoofShape { step, ..RoofShape::new(RoofForm::Stepped, 3.0, 9.0) });
        let (faces, volume_m3) = solid_of(&stepped, Detail::Levels).unwrap();
        let levels: Vec<std::collections::BTreeSet<i64>> = (faces.iter().filter(|f| f.surface == FaceKind::Roof))
            .map(|face| face.rings.iter().flatten().map(|corner| corner[2]).collect())
            .collect();
        assert!(levels.len() == 2 && levels.iter().all(|levels| levels.len() == 1), "{levels:?}");
        let expected_m3 = 64.0 * 9.3 + 32.0 * 3.3;
        assert!((volume_m3 - expected_m3).abs() < 0.1, "{volume_m3} {expected_m3}");
        let gable = RoofShape { ridge_azimuth_deg: Some(0.0), ..RoofShape::new(RoofForm::Gable, 4.0, 8.0) };
        assert!(solid_of(&house(&rectangle(), 0.0, gable), Detail::Levels).is_none(), "one level is a block");
    }

    /// Houses as layers have them: rectangles, L and T with corners a little off, turned any way, some with many more
    /// corners on their walls; and whether one is a rectangle with no more corners than that.
    fn footprints() -> impl Strategy<Value = (Polygon<f64>, bool)> {
        let off = prop::collection::vec(-0.25..0.25_f64, 20);
        (0..4_usize, 6.0..30.0_f64, 5.0..18.0_f64, 0.2..0.8_f64, off, any::<bool>()).prop_map(
            |(kind, width, depth, share, off, is_exact)| {
                let (x, y) = (share * width, -0.6 * depth);
                let corners: Vec<(f64, f64)> = match kind {
                    0 => vec![(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)],
                    1 => vec![(0.0, y), (x, y), (x, 0.0), (width, 0.0), (width, depth), (0.0, depth)],
                    2 => {
                        let (from, to) = (0.2 * width, 0.7 * width);
                        vec![
                            (0.0, 0.0),
                            (from, 0.0),
                            (from, y),
                            (to, y),
                            (to, 0.0),
                            (width, 0.0),
                            (width, depth),
                            (0.0, depth),
                        ]
                    }
                    _ => vec![(0.0, 0.0), (x, -0.02), (width, 0.0), (width, 0.5 * depth), (width, depth), (0.0, depth)],
                };
                let moved = corners.iter().enumerate().map(|(i, (x, y))| {
                    let by = if is_exact { [0.0; 2] } else { [off[2 * i], off[2 * i + 1]] };
                    Coord { x: x + by[0], y: y + by[1] }
                });
                (Polygon::new(moved.collect::<LineString<f64>>(), Vec::new()), kind == 0)
            },
        )
    }

    /// A house with its roof, and whether its footprint is one rectangle but for a few centimetres.
    fn houses() -> impl Strategy<Value = (BuildingRecord, bool)> {
        let numbers = (0.0..180.0_f64, 2.5..12.0_f64, 0.8..6.0_f64, 0.1..0.9_f64, 0.1..0.9_f64);
        (footprints(), 0..3_usize, numbers, any::<bool>(), any::<bool>()).prop_map(
            |((footprint, is_rectangle), form, (turn_deg, eave_m, rise_m, across, along), is_along_first, is_upper)| {
                let (sin, cos) = turn_deg.to_radians().sin_cos();
                let at = |x: f64, y: f64| [cos * x - sin * y + MAP_M[0], sin * x + cos * y + MAP_M[1]];
                let (x, y) = (12.0 * across, 9.0 * along);
                let corners = [at(-1.0, -12.0), at(x, -12.0), at(x, y), at(-1.0, y)];
                let step = (form == 2).then_some(Terrace { corners, is_upper });
                let roof_form = [RoofForm::Gable, RoofForm::Hip, RoofForm::Stepped][form];
                let shape = RoofShape {
                    ridge_azimuth_deg: Some(azimuth_deg(if is_along_first { turn_deg } else { turn_deg + 90.0 })),
                    step,
                    ..RoofShape::new(roof_form, eave_m, eave_m + rise_m + 0.4)
                };
                (house(&footprint, turn_deg, shape), is_rectangle)
            },
        )
    }

    /// Corners of a solid that stand outside its footprint, exactly.
    fn n_outside(record: &BuildingRecord, faces: &[GridFace]) -> usize {
        use geo::coordinate_position::{CoordPos, CoordinatePosition as _};
        let (grid, _) = OutputGrid::over(std::slice::from_ref(record), 0.001).unwrap();
        let block = SnappedPrism::of(record, &grid, 0.1).unwrap();
        let [x_0, y_0] = block.footprint().rings()[0][0];
        let at = |x: i64, y: i64| Coord { x: (x - x_0) as f64, y: (y - y_0) as f64 };
        let mut rings = block.footprint().rings().iter().map(|ring| ring.iter().map(|[x, y]| at(*x, *y)).collect());
        let footprint = Polygon::new(rings.next().unwrap(), rings.collect::<Vec<LineString<f64>>>());
        let corners = faces.iter().flat_map(|face| face.rings.iter().flatten());
        corners.filter(|[x, y, _]| footprint.coordinate_position(&at(*x, *y)) == CoordPos::Outside).count()
    }

    #[test]
    fn no_corner_of_a_roof_stands_outside_the_footprint_where_a_neighbour_may_be() {
        use proptest::strategy::ValueTree as _;
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let mut n = 0;
        for _ in 0..400 {
            let (house, _) = houses().new_tree(&mut runner).unwrap().current();
            if let Some((faces, _)) =
                geo::Validation::is_valid(house.footprint.as_ref().unwrap()).then(|| solid(&house)).flatten()
            {
                n += 1;
                assert_eq!(n_outside(&house, &faces), 0, "{house:?}");
            }
        }
        assert!(n > 200, "{n} solids");
    }

    #[test]
    fn houses_are_closed_solids_of_their_roofs_volume() {
        use proptest::strategy::ValueTree as _;
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let (mut n, mut n_blocks) = (0, 0);
        for _ in 0..400 {
            let (house, is_rectangle) = houses().new_tree(&mut runner).unwrap().current();
            let footprint = house.footprint.as_ref().unwrap();
            let form = house.roof.unwrap().form;
            let has_valleys = form == RoofForm::Hip && !is_rectangle;
            if !geo::Validation::is_valid(footprint) || has_valleys {
                continue;
            }
            n += 1;
            let Some((faces, volume_m3)) = solid(&house) else {
                assert!(!is_rectangle, "no solid: {house:?}");
                n_blocks += 1;
                continue;
            };
            assert!(n_roofs(&faces) >= 1);
            // Along the walls, a place of the lattice is in or out.
            let (expected_m3, area_m2) = (rained_m3(&house, 0.1), footprint.unsigned_area());
            assert!(
                (volume_m3 - expected_m3).abs() < 0.02 * expected_m3 + 0.1 * area_m2,
                "{volume_m3} {expected_m3} {house:?}"
            );
        }
        // Wings of odd sizes may leave slivers, which no solid is made of.
        assert!(n > 250 && 20 * n_blocks <= n, "{n_blocks} of {n} stay blocks");
    }
}
