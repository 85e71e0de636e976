//! Terrain from a DTM file or a constant.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::reproject::{self, MapBox};
use super::{Dem, DemError, Terrain};
use crate::crs::{Crs, CrsError};
use crate::geodata::raster::{RasterError, RasterFile};

/// Where the ground is: exactly one of `dtm` and `constant_m`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TerrainConfig {
    /// Raster of ground heights in metres: a terrain model (DTM), not a surface model (DSM) with roofs on it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dtm: Option<PathBuf>,
    /// One ground height everywhere, metres in the project's vertical reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constant_m: Option<f64>,
    /// Added to every height of the DTM, metres: from its vertical reference to the project's. Has to be stated (0 if
    /// they agree) where both name theirs and the names differ; heights are never shifted in silence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertical_offset_m: Option<f64>,
    /// CRS for a DTM that has none; refused for any other.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub crs: Option<Crs>,
    /// Band of the DTM that holds the heights, from 1.
    #[schemars(extend("x-expert" = true))]
    pub band: usize,
    /// How far beyond the project's area the DTM is read, metres. At least 0.
    #[schemars(extend("x-expert" = true))]
    pub margin_m: f64,
    /// Cells smaller than this are averaged on reading, metres. Above 0.
    #[schemars(extend("x-expert" = true))]
    pub min_cell_m: f64,
}

impl Default for TerrainConfig {
    fn default() -> Self {
        Self {
            dtm: None,
            constant_m: None,
            vertical_offset_m: None,
            crs: None,
            band: 1,
            margin_m: 100.0,
            min_cell_m: 0.5,
        }
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
    /// Heights that are not in metres.
    #[error("terrain {}: its heights are in {unit:?}, expected metres\nhint: `gdal_calc.py` converts them", path.display())]
    NotMetres {
        /// Path of the terrain model's file.
        path: PathBuf,
        /// Statement of the file.
        unit: String,
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

/// Reads the ground for an area (project CRS, metres). A DTM in another CRS is resampled, bilinear, onto a grid of the
/// same cell size in the project's; nodata stays without a value.
///
/// # Errors
/// [`TerrainError`].
pub fn load(config: &TerrainConfig, project_crs: &Crs, area: MapBox) -> Result<Terrain, TerrainError> {
    let refuse = |problem: &str, hint| Err(TerrainError::Config { problem: problem.to_owned(), hint });
    let offset_m = config.vertical_offset_m.unwrap_or(0.0);
    if !offset_m.is_finite() {
        return refuse("`vertical_offset_m` is no number", "metres, such as 0 or -34.2");
    }
    match (&config.dtm, config.constant_m) {
        (Some(_), Some(_)) => refuse("both `dtm` and `constant_m` are set", "keep one of them"),
        (None, None) => refuse(
            "neither `dtm` nor `constant_m` is set",
            "name a terrain model, or the ground's height in metres where it is flat; `sizeup dtm` makes a model from the photos",
        ),
        (None, Some(_)) if config.vertical_offset_m.is_some() => {
            refuse("`vertical_offset_m` belongs to `dtm`", "add it to `constant_m` yourself")
        }
        (None, Some(z_m)) if !z_m.is_finite() => refuse("`constant_m` is no number", "a height in metres"),
        (None, Some(z_m)) => Ok(Terrain::Constant(z_m)),
        (Some(path), None) => {
            let is_size = |m: f64| m.is_finite() && m > 0.0;
            if !(is_size(config.min_cell_m) && config.margin_m.is_finite() && config.margin_m >= 0.0) {
                return refuse("`min_cell_m` or `margin_m` is out of range", "a length in metres");
            }
            load_dtm(path, config, project_crs, area.grown(config.margin_m)).map(Terrain::Grid)
        }
    }
}

fn load_dtm(path: &Path, config: &TerrainConfig, project_crs: &Crs, area: MapBox) -> Result<Dem, TerrainError> {
    let file = RasterFile::open(path)?;
    let crs = match (file.crs()?, &config.crs) {
        (None, None) => return Err(TerrainError::NoCrs { path: path.to_owned() }),
        (None, Some(given)) => given.clone(),
        (Some(own), None) => own,
        (Some(own), Some(given)) if own.horizontal_epsg() == given.horizontal_epsg() => own,
        (Some(own), Some(given)) => {
            return Err(TerrainError::Config {
                problem: format!("{} is in {own}, but `crs` says {given}", path.display()),
                hint: "remove `crs`, or correct the file with `gdal_edit.py -a_srs`",
            });
        }
    };
    if let (Some(dtm), Some(project), None) =
        (crs.vertical_name(), project_crs.vertical_name(), config.vertical_offset_m)
        && dtm != project
    {
        return Err(TerrainError::VerticalReference {
            path: path.to_owned(),
            dtm_reference: dtm.to_owned(),
            project_reference: project.to_owned(),
        });
    }
    let is_metres = |unit: &str| ["m", "metre", "meter", "metres", "meters"].contains(&unit.to_lowercase().as_str());
    if let Some(unit) = file.unit(config.band)?.filter(|unit| !is_metres(unit)) {
        return Err(TerrainError::NotMetres { path: path.to_owned(), unit });
    }
    reproject::read(&reproject::DtmSource { file: &file, path, crs: &crs, config }, project_crs, area)
}
