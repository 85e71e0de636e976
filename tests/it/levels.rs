//! Footprints that hold two roof levels are split: towers on podiums, on a simulated downtown.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

use sizeup::config::RunConfig;
use sizeup::evaluate::read::{TruthOptions, read_results, read_truth};
use sizeup::evaluate::{HeightEvaluation, HeightOptions, evaluate_heights};
use sizeup::pipeline::{self, RunOptions, Stage};
use sizeup::simulate::{PriorLevel, SimulateConfig, TownKind, simulate};
use tempfile::TempDir;

/// A roof is stepped if its levels are so far apart, metres.
const TOWER_M: f64 = 15.0;

fn downtown(folder: &Path, seed: u64, n_buildings: usize, n_views: usize) {
    let mut config = SimulateConfig { seed, ..SimulateConfig::default() };
    config.town.kind = TownKind::Downtown;
    config.town.n_buildings = n_buildings;
    config.flight.n_views = Some(n_views);
    (config.camera.width_px, config.camera.height_px, config.prior.longest_px) = (448, 336, 448);
    config.prior.level = PriorLevel::Mid;
    config.images.enabled = false;
    simulate(&config, folder, &|_, _| {}).unwrap();
}

fn load(folder: &Path, settings: &[&str]) -> RunConfig {
    let settings: Vec<String> = settings
        .iter()
        .chain(&["output.pictures=false", "output.report.page=false", "ground.reference=mean"])
        .map(|&s| s.to_owned())
        .collect();
    RunConfig::load(&folder.join("sizeup.toml"), &settings).unwrap()
}

fn run(config: &RunConfig, from: Stage) {
    let options = RunOptions { from, until: Stage::Output, command: "test".to_owned() };
    pipeline::run(config, &options, &|_| {}).unwrap();
}

fn evaluate(folder: &Path, config: &RunConfig) -> HeightEvaluation {
    let results = read_results(&config.project.output.join("city.city.json"), &config.project.crs).unwrap();
    let truth = read_truth(&folder.join("truth.geojson"), &TruthOptions::default(), &config.project.crs).unwrap();
    evaluate_heights(&results, &truth.buildings, &HeightOptions::default()).unwrap()
}

/// The buildings with a tower on them, by the truth.
fn towers(folder: &Path) -> Vec<String> {
    let truth: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("truth.geojson")).unwrap()).unwrap();
    let features = truth["features"].as_array().unwrap().iter().map(|f| &f["properties"]);
    // Of the whole footprint, most lies far below the top.
    let is_tower = |p: &&serde_json::Value| p["ridge_m"].as_f64().unwrap() - p["height_m"].as_f64().unwrap() > TOWER_M;
    features.filter(is_tower).map(|p| p["id"].as_str().unwrap().to_owned()).collect()
}

/// A downtown with towers on podiums, and the result of its run; tests write into copies.
fn solved() -> &'static Path {
    static SCENE: LazyLock<TempDir> = LazyLock::new(|| {
        let folder = tempfile::tempdir().unwrap();
        downtown(folder.path(), 14, 16, 48);
        run(&load(folder.path(), &[]), Stage::Survey);
        folder
    });
    SCENE.path()
}

fn copy_of_solved() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let status = Command::new("cp").arg("-r").arg(solved().join(".")).arg(folder.path()).status().unwrap();
    assert!(status.success());
    folder
}

#[test]
fn towers_are_taken_off_their_podiums_and_nothing_else_is_taken_apart() {
    let folder = copy_of_solved();
    let towers = towers(folder.path());
    assert!(towers.len() >= 2, "the scene has {} towers on podiums", towers.len());

    let config = load(folder.path(), &[]);
    let records = read_results(&config.project.output.join("city.city.json"), &config.project.crs).unwrap();
    let mut apart: Vec<String> = records.iter().filter_map(|r| r.part_of.clone()).collect();
    apart.sort_unstable();
    apart.dedup();
    assert_eq!(apart, towers);

    let with = evaluate(folder.path(), &config);
    assert_eq!(with.counts.n_compared, with.counts.n_truth, "parts count as the building they are of");
    let worst_m = with.buildings.iter().map(|b| b.signed_error_m.abs()).fold(0.0, f64::max);
    // A tower of 60 m on a quarter of its footprint: a metre of its plan is a metre of the mean.
    assert!(worst_m < 4.0, "worst {worst_m:.1} m");

    let whole = load(folder.path(), &["optimise.search.split_levels=false"]);
    run(&whole, Stage::Heights);
    let without = evaluate(folder.path(), &whole);
    let mean = |e: &HeightEvaluation| e.all.as_ref().unwrap().error_mean_m;
    assert!(mean(&with) < 0.5 * mean(&without), "{:.2} m with, {:.2} m without", mean(&with), mean(&without));
}

/// One tower of 116 m stands on a podium so wide that hardly a photo holds all of it at the tower's height; most hold
/// its foot.
#[test]
fn a_podium_that_leaves_the_photos_at_its_towers_height_is_seen_at_its_foot() {
    let folder = tempfile::tempdir().unwrap();
    downtown(folder.path(), 21, 30, 70);
    let config = load(folder.path(), &[]);
    run(&config, Stage::Survey);
    let with = evaluate(folder.path(), &config);
    let worst_m = with.buildings.iter().map(|b| b.signed_error_m.abs()).fold(0.0, f64::max);
    assert!(worst_m < 4.0, "worst {worst_m:.1} m");
}

#[test]
fn the_output_stage_alone_takes_apart_what_the_heights_stage_did() {
    let folder = copy_of_solved();
    let config = load(folder.path(), &[]);
    let city = config.project.output.join("city.city.json");
    let first = fs::read(&city).unwrap();
    fs::remove_file(&city).unwrap();
    run(&config, Stage::Output);
    assert_eq!(fs::read(&city).unwrap(), first);
}
