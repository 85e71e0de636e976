//! Issues of the heights stage, and of the run as a whole.

use super::footprints_off::{moved_footprints, shifted_layer};
use super::{FootprintStage, HeightStage};
use crate::config::ProjectConfig;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_heights::optimise::{DisagreeingView, LevelOff, PriorShape, Solution};
use sizeup_survey::Survey;

/// Views whose prior or photo could not be used, and doubts about all of them.
pub(super) fn view_issues<'a>(survey: &'a Survey, heights: &'a HeightStage) -> impl Iterator<Item = Issue> + 'a {
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
pub(super) fn all_issues(
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
