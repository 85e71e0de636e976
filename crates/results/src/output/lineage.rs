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
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub command: String,
    /// SHA-256 of the resolved configuration, hexadecimal.
    #[serde(default, skip_serializing_if = "String::is_empty")]
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

impl Lineage {
    /// With the day of the flight, where nobody stated the day that the data stands for.
    #[must_use]
    pub fn of_day(self, flight_day: impl FnOnce() -> Option<String>) -> Self {
        Self { reference_date: self.reference_date.or_else(flight_day), ..self }
    }

    /// Returns what the header of a city has of it: files by their names, and no command, hash or depth prior. `lineage.json` beside
    /// the city has all.
    #[must_use]
    pub fn header(&self) -> Self {
        let name = |file: &InputFile| InputFile {
            role: file.role.clone(),
            path: file.path.rsplit(['/', '\\']).next().unwrap_or_default().to_owned(),
            ..InputFile::default()
        };
        Self {
            command: String::new(),
            config_sha256: String::new(),
            inputs: self.inputs.iter().filter(|file| file.role != "prior").map(name).collect(),
            source: self.source.as_ref().map(|source| Box::new(source.header())),
            ..self.clone()
        }
    }
}

/// One file that was read.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct InputFile {
    /// Role in which it was read: `survey`, `footprints`, `terrain`, `prior`, `config`.
    pub role: String,
    /// Path as the configuration beside the results has it.
    pub path: String,
    /// Size of the file, bytes.
    #[serde(default, skip_serializing_if = "no_bytes")]
    pub size_bytes: u64,
    /// SHA-256 of the content, hexadecimal.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub sha256: String,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference")]
fn no_bytes(size_bytes: &u64) -> bool {
    *size_bytes == 0
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
