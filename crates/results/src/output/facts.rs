//! What is known of a building's solid: its measures, and what validators find in it.
//!
//! ```text
//! walls  = Σ |A_f| over the walls f
//! volume = ⅓ Σ A_f · p_f over all faces f      divergence theorem
//! ```
//!
//! `A_f`: vector area of a face, outwards ([`triangles::area_m2`]); `p_f`: a corner of it. Of a block that is `l · t` and `A · t`, with area
//! `A` and length `l` of all rings of the footprint, and `t` from base to roof.

use glam::DVec3;

use super::grid::OutputGrid;
use super::prism::{FaceKind, GridFace, NoSolid, SnappedPrism};
use super::roof_solid::{self, Detail, RoofFacet, RoofSurface};
use super::{BuildingRecord, RoofForm, triangles, validate};

/// Sizes of a solid; metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    /// All walls from base to roof, courtyards' and those shared with neighbours too, m².
    pub walls_m2: f64,
    /// Volume that the faces enclose, m³.
    pub volume_m3: f64,
}

/// Facts of the solid of one building as it is written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SolidFacts {
    /// Why there is none, where there is none.
    pub no_solid_reason: Option<&'static str>,
    /// Sizes of the block, where there is a solid.
    pub measures: Option<Measures>,
    /// Sizes of the solid with its roof, where there is one; those of the block where the roof is flat or not known.
    pub roofed_measures: Option<Measures>,
    /// Faces of the solid with its roof; `None` where that is the block.
    pub roofed: Option<Vec<GridFace>>,
    /// Planes of the roof, the largest first; empty where its form is not known.
    pub roof: Vec<RoofFacet>,
    /// val3dity's numbers of the faults that [`validate`] finds in it; empty where it is valid.
    pub faults: Vec<u16>,
}

impl SolidFacts {
    /// The solid on a grid, and what is known of it.
    pub fn of(
        record: &BuildingRecord,
        grid: &OutputGrid,
        min_thickness_m: f64,
    ) -> (Result<SnappedPrism, NoSolid>, Self) {
        let prism = SnappedPrism::of(record, grid, min_thickness_m);
        let facts = match &prism {
            Ok(prism) => {
                let block = prism.faces();
                let roofed = roof_solid::faces(record, prism, grid, Detail::Slopes);
                Self {
                    no_solid_reason: None,
                    measures: Some(Measures::of(&block, grid)),
                    roofed_measures: Some(Measures::of(roofed.as_ref().unwrap_or(&block), grid)),
                    roofed,
                    roof: roof_solid::facets(record, prism, grid),
                    faults: validate::faults_of(&block, grid),
                }
            }
            Err(reason) => Self { no_solid_reason: Some(reason.code()), ..Self::default() },
        };
        (prism, facts)
    }

    /// Planes of the roof with the faces of the solid that they have; none where the roof's form is not known, or the solid is a
    /// block under a roof that is not flat.
    #[must_use]
    pub fn planes_of(&self, record: &BuildingRecord, faces: &[GridFace], grid: &OutputGrid) -> Vec<RoofSurface> {
        let is_flat = record.roof.is_some_and(|roof| roof.form == RoofForm::Flat);
        if self.roofed.is_some() || is_flat { roof_solid::surfaces(faces, grid) } else { Vec::new() }
    }

    /// Whether there is a solid in which nothing was found.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.measures.is_some() && self.faults.is_empty()
    }
}

impl Measures {
    fn of(faces: &[GridFace], grid: &OutputGrid) -> Self {
        let Some(origin) = faces.first().map(|face| face.rings[0][0]) else {
            return Self { walls_m2: 0.0, volume_m3: 0.0 };
        };
        let (mut walls_m2, mut volume_m3) = (0.0, 0.0);
        for face in faces {
            let area_m2 = triangles::area_m2(face, grid);
            let corner = face.rings[0][0];
            let from_origin = DVec3::from_array(std::array::from_fn(|axis| (corner[axis] - origin[axis]) as f64));
            volume_m3 += area_m2.dot(from_origin * grid.scale_m) / 3.0;
            if face.surface == FaceKind::Wall {
                walls_m2 += area_m2.length();
            }
        }
        Self { walls_m2, volume_m3 }
    }
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;
    use crate::output::RoofShape;
    use crate::output::record::tests::record;

    #[test]
    fn a_block_with_a_courtyard_has_the_walls_of_both_rings() {
        let footprint = polygon!(
            exterior: [(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.0, y: 9.0)],
            interiors: [[(x: 3.0, y: 3.0), (x: 3.0, y: 6.0), (x: 6.0, y: 6.0), (x: 6.0, y: 3.0)]],
        );
        let grid = OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] };
        let (prism, facts) = SolidFacts::of(&record("a", footprint, 1.0, 0.0, 4.0), &grid, 0.5);
        assert!(prism.is_ok() && facts.is_valid());
        let measures = facts.measures.unwrap();
        assert!((measures.walls_m2 - 48.0 * 5.0).abs() < 1e-9, "{measures:?}");
        assert!((measures.volume_m3 - 72.0 * 5.0).abs() < 1e-9, "{measures:?}");
    }

    #[test]
    fn a_gable_adds_its_ends_to_the_walls_and_its_wedge_to_the_volume() {
        // 12 x 8 m on a base at 0 m and ground at 0.3 m: eaves at 4.3 m, the ridge at 8.3 m along the longer side.
        let footprint = polygon![(x: 0.0, y: 0.0), (x: 12.0, y: 0.0), (x: 12.0, y: 8.0), (x: 0.0, y: 8.0)];
        let mut house = record("a", footprint, 0.3, 0.0, 5.0);
        house.roof = Some(RoofShape { ridge_azimuth_deg: Some(90.0), ..RoofShape::new(RoofForm::Gable, 4.0, 8.0) });
        let (_, facts) = SolidFacts::of(&house, &OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] }, 0.5);
        let (block, roofed) = (facts.measures.unwrap(), facts.roofed_measures.unwrap());
        assert!((block.walls_m2 - 40.0 * 5.3).abs() < 1e-9 && (block.volume_m3 - 96.0 * 5.3).abs() < 1e-9, "{block:?}");
        assert!((roofed.walls_m2 - (40.0 * 4.3 + 2.0 * 8.0 * 4.0 / 2.0)).abs() < 0.01, "{roofed:?}");
        assert!((roofed.volume_m3 - (96.0 * 4.3 + 12.0 * 8.0 * 4.0 / 2.0)).abs() < 0.1, "{roofed:?}");
        // Without its form it is the block.
        house.roof = None;
        let (_, facts) = SolidFacts::of(&house, &OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] }, 0.5);
        assert_eq!((facts.roofed_measures, facts.roofed), (facts.measures, None));
    }

    #[test]
    fn what_has_no_solid_says_why_and_is_not_valid() {
        let mut unknown = record("a", polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0)], 0.0, 0.0, 4.0);
        unknown.height_m = None;
        let (_, facts) = SolidFacts::of(&unknown, &OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] }, 0.5);
        assert_eq!((facts.no_solid_reason, facts.is_valid()), (Some("no_height"), false));
    }
}
