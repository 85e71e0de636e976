//! Independent tools that tests compare with: where `tools/deps.sh` puts them, and what it takes to run them.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::skipped::skip;

/// The folder of what is not a package of the distribution.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("target/tools")
}

/// `None`, and a line that says so.
fn skipped(what: &str, target: &str) -> Option<PathBuf> {
    skip(&format!("{what} is not installed (make {target})"));
    None
}

/// A program on the path.
pub fn program(name: &str, target: &str) -> Option<PathBuf> {
    on_path(name).or_else(|| skipped(name, target))
}

fn on_path(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file())
}

/// A browser without windows, or one with: what `tools/deps.sh web` takes for one.
pub fn chromium() -> Option<PathBuf> {
    let names = ["chromium-headless-shell", "chromium"];
    names.into_iter().find_map(on_path).or_else(|| skipped("chromium", "deps-test"))
}

/// cjio of the Python package index.
pub fn cjio() -> Option<PathBuf> {
    let own = folder().join("cjio/bin/cjio");
    if own.is_file() { Some(own) } else { skipped("cjio", "deps-test") }
}

/// A Python with FlatCityBuf's own reader, which shares no code with its writer.
pub fn flatcitybuf_python() -> Option<PathBuf> {
    let own = folder().join("flatcitybuf/bin/python");
    if own.is_file() { Some(own) } else { skipped("flatcitybuf", "deps-test") }
}

/// A package of npm, as its folder; `node` runs it.
pub fn npm(package: &str) -> Option<PathBuf> {
    let found = folder().join("web/node_modules").join(package);
    program("node", "deps-test")?;
    if found.is_dir() { Some(found) } else { skipped(package, "deps-test") }
}

/// Where npm's packages are.
pub fn node_modules() -> PathBuf {
    folder().join("web/node_modules")
}

/// Runs a command that has to succeed; its standard output.
pub fn run(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{command:?}\n{stdout}\n{}", String::from_utf8_lossy(&output.stderr));
    stdout
}

/// Where tests leave pictures to be looked at.
pub fn picture(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pictures");
    std::fs::create_dir_all(&folder).unwrap();
    folder.join(name)
}
