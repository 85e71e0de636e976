//! The survey stage: whether the poses look right, before anything is computed from them.
//!
//! Where photos are matched with each other, for depth or to refine roofs, bad photos are reported too, and poses that do not fit
//! their photos are aligned with them.

use std::path::Path;

use super::settings::SurveySettings;
use super::{Event, PipelineError, Tell};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_json;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::{self, MapBox, Terrain, TerrainConfig, TerrainError};
use sizeup_photos::align::{self, AlignError, AlignReport, AlignWhen, Aligned, CameraCorrection, MAX_MISFIT_PX};
use sizeup_photos::quality;
use sizeup_results::output::picture;
use sizeup_survey::{Reading, Site, Survey, SurveyReport, View};

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

/// Codes of the issues.
const ALIGNED: &str = "poses_aligned";
const LEFT_ALONE: &str = "pose_not_aligned";
const POOR: &str = "poses_poorer_than_photos";
/// Terrain is read so far around the cameras, metres: where oblique photos look.
const AROUND_CAMERAS_M: f64 = 500.0;
/// Finer terrain does not improve poses, metres per cell.
const MIN_CELL_M: f64 = 5.0;

/// Adds issues of bad photos, where depth is matched from them.
pub(super) fn looked_at(settings: &SurveySettings<'_>, mut survey: Survey, tell: Tell<'_>) -> Survey {
    if settings.from_photos {
        let issues = quality::look(&survey.views, &|done, total| tell(Event::Photos { done, total }));
        survey.issues.extend(issues);
    }
    survey
}

/// Aligns poses with their photos, where the settings want that and the photos are better than the poses.
pub(super) fn fitted(settings: &SurveySettings<'_>, survey: Survey, tell: Tell<'_>) -> Result<Survey, PipelineError> {
    let has_photos = survey.views.iter().any(|view| view.image.is_some());
    let is_wanted = settings.align.when == AlignWhen::Always;
    if !settings.is_aligned || !(has_photos || is_wanted) {
        return Ok(survey);
    }
    let Some(ground) = terrain_around(settings.terrain, settings.crs, &survey.views)? else { return Ok(survey) };
    let misfit_px = match align::misfit_px(&survey.views, &ground, settings.align) {
        Ok(misfit_px) => misfit_px,
        // Without a misfit there is nothing to align, unless the settings want it.
        Err(e) if is_wanted || e.is_usage() => return Err(e.into()),
        Err(_) => return Ok(survey),
    };
    tracing::debug!("photos lie {misfit_px:?} pixels off under the given poses");
    let is_poor = misfit_px.is_some_and(|misfit_px| misfit_px > MAX_MISFIT_PX);
    // A focal length that is off hides in the heights of points.
    let is_calibrated = settings.align.focal_sigma_percent == 0.0;
    if !is_poor && !is_wanted && is_calibrated {
        return Ok(survey);
    }
    let tell_size = |done, total| tell(Event::Align { done, total });
    let aligned = align::align(&survey.views, &ground, settings.align, misfit_px, &tell_size);
    match aligned {
        Ok(aligned) => applied(settings, survey, aligned),
        Err(e) if is_wanted => Err(e.into()),
        Err(e) => Ok(with_doubt(survey, misfit_px, &e)),
    }
}

fn applied(settings: &SurveySettings<'_>, survey: Survey, aligned: Aligned) -> Result<Survey, PipelineError> {
    let Aligned { views, report } = aligned;
    write_json(&settings.folder.join("align.json"), &report)?;
    let issues = survey.issues.into_iter().chain(issues(&report)).collect();
    Ok(Survey { views, issues })
}

/// Issues of the alignment, and of photos that were not aligned.
fn issues(report: &AlignReport) -> Vec<Issue> {
    let about = || Subject::Input("survey".to_owned());
    let (before, after) = (report.before.median_px, report.after.median_px);
    if !report.is_taken {
        let message = format!(
            "the photos fit no better under other poses (median {before:.1} pixels off, {after:.1} after adjusting): the given ones are kept"
        );
        return vec![Issue::new(Severity::Note, ALIGNED, about(), message)];
    }
    let message = format!(
        "the photos did not fit under the given poses (median {before:.1} pixels off); {} of {} were aligned ({after:.1} pixels), moved by \
         {:.2} m and {:.2} degrees (medians)",
        report.n_photos, report.n_views, report.shift_m, report.turn_deg
    );
    let focal = |camera: &CameraCorrection| {
        format!(
            "; focal length of {} photos {:.1} -> {:.1} pixels",
            camera.n_photos, camera.given_focal_px, camera.focal_px
        )
    };
    let message = message + &report.cameras.iter().map(focal).collect::<String>();
    let done = Issue::new(Severity::Note, ALIGNED, about(), message)
        .hint("align.json lists each photo; `align.when = \"never\"` takes poses as they are");
    let left = report.left_alone.iter().map(|left| {
        let message = format!("its pose was left as it came: {}", left.reason);
        Issue::new(Severity::Warning, LEFT_ALONE, Subject::View(left.view.clone()), message)
    });
    std::iter::once(done).chain(left).collect()
}

fn with_doubt(mut survey: Survey, misfit_px: Option<f64>, why: &AlignError) -> Survey {
    let message = format!(
        "the photos lie {:.1} pixels off under the given poses (median), and these could not be aligned: {why}",
        misfit_px.unwrap_or_default()
    );
    survey.issues.push(Issue::new(Severity::Warning, POOR, Subject::Input("survey".to_owned()), message));
    survey
}

/// The survey with the aligned poses of an earlier one.
pub(super) fn as_before(mut again: Survey, before: Survey) -> Survey {
    let is_kept = |code: &str| [ALIGNED, LEFT_ALONE, POOR].contains(&code) || quality::CODES.contains(&code);
    again.issues.extend(before.issues.into_iter().filter(|issue| is_kept(&issue.code)));
    Survey { views: before.views, ..again }
}

/// Sentence on the alignment; `None` where there was none.
pub(super) fn in_words(survey: &Survey) -> Option<String> {
    survey.issues.iter().find(|issue| [ALIGNED, POOR].contains(&issue.code.as_str())).map(|issue| issue.message.clone())
}

/// The ground around cameras, where one is given.
///
/// # Errors
/// [`TerrainError`].
pub fn terrain_around(config: &TerrainConfig, crs: &Crs, views: &[View]) -> Result<Option<Terrain>, TerrainError> {
    if let Some(height_m) = config.constant_m.filter(|_| config.dtm.is_none()) {
        return Ok(Some(Terrain::Constant(height_m)));
    }
    let cameras = views.iter().map(View::centre);
    let Some(area) = MapBox::around(cameras.map(|centre| (centre.x, centre.y))) else { return Ok(None) };
    let config = TerrainConfig { min_cell_m: config.min_cell_m.max(MIN_CELL_M), ..config.clone() };
    terrain::load(&config, crs, area.grown(AROUND_CAMERAS_M)).map(Some)
}
