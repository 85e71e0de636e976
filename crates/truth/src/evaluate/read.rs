//! Reading a result and a reference for evaluation, brought into one CRS.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::TruthBuilding;
use sizeup_geo::crs::Crs;
use sizeup_results::output::read::{FoundBuilding, FoundBuildings, ReadError, ReadOptions};
use sizeup_results::output::{BuildingRecord, HeightReference};

/// Attributes that are looked for, in this order, when none is named. All mean metres above ground.
pub const HEIGHT_FIELDS: [&str; 5] = ["height_m", "measuredHeight", "measured_height", "height", "HEIGHT"];

/// Options for reading a reference.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TruthOptions {
    /// Layer of a vector file with several.
    pub layer: Option<String>,
    /// Attribute that holds the id; one of the usual names by default.
    pub id_field: Option<String>,
    /// Attribute that holds the height above ground, metres. By default the surfaces of `CityJSON` are measured, and
    /// in a vector layer one of the usual names is taken.
    pub height_field: Option<String>,
    /// Attribute that tells kinds of buildings apart; rows are grouped by it where it exists.
    pub group_field: String,
    /// Which height of a measured roof counts: `eave`, `mean` or `ridge`.
    pub height_reference: HeightReference,
    /// Level of detail of `CityJSON` geometry; the highest by default.
    pub lod: Option<String>,
    /// CRS of a file that states none, or none with a vertical part.
    pub crs: Option<String>,
}

impl Default for TruthOptions {
    fn default() -> Self {
        Self {
            layer: None,
            id_field: None,
            height_field: None,
            group_field: "type".to_owned(),
            height_reference: HeightReference::Mean,
            lod: None,
            crs: None,
        }
    }
}

/// A reference and how its heights were found.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Buildings in the project's CRS.
    pub buildings: Vec<TruthBuilding>,
    /// Source of the heights, for the report: an attribute or the surfaces.
    pub height_source: String,
}

/// Reads a reference: `CityJSON` of any version and level of detail, or a vector layer with a height attribute.
///
/// # Errors
/// [`ReadError`]: unreadable, without CRS or without a height attribute.
pub fn read_truth(path: &Path, options: &TruthOptions, project_crs: &Crs) -> Result<Truth, ReadError> {
    read(path, options, project_crs, HeightsNeed::Needed)
}

/// As [`read_truth`], of a reference without heights.
///
/// # Errors
/// [`ReadError`]: unreadable, without CRS.
pub(super) fn read_truth_footprints(
    path: &Path,
    options: &TruthOptions,
    project_crs: &Crs,
) -> Result<Truth, ReadError> {
    read(path, options, project_crs, HeightsNeed::Absent)
}

/// Whether a reference must have heights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HeightsNeed {
    Needed,
    Absent,
}

fn read(path: &Path, options: &TruthOptions, project_crs: &Crs, heights: HeightsNeed) -> Result<Truth, ReadError> {
    let read = ReadOptions {
        layer: options.layer.as_deref(),
        id_field: options.id_field.as_deref(),
        lod: options.lod.as_deref(),
    };
    let mut found = FoundBuildings::read(path, &read)?;
    let failed = |source| ReadError::Crs { path: path.to_owned(), source };
    let stated = options.crs.as_deref().map(Crs::parse).transpose().map_err(failed)?;
    found.crs = found.crs.map(|own| own.with_heights_of(stated.as_ref())).or(stated);
    let found = found.into_crs(project_crs)?;
    let has = |field: &str| found.buildings.iter().any(|b| b.attributes.contains_key(field));
    let is_measured = found.buildings.iter().any(|b| b.levels.is_some());
    let field = match options.height_field.as_deref() {
        Some(field) if has(field) => Some(field),
        Some(field) => return Err(no_height(&found, field)),
        None if is_measured || heights == HeightsNeed::Absent => None,
        None => match HEIGHT_FIELDS.into_iter().find(|name| has(name)) {
            Some(field) => Some(field),
            None => return Err(no_height(&found, HEIGHT_FIELDS[0])),
        },
    };
    let building = |b: &FoundBuilding| TruthBuilding {
        id: b.id.clone(),
        footprint: b.footprint.clone(),
        height_m: match field {
            Some(field) => b.attributes.get(field).and_then(number),
            None => measured_height_m(b, options.height_reference),
        },
        group: b.attributes.get(&options.group_field).and_then(|kind| match kind {
            Value::String(kind) => Some(kind.clone()),
            Value::Null => None,
            other => Some(other.to_string()),
        }),
    };
    let height_source = match field {
        Some(field) => format!("attribute {field}"),
        None => format!("surfaces: {} of the roof minus lowest ground", options.height_reference.as_str()),
    };
    Ok(Truth { buildings: found.buildings.iter().map(building).collect(), height_source })
}

/// Reads a result of ours or anybody's: see [`FoundBuildings::to_records`]. Vector layers of others need a height
/// attribute named as in [`HEIGHT_FIELDS`].
///
/// # Errors
/// [`ReadError`].
pub fn read_results(path: &Path, project_crs: &Crs) -> Result<Vec<BuildingRecord>, ReadError> {
    let found = FoundBuildings::read(path, &ReadOptions::default())?.into_crs(project_crs)?;
    let mut records = found.to_records();
    let is_known = |found: &FoundBuilding| found.attributes.contains_key("height_m") || found.levels.is_some();
    if found.buildings.iter().any(is_known) || found.buildings.is_empty() {
        return Ok(records);
    }
    let has = |field: &str| found.buildings.iter().any(|b| b.attributes.contains_key(field));
    let field = HEIGHT_FIELDS.into_iter().find(|name| has(name)).ok_or_else(|| no_height(&found, HEIGHT_FIELDS[0]))?;
    for (record, building) in records.iter_mut().zip(&found.buildings) {
        record.height_m = building.attributes.get(field).and_then(number);
        if record.height_m.is_some() {
            record.status = sizeup_results::output::Status::Measured;
        }
    }
    Ok(records)
}

/// As [`read_results`], of a result without heights.
///
/// # Errors
/// [`ReadError`].
pub(super) fn read_footprints(path: &Path, project_crs: &Crs) -> Result<Vec<BuildingRecord>, ReadError> {
    Ok(FoundBuildings::read(path, &ReadOptions::default())?.into_crs(project_crs)?.to_records())
}

/// The CRS a file states, to be the frame of an evaluation.
///
/// # Errors
/// [`ReadError`], also for a file without CRS.
pub fn crs_of(path: &Path) -> Result<Crs, ReadError> {
    let found = FoundBuildings::read(path, &ReadOptions::default())?;
    found.crs.ok_or(ReadError::NoCrs { path: path.to_owned() })
}

fn measured_height_m(building: &FoundBuilding, reference: HeightReference) -> Option<f64> {
    let levels = building.levels?;
    let roof_m = match reference {
        HeightReference::Eave => levels.roof_min_m,
        HeightReference::Mean => levels.roof_mean_m,
        HeightReference::Ridge => levels.roof_max_m,
    };
    Some(roof_m - levels.ground_m)
}

/// A number, also one that was written as text.
fn number(value: &Value) -> Option<f64> {
    value.as_f64().or_else(|| value.as_str()?.trim().parse().ok())
}

fn no_height(found: &FoundBuildings, field: &str) -> ReadError {
    let mut available: Vec<String> = found.buildings.iter().flat_map(|b| b.attributes.keys().cloned()).collect();
    available.sort_unstable();
    available.dedup();
    ReadError::NoField { path: found.path.clone(), field: field.to_owned(), what: "height", available }
}
