//! The published schemas are those of the code.

use std::fs;
use std::path::Path;

use assert_cmd::Command;

#[test]
fn the_committed_schemas_are_what_the_code_writes() {
    let folder = tempfile::tempdir().unwrap();
    let mut sizeup = Command::new(env!("CARGO_BIN_EXE_sizeup"));
    sizeup.args(["schema", "--output"]).arg(folder.path()).assert().success().stdout("");
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas");
    let names = |folder: &Path| {
        let names = fs::read_dir(folder).map(|entries| entries.map(|e| e.unwrap().file_name()).collect::<Vec<_>>());
        let mut names = names.unwrap_or_default();
        names.sort();
        names
    };
    assert_eq!(names(&committed), names(folder.path()), "schemas/ is out of date: run `make schemas`");
    for name in names(folder.path()) {
        let is_same = fs::read(committed.join(&name)).unwrap() == fs::read(folder.path().join(&name)).unwrap();
        assert!(is_same, "schemas/{} is out of date: run `make schemas`", name.display());
    }
}

#[test]
fn a_schema_asked_for_by_name_goes_to_stdout() {
    let mut sizeup = Command::new(env!("CARGO_BIN_EXE_sizeup"));
    let output = sizeup.args(["schema", "run"]).output().unwrap();
    let schema: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(schema["title"], "RunConfig");
    assert!(schema["properties"]["footprints"].is_object() && output.stderr.is_empty());
}
