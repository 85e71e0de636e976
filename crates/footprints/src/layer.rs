//! Footprints from a vector layer, in whatever CRS and shape people keep them.
//!
//! Every feature of the layer ends in [`FootprintLayer::footprints`] or [`FootprintLayer::refused`]; what had to be
//! done to it is an issue with its place.

use std::path::PathBuf;

use geo_types::Coord;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::features::FeatureReader;
use super::overlap::refuse_duplicates;
use super::{FootprintLayer, osm, overlaps};
use sizeup_geo::crs::{Crs, CrsError, Transform};
use sizeup_geo::geodata::vector::{Feature, FeatureGeometry, VectorError};
use sizeup_photos::onnx::OnnxError;

/// Where the footprints are and how to read them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FootprintConfig {
    /// Vector file: GeoPackage, GeoJSON, Shapefile, FlatGeobuf, OpenStreetMap (`.osm`, `.osm.pbf`) or anything else GDAL reads.
    pub path: PathBuf,
    /// Layer of the file; may be left out where there is only one. Of an OpenStreetMap file the buildings where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layer: Option<String>,
    /// Attribute that holds each building's id; where left out the layer's own feature numbers, `way/123` of OpenStreetMap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id_field: Option<String>,
    /// CRS for a layer that has none or states degrees over coordinates that are metres; refused for any other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub crs: Option<Crs>,
    /// Moves the whole layer, east and north, metres: by as much as it is known to be off.
    #[serde(default)]
    pub shift_m: [f64; 2],
    /// Least area of a building, m²; smaller ones are refused by name. At least 0.
    #[serde(default = "default_min_area_m2")]
    pub min_area_m2: f64,
    /// Corners are snapped to multiples of this, metres, so that what is valid here is valid in the files. No key of a
    /// configuration: layers that sizeup wrote itself have a finer grid.
    #[serde(skip, default = "default_grid_m")]
    pub grid_m: f64,
    /// Overlaps of two footprints above this are reported, m². No key of a configuration: layers that sizeup wrote itself are
    /// not checked again.
    #[serde(skip, default = "default_overlap_warning_m2")]
    pub overlap_warning_m2: f64,
}

/// Most that repairing a self-crossing footprint may change its area, as a share of it.
pub const MAX_AREA_CHANGE: f64 = 0.01;

/// Layers are moved by no more than this along each axis, metres.
const MOST_SHIFTED_M: f64 = 1000.0;

fn default_min_area_m2() -> f64 {
    1.0
}

fn default_grid_m() -> f64 {
    0.001
}

fn default_overlap_warning_m2() -> f64 {
    1.0
}

impl FootprintConfig {
    /// The only layer of a file, with all defaults.
    #[must_use]
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            layer: None,
            id_field: None,
            crs: None,
            shift_m: [0.0; 2],
            min_area_m2: default_min_area_m2(),
            grid_m: default_grid_m(),
            overlap_warning_m2: default_overlap_warning_m2(),
        }
    }
}

/// Why a layer as a whole cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FootprintError {
    /// A setting outside its range.
    #[error("footprints: {field} = {value}: expected {expected}")]
    Config {
        /// Name of the setting.
        field: &'static str,
        /// The value that was set.
        value: f64,
        /// Values that are allowed, in words.
        expected: &'static str,
    },
    /// It cannot be read.
    #[error(transparent)]
    Vector(#[from] VectorError),
    /// It has no CRS and none was given.
    #[error(
        "footprints {}: the layer has no CRS\nhint: set `crs` to the one its coordinates are in, such as \"EPSG:25832\"",
        path.display()
    )]
    NoCrs {
        /// Path of the layer's file.
        path: PathBuf,
    },
    /// It has a CRS and another one was given.
    #[error(
        "footprints {}: the layer is in {layer_crs}, but `crs` says {given}\n\
         hint: remove `crs`, or correct the layer with `ogr2ogr -a_srs {given} OUTPUT INPUT`",
        path.display()
    )]
    CrsConflict {
        /// Path of the layer's file.
        path: PathBuf,
        /// Statement of the layer.
        layer_crs: String,
        /// Statement of the configuration.
        given: String,
    },
    /// It claims degrees, and its coordinates are none.
    #[error(
        "footprints {}: the layer states {layer_crs}, but ({x}, {y}) are no longitude and latitude\n\
         hint: {}",
        path.display(),
        if y.abs() > 90.0 && y.abs() <= 180.0 && x.abs() <= 90.0 {
            "the axes look swapped: longitude comes first"
        } else {
            "set `crs` to the one its coordinates are in"
        }
    )]
    NotDegrees {
        /// Path of the layer's file.
        path: PathBuf,
        /// Statement of the layer.
        layer_crs: String,
        /// First coordinate of the first offending corner.
        x: f64,
        /// Second coordinate of it.
        y: f64,
    },
    /// Coordinates in degrees that have latitude before longitude.
    #[error(
        "footprints {}: ({x}, {y}) as longitude and latitude is far from where {project_crs} is used, and ({y}, {x}) is not\n\
         hint: the axes look swapped: longitude comes first",
        path.display()
    )]
    SwappedAxes {
        /// Path of the layer's file.
        path: PathBuf,
        /// First coordinate of the first corner.
        x: f64,
        /// Second coordinate of it.
        y: f64,
        /// The project's CRS, near whose area the swapped coordinates lie.
        project_crs: String,
    },
    /// No accurate way from its CRS to the project's.
    #[error("footprints {}", path.display())]
    Crs {
        /// Path of the layer's file.
        path: PathBuf,
        /// Why its CRS cannot be read or reached.
        #[source]
        source: CrsError,
    },
    /// The attribute for ids does not exist.
    #[error(
        "footprints {}: no attribute {field:?}\nhint: set `id_field` to one of {}",
        path.display(),
        present.join(", ")
    )]
    NoIdField {
        /// Path of the layer's file.
        path: PathBuf,
        /// Attribute that was asked for.
        field: String,
        /// Attributes that the layer has.
        present: Vec<String>,
    },
    /// Masks or their settings cannot be used.
    #[error("footprints: {problem}\nhint: {hint}")]
    Masks {
        /// The problem with the masks or the network, in words.
        problem: String,
        /// Advice to the user: what to change or to look at.
        hint: String,
    },
    /// A network that cannot be loaded or run.
    #[error(transparent)]
    Network(#[from] OnnxError),
    /// It has no features.
    #[error(
        "footprints {}: layer {layer:?} is empty\nhint: is it the right file? `layer` chooses among several in one",
        path.display()
    )]
    Empty {
        /// Path of the layer's file.
        path: PathBuf,
        /// Name of the layer in its file.
        layer: String,
    },
}

/// Reads a layer into the project's horizontal CRS, metres. Heights (Z) and measures (M) are dropped, multi-part
/// features become one footprint per part (`id#1`, `id#2`, …), repeated ids are told apart (`id~2`).
///
/// # Errors
/// [`FootprintError`] where the layer as a whole cannot be used; single features never fail the layer.
pub fn read(config: &FootprintConfig, project_crs: &Crs) -> Result<FootprintLayer, FootprintError> {
    check_config(config)?;
    let mut source = osm::open_layer(config)?;
    let declared = source.crs()?;
    let features: Vec<Feature> = source.features().collect();
    if features.is_empty() {
        return Err(FootprintError::Empty { path: config.path.clone(), layer: source.name() });
    }
    if let Some(field) = config.id_field.as_ref().filter(|wanted| !source.field_names().any(|f| f == *wanted)) {
        let present = source.field_names().map(str::to_owned).collect();
        return Err(FootprintError::NoIdField { path: config.path.clone(), field: field.clone(), present });
    }
    let crs = settle_crs(config, declared, &features, project_crs)?;
    let to_project = Transform::new(&crs, project_crs)
        .map_err(|source| FootprintError::Crs { path: config.path.clone(), source })?;

    let mut reader = FeatureReader::new(config, to_project);
    for (i, feature) in features.iter().enumerate() {
        reader.add(i, feature);
    }
    let mut layer = reader.finish();
    refuse_duplicates(&mut layer);
    layer.issues.extend(overlaps(&layer.footprints, config.overlap_warning_m2));
    Ok(layer)
}

pub(super) fn check_config(config: &FootprintConfig) -> Result<(), FootprintError> {
    let refuse = |field, value, expected| Err(FootprintError::Config { field, value, expected });
    let is_at_least_0 = |v: f64| v.is_finite() && v >= 0.0;
    if !is_at_least_0(config.min_area_m2) {
        return refuse("min_area_m2", config.min_area_m2, "at least 0 m²");
    }
    if let Some(way_m) = config.shift_m.into_iter().find(|way_m| way_m.is_nan() || way_m.abs() > MOST_SHIFTED_M) {
        return refuse("shift_m", way_m, "at most 1000 m each; more is another CRS: see `crs`");
    }
    Ok(())
}

/// The layer's own CRS, unless it has none or its coordinates cannot be in it (GeoJSON without a CRS is WGS 84 by its
/// standard, and many a file is in metres all the same).
pub(super) fn settle_crs(
    config: &FootprintConfig,
    declared: Option<Crs>,
    features: &[Feature],
    project_crs: &Crs,
) -> Result<Crs, FootprintError> {
    let path = || config.path.clone();
    let Some(declared) = declared else {
        return config.crs.clone().ok_or_else(|| FootprintError::NoCrs { path: path() });
    };
    let no_degrees = if declared.is_projected() { None } else { corner_beyond_degrees(features) };
    if no_degrees.is_none()
        && declared.is_geographic()
        && let Some(Coord { x, y }) = swapped_corner(features, project_crs)
    {
        return Err(FootprintError::SwappedAxes { path: path(), x, y, project_crs: project_crs.to_string() });
    }
    match (&config.crs, no_degrees) {
        (None, None) => Ok(declared),
        (Some(given), None) if given.horizontal_epsg() == declared.horizontal_epsg() => Ok(declared),
        (Some(given), None) => {
            Err(FootprintError::CrsConflict { path: path(), layer_crs: declared.to_string(), given: given.to_string() })
        }
        (Some(given), Some(_)) => Ok(given.clone()),
        (None, Some(Coord { x, y })) => {
            Err(FootprintError::NotDegrees { path: path(), layer_crs: declared.to_string(), x, y })
        }
    }
}

fn corner_beyond_degrees(features: &[Feature]) -> Option<Coord<f64>> {
    corners(features).find(|c| c.x.abs() > 360.0 || c.y.abs() > 90.0)
}

/// The first corner of a layer whose corners all lie in the project's area if latitude comes first, and none otherwise.
fn swapped_corner(features: &[Feature], project_crs: &Crs) -> Option<Coord<f64>> {
    let [west, south, east, north] = project_crs.area_of_use_deg()?;
    let is_in_area = |lon: f64, lat: f64| (west..=east).contains(&lon) && (south..=north).contains(&lat);
    let is_swapped = corners(features).all(|c| !is_in_area(c.x, c.y) && is_in_area(c.y, c.x));
    corners(features).next().filter(|_| is_swapped)
}

fn corners(features: &[Feature]) -> impl Iterator<Item = Coord<f64>> + '_ {
    let shapes = features.iter().filter_map(|feature| match &feature.geometry {
        FeatureGeometry::Shape(shape) => Some(shape),
        FeatureGeometry::Missing | FeatureGeometry::Unsupported(_) => None,
    });
    shapes.flat_map(geo::CoordsIter::coords_iter)
}
