//! What other people's programs make of our files; skipped where a program is not installed.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use sizeup::crs::Crs;
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::geopackage::{self, GeoPackageConfig};
use sizeup::output::tiles3d::{self, Precision};
use sizeup::output::{flatcitybuf, flatgeobuf, geojson};

use crate::outputs::{assert_valid_cityjson, town};
use crate::tiles3d::{config, write_deep};
use crate::tools::{chromium, cjio, flatcitybuf_python, node_modules, npm, picture, program, run};

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[test]
fn cjio_reads_subsets_and_upgrades_our_cityjson() {
    let Some(cjio) = cjio() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mut town = town();
    town.records[0].part_of = Some("row".to_owned());
    town.records[1].part_of = Some("row".to_owned());
    cityjson::write(&at("town.city.json"), &town.model(), &CityJsonConfig::default()).unwrap();
    let info = run(Command::new(&cjio).arg(at("town.city.json")).args(["info", "--long"]));
    for expected in ["7415", "BuildingPart", "1.2"] {
        assert!(info.contains(expected), "{expected} in {info}");
    }
    // A subset by id brings the parts along.
    run(Command::new(&cjio).arg(at("town.city.json")).args(["subset", "--id", "row", "save"]).arg(at("row.city.json")));
    let subset = json(&at("row.city.json"));
    let mut ids: Vec<&String> = subset["CityObjects"].as_object().unwrap().keys().collect();
    ids.sort();
    assert_eq!(ids, ["row", "row 1", "row 2"]);
    assert_valid_cityjson(&at("row.city.json"));

    // The file as version 1.1, which differs in nothing we write; cjio brings it to 2.0 again.
    let mut old = json(&at("town.city.json"));
    old["version"] = "1.1".into();
    std::fs::write(at("old.city.json"), old.to_string()).unwrap();
    run(Command::new(&cjio).arg(at("old.city.json")).args(["upgrade", "save"]).arg(at("new.city.json")));
    let new = json(&at("new.city.json"));
    assert_eq!(new["version"], "2.0");
    assert_eq!(new["CityObjects"]["tower"]["attributes"], old["CityObjects"]["tower"]["attributes"]);
    assert_valid_cityjson(&at("new.city.json"));
}

/// Prints a file's header, its features, and the ids of those that two queries find: a box, and a status.
const READ_FLATCITYBUF: &str = "
import json, sys
import flatcitybuf as fcb
reader = fcb.FcbReader.open_file(sys.argv[1])
header = reader.header
whole = lambda feature: fcb.to_cityjson_feature(feature, header)
print(json.dumps(fcb.to_cityjson_metadata(header)))
print(json.dumps([whole(feature) for feature in reader.select_all()]))
box = tuple(map(float, sys.argv[2:6]))
info = header.info
in_box = fcb.search_rtree(reader.range_reader, header.layout.rtree_begin, info.features_count, info.index_node_size, box)
print(json.dumps([whole(reader.feature_at(hit))['id'] for hit in in_box]))
unknown = reader.select_attr([fcb.AttrCondition('status', fcb.Operator.EQ, fcb.KeyValue.from_string(fcb.KeyKind.STRING50, sys.argv[6]))])
print(json.dumps([whole(reader.feature_at(hit))['id'] for hit in unknown]))
";

#[test]
fn flatcitybuf_has_the_features_of_cityjsonseq_and_finds_them_by_place_and_status() {
    let Some(python) = flatcitybuf_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (town, config) = (town(), CityJsonConfig::default());
    flatcitybuf::write(&at("town.fcb"), &town.model(), &config).unwrap();
    flatcitybuf::write(&at("again.fcb"), &town.model(), &config).unwrap();
    assert!(std::fs::read(at("town.fcb")).unwrap() == std::fs::read(at("again.fcb")).unwrap(), "the same bytes twice");
    cityjson::write_sequence(&at("town.city.jsonl"), &town.model(), &config).unwrap();
    let lines = std::fs::read_to_string(at("town.city.jsonl")).unwrap();
    let mut lines = lines.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let expected_header = lines.next().unwrap();
    let expected: Vec<Value> = lines.collect();
    // The box of one building's vertices.
    let scale = |k: usize, v: &Value| {
        let [scale, translate] =
            ["scale", "translate"].map(|name| expected_header["transform"][name][k].as_f64().unwrap());
        v[k].as_f64().unwrap() * scale + translate
    };
    let tower = expected.iter().find(|feature| feature["id"] == "tower").unwrap();
    let vertices = tower["vertices"].as_array().unwrap();
    let middle = [0, 1].map(|k| vertices.iter().map(|v| scale(k, v)).sum::<f64>() / vertices.len() as f64);
    let around = [middle[0] - 0.1, middle[1] - 0.1, middle[0] + 0.1, middle[1] + 0.1].map(|side| side.to_string());
    let mut command = Command::new(python);
    command.args(["-c", READ_FLATCITYBUF]).arg(at("town.fcb")).args(&around).arg("unknown");
    let told = run(&mut command);
    let told: Vec<Value> = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let [header, found, in_box, unknown] = told.try_into().unwrap();
    assert_eq!(header["transform"], expected_header["transform"]);
    assert_eq!(header["metadata"]["referenceSystem"], expected_header["metadata"]["referenceSystem"]);
    let found = found.as_array().unwrap();
    assert_eq!(found.len(), expected.len());
    for expected in &expected {
        let found = found.iter().find(|found| found["id"] == expected["id"]).unwrap();
        assert_eq!(found["vertices"], expected["vertices"], "{}", expected["id"]);
        for (id, object) in expected["CityObjects"].as_object().unwrap() {
            let of_found = &found["CityObjects"][id];
            assert_eq!(of_found["type"], object["type"], "{id}");
            assert_eq!(without_null(&of_found["attributes"]), without_null(&object["attributes"]), "{id}");
            // It has no empty lists.
            let has_geometry = object["geometry"].as_array().is_some_and(|all| !all.is_empty());
            assert!(!has_geometry || of_found["geometry"] == object["geometry"], "{id}: {of_found}");
        }
    }
    assert_eq!(in_box, serde_json::json!(["tower"]));
    let of_status =
        |feature: &&Value| feature["CityObjects"][feature["id"].as_str().unwrap()]["attributes"]["status"] == "unknown";
    let mut ids: Vec<&Value> = expected.iter().filter(of_status).map(|feature| &feature["id"]).collect();
    let mut unknown: Vec<&Value> = unknown.as_array().unwrap().iter().collect();
    ids.sort_by_key(ToString::to_string);
    unknown.sort_by_key(ToString::to_string);
    assert!(!ids.is_empty());
    assert_eq!(unknown, ids);
}

/// Attributes that have a value.
fn without_null(attributes: &Value) -> Value {
    let all = attributes.as_object().into_iter().flatten();
    all.filter(|(_, value)| !value.is_null()).map(|(name, value)| (name.clone(), value.clone())).collect()
}

#[test]
fn ogrinfo_reads_our_layers_with_crs_and_comments() {
    let Some(ogrinfo) = program("ogrinfo", "deps-test") else { return };
    let folder = tempfile::tempdir().unwrap();
    let town = town();
    let (gpkg, fgb) = (folder.path().join("town.gpkg"), folder.path().join("town.fgb"));
    geopackage::write(&gpkg, &town.model(), &GeoPackageConfig::default()).unwrap();
    flatgeobuf::write(&fgb, &town.model()).unwrap();
    let layers = run(Command::new(&ogrinfo).args(["-ro", "-q"]).arg(&gpkg));
    for layer in [
        "buildings (Polygon)",
        "buildings_lod1 (3D Multi Polygon)",
        "buildings_lod13 (3D Multi Polygon)",
        "buildings_lod2 (3D Multi Polygon)",
        "tiles (Polygon)",
        "cameras (3D Point)",
        "qa_issues (Point)",
    ] {
        assert!(layers.contains(layer), "{layer} in {layers}");
    }
    for (path, features) in [(&gpkg, 6), (&fgb, 5)] {
        let info = run(Command::new(&ogrinfo).args(["-ro", "-so"]).arg(path).arg("buildings"));
        assert!(
            info.contains(&format!("Feature Count: {features}")) && info.contains("Amersfoort / RD New + NAP height"),
            "{info}"
        );
        assert!(info.contains("height_m: Real") && info.contains("n_views: Integer64"), "{info}");
    }
    let sql = |query: &str| run(Command::new(&ogrinfo).args(["-ro", "-q", "-sql", query]).arg(&gpkg));
    let comments = sql("SELECT description FROM gpkg_data_columns WHERE column_name = 'base_z_m'");
    assert!(comments.contains("Lowest ground under the footprint"), "{comments}");
    let uncommented =
        sql("SELECT name FROM pragma_table_info('buildings') WHERE name NOT IN ('fid', 'geom') AND name NOT IN \
         (SELECT column_name FROM gpkg_data_columns WHERE table_name = 'buildings')");
    // Only the user's own columns, of which we know nothing.
    for line in uncommented.lines().filter(|line| line.contains("name (String)")) {
        let is_theirs = ["street", "floors", "input_height_m", "tags", "share"].iter().any(|name| line.ends_with(name));
        assert!(is_theirs, "{line}");
    }
    let indexes = sql("SELECT count(*) AS n FROM gpkg_extensions WHERE extension_name = 'gpkg_rtree_index'");
    assert!(indexes.contains("= 7"), "{indexes}");
    let tile = sql("SELECT tile, n_buildings, n_heights FROM tiles");
    assert!(tile.contains("n_buildings (Integer64) = 6") || tile.contains("n_buildings (Integer) = 6"), "{tile}");
}

/// Rings of a feature from their lowest corner on, so that it does not matter where they begin.
fn rings(feature: &Value) -> Vec<Vec<[f64; 2]>> {
    let ring = |ring: &Value| {
        let mut corners: Vec<[f64; 2]> =
            ring.as_array().unwrap().iter().map(|at| [at[0].as_f64().unwrap(), at[1].as_f64().unwrap()]).collect();
        assert_eq!(corners.first(), corners.last(), "rings are closed");
        corners.pop();
        let first = (0..corners.len()).min_by(|&a, &b| corners[a].partial_cmp(&corners[b]).unwrap()).unwrap();
        corners.rotate_left(first);
        corners
    };
    feature["geometry"]["coordinates"].as_array().into_iter().flatten().map(ring).collect()
}

#[test]
fn our_geojson_is_what_gdal_makes_of_our_geopackage() {
    let Some(ogr2ogr) = program("ogr2ogr", "deps-test") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (gpkg, ours, theirs) =
        (folder.path().join("a.gpkg"), folder.path().join("a.geojson"), folder.path().join("b.geojson"));
    let mut town = town();
    // On the datum of WGS 84: GDAL leaves the shift of others out, which moves the town by 100 m.
    town.crs = Crs::parse("EPSG:25831").unwrap();
    geopackage::write(&gpkg, &town.model(), &GeoPackageConfig::default()).unwrap();
    geojson::write(&ours, &town.model()).unwrap();
    run(Command::new(&ogr2ogr)
        .args(["-f", "GeoJSON", "-lco", "RFC7946=YES", "-lco", "COORDINATE_PRECISION=10"])
        .args([&theirs, &gpkg])
        .arg("buildings"));
    let (ours, theirs) = (json(&ours), json(&theirs));
    let (ours, theirs) = (ours["features"].as_array().unwrap(), theirs["features"].as_array().unwrap());
    assert_eq!((ours.len(), theirs.len()), (6, 6));
    for (our, their) in ours.iter().zip(theirs) {
        assert_eq!(our["id"], our["properties"]["id"]);
        // GDAL takes text that reads as a list for one.
        let is_told_alike = |name: &str| match (&our["properties"][name], &their["properties"][name]) {
            (Value::String(text), list @ Value::Array(_)) => serde_json::from_str::<Value>(text).unwrap() == *list,
            (our, their) => our == their,
        };
        let names = |feature: &Value| feature["properties"].as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(our), names(their));
        assert!(names(our).iter().all(|name| is_told_alike(name)), "{our} {their}");
        assert_eq!(our["geometry"].is_null(), their["geometry"].is_null());
        let (our, their) = (rings(our), rings(their));
        assert_eq!(our.iter().map(Vec::len).collect::<Vec<_>>(), their.iter().map(Vec::len).collect::<Vec<_>>());
        for (a, b) in our.iter().flatten().zip(their.iter().flatten()) {
            assert!((a[0] - b[0]).abs() < 2e-9 && (a[1] - b[1]).abs() < 2e-9, "{a:?} {b:?}");
        }
    }
}

#[test]
fn the_gltf_validator_finds_nothing_wrong_with_our_tiles() {
    for precision in [Precision::Float, Precision::Quantised] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tiles");
        write_deep(&path, precision);
        let mut files = Vec::new();
        for level in std::fs::read_dir(path.join("tiles")).unwrap() {
            files.extend(std::fs::read_dir(level.unwrap().path()).unwrap().map(|entry| entry.unwrap().path()));
        }
        let Some(n_triangles) = triangles_of_valid_gltf(&files) else { return };
        // 23 boxes of 12 triangles; the courtyard has 8 walls of 2, and 8 triangles in floor and roof each.
        assert_eq!(n_triangles, 23 * 12 + 16 + 16);
    }
}

/// Asserts that Khronos' validator finds neither errors nor warnings; the number of triangles, `None` where it is not installed.
pub fn triangles_of_valid_gltf(files: &[PathBuf]) -> Option<u64> {
    let validator = npm("gltf-validator")?;
    let script = "const v = require(process.argv[1]), fs = require('fs');
        (async () => { for (const f of process.argv.slice(2)) {
            const r = await v.validateBytes(new Uint8Array(fs.readFileSync(f)));
            console.log(JSON.stringify([r.issues.numErrors, r.issues.numWarnings, r.info.totalTriangleCount, r.issues.messages]));
        } })();";
    let output = run(Command::new("node").args(["-e", script]).arg(&validator).args(files));
    assert_eq!(output.lines().count(), files.len());
    let mut n_triangles = 0;
    for line in output.lines() {
        let report: Value = serde_json::from_str(line).unwrap();
        assert_eq!((&report[0], &report[1]), (&0.into(), &0.into()), "{line}");
        n_triangles += report[2].as_u64().unwrap();
    }
    Some(n_triangles)
}

#[test]
fn the_3d_tiles_validator_finds_nothing_wrong_with_our_tilesets() {
    let Some(validator) = npm("3d-tiles-validator") else { return };
    for precision in [Precision::Float, Precision::Quantised] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tiles");
        write_deep(&path, precision);
        let report = folder.path().join("report.json");
        let mut node = Command::new("node");
        node.arg(validator.join("build/main.js"));
        run(node.arg("-t").arg(path.join("tileset.json")).arg("-r").arg(&report));
        let report = json(&report);
        assert_eq!((&report["numErrors"], &report["numWarnings"]), (&0.into(), &0.into()), "{report:#}");
    }
}

#[test]
fn a_browser_shows_our_tiles_where_they_are_with_their_attributes() {
    let (Some(_), Some(chromium)) = (npm("cesium"), chromium()) else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiles");
    let mut town = town();
    town.lineage.command.clear();
    tiles3d::write(&path, &town.model(), &config()).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/web/show.mjs");
    let shown =
        run(Command::new("node").arg(script).arg(node_modules()).arg(chromium).arg(&path).arg(picture("cesium.png")));
    let shown: Value = serde_json::from_str(&shown).unwrap();
    assert_eq!(shown["nFeatures"], 4);
    let picked = &shown["picked"];
    let record = town.records.iter().find(|r| r.id == picked["properties"]["id"]).unwrap();
    assert_eq!(picked["properties"]["height_m"].as_f64(), record.height_m);
    assert_eq!(picked["properties"]["street"], "Zürich \"A\"");
    // Picked on a roof or a wall, so between base and roof, above the ellipsoid.
    let height_m = picked["height"].as_f64().unwrap() - 43.5;
    assert!(height_m > 11.4 - 0.5 && height_m < record.roof_z_m().unwrap() + 0.5, "{height_m} {record:?}");
    let lon_lat = sizeup::crs::Transform::new(&town.crs, &sizeup::crs::Crs::parse("EPSG:4326").unwrap()).unwrap();
    let (lon, lat) = lon_lat.point(93_035.0, 436_026.0).unwrap();
    let (dx, dy) = (picked["lon"].as_f64().unwrap() - lon, picked["lat"].as_f64().unwrap() - lat);
    assert!(dx.abs() < 1e-3 && dy.abs() < 1e-3, "{picked}");
    // Not one flat colour.
    let image = image::open(picture("cesium.png")).unwrap().to_rgb8();
    let mut colours: Vec<_> = image.pixels().collect();
    colours.sort_unstable_by_key(|p| p.0);
    colours.dedup();
    assert!(colours.len() > 8, "{} colours", colours.len());
}
