//! Where a result comes from: enough to run it again, and nothing that changes from run to run (no clock).

use std::path::Path;

use serde::{Deserialize, Serialize};

use sizeup_geo::files::FileError;
use sizeup_geo::hashes::Content;
pub use sizeup_geo::hashes::sha256_hex;

/// The origin of a result, written into every file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lineage {
    /// Version of sizeup that wrote the result.
    pub version: String,
    /// The commit that it was built from, with a `+` where files differed from it; `None` where nobody knew.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// The command line, program name first.
    pub command: String,
    /// SHA-256 of the resolved configuration, hexadecimal.
    pub config_sha256: String,
    /// Every file that was read.
    pub inputs: Vec<InputFile>,
    /// The project's CRS as the user wrote it.
    pub crs: String,
    /// Vertical datum of z, in words: `orthometric, NAP height`, `ellipsoidal, GRS 80`.
    pub vertical_reference: String,
    /// Definition of `height_m`, in words.
    pub height_definition: String,
    /// Root seed of all random choices.
    pub seed: u64,
    /// The day the data stands for (of the flight, or of the run), `YYYY-MM-DD`. Given, never read from a clock, so
    /// that the same run writes the same bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_date: Option<String>,
    /// The origin of the city that this was made from, where that is a file of ours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Box<Lineage>>,
}

/// One file that was read.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct InputFile {
    /// Role in which it was read: `survey`, `footprints`, `terrain`, `prior`, `config`.
    pub role: String,
    /// Path as the configuration beside the results has it.
    pub path: String,
    /// Size of the file, bytes.
    pub size_bytes: u64,
    /// SHA-256 of the content, hexadecimal.
    pub sha256: String,
}

impl InputFile {
    /// Reads a file once to know its size and hash.
    ///
    /// # Errors
    /// [`FileError`] if it cannot be read.
    pub fn hash(role: &str, path: &Path) -> Result<Self, FileError> {
        Ok(Self::holding(role, path, Content::of(path).map_err(FileError::on("cannot read", path))?))
    }

    /// A file whose content is known.
    #[must_use]
    pub fn holding(role: &str, path: &Path, Content { size_bytes, sha256 }: Content) -> Self {
        Self { role: role.to_owned(), path: path.display().to_string(), size_bytes, sha256 }
    }
}
