//! The way of docs/from-your-software.md: a scene as ODM, Metashape, Pix4D and a drone leave theirs (`tools/exports.py`), begun with
//! `sizeup init` and run, ends with the scene's heights. What writes the files shares no code with what reads them.

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use sizeup::simulate::{PriorLevel, SimulateConfig, simulate};

use crate::evaluating::{number, report};
use crate::skipped::skip;
use crate::tiny_scene::{Outcome, sizeup};

/// Debian's own: GDAL's Python comes with it.
const PYTHON: &str = "/usr/bin/python3";
/// A pixel of these photos on the ground.
const MEAN_ERROR_M: f64 = 0.37;
/// Half of one: the poses are the scene's own but for the digits of each format, and the photos put the ground right under them.
const FROM_OWN_M: f64 = 0.185;

fn has_modules() -> bool {
    let imported = Command::new(PYTHON).args(["-c", "import numpy, PIL.Image, osgeo.osr"]).output();
    imported.is_ok_and(|output| output.status.success())
}

#[test]
#[ignore = "slow: make test-slow"]
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
    config.prior.level = PriorLevel::Clean;
    simulate(&config, &scene, &|_, _| {}).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/exports.py");
    let written = Command::new(PYTHON).arg(script).arg("write").args([&scene, desk.path()]).output().unwrap();
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    let own = heights(desk.path(), "scene/sizeup.toml", "result-own");
    let own_m = number(&own["all"]["error_mean_m"]);
    for program in ["odm", "metashape", "pix4d", "dji"] {
        let told = run_as_told(desk.path(), program);
        let all = &told["all"];
        assert_eq!(all["n"], 8, "{program}: every building has a height: {told}");
        let mean_m = number(&all["error_mean_m"]);
        assert!(
            mean_m < MEAN_ERROR_M && (mean_m - own_m).abs() < FROM_OWN_M,
            "{program}: {all}, {own_m} m by its own files"
        );
    }
}

/// `sizeup init` as a user types it, and the heights of what it wrote.
fn run_as_told(desk: &Path, program: &str) -> Value {
    let settings = format!("{program}.toml");
    let begun = at(desk, &["init", program, "--output", &settings]);
    assert_eq!(begun.code, 0, "{program}: {}", begun.stderr);
    assert!(begun.stderr.contains("40 with a usable pose"), "{program}: {}", begun.stderr);
    heights(desk, &settings, &format!("result-{program}"))
}

/// What `sizeup evaluate` says of a run with the scene's depth in place of minutes of matching, and without photos' say and pictures.
fn heights(desk: &Path, settings: &str, result: &str) -> Value {
    let priors = format!("prior.path={}", desk.join("scene/priors/{stem}.npy").display());
    let depth = ["prior.source=files", &priors, "prior.kind=inverse_depth"];
    let short = ["refinement.enabled=false", "output.pictures=false", "output.report.page=false"];
    let mut args = vec!["run", settings, "--output", result];
    args.extend(depth.iter().chain(&short).flat_map(|setting| ["--set", *setting]));
    let run = at(desk, &args);
    assert_eq!(run.code, 0, "{settings}: {}", run.stderr);
    report(&desk.join(result).join("city.city.json"), &desk.join("scene/truth.geojson"), &[])
}

fn at(desk: &Path, args: &[&str]) -> Outcome {
    sizeup().current_dir(desk).args(args).output().unwrap().into()
}
