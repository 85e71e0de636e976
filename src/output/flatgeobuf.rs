//! `FlatGeobuf`: the `buildings` layer of the [`super::geopackage`] alone, for the web and for streams.
//!
//! Readers fetch what lies in a window by range requests. The features are ordered along a Hilbert curve, unless a
//! building has no outline: the format has no index then, and the order is the input's.

use std::path::Path;

use super::geopackage::GeoPackageConfig;
use super::outlines::OutlineRows;
use super::{CityModel, OutputError, Overview, Records};
use crate::files::write_whole_by_name;
use crate::geodata::features::{GeometryKind, LayerSpec};
use crate::geodata::flatgeobuf::{self, Index};

/// Writes `path` (`….fgb`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, GDAL, the file system.
pub fn write<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &GeoPackageConfig,
) -> Result<(), OutputError> {
    let overview = Overview::of(model.records)?;
    let outlines = OutlineRows::new(model.records, overview.grid(config.scale_m)?, config.min_thickness_m)?;
    let spec = LayerSpec {
        name: "buildings",
        description: "Outlines with heights",
        geometry: GeometryKind::Polygon,
        columns: &outlines.columns,
    };
    let index = if overview.n_without_outline == 0 { Index::Spatial } else { Index::None };
    write_whole_by_name(path, |temporary| {
        flatgeobuf::create(temporary, model.crs.definition(), &spec, index, |push| {
            model.records.visit(&mut |record| push(outlines.row(record)))
        })
    })
}
