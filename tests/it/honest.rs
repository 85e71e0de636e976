//! Runs that say what they could not find: ranges that hold, issues of every doubt, a wrong terrain, priors chosen.

use std::fs;
use std::path::Path;

use serde_json::Value;
use sizeup::simulate::{SimulateConfig, TownKind, simulate};

use crate::tiny_scene::{N_BUILDINGS, Outcome, Scene, sizeup};

/// Id, and the attributes of every solid of the last run.
fn buildings(scene: &Scene) -> Vec<(String, Value)> {
    let city = scene.json("result/city.city.json");
    let objects = city["CityObjects"].as_object().unwrap();
    let with_height = objects.iter().filter(|(_, object)| object["attributes"]["height_m"].is_number());
    with_height.map(|(id, object)| (id.clone(), object["attributes"].clone())).collect()
}

#[test]
fn no_height_is_stated_outside_the_range_whatever_stage_sets_it() {
    let scene = Scene::new();
    for (min_m, max_m, reference) in
        [(2.0, 12.0, "mean"), (2.0, 12.0, "ridge"), (9.0, 30.0, "eave"), (2.0, 6.0, "mean")]
    {
        let set = [
            format!("heights.min_m={min_m}"),
            format!("heights.max_m={max_m}"),
            format!("optimise.height_reference={reference}"),
        ];
        let outcome = scene.run(&set.iter().flat_map(|set| ["--set", set]).collect::<Vec<_>>());
        assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
        let found = buildings(&scene);
        assert!(!found.is_empty());
        for (id, attributes) in found {
            let height_m = attributes["height_m"].as_f64().unwrap();
            // Files round to the millimetre.
            assert!((min_m - 1e-3..=max_m + 1e-3).contains(&height_m), "{id}: {height_m} m of {min_m} to {max_m}");
            let ridge_m = attributes["ridge_height_m"].as_f64().unwrap_or(height_m);
            assert!(ridge_m <= max_m + 1e-3, "{id}: a ridge at {ridge_m} m of at most {max_m}");
        }
    }
}

#[test]
fn every_building_that_is_not_measured_is_an_issue_and_counts_agree() {
    let scene = Scene::new();
    // The tops of the blocks are out of reach, so their heights are at the end of the range.
    let outcome = scene.run(&["--set", "heights.max_m=6"]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let issues = scene.json("result/issues.json");
    let told: Vec<&Value> = issues.as_array().unwrap().iter().filter(|i| i["subject"]["kind"] == "building").collect();
    let doubtful: Vec<String> =
        scene.statuses().into_iter().filter(|(_, s)| s != "measured").map(|(id, _)| id).collect();
    assert!(doubtful.len() >= 2, "{:?}", scene.statuses());
    for id in &doubtful {
        let of = |issue: &&&Value| issue["subject"]["id"] == id.as_str();
        let issue = told.iter().filter(of).find(|i| i["code"].as_str().unwrap().starts_with("height_"));
        let issue = issue.unwrap_or_else(|| panic!("{id} is not told of: {told:?}"));
        assert!(issue["place"].is_array() && issue["message"].as_str().unwrap().contains(": "), "{issue}");
    }
    let first = &issues[0];
    assert_eq!(first["code"], "result_implausible", "the whole comes first: {issues}");
    let summary = scene.json("result/summary.json");
    let message = summary["implausible"][0].as_str().unwrap();
    assert_eq!(first["message"], message);
    let text = &outcome.stderr;
    let at = |words: &str| text.find(words).unwrap_or_else(|| panic!("{words:?} in {text}"));
    assert!(at(message) < at("buildings,") && at("doubtful") > 0, "said first: {text}");
    let n: u64 = summary["by_status"].as_object().unwrap().values().filter_map(Value::as_u64).sum();
    assert_eq!((n, &summary["n_buildings"]), (N_BUILDINGS as u64, &Value::from(N_BUILDINGS)));
}

/// Photos over hills, and what a run of them says of the ground.
fn told_of_ground(folder: &Path, more: &[&str]) -> (Vec<Value>, Value) {
    let mut command = sizeup();
    command.arg("run").arg(folder.join("sizeup.toml")).args(["--set", "output.report.page=false"]).args(more);
    let outcome: Outcome = command.output().unwrap().into();
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let read =
        |name: &str| -> Value { serde_json::from_slice(&fs::read(folder.join("result").join(name)).unwrap()).unwrap() };
    let is_of_ground = |issue: &&Value| issue["code"].as_str().unwrap().starts_with("terrain_");
    let issues = read("issues.json");
    (issues.as_array().unwrap().iter().filter(is_of_ground).cloned().collect(), read("summary.json"))
}

#[test]
fn a_wrong_terrain_is_told_and_a_right_one_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = SimulateConfig { seed: 5, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::District, 12);
    config.flight.n_views = Some(30);
    (config.camera.width_px, config.camera.height_px, config.prior.longest_px) = (640, 480, 320);
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let (right, _) = told_of_ground(folder.path(), &["--set", "output.pictures=false"]);
    assert_eq!(right, Vec::<Value>::new(), "the terrain of the scene fits");
    let text = fs::read_to_string(folder.path().join("sizeup.toml")).unwrap();
    let dtm = text.lines().find(|line| line.starts_with("dtm = ")).unwrap();
    let shifted = text.replace(dtm, &format!("{dtm}\nvertical_offset_m = 3.0"));
    fs::write(folder.path().join("sizeup.toml"), shifted).unwrap();
    let (wrong, summary) = told_of_ground(folder.path(), &["--set", "output.pictures=false"]);
    assert_eq!(wrong.len(), 1);
    assert!(wrong[0]["message"].as_str().unwrap().contains("m lower than the terrain says"), "{wrong:?}");
    let measured = summary["by_status"]["measured"].as_u64().unwrap_or(0);
    assert!(measured <= 3, "heights over a ground that is 3 m off are not measured: {summary}");
}

#[test]
fn without_a_choice_of_priors_a_run_without_photos_says_what_is_missing() {
    let scene = Scene::new();
    let flags =
        ["run", "--crs", "EPSG:25832", "--survey", "sparse", "--footprints", "footprints.gpkg", "--dtm", "dtm.tif"];
    let text = fs::read_to_string(scene.path("sizeup.toml")).unwrap();
    let offset = text.lines().find(|line| line.starts_with("offset")).unwrap().replace(" = ", "=");
    let set = format!("survey.{offset}");
    let auto = scene.sizeup(&[&flags[..], &["--set", &set]].concat());
    assert_ne!(auto.code, 0);
    assert!(auto.stderr.contains("auto finds no source") && auto.stderr.contains("survey.images"), "{}", auto.stderr);
    let stereo =
        scene.sizeup(&[&flags[..], &["--prior-source", "stereo", "--priors", "x", "--prior-kind", "depth"]].concat());
    assert_eq!(stereo.code, 2, "{}", stereo.stderr);
}
