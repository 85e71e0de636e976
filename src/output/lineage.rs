//! Where a result comes from: enough to run it again, and nothing that changes from run to run (no clock).

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::files::FileError;

/// The origin of a result, written into every file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lineage {
    /// Version of sizeup.
    pub version: String,
    /// The command line, program name first.
    pub command: String,
    /// SHA-256 of the resolved configuration, hexadecimal.
    pub config_sha256: String,
    /// Every file that was read.
    pub inputs: Vec<InputFile>,
    /// The project's CRS as the user wrote it.
    pub crs: String,
    /// What z counts from, in words: `orthometric, NAP height`, `ellipsoidal, GRS 80`.
    pub vertical_reference: String,
    /// What `height_m` is, in words.
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
    /// What it was read as: `survey`, `footprints`, `terrain`, `prior`, `config`.
    pub role: String,
    /// Path as the configuration beside the results has it.
    pub path: String,
    /// Size in bytes.
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
        let (size_bytes, sha256) = hash_file(path).map_err(FileError::on("cannot read", path))?;
        Ok(Self { role: role.to_owned(), path: path.display().to_string(), size_bytes, sha256 })
    }
}

fn hash_file(path: &Path) -> io::Result<(u64, String)> {
    let mut file = File::open(path)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0_u8; 1 << 20];
    let mut size_bytes = 0_u64;
    loop {
        let n = file.read(&mut buffer)?;
        if n == 0 {
            return Ok((size_bytes, hex(&hasher.finalize())));
        }
        hasher.update(&buffer[..n]);
        size_bytes += n as u64;
    }
}

/// SHA-256 of bytes, hexadecimal.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        use std::fmt::Write as _;
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_sha256() {
        // FIPS 180-2, appendix B.1.
        assert_eq!(sha256_hex(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc");
        std::fs::write(&path, b"abc").unwrap();
        let file = InputFile::hash("survey", &path).unwrap();
        assert_eq!((file.size_bytes, file.sha256), (3, sha256_hex(b"abc")));
    }
}
