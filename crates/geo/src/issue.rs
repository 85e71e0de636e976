//! What went wrong with one item of the input, without stopping the run.
//!
//! A photo that cannot be used or a building that cannot be solved is an [`Issue`]: it stays in the output, with a
//! status and a reason, and is never dropped in silence.

use std::cmp::Reverse;

use serde::{Deserialize, Serialize};

/// Severity of an issue for the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Worth knowing; the result is as good as without it.
    Note,
    /// The item was used, and its result deserves a second look.
    Warning,
    /// The item could not be used.
    Refused,
}

/// Subject of an issue.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind", content = "id")]
pub enum Subject {
    /// A photo, by its name.
    View(String),
    /// A building, by its id in the input.
    Building(String),
    /// A file or layer as a whole.
    Input(String),
}

impl Subject {
    /// Name, id or path.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::View(name) | Self::Building(name) | Self::Input(name) => name,
        }
    }
}

/// One item, what is wrong with it, and what to do about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Issue {
    /// Machine-readable, stable name such as `footprint_self_crossing`.
    pub code: String,
    /// How grave the issue is.
    pub severity: Severity,
    /// Subject of the issue: a view, a building or the input.
    pub subject: Subject,
    /// Problem, expected against found; one sentence.
    pub message: String,
    /// Advice, where there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
    /// Place in the project's CRS: easting, northing (metres).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<[f64; 2]>,
}

/// Issues that are about the result as a whole, or that most others follow from; those that come first in a run first.
const OF_THE_WHOLE: [&str; 11] = [
    "result_implausible",
    "survey_unsound_accepted",
    "masks_empty",
    "instances_in_parts",
    "prior_looks_inverted",
    "prior_unrelated_to_ground",
    "prior_not_in_metres",
    "terrain_filled_in",
    "terrain_too_high",
    "terrain_too_low",
    "terrain_differs",
];
/// Codes that come first among issues of the same severity: heights before what may only have led to a wrong one.
const OF_HEIGHTS: [&str; 4] = ["height_unknown", "footprint_refused", "height_doubtful", "height_from_fallback"];

impl Issue {
    /// Sorting key of an issue where the most important come first: about the whole, by severity, heights first. Issues of
    /// the same weight stay in their order.
    #[must_use]
    pub fn weight(&self) -> (usize, Reverse<Severity>, usize) {
        let place = |codes: &[&str]| codes.iter().position(|code| *code == self.code).unwrap_or(codes.len());
        (place(&OF_THE_WHOLE), Reverse(self.severity), place(&OF_HEIGHTS))
    }

    /// Whether it is about the result as a whole, or others follow from it.
    #[must_use]
    pub fn is_of_the_whole(&self) -> bool {
        OF_THE_WHOLE.contains(&self.code.as_str())
    }

    /// An issue without hint or place; add them with [`Self::hint`] and [`Self::at`].
    #[must_use]
    pub fn new(severity: Severity, code: &str, subject: Subject, message: impl Into<String>) -> Self {
        Self { code: code.to_owned(), severity, subject, message: message.into(), hint: None, place: None }
    }

    /// With what to do about it.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// With its place in the project's CRS, metres.
    #[must_use]
    pub fn at(mut self, easting_m: f64, northing_m: f64) -> Self {
        self.place = Some([easting_m, northing_m]);
        self
    }
}
