//! KML: blocks on the ground of a globe, with the attributes of the `buildings` layer of the [`super::geopackage`].
//!
//! A block is the footprint at its height above the ground, drawn down to it (`relativeToGround`, `extrude`): so it stands on the
//! globe's own terrain, whatever its heights count from. Buildings without a height lie on the ground; those without a footprint have
//! no place.

use std::path::Path;

use serde_json::{Value, json};

use super::csv::write_rows;
use super::footprints::FootprintRows;
use super::grid::SCALE_M;
use super::prism::MIN_THICKNESS_M;
use super::{BuildingRecord, CityModel, OutputError, Overview, Records, wkb};
use sizeup_geo::geodata::features::{Column, ColumnKind, GeometryKind, LayerSpec, Row};
use sizeup_geo::geodata::geojson::{GeometryValue, LonLat, Position};
use sizeup_geo::geodata::text_layer::TextFormat;

/// Columns that KML has a meaning for, before the attributes.
const OF_KML: [Column; 3] = [
    Column::new("Name", "Name", ColumnKind::Text, "Id of the building"),
    Column::new("altitudeMode", "Heights count from", ColumnKind::Text, "What heights count from"),
    Column::new("extrude", "Drawn down to the ground", ColumnKind::Flag, "Whether it is drawn down to the ground"),
];

/// Writes `path` (`….kml`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, no accurate way from the CRS to WGS 84, a GDAL without KML, the file
/// system.
pub fn write<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    let (overview, footprints) = FootprintRows::of(model.records, SCALE_M, MIN_THICKNESS_M)?;
    let lonlat = LonLat::wgs84(model.crs)?;
    let columns: Vec<Column> = OF_KML.into_iter().chain(footprints.columns.iter().cloned()).collect();
    let spec = LayerSpec {
        name: "buildings",
        description: "Blocks with heights",
        geometry: GeometryKind::MultiPolygonZ,
        columns: &columns,
    };
    write_rows(path, TextFormat::Kml, "EPSG:4326", &spec, model.records, |record| {
        let mut values: Vec<Value> = vec![record.id.as_str().into(), "relativeToGround".into(), json!(1)];
        values.extend(footprints.row(record).values);
        Ok(Row { wkb: block(record, &lonlat)?, values })
    })?;
    Ok(overview)
}

/// The footprint at the height of the roof above the ground.
fn block(record: &BuildingRecord, lonlat: &LonLat) -> Result<Option<Vec<u8>>, OutputError> {
    let Some(footprint) = &record.footprint else { return Ok(None) };
    let height_m = record.height_m.unwrap_or(0.0);
    let parts = match lonlat.polygon(footprint)? {
        GeometryValue::Polygon { coordinates } => vec![coordinates],
        GeometryValue::MultiPolygon { coordinates } => coordinates,
        _ => return Ok(None),
    };
    let corner = |at: &Position| [at[0], at[1], height_m];
    // Closed rings here, open ones there.
    let ring = |ring: &Vec<Position>| ring.iter().skip(1).map(corner).collect();
    let parts: Vec<Vec<Vec<[f64; 3]>>> = parts.iter().map(|rings| rings.iter().map(ring).collect()).collect();
    Ok(Some(wkb::multi_polygon_z(&parts)))
}
