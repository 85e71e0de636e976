//! `CityJSON` 2.0 (<https://www.cityjson.org/specs/2.0.1/>): LOD 1.2 solids with semantics, in one file or as a sequence.
//!
//! Written building by building; only the list of distinct vertices is kept until the end. A building without a solid
//! is a `Building` without geometry whose attributes say why.

mod metadata;
pub mod read;
mod sequence;
mod vertices;

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::attributes;
use super::grid::Grid;
use super::prism::{Face, NoSolid, Prism, Surface};
use super::{BuildingRecord, CityModel, OutputError};
use crate::files::write_whole;
use crate::issue::{Issue, Severity, Subject};
pub use sequence::write_sequence;
use vertices::VertexPool;

/// How `CityJSON` is written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CityJsonConfig {
    /// Quantum of all coordinates, metres, 0.0001 to 1 (`transform.scale`; a millimetre by custom of the format).
    pub scale_m: f64,
    /// Smallest distance between base and roof of a solid, metres, above 0; a lower building has no geometry.
    pub min_thickness_m: f64,
    /// Title in the metadata.
    pub title: Option<String>,
}

impl Default for CityJsonConfig {
    fn default() -> Self {
        Self { scale_m: 0.001, min_thickness_m: 0.5, title: None }
    }
}

impl CityJsonConfig {
    fn require_valid(&self) -> Result<(), OutputError> {
        let setting = |name, value, expected| Err(OutputError::Setting { name, value, expected });
        if !(1e-4..=1.0).contains(&self.scale_m) {
            return setting("cityjson scale_m", self.scale_m, "0.0001 to 1 metre");
        }
        if !(self.min_thickness_m > 0.0 && self.min_thickness_m.is_finite()) {
            return setting("cityjson min_thickness_m", self.min_thickness_m, "a positive number of metres");
        }
        Ok(())
    }
}

/// Writes `path` (by convention `….city.json`) whole or not at all.
///
/// # Errors
/// [`OutputError`]: duplicate ids, settings out of range, a scene larger than the grid, the file system.
pub fn write(path: &Path, model: &CityModel<'_>, config: &CityJsonConfig) -> Result<(), OutputError> {
    config.require_valid()?;
    model.require_unique_ids()?;
    let (grid, extent) = Grid::over(model.records, config.scale_m)?;
    let metadata = metadata::metadata(model, extent.as_ref(), config.title.as_deref());
    write_whole(path, |out| {
        writeln!(out, r#"{{"type":"CityJSON","version":"2.0","#)?;
        writeln!(out, r#""metadata":{metadata},"#)?;
        writeln!(out, r#""transform":{},"#, metadata::transform(&grid))?;
        out.write_all(br#""CityObjects":{"#)?;
        let mut pool = VertexPool::default();
        for (i, record) in model.records.iter().enumerate() {
            out.write_all(if i == 0 { b"\n" } else { b",\n" })?;
            serde_json::to_writer(&mut *out, &record.id)?;
            out.write_all(b":")?;
            let prism = Prism::of(record, &grid, config.min_thickness_m);
            serde_json::to_writer(&mut *out, &building(record, prism.as_ref(), &grid, &mut pool))?;
        }
        out.write_all(b"\n},\n\"vertices\":[")?;
        pool.write(out)?;
        writeln!(out, "]}}")
    })?;
    Ok(())
}

/// What will have no solid although outline and height are known: one issue per such building.
///
/// # Errors
/// As [`write()`], but for the file system.
pub fn check(records: &[BuildingRecord], config: &CityJsonConfig) -> Result<Vec<Issue>, OutputError> {
    config.require_valid()?;
    let (grid, _) = Grid::over(records, config.scale_m)?;
    let issue = |record: &BuildingRecord| match Prism::of(record, &grid, config.min_thickness_m) {
        Ok(_) | Err(NoSolid::NoOutline | NoSolid::NoHeight) => None,
        Err(fault) => {
            let subject = Subject::Building(record.id.clone());
            let message = format!("no 3D solid was written: {fault}");
            let issue = Issue::new(Severity::Warning, fault.code(), subject, message);
            Some(match record.footprint.as_ref().and_then(|outline| outline.exterior().0.first()) {
                Some(corner) => issue.at(corner.x, corner.y),
                None => issue,
            })
        }
    };
    Ok(records.iter().filter_map(issue).collect())
}

/// One `Building` object; its vertices go into `pool`.
fn building(record: &BuildingRecord, prism: Result<&Prism, &NoSolid>, grid: &Grid, pool: &mut VertexPool) -> Value {
    let no_solid_reason = prism.err().map(|fault| fault.code());
    let attributes = attributes::to_json(record, no_solid_reason);
    match prism {
        Ok(prism) => {
            let geometry = solid(&prism.faces(), pool);
            json!({ "type": "Building", "attributes": attributes,
                    "geographicalExtent": extent(prism, grid), "geometry": [geometry] })
        }
        Err(_) => json!({ "type": "Building", "attributes": attributes }),
    }
}

/// A `Solid` of one shell, with one semantic surface per kind.
fn solid(faces: &[Face], pool: &mut VertexPool) -> Value {
    let mut shell: Vec<Vec<Vec<u32>>> = Vec::with_capacity(faces.len());
    let mut kinds: Vec<u8> = Vec::with_capacity(faces.len());
    for face in faces {
        shell.push(face.rings.iter().map(|ring| ring.iter().map(|p| pool.index_of(*p)).collect()).collect());
        kinds.push(match face.surface {
            Surface::Ground => 0,
            Surface::Roof => 1,
            Surface::Wall => 2,
        });
    }
    json!({
        "type": "Solid", "lod": "1.2", "boundaries": [shell],
        "semantics": {
            "surfaces": [{ "type": "GroundSurface" }, { "type": "RoofSurface" }, { "type": "WallSurface" }],
            "values": [kinds],
        },
    })
}

/// Box of the solid in the map frame, metres, rounded like everything else.
fn extent(prism: &Prism, grid: &Grid) -> [f64; 6] {
    let exterior = &prism.outline().rings()[0];
    let of = |axis: usize| {
        let values = exterior.iter().map(|p| p[axis]);
        values.fold((i64::MAX, i64::MIN), |(low, high), v| (low.min(v), high.max(v)))
    };
    let ((west, east), (south, north)) = (of(0), of(1));
    let low = grid.metres([west, south, prism.base()]).map(metadata::tidy);
    let high = grid.metres([east, north, prism.roof()]).map(metadata::tidy);
    [low[0], low[1], low[2], high[0], high[1], high[2]]
}
