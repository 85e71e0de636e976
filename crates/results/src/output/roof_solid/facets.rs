//! The planes of a roof as solar planners want them: area, slope, aspect.
//!
//! ```text
//! area   = area in the plan · √(1 + |g|²)      g: rise per metre to the east and to the north
//! slope  = atan |g|                             0° flat
//! aspect = azimuth of −g                        where it looks, degrees clockwise from grid north
//! ```

use std::collections::BTreeMap;

use geo::Area as _;
use glam::{DVec2, DVec3};
use serde::Serialize;
use serde_json::{Map as JsonMap, Value};

use sizeup_heights::scene::RoofForm;

use super::super::BuildingRecord;
use super::super::attributes::round_m;
use super::super::grid::OutputGrid;
use super::super::prism::{FaceKind, GridFace, SnappedPrism};
use super::super::triangles;
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

impl RoofFacet {
    /// Returns the facet of a plane of this area; `fall` is how far it falls per metre to the east and to the north.
    fn of(area_m2: f64, fall: DVec2) -> Self {
        let rise = fall.length();
        let aspect_deg = fall.x.atan2(fall.y).to_degrees().rem_euclid(360.0);
        Self {
            area_m2: round_m(area_m2),
            slope_deg: round_m(rise.atan().to_degrees()),
            aspect_deg: (rise > 0.0).then(|| round_m(aspect_deg)),
        }
    }

    /// Attributes of a surface in files: `area_m2`, `slope_deg`, and `aspect_deg` where it is not flat.
    #[must_use]
    pub fn attributes(&self) -> JsonMap<String, Value> {
        let aspect = self.aspect_deg.map(|deg| ("aspect_deg".to_owned(), deg.into()));
        let own = [("area_m2".to_owned(), self.area_m2.into()), ("slope_deg".to_owned(), self.slope_deg.into())];
        own.into_iter().chain(aspect).collect()
    }
}

/// Faces of a solid that are in one plane of its roof.
#[derive(Debug, Clone, PartialEq)]
pub struct RoofSurface {
    /// Positions of the faces among all faces of the solid.
    pub faces: Vec<usize>,
    /// Area, slope and aspect of them.
    pub facet: RoofFacet,
}

/// Returns the planes of the roof of a solid, each with its faces.
///
/// ```text
/// A = Σ ½ Σ p_i × p_(i+1)      vector area of the faces of a plane
/// area = |A|,  rise = √(A_x² + A_y²) / A_z,  it falls towards (A_x, A_y)
/// ```
#[must_use]
pub fn surfaces(faces: &[GridFace], grid: &OutputGrid) -> Vec<RoofSurface> {
    let mut by_plane: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, face) in faces.iter().enumerate().filter(|(_, face)| face.surface == FaceKind::Roof) {
        by_plane.entry(face.plane).or_default().push(i);
    }
    let surface = |of_plane: Vec<usize>| {
        let area: DVec3 = of_plane.iter().map(|i| triangles::area_m2(&faces[*i], grid)).sum();
        let facet = RoofFacet::of(area.length(), area.truncate() / area.z);
        RoofSurface { faces: of_plane, facet }
    };
    by_plane.into_values().map(surface).collect()
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
        RoofFacet::of(patch.unsigned_area() * rise.hypot(1.0), -plane.slope)
    };
    let mut facets: Vec<RoofFacet> = roof.planes.planes.iter().zip(&roof.patches).map(facet).collect();
    facets.retain(|facet| facet.area_m2 > 0.0);
    facets.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    facets
}
