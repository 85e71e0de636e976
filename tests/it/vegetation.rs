//! Trees that stand at walls, their crowns over roofs: told by their green in the photos, and no part of any height.

use std::path::Path;

use serde_json::Value;
use sizeup::simulate::{SimulateConfig, TownKind, simulate};

use crate::tiny_scene::{Outcome, sizeup};

fn village(folder: &Path) {
    let mut config = SimulateConfig { seed: 43, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::Village, 14);
    (config.town.trees_per_building, config.town.trees_at_walls) = (2.0, 1.0);
    config.flight.n_views = Some(20);
    (config.camera.width_px, config.camera.height_px) = (600, 450);
    config.masks.enabled = false;
    simulate(&config, folder, &|_, _| {}).unwrap();
}

/// Mean and greatest error of all heights, metres, and the photos that could not be read.
fn run(folder: &Path, more: &[&str]) -> (f64, f64, Vec<String>) {
    let mut command = sizeup();
    command.arg("run").arg(folder.join("sizeup.toml")).args(more);
    command.args(["--set", "output.pictures=false", "--set", "output.report.page=false"]);
    let outcome: Outcome = command.output().unwrap().into();
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let issues: Value = serde_json::from_slice(&std::fs::read(folder.join("result/issues.json")).unwrap()).unwrap();
    let unread = issues.as_array().unwrap().iter().filter(|issue| issue["code"] == "photo_unreadable");
    let unread = unread.map(|issue| issue["subject"]["id"].as_str().unwrap_or_default().to_owned()).collect();
    let mut command = sizeup();
    command.arg("evaluate").arg(folder.join("result/city.city.json")).arg(folder.join("truth.geojson")).arg("--json");
    let evaluated: Value = serde_json::from_slice(&command.output().unwrap().stdout).unwrap();
    let of = |key: &str| evaluated["all"][key].as_f64().unwrap();
    (of("error_mean_m"), of("error_max_m"), unread)
}

#[test]
fn trees_over_roofs_are_told_by_their_green() {
    let folder = tempfile::tempdir().unwrap();
    village(folder.path());
    for refined in ["true", "false"] {
        let refined = format!("refinement.enabled={refined}");
        let (told_m, worst_m, unread) = run(folder.path(), &["--set", &refined]);
        let seen_as_roof = ["--set", &refined, "--set", "optimise.search.leave_out_vegetation=false"];
        let (as_roof_m, _, _) = run(folder.path(), &seen_as_roof);
        println!("{refined}: {told_m:.2} m, worst {worst_m:.2} m; taken for roofs {as_roof_m:.2} m");
        assert!(told_m < 0.7 * as_roof_m, "{refined}: {told_m:.2} m against {as_roof_m:.2} m");
        assert_eq!(unread, [""; 0]);
    }
}
