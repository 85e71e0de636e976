//! Checks of a file's form by cjval: the official schemas, references between objects, indices, semantics.
//!
//! Our own extension is known; of others the types of attributes are not checked, and that is said.
//!
//! One file is checked in parts ([`super::document`]), so that it never is in memory as a whole; what is no list of objects and
//! one of vertices is given to cjval as it stands.
//!
//! cjval reads its schema anew for whatever it is given, some hundredths of a second each time. So features of a sequence
//! are given to it many at a time, merged into one ([`super::merge`]); where it finds anything, the halves are, down to
//! the single line.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use cjval::CJValidator;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;

use super::super::OutputError;
use super::super::cityjson::extension_schema;
use super::super::error::MalformedFile;
use super::document;
use super::granted;
use super::merge::merged;
use sizeup_geo::files::{self, FileError};

/// Where our extension is declared, its name stands in quotes.
const EXTENSION_IS_DECLARED: &str = "\"Sizeup\"";
/// cjval's names of its checks.
pub(super) const SCHEMA: &str = "schema";
pub(super) const EXTENSIONS: &str = "extensions";
pub(super) const INDICES: &str = "wrong_vertex_index";
pub(super) const SEMANTICS: &str = "semantics_arrays";
pub(super) const TEXTURES: &str = "textures";
pub(super) const MATERIALS: &str = "materials";
/// The byte order mark, with which programs of Windows begin a text; it is no part of it.
const BYTE_ORDER_MARK: char = '\u{feff}';
/// Features that are merged into one.
const AT_ONCE: usize = 256;
/// Features that are in memory at a time.
const IN_MEMORY: usize = 16 * AT_ONCE;

/// One thing that is wrong with the form.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SchemaFault {
    /// cjval's name of the check: `schema`, `wrong_vertex_index`, ….
    pub check: String,
    /// Line of a sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<usize>,
    /// Fault and its place, in cjval's words.
    pub message: String,
}

/// The outcome for a file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct SchemaCheck {
    /// Faults that make the file invalid.
    pub errors: Vec<SchemaFault>,
    /// Faults that do not, and are worth knowing.
    pub warnings: Vec<SchemaFault>,
    /// Features of a sequence.
    pub n_features: usize,
    /// Those that were looked at among them.
    pub n_features_checked: usize,
}

/// Checks a file, or every line of a sequence (`….jsonl`).
///
/// # Errors
/// [`OutputError::File`] if it cannot be read, [`OutputError::Malformed`] if what has to be looked at as a whole is no UTF-8.
pub fn check(path: &Path) -> Result<SchemaCheck, OutputError> {
    check_until(path, usize::MAX)
}

/// Like [`check`], but passes over the rest of a sequence once about `max_faults` errors and warnings were found.
///
/// # Errors
/// As [`check`].
pub fn check_until(path: &Path, max_faults: usize) -> Result<SchemaCheck, OutputError> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("jsonl")) {
        return check_sequence(path, max_faults);
    }
    if let Some(outcome) = document::check(path)? {
        return Ok(outcome);
    }
    let bytes = files::read_bytes(path)?;
    let text = String::from_utf8(bytes)
        .map_err(|e| MalformedFile { path: path.to_owned(), reason: format!("it is no UTF-8 text: {e}") })?;
    let text = text.trim_start_matches(BYTE_ORDER_MARK);
    let mut outcome = SchemaCheck::default();
    let secured = outcome.secure(text, None);
    outcome.add(&validator(secured.as_deref().unwrap_or(text)), None, has_other_extensions(text));
    Ok(outcome)
}

/// A line of a sequence, counted from 1.
type NumberedLine = (usize, String);

fn check_sequence(path: &Path, max_faults: usize) -> Result<SchemaCheck, OutputError> {
    let read = || FileError::on("cannot read", path);
    let mut outcome = SchemaCheck::default();
    let mut lines = BufReader::new(fs::File::open(path).map_err(read())?).lines().zip(1..);
    let Some((header, _)) = lines.next() else { return Ok(outcome) };
    let header = header.map_err(read())?;
    let header = SequenceHeader::new(header.trim_start_matches(BYTE_ORDER_MARK).to_owned());
    outcome.add_header(&header);
    if !outcome.errors.is_empty() {
        return Ok(outcome);
    }
    loop {
        let mut group: Vec<NumberedLine> = Vec::new();
        for (line, number) in lines.by_ref() {
            let line = line.map_err(read())?;
            if !line.trim().is_empty() {
                group.push((number, line));
            }
            if group.len() == IN_MEMORY {
                break;
            }
        }
        if group.is_empty() {
            return Ok(outcome);
        }
        outcome.n_features += group.len();
        if outcome.errors.len() + outcome.warnings.len() < max_faults {
            let found: Vec<SchemaCheck> = group.par_chunks(AT_ONCE).map(|lines| header.check(lines)).collect();
            for part in found {
                outcome.extend(part);
            }
        }
    }
}

/// The first line of a sequence.
struct SequenceHeader {
    text: String,
    has_other_extensions: bool,
}

impl SequenceHeader {
    fn new(text: String) -> Self {
        let has_other_extensions = has_other_extensions(&text);
        Self { text, has_other_extensions }
    }

    /// Checks some lines that come after it.
    fn check(&self, lines: &[NumberedLine]) -> SchemaCheck {
        let mut outcome = SchemaCheck { n_features_checked: lines.len(), ..SchemaCheck::default() };
        let secure = |(number, line): &NumberedLine| {
            let secured = outcome.secure(line, Some(*number));
            (*number, secured.unwrap_or_else(|| line.clone()))
        };
        let lines: Vec<NumberedLine> = lines.iter().map(secure).collect();
        self.find(&mut validator(&self.text), &lines, &mut outcome);
        outcome
    }

    /// All at once, and where anything is found in halves.
    fn find(&self, validator: &mut CJValidator, lines: &[NumberedLine], outcome: &mut SchemaCheck) {
        if let [(number, line)] = lines {
            return match validator.from_str_cjfeature(line) {
                Ok(()) => outcome.add(validator, Some(*number), self.has_other_extensions),
                Err(message) => {
                    outcome.errors.push(SchemaFault { check: "json_syntax".to_owned(), line: Some(*number), message });
                }
            };
        }
        let together = merged(lines.iter().map(|(_, line)| line.as_str()));
        let is_clean = together
            .is_some_and(|text| validator.from_str_cjfeature(&text).is_ok() && granted::said(validator).is_empty());
        if !is_clean {
            let (first, second) = lines.split_at(lines.len() / 2);
            self.find(validator, first, outcome);
            self.find(validator, second, outcome);
        }
    }
}

/// Sequences, and extensions as they are now, came with version 1.1, which cjval counts as 11.
const FIRST_WITH_FEATURES: i32 = 11;

/// With our own extension, which costs nothing where it is not used.
pub(super) fn validator(text: &str) -> CJValidator {
    let mut validator = CJValidator::from_str(text);
    // cjval has no schemas of extensions before, and panics.
    let has_extensions = validator.get_input_cityjson_version() >= FIRST_WITH_FEATURES;
    if has_extensions && text.contains(EXTENSION_IS_DECLARED) {
        // It is valid JSON, so cjval takes it.
        let _ = validator.add_one_extension_from_str(&extension_schema().to_string());
    }
    validator
}

/// Whether extensions are declared that are not ours.
pub(super) fn has_other_extensions(text: &str) -> bool {
    let header: Option<Value> = serde_json::from_str(text).ok();
    let declared = header.as_ref().and_then(|file| file.get("extensions")?.as_object());
    declared.is_some_and(|extensions| extensions.keys().any(|name| name != "Sizeup"))
}

impl SchemaCheck {
    fn add_header(&mut self, header: &SequenceHeader) {
        let validator = validator(&header.text);
        self.add(&validator, Some(1), header.has_other_extensions);
        if self.errors.is_empty() && validator.get_input_cityjson_version() < FIRST_WITH_FEATURES {
            let message = "a sequence needs CityJSON 1.1 or newer".to_owned();
            self.errors.push(SchemaFault { check: "schema".to_owned(), line: Some(1), message });
        }
    }

    fn add(&mut self, validator: &CJValidator, line: Option<usize>, has_other_extensions: bool) {
        for (check, message, is_warning) in granted::said(validator) {
            let is_unchecked_extension = check == EXTENSIONS && has_other_extensions;
            let list = if is_warning || is_unchecked_extension { &mut self.warnings } else { &mut self.errors };
            list.push(SchemaFault { check, line, message });
        }
    }

    /// Takes note of what cjval takes for granted and is not so; a text without it, where there is any of it.
    fn secure(&mut self, text: &str, line: Option<usize>) -> Option<String> {
        let mut document: Value = serde_json::from_str(text).ok()?;
        let as_it_was = document.clone();
        let findings = granted::secure_document(&mut document);
        let fault = |(check, message): granted::Finding| SchemaFault { check: check.to_owned(), line, message };
        self.errors.extend(findings.into_iter().map(fault));
        (document != as_it_was).then(|| document.to_string())
    }

    fn extend(&mut self, part: Self) {
        self.errors.extend(part.errors);
        self.warnings.extend(part.warnings);
        self.n_features_checked += part.n_features_checked;
    }
}
