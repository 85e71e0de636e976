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
    /// Name of the format, [`FORMAT`].
    pub format: String,
    /// Scenes in the order of the configuration.
    pub scenes: Vec<SceneEntry>,
    /// Every other file, by its path in the set.
    pub files: BTreeMap<String, FileEntry>,
}

/// A scene of the set: its photos and their licence.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SceneEntry {
    /// Name of the scene.
    pub name: String,
    /// Use of the scene: training, validation or test.
    pub split: Split,
    /// Licence of the scene's photos.
    pub licence: String,
    /// Buildings in the scene.
    pub n_buildings: usize,
    /// Photos in the set.
    pub n_photos: usize,
    /// Number of buildings in photos, each counted once per photo.
    pub n_instances: usize,
    /// Of these, with a part that something hides.
    pub n_occluded: usize,
    /// Number of photos with depth.
    pub n_with_depth: usize,
    /// What was left out, and why.
    pub notes: Vec<String>,
    /// Where it came from.
    pub source: SceneConfig,
}

/// A file of the set, by which changes are noticed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    /// Size of the file, bytes.
    pub bytes: u64,
    /// SHA-256 of the file's bytes, in hexadecimal.
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
