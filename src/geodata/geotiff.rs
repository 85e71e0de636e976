//! Writing rasters as GeoTIFF.

use std::path::Path;

use gdal::DriverManager;
use gdal::errors::GdalError;
use gdal::raster::{Buffer, RasterCreationOptions};
use gdal::spatial_ref::SpatialRef;

use crate::crs::Crs;
use crate::files::write_whole_by_name;
use crate::raster::Raster;

use super::WriteError;

/// Writes one band of `f32` (row 0 northernmost, `NaN` written as `nodata`), deflated; all or nothing.
///
/// `west_m`, `north_m`: map position of the top-left corner. `cell_x_m`, `cell_y_m`: size of a cell, both positive.
///
/// # Errors
/// [`WriteError`] when GDAL or the file system refuses.
#[allow(clippy::too_many_arguments)] // A raster and its georeference: a struct would be named and filled once.
pub fn write_geotiff(
    path: &Path,
    raster: &Raster<f32>,
    west_m: f64,
    north_m: f64,
    cell_x_m: f64,
    cell_y_m: f64,
    crs: &Crs,
    nodata: f32,
) -> Result<(), WriteError> {
    let write = |temporary: &Path| -> Result<(), GdalError> {
        let size = (raster.width(), raster.height());
        let options = RasterCreationOptions::from_iter(["COMPRESS=DEFLATE", "PREDICTOR=3", "TILED=YES"]);
        let driver = DriverManager::get_driver_by_name("GTiff")?;
        let mut dataset =
            driver.create_with_band_type_with_options::<f32, _>(temporary, size.0, size.1, 1, &options)?;
        dataset.set_geo_transform(&[west_m, cell_x_m, 0.0, north_m, 0.0, -cell_y_m])?;
        dataset.set_spatial_ref(&SpatialRef::from_definition(crs.definition())?)?;
        let mut band = dataset.rasterband(1)?;
        band.set_no_data_value(Some(f64::from(nodata)))?;
        let values = raster.data().iter().map(|&z| if z.is_nan() { nodata } else { z }).collect();
        band.write((0, 0), size, &mut Buffer::new(size, values))?;
        dataset.close()
    };
    write_whole_by_name(path, |temporary| write(temporary).map_err(WriteError::on(path)))
}
