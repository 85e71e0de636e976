//! References in another vertical reference: their levels are transformed or refused, never compared raw.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde_json::json;
use sizeup::crs::{Crs, Transform};
use sizeup::evaluate::solid::{Solid, write_obj};

use crate::evaluating::{evaluate, number, report};

fn transform(from: &str, to: &str) -> Transform {
    Transform::new(&Crs::parse(from).unwrap(), &Crs::parse(to).unwrap()).unwrap()
}

/// A box of 10 × 8 × 6 m.
fn block([x, y, z]: [f64; 3]) -> Solid {
    let footprint = geo::Rect::new((x, y), (x + 10.0, y + 8.0)).to_polygon();
    Solid::extruded("a", &footprint.into(), [z, z + 6.0]).unwrap()
}

#[test]
fn levels_of_another_zero_are_moved_by_the_published_offset() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // EPSG Guidance Note 7-2: 473.000 m in LN02 are 472.690 m in EVRF2000 at 47°20' N, 9°40' E.
    let (x, y) = transform("EPSG:4258", "EPSG:25832").point(9.0 + 40.0 / 60.0, 47.0 + 20.0 / 60.0).unwrap();
    write_obj(&at("evrf.obj"), &[block([x, y, 472.690])]).unwrap();
    write_obj(&at("ln02.obj"), &[block([x, y, 473.000])]).unwrap();
    let told =
        report(&at("evrf.obj"), &at("ln02.obj"), &["--crs", "EPSG:25832+5730", "--truth-crs", "EPSG:25832+5728"]);
    assert!(number(&told["surface"]["error_95_m"]) < 2e-3, "{}", told["surface"]);
    assert!(number(&told["volume"]["column_iou"]) > 0.999, "{}", told["volume"]);
    assert_eq!(told["levels"]["how"], "transformed");
    assert!((number(&told["levels"]["shift_m"][0]) + 0.310).abs() < 1e-3, "{}", told["levels"]);
    // Without saying so, nothing is compared; declared to be the same, they are 0.31 m apart.
    let unstated =
        evaluate(&at("evrf.obj"), &at("ln02.obj"), &["--crs", "EPSG:25832+5730", "--truth-crs", "EPSG:25832"]);
    assert!(unstated.code == 3 && unstated.stderr.contains("--truth-crs"), "{}", unstated.stderr);
    let raw = report(
        &at("evrf.obj"),
        &at("ln02.obj"),
        &["--crs", "EPSG:25832", "--truth-crs", "EPSG:25832", "--same-vertical"],
    );
    assert!((number(&raw["surface"]["error_95_m"]) - 0.31).abs() < 0.01, "{}", raw["surface"]);
    let shifted = report(
        &at("evrf.obj"),
        &at("ln02.obj"),
        &["--crs", "EPSG:25832", "--truth-crs", "EPSG:25832", "--level-shift", "-0.31"],
    );
    assert!(number(&shifted["surface"]["error_95_m"]) < 1e-3, "{}", shifted["surface"]);
}

/// A house of 10 × 10 m as a layer, and its roof as points with an id in longitude, latitude and ellipsoidal height.
fn house_and_scan(folder: &Path, crs: &str, [x, y]: [f64; 2], ground_m: f64, ellipsoidal_roof_m: f64) {
    let ring = [[x, y], [x + 10.0, y], [x + 10.0, y + 10.0], [x, y + 10.0], [x, y]];
    let layer = json!({ "type": "FeatureCollection",
        "crs": { "type": "name", "properties": { "name": format!("urn:ogc:def:crs:{}", crs.replace(':', "::")) } },
        "features": [{ "type": "Feature", "properties": { "id": "1", "ground_z_m": ground_m, "height_m": 10.0 },
                       "geometry": { "type": "Polygon", "coordinates": [ring] } }] });
    fs::write(folder.join("house.geojson"), layer.to_string()).unwrap();
    let to_lon_lat = transform(crs, "EPSG:4326");
    let mut text = String::new();
    for i in 0..21 * 21 {
        let (u, v) = (f64::from(i % 21) / 2.0, f64::from(i / 21) / 2.0);
        let (lon, lat) = to_lon_lat.point(x + u, y + v).unwrap();
        let _ = writeln!(text, "{lon} {lat} {ellipsoidal_roof_m} 1");
    }
    fs::write(folder.join("scan.xyz"), text).unwrap();
}

#[test]
fn an_ellipsoidal_scan_meets_a_result_above_the_geoid() {
    let folder = tempfile::tempdir().unwrap();
    // NGA's EGM96 test point: N = -43.575 m at 46.874319° N, 102.448729° E.
    let (x, y) = transform("EPSG:4326", "EPSG:32648").point(102.448_729, 46.874_319).unwrap();
    house_and_scan(folder.path(), "EPSG:32648", [x, y], 1_543.575, 1_510.0);
    let told = report(
        &folder.path().join("house.geojson"),
        &folder.path().join("scan.xyz"),
        &["--crs", "EPSG:32648+5773", "--truth-crs", "EPSG:4979", "--ground", "1500"],
    );
    assert!((number(&told["levels"]["shift_m"][0]) - 43.575).abs() < 0.06, "{}", told["levels"]);
    assert_eq!(number(&told["surface"]["completeness_05"]), 1.0, "{}", told["surface"]);
    assert!(number(&told["all"]["error_max_m"]) < 1e-6, "heights are differences: {}", told["all"]);
    assert!(told["truth_heights"].as_str().unwrap().contains("stated ground at 1500 m"), "{}", told["truth_heights"]);
}

#[test]
fn levels_that_need_a_missing_grid_are_left_out_by_its_name() {
    let folder = tempfile::tempdir().unwrap();
    house_and_scan(folder.path(), "EPSG:28992", [92_000.0, 437_000.0], 1.0, 54.5);
    let [result, truth] = ["house.geojson", "scan.xyz"].map(|name| folder.path().join(name));
    let crs = ["--crs", "EPSG:7415", "--truth-crs", "EPSG:4979", "--ground", "44.5"];
    let told = report(&result, &truth, &crs);
    assert_eq!(number(&told["all"]["n"]), 1.0, "heights need no common zero");
    if told["levels"].is_null() {
        let left_out = told["left_out"].to_string();
        assert!(left_out.contains("nl_nsgi_nlgeo2018") && left_out.contains("--level-shift"), "{left_out}");
        assert!(told["surface"].is_null());
    } else {
        assert_eq!(told["levels"]["how"], "transformed", "the grid is installed here");
    }
    let shifted = report(&result, &truth, &[&crs[..], &["--level-shift", "-43.5"]].concat());
    assert_eq!(number(&shifted["surface"]["completeness_05"]), 1.0, "{}", shifted["surface"]);
    assert_eq!(shifted["levels"]["how"], "declared");
}

#[test]
fn a_result_in_degrees_is_not_compared_in_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.geojson");
    let ring = [[9.0, 47.0], [9.001, 47.0], [9.001, 47.001], [9.0, 47.0]];
    let layer = json!({ "type": "FeatureCollection", "features": [{ "type": "Feature",
        "properties": { "id": "1", "height_m": 10.0 }, "geometry": { "type": "Polygon", "coordinates": [ring] } }] });
    fs::write(&path, layer.to_string()).unwrap();
    let refused = evaluate(&path, &path, &[]);
    assert!(refused.code == 3 && refused.stderr.contains("--crs"), "{}", refused.stderr);
    assert_eq!(number(&report(&path, &path, &["--crs", "EPSG:32632"])["all"]["error_max_m"]), 0.0);
}
