//! `CityJSON` as others write it: names of two systems, feet, bodies inside out, indices that are none; and results by their folder.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::read::{FoundBuildings, ReadOptions};

use crate::outputs::town;
use crate::tiny_scene::{Outcome, sizeup};

/// A cube 10 wide and 8 high on level 30, its faces seen from outside, or from inside where `order` turns them.
fn cube(crs: &str, order: fn(&mut Vec<u32>)) -> Value {
    let mut faces: Vec<Vec<u32>> =
        [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]].map(Vec::from).into();
    faces.iter_mut().for_each(order);
    let shell: Vec<Value> = faces.into_iter().map(|face| json!([face])).collect();
    let corner = |x: i32, y: i32, z: i32| json!([x, y, z]);
    let level = |z: i32| [corner(0, 0, z), corner(10, 0, z), corner(10, 10, z), corner(0, 10, z)];
    let vertices = [level(30), level(38)].concat();
    json!({
        "type": "CityJSON", "version": "2.0",
        "transform": { "scale": [1.0, 1.0, 1.0], "translate": [200_000.0, 400_000.0, 0.0] },
        "metadata": { "referenceSystem": crs },
        "vertices": vertices,
        "CityObjects": { "a": { "type": "Building", "geometry": [{ "type": "Solid", "lod": "1.2", "boundaries": [shell] }] } },
    })
}

const RD: &str = "https://www.opengis.net/def/crs/EPSG/0/28992";
const RD_AND_NAP: &str = "http://www.opengis.net/def/crs-compound?1=http://www.opengis.net/def/crs/EPSG/0/28992&2=http://www.opengis.net/def/crs/EPSG/0/5709";

fn write(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("a.city.json");
    fs::write(&path, text).unwrap();
    path
}

fn run(args: &[&str], path: &Path, more: &[&Path]) -> Outcome {
    let outcome: Outcome = sizeup().args(args).arg(path).args(more).output().unwrap().into();
    assert!(!outcome.stderr.contains("panicked"), "{}", outcome.stderr);
    outcome
}

#[test]
fn a_city_in_two_systems_is_exported_in_both_and_never_in_one_of_heights() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) =
        (write(folder.path(), &format!("\u{feff}{}", cube(RD_AND_NAP, |_| {}))), folder.path().join("a.gpkg"));
    let outcome = run(&["export"], &path, &[&out]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let crs = FoundBuildings::read(&out, &ReadOptions::default()).unwrap().crs.unwrap();
    assert_eq!(crs.horizontal_epsg(), Some(28992));
    write(folder.path(), &cube("https://www.opengis.net/def/crs/EPSG/0/5709", |_| {}).to_string());
    let outcome = run(&["export"], &path, &[&out]);
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("system of heights"), "{}", outcome.stderr);
}

#[test]
fn a_body_that_is_inside_out_is_as_high_in_every_export_as_one_that_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &cube(RD, |face| face.reverse()).to_string());
    for name in ["o.city.json", "o.city.jsonl", "o.gpkg", "o.fgb", "o.geojson"] {
        let out = folder.path().join(name);
        let outcome = run(&["export"], &path, &[&out]);
        assert_eq!(outcome.code, 0, "{name}: {}", outcome.stderr);
        let records = FoundBuildings::read(&out, &ReadOptions::default()).unwrap().to_records();
        assert_eq!((records[0].height_m, records[0].ground_z_m), (Some(8.0), Some(30.0)), "{name}");
    }
}

#[test]
fn a_body_without_thickness_has_no_height_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let mut flat = cube(RD, |_| {});
    let vertices = flat["vertices"].as_array_mut().unwrap();
    vertices.iter_mut().for_each(|vertex| vertex[2] = json!(30));
    let path = write(folder.path(), &flat.to_string());
    let record = FoundBuildings::read(&path, &ReadOptions::default()).unwrap().to_records().remove(0);
    assert_eq!((record.height_m, record.reasons), (None, vec!["height_not_positive".to_owned()]));
}

#[test]
fn a_city_in_feet_is_refused_by_every_export_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let compound = "http://www.opengis.net/def/crs-compound?1=http://www.opengis.net/def/crs/EPSG/0/2263&2=http://www.opengis.net/def/crs/EPSG/0/6360";
    for (crs, says) in [
        ("https://www.opengis.net/def/crs/EPSG/0/2263", "does not say in what it counts heights"),
        (compound, "counts in feet"),
    ] {
        let path = write(folder.path(), &cube(crs, |_| {}).to_string());
        for (name, more) in
            [("o.geojson", vec![]), ("o.gpkg", vec![]), ("t", vec!["--to", "3dtiles", "--geoid-height", "-32"])]
        {
            let out = folder.path().join(name);
            let outcome = run(&[&["export"], more.as_slice()].concat(), &path, &[&out]);
            assert_eq!(outcome.code, 3, "{name}: {}", outcome.stderr);
            assert!(outcome.stderr.contains(says) && outcome.stderr.contains("hint:"), "{}", outcome.stderr);
            assert!(!out.exists(), "{name}");
        }
    }
}

#[test]
fn a_vertex_index_that_is_none_ends_validation_with_3_and_its_place() {
    let folder = tempfile::tempdir().unwrap();
    for index in ["99999999999999999999", "1e20", "-1", "0.5", "8"] {
        let text = cube(RD, |_| {}).to_string().replacen("[[4,5,6,7]]", &format!("[[4,5,{index},7]]"), 1);
        assert!(text.contains(index));
        let path = write(folder.path(), &text);
        for args in [&["check"][..], &["check", "--no-schema"]] {
            let outcome = run(args, &path, &[]);
            assert_eq!(outcome.code, 3, "{index}: {}{}", outcome.stdout, outcome.stderr);
            let has_place = outcome.stderr.contains("boundaries/0/1/0/2") || outcome.stderr.contains("line 1 column");
            assert!(has_place && outcome.stderr.contains("vertex index"), "{index}: {}", outcome.stderr);
        }
        let outcome = run(&["export"], &path, &[&folder.path().join("o.geojson")]);
        assert_eq!(outcome.code, 3, "{index}: {}", outcome.stderr);
    }
}

#[test]
fn the_folder_of_a_result_stands_for_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("o.geojson");
    let result = folder.path().join("result");
    fs::create_dir(&result).unwrap();
    for (command, more) in [("export", vec![out.as_path()]), ("evaluate", vec![out.as_path()]), ("check", vec![])] {
        let outcome = run(&[command], &result, &more);
        assert_eq!(outcome.code, 3, "{command}: {}", outcome.stderr);
        assert!(
            outcome.stderr.contains("holds no result") && outcome.stderr.contains("city.city.json"),
            "{}",
            outcome.stderr
        );
    }
    let file = result.join("city.city.json");
    cityjson::write(&file, &town().model(), &CityJsonConfig::default()).unwrap();
    assert_eq!(run(&["export"], &result, &[&out]).code, 0);
    let compared = run(&["evaluate", "--json"], &result, &[&result]);
    assert_eq!(compared.code, 0, "{}", compared.stderr);
    assert_eq!(compared.stdout, run(&["evaluate", "--json"], &file, &[&file]).stdout);
    let validated = run(&["check"], &result, &[]);
    assert_eq!((validated.code, &validated.stdout), (0, &run(&["check"], &file, &[]).stdout));
}
