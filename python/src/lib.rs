//! The module `sizeup._native`: what Python cannot do by itself. What people import is Python (`python/sizeup`), which turns
//! their objects into plain values and these answers into objects.
//!
//! Answers are JSON, once per call and not per building; arrays come as bytes. The interpreter runs on while Rust computes.

mod arrays;
mod failure;
mod results;

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;
use sizeup::cli::{Call, answer_call};

use failure::{Failure, told};

/// The program and the method.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::arrays::estimate_heights;
    #[pymodule_export]
    use super::results::{read_city, read_solids};
    #[pymodule_export]
    use super::{answer, toml_of_json, version};
}

/// Answers a command line as the program does; the number is the exit code. `program` starts it once more, as runs in tiles
/// do; `code` is the file of this module.
#[pyfunction]
fn answer(py: Python<'_>, program: PathBuf, code: PathBuf, arguments: Vec<OsString>) -> u8 {
    py.detach(|| answer_call(Call { program, code, arguments }))
}

/// A configuration as the text of a file.
#[pyfunction]
fn toml_of_json(py: Python<'_>, json: &str) -> PyResult<String> {
    let no_table = |e: &dyn std::fmt::Display| {
        Failure::of_settings(
            format!("the configuration is no table of settings: {e}"),
            "keys are text, values text, numbers, true or false, lists and tables",
        )
    };
    let table: toml::Table = serde_json::from_str(json).map_err(|e| told(py, no_table(&e)))?;
    toml::to_string(&table).map_err(|e| told(py, no_table(&e)))
}

/// The version of the program.
#[pyfunction]
fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}
