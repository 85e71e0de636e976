//! Checks of a file's form by cjval: the official schemas, references between objects, indices, semantics.
//!
//! Our own extension is known; of others the types of attributes are not checked, and that is said.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use cjval::CJValidator;
use serde::Serialize;
use serde_json::Value;

use super::super::OutputError;
use super::super::cityjson::extension_schema;
use super::super::error::MalformedFile;
use crate::files::FileError;

/// Where our extension is declared, its name stands in quotes.
const EXTENSION_IS_DECLARED: &str = "\"Sizeup\"";
/// cjval's name of the check of extensions.
const EXTENSIONS: &str = "extensions";

/// One thing that is wrong with the form.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SchemaFault {
    /// cjval's name of the check: `schema`, `wrong_vertex_index`, ….
    pub check: String,
    /// Line of a sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<usize>,
    /// What and where, in cjval's words.
    pub message: String,
}

/// The outcome for a file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct SchemaCheck {
    /// What makes the file invalid.
    pub errors: Vec<SchemaFault>,
    /// What does not, and is worth knowing.
    pub warnings: Vec<SchemaFault>,
    /// Features of a sequence.
    pub n_features: usize,
    /// Of them, those that were looked at.
    pub n_features_checked: usize,
}

/// Checks a file, or every line of a sequence (`….jsonl`).
///
/// # Errors
/// [`OutputError::File`] if it cannot be read, [`OutputError::Malformed`] if it is no UTF-8.
pub fn check(path: &Path) -> Result<SchemaCheck, OutputError> {
    check_some(path, usize::MAX)
}

/// Like [`check`], but looks at no more than about `max_features` lines of a sequence, evenly spread: cjval takes some
/// hundredths of a second for each.
///
/// # Errors
/// As [`check`].
pub fn check_some(path: &Path, max_features: usize) -> Result<SchemaCheck, OutputError> {
    let mut outcome = SchemaCheck::default();
    let read = || FileError::on("cannot read", path);
    if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("jsonl")) {
        let bytes = fs::read(path).map_err(read())?;
        let text = String::from_utf8(bytes)
            .map_err(|e| MalformedFile { path: path.to_owned(), reason: format!("it is no UTF-8 text: {e}") })?;
        let others = has_other_extensions(&text);
        outcome.add(&validator(&text), None, others);
        return Ok(outcome);
    }
    let mut lines = BufReader::new(fs::File::open(path).map_err(read())?).lines().enumerate();
    let Some((_, header)) = lines.next() else { return Ok(outcome) };
    let header = header.map_err(read())?;
    let mut validator = validator(&header);
    let others = has_other_extensions(&header);
    outcome.add(&validator, Some(1), others);
    if !outcome.errors.is_empty() {
        return Ok(outcome);
    }
    if validator.get_input_cityjson_version() < FIRST_WITH_FEATURES {
        outcome.errors.push(SchemaFault {
            check: "schema".to_owned(),
            line: Some(1),
            message: "a sequence needs CityJSON 1.1 or newer".to_owned(),
        });
        return Ok(outcome);
    }
    let n_lines = BufReader::new(fs::File::open(path).map_err(read())?).lines().count();
    let step = n_lines.div_ceil(max_features.max(1));
    for (i, line) in lines {
        let line = line.map_err(read())?;
        if line.trim().is_empty() {
            continue;
        }
        outcome.n_features += 1;
        if !(outcome.n_features - 1).is_multiple_of(step) {
            continue;
        }
        outcome.n_features_checked += 1;
        match validator.from_str_cjfeature(&line) {
            Ok(()) => outcome.add(&validator, Some(i + 1), others),
            Err(message) => {
                outcome.errors.push(SchemaFault { check: "json_syntax".to_owned(), line: Some(i + 1), message });
            }
        }
    }
    Ok(outcome)
}

/// Sequences came with version 1.1, which cjval counts as 11.
const FIRST_WITH_FEATURES: i32 = 11;

/// With our own extension, which costs nothing where it is not used.
fn validator(text: &str) -> CJValidator {
    let mut validator = CJValidator::from_str(text);
    if text.contains(EXTENSION_IS_DECLARED) {
        // It is valid JSON, so cjval takes it.
        let _ = validator.add_one_extension_from_str(&extension_schema().to_string());
    }
    validator
}

/// Whether extensions are declared that are not ours.
fn has_other_extensions(text: &str) -> bool {
    let header: Option<Value> = serde_json::from_str(text).ok();
    let declared = header.as_ref().and_then(|file| file.get("extensions")?.as_object());
    declared.is_some_and(|extensions| extensions.keys().any(|name| name != "Sizeup"))
}

impl SchemaCheck {
    fn add(&mut self, validator: &CJValidator, line: Option<usize>, has_other_extensions: bool) {
        for (check, summary) in validator.validate() {
            let is_unchecked_extension = check == EXTENSIONS && has_other_extensions;
            let list =
                if summary.is_warning() || is_unchecked_extension { &mut self.warnings } else { &mut self.errors };
            list.extend(summary.get_errors().iter().map(|message| SchemaFault {
                check: check.clone(),
                line,
                message: message.clone(),
            }));
        }
    }
}
