//! Why a survey cannot be read or written as a whole. One bad photo is an [`Issue`](sizeup_geo::issue::Issue) instead.

use std::path::PathBuf;

use sizeup_geo::crs::CrsError;
use sizeup_geo::files::FileError;

/// Why a survey cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// A file could not be opened, read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A CRS or a transformation cannot be used.
    #[error(transparent)]
    Crs(#[from] CrsError),
    /// A file is not what its format says.
    #[error("{}{place}: {message}{hint}", path.display())]
    Malformed {
        /// The file of poses, or one beside it.
        path: PathBuf,
        /// Place in it (`line 12`, `byte 80`), empty for the file as a whole.
        place: Place,
        /// Problem, expected against found.
        message: String,
        /// Advice to the user, where there is any.
        hint: Hint,
    },
    /// The configuration contradicts itself or lacks something.
    #[error("survey configuration: {message}{hint}")]
    Config {
        /// Problem, expected against found.
        message: String,
        /// Advice to the user, where there is any.
        hint: Hint,
    },
    /// No pose could be used.
    #[error("{}: none of its {n_poses} poses can be used; the first: {first}{hint}", path.display())]
    NothingUsable {
        /// Path of the survey.
        path: PathBuf,
        /// Poses that were read.
        n_poses: usize,
        /// Why the first was refused.
        first: String,
        /// Advice to the user, where there is any.
        hint: Hint,
    },
}

/// Place in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Place {
    /// The file as a whole.
    #[default]
    Whole,
    /// A line, counted from 1.
    Line(u64),
    /// A byte, counted from 0.
    Byte(u64),
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Line(line) => write!(f, ", line {line}"),
            Self::Byte(byte) => write!(f, ", byte {byte}"),
        }
    }
}

/// Advice at the end of a message, on a line of its own; may be empty.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Hint(pub String);

impl From<&str> for Hint {
    fn from(hint: &str) -> Self {
        Self(hint.to_owned())
    }
}

impl From<String> for Hint {
    fn from(hint: String) -> Self {
        Self(hint)
    }
}

impl std::fmt::Display for Hint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.is_empty() { Ok(()) } else { write!(f, "\nhint: {}", self.0) }
    }
}

impl SurveyError {
    /// The error of a file that is not as its format says.
    pub(crate) fn malformed(path: &std::path::Path, place: Place, message: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_owned(), place, message: message.into(), hint: Hint::default() }
    }

    /// The error of a setting that cannot be.
    pub(crate) fn config(message: impl Into<String>, hint: impl Into<Hint>) -> Self {
        Self::Config { message: message.into(), hint: hint.into() }
    }

    /// The same with advice, for the variants that can carry it.
    #[must_use]
    pub(crate) fn hint(mut self, advice: impl Into<Hint>) -> Self {
        if let Self::Malformed { hint, .. } | Self::Config { hint, .. } | Self::NothingUsable { hint, .. } = &mut self {
            *hint = advice.into();
        }
        self
    }
}
