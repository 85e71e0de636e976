//! `sizeup run`: the whole path, or a part of it.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::flags::config_file;
use super::tiles::{CutArgs, PLAN, TilesetArgs, TrustArgs, config_of, failed, merge_city, say_plan};
use super::{Call, EXIT_FAILED, EXIT_FAILED_ITEMS, Failure, Global, Ui, counted, print_json};
use crate::config::RunConfig;
use crate::pipeline::{self, PipelineError, RunOptions, RunSummary, Stage};
use crate::tiles::{
    self, Attempt, Layout, Manifest, MergeOptions, Missing, PoolSettings, Tile, TileOutcome, TileState,
};
use sizeup_results::output::Status;

/// Where `--help` lists the options of tiled runs.
const TILED: &str = "With --tiled";
/// How often a tile that failed is tried again.
const N_RETRIES: usize = 1;

/// Arguments of `sizeup run`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup run                                  the sizeup.toml in this folder
  sizeup run sizeup.toml --set optimise.preset=paper --output result-paper
  sizeup run sizeup.toml --from output        write the results again, heights as they are
  sizeup run sizeup.toml --tiled --jobs 4     in parts, for areas that do not fit into memory

`sizeup init FOLDER` writes the configuration for a folder of photos.")]
pub struct RunArgs {
    /// Configuration file (TOML; default: sizeup.toml in this folder), or - for standard input, its paths relative to this folder.
    /// `sizeup schema run` lists its keys.
    pub config: Option<PathBuf>,
    /// Set one key of the configuration, as in `--set optimise.preset=paper`. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// Folder of the results, in place of the configuration's.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// First stage to run; earlier ones are read from the results' `stages` folder.
    #[arg(long, value_enum, default_value = "survey")]
    pub from: StageArg,
    /// Last stage to run.
    #[arg(long, value_enum, default_value = "output")]
    pub until: StageArg,
    /// Divide the area into tiles and run them in processes of their own: for areas that do not fit into memory.
    #[arg(long, conflicts_with_all = ["from", "until"])]
    pub tiled: bool,
    /// Tiles at a time, with --tiled; memory permitting. By default half the cores.
    #[arg(long, value_name = "N", requires = "tiled", help_heading = TILED)]
    pub jobs: Option<usize>,
    /// Memory that all tiles together may use, megabytes. By default what is free.
    #[arg(long, value_name = "MB", requires = "tiled", help_heading = TILED)]
    pub total_memory: Option<u64>,
    /// How the area is divided.
    #[command(flatten, next_help_heading = TILED)]
    pub cut: CutArgs,
    /// Heights in 3D Tiles.
    #[command(flatten, next_help_heading = TILED)]
    pub tileset: TilesetArgs,
    /// How much of what is known of files is believed.
    #[command(flatten, next_help_heading = TILED)]
    pub trust: TrustArgs,
}

/// A stage on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum StageArg {
    /// Poses into the project's CRS.
    Survey,
    /// Footprints onto the ground.
    Footprints,
    /// One height per building.
    Heights,
    /// Write the results.
    Output,
}

impl From<StageArg> for Stage {
    fn from(stage: StageArg) -> Self {
        match stage {
            StageArg::Survey => Self::Survey,
            StageArg::Footprints => Self::Footprints,
            StageArg::Heights => Self::Heights,
            StageArg::Output => Self::Output,
        }
    }
}

pub(super) fn run(args: &RunArgs, global: &Global) -> Result<u8, Failure> {
    let file = config_file(args.config.as_deref())?;
    if args.tiled {
        return run_tiled(&file, args, global);
    }
    let config = if file.as_os_str() == "-" {
        RunConfig::from_text(&text_of_stdin()?, Path::new("standard input"), &args.assignments)
    } else {
        RunConfig::load(&file, &args.assignments)
    };
    let mut config = config.map_err(|e| Failure::new(2, &e))?;
    if let Some(output) = &args.output {
        config.project.output.clone_from(output);
    }
    config.limits.set();
    if args.tileset.tileset().is_some() {
        let hint = "3D Tiles of one piece are written by `sizeup export --to 3dtiles`, which takes them too";
        return Err(Failure::from_text(2, format!("--heights and --geoid-height go with --tiled\nhint: {hint}")));
    }
    let options = RunOptions { from: args.from.into(), until: args.until.into(), command: Call::this().line() };
    let ui = Ui::new(global);
    let summary = pipeline::run(&config, &options, &|event| ui.tell(event));
    let summary = report_summary(&ui, summary)?;
    if global.json {
        print_json(&summary)?;
    }
    Ok(if summary.has_failed_items() { EXIT_FAILED_ITEMS } else { 0 })
}

/// Plans tiles, runs those that are not done, and merges all.
fn run_tiled(file: &Path, args: &RunArgs, global: &Global) -> Result<u8, Failure> {
    if file.as_os_str() == "-" {
        let hint = "save the configuration as a file: tiles are run again from it";
        return Err(Failure::from_text(2, format!("--tiled takes no configuration from standard input\nhint: {hint}")));
    }
    let (config, path) = config_of(file, &args.assignments, args.output.as_ref())?;
    let plan = args.cut.settings(path, args.tileset.tileset(), args.trust);
    let ui = Ui::new(global);
    let manifest = tiles::plan(&config, &plan, PLAN, &|event| ui.tell(event)).map_err(|e| failed(&e));
    ui.finish();
    run_tiles(&ui, &manifest?, args, global)
}

/// Runs the tiles of a plan that are not done, and merges all.
fn run_tiles(ui: &Ui, manifest: &Manifest, args: &RunArgs, global: &Global) -> Result<u8, Failure> {
    say_plan(ui, manifest);
    let n_cores = rayon::current_num_threads();
    let n_jobs = args.jobs.unwrap_or(n_cores.div_ceil(2)).max(1);
    let settings = PoolSettings {
        program: Call::this().program.clone(),
        n_jobs,
        n_threads: n_cores.div_ceil(n_jobs),
        memory_mb: args.total_memory.or_else(tiles::available_memory_mb).unwrap_or(u64::MAX),
        n_retries: N_RETRIES,
        trust: args.trust.trust(),
    };
    let layout = Layout::new(&manifest.config.project.output);
    let city = tiles::status(&layout, args.trust.trust()).map_err(|e| failed(&e))?;
    let todo: Vec<Tile> =
        city.tiles.into_iter().filter(|one| one.state != TileState::Done).map(|one| one.tile).collect();
    ui.say(format!("{} of {} are done", manifest.tiles.len() - todo.len(), counted(manifest.tiles.len(), "tile")));
    let outcomes = tiles::run_all(&layout, &todo, &settings, &|done, total| ui.advance("tiles", done, total));
    ui.finish();
    let failed_tiles: Vec<TileOutcome> =
        outcomes.map_err(|e| failed(&e))?.into_iter().filter(|outcome| !outcome.is_done()).collect();
    for outcome in &failed_tiles {
        let log = layout.tile(&outcome.id).join("log.txt");
        let cause = Attempt::read(&layout, &outcome.id).map_or_else(String::new, |last| format!(": {}", last.cause));
        ui.say(format!("tile {} failed{cause}\n  its log: {}", outcome.id, log.display()));
    }
    if !failed_tiles.is_empty() {
        let tiles = counted(failed_tiles.len(), "tile");
        let exit_code = failed_tiles.iter().map(TileOutcome::failure_code).max().unwrap_or(EXIT_FAILED);
        let first = if exit_code == EXIT_FAILED { "" } else { "mend the settings or the input that the tiles name; " };
        return Err(Failure::from_text(
            exit_code,
            format!("{tiles} failed\nhint: {first}the same command again runs only what failed"),
        ));
    }
    let options = MergeOptions { missing: Missing::Refuse, tileset: None, trust: args.trust.trust() };
    let merged = merge_city(&layout, &options, global)?;
    if global.json {
        print_json(&merged)?;
    }
    Ok(if merged.has_failed_items() { EXIT_FAILED_ITEMS } else { 0 })
}

/// Reports the end of a run: its summary, or why it failed.
pub(super) fn report_summary(ui: &Ui, summary: Result<RunSummary, PipelineError>) -> Result<RunSummary, Failure> {
    let summary = summary.map_err(|e| Failure::new(e.exit_code(), &e))?;
    ui.finish();
    tell_summary(ui, &summary);
    Ok(summary)
}

/// Prints the summary of a run on stderr.
pub fn tell_summary(ui: &Ui, summary: &RunSummary) {
    let seconds: Vec<String> = summary.seconds.iter().map(|(stage, s)| format!("{stage} {s:.1} s")).collect();
    for doubt in &summary.implausible {
        ui.warn(format!("THE RESULT IS IMPLAUSIBLE: {doubt}"));
    }
    ui.say(format!(
        "{}, {} ({} oblique), {} used",
        counted(summary.n_buildings, "building"),
        counted(summary.n_views, "view"),
        summary.n_oblique,
        counted(summary.n_used_views, "prior")
    ));
    if let Some(poses) = &summary.poses {
        ui.say(format!("poses: {poses}"));
    }
    if summary.n_used_views > 0 {
        ui.say(format!("priors from {}", summary.priors_from));
    }
    let words = |status: Status| match status {
        Status::Measured => "measured",
        Status::Reviewed => "reviewed: confirmed or corrected by a person",
        Status::Given => "given: from a model of others",
        Status::Doubtful => "doubtful: measured, to be looked at",
        Status::Fallback => "fallback: not measured, a height from elsewhere",
        Status::Unknown => "unknown: without a height",
        Status::Refused => "refused: without a usable footprint",
    };
    for (&status, n) in &summary.by_status {
        ui.say(format!("{n:>8} {}", words(status)));
    }
    let n_parts: usize = summary.parts_by_status.values().sum();
    if n_parts > 0 {
        let of = summary.parts_by_status.iter().map(|(status, n)| format!("{n} {}", status.as_str()));
        let of: Vec<String> = of.collect();
        ui.say(format!("{n_parts:>8} parts of buildings in several pieces: {}", of.join(", ")));
    }
    let n_refined = summary.n_refined.unwrap_or(0);
    if n_refined > 0 {
        let roofs = if n_refined == 1 { "roof" } else { "roofs" };
        ui.say(format!("{n_refined:>8} {roofs} refined by the photos"));
    }
    if let Some(median) = summary.median_height_m {
        ui.say(format!("median height {median:.1} m"));
    }
    if let Some(worst) = &summary.worst {
        ui.say(format!("above all: {worst}"));
    }
    tell_issues(ui, summary);
    ui.say(format!("{}; results in {}", seconds.join(", "), summary.output.display()));
}

/// How many issues there are, where there are any.
pub(super) fn tell_issues(ui: &Ui, summary: &RunSummary) {
    let (n_refused, n_warnings) = (summary.n_refused, summary.n_warnings);
    if n_refused + n_warnings > 0 {
        let (items, warnings) = (counted(n_refused, "item"), counted(n_warnings, "warning"));
        let file = summary.issues_in.as_deref().unwrap_or(Path::new("issues.json"));
        ui.say(format!("{items} refused, {warnings}: see {}", file.display()));
    }
}

/// Reads the text of a configuration that another program writes to standard input.
fn text_of_stdin() -> Result<String, Failure> {
    let cannot = |e| Failure::from_text(2, format!("cannot read the configuration from standard input: {e}"));
    std::io::read_to_string(std::io::stdin()).map_err(cannot)
}
