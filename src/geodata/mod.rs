//! Files of the GIS world, through the system's GDAL: the only doors to it.

mod geotiff;
mod layer_writer;

pub use geotiff::write_geotiff;
pub use layer_writer::{FieldType, LayerFeature, write_polygon_layer};

use std::path::{Path, PathBuf};

use gdal::errors::GdalError;

use crate::files::FileError;

/// Why a file could not be written through GDAL.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// GDAL refused.
    #[error("cannot write {}", path.display())]
    Gdal {
        /// The file.
        path: PathBuf,
        /// GDAL's own words.
        #[source]
        source: GdalError,
    },
    /// The file system refused.
    #[error(transparent)]
    File(#[from] FileError),
}

impl WriteError {
    /// Adapter for `map_err`.
    fn on(path: &Path) -> impl FnOnce(GdalError) -> Self + '_ {
        move |source| Self::Gdal { path: path.to_owned(), source }
    }
}
