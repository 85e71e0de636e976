//! `--progress json`: what a command tells while it works, one JSON object a line on stderr, for programs that call it.
//!
//! Bars, log lines and the error at the end all become events; the last line is always `done` or `error`. stdout stays
//! what it is: data.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::Serialize;
use tracing_subscriber::fmt::MakeWriter;

use super::{Failure, talk};
use crate::pipeline::Stage;

/// Between two lines about the same work, unless it is done: readers draw bars, and a line each is enough for the eye.
const ADVANCE_EVERY: Duration = Duration::from_millis(100);

/// How progress is told, on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum ProgressForm {
    /// Bars on a terminal, lines of text elsewhere.
    #[default]
    Text,
    /// One JSON object a line, for programs; `sizeup schema progress` describes them.
    Json,
}

/// How much a message weighs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MessageLevel {
    /// A remark on what is done.
    Info,
    /// Something that is probably not as it was meant.
    Warning,
    /// Something that went wrong, and the command goes on.
    Error,
}

/// Events of a command at work: one line each.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum ProgressEvent {
    /// A stage of a run begins: survey, footprints, heights, output.
    Stage {
        /// Name of the stage that begins.
        stage: Stage,
        /// Share of the whole run that is done, 0 to 1; never less than before.
        share: f64,
    },
    /// So much of some work is done. The same work can begin again, from 0.
    Advance {
        /// The work: `ground`, `tracing`, `priors`, `epochs`, `tiles`, or words.
        what: String,
        /// How much is done, at most `total`.
        done: usize,
        /// How much there is.
        total: usize,
        /// Share of the whole run that is done, 0 to 1, where it is a run.
        #[serde(skip_serializing_if = "Option::is_none")]
        share: Option<f64>,
    },
    /// A message to read.
    Message {
        /// How much it weighs.
        level: MessageLevel,
        /// The text, one or more lines.
        message: String,
    },
    /// The command is through; nothing follows.
    Done {
        /// The exit code: 0, 5 where some items of the input have no result, 3 where something was checked and found wrong.
        code: u8,
    },
    /// The command could not do what was asked; nothing follows.
    Error {
        /// The exit code: 2 usage or configuration, 3 the input cannot be used, 4 failed.
        code: u8,
        /// The problem in words, with its hint.
        message: String,
        /// Advice, where there is any.
        #[serde(skip_serializing_if = "Option::is_none")]
        hint: Option<String>,
    },
}

impl ProgressEvent {
    /// Line that ends a command.
    #[must_use]
    pub fn of_failure(failure: &Failure) -> Self {
        let (message, hint) = failure.message_and_hint();
        Self::Error { code: failure.exit_code, message, hint }
    }

    /// Writes it to stderr; nobody listening is no reason to stop.
    pub fn emit(&self) {
        talk(&serde_json::to_string(self).unwrap_or_default());
    }
}

/// Which lines about some work are due.
#[derive(Debug, Default)]
pub(super) struct Pace(Mutex<BTreeMap<String, (usize, Instant)>>);

impl Pace {
    /// Whether to tell that `done` of `total` is done: the first time, at the end, and now and then between. What is behind
    /// what was told already (threads overtake each other) is left out, unless it begins anew.
    pub fn is_due(&self, what: &str, done: usize, total: usize) -> bool {
        let Ok(mut told) = self.0.lock() else { return false };
        let is_due = match told.get(what) {
            None => true,
            Some(&(last, _)) if done == 0 || last == total => done != last,
            Some(&(last, at)) => done > last && (done == total || at.elapsed() >= ADVANCE_EVERY),
        };
        if is_due {
            told.insert(what.to_owned(), (done, Instant::now()));
        }
        is_due
    }
}

/// Log events as messages.
#[derive(Debug, Clone, Copy)]
pub(super) struct LogLines;

/// One log event on its way to a message.
#[derive(Debug)]
pub(super) struct LogLine(MessageLevel);

impl<'a> MakeWriter<'a> for LogLines {
    type Writer = LogLine;

    fn make_writer(&'a self) -> LogLine {
        LogLine(MessageLevel::Info)
    }

    fn make_writer_for(&'a self, meta: &tracing::Metadata<'_>) -> LogLine {
        LogLine(match *meta.level() {
            tracing::Level::ERROR => MessageLevel::Error,
            tracing::Level::WARN => MessageLevel::Warning,
            _ => MessageLevel::Info,
        })
    }
}

impl Write for LogLine {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        let message = String::from_utf8_lossy(line).trim().to_owned();
        ProgressEvent::Message { level: self.0, message }.emit();
        Ok(line.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_told_at_its_start_and_end_and_never_backwards() {
        let pace = Pace::default();
        let told: Vec<(usize, usize)> = [(0, 9), (2, 9), (1, 9), (9, 9), (9, 9), (0, 9), (9, 9)]
            .into_iter()
            .filter(|&(done, total)| pace.is_due("priors", done, total))
            .collect();
        assert_eq!(told, [(0, 9), (9, 9), (0, 9), (9, 9)]);
        assert!(pace.is_due("epochs", 3, 9), "each work has its own pace");
    }

    #[test]
    fn an_error_is_told_with_its_hint_apart() {
        let failure = Failure::from_text(3, "[survey] the poses look wrong\nhint: try another CRS");
        let told = serde_json::to_value(ProgressEvent::of_failure(&failure)).unwrap();
        let expected = serde_json::json!({
            "event": "error", "code": 3, "message": "[survey] the poses look wrong", "hint": "try another CRS",
        });
        assert_eq!(told, expected);
        let failure = Failure::from_text(4, "disk full");
        let told = serde_json::to_value(ProgressEvent::of_failure(&failure)).unwrap();
        assert_eq!(told, serde_json::json!({ "event": "error", "code": 4, "message": "disk full" }));
    }
}
