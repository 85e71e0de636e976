//! CSV: the attributes of the `buildings` layer of the [`super::geopackage`] as a table, with a place in each building.
//!
//! `FILE-metadata.json` beside it has title, meaning and type of every column, as the W3C's CSV on the Web names them
//! (<https://www.w3.org/TR/tabular-metadata/>).

use std::path::{Path, PathBuf};

use geo::InteriorPoint as _;
use serde_json::{Value, json};

use super::footprints::FootprintRows;
use super::grid::SCALE_M;
use super::prism::MIN_THICKNESS_M;
use super::{BuildingRecord, CityModel, OutputError, Overview, Records, attributes};
use sizeup_geo::files::{write_json, write_whole_by_name};
use sizeup_geo::geodata::features::{Column, ColumnKind, GeometryKind, LayerSpec, Row};
use sizeup_geo::geodata::text_layer::{self, TextFormat};

/// Columns of the place, after all others.
const PLACE: [Column; 2] = [
    Column::new(
        "x_m",
        "Easting (m)",
        ColumnKind::Real,
        "Easting of a place in the footprint, in the CRS of the city, metres",
    ),
    Column::new(
        "y_m",
        "Northing (m)",
        ColumnKind::Real,
        "Northing of a place in the footprint, in the CRS of the city, metres",
    ),
];

/// Writes `path` (`….csv`) whole or not at all, and its description beside it.
///
/// # Errors
/// [`OutputError`]: duplicate ids, a scene larger than the grid, GDAL, the file system.
pub fn write<R: Records + ?Sized>(path: &Path, model: &CityModel<'_, R>) -> Result<Overview, OutputError> {
    let (overview, footprints) = FootprintRows::of(model.records, SCALE_M, MIN_THICKNESS_M)?;
    let columns: Vec<Column> = footprints.columns.iter().cloned().chain(PLACE).collect();
    let spec = LayerSpec {
        name: "buildings",
        description: "Buildings with heights",
        geometry: GeometryKind::Polygon,
        columns: &columns,
    };
    write_rows(path, TextFormat::Csv, model.crs.definition(), &spec, model.records, |record| {
        let mut values = footprints.row(record).values;
        values.extend(place(record));
        Ok(Row { wkb: None, values })
    })?;
    write_json(&description_of(path), &description(path, model, &columns))?;
    Ok(overview)
}

/// Writes a row per building, whole or not at all.
pub(super) fn write_rows<R: Records + ?Sized>(
    path: &Path,
    format: TextFormat,
    crs_definition: &str,
    spec: &LayerSpec<'_>,
    records: &R,
    row: impl Fn(&BuildingRecord) -> Result<Row, OutputError>,
) -> Result<(), OutputError> {
    write_whole_by_name(path, |temporary| {
        text_layer::create(temporary, format, crs_definition, spec, |push| {
            records.visit(&mut |record| push(row(record)?))
        })
    })
}

/// File of the description, where readers look for it.
fn description_of(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{name}-metadata.json"))
}

/// A place in the building, on the millimetre.
fn place(record: &BuildingRecord) -> [Value; 2] {
    let at = record.footprint.as_ref().and_then(geo_types::Polygon::interior_point);
    at.map_or([Value::Null, Value::Null], |at| [at.x(), at.y()].map(attributes::metres))
}

fn description<R: ?Sized>(path: &Path, model: &CityModel<'_, R>, columns: &[Column]) -> Value {
    let column = |column: &Column| {
        let datatype = match column.kind {
            ColumnKind::Text => "string",
            ColumnKind::Real => "number",
            ColumnKind::Integer | ColumnKind::Flag => "integer",
        };
        json!({ "name": column.name, "titles": [column.name, column.title], "dc:description": column.meaning, "datatype": datatype })
    };
    json!({
        "@context": "http://www.w3.org/ns/csvw",
        "url": path.file_name().unwrap_or_default().to_string_lossy(),
        "dc:title": "Buildings with heights",
        "dc:date": model.lineage.reference_date,
        "dc:description": format!("CRS: {}. Heights: {}.", model.crs, model.lineage.vertical_reference),
        "tableSchema": { "primaryKey": "id", "columns": columns.iter().map(column).collect::<Vec<_>>() },
    })
}
