//! The layers with geometry. A layer of single things (cameras, issues, tiles) is a [`Table`]: a column and how to fill
//! it stand together.

use crate::output::prism::MIN_THICKNESS_M;
use geo::MapCoords as _;
use serde_json::Value;

use super::super::attributes::{self, FIELDS, Field, ID};
use super::super::facts::SolidFacts;
use super::super::footprints::{self, FootprintRows, own_values};
use super::super::prism::{GridFace, SnappedPrism};
use super::super::roof_solid::{self, Detail};
use super::super::{BuildingRecord, OutputError, Overview, Records, wkb};
use super::{OutputGrid, TileArea};
use sizeup_geo::geodata::features::ColumnKind::{Integer, Real, Text};
use sizeup_geo::geodata::features::{Column, ColumnKind, FID, GeometryKind, LayerSpec, Row};
use sizeup_geo::geodata::gpkg::Writer;
use sizeup_geo::issue::{Issue, Subject};
use sizeup_survey::{Survey, View};

/// Our fields that the faces of the solids have too.
const FIELDS_OF_SOLIDS: [&str; 6] = ["part_of", "height_m", "ground_z_m", "base_z_m", "roof_z_m", "status"];

/// Footprints with all attributes.
pub fn buildings<R: Records + ?Sized>(
    writer: &mut Writer<'_>,
    records: &R,
    rows: &FootprintRows,
) -> Result<(), OutputError> {
    let spec = LayerSpec {
        name: "buildings",
        description: "Footprints with heights; one row per building of the input, or per part of one",
        geometry: GeometryKind::Polygon,
        columns: &rows.columns,
    };
    writer.layer(&spec, |push| records.visit(&mut |record| push(rows.row(record))))
}

/// Our fields of a footprint that is off.
const FIELDS_OF_SHIFTS: [&str; 5] = ["part_of", "off_east_m", "off_north_m", "off_sigma_m", "too_large_m"];

fn fields_of_shifts() -> Vec<Field> {
    FIELDS.into_iter().filter(|field| FIELDS_OF_SHIFTS.contains(&&*field.column.name)).collect()
}

fn columns_of_shifts() -> Vec<Column> {
    std::iter::once(ID).chain(fields_of_shifts().into_iter().map(|field| field.column)).collect()
}

/// Footprints that are off, where the photos show their buildings.
pub fn moved<R: Records + ?Sized>(writer: &mut Writer<'_>, records: &R) -> Result<(), OutputError> {
    let (fields, columns) = (fields_of_shifts(), columns_of_shifts());
    let spec = LayerSpec {
        name: "footprints_moved",
        description: "Footprints that are off, moved to where the photos show their buildings",
        geometry: GeometryKind::Polygon,
        columns: &columns,
    };
    let row = |record: &BuildingRecord| {
        let rounded =
            record.footprint_in_photos()?.map_coords(|c| (attributes::round_m(c.x), attributes::round_m(c.y)).into());
        Some(Row { wkb: Some(wkb::polygon(&rounded)), values: own_values(record, &fields, &SolidFacts::default()) })
    };
    writer.layer(&spec, |push| records.visit(&mut |record| row(record).map_or(Ok(()), &mut *push)))
}

fn fields_of_solids() -> Vec<Field> {
    FIELDS.into_iter().filter(|field| FIELDS_OF_SOLIDS.contains(&&*field.column.name)).collect()
}

fn columns_of_solids() -> Vec<Column> {
    std::iter::once(ID).chain(fields_of_solids().into_iter().map(|field| field.column)).collect()
}

/// The columns of a layer of a city, as a reader of the file sees them: the feature id, then its own; none for a layer
/// that there is not.
#[must_use]
pub fn columns_of(layer: &str, overview: &Overview) -> Vec<Column> {
    let own = match layer {
        "buildings" => footprints::columns(overview),
        "buildings_lod1" | "buildings_lod13" | "buildings_lod2" => columns_of_solids(),
        "footprints_moved" => columns_of_shifts(),
        "tiles" => tiles_table().columns(),
        "cameras" => cameras_table().columns(),
        "qa_issues" => issues_table().columns(),
        _ => return Vec::new(),
    };
    std::iter::once(FID).chain(own).collect()
}

/// Faces of the solids as blocks.
pub fn blocks<R: Records + ?Sized>(writer: &mut Writer<'_>, records: &R, grid: &OutputGrid) -> Result<(), OutputError> {
    let description = "Faces of the LOD 1.2 solids, for tools that cannot extrude footprints";
    let faces = |record: &BuildingRecord| Some(SnappedPrism::of(record, grid, MIN_THICKNESS_M).ok()?.faces());
    solids(writer, ("buildings_lod1", description), records, grid, faces)
}

/// Faces of the solids with as much of their roofs; blocks where no more of them is known.
pub fn roofed<R: Records + ?Sized>(
    writer: &mut Writer<'_>,
    records: &R,
    grid: &OutputGrid,
    detail: Detail,
) -> Result<(), OutputError> {
    let layer = match detail {
        Detail::Levels => ("buildings_lod13", "Faces of the LOD 1.3 solids: the levels of stepped roofs, else blocks"),
        Detail::Slopes => {
            ("buildings_lod2", "Faces of the LOD 2.0 solids: roofs of the form that was found, else blocks")
        }
    };
    let faces = |record: &BuildingRecord| {
        let block = SnappedPrism::of(record, grid, MIN_THICKNESS_M).ok()?;
        Some(roof_solid::faces(record, &block, grid, detail).unwrap_or_else(|| block.faces()))
    };
    solids(writer, layer, records, grid, faces)
}

fn solids<R: Records + ?Sized>(
    writer: &mut Writer<'_>,
    (name, description): (&str, &str),
    records: &R,
    grid: &OutputGrid,
    faces: impl Fn(&BuildingRecord) -> Option<Vec<GridFace>>,
) -> Result<(), OutputError> {
    let (fields, columns) = (fields_of_solids(), columns_of_solids());
    let spec = LayerSpec { name, description, geometry: GeometryKind::MultiPolygonZ, columns: &columns };
    let row = |record: &BuildingRecord| {
        let in_metres = |ring: &Vec<[i64; 3]>| ring.iter().map(|p| grid.metres(*p).map(attributes::round_m)).collect();
        let faces: Vec<Vec<Vec<[f64; 3]>>> =
            faces(record)?.iter().map(|face| face.rings.iter().map(in_metres).collect()).collect();
        Some(Row {
            wkb: Some(wkb::multi_polygon_z(&faces)),
            values: own_values(record, &fields, &SolidFacts::default()),
        })
    };
    writer.layer(&spec, |push| records.visit(&mut |record| row(record).map_or(Ok(()), &mut *push)))
}

/// A column and how to fill it.
pub(crate) type FieldOf<T> = (Column, fn(&T) -> Value);

/// A layer whose rows come from things of one kind.
struct Table<'a, T> {
    name: &'a str,
    description: &'a str,
    geometry: GeometryKind,
    fields: Vec<FieldOf<T>>,
    wkb: fn(&T) -> Option<Vec<u8>>,
}

impl<T> Table<'_, T> {
    fn columns(&self) -> Vec<Column> {
        self.fields.iter().map(|(column, _)| column.clone()).collect()
    }

    fn write<'t>(&self, writer: &mut Writer<'_>, things: impl Iterator<Item = &'t T>) -> Result<(), OutputError>
    where
        T: 't,
    {
        let columns = self.columns();
        let Self { name, description, geometry, .. } = *self;
        let spec = LayerSpec { name, description, geometry, columns: &columns };
        let row = |thing| Row { wkb: (self.wkb)(thing), values: self.fields.iter().map(|(_, of)| of(thing)).collect() };
        writer.layer(&spec, |push| things.map(row).try_for_each(push))
    }
}

/// A column and what fills it.
pub(crate) const fn field<T>(
    name: &'static str,
    title: &'static str,
    kind: ColumnKind,
    meaning: &'static str,
    of: fn(&T) -> Value,
) -> FieldOf<T> {
    (Column::new(name, title, kind, meaning), of)
}

/// The layer of the areas.
fn tiles_table() -> Table<'static, TileArea> {
    Table {
        name: "tiles",
        description: "Areas that were worked on one by one",
        geometry: GeometryKind::Polygon,
        fields: vec![
            field("tile", "Tile", Text, "Name of the tile", |area| area.name.as_str().into()),
            field("status", "Status", Text, "done, or why not", |area| area.status.into()),
            field("n_buildings", "Buildings", Integer, "Buildings of the tile", |area| area.n_buildings.into()),
            field("n_heights", "Heights", Integer, "Of them, those with a height", |area| area.n_heights.into()),
        ],
        wkb: |area| {
            let [west, south, east, north] = area.corners_m.map(attributes::round_m);
            Some(wkb::polygon(&geo_types::Rect::new((west, south), (east, north)).to_polygon()))
        },
    }
}

/// The areas that were worked on one by one; a run that was not divided is one tile, and has none in `areas`.
pub fn tiles(writer: &mut Writer<'_>, overview: &Overview, areas: &[TileArea]) -> Result<(), OutputError> {
    let whole = overview.extent.filter(|_| areas.is_empty()).map(|extent| {
        let ([west, south, _], [east, north, _]) = (extent.min_m, extent.max_m);
        let (n_buildings, n_heights) = (overview.n_buildings, overview.n_heights);
        let corners_m = [west, south, east, north];
        TileArea { name: "all".to_owned(), status: "done", corners_m, n_buildings, n_heights }
    });
    tiles_table().write(writer, areas.iter().chain(&whole))
}

/// The layer of the photos.
fn cameras_table() -> Table<'static, View> {
    Table {
        name: "cameras",
        description: "Projection centres of the photos",
        geometry: GeometryKind::PointZ,
        fields: vec![
            field("image", "Photo", Text, "Name of the photo", |view| view.id.0.as_str().into()),
            field("kind", "Kind", Text, "nadir, oblique or upward", |view| {
                serde_json::to_value(view.kind()).unwrap_or_default()
            }),
            field(
                "yaw_deg",
                "Direction (degrees)",
                Real,
                "Direction of view, degrees clockwise from grid north",
                |view| attributes::metres(view_direction_deg(view).0),
            ),
            field(
                "pitch_deg",
                "Above the horizon (degrees)",
                Real,
                "Direction of view above the horizon, degrees; -90 is straight down",
                |view| attributes::metres(view_direction_deg(view).1),
            ),
            field("width_px", "Width (px)", Integer, "Width of the photo, pixels", |view| view.camera.width_px.into()),
            field("height_px", "Height (px)", Integer, "Height of the photo, pixels", |view| {
                view.camera.height_px.into()
            }),
        ],
        wkb: |view| {
            let centre = view.camera_from_map.centre();
            Some(wkb::point_z(centre.to_array().map(attributes::round_m)))
        },
    }
}

/// Projection centres with viewing directions.
pub fn cameras(writer: &mut Writer<'_>, survey: &Survey) -> Result<(), OutputError> {
    cameras_table().write(writer, survey.views.iter())
}

/// The layer of the issues.
fn issues_table() -> Table<'static, Issue> {
    Table {
        name: "qa_issues",
        description: "What was wrong with single items of the input",
        geometry: GeometryKind::Point,
        fields: vec![
            field("code", "Code", Text, "Stable name of the kind of issue", |issue| issue.code.as_str().into()),
            field("severity", "Severity", Text, "note, warning or refused", |issue| {
                serde_json::to_value(issue.severity).unwrap_or_default()
            }),
            field("subject_kind", "Kind of subject", Text, "view, building or input", |issue| subject(issue).0.into()),
            field("subject", "Subject", Text, "Name of the photo, building or file", |issue| subject(issue).1.into()),
            field("message", "Message", Text, "What, expected against found", |issue| issue.message.as_str().into()),
            field("hint", "Hint", Text, "What to do about it", |issue| {
                issue.hint.as_deref().map_or(Value::Null, Value::from)
            }),
        ],
        wkb: |issue| issue.place.map(wkb::point),
    }
}

/// Issues of single items of the input; without a place there is no geometry.
pub fn issues(writer: &mut Writer<'_>, issues: &[Issue]) -> Result<(), OutputError> {
    issues_table().write(writer, issues.iter())
}

/// Subject of an issue: its kind and its name.
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
