//! What can go wrong: what, where, expected against found, and what to do.

use std::path::{Path, PathBuf};

use sizeup_geo::files::FileError;

/// Why a set cannot be made or read, or a network not be trained.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A setting that cannot be.
    #[error("{problem}\nhint: {hint}")]
    Config {
        /// The problem with the setting, in words.
        problem: String,
        /// Text to write in its place.
        hint: String,
    },
    /// Something of a set that cannot be used.
    #[error("{}: {problem}\nhint: {hint}", path.display())]
    Set {
        /// The file of the set.
        path: PathBuf,
        /// What is wrong with it: expected against found.
        problem: String,
        /// What to do about it.
        hint: String,
    },
    /// A checkpoint or a network that does not fit.
    #[error("checkpoint {}: {problem}\nhint: {hint}", path.display())]
    Checkpoint {
        /// Path of the checkpoint's file.
        path: PathBuf,
        /// What is wrong with it: expected against found.
        problem: String,
        /// What to do about it.
        hint: String,
    },
    /// A scene that cannot be made ready.
    #[error("scene {scene:?}: {problem}")]
    Scene {
        /// Name of the scene.
        scene: String,
        /// What is the matter, with its own hint.
        problem: String,
    },
    /// A file that cannot be read or written.
    #[error(
        "{0}\nhint: is there room on the disk, and may the folder be written to? What was there before is still whole"
    )]
    File(#[from] FileError),
    /// A computation that did not work out.
    #[error("the network cannot be computed: {0}")]
    Tensor(#[from] candle_core::Error),
}

impl TrainError {
    /// Of a file of a set.
    pub fn set(path: &Path, problem: impl Into<String>, hint: &str) -> Self {
        Self::Set { path: path.to_owned(), problem: problem.into(), hint: hint.to_owned() }
    }

    /// An error of a scene, for `map_err`.
    pub fn scene<E: std::fmt::Display>(scene: &str) -> impl Fn(E) -> Self + '_ {
        move |problem| Self::Scene { scene: scene.to_owned(), problem: problem.to_string() }
    }

    /// An error of a setting, with what to write in its place.
    pub fn config(problem: impl Into<String>, hint: &str) -> Self {
        Self::Config { problem: problem.into(), hint: hint.to_owned() }
    }
}
