//! A folder that is either whole or absent: filled under a temporary name, then renamed.

use std::fs;
use std::path::Path;

use super::super::OutputError;
use crate::files::FileError;

/// The file that makes a folder a tileset.
pub const TILESET: &str = "tileset.json";

/// Fills a folder through `fill`. A tileset that stands there is replaced by two renames: at every moment there is the
/// old one, the new one, or for an instant none, never a mixture.
///
/// # Errors
/// [`OutputError::FolderInUse`] for a folder with other files, the error of `fill`, or of the file system.
pub fn write_whole(path: &Path, fill: impl FnOnce(&Path) -> Result<(), OutputError>) -> Result<(), OutputError> {
    let failed = |e| FileError::on("cannot write", path)(e);
    let is_replaceable = path.join(TILESET).is_file() || is_empty_folder(path);
    if path.exists() && !is_replaceable {
        return Err(OutputError::FolderInUse { path: path.to_owned() });
    }
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(parent).map_err(failed)?;
    let work = tempfile::Builder::new().prefix(".partial-").tempdir_in(parent).map_err(failed)?;
    let (new, old) = (work.path().join("new"), work.path().join("old"));
    fs::create_dir(&new).map_err(failed)?;
    fill(&new)?;
    if path.exists() {
        fs::rename(path, &old).map_err(failed)?;
    }
    fs::rename(&new, path).map_err(failed)?;
    fs::File::open(parent).and_then(|folder| folder.sync_all()).map_err(failed)?;
    Ok(())
}

fn is_empty_folder(path: &Path) -> bool {
    fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none())
}
