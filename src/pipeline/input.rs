//! Checks across stages: do survey, footprints and terrain speak of the same place?

use geo::Centroid as _;
use glam::DVec3;
use rayon::prelude::*;
use serde_json::{Map as JsonMap, Value};

use super::apart::no_overlap;
use super::settings::{DepthKind, HeightSettings, OutputSettings, PlaceSettings, SceneSettings};
use super::{FootprintStage, PipelineError};
use sizeup_footprints::{Footprint, attribute};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::GroundLevel;
use sizeup_heights::scene::{HeightBounds, HeightsConfig};
use sizeup_photos::textures::TEXELS_M;
use sizeup_results::output::fallback::{FallbackConfig, FallbackSource};
use sizeup_survey::{Survey, ViewKind, Viewpoints};

/// Code of the issue of footprints that are in no photo.
const UNSEEN: &str = "footprints_unseen";
const RANGE_HINT: &str = "set heights.min_m and heights.max_m in metres above ground";

/// Buildings sampled to count the places that photos were taken from.
const N_LOOKED_AT: usize = 200;

/// Checks that the views show the footprints from above; returns the lowest flying height above ground, metres.
pub(super) fn check_views(
    settings: &SceneSettings<'_>,
    survey: &Survey,
    footprints: &FootprintStage,
) -> Result<f64, PipelineError> {
    let targets = targets(footprints);
    if footprints.layer.footprints.is_empty() && footprints.detection.is_some() {
        return Err(PipelineError::Mismatch {
            message: "there is no building: none was found in the nadir photos".to_owned(),
            hint: "look at the layer `candidates` of footprints.gpkg and at issues.json of `sizeup footprints`",
        });
    }
    let Some(highest_ground) = targets.iter().map(|t| t.z).reduce(f64::max) else {
        return Err(PipelineError::Mismatch {
            message: format!("none of the {} footprints has a ground level", footprints.layer.footprints.len()),
            hint: "does the terrain cover the footprints, in the CRS it states?",
        });
    };
    check_kind(settings.depth, survey)?;
    check_overlap(&settings.places, survey, footprints)?;
    check_baseline(settings.depth, survey, &targets)?;
    clearance_m(survey, highest_ground)
}

/// Checks that there are oblique views, or nadir ones with depth in metres: what is only near and far shows no height from above.
fn check_kind(depth: DepthKind, survey: &Survey) -> Result<(), PipelineError> {
    let has_views = survey.views_for_heights().next().is_some();
    if has_views && (survey.kind_for_heights() == ViewKind::Oblique || depth.is_in_metres) {
        return Ok(());
    }
    let has_photos = has_views && survey.views.iter().any(|view| view.image.is_some());
    Err(PipelineError::Mismatch {
        message: format!("none of the {} views is oblique: all look straight down, or up", survey.views.len()),
        hint: if has_photos {
            "set prior.source = \"stereo\": overlapping photos that look straight down show the heights of roofs. Other depth is measured in \
             photos tilted by more than 15°; check the angle convention of the poses"
        } else {
            "heights are measured in photos tilted by more than 15°; check the angle convention of the poses"
        },
    })
}

/// Checks that the oblique photos of some building, on its ground, were taken from different places, where heights come from matching
/// photos with each other.
pub(super) fn check_baseline(depth: DepthKind, survey: &Survey, targets: &[DVec3]) -> Result<(), PipelineError> {
    if !depth.from_photos {
        return Ok(());
    }
    let sample = targets.iter().step_by(targets.len().div_ceil(N_LOOKED_AT).max(1));
    let seen = sample.map(|target| Viewpoints::of(survey.views_for_heights(), *target)).filter(|seen| seen.n_views > 1);
    let seen: Vec<Viewpoints> = seen.collect();
    if seen.is_empty() || !seen.iter().all(|seen| seen.lack_baseline()) {
        return Ok(());
    }
    Err(PipelineError::Mismatch {
        message: format!(
            "there is no baseline: all {} photos that show a building were taken from one place, and photos from one place show no \
             heights",
            if survey.kind_for_heights() == ViewKind::Oblique { "oblique" } else { "nadir" }
        ),
        hint: "take the photos from different places: fly around or past the buildings instead of turning the camera on the spot",
    })
}

/// The middle of each footprint on its ground, where that is known.
fn targets(footprints: &FootprintStage) -> Vec<DVec3> {
    let grounded = footprints.layer.footprints.iter().zip(&footprints.ground);
    let target = |(footprint, ground): (&Footprint, &Option<GroundLevel>)| {
        let centre = footprint.polygon.centroid()?;
        Some(DVec3::new(centre.x(), centre.y(), (*ground)?.reference_m))
    };
    grounded.filter_map(target).collect()
}

/// Checks that some view, of whatever kind, sees some footprint.
fn check_overlap(
    places: &PlaceSettings<'_>,
    survey: &Survey,
    footprints: &FootprintStage,
) -> Result<(), PipelineError> {
    let targets = targets(footprints);
    let is_seen = |target: &DVec3| is_in_a_photo(survey, *target);
    if targets.is_empty() || targets.iter().any(is_seen) {
        Ok(())
    } else {
        Err(no_overlap(places, survey, &footprints.layer))
    }
}

/// A warning where footprints are in no photo.
///
/// # Errors
/// [`PipelineError::Unusable`] where all are.
pub(super) fn unseen(
    places: &PlaceSettings<'_>,
    survey: &Survey,
    footprints: &FootprintStage,
) -> Result<Option<Issue>, PipelineError> {
    let targets = targets(footprints);
    let n_unseen = targets.par_iter().filter(|target| !is_in_a_photo(survey, **target)).count();
    if n_unseen == targets.len() && n_unseen > 0 {
        return Err(no_overlap(places, survey, &footprints.layer));
    }
    let message = format!("{n_unseen} of {} footprints are in no photo", targets.len());
    let subject = Subject::Input("footprints".to_owned());
    Ok((n_unseen > 0).then(|| {
        Issue::new(Severity::Warning, UNSEEN, subject, message)
            .hint("a flight smaller than the layer, or poses that are off: look at pictures/survey.png")
    }))
}

fn is_in_a_photo(survey: &Survey, place: DVec3) -> bool {
    survey.views.iter().any(|view| view.pixel_of(place).is_some())
}

/// The height of the lowest view that measures heights above the highest ground, metres.
pub(super) fn clearance_m(survey: &Survey, highest_ground: f64) -> Result<f64, PipelineError> {
    let clearance = |view: &sizeup_survey::View| view.camera_from_map.centre().z - highest_ground;
    let lowest = survey.views_for_heights().map(clearance).fold(f64::INFINITY, f64::min);
    if lowest <= 0.0 {
        return Err(PipelineError::Mismatch {
            message: format!("the lowest oblique view is {:.0} m below the ground of the buildings", -lowest),
            hint: "poses and terrain count heights from different levels: ellipsoidal against orthometric heights, or \
                   heights above take-off?",
        });
    }
    Ok(lowest)
}

/// Checks the settings before any work.
pub(super) fn check_settings(output: &OutputSettings<'_>, heights: &HeightSettings<'_>) -> Result<(), PipelineError> {
    let folder = output.folder.path();
    if folder.is_file() {
        return Err(PipelineError::Settings {
            table: "project",
            message: format!("output {} is a file, expected a folder", folder.display()),
            hint: "name another with `--output FOLDER`, or `project.output` in the configuration",
        });
    }
    if let Some(fault) = output.config.fallback.fault() {
        return Err(PipelineError::Settings {
            table: "output.fallback",
            message: fault.to_owned(),
            hint: "source is none, attribute (with attribute = \"storeys\", metres_per_unit = 3.0) or neighbourhood",
        });
    }
    if let Some(texel_m) = output.config.textures.texel_m.filter(|texel_m| !TEXELS_M.contains(texel_m)) {
        return Err(PipelineError::Settings {
            table: "output.textures",
            message: format!("`texel_m` is {texel_m}: expected {} to {} m", TEXELS_M.start(), TEXELS_M.end()),
            hint: "leave it out for the size that a pixel of the photos has on the buildings",
        });
    }
    if let Some((field, expected)) = heights.method.refinement.fault() {
        return Err(PipelineError::Settings {
            table: "refinement",
            message: format!("`{field}` is out of range: expected {expected}"),
            hint: "leave it out for the default, or set enabled = false to leave the photos out",
        });
    }
    match heights.scene.heights.fault() {
        None => Ok(()),
        Some(message) => Err(PipelineError::Settings { table: "heights", message, hint: RANGE_HINT }),
    }
}

/// Checks that some footprint has the attribute that replaces heights that could not be measured.
///
/// # Errors
/// [`PipelineError::Settings`].
pub fn check_fallback<'a>(
    settings: &FallbackConfig,
    mut attributes: impl Iterator<Item = &'a JsonMap<String, Value>>,
) -> Result<(), PipelineError> {
    match (settings.source, &settings.attribute) {
        (FallbackSource::Attribute, Some(name))
            if !attributes.any(|of_one| of_one.contains_key(name) || attribute(of_one, name).is_some()) =>
        {
            Err(PipelineError::Settings {
                table: "output.fallback",
                message: format!("none of the footprints has an attribute {name:?}"),
                hint: "attributes are named as in the footprints' layer; `ogrinfo -so LAYER` lists them",
            })
        }
        _ => Ok(()),
    }
}

/// Range of the heights.
pub(super) fn height_bounds(settings: &HeightsConfig, lowest_flight_m: f64) -> Result<HeightBounds, PipelineError> {
    let bounds = settings.bounds(lowest_flight_m);
    let HeightBounds { min_m, max_m } = bounds;
    if !(min_m > 0.0 && max_m > min_m && max_m.is_finite()) {
        return Err(PipelineError::Settings {
            table: "heights",
            message: format!(
                "heights from {min_m} to {max_m} m: expected 0 < min_m < max_m (the lowest oblique view is \
                 {lowest_flight_m:.0} m above ground)"
            ),
            hint: RANGE_HINT,
        });
    }
    Ok(bounds)
}
