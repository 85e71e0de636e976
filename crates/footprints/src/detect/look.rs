//! What one view shows, on the ground.

use geo::Centroid as _;
use geo_types::{MultiPolygon, Polygon};
use glam::DVec3;

use super::{BORDER_PX, PhotoContour};
use crate::candidate::FootprintCandidate;
use crate::contours::{ContourFineness, ContourKind, ContourSource, ViewContours, ViewFault};
use crate::georeference::{BaseSurface, PlaceError, Projector, ground_pixel_m};
use crate::source::DetectionSettings;
use crate::vectorise::Contour;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::Terrain;
use sizeup_survey::View;

/// Contours are thinned to this share of the footprints' tolerance before views vote.
const CONTOUR_SHARE: f64 = 0.1;
/// Parts of a candidate below this share of the least building are specks.
const SPECK_SHARE: f64 = 0.25;

/// Candidates of one view.
pub(super) struct ViewCandidates {
    /// Ground that it sees.
    pub seen: Polygon<f64>,
    /// Contours in the photo, on the ground, and how far off they may be.
    pub contours: Vec<(Contour, MultiPolygon<f64>, PlaceError)>,
    /// Contours that the terrain does not reach under.
    pub n_off_terrain: usize,
    /// Why a network that takes depth had none.
    pub without_depth: Option<String>,
}

impl ViewCandidates {
    /// Notes on what the view could not show.
    pub fn notes(&self, view: &View) -> Vec<Issue> {
        let note = |code, message: String, hint: &str| {
            Issue::new(Severity::Note, code, Subject::View(view.id.0.clone()), message).hint(hint)
        };
        let off_terrain = (self.n_off_terrain > 0).then(|| {
            let message = format!("{} of its contours reach beyond the terrain and are left out", self.n_off_terrain);
            note("contours_off_terrain", message, "use a terrain model that covers what the views see")
        });
        let without_depth = self.without_depth.as_ref().map(|reason| {
            let message = format!("its buildings are found by colours alone: {reason}");
            let hint = "depth makes footprints better: overlapping photos for stereo, or a depth map set in [prior]";
            note("footprints_without_depth", message, hint)
        });
        off_terrain.into_iter().chain(without_depth).collect()
    }
}

/// Looks for contours in a view and lays them on the ground.
///
/// # Errors
/// [`ViewFault`], with which the view has none.
pub(super) fn look_at(
    source: &dyn ContourSource,
    view: &View,
    terrain: &Terrain,
    settings: DetectionSettings<'_>,
) -> Result<ViewCandidates, ViewFault> {
    let on_ground = Projector::new(view, BaseSurface::Terrain(terrain));
    let seen = on_ground.seen(BORDER_PX).ok_or(ViewFault::OffTerrain)?;
    let pixel_m = ground_pixel_m(&on_ground, view).ok_or(ViewFault::OffTerrain)?;
    let look = ContourFineness {
        min_area_px2: SPECK_SHARE * settings.consensus.min_area_m2 / (pixel_m * pixel_m),
        tolerance_px: CONTOUR_SHARE * settings.consensus.tolerance_m / pixel_m,
        pixel_m,
    };
    let ViewContours { contours: found, without_depth } = source.contours(view, look)?;
    let n_found = found.len();
    let contours: Vec<_> = found
        .into_iter()
        .filter_map(|contour| {
            let shape = match settings.contour {
                ContourKind::Ground => on_ground.shape(&contour.shape_px)?,
                ContourKind::Roof => roof(view, terrain, &contour.shape_px, settings.consensus.roof_heights_m[0])?,
            };
            let centre = shape.centroid()?;
            let z = terrain.height_at(centre.x(), centre.y())?;
            let error = PlaceError::at(view, DVec3::new(centre.x(), centre.y(), z), settings.accuracy);
            Some((contour, shape, error))
        })
        .collect();
    let n_off_terrain = n_found - contours.len();
    Ok(ViewCandidates { seen, contours, n_off_terrain, without_depth })
}

/// A roof's contour at a height above the ground under its middle.
fn roof(view: &View, terrain: &Terrain, shape_px: &MultiPolygon<f64>, height_m: f64) -> Option<MultiPolygon<f64>> {
    let middle_px = shape_px.centroid()?.into();
    let first = Projector::new(view, BaseSurface::Terrain(terrain)).point(middle_px)?;
    // The ground under the roof, not behind it.
    let under = Projector::new(view, BaseSurface::Level(first.z + height_m)).point(middle_px)?;
    let ground_m = terrain.height_at(under.x, under.y)?;
    Projector::new(view, BaseSurface::Level(ground_m + height_m)).shape(shape_px)
}

/// A candidate at another height; as it is where that cannot be.
pub(super) fn raised(
    candidate: &FootprintCandidate,
    track: &PhotoContour,
    views: &[View],
    terrain: &Terrain,
    height_m: f64,
) -> FootprintCandidate {
    match roof(&views[track.view], terrain, &track.shape_px, height_m) {
        Some(shape) => FootprintCandidate { shape, ..candidate.clone() },
        None => candidate.clone(),
    }
}
