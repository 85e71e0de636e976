//! Reading the polygons of a vector layer with their attributes, through GDAL.

use std::path::{Path, PathBuf};

use gdal::errors::GdalError;
use gdal::vector::{FieldValue, Geometry, LayerAccess, OGRwkbGeometryType as Kind};
use gdal::{Dataset, DatasetOptions, GdalOpenFlags};
use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use serde_json::{Map as JsonMap, Value};

use crate::crs::{Crs, CrsError};

/// Why a layer cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum FeaturesError {
    /// GDAL cannot open it.
    #[error("cannot open layer {}\nhint: `ogrinfo {}` shows what GDAL makes of it", path.display(), path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// GDAL's words.
        #[source]
        source: GdalError,
    },
    /// Several layers, and none is the one.
    #[error("{} has the layers {}\nhint: name one of them", path.display(), layers.join(", "))]
    Layer {
        /// The file.
        path: PathBuf,
        /// Their names.
        layers: Vec<String>,
    },
    /// PROJ does not understand its CRS.
    #[error("the CRS of {} cannot be used", path.display())]
    Crs {
        /// The file.
        path: PathBuf,
        /// Why not.
        #[source]
        source: CrsError,
    },
}

/// One feature.
#[derive(Debug, Clone, PartialEq)]
pub struct PolygonFeature {
    /// The layer's own number for it.
    pub fid: Option<u64>,
    /// Its polygons; `None` for anything else.
    pub outline: Option<MultiPolygon<f64>>,
    /// Its attributes.
    pub attributes: JsonMap<String, Value>,
}

/// A layer as read.
#[derive(Debug, Clone)]
pub struct PolygonTable {
    /// Its CRS, where it has one.
    pub crs: Option<Crs>,
    /// Names of its attributes.
    pub fields: Vec<String>,
    /// Its features in order.
    pub features: Vec<PolygonFeature>,
}

/// Reads a layer by name; without a name the only one, or the one called `preferred`.
///
/// # Errors
/// [`FeaturesError`].
pub fn read_polygons(path: &Path, layer: Option<&str>, preferred: &str) -> Result<PolygonTable, FeaturesError> {
    let open = |source| FeaturesError::Open { path: path.to_owned(), source };
    let options = DatasetOptions { open_flags: GdalOpenFlags::GDAL_OF_VECTOR, ..Default::default() };
    let dataset = Dataset::open_ex(path, options).map_err(open)?;
    let names: Vec<String> =
        dataset.layers().filter(|l| l.defn().geometry_type() != Kind::wkbNone).map(|l| l.name()).collect();
    let name = match (layer, names.as_slice()) {
        (Some(layer), names) if names.iter().any(|n| n == layer) => layer,
        (None, [only]) => only,
        (None, names) if names.iter().any(|n| n == preferred) => preferred,
        _ => return Err(FeaturesError::Layer { path: path.to_owned(), layers: names }),
    };
    let mut layer = dataset.layer_by_name(name).map_err(open)?;
    let crs = match layer.spatial_ref().and_then(|srs| srs.to_projjson().or_else(|_| srs.to_wkt()).ok()) {
        Some(definition) => {
            Some(Crs::parse(&definition).map_err(|source| FeaturesError::Crs { path: path.to_owned(), source })?)
        }
        None => None,
    };
    let fields: Vec<String> = layer.defn().fields().map(|field| field.name()).collect();
    let features = layer
        .features()
        .map(|feature| PolygonFeature {
            fid: feature.fid(),
            outline: feature.geometry().and_then(outline),
            attributes: feature.fields().map(|(name, value)| (name, value.map_or(Value::Null, json))).collect(),
        })
        .collect();
    Ok(PolygonTable { crs, fields, features })
}

fn json(value: FieldValue) -> Value {
    match value {
        FieldValue::IntegerValue(v) => v.into(),
        FieldValue::Integer64Value(v) => v.into(),
        FieldValue::RealValue(v) => v.into(),
        FieldValue::StringValue(v) => v.into(),
        FieldValue::StringListValue(v) => v.into(),
        FieldValue::IntegerListValue(v) => v.into(),
        FieldValue::Integer64ListValue(v) => v.into(),
        FieldValue::RealListValue(v) => v.into(),
        FieldValue::DateValue(v) => v.to_string().into(),
        FieldValue::DateTimeValue(v) => format!("{v:?}").into(),
    }
}

fn outline(geometry: &Geometry) -> Option<MultiPolygon<f64>> {
    if !geometry.has_gdal_ptr() || geometry.is_empty() {
        return None;
    }
    match gdal::vector::geometry_type_flatten(geometry.geometry_type()) {
        Kind::wkbPolygon => Some(MultiPolygon::new(vec![polygon(geometry)?])),
        Kind::wkbMultiPolygon => (0..geometry.geometry_count())
            .map(|i| polygon(&geometry.get_geometry(i)))
            .collect::<Option<Vec<_>>>()
            .map(MultiPolygon::new),
        _ => None,
    }
}

fn polygon(geometry: &Geometry) -> Option<Polygon<f64>> {
    let ring = |i: usize| {
        let mut points = Vec::new();
        geometry.get_geometry(i).get_points(&mut points);
        points.into_iter().map(|(x, y, _)| Coord { x, y }).collect::<LineString<f64>>()
    };
    let mut rings = (0..geometry.geometry_count()).map(ring);
    Some(Polygon::new(rings.next()?, rings.collect()))
}
