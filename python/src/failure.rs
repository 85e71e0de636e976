//! Errors as Python's exceptions: `sizeup.SizeupError` and its kinds, with message and hint apart.

use pyo3::prelude::*;

/// What comes before the advice in the text of an error.
const HINT: &str = "\nhint: ";
/// Exit code of what is wrong with settings.
const SETTINGS: u8 = 2;
/// Exit code of what is wrong with the input.
const INPUT: u8 = 3;

/// What is wrong, before it becomes an exception.
#[derive(Debug)]
pub(crate) struct Failure {
    /// The exit code that the program would end with: it says which exception this is.
    code: u8,
    message: String,
    hint: Option<String>,
}

impl Failure {
    /// Settings that mean nothing, and what to write.
    pub(crate) fn of_settings(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { code: SETTINGS, message: message.into(), hint: Some(hint.into()) }
    }

    /// Input that cannot be used: where, what was expected and found, and what to do.
    pub(crate) fn of_input(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { code: INPUT, message: message.into(), hint: Some(hint.into()) }
    }

    /// A file that cannot be used; the error's text may hold the hint, and its causes follow where the text lacks them.
    pub(crate) fn of_file(error: &dyn std::error::Error) -> Self {
        let (message, hint) = sizeup::cli::Failure::new(INPUT, error).message_and_hint();
        Self { code: INPUT, message, hint }
    }

    /// A text with or without a hint in it.
    pub(crate) fn from_text(text: &str) -> Self {
        let (message, hint) = match text.split_once(HINT) {
            Some((message, hint)) => (message, Some(hint.to_owned())),
            None => (text, None),
        };
        Self { code: INPUT, message: message.to_owned(), hint }
    }
}

/// As the exception it is; where that cannot be made, why not.
pub(crate) fn told(py: Python<'_>, failure: Failure) -> PyErr {
    let made = py
        .import("sizeup._errors")
        .and_then(|errors| errors.getattr("of_code"))
        .and_then(|make| make.call1((failure.code, failure.message, failure.hint)));
    match made {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}
