//! The command `sizeup evaluate`, and what it reports.

use std::path::Path;

use serde_json::Value;

use crate::tiny_scene::{Outcome, sizeup};

/// `sizeup evaluate` and more arguments.
pub fn evaluate(result: &Path, truth: &Path, more: &[&str]) -> Outcome {
    sizeup().arg("evaluate").args([result, truth]).args(more).output().unwrap().into()
}

/// Its report as JSON.
pub fn report(result: &Path, truth: &Path, more: &[&str]) -> Value {
    let outcome = evaluate(result, truth, &[more, &["--json"]].concat());
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    serde_json::from_str(&outcome.stdout).unwrap()
}

/// A figure of a report.
pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}
