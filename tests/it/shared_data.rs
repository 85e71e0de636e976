//! Real data beside the repository: not part of it, and not on every machine.

use std::path::PathBuf;

/// A file or folder of the shared data, or `None` and a line that says so.
pub fn shared_data(path: &str) -> Option<PathBuf> {
    let found = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(path);
    if found.exists() {
        return Some(found);
    }
    println!("skipped: ../shared/data/{path} is not here");
    None
}
