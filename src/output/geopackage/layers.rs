//! The layers with geometry.

use std::collections::BTreeMap;

use serde_json::Value;

use super::super::attributes::{self, FIELDS, FieldKind};
use super::super::prism::{NoSolid, Prism};
use super::super::{BuildingRecord, CityModel, OutputError};
use super::{GeoPackageConfig, Grid, wkb};
use crate::geodata::gpkg::{Column, ColumnKind, GeometryKind, LayerSpec, Row, Writer};
use crate::issue::{Issue, Subject};
use crate::survey::{Survey, View};

/// Between the items of a list in a text column.
pub const LIST_SEPARATOR: &str = "; ";

/// Outlines with all attributes.
pub fn buildings(
    writer: &mut Writer<'_>,
    model: &CityModel<'_>,
    grid: &Grid,
    config: &GeoPackageConfig,
) -> Result<(), OutputError> {
    let carried = carried_columns(model.records);
    let mut columns = vec![column("id", ColumnKind::Text, "Id of the building in the input")];
    columns.extend(FIELDS.iter().map(|f| column(f.name, kind(f.kind), f.meaning)));
    columns.extend(carried.iter().map(|c| column(&c.column, c.kind, "")));
    let spec = LayerSpec {
        name: "buildings",
        description: "Outlines with heights; one row per building of the input",
        geometry: GeometryKind::Polygon,
        columns: &columns,
    };
    let rows = model.records.iter().map(|record| {
        let fault = Prism::of(record, grid, config.min_thickness_m).err();
        let mut values = vec![Value::from(record.id.as_str())];
        values.extend(FIELDS.iter().map(|f| flat(attributes::value(record, f, fault.map(NoSolid::code)))));
        values.extend(carried.iter().map(|c| record.attributes.get(&c.name).map_or(Value::Null, |v| c.value(v))));
        Row { wkb: record.footprint.as_ref().map(wkb::polygon), values }
    });
    Ok(writer.layer(&spec, rows)?)
}

/// Faces of the solids.
pub fn solids(
    writer: &mut Writer<'_>,
    model: &CityModel<'_>,
    grid: &Grid,
    config: &GeoPackageConfig,
) -> Result<(), OutputError> {
    let kept = ["height_m", "ground_z_m", "base_z_m", "roof_z_m", "status"];
    let fields: Vec<_> = FIELDS.iter().filter(|f| kept.contains(&f.name)).collect();
    let mut columns = vec![column("id", ColumnKind::Text, "Id of the building in the input")];
    columns.extend(fields.iter().map(|f| column(f.name, kind(f.kind), f.meaning)));
    let spec = LayerSpec {
        name: "buildings_lod1",
        description: "Faces of the LOD 1.2 solids, for tools that cannot extrude outlines",
        geometry: GeometryKind::MultiPolygonZ,
        columns: &columns,
    };
    let rows = model.records.iter().filter_map(|record| {
        let prism = Prism::of(record, grid, config.min_thickness_m).ok()?;
        let in_metres = |ring: &Vec<[i64; 3]>| ring.iter().map(|p| grid.metres(*p).map(attributes::round_m)).collect();
        let faces: Vec<Vec<Vec<[f64; 3]>>> =
            prism.faces().iter().map(|face| face.rings.iter().map(in_metres).collect()).collect();
        let mut values = vec![Value::from(record.id.as_str())];
        values.extend(fields.iter().map(|f| flat(attributes::value(record, f, None))));
        Some(Row { wkb: Some(wkb::multi_polygon_z(&faces)), values })
    });
    Ok(writer.layer(&spec, rows)?)
}

/// Projection centres with viewing directions.
pub fn cameras(writer: &mut Writer<'_>, survey: &Survey) -> Result<(), OutputError> {
    let columns = [
        column("image", ColumnKind::Text, "Name of the photo"),
        column("kind", ColumnKind::Text, "nadir, oblique or upward"),
        column("yaw_deg", ColumnKind::Real, "Direction of view, degrees clockwise from grid north"),
        column("pitch_deg", ColumnKind::Real, "Direction of view above the horizon, degrees; -90 is straight down"),
        column("width_px", ColumnKind::Integer, "Width of the photo, pixels"),
        column("height_px", ColumnKind::Integer, "Height of the photo, pixels"),
    ];
    let spec = LayerSpec {
        name: "cameras",
        description: "Projection centres of the photos",
        geometry: GeometryKind::PointZ,
        columns: &columns,
    };
    let rows = survey.views.iter().map(|view| {
        let centre = view.camera_from_map.centre();
        let (yaw_deg, pitch_deg) = view_direction_deg(view);
        let values = vec![
            view.id.0.as_str().into(),
            serde_json::to_value(view.kind()).unwrap_or_default(),
            attributes::metres(yaw_deg),
            attributes::metres(pitch_deg),
            view.camera.width_px.into(),
            view.camera.height_px.into(),
        ];
        Row { wkb: Some(wkb::point_z(centre.to_array().map(attributes::round_m))), values }
    });
    Ok(writer.layer(&spec, rows)?)
}

/// What was wrong with single items of the input; without a place there is no geometry.
pub fn issues(writer: &mut Writer<'_>, issues: &[Issue]) -> Result<(), OutputError> {
    let columns = [
        column("code", ColumnKind::Text, "Stable name of the kind of issue"),
        column("severity", ColumnKind::Text, "note, warning or refused"),
        column("subject_kind", ColumnKind::Text, "view, building or input"),
        column("subject", ColumnKind::Text, "Name of the photo, building or file"),
        column("message", ColumnKind::Text, "What, expected against found"),
        column("hint", ColumnKind::Text, "What to do about it"),
    ];
    let spec = LayerSpec {
        name: "qa_issues",
        description: "What was wrong with single items of the input",
        geometry: GeometryKind::Point,
        columns: &columns,
    };
    let rows = issues.iter().map(|issue| {
        let (subject_kind, subject) = match &issue.subject {
            Subject::View(name) => ("view", name),
            Subject::Building(id) => ("building", id),
            Subject::Input(name) => ("input", name),
        };
        let values = vec![
            issue.code.as_str().into(),
            serde_json::to_value(issue.severity).unwrap_or_default(),
            subject_kind.into(),
            subject.as_str().into(),
            issue.message.as_str().into(),
            issue.hint.as_deref().map_or(Value::Null, Value::from),
        ];
        Row { wkb: issue.place.map(wkb::point), values }
    });
    Ok(writer.layer(&spec, rows)?)
}

/// Yaw clockwise from grid north and pitch above the horizon of a view's optical axis, degrees.
fn view_direction_deg(view: &View) -> (f64, f64) {
    let axis = view.axis_in_map();
    let pitch_deg = axis.z.clamp(-1.0, 1.0).asin().to_degrees();
    // Straight down the axis has no direction: then up in the photo tells where the camera is turned to.
    let heading = if axis.truncate().length() > 1e-6 {
        axis
    } else {
        view.camera_from_map.rotation.transpose() * -glam::DVec3::Y
    };
    (heading.x.atan2(heading.y).to_degrees().rem_euclid(360.0), pitch_deg)
}

fn column(name: &str, kind: ColumnKind, meaning: &str) -> Column {
    Column { name: name.to_owned(), kind, meaning: meaning.to_owned() }
}

fn kind(kind: FieldKind) -> ColumnKind {
    match kind {
        FieldKind::Text => ColumnKind::Text,
        FieldKind::Real => ColumnKind::Real,
        FieldKind::Integer => ColumnKind::Integer,
    }
}

/// A list as text; anything else as it is.
fn flat(value: Value) -> Value {
    match value {
        Value::Array(items) => {
            let words: Vec<&str> = items.iter().filter_map(Value::as_str).collect();
            words.join(LIST_SEPARATOR).into()
        }
        other => other,
    }
}

/// A user's attribute as a column.
struct Carried {
    /// The user's name.
    name: String,
    /// Name of the column.
    column: String,
    kind: ColumnKind,
}

impl Carried {
    fn value(&self, value: &Value) -> Value {
        match (self.kind, value) {
            (ColumnKind::Integer, Value::Bool(flag)) => i64::from(*flag).into(),
            (ColumnKind::Text, Value::String(_)) | (_, Value::Null | Value::Number(_)) => value.clone(),
            (_, other) => other.to_string().into(),
        }
    }
}

/// One column per attribute name of any record, in the order of first appearance. Its type is the narrowest that
/// holds all values; names that differ only by case get a number, because the format does not tell them apart.
fn carried_columns(records: &[BuildingRecord]) -> Vec<Carried> {
    let mut kinds: indexmap::IndexMap<&str, Option<ColumnKind>> = indexmap::IndexMap::new();
    for (name, value) in records.iter().flat_map(|record| &record.attributes) {
        let so_far = kinds.entry(name).or_default();
        *so_far = wider(*so_far, value);
    }
    let mut n_used: BTreeMap<String, usize> = BTreeMap::new();
    let carried = kinds.into_iter().map(|(name, kind)| {
        let column = attributes::carried_name(name);
        let n = n_used.entry(column.to_lowercase()).and_modify(|n| *n += 1).or_insert(1);
        let column = if *n == 1 { column } else { format!("{column}_{n}") };
        Carried { name: name.to_owned(), column, kind: kind.unwrap_or(ColumnKind::Text) }
    });
    carried.collect()
}

fn wider(so_far: Option<ColumnKind>, value: &Value) -> Option<ColumnKind> {
    let needed = match value {
        Value::Null => return so_far,
        Value::Bool(_) => ColumnKind::Integer,
        Value::Number(number) if number.as_i64().is_some() => ColumnKind::Integer,
        Value::Number(_) => ColumnKind::Real,
        Value::String(_) | Value::Array(_) | Value::Object(_) => ColumnKind::Text,
    };
    Some(match (so_far, needed) {
        (None, needed) => needed,
        (Some(a), b) if a == b => a,
        (Some(ColumnKind::Integer), ColumnKind::Real) | (Some(ColumnKind::Real), ColumnKind::Integer) => {
            ColumnKind::Real
        }
        _ => ColumnKind::Text,
    })
}
