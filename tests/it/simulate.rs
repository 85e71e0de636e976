//! A simulated scene is whole, true and the same every time.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use sizeup::simulate::{
    CityJsonTown, ErrorConfig, FlightPattern, PriorLevel, RoofOrWall, SimulateConfig, TownKind, simulate,
    simulate_with_views, world,
};

use crate::shared_data::shared_data;

/// A scene of seconds: a few small buildings and photos.
fn small() -> SimulateConfig {
    let mut config = SimulateConfig::default();
    config.town.n_buildings = 7;
    config.flight.n_views = Some(9);
    (config.camera.width_px, config.camera.height_px) = (128, 96);
    config.prior.longest_px = 64;
    config.terrain.margin_m = 300.0;
    config
}

/// Every file under a folder, by its path in it.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.insert(path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap());
            }
        }
    }
    found
}

fn on_threads(n_threads: usize, config: &SimulateConfig) -> BTreeMap<PathBuf, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
    let path = folder.path();
    pool.install(|| simulate(config, path, &|_, _| {}).map(drop)).unwrap();
    contents(path)
}

#[test]
fn the_same_seed_writes_the_same_bytes_on_any_number_of_threads() {
    let mut config = small();
    config.errors = ErrorConfig::REALISTIC;
    config.prior.level = PriorLevel::Harsh;
    config.flight.pattern = FlightPattern::Free;
    config.camera.brown = Some([-0.05, 0.01, 0.0, 1e-4, 2e-4]);
    let one = on_threads(1, &config);
    let four = on_threads(4, &config);
    assert_eq!(one.keys().collect::<Vec<_>>(), four.keys().collect::<Vec<_>>());
    for (path, bytes) in &one {
        assert!(*bytes == four[path], "{} differs", path.display());
    }
    config.seed = 2;
    assert!(on_threads(2, &config)[Path::new("truth.geojson")] != one[Path::new("truth.geojson")]);
}

#[test]
fn a_scene_holds_everything_a_run_needs_and_nothing_half_written() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = small();
    config.prior.write_true_depth = true;
    let reports = std::cell::RefCell::new(Vec::new());
    let summary = simulate(&config, folder.path(), &|done, all| reports.borrow_mut().push((done, all))).unwrap();
    assert_eq!((summary.n_buildings, summary.n_views), (7, 9));
    assert_eq!(reports.borrow().first(), Some(&(0, 9)));
    assert_eq!(reports.borrow().last(), Some(&(9, 9)));

    let files = contents(folder.path());
    let count = |part: &str| files.keys().filter(|p| p.starts_with(part)).count();
    assert_eq!((count("images"), count("priors"), count("depth")), (9, 9, 9));
    assert_eq!(count("masks"), summary.n_nadir);
    for name in ["footprints.gpkg", "dtm.tif", "truth.geojson", "georef.json", "sizeup.toml", "sparse/points3D.txt"] {
        assert!(files.contains_key(Path::new(name)), "{name}");
    }
    assert!(files.keys().all(|p| !p.to_string_lossy().contains(".partial-")));
    let masks = files.iter().filter(|(path, _)| path.starts_with("masks"));
    let ids: BTreeSet<u16> =
        masks.flat_map(|(_, png)| image::load_from_memory(png).unwrap().into_luma16().into_raw()).collect();
    assert!(ids.len() > 3 && *ids.last().unwrap() <= 7, "0 and the buildings' positions, from 1: {ids:?}");
    let run: toml::Table = String::from_utf8(files[Path::new("sizeup.toml")].clone()).unwrap().parse().unwrap();
    assert_eq!(run["project"]["crs"].as_str(), Some("EPSG:25832"));
    assert_eq!(run["prior"]["kind"].as_str(), Some("inverse_depth"));
    assert_eq!(run["survey"]["offset"].as_array().map(Vec::len), Some(3));
}

#[test]
fn the_truth_file_says_what_the_world_is() {
    let folder = tempfile::tempdir().unwrap();
    let config = small();
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let truth: Value = serde_json::from_slice(&fs::read(folder.path().join("truth.geojson")).unwrap()).unwrap();
    assert_eq!(truth["crs"]["properties"]["name"], "urn:ogc:def:crs:EPSG::25832");
    let world = world(&config).unwrap();
    let features = truth["features"].as_array().unwrap();
    assert_eq!(features.len(), world.buildings.len());
    for (feature, building) in features.iter().zip(&world.buildings) {
        assert_eq!(feature["properties"]["id"], building.id.0.as_str());
        let height_m = feature["properties"]["height_m"].as_f64().unwrap();
        assert!((height_m - building.height_m).abs() < 1e-3);
    }
}

/// COLMAP's own files, read the way COLMAP documents them: a tie point lands on its pixel.
#[test]
fn tie_points_reproject_onto_their_pixels() {
    let folder = tempfile::tempdir().unwrap();
    simulate(&small(), folder.path(), &|_, _| {}).unwrap();
    let read = |name: &str| fs::read_to_string(folder.path().join("sparse").join(name)).unwrap();
    let numbers = |line: &str| -> Vec<f64> { line.split_whitespace().filter_map(|w| w.parse().ok()).collect() };
    let camera = read("cameras.txt");
    let lens = numbers(camera.lines().last().unwrap().split_once("PINHOLE").unwrap().1);
    let points: BTreeMap<u64, Vec<f64>> = read("points3D.txt")
        .lines()
        .filter(|l| !l.starts_with('#'))
        .map(|l| (numbers(l)[0] as u64, numbers(l)[1..4].to_vec()))
        .collect();
    let images = read("images.txt");
    let lines: Vec<&str> = images.lines().filter(|l| !l.starts_with('#')).collect();
    let mut n = 0;
    for pair in lines.chunks(2) {
        let pose = numbers(pair[0]);
        let [w, x, y, z] = [pose[1], pose[2], pose[3], pose[4]];
        let rotation = glam::DMat3::from_quat(glam::DQuat::from_xyzw(x, y, z, w));
        for sighting in numbers(pair[1]).chunks(3) {
            let point = &points[&(sighting[2] as u64)];
            let p =
                rotation * glam::DVec3::new(point[0], point[1], point[2]) + glam::DVec3::new(pose[5], pose[6], pose[7]);
            let (u, v) = (lens[2] * p.x / p.z + lens[4], lens[3] * p.y / p.z + lens[5]);
            // Five standard deviations of the simulated matching error.
            assert!((u - sighting[0]).hypot(v - sighting[1]) < 2.5, "{u} {v} {sighting:?}");
            n += 1;
        }
    }
    assert!(n > 100, "{n}");
}

#[test]
fn settings_out_of_range_and_unknown_presets_are_named() {
    let mut config = small();
    config.flight.tilt_deg = 85.0;
    let refused = simulate(&config, Path::new("nowhere"), &|_, _| {}).unwrap_err();
    assert_eq!(refused.to_string(), "flight.tilt_deg is 85: expected 20 to 60 degrees");
    let unknown = SimulateConfig::preset("atlantis").unwrap_err();
    assert!(unknown.to_string().contains("demo, village, district, downtown, res-1"), "{unknown}");
    assert!(toml::from_str::<SimulateConfig>("sede = 3").is_err());
}

#[test]
fn every_preset_is_within_its_own_ranges() {
    for name in SimulateConfig::preset_names() {
        let config = SimulateConfig::preset(name).unwrap();
        config.validate().unwrap();
        assert_eq!(world(&config).unwrap().buildings.len(), config.town.n_buildings, "{name}");
    }
    // The paper's counts: #Used / ratio.
    assert_eq!(SimulateConfig::preset("Res-1").unwrap().flight.n_views, Some(374));
    assert_eq!(SimulateConfig::preset("res-1").unwrap().town.kind, TownKind::District);
}

#[test]
fn real_buildings_from_cityjson_are_seen_and_measured() {
    let Some(path) = shared_data("rotterdam_lod2/rotterdam_delfshaven.city.json") else { return };
    let mut config = small();
    config.cityjson = Some(CityJsonTown {
        path,
        translation_m: [100.0, -50.0, 0.0],
        bounds_m: Some([90_700.0, 435_600.0, 91_100.0, 435_900.0]),
        max_buildings: Some(60),
        trees_per_building: 1.0,
    });
    let real = world(&config).unwrap();
    assert_eq!((real.buildings.len(), real.crs.as_str()), (60, "EPSG:28992"));
    for b in &real.buildings {
        assert!(b.height_m > 1.5 && b.height_m < 45.0, "{} {}", b.id, b.height_m);
        assert!(b.eave_m <= b.height_m + 1e-9 && b.height_m <= b.ridge_m + 1e-9, "{}", b.id);
    }
    assert!(real.extent.west_m > 90_790.0 && real.extent.north_m < 435_880.0, "moved by the translation");

    let folder = tempfile::tempdir().unwrap();
    let summary = simulate(&config, folder.path(), &|_, _| {}).unwrap();
    assert_eq!((summary.n_buildings, summary.n_views), (60, 9));
}

#[test]
fn given_cameras_take_the_photos_at_a_reduced_size() {
    use sizeup::camera::Camera;
    use sizeup::survey::View;

    let config = small();
    let world = world(&config).unwrap();
    let centre = world.extent.centre();
    let pose = sizeup::simulate::pose(glam::DVec3::new(centre.x, centre.y - 150.0, 175.0), 0.0, 0.785);
    let camera = std::sync::Arc::new(Camera::pinhole(14_204, 10_652, 12_000.0));
    let view = View { id: "block/101_0042.tif".into(), camera, camera_from_map: pose, image: None };
    let folder = tempfile::tempdir().unwrap();
    simulate_with_views(&config, std::slice::from_ref(&view), folder.path(), &|_, _| {}).unwrap();
    let photo = image::open(folder.path().join("images/101_0042.jpg")).unwrap();
    assert_eq!((photo.width(), photo.height()), (128, 96));
    assert!(folder.path().join("priors/101_0042.npy").exists());

    let twin = View { id: "other/101_0042.jpg".into(), ..view.clone() };
    let refused = simulate_with_views(&config, &[view, twin], folder.path(), &|_, _| {}).unwrap_err();
    assert!(refused.to_string().contains("101_0042"), "{refused}");
}

/// Rotterdam's buildings under Rotterdam's own oblique cameras: those cover other blocks, so the buildings move there.
#[test]
fn real_cameras_see_real_roofs_where_they_are() {
    use sizeup::survey::{SurveyConfig, View};

    let Some(cameras) = shared_data("rotterdam_oblique_cameras") else { return };
    let Some(city) = shared_data("rotterdam_lod2") else { return };
    let mut survey: SurveyConfig = toml::from_str(
        "format = 'csv'\npath = 'camera_parameters.txt'\ncrs = 'EPSG:7415'\n[csv]\nname = 'image_id'\nangles = 'opk'\n\
         sequence = 'zyx'\ndirection = 'world_to_camera'",
    )
    .unwrap();
    survey.visit_paths(&mut |path| *path = cameras.join(&*path));
    let survey = sizeup::survey::read(&survey, &sizeup::crs::Crs::parse("EPSG:7415").unwrap()).unwrap();
    let aim = |v: &View| {
        let (centre, axis) = (v.camera_from_map.centre(), v.axis_in_map());
        (centre - centre.z / axis.z * axis).truncate()
    };
    let target = aim(&survey.views[700]);
    let mut config = small();
    config.camera.width_px = 256;
    config.prior.longest_px = 256;
    config.prior.write_true_depth = true;
    let middle = glam::DVec2::new(90_930.0, 435_770.0);
    config.cityjson = Some(CityJsonTown {
        path: city.join("rotterdam_delfshaven.city.json"),
        translation_m: (target - middle).extend(0.0).to_array(),
        bounds_m: Some([middle.x - 150.0, middle.y - 150.0, middle.x + 150.0, middle.y + 150.0]),
        max_buildings: None,
        trees_per_building: 0.0,
    });
    let world = world(&config).unwrap();
    let views: Vec<View> = survey.views.into_iter().filter(|v| aim(v).distance(target) < 60.0).take(8).collect();
    let folder = tempfile::tempdir().unwrap();
    simulate_with_views(&config, &views, folder.path(), &|_, _| {}).unwrap();
    let (mut n_near, mut n_behind, mut n_all) = (0, 0, 0);
    for view in &views {
        let camera = view.camera.reduced_to(256);
        let stem = Path::new(&view.id.0).file_stem().unwrap().to_str().unwrap();
        let bytes = fs::read(folder.path().join(format!("depth/{stem}.npy"))).unwrap();
        let depth: Vec<f32> = npyz::NpyFile::new(&bytes[..]).unwrap().into_vec().unwrap();
        for roof in world.buildings.iter().flat_map(|b| &b.triangles).filter(|t| t.part == RoofOrWall::Roof) {
            let point = view.camera_from_map.point((roof.corners[0] + roof.corners[1] + roof.corners[2]) / 3.0);
            let Some(pixel) = camera.project(point).filter(|p| camera.contains(*p)) else { continue };
            let (col, row) = (pixel.x as usize, pixel.y as usize);
            if let Some(seen) = depth.get(row * camera.width_px as usize + col).filter(|_| col < 256) {
                n_all += 1;
                n_behind += usize::from(f64::from(*seen) > point.z + 3.0);
                n_near += usize::from((f64::from(*seen) - point.z).abs() < 1.0);
            }
        }
    }
    assert!(n_all > 200 && n_near * 10 > n_all * 7, "{n_near} of {n_all}");
    // Slivers of real roofs are narrower than a pixel, whose ray may pass beside them; nothing else is seen through.
    assert!(n_behind * 50 < n_all, "{n_behind} of {n_all} seen through");
}
