//! The method as a library: `estimate_heights` on arrays in memory returns what the program writes.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use sizeup::config::RunConfig;
use sizeup::heights::estimate::MethodSettings;
use sizeup::heights::{Building, Settings, View, estimate_heights};
use sizeup::pipeline::{self, FootprintStage, RunOptions, RunSettings, Stage};
use sizeup::prior::{Album, PriorSource as _};
use sizeup::simulate::{PriorLevel, SimulateConfig, TownKind, simulate};
use sizeup::survey::{Survey, ViewKind};
use sizeup::vegetation;

/// What a stage left behind.
fn stage<T: serde::de::DeserializeOwned>(config: &RunConfig, name: &str) -> T {
    let path = config.project.output.join(format!("stages/{name}.json"));
    let mut read: serde_json::Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    serde_json::from_value(read["data"].take()).unwrap()
}

/// Towers on podiums, photos, relief, and priors that bleed over edges.
fn scene(folder: &Path) -> RunConfig {
    let mut config = SimulateConfig { seed: 14, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::Downtown, 12);
    config.flight.n_views = Some(24);
    (config.camera.width_px, config.camera.height_px, config.prior.longest_px) = (448, 336, 320);
    config.prior.level = PriorLevel::Bleed;
    simulate(&config, folder, &|_, _| {}).unwrap();
    let settings = ["output.pictures=false", "output.report.page=false"].map(str::to_owned);
    RunConfig::load(&folder.join("sizeup.toml"), &settings).unwrap()
}

#[test]
fn the_library_returns_the_heights_of_the_program_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let config = scene(folder.path());
    let options = RunOptions { from: Stage::Survey, until: Stage::Heights, command: "test".to_owned() };
    pipeline::run(&config, &options, &|_| {}).unwrap();
    let (survey, mut layer): (Survey, FootprintStage) = (stage(&config, "survey"), stage(&config, "footprints"));
    let terrain = pipeline::terrain_of_heights(
        &RunSettings::of(&config).heights.scene,
        &survey,
        &mut layer,
        &stage(&config, "heights"),
    )
    .unwrap();

    let on_ground = layer.layer.footprints.iter().zip(&layer.ground);
    let buildings: Vec<Building> = on_ground
        .map(|(footprint, ground)| Building { footprint: footprint.polygon.clone(), ground: ground.unwrap() })
        .collect();
    let priors = config.prior.open(&survey.views, &terrain, 100.0).unwrap();
    let album = Album::new(config.refinement.long_side_px, 1 << 30);
    let found = |view: &sizeup::survey::View| {
        let path = config.result_folder().found(view.image.as_ref().unwrap());
        sizeup::survey::View { image: Some(path), ..view.clone() }
    };
    let views: Vec<View> = survey
        .views
        .iter()
        .map(found)
        .map(|view| View {
            name: view.id.0.clone(),
            camera: (*view.camera).clone(),
            camera_from_map: view.camera_from_map,
            prior: (view.kind() == ViewKind::Oblique).then(|| priors.load(&view).unwrap()),
            picture: Some(album.picture(&view).unwrap()),
            green: vegetation::green(&view, config.optimise.working_px).unwrap().map(Arc::new),
        })
        .collect();
    let method = MethodSettings { optimise: config.optimise.clone(), refinement: config.refinement.clone() };
    let settings = Settings { heights: config.heights.clone(), method, seed: config.seed };
    let library = estimate_heights(&buildings, &terrain, &views, &settings);

    let program: serde_json::Value = stage(&config, "heights");
    let of_program = program["solution"]["heights"].as_array().unwrap();
    let of_library: Vec<_> = library.iter().flat_map(|building| &building.parts).collect();
    assert_eq!(of_library.len(), of_program.len());
    for (part, of_program) in of_library.iter().zip(of_program) {
        assert_eq!(serde_json::to_value(&part.height).unwrap(), *of_program);
    }
    let n_split = library.iter().filter(|building| building.parts.len() > 1).count();
    let n_refined = of_library.iter().filter(|part| part.height.raised_m.is_some()).count();
    assert!(n_split >= 1 && n_refined >= 3, "{n_split} buildings in parts, {n_refined} parts refined by photos");
}
