//! Footprints that lie elsewhere than the photos show their buildings: heights as good as in place, and told by how much.

use std::path::Path;

use serde_json::Value;
use sizeup::simulate::{SimulateConfig, TownKind, simulate};

use crate::tiny_scene::{Outcome, sizeup};

fn town(folder: &Path, shift_m: [f64; 2]) {
    let mut config = SimulateConfig { seed: 41, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::Village, 24);
    config.flight.n_views = Some(40);
    (config.images.enabled, config.masks.enabled) = (false, false);
    config.errors.shift_m = shift_m;
    simulate(&config, folder, &|_, _| {}).unwrap();
}

/// Runs a town; its warning of a shifted layer, and the mean error of its heights, metres.
fn run(folder: &Path, more: &[&str]) -> (Option<String>, f64) {
    let mut command = sizeup();
    command.arg("run").arg(folder.join("sizeup.toml")).args(more);
    command.args(["--set", "output.pictures=false", "--set", "output.report.page=false"]);
    let outcome: Outcome = command.output().unwrap().into();
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let read = |path: &Path| -> Value { serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap() };
    let issues = read(&folder.join("result/issues.json"));
    let told = issues.as_array().unwrap().iter().find(|issue| issue["code"] == "footprints_shifted");
    let mut command = sizeup();
    command.arg("evaluate").arg(folder.join("result/city.city.json")).arg(folder.join("truth.geojson")).arg("--json");
    let evaluated: Value = serde_json::from_slice(&command.output().unwrap().stdout).unwrap();
    let say = |issue: &Value| format!("{} {}", issue["message"].as_str().unwrap(), issue["hint"].as_str().unwrap());
    (told.map(say), evaluated["all"]["error_mean_m"].as_f64().unwrap())
}

#[test]
fn a_layer_that_is_off_by_metres_is_told_and_costs_no_height() {
    let folders: Vec<_> = (0..2).map(|_| tempfile::tempdir().unwrap()).collect();
    town(folders[0].path(), [0.0, 0.0]);
    let (told, in_place_m) = run(folders[0].path(), &[]);
    assert_eq!(told, None, "this one is in place");
    town(folders[1].path(), [2.0, -1.5]);
    let (told, shifted_m) = run(folders[1].path(), &[]);
    let told = told.expect("this one is 2.5 m off");
    // "… shift_m = [-2.0, 1.5] …": within the error of the footprints' own corners and half a pixel.
    let numbers = told.split("shift_m = [").nth(1).and_then(|rest| rest.split(']').next()).unwrap();
    let way: Vec<f64> = numbers.split(", ").map(|number| number.parse().unwrap()).collect();
    assert!((way[0] + 2.0).abs() <= 0.4 && (way[1] - 1.5).abs() <= 0.4, "{told}");
    assert!(told.contains("east and") && told.contains("south of where the photos show"), "{told}");
    // The ground under a footprint that is elsewhere is another one: on these slopes a decimetre.
    assert!(shifted_m < in_place_m + 0.15, "{shifted_m:.2} m against {in_place_m:.2} m in place");
    // Without a look at its footprints, neither together nor one by one.
    let blind = ["--set", "optimise.search.measure_shift=false"];
    let (_, untold_m) = run(folders[1].path(), &blind);
    assert!(untold_m > in_place_m + 0.4, "the scene is one where it matters: {untold_m:.2} m");
    // Moved back by as much as it says it is in place.
    let (told, moved_m) = run(folders[1].path(), &["--set", "footprints.shift_m=[-2.0, 1.5]"]);
    assert_eq!(told, None);
    assert!(moved_m < in_place_m + 0.15, "{moved_m:.2} m against {in_place_m:.2} m in place");
}

/// Without photos nothing shows the ground but the depth beside buildings.
#[test]
fn a_terrain_that_is_3_m_off_is_reported_by_depth_alone_and_no_height_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    town(folder.path(), [0.0, 0.0]);
    let found = |offset_m: f64| {
        let offset = format!("terrain.vertical_offset_m={offset_m}");
        run(folder.path(), &["--set", &offset]);
        let read = |name: &str| -> Value {
            serde_json::from_slice(&std::fs::read(folder.path().join("result").join(name)).unwrap()).unwrap()
        };
        let issues = read("issues.json");
        let is_of_terrain = |issue: &&Value| issue["code"].as_str().unwrap().starts_with("terrain_");
        let told = issues.as_array().unwrap().iter().find(is_of_terrain);
        let told = told.map(|issue| [&issue["code"], &issue["message"]].map(|text| text.as_str().unwrap().to_owned()));
        let by_status = read("summary.json")["by_status"].clone();
        (told, by_status["measured"].as_u64().unwrap_or(0))
    };
    let (told, n_measured) = found(0.0);
    assert_eq!(told, None, "the terrain of the scene fits");
    assert!(n_measured >= 18, "{n_measured}");
    for (offset_m, code, than) in [(3.0, "terrain_too_high", "m lower"), (-3.0, "terrain_too_low", "m higher")] {
        let (told, n_measured) = found(offset_m);
        let [told_code, message] = told.unwrap_or_else(|| panic!("{offset_m} m are not told"));
        assert!(told_code == code && message.contains(than), "{told_code}: {message}");
        // 2.4 to 4.5 m over two villages: a warning, no measurement.
        let figure: f64 = message.split(' ').find_map(|word| word.parse().ok()).unwrap();
        assert!((2.0..5.0).contains(&figure), "{message}");
        assert_eq!(n_measured, 0, "{message}");
    }
}
