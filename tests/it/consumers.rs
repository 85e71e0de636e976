//! What other people's programs make of our files; skipped where a program is not installed.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use sizeup::crs::Crs;
use sizeup::output::citygml::{self, Edition};
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::geopackage;
use sizeup::output::tiles3d::{self, Precision};
use sizeup::output::{csv, dxf, flatcitybuf, flatgeobuf, geojson, kml, mesh};

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
    geopackage::write(&gpkg, &town.model()).unwrap();
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
    geopackage::write(&gpkg, &town.model()).unwrap();
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
    for precision in [Precision::Float, Precision::Quantised] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tiles");
        write_deep(&path, precision);
        is_valid_tileset(&path);
    }
}

/// Asserts that Cesium's validator finds neither errors nor warnings, where it is installed.
pub fn is_valid_tileset(folder: &Path) {
    let Some(validator) = npm("3d-tiles-validator") else { return };
    let report = tempfile::NamedTempFile::new().unwrap();
    let mut node = Command::new("node");
    node.arg(validator.join("build/main.js"));
    run(node.arg("-t").arg(folder.join("tileset.json")).arg("-r").arg(report.path()));
    let report = json(report.path());
    assert_eq!((&report["numErrors"], &report["numWarnings"]), (&0.into(), &0.into()), "{report:#}");
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

/// The town with a gable that the grid bends, so that its roof is of triangles.
pub fn town_with_a_roof() -> crate::outputs::Town {
    let mut town = town();
    let shape = sizeup::output::RoofShape {
        ridge_azimuth_deg: Some(17.0),
        ..sizeup::output::RoofShape::new(sizeup::output::RoofForm::Gable, 5.0, 7.5)
    };
    (town.records[0].roof, town.records[0].height_m) = (Some(shape), Some(6.25));
    town
}

/// Corners of the triangles of a binary STL.
fn triangles_of_stl(path: &Path) -> Vec<[[u32; 3]; 3]> {
    let bytes = std::fs::read(path).unwrap();
    let n = u32::from_le_bytes(bytes[80..84].try_into().unwrap()) as usize;
    assert_eq!(bytes.len(), 84 + 50 * n);
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let corner = |t: usize, c: usize| std::array::from_fn(|axis| number(84 + 50 * t + 12 * (c + 1) + 4 * axis));
    (0..n).map(|t| std::array::from_fn(|c| corner(t, c))).collect()
}

#[test]
fn a_printer_gets_closed_solids_on_one_plate() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.stl");
    mesh::write_stl(&path, &town_with_a_roof().model()).unwrap();
    let triangles = triangles_of_stl(&path);
    assert!(triangles.len() > 40, "{}", triangles.len());
    // Every edge as often one way as the other: also where two houses share a wall.
    let mut ways: std::collections::BTreeMap<[[u32; 3]; 2], i32> = std::collections::BTreeMap::new();
    for [a, b, c] in &triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (edge, way) = if from < to { ([*from, *to], 1) } else { ([*to, *from], -1) };
            *ways.entry(edge).or_default() += way;
        }
    }
    assert!(ways.values().all(|way| *way == 0));
    let metres = |bits: [u32; 3]| bits.map(|b| f64::from(f32::from_bits(b)));
    let six_volumes: f64 = triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|corner| glam::DVec3::from_array(metres(corner)));
            a.dot(b.cross(c))
        })
        .sum();
    let lowest = triangles.iter().flatten().map(|corner| metres(*corner)[2]).fold(f64::INFINITY, f64::min);
    let city = folder.path().join("town.city.json");
    cityjson::write(&city, &town_with_a_roof().model(), &CityJsonConfig::default()).unwrap();
    let objects = json(&city);
    let stated_m3: f64 = objects["CityObjects"]
        .as_object()
        .unwrap()
        .values()
        .filter_map(|o| o["attributes"]["lod2_volume_m3"].as_f64())
        .sum();
    assert_eq!(lowest, 0.0);
    // STL has seven digits.
    assert!((six_volumes / 6.0 / stated_m3 - 1.0).abs() < 1e-5, "{} of {stated_m3}", six_volumes / 6.0);
}

/// Area and normal of a ring of corners, by triangles from its first.
fn area_and_normal(ring: &[glam::DVec3]) -> (f64, glam::DVec3) {
    let twice: glam::DVec3 = ring[1..].windows(2).map(|pair| (pair[0] - ring[0]).cross(pair[1] - ring[0])).sum();
    (twice.length() / 2.0, twice.normalize())
}

#[test]
fn each_plane_of_a_roof_is_a_surface_of_cityjson_and_citygml_with_its_slope_and_aspect() {
    let folder = tempfile::tempdir().unwrap();
    let (path, gml) = (folder.path().join("town.city.json"), folder.path().join("town.gml"));
    let town = town_with_a_roof();
    cityjson::write(&path, &town.model(), &CityJsonConfig::default()).unwrap();
    citygml::write(&gml, &town.model(), Edition::V2).unwrap();
    assert_valid_cityjson(&path);
    let city = json(&path);
    let number = |value: &Value| value.as_f64().unwrap();
    let corner = |index: &Value| {
        let vertex = &city["vertices"][index.as_u64().unwrap() as usize];
        glam::DVec3::from_array(std::array::from_fn(|axis| {
            number(&vertex[axis]) * number(&city["transform"]["scale"][axis])
        }))
    };
    let geometry = &city["CityObjects"]["row 1"]["geometry"];
    let solid = geometry.as_array().unwrap().iter().find(|solid| solid["lod"] == "2.0").unwrap();
    let surfaces = solid["semantics"]["surfaces"].as_array().unwrap();
    let roofs: Vec<usize> = (0..surfaces.len()).filter(|i| surfaces[*i]["type"] == "RoofSurface").collect();
    assert_eq!(roofs.len(), 2, "{surfaces:?}");
    for roof in roofs {
        let values = solid["semantics"]["values"][0].as_array().unwrap();
        let of_roof = (0..values.len()).filter(|face| values[*face] == roof);
        let rings: Vec<Vec<glam::DVec3>> = of_roof
            .map(|face| solid["boundaries"][0][face][0].as_array().unwrap().iter().map(corner).collect())
            .collect();
        let area_m2: f64 = rings.iter().map(|ring| area_and_normal(ring).0).sum();
        let (_, normal) = area_and_normal(&rings[0]);
        let stated = &surfaces[roof];
        assert!((area_m2 - number(&stated["area_m2"])).abs() < 0.01, "{area_m2} of {stated}");
        // Faces that the grid has bent are millimetres off their plane.
        assert!((normal.z.acos().to_degrees() - number(&stated["slope_deg"])).abs() < 0.1, "{normal} of {stated}");
        let aspect_deg = normal.x.atan2(normal.y).to_degrees().rem_euclid(360.0);
        assert!((aspect_deg - number(&stated["aspect_deg"])).abs() < 0.2, "{aspect_deg} of {stated}");
        let in_gml = format!("<gen:doubleAttribute name=\"slope_deg\"><gen:value>{}</gen:value>", stated["slope_deg"]);
        assert!(std::fs::read_to_string(&gml).unwrap().contains(&in_gml), "{in_gml}");
    }
    // Nobody looked for the form of the others.
    let tower = &city["CityObjects"]["tower"]["geometry"][2]["semantics"]["surfaces"];
    assert!(tower.as_array().unwrap().iter().all(|surface| surface["slope_deg"].is_null()), "{tower}");
}

#[test]
fn an_obj_has_an_object_per_building_in_the_place_that_its_head_states() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.obj");
    mesh::write_obj(&path, &town_with_a_roof().model()).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let objects: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("o ")).collect();
    assert_eq!(objects, ["row 1", "row 2", "courtyard", "tower"]);
    let origin: Vec<f64> = text.lines().nth(1).unwrap().split(' ').filter_map(|word| word.parse().ok()).collect();
    let corners: Vec<[f64; 3]> = text
        .lines()
        .filter_map(|line| line.strip_prefix("v "))
        .map(|line| {
            let mut numbers = line.split(' ').zip(&origin).map(|(word, o)| word.parse::<f64>().unwrap() + o);
            std::array::from_fn(|_| numbers.next().unwrap())
        })
        .collect();
    assert!(corners.contains(&[93_000.0, 436_000.0, 11.4]), "{corners:?}");
    let numbers = text.lines().filter_map(|line| line.strip_prefix("f ")).flat_map(|line| line.split(' '));
    let numbers: Vec<usize> = numbers.map(|word| word.parse().unwrap()).collect();
    assert_eq!(numbers.iter().max(), Some(&corners.len()));
    for kind in ["ground", "roof", "wall"] {
        assert!(text.contains(&format!("\ng {kind}\n")), "{kind}");
    }
}

#[test]
fn gdal_reads_our_dxf_with_faces_footprints_and_ids() {
    let Some(ogrinfo) = program("ogrinfo", "deps-test") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.dxf");
    let mut town = town_with_a_roof();
    town.records[0].id = "Häuser 1".to_owned();
    dxf::write(&path, &town.model()).unwrap();
    let count = |layer: &str| -> usize {
        let sql = format!("SELECT COUNT(*) AS n FROM entities WHERE Layer = '{layer}'");
        let said = run(Command::new(&ogrinfo).arg(&path).args(["-dialect", "sqlite", "-sql", &sql]));
        let of = |line: &str| line.split("n (Integer) = ").nth(1).map(|n| n.trim().parse().unwrap());
        said.lines().find_map(of).unwrap_or_else(|| panic!("{said}"))
    };
    let all = run(Command::new(&ogrinfo).arg(&path).args(["-al", "-q"]));
    assert!(count("ROOF") >= 5 && count("WALL") > 30, "{all}");
    // The courtyard has two outlines; a building without a height has one, and no faces.
    assert_eq!((count("FOOTPRINTS"), count("IDS")), (6, 5), "{all}");
    // As CAD writes letters that release 12 has not.
    assert!(all.contains("H\\U+00E4user 1"), "{all}");
    assert!(all.contains("POLYGON Z ((93000 436000 11.4,"), "{all}");
}

#[test]
fn gdal_reads_our_kml_on_the_globe_with_all_attributes() {
    let Some(ogrinfo) = program("ogrinfo", "deps-test") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.kml");
    kml::write(&path, &town().model()).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("<extrude>1</extrude>") && text.contains("relativeToGround"), "{text}");
    let said = run(Command::new(ogrinfo).arg(&path).args(["-al", "-q"]));
    assert!(said.contains("Name (String) = tower") && said.contains("height_m (Real) = 61"), "{said}");
    // Rotterdam, 61 m above the ground.
    assert!(said.contains("(4.4") && said.contains(" 51.9") && said.contains(" 61"), "{said}");
}

#[test]
fn a_spreadsheet_gets_a_row_per_building_and_the_meaning_of_each_column() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.csv");
    csv::write(&path, &town().model()).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let described = json(&folder.path().join("town.csv-metadata.json"));
    let columns = described["tableSchema"]["columns"].as_array().unwrap();
    let names: Vec<&str> = columns.iter().map(|column| column["name"].as_str().unwrap()).collect();
    assert_eq!(text.lines().next().unwrap(), names.join(","));
    assert_eq!((text.lines().count(), &described["url"]), (7, &"town.csv".into()));
    assert_eq!(names[names.len() - 2..], ["x_m", "y_m"]);
    assert!(columns.iter().all(|column| column["dc:description"].as_str().is_some_and(|words| words.len() > 5)));
    let tower = text.lines().find(|line| line.starts_with("tower,")).unwrap();
    // Lists of the input have commas of their own: from the left up to our columns, from the right for the place.
    let at = names.iter().position(|name| *name == "height_m").unwrap();
    assert_eq!(tower.split(',').nth(at), Some("61"));
    let x_m: f64 = tower.rsplit(',').nth(1).unwrap().parse().unwrap();
    assert!((93_000.0..93_012.0).contains(&x_m), "{tower}");
}
