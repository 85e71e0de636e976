//! Real data beside the repository: not part of it, and not on every machine.

use std::path::PathBuf;

use crate::skipped::skip;

/// A file or folder of the shared data, or `None` and a line that says so.
///
/// It lies in `../shared/data`, or where the environment's `SIZEUP_SHARED_DATA` points.
pub fn shared_data(path: &str) -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let found = std::env::var_os("SIZEUP_SHARED_DATA").map_or_else(beside, PathBuf::from).join(path);
    if found.exists() {
        return Some(found);
    }
    skip(&format!("../shared/data/{path} is not here"));
    None
}
