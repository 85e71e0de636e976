//! Records: one per input building, from its footprint and its solved height; and the issues of the heights stage.

use geo::Centroid as _;
use glam::DVec2;

use super::super::photo_ground::GroundCorrection;
use super::super::settings::RecordSettings;
use super::super::{FootprintStage, HeightStage, PipelineError};
use crate::config::{FootprintPlace, ProjectConfig};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::optimise::{
    DisagreeingView, FootprintShift, LayerShift, LevelOff, PriorShape, Reason, Roof, Solution, SolvedHeight, Terrace,
};
use sizeup_heights::scene::HeightBounds;
use sizeup_results::output::reviews::{Reviews, ReviewsConfig};
use sizeup_results::output::{BuildingRecord, HeightReference, RoofShape, Status, fallback, party_walls};
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
pub(in crate::pipeline) fn records(
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
                ground_ends_z_m: ground.and_then(|g| g.outline_m),
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
        part_of: refused.part_of.as_ref().map(|id| id.0.clone()),
        height_reference,
        reasons: vec![refused.reason.clone()],
        attributes: refused.attributes.clone(),
        ..BuildingRecord::without_height(&*refused.id.0, Status::Refused)
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

/// Views whose prior or photo could not be used, and doubts about all of them.
pub(in crate::pipeline) fn view_issues<'a>(
    survey: &'a Survey,
    heights: &'a HeightStage,
) -> impl Iterator<Item = Issue> + 'a {
    let issue = |severity, code, (view, reason): &(usize, String)| {
        let subject = Subject::View(survey.views[*view].id.0.clone());
        // A reason carries its advice on a line of its own.
        match reason.split_once("\nhint: ") {
            Some((reason, hint)) => Issue::new(severity, code, subject, reason).hint(hint),
            None => Issue::new(severity, code, subject, reason.clone()),
        }
    };
    let failed = heights.solution.failed_views.iter();
    let failed = failed.map(move |view| issue(Severity::Refused, "prior_unusable", view));
    let unread = heights.unread_photos.iter().map(move |view| issue(Severity::Warning, "photo_unreadable", view));
    failed
        .chain(unread)
        .chain(heights.doubt.clone())
        .chain(heights.solution.disagreeing_views.iter().map(|found| disagreeing_prior(survey, found)))
        .chain(bent_priors(&heights.solution))
        .chain(heights.layer_shift.map(|shift| shifted_layer(&shift)))
        .chain(heights.ground.issue())
        .chain(heights.level_off().map(|off| level_off(&off)))
}

/// A warning that a photo's prior contradicts all others.
fn disagreeing_prior(survey: &Survey, found: &DisagreeingView) -> Issue {
    let message = format!(
        "its prior does not show what the other photos' do: correlation {:.2} with the depth of the {} buildings measured in it, expected \
         about {:.2}; it was left out",
        found.correlation, found.n_buildings, found.usual
    );
    let hint = "is it the prior of this photo, in its orientation? Is the photo's pose right?";
    let subject = Subject::View(survey.views[found.view].id.0.clone());
    Issue::new(Severity::Warning, "prior_disagrees", subject, message).hint(hint)
}

/// A warning that depth shows the ground elsewhere than the terrain says.
fn level_off(&LevelOff { up_m, sigma_m, n_buildings }: &LevelOff) -> Issue {
    let (code, than) = if up_m < 0.0 { ("terrain_too_high", "lower") } else { ("terrain_too_low", "higher") };
    let message = format!(
        "the ground lies {:.1} ± {sigma_m:.1} m {than} than the terrain says, by the depth beside {n_buildings} buildings; heights are off by \
         about as much, or more, and were not corrected",
        up_m.abs()
    );
    let hint = "check whether the terrain and the poses have one vertical datum (`terrain.vertical_offset_m`); with the photos in \
                `survey.images` the ground is measured, and heights are corrected";
    Issue::new(Severity::Warning, code, Subject::Input("terrain".to_owned()), message).hint(hint)
}

/// A note on priors that were straightened along the ground.
fn bent_priors(solution: &Solution) -> Option<Issue> {
    let (n, n_used) = (solution.n_straightened, solution.used_views.len());
    (n > 0).then(|| {
        let message = match solution.prior_shape {
            PriorShape::ShiftedDepth => format!(
                "the prior is depth with an offset in {n} of {n_used} photos, expected depth up to scale; the offset was taken off by the \
                 terrain there"
            ),
            PriorShape::Bent | PriorShape::Line => format!(
                "the prior runs in a curve along the ground in {n} of {n_used} photos, expected a straight line in inverse depth; \
                 it was straightened by the terrain there"
            ),
        };
        if solution.prior_shape == PriorShape::ShiftedDepth {
            let hint = "maps that were stretched to a fixed range, photo by photo, are like this; store depth itself where you can";
            return Issue::new(Severity::Note, "prior_straightened", Subject::Input("prior".to_owned()), message).hint(hint);
        }
        let hint = "depths said to be inverse, or the other way round, do this: is `kind` right? So do maps that were stored with \
                    a gamma, as logarithms or as ranks: those are fine";
        Issue::new(Severity::Note, "prior_straightened", Subject::Input("prior".to_owned()), message).hint(hint)
    })
}

/// A note where the vertical datum is not stated.
#[must_use]
pub fn unstated_reference(project: &ProjectConfig) -> Option<Issue> {
    (project.vertical_reference.is_none() && project.crs.vertical_name().is_none()).then(|| {
        let subject = Subject::Input("project".to_owned());
        let message = format!("{} has no vertical part, so the vertical datum is not stated", project.crs);
        Issue::new(Severity::Note, "vertical_reference_not_stated", subject, message)
            .hint("set project.vertical_reference, or use a compound CRS such as EPSG:7415")
    })
}

/// Issues of all stages.
pub(in crate::pipeline) fn all_issues(
    project: &ProjectConfig,
    survey: &Survey,
    footprints: &FootprintStage,
    heights: &HeightStage,
) -> Vec<Issue> {
    let mut issues: Vec<Issue> = survey.issues.clone();
    issues.extend(footprints.layer.issues.iter().chain(&footprints.issues).cloned());
    issues.extend(view_issues(survey, heights).chain(unstated_reference(project)));
    issues.extend(moved_footprints(footprints, heights));
    issues
}

/// A warning that the footprint layer lies elsewhere than the photos show its buildings.
pub(in crate::pipeline) fn shifted_layer(shift: &LayerShift) -> Issue {
    let (east_m, north_m) = (shift.east_m, shift.north_m);
    let message = format!(
        "the footprints lie {:.1} m off, {} of where the photos show their buildings (± {:.1} m, by {} of them); heights \
         were measured with the photos moved there",
        east_m.hypot(north_m),
        east_and_north(east_m, north_m),
        shift.sigma_m,
        shift.n_buildings,
    );
    // As it would be written: no minus before a zero.
    let back = |way_m: f64| 0.0 - (way_m * 10.0).round() / 10.0;
    let hint = format!(
        "if the layer is off, `shift_m = [{:?}, {:?}]` under [footprints] moves it; if the photos are, their positions have another \
         datum or base station",
        back(east_m),
        back(north_m),
    );
    Issue::new(Severity::Warning, "footprints_shifted", Subject::Input("footprints".to_owned()), message).hint(hint)
}

/// A note on each footprint that lies elsewhere than the photos show its building, and a warning on all of them.
pub(in crate::pipeline) fn moved_footprints(footprints: &FootprintStage, heights: &HeightStage) -> Vec<Issue> {
    let solved = heights.solved.iter().zip(&heights.solution.heights);
    let mut notes: Vec<Issue> = solved
        .filter_map(|(&at, solved)| {
            let (shift, footprint) = (solved.footprint_shift?, &footprints.layer.footprints[at]);
            let mut parts = Vec::new();
            if shift.is_moved() {
                let way = east_and_north(shift.east_m, shift.north_m);
                parts.push(format!("lies {way} of where the photos show the building (± {:.1} m)", shift.sigma_m));
            }
            if shift.too_large_m != 0.0 {
                let words = if shift.too_large_m > 0.0 { "farther out than" } else { "inside of" };
                let by_m = shift.too_large_m.abs();
                parts.push(format!(
                    "has walls that stand {by_m:.1} m {words} the edge of the roof that the photos show"
                ));
            }
            let message = format!("the footprint {}", parts.join(", and "));
            let note = Issue::new(Severity::Note, "footprint_off", Subject::Building(footprint.id.0.clone()), message);
            Some(match footprint.polygon.centroid() {
                Some(place) => note.at(place.x(), place.y()),
                None => note,
            })
        })
        .collect();
    if !notes.is_empty() {
        let message = format!(
            "{} of {} footprints lie elsewhere than the photos show their buildings, or are larger or smaller; heights were measured \
             where the photos show them",
            notes.len(),
            heights.solved.len(),
        );
        let hint = "the layer footprints_moved of the GeoPackage has them there; `footprints = \"in_photos\"` under [output] \
                    takes them for the given ones";
        notes.push(
            Issue::new(Severity::Warning, "footprints_off", Subject::Input("footprints".to_owned()), message)
                .hint(hint),
        );
    }
    notes
}

/// A way along the ground in words: `0.8 m west and 0.3 m south`.
fn east_and_north(east_m: f64, north_m: f64) -> String {
    let along = |way_m: f64, words: [&str; 2]| format!("{:.1} m {}", way_m.abs(), words[usize::from(way_m < 0.0)]);
    format!("{} and {}", along(east_m, ["east", "west"]), along(north_m, ["north", "south"]))
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
