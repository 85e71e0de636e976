//! Runs that say what they could not find: ranges that hold, issues of every doubt, priors chosen.

use std::fs;

use serde_json::{Value, json};
use sizeup::simulate::{PriorLevel, SimulateConfig, TownKind, simulate};

use crate::tiny_scene::{N_BUILDINGS, Scene};

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

#[test]
fn without_a_choice_of_priors_a_run_without_photos_says_what_is_missing() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| {
        let (before, rest) = text.split_once("[prior]").unwrap();
        let (_, after) = rest.split_once("\n[").unwrap();
        format!("{before}[prior]\nsource = \"auto\"\n\n[{after}")
    });
    let auto = scene.run(&[]);
    assert_ne!(auto.code, 0);
    assert!(auto.stderr.contains("auto finds no source") && auto.stderr.contains("survey.images"), "{}", auto.stderr);
}

/// A simulated town without photos.
fn town(kind: TownKind, seed: u64, level: PriorLevel, n_views: usize) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let mut config = SimulateConfig { seed, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (kind, 20);
    (config.flight.n_views, config.prior.level) = (Some(n_views), level);
    (config.images.enabled, config.masks.enabled) = (false, false);
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    Scene::of(folder)
}

const PLAIN: [&str; 4] = ["--set", "output.pictures=false", "--set", "output.report.page=false"];

/// Box around a footprint: west, south, east, north.
fn box_of(feature: &Value) -> [f64; 4] {
    let corners = feature["geometry"]["coordinates"][0].as_array().unwrap().iter();
    corners.fold([f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY], |[w, s, e, n], corner| {
        let (x, y) = (corner[0].as_f64().unwrap(), corner[1].as_f64().unwrap());
        [w.min(x), s.min(y), e.max(x), n.max(y)]
    })
}

/// Adds footprints on open ground, each like one of the layer, 3 m and more from all others.
fn add_where_nothing_stands(features: &mut Vec<Value>) {
    let mut boxes: Vec<[f64; 4]> = features.iter().map(box_of).collect();
    for at in 0..6 {
        let mut ways = (0..48).map(|i| {
            let turn = f64::from(i % 12) * std::f64::consts::TAU / 12.0;
            let far_m = 20.0 + 5.0 * f64::from(i / 12);
            [far_m * turn.cos(), far_m * turn.sin()]
        });
        let [west, south, east, north] = box_of(&features[at]);
        let free = ways.find(|[x, y]| {
            boxes.iter().all(|b| {
                west + x > b[2] + 3.0 || east + x < b[0] - 3.0 || south + y > b[3] + 3.0 || north + y < b[1] - 3.0
            })
        });
        let Some([x, y]) = free else { continue };
        let mut gone = features[at].clone();
        gone["properties"]["id"] = json!(format!("gone{at}"));
        for corner in
            gone["geometry"]["coordinates"].as_array_mut().unwrap().iter_mut().flat_map(|r| r.as_array_mut().unwrap())
        {
            corner[0] = json!(corner[0].as_f64().unwrap() + x);
            corner[1] = json!(corner[1].as_f64().unwrap() + y);
        }
        boxes.push([west + x, south + y, east + x, north + y]);
        features.push(gone);
    }
}

#[test]
fn buildings_that_were_pulled_down_are_not_measured_and_open_ground_is_named() {
    let scene = town(TownKind::Downtown, 43, PriorLevel::High, 40);
    scene.change_footprints(add_where_nothing_stands);
    let outcome = scene.run(&PLAIN);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let gone: Vec<(String, String)> = scene.statuses().into_iter().filter(|(id, _)| id.starts_with("gone")).collect();
    assert!(gone.len() >= 4, "{gone:?}");
    assert!(gone.iter().all(|(_, status)| status != "measured"), "{gone:?}");
    let found = buildings(&scene);
    let is_open = |attributes: &Value| {
        let mut reasons = attributes["reasons"].as_array().into_iter().flatten();
        reasons.any(|reason| reason == "nothing_stands_here")
    };
    let (open, standing): (Vec<_>, Vec<_>) = found.iter().partition(|(id, _)| id.starts_with("gone"));
    let n_open = open.iter().filter(|(_, attributes)| is_open(attributes)).count();
    assert!(n_open >= 2, "{n_open} of {gone:?}");
    let n_wrong = standing.iter().filter(|(_, attributes)| is_open(attributes)).count();
    assert!(n_wrong <= 1, "{n_wrong} buildings that stand are said not to");
    assert!(scene.issues("height_doubtful").iter().any(|issue| {
        issue["message"].as_str().unwrap().contains("the bare ground explains them as well")
            && issue["hint"].is_string()
    }));
}

#[test]
fn priors_of_other_photos_are_named_photo_by_photo_and_left_out() {
    let scene = town(TownKind::Village, 41, PriorLevel::Mid, 50);
    let mean_error_m = || {
        let outcome = scene.sizeup(&["evaluate", "result/city.city.json", "truth.geojson", "--json"]);
        let evaluated: Value = serde_json::from_str(&outcome.stdout).unwrap();
        evaluated["all"]["error_mean_m"].as_f64().unwrap()
    };
    assert_eq!(scene.run(&PLAIN).code, 0);
    assert_eq!(scene.issues("prior_disagrees"), Vec::<Value>::new(), "all priors are those of their photos");
    let as_it_was_m = mean_error_m();
    // Every second oblique photo has the prior of the next of these.
    let oblique: Vec<String> = scene.stems().into_iter().filter(|stem| stem.ends_with("oblique")).collect();
    let exchanged: Vec<&String> = oblique.iter().step_by(2).collect();
    let priors: Vec<Vec<u8>> =
        exchanged.iter().map(|stem| fs::read(scene.path(&format!("priors/{stem}.npy"))).unwrap()).collect();
    for (i, stem) in exchanged.iter().enumerate() {
        fs::write(scene.path(&format!("priors/{stem}.npy")), &priors[(i + 1) % priors.len()]).unwrap();
    }
    assert_eq!(scene.run(&PLAIN).code, 0);
    let told = scene.issues("prior_disagrees");
    let name_of = |issue: &Value| issue["subject"]["id"].as_str().unwrap().split('.').next().unwrap().to_owned();
    let named: Vec<String> = told.iter().map(name_of).collect();
    let wrong: Vec<&String> = named.iter().filter(|name| !exchanged.contains(name)).collect();
    assert!(wrong.is_empty(), "{wrong:?} have their own priors");
    // Views at the edge show too few buildings.
    assert!(5 * named.len() >= 4 * exchanged.len(), "{} of {} named", named.len(), exchanged.len());
    assert!(told[0]["message"].as_str().unwrap().contains("correlation") && told[0]["hint"].is_string());
    let exchanged_m = mean_error_m();
    assert!(
        exchanged_m < as_it_was_m + 0.2,
        "{as_it_was_m:.2} m with all priors, {exchanged_m:.2} m without half of them"
    );
}

#[test]
fn of_a_building_that_the_layer_has_twice_the_first_is_measured_and_the_other_refused() {
    let scene = Scene::new();
    assert!([0, 5].contains(&scene.run(&[]).code));
    let before = scene.statuses();
    scene.change_footprints(|features| {
        for at in 0..2 {
            let mut twin = features[at].clone();
            twin["properties"]["id"] = json!(format!("{}-twin", features[at]["properties"]["id"].as_str().unwrap()));
            features.push(twin);
        }
    });
    let outcome = scene.run(&[]);
    assert_eq!(outcome.code, 5, "{}", outcome.stderr);
    let (twins, others): (Vec<_>, Vec<_>) = scene.statuses().into_iter().partition(|(id, _)| id.ends_with("-twin"));
    assert_eq!(others, before);
    assert!(twins.len() == 2 && twins.iter().all(|(_, status)| status == "refused"), "{twins:?}");
    for issue in scene.issues("footprint_duplicate") {
        let id = issue["subject"]["id"].as_str().unwrap();
        assert!(issue["message"].as_str().unwrap().contains(id.trim_end_matches("-twin")) && issue["place"].is_array());
    }
    assert_eq!(scene.issues("footprint_duplicate").len(), 2);
    assert!(scene.issues("footprint_overlap").is_empty());
}

/// A rising change of a prior's values, and its name.
type Change = (&'static str, fn(f32) -> f32);

/// A prior's file with each value changed, from the least as 0 to the greatest as 1.
fn bent(file: &[u8], change: fn(f32) -> f32) -> Vec<u8> {
    let (header, data) = file.split_at(10 + usize::from(u16::from_le_bytes([file[8], file[9]])));
    let values: Vec<f32> = data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = (finite().fold(f32::MAX, f32::min), finite().fold(f32::MIN, f32::max));
    let changed = values.iter().flat_map(|value| change((value - low) / (high - low)).to_le_bytes());
    header.iter().copied().chain(changed).collect()
}

#[test]
fn a_rising_change_of_the_priors_moves_heights_by_no_more_than_their_own_errors() {
    const CHANGES: [Change; 3] = [("as it is", |x| x), ("root", f32::sqrt), ("square", |x| x * x)];
    let scene = town(TownKind::Village, 5, PriorLevel::Mid, 30);
    let config = fs::read_to_string(scene.path("sizeup.toml")).unwrap();
    assert!(config.contains("kind = \"inverse_depth\""), "{config}");
    let truth = scene.json("truth.geojson");
    let true_height_m = |id: &str| {
        let mut features = truth["features"].as_array().unwrap().iter().map(|feature| &feature["properties"]);
        features.find(|of| of["id"] == id)?["height_m"].as_f64()
    };
    let paths = scene.stems().into_iter().map(|stem| scene.path(&format!("priors/{stem}.npy")));
    let priors: Vec<_> = paths.map(|path| (fs::read(&path).unwrap(), path)).collect();
    for preset in ["robust", "paper"] {
        let mut errors_m = Vec::new();
        for (name, change) in CHANGES {
            priors.iter().for_each(|(file, path)| fs::write(path, bent(file, change)).unwrap());
            let set = format!("optimise.preset={preset}");
            let outcome = scene.run(&[&PLAIN[..], &["--set", &set]].concat());
            assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
            let found = buildings(&scene);
            let errors = found.iter().filter_map(|(id, found)| Some(found["height_m"].as_f64()? - true_height_m(id)?));
            let errors: Vec<f64> = errors.map(f64::abs).collect();
            assert!(errors.len() >= 18, "{preset}, {name}: {} heights", errors.len());
            errors_m.push(errors.iter().sum::<f64>() / errors.len() as f64);
        }
        println!("{preset}: {errors_m:.2?}");
        let (as_it_is, changed) = errors_m.split_first().unwrap();
        // Errors of a mean over twenty buildings.
        assert!(changed.iter().all(|error| *error < *as_it_is + 0.2), "{preset}: {errors_m:.2?}");
    }
}
