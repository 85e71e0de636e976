//! The report of a run, from what its stages found.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::super::priors::PriorStore;
use super::super::scene::SceneStage;
use super::super::scene::load_terrain;
use super::super::settings::{HeightSettings, OutputSettings};
use super::super::{HeightStage, PipelineError};
use super::{backdrop, evidence, overview};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::BuildingId;
use sizeup_heights::optimise::{EpochRecord, LevelGain};
use sizeup_results::output::textured::TexturedCity;
use sizeup_results::output::{CityModel, picture};
use sizeup_results::report::{self, Backdrop, LevelFit, Report, SolverPass, ViewUse};
use sizeup_survey::{Survey, SurveyReport, View};

/// Longer side of the picture under the map, pixels, at most: nadir photos laid on the ground. It takes some 500 kB.
const BACKDROP_PX: u32 = 1400;

/// Writes `report.html` beside the results.
pub(in crate::pipeline) fn write(
    (settings, search): (&OutputSettings<'_>, &HeightSettings<'_>),
    model: &CityModel<'_>,
    stage: &SceneStage,
    heights: &HeightStage,
    levels: &[(BuildingId, LevelGain)],
    priors: &PriorStore,
) -> Result<(), PipelineError> {
    let implausible: Vec<String> =
        model.issues.iter().filter(|i| i.code == "result_implausible").map(|i| i.message.clone()).collect();
    let draw = || picture::warned(overview::draw(&stage.scene, &heights.solution.heights), &implausible);
    let overview = settings.config.pictures.then(draw);
    if let Some(overview) = &overview {
        picture::write_png(&settings.folder.picture("overview.png"), overview)?;
    }
    let textured = TexturedCity::of_result(settings.folder.path())?;
    let report = Report {
        model: *model,
        terrain: &stage.terrain,
        views: uses(model.survey, heights),
        passes: heights.solution.history.iter().map(pass).collect(),
        solved: &heights.solved,
        levels: levels.iter().map(levels_of).collect(),
        survey: survey_report(settings),
        evidence: evidence::gather(search, model.survey, stage, heights, priors),
        overview,
        backdrop: lay_photos(model, &stage.terrain, backdrop::TOWN),
        textured: textured.as_ref(),
        config: settings.config_toml.clone(),
    };
    Ok(report::write(&settings.folder.join("report.html"), &report)?)
}

/// Cells of the ground in the page of a city are at least so wide, metres.
const CITY_CELL_M: f64 = 5.0;

fn lay_photos(model: &CityModel<'_>, terrain: &Terrain, effort: backdrop::Effort) -> Option<Backdrop> {
    backdrop::lay(&model.survey.views, model.records, terrain, BACKDROP_PX, effort)
}

/// The photos that may lie under the map of a city: where they change, so may its page.
#[must_use]
pub fn photos_for_city_report(views: &[View]) -> Vec<&Path> {
    backdrop::at_hand(views).filter_map(|view| view.image.as_deref()).collect()
}

/// Writes `report.html` of a city that was made in parts: without the passes and the evidence, which stay with the parts.
/// Returns the photos that lie under its map.
///
/// # Errors
/// [`PipelineError`]: the terrain cannot be read, or the page not be written.
pub fn write_city_report(
    settings: &OutputSettings<'_>,
    folder: &Path,
    model: &CityModel<'_>,
    textured: Option<&TexturedCity>,
) -> Result<Vec<PathBuf>, PipelineError> {
    let footprints = model.records.iter().filter_map(|r| r.footprint.as_ref());
    let terrain = load_terrain(&settings.ground.coarser(CITY_CELL_M), footprints, 0.0)?.terrain;
    let asked: BTreeSet<&str> = model.records.iter().flat_map(|r| &r.views).map(String::as_str).collect();
    let kind = model.survey.kind_for_heights();
    let used = |view: &View| match view.kind() {
        _ if asked.contains(view.id.0.as_str()) => ViewUse::Measured,
        of_view if of_view == kind => ViewUse::NotNeeded,
        _ => ViewUse::NotOblique,
    };
    let backdrop = lay_photos(model, &terrain, backdrop::CITY);
    let shown: BTreeSet<&str> = backdrop.iter().flat_map(|b| &b.photos).map(String::as_str).collect();
    let shown = model.survey.views.iter().filter(|view| shown.contains(view.id.0.as_str()));
    let photos = shown.filter_map(|view| view.image.clone()).collect();
    let report = Report {
        model: *model,
        terrain: &terrain,
        views: model.survey.views.iter().map(used).collect(),
        passes: Vec::new(),
        solved: &[],
        levels: Vec::new(),
        survey: survey_report(settings),
        evidence: Vec::new(),
        overview: None,
        backdrop,
        textured,
        config: settings.config_toml.clone(),
    };
    report::write(&folder.join("report.html"), &report)?;
    Ok(photos)
}

/// Report of the survey stage; a report without it is still a report.
fn survey_report(settings: &OutputSettings<'_>) -> Option<SurveyReport> {
    let text = std::fs::read(settings.folder.join("survey.json")).ok()?;
    serde_json::from_slice(&text).ok()
}

fn levels_of((whole, gain): &(BuildingId, LevelGain)) -> LevelFit {
    LevelFit {
        whole: whole.to_string(),
        heights_m: gain.heights_m,
        two: gain.two,
        one: gain.one.clone(),
        n_views: gain.n_views,
    }
}

fn pass(pass: &EpochRecord) -> SolverPass {
    SolverPass {
        loss: pass.loss,
        relative_change: pass.relative_change,
        n_selected: pass.n_selected,
        active_pairs: pass.active_pairs,
        heights_m: pass.heights_m.clone(),
    }
}

fn uses(survey: &Survey, heights: &HeightStage) -> Vec<ViewUse> {
    let failed: BTreeMap<usize, &String> = heights.solution.failed_views.iter().map(|(v, why)| (*v, why)).collect();
    let used = |i: &usize| heights.solution.used_views.binary_search(i).is_ok();
    let kind = survey.kind_for_heights();
    let of = |(i, view): (usize, &sizeup_survey::View)| match failed.get(&i) {
        Some(why) => ViewUse::Failed((*why).clone()),
        None if used(&i) => ViewUse::Measured,
        None if view.kind() == kind => ViewUse::NotNeeded,
        None => ViewUse::NotOblique,
    };
    survey.views.iter().enumerate().map(of).collect()
}
