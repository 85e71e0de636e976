//! Whether the poses look right, before anything is computed from them.

use super::PipelineError;
use super::stages::write_json;
use crate::config::RunConfig;
use crate::issue::{Issue, Severity, Subject};
use crate::survey::{self, Site, Survey, SurveyReport};
use crate::terrain::Terrain;

/// Longer side of the survey's picture, pixels.
const PICTURE_PX: u32 = 1600;

/// Reads the survey, and writes the report and its picture beside the results.
///
/// The outlines are no area of interest here: a survey of a whole city serves a run of one block.
pub(super) fn look_over(config: &RunConfig, ground: Option<&Terrain>) -> Result<Survey, PipelineError> {
    let site = Site { terrain: ground, area: None };
    let (mut survey, report) = survey::inspect(&config.survey, &config.project.crs, site)?;
    let path = config.project.output.join("survey.json");
    write_json(&path, &report)?;
    if config.output.pictures {
        let picture = config.project.output.join("pictures").join("survey.png");
        survey::write_picture(&survey, ground.unwrap_or(&Terrain::Constant(0.0)), PICTURE_PX, &picture)?;
    }
    if report.is_sound() {
        return Ok(survey);
    }
    if !config.survey.accept_unsound || survey.views.is_empty() {
        return Err(PipelineError::Unsound { findings: findings(&report), report: path });
    }
    let message = format!("the poses look wrong, and were accepted: {}", report.findings.join("; "));
    let subject = Subject::Input(config.survey.path.display().to_string());
    survey.issues.push(Issue::new(Severity::Warning, "survey_unsound_accepted", subject, message));
    Ok(survey)
}

fn findings(report: &SurveyReport) -> String {
    let found = report.findings.iter().map(|finding| format!("  - {finding}"));
    let first = report.issues.iter().filter(|issue| issue.severity == Severity::Refused).take(1);
    let first = first.map(|issue| format!("  - the first refused item: {}", issue.message));
    let hints = report.trials.iter().map(|trial| format!("  hint: {trial}"));
    found.chain(first).chain(hints).collect::<Vec<_>>().join("\n")
}
