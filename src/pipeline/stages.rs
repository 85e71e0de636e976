//! The stages, one function each, and the loop over them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::checks::{check_fallback, check_settings, unseen};
use super::heights::HeightSearch;
use super::output::records::{all_issues, records, reviews_of};
use super::output::summary::{lineage, worst};
use super::output::{pictures, report, textures, write_results};
use super::priors::PriorStore;
use super::scene::SceneStage;
use super::{City, Event, FootprintStage, PipelineError, RunOptions, RunSettings, RunSummary, Solver, Stage, Tell};
use super::{dtm, footprints, survey as survey_stage};
use crate::config::ResultFolder;
use sizeup_geo::files::write_json;
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::Terrain;
use sizeup_geo::unfinished::Unfinished;
use sizeup_results::output::plausible::CityDoubts;
use sizeup_results::output::reports::write_issues;
use sizeup_results::output::reviews::Reviews;
use sizeup_results::output::unmeasured::unmeasured;
use sizeup_results::output::{BuildingRecord, CityModel, StatusCount, cityjson};
use sizeup_survey::{Survey, ViewKind};

pub(super) fn run(
    settings: &RunSettings<'_>,
    options: &RunOptions,
    tell: Tell<'_>,
    solver: Solver<'_>,
) -> Result<City, PipelineError> {
    if options.from > options.until {
        return Err(PipelineError::Settings {
            table: "run",
            message: format!("--from {} comes after --until {}", options.from.name(), options.until.name()),
            hint: "the stages are survey, footprints, heights, output",
        });
    }
    check_settings(&settings.output, &settings.heights)?;
    let reviews = reviews_of(settings.reviews)?;
    let folder = settings.output.folder;
    // The mark shows that the folder is not complete, also after a run was killed.
    let start = if options.until < Stage::Output { Unfinished::start_beside_others } else { Unfinished::start };
    let mut mark = start(folder.path(), &options.command)?;
    let city = run_marked(settings, options, &reviews, (tell, solver), &mut mark).and_then(|city| {
        let seconds: BTreeMap<&str, f64> = city.summary.seconds.iter().map(|(stage, s)| (stage.as_str(), *s)).collect();
        write_json(&folder.join(beside_results(folder, options.until, "timing.json")), &seconds)?;
        Ok(city)
    });
    match (&city, mark.is_replacing()) {
        (Ok(_), true) => mark.finish()?,
        (Err(_), true) => {}
        // What was not replaced is what it was.
        (_, false) => mark.withdraw()?,
    }
    city
}

/// The stages themselves, in a folder that is marked.
fn run_marked(
    settings: &RunSettings<'_>,
    options: &RunOptions,
    reviews: &Reviews,
    (tell, solver): (Tell<'_>, Solver<'_>),
    mark: &mut Unfinished,
) -> Result<City, PipelineError> {
    let RunSettings { survey: of_survey, output, artefacts, .. } = settings;
    let mut seconds = Vec::new();
    let mut timed =
        |stage: Stage, start: Instant| seconds.push((stage.name().to_owned(), start.elapsed().as_secs_f64()));
    let runs = |stage: Stage| options.from <= stage && stage <= options.until;

    let (start, mut reading) = (Instant::now(), None);
    let mut survey: Survey = if runs(Stage::Survey) {
        tell(Event::Stage(Stage::Survey));
        // A terrain model is read around the footprints: the survey is checked again with it.
        let ground = of_survey.terrain.constant_m.map(Terrain::Constant);
        let survey =
            survey_stage::look_over(of_survey, reading.insert(survey_stage::read(of_survey)?), ground.as_ref())?;
        let survey = survey_stage::fitted(of_survey, survey_stage::looked_at(of_survey, survey, tell), tell)?;
        artefacts.write_survey(&survey)?;
        timed(Stage::Survey, start);
        survey
    } else {
        artefacts.read_survey()?
    };
    let mut summary = summary_of_survey(settings, &survey);
    if options.until == Stage::Survey {
        return Ok(City::without_records(RunSummary { seconds, ..summary }));
    }

    let start = Instant::now();
    let mut footprints: FootprintStage = if runs(Stage::Footprints) {
        tell(Event::Stage(Stage::Footprints));
        dtm::for_run(&settings.dtm, &survey, tell)?;
        let (footprints, terrain) = footprints::read(&settings.footprints, &survey)?;
        if matches!(terrain, Terrain::Grid(_)) {
            let reading = reading.take().map_or_else(|| survey_stage::read(of_survey), Ok)?;
            survey = survey_stage::as_before(survey_stage::look_over(of_survey, &reading, Some(&terrain))?, survey);
            // Later stages need the issues of this check, too.
            artefacts.write_survey(&survey)?;
        }
        artefacts.write(Stage::Footprints, &survey, &footprints)?;
        timed(Stage::Footprints, start);
        footprints
    } else {
        artefacts.read(Stage::Footprints, &survey)?
    };
    check_fallback(
        settings.records.fallback,
        footprints.layer.footprints.iter().map(|footprint| &footprint.attributes),
    )?;
    summary.n_buildings = n_buildings(&footprints);
    summary.detection.clone_from(&footprints.detection);
    if options.until == Stage::Footprints {
        sum_up_without_heights(settings, &survey, &footprints, &mut summary)?;
        return Ok(City::without_records(RunSummary { seconds, ..summary }));
    }

    let start = Instant::now();
    let (heights, stage, priors) = if runs(Stage::Heights) {
        tell(Event::Stage(Stage::Heights));
        let search = HeightSearch::new(&settings.heights, &survey, tell, solver);
        let (heights, stage, priors) = search.run(&mut footprints, artefacts)?;
        artefacts.write(Stage::Heights, &survey, &heights)?;
        timed(Stage::Heights, start);
        (heights, stage, Some(priors))
    } else {
        let heights = artefacts.read_heights(&survey, &footprints)?;
        let (heights, stage) = SceneStage::of_heights(&settings.heights.scene, &survey, &mut footprints, heights)?;
        (heights, stage, None)
    };
    summary.n_used_views = heights.solution.used_views.len();
    summary.n_refined = Some(heights.solution.heights.iter().filter(|solved| solved.raised_m.is_some()).count());
    if options.until == Stage::Heights {
        return Ok(City::without_records(RunSummary { seconds, ..summary }));
    }

    let start = Instant::now();
    tell(Event::Stage(Stage::Output));
    let records = records((&settings.records, stage.scene.bounds), &survey, &footprints, &heights, reviews);
    let mut issues = all_issues(settings.origin.project, &survey, &footprints, &heights);
    issues.extend(reviews.unmatched(records.as_slice())?);
    issues.extend(cityjson::check(&records)?);
    let moved_survey = heights.moved(&survey).into_owned();
    let painted = textures::of_run(output, &records, &moved_survey, &stage)?;
    issues.extend(painted.iter().flat_map(|(_, textures)| textures.issues.iter().cloned()));
    sum_up(&mut summary, &records, &mut issues);
    let priors = priors.map_or_else(|| PriorStore::open(&settings.heights, &survey, &stage), Ok)?;
    let survey = moved_survey;
    let lineage = lineage(settings, &options.command, &survey, &heights, priors.source())?;
    let model = CityModel {
        records: records.as_slice(),
        crs: settings.survey.crs,
        lineage: &lineage,
        issues: &issues,
        survey: &survey,
    };
    // From here on results of another run may be replaced, one after the other.
    mark.replace()?;
    write_results(output, &model, &summary)?;
    textures::write_or_remove(output, &model, painted.as_ref())?;
    if output.config.pictures {
        pictures::write(output.folder.path(), &model, &stage, &heights, &priors)?;
    }
    if output.config.report.page {
        report::write((output, &settings.heights), &model, &stage, &heights, &footprints.levels, &priors)?;
    }
    timed(Stage::Output, start);
    Ok(City { summary: RunSummary { seconds, ..summary }, records, issues })
}

/// Writes and counts the issues of a run that ends with the footprints: later stages would write them with their own.
fn sum_up_without_heights(
    settings: &RunSettings<'_>,
    survey: &Survey,
    footprints: &FootprintStage,
    summary: &mut RunSummary,
) -> Result<(), PipelineError> {
    let unseen = unseen(&settings.footprints.places, survey, footprints)?;
    summary.worst = unseen.as_ref().map(|issue| issue.message.clone());
    let all = survey.issues.iter().chain(&footprints.layer.issues).chain(&footprints.issues);
    let found: Vec<Issue> = all.cloned().chain(unseen).collect();
    summary.count_issues(&found);
    let folder = settings.output.folder;
    let file = beside_results(folder, Stage::Footprints, "issues.json");
    write_issues(&folder.join(&file), &found)?;
    summary.issues_in = (file != Path::new("issues.json")).then_some(file);
    Ok(())
}

/// Where a run that ends with `until` writes a file that lies beside results: those of an earlier run that are in the folder
/// keep theirs.
fn beside_results(folder: ResultFolder<'_>, until: Stage, name: &str) -> PathBuf {
    let has_results = || folder.join("summary.json").is_file();
    if until < Stage::Output && has_results() { Path::new("stages").join(name) } else { name.into() }
}

fn summary_of_survey(settings: &RunSettings<'_>, survey: &Survey) -> RunSummary {
    RunSummary {
        poses: survey_stage::in_words(survey),
        priors_from: settings.heights.prior.in_words(),
        output: settings.output.folder.path().to_owned(),
        n_views: survey.views.len(),
        n_oblique: survey.views.iter().filter(|v| v.kind() == ViewKind::Oblique).count(),
        n_refined: Some(0),
        ..RunSummary::default()
    }
}

/// Adds the issues of the records, sorts all by weight, and counts.
fn sum_up(summary: &mut RunSummary, records: &[BuildingRecord], issues: &mut Vec<Issue>) {
    issues.extend(unmeasured(records, issues));
    let implausible = CityDoubts::of(records).implausible();
    summary.implausible = implausible.iter().map(|issue| issue.message.clone()).collect();
    issues.extend(implausible);
    issues.sort_by_key(Issue::weight);
    summary.count_issues(issues);
    summary.worst = worst(records, issues);
    let count = StatusCount::of(records);
    summary.n_buildings = count.n_buildings();
    (summary.by_status, summary.parts_by_status) = (count.by_status(), count.parts);
    let known: Vec<f64> = records.iter().filter_map(|r| r.height_m).collect();
    summary.median_height_m = sizeup_heights::stats::median(&known);
}

/// Buildings of the input: one in several pieces is one.
fn n_buildings(footprints: &FootprintStage) -> usize {
    let layer = &footprints.layer;
    let found = layer.footprints.iter().map(|f| f.part_of.as_ref().unwrap_or(&f.id));
    let refused = layer.refused.iter().map(|f| f.part_of.as_ref().unwrap_or(&f.id));
    found.chain(refused).collect::<BTreeSet<_>>().len()
}
