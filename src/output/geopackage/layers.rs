//! The layers with geometry.

use serde_json::Value;

use super::super::attributes::{self, FIELDS, ID};
use super::super::outlines::{OutlineRows, flat};
use super::super::prism::Prism;
use super::super::{BuildingRecord, OutputError, Overview, Records, wkb};
use super::{GeoPackageConfig, Grid, TileArea};
use crate::geodata::features::{Column, ColumnKind, GeometryKind, LayerSpec, Row};
use crate::geodata::gpkg::Writer;
use crate::issue::{Issue, Subject};
use crate::survey::{Survey, View};

/// Outlines with all attributes.
pub fn buildings<R: Records + ?Sized>(
    writer: &mut Writer<'_>,
    records: &R,
    rows: &OutlineRows,
) -> Result<(), OutputError> {
    let spec = LayerSpec {
        name: "buildings",
        description: "Outlines with heights; one row per building of the input, or per part of one",
        geometry: GeometryKind::Polygon,
        columns: &rows.columns,
    };
    writer.layer(&spec, |push| records.visit(&mut |record| push(rows.row(record))))
}

/// Faces of the solids.
pub fn solids<R: Records + ?Sized>(
    writer: &mut Writer<'_>,
    records: &R,
    grid: &Grid,
    config: &GeoPackageConfig,
) -> Result<(), OutputError> {
    let kept = ["part_of", "height_m", "ground_z_m", "base_z_m", "roof_z_m", "status"];
    let fields: Vec<_> = FIELDS.into_iter().filter(|f| kept.contains(&&*f.name)).collect();
    let columns: Vec<Column> = std::iter::once(ID).chain(fields.iter().cloned()).collect();
    let spec = LayerSpec {
        name: "buildings_lod1",
        description: "Faces of the LOD 1.2 solids, for tools that cannot extrude outlines",
        geometry: GeometryKind::MultiPolygonZ,
        columns: &columns,
    };
    let row = |record: &BuildingRecord| {
        let prism = Prism::of(record, grid, config.min_thickness_m).ok()?;
        let in_metres = |ring: &Vec<[i64; 3]>| ring.iter().map(|p| grid.metres(*p).map(attributes::round_m)).collect();
        let faces: Vec<Vec<Vec<[f64; 3]>>> =
            prism.faces().iter().map(|face| face.rings.iter().map(in_metres).collect()).collect();
        let mut values = vec![Value::from(record.id.as_str())];
        values.extend(fields.iter().map(|f| flat(attributes::value(record, f, None))));
        Some(Row { wkb: Some(wkb::multi_polygon_z(&faces)), values })
    };
    writer.layer(&spec, |push| records.visit(&mut |record| row(record).map_or(Ok(()), &mut *push)))
}

/// The areas that were worked on one by one; a run that was not divided is one tile, and has none in `areas`.
pub fn tiles(writer: &mut Writer<'_>, overview: &Overview, areas: &[TileArea]) -> Result<(), OutputError> {
    let columns = [
        Column::new("tile", ColumnKind::Text, "Name of the tile"),
        Column::new("status", ColumnKind::Text, "done, or why not"),
        Column::new("n_buildings", ColumnKind::Integer, "Buildings of the tile"),
        Column::new("n_heights", ColumnKind::Integer, "Of them, those with a height"),
    ];
    let spec = LayerSpec {
        name: "tiles",
        description: "Areas that were worked on one by one",
        geometry: GeometryKind::Polygon,
        columns: &columns,
    };
    let row = |area: &TileArea| {
        let [west, south, east, north] = area.corners_m.map(attributes::round_m);
        let outline = geo_types::Rect::new((west, south), (east, north)).to_polygon();
        let values =
            vec![area.name.as_str().into(), area.status.into(), area.n_buildings.into(), area.n_heights.into()];
        Row { wkb: Some(wkb::polygon(&outline)), values }
    };
    let whole = overview.extent.filter(|_| areas.is_empty()).map(|extent| {
        let ([west, south, _], [east, north, _]) = (extent.min_m, extent.max_m);
        let (n_buildings, n_heights) = (overview.n_buildings, overview.n_heights);
        TileArea {
            name: "all".to_owned(),
            status: "done",
            corners_m: [west, south, east, north],
            n_buildings,
            n_heights,
        }
    });
    writer.layer(&spec, |push| areas.iter().chain(&whole).try_for_each(|area| push(row(area))))
}

/// Projection centres with viewing directions.
pub fn cameras(writer: &mut Writer<'_>, survey: &Survey) -> Result<(), OutputError> {
    let columns = [
        Column::new("image", ColumnKind::Text, "Name of the photo"),
        Column::new("kind", ColumnKind::Text, "nadir, oblique or upward"),
        Column::new("yaw_deg", ColumnKind::Real, "Direction of view, degrees clockwise from grid north"),
        Column::new(
            "pitch_deg",
            ColumnKind::Real,
            "Direction of view above the horizon, degrees; -90 is straight down",
        ),
        Column::new("width_px", ColumnKind::Integer, "Width of the photo, pixels"),
        Column::new("height_px", ColumnKind::Integer, "Height of the photo, pixels"),
    ];
    let spec = LayerSpec {
        name: "cameras",
        description: "Projection centres of the photos",
        geometry: GeometryKind::PointZ,
        columns: &columns,
    };
    let row = |view: &View| {
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
    };
    writer.layer(&spec, |push| survey.views.iter().try_for_each(|view| push(row(view))))
}

/// What was wrong with single items of the input; without a place there is no geometry.
pub fn issues(writer: &mut Writer<'_>, issues: &[Issue]) -> Result<(), OutputError> {
    let columns = [
        Column::new("code", ColumnKind::Text, "Stable name of the kind of issue"),
        Column::new("severity", ColumnKind::Text, "note, warning or refused"),
        Column::new("subject_kind", ColumnKind::Text, "view, building or input"),
        Column::new("subject", ColumnKind::Text, "Name of the photo, building or file"),
        Column::new("message", ColumnKind::Text, "What, expected against found"),
        Column::new("hint", ColumnKind::Text, "What to do about it"),
    ];
    let spec = LayerSpec {
        name: "qa_issues",
        description: "What was wrong with single items of the input",
        geometry: GeometryKind::Point,
        columns: &columns,
    };
    let row = |issue: &Issue| {
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
    };
    writer.layer(&spec, |push| issues.iter().try_for_each(|issue| push(row(issue))))
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
