//! The one thing to know of a run that did not go well.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use crate::issue::{Issue, Severity, Subject};
use crate::output::{BuildingRecord, Status};

/// Issues that most others can follow from, those that come first in a run first.
const CAUSES: [&str; 5] = [
    "survey_unsound_accepted",
    "masks_empty",
    "instances_in_parts",
    "prior_looks_inverted",
    "prior_unrelated_to_ground",
];
/// Reasons that say where a height comes from, not why it was not measured.
const OF_FALLBACK: [&str; 3] = ["height_from_attribute", "height_from_neighbours", "no_fallback"];

/// The most important problem in one sentence; `None` where there is none: what others follow from, or heights that
/// could not be measured, or the gravest of the other issues.
pub(super) fn worst(records: &[BuildingRecord], issues: &[Issue]) -> Option<String> {
    let cause = CAUSES.iter().find_map(|code| issues.iter().find(|issue| issue.code == *code));
    let gravest = || {
        let grave = issues.iter().filter(|issue| issue.severity >= Severity::Warning);
        grave.min_by_key(|issue| Reverse(issue.severity))
    };
    cause.map(told).or_else(|| unmeasured(records)).or_else(|| gravest().map(told))
}

fn told(issue: &Issue) -> String {
    match &issue.subject {
        Subject::View(id) | Subject::Building(id) => format!("{id}: {}", issue.message),
        Subject::Input(_) => issue.message.clone(),
    }
}

/// How many heights could not be measured, and the commonest reason.
fn unmeasured(records: &[BuildingRecord]) -> Option<String> {
    let is_measured = |record: &BuildingRecord| matches!(record.status, Status::Measured | Status::Doubtful);
    let without: Vec<&BuildingRecord> = records.iter().filter(|record| !is_measured(record)).collect();
    let mut by_reason: BTreeMap<&str, usize> = BTreeMap::new();
    for reason in without.iter().flat_map(|record| &record.reasons).filter(|r| !OF_FALLBACK.contains(&r.as_str())) {
        *by_reason.entry(reason).or_default() += 1;
    }
    let (reason, n) = by_reason.into_iter().min_by_key(|(_, n)| Reverse(*n))?;
    let of_them = if n < without.len() { format!(", {n} of them") } else { String::new() };
    Some(format!(
        "{} of {} heights could not be measured{of_them} because {}",
        without.len(),
        records.len(),
        in_words(reason)
    ))
}

fn in_words(reason: &str) -> String {
    match reason {
        "seen_by_no_view" => "no oblique photo with a prior sees the building well enough",
        "too_few_views" => "fewer than three photos have a say",
        "range_bound" => "the best height is the least or the greatest allowed",
        "flat_score" => "all heights explain the priors about equally well",
        "conflicting_views" => "the photos disagree",
        "poor_score" => "no height explains the priors",
        "wrong_order" => "the heights found leave the depths in the wrong order",
        "ground_unknown" => "the terrain has no ground there",
        _ => return format!("the outline cannot be used ({reason})"),
    }
    .to_owned()
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;
    use crate::output::record::tests::record;

    fn records(reasons: &[&str]) -> Vec<BuildingRecord> {
        let outline = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.0, y: 9.0)];
        let of = |reason: &&str| {
            let measured = record("a", outline.clone(), 0.0, 0.0, 9.0);
            if reason.is_empty() {
                return measured;
            }
            BuildingRecord { status: Status::Unknown, reasons: vec![(*reason).to_owned()], ..measured }
        };
        reasons.iter().map(of).collect()
    }

    #[test]
    fn causes_come_before_buildings_and_buildings_before_photos() {
        let photo = Issue::new(Severity::Refused, "prior_unusable", Subject::View("a.jpg".to_owned()), "no depth");
        let prior =
            Issue::new(Severity::Warning, "prior_looks_inverted", Subject::Input("prior".to_owned()), "inverted");
        let note = Issue::new(Severity::Note, "height_choice", Subject::Input("project".to_owned()), "a note");
        let (sound, bad) = (records(&[""]), records(&["", "poor_score", "poor_score", "flat_score"]));
        let all = [note.clone(), photo.clone(), prior];
        assert_eq!(worst(&bad, &all).unwrap(), "inverted");
        assert_eq!(
            worst(&bad, &all[..2]).unwrap(),
            "3 of 4 heights could not be measured, 2 of them because no height explains the priors"
        );
        assert_eq!(
            worst(&records(&["ground_unknown", ""]), &all[..2]).unwrap(),
            "1 of 2 heights could not be measured because the terrain has no ground there"
        );
        assert_eq!(worst(&sound, &all[..2]).unwrap(), "a.jpg: no depth");
        assert_eq!(worst(&sound, &all[..1]), None);
    }
}
