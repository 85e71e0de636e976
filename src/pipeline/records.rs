//! From footprints and solved heights to one record per input building.

use glam::DVec2;

use super::photo_ground::GroundCorrection;
use super::settings::RecordSettings;
use super::{FootprintStage, HeightStage, PipelineError};
use crate::config::FootprintPlace;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::optimise::{FootprintShift, LayerShift, Reason, Roof, SolvedHeight, Terrace};
use sizeup_heights::scene::HeightBounds;
use sizeup_results::output::reviews::{Reviews, ReviewsConfig};
use sizeup_results::output::{BuildingRecord, HeightReference, RoofShape, Status};
use sizeup_results::output::{fallback, party_walls};
use sizeup_survey::Survey;

/// Reads the decisions of people about single buildings; first, so that a bad file is reported before hours of computing.
///
/// # Errors
/// [`PipelineError::Reviews`].
pub fn reviews_of(settings: Option<&ReviewsConfig>) -> Result<Reviews, PipelineError> {
    Ok(settings.map(|reviews| Reviews::read(&reviews.path)).transpose()?.unwrap_or_default())
}

/// Every building of the input, footprints first, in the layer's order. What people decided counts for more than what was
/// found; heights that are not known then come from the fallback, if one is chosen, within the bounds of heights. Party walls are
/// those between them.
pub(super) fn records(
    (settings, bounds): (&RecordSettings<'_>, HeightBounds),
    survey: &Survey,
    footprints: &FootprintStage,
    heights: &HeightStage,
    reviews: &Reviews,
) -> Vec<BuildingRecord> {
    let mut records = found(survey, footprints, heights, settings.height_reference);
    for (record, correction) in
        records.iter_mut().zip(heights.ground.corrections(settings.ground_is_model, &footprints.layer.footprints))
    {
        if let Some(correction) = correction {
            add_ground_sigma(record, correction);
        }
    }
    if heights.level_off().is_some() {
        let found = records.iter_mut().filter(|record| record.height_m.is_some());
        found.for_each(|record| doubt(record, Reason::GroundDiffers));
    }
    if settings.place == FootprintPlace::InPhotos {
        records.iter_mut().for_each(move_to_photos);
    }
    reviews.apply(&mut records);
    fallback::fill(&mut records, settings.fallback, bounds);
    party_walls::fill(&mut records);
    records
}

fn found(
    survey: &Survey,
    footprints: &FootprintStage,
    heights: &HeightStage,
    height_reference: HeightReference,
) -> Vec<BuildingRecord> {
    let mut solved: Vec<Option<&SolvedHeight>> = vec![None; footprints.layer.footprints.len()];
    for (&at, height) in heights.solved.iter().zip(&heights.solution.heights) {
        solved[at] = Some(height);
    }
    let with_footprint =
        footprints.layer.footprints.iter().zip(&footprints.ground).zip(solved).map(|((footprint, ground), solved)| {
            let (status, reasons) = status_of(ground.is_some(), solved);
            BuildingRecord {
                id: footprint.id.0.clone(),
                part_of: footprint.part_of.as_ref().map(|id| id.0.clone()),
                footprint: Some(footprint.polygon.clone()),
                ground_z_m: ground.map(|g| g.reference_m),
                base_z_m: ground.map(|g| g.lowest_m),
                height_m: solved.and_then(|s| s.height_m),
                height_sigma_m: solved.and_then(|s| s.sigma_m),
                roof_sigma_m: solved.and_then(|s| s.sigma_m),
                ground_sigma_m: None,
                party_wall_m2: None,
                footprint_shift: total_shift(solved, heights.layer_shift),
                height_reference,
                // A height that is not known, or comes from a fallback, says nothing of the roof.
                roof: solved.filter(|s| s.height_m.is_some()).and_then(|s| {
                    Some(RoofShape {
                        certainty: s.form_certainty,
                        ..roof_shape(s.roof?, heights.origin, s.footprint_shift)
                    })
                }),
                status,
                reasons,
                views: solved
                    .map_or_else(Vec::new, |s| s.views.iter().map(|&v| survey.views[v].id.0.clone()).collect()),
                attributes: footprint.attributes.clone(),
            }
        });
    let without = footprints.layer.refused.iter().map(|refused| BuildingRecord {
        id: refused.id.0.clone(),
        part_of: refused.part_of.as_ref().map(|id| id.0.clone()),
        footprint: None,
        ground_z_m: None,
        base_z_m: None,
        height_m: None,
        height_sigma_m: None,
        roof_sigma_m: None,
        ground_sigma_m: None,
        party_wall_m2: None,
        footprint_shift: None,
        height_reference,
        roof: None,
        status: Status::Refused,
        reasons: vec![refused.reason.clone()],
        views: Vec::new(),
        attributes: refused.attributes.clone(),
    });
    with_footprint.chain(without).collect()
}

/// Adds what the ground's uncertainty does to the height over it.
fn add_ground_sigma(record: &mut BuildingRecord, correction: GroundCorrection) {
    record.ground_sigma_m = record.ground_z_m.map(|_| correction.sigma_m);
    if record.height_m.is_none() {
        return;
    }
    record.height_sigma_m.iter_mut().for_each(|of_roof_m| *of_roof_m = of_roof_m.hypot(correction.sigma_m));
    if correction.is_unsure() {
        doubt(record, Reason::GroundDiffers);
    }
}

/// Adds a reason to check a height.
fn doubt(record: &mut BuildingRecord, reason: Reason) {
    let code = reason.code();
    if let Err(at) = record.reasons.binary_search_by(|known| known.as_str().cmp(code)) {
        record.reasons.insert(at, code.to_owned());
    }
    if record.status == Status::Measured {
        record.status = Status::Doubtful;
    }
}

/// Moves a footprint that is off, and the step of its roof, to where the photos show the building.
fn move_to_photos(record: &mut BuildingRecord) {
    let (Some(moved), Some(shift)) = (record.footprint_in_photos(), record.footprint_shift) else { return };
    record.footprint = Some(moved);
    let way = shift.way();
    if let Some(step) = record.roof.as_mut().and_then(|roof| roof.step.as_mut()) {
        step.corners = step.corners.map(|[x, y]| [x + way.x, y + way.y]);
    }
}

/// How far a footprint lies off, with its layer and by itself.
fn total_shift(solved: Option<&SolvedHeight>, layer: Option<LayerShift>) -> Option<FootprintShift> {
    let own = solved.and_then(|s| s.footprint_shift);
    let Some(layer) = layer else { return own };
    let own = own.unwrap_or_default();
    Some(FootprintShift {
        east_m: own.east_m + layer.east_m,
        north_m: own.north_m + layer.north_m,
        sigma_m: own.sigma_m.hypot(layer.sigma_m),
        ..own
    })
}

/// A roof of the local frame in the map, over the footprint as it was given.
fn roof_shape(roof: Roof, origin: LocalOrigin, shift: Option<FootprintShift>) -> RoofShape {
    let way = shift.map_or(DVec2::ZERO, |shift| shift.way());
    let azimuth_deg = |[east, north]: [f64; 2]| east.atan2(north).to_degrees().rem_euclid(180.0);
    let moved = |corners: [[f64; 2]; 4]| corners.map(|[x, y]| [x + origin.0.x - way.x, y + origin.0.y - way.y]);
    RoofShape {
        ridge_azimuth_deg: roof.ridge_along.map(azimuth_deg),
        step: roof.terrace.map(|step| Terrace { corners: moved(step.corners), ..step }),
        ..RoofShape::new(roof.form, roof.eave_m, roof.ridge_m)
    }
}

fn status_of(has_ground: bool, solved: Option<&SolvedHeight>) -> (Status, Vec<String>) {
    let Some(solved) = solved.filter(|_| has_ground) else {
        return (Status::Unknown, vec!["ground_unknown".to_owned()]);
    };
    let mut reasons: Vec<String> = solved.reasons.iter().map(|r| r.code().to_owned()).collect();
    reasons.sort_unstable();
    let status = match (solved.height_m, reasons.is_empty()) {
        (None, _) => Status::Unknown,
        (Some(_), _) if solved.reasons.contains(&Reason::Guessed) => Status::Fallback,
        (Some(_), true) => Status::Measured,
        (Some(_), false) => Status::Doubtful,
    };
    (status, reasons)
}

#[cfg(test)]
mod tests {
    use geo::{Rect, coord};

    use super::*;

    fn on_ground(sigma_m: f64) -> BuildingRecord {
        let footprint = Rect::new(coord! { x: 0.0, y: 0.0 }, coord! { x: 9.0, y: 9.0 }).to_polygon();
        let mut record = BuildingRecord {
            height_sigma_m: Some(0.3),
            roof_sigma_m: Some(0.3),
            ..BuildingRecord::measured("a", footprint, 100.0, 10.0)
        };
        add_ground_sigma(&mut record, GroundCorrection { off_m: 1.5, sigma_m });
        record
    }

    #[test]
    fn the_sigmas_of_roof_and_ground_make_the_height_s() {
        let record = on_ground(0.4);
        assert_eq!(
            (record.ground_z_m, record.height_m),
            (Some(100.0), Some(10.0)),
            "corrected before heights were found"
        );
        assert_eq!((record.roof_sigma_m, record.ground_sigma_m), (Some(0.3), Some(0.4)));
        assert!((record.height_sigma_m.unwrap() - 0.5).abs() < 1e-12, "both sigmas count");
        assert_eq!((record.status, record.reasons.len()), (Status::Measured, 0));
    }

    #[test]
    fn a_height_over_an_uncertain_ground_is_doubtful() {
        let record = on_ground(1.2);
        assert_eq!((record.status, &record.reasons[..]), (Status::Doubtful, &["ground_differs".to_owned()][..]));
    }
}
