//! Terrain from a DTM file or a constant.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::reproject::{self, MapBox};
use super::{DemError, Terrain};
use crate::crs::{Crs, CrsError};
use crate::geodata::raster::{RasterError, RasterFile};
use crate::issue::{Issue, Severity, Subject};
use crate::units::metres_per;

/// The band that is read: most terrain models have no other.
pub(super) const BAND: usize = 1;

/// Where the ground is: exactly one of `dtm` and `constant_m`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TerrainConfig {
    /// Raster of ground heights: a terrain model (DTM), not a surface model (DSM) with roofs on it. Feet become metres where its
    /// band or its CRS states them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dtm: Option<PathBuf>,
    /// One ground height everywhere, metres in the project's vertical reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constant_m: Option<f64>,
    /// Added to every height of the DTM, metres: from its vertical reference to the project's. Has to be stated (0 if
    /// they agree) where both name theirs and the names differ; heights are never shifted in silence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertical_offset_m: Option<f64>,
    /// CRS for a DTM that has none, or that of the DTM with the vertical part that it lacks, as in "EPSG:2263+6360": it states in
    /// what unit heights are. Refused for any other.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub crs: Option<Crs>,
    /// How far beyond the project's area the DTM is read, metres. At least 0. No key of a configuration.
    #[serde(skip)]
    pub margin_m: f64,
    /// Cells smaller than this are averaged on reading, metres. Above 0. No key of a configuration: stages that need less detail
    /// set it.
    #[serde(skip)]
    pub min_cell_m: f64,
}

impl Default for TerrainConfig {
    fn default() -> Self {
        Self { dtm: None, constant_m: None, vertical_offset_m: None, crs: None, margin_m: 100.0, min_cell_m: 0.5 }
    }
}

impl TerrainConfig {
    /// One ground height everywhere, metres.
    #[must_use]
    pub fn constant(height_m: f64) -> Self {
        Self { constant_m: Some(height_m), ..Self::default() }
    }

    /// A terrain model from a file.
    #[must_use]
    pub fn dtm(path: impl Into<PathBuf>) -> Self {
        Self { dtm: Some(path.into()), ..Self::default() }
    }
}

/// Why there is no terrain.
#[derive(Debug, thiserror::Error)]
pub enum TerrainError {
    /// A setting that cannot be.
    #[error("terrain: {problem}\nhint: {hint}")]
    Config {
        /// The problem with the setting, in words.
        problem: String,
        /// Text to write in its place.
        hint: &'static str,
    },
    /// The file cannot be read.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// It has no CRS and none was given.
    #[error(
        "terrain {}: the file has no CRS\nhint: set `crs` to the one it is in, or write it in with `gdal_edit.py -a_srs`",
        path.display()
    )]
    NoCrs {
        /// Path of the terrain model's file.
        path: PathBuf,
    },
    /// No accurate way between its CRS and the project's.
    #[error("terrain {}", path.display())]
    Crs {
        /// Path of the terrain model's file.
        path: PathBuf,
        /// Why its CRS cannot be read or reached.
        #[source]
        source: CrsError,
    },
    /// Two vertical references, and nothing said about how they relate.
    #[error(
        "terrain {}: its heights are {dtm_reference}, the project's are {project_reference}\n\
         hint: set `vertical_offset_m` to what has to be added to the file's heights (0 if they agree here)",
        path.display()
    )]
    VerticalReference {
        /// Path of the terrain model's file.
        path: PathBuf,
        /// Kind of its heights.
        dtm_reference: String,
        /// Kind of the project's heights.
        project_reference: String,
    },
    /// Heights in a unit that is no length.
    #[error(
        "terrain {}: its heights are in {unit:?}, expected metres or feet\n\
         hint: `gdal_edit.py -units m {}` states the unit, `gdal_calc.py` converts heights",
        path.display(), path.display()
    )]
    NotMetres {
        /// Path of the terrain model's file.
        path: PathBuf,
        /// Statement of the file.
        unit: String,
    },
    /// Positions in feet, and no word of the unit of heights.
    #[error(
        "terrain {}: it counts positions in feet ({crs}) and does not say in what it counts heights\nhint: {hint}",
        path.display()
    )]
    HeightUnit {
        /// Path of the terrain model's file.
        path: PathBuf,
        /// CRS of the file.
        crs: String,
        /// Way to state it.
        hint: String,
    },
    /// Two statements about the unit of heights.
    #[error(
        "terrain {}: its band counts heights in {unit:?}, its CRS in another unit ({crs})\n\
         hint: correct the file: `gdal_edit.py -units UNIT` or `-a_srs CRS`",
        path.display()
    )]
    TwoUnits {
        /// Path of the terrain model's file.
        path: PathBuf,
        /// Unit of the band.
        unit: String,
        /// Vertical part of the CRS.
        crs: String,
    },
    /// A terrain model that does not cover the area.
    #[error(
        "terrain {}: it covers {found}, expected it around {expected} ({crs}){distance}\nhint: {hint}",
        path.display()
    )]
    Elsewhere {
        /// Path of the terrain model's file.
        path: PathBuf,
        /// Area that it covers, in the project's CRS where that can be told.
        found: String,
        /// Area that the project needs.
        expected: String,
        /// Definition of the project's CRS.
        crs: String,
        /// Distance between the two, in words, where it is known.
        distance: String,
        /// Advice to the user: what to change or to look at.
        hint: String,
    },
    /// The part that was read has no heights.
    #[error("terrain {}", path.display())]
    Dem {
        /// Path of the terrain model's file.
        path: PathBuf,
        /// Why its grid cannot be used.
        #[source]
        source: DemError,
    },
}

/// Ground, and what is to be said about the file that it was read from.
#[derive(Debug)]
pub struct LoadedTerrain {
    /// Ground in the CRS and the vertical datum of the project.
    pub terrain: Terrain,
    /// Converted units, and cells that hold no ground although no nodata tag names them.
    pub issues: Vec<Issue>,
}

impl From<Terrain> for LoadedTerrain {
    fn from(terrain: Terrain) -> Self {
        Self { terrain, issues: Vec::new() }
    }
}

/// Reads the ground for an area as [`load_with_issues`] does, for those who do not report.
///
/// # Errors
/// [`TerrainError`].
pub fn load(config: &TerrainConfig, project_crs: &Crs, area: MapBox) -> Result<Terrain, TerrainError> {
    load_with_issues(config, project_crs, area).map(|loaded| loaded.terrain)
}

/// Reads the ground for an area (project CRS, metres). A DTM in another CRS is resampled, bilinear, onto a grid of the
/// same cell size in the project's; nodata stays without a value, and so do voids that no tag names.
///
/// # Errors
/// [`TerrainError`].
pub fn load_with_issues(
    config: &TerrainConfig,
    project_crs: &Crs,
    area: MapBox,
) -> Result<LoadedTerrain, TerrainError> {
    let refuse = |problem: &str, hint| Err(TerrainError::Config { problem: problem.to_owned(), hint });
    let offset_m = config.vertical_offset_m.unwrap_or(0.0);
    if !offset_m.is_finite() {
        return refuse("`vertical_offset_m` is no number", "metres, such as 0 or -34.2");
    }
    match (&config.dtm, config.constant_m) {
        (Some(_), Some(_)) => refuse("both `dtm` and `constant_m` are set", "keep one of them"),
        (None, None) => refuse(
            "neither `dtm` nor `constant_m` is set",
            "name a terrain model, or the ground's height in metres where it is flat; `sizeup survey dtm` makes a model from the photos",
        ),
        (None, Some(_)) if config.vertical_offset_m.is_some() => {
            refuse("`vertical_offset_m` belongs to `dtm`", "add it to `constant_m` yourself")
        }
        (None, Some(z_m)) if !z_m.is_finite() => refuse("`constant_m` is no number", "a height in metres"),
        (None, Some(z_m)) => Ok(Terrain::Constant(z_m).into()),
        (Some(path), None) => {
            let is_size = |m: f64| m.is_finite() && m > 0.0;
            if !(is_size(config.min_cell_m) && config.margin_m.is_finite() && config.margin_m >= 0.0) {
                return refuse("`min_cell_m` or `margin_m` is out of range", "a length in metres");
            }
            load_dtm(path, config, project_crs, area.grown(config.margin_m))
        }
    }
}

fn load_dtm(
    path: &Path,
    config: &TerrainConfig,
    project_crs: &Crs,
    area: MapBox,
) -> Result<LoadedTerrain, TerrainError> {
    let file = RasterFile::open(path)?;
    let crs = crs_of(&file, path, config)?;
    if let (Some(dtm), Some(project), None) =
        (crs.vertical_name(), project_crs.vertical_name(), config.vertical_offset_m)
        && dtm != project
        && !crs.has_heights_of(project_crs)
    {
        return Err(TerrainError::VerticalReference {
            path: path.to_owned(),
            dtm_reference: dtm.to_owned(),
            project_reference: project.to_owned(),
        });
    }
    let unit_m = unit_of(&file, path, &crs)?;
    let source = reproject::DtmSource { file: &file, path, crs: &crs, config, unit_m };
    let (dem, voids) = reproject::read(&source, project_crs, area)?;
    let converted = (unit_m != 1.0).then(|| {
        let unit = crs.vertical_name().map_or_else(|| file.unit(BAND).ok().flatten(), |name| Some(name.to_owned()));
        let message = format!(
            "its heights ({}) are multiplied by {unit_m:.7} to metres",
            unit.unwrap_or_else(|| "feet".to_owned())
        );
        Issue::new(Severity::Note, "terrain_converted", Subject::Input(path.display().to_string()), message)
    });
    let n_bands = file.n_bands();
    let others = (n_bands > 1).then(|| {
        let message = format!(
            "it has {n_bands} bands: heights are read from the first (`gdal_translate -b N` writes another alone)"
        );
        Issue::new(Severity::Warning, "terrain_has_bands", Subject::Input(path.display().to_string()), message)
    });
    let issues = converted.into_iter().chain(others).chain(voids).collect();
    Ok(LoadedTerrain { terrain: Terrain::Grid(dem), issues })
}

/// Metres per unit of the heights of a configured DTM; 1 without one.
///
/// # Errors
/// [`TerrainError`] where it cannot be opened, or does not say in what it counts heights.
pub fn height_unit_m(config: &TerrainConfig) -> Result<f64, TerrainError> {
    let Some(path) = &config.dtm else { return Ok(1.0) };
    let file = RasterFile::open(path)?;
    unit_of(&file, path, &crs_of(&file, path, config)?)
}

/// CRS of a DTM: its own, with the vertical part that is stated where it lacks one, or the stated one.
fn crs_of(file: &RasterFile, path: &Path, config: &TerrainConfig) -> Result<Crs, TerrainError> {
    match (file.crs()?, &config.crs) {
        (None, None) => Err(TerrainError::NoCrs { path: path.to_owned() }),
        (None, Some(given)) => Ok(given.clone()),
        (Some(own), None) => Ok(own),
        (Some(own), Some(given)) if own.has_plane_of(given) => Ok(own.with_heights_of(Some(given))),
        (Some(own), Some(given)) => Err(TerrainError::Config {
            problem: format!("{} is in {own}, but `crs` says {given}", path.display()),
            hint: "remove `crs`, or correct the file with `gdal_edit.py -a_srs`",
        }),
    }
}

/// Metres per unit of a DTM's heights, as its band or the vertical part of its CRS states it. In a plane that is counted in metres
/// or degrees heights are metres unless stated; in one that is counted in feet they may be either.
fn unit_of(file: &RasterFile, path: &Path, crs: &Crs) -> Result<f64, TerrainError> {
    /// International and US survey feet, which many files mix up, differ by less.
    const SAME_UNIT: f64 = 1e-4;
    let of_band = match file.unit(BAND)? {
        Some(unit) => match metres_per(&unit) {
            Some(unit_m) => Some((unit_m, unit)),
            None => return Err(TerrainError::NotMetres { path: path.to_owned(), unit }),
        },
        None => None,
    };
    match (of_band, crs.height_unit_m()) {
        (Some((band_m, unit)), Some(crs_m)) if (band_m / crs_m - 1.0).abs() > SAME_UNIT => {
            let crs = crs.vertical_name().unwrap_or_else(|| crs.name()).to_owned();
            Err(TerrainError::TwoUnits { path: path.to_owned(), unit, crs })
        }
        (_, Some(crs_m)) => Ok(crs_m),
        (Some((band_m, _)), None) => Ok(band_m),
        (None, None) if crs.is_metric() => Ok(1.0),
        (None, None) => {
            let hint = crs.horizontal_epsg().map_or_else(
                || "state `crs` with a vertical part, such as \"EPSG:2263+6360\"".to_owned(),
                |code| {
                    format!(
                        "state `crs` with a vertical part: in the USA \"EPSG:{code}+6360\" (NAVD88 in US survey feet) or \
                         \"EPSG:{code}+5703\" (NAVD88 in metres); or write the unit into the file: `gdal_edit.py -units ft`"
                    )
                },
            );
            Err(TerrainError::HeightUnit { path: path.to_owned(), crs: crs.to_string(), hint })
        }
    }
}
