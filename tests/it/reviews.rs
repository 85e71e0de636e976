//! Decisions of people about buildings: read from a file beside the result, they count for more than what was found.

use std::fs;

use serde_json::{Value, json};

use crate::tiny_scene::Scene;

/// Writes decisions into a file of the scene.
pub fn decide(scene: &Scene, file: &str, reviews: &[Value]) {
    let feature = |properties: &Value| json!({ "type": "Feature", "geometry": null, "properties": properties });
    let all: Vec<Value> = reviews.iter().map(feature).collect();
    let text = json!({ "type": "FeatureCollection", "features": all }).to_string();
    fs::write(scene.path(file), text).unwrap();
}

/// Attributes of a building of the result.
fn building(scene: &Scene, id: &str) -> Value {
    scene.json("result/city.city.json")["CityObjects"][id]["attributes"].clone()
}

#[test]
fn decisions_are_applied_without_computing_heights_again_and_outlive_a_whole_run() {
    let scene = Scene::new();
    scene.run(&[]);
    let heights = fs::read(scene.path("result/stages/heights.json")).unwrap();
    decide(
        &scene,
        "result/reviews.geojson",
        &[
            json!({ "building_id": "b001", "decision": "corrected", "height_m": 12.5, "sigma_m": 0.1, "author": "Änne" }),
            json!({ "building_id": "b002", "decision": "wrong" }),
            json!({ "building_id": "b999", "decision": "wrong" }),
        ],
    );
    // As the QGIS plugin does: from the folder of the result alone.
    let of_result = ["run", "result/config.toml", "--from", "output", "--set", "reviews.path='reviews.geojson'"];
    let whole = ["run", "sizeup.toml", "--set", "reviews.path='result/reviews.geojson'"];
    for command in [&of_result[..], &whole] {
        let outcome = scene.sizeup(command);
        assert_eq!(outcome.code, 5, "{}", outcome.stderr);
        assert!(outcome.stderr.contains("1 reviewed: confirmed or corrected"), "{}", outcome.stderr);
        let (corrected, wrong) = (building(&scene, "b001"), building(&scene, "b002"));
        assert_eq!((&corrected["status"], &corrected["height_m"]), (&"reviewed".into(), &12.5.into()));
        assert_eq!((&corrected["reasons"], &corrected["height_sigma_m"]), (&json!(["reviewed"]), &0.1.into()));
        assert_eq!((&wrong["status"], &wrong["reasons"]), (&"unknown".into(), &json!(["reviewed_wrong"])));
        assert!(wrong["height_m"].is_null());
        assert_eq!(scene.issues("review_unmatched").len(), 1);
        assert_eq!(
            scene.issues("height_unknown").len(),
            1,
            "what was found wrong is an issue, what was settled is none"
        );
    }
    let again = fs::read(scene.path("result/stages/heights.json")).unwrap();
    assert_eq!(heights, again, "decisions are not among what heights are found from");
    assert!(scene.path("result/reviews.geojson").is_file(), "no run writes or removes it");
}

#[test]
fn a_file_that_holds_no_decisions_stops_the_run_before_it_begins() {
    let scene = Scene::new();
    fs::create_dir_all(scene.path("result")).unwrap();
    fs::write(scene.path("result/reviews.geojson"), "{}").unwrap();
    for (path, said) in [("result/reviews.geojson", "holds no decisions"), ("nowhere.geojson", "cannot read")] {
        let outcome = scene.run(&["--set", &format!("reviews.path='{path}'")]);
        assert_eq!(outcome.code, 3, "{}", outcome.stderr);
        assert!(outcome.stderr.contains("[reviews]") && outcome.stderr.contains(said), "{}", outcome.stderr);
        assert!(!scene.path("result/stages").exists());
    }
}
