//! Two results from files, brought into one frame.
//!
//! A folder is that of a run or of a merged city: the first of [`IN_FOLDER`] that it has is read. Footprints of the old result
//! are brought to the CRS of the new one where they differ; levels are compared where both say what they count from, and
//! refused where that is not the same.

use std::path::{Path, PathBuf};

use geo_types::Geometry;
use sizeup_geo::crs::{Crs, CrsError, Transform, VerticalReference};
use sizeup_geo::files::FileError;
use sizeup_geo::geodata::vector::{FeatureGeometry, VectorLayer};

use super::{Compared, LevelRule, SettingError};
use crate::output::read::{FoundBuildings, ReadError, ReadOptions, RecordFile};
use crate::output::{BuildingRecord, InputFile, Lineage, OutputError};

/// Files of a result's folder, in the order in which it is looked for.
const IN_FOLDER: [&str; 3] = ["city.gpkg", "city.city.jsonl", "city.city.json"];

/// The layer of the photos in our `GeoPackage` files.
const CAMERAS: &str = "cameras";

/// Words of lineages for a vertical reference that nobody stated.
const NOT_STATED: [&str; 3] = ["", "not stated", "as in the input"];

/// Why two results cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum ChangesError {
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// There is no such file or folder.
    #[error("the {epoch} result {} does not exist\nhint: name the folder of a run, or its city.gpkg or city.city.json", path.display())]
    Missing {
        /// Epoch of the result: `old` or `new`.
        epoch: &'static str,
        /// Path that was named.
        path: PathBuf,
    },
    /// The folder holds no result.
    #[error("the {epoch} result {} holds none of {}\nhint: name the folder that `sizeup run` or `sizeup tiles merge` wrote, or the file itself", path.display(), IN_FOLDER.join(", "))]
    NoResult {
        /// Epoch of the result: `old` or `new`.
        epoch: &'static str,
        /// The folder that was named.
        path: PathBuf,
    },
    /// Both are one file.
    #[error("{} and {} are the same file\nhint: name the results of two flights, the earlier one first", old.display(), new.display())]
    SameFile {
        /// Path of the old result.
        old: PathBuf,
        /// Path of the new result.
        new: PathBuf,
    },
    /// There is nothing to compare with.
    #[error("the {epoch} result {} has no building with a footprint, out of {n_buildings}\nhint: every building of the other one would be new or gone; look at the run's issues.json", path.display())]
    Empty {
        /// Epoch of the result: `old` or `new`.
        epoch: &'static str,
        /// Path of the result's file.
        path: PathBuf,
        /// Number of buildings it has.
        n_buildings: usize,
    },
    /// Areas and distances mean nothing in its CRS.
    #[error("the new result {} cannot be compared in its CRS", path.display())]
    Frame {
        /// Path of the new result's file.
        path: PathBuf,
        /// Why its positions cannot be brought into the old one's CRS.
        #[source]
        source: CrsError,
    },
    /// Levels count from different zeros.
    #[error("levels cannot be compared: those of {} count from {old_reference}, those of {} from {new_reference}\nhint: --heights-only compares heights above ground, which need no common zero", old.display(), new.display())]
    Vertical {
        /// Path of the old result.
        old: PathBuf,
        /// Zero of its levels.
        old_reference: String,
        /// Path of the new result.
        new: PathBuf,
        /// Zero of its levels.
        new_reference: String,
    },
    /// A file cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A file cannot be read or written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file cannot be hashed.
    #[error(transparent)]
    File(#[from] FileError),
}

/// A result as it is compared.
#[derive(Debug)]
pub struct ResultFile {
    /// The file, with its hash.
    pub file: InputFile,
    /// Buildings, in the frame of the comparison.
    pub records: Vec<BuildingRecord>,
    /// Projection centres of its photos (easting, northing), in the frame of the comparison; only a `GeoPackage` has them.
    pub cameras: Vec<[f64; 2]>,
    /// The result's own CRS.
    pub crs: Crs,
    /// Lineage, if it is ours.
    pub lineage: Option<Lineage>,
}

/// Two results in one frame, that of the new one.
#[derive(Debug)]
pub struct ResultPair {
    /// The earlier result.
    pub old: ResultFile,
    /// The later result, in the CRS of the earlier.
    pub new: ResultFile,
    /// Zero of the levels of both; `None` where they are not to be compared or one does not say.
    pub level_reference: Option<String>,
}

impl ResultPair {
    /// Reads two results.
    ///
    /// # Errors
    /// [`ChangesError`].
    pub fn read(old: &Path, new: &Path, levels: LevelRule) -> Result<Self, ChangesError> {
        let (old_path, new_path) = (file_of(old, "old")?, file_of(new, "new")?);
        if same_file(&old_path, &new_path) {
            return Err(ChangesError::SameFile { old: old_path, new: new_path });
        }
        let new = ResultFile::read(&new_path, None, "new")?;
        let framed = new.crs.require_projected_metres();
        framed.map_err(|source| ChangesError::Frame { path: new_path.clone(), source })?;
        let old = ResultFile::read(&old_path, Some(&new.crs), "old")?;
        let level_reference = match levels {
            LevelRule::Compare => common_reference(&old, &new)?,
            LevelRule::HeightsOnly => None,
        };
        Ok(Self { old, new, level_reference })
    }
}

impl ResultFile {
    fn read(path: &Path, frame: Option<&Crs>, epoch: &'static str) -> Result<Self, ChangesError> {
        let found = FoundBuildings::read(path, &ReadOptions::default())?;
        let n_buildings = found.buildings.len();
        if !found.buildings.iter().any(|building| building.footprint.is_some()) {
            return Err(ChangesError::Empty { epoch, path: path.to_owned(), n_buildings });
        }
        let crs = found.crs.clone().ok_or_else(|| ReadError::NoCrs { path: path.to_owned() })?;
        let frame = frame.unwrap_or(&crs);
        let records = found.into_crs(frame)?.to_records();
        let lineage = RecordFile::open(path, ReadOptions::default())?.lineage();
        let cameras = cameras(path, frame).map_err(|source| ReadError::Crs { path: path.to_owned(), source })?;
        Ok(Self { file: InputFile::hash(epoch, path)?, records, cameras, crs, lineage })
    }

    /// The result as [`super::compare`] takes it.
    #[must_use]
    pub fn compared(&self) -> Compared<'_> {
        Compared { records: &self.records, cameras: &self.cameras }
    }

    /// Path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        Path::new(&self.file.path)
    }

    /// The vertical reference in words, if the file or its lineage states one.
    fn reference_in_words(&self) -> Option<String> {
        let of_crs = VerticalReference::of(&self.crs).map(|reference| reference.to_string());
        let of_lineage = || self.lineage.as_ref().map(|lineage| lineage.vertical_reference.clone());
        of_crs.or_else(of_lineage).filter(|words| !NOT_STATED.contains(&words.as_str()))
    }
}

/// Projection centres from the layer that a GeoPackage of ours has; none from any other file.
fn cameras(path: &Path, frame: &Crs) -> Result<Vec<[f64; 2]>, CrsError> {
    let is_geopackage = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gpkg"));
    let Some(mut layer) = is_geopackage.then(|| VectorLayer::open(path, Some(CAMERAS)).ok()).flatten() else {
        return Ok(Vec::new());
    };
    let Ok(Some(crs)) = layer.crs() else { return Ok(Vec::new()) };
    let transform = Transform::new(&crs, frame)?;
    let centres = layer.features().filter_map(|feature| match feature.geometry {
        FeatureGeometry::Shape(Geometry::Point(at)) => Some(at),
        _ => None,
    });
    centres.map(|at| transform.point(at.x(), at.y()).map(<[f64; 2]>::from)).collect()
}

/// Zero of the levels of both, if both say it.
fn common_reference(old: &ResultFile, new: &ResultFile) -> Result<Option<String>, ChangesError> {
    let (Some(before), Some(now)) = (old.reference_in_words(), new.reference_in_words()) else { return Ok(None) };
    // One may have it from a CRS, "NAP height", and the other from words, "orthometric, NAP height".
    if before.contains(&now) || now.contains(&before) {
        return Ok(Some(now));
    }
    Err(ChangesError::Vertical {
        old: old.path().to_owned(),
        old_reference: before,
        new: new.path().to_owned(),
        new_reference: now,
    })
}

/// The file of a result: itself, or the one that its folder holds.
fn file_of(path: &Path, epoch: &'static str) -> Result<PathBuf, ChangesError> {
    if path.is_dir() && !path.join("tileset.json").is_file() {
        let found = IN_FOLDER.iter().map(|name| path.join(name)).find(|file| file.is_file());
        return found.ok_or_else(|| ChangesError::NoResult { epoch, path: path.to_owned() });
    }
    if path.exists() { Ok(path.to_owned()) } else { Err(ChangesError::Missing { epoch, path: path.to_owned() }) }
}

fn same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
