//! Vector and raster files through GDAL: the only door to it.

pub mod features;
pub mod gpkg;
