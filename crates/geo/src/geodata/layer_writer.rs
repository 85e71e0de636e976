//! Writing polygon layers as `GeoPackage`.

use std::path::Path;

use gdal::config::{clear_thread_local_config_option, set_thread_local_config_option};
use gdal::errors::GdalError;
use gdal::spatial_ref::SpatialRef;
use gdal::vector::{Feature, LayerAccess, LayerOptions, OGRFieldType, OGRwkbGeometryType, ToGdal};
use gdal::{Dataset, DriverManager};
use geo_types::Polygon;

use crate::crs::Crs;
use crate::files::write_whole_by_name;

use super::WriteError;

/// `GeoPackage` stamps files with the time of writing; a fixed one keeps equal inputs equal on disk.
const TIME_STAMP: (&str, &str) = ("OGR_CURRENT_DATE", "2000-01-01T00:00:00.000Z");

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldType {
    /// Text of any length.
    Text,
    /// A number; `NaN` is written as no value.
    Number,
}

/// One row: a footprint and its attributes in the order of the columns.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerFeature<'a> {
    /// In the layer's CRS, x before y.
    pub polygon: &'a Polygon<f64>,
    /// For every text column, its value.
    pub texts: Vec<String>,
    /// For every number column, its value.
    pub numbers: Vec<f64>,
}

/// Writes a `GeoPackage` with one polygon layer; all or nothing, and the same bytes for the same input.
///
/// # Errors
/// [`WriteError`] when GDAL or the file system refuses.
pub fn write_polygon_layer(
    path: &Path,
    layer: &str,
    crs: &Crs,
    columns: &[(&str, FieldType)],
    features: &[LayerFeature],
) -> Result<(), WriteError> {
    let write = |temporary: &Path| -> Result<(), GdalError> {
        set_thread_local_config_option(TIME_STAMP.0, TIME_STAMP.1)?;
        let dataset = DriverManager::get_driver_by_name("GPKG")?.create_vector_only(temporary)?;
        let written = fill(dataset, layer, crs, columns, features);
        clear_thread_local_config_option(TIME_STAMP.0)?;
        written
    };
    write_whole_by_name(path, |temporary| write(temporary).map_err(WriteError::on(path)))
}

fn fill(
    mut dataset: Dataset,
    layer: &str,
    crs: &Crs,
    columns: &[(&str, FieldType)],
    features: &[LayerFeature],
) -> Result<(), GdalError> {
    let srs = SpatialRef::from_definition(crs.definition())?;
    let mut transaction = dataset.start_transaction()?;
    let options = LayerOptions { name: layer, srs: Some(&srs), ty: OGRwkbGeometryType::wkbPolygon, options: None };
    {
        let target = transaction.create_layer(options)?;
        let fields: Vec<_> = columns
            .iter()
            .map(|&(name, kind)| match kind {
                FieldType::Text => (name, OGRFieldType::OFTString),
                FieldType::Number => (name, OGRFieldType::OFTReal),
            })
            .collect();
        target.create_defn_fields(&fields)?;
        for row in features {
            let mut feature = Feature::new(target.defn())?;
            feature.set_geometry(row.polygon.to_gdal()?)?;
            let (mut texts, mut numbers) = (row.texts.iter(), row.numbers.iter());
            for (idx, (_, kind)) in columns.iter().enumerate() {
                match kind {
                    FieldType::Text => {
                        if let Some(text) = texts.next() {
                            feature.set_field_string(idx, text)?;
                        }
                    }
                    FieldType::Number => {
                        if let Some(number) = numbers.next().filter(|n| !n.is_nan()) {
                            feature.set_field_double(idx, *number)?;
                        }
                    }
                }
            }
            feature.create(&target)?;
        }
    }
    transaction.commit()?;
    dataset.close()
}
