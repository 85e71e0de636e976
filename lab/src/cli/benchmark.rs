//! `sizeup-lab benchmark`: scenes with known truth, every method, tables for the documentation.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::benchmark::accuracy::{self, AccuracyConfig};
use crate::benchmark::paper::{self, PaperConfig};
use crate::benchmark::passes::{self, PassesConfig};
use crate::benchmark::textures::{self, TexturesConfig};
use crate::benchmark::{Again, BenchmarkError, Method, Programs, SuitePlan};
use sizeup::cli::{Call, Failure, Global, Ui, print, print_json};
use sizeup::config;
use sizeup_results::output::sha256_hex;

/// Arguments of `sizeup-lab benchmark`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup-lab benchmark accuracy --small --output bench
  sizeup-lab benchmark accuracy --output bench --keep-scenes
  sizeup-lab benchmark paper --output bench --set scenes=[\"res-1\"]
  sizeup-lab benchmark accuracy --output bench --keep-scenes --again robust --set seeds=[1,2] --set levels=[\"mid\"]
  sizeup-lab benchmark accuracy --output bench --again outdated
  sizeup-lab benchmark passes --output bench --set 'real=[\"flight/sizeup.toml\"]'
  sizeup-lab benchmark textures --output bench --set 'real=[\"flight/sizeup.toml\"]'
  sizeup-lab benchmark accuracy --output bench --set 'real=[{name=\"west\",cityjson={path=\"city.json\",max_buildings=80}}]'

A run that was stopped goes on where it was: the folder holds one outcome per scene and method. Those that another
program made are taken over and said so, in the table too, unless `--again outdated` makes them anew.")]
pub struct BenchmarkArgs {
    /// Suite of scenes to measure.
    pub suite: Suite,
    /// Folder of scenes, outcomes and tables.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: PathBuf,
    /// A suite of seconds: it shows that everything works, and is too small to tell methods apart.
    #[arg(long)]
    pub small: bool,
    /// Set one key of the suite, as in `--set seeds=[1,2]`. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// Make this method's outcomes anew, or (`outdated`) those that another program made. May be repeated.
    #[arg(long, value_name = "METHOD|outdated")]
    pub again: Vec<String>,
    /// Keep the simulated scenes for the next run.
    #[arg(long)]
    pub keep_scenes: bool,
}

/// Suite of scenes that is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Suite {
    /// Heights over seeds, towns and levels of prior errors.
    Accuracy,
    /// Scenes with the paper's counts, every method and baseline, tables in the paper's layout.
    Paper,
    /// Heights and processor time with one pass of the solver changed at a time.
    Passes,
    /// Textures against photos that they were not made from.
    Textures,
}

pub(super) fn run(args: &BenchmarkArgs, global: &Global) -> Result<u8, Failure> {
    let plan = SuitePlan {
        folder: args.output.clone(),
        program: this_program()?,
        again: again(&args.again)?,
        keep_scenes: args.keep_scenes,
    };
    let ui = Ui::new(global);
    let tell = |done: usize, total: usize, what: &str| ui.advance(what, done, total);
    match args.suite {
        Suite::Accuracy => {
            let config = if args.small { AccuracyConfig::small() } else { AccuracyConfig::default() };
            let table = accuracy::run(&with_assignments(&config, args)?, &plan, &tell);
            ui.finish();
            let table = table.map_err(|e| failure(&e))?;
            tell_programs(&ui, &table.programs);
            if global.json { print_json(&table)? } else { print(&table.to_markdown())? }
        }
        Suite::Paper => {
            let config = if args.small { PaperConfig::small() } else { PaperConfig::default() };
            let tables = paper::run(&with_assignments(&config, args)?, &plan, &tell);
            ui.finish();
            let tables = tables.map_err(|e| failure(&e))?;
            tell_programs(&ui, &tables.programs);
            if global.json { print_json(&tables)? } else { print(&tables.to_markdown())? }
        }
        Suite::Passes => {
            let config = if args.small { PassesConfig::small() } else { PassesConfig::default() };
            let table = passes::run(&with_assignments(&config, args)?, &plan, &tell);
            ui.finish();
            let table = table.map_err(|e| failure(&e))?;
            if global.json { print_json(&table)? } else { print(&table.to_markdown())? }
        }
        Suite::Textures => {
            let config = if args.small { TexturesConfig::small() } else { TexturesConfig::default() };
            let table = textures::run(&with_assignments(&config, args)?, &plan, &tell);
            ui.finish();
            let table = table.map_err(|e| failure(&e))?;
            if global.json { print_json(&table)? } else { print(&table.to_markdown())? }
        }
    }
    ui.say(format!("tables and outcomes in {}", args.output.display()));
    Ok(0)
}

fn with_assignments<T>(config: &T, args: &BenchmarkArgs) -> Result<T, Failure>
where
    T: serde::Serialize + serde::de::DeserializeOwned,
{
    let text = toml::to_string(config).map_err(|e| Failure::new(4, &e))?;
    config::parse_scene(&text, None, &args.assignments).map_err(|e| Failure::new(2, &e))
}

/// Stands for all outcomes that another program made.
const OUTDATED: &str = "outdated";
/// Digits of the program's hash that are kept: builds are told apart, no more.
const HASH_DIGITS: usize = 12;

fn again(names: &[String]) -> Result<Again, Failure> {
    let method = |name: &String| {
        Method::named(name).ok_or_else(|| {
            let known = Method::ALL.map(Method::name).join(", ");
            Failure::from_text(
                2,
                format!(
                    "--again {name}: no such method\nhint: the methods are {known}; `{OUTDATED}` is for all of them"
                ),
            )
        })
    };
    Ok(Again {
        methods: names.iter().filter(|name| *name != OUTDATED).map(method).collect::<Result<_, _>>()?,
        outdated: names.iter().any(|name| name == OUTDATED),
    })
}

/// Version and hash of the running program: two builds of one version may find different heights.
fn this_program() -> Result<String, Failure> {
    let bytes = std::fs::read(&Call::this().code);
    let bytes = bytes.map_err(|e| Failure::from_text(4, format!("cannot read the program itself: {e}")))?;
    Ok(format!("sizeup {} ({})", env!("CARGO_PKG_VERSION"), &sha256_hex(&bytes)[..HASH_DIGITS]))
}

fn tell_programs(ui: &Ui, programs: &Programs) {
    let n_outdated = programs.n_outdated();
    if n_outdated > 0 {
        let n: usize = programs.n_outcomes.values().sum();
        ui.warn(format!(
            "{n_outdated} of {n} outcomes were made by another program than this one ({}); --again {OUTDATED} makes \
             them anew",
            programs.written_by
        ));
    }
}

fn failure(error: &BenchmarkError) -> Failure {
    Failure::new(
        if matches!(
            error,
            BenchmarkError::Empty { .. } | BenchmarkError::UnknownChange { .. } | BenchmarkError::UnknownScene { .. }
        ) {
            2
        } else {
            4
        },
        error,
    )
}
