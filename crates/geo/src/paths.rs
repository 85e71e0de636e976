//! Paths of a configuration: relative to its file when they are read, and to the results when they are saved beside them.
//!
//! A path that was relative in the file belongs to the project: it is saved relative to the folder of the results where
//! these lie in the configuration's folder or beside it, so that the whole can be moved. All other paths are saved as
//! absolute ones, so that results elsewhere still find their input.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

/// Action on each path of some settings.
pub type PathVisitor<'a> = &'a mut dyn FnMut(&mut PathBuf);

/// Visits a path with placeholders, which is text.
pub fn visit_template(template: &mut String, visit: PathVisitor<'_>) {
    let mut path = PathBuf::from(std::mem::take(template));
    visit(&mut path);
    *template = path.to_string_lossy().into_owned();
}

/// A path of a file in `folder`; absolute ones stay.
#[must_use]
pub fn resolved(folder: &Path, path: &Path) -> PathBuf {
    if path == Path::new(".") && !folder.as_os_str().is_empty() { folder.to_owned() } else { folder.join(path) }
}

/// The last part of a path out of a file that any system may have written; all of it where it ends in a separator or has
/// none.
#[must_use]
pub fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().filter(|name| !name.is_empty()).unwrap_or(path)
}

/// A name out of a file as a path that stays in the folder it is joined to: relative, and without `..`; `None` for any
/// other. Every name that a file brings goes through here before it becomes part of a path.
#[must_use]
pub fn within(name: &str) -> Option<&Path> {
    let path = Path::new(name);
    let is_plain = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    // Windows would split at `\\` and take what stands before `:` for a drive.
    let is_foreign = |part: &str| part == ".." || part.contains('\0');
    let is_name = path.components().any(|part| matches!(part, Component::Normal(_)));
    let stays = path.components().all(is_plain) && !name.split(['/', '\\']).any(is_foreign);
    (is_name && stays).then_some(path)
}

/// As [`within`], for a name that is one file or folder: without folders of its own.
#[must_use]
pub fn single(name: &str) -> Option<&Path> {
    within(name).filter(|path| path.components().count() == 1 && !name.contains(['/', '\\', ':']))
}

/// The folder of a configuration and the paths that were relative to it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct OwnPaths {
    folder: PathBuf,
    /// Resolved; of those with placeholders what stands before the first.
    own: BTreeSet<PathBuf>,
}

impl OwnPaths {
    /// Paths of a configuration in `folder`.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), own: BTreeSet::new() }
    }

    /// Resolves a path of the configuration.
    pub fn resolve(&mut self, path: &mut PathBuf) {
        let is_own = path.is_relative() && !path.as_os_str().is_empty();
        *path = resolved(&self.folder, path);
        if is_own {
            let is_plain = |part: &Component<'_>| !part.as_os_str().to_string_lossy().contains('{');
            self.own.insert(path.components().take_while(is_plain).collect());
        }
    }

    /// Form of a path beside results in the folder `result`.
    #[must_use]
    pub fn saved(&self, path: &Path, result: &Path) -> PathBuf {
        let is_own = self.own.iter().any(|own| path.starts_with(own));
        if path.as_os_str().is_empty() || (path.is_absolute() && !is_own) {
            return path.to_owned();
        }
        let [Some(full), Some(result), Some(home)] = [path, result, &self.folder].map(full) else {
            return path.to_owned();
        };
        // A folder at the root has everything beside it.
        let around = home.parent().filter(|around| around.parent().is_some()).unwrap_or(&home);
        let moves_along = result.starts_with(around);
        if is_own && moves_along { relative(&full, &result) } else { full }
    }

    /// The path whose form beside results in the folder `result` this is: the other way round.
    #[must_use]
    pub fn found(&self, saved: &Path, result: &Path) -> PathBuf {
        let of_own = |own: &PathBuf| {
            let rest = saved.strip_prefix(self.saved(own, result)).ok()?;
            Some(if rest.as_os_str().is_empty() { own.clone() } else { own.join(rest) })
        };
        self.own.iter().find_map(of_own).unwrap_or_else(|| result.join(saved))
    }
}

/// Name of a path in a file in `folder`: relative where both lie in one place, else from the root.
#[must_use]
pub fn named_from(folder: &Path, path: &Path) -> PathBuf {
    let (Some(to), Some(from)) = (full(path), full(folder)) else { return path.to_owned() };
    // What two paths share of a root says nothing of their belonging together.
    let n_shared = to.components().zip(from.components()).take_while(|(a, b)| a == b).count();
    let n_own = from.components().filter(|part| matches!(part, Component::Normal(_))).count();
    let is_one_place = n_shared > 1 || n_own <= 1;
    if is_one_place { relative(&to, &from) } else { to }
}

/// An absolute path without `.` and `..`, by its text alone.
fn full(path: &Path) -> Option<PathBuf> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let mut full = PathBuf::new();
    for part in std::path::absolute(path).ok()?.components() {
        match part {
            Component::ParentDir => drop(full.pop()),
            Component::CurDir => {}
            part => full.push(part),
        }
    }
    Some(full)
}

/// The way from a folder to a path, both absolute; the path itself where they have nothing in common.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let n_common = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    if n_common == 0 {
        return path.to_owned();
    }
    let up = folder.components().skip(n_common).map(|_| Component::ParentDir);
    let way: PathBuf = up.chain(path.components().skip(n_common)).collect();
    if way.as_os_str().is_empty() { PathBuf::from(".") } else { way }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn saved(folder: &str, path: &str, result: &str) -> String {
        let (mut own, mut path) = (OwnPaths::new(Path::new(folder)), PathBuf::from(path));
        own.resolve(&mut path);
        let saved = own.saved(&path, Path::new(result));
        // A file below it, too, is found again by the very path that it had.
        for file in [path.clone(), path.join("a.jpg")] {
            assert_eq!(own.found(&own.saved(&file, Path::new(result)), Path::new(result)), file);
        }
        saved.display().to_string()
    }

    #[test]
    fn the_name_of_a_file_is_the_last_part_of_a_path_of_any_system() {
        for path in ["C:\\flight\\a b.jpg", "/flight/a b.jpg", "a b.jpg", "C:\\flight/a b.jpg"] {
            assert_eq!(file_name(path), "a b.jpg");
        }
        assert_eq!((file_name("folder/"), file_name("")), ("folder/", ""));
    }

    #[test]
    fn names_that_leave_their_folder_are_none() {
        for name in ["a.jpg", "flight 1/a.jpg", "./a", "a..b/c", "ä.tif", "C:a"] {
            assert_eq!(within(name), Some(Path::new(name)));
        }
        for name in ["..", "../a", "a/../../b", "/etc/passwd", "", ".", "..\\a", "a\\..\\..\\b", "a\0b"] {
            assert_eq!(within(name), None, "{name:?}");
        }
        assert!(single("e0_n0").is_some());
        for name in ["a/b", "./a", "a\\b", "C:a", "..", ""] {
            assert_eq!(single(name), None, "{name:?}");
        }
    }

    #[test]
    fn what_lies_with_the_configuration_is_found_from_the_results() {
        assert_eq!(saved("/town", "sparse/0", "/town/result"), "../sparse/0");
        assert_eq!(saved("/town", "sparse", "/town/out/a"), "../../sparse");
        assert_eq!(saved("/town/scene", "dtm.tif", "/town/result"), "../scene/dtm.tif");
        assert_eq!(saved("/town", "../photos/{stem}.npy", "/town/result"), "../../photos/{stem}.npy");
        assert_eq!(saved("/town", ".", "/town"), ".");
        // The same whatever folder the command was given in.
        assert_eq!(saved("town", "sparse", "town/result"), "../sparse");
        assert_eq!(saved("", "sparse", "result"), "../sparse");
    }

    #[test]
    fn saving_what_was_saved_changes_nothing() {
        assert_eq!(saved("/town/result", "../sparse/0", "/town/result"), "../sparse/0");
        assert_eq!(saved("/town/result", "/far/photos", "/town/result"), "/far/photos");
    }

    #[test]
    fn paths_that_do_not_move_along_are_absolute() {
        assert_eq!(saved("/town", "sparse", "/scratch/run"), "/town/sparse");
        assert_eq!(saved("/town", "/photos/{stem}.npy", "/town/result"), "/photos/{stem}.npy");
        assert_eq!(saved("/town", "/vsizip/a.zip/b", "/town/result"), "/vsizip/a.zip/b");
    }

    #[test]
    fn a_file_names_what_lies_near_by_a_relative_path() {
        let named = |folder: &str, path: &str| named_from(Path::new(folder), Path::new(path)).display().to_string();
        assert_eq!(named("/town", "/town/photos/a"), "photos/a");
        assert_eq!(named("/town", "/town"), ".");
        assert_eq!(named("/home/me/town", "/home/me/photos"), "../photos");
        assert_eq!(named("/home/me", "/media/card/DCIM"), "/media/card/DCIM");
        assert_eq!(named("", "photos/../dtm.tif"), "dtm.tif");
    }

    #[test]
    fn files_below_an_own_path_are_own() {
        let mut own = OwnPaths::new(Path::new("/town"));
        own.resolve(&mut PathBuf::from("priors/{stem}.npy"));
        assert_eq!(
            own.saved(Path::new("/town/priors/001.npy"), Path::new("/town/result")),
            Path::new("../priors/001.npy")
        );
        assert_eq!(own.saved(Path::new("/town/else"), Path::new("/town/result")), Path::new("/town/else"));
    }
}
