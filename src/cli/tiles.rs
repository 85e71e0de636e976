//! `sizeup tiles`: a city in tiles, for one machine or many.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::export::HeightsArg;
use super::{EXIT_FAILED_ITEMS, Failure, Global, Ui, print, print_json};
use crate::config::RunConfig;
use crate::optimise::CalibrationRays;
use crate::output::tiles3d::Heights;
use crate::tiles::{self, Layout, MergeOptions, Merged, Missing, PlanSettings, State, TileRun, TileStatus, TilesError};

/// The steps of a city.
#[derive(Debug, Clone, Subcommand)]
pub enum TilesCommand {
    /// Cut a city into tiles, and say what each needs.
    Plan(PlanArgs),
    /// Run one tile; done tiles stay as they are.
    Run(TileArgs),
    /// Bring the tiles that are done together.
    Merge(MergeArgs),
    /// Say where each tile stands.
    Status(StatusArgs),
}

/// How a city is cut.
#[derive(Debug, Clone, Args)]
pub struct CutArgs {
    /// Side of the tiles, metres. Without it squares are quartered until they hold few enough buildings.
    #[arg(long, value_name = "METRES")]
    pub size: Option<f64>,
    /// Most buildings of a tile.
    #[arg(long, value_name = "N", default_value_t = 1000, conflicts_with = "size")]
    pub buildings: usize,
    /// Width of the ring around a tile whose buildings are solved with it, metres. By default half as
    /// much again as a view shows at once.
    #[arg(long, value_name = "METRES")]
    pub halo: Option<f64>,
    /// How far around a tile views are taken in, metres. By default a third of the halo.
    #[arg(long, value_name = "METRES")]
    pub view_margin: Option<f64>,
    /// Most memory of a tile, megabytes; tiles that need more are quartered.
    #[arg(long, value_name = "MB")]
    pub memory: Option<u64>,
}

/// Arguments of `sizeup tiles plan`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup tiles plan sizeup.toml
  sizeup tiles plan sizeup.toml --buildings 2000 --memory 4000 --output city

The plan is tiles.json in the folder of the results.")]
pub struct PlanArgs {
    /// Configuration file (TOML), as for `sizeup run`.
    pub config: PathBuf,
    /// Set one key of the configuration. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// Folder of the results, in place of the configuration's.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// How the city is cut.
    #[command(flatten)]
    pub cut: CutArgs,
}

/// Arguments of `sizeup tiles run`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:
  sizeup tiles run result --tile e565000_n5932000_s500

Exit codes: 0 done, 5 done and some items have no result, 4 failed (try again), 2 and 3 no use trying again.")]
pub struct TileArgs {
    /// Folder of the plan.
    pub folder: PathBuf,
    /// Name of the tile, or its number in the plan, from 0 (for job arrays).
    #[arg(long, value_name = "ID")]
    pub tile: String,
}

/// Arguments of `sizeup tiles merge`.
#[derive(Debug, Clone, Args)]
pub struct MergeArgs {
    /// Folder of the plan.
    pub folder: PathBuf,
    /// Merge what is done, although tiles are missing.
    #[arg(long)]
    pub allow_missing: bool,
    /// 3D Tiles: what heights are. crs: what the CRS says, by PROJ's grids.
    #[arg(long, value_enum, value_name = "WHAT", default_value = "crs", conflicts_with = "geoid_height")]
    pub heights: HeightsArg,
    /// 3D Tiles: height of the geoid above the ellipsoid for the whole city, metres.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub geoid_height: Option<f64>,
}

/// Arguments of `sizeup tiles status`.
#[derive(Debug, Clone, Args)]
pub struct StatusArgs {
    /// Folder of the plan.
    pub folder: PathBuf,
}

pub(super) fn run(command: &TilesCommand, global: &Global) -> Result<u8, Failure> {
    match command {
        TilesCommand::Plan(args) => plan(args, global),
        TilesCommand::Run(args) => run_tile(args, global),
        TilesCommand::Merge(args) => merge(args, global),
        TilesCommand::Status(args) => status(args, global),
    }
}

pub(super) fn failed(error: &TilesError) -> Failure {
    Failure::new(error.exit_code(), error)
}

fn plan(args: &PlanArgs, global: &Global) -> Result<u8, Failure> {
    // Tiles may be run from another folder than this one.
    let path = absolute(&args.config)?;
    let mut config = RunConfig::load(&path, &args.assignments).map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    if let Some(output) = &args.output {
        config.project.output = absolute(output)?;
    }
    let manifest = plan_config(&config, &args.cut, global)?;
    if global.json {
        print_json(&manifest.tiles)?;
    }
    Ok(0)
}

/// Makes the plan of a configuration, and says what it is.
pub(super) fn plan_config(config: &RunConfig, cut: &CutArgs, global: &Global) -> Result<tiles::Manifest, Failure> {
    let ui = Ui::new(global);
    let settings = PlanSettings {
        size_m: cut.size,
        n_buildings: cut.buildings,
        halo_m: cut.halo,
        view_margin_m: cut.view_margin,
        memory_mb: cut.memory,
        n_threads: rayon::current_num_threads(),
    };
    let manifest = tiles::plan(config, &settings, "sizeup tiles plan", &|event| ui.tell(event));
    ui.finish();
    let manifest = manifest.map_err(|e| failed(&e))?;
    let most = |of: fn(&tiles::Tile) -> u64| manifest.tiles.iter().map(of).max().unwrap_or(0);
    ui.say(format!(
        "{} buildings, {} views in {} tiles, with a halo of {:.0} m",
        manifest.n_buildings,
        manifest.n_views,
        manifest.tiles.len(),
        manifest.halo_m
    ));
    ui.say(format!(
        "the largest tile: {} buildings of its own, {} with its halo, {} views, about {} MB",
        most(|t| t.n_buildings as u64),
        most(|t| t.n_solved as u64),
        most(|t| t.n_views as u64),
        most(|t| t.memory_mb)
    ));
    if config.optimise.search.calibrate_on == CalibrationRays::All {
        ui.say(
            "hint: priors are brought to metres by buildings and ground, which carries small differences from tile to tile; \
             with --set optimise.search.calibrate_on=ground heights do hardly depend on the tiling",
        );
    }
    ui.say(format!("the plan is {}", Layout::new(&config.project.output).manifest().display()));
    Ok(manifest)
}

pub(super) fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|e| Failure::from_text(2, format!("{}: {e}", path.display())))
}

fn run_tile(args: &TileArgs, global: &Global) -> Result<u8, Failure> {
    let ui = Ui::new(global);
    let layout = Layout::new(&args.folder);
    let id = name_of(&layout, &args.tile)?;
    let wait = |holder: &str| ui.say(format!("tile {id} is being run by {holder}: waiting for it"));
    let outcome = tiles::run_tile(&layout, &id, &wait, &|event| ui.tell(event));
    ui.finish();
    let outcome = outcome.map_err(|e| failed(&e))?;
    let done = outcome.done();
    let word = if matches!(outcome, TileRun::WasDone(_)) { "was done already" } else { "is done" };
    ui.say(format!(
        "tile {id} {word}: {} buildings, {} with a height, {} priors used",
        done.n_buildings, done.n_heights, done.n_used_views
    ));
    if global.json {
        print_json(done)?;
    }
    Ok(done.exit_code)
}

/// A tile by its name, or by its number in the plan.
fn name_of(layout: &Layout, tile: &str) -> Result<String, Failure> {
    let Ok(number) = tile.parse::<usize>() else { return Ok(tile.to_owned()) };
    let manifest = layout.read_manifest().map_err(|e| failed(&e))?;
    let found = manifest.tiles.get(number).map(|tile| tile.id.clone());
    found.ok_or_else(|| failed(&TilesError::NoSuchTile { id: tile.to_owned() }))
}

fn merge(args: &MergeArgs, global: &Global) -> Result<u8, Failure> {
    let heights = match (args.geoid_height, args.heights) {
        (Some(geoid_m), _) => Heights::GeoidHeight(geoid_m),
        (None, HeightsArg::Ellipsoidal) => Heights::Ellipsoidal,
        (None, HeightsArg::Crs) => Heights::Crs,
    };
    let missing = if args.allow_missing { Missing::Allow } else { Missing::Refuse };
    let merged = merge_city(&Layout::new(&args.folder), &MergeOptions { missing, heights }, global)?;
    if global.json {
        print_json(&merged)?;
    }
    Ok(if merged.has_failed_items() { EXIT_FAILED_ITEMS } else { 0 })
}

/// Merges and says what came out.
pub(super) fn merge_city(layout: &Layout, options: &MergeOptions, global: &Global) -> Result<Merged, Failure> {
    let ui = Ui::new(global);
    let wait = |holder: &str| ui.say(format!("{holder} is at it: waiting for it"));
    let merged = tiles::merge(layout, options, &wait).map_err(|e| failed(&e))?;
    let n_done = merged.n_tiles - merged.missing.len();
    ui.say(format!("{} buildings of {n_done} of {} tiles", merged.n_buildings, merged.n_tiles));
    if let Some(median_m) = merged.median_height_m {
        ui.say(format!("median height {median_m:.1} m"));
    }
    if let Some(nearest) = merged.seams.classes.first().filter(|class| class.n > 0) {
        ui.say(format!(
            "seams: {} buildings within {:.0} m solved on both sides, {} the same, the others within {:.3} m",
            nearest.n,
            nearest.up_to_m.unwrap_or(f64::INFINITY),
            nearest.n_same,
            nearest.max_m
        ));
    }
    if let Some(why) = &merged.no_tileset {
        ui.say(format!("no 3D Tiles: {why}"));
    }
    ui.say(format!("the city is in {}", layout.folder().display()));
    Ok(merged)
}

fn status(args: &StatusArgs, global: &Global) -> Result<u8, Failure> {
    let tiles = tiles::status(&Layout::new(&args.folder)).map_err(|e| failed(&e))?;
    if global.json {
        print_json(&tiles)?;
    } else {
        for one in &tiles {
            print(&line_of(one))?;
        }
    }
    let count = |state: State| tiles.iter().filter(|one| one.state == state).count();
    let ui = Ui::new(global);
    ui.say(format!(
        "{} tiles: {} done, {} running, {} waiting, {} damaged",
        tiles.len(),
        count(State::Done),
        count(State::Running),
        count(State::Waiting),
        count(State::Damaged)
    ));
    Ok(0)
}

fn line_of(one: &TileStatus) -> String {
    let state = match one.state {
        State::Done if one.exit_code == Some(EXIT_FAILED_ITEMS) => "done, with failed items".to_owned(),
        State::Done => "done".to_owned(),
        State::Running => format!("running, {}", one.runner.as_deref().unwrap_or("somebody")),
        State::Damaged => "damaged: run it again".to_owned(),
        State::Waiting => "waiting".to_owned(),
    };
    let tile = &one.tile;
    format!("{}\t{} buildings\t{} views\t{} MB\t{state}", tile.id, tile.n_buildings, tile.n_views, tile.memory_mb)
}
