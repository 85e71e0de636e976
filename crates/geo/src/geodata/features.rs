//! Layers of features for the writers: what they hold, and the way from a row to GDAL.

use std::borrow::Cow;

use gdal::Dataset;
use gdal::errors::GdalError;
use gdal::spatial_ref::SpatialRef;
use gdal::vector::{Feature, FieldDefn, Geometry, LayerAccess, LayerOptions, OGRFieldType, OGRwkbGeometryType};
use serde_json::Value;

/// Shape of a layer's features.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GeometryKind {
    /// A point with x and y.
    Point,
    /// A point with x, y and z.
    PointZ,
    /// A polygon with x and y.
    Polygon,
    /// A multipolygon with x and y.
    MultiPolygon,
    /// A multipolygon with x, y and z.
    MultiPolygonZ,
}

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    /// Text of any length.
    Text,
    /// Real numbers, 64 bits.
    Real,
    /// Whole numbers with sign, 64 bits.
    Integer,
    /// 0 or 1, in 32 bits where a format tells numbers apart by their size.
    Flag,
}

impl ColumnKind {
    /// The narrowest type that holds what came so far and one more value; `None` while all are missing.
    #[must_use]
    pub fn wider(so_far: Option<Self>, value: &Value) -> Option<Self> {
        let needed = match value {
            Value::Null => return so_far,
            Value::Bool(_) => Self::Integer,
            Value::Number(number) if number.as_i64().is_some() => Self::Integer,
            Value::Number(_) => Self::Real,
            Value::String(_) | Value::Array(_) | Value::Object(_) => Self::Text,
        };
        Some(match (so_far, needed) {
            (None, needed) => needed,
            (Some(a), b) if a == b => a,
            (Some(Self::Integer), Self::Real) | (Some(Self::Real), Self::Integer) => Self::Real,
            _ => Self::Text,
        })
    }
}

/// A column of a layer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Name of the column, unique in its table.
    pub name: Cow<'static, str>,
    /// Type of the values.
    pub kind: ColumnKind,
    /// Name for people, one of its kind in the layer; written to `gpkg_data_columns`, and as the alias of QGIS.
    pub title: Cow<'static, str>,
    /// Meaning and unit, one line; written to `gpkg_data_columns`.
    pub meaning: &'static str,
}

impl Column {
    /// A column whose name is known in advance.
    #[must_use]
    pub const fn new(name: &'static str, title: &'static str, kind: ColumnKind, meaning: &'static str) -> Self {
        Self { name: Cow::Borrowed(name), kind, title: Cow::Borrowed(title), meaning }
    }

    /// A column that came with the input, under its own name and what people call it.
    #[must_use]
    pub const fn carried(name: String, title: String, kind: ColumnKind) -> Self {
        Self { name: Cow::Owned(name), kind, title: Cow::Owned(title), meaning: "Attribute of the input" }
    }
}

/// The feature id, which GDAL adds to every layer of a `GeoPackage`.
pub const FID: Column = Column::new("fid", "Row", ColumnKind::Integer, "Number of the row in the layer");

/// A title for a column that came with the input: what the input calls it, told apart from the names and titles that are
/// taken.
#[must_use]
pub fn free_title(name: &str, taken: &[Column]) -> String {
    let own = FID;
    let is_taken = |title: &str| {
        let mut names = taken.iter().chain([&own]).flat_map(|column| [&column.name, &column.title]);
        names.any(|other| other.to_lowercase() == title.to_lowercase())
    };
    let mut title = name.to_owned();
    while is_taken(&title) {
        title.push_str(" (input)");
    }
    title
}

/// A layer to create.
#[derive(Debug, Clone)]
pub struct LayerSpec<'a> {
    /// Name of the table.
    pub name: &'a str,
    /// One line for people.
    pub description: &'a str,
    /// Shape of its features.
    pub geometry: GeometryKind,
    /// Attribute columns, without the feature id and the geometry.
    pub columns: &'a [Column],
}

/// One feature: well-known binary or nothing, and one value per column (`Null`, text or number).
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// ISO WKB of the layer's geometry kind.
    pub wkb: Option<Vec<u8>>,
    /// In the order of the columns.
    pub values: Vec<Value>,
}

/// Adds a layer to a dataset, and all features that `fill` hands to its argument.
///
/// `failed` turns GDAL's errors into the caller's.
pub(super) fn write_features<E>(
    dataset: &mut Dataset,
    crs: &SpatialRef,
    spec: &LayerSpec<'_>,
    options: &[&str],
    failed: &dyn Fn(GdalError) -> E,
    fill: impl FnOnce(&mut dyn FnMut(Row) -> Result<(), E>) -> Result<(), E>,
) -> Result<(), E> {
    let (ty, options) = (wkb_type(spec.geometry), Some(options));
    let layer = dataset.create_layer(LayerOptions { name: spec.name, srs: Some(crs), ty, options }).map_err(failed)?;
    for column in spec.columns {
        FieldDefn::new(&column.name, field_type(column.kind))
            .and_then(|field| field.add_to_layer(&layer))
            .map_err(failed)?;
    }
    let write = |row: &Row| -> Result<(), GdalError> {
        let mut feature = Feature::new(layer.defn())?;
        if let Some(wkb) = &row.wkb {
            feature.set_geometry(Geometry::from_wkb(wkb)?)?;
        }
        // GDAL may launder a name, so the fields are addressed by position.
        for (i, (column, value)) in spec.columns.iter().zip(&row.values).enumerate() {
            set_field(&mut feature, i, column.kind, value)?;
        }
        feature.create(&layer)
    };
    fill(&mut |row| write(&row).map_err(failed))
}

fn set_field(feature: &mut Feature<'_>, i: usize, kind: ColumnKind, value: &Value) -> Result<(), GdalError> {
    match (kind, value) {
        (_, Value::Null) => feature.set_field_null(i),
        (ColumnKind::Real, Value::Number(number)) => match number.as_f64() {
            Some(number) => feature.set_field_double(i, number),
            None => feature.set_field_null(i),
        },
        (ColumnKind::Integer, Value::Number(number)) => match number.as_i64() {
            Some(number) => feature.set_field_integer64(i, number),
            None => feature.set_field_null(i),
        },
        (ColumnKind::Flag, Value::Number(number)) => {
            feature.set_field_integer(i, i32::from(number.as_i64() != Some(0)))
        }
        (ColumnKind::Text, Value::String(words)) => feature.set_field_string(i, &words.replace('\0', "")),
        (_, other) => feature.set_field_string(i, &other.to_string()),
    }
}

fn wkb_type(kind: GeometryKind) -> OGRwkbGeometryType::Type {
    match kind {
        GeometryKind::Point => OGRwkbGeometryType::wkbPoint,
        GeometryKind::PointZ => OGRwkbGeometryType::wkbPoint25D,
        GeometryKind::Polygon => OGRwkbGeometryType::wkbPolygon,
        GeometryKind::MultiPolygon => OGRwkbGeometryType::wkbMultiPolygon,
        GeometryKind::MultiPolygonZ => OGRwkbGeometryType::wkbMultiPolygon25D,
    }
}

fn field_type(kind: ColumnKind) -> OGRFieldType::Type {
    match kind {
        ColumnKind::Text => OGRFieldType::OFTString,
        ColumnKind::Real => OGRFieldType::OFTReal,
        ColumnKind::Integer => OGRFieldType::OFTInteger64,
        ColumnKind::Flag => OGRFieldType::OFTInteger,
    }
}
