//! Matching poses to photo files by name.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::{SurveyError, View, whole};
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::may_be_asked;
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::template;

/// Extensions of files that are photos, lower case.
const PHOTO_EXTENSIONS: [&str; 8] = ["jpg", "jpeg", "tif", "tiff", "png", "webp", "jp2", "dng"];
/// Folders nested deeper than this are not a photo collection but a loop of links.
const MAX_DEPTH: usize = 16;

/// The photos below a folder, by path, sorted; one photo stands for itself.
///
/// # Errors
/// [`FileError`] when the folder cannot be read.
pub(crate) fn list(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    if folder.is_file() {
        return Ok(vec![folder.to_owned()]);
    }
    let mut photos = Vec::new();
    collect(folder, 0, &mut photos)?;
    photos.sort();
    Ok(photos)
}

fn collect(folder: &Path, depth: usize, photos: &mut Vec<PathBuf>) -> Result<(), FileError> {
    for entry in fs::read_dir(folder).map_err(FileError::on("cannot read folder", folder))? {
        let path = entry.map_err(FileError::on("cannot read folder", folder))?.path();
        if path.is_dir() {
            if depth < MAX_DEPTH && !is_result(&path) {
                collect(&path, depth + 1, photos)?;
            }
        } else if is_photo(&path) {
            photos.push(path);
        }
    }
    Ok(())
}

/// Whether a folder holds results of sizeup, whose pictures are no photos.
#[must_use]
pub fn is_result(folder: &Path) -> bool {
    folder.join("survey.json").is_file() && folder.join("stages").is_dir()
}

/// Whether a file is a map rather than a photo: a raster that says where on the earth it lies.
pub(crate) fn is_map(path: &Path) -> bool {
    let may_be = path.extension().is_some_and(|e| ["tif", "tiff", "jp2"].iter().any(|map| e.eq_ignore_ascii_case(map)));
    may_be && RasterFile::open(path).is_ok_and(|file| file.grid().is_ok() && file.crs().is_ok_and(|crs| crs.is_some()))
}

/// Whether a path has a photo's extension.
#[must_use]
pub fn is_photo(path: &Path) -> bool {
    path.extension()
        .and_then(|e| e.to_str())
        .is_some_and(|e| PHOTO_EXTENSIONS.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// Gives each view its photo: by relative path, else by file name, else by file stem (Metashape labels lack the
/// extension), where that is unique. Poses without a photo, photos without a pose and photos whose files are damaged become
/// issues.
pub(crate) fn attach(
    views: &mut [View],
    already_refused: &BTreeSet<String>,
    folder: &Path,
) -> Result<Vec<Issue>, FileError> {
    let files = list(folder)?;
    let by_path: BTreeMap<&Path, usize> =
        files.iter().enumerate().filter_map(|(i, path)| Some((path.strip_prefix(folder).ok()?, i))).collect();
    let by_name = unique(&files, |path| path.file_name());
    let by_stem = unique(&files, |path| path.file_stem());
    let find = |name: &str| {
        let path = Path::new(name);
        let by_path = by_path.get(path).copied();
        by_path
            .or_else(|| by_name.get(path.file_name()?).copied().flatten())
            .or_else(|| by_stem.get(path.file_name()?).copied().flatten())
    };
    let mut issues = Vec::new();
    let mut is_used = vec![false; files.len()];
    for view in &mut *views {
        if let Some(i) = find(&view.id.0) {
            is_used[i] = true;
            view.image = Some(files[i].clone());
        } else {
            let subject = Subject::View(view.id.0.clone());
            let name = Path::new(&view.id.0).file_name();
            let (code, message, hint) = if name.is_some_and(|name| matches!(by_name.get(name), Some(None))) {
                let message = format!("several photos in {} have this name", folder.display());
                ("duplicate_photo_name", message, "name the photos by their folder too, as in `flight1/IMG_1.jpg`")
            } else {
                let message = format!("there is no photo of this name in {}", folder.display());
                ("pose_without_photo", message, "check `images`; the view is used as far as it needs no pixels")
            };
            issues.push(Issue::new(Severity::Warning, code, subject, message).hint(hint));
        }
    }
    issues.extend(whole::check(views));
    for name in already_refused {
        if let Some(i) = find(name) {
            is_used[i] = true;
        }
    }
    for (path, _) in files.iter().zip(is_used).filter(|(path, used)| !used && !is_map(path)) {
        let name = path.strip_prefix(folder).unwrap_or(path).to_string_lossy().into_owned();
        let message = "the survey has no pose for this photo".to_owned();
        issues.push(
            Issue::new(Severity::Refused, "photo_without_pose", Subject::View(name), message).hint(
                "if its pose was left out of the export, export it again; photos that were not aligned have none",
            ),
        );
    }
    Ok(issues)
}

/// Gives each view its photo in an archive or on a server, where nothing can be listed: by a template with `{name}` or `{stem}`, or by
/// a folder. Whether it is there shows when it is wanted.
///
/// # Errors
/// [`SurveyError`] for a template without sense, and for a server where none may be asked.
pub(crate) fn address(views: &mut [View], images: &Path) -> Result<(), SurveyError> {
    let text = images.to_string_lossy();
    if let Err(refusal) = may_be_asked(images) {
        let message = refusal.to_string();
        let (message, hint) = message.split_once("\nhint: ").unwrap_or((&message, ""));
        return Err(SurveyError::config(message, hint));
    }
    let template =
        if text.contains('{') { text.into_owned() } else { format!("{}/{{name}}", text.trim_end_matches('/')) };
    template::check(&template).map_err(|e| SurveyError::config(e, "`{name}` and `{stem}` stand for a photo's name"))?;
    for view in views {
        let name = if template.starts_with(CURL) { in_url(&view.id.0) } else { view.id.0.clone() };
        view.image = template::fill(&template, &name, None);
    }
    Ok(())
}

/// GDAL's file system of web servers, whose paths are addresses.
const CURL: &str = "/vsicurl/";

/// A name as it stands in an address (RFC 3986, 2.3); folders stay.
fn in_url(name: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~/".contains(&byte);
    let in_address = |byte| if is_plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") };
    name.bytes().map(in_address).collect()
}

/// Index by a part of the path; `None` where several files share it.
fn unique<'a, K: Ord + ?Sized>(
    files: &'a [PathBuf],
    key: impl Fn(&'a Path) -> Option<&'a K>,
) -> BTreeMap<&'a K, Option<usize>> {
    let mut index = BTreeMap::new();
    for (i, path) in files.iter().enumerate() {
        if let Some(key) = key(path) {
            index.entry(key).and_modify(|found| *found = None).or_insert(Some(i));
        }
    }
    index
}
