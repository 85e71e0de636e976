//! Writing rasters as GeoTIFF.

use std::path::Path;

use gdal::DriverManager;
use gdal::errors::GdalError;
use gdal::raster::{Buffer, RasterCreationOptions};
use gdal::spatial_ref::SpatialRef;

use crate::crs::Crs;
use crate::files::write_whole_by_name;
use sizeup_heights::raster::Raster;

use super::WriteError;

/// Place of a raster in the map, and the value of a cell without one.
#[derive(Debug, Clone, Copy)]
pub struct GridPlace<'a> {
    /// Map position of the top-left corner, metres: easting, northing.
    pub corner_m: (f64, f64),
    /// Size of a cell, metres, both positive: along a row, along a column.
    pub cell_m: (f64, f64),
    /// CRS of the map frame.
    pub crs: &'a Crs,
    /// Number that is written where the raster has `NaN`.
    pub nodata: f32,
}

/// Writes one band of `f32` (row 0 northernmost), deflated; all or nothing.
///
/// # Errors
/// [`WriteError`] when GDAL or the file system refuses.
pub fn write_geotiff(path: &Path, raster: &Raster<f32>, place: &GridPlace<'_>) -> Result<(), WriteError> {
    let GridPlace { corner_m: (west_m, north_m), cell_m: (cell_x_m, cell_y_m), crs, nodata } = *place;
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
