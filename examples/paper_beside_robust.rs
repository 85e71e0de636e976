//! The published solver beside ours, on a simulated town with known heights.
//!
//! `cargo run --release --example paper_beside_robust`.

#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use sizeup::config::RunConfig;
use sizeup::evaluate::read::{TruthOptions, read_truth};
use sizeup::evaluate::{HeightOptions, evaluate_heights};
use sizeup::optimise::Preset;
use sizeup::pipeline;
use sizeup::simulate::{SimulateConfig, simulate};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let mut town = SimulateConfig::default();
    town.town.n_buildings = 20;
    town.flight.n_views = Some(60);
    (town.camera.width_px, town.camera.height_px, town.prior.longest_px) = (320, 240, 320);
    town.images.enabled = false;
    let scene = simulate(&town, folder.path(), &|_, _| {})?;

    for preset in [Preset::Robust, Preset::Paper] {
        let mut config = RunConfig::load(&scene.run_config, &[])?;
        (config.optimise.preset, config.output.pictures) = (preset, false);
        config.project.output = folder.path().join(format!("{preset:?}"));
        let city = pipeline::city(&config, &|_| {})?;

        let truth = read_truth(&scene.truth, &TruthOptions::default(), &config.project.crs)?;
        let errors = evaluate_heights(&city.records, &truth.buildings, &HeightOptions::default())?.all;
        let errors = errors.ok_or("no building has a height")?;
        println!(
            "{preset:?}: mean error {:.2} m, 90 % within {:.2} m, {} photos used",
            errors.error_mean_m, errors.error_p90_m, city.summary.n_used_views
        );
    }
    Ok(())
}
