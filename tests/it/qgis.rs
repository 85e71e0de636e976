//! A real QGIS opens our GeoPackage; skipped where none is installed.

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use sizeup::output::geopackage::{self, GeoPackageConfig};

use crate::outputs::town;

/// Debian's own interpreter: QGIS's bindings belong to it.
const PYTHON: &str = "/usr/bin/python3";

fn has_qgis() -> bool {
    let found =
        Command::new(PYTHON).args(["-c", "import qgis.core, qgis._3d"]).output().is_ok_and(|o| o.status.success());
    if !found {
        eprintln!("skipped: QGIS is not installed (apt-get install qgis python3-qgis)");
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
    geopackage::write(&path, &town().model(), &GeoPackageConfig::default()).unwrap();
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
        (legend.len(), &legend[0], &legend[9]),
        (10, &Value::from("below 3 m"), &Value::from("height not known"))
    );
    let extrusion = serde_json::json!({
        "height": ["\"base_z_m\""],
        "extrusionHeight": ["\"roof_z_m\" - \"base_z_m\""],
        "clamping": ["absolute"],
    });
    assert_eq!(buildings["extrusion"], extrusion);
    assert_eq!(report["cameras"]["legend"][0], "oblique photo");
    assert_eq!(report["qa_issues"]["features"], 2);
    // The classes of 6.25, 15, and 61 m are on the picture.
    let colours: Vec<&str> = report["colours"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    for colour in ["#3e4989", "#1f9e89", "#fde725"] {
        assert!(colours.contains(&colour), "{colour} of {colours:?}");
    }
}

#[test]
fn the_styles_in_the_repository_are_those_of_the_script() {
    if !has_qgis() {
        return;
    }
    let version =
        Command::new(PYTHON).args(["-c", "from qgis.core import Qgis; print(Qgis.QGIS_VERSION_INT // 100)"]).output();
    if String::from_utf8_lossy(&version.unwrap().stdout).trim() != "322" {
        eprintln!("skipped: the styles were exported from QGIS 3.22, and other versions write other attributes");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    run("styles.py", &[folder.path()]);
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/output/geopackage/styles");
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        let made = entry.unwrap().path();
        let name = made.file_name().unwrap();
        assert!(
            std::fs::read(&made).unwrap() == std::fs::read(kept.join(name)).unwrap(),
            "{}: run `tests/qgis/styles.py`",
            name.display()
        );
    }
}
