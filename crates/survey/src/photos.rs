//! Matching poses to photo files by name.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::{SurveyError, View, names, whole};
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

/// Photos of a folder, to find those of poses by their names.
///
/// A pose has the photo whose path ends like its own for longest, letter case, percent-encoding, Unicode's form and `.jpeg` for
/// `.jpg` aside; names that lack the extension are found too (Metashape's labels). Among equals an exact name goes first, then
/// the path that has no other folders. The folders above the photos count too, so that `left/1.jpg` is found in a folder `left`.
pub struct PhotoIndex {
    photos: Vec<IndexedPhoto>,
    /// Photos by the key of their names without extension.
    by_stem: BTreeMap<String, Vec<usize>>,
}

/// A photo's path, taken apart.
struct IndexedPhoto {
    parts: Vec<String>,
    /// Number of parts below the folder of all photos.
    n_below: usize,
}

/// How well a photo's path fits a pose's name: the greater the better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Fit {
    /// Last parts that both have in common.
    n_common: usize,
    name: NameFit,
    /// Whether neither has any other parts.
    is_whole: bool,
    /// Common parts that are equal to the letter.
    n_exact: usize,
}

/// How a photo's file name fits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum NameFit {
    Alike,
    /// To the letter, but for the extension that the pose's name lacks.
    WithoutExtension,
    Exact,
}

/// The photo of a pose.
enum Found {
    /// One that no other pose fits as well.
    Photo { photo: usize, is_exact: bool },
    /// None of the name.
    Nothing,
    /// Several that fit equally well.
    Several(usize, usize),
    /// One that fits another pose equally well, or better.
    Shared { photo: usize, other: usize, is_better: bool },
}

impl PhotoIndex {
    /// The photos below a folder, by their paths.
    pub fn new<'a>(photos: impl IntoIterator<Item = &'a Path>, folder: &Path) -> Self {
        let mut index = Self { photos: Vec::new(), by_stem: BTreeMap::new() };
        for path in photos {
            let full = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
            let parts: Vec<String> = names::parts(&full.to_string_lossy()).into_iter().map(str::to_owned).collect();
            let n_below = path.strip_prefix(folder).map_or(parts.len(), |below| below.components().count().max(1));
            if let Some(name) = parts.last() {
                index.by_stem.entry(names::key(apart(name).0)).or_default().push(index.photos.len());
            }
            index.photos.push(IndexedPhoto { parts, n_below });
        }
        index
    }

    /// Number of poses of these names that have their photo here, or several that fit equally well.
    #[must_use]
    pub fn count(&self, poses: &[String]) -> usize {
        let names: Vec<&str> = poses.iter().map(String::as_str).collect();
        self.find_all(&names).iter().filter(|found| matches!(found, Found::Photo { .. } | Found::Several(..))).count()
    }

    /// The photos of poses. A photo is that of one pose: of the one that it fits best.
    fn find_all(&self, names: &[&str]) -> Vec<Found> {
        let best: Vec<Vec<(usize, Fit)>> = names.iter().map(|name| self.best(name)).collect();
        // The best fit of each photo, and up to two poses that have it.
        let mut owners: BTreeMap<usize, (Fit, usize, Option<usize>)> = BTreeMap::new();
        for (pose, fits) in best.iter().enumerate() {
            for &(photo, fit) in fits {
                let owner = owners.entry(photo).or_insert((fit, pose, None));
                match fit.cmp(&owner.0) {
                    Ordering::Greater => *owner = (fit, pose, None),
                    Ordering::Equal if owner.1 != pose => owner.2 = owner.2.or(Some(pose)),
                    Ordering::Equal | Ordering::Less => {}
                }
            }
        }
        let found = best.iter().enumerate().map(|(pose, fits)| match fits[..] {
            [] => Found::Nothing,
            [(photo, fit)] => match owners[&photo] {
                (_, owner, None) if owner == pose => Found::Photo { photo, is_exact: fit.is_exact() },
                (best, owner, second) => {
                    let other = if owner == pose { second.unwrap_or(owner) } else { owner };
                    Found::Shared { photo, other, is_better: best > fit }
                }
            },
            [(one, _), (other, _), ..] => Found::Several(one, other),
        });
        found.collect()
    }

    /// The photos that fit a pose's name best.
    fn best(&self, name: &str) -> Vec<(usize, Fit)> {
        let parts = names::parts(name);
        let Some(file) = parts.last() else { return Vec::new() };
        let (stem, extension) = apart(file);
        let called = |stem: &str| self.by_stem.get(&names::key(stem)).into_iter().flatten().copied();
        let with_extension = called(stem).filter(|photo| self.photos[*photo].extension() == extension);
        let mut fits: Vec<(usize, Fit)> =
            with_extension.chain(called(file)).map(|photo| (photo, self.photos[photo].fit(&parts))).collect();
        let best = fits.iter().map(|(_, fit)| *fit).max();
        fits.retain(|(_, fit)| Some(*fit) == best);
        fits
    }
}

impl Fit {
    fn is_exact(self) -> bool {
        self.name > NameFit::Alike && self.n_exact == self.n_common
    }
}

impl IndexedPhoto {
    fn name(&self) -> &str {
        self.parts.last().map_or("", String::as_str)
    }

    fn extension(&self) -> Option<&'static str> {
        apart(self.name()).1
    }

    /// How well the path fits that of a pose whose file name is alike.
    fn fit(&self, pose: &[&str]) -> Fit {
        let own = self.name();
        let file = pose.last().copied().unwrap_or_default();
        let name = if own == file {
            NameFit::Exact
        } else if apart(own).0 == file {
            NameFit::WithoutExtension
        } else {
            NameFit::Alike
        };
        let folders = self.parts.iter().rev().zip(pose.iter().rev()).enumerate().skip(1);
        let common: Vec<bool> = folders
            .take_while(|(_, (own, pose))| names::are_alike(own, pose))
            // Folders above those of the photos may be called anyhow.
            .map(|(i, (own, pose))| own == pose || i >= self.n_below)
            .collect();
        let n_common = 1 + common.len();
        let n_exact = usize::from(name > NameFit::Alike) + common.into_iter().filter(|is_exact| *is_exact).count();
        Fit { n_common, name, is_whole: n_common == pose.len() && n_common == self.n_below, n_exact }
    }
}

/// A photo's name without extension, and the extension, in one form for each kind of file; what is no photo's extension belongs to
/// the name.
fn apart(name: &str) -> (&str, Option<&'static str>) {
    let Some((stem, extension)) = name.rsplit_once('.').filter(|(stem, _)| !stem.is_empty()) else { return (name, None) };
    let known = PHOTO_EXTENSIONS.iter().find(|known| extension.eq_ignore_ascii_case(known));
    match known {
        Some(&"jpeg") => (stem, Some("jpg")),
        Some(&"tiff") => (stem, Some("tif")),
        Some(known) => (stem, Some(known)),
        None => (name, None),
    }
}

/// Gives each view its photo by its name ([`PhotoIndex`]). `written` holds names as the file of the poses writes them, where views
/// have others. Poses without a photo, photos without a pose and photos whose files are damaged become issues.
pub(crate) fn attach(
    views: &mut [View],
    already_refused: &BTreeSet<String>,
    written: &BTreeMap<String, String>,
    folder: &Path,
) -> Result<Vec<Issue>, FileError> {
    let files = list(folder)?;
    let index = PhotoIndex::new(files.iter().map(PathBuf::as_path), folder);
    let with_view: BTreeSet<&str> = views.iter().map(|view| view.id.0.as_str()).collect();
    let without_view = already_refused.iter().map(String::as_str).filter(|name| !with_view.contains(name));
    let poses: Vec<String> = views.iter().map(|view| view.id.0.as_str()).chain(without_view).map(str::to_owned).collect();
    let names: Vec<&str> = poses.iter().map(|name| written.get(name).unwrap_or(name).as_str()).collect();
    let mut issues = Vec::new();
    let mut is_used = vec![false; files.len()];
    let mut differing = Vec::new();
    let matching = Matching { poses: &poses, files: &files, folder };
    for (i, found) in index.find_all(&names).into_iter().enumerate() {
        match found {
            Found::Photo { photo, is_exact } => {
                is_used[photo] = true;
                if let Some(view) = views.get_mut(i) {
                    view.image = Some(files[photo].clone());
                    differing.extend((!is_exact).then_some((names[i], photo)));
                }
                continue;
            }
            Found::Several(one, other) => (is_used[one], is_used[other]) = (true, true),
            Found::Shared { photo, .. } => is_used[photo] = true,
            Found::Nothing => {}
        }
        issues.extend((i < views.len()).then(|| matching.issue(i, &found)));
    }
    issues.extend(matching.note(&differing));
    issues.extend(whole::check(views));
    for (path, _) in files.iter().zip(is_used).filter(|(path, used)| !used && !is_map(path)) {
        let name = below(path, folder).to_string_lossy().into_owned();
        let message = "the survey has no pose for this photo".to_owned();
        issues.push(
            Issue::new(Severity::Refused, "photo_without_pose", Subject::View(name), message).hint(
                "if its pose was left out of the export, export it again; photos that were not aligned have none",
            ),
        );
    }
    Ok(issues)
}

/// Poses, and the photos among which theirs are looked for.
struct Matching<'a> {
    poses: &'a [String],
    files: &'a [PathBuf],
    folder: &'a Path,
}

impl Matching<'_> {
    fn photo(&self, i: usize) -> std::path::Display<'_> {
        below(&self.files[i], self.folder).display()
    }

    /// Why a pose has no photo.
    fn issue(&self, pose: usize, found: &Found) -> Issue {
        let folder = self.folder.display();
        let missing = format!("there is no photo of this name in {folder}");
        let look = "check `images`; the view is used as far as it needs no pixels";
        let (code, message, hint) = match *found {
            Found::Several(one, other) => (
                "duplicate_photo_name",
                format!(
                    "several photos in {folder} have this name and fit equally well: {} and {}",
                    self.photo(one),
                    self.photo(other)
                ),
                "name the photos by their folder too, as in `flight1/IMG_1.jpg`",
            ),
            Found::Shared { photo, other, is_better: false } => (
                "duplicate_photo_name",
                format!("the photo {} fits {} equally well: neither has it", self.photo(photo), self.poses[other]),
                "keep the photos in folders as the poses name them, as in `flight1/IMG_1.jpg`",
            ),
            Found::Shared { photo, other, is_better: true } => {
                let message = format!("{missing}: {} is that of {}", self.photo(photo), self.poses[other]);
                ("pose_without_photo", message, look)
            }
            Found::Nothing | Found::Photo { .. } => ("pose_without_photo", missing, look),
        };
        Issue::new(Severity::Warning, code, Subject::View(self.poses[pose].clone()), message).hint(hint)
    }

    /// What is said of photos that the poses spell otherwise: names of poses, and their photos.
    fn note(&self, differing: &[(&str, usize)]) -> Option<Issue> {
        let &(pose, photo) = differing.first()?;
        let message = format!(
            "photos matched although poses spell their names otherwise (letter case, extension, coded letters): {}, such as {} \
             for {pose}",
            differing.len(),
            self.photo(photo)
        );
        Some(Issue::new(
            Severity::Note,
            "photo_spelling_differs",
            Subject::Input(self.folder.display().to_string()),
            message,
        ))
    }
}

/// A photo's path in the folder of all; its name where it is the only one.
fn below<'a>(path: &'a Path, folder: &Path) -> &'a Path {
    let below = path.strip_prefix(folder).ok().filter(|below| !below.as_os_str().is_empty());
    below.unwrap_or_else(|| path.file_name().map_or(path, Path::new))
}

/// Why no view has a photo of a folder, in words: a name of each side by side.
#[must_use]
pub fn mismatch(views: &[View], folder: &Path) -> String {
    let photos = list(folder).unwrap_or_default();
    let Some(photo) = photos.first() else { return format!("there is no photo in {}", folder.display()) };
    let pose = views.first().map_or("none", |view| view.id.0.as_str());
    format!(
        "none of the {} poses has its photo among the {} of {}: pose {pose:?}, photo {:?}",
        views.len(),
        photos.len(),
        folder.display(),
        below(photo, folder).display().to_string()
    )
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
