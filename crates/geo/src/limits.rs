//! How much memory one input may take, and whether an input may reach for the network.
//!
//! ```text
//! bytes(what a header asks for)  ≤  input_mb · 10⁶
//! bytes(what a header asks for)  ≤  4096 · bytes(the file)     from 64 MB on
//! ```
//!
//! Nothing that a file says sizes an allocation before it went through [`check`] or was held against the file's length.
//! These are guards, no settings of a computation: no result depends on them. So they hold for the whole process, and are
//! set once, by the command line.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Memory for one input unless somebody says otherwise, megabytes: the largest aerial frame camera has 450 megapixels,
/// 1,800 MB as floats, and the same once more while it is made ready.
pub const INPUT_MB: u64 = 4096;
/// Most bytes that one byte of a file can stand for: deflate reaches 1,032, LZW 2,730. More is holes.
const MOST_PER_BYTE: u64 = 4096;
/// Less than this, bytes, hurts nobody, however little of it is in the file.
const HARMLESS: u64 = 64_000_000;

/// Statement of the configuration.
static INPUT: AtomicU64 = AtomicU64::new(INPUT_MB);
static REMOTE: AtomicBool = AtomicBool::new(false);
/// Limit from the command line, which goes before it; 0 for nothing.
static INSISTED: AtomicU64 = AtomicU64::new(0);
static REMOTE_INSISTED: AtomicBool = AtomicBool::new(false);

/// Limits of the memory and servers that input may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Most memory that reading one file may take, megabytes. Files that ask for more are refused before it is taken.
    pub input_mb: u64,
    /// Whether input may be on servers (`/vsicurl/…`, `/vsis3/…`), and files may refer to such (WMS, VRT layers).
    pub allow_remote: bool,
}

impl Default for Limits {
    fn default() -> Self {
        Self { input_mb: INPUT_MB, allow_remote: false }
    }
}

impl Limits {
    /// Makes a configuration's hold for the process, but for what was insisted on. Remote input has to be allowed before
    /// the first file is opened.
    pub fn set(self) {
        INPUT.store(self.input_mb, Ordering::Relaxed);
        REMOTE.store(self.allow_remote, Ordering::Relaxed);
    }

    /// Limits that hold now in this process.
    #[must_use]
    pub fn now() -> Self {
        let insisted = INSISTED.load(Ordering::Relaxed);
        let input_mb = if insisted > 0 { insisted } else { INPUT.load(Ordering::Relaxed) };
        let allow_remote = REMOTE.load(Ordering::Relaxed) || REMOTE_INSISTED.load(Ordering::Relaxed);
        Self { input_mb, allow_remote }
    }

    /// Limit from the command line, whatever a configuration says.
    pub fn insist(input_mb: Option<u64>, allow_remote: bool) {
        INSISTED.store(input_mb.unwrap_or(0), Ordering::Relaxed);
        REMOTE_INSISTED.store(allow_remote, Ordering::Relaxed);
    }

    /// Bytes that one input may take.
    #[must_use]
    pub fn input_bytes(self) -> u64 {
        self.input_mb.saturating_mul(1_000_000)
    }
}

/// Why a file's claim is not believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Excess {
    /// More than one input may take.
    #[error(
        "it asks for {} MB of memory, and one input may take {limit_mb} MB\n\
         hint: if the file is sound, raise `--input-memory` or `limits.input_mb`",
        claimed / 1_000_000
    )]
    Large {
        /// Memory asked for, bytes.
        claimed: u64,
        /// Memory that one input may take, megabytes.
        limit_mb: u64,
    },
    /// Much more than it can hold.
    #[error(
        "its {stored} bytes claim to hold {} MB: it is damaged, or nearly all of it is empty\n\
         hint: cut out the part that is needed, for rasters with `gdal_translate -projwin`",
        claimed / 1_000_000
    )]
    Hollow {
        /// Memory that the file claims to fill, bytes.
        claimed: u64,
        /// The file's length, bytes.
        stored: u64,
    },
}

/// Holds what a file claims, bytes in memory, against the limit and, where it is known, the file's length.
///
/// # Errors
/// [`Excess`].
pub fn check(claimed: u64, stored: Option<u64>) -> Result<(), Excess> {
    check_against(claimed, stored, Limits::now())
}

/// Holds what a file claims, bytes, against its length alone: for what is read piece by piece.
///
/// # Errors
/// [`Excess::Hollow`].
pub fn check_content(claimed: u64, stored: u64) -> Result<(), Excess> {
    let is_hollow = claimed > HARMLESS && claimed / MOST_PER_BYTE > stored;
    if is_hollow { Err(Excess::Hollow { claimed, stored }) } else { Ok(()) }
}

fn check_against(claimed: u64, stored: Option<u64>, limits: Limits) -> Result<(), Excess> {
    stored.map_or(Ok(()), |stored| check_content(claimed, stored))?;
    if claimed > limits.input_bytes() {
        return Err(Excess::Large { claimed, limit_mb: limits.input_mb });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_are_held_against_the_limit_and_the_length() {
        let limits = Limits { input_mb: 200, allow_remote: false };
        let check = |claimed, stored| check_against(claimed, stored, limits);
        assert_eq!(check(200_000_000, None), Ok(()));
        assert_eq!(check(200_000_001, None), Err(Excess::Large { claimed: 200_000_001, limit_mb: 200 }));
        // As much as deflate can pack, and what no packing can.
        assert_eq!(check(103_200_000, Some(100_000)), Ok(()));
        assert_eq!(check(100_000_000, Some(142)), Err(Excess::Hollow { claimed: 100_000_000, stored: 142 }));
        assert_eq!(check(60_000_000, Some(142)), Ok(()), "too little to hurt");
    }
}
