//! An issue for every building whose height is neither `measured` nor `reviewed`: why, where, and what to do about it.

use std::collections::BTreeSet;

use geo::{Area as _, InteriorPoint as _};

use super::{BuildingRecord, Status};
use sizeup_geo::issue::{Issue, Severity, Subject};

/// Reasons that say where a height comes from, not why it was not measured.
pub const OF_FALLBACK: [&str; 3] = ["height_from_attribute", "height_from_neighbours", "no_fallback"];

/// Start of a reason that shows an attribute's value, from which no height could be taken.
pub const ATTRIBUTE_REFUSED: &str = "attribute_refused: ";

/// Whether a reason says where a height comes from, or why from nowhere, and not why it was not measured.
#[must_use]
pub fn is_of_fallback(reason: &str) -> bool {
    OF_FALLBACK.contains(&reason) || reason.starts_with(ATTRIBUTE_REFUSED)
}

/// Issues of the buildings that are neither `measured` nor `reviewed`: those without a height first, then the doubtful ones, large footprints
/// first. Refused footprints that `told` has an issue of are left out.
#[must_use]
pub fn unmeasured(records: &[BuildingRecord], told: &[Issue]) -> Vec<Issue> {
    let refused: BTreeSet<&str> =
        told.iter().filter(|i| i.severity == Severity::Refused).filter_map(building).collect();
    let is_told = |record: &BuildingRecord| record.status == Status::Refused && refused.contains(record.id.as_str());
    let mut found: Vec<&BuildingRecord> =
        records.iter().filter(|record| !is_settled(record.status) && !is_told(record)).collect();
    let area_m2 = |record: &BuildingRecord| record.footprint.as_ref().map_or(0.0, geo::Polygon::unsigned_area);
    found.sort_by(|a, b| b.status.cmp(&a.status).then(area_m2(b).total_cmp(&area_m2(a))));
    found.into_iter().map(issue).collect()
}

/// Whether nobody has to look at it.
fn is_settled(status: Status) -> bool {
    matches!(status, Status::Measured | Status::Reviewed)
}

fn building(issue: &Issue) -> Option<&str> {
    match &issue.subject {
        Subject::Building(id) => Some(id),
        Subject::View(_) | Subject::Input(_) => None,
    }
}

fn issue(record: &BuildingRecord) -> Issue {
    let (severity, code, what) = match (record.status, record.height_m) {
        (Status::Doubtful, Some(h)) => {
            (Severity::Warning, "height_doubtful", format!("its height of {h:.1} m is doubtful"))
        }
        (Status::Fallback, Some(h)) => {
            (Severity::Warning, "height_from_fallback", format!("its height of {h:.1} m comes from the fallback"))
        }
        (Status::Refused, _) => (Severity::Refused, "footprint_refused", "it has no height".to_owned()),
        _ => (Severity::Refused, "height_unknown", "its height is unknown".to_owned()),
    };
    let reasons: Vec<&str> = record.reasons.iter().map(String::as_str).filter(|r| !OF_FALLBACK.contains(r)).collect();
    let why: Vec<String> = reasons.iter().map(|reason| in_words(reason)).collect();
    let message = if why.is_empty() { what } else { format!("{what}: {}", why.join("; ")) };
    let issue = Issue::new(severity, code, Subject::Building(record.id.clone()), message);
    let issue = match reasons.iter().find_map(|reason| advice(reason)) {
        Some(hint) => issue.hint(hint),
        None => issue,
    };
    match record.footprint.as_ref().and_then(geo::Polygon::interior_point) {
        Some(at) => issue.at(at.x(), at.y()),
        None => issue,
    }
}

/// Meaning of a reason.
#[must_use]
pub fn in_words(reason: &str) -> String {
    match reason {
        "seen_by_no_view" => "no oblique photo with a prior sees the building well enough",
        "too_few_views" => "fewer than three photos have a say",
        "range_bound" => "the best height is at an end of the heights that are looked for",
        "flat_score" => "all heights explain the priors about equally well",
        "conflicting_views" => "the photos disagree",
        "poor_score" => "the priors are explained badly by any height",
        "wrong_order" => "the heights found leave its depths in the wrong order",
        "other_height" => "another height explains the priors better",
        "unseen_above" => "no photo's depth looks through the space above it: it may be taller",
        "vegetation" => "nearly all that stands there is as green as leaves: trees over the roof, or a green roof",
        "above_all_around" => "it stands far above all that is around",
        "nothing_stands_here" => "the photos show no building there: the bare ground explains them as well",
        "roof_of_neighbour" => "so small a footprint may show the roof of another building beside it",
        "ground_differs" => "the photos do not agree on the level of the ground around it",
        "ground_unknown" => "the terrain has no ground there",
        "footprint_duplicate" => "another footprint of the layer is the same building",
        "reviewed" => "a person looked at it and settled its height",
        "reviewed_wrong" => "a person looked at it and found its height wrong",
        _ => {
            return match reason.strip_prefix(ATTRIBUTE_REFUSED) {
                Some(value) => format!("its attribute {value}"),
                None => format!("the footprint cannot be used ({reason})"),
            };
        }
    }
    .to_owned()
}

fn advice(reason: &str) -> Option<&'static str> {
    Some(match reason {
        "seen_by_no_view" | "too_few_views" => "more oblique photos of it would help",
        "range_bound" => "if buildings are higher or lower than that, set heights.max_m and heights.min_m",
        "above_all_around" => "if there is no tower, look at its footprint and its photos (`sizeup view --photo`)",
        "nothing_stands_here" => "if it was pulled down, take its footprint out of the layer",
        "roof_of_neighbour" => "look at it in the photos; a building beside it may be missing in the layer",
        "ground_differs" => "give a terrain model, or photos that show the ground beside it from more sides",
        "reviewed_wrong" => "correct its height in the review, or give it one with [output.fallback]",
        "vegetation" => "look at it in the photos: under trees the height is theirs, of a green roof it is its own",
        "unseen_above" | "conflicting_views" | "poor_score" | "flat_score" | "other_height" => {
            "look at its footprint, and at pictures/overlay-*.png or the report's photos of it"
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;
    use crate::output::record::tests::record;

    fn of(id: &str, side_m: f64, status: Status, reasons: &[&str]) -> BuildingRecord {
        let footprint = polygon![(x: 0.0, y: 0.0), (x: side_m, y: 0.0), (x: side_m, y: side_m), (x: 0.0, y: side_m)];
        let reasons = reasons.iter().map(|r| (*r).to_owned()).collect();
        let height_m = (status != Status::Unknown).then_some(9.0);
        BuildingRecord { height_m, status, reasons, ..record(id, footprint, 0.0, 0.0, 9.0) }
    }

    #[test]
    fn every_building_that_is_not_measured_is_an_issue_with_reason_and_place() {
        let records = [
            of("small", 5.0, Status::Doubtful, &["conflicting_views"]),
            of("fine", 9.0, Status::Measured, &[]),
            of("large", 20.0, Status::Doubtful, &["flat_score", "range_bound"]),
            of("hidden", 9.0, Status::Unknown, &["no_fallback", "seen_by_no_view"]),
            of("bad", 9.0, Status::Refused, &["self_crossing"]),
        ];
        let told = [Issue::new(Severity::Refused, "x", Subject::Building("bad".to_owned()), "crosses itself")];
        let issues = unmeasured(&records, &told);
        let ids: Vec<&str> = issues.iter().filter_map(building).collect();
        assert_eq!(ids, ["hidden", "large", "small"]);
        assert_eq!(issues[0].severity, Severity::Refused);
        assert_eq!(
            issues[0].message,
            "its height is unknown: no oblique photo with a prior sees the building well enough"
        );
        assert!(issues[1].message.contains("doubtful") && issues[1].message.contains("; the best height is at an end"));
        assert_eq!(issues[2].place, Some([2.5, 2.5]));
        assert_eq!(unmeasured(&records, &[]).len(), 4, "a refused footprint that nobody told of is told");
    }
}
