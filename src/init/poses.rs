//! Which poses a project takes: those that a bundle adjustment has made agree with the photos, before a table of unknown origin,
//! before what the drone wrote into its photos.

use std::cmp::Reverse;
use std::error::Error;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::folder::{Inventory, name_of};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::read_text;
use sizeup_geo::paths::resolved;
use sizeup_survey::{
    FirstLook, Format, PhotoFacts, PhotoIndex, PoseWorld, SurveyConfig, SurveyError, WorldGuess, first_look, recognise,
};

/// Formats of adjusted poses, the surest to read first: those that name their CRS before those that do not. One that stands
/// neither here nor below is taken for adjusted, behind these.
const ADJUSTED: [Format; 11] = [
    Format::BlocksExchange,
    Format::Metashape,
    Format::Opf,
    Format::Pix4d,
    Format::Odm,
    Format::Opensfm,
    Format::Inpho,
    Format::Stac,
    Format::Colmap,
    Format::Nerfstudio,
    Format::MetashapeOpk,
];
/// Formats of poses that no adjustment has made agree with the photos: tables of unknown origin, what the drone wrote, and
/// positions that photogrammetry was given.
const NOT_ADJUSTED: [Format; 3] = [Format::Csv, Format::Photos, Format::GeoTxt];
/// File that sizeup writes beside poses that it has converted or aligned.
const OWN_SETTINGS: &str = "survey.toml";
/// File that says where a model in local coordinates lies: `{"crs": "EPSG:…", "offset": [x, y, z]}`.
const GEOREFERENCE: &str = "georef.json";

/// Poses that could be taken.
#[derive(Debug, Clone)]
pub(super) struct PoseSource {
    /// Settings for reading them.
    pub config: SurveyConfig,
    /// First look at them.
    pub look: FirstLook,
    /// Photos of the folder that they are of.
    pub n_matched: usize,
    /// File that says where they are, where they do not themselves.
    pub placed_by: Option<String>,
}

/// Poses that are not taken, and why.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Passed {
    /// File or folder of the poses.
    pub path: PathBuf,
    /// Format of the poses, as the configuration names it.
    pub format: String,
    /// Why they are not taken.
    pub why: String,
}

/// Outcome of a look through the folder.
#[derive(Debug)]
pub(super) struct PoseChoice {
    /// Poses that the project takes; `None` where there are none to take.
    pub chosen: Option<PoseSource>,
    /// Poses that it does not take, and why.
    pub passed: Vec<Passed>,
}

impl PoseSource {
    /// Whether it is known where they are, or numbers may tell.
    pub(super) fn is_placed(&self) -> bool {
        self.look.world != PoseWorld::Unsaid(WorldGuess::Local)
    }

    /// Whether they were adjusted together with the photos.
    pub(super) fn is_adjusted(&self) -> bool {
        !NOT_ADJUSTED.contains(&self.config.format) || self.is_own()
    }

    fn is_own(&self) -> bool {
        self.placed_by.as_deref() == Some(OWN_SETTINGS)
    }

    /// The better the lower: what places itself, is of these photos, is adjusted, and covers most.
    fn merit(&self, has_photos: bool) -> impl Ord + use<> {
        let kind = if self.is_own() { 0 } else { preference(self.config.format) };
        let is_foreign = has_photos && self.n_matched == 0;
        (!self.is_placed(), is_foreign, kind, Reverse(self.n_matched), self.config.path.clone())
    }
}

/// The place of a format in the order of preference.
fn preference(format: Format) -> usize {
    let place = |list: &[Format]| list.iter().position(|known| *known == format);
    // 0 is what sizeup wrote itself.
    let last = ADJUSTED.len() + 1;
    place(&NOT_ADJUSTED).map(|i| last + 1 + i).or(place(&ADJUSTED).map(|i| i + 1)).unwrap_or(last)
}

/// Reads what may be poses and chooses.
pub(super) fn choose(inventory: &Inventory, facts: &[PhotoFacts], offset: Option<[f64; 3]>) -> PoseChoice {
    let photos = PhotoIndex::new(inventory.photos.iter().map(PathBuf::as_path), &inventory.root);
    let mut passed = Vec::new();
    let mut sources = Vec::new();
    for (path, format) in candidates(inventory, facts) {
        match read(&path, format, offset) {
            Ok(source) if source.look.names.is_empty() => passed.push(pass(&path, format, nothing_in(&source.look))),
            Ok(source) => sources.push(PoseSource { n_matched: photos.count(&source.look.names), ..source }),
            // Tables of all kinds lie in folders.
            Err(_) if format == Format::Csv => {}
            Err(error) => passed.push(pass(&path, format, one_line(&error))),
        }
    }
    sources.sort_by_cached_key(|source| source.merit(!inventory.photos.is_empty()));
    let mut sources = sources.into_iter();
    let chosen = sources.next();
    passed.extend(sources.map(|source| {
        let why = chosen.as_ref().map_or_else(String::new, |chosen| why_not(&source, chosen));
        pass(&source.config.path, source.config.format, why)
    }));
    PoseChoice { chosen, passed }
}

fn pass(path: &Path, format: Format, why: String) -> Passed {
    Passed { path: path.to_owned(), format: format.name(), why }
}

fn nothing_in(look: &FirstLook) -> String {
    look.issues.first().map_or_else(|| "it has no poses".to_owned(), |issue| format!("no pose: {}", issue.message))
}

/// An error with its causes in a line, without hints.
pub(super) fn one_line(error: &dyn Error) -> String {
    let text = |error: &dyn Error| error.to_string().split("\nhint:").next().unwrap_or_default().replace('\n', " ");
    let mut line = text(error);
    let mut cause = error.source();
    while let Some(found) = cause {
        if !line.contains(&text(found)) {
            line = format!("{line}: {}", text(found));
        }
        cause = found.source();
    }
    line
}

fn why_not(source: &PoseSource, chosen: &PoseSource) -> String {
    let n = source.look.names.len();
    if !source.is_placed() {
        "its positions are local and nothing says where they lie (an `offset` would)".to_owned()
    } else if source.n_matched == 0 && chosen.n_matched > 0 {
        "it names none of the photos here".to_owned()
    } else if source.config.format == Format::Photos {
        format!("{n} photos with EXIF and XMP; adjusted poses fit photos better")
    } else {
        format!("{n} poses; {} comes first in the order of preference", chosen.config.format.name())
    }
}

/// Files and folders that a reader knows. Photos count where they say position and direction.
fn candidates(inventory: &Inventory, facts: &[PhotoFacts]) -> Vec<(PathBuf, Format)> {
    let known = |path: &PathBuf| recognise(path).filter(|format| *format != Format::Photos).map(|f| (path.clone(), f));
    let mut found: Vec<(PathBuf, Format)> = inventory.folders.iter().filter_map(known).collect();
    let is_within = |file: &Path, format: Format, folders: &[(PathBuf, Format)]| {
        let is_its_folder = |(folder, of): &(PathBuf, Format)| *of == format && file.parent() == Some(folder.as_path());
        folders.iter().any(is_its_folder)
    };
    let files: Vec<_> = inventory.poses.iter().filter(|path| !is_list_of_others(path)).filter_map(known).collect();
    let files: Vec<_> = files.into_iter().filter(|(file, format)| !is_within(file, *format, &found)).collect();
    found.extend(files);
    found.extend(folder_of_posed(facts).map(|folder| (folder, Format::Photos)));
    found
}

/// Any JSON list may be `OpenSfM`'s by its first byte: of those only what is called so is tried.
fn is_list_of_others(path: &Path) -> bool {
    let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    is_json && recognise(path) == Some(Format::Opensfm) && !name_of(path).contains("reconstruction")
}

/// The folder that holds all photos which say where and whereto they look.
fn folder_of_posed(facts: &[PhotoFacts]) -> Option<PathBuf> {
    let posed = facts.iter().filter(|photo| photo.place_deg.is_some() && photo.has_angles);
    common_folder(posed.map(|photo| photo.path.as_path()))
}

/// The innermost folder that holds all files.
pub(super) fn common_folder<'a>(mut files: impl Iterator<Item = &'a Path>) -> Option<PathBuf> {
    let first = files.next()?.parent()?.to_owned();
    files.try_fold(first, |shared, file| Some(shared.ancestors().find(|above| file.starts_with(above))?.to_owned()))
}

/// Reads poses as far as they say themselves, and what lies beside them, where they are.
fn read(path: &Path, format: Format, offset: Option<[f64; 3]>) -> Result<PoseSource, SurveyError> {
    let plain = SurveyConfig { format, ..SurveyConfig::at(path) };
    let (config, mut placed_by) = match own_settings(path) {
        Some(config) => (config, Some(OWN_SETTINGS.to_owned())),
        None => (plain, None),
    };
    let mut source = PoseSource { look: first_look(&config)?, config, n_matched: 0, placed_by: placed_by.clone() };
    let config = match (&source.look.world, offset) {
        (PoseWorld::Unsaid(WorldGuess::Degrees), _) => {
            SurveyConfig { crs: Crs::parse("EPSG:4326").ok(), ..source.config }
        }
        (PoseWorld::Unsaid(WorldGuess::EarthCentred), _) => {
            SurveyConfig { crs: Crs::parse("EPSG:4978").ok(), ..source.config }
        }
        (PoseWorld::Unsaid(WorldGuess::Local), Some(offset)) => {
            placed_by = Some("--offset".to_owned());
            SurveyConfig { offset, ..source.config }
        }
        (PoseWorld::Unsaid(WorldGuess::Local), None) => match georeference(path) {
            Some((name, crs, offset)) => {
                placed_by = Some(name);
                SurveyConfig { crs, offset, ..source.config }
            }
            None => return Ok(source),
        },
        _ => return Ok(source),
    };
    source = PoseSource { look: first_look(&config)?, config, n_matched: 0, placed_by };
    Ok(source)
}

/// The settings that sizeup wrote beside these poses.
fn own_settings(path: &Path) -> Option<SurveyConfig> {
    let folder = if path.is_dir() { path } else { path.parent()? };
    let mut config: SurveyConfig = toml::from_str(&read_text(&folder.join(OWN_SETTINGS)).ok()?).ok()?;
    config.path = resolved(folder, &config.path);
    (config.path == path).then_some(config)
}

/// Statement of a georeference beside a model: its name, the CRS where it names one, and the offset.
fn georeference(path: &Path) -> Option<(String, Option<Crs>, [f64; 3])> {
    #[derive(Deserialize)]
    struct Georeference {
        #[serde(alias = "world")]
        crs: Option<String>,
        offset: [f64; 3],
    }
    path.ancestors().take(3).find_map(|folder| {
        let found: Georeference = serde_json::from_str(&read_text(&folder.join(GEOREFERENCE)).ok()?).ok()?;
        // The first word of "EPSG:2180 (PL-1992) minus offset".
        let crs = found.crs.and_then(|text| Crs::parse(text.split_whitespace().next()?).ok());
        Some((GEOREFERENCE.to_owned(), crs, found.offset))
    })
}
