//! `FlatGeobuf`: the `buildings` layer of the [`super::geopackage`] alone, for the web and for streams.
//!
//! Readers fetch what lies in a window by range requests. The features are ordered along a Hilbert curve. Buildings
//! without a footprint have no place in it ([`Overview::n_without_footprint`] counts them).

use crate::output::grid::SCALE_M;
use crate::output::prism::MIN_THICKNESS_M;
use std::path::Path;

use super::footprints::FootprintRows;
use super::{CityModel, OutputError, Overview, Records};
use sizeup_geo::files::write_whole_by_name;
use sizeup_geo::geodata::features::{GeometryKind, LayerSpec};
use sizeup_geo::geodata::flatgeobuf;

/// Writes `path` (`….fgb`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, GDAL, the file system.
pub fn write<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    let (overview, footprints) = FootprintRows::of(model.records, SCALE_M, MIN_THICKNESS_M)?;
    let spec = LayerSpec {
        name: "buildings",
        description: "Footprints with heights",
        geometry: GeometryKind::Polygon,
        columns: &footprints.columns,
    };
    write_whole_by_name(path, |temporary| {
        flatgeobuf::create(temporary, model.crs.definition(), &spec, |push| {
            model.records.visit(&mut |record| match record.footprint {
                Some(_) => push(footprints.row(record)),
                None => Ok(()),
            })
        })
    })?;
    Ok(overview)
}
