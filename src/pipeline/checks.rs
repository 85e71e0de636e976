//! Checks across stages: do survey, footprints and terrain describe the same place?
//!
//! Poses and footprints far from each other have a wrong CRS more often than wrong files. That is checked before terrain is read,
//! which would be blamed for it.

use geo::{BoundingRect as _, Centroid as _};
use geo_types::Polygon;
use glam::DVec3;
use rayon::prelude::*;
use serde_json::{Map as JsonMap, Value};

use super::settings::{DepthKind, HeightSettings, OutputSettings, PlaceSettings, SceneSettings};
use super::{FootprintStage, PipelineError};
use sizeup_footprints::{Footprint, FootprintLayer, attribute, open_layer};
use sizeup_geo::crs::{Crs, Transform};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::{GroundLevel, MapBox};
use sizeup_heights::scene::{HeightBounds, HeightsConfig};
use sizeup_photos::textures::TEXELS_M;
use sizeup_results::output::fallback::{FallbackConfig, FallbackSource};
use sizeup_survey::ground::MAX_OFF_NADIR_DEG;
use sizeup_survey::{Survey, View, ViewKind, Viewpoints};

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
        Err(no_overlap(places, survey, Places::of_layer(places, survey, &footprints.layer)))
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
        return Err(no_overlap(places, survey, Places::of_layer(places, survey, &footprints.layer)));
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

/// Ground below the zero of heights, and below a level that is known roughly, is not deeper than this, metres.
const BELOW_ZERO_M: f64 = 500.0;
const BELOW_LEVEL_M: f64 = 100.0;
/// No building is longer, metres.
const LONGEST_M: f64 = 20_000.0;
/// Further apart than this, two inputs have different ideas of where they are, metres.
const FAR_M: f64 = 20_000.0;

/// Cameras and footprints in the map.
struct Places {
    cameras: MapBox,
    footprints: MapBox,
    /// From the nearest footprint to the cameras, metres.
    gap_m: f64,
    /// So far a camera can see the ground, metres.
    sight_m: f64,
}

impl Places {
    fn of_layer(declared: &PlaceSettings<'_>, survey: &Survey, layer: &FootprintLayer) -> Option<Self> {
        let polygons = || layer.footprints.iter().map(|footprint| &footprint.polygon);
        let middles = polygons().filter_map(|polygon| Some(polygon.centroid()?.x_y()));
        Self::new(declared, survey, extent(polygons())?, middles)
    }

    /// From the box around all footprints, and the middle of each.
    fn new(
        declared: &PlaceSettings<'_>,
        survey: &Survey,
        footprints: MapBox,
        middles: impl Iterator<Item = (f64, f64)>,
    ) -> Option<Self> {
        let centres = || survey.views.iter().map(View::centre);
        let cameras = MapBox::around(centres().map(|centre| (centre.x, centre.y)))?;
        let gap_m = middles.map(|middle| cameras.distance_m(middle)).reduce(f64::min)?;
        let lowest_m = declared.level_m.map_or(-BELOW_ZERO_M, |level_m| level_m - BELOW_LEVEL_M);
        let highest_m = centres().map(|centre| centre.z).fold(lowest_m, f64::max);
        let sight_m = (highest_m - lowest_m) * MAX_OFF_NADIR_DEG.to_radians().tan();
        Some(Self { cameras, footprints, gap_m, sight_m })
    }
}

/// Checks that footprints are as large as buildings can be, and that some are as near as the cameras can see.
///
/// # Errors
/// [`PipelineError::Unusable`].
pub(super) fn check_apart(
    declared: &PlaceSettings<'_>,
    survey: &Survey,
    layer: &FootprintLayer,
) -> Result<(), PipelineError> {
    check_lengths(layer)?;
    near_enough(declared, survey, Places::of_layer(declared, survey, layer))
}

/// Checks, before a city is cut into parts, that its views measure heights, and that some footprint is as near as the cameras can see.
///
/// # Errors
/// [`PipelineError`], as a run in one piece.
pub fn check_city(
    settings: &SceneSettings<'_>,
    survey: &Survey,
    footprints: MapBox,
    middles: &[(f64, f64)],
) -> Result<(), PipelineError> {
    let places = &settings.places;
    near_enough(places, survey, Places::new(places, survey, footprints, middles.iter().copied()))?;
    check_kind(settings.depth, survey)
}

/// Box around footprints, map frame, metres.
pub(super) fn extent<'a>(polygons: impl Iterator<Item = &'a Polygon<f64>>) -> Option<MapBox> {
    let corners = polygons.filter_map(geo::BoundingRect::bounding_rect).flat_map(|rect| [rect.min(), rect.max()]);
    MapBox::around(corners.map(|c| (c.x, c.y)))
}

fn near_enough(declared: &PlaceSettings<'_>, survey: &Survey, places: Option<Places>) -> Result<(), PipelineError> {
    match places {
        Some(places) if places.gap_m > places.sight_m => Err(no_overlap(declared, survey, Some(places))),
        _ => Ok(()),
    }
}

/// Checks that footprints are as large as buildings can be: a corner that is far away makes one that no memory is enough for.
///
/// # Errors
/// [`PipelineError::Unusable`] with the longest.
pub fn check_lengths(layer: &FootprintLayer) -> Result<(), PipelineError> {
    let length_m = |polygon: &Polygon<f64>| polygon.bounding_rect().map_or(0.0, |rect| rect.width().max(rect.height()));
    let lengths = layer.footprints.iter().map(|footprint| (length_m(&footprint.polygon), &footprint.id));
    let Some((length_m, id)) = lengths.filter(|(length_m, _)| *length_m > LONGEST_M).max_by(|a, b| a.0.total_cmp(&b.0))
    else {
        return Ok(());
    };
    Err(PipelineError::Unusable {
        message: format!(
            "[footprints] the footprint {id} is {:.0} km long, expected a building of at most {:.0} km",
            length_m / 1000.0,
            LONGEST_M / 1000.0
        ),
        hint: "one of its corners lies elsewhere: mend the footprint, or take it out of the layer".to_owned(),
    })
}

/// No view sees any footprint: where both are, and what may be wrong.
fn no_overlap(declared: &PlaceSettings<'_>, survey: &Survey, places: Option<Places>) -> PipelineError {
    let Some(places) = places else {
        let message = "no view sees any footprint".to_owned();
        return PipelineError::Mismatch { message, hint: "are there poses and footprints?" };
    };
    let Places { cameras, footprints, gap_m, .. } = &places;
    let span = |area: &MapBox| {
        format!("E {:.0} to {:.0}, N {:.0} to {:.0}", area.west_m, area.east_m, area.south_m, area.north_m)
    };
    let message = format!(
        "no view sees any footprint: the nearest is {:.1} km from the cameras: the footprints lie in {}, the cameras in {} ({})",
        gap_m / 1000.0,
        span(footprints),
        span(cameras),
        declared.crs
    );
    let check = "check the CRS and offset of the survey, the CRS of the footprints, and the angle convention";
    let hint = match (*gap_m > FAR_M).then(|| fitting(declared, survey, &places)) {
        None => check.to_owned(),
        Some(None) => format!("so far apart, a wrong CRS (its zone, too) is the likely cause: {check}"),
        Some(Some(fit)) => format!("a wrong CRS is the likely cause: {fit}; or {check}"),
    };
    PipelineError::Unusable { message, hint }
}

/// The CRS in which the numbers of the poses, or else of the footprints, fit the others, as advice.
fn fitting(declared: &PlaceSettings<'_>, survey: &Survey, places: &Places) -> Option<String> {
    let PlaceSettings { crs: project, layer, .. } = *declared;
    let own = layer.and_then(|layer| open_layer(layer).ok()?.crs().ok()?).filter(Crs::is_projected);
    let numbers_in = |declared: &Crs, (x, y): (f64, f64)| Transform::new(project, declared).ok()?.point(x, y).ok();
    let n = survey.views.len().max(1) as f64;
    let camera = survey.views.iter().map(View::centre).sum::<DVec3>() / n;
    let poses = declared.survey_crs.unwrap_or(project);
    let candidates = own.into_iter().filter(|own| own != poses).chain(poses.other_zones());
    let is_there = |place| places.footprints.distance_m(place) < FAR_M;
    let of_poses = numbers_in(poses, (camera.x, camera.y))
        .and_then(|numbers| project.read_in(candidates, numbers, is_there))
        .map(|fits| {
            let key = if declared.survey_crs.is_some() { "survey.crs" } else { "project.crs" };
            format!("the numbers of the poses fit {fits} ({}), so try {key} = \"{fits}\"", fits.name())
        });
    let of_footprints = || {
        let declared = layer?.crs.as_ref()?;
        let middle = |low: f64, high: f64| f64::midpoint(low, high);
        let MapBox { west_m, south_m, east_m, north_m } = places.footprints;
        let numbers = numbers_in(declared, (middle(west_m, east_m), middle(south_m, north_m)))?;
        let is_there = |place| places.cameras.distance_m(place) < FAR_M;
        let fits = project.read_in(declared.other_zones(), numbers, is_there)?;
        Some(format!("the numbers of the footprints fit {fits} ({}), so try footprints.crs = \"{fits}\"", fits.name()))
    };
    // A CRS that was written by hand for the layer is the likelier to be wrong.
    of_footprints().or(of_poses)
}
