//! Houses with a low annex under one outline, smaller than most outlines that hold two levels.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use sizeup::config::RunConfig;
use sizeup::evaluate::read::{TruthOptions, read_results, read_truth};
use sizeup::evaluate::{HeightEvaluation, HeightOptions, evaluate_heights};
use sizeup::pipeline::{self, RunOptions, Stage};
use sizeup::simulate::{CityJsonConfig, PriorLevel, SimulateConfig, simulate};

/// A house of 10 × 9 m, and what leans on its north side over its whole width.
const WIDTH_M: f64 = 10.0;
const HOUSE_DEPTH_M: f64 = 9.0;
/// Rows of houses, and the distance of their middles, metres.
const N_SIDE: usize = 4;
const SPACING_M: f64 = 35.0;

/// Box of a house or an annex, without its floor: west, south, east, north and top, metres.
fn faces([west, south, east, north, top]: [f64; 5]) -> Vec<Value> {
    let corners = [[west, south], [east, south], [east, north], [west, north]];
    let wall = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        json!([[[a[0], a[1], 0.0], [b[0], b[1], 0.0], [b[0], b[1], top], [a[0], a[1], top]]])
    };
    let roof = json!([corners.map(|[x, y]| [x, y, top])]);
    (0..4).map(wall).chain([roof]).collect()
}

/// A `CityJSON` file of houses, each with an annex so deep and so high, metres, under one outline.
fn city(path: &Path, house_m: f64, [annex_depth_m, annex_m]: [f64; 2]) {
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    let mut objects = serde_json::Map::new();
    for at in 0..N_SIDE * N_SIDE {
        let (west, south) = (SPACING_M * (at % N_SIDE) as f64, SPACING_M * (at / N_SIDE) as f64);
        let (east, middle) = (west + WIDTH_M, south + HOUSE_DEPTH_M);
        let north = middle + annex_depth_m;
        let floor = json!([[[west, south, 0.0], [west, north, 0.0], [east, north, 0.0], [east, south, 0.0]]]);
        let boxes = [[west, south, east, middle, house_m], [west, middle, east, north, annex_m]];
        let surfaces = boxes.into_iter().flat_map(faces).chain([floor]);
        let mut indexed = |surface: Value| -> Value {
            let rings: Vec<Vec<[f64; 3]>> = serde_json::from_value(surface).unwrap();
            let ring = |ring: Vec<[f64; 3]>| -> Vec<usize> {
                let from = vertices.len();
                vertices.extend(ring);
                (from..vertices.len()).collect()
            };
            rings.into_iter().map(ring).collect::<Vec<_>>().into()
        };
        let boundaries: Vec<Value> = surfaces.map(&mut indexed).collect();
        let geometry = json!([{ "type": "MultiSurface", "lod": "2", "boundaries": boundaries }]);
        objects.insert(format!("house-{at}"), json!({ "type": "Building", "geometry": geometry }));
    }
    let vertices: Vec<[i64; 3]> = vertices.iter().map(|v| v.map(|x| (1000.0 * x).round() as i64)).collect();
    let file = json!({
        "type": "CityJSON", "version": "2.0",
        "transform": { "scale": [0.001, 0.001, 0.001], "translate": [565_000.0, 5_932_000.0, 20.0] },
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/25832" },
        "CityObjects": objects, "vertices": vertices,
    });
    fs::write(path, file.to_string()).unwrap();
}

fn solved(folder: &Path, house_m: f64, annex: [f64; 2]) -> HeightEvaluation {
    let path = folder.join("houses.city.json");
    city(&path, house_m, annex);
    let source =
        CityJsonConfig { path, translation_m: [0.0; 3], bounds_m: None, max_buildings: None, trees_per_building: 0.0 };
    let mut config = SimulateConfig { seed: 3, cityjson: Some(source), ..SimulateConfig::default() };
    config.images.enabled = false;
    config.flight.n_views = Some(50);
    config.flight.height_m = 100.0;
    (config.camera.width_px, config.camera.height_px, config.prior.longest_px) = (448, 336, 448);
    config.prior.level = PriorLevel::Mid;
    let scene = folder.join("scene");
    simulate(&config, &scene, &|_, _| {}).unwrap();
    let settings = ["output.pictures=false".to_owned()];
    let run = RunConfig::load(&scene.join("sizeup.toml"), &settings).unwrap();
    let options = RunOptions { from: Stage::Survey, until: Stage::Output, command: "test".to_owned() };
    pipeline::run(&run, &options, &|_| {}).unwrap();
    let results = read_results(&run.project.output.join("city.city.json"), &run.project.crs).unwrap();
    let truth = read_truth(&scene.join("truth.geojson"), &TruthOptions::default(), &run.project.crs).unwrap();
    evaluate_heights(&results, &truth.buildings, &HeightOptions::default()).unwrap()
}

/// 90 m² at 9 m and 40 m² at 3 m: a single level fits neither, and ends near the upper one.
#[test]
fn a_low_annex_of_a_small_house_counts_in_its_mean_height() {
    let folder = tempfile::tempdir().unwrap();
    let found = solved(folder.path(), 9.0, [4.0, 3.0]);
    let all = found.all.as_ref().unwrap();
    println!("{found}");
    assert_eq!(all.n, N_SIDE * N_SIDE);
    // The mean is 1.85 m below the house's roof. A pixel is 0.3 m on the ground.
    assert!(all.error_mean_m < 0.5, "mean error {:.2} m", all.error_mean_m);
    let worst_m = found.buildings.iter().map(|b| b.signed_error_m.abs()).fold(0.0, f64::max);
    assert!(worst_m < 1.5, "worst {worst_m:.2} m");
}
