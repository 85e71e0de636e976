//! `sizeup survey`: poses looked over, and poses in another form.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use geo::ConvexHull as _;
use serde::{Deserialize, Serialize};

use super::dtm::{self, DtmArgs};
use super::flags::{Flag, flag, put, text_of};
use super::ui::{ALIGNING, PHOTOS};
use super::{Failure, Global, Ui, print, print_json, print_lines};
use crate::pipeline;
use sizeup_footprints::{ContourSource as _, FootprintSource, MaskConfig, MaskFiles};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::{is_virtual, write_json};
use sizeup_geo::issue::Issue;
use sizeup_geo::limits::Limits;
use sizeup_geo::paths::resolved;
use sizeup_geo::terrain::{Terrain, TerrainConfig};
use sizeup_photos::align::{self, AlignConfig, AlignError, AlignReport, Aligned};
use sizeup_photos::quality;
use sizeup_results::output::picture;
use sizeup_survey::{
    self, CornerErrors, Format, GroundPolygons, Reading, Site, Survey, SurveyConfig, SurveyReport, Target, View,
    ViewKind,
};

/// Message where image footprints are wanted and nothing tells the height of the ground.
const NO_GROUND: &str = "no --dtm or --ground: image footprints are taken on a ground of 0 m";
/// Advice on poses that look wrong.
const ACCEPT: &str = "nothing is written\nhint: `--set survey.accept_unsound=true` converts them all the same";
/// The poses look wrong.
const EXIT_UNSOUND: u8 = 3;

/// Subcommands of `sizeup survey`.
#[derive(Debug, Clone, Subcommand)]
pub enum SurveyCommand {
    /// Say what a survey holds and whether its poses look right. Exit code 3 if they do not.
    Inspect(InspectSurveyArgs),
    /// Bring poses that are nearly right to agree with the photos: guided matching and bundle adjustment.
    Align(AlignArgs),
    /// Write a survey's poses for other tools: COLMAP text, CSV, or GIS layers of cameras, axes, image footprints.
    Convert(ConvertArgs),
    /// Make a terrain model from the photos, for a place that has none.
    Dtm(DtmArgs),
    /// List the formats that can be read, by their names in `survey.format`.
    Formats,
}

/// Where the poses are and what their numbers mean: a configuration file, or flags, or flags over a file.
#[derive(Debug, Clone, Args)]
pub struct SourceArgs {
    /// Poses: a file, or the folder of a model or of photos. Several are looked at one after the other.
    #[arg(required_unless_present = "config", value_name = "PATH")]
    pub paths: Vec<PathBuf>,
    /// Configuration of `sizeup run` (TOML): its [survey], [terrain], [footprints] and project.crs are used.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// The project's projected CRS, such as EPSG:25832 or, with heights, EPSG:7415.
    #[arg(long, value_name = "CRS", required_unless_present = "config")]
    pub crs: Option<String>,
    /// CRS of the poses (default: what the file says, else the project's).
    #[arg(long, value_name = "CRS")]
    pub pose_crs: Option<String>,
    /// Format of the poses, as `survey.format` (default: found from the files).
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<String>,
    /// Folder of the photos, matched to the poses by name.
    #[arg(long, value_name = "FOLDER")]
    pub images: Option<PathBuf>,
    /// Added to every position: easting, northing, height.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three_numbers)]
    pub offset: Option<[f64; 3]>,
    /// Terrain model: heights above ground are checked with it.
    #[arg(long, value_name = "FILE", conflicts_with = "ground")]
    pub dtm: Option<PathBuf>,
    /// One ground height everywhere, metres.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub ground: Option<f64>,
    /// Set one key, as in `--set survey.csv.angles=pok`. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
}

/// Arguments of `sizeup survey inspect`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup survey inspect sparse --crs EPSG:25832 --dtm dtm.tif --footprints blocks.gpkg --picture survey.png
  sizeup survey inspect photos --crs EPSG:25832 --set survey.height.geoid_offset=44.1
  sizeup survey inspect --config sizeup.toml --json
  sizeup survey inspect poses.csv --crs EPSG:7415 --set survey.csv.name=image_id \\
             --compare-footprints polygons.geojson --id-field image_id

Exit code 0: the poses look right. 3: they look wrong, or cannot be read.")]
pub struct InspectSurveyArgs {
    #[command(flatten)]
    source: SourceArgs,
    /// Footprints of the area of interest: at least half of the photos have to look at it.
    #[arg(long, value_name = "FILE")]
    footprints: Option<PathBuf>,
    /// Draw the cameras, what they look at and their image footprints as a map.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Look at every photo too, and name those that are blurred, burnt out or black.
    #[arg(long)]
    photos: bool,
    /// Polygons of where the photos are known to look: say how far the image corners are from theirs.
    #[arg(long, value_name = "FILE")]
    compare_footprints: Option<PathBuf>,
    /// Attribute of these polygons that holds the photos' names.
    #[arg(long, value_name = "NAME", default_value = "image_id")]
    id_field: String,
}

/// Arguments of `sizeup survey convert`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup survey convert block.xml --crs EPSG:25832 --output model          a COLMAP text model
  sizeup survey convert block.xml --crs EPSG:25832 --output poses.csv
  sizeup survey convert sparse --crs EPSG:2180 --offset 634000,485000,0 --ground 110 --output survey.gpkg

COLMAP and CSV come with a survey.toml that reads them back.")]
pub struct ConvertArgs {
    #[command(flatten)]
    source: SourceArgs,
    /// Format to write (default: by the output's extension; a folder is a COLMAP model).
    #[arg(long, value_enum)]
    to: Option<TargetArg>,
    /// File or folder to write.
    #[arg(long, short, value_name = "PATH")]
    output: PathBuf,
}

/// Arguments of `sizeup survey align`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup survey align --config sizeup.toml --output aligned
  sizeup survey align photos --crs EPSG:25832 --ground 80 --output aligned
  sizeup survey align --config sizeup.toml --output aligned --set align.position_sigma_m=0.1 --set align.angle_sigma_deg=0.3

The folder gets a COLMAP text model with the survey.toml that reads it, poses.csv and align.json, the report. Poses that the photos do
not better stay as they came. It is no structure from motion: poses have to be right to a metre and a degree or so.")]
pub struct AlignArgs {
    #[command(flatten)]
    source: SourceArgs,
    /// Folder to write the adjusted poses into.
    #[arg(long, short, value_name = "FOLDER")]
    output: PathBuf,
}

/// A target on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum TargetArg {
    /// A COLMAP text model: a folder.
    Colmap,
    /// A table with quaternions and complete cameras.
    Csv,
    /// Three GIS layers in the project's CRS.
    Gpkg,
    /// Three GIS layers in longitude and latitude: a folder.
    Geojson,
}

impl From<TargetArg> for Target {
    fn from(target: TargetArg) -> Self {
        match target {
            TargetArg::Colmap => Self::Colmap,
            TargetArg::Csv => Self::Csv,
            TargetArg::Gpkg => Self::GeoPackage,
            TargetArg::Geojson => Self::GeoJson,
        }
    }
}

/// The tables of a run's configuration that matter here; the others are passed over.
#[derive(Debug, Clone, Deserialize)]
struct RunTables {
    project: ProjectTable,
    survey: SurveyConfig,
    #[serde(default)]
    terrain: Option<TerrainConfig>,
    #[serde(default)]
    footprints: Option<FootprintSource>,
    #[serde(default)]
    limits: Limits,
    #[serde(default)]
    align: AlignConfig,
}

#[derive(Debug, Clone, Deserialize)]
struct ProjectTable {
    crs: Crs,
}

pub(super) fn three_numbers(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    numbers.ok().and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| "expected x,y,z".to_owned())
}

/// Findings of one survey.
#[derive(Serialize)]
struct Inspected {
    is_sound: bool,
    #[serde(flatten)]
    report: SurveyReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    corner_errors: Option<CornerErrors>,
}

pub(super) fn run(command: &SurveyCommand, global: &Global) -> Result<u8, Failure> {
    match command {
        SurveyCommand::Inspect(args) => inspect_all(args, global),
        SurveyCommand::Align(args) => align(args, global),
        SurveyCommand::Convert(args) => convert(args, global),
        SurveyCommand::Dtm(args) => dtm::run(args, global),
        SurveyCommand::Formats => formats(global),
    }
}

fn formats(global: &Global) -> Result<u8, Failure> {
    let all: Vec<(String, &str)> = Format::all().map(|(format, about)| (format.name(), about)).collect();
    if global.json {
        print_json(
            &all.iter().map(|(name, about)| serde_json::json!({"name": name, "about": about})).collect::<Vec<_>>(),
        )?;
    } else {
        all.iter().try_for_each(|(name, about)| print(&format_args!("{name:<18}{about}")))?;
    }
    Ok(0)
}

fn inspect_all(args: &InspectSurveyArgs, global: &Global) -> Result<u8, Failure> {
    let all: Result<Vec<Inspected>, Failure> = settings(&args.source, args.footprints.as_deref())?
        .iter()
        .map(|settings| inspect(settings, args, global))
        .collect();
    let all = all?;
    match all.as_slice() {
        [only] if global.json => print_json(only)?,
        several if global.json => print_json(&several)?,
        _ => {}
    }
    Ok(if all.iter().all(|inspected| inspected.is_sound) { 0 } else { EXIT_UNSOUND })
}

fn inspect(settings: &RunTables, args: &InspectSurveyArgs, global: &Global) -> Result<Inspected, Failure> {
    let bad_input = |e: &dyn std::error::Error| Failure::new(3, e);
    let ui = Ui::new(global);
    let crs = &settings.project.crs;
    let area = area_of(settings, args, &ui)?;
    let reading = Reading::of(&settings.survey, crs).map_err(|e| bad_input(&e))?;
    let ground = terrain_of(settings, reading.survey())?;
    if let Some(FootprintSource::Masks(masks)) = &settings.footprints {
        tell_masks(masks, reading.survey(), &ui)?;
    }
    let mut report = reading.report(Site { terrain: ground.as_ref(), area: area.as_ref() });
    if args.photos {
        report.issues.extend(looked_at(&reading.survey().views, &ui)?);
    }
    let corner_errors = match &args.compare_footprints {
        Some(path) => {
            let polygons = GroundPolygons::read(path, &args.id_field, crs).map_err(|e| bad_input(&e))?;
            Some(polygons.compare(reading.survey(), ground.as_ref().unwrap_or(&Terrain::Constant(0.0))))
        }
        None => None,
    };
    if !global.json {
        print_lines(&report)?;
        if let Some(errors) = &corner_errors {
            print_lines(errors)?;
        }
    }
    if ground.is_none() && (args.picture.is_some() || corner_errors.is_some()) {
        ui.say(NO_GROUND);
    }
    if let Some(path) = &args.picture {
        let map = picture::survey_map(reading.survey(), ground.as_ref(), crs);
        picture::write_png(path, &map).map_err(|e| Failure::new(4, &e))?;
    }
    Ok(Inspected { is_sound: report.is_sound(), report, corner_errors })
}

/// Issues that the photos themselves show.
fn looked_at(views: &[View], ui: &Ui) -> Result<Vec<Issue>, Failure> {
    if views.iter().all(|view| view.image.is_none()) {
        return Err(Failure::from_text(
            2,
            "--photos: the survey names no photos\nhint: `--images FOLDER` says where they are",
        ));
    }
    let told = quality::look(views, &|done, total| ui.advance_named(PHOTOS, done, total));
    ui.finish();
    Ok(told)
}

/// The hull of the footprints. A configuration may name footprints that are still to come: then there is no area.
fn area_of(settings: &RunTables, args: &InspectSurveyArgs, ui: &Ui) -> Result<Option<geo::Polygon>, Failure> {
    let Some(FootprintSource::Layer(config)) = &settings.footprints else { return Ok(None) };
    if args.footprints.is_none() && !config.path.exists() {
        ui.say(format!("{} is not there: nothing to hold the image centres against", config.path.display()));
        return Ok(None);
    }
    let layer = sizeup_footprints::read(config, &settings.project.crs).map_err(|e| Failure::new(3, &e))?;
    let footprints: Vec<_> = layer.footprints.into_iter().map(|f| f.polygon).collect();
    Ok(Some(geo::MultiPolygon::new(footprints).convex_hull()))
}

/// How many of the nadir photos have the mask that a run would look for.
fn tell_masks(masks: &MaskConfig, survey: &Survey, ui: &Ui) -> Result<(), Failure> {
    let masks = MaskFiles::new(masks.clone()).map_err(|e| Failure::new(3, &e))?;
    let nadir: Vec<&View> = survey.views.iter().filter(|v| v.kind() == ViewKind::Nadir).collect();
    let absent: Vec<&&View> = nadir.iter().filter(|view| !masks.is_there(view)).collect();
    ui.say(format!("masks: {} of {} nadir photos have one", nadir.len() - absent.len(), nadir.len()));
    if let Some(first) = absent.first() {
        let place = masks.file_of(first).map_or_else(String::new, |path| format!(": looked for {}", path.display()));
        ui.say(format!("{} has none{place}", first.id));
    }
    Ok(())
}

fn convert(args: &ConvertArgs, global: &Global) -> Result<u8, Failure> {
    let all = settings(&args.source, None)?;
    let [settings] = all.as_slice() else {
        return Err(Failure::from_text(2, "convert takes one survey at a time"));
    };
    let target = args.to.map_or_else(|| Target::of_path(&args.output), Target::from);
    let ui = Ui::new(global);
    let crs = &settings.project.crs;
    let reading = Reading::of(&settings.survey, crs).map_err(|e| Failure::new(3, &e))?;
    let ground = terrain_of(settings, reading.survey())?;
    let report = reading.report(Site { terrain: ground.as_ref(), area: None });
    if !report.is_sound() && !settings.survey.accept_unsound {
        return Err(Failure::from_text(EXIT_UNSOUND, format!("{report}{ACCEPT}")));
    }
    let survey = reading.into_survey();
    if ground.is_none() && matches!(target, Target::GeoJson | Target::GeoPackage) {
        ui.say(NO_GROUND);
    }
    let terrain = ground.unwrap_or(Terrain::Constant(0.0));
    let converted =
        sizeup_survey::write(&survey, crs, &terrain, target, &args.output).map_err(|e| Failure::new(4, &e))?;
    for issue in survey.issues.iter().chain(&converted.issues) {
        ui.say(format!("{}: {}", issue.code, issue.message));
    }
    let n_written = survey.views.len().saturating_sub(converted.issues.len());
    ui.say(format!("{n_written} of {} views written", survey.views.len()));
    if global.json {
        print_json(&serde_json::json!({
            "files": converted.files, "n_views": survey.views.len(),
            "issues": survey.issues.iter().chain(&converted.issues).collect::<Vec<_>>(),
        }))?;
    } else {
        converted.files.iter().try_for_each(|file| print(&file.display()))?;
    }
    Ok(0)
}

fn align(args: &AlignArgs, global: &Global) -> Result<u8, Failure> {
    let all = settings(&args.source, None)?;
    let [settings] = all.as_slice() else {
        return Err(Failure::from_text(2, "align takes one survey at a time"));
    };
    let (ui, crs) = (Ui::new(global), &settings.project.crs);
    let survey = sizeup_survey::read(&settings.survey, crs).map_err(|e| Failure::new(3, &e))?;
    let Some(terrain) = terrain_of(settings, &survey)? else {
        return Err(Failure::new(3, &AlignError::NoTerrain));
    };
    let started = std::time::Instant::now();
    let tell = |done, total| ui.advance_named(ALIGNING, done, total);
    let aligned = align::align(&survey.views, &terrain, &settings.align, None, &tell);
    ui.finish();
    let Aligned { views, report } = aligned.map_err(|e| Failure::new(if e.is_usage() { 2 } else { 3 }, &e))?;
    let survey = Survey { views, issues: survey.issues };
    write_aligned(&survey, &report, &terrain, crs, &args.output)?;
    if global.json {
        print_json(&report)?;
    } else {
        print_lines(&report)?;
    }
    ui.say(format!("{:.0} s", started.elapsed().as_secs_f64()));
    ui.say(format!(
        "next: put {} in place of [survey] in the configuration",
        args.output.join("survey.toml").display()
    ));
    Ok(0)
}

/// The model, the table and the report.
fn write_aligned(
    survey: &Survey,
    report: &AlignReport,
    terrain: &Terrain,
    crs: &Crs,
    folder: &Path,
) -> Result<(), Failure> {
    std::fs::create_dir_all(folder)
        .map_err(|e| Failure::from_text(4, format!("cannot make the folder {}: {e}", folder.display())))?;
    for (target, path) in [(Target::Colmap, folder.to_owned()), (Target::Csv, folder.join("poses.csv"))] {
        sizeup_survey::write(survey, crs, terrain, target, &path).map_err(|e| Failure::new(4, &e))?;
    }
    write_json(&folder.join("align.json"), report).map_err(|e| Failure::new(4, &e))
}

/// The ground around the cameras, where one is given.
fn terrain_of(settings: &RunTables, survey: &Survey) -> Result<Option<Terrain>, Failure> {
    let Some(config) = &settings.terrain else { return Ok(None) };
    pipeline::terrain_around(config, &settings.project.crs, &survey.views).map_err(|e| Failure::new(3, &e))
}

/// The settings of each path, or those of the configuration file.
fn settings(args: &SourceArgs, footprints: Option<&Path>) -> Result<Vec<RunTables>, Failure> {
    if args.paths.is_empty() {
        return Ok(vec![settings_of(args, None, footprints)?]);
    }
    args.paths.iter().map(|path| settings_of(args, Some(path), footprints)).collect()
}

/// File and flags as one text, so that there is one way to read settings.
fn settings_of(args: &SourceArgs, path: Option<&Path>, footprints: Option<&Path>) -> Result<RunTables, Failure> {
    let usage = |e: &dyn std::error::Error| Failure::new(2, e);
    let text = match &args.config {
        Some(file) => std::fs::read_to_string(file)
            .map_err(|e| Failure::from_text(2, format!("cannot read {}: {e}", file.display())))?,
        None => String::new(),
    };
    let flags = flags(args, path, footprints)?;
    let name = args.config.as_deref().unwrap_or(Path::new("command line"));
    let text = if flags.is_empty() {
        text
    } else {
        let mut table: toml::Table = crate::config::parse(&text, Some(name), &[]).map_err(|e| usage(&e))?;
        make_room(&mut table, args, footprints);
        put(&mut table, flags);
        table.to_string()
    };
    let mut settings: RunTables = crate::config::parse(&text, Some(name), &args.assignments).map_err(|e| usage(&e))?;
    settings.limits.set();
    let folder = args.config.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    let resolve = &mut |path: &mut PathBuf| *path = resolved(folder, path);
    settings.survey.visit_paths(resolve);
    settings.terrain.iter_mut().filter_map(|terrain| terrain.dtm.as_mut()).for_each(&mut *resolve);
    settings.footprints.iter_mut().for_each(|footprints| footprints.visit_paths(resolve));
    Ok(settings)
}

/// Takes out of the file what a flag stands against: footprints of another source, ground of another kind.
fn make_room(table: &mut toml::Table, args: &SourceArgs, footprints: Option<&Path>) {
    if footprints.is_some() {
        table.remove("footprints");
    }
    if let Some(terrain) = table.get_mut("terrain").and_then(toml::Value::as_table_mut) {
        if args.dtm.is_some() {
            terrain.remove("constant_m");
        }
        if args.ground.is_some() {
            terrain.remove("dtm");
        }
    }
}

/// Settings that the flags stand for: table, key, value. Paths become absolute: those of a file are relative to the file.
fn flags(args: &SourceArgs, path: Option<&Path>, footprints: Option<&Path>) -> Result<Vec<Flag>, Failure> {
    let absolute = |path: &Path| -> Result<String, Failure> {
        // An address would lose one of its slashes.
        let path = if is_virtual(path) { Ok(path.to_owned()) } else { std::path::absolute(path) };
        let path = path.map_err(|e| Failure::new(2, &e))?;
        Ok(text_of(&path))
    };
    let all = [
        flag("survey", "path", path.map(absolute).transpose()?),
        flag("survey", "images", args.images.as_deref().map(absolute).transpose()?),
        flag("terrain", "dtm", args.dtm.as_deref().map(absolute).transpose()?),
        flag("footprints", "path", footprints.map(absolute).transpose()?),
        flag("project", "crs", args.crs.clone()),
        flag("survey", "crs", args.pose_crs.clone()),
        flag("survey", "format", args.format.clone()),
        flag("survey", "offset", args.offset.map(|offset| offset.to_vec())),
        flag("terrain", "constant_m", args.ground),
    ];
    Ok(all.into_iter().flatten().collect())
}
