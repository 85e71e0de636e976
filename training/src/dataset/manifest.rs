//! What a set holds: counts, licences, and every file with its size and SHA-256.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use sizeup_geo::files;
use sizeup_geo::hashes::sha256_hex;

use super::{SceneConfig, Split};
use crate::TrainError;

/// The form of a set that this program writes and reads.
pub const FORMAT: &str = "sizeup-footprints.v1";
/// Its name in a set.
pub const FILE: &str = "manifest.json";

/// A set's list of contents.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// Scenes in the order of the configuration.
    pub scenes: Vec<SceneEntry>,
    /// Every other file, by its path in the set.
    pub files: BTreeMap<String, FileEntry>,
}

/// One scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SceneEntry {
    /// Its name.
    pub name: String,
    /// What it is for.
    pub split: Split,
    /// Of its photos.
    pub licence: String,
    /// Buildings in the scene.
    pub n_buildings: usize,
    /// Photos in the set.
    pub n_photos: usize,
    /// Buildings in photos.
    pub n_instances: usize,
    /// Of these, with a part that something hides.
    pub n_occluded: usize,
    /// Photos with depth.
    pub n_with_depth: usize,
    /// What was left out, and why.
    pub notes: Vec<String>,
    /// Where it came from.
    pub source: SceneConfig,
}

/// One file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    /// Its size.
    pub bytes: u64,
    /// In hexadecimal.
    pub sha256: String,
}

impl FileEntry {
    /// Of a file.
    ///
    /// # Errors
    /// One that cannot be read.
    pub fn of(path: &Path) -> Result<Self, TrainError> {
        let bytes = files::read_bytes(path)?;
        Ok(Self { bytes: bytes.len() as u64, sha256: sha256_hex(&bytes) })
    }
}
