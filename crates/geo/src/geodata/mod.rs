//! Files of the GIS world, through GDAL.
//!
//! The only doors to GDAL: [`raster`] and [`vector`] read, the others write. [`qml`] is what QGIS reads beside them;
//! `GeoJSON` is read and written without GDAL.

pub mod features;
pub mod flatgeobuf;
pub mod geojson;
pub mod gpkg;
pub mod qml;
pub mod raster;
pub mod source;
pub mod text_layer;
pub mod vector;
pub mod view_layers;

mod antimeridian;
mod body;
mod curve;
mod geojson_layer;
mod geotiff;
mod layer_writer;
mod open;

pub use geotiff::{GridPlace, write_geotiff};
pub use layer_writer::{FieldType, LayerFeature, write_polygon_layer};
pub use open::{Refusal, may_be_asked};

use std::path::{Path, PathBuf};

use gdal::errors::GdalError;
use gdal::spatial_ref::SpatialRef;

use crate::crs::{Crs, CrsError};
use crate::files::FileError;
use crate::gdal_log;

/// CRS by GDAL's statement, as one of ours; `None` for GeoPackage's "undefined" and local engineering systems.
fn crs_of(spatial_ref: &SpatialRef) -> Result<Option<Crs>, CrsError> {
    if spatial_ref.is_local() || spatial_ref.name().is_some_and(|name| name.starts_with("Undefined")) {
        return Ok(None);
    }
    // A registered code reads better in messages than a page of WKT, and both mean the same.
    let registered = match (spatial_ref.auth_name().as_deref(), spatial_ref.auth_code()) {
        (Some("EPSG"), Ok(code)) => Crs::parse(&format!("EPSG:{code}")).ok(),
        _ => None,
    };
    if registered.is_some() {
        return Ok(registered);
    }
    // PROJJSON says more than WKT 1 (axis order, datum ensembles); both are PROJ's own words.
    let definition = spatial_ref.to_projjson().or_else(|_| spatial_ref.to_wkt());
    definition.map_or(Ok(None), |text| Crs::parse(&text).map(Some))
}

/// Version of the GDAL that is linked, such as `3.6.2`.
#[must_use]
pub fn gdal_version() -> String {
    gdal::version::version_info("RELEASE_NAME")
}

/// Whether GDAL has a driver, by its short name.
#[must_use]
pub fn has_driver(name: &str) -> bool {
    gdal_log::route_messages();
    gdal::DriverManager::get_driver_by_name(name).is_ok()
}

/// A CRS as well-known text, `None` where GDAL cannot write it so.
#[must_use]
pub fn wkt_of(crs: &Crs) -> Option<String> {
    SpatialRef::from_definition(crs.definition()).ok()?.to_wkt().ok()
}

/// Why a file could not be written through GDAL.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// GDAL cannot write the file.
    #[error("cannot write {}", path.display())]
    Gdal {
        /// The file that was written to.
        path: PathBuf,
        /// Error that GDAL reported.
        #[source]
        source: GdalError,
    },
    /// The file system did not let the file be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

impl WriteError {
    /// GDAL's error on a file as a [`WriteError`], for `map_err`.
    fn on(path: &Path) -> impl FnOnce(GdalError) -> Self + '_ {
        move |source| Self::Gdal { path: path.to_owned(), source }
    }
}
