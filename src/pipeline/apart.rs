//! Poses and footprints that are far from each other: a wrong CRS more often than wrong files. Checked before terrain is read,
//! which would be blamed for it.

use geo::{BoundingRect as _, Centroid as _};
use geo_types::Polygon;
use glam::DVec3;

use super::PipelineError;
use super::settings::PlaceSettings;
use sizeup_footprints::{FootprintLayer, open_layer};
use sizeup_geo::crs::{Crs, Transform};
use sizeup_geo::terrain::MapBox;
use sizeup_survey::ground::MAX_OFF_NADIR_DEG;
use sizeup_survey::{Survey, View};

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
    fn of(declared: &PlaceSettings<'_>, survey: &Survey, layer: &FootprintLayer) -> Option<Self> {
        let centres = || survey.views.iter().map(View::centre);
        let cameras = MapBox::around(centres().map(|centre| (centre.x, centre.y)))?;
        let polygons = || layer.footprints.iter().map(|footprint| &footprint.polygon);
        let corners = polygons().filter_map(Polygon::bounding_rect).flat_map(|rect| [rect.min(), rect.max()]);
        let footprints = MapBox::around(corners.map(|corner| (corner.x, corner.y)))?;
        let gap = |polygon: &Polygon<f64>| Some(cameras.distance_m(polygon.centroid()?.x_y()));
        let gap_m = polygons().filter_map(gap).reduce(f64::min)?;
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
    let is_apart = Places::of(declared, survey, layer).is_some_and(|places| places.gap_m > places.sight_m);
    if is_apart { Err(no_overlap(declared, survey, layer)) } else { Ok(()) }
}

/// A corner that is far away makes a footprint that no memory is enough for.
fn check_lengths(layer: &FootprintLayer) -> Result<(), PipelineError> {
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
pub(super) fn no_overlap(declared: &PlaceSettings<'_>, survey: &Survey, layer: &FootprintLayer) -> PipelineError {
    let Some(places) = Places::of(declared, survey, layer) else {
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
