//! What other programs make of our files.

use std::path::Path;
use std::sync::Arc;

use gdal::vector::LayerAccess;
use geo::polygon;
use geo_types::Polygon;
use glam::{DMat3, DVec3};
use serde_json::{Map, Value, json};
use sizeup::camera::Camera;
use sizeup::crs::Crs;
use sizeup::frames::Rigid;
use sizeup::issue::{Issue, Severity, Subject};
use sizeup::optimise::Terrace;
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::geopackage;
use sizeup::output::read::{FoundBuildings, ReadOptions};
use sizeup::output::validate::ValidateConfig;
use sizeup::output::{BuildingRecord, CityModel, InputFile, Lineage, RoofForm, RoofShape, Status};
use sizeup::survey::{Survey, View};

/// A small town with one building of every kind.
pub struct Town {
    pub records: Vec<BuildingRecord>,
    pub crs: Crs,
    pub lineage: Lineage,
    pub issues: Vec<Issue>,
    pub survey: Survey,
}

impl Town {
    pub fn model(&self) -> CityModel<'_> {
        CityModel {
            records: &self.records,
            crs: &self.crs,
            lineage: &self.lineage,
            issues: &self.issues,
            survey: &self.survey,
        }
    }
}

pub fn building(id: &str, footprint: Option<Polygon<f64>>, height_m: Option<f64>, status: Status) -> BuildingRecord {
    let attributes = json!({ "street": "Zürich \"A\"", "floors": 3, "height_m": 9.9, "tags": ["x", 1], "share": 0.5 });
    BuildingRecord {
        footprint,
        ground_z_m: Some(12.0),
        base_z_m: Some(11.4),
        ground_ends_z_m: Some([11.4, 12.9]),
        height_m,
        height_sigma_m: height_m.map(|_| 0.31),
        reasons: if status == Status::Measured { Vec::new() } else { vec!["too_few_views".to_owned()] },
        views: vec!["a.jpg".to_owned(), "b.jpg".to_owned()],
        attributes: match attributes {
            Value::Object(attributes) => attributes,
            _ => Map::new(),
        },
        ..BuildingRecord::without_height(id, status)
    }
}

pub fn town() -> Town {
    let (e, n) = (93_000.0, 436_000.0);
    let rectangle = |x: f64, y: f64, w: f64, h: f64| polygon![(x: e + x, y: n + y), (x: e + x + w, y: n + y), (x: e + x + w, y: n + y + h), (x: e + x, y: n + y + h)];
    let courtyard = polygon!(
        exterior: [(x: e + 40.0, y: n), (x: e + 70.0, y: n), (x: e + 70.0, y: n + 30.0), (x: e + 40.0, y: n + 30.0)],
        interiors: [[(x: e + 50.0, y: n + 10.0), (x: e + 50.0, y: n + 20.0), (x: e + 60.0, y: n + 20.0), (x: e + 60.0, y: n + 10.0)]],
    );
    let tower = rectangle(0.0, 40.0, 12.0, 12.0);
    let mut refused = building("no footprint", None, None, Status::Refused);
    refused.ground_z_m = None;
    refused.base_z_m = None;
    refused.ground_ends_z_m = None;
    let gable = BuildingRecord {
        roof: Some(RoofShape::new(RoofForm::Gable, 6.0, 9.0)),
        ..building("row 2", Some(rectangle(10.0, 0.0, 10.0, 8.0)), Some(7.5), Status::Measured)
    };
    let records = vec![
        building("row 1", Some(rectangle(0.0, 0.0, 10.0, 8.0)), Some(6.25), Status::Measured),
        gable,
        building("courtyard", Some(courtyard), Some(15.0), Status::Doubtful),
        building("tower", Some(tower), Some(61.0), Status::Fallback),
        building("unknown", Some(rectangle(30.0, 40.0, 20.0, 9.0)), None, Status::Unknown),
        refused,
    ];
    let look_down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
    let tilted = DMat3::from_rotation_x(0.7) * look_down;
    let camera = Arc::new(Camera::pinhole(6000, 4000, 5000.0));
    let view = |name: &str, rotation, x: f64| View {
        id: name.into(),
        camera: camera.clone(),
        camera_from_map: Rigid::from_rotation_and_centre(rotation, DVec3::new(e + x, n - 40.0, 120.0)),
        image: None,
    };
    let survey =
        Survey { views: vec![view("a.jpg", look_down, 20.0), view("b.jpg", tilted, 50.0)], issues: Vec::new() };
    let lineage = Lineage {
        version: "0.1.0".to_owned(),
        commit: None,
        command: "sizeup run town.toml".to_owned(),
        config_sha256: "00".repeat(32),
        inputs: vec![InputFile {
            role: "footprints".to_owned(),
            path: "town.gpkg".to_owned(),
            size_bytes: 12,
            sha256: "11".repeat(32),
        }],
        crs: "EPSG:7415".to_owned(),
        vertical_reference: "orthometric, NAP height".to_owned(),
        height_definition: "mean roof level minus ground level".to_owned(),
        seed: 7,
        reference_date: Some("2025-06-01".to_owned()),
        source: None,
    };
    let subject = Subject::Building("no footprint".to_owned());
    let issues = vec![
        Issue::new(Severity::Refused, "footprint_self_crossing", subject, "crosses itself").hint("repair it").at(e, n),
        Issue::new(Severity::Note, "photo_without_pose", Subject::View("c.jpg".to_owned()), "no pose"),
    ];
    Town { records, crs: Crs::parse("EPSG:7415").unwrap(), lineage, issues, survey }
}

fn read_json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Asserts that cjval finds neither errors nor warnings in a file.
pub fn assert_valid_cityjson(path: &Path) {
    let text = std::fs::read_to_string(path).unwrap();
    for (criterion, summary) in cjval::CJValidator::from_str(&text).validate() {
        assert!(!summary.has_errors(), "{criterion}: {summary}");
        assert!(summary.get_errors().is_empty(), "{criterion}: {summary}");
    }
}

#[test]
fn cjval_finds_nothing_to_say_about_our_cityjson() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    cityjson::write(&path, &town().model(), &CityJsonConfig::default()).unwrap();
    assert_valid_cityjson(&path);
}

#[test]
fn cjval_accepts_every_line_of_our_sequence_and_it_reads_back_like_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let (one, sequence) = (folder.path().join("town.city.json"), folder.path().join("town.city.jsonl"));
    let town = town();
    cityjson::write(&one, &town.model(), &CityJsonConfig::default()).unwrap();
    cityjson::write_sequence(&sequence, &town.model(), &CityJsonConfig::default()).unwrap();
    let text = std::fs::read_to_string(&sequence).unwrap();
    let mut lines = text.lines();
    let mut validator = cjval::CJValidator::from_str(lines.next().unwrap());
    assert!(validator.is_valid());
    for line in lines {
        validator.from_str_cjfeature(line).unwrap();
        for (criterion, summary) in validator.validate() {
            assert!(summary.get_errors().is_empty(), "{criterion}: {summary}");
        }
    }
    let read = |path: &Path| sizeup::evaluate::read::read_results(path, &town.crs).unwrap();
    assert_eq!(read(&one), read(&sequence));
}

#[test]
fn roofs_are_solids_beside_the_blocks_and_come_back_from_the_files() {
    let mut town = town();
    let (e, n) = (93_000.0, 436_000.0);
    town.records[1].roof =
        Some(RoofShape { ridge_azimuth_deg: Some(90.0), ..RoofShape::new(RoofForm::Gable, 6.0, 9.0) });
    let corners = [[e, n + 40.0], [e + 5.0, n + 40.0], [e + 5.0, n + 52.0], [e, n + 52.0]];
    let step = Some(Terrace { corners, is_upper: true });
    town.records[3].roof = Some(RoofShape { step, ..RoofShape::new(RoofForm::Stepped, 50.0, 65.0) });
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    cityjson::write(&path("town.city.json"), &town.model(), &CityJsonConfig::default()).unwrap();
    geopackage::write(&path("town.gpkg"), &town.model()).unwrap();
    assert_valid_cityjson(&path("town.city.json"));
    let found = sizeup::output::validate::validate_file(&path("town.city.json"), &ValidateConfig::default()).unwrap();
    assert!(found.is_valid() && found.n_geometries == 13, "{found:?}");

    // Four buildings as blocks and with their roofs, and one footprint on the ground.
    let objects = read_json(&path("town.city.json"))["CityObjects"].clone();
    let lods = |id: &str| -> Vec<String> {
        let all = objects[id]["geometry"].as_array().unwrap();
        all.iter().map(|geometry| geometry["lod"].as_str().unwrap().to_owned()).collect()
    };
    // Also where nobody looked at the roof: who takes a level has all buildings.
    for id in ["row 1", "row 2", "courtyard", "tower"] {
        assert_eq!(lods(id), ["1.2", "1.3", "2.0"], "{id}");
    }
    assert_eq!(lods("unknown"), ["0"]);
    let faces = |id: &str, lod: usize| objects[id]["geometry"][lod]["boundaries"].clone();
    assert_eq!([1, 2].map(|lod| faces("row 1", lod)), [0, 0].map(|lod| faces("row 1", lod)));
    // A gable has one level; a step has two, and no slopes.
    assert_eq!((faces("row 2", 1), faces("tower", 1)), (faces("row 2", 0), faces("tower", 2)));
    let n_roofs = |id: &str, lod: usize| {
        let semantics = &objects[id]["geometry"][lod]["semantics"];
        let kinds = semantics["values"][0].as_array().unwrap();
        let is_roof = |kind: &&Value| semantics["surfaces"][kind.as_u64().unwrap() as usize]["type"] == "RoofSurface";
        kinds.iter().filter(is_roof).count()
    };
    assert_eq!([0, 1, 2].map(|lod| n_roofs("row 2", lod)), [1, 1, 2]);
    assert_eq!([0, 1, 2].map(|lod| n_roofs("tower", lod)), [1, 2, 2]);
    // 12 m ground, 9 m to the ridge, 65 m to the upper level.
    let top = |id: &str| objects[id]["geographicalExtent"][5].as_f64().unwrap();
    assert_eq!((top("row 2"), top("tower")), (21.0, 77.0));

    for from in ["town.city.json", "town.gpkg"] {
        let read = FoundBuildings::read(&path(from), &ReadOptions::default()).unwrap();
        let records = read.to_records();
        for (id, roof) in [("row 2", town.records[1].roof), ("tower", town.records[3].roof)] {
            let record = records.iter().find(|record| record.id == id).unwrap();
            assert_eq!(record.roof, roof, "{id} of {from}");
        }
    }
}

#[test]
fn every_building_is_in_the_cityjson_and_says_why_it_has_no_solid() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    cityjson::write(&path, &town().model(), &CityJsonConfig::default()).unwrap();
    let file = read_json(&path);
    assert_eq!(file["CityObjects"].as_object().unwrap().len(), 6);
    assert_eq!(file["metadata"]["referenceSystem"], "https://www.opengis.net/def/crs/EPSG/0/7415");
    assert_eq!(file["metadata"]["sizeup"]["vertical_reference_system"], "NAP height");
    assert_eq!(file["metadata"]["geographicalExtent"], json!([93000.0, 436_000.0, 11.4, 93070.0, 436_052.0, 73.0]));
    let tower = &file["CityObjects"]["tower"];
    assert_eq!(tower["attributes"]["roof_z_m"], 73.0);
    assert_eq!(tower["attributes"]["input_height_m"], 9.9);
    assert_eq!(tower["geographicalExtent"], json!([93000.0, 436_040.0, 11.4, 93012.0, 436_052.0, 73.0]));
    assert_eq!(file["CityObjects"]["unknown"]["attributes"]["no_solid_reason"], "no_height");
    assert_eq!(file["CityObjects"]["no footprint"]["attributes"]["no_solid_reason"], "no_footprint");
    assert_eq!(file["CityObjects"]["no footprint"]["geometry"], json!([]));
    // Row houses share the four corners of their party wall: 2 of the ground, and 2 roofs at their own heights.
    // A building without a height has its footprint.
    assert_eq!(file["vertices"].as_array().unwrap().len(), 8 + 8 - 2 + 16 + 8 + 4);
    let footprint = &file["CityObjects"]["unknown"]["geometry"][0];
    assert_eq!((&footprint["type"], &footprint["lod"]), (&json!("MultiSurface"), &json!("0")));
}

#[test]
fn the_header_names_the_inputs_and_keeps_commands_folders_and_priors_to_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.city.json");
    let mut town = town();
    town.lineage.command = "sizeup run /home/anna/town.toml".to_owned();
    town.lineage.inputs[0].path = "/home/anna/town.gpkg".to_owned();
    let prior = |i: usize| InputFile {
        role: "prior".to_owned(),
        path: format!("/home/anna/priors/{i}.npy"),
        size_bytes: 9,
        sha256: "22".repeat(32),
    };
    town.lineage.inputs.extend((0..40).map(prior));
    cityjson::write(&path, &town.model(), &CityJsonConfig::default()).unwrap();
    let file = read_json(&path);
    let lineage = &file["metadata"]["sizeup"];
    assert_eq!(lineage["inputs"], json!([{ "role": "footprints", "path": "town.gpkg" }]));
    let text = file["metadata"].to_string();
    assert!(!text.contains("anna") && !text.contains("priors") && text.len() < 1000, "{text}");
    // What a comparison and an export need is still there.
    let read = sizeup::output::read::RecordFile::open(&path, ReadOptions::default()).unwrap().lineage().unwrap();
    assert_eq!((read.vertical_reference, read.seed), (town.lineage.vertical_reference, 7));
    assert_eq!(read.reference_date.as_deref(), Some("2025-06-01"));
}

#[test]
fn the_same_model_is_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = ["a", "b"].map(|name| {
        let path = folder.path().join(name).join("town.city.json");
        cityjson::write(&path, &town().model(), &CityJsonConfig::default()).unwrap();
        std::fs::read(path).unwrap()
    });
    assert_eq!(bytes[0], bytes[1]);
}

fn write_gpkg(folder: &Path, name: &str) -> std::path::PathBuf {
    let path = folder.join(name);
    geopackage::write(&path, &town().model()).unwrap();
    path
}

#[test]
fn the_geopackage_has_all_layers_with_crs_and_features() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = gdal::Dataset::open(write_gpkg(folder.path(), "town.gpkg")).unwrap();
    let count = |name: &str| dataset.layer_by_name(name).unwrap().feature_count();
    assert_eq!(count("buildings"), 6);
    assert_eq!(["buildings_lod1", "buildings_lod13", "buildings_lod2"].map(count), [4, 4, 4]);
    assert_eq!(count("cameras"), 2);
    assert_eq!(count("qa_issues"), 2);
    let mut buildings = dataset.layer_by_name("buildings").unwrap();
    assert_eq!(buildings.spatial_ref().unwrap().auth_code().unwrap(), 7415);
    let courtyard =
        buildings.features().find(|f| f.field_as_string(0).unwrap().as_deref() == Some("courtyard")).unwrap();
    let text = |name: &str| courtyard.field_as_string(courtyard.field_index(name).unwrap()).unwrap();
    let real = |name: &str| courtyard.field_as_double(courtyard.field_index(name).unwrap()).unwrap();
    assert_eq!(real("height_m"), Some(15.0));
    assert_eq!(real("roof_z_m"), Some(27.0));
    assert_eq!(real("input_height_m"), Some(9.9));
    assert_eq!(text("status").as_deref(), Some("doubtful"));
    assert_eq!(text("reasons").as_deref(), Some("too_few_views"));
    assert_eq!(text("views").as_deref(), Some("a.jpg; b.jpg"));
    assert_eq!(text("street").as_deref(), Some("Zürich \"A\""));
    assert_eq!(text("tags").as_deref(), Some("[\"x\",1]"));
    let footprint = courtyard.geometry().unwrap();
    assert_eq!(footprint.area(), 900.0 - 100.0);
}

#[test]
fn geopackage_cameras_look_where_they_look() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = gdal::Dataset::open(write_gpkg(folder.path(), "town.gpkg")).unwrap();
    let mut cameras = dataset.layer_by_name("cameras").unwrap();
    let rows: Vec<(String, f64, f64)> = cameras
        .features()
        .map(|f| {
            let real = |name: &str| f.field_as_double(f.field_index(name).unwrap()).unwrap().unwrap();
            (f.field_as_string(1).unwrap().unwrap(), real("yaw_deg"), real("pitch_deg"))
        })
        .collect();
    assert_eq!(rows[0], ("nadir".to_owned(), 0.0, -90.0));
    assert_eq!(rows[1].0, "oblique");
    assert!((rows[1].2 + 90.0 - 0.7_f64.to_degrees()).abs() < 1e-3, "{rows:?}");
}

#[test]
fn the_same_model_is_the_same_geopackage_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let a = std::fs::read(write_gpkg(folder.path(), "a.gpkg")).unwrap();
    let b = std::fs::read(write_gpkg(folder.path(), "b.gpkg")).unwrap();
    assert!(a == b, "{} and {} bytes", a.len(), b.len());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no litter");
}

#[test]
fn gdals_threaded_index_of_large_layers_does_not_break_the_transaction() {
    // GDAL starts it beyond some 100,000 features; this makes it start at the first.
    gdal::config::set_thread_local_config_option("OGR_GPKG_THREADED_RTREE_AT_FIRST_FEATURE", "YES").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let dataset = gdal::Dataset::open(write_gpkg(folder.path(), "town.gpkg")).unwrap();
    assert_eq!(dataset.layer_by_name("buildings").unwrap().feature_count(), 6);
}
