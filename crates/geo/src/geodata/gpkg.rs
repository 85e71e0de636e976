//! Writing a `GeoPackage` through GDAL: layers, plain tables and the contents that GDAL has no call for.
//!
//! Everything happens in one transaction (8 times faster than without). Dates that the format demands come from the
//! caller (GDAL's `OGR_CURRENT_DATE`), so that the same content is the same bytes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gdal::config::{clear_thread_local_config_option, set_thread_local_config_option};
use gdal::errors::GdalError;
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};
use gdal::vector::sql::Dialect;
use gdal::{Dataset, DriverManager};

use super::features::{Column, FID, LayerSpec, Row, write_features};
use super::qml;

/// Layout of every layer.
const LAYER_OPTIONS: [&str; 3] = ["GEOMETRY_NAME=geom", "FID=fid", "SPATIAL_INDEX=YES"];

/// Failure of GDAL, and the file.
#[derive(Debug, thiserror::Error)]
pub enum GpkgError {
    /// For a reason that GDAL knows.
    #[error("cannot {action} in {}", path.display())]
    Gdal {
        /// Action, as in "create layer buildings".
        action: String,
        /// The file that was written to.
        path: PathBuf,
        /// Error that GDAL reported.
        #[source]
        source: GdalError,
    },
    /// There is no room left. What GDAL says of it is the statement that did not fit.
    #[error("cannot write {}: the disk is full, or a limit of file sizes is reached", path.display())]
    Full {
        /// The file that was written to.
        path: PathBuf,
    },
}

/// `SQLite`'s name for a write that found no room: a full disk, and a limit of file sizes.
const NO_ROOM: [&str; 2] = ["disk is full", "disk I/O error"];

/// Free space below which a disk counts as full, bytes: `SQLite` keeps 2 MB of pages until the end of a transaction, and gives back what
/// it could not use.
const LEAST_FREE: u64 = 1 << 22;

/// Whether the disk that holds a file is full.
fn has_no_room(path: &Path) -> bool {
    let folder = path.parent().unwrap_or(Path::new("."));
    rustix::fs::statvfs(folder).is_ok_and(|disk| disk.f_bavail.saturating_mul(disk.f_frsize) < LEAST_FREE)
}

impl GpkgError {
    pub(super) fn new(action: String, path: PathBuf, source: GdalError) -> Self {
        let text = source.to_string();
        // Some of GDAL's calls give no reason: then the disk is asked.
        if NO_ROOM.iter().any(|words| text.contains(words)) || has_no_room(&path) {
            return Self::Full { path };
        }
        Self::Gdal { action, path, source }
    }
}

/// An open `GeoPackage` inside its transaction.
pub struct Writer<'a> {
    dataset: &'a mut Dataset,
    path: PathBuf,
    crs: SpatialRef,
    /// Columns of the layers so far, by layer.
    columns: BTreeMap<String, Vec<Column>>,
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
        move |source| GpkgError::new(action, path, source)
    };
    let _options = ThreadOptions::set(timestamp).map_err(failed("set the date"))?;
    let mut crs = SpatialRef::from_definition(crs_definition).map_err(failed("use the CRS"))?;
    crs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    let driver = DriverManager::get_driver_by_name("GPKG").map_err(failed("find the GPKG driver"))?;
    let mut dataset = driver.create_vector_only(path).map_err(failed("create the file"))?;
    {
        let mut transaction = dataset.start_transaction().map_err(failed("start a transaction"))?;
        fill(&mut Writer { dataset: &mut transaction, path: path.to_owned(), crs, columns: BTreeMap::new() })?;
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
    /// Default styles of layers that are written, as (layer, QML), where QGIS looks for them: a table of its own, which
    /// must be listed in `gpkg_contents`, or QGIS does not see it. Titles of the layers' columns become aliases.
    ///
    /// # Errors
    /// [`GpkgError`].
    pub fn styles(&mut self, styles: &[(&str, &str)], timestamp: &str) -> Result<(), GpkgError> {
        self.sql(
            "CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256), \
             f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256), styleName TEXT(30), \
             styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30), \
             update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))",
        )?;
        self.sql(&format!(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, last_change, srs_id) \
             VALUES ('layer_styles', 'attributes', 'layer_styles', 'QGIS layer styles', {}, 0)",
            text(timestamp)
        ))?;
        for (layer, qml) in styles {
            let qml = qml::with_aliases(qml, self.columns.get(*layer).map_or(&[], Vec::as_slice));
            self.sql(&format!(
                "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName, \
                 styleQML, styleSLD, useAsDefault, description, owner, ui, update_time) \
                 VALUES ('', '', {layer}, 'geom', {layer}, {qml}, '', 1, 'sizeup default', '', NULL, {timestamp})",
                layer = text(layer),
                qml = text(&qml),
                timestamp = text(timestamp),
            ))?;
        }
        Ok(())
    }

    /// Adds a layer with a spatial index and all features that `fill` hands to its argument, one by one.
    ///
    /// # Errors
    /// [`GpkgError`], or the error of `fill`.
    pub fn layer<E: From<GpkgError>>(
        &mut self,
        spec: &LayerSpec<'_>,
        fill: impl FnOnce(&mut dyn FnMut(Row) -> Result<(), E>) -> Result<(), E>,
    ) -> Result<(), E> {
        let (action, path) = (format!("write layer {}", spec.name), self.path.clone());
        let failed = move |source| E::from(GpkgError::new(action.clone(), path.clone(), source));
        let described = [format!("IDENTIFIER={}", spec.name), format!("DESCRIPTION={}", spec.description)];
        let options: Vec<&str> = LAYER_OPTIONS.into_iter().chain(described.iter().map(String::as_str)).collect();
        write_features(self.dataset, &self.crs, spec, &options, &failed, fill)?;
        let columns: Vec<Column> = std::iter::once(FID).chain(spec.columns.iter().cloned()).collect();
        for column in &columns {
            let (layer, name, meaning) = (text(spec.name), text(&column.name), text(column.meaning));
            // GDAL takes the one for the field's alias, other readers the other.
            let title = text(&column.title);
            self.sql(&format!(
                "INSERT INTO gpkg_data_columns (table_name, column_name, name, title, description) \
                 VALUES ({layer}, {name}, {title}, {title}, {meaning})"
            ))?;
        }
        self.columns.insert(spec.name.to_owned(), columns);
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

    fn failed(&self, action: &str) -> impl FnOnce(GdalError) -> GpkgError + use<> {
        let (action, path) = (action.to_owned(), self.path.clone());
        move |source| GpkgError::new(action, path, source)
    }
}

/// A text as an SQL literal.
#[must_use]
pub fn text(value: &str) -> String {
    // SQLite ends a statement at NUL.
    format!("'{}'", value.replace('\'', "''").replace('\0', ""))
}
