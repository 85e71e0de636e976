//! The commands that look input and results over, as a user types them.
//!
//! Real data lies beside the repository, in `../shared/data`; where it does not, these tests say `skipped`.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use serde_json::{Value, json};

use crate::shared_data::shared_data;

fn sizeup(args: &[&str]) -> Output {
    Command::cargo_bin("sizeup").unwrap().args(args).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Poses of a table, `n` nadir views 100 m up; `kind` of angles turned by `omega_deg`.
fn table(path: &Path, n: usize, omega_deg: f64) {
    let mut rows = "name,x,y,z,omega,phi,kappa,width,height,fx,cx,cy\n".to_owned();
    for i in 0..n {
        let easting = 566_000 + 10 * i;
        writeln!(rows, "{i}.jpg,{easting},5763000,180,{omega_deg},0,0,400,300,500,200,150").unwrap();
    }
    fs::write(path, rows).unwrap();
}

#[test]
fn a_sound_survey_exits_0_and_one_that_looks_up_exits_3() {
    let folder = tempfile::tempdir().unwrap();
    let poses = folder.path().join("poses.csv");
    let path = poses.to_str().unwrap();
    table(&poses, 10, 10.0);
    let sound = sizeup(&["survey", "inspect", path, "--crs", "EPSG:25832", "--ground", "80"]);
    assert_eq!(sound.status.code(), Some(0), "{}", text(&sound.stderr));
    let stdout = text(&sound.stdout);
    assert!(stdout.contains("The poses look right") && stdout.contains("100.0 m"), "{stdout}");
    table(&poses, 10, 170.0);
    let unsound = sizeup(&["survey", "inspect", path, "--crs", "EPSG:25832", "--json"]);
    assert_eq!(unsound.status.code(), Some(3));
    let report: Value = serde_json::from_slice(&unsound.stdout).unwrap();
    assert_eq!((&report["is_sound"], &report["n_poses"]), (&json!(false), &json!(10)));
    let findings = report["findings"].as_array().unwrap();
    assert!(findings.iter().any(|f| f.as_str().unwrap().contains("look down")), "{report}");
}

#[test]
fn cameras_below_the_ground_are_told_and_pictures_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let poses = folder.path().join("poses.csv");
    table(&poses, 10, 10.0);
    let picture = folder.path().join("survey.png");
    let args = ["survey", "inspect", poses.to_str().unwrap(), "--crs", "EPSG:25832", "--ground", "400", "--picture"];
    let told = sizeup(&[&args[..], &[picture.to_str().unwrap()]].concat());
    assert_eq!(told.status.code(), Some(3));
    assert!(text(&told.stdout).contains("below the ground"), "{}", text(&told.stdout));
    assert!(image::open(&picture).unwrap().width() > 100);
}

#[test]
fn refused_poses_are_on_the_picture_and_in_the_text() {
    let folder = tempfile::tempdir().unwrap();
    let (poses, picture) = (folder.path().join("poses.csv"), folder.path().join("survey.png"));
    let rows = "a.jpg,699000,5764000,4e10,0,0,0,400,300,300\nb.jpg,699050,5764000,300,180,0,0,400,300,300\n";
    std::fs::write(&poses, format!("name,x,y,z,omega,phi,kappa,width,height,fx\n{rows}")).unwrap();
    let args =
        ["survey", "inspect", poses.to_str().unwrap(), "--crs", "EPSG:25832", "--picture", picture.to_str().unwrap()];
    let told = sizeup(&args);
    assert_eq!(told.status.code(), Some(3), "{}", text(&told.stderr));
    for why in ["a.jpg: its camera is 40000000000 m high", "b.jpg: it looks 180.0° off the vertical", "2 refused items"]
    {
        assert!(text(&told.stdout).contains(why), "{why:?} is missing in: {}", text(&told.stdout));
    }
    // Bluish green of the Okabe-Ito palette: two dots on the map and one in the legend.
    let map = image::open(&picture).unwrap().into_rgb8();
    let is_green = |x: u32, y: u32| map.get_pixel(x, y).0 == [0, 158, 115];
    let (width, height) = map.dimensions();
    let starts = |x: &u32, y: u32| is_green(*x, y) && (*x == 0 || !is_green(x - 1, y));
    let columns: std::collections::BTreeSet<u32> =
        (0..height).flat_map(|y| (0..width).filter(move |x| starts(x, y)).map(|x| x / 40)).collect();
    assert!(columns.len() >= 3, "{columns:?}");
}

#[test]
fn footprints_still_to_come_do_not_keep_the_poses_from_being_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    table(&folder.path().join("poses.csv"), 10, 10.0);
    let config = folder.path().join("sizeup.toml");
    let settings =
        "project = { crs = \"EPSG:25832\" }\nsurvey = { path = \"poses.csv\" }\nterrain = { dtm = \"dtm.tif\" }\n";
    let inspect = |footprints: &str, more: &[&str]| {
        fs::write(&config, format!("{settings}footprints = {footprints}\n")).unwrap();
        sizeup(&[&["survey", "inspect", "--config", config.to_str().unwrap(), "--ground", "80"], more].concat())
    };
    let absent = inspect("{ path = \"absent.gpkg\" }", &[]);
    assert_eq!(absent.status.code(), Some(0), "{}", text(&absent.stderr));
    assert!(text(&absent.stderr).contains("absent.gpkg is not there"), "{}", text(&absent.stderr));
    // A flag names a layer, also where the file has masks.
    let masks = "{ source = \"masks\", path = \"{stem}.png\", kind = \"instance\" }";
    let area = folder.path().join("area.geojson");
    let ring = json!([[9.95, 52.01], [9.98, 52.01], [9.98, 52.03], [9.95, 52.03], [9.95, 52.01]]);
    let layer = json!({ "type": "FeatureCollection", "features": [{ "type": "Feature", "properties": { "id": "a" },
        "geometry": { "type": "Polygon", "coordinates": [ring] } }] });
    fs::write(&area, layer.to_string()).unwrap();
    let seen = inspect(masks, &["--footprints", area.to_str().unwrap(), "--set", "footprints.id_field=id"]);
    assert_eq!(seen.status.code(), Some(0), "{}{}", text(&seen.stdout), text(&seen.stderr));
    assert!(text(&seen.stdout).contains("see the area            100 %"), "{}", text(&seen.stdout));
}

/// A configuration over poses 60 m by 80 m wide on the ground, and a block of a footprint `corners` (eastings, northings).
fn block(folder: &Path, [west, south, east, north]: [f64; 4]) -> std::path::PathBuf {
    let ring = json!([[west, south], [east, south], [east, north], [west, north], [west, south]]);
    let crs = json!({ "type": "name", "properties": { "name": "urn:ogc:def:crs:EPSG::25832" } });
    let layer = json!({ "type": "FeatureCollection", "crs": crs, "features": [{ "type": "Feature",
        "properties": { "id": "a" }, "geometry": { "type": "Polygon", "coordinates": [ring] } }] });
    fs::write(folder.join("block.geojson"), layer.to_string()).unwrap();
    let config = folder.join("sizeup.toml");
    let settings = "project = { crs = \"EPSG:25832\" }\nsurvey = { path = \"poses.csv\" }\n\
                    terrain = { constant_m = 80.0 }\nfootprints = { path = \"block.geojson\", id_field = \"id\" }\n";
    fs::write(&config, settings).unwrap();
    config
}

#[test]
fn a_good_flight_larger_than_its_block_is_right_and_one_beside_it_is_not() {
    let folder = tempfile::tempdir().unwrap();
    table(&folder.path().join("poses.csv"), 100, 0.0);
    let inspect = |corners: [f64; 4]| {
        let config = block(folder.path(), corners);
        let told = sizeup(&["survey", "inspect", "--config", config.to_str().unwrap(), "--json"]);
        (told.status.code(), serde_json::from_slice::<Value>(&told.stdout).unwrap())
    };
    let (code, report) = inspect([566_300.0, 5_762_990.0, 566_400.0, 5_763_010.0]);
    assert!(report["sees_area"].as_f64().unwrap() < 0.2, "{report}");
    assert_eq!((code, &report["area_seen"], &report["findings"]), (Some(0), &json!(1.0), &json!([])), "{report}");
    let (code, report) = inspect([566_300.0, 5_763_990.0, 566_400.0, 5_764_010.0]);
    assert_eq!((code, &report["area_seen"]), (Some(3), &json!(0.0)), "{report}");
    let finding = report["findings"][0].as_str().unwrap();
    assert!(finding.contains("expected at least 50 %") && finding.contains("0 % of it is in a photo"), "{finding}");
}

#[test]
fn a_flight_above_its_block_that_looks_elsewhere_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    // All photos look 58 m to the side of the flight line, past the block that most of them show the rim of.
    table(&folder.path().join("poses.csv"), 100, 30.0);
    let config = block(folder.path(), [566_000.0, 5_762_998.0, 567_000.0, 5_763_057.0]);
    let told = sizeup(&["survey", "inspect", "--config", config.to_str().unwrap(), "--json"]);
    let report: Value = serde_json::from_slice(&told.stdout).unwrap();
    assert!(report["area_seen"].as_f64().unwrap() > 0.5, "{report}");
    assert_eq!((told.status.code(), &report["sees_area"]), (Some(3), &json!(0.0)), "{report}");
}

#[test]
fn an_unknown_crs_is_told_by_us_alone() {
    let folder = tempfile::tempdir().unwrap();
    let poses = folder.path().join("poses.csv");
    table(&poses, 3, 10.0);
    let told = text(&sizeup(&["survey", "inspect", poses.to_str().unwrap(), "--crs", "EPSG:99999"]).stderr);
    assert!(told.contains("unknown CRS \"EPSG:99999\"") && !told.contains("proj_create"), "{told}");
}

#[test]
fn a_conversion_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let poses = folder.path().join("poses.csv");
    table(&poses, 10, 10.0);
    let model = folder.path().join("model");
    let (path, output) = (poses.to_str().unwrap(), model.to_str().unwrap());
    let converted = sizeup(&["survey", "convert", path, "--crs", "EPSG:25832", "--to", "colmap", "--output", output]);
    assert_eq!(converted.status.code(), Some(0), "{}", text(&converted.stderr));
    assert_eq!(text(&converted.stdout).lines().count(), 4);
    let offset = "566000,5763000,0";
    let back = sizeup(&["survey", "inspect", output, "--crs", "EPSG:25832", "--offset", offset, "--json"]);
    let report: Value = serde_json::from_slice(&back.stdout).unwrap();
    assert_eq!((&report["n_views"], &report["format"]), (&json!(10), &json!("colmap")));
}

#[test]
fn rotterdam_is_compared_with_its_ground_polygons_in_one_command() {
    let Some(folder) = shared_data("rotterdam_oblique_cameras") else { return };
    let (poses, polygons) = (folder.join("camera_parameters.txt"), folder.join("image_footprints.geojson"));
    let args = ["survey", "inspect", poses.to_str().unwrap(), "--format", "csv", "--crs", "EPSG:7415", "--ground", "0"];
    let settings = [
        "--set",
        "survey.csv.name=image_id",
        "--set",
        "survey.csv.sequence=zyx",
        "--set",
        "survey.csv.direction=world_to_camera",
        "--compare-footprints",
        polygons.to_str().unwrap(),
        "--json",
    ];
    let compared = sizeup(&[&args[..], &settings].concat());
    assert_eq!(compared.status.code(), Some(0), "{}", text(&compared.stderr));
    let report: Value = serde_json::from_slice(&compared.stdout).unwrap();
    let errors = &report["corner_errors"];
    assert_eq!(errors["n_compared"], json!(1403));
    // The photos' own accuracy on a level ground of 0 m; the usual reading of the angles is off by hundreds of metres.
    assert!(errors["worst_corner_m"]["median"].as_f64().unwrap() <= 3.0, "{errors}");
    assert!(errors["worst_corner_m"]["max"].as_f64().unwrap() < 14.0, "{errors}");
}

#[test]
fn a_missing_grid_is_named_once_and_gdal_says_nothing_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let poses = folder.path().join("poses.csv");
    table(&poses, 3, 10.0);
    let args = ["survey", "inspect", poses.to_str().unwrap(), "--crs", "EPSG:7415", "--pose-crs", "EPSG:4979"];
    let outcome = sizeup(&args);
    assert!(!text(&outcome.stderr).contains("ERROR "), "{}", text(&outcome.stderr));
}

/// A square building of a file that cannot be valid: its roof is missing.
fn open_box() -> Value {
    let corner = |i: usize| {
        json!([if i % 4 == 1 || i % 4 == 2 { 10000 } else { 0 }, if i % 4 > 1 { 10000 } else { 0 }, 5000 * (i / 4)])
    };
    let walls = [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
    let mut shell = vec![json!([[0, 3, 2, 1]])];
    shell.extend(walls.iter().map(|wall| json!([wall])));
    json!({
        "type": "CityJSON", "version": "2.0",
        "transform": { "scale": [0.001, 0.001, 0.001], "translate": [566_000.0, 5_763_000.0, 80.0] },
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/25832" },
        "CityObjects": { "a": { "type": "Building", "geometry": [
            { "type": "Solid", "lod": "1.2", "boundaries": [shell] } ] } },
        "vertices": (0..8).map(corner).collect::<Vec<_>>(),
    })
}

#[test]
fn a_box_without_a_roof_is_302_with_its_place_and_exit_3() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("open.city.json");
    fs::write(&path, open_box().to_string()).unwrap();
    let outcome = sizeup(&["check", path.to_str().unwrap()]);
    assert_eq!(outcome.status.code(), Some(3));
    let stdout = text(&outcome.stdout);
    assert!(stdout.contains("302 SHELL_NOT_CLOSED: a (LOD 1.2)") && stdout.contains("at 56600"), "{stdout}");
    let outcome = sizeup(&["check", path.to_str().unwrap(), "--json"]);
    let json: Value = serde_json::from_slice(&outcome.stdout).unwrap();
    assert_eq!(json["n_valid"], json!(0));
}

#[test]
fn exports_go_round_through_all_formats() {
    let folder = tempfile::tempdir().unwrap();
    let mut city = open_box();
    let shell = city["CityObjects"]["a"]["geometry"][0]["boundaries"][0].as_array_mut().unwrap();
    shell.push(json!([[4, 5, 6, 7]]));
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let names = ["0.city.json", "1.gpkg", "2.city.jsonl", "3.city.json"].map(path);
    fs::write(&names[0], city.to_string()).unwrap();
    for pair in names.windows(2) {
        let outcome = sizeup(&["export", &pair[0], &pair[1], "--json"]);
        assert_eq!(outcome.status.code(), Some(0), "{}", text(&outcome.stderr));
        let summary: Value = serde_json::from_slice(&outcome.stdout).unwrap();
        assert_eq!((&summary["n_buildings"], &summary["n_heights"]), (&json!(1), &json!(1)));
    }
    let valid = sizeup(&["check", &names[3]]);
    assert_eq!(valid.status.code(), Some(0), "{}", text(&valid.stdout));
    let back =
        sizeup::output::read::FoundBuildings::read(Path::new(&names[3]), &sizeup::output::read::ReadOptions::default())
            .unwrap();
    let record = &back.to_records()[0];
    assert!((record.height_m.unwrap() - 5.0).abs() < 1e-9 && (record.ground_z_m.unwrap() - 80.0).abs() < 1e-9);
    let refused = sizeup(&["export", &names[0], &path("4.ply")]);
    assert_eq!(refused.status.code(), Some(2));
}

#[test]
fn a_network_is_described_without_running_it() {
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/onnx/depth_of_brightness.onnx");
    let outcome = sizeup(&["model", "inspect", model]);
    assert_eq!(outcome.status.code(), Some(0), "{}", text(&outcome.stderr));
    let told = text(&outcome.stdout);
    assert!(told.contains("\ninput   image ? × 3 × ? × ?\n") && told.contains("fits    da3-mono"), "{told}");
    let cubic = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/onnx/cubic_resize.onnx");
    assert_eq!(sizeup(&["model", "inspect", "--engine", "rten", cubic]).status.code(), Some(3));
}

/// A calibrated project as the OPF specification 1.0 lays it out.
pub fn opf(folder: &Path) {
    let item = |kind: &str, file: &str, format: &str| {
        json!({ "id": kind, "type": kind, "sources": [],
                "resources": [{ "uri": file, "format": format!("application/opf-{format}+json") }] })
    };
    let project = json!({ "format": "application/opf-project+json", "version": "1.0", "items": [
        item("camera_list", "list.json", "camera-list"),
        item("input_cameras", "input.json", "input-cameras"),
        item("scene_reference_frame", "frame.json", "scene-reference-frame"),
        item("calibration", "calibrated.json", "calibrated-cameras"),
    ]});
    let list = json!({ "cameras": [
        { "id": 7, "uri": "file:///c:/data/DJI_1.jpg" }, { "id": 8, "uri": "DJI_2.jpg" }] });
    let input = json!({ "captures": [], "sensors": [
        { "id": 1, "image_size_px": [6000, 4000] }, { "id": 2, "image_size_px": [1280, 960] }] });
    let frame = json!({ "crs": { "definition": "EPSG:25832" }, "base_to_canonical": {
        "shift": [-566_000.0, -5_763_000.0, -80.0], "scale": [1.0, 1.0, 1.0], "swap_xy": false } });
    let calibrated = json!({
        "sensors": [
            { "id": 1, "internals": { "type": "perspective", "principal_point_px": [3001.23, 2011.24],
              "focal_length_px": 5312.353, "radial_distortion": [-0.0144, 0.0123, -2e-5],
              "tangential_distortion": [0.0012, 0.0004] } },
            { "id": 2, "internals": { "type": "fisheye", "principal_point_px": [634.0, 481.0], "affine": [1000.0, 0.0, 0.0, 1000.0],
              "polynomial": [0.0, 1.0], "is_p0_zero": true, "is_symmetric_affine": true } },
        ],
        "cameras": [
            { "id": 7, "sensor_id": 1, "position": [10.0, 20.0, 100.0], "orientation_deg": [40.8934, -20.7048, -22.2077] },
            { "id": 8, "sensor_id": 2, "position": [10.0, 20.0, 100.0], "orientation_deg": [0.0, 0.0, 0.0] },
        ],
    });
    let files = [("project.opf", project), ("list.json", list), ("input.json", input), ("frame.json", frame)];
    for (name, value) in files.into_iter().chain([("calibrated.json", calibrated)]) {
        fs::write(folder.join(name), value.to_string()).unwrap();
    }
}

#[test]
fn an_opf_project_is_read_as_its_specification_says() {
    let folder = tempfile::tempdir().unwrap();
    opf(folder.path());
    let crs = sizeup::crs::Crs::parse("EPSG:25832").unwrap();
    let config = sizeup::survey::SurveyConfig::at(folder.path());
    let survey = sizeup::survey::read(&config, &crs).unwrap();
    assert_eq!((survey.views.len(), survey.issues.len()), (2, 0), "{:?}", survey.issues);
    let fisheye = &survey.views[1].camera;
    // 1000 px at 90° off the axis, equidistant.
    assert!((fisheye.fx_px - 1000.0 * std::f64::consts::FRAC_2_PI).abs() < 1e-9, "{fisheye:?}");
    let view = &survey.views[0];
    assert_eq!((view.id.0.as_str(), view.camera.width_px), ("DJI_1.jpg", 6000));
    let expected = glam::DVec3::new(566_010.0, 5_763_020.0, 180.0);
    assert!((view.camera_from_map.centre() - expected).length() < 1e-6);
    // Golden vector: heading 30°, 45° down.
    let axis = glam::DVec3::new(0.353_553, 0.612_372, -std::f64::consts::FRAC_1_SQRT_2);
    assert!((view.axis_in_map() - axis).length() < 1e-5, "{}", view.axis_in_map());
}

#[test]
fn a_run_stops_on_wrong_poses_unless_they_are_accepted_knowingly() {
    let folder = tempfile::tempdir().unwrap();
    table(&folder.path().join("poses.csv"), 10, 10.0);
    let config = folder.path().join("sizeup.toml");
    let settings = r#"
        project = { crs = "EPSG:25832" }
        survey = { path = "poses.csv" }
        footprints = { path = "absent.gpkg" }
        terrain = { constant_m = 400.0 }
        prior = { source = "files", path = "{stem}.npy", kind = "depth" }
    "#;
    fs::write(&config, settings).unwrap();
    let args = ["run", config.to_str().unwrap(), "--until", "survey"];
    let stopped = sizeup(&args);
    let stderr = text(&stopped.stderr);
    assert_eq!(stopped.status.code(), Some(3), "{stderr}");
    assert!(stderr.contains("below the ground") && stderr.contains("survey.offset"), "{stderr}");
    let result = folder.path().join("result");
    let report: Value = serde_json::from_slice(&fs::read(result.join("survey.json")).unwrap()).unwrap();
    assert_eq!(report["n_views"], json!(10));
    assert!(result.join("pictures/survey.png").is_file());
    let accepted = sizeup(&[&args[..], &["--set", "survey.accept_unsound=true"]].concat());
    assert_eq!(accepted.status.code(), Some(0), "{}", text(&accepted.stderr));
    let report: Value = serde_json::from_slice(&fs::read(result.join("survey.json")).unwrap()).unwrap();
    assert_eq!(report["accepted"], json!(true));
    let stage = fs::read_to_string(result.join("stages/survey.json")).unwrap();
    assert!(stage.contains("survey_unsound_accepted"), "the choice is recorded");
}
