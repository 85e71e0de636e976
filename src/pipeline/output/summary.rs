//! Summary of a run: the one thing to know where it did not go well, and the origin of its results.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use super::super::recipes::{files_of, footprint_files};
use super::super::settings::Origin;
use super::super::{HeightStage, PipelineError, RunSettings};
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::source;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_photos::prior::Priors;
use sizeup_results::output::unmeasured::{in_words, is_of_fallback};
use sizeup_results::output::{BuildingRecord, InputFile, Lineage, Status};
use sizeup_survey::{Survey, flight_day};

/// Weight of a height that is not there against one that is doubtful.
const WEIGHT_WITHOUT: usize = 2;

/// The most important problem in one sentence; `None` where there is none: what others follow from, or heights that
/// could not be measured or are doubtful, whichever weighs more, or the gravest of the other issues.
pub(in crate::pipeline) fn worst(records: &[BuildingRecord], issues: &[Issue]) -> Option<String> {
    // An implausible result has a cause that says more, if one is known.
    let is_effect = |issue: &Issue| issue.code == "result_implausible";
    let of_the_whole = issues.iter().filter(|issue| issue.is_of_the_whole());
    let cause = of_the_whole.min_by_key(|issue| (is_effect(issue), issue.weight()));
    let gravest = || {
        let grave = issues.iter().filter(|issue| issue.severity >= Severity::Warning);
        grave.min_by_key(|issue| issue.weight())
    };
    cause.map(sentence).or_else(|| not_measured(records)).or_else(|| gravest().map(sentence))
}

/// The issue as a sentence.
fn sentence(issue: &Issue) -> String {
    match &issue.subject {
        Subject::View(id) | Subject::Building(id) => format!("{id}: {}", issue.message),
        Subject::Input(_) => issue.message.clone(),
    }
}

/// How many heights could not be measured, or are doubtful, and the commonest reason. Buildings are counted, one in parts as its
/// worst part, as everywhere else.
fn not_measured(records: &[BuildingRecord]) -> Option<String> {
    let mut status_of: BTreeMap<&str, Status> = BTreeMap::new();
    for record in records {
        let status = status_of.entry(building_of(record)).or_insert(record.status);
        *status = record.status.max(*status);
    }
    let is_without = |status: Status| !matches!(status, Status::Measured | Status::Reviewed | Status::Doubtful);
    let is_doubtful = |status: Status| status == Status::Doubtful;
    let count = |holds: &dyn Fn(Status) -> bool| status_of.values().filter(|status| holds(**status)).count();
    let (n_without, n_doubtful) = (count(&is_without), count(&is_doubtful));
    let (holds, n_those, are): (&dyn Fn(Status) -> bool, usize, &str) = if WEIGHT_WITHOUT * n_without >= n_doubtful {
        (&is_without, n_without, "could not be measured")
    } else {
        (&is_doubtful, n_doubtful, "are doubtful")
    };
    let mut by_reason: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for record in records.iter().filter(|record| holds(record.status) && holds(status_of[building_of(record)])) {
        for reason in record.reasons.iter().filter(|reason| !is_of_fallback(reason)) {
            by_reason.entry(reason).or_default().insert(building_of(record));
        }
    }
    let (reason, of_it) = by_reason.into_iter().min_by_key(|(_, buildings)| Reverse(buildings.len()))?;
    let of_them = if of_it.len() < n_those { format!(", {} of them", of_it.len()) } else { String::new() };
    Some(format!("{n_those} of {} heights {are}{of_them} because {}", status_of.len(), in_words(reason)))
}

/// The building of the input that a record is of.
fn building_of(record: &BuildingRecord) -> &str {
    record.part_of.as_deref().unwrap_or(&record.id)
}

/// Origin of a run's results: the files that it read, and its settings.
pub(in crate::pipeline) fn lineage(
    settings: &RunSettings<'_>,
    command: &str,
    survey: &Survey,
    heights: &HeightStage,
    priors: &Priors,
) -> Result<Lineage, PipelineError> {
    let mut files: BTreeSet<(&str, PathBuf)> = BTreeSet::new();
    files.extend(files_of(&settings.survey.config.path).into_iter().map(|path| ("survey", path)));
    let footprint_files = footprint_files(settings.footprints.source, survey);
    files.extend(footprint_files.iter().flat_map(|path| source::files_of(path)).map(|path| ("footprints", path)));
    files.extend(
        settings
            .footprints
            .ground
            .terrain
            .dtm
            .iter()
            .flat_map(|path| source::files_of(path))
            .map(|path| ("terrain", path)),
    );
    files.extend(settings.reviews.iter().map(|reviews| ("reviews", reviews.path.clone())));
    for &view in &heights.solution.used_views {
        files.extend(priors.file_of(&survey.views[view])?.map(|path| ("prior", path)));
    }
    let hashed = |(role, path): &(&str, PathBuf)| -> Result<InputFile, FileError> {
        let path_saved = settings.output.folder.saved(path).display().to_string();
        Ok(InputFile { path: path_saved, ..InputFile::hash(role, path)? })
    };
    let inputs: Result<Vec<InputFile>, FileError> =
        files.iter().filter(|(_, path)| path.is_file()).map(hashed).collect();
    let photos = survey.views.iter().filter_map(|view| view.image.as_ref());
    Ok(settings.origin.lineage(command, inputs?).of_day(|| flight_day(photos)))
}

impl Origin<'_> {
    /// Lineage of a result that was made from some files.
    #[must_use]
    pub fn lineage(&self, command: &str, inputs: Vec<InputFile>) -> Lineage {
        let crs = &self.project.crs;
        let vertical = self.project.vertical_reference.clone();
        Lineage {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: crate::recipe::commit().map(str::to_owned),
            command: command.to_owned(),
            config_sha256: self.config_sha256.clone(),
            inputs,
            crs: crs.definition().to_owned(),
            vertical_reference: vertical
                .or_else(|| crs.vertical_name().map(str::to_owned))
                .unwrap_or_else(|| "not stated".to_owned()),
            height_definition: format!(
                "roof level minus ground level; ground level: {}; roof level: mean over the roof",
                serde_json::to_string(&self.ground.reference).unwrap_or_default().trim_matches('"')
            ),
            seed: self.seed,
            reference_date: self.project.reference_date.clone(),
            source: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;

    use super::*;

    fn records(reasons: &[&str]) -> Vec<BuildingRecord> {
        let footprint = polygon![(x: 0.0, y: 0.0), (x: 9.0, y: 0.0), (x: 9.0, y: 9.0), (x: 0.0, y: 9.0)];
        let of = |reason: &&str| {
            let measured = BuildingRecord::measured("a", footprint.clone(), 0.0, 9.0);
            if reason.is_empty() {
                return measured;
            }
            BuildingRecord { status: Status::Unknown, reasons: vec![(*reason).to_owned()], ..measured }
        };
        let numbered = |(i, reason): (usize, &&str)| BuildingRecord { id: format!("b{i}"), ..of(reason) };
        reasons.iter().enumerate().map(numbered).collect()
    }

    #[test]
    fn a_building_in_parts_is_counted_once_as_its_worst_part() {
        let mut parts = records(&["", "conflicting_views", "conflicting_views", ""]);
        for part in &mut parts[1..] {
            part.part_of = Some("row".to_owned());
            part.status = if part.reasons.is_empty() { Status::Measured } else { Status::Doubtful };
        }
        assert_eq!(worst(&parts, &[]).unwrap(), "1 of 2 heights are doubtful because the photos disagree");
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
            "3 of 4 heights could not be measured, 2 of them because the priors are explained badly by any height"
        );
        assert_eq!(
            worst(&records(&["ground_unknown", ""]), &all[..2]).unwrap(),
            "1 of 2 heights could not be measured because the terrain has no ground there"
        );
        let mut doubtful =
            records(&["flat_score", "conflicting_views", "conflicting_views", "range_bound", "range_bound", ""]);
        doubtful[..5].iter_mut().for_each(|record| record.status = Status::Doubtful);
        let overlap = Issue::new(Severity::Warning, "footprints_overlap", Subject::Building("a".to_owned()), "by 1 %");
        assert_eq!(
            worst(&doubtful, &[overlap]).unwrap(),
            "5 of 6 heights are doubtful, 2 of them because the photos disagree"
        );
        assert_eq!(worst(&sound, &all[..2]).unwrap(), "a.jpg: no depth");
        assert_eq!(worst(&sound, &all[..1]), None);
    }
}
