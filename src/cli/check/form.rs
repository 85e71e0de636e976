//! The form of a `CityJSON` file: schema, references, indices, semantics.

use std::path::Path;

use serde::Serialize;

use super::super::Failure;
use super::city::more;
use sizeup_results::output::validate::schema::{self, SchemaCheck, SchemaFault};

/// Faults after which the rest of a sequence is passed over unless all are asked for.
const MAX_FAULTS: usize = 200;

/// The findings of cjval in one file.
#[derive(Serialize)]
#[serde(transparent)]
pub(super) struct Form(SchemaCheck);

impl Form {
    /// Checks a file.
    pub(super) fn check(file: &Path, is_all: bool) -> Result<Self, Failure> {
        let max_faults = if is_all { usize::MAX } else { MAX_FAULTS };
        schema::check_until(file, max_faults).map(Self).map_err(|e| Failure::new(3, &e))
    }

    /// Whether nothing is wrong.
    pub(super) fn is_sound(&self) -> bool {
        self.0.errors.is_empty()
    }

    /// Findings as lines.
    pub(super) fn lines(&self, n_printed: usize) -> String {
        let Self(form) = self;
        let mut lines = vec![format!("form: {} errors, {} warnings", form.errors.len(), form.warnings.len())];
        if form.n_features_checked < form.n_features {
            lines.push(format!(
                "after these, the form of the other features was not looked at: {} out of {}; --all looks at every one",
                form.n_features_checked, form.n_features
            ));
        }
        for (what, faults) in [("error", &form.errors), ("warning", &form.warnings)] {
            for SchemaFault { check, line, message } in faults.iter().take(n_printed) {
                let line = line.map_or_else(String::new, |line| format!(" line {line}"));
                lines.push(format!("{what} {check}{line}: {message}"));
            }
            lines.extend(more(faults.len(), n_printed));
        }
        lines.join("\n")
    }
}
