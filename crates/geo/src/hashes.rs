//! Contents by their SHA-256, and a memory of them, so that what has not changed is not read again.
//!
//! A file is taken as known while its size, inode, and the times of its last change of content and of status are those at
//! which it was hashed. The time of status is the system's own: no tool can set it back. A file that was changed within
//! the last moments may change again within the same tick of the clock: it is hashed every time until it has settled.

use std::collections::HashMap;
use std::fs::{File, Metadata};
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::files::{FileError, write_whole_unflushed};

/// A file that changed less than this before it was hashed is not taken as known: two seconds is the coarsest clock of a
/// file system in use (FAT).
const SETTLED: Duration = Duration::from_secs(2);

/// SHA-256 of bytes, hexadecimal.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Content of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Content {
    /// Size of the file, bytes.
    pub size_bytes: u64,
    /// SHA-256 of the file's bytes, in hexadecimal.
    pub sha256: String,
}

impl Content {
    /// Content of what is in memory.
    #[must_use]
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self { size_bytes: bytes.len() as u64, sha256: sha256_hex(bytes) }
    }

    /// The 32 bytes of the hash.
    #[must_use]
    pub fn digest(&self) -> Vec<u8> {
        let digits = self.sha256.as_bytes().chunks(2).filter_map(|pair| std::str::from_utf8(pair).ok());
        digits.filter_map(|pair| u8::from_str_radix(pair, 16).ok()).collect()
    }

    /// Reads a file once.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn of(path: &Path) -> io::Result<Self> {
        let mut file = File::open(path)?;
        let mut hasher = Sha256::new();
        let mut buffer = vec![0_u8; 1 << 20];
        let mut size_bytes = 0_u64;
        loop {
            let n = file.read(&mut buffer)?;
            if n == 0 {
                return Ok(Self { size_bytes, sha256: hex(&hasher.finalize()) });
            }
            hasher.update(&buffer[..n]);
            size_bytes += n as u64;
        }
    }
}

/// Two digits a byte, lower case.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        use std::fmt::Write as _;
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Marks that tell a file from a changed one without reading it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Stamp {
    size_bytes: u64,
    inode: u64,
    /// Times of the last change of content and of status, nanoseconds since 1970.
    changed_ns: [i128; 2],
}

impl Stamp {
    fn of(metadata: &Metadata) -> io::Result<Self> {
        let since_1970 = |time: SystemTime| match time.duration_since(SystemTime::UNIX_EPOCH) {
            Ok(after) => after.as_nanos() as i128,
            Err(before) => -(before.duration().as_nanos() as i128),
        };
        let content_ns = since_1970(metadata.modified()?);
        #[cfg(unix)]
        let (inode, status_ns) = {
            use std::os::unix::fs::MetadataExt as _;
            (metadata.ino(), i128::from(metadata.ctime()) * 1_000_000_000 + i128::from(metadata.ctime_nsec()))
        };
        #[cfg(not(unix))]
        let (inode, status_ns) = (0, content_ns);
        Ok(Self { size_bytes: metadata.len(), inode, changed_ns: [content_ns, status_ns] })
    }

    /// Whether no change can hide behind the clock's tick.
    fn is_settled(&self, now: SystemTime) -> bool {
        let limit = now.checked_sub(SETTLED).and_then(|at| at.duration_since(SystemTime::UNIX_EPOCH).ok());
        limit.is_some_and(|limit| self.changed_ns.iter().all(|&ns| ns < limit.as_nanos() as i128))
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct KnownHash {
    stamp: Stamp,
    sha256: String,
}

/// Files whose content is known.
#[derive(Debug, Default)]
pub struct Hashes {
    known: Mutex<HashMap<PathBuf, KnownHash>>,
    /// Files that were read since this memory was made.
    read: Mutex<HashMap<PathBuf, u64>>,
}

impl Hashes {
    /// A memory of hashes that knows no file yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds what an earlier process left behind; a file that is missing or no such list adds nothing.
    pub fn load(&self, path: &Path) {
        let Ok(file) = File::open(path) else { return };
        let found: HashMap<PathBuf, KnownHash> = serde_json::from_reader(BufReader::new(file)).unwrap_or_default();
        self.known().extend(found);
    }

    /// Leaves what is known of some files behind for others.
    ///
    /// # Errors
    /// [`FileError`] where it cannot be written.
    pub fn save<'a>(&self, path: &Path, files: impl Iterator<Item = &'a Path>) -> Result<(), FileError> {
        let known = self.known();
        let of_files: std::collections::BTreeMap<&Path, &KnownHash> =
            files.filter_map(|file| Some((file, known.get(file)?))).collect();
        write_whole_unflushed(path, |out| Ok(serde_json::to_writer(out, &of_files)?))
    }

    /// Content of a file; it is read only where that is not known.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn of(&self, path: &Path) -> io::Result<Content> {
        let stamp = Stamp::of(&std::fs::metadata(path)?)?;
        if let Some(known) = self.known().get(path).filter(|known| known.stamp == stamp) {
            return Ok(Content { size_bytes: stamp.size_bytes, sha256: known.sha256.clone() });
        }
        let now = SystemTime::now();
        let content = Content::of(path)?;
        *self.read().entry(path.to_owned()).or_default() += content.size_bytes;
        let after = Stamp::of(&std::fs::metadata(path)?)?;
        if stamp == after && stamp.is_settled(now) {
            self.known().insert(path.to_owned(), KnownHash { stamp, sha256: content.sha256.clone() });
        }
        Ok(content)
    }

    /// The files whose content is known, sorted.
    #[must_use]
    pub fn paths(&self) -> Vec<PathBuf> {
        let mut paths: Vec<PathBuf> = self.known().keys().cloned().collect();
        paths.sort();
        paths
    }

    /// Bytes that were read to learn what files hold.
    #[must_use]
    pub fn n_bytes_read(&self) -> u64 {
        self.read().values().sum()
    }

    fn known(&self) -> MutexGuard<'_, HashMap<PathBuf, KnownHash>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn read(&self) -> MutexGuard<'_, HashMap<PathBuf, u64>> {
        self.read.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, FileTimes};

    use super::*;

    #[test]
    fn hashes_are_sha256() {
        // FIPS 180-2, appendix B.1.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256_hex(b"abc"), abc);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc");
        fs::write(&path, b"abc").unwrap();
        let content = Content::of(&path).unwrap();
        assert_eq!(content, Content { size_bytes: 3, sha256: abc.to_owned() });
        assert_eq!(hex(&content.digest()), abc);
    }

    fn set_time(path: &Path, time: SystemTime) {
        File::options().append(true).open(path).unwrap().set_times(FileTimes::new().set_modified(time)).unwrap();
    }

    /// As of a file that was made long ago.
    fn known_of(path: &Path) -> Hashes {
        let hashes = Hashes::new();
        let stamp = Stamp::of(&fs::metadata(path).unwrap()).unwrap();
        let sha256 = Content::of(path).unwrap().sha256;
        hashes.known().insert(path.to_owned(), KnownHash { stamp, sha256 });
        hashes
    }

    #[test]
    fn a_file_that_has_not_changed_is_not_read_again_also_by_another_process() {
        let folder = tempfile::tempdir().unwrap();
        let (path, list) = (folder.path().join("a"), folder.path().join("hashes.json"));
        fs::write(&path, "first").unwrap();
        let hashes = known_of(&path);
        assert_eq!(hashes.of(&path).unwrap().sha256, sha256_hex(b"first"));
        hashes.save(&list, std::iter::once(path.as_path())).unwrap();
        let other = Hashes::new();
        other.load(&list);
        assert_eq!(other.of(&path).unwrap().sha256, sha256_hex(b"first"));
        assert_eq!((hashes.n_bytes_read(), other.n_bytes_read()), (0, 0));
    }

    #[test]
    fn a_change_is_found_though_size_and_time_are_those_of_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "first").unwrap();
        let time = fs::metadata(&path).unwrap().modified().unwrap();
        let hashes = known_of(&path);
        // As `rsync --inplace --times` or `touch -r` leave it.
        std::thread::sleep(Duration::from_millis(20));
        fs::write(&path, "other").unwrap();
        set_time(&path, time);
        assert_eq!(hashes.of(&path).unwrap().sha256, sha256_hex(b"other"));
    }

    #[test]
    fn a_file_that_was_just_changed_is_read_every_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "first").unwrap();
        let hashes = Hashes::new();
        hashes.of(&path).unwrap();
        hashes.of(&path).unwrap();
        assert_eq!(hashes.n_bytes_read(), 10);
    }
}
