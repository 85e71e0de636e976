//! Writing one layer as a table (CSV) or for globes (KML), through GDAL.

use std::path::Path;

use gdal::DriverManager;
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};

use super::features::{LayerSpec, Row, write_features};
use super::gpkg::GpkgError;

/// Kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextFormat {
    /// Comma-separated values in UTF-8, a row per feature, without geometries.
    Csv,
    /// KML, whose positions are longitude and latitude. The driver takes fields called `Name`, `altitudeMode` and `extrude` for what
    /// KML calls so.
    Kml,
}

impl TextFormat {
    fn driver(self) -> &'static str {
        match self {
            Self::Csv => "CSV",
            Self::Kml => "LIBKML",
        }
    }
}

/// Creates `path`, which must not exist, with one layer.
///
/// # Errors
/// [`GpkgError`] with what could not be done, such as a GDAL without the driver, or the error of `fill`. The file is then incomplete:
/// write through [`crate::files::write_whole_by_name`].
pub fn create<E: From<GpkgError>>(
    path: &Path,
    format: TextFormat,
    crs_definition: &str,
    spec: &LayerSpec<'_>,
    fill: impl FnOnce(&mut dyn FnMut(Row) -> Result<(), E>) -> Result<(), E>,
) -> Result<(), E> {
    crate::gdal_log::route_messages();
    let failed = |action: String| {
        let path = path.to_owned();
        move |source| E::from(GpkgError::new(action.clone(), path.clone(), source))
    };
    let name = format.driver();
    let mut crs = SpatialRef::from_definition(crs_definition).map_err(failed("use the CRS".to_owned()))?;
    crs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    let driver = DriverManager::get_driver_by_name(name).map_err(failed(format!("find GDAL's driver {name}")))?;
    let mut dataset = driver.create_vector_only(path).map_err(failed("create the file".to_owned()))?;
    let write_failed = failed("write the features".to_owned());
    write_features(&mut dataset, &crs, spec, &[], &write_failed, fill)?;
    dataset.close().map_err(&write_failed)
}
