//! `sizeup-lab baseline`: quick and simple ways to heights and bodies, on the input of a run.

use std::cell::RefCell;
use std::path::PathBuf;

use clap::Args;

use crate::benchmark::{Aids, Method};
use sizeup::cli::{Call, EXIT_FAILED_ITEMS, Failure, Global, Ui, config_file, print_json, tell_summary};
use sizeup::config::RunConfig;
use sizeup::pipeline::{self, RunOptions, Stage};
use sizeup_heights::optimise::{OptimiseConfig, Problem};
use sizeup_truth::evaluate::cloud_in_project;
use sizeup_truth::evaluate::read::{TruthOptions, read_truth};
use sizeup_truth::evaluate::solid::write_obj;

/// Arguments of `sizeup-lab baseline`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup-lab baseline metric_lift sizeup.toml --output lift
  sizeup-lab baseline points_p90 sizeup.toml --cloud dense.laz --output lidar
  sizeup-lab baseline stacked_prisms sizeup.toml --cloud points.xyz --output stacks
  sizeup-lab baseline neighbourhood sizeup.toml --known cadastre.gpkg --output guess

Results are those of `sizeup run`; hulls and stacked prisms are written as bodies.obj beside them.")]
pub struct BaselineArgs {
    /// Method to run: a yardstick for the height solver.
    #[arg(value_parser = names())]
    pub method: String,
    /// Configuration, as for `sizeup run` (default: sizeup.toml in this folder).
    pub config: Option<PathBuf>,
    /// Folder of the results (not that of a run).
    #[arg(long, short, value_name = "FOLDER")]
    pub output: PathBuf,
    /// Point cloud (LAS, LAZ, XYZ), for the methods that need one. It is brought to the project's CRS; one that states none
    /// is taken to be in it.
    #[arg(long, value_name = "FILE")]
    pub cloud: Option<PathBuf>,
    /// Layer with known heights, for `constant` (their median) and `neighbourhood`.
    #[arg(long, value_name = "FILE")]
    pub known: Option<PathBuf>,
    /// Set one key of the configuration. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
}

/// The methods that are no solver of `sizeup run`.
fn names() -> clap::builder::PossibleValuesParser {
    let solvers = [Method::Paper, Method::Robust];
    let methods = Method::ALL.into_iter().filter(|method| !solvers.contains(method));
    let value = |method: Method| clap::builder::PossibleValue::new(method.name()).help(method.definition());
    clap::builder::PossibleValuesParser::new(methods.map(value))
}

pub(super) fn run(args: &BaselineArgs, global: &Global) -> Result<u8, Failure> {
    let method = Method::named(&args.method).expect("the parser takes known names only");
    let mut config =
        RunConfig::load(&config_file(args.config.as_deref())?, &args.assignments).map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    config.project.output.clone_from(&args.output);
    let aids = aids(method, args, &config)?;
    let bodies = RefCell::new(None);
    let solver = |problem: &Problem<'_>, config: &OptimiseConfig| {
        let answer = method.answer(problem, config, &aids);
        bodies.replace(answer.bodies);
        answer.solution
    };
    let options = RunOptions { from: Stage::Survey, until: Stage::Output, command: Call::this().line() };
    let ui = Ui::new(global);
    let summary = pipeline::run_with(&config, &options, &|event| ui.tell(event), &solver)
        .map_err(|e| Failure::new(e.exit_code(), &e))?;
    ui.finish();
    if let Some(bodies) = bodies.take() {
        let path = args.output.join("bodies.obj");
        write_obj(&path, &bodies).map_err(|e| Failure::new(4, &e))?;
        ui.say(format!("{} bodies in {}", bodies.len(), path.display()));
    }
    tell_summary(&ui, &summary);
    if global.json {
        print_json(&summary)?;
    }
    Ok(if summary.has_failed_items() { EXIT_FAILED_ITEMS } else { 0 })
}

fn aids(method: Method, args: &BaselineArgs, config: &RunConfig) -> Result<Aids, Failure> {
    let needs = |flag: &str| {
        Failure::from_text(2, format!("{} needs {flag}\nhint: see `sizeup-lab baseline --help`", method.name()))
    };
    let mut aids = Aids::default();
    if method.needs_points() {
        let path = args.cloud.as_ref().ok_or_else(|| needs("--cloud FILE"))?;
        let cloud = cloud_in_project(path, &config.project.crs).map_err(|e| Failure::new(3, &e))?;
        aids.points = cloud.of_buildings();
    }
    if method.needs_known() {
        let path = args.known.as_ref().ok_or_else(|| needs("--known FILE"))?;
        let truth = read_truth(path, &TruthOptions::default(), &config.project.crs).map_err(|e| Failure::new(3, &e))?;
        aids.known = Aids::known_of(&truth.buildings);
        if aids.known.is_empty() {
            return Err(Failure::from_text(
                3,
                format!("{} has no building with a footprint and a height", path.display()),
            ));
        }
    }
    Ok(aids)
}
