//! Whether the poses look right, before anything is computed from them.

use std::path::Path;

use super::PipelineError;
use super::settings::SurveySettings;
use sizeup_geo::files::write_json;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::Terrain;
use sizeup_results::output::picture;
use sizeup_survey::{Reading, Site, Survey, SurveyReport};

/// Reads the survey; its views show where terrain is needed.
pub(super) fn read(settings: &SurveySettings<'_>) -> Result<Reading, PipelineError> {
    Ok(Reading::of(settings.config, settings.crs)?)
}

/// Looks the survey over, and writes the report and its picture beside the results.
///
/// The footprints are no area of interest here: a survey of a whole city serves a run of one block.
pub(super) fn look_over(
    settings: &SurveySettings<'_>,
    reading: &Reading,
    ground: Option<&Terrain>,
) -> Result<Survey, PipelineError> {
    let mut report = reading.report(Site { terrain: ground, area: None });
    let mut survey = reading.survey().clone();
    report.path = settings.folder.saved(Path::new(&report.path)).display().to_string();
    for issue in survey.issues.iter_mut().chain(&mut report.issues) {
        if let Subject::Input(path) = &mut issue.subject {
            *path = settings.folder.saved(Path::new(path)).display().to_string();
        }
    }
    report.accepted = !report.is_sound() && settings.config.accept_unsound && !survey.views.is_empty();
    let path = settings.folder.join("survey.json");
    write_json(&path, &report)?;
    if settings.draws_pictures {
        let file = settings.folder.picture("survey.png");
        let picture = picture::survey_map(&survey, ground, settings.crs);
        picture::write_png(&file, &picture)?;
    }
    if report.is_sound() {
        return Ok(survey);
    }
    if !report.accepted {
        return Err(PipelineError::Unsound { findings: findings(&report), cure: cure(&report), report: path });
    }
    let message = format!("the poses look wrong, and were accepted: {}", report.findings.join("; "));
    let subject = Subject::Input(settings.folder.saved(&settings.config.path).display().to_string());
    survey.issues.push(Issue::new(Severity::Warning, "survey_unsound_accepted", subject, message));
    Ok(survey)
}

/// Remedy. No run can go on from cameras in the ground, whatever is accepted.
fn cure(report: &SurveyReport) -> &'static str {
    if report.above_ground_m.is_some_and(|spread| spread.median <= 0.0) {
        "cameras and terrain count heights from different levels: say what those of the poses are with `survey.height`, \
         move the poses with `survey.offset = [0, 0, METRES]`, or the terrain model with `terrain.vertical_offset_m`"
    } else {
        "`survey.accept_unsound = true` goes on nevertheless"
    }
}

fn findings(report: &SurveyReport) -> String {
    let found = report.findings.iter().map(|finding| format!("  - {finding}"));
    let first = report.issues.iter().filter(|issue| issue.severity == Severity::Refused).take(1);
    let first = first.map(|issue| format!("  - the first refused item: {}", issue.message));
    let hints = report.trials.iter().map(|trial| format!("  hint: {}", trial.advice()));
    found.chain(first).chain(hints).collect::<Vec<_>>().join("\n")
}
