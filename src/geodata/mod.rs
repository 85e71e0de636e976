//! Vector and raster files, through GDAL.

pub(crate) mod view_layers;
