//! The examples, run as a reader would run them.

use std::path::Path;
use std::process::{Command, Output};

use crate::tiny_scene::Scene;

/// An example's program: cargo builds it beside the tests.
fn example(name: &str, args: &[&str]) -> Output {
    let built = Path::new(env!("CARGO_BIN_EXE_sizeup")).parent().unwrap().join("examples").join(name);
    let output = Command::new(&built).args(args).output().unwrap_or_else(|e| panic!("{}: {e}", built.display()));
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn lines(output: &Output) -> Vec<String> {
    String::from_utf8_lossy(&output.stdout).lines().map(str::to_owned).collect()
}

#[test]
fn heights_come_out_of_memory_within_half_a_metre() {
    // It holds its own results against the truth.
    assert_eq!(lines(&example("heights_in_memory", &[])).len(), 2);
}

#[test]
fn prisms_of_ones_own_become_valid_cityjson() {
    assert!(lines(&example("write_cityjson", &[]))[0].ends_with("2 solids, 0 faults"));
}

#[test]
fn photos_show_where_they_look() {
    let scene = Scene::new();
    let config = scene.path("sizeup.toml").to_string_lossy().into_owned();
    let lines = lines(&example("photo_footprints", &[&config, "0"]));
    assert_eq!(lines.len(), crate::tiny_scene::N_VIEWS);
    assert!(lines.iter().all(|line| line.contains("° off nadir\tPOLYGON((")), "{lines:?}");
}

#[test]
fn a_run_needs_no_configuration_file() {
    let lines = lines(&example("run_configured_in_code", &[]));
    assert_eq!(lines.len(), 6, "{lines:?}");
    assert!(lines.iter().all(|line| line.ends_with("measured") || line.ends_with("doubtful")), "{lines:?}");
}

#[test]
fn the_paper_stands_beside_ours() {
    let lines = lines(&example("paper_beside_robust", &[]));
    assert!(lines[0].starts_with("Robust: mean error") && lines[1].starts_with("Paper: mean error"), "{lines:?}");
}
