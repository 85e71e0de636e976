//! GeoJSON read without GDAL: what both readers make of the same files.

use std::fs;

use geo::CoordsIter as _;
use serde_json::Value;
use sizeup::crs::{Crs, Transform};
use sizeup::geodata::geojson::{self, LonLat};
use sizeup::geodata::vector::{Feature, FeatureGeometry, VectorLayer};

use crate::tiny_scene::Scene;

/// What both readers make of a text: they have to agree, and the first has to have read it.
fn both(name: &str, text: &str) -> Vec<Feature> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    let mut own = VectorLayer::open(&path, None).unwrap();
    assert!(!own.is_read_by_gdal(), "GDAL read {text}");
    let mut gdal = VectorLayer::open_with_gdal(&path, None).unwrap();
    assert_eq!(own.name(), gdal.name());
    assert_eq!(own.crs().unwrap(), gdal.crs().unwrap());
    assert_eq!(own.field_names().collect::<Vec<_>>(), gdal.field_names().collect::<Vec<_>>());
    let found: Vec<Feature> = own.features().collect();
    assert_eq!(found, gdal.features().map(as_we_have_it).collect::<Vec<_>>(), "{text}");
    let window = [2.0, 2.0, 3.0, 3.0];
    own.look_at(window);
    gdal.look_at(window);
    let of_gdal: Vec<Feature> = gdal.features().map(as_we_have_it).collect();
    assert_eq!(own.features().collect::<Vec<_>>(), of_gdal, "in {window:?}: {text}");
    assert_eq!(own.n_features(), Some(own.features().count() as u64));
    found
}

/// GDAL's reading as ours: its binding has no text that is missing but an empty one, and spaces in objects.
fn as_we_have_it(mut feature: Feature) -> Feature {
    for value in feature.attributes.values_mut() {
        let object = value.as_str().filter(|text| text.starts_with('{')).map(serde_json::from_str::<Value>);
        match object {
            Some(Ok(object)) => *value = object.to_string().into(),
            _ if value == "" => *value = Value::Null,
            _ => {}
        }
    }
    feature
}

fn collection(members: &str, features: &[(&str, &str, &str)]) -> String {
    let feature = |(more, geometry, properties): &(&str, &str, &str)| {
        format!(r#"{{"type":"Feature",{more}"geometry":{geometry},"properties":{properties}}}"#)
    };
    let features: Vec<String> = features.iter().map(feature).collect();
    format!(r#"{{"type":"FeatureCollection",{members}"features":[{}]}}"#, features.join(","))
}

const SQUARE: &str =
    r#"{"type":"Polygon","coordinates":[[[0,0],[4,0],[4,4.5],[0,4],[0,0]],[[1,1],[1,2],[2,2],[1,1]]]}"#;

#[test]
fn shapes_are_those_that_gdal_finds() {
    let shapes = [
        SQUARE,
        "null",
        r#"{"type":"Point","coordinates":[2.5,2.5]}"#,
        r#"{"type":"MultiPoint","coordinates":[[0,0],[2.5,2.5]]}"#,
        r#"{"type":"LineString","coordinates":[[0,0],[1e1,1E1]]}"#,
        r#"{"type":"MultiLineString","coordinates":[[[0,0],[1,1]],[[9,9],[8,7]]]}"#,
        r#"{"type":"MultiPolygon","coordinates":[[[[0,0],[9,0],[0,9],[0,0]]],[[[20,0],[29,0],[20,9],[20,0]]]]}"#,
        r#"{"type":"GeometryCollection","geometries":[{"type":"Point","coordinates":[0,1]}]}"#,
        r#"{"type":"Polygon","coordinates":[]}"#,
        r#"{"type":"Polygon","coordinates":[[[0,0],[1,0],[1,1]]]}"#,
    ];
    let features: Vec<_> = shapes.iter().map(|shape| ("", *shape, "{}")).collect();
    assert_eq!(both("shapes.geojson", &collection("", &features)).len(), shapes.len());
}

#[test]
fn attributes_have_the_kinds_that_gdal_gives_them() {
    let rows = [
        r#"{"whole":1,"mixed":1,"either":1,"so":true,"text":"a","nothing":null,"object":{"a":[1,2]},"later":null}"#,
        r#"{"whole":-7000000000,"mixed":2.5,"either":"b","so":false,"text":null,"later":3}"#,
        r#"{"mixed":null,"either":true,"text":"é\"","later":0.1}"#,
        "null",
    ];
    let features: Vec<_> = rows.iter().map(|row| ("", SQUARE, *row)).collect();
    let found = both("attributes.json", &collection(r#""name":"houses","#, &features));
    assert_eq!(found[0].attributes["mixed"], Value::from(1.0));
    assert_eq!(found[0].attributes["object"], Value::from(r#"{"a":[1,2]}"#));
}

#[test]
fn features_have_the_numbers_and_names_that_gdal_gives_them() {
    let numbered = both("a.geojson", &collection("", &[(r#""id":7,"#, SQUARE, "{}"), (r#""id":3,"#, SQUARE, "{}")]));
    assert_eq!(numbered.iter().map(|f| f.fid).collect::<Vec<_>>(), [Some(7), Some(3)]);
    let rows = [(r#""id":"b/1","#, SQUARE, r#"{"a":1}"#), (r#""id":"b/2","#, SQUARE, "{}")];
    let named = both("b.geojson", &collection("", &rows));
    assert_eq!(named[1].attributes["id"], Value::from("b/2"));
}

#[test]
fn the_older_crs_member_is_honoured_as_gdal_does() {
    for name in
        ["urn:ogc:def:crs:EPSG::25832", "EPSG:25832", "urn:ogc:def:crs:EPSG:6.9:25832", "urn:ogc:def:crs:EPSG::4258"]
    {
        let member = format!(r#""crs":{{"type":"name","properties":{{"name":"{name}"}}}},"#);
        both("crs.geojson", &collection(&member, &[("", SQUARE, "{}")]));
    }
    let of = |member: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("crs.geojson");
        fs::write(&path, collection(member, &[("", SQUARE, "{}")])).unwrap();
        VectorLayer::open(&path, None).unwrap()
    };
    let old = of(r#""crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:OGC:1.3:CRS84"}},"#);
    assert_eq!(old.crs().unwrap().unwrap().epsg(), Some(4326));
    // What names nothing is GDAL's to judge.
    assert!(of(r#""crs":{"type":"name","properties":{"name":"my own"}},"#).is_read_by_gdal());
    assert!(of(r#""crs":null,"#).is_read_by_gdal());
}

#[test]
fn what_is_no_plain_collection_is_left_to_gdal() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("times.geojson", collection("", &[("", SQUARE, r#"{"built":"1987-05-01"}"#)])),
        ("lists.geojson", collection("", &[("", SQUARE, r#"{"floors":[1,2]}"#)])),
        ("numbers.geojson", collection("", &[("", r#"{"type":"Point","coordinates":[NaN,1]}"#, "{}")])),
        ("twice.geojson", collection("", &[(r#""id":1,"#, SQUARE, "{}"), (r#""id":1,"#, SQUARE, "{}")])),
        ("later.geojson", collection("", &[("", SQUARE, r#"{"a":1}"#), ("", SQUARE, r#"{"b":1,"a":2}"#)])),
        ("empty.geojson", collection("", &[])),
        ("heights.geojson", collection("", &[("", r#"{"type":"Point","coordinates":[1,1,7]}"#, "{}")])),
        ("alone.geojson", format!(r#"{{"type":"Feature","geometry":{SQUARE},"properties":{{}}}}"#)),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        assert!(VectorLayer::open(&path, None).unwrap().is_read_by_gdal(), "{name}");
    }
}

#[test]
fn issues_and_other_layers_of_a_result_are_written_for_web_maps() {
    let scene = Scene::new();
    scene.change_footprints(|features| {
        features[0]["geometry"]["coordinates"][0].as_array_mut().unwrap().swap(1, 2);
    });
    assert_eq!(scene.run(&[]).code, 5);
    for (layer, kind) in [("qa_issues", "Point"), ("cameras", "Point")] {
        let name = format!("{layer}.geojson");
        let done = scene.sizeup(&["export", "result/city.gpkg", &name, "--layer", layer]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let written = scene.json(&name);
        assert!(written.get("crs").is_none() && written["name"] == layer);
        let features = written["features"].as_array().unwrap();
        let placed: Vec<&Value> = features.iter().filter(|feature| !feature["geometry"].is_null()).collect();
        assert!(!placed.is_empty() && placed.iter().all(|feature| feature["geometry"]["type"] == kind), "{written}");
        // Where GDAL finds them in the layer itself.
        let mut own = VectorLayer::open_with_gdal(&scene.path("result/city.gpkg"), Some(layer)).unwrap();
        assert_eq!(own.features().count(), features.len());
        let mut read = VectorLayer::open_with_gdal(&scene.path(&name), None).unwrap();
        let (map, degrees) = (own.crs().unwrap().unwrap(), read.crs().unwrap().unwrap());
        let to_map = Transform::new(&degrees, &map).unwrap();
        for (there, here) in own.features().zip(read.features()) {
            let (FeatureGeometry::Shape(there), FeatureGeometry::Shape(here)) = (there.geometry, here.geometry) else {
                continue;
            };
            let (there, here) = (there.coords_iter().next().unwrap(), here.coords_iter().next().unwrap());
            let (x_m, y_m) = to_map.point(here.x, here.y).unwrap();
            // A digit of what is written is 0.1 mm.
            assert!((there.x - x_m).hypot(there.y - y_m) < 0.001, "{there:?} {x_m} {y_m}");
        }
    }
    let refused = scene.sizeup(&["export", "result/city.gpkg", "a.geojson", "--layer", "rivers"]);
    assert!(refused.code == 3 && refused.stderr.contains("qa_issues"), "{}", refused.stderr);
    let refused = scene.sizeup(&["export", "result/city.gpkg", "a.fgb", "--layer", "cameras"]);
    assert!(refused.code == 2 && refused.stderr.contains(".geojson"), "{}", refused.stderr);
}

#[test]
fn footprints_in_another_crs_give_the_heights_of_those_in_the_projects() {
    let scene = Scene::new();
    scene.change_footprints(|_| {});
    assert_eq!(scene.run(&[]).code, 0);
    let before = scene.json("result/city.city.json");
    // The same footprints in longitude and latitude, without a `crs` member: RFC 7946.
    let layer = scene.json("footprints.geojson");
    let member = layer["crs"]["properties"]["name"].as_str().unwrap().to_owned();
    let map = Crs::parse(&format!("EPSG:{}", member.rsplit(':').next().unwrap())).unwrap();
    let mut degrees = VectorLayer::open(&scene.path("footprints.geojson"), None).unwrap();
    let lonlat = LonLat::wgs84(&map).unwrap();
    let features: Vec<Value> = degrees
        .features()
        .map(|thing| {
            let FeatureGeometry::Shape(shape) = thing.geometry else { panic!("a building without a footprint") };
            let geometry = Some(lonlat.geometry(&shape).unwrap());
            serde_json::to_value(geojson::feature(None, geometry, thing.attributes)).unwrap()
        })
        .collect();
    let collection = serde_json::json!({ "type": "FeatureCollection", "features": features });
    fs::write(scene.path("footprints.geojson"), collection.to_string()).unwrap();
    assert_eq!(scene.run(&[]).code, 0);
    let after = scene.json("result/city.city.json");
    for (id, object) in before["CityObjects"].as_object().unwrap() {
        let height = |object: &Value| object["attributes"]["height_m"].as_f64().unwrap();
        let moved_m = (height(object) - height(&after["CityObjects"][id])).abs();
        assert!(moved_m < 0.01, "{id}: {moved_m} m");
    }
}
