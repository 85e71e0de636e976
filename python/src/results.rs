//! A city's file as JSON: `{"crs": …, "lineage": …, "buildings": [{…, "geometry": GeoJSON}]}`.

use std::path::PathBuf;

use geo_types::{LineString, Polygon};
use pyo3::prelude::*;
use serde_json::{Value, json};
use sizeup::output::read::{ReadOptions, RecordFile};
use sizeup::output::{BuildingRecord, Records as _};

use crate::failure::{Failure, told};

/// Reads a city: CityJSON, CityJSONSeq or any vector layer with heights.
#[pyfunction]
pub(crate) fn read_city(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    py.detach(|| city(&path)).map_err(|failure| told(py, failure))
}

fn city(path: &std::path::Path) -> Result<String, Failure> {
    let file = RecordFile::open(path, ReadOptions::default()).map_err(|e| Failure::of_file(&e))?;
    if let Some(crs) = file.crs() {
        file.check_units(crs).map_err(|e| Failure::of_file(&e))?;
    }
    let mut buildings = Vec::new();
    file.visit(&mut |record| {
        buildings.push(building(record));
        Ok(())
    })
    .map_err(|e| Failure::of_file(&e))?;
    let crs = file.crs().map(sizeup::crs::Crs::definition);
    Ok(json!({ "crs": crs, "lineage": file.lineage(), "buildings": buildings }).to_string())
}

/// A building's record, its footprint as GeoJSON: exterior counter-clockwise, holes clockwise, first point repeated.
fn building(record: &BuildingRecord) -> Value {
    let mut value = serde_json::to_value(record).expect("a record is what files of results hold as JSON");
    if let Some(fields) = value.as_object_mut() {
        fields.remove("footprint");
        fields.insert("roof_z_m".to_owned(), json!(record.roof_z_m()));
        fields.insert("geometry".to_owned(), record.footprint.as_ref().map_or(Value::Null, geojson));
    }
    value
}

fn geojson(footprint: &Polygon<f64>) -> Value {
    let ring = |ring: &LineString<f64>| ring.0.iter().map(|p| [p.x, p.y]).collect::<Vec<_>>();
    let rings: Vec<_> = std::iter::once(footprint.exterior()).chain(footprint.interiors()).map(ring).collect();
    json!({ "type": "Polygon", "coordinates": rings })
}
