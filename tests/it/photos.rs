//! What photos add to the order of depths: roofs refined where they agree, and the ground of a run that has no model.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use sizeup::crs::Crs;
use sizeup::evaluate::read::{TruthOptions, read_results, read_truth};
use sizeup::evaluate::{BuildingError, HeightEvaluation, HeightOptions, evaluate_heights};
use sizeup::output::BuildingRecord;
use sizeup::output::read::{FoundBuildings, ReadOptions};
use sizeup::simulate::{SimulateConfig, TownKind, simulate};
use tempfile::TempDir;

use crate::real_data::warsaw_config;
use crate::shared_data::shared_data;
use crate::tiny_scene::{Outcome, copy, simulate_from_above, sizeup};

/// A small town with photos, poses good to 0.05 m and 0.05°.
static TOWN: LazyLock<TempDir> = LazyLock::new(|| town(|_| ()));
/// Its result by priors and photos, and by priors alone; tests read them.
static BY_PHOTOS: LazyLock<PathBuf> = LazyLock::new(|| run(TOWN.path(), "photos", &[]));
static BY_PRIORS: LazyLock<PathBuf> = LazyLock::new(|| run(TOWN.path(), "priors", &[BLIND]));
/// The same over a terrain model whose heights count from elsewhere: 3 m too high, and 3 m too low.
static OVER_OFFSET: LazyLock<PathBuf> =
    LazyLock::new(|| run(TOWN.path(), "offset", &["terrain.vertical_offset_m=3.0"]));
static OVER_LOW: LazyLock<PathBuf> = LazyLock::new(|| run(TOWN.path(), "low", &["terrain.vertical_offset_m=-3.0"]));
/// Refinement by photos takes most of a run's time.
const BLIND: &str = "refinement.enabled=false";

fn small_town() -> SimulateConfig {
    let mut config = SimulateConfig { seed: 5, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::District, 12);
    config.flight.n_views = Some(32);
    (config.camera.width_px, config.camera.height_px) = (640, 480);
    config.prior.longest_px = 320;
    config
}

fn town(change: impl Fn(&mut SimulateConfig)) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut config = small_town();
    change(&mut config);
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    folder
}

/// Copies what the town was simulated as, without the results that other tests write into it meanwhile.
fn copy_of_town(to: &Path) {
    for folder in ["sparse", "images", "priors"] {
        copy(&TOWN.path().join(folder), &to.join(folder));
    }
    for file in ["sizeup.toml", "footprints.gpkg", "truth.geojson", "dtm.tif"] {
        fs::copy(TOWN.path().join(file), to.join(file)).unwrap();
    }
}

/// Runs the scene with more settings; its results.
fn run(scene: &Path, name: &str, more: &[&str]) -> PathBuf {
    let result = scene.join(name);
    let mut command = sizeup();
    command.arg("run").arg(scene.join("sizeup.toml")).args([
        "--set",
        "output.report.page=false",
        "--set",
        "output.pictures=false",
    ]);
    command.arg("--set").arg(format!("project.output={}", result.display()));
    let outcome: Outcome = command.args(more.iter().flat_map(|set| ["--set", set])).output().unwrap().into();
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    result
}

fn evaluated(scene: &Path, result: &Path) -> HeightEvaluation {
    let crs = Crs::parse("EPSG:25832").unwrap();
    let results = read_results(&result.join("city.city.json"), &crs).unwrap();
    let truth = read_truth(&scene.join("truth.geojson"), &TruthOptions::default(), &crs).unwrap();
    let evaluation = evaluate_heights(&results, &truth.buildings, &HeightOptions::default()).unwrap();
    assert_eq!(evaluation.buildings.len(), truth.buildings.len(), "buildings compared");
    evaluation
}

fn mean_error_m(scene: &Path, result: &Path) -> f64 {
    evaluated(scene, result).all.unwrap().error_mean_m
}

/// By how much the photos raised each roof that they refined, metres.
fn raised_m(result: &Path) -> Vec<f64> {
    let stage: serde_json::Value =
        serde_json::from_slice(&fs::read(result.join("stages/heights.json")).unwrap()).unwrap();
    let heights = stage["data"]["solution"]["heights"].as_array().unwrap();
    heights.iter().filter_map(|height| height["raised_m"].as_f64()).collect()
}

#[test]
fn photos_refine_roofs_closer_than_priors_do() {
    let scene = TOWN.path();
    let [priors, photos] = [&*BY_PRIORS, &*BY_PHOTOS].map(|result| mean_error_m(scene, result));
    println!("priors {priors:.2} m, photos too {photos:.2} m");
    assert!(raised_m(&BY_PRIORS).is_empty());
    assert!(raised_m(&BY_PHOTOS).len() >= 6, "{:?}", raised_m(&BY_PHOTOS));
    assert!(photos < 0.7 * priors, "{photos} m with photos, {priors} m without");
}

/// One of two blocks around courts has gables, which the priors call flat; of the steep photos that show half of it most cut it off.
#[test]
#[ignore = "slow: make test-slow"]
fn large_blocks_are_refined_by_photos_that_show_parts_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    simulate(&SimulateConfig::preset("demo").unwrap(), scene, &|_, _| {}).unwrap();
    let evaluation = evaluated(scene, &run(scene, "result", &[]));
    let is_court = |building: &&BuildingError| building.group.as_deref() == Some("courtyard");
    let errors_m: Vec<f64> = evaluation.buildings.iter().filter(is_court).map(|b| b.signed_error_m).collect();
    assert!(errors_m.len() == 2 && errors_m.iter().all(|error_m| error_m.abs() < 0.3), "{errors_m:?}");
}

#[test]
fn photos_under_poses_that_are_off_have_no_say_until_they_are_aligned() {
    // The same photos: only the poses are others.
    let shaken = tempfile::tempdir().unwrap();
    copy_of_town(shaken.path());
    let poses = town(|config| {
        (config.errors.position_m, config.errors.angle_deg) = (0.4, 0.25);
        (config.images.enabled, config.masks.enabled, config.prior.longest_px) = (false, false, 16);
    });
    fs::copy(poses.path().join("sparse/images.txt"), shaken.path().join("sparse/images.txt")).unwrap();
    let result = run(shaken.path(), "as-given", &["align.when=never"]);
    assert!(raised_m(&result).len() <= 1, "{:?}", raised_m(&result));
    let aligned = run(shaken.path(), "aligned", &[]);
    assert!(raised_m(&aligned).len() >= 6, "{:?}", raised_m(&aligned));
    let [before, after] = [&result, &aligned].map(|result| mean_error_m(shaken.path(), result));
    println!("poses as given {before:.2} m, aligned {after:.2} m");
    assert!(after < 0.7 * before, "{before} m under the poses as given, {after} m aligned");
}

#[test]
fn a_photo_that_cannot_be_read_is_told_of_and_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    copy_of_town(&scene);
    let mut photos: Vec<PathBuf> =
        fs::read_dir(scene.join("images")).unwrap().map(|entry| entry.unwrap().path()).collect();
    photos.sort();
    // Every fourth; not all of them are asked for.
    photos.iter().step_by(4).for_each(|photo| fs::write(photo, "no photo").unwrap());
    let result = run(&scene, "spoilt", &[]);
    assert!(raised_m(&result).len() >= 4, "the others will do: {:?}", raised_m(&result));
    let issues: serde_json::Value = serde_json::from_slice(&fs::read(result.join("issues.json")).unwrap()).unwrap();
    let told: Vec<_> = issues.as_array().unwrap().iter().filter(|i| i["code"] == "photo_unreadable").collect();
    let name = |i: usize| photos[i].file_name().unwrap().to_str().unwrap();
    let is_of = |i: usize| told.iter().any(|issue| issue.to_string().contains(name(i)));
    let n_spoilt = (0..photos.len()).step_by(4).filter(|&i| is_of(i)).count();
    assert!(n_spoilt >= 3 && n_spoilt == told.len(), "{told:?}");
}

/// The run is given by a path from one folder, its result is looked at from another.
#[test]
fn a_result_finds_its_photos_from_any_folder_and_pictures_in_them_what_is_farthest_off() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    copy_of_town(&scene);
    let sizeup_in = |from: &Path, args: &[&str]| -> Outcome {
        let outcome: Outcome = sizeup().current_dir(from).args(args).output().unwrap().into();
        assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
        outcome
    };
    let fast =
        ["refinement.enabled=false", "align.when=never", "output.report.page=false"].map(|set| ["--set", set]).concat();
    sizeup_in(folder.path(), &[&["run", "scene/sizeup.toml"][..], &fast].concat());
    let elsewhere = tempfile::tempdir().unwrap();
    let result = scene.join("result");
    let [city, config, truth] =
        [result.join("city.city.json"), result.join("config.toml"), scene.join("truth.geojson")]
            .map(|path| path.display().to_string());
    sizeup_in(elsewhere.path(), &["view", &config, "--photo", "oblique", "--output", "panel.png"]);
    let evaluate = |pictures: &str| {
        sizeup_in(elsewhere.path(), &["evaluate", &city, &truth, "--heights-only", "--pictures", pictures])
    };
    let quiet = evaluate("looks");
    assert_eq!(quiet.stderr, "");
    let sheet = image::open(elsewhere.path().join("looks/farthest.png")).unwrap().into_rgb8();
    let n_of = |colour: [u8; 3]| sheet.pixels().filter(|pixel| pixel.0 == colour).count();
    let [roofs, references] = [[253, 231, 37], [255, 70, 220]].map(n_of);
    assert!(roofs > 1000 && references > 1000, "{roofs} pixels of roofs, {references} of the reference's");
    let n_white = n_of([255; 3]);
    assert!(n_white < (sheet.width() * sheet.height() / 2) as usize, "photos fill the sheet: {n_white} white pixels");

    fs::rename(scene.join("images"), scene.join("gone")).unwrap();
    let told = evaluate("without");
    assert!(told.stdout.contains("photos of farthest.png") && told.stdout.contains(".jpg"), "{}", told.stdout);
    let without = elsewhere.path().join("without");
    assert!(without.join("errors.png").is_file() && !without.join("farthest.png").exists());
}

#[test]
fn settings_that_cannot_be_are_refused_by_name() {
    let mut command = sizeup();
    command.arg("run").arg(TOWN.path().join("sizeup.toml")).args(["--set", "refinement.long_side_px=2"]);
    let outcome: Outcome = command.output().unwrap().into();
    assert_eq!(outcome.code, 2);
    assert!(outcome.stderr.contains("`long_side_px`") && outcome.stderr.contains("64 to 20000"), "{}", outcome.stderr);
}

#[test]
fn the_publications_preset_asks_no_photos() {
    let result = run(TOWN.path(), "paper", &["optimise.preset=paper"]);
    assert!(raised_m(&result).is_empty());
}

#[test]
fn a_run_without_a_terrain_model_makes_one_from_its_photos() {
    let scene = TOWN.path();
    let by_priors = mean_error_m(scene, &BY_PRIORS);
    let config = fs::read_to_string(scene.join("sizeup.toml")).unwrap();
    assert!(config.contains("dtm = \"dtm.tif\""), "the scene comes with its model");
    // A level that is some metres off at most places, and a model whose heights count from elsewhere. The ground is the
    // same whether roofs are refined or not.
    let pictured = "output.pictures=true";
    let level = run(scene, "level", &["terrain={constant_m=22.0}", "dtm={}", BLIND, pictured]);
    assert!(
        ground_sigmas_m(&level).iter().all(|sigma_m| (0.1..2.0).contains(sigma_m))
            && ground_sigmas_m(&level).len() >= 11
    );
    let shifted = run(scene, "shifted", &["terrain.vertical_offset_m=2.5", "dtm={}", BLIND]);
    assert!(level.join("stages/dtm.tif").is_file() && level.join("pictures/dtm.png").is_file());
    let (level, shifted) = (mean_error_m(scene, &level), mean_error_m(scene, &shifted));
    println!("model {by_priors:.2} m, level {level:.2} m, shifted {shifted:.2} m");
    assert!(
        level < by_priors + 0.3 && shifted < by_priors + 0.3,
        "{level} and {shifted} m, {by_priors} m with the model"
    );
}

#[test]
fn a_wrong_terrain_is_corrected_by_the_photos_and_the_ground_has_a_sigma() {
    let scene = TOWN.path();
    // A model whose heights count from elsewhere, and one height for a town with some metres of relief: with refined roofs and
    // without.
    let constant = run(scene, "constant", &["terrain={constant_m=22.0}", BLIND]);
    for (name, result, right) in [("offset", &*OVER_OFFSET, &*BY_PHOTOS), ("constant", &constant, &*BY_PRIORS)] {
        let [error_m, with_model] = [result, right].map(|result| mean_error_m(scene, result));
        println!("{name}: {error_m:.2} m, {with_model:.2} m with the model");
        assert!(error_m < with_model + 0.3, "{name}: {error_m} m, {with_model} m with the model");
        let sigmas_m = ground_sigmas_m(result);
        assert!(sigmas_m.len() >= 11, "{name}: {} grounds have a sigma", sigmas_m.len());
        assert!(sigmas_m.iter().all(|sigma_m| (0.1..2.0).contains(sigma_m)), "{name}: {sigmas_m:?}");
    }
}

/// Standard deviations of the ground of a result's buildings, metres.
fn ground_sigmas_m(result: &Path) -> Vec<f64> {
    let found = FoundBuildings::read(&result.join("city.gpkg"), &ReadOptions::default()).unwrap();
    found.buildings.iter().filter_map(|building| building.attributes.get("ground_sigma_m")?.as_f64()).collect()
}

/// What was reported of a result's terrain.
fn told_of_terrain(result: &Path) -> Vec<serde_json::Value> {
    let issues: serde_json::Value = serde_json::from_slice(&fs::read(result.join("issues.json")).unwrap()).unwrap();
    let is_of_terrain = |issue: &&serde_json::Value| issue["code"].as_str().unwrap().starts_with("terrain_");
    issues.as_array().unwrap().iter().filter(is_of_terrain).cloned().collect()
}

/// Ground levels of the buildings of a result, metres, and the codes of what was reported of its terrain.
fn grounds(result: &Path) -> (BTreeMap<String, f64>, Vec<String>) {
    let codes = told_of_terrain(result).iter().map(|issue| issue["code"].as_str().unwrap().to_owned()).collect();
    let found = FoundBuildings::read(&result.join("city.gpkg"), &ReadOptions::default()).unwrap();
    let ground =
        found.buildings.into_iter().filter_map(|found| Some((found.id, found.attributes.get("ground_z_m")?.as_f64()?)));
    (ground.collect(), codes)
}

#[test]
fn a_wrong_terrain_is_reported_and_a_right_one_is_left_alone() {
    assert_eq!(told_of_terrain(&BY_PHOTOS), Vec::<serde_json::Value>::new(), "the terrain of the scene fits");
    let wrong = told_of_terrain(&OVER_OFFSET);
    assert_eq!(wrong.len(), 1);
    assert!(wrong[0]["message"].as_str().unwrap().contains("m lower than the terrain says"), "{wrong:?}");
}

/// The scene is solved on the corrected ground: corrected afterwards, low houses over a terrain that is 3 m too high ended at the least
/// height.
#[test]
fn over_a_terrain_that_is_3_m_off_heights_and_status_are_as_over_the_right_one() {
    let records_of = |result: &Path| -> BTreeMap<String, BuildingRecord> {
        let found = FoundBuildings::read(&result.join("city.gpkg"), &ReadOptions::default()).unwrap().to_records();
        found.into_iter().map(|record| (record.id.clone(), record)).collect()
    };
    let right = records_of(&BY_PHOTOS);
    for (name, result) in [("too high", &*OVER_OFFSET), ("too low", &*OVER_LOW)] {
        let wrong = records_of(result);
        assert_eq!(wrong.keys().collect::<Vec<_>>(), right.keys().collect::<Vec<_>>(), "{name}: parts");
        let both = || right.values().zip(wrong.values()).filter(|(right, _)| right.height_m.is_some());
        let off_m: Vec<f64> = both().map(|(a, b)| (a.height_m.unwrap() - b.height_m.unwrap()).abs()).collect();
        let mean_m = off_m.iter().sum::<f64>() / off_m.len() as f64;
        let at_bound = wrong.values().filter(|record| record.reasons.iter().any(|reason| reason == "range_bound"));
        println!("{name}: {mean_m:.3} m from the heights over the right terrain, {off_m:.2?}");
        assert!(off_m.len() >= 10 && mean_m < 0.2, "{name}: {mean_m} m, {off_m:?}");
        assert_eq!(at_bound.count(), 0, "{name}");
        let n_same = both().filter(|(a, b)| a.status == b.status).count();
        assert!(n_same + 1 >= off_m.len(), "{name}: {n_same} of {} have the same status", off_m.len());
    }
}

#[test]
#[ignore = "slow: make test-slow"]
fn a_wrong_terrain_is_corrected_in_tiles_as_in_one_piece() {
    let scene = TOWN.path();
    // The roofs do not matter here.
    let settings = ["terrain.vertical_offset_m=2.5", BLIND];
    let (whole, codes) = grounds(&run(scene, "whole", &settings));
    assert_eq!(codes, ["terrain_too_high"]);
    let (uncorrected, _) = grounds(&BY_PRIORS);
    let n_right = whole.iter().filter(|(id, ground_m)| (*ground_m - uncorrected[*id]).abs() < 0.3).count();
    assert!(n_right * 10 >= whole.len() * 9, "{n_right} of {}: {whole:?}, {uncorrected:?}", whole.len());
    for size in ["60", "5000"] {
        let mut command = sizeup();
        let config = scene.join("sizeup.toml");
        let result = scene.join(format!("tiles{size}"));
        command.arg("run").arg(config).args(["--tiled", "--heights", "none", "--jobs", "2", "--size", size]);
        command.args(settings.iter().flat_map(|set| ["--set", set])).arg("--output").arg(&result);
        let outcome: Outcome = command.output().unwrap().into();
        assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
        let (tiled, codes_of_tiles) = grounds(&result);
        assert_eq!(codes_of_tiles, codes, "tiles of {size} m");
        for (id, ground_m) in &whole {
            assert!((tiled[id] - ground_m).abs() < 0.05, "{id} in tiles of {size} m: {} and {ground_m} m", tiled[id]);
        }
    }
}

/// What `survey inspect --photos` tells of photos: codes by photo.
fn told_of_photos(config: &Path) -> BTreeMap<String, String> {
    let outcome: Outcome =
        sizeup().args(["survey", "inspect", "--photos", "--json", "--config"]).arg(config).output().unwrap().into();
    let report: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
    let issues = report["issues"].as_array().unwrap().iter();
    let about_photos = issues.filter(|issue| issue["code"].as_str().unwrap().starts_with("photo_"));
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    about_photos.map(|issue| (text(&issue["subject"]["id"]), text(&issue["code"]))).collect()
}

#[test]
fn blurred_burnt_out_and_black_photos_are_named_and_good_ones_are_not() {
    let town = town(|config| config.flight.n_views = Some(12));
    let config = town.path().join("sizeup.toml");
    assert_eq!(told_of_photos(&config), BTreeMap::new(), "as they were made");
    let mut photos: Vec<PathBuf> =
        fs::read_dir(town.path().join("images")).unwrap().map(|entry| entry.unwrap().path()).collect();
    photos.sort();
    let change = |path: &Path, change: &dyn Fn(image::RgbImage) -> image::RgbImage| {
        change(image::open(path).unwrap().into_rgb8()).save(path).unwrap();
    };
    change(&photos[1], &|photo| image::imageops::blur(&photo, 1.5));
    change(&photos[4], &|mut photo| {
        photo.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|value| value.saturating_mul(3)));
        photo
    });
    change(&photos[7], &|mut photo| {
        photo.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|value| value / 40));
        photo
    });
    let told: Vec<(String, String)> = told_of_photos(&config).into_iter().collect();
    let name = |i: usize| photos[i].file_name().unwrap().to_str().unwrap().to_owned();
    let expected = [(1, "photo_blurred"), (4, "photo_overexposed"), (7, "photo_underexposed")];
    assert_eq!(told, expected.map(|(i, code)| (name(i), code.to_owned())));
}

#[test]
fn real_photos_are_good_ones_until_they_are_blurred() {
    let Some(data) = shared_data("warsaw_ochota_photos") else { return };
    let folder = tempfile::tempdir().unwrap();
    let config = warsaw_config(&data, "{stem}.npy", folder.path());
    assert_eq!(told_of_photos(&config), BTreeMap::new());
    let images = folder.path().join("images");
    fs::create_dir(&images).unwrap();
    for entry in fs::read_dir(data.join("images")).unwrap() {
        let path = entry.unwrap().path();
        let photo = image::open(&path).unwrap().into_rgb8();
        let blurred = if path.ends_with("img_3163.jpg") { image::imageops::blur(&photo, 2.0) } else { photo };
        blurred.save(images.join(path.file_name().unwrap())).unwrap();
    }
    let text = fs::read_to_string(&config).unwrap();
    fs::write(&config, text.replace(&format!("{}/images", data.display()), &images.display().to_string())).unwrap();
    let told = told_of_photos(&config);
    assert_eq!(told, BTreeMap::from([("img_3163.jpg".to_owned(), "photo_blurred".to_owned())]));
}

/// A town photographed straight down only: 30 overlapping photos of a grid, poses good to 0.05 m and 0.05°.
#[test]
fn photos_that_look_straight_down_give_heights_by_stereo_with_an_honest_sigma() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    let mut config = small_town();
    config.town.n_buildings = 9;
    config.flight.n_views = Some(100);
    config.prior.longest_px = 64;
    assert_eq!(simulate_from_above(&config, scene).n_views, 20);
    // Depth that is only near and far shows no heights from above.
    let refused: Outcome = sizeup().arg("run").arg(scene.join("sizeup.toml")).output().unwrap().into();
    assert!(refused.stderr.contains("none of the 20 views is oblique"), "{}", refused.stderr);
    assert!(refused.stderr.contains("prior.source = \"stereo\""), "{}", refused.stderr);
    let result = run(scene, "nadir", &["prior={source=\"stereo\"}"]);
    let evaluation = evaluated(scene, &result);
    let all = evaluation.all.unwrap();
    let known: Vec<&BuildingError> = evaluation.buildings.iter().filter(|b| b.sigma_m.is_some()).collect();
    let within = known.iter().filter(|b| b.signed_error_m.abs() <= 2.0 * b.sigma_m.unwrap()).count();
    println!("{:.2} m on {} buildings, {within} of {} within 2 sigma", all.error_mean_m, all.n, known.len());
    assert!(known.len() >= 8 && all.error_mean_m < 0.5, "{} m, {} with a sigma", all.error_mean_m, known.len());
    assert!(within * 10 >= known.len() * 8, "{within} of {} within 2 sigma", known.len());
}
