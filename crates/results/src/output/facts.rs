//! What is known of a building's solid: its measures, and what validators find in it.
//!
//! ```text
//! walls = l · t,    volume = A · t,    roof = floor = A
//! ```
//!
//! `A`, `l`: area and length of all rings of the footprint on the output grid; `t`: roof − base.

use super::BuildingRecord;
use super::grid::OutputGrid;
use super::prism::{NoSolid, SnappedPrism};
use super::roof_solid::{self, RoofFacet};
use super::validate;

/// Sizes of a block; metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    /// All walls from base to roof, courtyards' and those shared with neighbours too, m².
    pub walls_m2: f64,
    /// Volume of the block, m³.
    pub volume_m3: f64,
}

/// Facts of the solid of one building as it is written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SolidFacts {
    /// Why there is none, where there is none.
    pub no_solid_reason: Option<&'static str>,
    /// Facts of the solid, where there is one.
    pub measures: Option<Measures>,
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
            Ok(prism) => Self {
                no_solid_reason: None,
                measures: Some(Measures::of(prism, grid)),
                roof: roof_solid::facets(record, prism, grid),
                faults: validate::faults_of(&prism.faces(), grid),
            },
            Err(reason) => Self { no_solid_reason: Some(reason.code()), ..Self::default() },
        };
        (prism, facts)
    }

    /// Whether there is a solid in which nothing was found.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.measures.is_some() && self.faults.is_empty()
    }
}

impl Measures {
    fn of(prism: &SnappedPrism, grid: &OutputGrid) -> Self {
        let thickness_m = (prism.roof() - prism.base()) as f64 * grid.scale_m;
        let length = |ring: &Vec<[i64; 2]>| -> f64 {
            let ends = ring.iter().zip(ring.iter().cycle().skip(1));
            ends.map(|(a, b)| ((b[0] - a[0]) as f64).hypot((b[1] - a[1]) as f64)).sum()
        };
        let length_m = prism.footprint().rings().iter().map(length).sum::<f64>() * grid.scale_m;
        let area_m2 = prism.footprint().area() * grid.scale_m.powi(2);
        Self { walls_m2: length_m * thickness_m, volume_m3: area_m2 * thickness_m }
    }
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;
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
    fn what_has_no_solid_says_why_and_is_not_valid() {
        let mut unknown = record("a", polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0)], 0.0, 0.0, 4.0);
        unknown.height_m = None;
        let (_, facts) = SolidFacts::of(&unknown, &OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] }, 0.5);
        assert_eq!((facts.no_solid_reason, facts.is_valid()), (Some("no_height"), false));
    }
}
