//! Writing a `GeoPackage` through GDAL: layers, plain tables and the contents that GDAL has no call for.
//!
//! Everything happens in one transaction (8 times faster than without). Dates that the format demands come from the
//! caller (GDAL's `OGR_CURRENT_DATE`), so that the same content is the same bytes.

use std::path::{Path, PathBuf};

use gdal::config::{clear_thread_local_config_option, set_thread_local_config_option};
use gdal::errors::GdalError;
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};
use gdal::vector::sql::Dialect;
use gdal::vector::{Feature, FieldDefn, Geometry, LayerAccess, LayerOptions, OGRFieldType, OGRwkbGeometryType};
use gdal::{Dataset, DriverManager};
use serde_json::Value;

/// What GDAL could not do, and to which file.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} in {}", path.display())]
pub struct GpkgError {
    /// What was being done, as in "create layer buildings".
    pub action: String,
    /// To which file.
    pub path: PathBuf,
    /// GDAL's words.
    #[source]
    pub source: GdalError,
}

/// Shape of a layer's features.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GeometryKind {
    /// 2D point.
    Point,
    /// 3D point.
    PointZ,
    /// 2D polygon.
    Polygon,
    /// 2D multipolygon.
    MultiPolygon,
    /// 3D multipolygon.
    MultiPolygonZ,
}

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    /// Text.
    Text,
    /// Real number.
    Real,
    /// 64-bit whole number.
    Integer,
}

/// A column of a layer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Name.
    pub name: String,
    /// Type.
    pub kind: ColumnKind,
    /// Meaning and unit, one line; written to `gpkg_data_columns`. May be empty.
    pub meaning: String,
}

/// A layer to create.
#[derive(Debug, Clone)]
pub struct LayerSpec<'a> {
    /// Table name.
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

/// An open `GeoPackage` inside its transaction.
pub struct Writer<'a> {
    dataset: &'a mut Dataset,
    path: PathBuf,
    crs: SpatialRef,
}

/// Creates `path`, which must not exist, and fills it in one transaction.
///
/// `crs_definition`: anything PROJ reads; compounds keep their vertical part. `timestamp`: ISO 8601 in UTC with
/// milliseconds, for the columns where the format wants the time of the last change.
///
/// # Errors
/// [`GpkgError`] with what could not be done, or the error of `fill`. The file is then incomplete: write through
/// [`crate::files::write_whole_by_name`].
pub fn create<E: From<GpkgError>>(
    path: &Path,
    crs_definition: &str,
    timestamp: &str,
    fill: impl FnOnce(&mut Writer<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let failed = |action: &str| {
        let (action, path) = (action.to_owned(), path.to_owned());
        move |source| GpkgError { action, path, source }
    };
    let _options = ThreadOptions::set(timestamp).map_err(failed("set the date"))?;
    let mut crs = SpatialRef::from_definition(crs_definition).map_err(failed("use the CRS"))?;
    crs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    let driver = DriverManager::get_driver_by_name("GPKG").map_err(failed("find the GPKG driver"))?;
    let mut dataset = driver.create_vector_only(path).map_err(failed("create the file"))?;
    {
        let mut transaction = dataset.start_transaction().map_err(failed("start a transaction"))?;
        fill(&mut Writer { dataset: &mut transaction, path: path.to_owned(), crs })?;
        transaction.commit().map_err(failed("commit the transaction"))?;
    }
    // Spatial indexes are built here.
    dataset.close().map_err(failed("close the file"))?;
    Ok(())
}

/// GDAL's options for this thread while a file is written, cleared on drop.
struct ThreadOptions;

impl ThreadOptions {
    /// The time that the format's columns get.
    const DATE: &str = "OGR_CURRENT_DATE";
    /// The spatial index of a large layer, built on another thread in a database of its own: GDAL 3.6 cannot detach
    /// that database again within our transaction.
    const THREADED_INDEX: &str = "OGR_GPKG_ALLOW_THREADED_RTREE";

    fn set(timestamp: &str) -> Result<Self, GdalError> {
        set_thread_local_config_option(Self::DATE, timestamp)?;
        set_thread_local_config_option(Self::THREADED_INDEX, "NO")?;
        Ok(Self)
    }
}

impl Drop for ThreadOptions {
    fn drop(&mut self) {
        for option in [Self::DATE, Self::THREADED_INDEX] {
            // Fails only for a name with a NUL byte.
            let _ = clear_thread_local_config_option(option);
        }
    }
}

impl Writer<'_> {
    /// Adds a layer with a spatial index and all its features.
    ///
    /// # Errors
    /// [`GpkgError`].
    pub fn layer(&mut self, spec: &LayerSpec<'_>, rows: impl Iterator<Item = Row>) -> Result<(), GpkgError> {
        self.features(spec, rows).map_err(self.failed(&format!("write layer {}", spec.name)))?;
        for column in spec.columns.iter().filter(|column| !column.meaning.is_empty()) {
            let (layer, name, meaning) = (text(spec.name), text(&column.name), text(&column.meaning));
            self.sql(&format!(
                "INSERT INTO gpkg_data_columns (table_name, column_name, description) VALUES ({layer}, {name}, {meaning})"
            ))?;
        }
        Ok(())
    }

    /// Creates the schema extension's table of column meanings, which [`Self::layer`] fills (OGC 12-128r15, F.9).
    ///
    /// # Errors
    /// [`GpkgError`].
    pub fn create_data_columns(&mut self) -> Result<(), GpkgError> {
        self.sql(
            "CREATE TABLE gpkg_data_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL, name TEXT, title TEXT, \
             description TEXT, mime_type TEXT, constraint_name TEXT, \
             CONSTRAINT pk_gdc PRIMARY KEY (table_name, column_name), CONSTRAINT gdc_tn UNIQUE (table_name, name))",
        )?;
        let definition = "http://www.geopackage.org/spec121/#extension_schema";
        self.extension(&["gpkg_data_columns"], "gpkg_schema", definition)
    }

    /// Registers tables with an extension of the standard.
    ///
    /// # Errors
    /// [`GpkgError`].
    pub fn extension(&mut self, tables: &[&str], name: &str, definition: &str) -> Result<(), GpkgError> {
        // GDAL makes this table only when it needs it itself.
        self.sql(
            "CREATE TABLE IF NOT EXISTS gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, \
             definition TEXT NOT NULL, scope TEXT NOT NULL, CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name))",
        )?;
        for table in tables {
            self.sql(&format!(
                "INSERT INTO gpkg_extensions (table_name, column_name, extension_name, definition, scope) \
                 VALUES ({}, NULL, {}, {}, 'read-write')",
                text(table),
                text(name),
                text(definition)
            ))?;
        }
        Ok(())
    }

    /// Runs one SQL statement without a result. Text values go through [`text`].
    ///
    /// # Errors
    /// [`GpkgError`] with the statement's first words.
    pub fn sql(&mut self, statement: &str) -> Result<(), GpkgError> {
        let head: String = statement.chars().take(60).collect();
        match self.dataset.execute_sql(statement, None, Dialect::DEFAULT) {
            Ok(_) => Ok(()),
            Err(source) => Err(self.failed(&format!("run {head:?}"))(source)),
        }
    }

    fn features(&mut self, spec: &LayerSpec<'_>, rows: impl Iterator<Item = Row>) -> Result<(), GdalError> {
        let description = format!("DESCRIPTION={}", spec.description);
        let identifier = format!("IDENTIFIER={}", spec.name);
        let options = ["GEOMETRY_NAME=geom", "FID=fid", "SPATIAL_INDEX=YES", &identifier, &description];
        let layer = self.dataset.create_layer(LayerOptions {
            name: spec.name,
            srs: Some(&self.crs),
            ty: wkb_type(spec.geometry),
            options: Some(&options),
        })?;
        for column in spec.columns {
            FieldDefn::new(&column.name, field_type(column.kind))?.add_to_layer(&layer)?;
        }
        // GDAL may launder a name, so the fields are addressed by position.
        for row in rows {
            let mut feature = Feature::new(layer.defn())?;
            if let Some(wkb) = &row.wkb {
                feature.set_geometry(Geometry::from_wkb(wkb)?)?;
            }
            for (i, (column, value)) in spec.columns.iter().zip(&row.values).enumerate() {
                set_field(&mut feature, i, column.kind, value)?;
            }
            feature.create(&layer)?;
        }
        Ok(())
    }

    fn failed(&self, action: &str) -> impl FnOnce(GdalError) -> GpkgError + use<> {
        let (action, path) = (action.to_owned(), self.path.clone());
        move |source| GpkgError { action, path, source }
    }
}

/// A text as an SQL literal.
#[must_use]
pub fn text(value: &str) -> String {
    // SQLite ends a statement at NUL.
    format!("'{}'", value.replace('\'', "''").replace('\0', ""))
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
    }
}
