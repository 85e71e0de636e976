//! One writer at a time, of a tile or of a folder of results: an advisory lock that the system gives back when its holder ends,
//! however it ends.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use crate::files::FileError;

/// A lock that is held until it is dropped, or its process ends. The file stays: removing it would let two others hold
/// two files of the same name.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

/// Somebody else holds the lock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Held;

impl Lock {
    /// Takes the lock, waiting for its holder if there is one; `wait` is told who that is.
    ///
    /// # Errors
    /// [`FileError`] where the file system has no locks or cannot be written.
    pub fn take(path: &Path, wait: &dyn Fn(&str)) -> Result<Self, FileError> {
        let failed = |e| FileError::on("cannot lock", path)(e);
        let mut file = open(path)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                wait(&holder(&mut file));
                file.lock().map_err(failed)?;
            }
            Err(TryLockError::Error(e)) => return Err(failed(e)),
        }
        let own = format!("process {}\n", std::process::id());
        file.rewind().and_then(|()| file.set_len(0)).and_then(|()| file.write_all(own.as_bytes())).map_err(failed)?;
        Ok(Self { _file: file })
    }

    /// Takes the lock of a folder, where nobody holds it; it leaves no file. `None` on file systems that have no locks on folders.
    ///
    /// # Errors
    /// [`Held`].
    pub fn of_folder(folder: &Path) -> Result<Option<Self>, Held> {
        let Ok(file) = File::open(folder) else { return Ok(None) };
        match file.try_lock() {
            Ok(()) => Ok(Some(Self { _file: file })),
            Err(TryLockError::WouldBlock) => Err(Held),
            Err(TryLockError::Error(_)) => Ok(None),
        }
    }

    /// Who holds a lock, if anybody does.
    #[must_use]
    pub fn holder_of(path: &Path) -> Option<String> {
        let mut file = File::open(path).ok()?;
        match file.try_lock_shared() {
            Err(TryLockError::WouldBlock) => Some(holder(&mut file)),
            Ok(()) | Err(TryLockError::Error(_)) => None,
        }
    }
}

fn open(path: &Path) -> Result<File, FileError> {
    let folder = path.parent().map_or_else(PathBuf::new, Path::to_owned);
    std::fs::create_dir_all(&folder).map_err(FileError::on("cannot create", &folder))?;
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    options.open(path).map_err(FileError::on("cannot lock", path))
}

fn holder(file: &mut File) -> String {
    let mut text = String::new();
    match file.read_to_string(&mut text) {
        Ok(_) if !text.trim().is_empty() => text.trim().to_owned(),
        _ => "another process".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_holder_and_nothing_is_left_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let first = Lock::of_folder(folder.path()).unwrap();
        assert!(first.is_some(), "this system has locks");
        assert_eq!(Lock::of_folder(folder.path()).unwrap_err(), Held);
        drop(first);
        assert!(Lock::of_folder(folder.path()).is_ok());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_lock_is_held_by_one_and_free_afterwards() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("locks").join("a");
        let first = Lock::take(&path, &|_| panic!("nobody holds it")).unwrap();
        assert_eq!(Lock::holder_of(&path), Some(format!("process {}", std::process::id())));
        let waited = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            let second = scope.spawn(|| {
                Lock::take(&path, &|_| waited.store(true, std::sync::atomic::Ordering::SeqCst)).unwrap();
            });
            while !waited.load(std::sync::atomic::Ordering::SeqCst) {
                std::thread::yield_now();
            }
            drop(first);
            second.join().unwrap();
        });
        assert_eq!(Lock::holder_of(&path), None);
    }
}
