//! Contours of roofs, once the roofs' heights are known.

use geo::{Area as _, Centroid as _};
use glam::DVec3;

use super::{BORDER_PX, Tracks};
use crate::FootprintLayer;
use crate::candidate::{FootprintCandidate, SeenGround};
use crate::clean::{self, CleaningRules};
use crate::consensus;
use crate::georeference::{BaseSurface, PlaceError, Projector};
use crate::source::DetectionSettings;
use sizeup_survey::View;

/// Lays roof contours at the roofs' heights anew: `roof_z_m` per building of the layer, `None` leaves it as it is.
/// Returns how far the corners' mean moved, metres, per building.
///
/// # Errors
/// Never for tracks that [`crate::detect()`] made over the same views.
pub fn move_roofs(
    layer: &mut FootprintLayer,
    tracks: &Tracks,
    roof_z_m: &[Option<f64>],
    views: &[View],
    settings: DetectionSettings<'_>,
) -> Vec<f64> {
    let mut candidates = Vec::new();
    let mut seen: Vec<SeenGround> = Vec::new();
    let mut fixed = Vec::new();
    for (i, (tracks, z)) in tracks.buildings.iter().zip(roof_z_m).enumerate() {
        let Some(z) = z else { continue };
        let first = candidates.len();
        for track in tracks {
            let view = &views[track.view];
            let projector = Projector::new(view, BaseSurface::Level(*z));
            let (Some(shape), Some(area)) = (projector.shape(&track.shape_px), projector.seen(BORDER_PX)) else {
                continue;
            };
            let Some(centre) = shape.centroid() else { continue };
            let error = PlaceError::at(view, DVec3::new(centre.x(), centre.y(), *z), settings.accuracy);
            let weight = error.sigma_m().powi(2).max(1e-6).recip();
            candidates.push(FootprintCandidate {
                view: seen.len(),
                shape,
                weight,
                score: track.score,
                is_cut: track.is_cut,
            });
            seen.push(SeenGround { area });
        }
        if candidates.len() > first {
            fixed.push((i, (first..candidates.len()).collect::<Vec<_>>()));
        }
    }
    let drawn = consensus::draw_fixed(&fixed, &candidates, &seen, settings.consensus);
    let rules = CleaningRules {
        grid_m: settings.consensus.grid_m,
        min_area_m2: settings.consensus.min_area_m2,
        max_area_change: 0.05,
    };
    let mut moved = vec![0.0; layer.footprints.len()];
    for (i, polygon) in drawn {
        let Ok(cleaned) = clean::clean(&polygon, rules) else { continue };
        let parts = cleaned.parts.into_iter();
        let Some(largest) = parts.max_by(|a, b| a.unsigned_area().total_cmp(&b.unsigned_area())) else { continue };
        let old = std::mem::replace(&mut layer.footprints[i].polygon, largest);
        if let (Some(a), Some(b)) = (old.centroid(), layer.footprints[i].polygon.centroid()) {
            moved[i] = (a.x() - b.x()).hypot(a.y() - b.y());
        }
    }
    moved
}
