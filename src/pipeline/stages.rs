//! The stages, one function each, and the loop over them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

use geo_types::Polygon;
use glam::DVec3;

use super::dtm::{self, terrain_in_force};
use super::footprints_off::{moved_footprints, shifted_layer};
use super::frame::{Frame, origin};
use super::heights::{HeightSearch, moved};
use super::input::{check_fallback, check_settings, check_views, height_bounds, unseen};
use super::kept::PriorStore;
use super::parts::split_footprints;
use super::records::records;
use super::textures;
use super::worst::worst;
use super::{City, Event, FootprintStage, HeightStage, PipelineError, RunOptions, RunSummary, Solver, Stage, Tell};
use super::{artefact, footprints, ground_told, pictures, poses, report, soundness};
use crate::config::RunConfig;
use sizeup_geo::files::{FileError, write_json, write_whole};
use sizeup_geo::geodata::source;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::{self, GroundLevel, LoadedTerrain, MapBox, Terrain};
use sizeup_geo::unfinished::Unfinished;
use sizeup_heights::estimate::move_footprints;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::optimise::{DisagreeingView, LevelOff, PriorShape, Solution};
use sizeup_heights::scene::Scene;
use sizeup_photos::prior::Priors;
use sizeup_results::output::plausible::CityDoubts;
use sizeup_results::output::reports::write_issues;
use sizeup_results::output::reviews::Reviews;
use sizeup_results::output::unmeasured::unmeasured;
use sizeup_results::output::{
    BuildingRecord, CityModel, InputFile, Lineage, StatusCount, cityjson, geopackage, sha256_hex,
};
use sizeup_survey::{Survey, ViewKind};

pub(super) fn run(
    config: &RunConfig,
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
    check_settings(config)?;
    let reviews = reviews_of(config)?;
    // Whoever looks into the folder before the end is told, and so is who looks there after a run was killed.
    let start = if options.until < Stage::Output { Unfinished::start_beside_others } else { Unfinished::start };
    let mut mark = start(&config.project.output, &options.command)?;
    let city = run_marked(config, options, &reviews, (tell, solver), &mut mark).and_then(|city| {
        let seconds: BTreeMap<&str, f64> = city.summary.seconds.iter().map(|(stage, s)| (stage.as_str(), *s)).collect();
        write_json(&config.project.output.join(beside_results(config, options.until, "timing.json")), &seconds)?;
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
    config: &RunConfig,
    options: &RunOptions,
    reviews: &Reviews,
    (tell, solver): (Tell<'_>, Solver<'_>),
    mark: &mut Unfinished,
) -> Result<City, PipelineError> {
    let mut seconds = Vec::new();
    let mut timed =
        |stage: Stage, start: Instant| seconds.push((stage.name().to_owned(), start.elapsed().as_secs_f64()));
    let runs = |stage: Stage| options.from <= stage && stage <= options.until;

    let (start, mut reading) = (Instant::now(), None);
    let mut survey: Survey = if runs(Stage::Survey) {
        tell(Event::Stage(Stage::Survey));
        // A terrain model is read around the footprints: with it, the survey is looked over once more.
        let ground = config.terrain.constant_m.map(Terrain::Constant);
        let survey = soundness::look_over(config, reading.insert(soundness::read(config)?), ground.as_ref())?;
        let survey = poses::fitted(config, poses::looked_at(config, survey, tell), tell)?;
        artefact::write_survey(config, &survey)?;
        timed(Stage::Survey, start);
        survey
    } else {
        artefact::read_survey(config)?
    };
    let mut summary = summary_of_survey(config, &survey);
    if options.until == Stage::Survey {
        return Ok(City::without_records(RunSummary { seconds, ..summary }));
    }

    let start = Instant::now();
    let mut footprints: FootprintStage = if runs(Stage::Footprints) {
        tell(Event::Stage(Stage::Footprints));
        dtm::for_run(config, &survey, tell)?;
        let (footprints, terrain) = footprints::read(config, &survey)?;
        if matches!(terrain, Terrain::Grid(_)) {
            let reading = reading.take().map_or_else(|| soundness::read(config), Ok)?;
            survey = poses::as_before(soundness::look_over(config, &reading, Some(&terrain))?, survey);
            // What the ground told of the poses, and was accepted, is for the later stages too.
            artefact::write_survey(config, &survey)?;
        }
        artefact::write(config, Stage::Footprints, &survey, &footprints)?;
        timed(Stage::Footprints, start);
        footprints
    } else {
        artefact::read(config, Stage::Footprints, &survey)?
    };
    check_fallback(config, footprints.layer.footprints.iter().map(|footprint| &footprint.attributes))?;
    summary.n_buildings = n_buildings(&footprints);
    summary.detection.clone_from(&footprints.detection);
    if options.until == Stage::Footprints {
        sum_up_without_heights(config, &survey, &footprints, &mut summary)?;
        return Ok(City::without_records(RunSummary { seconds, ..summary }));
    }

    let start = Instant::now();
    let (heights, stage, priors) = if runs(Stage::Heights) {
        tell(Event::Stage(Stage::Heights));
        let search = HeightSearch::new(config, &survey, tell, solver);
        let (heights, stage, priors) = search.run(&mut footprints)?;
        artefact::write(config, Stage::Heights, &survey, &heights)?;
        timed(Stage::Heights, start);
        (heights, stage, Some(priors))
    } else {
        let heights: HeightStage = artefact::read(config, Stage::Heights, &survey)?;
        heights.check_positions(config, &survey, &footprints)?;
        let (heights, stage) = SceneStage::of_heights(config, &survey, &mut footprints, heights)?;
        (heights, stage, None)
    };
    summary.n_used_views = heights.solution.used_views.len();
    summary.n_refined = Some(heights.solution.heights.iter().filter(|solved| solved.raised_m.is_some()).count());
    if options.until == Stage::Heights {
        return Ok(City::without_records(RunSummary { seconds, ..summary }));
    }

    let start = Instant::now();
    tell(Event::Stage(Stage::Output));
    let records = records((config, stage.scene.bounds), &survey, &footprints, &heights, reviews);
    let mut issues = all_issues(config, &survey, &footprints, &heights);
    issues.extend(reviews.unmatched(records.as_slice())?);
    issues.extend(cityjson::check(&records)?);
    let moved_survey = moved(&survey, heights.moved_m()).into_owned();
    let painted = textures::of_run(config, &records, &moved_survey, &stage)?;
    issues.extend(painted.iter().flat_map(|(_, textures)| textures.issues.iter().cloned()));
    sum_up(&mut summary, &records, &mut issues);
    let priors = priors.map_or_else(|| PriorStore::open(config, &survey, &stage), Ok)?;
    let survey = moved_survey;
    let lineage = lineage(config, options, &survey, &heights, priors.source())?;
    let model = CityModel {
        records: records.as_slice(),
        crs: &config.project.crs,
        lineage: &lineage,
        issues: &issues,
        survey: &survey,
    };
    // From here on results of another run may be replaced, one after the other.
    mark.replace()?;
    write_results(config, &model, &summary)?;
    textures::write_or_remove(config, &model, painted.as_ref())?;
    if config.output.pictures {
        pictures::write(&config.project.output, &model, &stage, &heights, &priors)?;
    }
    if config.output.report.page {
        report::write(config, &model, &stage, &heights, &footprints.levels, &priors)?;
    }
    timed(Stage::Output, start);
    Ok(City { summary: RunSummary { seconds, ..summary }, records, issues })
}

/// Writes and counts the issues of a run that ends with the footprints: later stages would write them with their own.
fn sum_up_without_heights(
    config: &RunConfig,
    survey: &Survey,
    footprints: &FootprintStage,
    summary: &mut RunSummary,
) -> Result<(), PipelineError> {
    let unseen = unseen(config, survey, footprints)?;
    summary.worst = unseen.as_ref().map(|issue| issue.message.clone());
    let all = survey.issues.iter().chain(&footprints.layer.issues).chain(&footprints.issues);
    let found: Vec<Issue> = all.cloned().chain(unseen).collect();
    summary.count_issues(&found);
    let file = beside_results(config, Stage::Footprints, "issues.json");
    write_issues(&config.project.output.join(&file), &found)?;
    summary.issues_in = (file != Path::new("issues.json")).then_some(file);
    Ok(())
}

/// Where a run that ends with `until` writes a file that lies beside results: those of an earlier run that are in the folder
/// keep theirs.
fn beside_results(config: &RunConfig, until: Stage, name: &str) -> PathBuf {
    let has_results = || config.project.output.join("summary.json").is_file();
    if until < Stage::Output && has_results() { Path::new("stages").join(name) } else { name.into() }
}

/// Decisions of people about single buildings; read first, so that a file that cannot be used is told before hours of
/// computing.
///
/// # Errors
/// [`PipelineError::Reviews`].
pub fn reviews_of(config: &RunConfig) -> Result<Reviews, PipelineError> {
    Ok(config.reviews.as_ref().map(|reviews| Reviews::read(&reviews.path)).transpose()?.unwrap_or_default())
}

fn summary_of_survey(config: &RunConfig, survey: &Survey) -> RunSummary {
    RunSummary {
        poses: poses::in_words(survey),
        priors_from: config.prior.in_words(),
        output: config.project.output.clone(),
        n_views: survey.views.len(),
        n_oblique: survey.views.iter().filter(|v| v.kind() == ViewKind::Oblique).count(),
        n_refined: Some(0),
        ..RunSummary::default()
    }
}

/// Box around footprints, map frame, metres.
pub(super) fn extent<'a>(polygons: impl Iterator<Item = &'a Polygon<f64>>) -> Option<MapBox> {
    let corners = polygons.filter_map(geo::BoundingRect::bounding_rect).flat_map(|rect| [rect.min(), rect.max()]);
    MapBox::around(corners.map(|c| (c.x, c.y)))
}

pub(super) fn load_terrain<'a>(
    config: &RunConfig,
    polygons: impl Iterator<Item = &'a Polygon<f64>>,
    margin_m: f64,
) -> Result<LoadedTerrain, PipelineError> {
    let Some(area) = extent(polygons) else {
        return Err(PipelineError::Mismatch {
            message: "none of the input's buildings has a usable footprint".to_owned(),
            hint: "issues of the footprints stage tell why, building by building",
        });
    };
    Ok(terrain::load_with_issues(&terrain_in_force(config), &config.project.crs, area.grown(margin_m))?)
}

fn on_known_ground(footprints: &FootprintStage) -> Vec<(&Polygon<f64>, GroundLevel)> {
    let on_ground = footprints.layer.footprints.iter().zip(&footprints.ground);
    on_ground.filter_map(|(footprint, ground)| Some((&footprint.polygon, (*ground)?))).collect()
}

/// The ground that rays meet around the buildings on known ground; there has to be one.
pub(super) fn terrain_around(
    config: &RunConfig,
    frame: &Frame,
    footprints: &FootprintStage,
) -> Result<Terrain, PipelineError> {
    let on_ground = on_known_ground(footprints);
    // What is to be said of it was said when footprints were put onto it.
    let loaded = load_terrain(config, on_ground.iter().map(|(polygon, _)| *polygon), frame.bounds.ground_margin_m())?;
    Ok(loaded.terrain)
}

/// The same as the photos correct it.
fn corrected_terrain_around(
    config: &RunConfig,
    frame: &Frame,
    footprints: &FootprintStage,
) -> Result<Terrain, PipelineError> {
    let terrain = terrain_around(config, frame, footprints)?;
    let on_ground = on_known_ground(footprints);
    let area = extent(on_ground.iter().map(|(polygon, _)| *polygon));
    let area = area.map(|area| area.grown(frame.bounds.ground_margin_m()));
    Ok(area.and_then(|area| footprints.told.corrected(config, &terrain, area)).unwrap_or(terrain))
}

/// Corrects the ground levels of footprints to those that a run found heights over. Returns its terrain.
///
/// # Errors
/// [`PipelineError`]: the terrain cannot be read.
pub fn correct_ground(
    config: &RunConfig,
    survey: &Survey,
    footprints: &mut FootprintStage,
    heights: &HeightStage,
) -> Result<Terrain, PipelineError> {
    footprints::correct_ground(config, footprints, heights.ground.clone())?;
    Ok(SceneStage::new(config, survey, footprints)?.terrain)
}

/// Everything that rays meet, and what they are compared with.
pub(super) struct SceneStage {
    /// The buildings whose ground is known.
    pub scene: Scene,
    /// Their positions in the layer.
    pub solved: Vec<usize>,
    /// Ground around the buildings.
    pub terrain: Terrain,
    /// From one place where the ground is looked at in the photos to the next, metres.
    pub ground_spacing_m: f64,
}

impl SceneStage {
    pub fn new(config: &RunConfig, survey: &Survey, footprints: &FootprintStage) -> Result<Self, PipelineError> {
        let bounds = height_bounds(config, check_views(config, survey, footprints)?)?;
        let area = extent(footprints.layer.footprints.iter().map(|f| &f.polygon));
        let (origin, ground_spacing_m) =
            area.map_or((LocalOrigin(DVec3::ZERO), 0.0), |area| (origin(survey, area), ground_told::spacing_m(area)));
        Self::in_frame(config, &Frame { origin, bounds, ground_spacing_m }, footprints)
    }

    /// The same over the terrain as the photos correct it, which they are looked at for.
    pub fn on_measured_ground(
        config: &RunConfig,
        survey: &Survey,
        footprints: &mut FootprintStage,
    ) -> Result<Self, PipelineError> {
        let given = Self::new(config, survey, footprints)?;
        let told = ground_told::look(config, survey, footprints, &given, None);
        footprints::correct_ground(config, footprints, told)?;
        Self::new(config, survey, footprints)
    }

    /// The same in a frame that is given.
    pub fn in_frame(config: &RunConfig, frame: &Frame, footprints: &FootprintStage) -> Result<Self, PipelineError> {
        let terrain = corrected_terrain_around(config, frame, footprints)?;
        Ok(Self::over(terrain, frame, footprints))
    }

    fn over(terrain: Terrain, frame: &Frame, footprints: &FootprintStage) -> Self {
        let solved: Vec<usize> = (0..footprints.ground.len()).filter(|&i| footprints.ground[i].is_some()).collect();
        let margin_m = frame.bounds.ground_margin_m();
        let scene = Scene::at(frame.origin, &on_known_ground(footprints), &terrain, frame.bounds, margin_m);
        Self { scene, solved, terrain, ground_spacing_m: frame.ground_spacing_m }
    }

    /// The scene of heights that were found, on the ground that they were found over.
    pub fn of_heights(
        config: &RunConfig,
        survey: &Survey,
        footprints: &mut FootprintStage,
        mut heights: HeightStage,
    ) -> Result<(HeightStage, Self), PipelineError> {
        footprints::correct_ground(config, footprints, heights.ground.clone())?;
        let mut stage = Self::new(config, survey, footprints)?;
        stage.split(footprints, &mut heights);
        Ok((heights, stage))
    }

    /// Splits the footprints into the parts that heights were found for, and moves those that the photos show elsewhere.
    pub fn split(&mut self, footprints: &mut FootprintStage, heights: &mut HeightStage) {
        heights.solved = split_footprints(footprints, heights);
        if !heights.splits.is_empty() {
            *self = Self::over(self.terrain.clone(), &self.frame(), footprints);
        }
        move_footprints(&mut self.scene, &heights.solution);
    }

    /// Frame of the scene.
    pub fn frame(&self) -> Frame {
        Frame { origin: self.scene.origin, bounds: self.scene.bounds, ground_spacing_m: self.ground_spacing_m }
    }
}

/// Views whose prior or photo could not be used, and doubts about all of them.
pub(super) fn view_issues<'a>(survey: &'a Survey, heights: &'a HeightStage) -> impl Iterator<Item = Issue> + 'a {
    let told = |severity, code, (view, reason): &(usize, String)| {
        let subject = Subject::View(survey.views[*view].id.0.clone());
        // A reason carries its advice on a line of its own.
        match reason.split_once("\nhint: ") {
            Some((reason, hint)) => Issue::new(severity, code, subject, reason).hint(hint),
            None => Issue::new(severity, code, subject, reason.clone()),
        }
    };
    let failed = heights.solution.failed_views.iter();
    let failed = failed.map(move |view| told(Severity::Refused, "prior_unusable", view));
    let unread = heights.unread_photos.iter().map(move |view| told(Severity::Warning, "photo_unreadable", view));
    failed
        .chain(unread)
        .chain(heights.doubt.clone())
        .chain(heights.solution.disagreeing_views.iter().map(|found| disagreeing_prior(survey, found)))
        .chain(bent_priors(&heights.solution))
        .chain(heights.layer_shift.map(|shift| shifted_layer(&shift)))
        .chain(heights.ground.issue())
        .chain(heights.level_off().map(|off| level_off(&off)))
}

/// A warning that a photo's prior does not show what stands there by all others.
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
pub fn unstated_reference(config: &RunConfig) -> Option<Issue> {
    (config.project.vertical_reference.is_none() && config.project.crs.vertical_name().is_none()).then(|| {
        let subject = Subject::Input("project".to_owned());
        let message = format!("{} has no vertical part, so the vertical datum is not stated", config.project.crs);
        Issue::new(Severity::Note, "vertical_reference_not_stated", subject, message)
            .hint("set project.vertical_reference, or use a compound CRS such as EPSG:7415")
    })
}

fn all_issues(config: &RunConfig, survey: &Survey, footprints: &FootprintStage, heights: &HeightStage) -> Vec<Issue> {
    let mut issues: Vec<Issue> = survey.issues.clone();
    issues.extend(footprints.layer.issues.iter().chain(&footprints.issues).cloned());
    issues.extend(view_issues(survey, heights).chain(unstated_reference(config)));
    issues.extend(moved_footprints(footprints, heights));
    issues
}

/// Adds the issues that the records tell of, puts all by weight, and counts.
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

fn lineage(
    config: &RunConfig,
    options: &RunOptions,
    survey: &Survey,
    heights: &HeightStage,
    priors: &Priors,
) -> Result<Lineage, PipelineError> {
    let mut files: BTreeSet<(&str, PathBuf)> = BTreeSet::new();
    files.extend(files_of(&config.survey.path).into_iter().map(|path| ("survey", path)));
    let footprint_files = footprints::files(config, survey);
    files.extend(footprint_files.iter().flat_map(|path| source::files_of(path)).map(|path| ("footprints", path)));
    let terrain = terrain_in_force(config);
    files.extend(terrain.dtm.iter().flat_map(|path| source::files_of(path)).map(|path| ("terrain", path)));
    files.extend(config.reviews.iter().map(|reviews| ("reviews", reviews.path.clone())));
    for &view in &heights.solution.used_views {
        files.extend(priors.file_of(&survey.views[view])?.map(|path| ("prior", path)));
    }
    let hashed = |(role, path): &(&str, PathBuf)| -> Result<InputFile, FileError> {
        let path_saved = config.saved_path(path).display().to_string();
        Ok(InputFile { path: path_saved, ..InputFile::hash(role, path)? })
    };
    let inputs: Result<Vec<InputFile>, FileError> =
        files.iter().filter(|(_, path)| path.is_file()).map(hashed).collect();
    Ok(lineage_of(config, &options.command, inputs?))
}

/// The origin of a result that was made from some files.
#[must_use]
pub fn lineage_of(config: &RunConfig, command: &str, inputs: Vec<InputFile>) -> Lineage {
    let vertical = config.project.vertical_reference.clone();
    Lineage {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: crate::recipe::commit().map(str::to_owned),
        command: command.to_owned(),
        config_sha256: sha256_hex(config.saved().to_toml().as_bytes()),
        inputs,
        crs: config.project.crs.definition().to_owned(),
        vertical_reference: vertical
            .or_else(|| config.project.crs.vertical_name().map(str::to_owned))
            .unwrap_or_else(|| "not stated".to_owned()),
        height_definition: format!(
            "roof level minus ground level; ground level: {}; roof level: mean over the roof",
            serde_json::to_string(&config.ground.reference).unwrap_or_default().trim_matches('"')
        ),
        seed: config.seed,
        reference_date: config.project.reference_date.clone(),
        source: None,
    }
}

/// The file itself, or the files of a folder.
#[must_use]
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    match std::fs::read_dir(path) {
        Ok(entries) => entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|p| p.is_file()).collect(),
        Err(_) => vec![path.to_owned()],
    }
}

fn write_results(config: &RunConfig, model: &CityModel<'_>, summary: &RunSummary) -> Result<(), PipelineError> {
    let folder = &config.project.output;
    cityjson::write(&folder.join("city.city.json"), model, &config.output.cityjson)?;
    geopackage::write(&folder.join("city.gpkg"), model, &config.output.geopackage)?;
    dtm::write_project(config, folder, "city.gpkg", model)?;
    write_issues(&folder.join("issues.json"), model.issues)?;
    write_json(&folder.join("lineage.json"), &model.lineage)?;
    summary.write(folder)?;
    write_whole(&folder.join(RunConfig::SAVED_NAME), |out| out.write_all(config.saved().to_toml().as_bytes()))?;
    Ok(())
}
