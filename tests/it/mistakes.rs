//! Mistakes that people make in the first hour: message, hint and exit code of each.

use std::fs;

use serde_json::json;

use crate::tiny_scene::{N_BUILDINGS, Scene};

/// Asserts that a run ends with a code, and what its message and its hint say.
fn assert_told(scene: &Scene, more: &[&str], code: i32, message: &[&str], hint: &[&str]) {
    let outcome = scene.run(more);
    assert_eq!(outcome.code, code, "{}", outcome.stderr);
    let (said, advice) = outcome.stderr.split_once("hint: ").unwrap_or_else(|| panic!("no hint: {}", outcome.stderr));
    for word in message {
        assert!(said.contains(word), "{word:?} is missing before the hint: {}", outcome.stderr);
    }
    for word in hint {
        assert!(advice.contains(word), "{word:?} is missing in the hint: {}", outcome.stderr);
    }
    assert!(!scene.path("result/city.gpkg").exists(), "nothing half-written");
}

#[test]
fn points_in_place_of_outlines() {
    let scene = Scene::new();
    scene.change_footprints(|features| {
        for feature in features {
            let corner = feature["geometry"]["coordinates"][0][0].clone();
            feature["geometry"] = json!({ "type": "Point", "coordinates": corner });
        }
    });
    let message = format!("none of the {N_BUILDINGS} outlines can be used: {N_BUILDINGS} footprint_not_a_polygon");
    assert_told(&scene, &[], 3, &["[footprints]", &message, "its geometry is not a polygon"], &["polygons"]);
}

#[test]
fn a_terrain_model_that_is_not_there() {
    let scene = Scene::new();
    fs::remove_file(scene.path("dtm.tif")).unwrap();
    assert_told(&scene, &[], 3, &["[terrain]", "dtm.tif does not exist"], &["path"]);
    assert!(!scene.run(&[]).stderr.contains("NULL"));
}

#[test]
fn a_table_that_is_missing_is_no_mistake_of_the_comment_above() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| {
        let table = text.find("[terrain]").unwrap();
        let next = text[table + 1..].find("\n[").map_or(text.len(), |at| table + 1 + at);
        format!("# Our town, from the air\n{}{}", &text[..table], &text[next..])
    });
    assert_told(&scene, &[], 2, &["the table [terrain] is missing"], &["dtm = ", "constant_m = "]);
    assert!(!scene.run(&[]).stderr.contains("Our town"));
}

#[test]
fn a_prior_without_its_source() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| text.replace("source = \"files\"\n", ""));
    assert_told(&scene, &[], 2, &["source"], &["\"files\"", "\"network\"", "\"stereo\""]);
}

#[test]
fn a_misspelt_preset_and_a_hyphen() {
    let scene = Scene::new();
    assert_told(&scene, &["--set", "optimise.preset=papr"], 2, &["--set optimise.preset=papr"], &["robust", "paper"]);
    let hyphen = scene.run(&["--set", "prior.kind=inverse-depth", "--until", "survey"]);
    assert_eq!(hyphen.code, 0, "{}", hyphen.stderr);
}

#[test]
fn an_output_that_is_a_file() {
    let scene = Scene::new();
    fs::write(scene.path("notes.txt"), "mine").unwrap();
    assert_told(&scene, &["--output", "notes.txt"], 2, &["notes.txt is a file", "folder"], &["--output"]);
    assert_eq!(fs::read_to_string(scene.path("notes.txt")).unwrap(), "mine");
}

#[test]
fn a_folder_in_place_of_the_priors_files() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| text.replace("priors/{stem}.npy", "priors"));
    assert_told(&scene, &[], 3, &["[prior]", "is a folder"], &["priors/{stem}.npy"]);
}

#[test]
fn cameras_below_the_ground_get_a_hint_that_cures() {
    let scene = Scene::new();
    let sink = |by: f64| {
        let text = fs::read_to_string(scene.path("sizeup.toml")).unwrap();
        let line = text.lines().find(|line| line.starts_with("offset")).unwrap().to_owned();
        let numbers = line.split_once('[').unwrap().1.trim_end_matches(']');
        let mut offset: Vec<f64> = numbers.split(',').map(|number| number.trim().parse().unwrap()).collect();
        offset[2] -= by;
        (line, format!("offset = {offset:?}"))
    };
    let (line, sunk) = sink(300.0);
    scene.edit("sizeup.toml", |text| text.replace(&line, &sunk));
    assert_told(&scene, &[], 3, &["below the ground"], &["survey.offset", "terrain.vertical_offset_m"]);
    assert!(!scene.run(&[]).stderr.contains("accept_unsound"), "which does not help");
}

#[test]
fn poses_a_kilometre_off_are_told_before_the_heights() {
    let scene = Scene::new();
    let text = fs::read_to_string(scene.path("sizeup.toml")).unwrap();
    let line = text.lines().find(|line| line.starts_with("offset")).unwrap().to_owned();
    let numbers = line.split_once('[').unwrap().1.trim_end_matches(']');
    let mut offset: Vec<f64> = numbers.split(',').map(|number| number.trim().parse().unwrap()).collect();
    offset[0] += 5000.0;
    scene.edit("sizeup.toml", |text| text.replace(&line, &format!("offset = {offset:?}")));
    // A constant ground everywhere: the terrain model would not reach there.
    scene.edit("sizeup.toml", |text| text.replace("dtm = \"dtm.tif\"", "constant_m = 0.0"));
    let outcome = scene.run(&["--until", "footprints"]);
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("no view sees any footprint"), "{}", outcome.stderr);
}

#[test]
fn priors_of_another_shape_are_told_before_any_ray_is_traced() {
    let scene = Scene::new();
    for stem in scene.stems() {
        scene.write_prior(&stem, 100, 100, &vec![1.0; 100 * 100]);
    }
    assert_told(&scene, &[], 3, &["none of the", "priors", "100 × 100"], &["resized photos"]);
    let stages = scene.files("result/stages");
    assert!(!stages.iter().any(|path| path.ends_with("heights.json")), "{stages:?}");
}

#[test]
fn photos_that_are_missing_are_failed_items() {
    let scene = Scene::new();
    fs::create_dir(scene.path("images")).unwrap();
    let stems = scene.stems();
    for stem in &stems[stems.len() / 2..] {
        fs::write(scene.path(&format!("images/{stem}.jpg")), b"").unwrap();
    }
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"images\""));
    scene.edit("sizeup.toml", |text| text.replace("[optimise]\n", "[optimise]\npolish = { enabled = false }\n"));
    let outcome = scene.run(&[]);
    assert_eq!(outcome.code, 5, "{}", outcome.stderr);
    assert_eq!(scene.json("result/summary.json")["n_photos_missing"], stems.len() / 2);
}

#[test]
fn the_doctor_names_what_a_configuration_lacks() {
    let scene = Scene::new();
    let sound = scene.sizeup(&["doctor", "sizeup.toml"]);
    assert_eq!(sound.code, 0, "{}{}", sound.stdout, sound.stderr);
    for word in ["GDAL's GPKG: there", "memory: ", "survey.path: ", "prior.path: "] {
        assert!(sound.stdout.contains(word), "{word:?} is missing in: {}", sound.stdout);
    }
    fs::remove_file(scene.path("dtm.tif")).unwrap();
    let lacking = scene.sizeup(&["doctor", "sizeup.toml"]);
    assert_eq!(lacking.code, 3, "{}", lacking.stdout);
    let line = lacking.stdout.lines().find(|line| line.starts_with("MISSING")).unwrap();
    assert!(line.contains("terrain.dtm") && line.contains("does not exist"), "{line}");
    let json: serde_json::Value =
        serde_json::from_str(&scene.sizeup(&["doctor", "sizeup.toml", "--json"]).stdout).unwrap();
    let states: Vec<&str> = json.as_array().unwrap().iter().filter_map(|f| f["state"].as_str()).collect();
    assert_eq!(states.iter().filter(|state| **state == "missing").count(), 1, "{json}");
}

#[test]
fn a_height_that_is_a_guess_is_not_called_measured() {
    let scene = Scene::new();
    let outcome =
        scene.sizeup(&["baseline", "constant", "sizeup.toml", "--known", "truth.geojson", "--output", "guess"]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let city = scene.json("guess/city.city.json");
    for (id, object) in city["CityObjects"].as_object().unwrap() {
        let attributes = &object["attributes"];
        assert_eq!((&attributes["status"], &attributes["n_views"]), (&json!("fallback"), &json!(0)), "{id}");
        assert_eq!((&attributes["reasons"], &attributes["quality_ok"]), (&json!(["guessed"]), &json!(0)), "{id}");
    }
}
