//! Writing one layer as `FlatGeobuf` (<https://flatgeobuf.org>) through GDAL: a spatially indexed stream of features.
//!
//! GDAL 3.6 has two traps here. A feature without a geometry is dropped without a word, so none is accepted. And a disk
//! that fills up is not noticed, so the file is read back and its features are counted.

use std::path::Path;

use gdal::DriverManager;
use gdal::errors::GdalError;
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};
use gdal::vector::LayerAccess as _;

use super::features::{LayerSpec, Row, write_features};
use super::gpkg::GpkgError;

/// Creates `path`, which must not exist, with one layer; every row must have a geometry.
///
/// GDAL orders the features along a Hilbert curve, so they come back in another order than they were handed over.
///
/// # Errors
/// [`GpkgError`] with what could not be done, or the error of `fill`. The file is then incomplete: write through
/// [`crate::files::write_whole_by_name`].
pub fn create<E: From<GpkgError>>(
    path: &Path,
    crs_definition: &str,
    spec: &LayerSpec<'_>,
    fill: impl FnOnce(&mut dyn FnMut(Row) -> Result<(), E>) -> Result<(), E>,
) -> Result<(), E> {
    crate::gdal_log::route_messages();
    let failed = |action: &str| {
        let (action, path) = (action.to_owned(), path.to_owned());
        move |source| E::from(GpkgError::new(action.clone(), path.clone(), source))
    };
    let mut crs = SpatialRef::from_definition(crs_definition).map_err(failed("use the CRS"))?;
    crs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    let driver = DriverManager::get_driver_by_name("FlatGeobuf").map_err(failed("find the FlatGeobuf driver"))?;
    let mut dataset = driver.create_vector_only(path).map_err(failed("create the file"))?;
    let write_failed = failed("write the features");
    let mut n_written = 0_usize;
    write_features(&mut dataset, &crs, spec, &["SPATIAL_INDEX=YES"], &write_failed, |push| {
        fill(&mut |row| {
            if row.wkb.is_none() {
                return Err(write_failed(GdalError::BadArgument("a feature without a geometry".to_owned())));
            }
            n_written += 1;
            push(row)
        })
    })?;
    // The index and the features are written here.
    dataset.close().map_err(&write_failed)?;
    let n_found = count(path).map_err(failed("read the features back"))?;
    if n_found != n_written {
        let reason = format!("{n_found} of {n_written} features arrived: the disk may be full");
        return Err(write_failed(GdalError::BadArgument(reason)));
    }
    Ok(())
}

/// Features that can be read.
fn count(path: &Path) -> Result<usize, GdalError> {
    let dataset = gdal::Dataset::open(path)?;
    let mut layer = dataset.layer(0)?;
    Ok(layer.features().filter(|feature| feature.geometry().is_some()).count())
}
