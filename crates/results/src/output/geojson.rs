//! `GeoJSON` in longitude and latitude of WGS 84: outlines with all attributes, for web maps and programs without GDAL.
//!
//! The attributes are those of the `buildings` layer of the [`super::geopackage`], a feature's id is the building's. Those
//! without an outline are features without a geometry.

use std::path::Path;

use super::geopackage::GeoPackageConfig;
use super::outlines::OutlineRows;
use super::{CityModel, OutputError, Overview, Records};
use sizeup_geo::geodata::geojson::{JsonObject, LonLat, feature, write as write_features};

/// Writes `path` (`….geojson`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, no accurate way from the CRS to WGS 84, the file system.
pub fn write<R: Records + ?Sized>(
    path: &Path,
    model: &CityModel<'_, R>,
    config: &GeoPackageConfig,
) -> Result<Overview, OutputError> {
    let (overview, outlines) = OutlineRows::of(model.records, config.scale_m, config.min_thickness_m)?;
    let lonlat = LonLat::wgs84(model.crs)?;
    let members = JsonObject::from_iter([("name".to_owned(), "buildings".into())]);
    write_features(path, &members, |push| {
        model.records.visit(&mut |record| {
            let geometry = record.footprint.as_ref().map(|footprint| lonlat.polygon(footprint)).transpose()?;
            let names = outlines.columns.iter().map(|column| column.name.clone().into_owned());
            push(&feature(Some(&record.id), geometry, names.zip(outlines.row(record).values).collect()))
        })
    })?;
    Ok(overview)
}
