//! The way of docs/from-your-software.md: a scene as ODM, Metashape, Pix4D and a drone leave theirs (`tools/exports.py`), begun with
//! `sizeup init` and run, ends with the scene's heights. What writes the files shares no code with what reads them.

use std::path::Path;
use std::process::Command;

use sizeup::simulate::{SimulateConfig, simulate};

use crate::evaluating::{number, report};
use crate::skipped::skip;
use crate::tiny_scene::{Outcome, sizeup};

/// Debian's own: GDAL's Python comes with it.
const PYTHON: &str = "/usr/bin/python3";
/// A pixel of these photos is 0.37 m on the ground; the scene's own files give 0.2 m.
const MEAN_ERROR_M: f64 = 0.4;

fn has_modules() -> bool {
    let imported = Command::new(PYTHON).args(["-c", "import numpy, PIL.Image, osgeo.osr"]).output();
    imported.is_ok_and(|output| output.status.success())
}

#[test]
fn the_exports_of_each_program_end_in_the_heights_of_the_scene() {
    if !has_modules() {
        return skip("GDAL's Python, numpy or Pillow is not installed (make deps-test)");
    }
    let desk = tempfile::tempdir().unwrap();
    let scene = desk.path().join("scene");
    let mut config = SimulateConfig::preset("village").unwrap();
    config.town.n_buildings = 8;
    config.flight.n_views = Some(40);
    config.images.enabled = true;
    simulate(&config, &scene, &|_, _| {}).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/exports.py");
    let written = Command::new(PYTHON).arg(script).arg("write").args([&scene, desk.path()]).output().unwrap();
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    for program in ["odm", "metashape", "pix4d", "dji"] {
        let told = run_as_told(desk.path(), program);
        let all = &told["all"];
        assert_eq!(all["n"], 8, "{program}: every building has a height: {told}");
        assert!(number(&all["error_mean_m"]) < MEAN_ERROR_M, "{program}: {all}");
    }
}

/// `sizeup init` and `sizeup run` as a user types them, with the scene's depth in place of minutes of matching, and without photos' say and
/// pictures; what `sizeup evaluate` says of the result.
fn run_as_told(desk: &Path, program: &str) -> serde_json::Value {
    let at_desk = |args: &[&str]| -> Outcome { sizeup().current_dir(desk).args(args).output().unwrap().into() };
    let (settings, result) = (format!("{program}.toml"), format!("result-{program}"));
    let begun = at_desk(&["init", program, "--output", &settings]);
    assert_eq!(begun.code, 0, "{program}: {}", begun.stderr);
    assert!(begun.stderr.contains("40 with a usable pose"), "{program}: {}", begun.stderr);
    let depth = ["prior.source=files", "prior.path=scene/priors/{stem}.npy", "prior.kind=inverse_depth"];
    let short = ["refinement.enabled=false", "output.pictures=false", "output.report.page=false"];
    let mut args = vec!["run", &settings, "--output", &result];
    args.extend(depth.iter().chain(&short).flat_map(|setting| ["--set", setting]));
    let run = at_desk(&args);
    assert_eq!(run.code, 0, "{program}: {}", run.stderr);
    report(&desk.join(result).join("city.city.json"), &desk.join("scene/truth.geojson"), &[])
}
