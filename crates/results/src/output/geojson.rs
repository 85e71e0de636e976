//! `GeoJSON` in longitude and latitude of WGS 84: footprints with all attributes, for web maps and programs without GDAL.
//!
//! The attributes are those of the `buildings` layer of the [`super::geopackage`], a feature's id is the building's. Those
//! without a footprint are features without a geometry.

use crate::output::grid::SCALE_M;
use crate::output::prism::MIN_THICKNESS_M;
use std::path::Path;

use super::footprints::FootprintRows;
use super::read::ReadError;
use super::{CityModel, OutputError, Overview, Records};
use sizeup_geo::crs::Crs;
use sizeup_geo::geodata::geojson::{JsonObject, LonLat, feature, write as write_features};
use sizeup_geo::geodata::vector::{FeatureGeometry, VectorLayer};

/// Writes `path` (`….geojson`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, no accurate way from the CRS to WGS 84, the file system.
pub fn write<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    let (overview, footprints) = FootprintRows::of(model.records, SCALE_M, MIN_THICKNESS_M)?;
    let lonlat = LonLat::wgs84(model.crs)?;
    let members = JsonObject::from_iter([("name".to_owned(), "buildings".into())]);
    write_features(path, &members, |push| {
        model.records.visit(&mut |record| {
            let geometry = record.footprint.as_ref().map(|footprint| lonlat.polygon(footprint)).transpose()?;
            let names = footprints.columns.iter().map(|column| column.name.clone().into_owned());
            push(&feature(Some(&record.id), geometry, names.zip(footprints.row(record).values).collect()))
        })
    })?;
    Ok(overview)
}

/// Writes any layer of a file, with its attributes, in longitude and latitude: the issues of a result, or the areas of its tiles.
/// `stated` is the CRS of a file that has none. How many features there are.
///
/// # Errors
/// As [`write()`]; [`OutputError::Input`] where there is no such layer.
pub fn write_layer(path: &Path, input: &Path, layer: &str, stated: Option<&Crs>) -> Result<usize, OutputError> {
    let unreadable = |error: ReadError| OutputError::Input(Box::new(error));
    let mut source = VectorLayer::open(input, Some(layer)).map_err(|e| unreadable(e.into()))?;
    let own = source.crs().map_err(|e| unreadable(e.into()))?;
    let crs = own.or_else(|| stated.cloned()).ok_or_else(|| unreadable(ReadError::NoCrs { path: input.to_owned() }))?;
    let lonlat = LonLat::wgs84(&crs)?;
    let members = JsonObject::from_iter([("name".to_owned(), layer.into())]);
    let mut n_features = 0;
    write_features(path, &members, |push| -> Result<(), OutputError> {
        for thing in source.features() {
            let geometry = match &thing.geometry {
                FeatureGeometry::Shape(shape) => Some(lonlat.geometry(shape)?),
                FeatureGeometry::Missing | FeatureGeometry::Unsupported(_) => None,
            };
            push(&feature(None, geometry, thing.attributes))?;
            n_features += 1;
        }
        Ok(())
    })?;
    Ok(n_features)
}
