//! From footprints and solved heights to one record per input building.

use glam::DVec2;

use super::dtm::terrain_in_force;
use super::ground_told::{GroundCorrection, GroundTold};
use super::{FootprintStage, HeightStage};
use crate::config::{FootprintPlace, RunConfig};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::optimise::{FootprintShift, LayerShift, Reason, Roof, SolvedHeight, Terrace};
use sizeup_heights::scene::HeightBounds;
use sizeup_results::output::reviews::Reviews;
use sizeup_results::output::{BuildingRecord, HeightReference, RoofForm, RoofShape, Status};
use sizeup_results::output::{fallback, party_walls};
use sizeup_survey::Survey;

/// Every building of the input, footprints first, in the layer's order. What people decided counts for more than what was
/// found; heights that are not known then come from the fallback, if one is chosen, within the bounds of heights. Party walls are
/// those between them.
pub(super) fn records(
    (config, bounds): (&RunConfig, HeightBounds),
    survey: &Survey,
    footprints: &FootprintStage,
    (heights, ground): (&HeightStage, &GroundTold),
    reviews: &Reviews,
) -> Vec<BuildingRecord> {
    let mut records = found(survey, footprints, heights, config.optimise.height_reference);
    for (record, correction) in records.iter_mut().zip(ground.corrections(footprints, &terrain_in_force(config))) {
        if let Some(correction) = correction {
            set_on_ground(record, correction, bounds);
        }
    }
    if config.output.footprints == FootprintPlace::InPhotos {
        records.iter_mut().for_each(move_to_photos);
    }
    reviews.apply(&mut records);
    fallback::fill(&mut records, &config.output.fallback, bounds);
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

/// Corrects the ground of a building: its roof stays where it is, unless its height leaves the bounds.
fn set_on_ground(record: &mut BuildingRecord, correction: GroundCorrection, bounds: HeightBounds) {
    let GroundCorrection { off_m, sigma_m } = correction;
    let raise = |z_m: &mut f64| *z_m += off_m;
    let lower = |height_m: &mut f64| *height_m -= off_m;
    record.ground_z_m.iter_mut().for_each(raise);
    record.base_z_m.iter_mut().for_each(raise);
    record.ground_sigma_m = record.ground_z_m.map(|_| sigma_m);
    let Some(before_m) = record.height_m else { return };
    // Over a terrain that is too high the search began above low roofs.
    if off_m < 0.0 && before_m < f64::from(bounds.min_m) - off_m {
        doubt(record, Reason::RangeBound);
    }
    record.height_m.iter_mut().for_each(lower);
    record.height_sigma_m.iter_mut().for_each(|of_roof_m| *of_roof_m = of_roof_m.hypot(sigma_m));
    if let Some(roof) = &mut record.roof {
        lower(&mut roof.eave_height_m);
        lower(&mut roof.ridge_height_m);
        if let Some(gable) = roof.step.as_mut().and_then(|step| step.gable.as_mut()) {
            lower(&mut gable.eave_m);
        }
    }
    if correction.is_unsure() {
        doubt(record, Reason::GroundDiffers);
    }
    keep_within(record, bounds);
}

/// Takes a height or a roof outside the bounds back to them, as a flat roof, with the reason.
fn keep_within(record: &mut BuildingRecord, bounds: HeightBounds) {
    let Some(height_m) = record.height_m else { return };
    let is_within =
        record.roof.is_none_or(|roof| roof.eave_height_m > 0.0 && roof.ridge_height_m <= f64::from(bounds.max_m));
    if bounds.hold(height_m) && is_within {
        return;
    }
    let nearest_m = bounds.nearest(height_m);
    record.height_m = Some(nearest_m);
    record.roof = record.roof.map(|_| RoofShape::new(RoofForm::Flat, nearest_m, nearest_m));
    doubt(record, Reason::RangeBound);
}

/// Adds a reason to look at a height again.
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

    const BOUNDS: HeightBounds = HeightBounds { min_m: 2.0, max_m: 30.0 };

    /// A gabled house of 8 m at its eave and 10 m on average, on a ground of 100 m.
    fn house() -> BuildingRecord {
        let footprint = Rect::new(coord! { x: 0.0, y: 0.0 }, coord! { x: 9.0, y: 9.0 }).to_polygon();
        BuildingRecord {
            height_sigma_m: Some(0.3),
            roof_sigma_m: Some(0.3),
            roof: Some(RoofShape::new(RoofForm::Gable, 8.0, 12.0)),
            ..BuildingRecord::measured("a", footprint, 100.0, 10.0)
        }
    }

    fn on_ground(off_m: f64, sigma_m: f64) -> BuildingRecord {
        let mut record = house();
        set_on_ground(&mut record, GroundCorrection { off_m, sigma_m }, BOUNDS);
        record
    }

    #[test]
    fn a_corrected_ground_changes_the_height_and_leaves_the_roof_where_it_is() {
        let record = on_ground(1.5, 0.4);
        assert_eq!((record.ground_z_m, record.base_z_m, record.height_m), (Some(101.5), Some(101.5), Some(8.5)));
        assert_eq!(record.roof_z_m(), house().roof_z_m());
        let roof = record.roof.unwrap();
        assert_eq!((roof.eave_height_m, roof.ridge_height_m), (6.5, 10.5));
        assert_eq!((record.roof_sigma_m, record.ground_sigma_m), (Some(0.3), Some(0.4)));
        assert!((record.height_sigma_m.unwrap() - 0.5).abs() < 1e-12, "both sigmas count");
        assert_eq!((record.status, record.reasons.len()), (Status::Measured, 0));
    }

    #[test]
    fn a_low_roof_over_a_terrain_that_was_too_high_is_doubtful() {
        let mut record = BuildingRecord { height_m: Some(3.0), roof: None, ..house() };
        set_on_ground(&mut record, GroundCorrection { off_m: -2.0, sigma_m: 0.2 }, BOUNDS);
        assert_eq!((record.height_m, record.status), (Some(5.0), Status::Doubtful));
    }

    #[test]
    fn an_uncertain_ground_and_a_height_that_leaves_the_bounds_are_doubtful() {
        let unsure = on_ground(0.0, 1.2);
        assert_eq!((unsure.status, &unsure.reasons[..]), (Status::Doubtful, &["ground_differs".to_owned()][..]));
        let low = on_ground(9.0, 0.2);
        assert_eq!((low.status, &low.reasons[..]), (Status::Doubtful, &["range_bound".to_owned()][..]));
        let roof = low.roof.unwrap();
        assert_eq!((low.height_m, roof.form, roof.eave_height_m), (Some(2.0), RoofForm::Flat, 2.0));
    }
}
