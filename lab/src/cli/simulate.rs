//! `sizeup-lab simulate`: a scene with known truth.

use std::path::PathBuf;

use clap::Args;

use sizeup::cli::{Failure, Global, Ui, print_json, simulate_scene};
use sizeup::config;
use sizeup_truth::simulate::SimulateConfig;

/// Arguments of `sizeup-lab simulate`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:
  sizeup-lab simulate --preset district --output scene
  sizeup-lab simulate --preset village --set prior.level=high --set seed=7 --output scene
  sizeup-lab simulate --set cityjson.path=rotterdam.city.json --output scene")]
pub struct SimulateArgs {
    /// Name of a ready scene.
    #[arg(long, default_value = "demo", value_parser = preset_names())]
    pub preset: String,
    /// Settings file (TOML) in place of a preset.
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    pub config: Option<PathBuf>,
    /// Set one key, as in `--set prior.level=high`. May be repeated; `sizeup-lab schema` lists the keys.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub assignments: Vec<String>,
    /// Folder of the scene.
    #[arg(long, short, value_name = "FOLDER")]
    pub output: PathBuf,
}

fn preset_names() -> clap::builder::PossibleValuesParser {
    clap::builder::PossibleValuesParser::new(SimulateConfig::preset_names())
}

pub(super) fn run(args: &SimulateArgs, global: &Global) -> Result<u8, Failure> {
    let text = match &args.config {
        Some(path) => std::fs::read_to_string(path)
            .map_err(|e| Failure::from_text(2, format!("cannot read {}: {e}", path.display())))?,
        None => {
            let preset = SimulateConfig::preset(&args.preset).map_err(|e| Failure::new(2, &e))?;
            toml::to_string(&preset).map_err(|e| Failure::new(4, &e))?
        }
    };
    let config: SimulateConfig =
        config::parse_scene(&text, args.config.as_deref(), &args.assignments).map_err(|e| Failure::new(2, &e))?;
    let ui = Ui::new(global);
    let summary = simulate_scene(&config, &args.output, &ui)?;
    ui.say(format!(
        "{} buildings of {:.0} to {:.0} m, {} views ({} nadir) in {}",
        summary.n_buildings,
        summary.height_range_m[0],
        summary.height_range_m[1],
        summary.n_views,
        summary.n_nadir,
        args.output.display()
    ));
    ui.say(format!("next: sizeup run {}", summary.run_config.display()));
    if global.json {
        print_json(&summary)?;
    }
    Ok(0)
}
