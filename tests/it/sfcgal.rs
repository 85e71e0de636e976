//! SFCGAL, the library behind `PostGIS`'s 3D functions: what it says of our solids, where somebody has one.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::skipped::skip;
use crate::tools::run;
use crate::val3dity::write_split_houses;

/// A Python with SFCGAL's own bindings.
fn sfcgal_python() -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/tools/sfcgal/bin/python");
    if !own.is_file() {
        skip("SFCGAL is not installed (make deps-test)");
        return None;
    }
    Some(own)
}

/// Asserts that SFCGAL calls every solid of a file valid, where there is one.
pub fn assert_valid_to_sfcgal(path: &Path) {
    let Some(python) = sfcgal_python() else { return };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sfcgal.py");
    let said: Value = serde_json::from_str(&run(Command::new(python).arg(script).arg(path))).unwrap();
    assert!(said["n"].as_u64().unwrap() > 0, "nothing was looked at");
    assert_eq!(said["faults"], Value::Array(Vec::new()), "of {} solids", said["n"]);
}

#[test]
fn roofs_turned_any_way_are_planar_to_the_last_digit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("parts.city.json");
    write_split_houses(&path);
    assert_valid_to_sfcgal(&path);
}
