//! A mark in a folder of results while they are made: laid before anything in it changes, taken away after the last.
//!
//! Each file is whole or absent, but a writer that is killed before its end leaves results of an earlier one, or between
//! two files of its own those of both, side by side. The mark that it leaves too says so to whoever reads them.
//!
//! While a writer lives it holds the folder's lock, and a second one is refused.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use crate::files::{FileError, read_text, write_whole};
use crate::lock::Lock;

/// Name of the file that marks a folder of unfinished results.
pub const NAME: &str = "UNFINISHED.txt";

/// The first line of a mark whose writer has replaced nothing yet.
const STARTED: &str = "a run was started and has not come to its end: what else is here is of an earlier one";
/// The first line from then on.
const REPLACING: &str =
    "these results may be of two runs: they were being replaced, and the writer has not come to its end";

/// A folder whose results are being made. Dropped without [`Self::finish`] or [`Self::withdraw`], the mark stays.
#[derive(Debug)]
#[must_use = "the mark stays until the results are finished"]
pub struct Unfinished {
    path: PathBuf,
    command: String,
    /// The mark as it is now.
    text: String,
    /// The mark of an earlier writer that had begun to replace results.
    before: Option<String>,
    /// The folder and those above it that were not there before, the innermost first.
    made: Vec<PathBuf>,
    is_replacing: bool,
    /// `None` where the file system has no locks.
    #[cfg_attr(not(test), expect(dead_code, reason = "held until it is dropped"))]
    lock: Option<Lock>,
}

impl Unfinished {
    /// Lays the mark before anything is computed: results that are in the folder are of an earlier writer.
    ///
    /// # Errors
    /// [`FileError`] where the folder cannot be written, or another writer is still at it.
    pub fn start(folder: &Path, command: &str) -> Result<Self, FileError> {
        let made = made_with(folder)?;
        let lock = Lock::of_folder(folder).map_err(|_| FileError {
            action: "cannot write into",
            path: folder.to_owned(),
            source: held(&folder.join(NAME)),
        })?;
        Self::lay(folder, command, made, lock)
    }

    /// Lays the mark of a writer that replaces no results, so that several may work at once: each of their files is written whole.
    ///
    /// # Errors
    /// [`FileError`] where the folder cannot be written.
    pub fn start_beside_others(folder: &Path, command: &str) -> Result<Self, FileError> {
        let made = made_with(folder)?;
        Self::lay(folder, command, made, None)
    }

    fn lay(folder: &Path, command: &str, made: Vec<PathBuf>, lock: Option<Lock>) -> Result<Self, FileError> {
        let path = folder.join(NAME);
        let mut mark = Self {
            lock,
            made,
            command: command.to_owned(),
            text: String::new(),
            before: read_text(&path).ok().filter(|text| text.starts_with(REPLACING)),
            is_replacing: false,
            path,
        };
        mark.say(STARTED)?;
        Ok(mark)
    }

    /// Lays the mark before the first result is replaced.
    ///
    /// # Errors
    /// [`FileError`] where the folder cannot be written.
    pub fn begin(folder: &Path, command: &str) -> Result<Self, FileError> {
        let mut mark = Self::start(folder, command)?;
        mark.replace()?;
        Ok(mark)
    }

    /// Says in the mark that from now on results are replaced, one after the other.
    ///
    /// # Errors
    /// [`FileError`] where the folder cannot be written.
    pub fn replace(&mut self) -> Result<(), FileError> {
        self.is_replacing = true;
        self.say(REPLACING)
    }

    /// Whether results may have been replaced.
    #[must_use]
    pub fn is_replacing(&self) -> bool {
        self.is_replacing
    }

    fn say(&mut self, what: &str) -> Result<(), FileError> {
        let process = std::process::id();
        let command = &self.command;
        let text = format!("{what}\nUnless process {process} is still at it, do it again: {command}\n");
        write_whole(&self.path, |out| out.write_all(text.as_bytes()))?;
        self.text = text;
        Ok(())
    }

    /// Takes the mark away: the results are whole. Another writer's that came since stays.
    ///
    /// # Errors
    /// [`FileError`] where it cannot be removed.
    pub fn finish(self) -> Result<(), FileError> {
        if self.is_own() { self.remove() } else { Ok(()) }
    }

    /// Leaves things as they were found, where no result was replaced: with the mark of an earlier writer that had begun to,
    /// or without, and without a folder that was made for the mark alone.
    ///
    /// # Errors
    /// [`FileError`] where it cannot be written or removed.
    pub fn withdraw(self) -> Result<(), FileError> {
        if !self.is_own() {
            return Ok(());
        }
        if let Some(before) = &self.before {
            return write_whole(&self.path, |out| out.write_all(before.as_bytes()));
        }
        self.remove()?;
        // The first that holds something ends it.
        let _ = self.made.iter().try_for_each(fs::remove_dir);
        Ok(())
    }

    fn is_own(&self) -> bool {
        read_text(&self.path).is_ok_and(|text| text == self.text)
    }

    fn remove(&self) -> Result<(), FileError> {
        match fs::remove_file(&self.path) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(FileError::on("cannot remove", &self.path)(e)),
            _ => Ok(()),
        }
    }
}

/// Who is still at it, by the mark that they laid.
/// Makes a folder; those above it that had to be made, too, itself first.
fn made_with(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let made = folder.ancestors().take_while(|f| !f.as_os_str().is_empty() && !f.exists()).map(Into::into).collect();
    fs::create_dir_all(folder).map_err(FileError::on("cannot create", folder))?;
    Ok(made)
}

fn held(mark: &Path) -> io::Error {
    let text = read_text(mark).unwrap_or_default();
    let writer = text.lines().nth(1).and_then(|line| {
        let (process, command) = line.strip_prefix("Unless ")?.split_once(" is still at it, do it again: ")?;
        Some(format!("{process} (`{command}`)"))
    });
    let writer = writer.unwrap_or_else(|| "another process".to_owned());
    let hint = "wait until it has ended, or name another folder with `--output FOLDER`";
    io::Error::new(ErrorKind::ResourceBusy, format!("{writer} is still writing its results there\nhint: {hint}"))
}

/// The first line of a mark on results: of a folder's, or of those of the folder that a file of results lies in.
/// `None` where they are finished.
#[must_use]
pub fn told_of(path: &Path) -> Option<String> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let mark = folder.join(NAME);
    let text = mark.is_file().then(|| read_text(&mark).unwrap_or_default())?;
    let line = text.lines().next().filter(|line| !line.is_empty());
    Some(line.unwrap_or("their writer has not come to its end").to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_marked_until_they_are_finished() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("city.gpkg");
        let mark = Unfinished::begin(folder.path(), "sizeup run").unwrap();
        assert!([folder.path(), &file].iter().all(|path| told_of(path).unwrap().contains("may be of two runs")));
        mark.finish().unwrap();
        assert_eq!(told_of(&file), None);
        drop(Unfinished::start(folder.path(), "sizeup run").unwrap());
        assert!(told_of(&file).unwrap().contains("of an earlier one"));
    }

    #[test]
    fn a_writer_that_replaced_nothing_leaves_what_it_found() {
        let folder = tempfile::tempdir().unwrap();
        let results = folder.path().join("of").join("a run");
        Unfinished::start(&results, "sizeup run").unwrap().withdraw().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nor folders");

        drop(Unfinished::begin(&results, "the first").unwrap());
        let text = fs::read_to_string(results.join(NAME)).unwrap();
        Unfinished::start(&results, "the second").unwrap().withdraw().unwrap();
        assert_eq!(fs::read_to_string(results.join(NAME)).unwrap(), text, "the first had begun to");

        fs::remove_file(results.join(NAME)).unwrap();
        drop(Unfinished::start(&results, "the first").unwrap());
        Unfinished::start(&results, "the second").unwrap().withdraw().unwrap();
        assert_eq!(told_of(&results), None, "the first had not");
    }

    #[test]
    fn a_mark_of_a_later_writer_stays() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = Unfinished::start(folder.path(), "the first").unwrap();
        let refused = Unfinished::begin(folder.path(), "the second").unwrap_err();
        assert!(refused.source.to_string().contains("(`the first`) is still writing"), "{}", refused.source);
        // As on a file system without locks.
        first.lock = None;
        let second = Unfinished::begin(folder.path(), "the second").unwrap();
        first.finish().unwrap();
        assert!(told_of(folder.path()).is_some());
        second.finish().unwrap();
        assert!(told_of(folder.path()).is_none());
    }
}
