//! `sizeup tiles`: a city in tiles, for one machine or many.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};

use super::flags::config_file;
use super::{EXIT_FAILED_ITEMS, Failure, Global, Ui, print, print_json};
use crate::config::RunConfig;
use crate::pipeline::RunSettings;
use crate::recipe;
use crate::tiles::{
    self, CityStatus, Layout, MergeOptions, Merged, Missing, PlanSettings, Planned, TileChange, TileRun, TileState,
    TileStatus, TilesError, Tileset, Trust,
};
use sizeup_heights::optimise::CalibrationRays;
use sizeup_results::output::tiles3d::Heights;

/// The steps of a city.
#[derive(Debug, Clone, Subcommand)]
pub enum TilesCommand {
    /// Cut a city into tiles, and say what each needs.
    Plan(PlanArgs),
    /// Run one tile; done tiles stay as they are.
    Run(TileArgs),
    /// Bring the tiles that are done together.
    Merge(MergeArgs),
    /// Say where each tile stands, and why it is not done.
    Status(StatusArgs),
    /// List the files that a plan reads, with their hashes, for engines that have to know whether to plan again.
    Inputs(InputsArgs),
}

/// How a city is cut.
#[derive(Debug, Clone, Args)]
pub struct CutArgs {
    /// Side of the tiles, metres. Without it and --buildings tiles are as large as it takes for their halos to cost no more
    /// than half as much again as one piece, memory permitting.
    #[arg(long, value_name = "METRES")]
    pub size: Option<f64>,
    /// Most buildings of a tile: squares are quartered until they hold few enough.
    #[arg(long, value_name = "N", conflicts_with = "size")]
    pub buildings: Option<usize>,
    /// Width of the ring around a tile whose buildings are solved with it, metres. By default twice
    /// what a view shows at once.
    #[arg(long, value_name = "METRES")]
    pub halo: Option<f64>,
    /// How far around a tile views are taken in, metres. By default 0.45 of the halo.
    #[arg(long, value_name = "METRES")]
    pub view_margin: Option<f64>,
    /// Most memory of a tile, megabytes; tiles that need more are quartered. 4000 without --size and --buildings.
    #[arg(long, value_name = "MB")]
    pub memory: Option<u64>,
}

/// Heights in 3D Tiles.
#[derive(Debug, Clone, Args)]
pub struct TilesetArgs {
    /// 3D Tiles: what heights are. crs: what the CRS says, by PROJ's grids (the default); none: write no 3D Tiles.
    #[arg(long, value_enum, value_name = "WHAT", conflicts_with = "geoid_height")]
    pub heights: Option<TileHeightsArg>,
    /// 3D Tiles: height of the geoid above the ellipsoid for the whole city, metres.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub geoid_height: Option<f64>,
}

/// Meaning of heights, on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum TileHeightsArg {
    /// Heights are what the CRS says.
    Crs,
    /// Heights are above the ellipsoid.
    Ellipsoidal,
    /// Write no 3D Tiles.
    None,
}

impl TilesetArgs {
    /// Tileset that was asked for, if any.
    pub(super) fn tileset(&self) -> Option<Tileset> {
        match (self.geoid_height, self.heights) {
            (Some(geoid_m), _) => Some(Tileset::Written(Heights::GeoidHeight(geoid_m))),
            (None, Some(TileHeightsArg::Crs)) => Some(Tileset::Written(Heights::Crs)),
            (None, Some(TileHeightsArg::Ellipsoidal)) => Some(Tileset::Written(Heights::Ellipsoidal)),
            (None, Some(TileHeightsArg::None)) => Some(Tileset::LeftOut),
            (None, None) => None,
        }
    }
}

/// How much of what is known of files is believed.
#[derive(Debug, Clone, Copy, Args)]
pub struct TrustArgs {
    /// Read every file again, also those whose size, inode and times say that they have not changed.
    #[arg(long)]
    pub rehash: bool,
}

impl TrustArgs {
    pub(super) fn trust(self) -> Trust {
        if self.rehash { Trust::Nothing } else { Trust::Known }
    }
}

/// Arguments of `sizeup tiles plan`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup tiles plan sizeup.toml
  sizeup tiles plan sizeup.toml --buildings 2000 --memory 4000 --output city

  sizeup tiles plan sizeup.toml --output city --dry-run     what would be run again, why, and what it would cost

The plan is tiles.json in the folder of the results. Planning again keeps all that has not changed.")]
pub struct PlanArgs {
    /// Configuration file (TOML; default: sizeup.toml in this folder), as for `sizeup run`.
    pub config: Option<PathBuf>,
    /// Set one key of the configuration. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// Folder of the results, in place of the configuration's.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Change nothing: say which tiles would be run again, why, and what it would cost.
    #[arg(long)]
    pub dry_run: bool,
    /// How the city is cut.
    #[command(flatten)]
    pub cut: CutArgs,
    /// Heights in 3D Tiles.
    #[command(flatten)]
    pub tileset: TilesetArgs,
    /// How much of what is known of files is believed.
    #[command(flatten)]
    pub trust: TrustArgs,
}

/// Arguments of `sizeup tiles inputs`.
#[derive(Debug, Clone, Args)]
pub struct InputsArgs {
    /// Configuration file (TOML), as for `sizeup tiles plan`.
    pub config: PathBuf,
    /// Folder of the results, in place of the configuration's.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// How much of what is known of files is believed.
    #[command(flatten)]
    pub trust: TrustArgs,
}

/// Arguments of `sizeup tiles run`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:
  sizeup tiles run result --tile e565000_n5932000_s500

Exit codes: 0 done, 5 done and some items have no result, 4 failed (try again), 2 and 3 no use trying again.
A tile whose input has changed since the plan is refused with 3: plan again.")]
pub struct TileArgs {
    /// Folder of the plan.
    pub folder: PathBuf,
    /// Name of the tile, or its number in the plan, from 0 (for job arrays).
    #[arg(long, value_name = "ID")]
    pub tile: String,
    /// How much of what is known of files is believed.
    #[command(flatten)]
    pub trust: TrustArgs,
}

/// Arguments of `sizeup tiles merge`.
#[derive(Debug, Clone, Args)]
pub struct MergeArgs {
    /// Folder of the plan.
    pub folder: PathBuf,
    /// Merge what is done, although tiles are missing.
    #[arg(long)]
    pub allow_missing: bool,
    /// Heights in 3D Tiles; by default what the plan says.
    #[command(flatten)]
    pub tileset: TilesetArgs,
    /// How much of what is known of files is believed.
    #[command(flatten)]
    pub trust: TrustArgs,
}

/// Arguments of `sizeup tiles status`.
#[derive(Debug, Clone, Args)]
pub struct StatusArgs {
    /// Folder of the plan.
    pub folder: PathBuf,
    /// List only tiles that are not done, each with its number in the plan before its name, for job arrays.
    #[arg(long)]
    pub todo: bool,
    /// How much of what is known of files is believed.
    #[command(flatten)]
    pub trust: TrustArgs,
}

pub(super) fn run(command: &TilesCommand, global: &Global) -> Result<u8, Failure> {
    match command {
        TilesCommand::Plan(args) => plan(args, global),
        TilesCommand::Run(args) => run_tile(args, global),
        TilesCommand::Merge(args) => merge(args, global),
        TilesCommand::Status(args) => status(args, global),
        TilesCommand::Inputs(args) => inputs(args, global),
    }
}

pub(super) fn failed(error: &TilesError) -> Failure {
    Failure::new(error.exit_code(), error)
}

/// Loads the configuration of a city, its paths absolute: tiles may be run from another folder.
pub(super) fn config_of(
    path: &Path,
    assignments: &[String],
    output: Option<&PathBuf>,
) -> Result<(RunConfig, PathBuf), Failure> {
    let path = absolute(path)?;
    let mut config = RunConfig::load(&path, assignments).map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    config.project.output = absolute(output.unwrap_or(&config.project.output))?;
    Ok((config, path))
}

fn plan(args: &PlanArgs, global: &Global) -> Result<u8, Failure> {
    let (config, path) = config_of(&config_file(args.config.as_deref())?, &args.assignments, args.output.as_ref())?;
    let settings = args.cut.settings(path, args.tileset.tileset(), args.trust);
    let ui = Ui::new(global);
    if args.dry_run {
        let planned = tiles::try_plan(&config, &settings, PLAN, &|event| ui.tell(event));
        ui.finish();
        return say_changes(&ui, &planned.map_err(|e| failed(&e))?, global);
    }
    let manifest = tiles::plan(&config, &settings, PLAN, &|event| ui.tell(event));
    ui.finish();
    let manifest = manifest.map_err(|e| failed(&e))?;
    say_plan(&ui, &manifest);
    if global.json {
        print_json(&manifest.tiles)?;
    }
    Ok(0)
}

impl CutArgs {
    /// All that a plan has to know beside the configuration.
    pub(super) fn settings(&self, config_file: PathBuf, tileset: Option<Tileset>, trust: TrustArgs) -> PlanSettings {
        PlanSettings {
            size_m: self.size,
            n_buildings: self.buildings,
            halo_m: self.halo,
            view_margin_m: self.view_margin,
            memory_mb: self.memory,
            n_threads: rayon::current_num_threads(),
            config_file: Some(config_file),
            tileset: tileset.unwrap_or(Tileset::Written(Heights::Crs)),
            trust: trust.trust(),
        }
    }
}

/// Reports the changes that a plan would make, and their cost.
fn say_changes(ui: &Ui, planned: &Planned, global: &Global) -> Result<u8, Failure> {
    if global.json {
        print_json(planned)?;
        return Ok(0);
    }
    for TileChange { tile, why, processor_seconds } in &planned.changes {
        let cost = processor_seconds.map_or("unknown time".to_owned(), |s| format!("about {s:.1} s"));
        print(&format!("{}\t{} buildings to solve\t{cost}\t{}", tile.id, tile.n_solved, first_line(why)))?;
    }
    let n_solved: usize = planned.changes.iter().map(|change| change.tile.n_solved).sum();
    let seconds: Option<f64> = planned.changes.iter().map(|change| change.processor_seconds).sum();
    let cost = match seconds {
        _ if planned.changes.is_empty() => String::new(),
        Some(s) => format!(", {n_solved} buildings to solve, about {s:.0} s of processor time by what tiles took here"),
        None => format!(", {n_solved} buildings to solve; what that takes is known once a tile has been run"),
    };
    ui.say(format!("{} of {} tiles would be run{cost}", planned.changes.len(), planned.n_tiles));
    Ok(0)
}

fn inputs(args: &InputsArgs, global: &Global) -> Result<u8, Failure> {
    let (config, path) = config_of(&args.config, &[], args.output.as_ref())?;
    let cut = CutArgs { size: None, buildings: None, halo: None, view_margin: None, memory: None };
    let files =
        tiles::inputs(&RunSettings::of(&config), &cut.settings(path, None, args.trust)).map_err(|e| failed(&e))?;
    if global.json {
        print_json(&serde_json::json!({ "program": recipe::program(), "files": files }))?;
        return Ok(0);
    }
    print(&format!("program\tsizeup\t{}", recipe::program()))?;
    files.iter().try_for_each(|file| print(&format!("{}\t{}\t{}", file.role, file.path, file.sha256)))?;
    Ok(0)
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

/// Command of a plan, for its lineage.
pub(super) const PLAN: &str = "sizeup tiles plan";

/// Reports the tiles of a plan.
pub(super) fn say_plan(ui: &Ui, manifest: &tiles::Manifest) {
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
    let n_solved: usize = manifest.tiles.iter().map(|tile| tile.n_solved).sum();
    ui.say(format!(
        "with their halos the tiles solve {n_solved} buildings, {:.1} times as many as there are",
        n_solved as f64 / manifest.n_buildings.max(1) as f64
    ));
    if manifest.config.optimise.search.calibrate_on == CalibrationRays::All {
        ui.say(
            "hint: priors are brought to metres by buildings and ground, which carries small differences from tile to tile; \
             with --set optimise.search.calibrate_on=ground heights do hardly depend on the tiling",
        );
    }
    ui.say(format!("the plan is {}", Layout::new(&manifest.config.project.output).manifest().display()));
}

fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|e| Failure::from_text(2, format!("{}: {e}", path.display())))
}

fn run_tile(args: &TileArgs, global: &Global) -> Result<u8, Failure> {
    let ui = Ui::new(global);
    let layout = Layout::new(&args.folder);
    let id = name_of(&layout, &args.tile)?;
    let wait = |holder: &str| ui.say(format!("tile {id} is being run by {holder}: waiting for it"));
    let outcome = tiles::run_tile(&layout, &id, args.trust.trust(), &wait, &|event| ui.tell(event));
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
    let missing = if args.allow_missing { Missing::Allow } else { Missing::Refuse };
    let options = MergeOptions { missing, tileset: args.tileset.tileset(), trust: args.trust.trust() };
    let merged = merge_city(&Layout::new(&args.folder), &options, global)?;
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
    if merged.n_photos_missing > 0 {
        ui.say(format!("{} missing: issues.json names them", super::counted(merged.n_photos_missing, "photo")));
    }
    if let Some(why) = &merged.no_tileset {
        ui.say(format!("no 3D Tiles: {why}"));
    }
    ui.say(format!("the city is in {}", layout.folder().display()));
    Ok(merged)
}

fn status(args: &StatusArgs, global: &Global) -> Result<u8, Failure> {
    let city = tiles::status(&Layout::new(&args.folder), args.trust.trust()).map_err(|e| failed(&e))?;
    if global.json {
        print_json(&city)?;
    } else {
        for (i, one) in city.tiles.iter().enumerate() {
            match (args.todo, one.state) {
                (true, TileState::Done) => {}
                (true, _) => print(&format!("{i}\t{}", line_of(one)))?,
                (false, _) => print(&line_of(one))?,
            }
        }
    }
    tell_status(&Ui::new(global), &city);
    Ok(0)
}

fn tell_status(ui: &Ui, city: &CityStatus) {
    if let Some(why) = &city.plan_stale {
        ui.say(format!("the plan is stale: {why}\nhint: plan again; tiles that the change does not touch stay done"));
    }
    ui.say(format!(
        "{} tiles: {} done, {} running, {} stale, {} failed, {} waiting",
        city.tiles.len(),
        city.count(TileState::Done),
        city.count(TileState::Running),
        city.count(TileState::Stale),
        city.count(TileState::Failed),
        city.count(TileState::Waiting)
    ));
    ui.say(match (city.merge, &city.merge_stale) {
        (TileState::Done, _) => "the merge is done".to_owned(),
        (TileState::Running, _) => "the merge is running".to_owned(),
        (TileState::Failed, Some(why)) => format!("the merge is not finished: {why}\nhint: merge again"),
        (_, Some(why)) => format!("the merge is stale: {why}"),
        _ => "nothing has been merged".to_owned(),
    });
}

fn line_of(one: &TileStatus) -> String {
    let why = one.why.as_deref().map(first_line);
    let state = match one.state {
        TileState::Done if one.exit_code == Some(EXIT_FAILED_ITEMS) => "done, with failed items".to_owned(),
        TileState::Done => "done".to_owned(),
        TileState::Running => format!("running, {}", one.runner.as_deref().unwrap_or("somebody")),
        TileState::Stale => format!("stale: {}", why.unwrap_or_default()),
        TileState::Failed => {
            let code = one.exit_code.map_or("no exit code".to_owned(), |code| format!("exit code {code}"));
            let tries = super::counted_as(one.n_tries, "try", "tries");
            format!("failed, {code}, {tries}: {}", why.unwrap_or_default())
        }
        TileState::Waiting => why.map_or("waiting".to_owned(), |why| format!("waiting: {why}")),
    };
    let tile = &one.tile;
    format!("{}\t{} buildings\t{} views\t{} MB\t{state}", tile.id, tile.n_buildings, tile.n_views, tile.memory_mb)
}
