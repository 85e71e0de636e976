//! What the numbers of an evaluation are, on cases computed by hand.

use std::path::{Path, PathBuf};

use geo::polygon;
use geo_types::{MultiPolygon, Polygon};
use sizeup::crs::Crs;
use sizeup::evaluate::read::{TruthOptions, read_results, read_truth};
use sizeup::evaluate::{EvaluationError, HeightOptions, Matching, TruthBuilding, evaluate_heights};
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::geopackage;
use sizeup::output::read::ReadError;
use sizeup::output::{BuildingRecord, Status};

use crate::outputs::{building, town};

fn rectangle(x: f64, y: f64, w: f64, h: f64) -> Polygon<f64> {
    polygon![(x: x, y: y), (x: x + w, y: y), (x: x + w, y: y + h), (x: x, y: y + h)]
}

fn truth(id: &str, footprint: Polygon<f64>, height_m: f64, group: &str) -> TruthBuilding {
    TruthBuilding {
        id: id.to_owned(),
        footprint: Some(MultiPolygon::new(vec![footprint])),
        height_m: Some(height_m),
        group: Some(group.to_owned()),
    }
}

fn result(id: &str, footprint: Polygon<f64>, height_m: Option<f64>) -> BuildingRecord {
    building(id, Some(footprint), height_m, if height_m.is_some() { Status::Measured } else { Status::Unknown })
}

#[test]
fn a_perfect_prediction_is_perfect_under_every_metric() {
    let heights = [3.0, 12.5, 80.0];
    let footprint = |i: usize| rectangle(20.0 * i as f64, 0.0, 10.0, 10.0);
    let results: Vec<_> =
        heights.iter().enumerate().map(|(i, h)| result(&i.to_string(), footprint(i), Some(*h))).collect();
    let truths: Vec<_> =
        heights.iter().enumerate().map(|(i, h)| truth(&i.to_string(), footprint(i), *h, "x")).collect();
    for matching in [Matching::Auto, Matching::Id, Matching::Overlap] {
        let options = HeightOptions { matching, ..HeightOptions::default() };
        let evaluation = evaluate_heights(&results, &truths, &options).unwrap();
        let s = evaluation.all.unwrap();
        assert_eq!((s.n, s.n_accuracy_clamped), (3, 0));
        assert_eq!([s.error_mean_m, s.error_median_m, s.error_p90_m, s.error_max_m, s.rmse_m, s.bias_m], [0.0; 6]);
        assert_eq!([s.within_1m_share, s.within_10pct_share, s.accuracy_mean, s.accuracy_90], [1.0; 4]);
        assert_eq!((s.within_1_sigma_share, s.within_2_sigma_share), (Some(1.0), Some(1.0)));
    }
}

#[test]
fn every_reference_building_is_counted_once() {
    let results = [
        result("a", rectangle(0.0, 0.0, 10.0, 10.0), Some(11.0)),
        result("b", rectangle(20.0, 0.0, 10.0, 10.0), None),
        result("c", rectangle(40.0, 0.0, 10.0, 10.0), Some(1.0)),
        result("new", rectangle(900.0, 0.0, 10.0, 10.0), Some(8.0)),
    ];
    let mut unknown = truth("e", rectangle(80.0, 0.0, 10.0, 10.0), 0.0, "house");
    unknown.height_m = None;
    let truths = [
        truth("a", rectangle(0.0, 0.0, 10.0, 10.0), 10.0, "house"),
        truth("b", rectangle(20.0, 0.0, 10.0, 10.0), 10.0, "house"),
        truth("c", rectangle(40.0, 0.0, 10.0, 10.0), 1.5, "shed"),
        truth("d", rectangle(60.0, 0.0, 10.0, 10.0), 10.0, "house"),
        unknown,
    ];
    let evaluation = evaluate_heights(&results, &truths, &HeightOptions::default()).unwrap();
    let c = &evaluation.counts;
    assert_eq!(evaluation.matched_by, Matching::Id);
    assert_eq!((c.n_compared, c.n_unobserved, c.n_too_low, c.n_unmatched, c.n_without_truth), (1, 1, 1, 1, 1));
    assert_eq!((c.n_truth, c.n_results, c.n_results_unmatched), (5, 4, 1));
    assert_eq!(evaluation.by_group.len(), 1);
    assert_eq!(evaluation.all.as_ref().unwrap().bias_m, 1.0);
    let table = evaluation.to_string();
    assert!(table.contains("1 of 5 reference buildings compared"), "{table}");
    assert!(serde_json::to_string(&evaluation).unwrap().contains("accuracy_90"));
}

#[test]
fn without_common_ids_the_largest_overlap_decides() {
    let results = [
        result("r1", rectangle(0.0, 0.0, 7.0, 10.0), Some(11.0)),
        result("r2", rectangle(7.0, 0.0, 3.0, 10.0), Some(50.0)),
        result("far", rectangle(100.0, 0.0, 4.0, 10.0), Some(50.0)),
    ];
    let truths = [
        truth("t1", rectangle(0.0, 0.0, 10.0, 10.0), 10.0, "x"),
        // Only 40 % of it are covered.
        truth("t2", rectangle(100.0, 0.0, 10.0, 10.0), 10.0, "x"),
    ];
    let evaluation = evaluate_heights(&results, &truths, &HeightOptions::default()).unwrap();
    assert_eq!(evaluation.matched_by, Matching::Overlap);
    assert_eq!(evaluation.counts.n_unmatched, 1);
    assert_eq!(evaluation.buildings[0].result_id, "r1");
    assert!((evaluation.buildings[0].overlap_share.unwrap() - 0.7).abs() < 1e-9);
}

#[test]
fn nothing_in_common_is_an_error_with_a_hint() {
    let results = [result("a", rectangle(0.0, 0.0, 10.0, 10.0), Some(10.0))];
    let truths = [truth("b", rectangle(1e6, 0.0, 10.0, 10.0), 10.0, "x")];
    let error = evaluate_heights(&results, &truths, &HeightOptions::default()).unwrap_err();
    assert!(matches!(error, EvaluationError::NoMatch { how: "overlap", .. }));
    assert!(error.to_string().contains("hint:"), "{error}");
}

fn write_geojson(folder: &Path, crs: Option<&str>, square: [[f64; 2]; 5]) -> PathBuf {
    let path = folder.join("truth.geojson");
    let mut collection = serde_json::json!({
        "type": "FeatureCollection",
        "features": [{ "type": "Feature", "properties": { "id": "t", "height_m": 9.0, "type": "hall" },
                       "geometry": { "type": "Polygon", "coordinates": [square] } }],
    });
    if let Some(crs) = crs {
        collection["crs"] = serde_json::json!({ "type": "name", "properties": { "name": crs } });
    }
    std::fs::write(&path, collection.to_string()).unwrap();
    path
}

#[test]
fn a_reference_in_degrees_is_transformed_never_compared_raw() {
    let folder = tempfile::tempdir().unwrap();
    // Amersfoort's tower is the origin of RD: 52.15517 N 5.38721 E.
    let (lon, lat, d) = (5.387_206, 52.155_174, 1e-4);
    let square = [[lon, lat], [lon + d, lat], [lon + d, lat + d], [lon, lat + d], [lon, lat]];
    let path = write_geojson(folder.path(), None, square);
    let truth = read_truth(&path, &TruthOptions::default(), &Crs::parse("EPSG:7415").unwrap()).unwrap();
    assert_eq!(truth.height_source, "attribute height_m");
    let footprint = truth.buildings[0].footprint.as_ref().unwrap();
    let corner = footprint.0[0].exterior().0[0];
    assert!((corner.x - 155_000.0).abs() < 2.0 && (corner.y - 463_000.0).abs() < 2.0, "{corner:?}");
    assert_eq!((truth.buildings[0].height_m, truth.buildings[0].group.as_deref()), (Some(9.0), Some("hall")));
}

#[test]
fn a_missing_height_attribute_lists_what_there_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_geojson(folder.path(), None, [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]);
    let options = TruthOptions { height_field: Some("hoogte".to_owned()), ..TruthOptions::default() };
    let error = read_truth(&path, &options, &Crs::parse("EPSG:4326").unwrap()).unwrap_err();
    assert!(matches!(&error, ReadError::NoField { field, .. } if field == "hoogte"));
    assert!(error.to_string().contains("height_m"), "{error}");
}

#[test]
fn our_own_files_come_back_as_they_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let town = town();
    let (city, gpkg) = (folder.path().join("town.city.json"), folder.path().join("town.gpkg"));
    cityjson::write(&city, &town.model(), &CityJsonConfig::default()).unwrap();
    geopackage::write(&gpkg, &town.model()).unwrap();

    let from_gpkg = read_results(&gpkg, &town.crs).unwrap();
    for (read, written) in from_gpkg.iter().zip(&town.records) {
        let mut expected = written.clone();
        // A column holds one type: lists of the user are text in a GeoPackage.
        expected.attributes.insert("tags".to_owned(), "[\"x\",1]".into());
        assert_eq!(read.attributes, expected.attributes);
        assert_eq!((&read.id, read.height_m, read.base_z_m), (&expected.id, expected.height_m, expected.base_z_m));
        assert_eq!((&read.status, &read.reasons, &read.views), (&expected.status, &expected.reasons, &expected.views));
        assert_eq!(read.footprint, expected.footprint);
    }

    let from_city = read_results(&city, &town.crs).unwrap();
    for (read, written) in from_city.iter().zip(&town.records) {
        assert_eq!(read.attributes, written.attributes);
        assert_eq!(
            (&read.id, read.height_m, read.height_sigma_m),
            (&written.id, written.height_m, written.height_sigma_m)
        );
        assert_eq!((&read.status, &read.reasons, &read.views), (&written.status, &written.reasons, &written.views));
        assert_eq!(read.footprint.is_some(), written.footprint.is_some());
        if let (Some(read), Some(written)) = (&read.footprint, &written.footprint) {
            use geo::Area as _;
            assert!((read.unsigned_area() - written.unsigned_area()).abs() < 1e-3);
        }
    }
}

#[test]
fn our_result_against_our_own_cityjson_as_reference_is_perfect() {
    let folder = tempfile::tempdir().unwrap();
    let town = town();
    let city = folder.path().join("town.city.json");
    cityjson::write(&city, &town.model(), &CityJsonConfig::default()).unwrap();
    let options = TruthOptions { height_field: Some("measuredHeight".to_owned()), ..TruthOptions::default() };
    let truth = read_truth(&city, &options, &town.crs).unwrap();
    let evaluation = evaluate_heights(&town.records, &truth.buildings, &HeightOptions::default()).unwrap();
    assert_eq!(evaluation.all.unwrap().error_max_m, 0.0);
    assert_eq!(evaluation.counts.n_without_truth, 2);
}

/// The folder of real data beside the checkout, if it is there.
pub fn shared_data(name: &str) -> Option<PathBuf> {
    crate::shared_data::shared_data(name)
}

#[test]
fn rotterdams_lod2_has_the_heights_its_source_states() {
    let Some(path) = shared_data("rotterdam_lod2/rotterdam_delfshaven.city.json") else { return };
    let crs = Crs::parse("EPSG:28992").unwrap();
    let options = TruthOptions { height_reference: sizeup::output::HeightReference::Ridge, ..TruthOptions::default() };
    let truth = read_truth(&path, &options, &crs).unwrap();
    assert_eq!(truth.buildings.len(), 853);
    let heights: Vec<f64> = truth.buildings.iter().filter_map(|b| b.height_m).collect();
    let median = sizeup::stats::median(&heights).unwrap();
    // Published: heights 2.2 to 41.2 m, median 14.1.
    assert!(heights.len() > 845 && (median - 14.1).abs() < 0.5, "{} heights, median {median}", heights.len());
}

#[test]
fn cityjson_1_0_without_semantics_is_read_by_its_normals() {
    let Some(path) = shared_data("delft_lidar_lod1/output/testarea.json") else { return };
    let truth = read_truth(&path, &TruthOptions::default(), &Crs::parse("EPSG:28992").unwrap()).unwrap();
    let n_known = truth.buildings.iter().filter(|b| b.height_m.is_some()).count();
    assert_eq!((truth.buildings.len(), n_known), (160, 160));
}

#[test]
fn the_real_warsaw_reference_is_perfect_against_itself() {
    let Some(path) = shared_data("warsaw_ochota_photos/truth_buildings.geojson") else { return };
    let crs = Crs::parse("EPSG:2180").unwrap();
    let truth = read_truth(&path, &TruthOptions::default(), &crs).unwrap();
    let results = read_results(&path, &crs).unwrap();
    let evaluation = evaluate_heights(&results, &truth.buildings, &HeightOptions::default()).unwrap();
    assert_eq!((evaluation.counts.n_truth, evaluation.all.unwrap().error_max_m), (9, 0.0));
}
