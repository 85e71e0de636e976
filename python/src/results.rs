//! A city's file as JSON, and its solids.
//!
//! ```text
//! city    {"crs": …, "lineage": …, "columns": [name, …], "buildings": [{…, "geometry": GeoJSON, "row": [value, …]}]}
//! solids  {id: {"vertices": [[x, y, z], …], "triangles": [[i, j, k], …], "kinds": ["ground", "roof" or "wall", …]}}
//! ```
//!
//! A row has the values of the columns, those of the layer `buildings` of a GeoPackage.

use std::path::{Path, PathBuf};

use geo_types::{LineString, Polygon};
use pyo3::prelude::*;
use serde_json::{Map, Value, json};
use sizeup::output::attributes::round_m;
use sizeup::output::grid::{OutputGrid, SCALE_M};
use sizeup::output::mesh::TriangleSolid;
use sizeup::output::prism::{FaceKind, MIN_THICKNESS_M};
use sizeup::output::read::{ReadOptions, RecordFile};
use sizeup::output::{BuildingRecord, FootprintRows, Overview, Records as _};

use crate::failure::{Failure, told};

/// Reads a city: CityJSON, CityJSONSeq or any vector layer with heights.
#[pyfunction]
pub(crate) fn read_city(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    py.detach(|| city(&path)).map_err(|failure| told(py, failure))
}

/// Reads the solids of a city.
#[pyfunction]
pub(crate) fn read_solids(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    py.detach(|| solids(&path)).map_err(|failure| told(py, failure))
}

fn city(path: &Path) -> Result<String, Failure> {
    let (file, records) = records(path)?;
    let (_, rows) =
        FootprintRows::of(records.as_slice(), SCALE_M, MIN_THICKNESS_M).map_err(|e| Failure::of_file(&e))?;
    let of_building = |record: &BuildingRecord| {
        let mut value = building(record);
        value["row"] = json!(rows.row(record).values);
        value
    };
    let buildings: Vec<Value> = records.iter().map(of_building).collect();
    let columns: Vec<&str> = rows.columns.iter().map(|column| column.name.as_ref()).collect();
    let crs = file.crs().map(sizeup::crs::Crs::definition);
    Ok(json!({ "crs": crs, "lineage": file.lineage(), "columns": columns, "buildings": buildings }).to_string())
}

fn solids(path: &Path) -> Result<String, Failure> {
    let (_, records) = records(path)?;
    let grid = Overview::of(records.as_slice()).and_then(|overview| overview.grid(SCALE_M));
    let grid = grid.map_err(|e| Failure::of_file(&e))?;
    let of_building = |record: &BuildingRecord| {
        let solid = TriangleSolid::of(record, &grid)?;
        Some((record.id.clone(), mesh(&solid, &grid)))
    };
    Ok(Value::Object(records.iter().filter_map(of_building).collect::<Map<_, _>>()).to_string())
}

/// The buildings of a file in metres.
fn records(path: &Path) -> Result<(RecordFile<'static>, Vec<BuildingRecord>), Failure> {
    let file = RecordFile::open(path, ReadOptions::default()).map_err(|e| Failure::of_file(&e))?;
    if let Some(crs) = file.crs() {
        file.check_units(crs).map_err(|e| Failure::of_file(&e))?;
    }
    let mut records = Vec::new();
    file.visit(&mut |record| {
        records.push(record.clone());
        Ok(())
    })
    .map_err(|e| Failure::of_file(&e))?;
    Ok((file, records))
}

/// Triangles with each corner once, in the order in which they come.
fn mesh(solid: &TriangleSolid, grid: &OutputGrid) -> Value {
    let mut index_of: std::collections::HashMap<[i64; 3], usize> = std::collections::HashMap::new();
    let (mut vertices, mut triangles, mut kinds) = (Vec::new(), Vec::new(), Vec::new());
    for (kind, corners) in &solid.triangles {
        let index = |corner: [i64; 3]| {
            *index_of.entry(corner).or_insert_with(|| {
                vertices.push(grid.metres(corner).map(round_m));
                vertices.len() - 1
            })
        };
        triangles.push(corners.map(index));
        kinds.push(match kind {
            FaceKind::Ground => "ground",
            FaceKind::Roof => "roof",
            FaceKind::Wall => "wall",
        });
    }
    json!({ "vertices": vertices, "triangles": triangles, "kinds": kinds })
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
