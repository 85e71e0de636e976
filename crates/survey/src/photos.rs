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
    Several(Vec<usize>),
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
                    let other = second.filter(|_| owner == pose).unwrap_or(owner);
                    Found::Shared { photo, other, is_better: best > fit }
                }
            },
            _ => Found::Several(fits.iter().map(|(photo, _)| *photo).collect()),
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
    let Some((stem, extension)) = name.rsplit_once('.').filter(|(stem, _)| !stem.is_empty()) else {
        return (name, None);
    };
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
    let poses: Vec<String> =
        views.iter().map(|view| view.id.0.as_str()).chain(without_view).map(str::to_owned).collect();
    let names: Vec<&str> = poses.iter().map(|name| written.get(name).unwrap_or(name).as_str()).collect();
    let mut issues = Vec::new();
    let mut is_used = vec![false; files.len()];
    let mut differing = Vec::new();
    let matching = Matching { poses: &poses, files: &files, folder };
    for (i, found) in index.find_all(&names).into_iter().enumerate() {
        match &found {
            &Found::Photo { photo, is_exact } => {
                is_used[photo] = true;
                if let Some(view) = views.get_mut(i) {
                    view.image = Some(files[photo].clone());
                    differing.extend((!is_exact).then_some((names[i], photo)));
                }
                continue;
            }
            Found::Several(photos) => photos.iter().for_each(|photo| is_used[*photo] = true),
            Found::Shared { photo, .. } => is_used[*photo] = true,
            Found::Nothing => {}
        }
        issues.extend((i < views.len()).then(|| matching.issue(i, &found)));
    }
    issues.extend(matching.note(&differing));
    let advice = if !poses.is_empty() && views.iter().all(|view| view.image.is_none()) {
        format!(
            "no pose has its photo here; the poses are named as in {:?}: name the photos alike, or check `images`",
            poses[0]
        )
    } else {
        "if its pose was left out of the export, export it again; photos that were not aligned have none".to_owned()
    };
    issues.extend(whole::check(views));
    for (path, _) in files.iter().zip(is_used).filter(|(path, used)| !used && !is_map(path)) {
        let name = below(path, folder).to_string_lossy().into_owned();
        let message = "the survey has no pose for this photo".to_owned();
        let issue = Issue::new(Severity::Refused, "photo_without_pose", Subject::View(name), message);
        issues.push(issue.hint(advice.clone()));
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
        let (code, message, hint) = match found {
            Found::Several(photos) => (
                "duplicate_photo_name",
                format!(
                    "{} photos in {folder} have this name and fit equally well, such as {} and {}",
                    photos.len(),
                    self.photo(photos[0]),
                    self.photo(photos[1])
                ),
                "name the photos by their folder too, as in `flight1/IMG_1.jpg`",
            ),
            Found::Shared { photo, other, is_better: false } => (
                "duplicate_photo_name",
                format!("the photo {} fits {} equally well: neither has it", self.photo(*photo), self.poses[*other]),
                "keep the photos in folders as the poses name them, as in `flight1/IMG_1.jpg`",
            ),
            Found::Shared { photo, other, is_better: true } => {
                let message = format!("{missing}: {} is that of {}", self.photo(*photo), self.poses[*other]);
                ("pose_without_photo", message, look)
            }
            Found::Nothing | Found::Photo { .. } => ("pose_without_photo", missing, look),
        };
        Issue::new(Severity::Warning, code, Subject::View(self.poses[pose].clone()), message).hint(hint)
    }

    /// The note on photos that the poses spell otherwise: names of poses, and their photos.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Survey, SurveyConfig};
    use sizeup_geo::crs::Crs;

    /// The photo that each pose has, by its path below the folder.
    fn matched(poses: &[&str], photos: &[&str]) -> Vec<Option<String>> {
        let folder = Path::new("/data/flight");
        let paths: Vec<PathBuf> = photos.iter().map(|photo| folder.join(photo)).collect();
        let index = PhotoIndex::new(paths.iter().map(PathBuf::as_path), folder);
        let photo = |found: Found| match found {
            Found::Photo { photo, .. } => Some(photos[photo].to_owned()),
            _ => None,
        };
        index.find_all(poses).into_iter().map(photo).collect()
    }

    fn assert_matched(pose: &str, photos: &[&str], expected: &str) {
        assert_eq!(matched(&[pose], photos), [Some(expected.to_owned())], "{pose} among {photos:?}");
    }

    #[test]
    fn a_photo_is_found_however_systems_spell_its_name() {
        for (pose, photo) in [
            ("IMG_1.jpg", "IMG_1.JPG"),
            ("img_1.JPEG", "IMG_1.jpg"),
            ("IMG_1.tif", "IMG_1.TIFF"),
            ("a%20b/c%C3%BC.jpg", "a b/c\u{FC}.jpg"),
            ("cu\u{308}.jpg", "c\u{FC}.JPG"),
            ("LEFT\\IMG_1.jpg", "left/IMG_1.jpg"),
            ("/mnt/flight/left/1.jpg", "left/1.jpg"),
            ("D:\\flug\\left\\1.jpg", "left/1.jpg"),
            ("file:///c:/flug/left/1.jpg", "left/1.jpg"),
            ("../images/1.jpg", "1.jpg"),
            ("label", "label.jpg"),
            ("LABEL", "label.JPG"),
            ("a.b", "a.b.jpg"),
            ("1.jpg", "1.jpg.tif"),
        ] {
            assert_matched(pose, &[photo, "right/2.jpg", "IMG_11.jpg"], photo);
        }
        for (pose, photo) in [("1.jpg", "1.png"), ("1.arw", "1.jpg"), ("1.jpg", "11.jpg"), ("..", "1.jpg")] {
            assert_eq!(matched(&[pose], &[photo]), [None], "{pose}, {photo}");
        }
    }

    #[test]
    fn the_longest_common_path_goes_first_then_the_exact_name() {
        assert_matched("left/1.jpg", &["left/1.JPG", "right/1.jpg"], "left/1.JPG");
        assert_matched("x/left/1.jpg", &["x/right/1.jpg", "y/left/1.jpg"], "y/left/1.jpg");
        assert_matched("1.jpg", &["1.JPG", "1.jpg"], "1.jpg");
        assert_matched("1.jpg", &["1.JPG", "copies/1.jpg"], "copies/1.jpg");
        assert_matched("1.jpg", &["1.jpg", "copies/1.jpg"], "1.jpg");
        assert_matched("1.JPEG", &["1.jpg", "copies/1.jpg"], "1.jpg");
        assert_matched("1", &["1.jpg", "copies/1.jpg"], "1.jpg");
        assert_matched("../flight/1.jpg", &["1.jpg", "copies/1.jpg"], "1.jpg");
        assert_eq!(matched(&["1.jpg"], &["left/1.jpg", "right/1.jpg"]), [None], "equally well");
        assert_eq!(matched(&["1.jpg"], &["left/1.JPG", "right/1.JPEG"]), [None], "equally well");
    }

    #[test]
    fn a_photo_is_that_of_one_pose() {
        let photo = |name: &str| Some(name.to_owned());
        assert_eq!(matched(&["left/1.jpg", "right/1.jpg"], &["right/1.jpg"]), [None, photo("right/1.jpg")]);
        assert_eq!(matched(&["left/1.jpg", "right/1.jpg"], &["1.jpg"]), [None, None], "which one?");
        // The folder of all photos is a folder too.
        assert_eq!(matched(&["flight/1.jpg", "other/1.jpg"], &["1.jpg"]), [photo("1.jpg"), None]);
        assert_eq!(matched(&["img.jpg", "IMG.jpg"], &["IMG.jpg", "img.jpg"]), [photo("img.jpg"), photo("IMG.jpg")]);
    }

    /// Folders of a camera of five lenses, each of which numbers its photos from 0.
    const LENSES: [&str; 5] = ["back", "fwd", "left", "nadir", "right"];

    /// Poses that look straight down, and their photos in the folders of their lenses: number of lens and photo, and the place.
    fn rig() -> impl Iterator<Item = (usize, usize, f64)> {
        (0..LENSES.len()).flat_map(|lens| (0..2).map(move |i| (lens, i, (10 * lens + i) as f64)))
    }

    fn crs() -> Crs {
        Crs::parse("EPSG:25832").unwrap()
    }

    fn read(config: &SurveyConfig) -> Survey {
        crate::read(config, &crs()).unwrap()
    }

    /// Reads files that name the photos by `name` of lens and number, and checks that each has its name, place and photo.
    fn assert_rig(files: &[(&str, String)], path: &str, stem_only: bool) {
        let folder = tempfile::tempdir().unwrap();
        let photos = folder.path().join("photos");
        for (lens, i, _) in rig() {
            fs::create_dir_all(photos.join(LENSES[lens])).unwrap();
            fs::write(photos.join(LENSES[lens]).join(format!("DSC0000{i}.JPG")), format!("photo {lens} {i}")).unwrap();
        }
        for (name, text) in files {
            fs::create_dir_all(folder.path().join(name).parent().unwrap()).unwrap();
            fs::write(folder.path().join(name), text).unwrap();
        }
        let config = SurveyConfig { images: Some(photos.clone()), ..SurveyConfig::at(folder.path().join(path)) };
        let survey = read(&config);
        assert!(survey.issues.is_empty(), "{path}: {:?}", survey.issues);
        assert_eq!(survey.views.len(), 10, "{path}");
        for (view, (lens, i, x)) in survey.views.iter().zip(rig()) {
            let photo = format!("{}/DSC0000{i}.JPG", LENSES[lens]);
            let name = if stem_only { photo.trim_end_matches(".JPG") } else { &photo };
            assert_eq!((view.id.0.as_str(), view.image.as_deref()), (name, Some(&*photos.join(&photo))), "{path}");
            assert!((view.centre().x - 566_000.0 - x).abs() < 1e-6, "{path}: {}", view.centre());
        }
    }

    fn colmap(name: impl Fn(&str, usize) -> String) -> String {
        let row = |(lens, i, x): (usize, usize, f64)| {
            let id = 2 * lens + i + 1;
            format!("{id} 0 1 0 0 {} 5763000 180 1 {}\n\n", -(566_000.0 + x), name(LENSES[lens], i))
        };
        rig().map(row).collect()
    }

    #[test]
    fn a_rig_of_five_lenses_has_all_its_poses_and_photos_in_colmap_and_tables() {
        let cameras = "1 PINHOLE 400 300 500 500 200 150\n".to_owned();
        let names: [fn(&str, usize) -> String; 4] = [
            |lens, i| format!("{lens}/DSC0000{i}.JPG"),
            |lens, i| format!("{lens}\\DSC0000{i}.JPG"),
            |lens, i| format!("/mnt/flight 1/{lens}/DSC0000{i}.JPG"),
            |lens, i| format!("../photos/{lens}/DSC0000{i}.JPG"),
        ];
        for name in names {
            let images = ("sparse/images.txt", colmap(name));
            assert_rig(&[("sparse/cameras.txt", cameras.clone()), images], "sparse", false);
            let row = |(lens, i, x): (usize, usize, f64)| {
                format!("{},{},5763000,180,0,0,0,400,300,500\n", name(LENSES[lens], i), 566_000.0 + x)
            };
            let table: String = rig().map(row).collect();
            let table = format!("name,x,y,z,omega,phi,kappa,width,height,fx\n{table}");
            assert_rig(&[("poses.csv", table)], "poses.csv", false);
        }
    }

    #[test]
    fn a_rig_of_five_lenses_has_all_its_poses_and_photos_in_blocks_exchange() {
        for place in ["D:/flug", "D:\\flug", "/mnt/flug", "."] {
            let photo = |(lens, i, x): (usize, usize, f64)| {
                format!(
                    "<Photo><ImagePath>{place}/{}/DSC0000{i}.JPG</ImagePath><Pose><Rotation><M_00>1</M_00><M_01>0</M_01>\
                     <M_02>0</M_02><M_10>0</M_10><M_11>-1</M_11><M_12>0</M_12><M_20>0</M_20><M_21>0</M_21><M_22>-1</M_22>\
                     </Rotation><Center><x>{}</x><y>5763000</y><z>180</z></Center></Pose></Photo>",
                    LENSES[lens],
                    566_000.0 + x
                )
            };
            let photos: String = rig().map(photo).collect();
            let block = format!(
                "<BlocksExchange version=\"3.2\"><Block><Photogroups><Photogroup><ImageDimensions><Width>400</Width>\
                 <Height>300</Height></ImageDimensions><FocalLengthPixels>500</FocalLengthPixels>{photos}</Photogroup>\
                 </Photogroups></Block></BlocksExchange>"
            );
            assert_rig(&[("block.xml", block)], "block.xml", false);
        }
    }

    #[test]
    fn a_rig_of_five_lenses_has_all_its_poses_and_photos_in_opf() {
        let item = |kind: &str, file: &str, format: &str| serde_json::json!({ "type": kind, "resources": [{ "uri": file, "format": format!("application/opf-{format}+json") }] });
        let project = serde_json::json!({ "items": [
            item("camera_list", "list.json", "camera-list"),
            item("input_cameras", "input.json", "input-cameras"),
            item("scene_reference_frame", "frame.json", "scene-reference-frame"),
            item("calibration", "calibrated.json", "calibrated-cameras"),
        ]});
        let input = serde_json::json!({ "sensors": [{ "id": 1, "image_size_px": [400, 300] }] });
        let frame = serde_json::json!({ "crs": { "definition": "EPSG:25832" }, "base_to_canonical": {
            "shift": [-566_000.0, -5_763_000.0, 0.0], "scale": [1.0, 1.0, 1.0], "swap_xy": false } });
        let sensor = serde_json::json!({ "id": 1, "internals": { "type": "perspective", "principal_point_px": [200.0, 150.0],
            "focal_length_px": 500.0, "radial_distortion": [0.0, 0.0, 0.0], "tangential_distortion": [0.0, 0.0] } });
        for place in ["file:///c:/flug", "images", ".."] {
            let listed = |(lens, i, _): (usize, usize, f64)| {
                let uri = format!("{place}/{}/DSC0000{i}.JPG", LENSES[lens]);
                serde_json::json!({ "id": 10 * lens + i, "uri": uri })
            };
            let posed = |(lens, i, x): (usize, usize, f64)| {
                serde_json::json!({ "id": 10 * lens + i, "sensor_id": 1, "position": [x, 0.0, 180.0],
                                    "orientation_deg": [0.0, 0.0, 0.0] })
            };
            let list = serde_json::json!({ "cameras": rig().map(listed).collect::<Vec<_>>() });
            let calibrated =
                serde_json::json!({ "sensors": [sensor], "cameras": rig().map(posed).collect::<Vec<_>>() });
            let files = [
                ("opf/project.opf", project.to_string()),
                ("opf/list.json", list.to_string()),
                ("opf/input.json", input.to_string()),
                ("opf/frame.json", frame.to_string()),
                ("opf/calibrated.json", calibrated.to_string()),
            ];
            assert_rig(&files, "opf", false);
        }
    }

    #[test]
    fn a_rig_of_five_lenses_has_all_its_poses_and_photos_in_inpho() {
        let photo = |(lens, i, x): (usize, usize, f64)| {
            format!(
                "$PHOTO\n $PHOTO_NUM : {i}\n $PHOTO_FILE : D:\\flug\\{}\\DSC0000{i}.JPG\n $CAMERA_ID : c\n $EXT_ORI : 0\n  \
                 50 {} 5763000 180\n  1 0 0 0 1 0 0 0 1\n$END\n",
                LENSES[lens],
                566_000.0 + x
            )
        };
        let photos: String = rig().map(photo).collect();
        let project = format!(
            "$PROJECT 1\n$END\n{photos}$CAMERA_DEFINITION\n $ID : c\n $CCD_INTERIOR_ORIENTATION :\n  10 0 199.5\n  0 -10 149.5\n \
             $CCD_COLUMNS : 400\n $CCD_ROWS : 300\n $PIXEL_REFERENCE : CenterTopLeft\n $FOCAL_LENGTH : 50\n$END\n"
        );
        assert_rig(&[("block.prj", project)], "block.prj", false);
    }

    /// A local chunk whose cameras open as `camera` says: the label of their group, if they have one, and their own.
    fn metashape(camera: impl Fn(&str, usize) -> (Option<String>, String)) -> String {
        let shot = |(lens, i, x): (usize, usize, f64)| {
            let (group, label) = camera(LENSES[lens], i);
            let shot = format!(
                "<camera id=\"{lens}{i}\" sensor_id=\"{lens}\" label=\"{label}\"><transform>1 0 0 {} 0 -1 0 5763000 0 0 -1 180 \
                 0 0 0 1</transform></camera>",
                566_000.0 + x
            );
            group.map_or(shot.clone(), |group| format!("<group label=\"{group}\">{shot}</group>"))
        };
        let shots: String = rig().map(shot).collect();
        let sensor = |(id, lens): (usize, &&str)| {
            format!(
                "<sensor id=\"{id}\" label=\"{lens}\" type=\"frame\"><resolution width=\"400\" height=\"300\"/><calibration>\
                 <f>500</f></calibration></sensor>"
            )
        };
        let sensors: String = LENSES.iter().enumerate().map(sensor).collect();
        format!(
            "<document version=\"2.0.0\"><chunk><sensors>{sensors}</sensors><cameras>{shots}</cameras><reference>LOCAL_CS[\"\"]\
             </reference></chunk></document>"
        )
    }

    #[test]
    fn a_rig_of_five_lenses_has_all_its_poses_and_photos_in_metashape() {
        let label = |_: &str, i: usize| format!("DSC0000{i}");
        let in_groups = metashape(|lens, i| (Some(lens.to_owned()), label(lens, i)));
        assert_rig(&[("cameras.xml", in_groups)], "cameras.xml", true);
        let by_sensors = metashape(|lens, i| (None, label(lens, i)));
        assert_rig(&[("cameras.xml", by_sensors)], "cameras.xml", true);
        let absolute = metashape(|lens, i| (None, format!("/mnt/flight/{lens}/DSC0000{i}.JPG")));
        assert_rig(&[("cameras.xml", absolute)], "cameras.xml", false);
    }

    /// A table of poses of these names, and a folder with these photos.
    fn survey_of(poses: &[&str], photos: &[&str]) -> Survey {
        let folder = tempfile::tempdir().unwrap();
        let images = folder.path().join("images");
        for photo in photos {
            fs::create_dir_all(images.join(photo).parent().unwrap()).unwrap();
            fs::write(images.join(photo), format!("photo {photo}")).unwrap();
        }
        let row = |(i, name): (usize, &&str)| format!("{name},{},5763000,180,0,0,0,400,300,500\n", 566_000 + i);
        let rows: String = poses.iter().enumerate().map(row).collect();
        let path = folder.path().join("poses.csv");
        fs::write(&path, format!("name,x,y,z,omega,phi,kappa,width,height,fx\n{rows}")).unwrap();
        read(&SurveyConfig { images: Some(images), ..SurveyConfig::at(path) })
    }

    #[test]
    fn photos_that_are_spelt_otherwise_are_told_once() {
        let survey = survey_of(&["a.jpg", "b.jpg", "c.jpg"], &["a.JPG", "b.jpeg", "c.jpg"]);
        assert!(survey.views.iter().all(|view| view.image.is_some()));
        let [note] = &survey.issues[..] else { panic!("{:?}", survey.issues) };
        assert_eq!((note.code.as_str(), note.severity), ("photo_spelling_differs", Severity::Note));
        assert!(note.message.ends_with(": 2, such as a.JPG for a.jpg"), "{}", note.message);
        assert!(survey_of(&["a.jpg", "label"], &["A/a.jpg", "label.JPG"]).issues.is_empty(), "found as they are");
    }

    #[test]
    fn a_match_that_is_in_doubt_is_refused_with_both_names() {
        let survey = survey_of(&["1.jpg"], &["back/1.jpg", "left/1.jpg", "right/1.jpg"]);
        let [issue] = &survey.issues[..] else { panic!("{:?}", survey.issues) };
        assert_eq!(issue.code, "duplicate_photo_name");
        assert!(
            issue.message.contains("3 photos") && issue.message.contains("back/1.jpg and left/1.jpg"),
            "{}",
            issue.message
        );
        let survey = survey_of(&["left/1.jpg", "right/1.jpg"], &["1.jpg"]);
        assert!(survey.views.iter().all(|view| view.image.is_none()));
        let messages: Vec<&str> = survey.issues.iter().map(|issue| issue.message.as_str()).collect();
        assert!(
            messages[0].contains("1.jpg fits right/1.jpg") && messages[1].contains("1.jpg fits left/1.jpg"),
            "{messages:?}"
        );
        let survey = survey_of(&["left/1.jpg", "right/1.jpg"], &["right/1.jpg"]);
        assert!(survey.issues[0].message.contains("right/1.jpg is that of right/1.jpg"), "{:?}", survey.issues);
    }

    #[test]
    fn a_name_that_is_no_path_of_a_file_is_refused() {
        let survey = survey_of(&["..", "a.jpg", "../../a/b.jpg"], &["a.jpg", "b.jpg"]);
        let names: Vec<&str> = survey.views.iter().map(|view| view.id.0.as_str()).collect();
        assert_eq!((names, survey.issues[0].code.as_str()), (vec!["a.jpg", "b.jpg"], "photo_name_unusable"));
        assert!(survey.views.iter().all(|view| view.image.is_some()), "{:?}", survey.issues);
    }

    #[test]
    fn a_mismatch_shows_a_pose_and_a_photo_side_by_side() {
        let issues = survey_of(&["IMG_1.jpg"], &["DSC_1.JPG"]).issues;
        let hints: Vec<&str> = issues.iter().filter_map(|issue| issue.hint.as_deref()).collect();
        assert!(hints[0].contains("named as in \"IMG_1.jpg\""), "{issues:?}");
        let folder = tempfile::tempdir().unwrap();
        let views = survey_of(&["IMG_1.jpg", "IMG_2.jpg"], &["x.jpg"]).views;
        assert!(mismatch(&views, folder.path()).contains("there is no photo in"));
        fs::write(folder.path().join("DSC_1.JPG"), b"photo").unwrap();
        let why = mismatch(&views, folder.path());
        assert!(why.contains("none of the 2 poses") && why.contains("\"IMG_1.jpg\", photo \"DSC_1.JPG\""), "{why}");
    }
}
