//! What one view shows, on the ground.

use geo::Centroid as _;
use geo_types::{MultiPolygon, Polygon};
use glam::DVec3;

use super::{BORDER_PX, Track};
use crate::candidate::Candidate;
use crate::georeference::{PlaceError, Projector, Surface, ground_pixel_m};
use crate::outlines::{Look, OutlineKind, OutlineSource, ViewFault};
use crate::source::DetectionSettings;
use crate::vectorise::Outline;
use sizeup_geo::terrain::Terrain;
use sizeup_survey::View;

/// Contours are thinned to this share of the outlines' tolerance before views vote.
const CONTOUR_SHARE: f64 = 0.1;
/// Parts of a candidate below this share of the least building are specks.
const SPECK_SHARE: f64 = 0.25;

/// What one view shows.
pub(super) struct Looked {
    /// What it sees of the ground.
    pub seen: Polygon<f64>,
    /// Outlines in the photo, on the ground, and how far off they may be.
    pub outlines: Vec<(Outline, MultiPolygon<f64>, PlaceError)>,
    /// Outlines that the terrain does not reach under.
    pub n_off_terrain: usize,
}

/// Looks for outlines in a view and lays them on the ground.
///
/// # Errors
/// [`ViewFault`], with which the view has none.
pub(super) fn look_at(
    source: &dyn OutlineSource,
    view: &View,
    terrain: &Terrain,
    settings: DetectionSettings<'_>,
) -> Result<Looked, ViewFault> {
    let on_ground = Projector::new(view, Surface::Terrain(terrain));
    let seen = on_ground.seen(BORDER_PX).ok_or(ViewFault::OffTerrain)?;
    let pixel_m = ground_pixel_m(&on_ground, view).ok_or(ViewFault::OffTerrain)?;
    let look = Look {
        min_area_px2: SPECK_SHARE * settings.consensus.min_area_m2 / (pixel_m * pixel_m),
        tolerance_px: CONTOUR_SHARE * settings.consensus.tolerance_m / pixel_m,
    };
    let found = source.outlines(view, look)?;
    let n_found = found.len();
    let outlines: Vec<_> = found
        .into_iter()
        .filter_map(|outline| {
            let shape = match settings.outline {
                OutlineKind::Ground => on_ground.shape(&outline.shape_px)?,
                OutlineKind::Roof => roof(view, terrain, &outline.shape_px, settings.consensus.roof_heights_m[0])?,
            };
            let centre = shape.centroid()?;
            let z = terrain.height_at(centre.x(), centre.y())?;
            let error = PlaceError::at(view, DVec3::new(centre.x(), centre.y(), z), settings.accuracy);
            Some((outline, shape, error))
        })
        .collect();
    let n_off_terrain = n_found - outlines.len();
    Ok(Looked { seen, outlines, n_off_terrain })
}

/// A roof's outline at a height above the ground under its middle.
fn roof(view: &View, terrain: &Terrain, shape_px: &MultiPolygon<f64>, height_m: f64) -> Option<MultiPolygon<f64>> {
    let middle_px = shape_px.centroid()?.into();
    let first = Projector::new(view, Surface::Terrain(terrain)).point(middle_px)?;
    // The ground under the roof, not behind it.
    let under = Projector::new(view, Surface::Level(first.z + height_m)).point(middle_px)?;
    let ground_m = terrain.height_at(under.x, under.y)?;
    Projector::new(view, Surface::Level(ground_m + height_m)).shape(shape_px)
}

/// A candidate at another height; as it is where that cannot be.
pub(super) fn raised(
    candidate: &Candidate,
    track: &Track,
    views: &[View],
    terrain: &Terrain,
    height_m: f64,
) -> Candidate {
    match roof(&views[track.view], terrain, &track.shape_px, height_m) {
        Some(shape) => Candidate { shape, ..candidate.clone() },
        None => candidate.clone(),
    }
}
