//! `sizeup model`: what a depth network wants, and priors ahead of a run.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::flags::config_file;
use super::ui::PRIORS;
use super::{EXIT_FAILED_ITEMS, Failure, Global, Ui, counted, print, print_json};
use crate::config::RunConfig;
use crate::pipeline::{PriorsDone, RunSettings, Wanted, compute_priors};
use sizeup_photos::onnx::{EngineChoice, EngineConfig, Port};
use sizeup_photos::prior::network::{GraphInspection, inspect};

/// Arguments of `sizeup model inspect`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:
  sizeup model inspect depth_anything_v2_small.onnx")]
pub struct InspectPriorArgs {
    /// ONNX file of the network.
    pub model: PathBuf,
    /// Engine that looks at it.
    #[arg(long, value_enum, default_value_t = EngineArg::Auto)]
    pub engine: EngineArg,
    /// ONNX Runtime's shared library.
    #[arg(long, value_name = "FILE")]
    pub library: Option<PathBuf>,
}

/// An engine for networks, on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum EngineArg {
    /// The embedded one where it can run the graph, else ONNX Runtime.
    Auto,
    /// The embedded engine.
    Rten,
    /// ONNX Runtime, where it is installed.
    Onnxruntime,
}

/// Arguments of `sizeup model compute`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup model compute sizeup.toml
  sizeup model compute sizeup.toml --all --set prior.cache.limit_gb=200
  sizeup run sizeup.toml                     finds the priors in the cache

Views that are in the cache already are passed over: the same command goes on after an interruption, and several
processes with the same cache share the work. Exit code 5: some views have no prior.")]
pub struct ComputeArgs {
    /// Configuration file (TOML; default: sizeup.toml in this folder), as that of `sizeup run`.
    pub config: Option<PathBuf>,
    /// All oblique views, not only those that a run selects first: for cities in tiles.
    #[arg(long)]
    pub all: bool,
    /// Set one key of the configuration, as in `--set prior.long_side_px=672`. May be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
}

pub(super) fn run_inspect(args: &InspectPriorArgs, global: &Global) -> Result<u8, Failure> {
    let name = match args.engine {
        EngineArg::Auto => EngineChoice::Auto,
        EngineArg::Rten => EngineChoice::Rten,
        EngineArg::Onnxruntime => EngineChoice::OnnxRuntime,
    };
    let engine = EngineConfig { name, library: args.library.clone(), ..EngineConfig::default() };
    let inspection = inspect(&args.model, &engine).map_err(|e| Failure::new(3, &e))?;
    if global.json {
        print_json(&as_json(&inspection))?;
    } else {
        print(&table_of(&inspection))?;
    }
    Ok(0)
}

pub(super) fn run_compute(args: &ComputeArgs, global: &Global) -> Result<u8, Failure> {
    let config =
        RunConfig::load(&config_file(args.config.as_deref())?, &args.assignments).map_err(|e| Failure::new(2, &e))?;
    config.limits.set();
    let wanted = if args.all { Wanted::AllOblique } else { Wanted::Selected };
    let ui = Ui::new(global);
    // Processes that share the work begin at different views.
    let start = std::process::id() as usize;
    let progress = |done: usize, total: usize| ui.advance_named(PRIORS, done, total);
    let done = compute_priors(&RunSettings::of(&config), wanted, start, &|event| ui.tell(event), &progress)
        .map_err(|e| Failure::new(e.exit_code(), &e))?;
    ui.finish();
    tell_done(&ui, &done);
    if global.json {
        print_json(&done)?;
    }
    Ok(if done.failed.is_empty() { 0 } else { EXIT_FAILED_ITEMS })
}

fn tell_done(ui: &Ui, done: &PriorsDone) {
    const MOST_SHOWN: usize = 5;
    let PriorsDone { n_wanted, n_found, n_computed, n_kept, failed } = done;
    ui.say(format!("{} wanted: {n_computed} computed, {n_found} found in the cache", counted(*n_wanted, "prior")));
    for (view, reason) in failed.iter().take(MOST_SHOWN) {
        ui.say(format!("{view}: {reason}"));
    }
    if failed.len() > MOST_SHOWN {
        ui.say(format!("… and {} more without a prior", counted(failed.len() - MOST_SHOWN, "view")));
    }
    if *n_kept < n_computed + n_found {
        ui.say(format!(
            "only {n_kept} are kept: the cache is at its limit or cannot be written\nhint: raise `prior.cache.limit_gb`"
        ));
    }
}

/// Table of a graph and the profiles that it fits, as lines.
fn table_of(inspection: &GraphInspection) -> String {
    let contents = &inspection.contents;
    let engine = match inspection.engine {
        EngineChoice::OnnxRuntime => "ONNX Runtime",
        EngineChoice::Auto | EngineChoice::Rten => "the embedded engine",
    };
    let n_nodes: usize = contents.operators.values().sum();
    let mut lines = vec![format!("loaded by {engine}; operators of version {}, {n_nodes} nodes", contents.opset)];
    lines.extend(contents.external_files.iter().map(|file| format!("weights in {}", file.display())));
    for (what, ports) in [("input", &inspection.inputs), ("output", &inspection.outputs)] {
        lines.extend(ports.iter().map(|port| format!("{what:<8}{} {}", port.name, shape(port))));
    }
    lines.extend(inspection.profiles.iter().map(|(profile, wiring)| match wiring {
        Ok(wiring) => format!("fits    {} ({}; weights: {})", profile.name, wiring.output, profile.licence),
        Err(reason) => format!("no fit  {}: {reason}", profile.name),
    }));
    let hint = if inspection.profiles.iter().all(|(_, wiring)| wiring.is_err()) {
        "hint: describe it in a TOML file and name that as `profile`; `sizeup schema depth-network` lists the keys"
    } else {
        "hint: several may fit; choose by where the weights come from, not by the graph"
    };
    lines.push(hint.to_owned());
    lines.join("\n")
}

fn shape(port: &Port) -> String {
    if port.shape.is_empty() {
        return "of unsaid shape".to_owned();
    }
    port.shape.iter().map(|n| n.map_or_else(|| "?".to_owned(), |n| n.to_string())).collect::<Vec<_>>().join(" × ")
}

fn as_json(inspection: &GraphInspection) -> Value {
    let ports = |ports: &[Port]| -> Vec<Value> {
        ports.iter().map(|port| json!({ "name": port.name, "shape": port.shape, "numbers": port.numbers })).collect()
    };
    let profiles: Vec<Value> = inspection
        .profiles
        .iter()
        .map(|(profile, wiring)| {
            let reason = wiring.as_ref().err();
            json!({ "name": profile.name, "fits": reason.is_none(), "reason": reason, "licence": profile.licence })
        })
        .collect();
    json!({
        "engine": inspection.engine,
        "opset": inspection.contents.opset,
        "operators": inspection.contents.operators,
        "external_files": inspection.contents.external_files,
        "inputs": ports(&inspection.inputs),
        "outputs": ports(&inspection.outputs),
        "profiles": profiles,
    })
}
