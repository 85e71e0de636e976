//! Input that is wrong as people's input is: named with a hint, with the right exit code, and nothing half-written.

use std::fs;

use serde_json::{Value, json};

use crate::tiny_scene::{N_BUILDINGS, N_VIEWS, Outcome, Scene};

/// A run that ends in one message: exit code, words that it must hold, and no results.
fn assert_refused(scene: &Scene, outcome: &Outcome, code: i32, words: &[&str]) {
    assert_eq!(outcome.code, code, "{}", outcome.stderr);
    for word in words.iter().chain(&["error: ", "hint: "]) {
        assert!(outcome.stderr.contains(word), "{word:?} is missing in: {}", outcome.stderr);
    }
    assert_eq!(outcome.stdout, "");
    assert!(!outcome.stderr.contains("panicked"), "{}", outcome.stderr);
    assert!(!scene.path("result/city.city.json").exists() && !scene.path("result/city.gpkg").exists());
    scene.assert_no_litter();
}

/// A run that finishes with items to look at: exit code 5, and every building in the results.
fn assert_finished_with_items(scene: &Scene, outcome: &Outcome, n_buildings: usize) {
    assert_eq!(outcome.code, 5, "{}", outcome.stderr);
    assert_eq!(scene.statuses().len(), n_buildings, "{:?}", scene.statuses());
    scene.assert_no_litter();
}

fn status_of(scene: &Scene, id: &str) -> String {
    scene.statuses().into_iter().find(|(found, _)| found == id).unwrap_or_else(|| panic!("{id} is missing")).1
}

/// The id of the scene's first building.
fn first_id(scene: &Scene) -> String {
    scene.json("truth.geojson")["features"][0]["properties"]["id"].as_str().unwrap().to_owned()
}

fn set_crs(scene: &Scene, crs: &str) {
    scene.edit("sizeup.toml", |text| text.replace("crs = \"EPSG:25832\"", &format!("crs = {crs:?}")));
}

#[test]
fn degrees_web_mercator_and_an_unknown_crs_are_refused() {
    let scene = Scene::new();
    for (crs, word) in [("EPSG:4326", "WGS 84"), ("EPSG:3857", "Web Mercator"), ("EPSG:99999999", "unknown CRS")] {
        let outcome = scene.run(&["--set", &format!("project.crs={crs}")]);
        assert_refused(&scene, &outcome, 2, &[word, crs]);
    }
    set_crs(&scene, "EPSG:99999999");
    assert_refused(&scene, &scene.run(&[]), 2, &["unknown CRS", "line "]);
}

#[test]
fn the_wrong_zone_is_found_out_by_what_the_views_see() {
    let scene = Scene::new();
    set_crs(&scene, "EPSG:25833");
    let outcome = scene.run(&[]);
    assert_refused(&scene, &outcome, 3, &["no view sees any footprint", "CRS"]);
}

#[test]
fn footprints_without_a_crs_are_refused() {
    let scene = Scene::new();
    let truth = scene.json("truth.geojson");
    let mut table = "id;WKT\n".to_owned();
    for feature in truth["features"].as_array().unwrap() {
        let ring = feature["geometry"]["coordinates"][0].as_array().unwrap();
        let corners: Vec<String> = ring.iter().map(|c| format!("{} {}", c[0], c[1])).collect();
        let id = feature["properties"]["id"].as_str().unwrap();
        table = format!("{table}{id};\"POLYGON (({}))\"\n", corners.join(", "));
    }
    fs::write(scene.path("footprints.csv"), table).unwrap();
    scene.edit("sizeup.toml", |text| text.replace("footprints.gpkg", "footprints.csv"));
    assert_refused(&scene, &scene.run(&[]), 3, &["footprints.csv", "no CRS", "`crs`"]);
    let outcome = scene.run(&["--set", "footprints.crs=EPSG:25832"]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    assert_eq!(scene.statuses().len(), N_BUILDINGS);
}

#[test]
fn a_layer_of_metres_that_claims_degrees_is_refused() {
    let scene = Scene::new();
    let mut layer = scene.json("truth.geojson");
    layer.as_object_mut().unwrap().remove("crs");
    fs::write(scene.path("footprints.geojson"), layer.to_string()).unwrap();
    scene.edit("sizeup.toml", |text| text.replace("footprints.gpkg", "footprints.geojson"));
    assert_refused(&scene, &scene.run(&[]), 3, &["footprints.geojson", "no longitude and latitude", "`crs`"]);
}

#[test]
fn footprints_outside_the_survey_are_refused_as_a_whole() {
    let scene = Scene::new();
    scene.change_footprints(|features| features.iter_mut().map(|f| shift(f, 20_000.0)).collect());
    scene.edit("sizeup.toml", |text| text.replace("dtm = \"dtm.tif\"", "constant_m = 24.0"));
    assert_refused(&scene, &scene.run(&[]), 3, &["no view sees any footprint", "cameras"]);
}

/// Moves a feature east, metres.
fn shift(feature: &mut Value, east_m: f64) {
    for ring in feature["geometry"]["coordinates"].as_array_mut().unwrap() {
        for corner in ring.as_array_mut().unwrap() {
            corner[0] = json!(corner[0].as_f64().unwrap() + east_m);
        }
    }
}

#[test]
fn one_footprint_outside_survey_and_terrain_is_unknown() {
    let scene = Scene::new();
    let id = first_id(&scene);
    scene.change_footprints(|features| shift(&mut features[0], 20_000.0));
    let outcome = scene.run(&[]);
    assert_finished_with_items(&scene, &outcome, N_BUILDINGS);
    assert_eq!(status_of(&scene, &id), "unknown");
}

#[test]
fn an_empty_layer_is_refused() {
    let scene = Scene::new();
    scene.change_footprints(Vec::clear);
    assert_refused(&scene, &scene.run(&[]), 3, &["footprints.geojson", "is empty"]);
}

#[test]
fn a_self_crossing_polygon_keeps_its_place_in_the_results() {
    let scene = Scene::new();
    let id = first_id(&scene);
    scene.change_footprints(|features| {
        let ring = features[0]["geometry"]["coordinates"][0].as_array_mut().unwrap();
        ring.swap(1, 2);
    });
    let outcome = scene.run(&[]);
    assert_finished_with_items(&scene, &outcome, N_BUILDINGS);
    assert_eq!(status_of(&scene, &id), "refused");
    let issues = scene.json("result/issues.json");
    let issue = issues.as_array().unwrap().iter().find(|i| i["subject"]["id"] == id.as_str()).unwrap();
    assert!(issue["code"].as_str().unwrap().starts_with("footprint_") && issue["hint"].is_string(), "{issue}");
}

#[test]
fn footprints_without_area_or_with_corners_that_are_no_numbers_are_refused_one_by_one() {
    const MARK: f64 = 123_456_789.5;
    let scene = Scene::new();
    let mut ids = Vec::new();
    scene.change_footprints(|features| {
        ids = features[..2].iter().map(|f| f["properties"]["id"].as_str().unwrap().to_owned()).collect();
        features[0]["geometry"]["coordinates"][0][1][0] = json!(MARK);
        let ring = features[1]["geometry"]["coordinates"][0].as_array_mut().unwrap();
        *ring = vec![ring[0].clone(), ring[1].clone(), ring[0].clone(), ring[1].clone(), ring[0].clone()];
    });
    scene.edit("footprints.geojson", |text| text.replace(&MARK.to_string(), "NaN"));
    assert_finished_with_items(&scene, &scene.run(&[]), N_BUILDINGS);
    for (id, code) in ids.iter().zip(["footprint_not_finite", "footprint_no_area"]) {
        assert_eq!(status_of(&scene, id), "refused");
        let issues = scene.issues(code);
        assert!(issues.iter().any(|issue| issue["subject"]["id"] == id.as_str()), "{code}: {issues:?}");
    }
}

#[test]
fn a_prior_that_looks_inverted_is_told_and_not_turned_round() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| text.replace("kind = \"inverse_depth\"", "kind = \"depth\""));
    // One photo looks as its tag says: that leaves a doubt, and the run goes on.
    let first = scene.stems().into_iter().find(|stem| stem.contains("oblique")).unwrap();
    let farther_up: Vec<f32> = (0..160 * 120).map(|i| (121 - i / 160) as f32).collect();
    scene.write_prior(&first, 160, 120, &farther_up);
    let outcome = scene.run(&[]);
    assert_finished_with_items(&scene, &outcome, N_BUILDINGS);
    let (early, late) = outcome.stderr.split_once("tracing rays").expect("rays are traced");
    assert!(early.contains("do not follow the ground") && !late.contains("do not follow"), "{}", outcome.stderr);
    let issue = &scene.issues("prior_looks_inverted")[0];
    assert!(issue["hint"].as_str().unwrap().contains("inverse_depth"), "{issue}");
    assert!(outcome.stderr.contains("\nabove all: the prior looks inverted: "), "{}", outcome.stderr);
    // Nothing was turned round: what the priors say fits no height.
    assert!(scene.statuses().iter().all(|(_, status)| status != "measured"), "{:?}", scene.statuses());
}

#[test]
fn repeated_ids_are_told_apart() {
    let scene = Scene::new();
    let id = first_id(&scene);
    scene.change_footprints(|features| {
        let id = features[0]["properties"]["id"].clone();
        features[1]["properties"]["id"] = id;
    });
    let outcome = scene.run(&[]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    assert_eq!(scene.statuses().len(), N_BUILDINGS);
    let issue = &scene.issues("footprint_id_repeated")[0];
    assert!(issue["message"].as_str().unwrap().contains(&id) && issue["hint"].is_string(), "{issue}");
}

#[test]
fn a_building_without_geometry_is_in_the_results() {
    let scene = Scene::new();
    let id = first_id(&scene);
    scene.change_footprints(|features| features[0]["geometry"] = Value::Null);
    assert_finished_with_items(&scene, &scene.run(&[]), N_BUILDINGS);
    assert_eq!(status_of(&scene, &id), "refused");
}

#[test]
fn layers_without_any_usable_footprint_are_refused() {
    let scene = Scene::new();
    scene.change_footprints(|features| features.iter_mut().map(|f| f["geometry"] = Value::Null).collect());
    assert_refused(&scene, &scene.run(&[]), 3, &["none of the 6 footprints can be used", "hint:"]);
}

#[test]
fn a_prior_of_another_shape_is_refused_by_name() {
    let scene = Scene::new();
    let stem = scene.stems().remove(0);
    for stem in scene.stems() {
        scene.write_prior(&stem, 150, 120, &(0..150 * 120).map(|i| i as f32 + 1.0).collect::<Vec<_>>());
    }
    let outcome = scene.run(&[]);
    assert_refused(&scene, &outcome, 3, &["150 × 120", "160 × 120", "not the same shape", "never cropped or padded"]);
    assert!(outcome.stderr.contains(&stem) || outcome.stderr.contains("priors/"), "{}", outcome.stderr);
}

#[test]
fn some_unusable_priors_are_listed_and_the_others_go_on() {
    let scene = Scene::new();
    let stems = scene.stems();
    let half = N_VIEWS / 2;
    scene.write_prior(&stems[0], 150, 120, &[1.0; 150 * 120]);
    scene.write_prior(&stems[1], 160, 120, &[f32::NAN; 160 * 120]);
    for stem in &stems[2..half] {
        fs::remove_file(scene.path(&format!("priors/{stem}.npy"))).unwrap();
    }
    let outcome = scene.run(&[]);
    assert_finished_with_items(&scene, &outcome, N_BUILDINGS);
    let issues = scene.issues("prior_unusable");
    assert!(!issues.is_empty());
    for issue in issues {
        let name = issue["subject"]["id"].as_str().unwrap();
        assert!(stems[..half].iter().any(|stem| name.starts_with(&**stem)), "{name}");
        assert!(!issue["message"].as_str().unwrap().is_empty());
    }
}

#[test]
fn priors_without_a_value_are_refused() {
    let scene = Scene::new();
    for stem in scene.stems() {
        scene.write_prior(&stem, 160, 120, &[f32::NAN; 160 * 120]);
    }
    assert_refused(&scene, &scene.run(&[]), 3, &["no value at all", "depth priors"]);
}

#[test]
fn missing_priors_are_refused_with_the_path_that_was_looked_for() {
    let scene = Scene::new();
    fs::remove_dir_all(scene.path("priors")).unwrap();
    assert_refused(&scene, &scene.run(&[]), 3, &["priors/", "does not exist", "{stem}"]);
}

#[test]
fn poses_without_photos_and_photos_without_poses_are_told() {
    let scene = Scene::new();
    fs::create_dir(scene.path("images")).unwrap();
    let stems = scene.stems();
    for stem in &stems[1..] {
        fs::write(scene.path(&format!("images/{stem}.jpg")), b"").unwrap();
    }
    fs::write(scene.path("images/stray.jpg"), b"").unwrap();
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"images\""));
    let outcome = scene.run(&[]);
    assert_finished_with_items(&scene, &outcome, N_BUILDINGS);
    let (pose, photo) = (scene.issues("pose_without_photo"), scene.issues("photo_without_pose"));
    assert_eq!((pose.len(), photo.len()), (1, 1));
    assert!(pose[0]["subject"]["id"].as_str().unwrap().starts_with(&*stems[0]) && pose[0]["hint"].is_string());
    assert_eq!(photo[0]["subject"]["id"], "stray.jpg");
    assert!(photo[0]["hint"].is_string(), "{}", photo[0]);
}

#[test]
fn a_missing_image_folder_is_refused() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"imagse\""));
    assert_refused(&scene, &scene.run(&[]), 3, &["imagse"]);
}

#[test]
fn photos_that_are_named_otherwise_than_the_poses_are_told_side_by_side() {
    let scene = Scene::new();
    fs::create_dir(scene.path("images")).unwrap();
    fs::write(scene.path("images/other.JPG"), b"photo").unwrap();
    for source in ["stereo", "auto"] {
        let prior = format!("prior={{source=\"{source}\"}}");
        let outcome = scene.run(&["--set", "survey.images=images", "--set", &prior]);
        let says = [
            "poses has its photo among the 1 of",
            "images: pose \"",
            "photo \"other.JPG\"",
            "Name the photos as the poses do",
        ];
        assert_refused(&scene, &outcome, 3, &says);
    }
}

#[test]
fn one_name_for_two_poses_is_trusted_for_neither() {
    let scene = Scene::new();
    scene.edit("sparse/images.txt", |text| {
        let names: Vec<&str> =
            text.lines().filter_map(|line| line.split(' ').nth(9)).filter(|name| name.contains(".jpg")).collect();
        text.replace(names[1], names[0])
    });
    let outcome = scene.run(&[]);
    assert_finished_with_items(&scene, &outcome, N_BUILDINGS);
    let issue = &scene.issues("duplicate_name")[0];
    assert!(issue["severity"] == "refused" && issue["hint"].is_string(), "{issue}");
}

#[test]
fn a_terrain_elsewhere_is_refused() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| {
        text.replace("offset = [5", "offset = [6").replace("footprints.gpkg", "footprints.geojson")
    });
    let mut layer = scene.json("truth.geojson");
    for feature in layer["features"].as_array_mut().unwrap() {
        shift(feature, 100_000.0);
    }
    fs::write(scene.path("footprints.geojson"), layer.to_string()).unwrap();
    assert_refused(&scene, &scene.run(&[]), 3, &["dtm.tif", "it covers", "CRS"]);
}

#[test]
fn heights_that_cannot_be_are_refused_before_any_work() {
    let scene = Scene::new();
    let outcome = scene.run(&["--set", "heights.min_m=20", "--set", "heights.max_m=20"]);
    assert_refused(&scene, &outcome, 2, &["20", "heights.min_m", "heights.max_m"]);
    assert!(!scene.path("result").exists(), "the settings alone tell");
}

#[test]
fn missing_files_are_named() {
    for (name, word) in [("footprints.gpkg", "footprints"), ("dtm.tif", "terrain"), ("sparse/images.txt", "survey")] {
        let scene = Scene::new();
        fs::remove_file(scene.path(name)).unwrap();
        assert_refused(&scene, &scene.run(&[]), 3, &[word]);
    }
}

#[test]
fn an_output_folder_that_cannot_be_written_fails_and_says_so() {
    let scene = Scene::new();
    fs::write(scene.path("occupied"), b"a file, not a folder").unwrap();
    let outcome = scene.run(&["--output", "occupied"]);
    assert_eq!(outcome.code, 2, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("occupied"), "{}", outcome.stderr);
    assert_eq!(fs::read(scene.path("occupied")).unwrap(), b"a file, not a folder");
    scene.assert_no_litter();
}

#[test]
fn a_failed_run_leaves_the_old_results_as_they_were() {
    let scene = Scene::new();
    assert!([0, 5].contains(&scene.run(&[]).code));
    let results = ["city.city.json", "city.gpkg", "issues.json", "summary.json", "lineage.json", "config.toml"];
    let read = || results.map(|name| fs::read(scene.path(&format!("result/{name}"))).unwrap());
    let before = read();
    fs::remove_dir_all(scene.path("priors")).unwrap();
    assert_eq!(scene.run(&[]).code, 3);
    assert!(before == read());
    scene.assert_no_litter();
}
