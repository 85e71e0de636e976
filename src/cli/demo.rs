//! `sizeup demo`: the main job on data of our own, start to end.

use std::path::{Path, PathBuf};

use clap::Args;

use super::run::report_summary;
use super::{EXIT_FAILED, Failure, Global, Ui, print, print_json};
use crate::config::RunConfig;
use crate::pipeline::{self, RunOptions, Stage};
use sizeup_truth::evaluate::read::{TruthOptions, read_results, read_truth};
use sizeup_truth::evaluate::{HeightOptions, evaluate_heights};
use sizeup_truth::simulate::{SimulateConfig, SimulateError, SimulationSummary, simulate};

/// Arguments of `sizeup demo`.
#[derive(Debug, Clone, Args)]
pub struct DemoArgs {
    /// Folder of everything the demo makes.
    #[arg(long, short, value_name = "FOLDER", default_value = "sizeup-demo")]
    pub output: PathBuf,
}

pub(super) fn run(args: &DemoArgs, global: &Global) -> Result<u8, Failure> {
    let ui = Ui::new(global);
    ui.say("1 of 3: simulating a small town with known heights: photos, poses, footprints, terrain and depth priors (half of the time)");
    let preset = SimulateConfig::preset("demo").map_err(|e| Failure::new(4, &e))?;
    let scene = simulate_scene(&preset, &args.output.join("scene"), &ui)?;

    if let Some(photo) = first_photo(&args.output.join("scene/images")) {
        ui.say(format!("   a photo of the town: {}", photo.display()));
    }
    ui.say("2 of 3: finding the heights: this is what `sizeup run` does with your data (the other half)");
    let mut config = RunConfig::load(&scene.run_config, &[]).map_err(|e| Failure::new(4, &e))?;
    config.limits.set();
    config.project.output = args.output.join("result");
    let options = RunOptions { from: Stage::Survey, until: Stage::Output, command: "sizeup demo".to_owned() };
    let summary = pipeline::run(&config, &options, &|event| ui.tell(event));
    report_summary(&ui, summary)?;

    ui.say("3 of 3: comparing with the truth");
    let results = read_results(&config.project.output.join("city.city.json"), &config.project.crs);
    let results = results.map_err(|e| Failure::new(4, &e))?;
    let truth = read_truth(&scene.truth, &TruthOptions::default(), &config.project.crs);
    let truth = truth.map_err(|e| Failure::new(4, &e))?;
    let evaluation = evaluate_heights(&results, &truth.buildings, &HeightOptions::default());
    let evaluation = evaluation.map_err(|e| Failure::new(4, &e))?;
    if global.json {
        print_json(&evaluation)?;
    } else {
        print(&evaluation)?;
    }

    let result = config.project.output.display();
    ui.say(format!(
        "Look at it:\n  {result}/report.html      open in a browser: the city in 3D, and what was seen of each building\n  {result}/city.gpkg        open in QGIS: it comes styled, coloured by height\n  \
         {result}/city.city.json  the solids, for a viewer such as https://ninja.cityjson.org\n\
         Run it on your own data:\n  {}  is the configuration to copy; `sizeup run --help` says more",
        scene.run_config.display()
    ));
    Ok(0)
}

/// Returns the first photo by name, for a person to look at while the program works.
fn first_photo(folder: &Path) -> Option<PathBuf> {
    std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path())).min()
}

/// Simulates a scene with a progress bar.
///
/// # Errors
/// [`Failure`], as a usage error where a setting is at fault, and as bad input where a file of real buildings is.
pub fn simulate_scene(config: &SimulateConfig, output: &Path, ui: &Ui) -> Result<SimulationSummary, Failure> {
    let summary = simulate(config, output, &|done, total| ui.advance("simulating", done, total));
    ui.finish();
    summary.map_err(|e| {
        let exit_code = match &e {
            SimulateError::Setting { .. } | SimulateError::UnknownPreset { .. } | SimulateError::Crs(_) => 2,
            SimulateError::CityJson { .. } => 3,
            SimulateError::File(file) if file.is_of_input() => 3,
            _ => EXIT_FAILED,
        };
        Failure::new(exit_code, &e)
    })
}
