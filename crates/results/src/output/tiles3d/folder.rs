//! A folder that is either whole or absent: filled under a temporary name, then renamed.

use std::path::Path;
use std::{fs, io};

use super::super::OutputError;
use sizeup_geo::files::{FileError, partial_prefix, sweep_litter_of};

/// The file that makes a folder a tileset.
pub const TILESET: &str = "tileset.json";

/// Fills a folder through `fill`, flushes it to disk and puts it in place. One that stands there, told by a file `mark` in it, is exchanged for
/// it in one step, so that at every moment there is the old one or the new one; where the file system cannot exchange
/// (network drives), in two, with none for an instant between them.
///
/// # Errors
/// [`OutputError::FolderInUse`] for a folder with other files, the error of `fill`, or of the file system.
pub fn write_whole(
    path: &Path,
    mark: &str,
    fill: impl FnOnce(&Path) -> Result<(), OutputError>,
) -> Result<(), OutputError> {
    let failed = |e| FileError::on("cannot write", path)(e);
    let is_replaceable = path.join(mark).is_file() || is_empty_folder(path);
    if path.exists() && !is_replaceable {
        return Err(OutputError::FolderInUse { path: path.to_owned() });
    }
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(parent).map_err(failed)?;
    let name = path.file_name().map_or_else(|| "out".to_owned(), |name| name.to_string_lossy().into_owned());
    sweep_litter_of(parent, &name);
    let (prefix, suffix) = (partial_prefix(), format!("-{name}"));
    let work = tempfile::Builder::new().prefix(&prefix).suffix(&suffix).tempdir_in(parent).map_err(failed)?;
    let (new, old) = (work.path().join("new"), work.path().join("old"));
    fs::create_dir(&new).map_err(failed)?;
    fill(&new)?;
    flush(&new).map_err(failed)?;
    if !path.exists() {
        fs::rename(&new, path).map_err(failed)?;
    } else if exchange(&new, path).is_err() {
        fs::rename(path, &old).and_then(|()| fs::rename(&new, path)).map_err(failed)?;
    }
    fs::File::open(parent).and_then(|folder| folder.sync_all()).map_err(failed)?;
    Ok(())
}

/// Lets two paths change places in one step, where the system can.
#[cfg(any(target_os = "linux", target_vendor = "apple"))]
fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

#[cfg(not(any(target_os = "linux", target_vendor = "apple")))]
fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Flushes a folder and all in it to disk.
fn flush(path: &Path) -> io::Result<()> {
    if path.is_dir() {
        fs::read_dir(path)?.try_for_each(|entry| flush(&entry?.path()))?;
    }
    fs::File::open(path)?.sync_all()
}

fn is_empty_folder(path: &Path) -> bool {
    fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tileset_is_exchanged_while_its_readers_never_miss_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("city");
        let write = |n: usize| {
            write_whole(&path, TILESET, |new| {
                fs::create_dir(new.join("tiles")).unwrap();
                fs::write(new.join("tiles/r.glb"), n.to_string()).unwrap();
                fs::write(new.join(TILESET), n.to_string()).unwrap();
                Ok(())
            })
        };
        write(0).unwrap();
        let is_done = std::sync::atomic::AtomicBool::new(false);
        let n_missed = std::thread::scope(|scope| {
            let reader = scope.spawn(|| {
                let mut n_missed = 0;
                while !is_done.load(std::sync::atomic::Ordering::Relaxed) {
                    n_missed += usize::from(!path.join(TILESET).is_file());
                }
                n_missed
            });
            (1..200).for_each(|n| write(n).unwrap());
            is_done.store(true, std::sync::atomic::Ordering::Relaxed);
            reader.join().unwrap()
        });
        assert_eq!(fs::read_to_string(path.join("tiles/r.glb")).unwrap(), "199");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no litter");
        let other = tempfile::tempdir_in(folder.path()).unwrap();
        if exchange(other.path(), &path).is_ok() {
            assert_eq!(n_missed, 0, "at every moment there is a tileset");
        }
    }

    #[test]
    fn a_folder_of_other_things_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("thesis.txt"), "years").unwrap();
        assert!(write_whole(folder.path(), TILESET, |_| Ok(())).is_err());
        assert_eq!(fs::read_to_string(folder.path().join("thesis.txt")).unwrap(), "years");
    }
}
