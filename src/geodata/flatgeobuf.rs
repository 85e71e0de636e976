//! Writing one layer as `FlatGeobuf` (<https://flatgeobuf.org>) through GDAL: a spatially indexed stream of features.

use std::path::Path;

use gdal::DriverManager;
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};

use super::features::{LayerSpec, Row, write_features};
use super::gpkg::GpkgError;

/// Whether the file has an index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Index {
    /// A packed R-tree; every feature must then have a geometry.
    Spatial,
    /// None: features stay in their order.
    None,
}

/// Creates `path`, which must not exist, with one layer.
///
/// With an index, GDAL orders the features along a Hilbert curve, so they come back in another order than they were handed over.
///
/// # Errors
/// [`GpkgError`] with what could not be done, or the error of `fill`. The file is then incomplete: write through
/// [`crate::files::write_whole_by_name`].
pub fn create<E: From<GpkgError>>(
    path: &Path,
    crs_definition: &str,
    spec: &LayerSpec<'_>,
    index: Index,
    fill: impl FnOnce(&mut dyn FnMut(Row) -> Result<(), E>) -> Result<(), E>,
) -> Result<(), E> {
    crate::gdal_log::route_messages();
    let failed = |action: &str| {
        let (action, path) = (action.to_owned(), path.to_owned());
        move |source| E::from(GpkgError { action: action.clone(), path: path.clone(), source })
    };
    let mut crs = SpatialRef::from_definition(crs_definition).map_err(failed("use the CRS"))?;
    crs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    let driver = DriverManager::get_driver_by_name("FlatGeobuf").map_err(failed("find the FlatGeobuf driver"))?;
    let mut dataset = driver.create_vector_only(path).map_err(failed("create the file"))?;
    let options = match index {
        Index::Spatial => ["SPATIAL_INDEX=YES"],
        Index::None => ["SPATIAL_INDEX=NO"],
    };
    write_features(&mut dataset, &crs, spec, &options, &failed("write the features"), fill)?;
    // The index and the features are written here.
    dataset.close().map_err(failed("write the features"))
}
