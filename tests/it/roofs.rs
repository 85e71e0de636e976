//! What the search does about pitched and stepped roofs and about depth edges that bleed over, on simulated towns.

use std::fs;
use std::path::Path;

use serde_json::Value;
use sizeup::config::RunConfig;
use sizeup::pipeline::{self, RunOptions, Stage};
use sizeup::scene::RoofForm;
use sizeup::simulate::{PriorLevel, SimulateConfig, TownKind, simulate};

/// A village of pitched roofs, seen from all sides, with one level of prior errors.
fn village(folder: &Path, level: PriorLevel) {
    simulate(&town(TownKind::Village, level), folder, &|_, _| {}).unwrap();
}

fn town(kind: TownKind, level: PriorLevel) -> SimulateConfig {
    let mut config = SimulateConfig { seed: 5, ..SimulateConfig::default() };
    config.town.kind = kind;
    config.town.n_buildings = 24;
    config.flight.n_views = Some(40);
    (config.camera.width_px, config.camera.height_px, config.prior.longest_px) = (448, 336, 448);
    config.prior.level = level;
    config.images.enabled = false;
    config
}

/// Runs the scene with settings; returns the city and the solution.
fn run(folder: &Path, settings: &[&str]) -> (Value, Value) {
    run_config(folder, &config(folder, settings))
}

fn config(folder: &Path, settings: &[&str]) -> RunConfig {
    let settings: Vec<String> = settings
        .iter()
        .chain(&["output.pictures=false", "output.report.page=false", "ground.reference=mean"])
        .map(|&s| s.to_owned())
        .collect();
    RunConfig::load(&folder.join("sizeup.toml"), &settings).unwrap()
}

/// The same with some forms of roofs only.
fn run_with_forms(folder: &Path, settings: &[&str], forms: &[RoofForm]) -> (Value, Value) {
    let mut config = config(folder, settings);
    config.optimise.search.roof_forms = forms.to_vec();
    run_config(folder, &config)
}

fn run_config(folder: &Path, config: &RunConfig) -> (Value, Value) {
    let options = RunOptions { from: Stage::Survey, until: Stage::Output, command: "test".to_owned() };
    pipeline::run(config, &options, &|_| {}).unwrap();
    let read = |name: &str| serde_json::from_slice(&fs::read(folder.join("result").join(name)).unwrap()).unwrap();
    let city: Value = read("city.city.json");
    let heights: Value = read("stages/heights.json");
    (city, heights["data"]["solution"].clone())
}

/// The truth of each building beside the attributes that the city states of it.
fn pairs<'a>(folder: &Path, city: &'a Value) -> Vec<(Value, &'a Value)> {
    let truth: Value = serde_json::from_slice(&fs::read(folder.join("truth.geojson")).unwrap()).unwrap();
    let features = truth["features"].as_array().unwrap().iter().map(|feature| feature["properties"].clone());
    features
        .map(|truth| {
            let stated = &city["CityObjects"][truth["id"].as_str().unwrap()]["attributes"];
            (truth, stated)
        })
        .collect()
}

/// Mean absolute error of an attribute against one of the truth's, metres.
fn error_of(folder: &Path, city: &Value, attribute: &str, truth_name: &str) -> f64 {
    let error = |(truth, stated): (Value, &Value)| {
        (stated[attribute].as_f64().expect("every building is seen") - truth[truth_name].as_f64().unwrap()).abs()
    };
    let errors: Vec<f64> = pairs(folder, city).into_iter().map(error).collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// The same of the heights.
fn error_m(folder: &Path, city: &Value, truth_name: &str) -> f64 {
    error_of(folder, city, "height_m", truth_name)
}

#[test]
fn each_height_reference_states_its_own_height_of_a_pitched_roof() {
    let folder = tempfile::tempdir().unwrap();
    village(folder.path(), PriorLevel::Clean);
    // A pixel is half a metre on the ground, so no single line of a roof is known to better than that.
    for (reference, truth_name, bound_m) in [("eave", "eave_m", 0.9), ("ridge", "ridge_m", 0.9)] {
        let setting = format!("optimise.height_reference={reference}");
        let (city, _) = run(folder.path(), &[&setting]);
        let error_m = error_m(folder.path(), &city, truth_name);
        assert!(error_m < bound_m, "{reference}: {error_m:.2} m");
        let stated = city["CityObjects"].as_object().unwrap().values().next().unwrap();
        assert_eq!(stated["attributes"]["height_reference"], reference);
    }
    let (city, _) = run(folder.path(), &[]);
    let pitched_m = error_m(folder.path(), &city, "height_m");
    assert!(pitched_m < 0.4, "mean, as by default: {pitched_m:.2} m");
    let stated = city["CityObjects"].as_object().unwrap().values().next().unwrap();
    assert_eq!(stated["attributes"]["height_reference"], "mean");
    let [eave_m, ridge_m] = [("eave_height_m", "eave_m"), ("ridge_height_m", "ridge_m")]
        .map(|(attribute, truth_name)| error_of(folder.path(), &city, attribute, truth_name));
    assert!(eave_m < 0.5 && ridge_m < 0.5, "eave {eave_m:.2} m, ridge {ridge_m:.2} m");
    let is_pitched = |form: &Value| form == "gable" || form == "hip";
    let pairs = pairs(folder.path(), &city);
    let n_right = pairs.iter().filter(|(truth, stated)| is_pitched(&truth["roof"]) == is_pitched(&stated["roof_form"]));
    let (n_right, n) = (n_right.count(), pairs.len());
    println!("pitched or flat told right: {n_right} of {n}; eave {eave_m:.2} m, ridge {ridge_m:.2} m off");
    assert!(10 * n_right >= 9 * n, "pitched or flat: {n_right} of {n} right");
    let (flat, _) = run_with_forms(folder.path(), &[], &[]);
    let flat_m = error_m(folder.path(), &flat, "height_m");
    assert!(pitched_m < 0.7 * flat_m, "pitched {pitched_m:.2} m, flat {flat_m:.2} m");
}

#[test]
fn edges_that_spill_over_are_measured_and_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    village(folder.path(), PriorLevel::Bleed);
    let (with, solution) = run(folder.path(), &[]);
    let mut left_alone = config(folder.path(), &[]);
    left_alone.optimise.search.correct_edge_bleeding = false;
    let (without, untouched) = run_config(folder.path(), &left_alone);
    // Simulated near sides grow by 2 to 3 px; walls a few pixels wide in the image hide a part of that.
    let bleeding_px = solution["bleeding_px"].as_f64().unwrap();
    assert!((0.5..4.0).contains(&bleeding_px), "{bleeding_px:.2} px");
    assert_eq!(untouched["bleeding_px"], 0.0);
    let (with_m, without_m) = (error_m(folder.path(), &with, "height_m"), error_m(folder.path(), &without, "height_m"));
    assert!(with_m < 0.8 * without_m, "with {with_m:.2} m, without {without_m:.2} m");
}

#[test]
fn a_step_in_a_roof_is_seen_and_its_mean_height_stated() {
    const ONE_LEVEL: [RoofForm; 2] = [RoofForm::Gable, RoofForm::Hip];
    // Where the steps of the search stand is chance, and few roofs of a town are stepped: four towns tell more than one.
    let (mut with_m, mut without_m) = (Vec::new(), Vec::new());
    let (mut right, mut wrong) = (0, 0);
    for seed in 5..9 {
        let folder = tempfile::tempdir().unwrap();
        simulate(&SimulateConfig { seed, ..town(TownKind::Downtown, PriorLevel::Mid) }, folder.path(), &|_, _| {})
            .unwrap();
        let (with, without) = (run(folder.path(), &[]).0, run_with_forms(folder.path(), &[], &ONE_LEVEL).0);
        // Those whose footprint was left whole.
        let errors_m = |city: &Value| -> Vec<f64> {
            let whole = pairs(folder.path(), city).into_iter().filter(|(_, stated)| stated["height_m"].is_f64());
            let stepped = whole.filter(|(truth, _)| truth["roof"] == "stepped");
            let height_m = |of: &Value| of["height_m"].as_f64().unwrap();
            stepped.map(|(truth, stated)| (height_m(stated) - height_m(&truth)).abs()).collect()
        };
        with_m.extend(errors_m(&with));
        without_m.extend(errors_m(&without));
        let n_stated = |city: &Value, is_stepped: bool| {
            let pairs = pairs(folder.path(), city).into_iter();
            let stated = pairs.filter(|(_, stated)| stated["roof_form"] == "stepped");
            stated.filter(|(truth, _)| (truth["roof"] == "stepped") == is_stepped).count()
        };
        right += n_stated(&with, true);
        wrong += n_stated(&with, false);
        assert_eq!(n_stated(&without, true) + n_stated(&without, false), 0);
    }
    let n_stepped = with_m.len();
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    let (with_m, without_m) = (mean(&with_m), mean(&without_m));
    println!(
        "stepped roofs {with_m:.2} m off, {without_m:.2} m as one level; {right} of {n_stepped} told, {wrong} others"
    );
    // 0.48 and 0.70 m, 7 of 20 told, with weights of today and of before; one of the towns alone may have 0.3 or 0.9 m.
    assert!(with_m < 0.8 * without_m, "with {with_m:.2} m, without {without_m:.2} m");
    assert!(4 * right > n_stepped && wrong == 0, "{right} of {n_stepped} stepped roofs told, and {wrong} others");
}

/// A footprint that is a little too large, as these are by default, has a rim of ground within it, which a low hip follows as well.
#[test]
fn a_flat_roof_under_a_footprint_that_is_too_large_is_no_hip() {
    let mut roofs = Vec::new();
    for seed in [31, 32] {
        let folder = tempfile::tempdir().unwrap();
        let mut config = SimulateConfig { seed, ..town(TownKind::Downtown, PriorLevel::Clean) };
        config.town.n_buildings = 40;
        simulate(&config, folder.path(), &|_, _| {}).unwrap();
        let (city, _) = run(folder.path(), &[]);
        let forms = pairs(folder.path(), &city).into_iter();
        roofs.extend(forms.map(|(truth, stated)| (truth["roof"].clone(), stated["roof_form"].clone())));
    }
    let n = |form: &str, stated: &str| roofs.iter().filter(|(truth, found)| truth == form && found == stated).count();
    let n_flat = roofs.iter().filter(|(truth, _)| truth == "flat").count();
    println!("{} of {n_flat} flat roofs called hips", n("flat", "hip"));
    assert!(20 * n("flat", "hip") <= n_flat && n_flat > 40, "{} of {n_flat} flat roofs are hips", n("flat", "hip"));
}
