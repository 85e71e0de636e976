//! The planes of a roof as solar planners want them: area, slope, aspect.
//!
//! ```text
//! area   = area in the plan · √(1 + |g|²)      g: rise per metre to the east and to the north
//! slope  = atan |g|                             0° flat
//! aspect = azimuth of −g                        where it looks, degrees clockwise from grid north
//! ```

use geo::Area as _;
use serde::Serialize;

use sizeup_heights::scene::RoofForm;

use super::super::BuildingRecord;
use super::super::attributes::round_m;
use super::super::grid::OutputGrid;
use super::super::prism::SnappedPrism;
use super::PlannedRoof;

/// A plane of a roof.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RoofFacet {
    /// Area of the plane itself, m².
    pub area_m2: f64,
    /// Angle between the plane and the horizontal, degrees.
    pub slope_deg: f64,
    /// Direction in which it falls, degrees clockwise from grid north; `None` where it is flat.
    pub aspect_deg: Option<f64>,
}

/// Returns the planes of a building's roof, the largest first; none where its form is not known or does not fit the footprint.
#[must_use]
pub fn facets(record: &BuildingRecord, block: &SnappedPrism, grid: &OutputGrid) -> Vec<RoofFacet> {
    let Some(shape) = record.roof else { return Vec::new() };
    if shape.form == RoofForm::Flat {
        let area_m2 = record.footprint.as_ref().map_or(0.0, geo::Area::unsigned_area);
        return vec![RoofFacet { area_m2: round_m(area_m2), slope_deg: 0.0, aspect_deg: None }];
    }
    let Some(roof) = PlannedRoof::of(shape, block, grid) else { return Vec::new() };
    let facet = |(plane, patch): (&sizeup_heights::optimise::RoofPlane, &geo_types::MultiPolygon<f64>)| {
        let rise = plane.slope.length();
        let aspect_deg = (-plane.slope.x).atan2(-plane.slope.y).to_degrees().rem_euclid(360.0);
        RoofFacet {
            area_m2: round_m(patch.unsigned_area() * rise.hypot(1.0)),
            slope_deg: round_m(rise.atan().to_degrees()),
            aspect_deg: (rise > 0.0).then(|| round_m(aspect_deg)),
        }
    };
    let mut facets: Vec<RoofFacet> = roof.planes.planes.iter().zip(&roof.patches).map(facet).collect();
    facets.retain(|facet| facet.area_m2 > 0.0);
    facets.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    facets
}
