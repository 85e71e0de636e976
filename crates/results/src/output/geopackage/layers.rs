//! The layers with geometry. A layer of single things (cameras, issues, tiles) is a [`Table`]: a column and how to fill
//! it stand together.

use serde_json::Value;

use super::super::attributes::{self, FIELDS, Field, ID};
use super::super::facts::SolidFacts;
use super::super::outlines::{OutlineRows, own_values};
use super::super::prism::Prism;
use super::super::{BuildingRecord, OutputError, Overview, Records, wkb};
use super::{GeoPackageConfig, Grid, TileArea};
use sizeup_geo::geodata::features::ColumnKind::{Integer, Real, Text};
use sizeup_geo::geodata::features::{Column, ColumnKind, GeometryKind, LayerSpec, Row};
use sizeup_geo::geodata::gpkg::Writer;
use sizeup_geo::issue::{Issue, Subject};
use sizeup_survey::{Survey, View};

/// Our fields that the faces of the solids have too.
const FIELDS_OF_SOLIDS: [&str; 6] = ["part_of", "height_m", "ground_z_m", "base_z_m", "roof_z_m", "status"];

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
    let fields: Vec<Field> =
        FIELDS.into_iter().filter(|field| FIELDS_OF_SOLIDS.contains(&&*field.column.name)).collect();
    let columns: Vec<Column> = std::iter::once(ID).chain(fields.iter().map(|field| field.column.clone())).collect();
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
        Some(Row {
            wkb: Some(wkb::multi_polygon_z(&faces)),
            values: own_values(record, &fields, &SolidFacts::default()),
        })
    };
    writer.layer(&spec, |push| records.visit(&mut |record| row(record).map_or(Ok(()), &mut *push)))
}

/// A column and how to fill it.
type FieldOf<T> = (Column, fn(&T) -> Value);

/// A layer whose rows come from things of one kind.
struct Table<'a, T> {
    name: &'a str,
    description: &'a str,
    geometry: GeometryKind,
    fields: Vec<FieldOf<T>>,
    wkb: fn(&T) -> Option<Vec<u8>>,
}

impl<T> Table<'_, T> {
    fn write<'t>(&self, writer: &mut Writer<'_>, things: impl Iterator<Item = &'t T>) -> Result<(), OutputError>
    where
        T: 't,
    {
        let columns: Vec<Column> = self.fields.iter().map(|(column, _)| column.clone()).collect();
        let Self { name, description, geometry, .. } = *self;
        let spec = LayerSpec { name, description, geometry, columns: &columns };
        let row = |thing| Row { wkb: (self.wkb)(thing), values: self.fields.iter().map(|(_, of)| of(thing)).collect() };
        writer.layer(&spec, |push| things.map(row).try_for_each(push))
    }
}

fn field<T>(name: &'static str, kind: ColumnKind, meaning: &'static str, of: fn(&T) -> Value) -> FieldOf<T> {
    (Column::new(name, kind, meaning), of)
}

/// The areas that were worked on one by one; a run that was not divided is one tile, and has none in `areas`.
pub fn tiles(writer: &mut Writer<'_>, overview: &Overview, areas: &[TileArea]) -> Result<(), OutputError> {
    let table: Table<'_, TileArea> = Table {
        name: "tiles",
        description: "Areas that were worked on one by one",
        geometry: GeometryKind::Polygon,
        fields: vec![
            field("tile", Text, "Name of the tile", |area| area.name.as_str().into()),
            field("status", Text, "done, or why not", |area| area.status.into()),
            field("n_buildings", Integer, "Buildings of the tile", |area| area.n_buildings.into()),
            field("n_heights", Integer, "Of them, those with a height", |area| area.n_heights.into()),
        ],
        wkb: |area| {
            let [west, south, east, north] = area.corners_m.map(attributes::round_m);
            Some(wkb::polygon(&geo_types::Rect::new((west, south), (east, north)).to_polygon()))
        },
    };
    let whole = overview.extent.filter(|_| areas.is_empty()).map(|extent| {
        let ([west, south, _], [east, north, _]) = (extent.min_m, extent.max_m);
        let (n_buildings, n_heights) = (overview.n_buildings, overview.n_heights);
        let corners_m = [west, south, east, north];
        TileArea { name: "all".to_owned(), status: "done", corners_m, n_buildings, n_heights }
    });
    table.write(writer, areas.iter().chain(&whole))
}

/// Projection centres with viewing directions.
pub fn cameras(writer: &mut Writer<'_>, survey: &Survey) -> Result<(), OutputError> {
    let table: Table<'_, View> = Table {
        name: "cameras",
        description: "Projection centres of the photos",
        geometry: GeometryKind::PointZ,
        fields: vec![
            field("image", Text, "Name of the photo", |view| view.id.0.as_str().into()),
            field("kind", Text, "nadir, oblique or upward", |view| {
                serde_json::to_value(view.kind()).unwrap_or_default()
            }),
            field("yaw_deg", Real, "Direction of view, degrees clockwise from grid north", |view| {
                attributes::metres(view_direction_deg(view).0)
            }),
            field("pitch_deg", Real, "Direction of view above the horizon, degrees; -90 is straight down", |view| {
                attributes::metres(view_direction_deg(view).1)
            }),
            field("width_px", Integer, "Width of the photo, pixels", |view| view.camera.width_px.into()),
            field("height_px", Integer, "Height of the photo, pixels", |view| view.camera.height_px.into()),
        ],
        wkb: |view| {
            let centre = view.camera_from_map.centre();
            Some(wkb::point_z(centre.to_array().map(attributes::round_m)))
        },
    };
    table.write(writer, survey.views.iter())
}

/// What was wrong with single items of the input; without a place there is no geometry.
pub fn issues(writer: &mut Writer<'_>, issues: &[Issue]) -> Result<(), OutputError> {
    let table: Table<'_, Issue> = Table {
        name: "qa_issues",
        description: "What was wrong with single items of the input",
        geometry: GeometryKind::Point,
        fields: vec![
            field("code", Text, "Stable name of the kind of issue", |issue| issue.code.as_str().into()),
            field("severity", Text, "note, warning or refused", |issue| {
                serde_json::to_value(issue.severity).unwrap_or_default()
            }),
            field("subject_kind", Text, "view, building or input", |issue| subject(issue).0.into()),
            field("subject", Text, "Name of the photo, building or file", |issue| subject(issue).1.into()),
            field("message", Text, "What, expected against found", |issue| issue.message.as_str().into()),
            field("hint", Text, "What to do about it", |issue| issue.hint.as_deref().map_or(Value::Null, Value::from)),
        ],
        wkb: |issue| issue.place.map(wkb::point),
    };
    table.write(writer, issues.iter())
}

/// What an issue is about: its kind and its name.
fn subject(issue: &Issue) -> (&'static str, &str) {
    match &issue.subject {
        Subject::View(name) => ("view", name),
        Subject::Building(id) => ("building", id),
        Subject::Input(name) => ("input", name),
    }
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
