//! A real QGIS opens our GeoPackage; skipped where none is installed.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};
use sizeup::camera::Distortion;
use sizeup::crs::Crs;
use sizeup::geodata::{GridPlace, write_geotiff};
use sizeup::output::geopackage::{self, ProjectGround};
use sizeup::raster::Raster;
use sizeup::simulate::simulate;

use crate::footprint_masks::{GROUND, INSTANCES, crs, find, source_of, with_masks};
use crate::outputs::town;
use crate::skipped::skip;
use crate::tiny_scene;
use crate::tools::{picture, program};

/// Debian's own interpreter: QGIS's bindings belong to it.
const PYTHON: &str = "/usr/bin/python3";

fn has_qgis() -> bool {
    let found =
        Command::new(PYTHON).args(["-c", "import qgis.core, qgis._3d"]).output().is_ok_and(|o| o.status.success());
    if !found {
        skip("QGIS is not installed (apt-get install qgis python3-qgis)");
    }
    found
}

fn script(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/qgis").join(name)
}

fn run(name: &str, arguments: &[&Path]) -> String {
    let output = Command::new(PYTHON).arg(script(name)).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn qgis_opens_the_geopackage_styled_in_place_and_standing_on_the_ground() {
    if !has_qgis() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.gpkg");
    geopackage::write(&path, &town().model()).unwrap();
    let picture = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pictures/qgis.png");
    std::fs::create_dir_all(picture.parent().unwrap()).unwrap();
    let report: Value = serde_json::from_str(&run("check.py", &[&path, &picture])).unwrap();

    let buildings = &report["buildings"];
    assert_eq!(buildings["crs"], "EPSG:7415");
    assert_eq!(buildings["features"], 6);
    assert_eq!(buildings["index"], true);
    assert_eq!(buildings["renderer"], "RuleRenderer");
    let legend = buildings["legend"].as_array().unwrap();
    assert_eq!(
        (legend.len(), &legend[0], &legend[10]),
        (14, &Value::from("below 3 m"), &Value::from("height not known"))
    );
    let over = ["doubtful: look at it", "reviewed by a person", "height from a fallback"];
    assert_eq!(legend[11..], over.map(Value::from));
    assert_eq!((&buildings["labels"], &report["cameras"]["labels"]), (&true.into(), &false.into()));
    let extrusion = serde_json::json!({
        "height": ["\"base_z_m\""],
        "extrusionHeight": ["\"roof_z_m\" - \"base_z_m\""],
        "clamping": ["absolute"],
    });
    assert_eq!(buildings["extrusion"], extrusion);
    assert_eq!(report["cameras"]["legend"][0], "oblique photo");
    // A GeoPackage dragged into a project shows the town, and cameras once one is near.
    assert_eq!((&report["cameras"]["shown_from"], &buildings["shown_from"]), (&1000.0.into(), &Value::Null));
    assert_eq!(report["qa_issues"]["features"], 2);
    assert_eq!(report["cameras"]["symbols"], serde_json::json!(["arrow", "circle", "triangle"]));
    // The classes of 6.25, 15, and 61 m are on the picture; the second is doubtful, and hatched over its colour.
    let colours: Vec<&str> = report["colours"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    for colour in ["#3e4989", "#1f9e89", "#b5de2b", "#d55e00"] {
        assert!(colours.contains(&colour), "{colour} of {colours:?}");
    }
}

#[test]
fn qgis_opens_the_project_styled_and_in_place() {
    if !has_qgis() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (gpkg, project) = (folder.path().join("town & co.gpkg"), folder.path().join("town.qgs"));
    let town = town();
    geopackage::write(&gpkg, &town.model()).unwrap();
    let dtm = folder.path().join("dtm.tif");
    write_slope(&dtm);
    let dtm_crs = Crs::parse("EPSG:28992").unwrap();
    let ground = ProjectGround::Model { path: Path::new("dtm.tif"), crs: Some(&dtm_crs), unit_m: 0.5, offset_m: 0.25 };
    geopackage::write_project(&project, "town & co.gpkg", &town.model(), ground).unwrap();
    // Paths are relative: the folder may be moved. The packed project is the same.
    let moved = tempfile::tempdir().unwrap();
    let packed = project.with_extension("qgz");
    for path in [&gpkg, &project, &packed, &dtm] {
        std::fs::copy(path, moved.path().join(path.file_name().unwrap())).unwrap();
    }
    drop(folder);
    let report = run("project.py", &[&moved.path().join("town.qgs"), &picture("qgis-project.png")]);
    let from_packed = run("project.py", &[&moved.path().join("town.qgz"), &picture("qgis-project-packed.png")]);
    assert_eq!(report, from_packed);
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!((&report["read"], &report["crs"]), (&true.into(), &"EPSG:7415".into()));
    assert_eq!(report["drawn"], serde_json::json!(["qa_issues", "buildings", "buildings_lod2", "terrain"]));
    assert_eq!(report["groups"], serde_json::json!(["survey"]));
    let terrain = &report["layers"]["terrain"];
    assert_eq!((&terrain["renderer"], &terrain["crs"]), (&"hillshade".into(), &"EPSG:28992".into()));
    // Heights of −9999 and the like are none, whatever the file's own tag names.
    let is_void = |z: f64| {
        terrain["voids"]
            .as_array()
            .unwrap()
            .iter()
            .any(|range| range[0].as_f64().unwrap() <= z && z <= range[1].as_f64().unwrap())
    };
    assert!([-9999.0, -32767.0, -3.4e38, 1e20].into_iter().all(is_void) && !is_void(0.0) && !is_void(8000.0));
    // Python reaches the terrain's scale from QGIS 3.26 on only.
    let text = std::fs::read_to_string(moved.path().join("town.qgs")).unwrap();
    assert!(text.contains("<TerrainProvider offset=\"0.25\" scale=\"0.5\""));
    assert_eq!(
        report["layouts"]["Map, A4"]["items"],
        serde_json::json!(["legend", "map", "north", "place", "scale", "sources", "title"])
    );
    let titles = &report["layouts"]["Map, A4"]["titles"];
    assert_eq!(
        (&titles["buildings"], &titles["qa_issues"]),
        (&"Height above ground".into(), &"To be looked at".into())
    );
    let sources = report["layouts"]["Map, A4"]["sources"].as_str().unwrap();
    assert!(sources.contains("Footprints: town.gpkg") && sources.contains("NAP"), "{sources}");
    // Rotterdam, and the day.
    let place = report["layouts"]["Map, A4"]["place"].as_str().unwrap();
    assert!(
        place.starts_with("Place: 51.9") && place.contains("° N, 4.4") && place.ends_with("Date: 2025-06-01"),
        "{place}"
    );
    // A font that is not there makes QGIS warn; a view that looks straight down shows no walls.
    assert!(!text.contains("fontFamily"));
    let camera = text.split("</qgis3d>").nth(1).unwrap();
    assert!(
        camera.trim_start().starts_with("<camera x=\"0\" y=\"0\" elev=") && camera.contains("pitch=\"50\""),
        "{camera}"
    );
    // Solids with roofs are for the 3D view: the map does not draw them.
    for (layer, features, n_legend) in [
        ("buildings", 6, 14),
        ("buildings_lod1", 4, 14),
        ("buildings_lod13", 4, 14),
        ("buildings_lod2", 4, 0),
        ("tiles", 1, 2),
        ("cameras", 2, 3),
        ("qa_issues", 2, 3),
    ] {
        let found = &report["layers"][layer];
        assert_eq!((&found["valid"], &found["crs"]), (&true.into(), &"EPSG:7415".into()), "{layer}");
        assert_eq!(found["features"], features, "{layer}");
        assert_eq!(found["legend"].as_array().unwrap().len(), n_legend, "{layer}");
    }
    assert_eq!(report["layers"]["buildings_lod2"]["extrusion"]["clamping"], serde_json::json!(["absolute"]));
    assert!(report["layers"]["buildings"]["extrusion"].is_null(), "solids would stand in blocks of their own");
    let image = image::open(picture("qgis-project.png")).unwrap().to_rgb8();
    for colour in [[0x3e, 0x49, 0x89], [0x1f, 0x9e, 0x89], [0xb5, 0xde, 0x2b]] {
        assert!(image.pixels().any(|p| p.0 == colour), "{colour:?}");
    }
}

#[test]
fn heights_are_written_beside_the_marks_of_what_is_doubtful() {
    if !has_qgis() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut town = town();
    // A mark in the middle of each building, as doubtful ones have it.
    let middle = |record: &sizeup::output::BuildingRecord| record.footprint.as_ref().and_then(geo::Centroid::centroid);
    let marks = town.records.iter().filter_map(|record| Some((record.id.clone(), middle(record)?)));
    let mark = |(id, at): (String, geo_types::Point<f64>)| {
        let subject = sizeup::issue::Subject::Building(id);
        let issue = sizeup::issue::Issue::new(sizeup::issue::Severity::Warning, "building_doubtful", subject, "look");
        issue.at(at.x(), at.y())
    };
    town.issues = marks.map(mark).collect();
    let (gpkg, project) = (folder.path().join("town.gpkg"), folder.path().join("town.qgs"));
    geopackage::write(&gpkg, &town.model()).unwrap();
    geopackage::write_project(&project, "town.gpkg", &town.model(), ProjectGround::LowestWall).unwrap();
    let report: Value = serde_json::from_str(&run("project.py", &[&project, &picture("qgis-marks.png")])).unwrap();
    assert!(report["labels"].as_u64().unwrap() >= 2, "{}", report["labels"]);
    assert_eq!(report["labels_on_marks"], 0);
}

/// A terrain model under the town: 12 m, rising a little to the east.
fn write_slope(path: &Path) {
    let heights = (0..30 * 30).map(|i| 12.0 + 0.05 * (i % 30) as f32).collect();
    let crs = Crs::parse("EPSG:28992").unwrap();
    let place = GridPlace { corner_m: (92_980.0, 436_080.0), cell_m: (4.0, 4.0), crs: &crs, nodata: -9999.0 };
    write_geotiff(path, &Raster::from_vec(30, 30, heights).unwrap(), &place).unwrap();
}

#[test]
fn qgis_shows_the_title_of_every_field_of_every_layer() {
    if !has_qgis() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let town = town();
    geopackage::write(&path("town.gpkg"), &town.model()).unwrap();
    geopackage::write_project(&path("town.qgs"), "town.gpkg", &town.model(), ProjectGround::LowestWall).unwrap();
    // A file of a run without a cadastre has no layer of what vanished.
    let (views, _) = with_masks(folder.path());
    let found = find(&source_of(folder.path(), INSTANCES), &views, &GROUND).unwrap();
    sizeup::footprint::write(&path("footprints.gpkg"), &found, &views, &crs()).unwrap();
    let files = ["town.gpkg", "town.qgs", "town.qgz", "footprints.gpkg"].map(path);
    let report: Value = serde_json::from_str(&run("aliases.py", &files.each_ref().map(PathBuf::as_path))).unwrap();

    let of_town = &report[0]["layers"];
    assert_eq!((&report[1]["layers"], &report[2]["layers"]), (of_town, of_town), "the project names them alike");
    for (file, layers) in [(0, 7), (3, 2)] {
        assert_eq!(report[file]["layers"], report[file]["titles"], "those of gpkg_data_columns, all of them");
        assert_eq!(report[file]["layers"].as_object().unwrap().len(), layers);
    }
    let fields = report.as_array().unwrap().iter().flat_map(|file| file["layers"].as_object().unwrap());
    for (layer, aliases) in fields {
        for (field, alias) in aliases.as_object().unwrap() {
            assert!(alias.as_str().is_some_and(|alias| !alias.is_empty()), "{layer}.{field}");
        }
    }
    let buildings = &of_town["buildings"];
    assert_eq!((&buildings["fid"], &buildings["roof_z_m"]), (&"Row".into(), &"Roof level (m)".into()));
    assert_eq!((&buildings["street"], &buildings["input_height_m"]), (&"street".into(), &"height_m (input)".into()));
}

#[test]
fn qgis_takes_a_compound_crs_without_a_code_and_a_level_for_the_ground() {
    if !has_qgis() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (gpkg, project) = (folder.path().join("town.gpkg"), folder.path().join("town.qgs"));
    let town = crate::outputs::Town { crs: Crs::parse("EPSG:25832+7837").unwrap(), ..town() };
    geopackage::write(&gpkg, &town.model()).unwrap();
    geopackage::write_project(&project, "town.gpkg", &town.model(), ProjectGround::Level(11.4)).unwrap();
    let report: Value = serde_json::from_str(&run("project.py", &[&project, &picture("qgis-compound.png")])).unwrap();
    assert_eq!(
        (&report["read"], &report["crs"]),
        (&true.into(), &"EPSG:25832".into()),
        "3.22 takes the horizontal part"
    );
    let text = std::fs::read_to_string(&project).unwrap();
    assert!(text.contains("COMPD_CS") && text.contains("DHHN2016"), "and newer ones find the whole");
    assert!(text.contains("elevation-offset=\"11.4\""));
}

#[test]
fn qgis_draws_footprints_and_solids_in_3d() {
    if !has_qgis() {
        return;
    }
    let Some(display) = program("xvfb-run", "deps-qgis") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.gpkg");
    let town = town();
    geopackage::write(&path, &town.model()).unwrap();
    for (layer, name) in [("buildings", "qgis-3d.png"), ("buildings_lod2", "qgis-3d-lod2.png")] {
        stands_as_it_is(&display, &path, layer, &picture(name));
    }
}

fn stands_as_it_is(display: &Path, path: &Path, layer: &str, picture: &Path) {
    let output = Command::new(display)
        .args(["-a", "-s", "-screen 0 1280x1024x24", PYTHON])
        .arg(script("scene.py"))
        .arg(path)
        .arg(layer)
        .arg(picture)
        .output()
        .unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout);
    let report: Value = serde_json::from_str(stdout.trim())
        .unwrap_or_else(|e| panic!("{e}: {stdout}\n{}", String::from_utf8_lossy(&output.stderr)));
    assert_eq!(report["result"], 0);
    // Flat roofs of 6.25 and 15 m have the colours of the legend.
    let colours: Vec<[i32; 3]> = serde_json::from_value(report["colours"].clone()).unwrap();
    for class in [[0x3e, 0x49, 0x89], [0x1f, 0x9e, 0x89]] {
        let is_class = |colour: &[i32; 3]| colour.iter().zip(class).all(|(a, b): (&i32, i32)| (a - b).abs() <= 6);
        assert!(colours.iter().any(is_class), "{class:?} of {colours:?}");
    }
    // Seen from the south, from afar: the rows with the tower behind them, then the courtyard, all on one base.
    let groups = report["groups"].as_array().unwrap();
    let [tower, courtyard] = [0, 1].map(|i| {
        let side = |name: &str| groups[i][name].as_f64().unwrap();
        (side("width"), side("height"), side("bottom"))
    });
    assert_eq!(groups.len(), 2, "{report}");
    // 61.6 m and 15.6 m high, 20 m and 30 m wide; the tower stands 46 m farther back, seen from 10 times that.
    for (found, expected) in [
        (tower.1 / courtyard.1, 61.6 / 15.6),
        (courtyard.0 / courtyard.1, 30.0 / 15.6),
        (courtyard.0 / tower.0, 30.0 / 20.0),
    ] {
        assert!((found / expected - 1.0).abs() < 0.12, "{found} for {expected}: {report}");
    }
    assert!((tower.2 - courtyard.2).abs() < 0.05 * tower.1, "they stand on one level: {report}");
}

#[test]
fn the_styles_in_the_repository_are_those_of_the_script() {
    if !has_qgis() {
        return;
    }
    let version =
        Command::new(PYTHON).args(["-c", "from qgis.core import Qgis; print(Qgis.QGIS_VERSION_INT // 100)"]).output();
    if String::from_utf8_lossy(&version.unwrap().stdout).trim() != "322" {
        skip("the styles were exported from QGIS 3.22, and other versions write other attributes");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let made_in = ["city", "footprints", "changes"].map(|name| folder.path().join(name));
    for made in &made_in {
        std::fs::create_dir(made).unwrap();
    }
    run("styles.py", &made_in.each_ref().map(PathBuf::as_path));
    for (made_in, kept_in) in made_in.iter().zip([
        "crates/results/src/output/geopackage/styles",
        "crates/footprints/src/styles",
        "crates/results/src/changes/styles",
    ]) {
        let kept_in = Path::new(env!("CARGO_MANIFEST_DIR")).join(kept_in);
        let names = |folder: &Path| -> Vec<std::ffi::OsString> {
            let mut names: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect();
            names.sort();
            names
        };
        assert_eq!(names(made_in), names(&kept_in));
        for name in names(made_in) {
            assert!(
                std::fs::read(made_in.join(&name)).unwrap() == std::fs::read(kept_in.join(&name)).unwrap(),
                "{}: run `tests/qgis/styles.py`",
                name.display()
            );
        }
    }
}

/// Places of the ideal image and where lenses bend them to, for the plugin to do the same.
fn bent_places() -> Value {
    let lenses = [
        Distortion::None,
        Distortion::Brown { k1: -0.0445, k2: 0.0188, k3: -0.002, p1: 5.96e-4, p2: 4.9e-5 },
        Distortion::BrownAffine { k1: -0.04, k2: 0.02, k3: -0.004, k4: 1e-3, p1: 6e-4, p2: 5e-5, skew: 3e-4 },
        Distortion::Rational { k1: 0.3, k2: 0.05, k3: 0.001, k4: 0.32, k5: 0.07, k6: 0.002, p1: 1e-4, p2: -2e-4 },
        Distortion::Fisheye { k1: -0.02, k2: 0.004, k3: -0.001, k4: 2e-4 },
        Distortion::FisheyeSeries { k1: 0.0097, k2: -0.065, k3: 0.01 },
        // Folds back at 1.05.
        Distortion::Brown { k1: -0.3, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 },
    ];
    let places = [[0.0, 0.0], [0.31, -0.42], [-0.6, 0.2], [0.0, 0.71], [1.4, 0.3]];
    let of = |lens: &Distortion, ideal: [f64; 2]| {
        let bent = lens.distort(ideal.into()).map(|at| [at.x, at.y]);
        json!({ "lens": lens, "ideal": ideal, "bent": bent })
    };
    lenses.iter().flat_map(|lens| places.map(|ideal| of(lens, ideal))).collect()
}

#[test]
fn the_plugin_runs_the_program_tells_mistakes_and_keeps_reviews() {
    if !has_qgis() {
        return;
    }
    let folder = tempfile::Builder::new().prefix("Szene für QGIS ").tempdir().unwrap();
    let mut config = tiny_scene::config();
    config.images.enabled = true;
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    std::fs::write(folder.path().join("cameras.json"), bent_places().to_string()).unwrap();
    let output = Command::new(PYTHON)
        .args(["-W", "ignore"])
        .arg(script("plugin.py"))
        .args([folder.path(), Path::new(env!("CARGO_BIN_EXE_sizeup")), picture("qgis-review.png").parent().unwrap()])
        .output()
        .unwrap();
    let said = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).join("\n");
    assert!(output.status.success(), "{said}");
}

#[test]
fn the_plugin_is_packed_the_same_each_time_in_the_program_s_version() {
    let packed: Vec<Vec<u8>> = (0..2)
        .map(|_| {
            let folder = tempfile::tempdir().unwrap();
            let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/qgis_plugin.sh");
            let said = crate::tools::run(Command::new(script).arg(folder.path()));
            let name = format!("sizeup-qgis-{}.zip", env!("CARGO_PKG_VERSION"));
            assert!(said.trim().ends_with(&name), "{said}");
            std::fs::read(folder.path().join(name)).unwrap()
        })
        .collect();
    assert!(packed[0] == packed[1]);
    let archive = zip::ZipArchive::new(std::io::Cursor::new(&packed[0])).unwrap();
    let names: Vec<String> = archive.file_names().map(|name| name.unwrap().into_owned()).collect();
    for name in ["metadata.txt", "__init__.py", "icon.svg", "LICENSE", "review/dock.py"] {
        assert!(names.contains(&format!("sizeup/{name}")), "{names:?}");
    }
    assert!(names.iter().all(|name| name.starts_with("sizeup/") && !name.contains("__pycache__")), "{names:?}");
}
