//! Files that are either whole or absent: write under a temporary name, flush to disk, rename. And files without a name, for what does not fit
//! into memory ([`UnnamedFile`]).

use std::fs;
use std::io::{self, BufWriter, Read, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use crate::limits;

/// A file operation that failed, with the file it failed on.
#[derive(Debug, thiserror::Error)]
#[error("{action} {}", path.display())]
pub struct FileError {
    /// Action, as in "cannot write".
    pub action: &'static str,
    /// The file that was read or written.
    pub path: PathBuf,
    /// Error that the system reported.
    #[source]
    pub source: io::Error,
}

impl FileError {
    /// Whether a file was to be read: then the input is at fault, and not the place of the results.
    #[must_use]
    pub fn is_of_input(&self) -> bool {
        self.action.starts_with("cannot read") || self.action.starts_with("cannot open")
    }

    /// Adapter for `map_err`: `fs::read(path).map_err(FileError::on("cannot read", path))`.
    pub fn on<'a>(action: &'static str, path: &'a Path) -> impl FnOnce(io::Error) -> Self + 'a {
        move |source| Self { action, path: path.to_owned(), source }
    }
}

/// Writes a file through `fill` so that readers see the old file or the whole new one, also after a crash.
///
/// # Errors
/// [`FileError`] when the folder cannot be written, the disk is full, or `fill` fails; the old file then stays.
pub fn write_whole(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), FileError> {
    write_whole_or(path, |out| fill(out).map_err(FileError::on("cannot write", path)))
}

/// Writes anything serialisable as indented JSON with a final newline.
///
/// # Errors
/// As [`write_whole`].
pub fn write_json(path: &Path, value: &(impl Serialize + ?Sized)) -> Result<(), FileError> {
    write_whole(path, |out| {
        serde_json::to_writer_pretty(&mut *out, value)?;
        out.write_all(b"\n")
    })
}

/// Removes a file or a folder with all that is in it; what cannot be removed is left: it is in nobody's way.
pub fn remove_litter(path: &Path) {
    let _ = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
}

/// Like [`write_whole`], where `fill` can fail for reasons of its own.
///
/// # Errors
/// The error of `fill`, or a [`FileError`] turned into it; the old file then stays.
pub fn write_whole_or<E: From<FileError>>(
    path: &Path,
    fill: impl FnOnce(&mut dyn Write) -> Result<(), E>,
) -> Result<(), E> {
    let failed = |e| FileError::on("cannot write", path)(e);
    let mut temporary = temporary_beside(path).map_err(failed)?;
    let mut buffered = BufWriter::with_capacity(1 << 20, temporary.as_file_mut());
    fill(&mut buffered)?;
    buffered.flush().map_err(failed)?;
    drop(buffered);
    persist(temporary, path).map_err(failed)?;
    Ok(())
}

/// Like [`write_whole`], but leaves the flush to disk to the system: for the many files that a repeated run would
/// make again. Readers still see the old file or the whole new one, though not after a power cut.
///
/// # Errors
/// As [`write_whole`].
pub fn write_whole_unflushed(
    path: &Path,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), FileError> {
    let write = || -> io::Result<()> {
        let mut temporary = temporary_beside(path)?;
        let mut buffered = BufWriter::with_capacity(1 << 20, temporary.as_file_mut());
        fill(&mut buffered)?;
        buffered.flush()?;
        drop(buffered);
        temporary.persist(path).map(drop).map_err(|e| e.error)
    };
    write().map_err(FileError::on("cannot write", path))
}

/// Lets an engine that opens files by name (GDAL) write `path` the same way: `fill` gets a temporary path with the
/// same extension in the same folder, renamed to `path` when `fill` succeeds and removed when it does not.
///
/// # Errors
/// The error of `fill`, or a [`FileError`] turned into it.
pub fn write_whole_by_name<E: From<FileError>>(
    path: &Path,
    fill: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let temporary = temporary_beside(path).map_err(FileError::on("cannot write", path))?;
    // The engine wants to create the file itself; our empty one only reserved the name.
    fs::remove_file(temporary.path()).map_err(FileError::on("cannot write", path))?;
    fill(temporary.path())?;
    let finish = || -> io::Result<()> {
        fs::File::open(temporary.path())?.sync_all()?;
        fs::rename(temporary.path(), path)?;
        sync_folder(path)
    };
    finish().map_err(FileError::on("cannot write", path))?;
    Ok(())
}

/// Bytes on disk instead of in memory: written at the end, and read back in any order, by any thread. The file has no name, so nothing is left of
/// it when the process ends, however that happens.
#[derive(Debug)]
pub struct UnnamedFile {
    folder: PathBuf,
    file: Mutex<fs::File>,
}

/// Place of some bytes in an [`UnnamedFile`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stored {
    first_byte: u64,
    n_bytes: usize,
}

impl Stored {
    /// Number of the bytes.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        self.n_bytes
    }
}

impl UnnamedFile {
    /// Makes an empty file in a folder, which is made where there is none.
    ///
    /// # Errors
    /// [`FileError`] when the folder cannot be written.
    pub fn new(folder: &Path) -> Result<Self, FileError> {
        let file = fs::create_dir_all(folder).and_then(|()| tempfile::tempfile_in(folder));
        let file = file.map_err(FileError::on("cannot write into", folder))?;
        Ok(Self { folder: folder.to_owned(), file: Mutex::new(file) })
    }

    /// Writes bytes at the end.
    ///
    /// # Errors
    /// [`FileError`]: above all a full disk.
    pub fn put(&self, bytes: &[u8]) -> Result<Stored, FileError> {
        let mut file = self.file();
        let first_byte = file.seek(SeekFrom::End(0)).and_then(|end| file.write_all(bytes).map(|()| end));
        let first_byte = first_byte.map_err(FileError::on("cannot write into", &self.folder))?;
        Ok(Stored { first_byte, n_bytes: bytes.len() })
    }

    /// Reads bytes back.
    ///
    /// # Errors
    /// [`FileError`], which is never the input's fault.
    pub fn get(&self, at: Stored) -> Result<Vec<u8>, FileError> {
        let (mut bytes, mut file) = (vec![0; at.n_bytes], self.file());
        let read = file.seek(SeekFrom::Start(at.first_byte)).and_then(|_| file.read_exact(&mut bytes));
        read.map_err(|e| self.lost(e))?;
        Ok(bytes)
    }

    /// Reads all bytes from the first one on.
    pub fn reader(&self) -> impl Read + '_ {
        UnnamedReader { of: self, next_byte: 0 }
    }

    /// Error for bytes that do not come back, or not as they were.
    #[must_use]
    pub fn lost(&self, source: io::Error) -> FileError {
        FileError::on("lost a temporary file in", &self.folder)(source)
    }

    fn file(&self) -> MutexGuard<'_, fs::File> {
        self.file.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for &UnnamedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.put(bytes).map(|at| at.n_bytes).map_err(io::Error::other)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Position in an [`UnnamedFile`] that is read from its first byte on.
struct UnnamedReader<'a> {
    of: &'a UnnamedFile,
    next_byte: u64,
}

impl Read for UnnamedReader<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut file = self.of.file();
        let read = file.seek(SeekFrom::Start(self.next_byte)).and_then(|_| file.read(bytes));
        let n_read = read.map_err(|e| io::Error::other(self.of.lost(e)))?;
        self.next_byte += n_read as u64;
        Ok(n_read)
    }
}

/// Reads a whole file of text or bytes, as long as it may be ([`crate::limits`]); also what has no length of its own, such as
/// a pipe, ends there.
///
/// # Errors
/// [`FileError`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let limit = limits::Limits::now().input_bytes();
    let read = || {
        let file = fs::File::open(path)?;
        limits::check(file.metadata()?.len(), None).map_err(io::Error::other)?;
        let mut bytes = Vec::new();
        file.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
        limits::check(bytes.len() as u64, None).map_err(io::Error::other)?;
        Ok(bytes)
    };
    read().map_err(FileError::on("cannot read", path))
}

/// As [`read_bytes`], for a file in UTF-8.
///
/// # Errors
/// [`FileError`].
pub fn read_text(path: &Path) -> Result<String, FileError> {
    let not_text = |e: std::string::FromUtf8Error| io::Error::new(io::ErrorKind::InvalidData, e.utf8_error());
    String::from_utf8(read_bytes(path)?).map_err(not_text).map_err(FileError::on("cannot read", path))
}

/// Whether a path names something inside an archive or on a server (`/vsizip/…`, `/vsicurl/…`, `/vsis3/…`): only GDAL
/// can tell whether it exists.
#[must_use]
pub fn is_virtual(path: &Path) -> bool {
    path.to_str().is_some_and(|path| path.starts_with("/vsi"))
}

fn temporary_beside(path: &Path) -> io::Result<tempfile::NamedTempFile> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let suffix = path.file_name().and_then(|n| n.to_str()).unwrap_or("out");
    sweep_litter_of(folder, suffix);
    let mut builder = tempfile::Builder::new();
    let prefix = partial_prefix();
    builder.prefix(&prefix);
    let suffix = format!("-{suffix}");
    builder.suffix(&suffix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        builder.permissions(fs::Permissions::from_mode(0o644));
    }
    builder.tempfile_in(folder)
}

/// Beginning of the names of half-written files.
const PARTIAL: &str = ".partial-";

/// Beginning, by this process, of the name of a half-written file or folder: with the machine and its own number, so that others
/// can tell whether its writer still lives.
#[must_use]
pub fn partial_prefix() -> String {
    format!("{PARTIAL}{}.{}.", machine(), std::process::id())
}

/// The machine's name without marks that file names could stumble over.
fn machine() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

/// Removes what writers of a file or folder of this name left in a folder when they were killed. Those of other machines
/// stay: whether they live is not known here.
pub fn sweep_litter_of(folder: &Path, name: &str) {
    let own_machine = machine();
    let is_dead = |file: &str| {
        let mut words = file.strip_prefix(PARTIAL)?.splitn(3, '.');
        let (machine, process, rest) = (words.next()?, words.next()?.parse::<u32>().ok()?, words.next()?);
        // The engine may have left a journal beside its file.
        let is_of_name = rest.split_once('-').is_some_and(|(_, of)| of == name || of == format!("{name}-journal"));
        let can_tell = Path::new("/proc/self").exists();
        Some(is_of_name && machine == own_machine && can_tell && !Path::new(&format!("/proc/{process}")).exists())
    };
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if is_dead(&entry.file_name().to_string_lossy()) == Some(true) {
            remove_litter(&entry.path());
        }
    }
}

fn persist(temporary: tempfile::NamedTempFile, path: &Path) -> io::Result<()> {
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|e| e.error)?;
    sync_folder(path)
}

/// Makes the rename itself survive a power cut.
fn sync_folder(path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::File::open(folder)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        write_whole(&path, |w| w.write_all(b"old")).unwrap();
        let failed = write_whole(&path, |w| {
            w.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_a_dead_writer_left_is_swept_and_what_a_living_one_writes_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let partial = |process: u32, of: &str| format!("{PARTIAL}{}.{process}.abc-{of}", machine());
        // Processes have numbers below 2²² on Linux.
        let dead = [partial(u32::MAX, "a.gpkg"), partial(u32::MAX, "a.gpkg-journal")];
        let others = [
            partial(std::process::id(), "a.gpkg"),
            partial(u32::MAX, "b.gpkg"),
            format!("{PARTIAL}elsewhere.1.abc-a.gpkg"),
            "a.gpkg.partial-x".to_owned(),
        ];
        for name in dead.iter().chain(&others) {
            fs::write(folder.path().join(name), "half").unwrap();
        }
        write_whole(&folder.path().join("a.gpkg"), |w| w.write_all(b"whole")).unwrap();
        assert!(dead.iter().all(|name| !folder.path().join(name).exists()));
        assert!(others.iter().all(|name| folder.path().join(name).exists()));
    }

    #[test]
    fn an_unnamed_file_gives_bytes_back_in_any_order_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("new");
        let file = UnnamedFile::new(&inside).unwrap();
        let pieces: [&[u8]; 3] = [b"first", b"", b"third"];
        let places = pieces.map(|piece| file.put(piece).unwrap());
        for k in [2, 0, 1, 0] {
            assert_eq!(file.get(places[k]).unwrap(), pieces[k]);
        }
        let mut reader = file.reader();
        reader.read_exact(&mut [0; 2]).unwrap();
        (&file).write_all(b", and more").unwrap();
        let mut rest = String::new();
        reader.read_to_string(&mut rest).unwrap();
        assert_eq!(rest, "rstthird, and more");
        assert_eq!(fs::read_dir(&inside).unwrap().count(), 0);
    }

    #[test]
    fn an_unnamed_file_that_fails_is_not_the_inputs_fault() {
        let folder = tempfile::tempdir().unwrap();
        let [long, empty] = [0, 1].map(|_| UnnamedFile::new(folder.path()).unwrap());
        let lost = empty.get(long.put(b"long").unwrap()).unwrap_err();
        assert_eq!(lost.action, "lost a temporary file in");
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let cannot_write = UnnamedFile::new(&file).unwrap_err();
        assert_eq!(cannot_write.to_string(), format!("cannot write into {}", file.display()));
        assert!(!lost.is_of_input() && !cannot_write.is_of_input());
    }

    #[test]
    fn writing_by_name_renames_only_on_success() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gpkg");
        let failed: Result<(), FileError> = write_whole_by_name(&path, |temporary| {
            fs::write(temporary, b"half").unwrap();
            Err(FileError { action: "cannot write", path: temporary.to_owned(), source: io::Error::other("no") })
        });
        assert!(failed.is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        write_whole_by_name::<FileError>(&path, |temporary| {
            fs::write(temporary, b"whole").unwrap();
            Ok(())
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }
}
