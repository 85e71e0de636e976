//! Ground from the photos alone, against ground that is known.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use geo::Centroid as _;
use sizeup::crs::Crs;
use sizeup::dtm::{DtmConfig, DtmError, SquareOutcome, estimate};
use sizeup::footprint::{FootprintConfig, read};
use sizeup::simulate::{SimulateConfig, simulate};
use sizeup::stats::{median, quantile};
use sizeup::survey::{self, Survey, SurveyConfig};
use sizeup::terrain::{MapBox, Terrain, TerrainConfig, load};
use tempfile::TempDir;

use crate::shared_data::shared_data;

const BASE_Z_M: f64 = 24.0;

/// A few buildings among hills, and photos of them.
static SCENE: LazyLock<(TempDir, Survey)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let survey = simulated(folder.path());
    (folder, survey)
});

fn simulated(folder: &Path) -> Survey {
    let mut config = SimulateConfig::default();
    config.town.n_buildings = 9;
    config.flight.n_views = Some(40);
    (config.camera.width_px, config.camera.height_px) = (640, 480);
    (config.prior.longest_px, config.terrain.base_z_m) = (64, BASE_Z_M);
    simulate(&config, folder, &|_, _| {}).unwrap();
    let run: toml::Table = fs::read_to_string(folder.join("sizeup.toml")).unwrap().parse().unwrap();
    let offset: Vec<f64> = run["survey"]["offset"].as_array().unwrap().iter().map(|v| v.as_float().unwrap()).collect();
    let settings = SurveyConfig {
        offset: [offset[0], offset[1], offset[2]],
        images: Some(folder.join("images")),
        ..SurveyConfig::at(folder.join("sparse"))
    };
    survey::read(&settings, &crs()).unwrap()
}

fn crs() -> Crs {
    Crs::parse("EPSG:25832").unwrap()
}

#[test]
fn photos_alone_give_the_ground_to_a_decimetre() {
    let (folder, survey) = &*SCENE;
    let layer = FootprintConfig::new(folder.path().join("footprints.gpkg"));
    let layer = read(&layer, &crs()).unwrap();
    let footprints: Vec<_> = layer.footprints.iter().map(|f| &f.polygon).collect();
    // The rough level is 5 m off.
    let config = DtmConfig { margin_m: 40.0, ..DtmConfig::default() };
    let dtm = estimate(&survey.views, &footprints, &Terrain::Constant(BASE_Z_M + 5.0), &config, &|_, _| {}).unwrap();
    let everywhere = MapBox { west_m: 0.0, south_m: 0.0, east_m: 1e6, north_m: 1e7 };
    let truth = load(&TerrainConfig::dtm(folder.path().join("dtm.tif")), &crs(), everywhere).unwrap();

    let n_ground = dtm.squares.iter().filter(|s| matches!(s.outcome, SquareOutcome::Ground(_))).count();
    assert!(n_ground * 2 > dtm.squares.len(), "{n_ground} of {} squares", dtm.squares.len());
    let model = Terrain::Grid(dtm.dem.clone());
    let off = |at: (f64, f64)| Some((model.height_at(at.0, at.1)? - truth.height_at(at.0, at.1)?).abs());
    // Where it is needed: under the footprints, which it has never looked at.
    let corners = footprints.iter().flat_map(|o| o.exterior().points()).map(geo::Point::x_y);
    let errors: Vec<f64> = corners.map(|at| off(at).expect("there is ground around every footprint")).collect();
    println!(
        "{n_ground} squares, under footprints {:.3} m, P90 {:.3} m",
        median(&errors).unwrap(),
        quantile(&errors, 0.9).unwrap()
    );
    assert!(median(&errors).unwrap() < 0.1 && quantile(&errors, 0.9).unwrap() < 0.3, "{errors:?}");
}

#[test]
fn a_level_far_from_the_ground_is_refused_with_the_range_that_was_tried() {
    let (_, survey) = &*SCENE;
    let refused = estimate(&survey.views, &[], &Terrain::Constant(BASE_Z_M - 200.0), &DtmConfig::default(), &|_, _| {})
        .unwrap_err();
    assert!(matches!(refused, DtmError::TooLittle { .. }), "{refused}");
    assert!(refused.to_string().contains("-191.0 and -161.0 m"), "{refused}");
}

#[test]
fn warsaw_stands_on_the_ground_that_its_points_were_measured_on() {
    let Some(data) = shared_data("warsaw_ochota_photos") else { return };
    let settings = SurveyConfig {
        offset: [634_000.0, 485_000.0, 0.0],
        images: Some(data.join("images")),
        ..SurveyConfig::at(data.join("sparse"))
    };
    let crs = Crs::parse("EPSG:2180").unwrap();
    let survey = survey::read(&settings, &crs).unwrap();
    let layer = FootprintConfig::new(data.join("truth_buildings.geojson"));
    let layer = read(&layer, &crs).unwrap();
    let footprints: Vec<_> = layer.footprints.iter().map(|f| &f.polygon).collect();
    let config = DtmConfig { margin_m: 40.0, spacing_m: 8.0, ..DtmConfig::default() };
    // The measured ground beside the nine buildings is 110.2 to 111.7 m; the search starts 6 m below it.
    let dtm = estimate(&survey.views, &footprints, &Terrain::Constant(105.0), &config, &|_, _| {}).unwrap();
    let model = Terrain::Grid(dtm.dem);
    let truth: serde_json::Value =
        serde_json::from_slice(&fs::read(data.join("truth_buildings.geojson")).unwrap()).unwrap();
    let measured =
        truth["features"].as_array().unwrap().iter().map(|f| f["properties"]["ground_z_m"].as_f64().unwrap());
    let middles = footprints.iter().filter_map(|o| o.centroid());
    let errors: Vec<f64> = middles
        .zip(measured)
        .filter_map(|(middle, ground_z_m)| Some(model.height_at(middle.x(), middle.y())? - ground_z_m))
        .collect();
    println!("{errors:.2?}");
    let sizes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
    assert!(errors.len() >= 8 && median(&sizes).unwrap() < 1.0, "{errors:?}");
}
