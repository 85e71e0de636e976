//! A `GeoJSON` file as a layer, read with the `geojson` crate: what it holds is what GDAL makes of the same file, so that nothing
//! depends on who reads.
//!
//! Places are in WGS 84 (RFC 7946) unless the `crs` member of the standard's draft of 2008 names another system. A column has
//! one kind: whole numbers beside others become numbers with a point, anything beside text becomes text, true and false are 1
//! and 0, objects are their JSON.
//!
//! What is no such collection is left to GDAL, which says what is wrong with it: text that is no JSON, positions that are none,
//! a `crs` that names nothing, ids of several kinds, columns of times or of lists or that
//! the first feature has not, heights without a `crs`, nothing at all.

use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use geo::Intersects as _;
use geo_types::{Coord, GeometryCollection, LineString, MultiPolygon, Point, Polygon, Rect};
use geojson::feature::Id;
use geojson::{FeatureReader, GeometryValue, Position};
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Map as JsonMap, Value};

use super::body::{self, Face};
use super::vector::{Feature, FeatureGeometry};
use crate::crs::Crs;
use crate::files::is_virtual;
use crate::limits::Limits;

/// The CRS of the standard; longitude comes first whatever the authority says.
const WGS84: &str = "EPSG:4326";
/// Name of a system in the member `crs`, before its number.
const EPSG: [&str; 3] = ["urn:ogc:def:crs:EPSG:", "urn:x-ogc:def:crs:EPSG:", "EPSG:"];
/// WGS 84 with longitude first, as old files spell it.
const CRS84: &str = "CRS84";

/// A file's features, in memory.
#[derive(Debug)]
pub(super) struct GeoJsonLayer {
    /// As the file says, else as the file is called.
    pub name: String,
    /// The CRS of its places.
    pub crs: Crs,
    /// Names of its attributes, in the order in which they occur.
    pub fields: Vec<String>,
    /// West, south, east, north of what is shown.
    pub window: Option<[f64; 4]>,
    features: Vec<Feature>,
}

/// Members beside the features.
#[derive(Deserialize)]
struct Members {
    r#type: String,
    name: Option<String>,
    #[serde(default, deserialize_with = "some")]
    crs: Option<Value>,
    #[serde(rename = "features")]
    _features: IgnoredAny,
}

/// A member that is there, `null` too.
fn some<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<Value>, D::Error> {
    Value::deserialize(deserializer).map(Some)
}

impl GeoJsonLayer {
    /// Reads a file; `None` for what is left to GDAL.
    pub(super) fn read(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_string_lossy().to_ascii_lowercase();
        if is_virtual(path) || !["geojson", "json"].contains(&extension.as_str()) {
            return None;
        }
        let open = || Some(BufReader::new(File::open(path).ok()?));
        if std::fs::metadata(path).ok()?.len() > Limits::now().input_bytes() {
            return None;
        }
        let members: Members = serde_json::from_reader(open()?).ok()?;
        if members.r#type != "FeatureCollection" {
            return None;
        }
        let crs = crs_of(members.crs.as_ref())?;
        let features: Vec<geojson::Feature> =
            FeatureReader::from_reader(open()?).features().collect::<Result<_, _>>().ok()?;
        // Of places with heights and nothing said of them, GDAL says that they count from the ellipsoid, or does not.
        if members.crs.is_none() && features.iter().filter_map(|f| f.geometry.as_ref()).any(|g| has_heights(&g.value)) {
            return None;
        }
        let columns = CollectionColumns::of(&features)?;
        let numbers = numbers(&features)?;
        let name = members.name.filter(|name| !name.is_empty());
        Some(Self {
            name: name.unwrap_or_else(|| path.file_stem().unwrap_or_default().to_string_lossy().into_owned()),
            crs,
            window: None,
            features: features.into_iter().zip(numbers).map(|(feature, fid)| columns.feature(feature, fid)).collect(),
            fields: columns.0.into_iter().map(|(name, _)| name).collect(),
        })
    }

    /// Features that meet the window, in the file's order.
    pub(super) fn features(&self) -> impl Iterator<Item = Feature> + '_ {
        let window = self.window.map(|[west, south, east, north]| Rect::new((west, south), (east, north)));
        let is_shown = move |feature: &&Feature| match (&window, &feature.geometry) {
            (None, _) => true,
            (Some(window), FeatureGeometry::Shape(shape)) => shape.intersects(window),
            (Some(_), _) => false,
        };
        self.features.iter().filter(is_shown).cloned()
    }

    /// Number of features that it shows.
    pub(super) fn n_features(&self) -> u64 {
        self.features().count() as u64
    }
}

/// The CRS that a member `crs` names; `None` where it names nothing that is known.
fn crs_of(member: Option<&Value>) -> Option<Crs> {
    let Some(member) = member else { return Crs::parse(WGS84).ok() };
    let name = member["properties"]["name"].as_str().filter(|_| member["type"] == "name")?;
    if name.ends_with(CRS84) {
        return Crs::parse(WGS84).ok();
    }
    let rest = EPSG.iter().find_map(|start| name.strip_prefix(start))?;
    // A version of the registry may stand before the number.
    let code = rest.rsplit(':').next().filter(|code| code.bytes().all(|b| b.is_ascii_digit()))?;
    Crs::parse(&format!("EPSG:{code}")).ok()
}

/// The number of each feature: its own, or its position where none has one; `None` where some have and others have not, or one
/// comes twice.
fn numbers(features: &[geojson::Feature]) -> Option<Vec<u64>> {
    let own: Vec<u64> = features.iter().filter_map(number_of).collect();
    let is_one_each = own.len() == features.len() && own.iter().collect::<BTreeSet<_>>().len() == own.len();
    match own.len() {
        0 => Some((0..features.len() as u64).collect()),
        _ => is_one_each.then_some(own),
    }
}

fn number_of(feature: &geojson::Feature) -> Option<u64> {
    match &feature.id {
        Some(Id::Number(number)) => number.as_u64(),
        Some(Id::String(_)) | None => None,
    }
}

/// The kind of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ValueKind {
    /// Nothing but nulls so far.
    Unknown,
    Whole,
    Real,
    Text,
}

impl ValueKind {
    fn of(value: &Value) -> Option<Self> {
        match value {
            Value::Null => Some(Self::Unknown),
            Value::Bool(_) => Some(Self::Whole),
            Value::Number(number) if number.is_i64() => Some(Self::Whole),
            Value::Number(number) if number.is_f64() => Some(Self::Real),
            Value::String(text) if !is_time(text) => Some(Self::Text),
            Value::Object(_) => Some(Self::Text),
            Value::Number(_) | Value::String(_) | Value::Array(_) => None,
        }
    }

    fn and(self, other: Self) -> Self {
        match (self, other) {
            (kind, Self::Unknown) | (Self::Unknown, kind) => kind,
            (a, b) if a == b => a,
            (Self::Text, _) | (_, Self::Text) => Self::Text,
            _ => Self::Real,
        }
    }

    fn value(self, value: Value) -> Value {
        match (self, value) {
            (Self::Whole, Value::Bool(is_so)) => i64::from(is_so).into(),
            (Self::Real, Value::Number(number)) => number.as_f64().into(),
            (Self::Real, Value::Bool(is_so)) => f64::from(u8::from(is_so)).into(),
            (Self::Text, Value::String(text)) => text.into(),
            (Self::Text, Value::Null) => Value::Null,
            (Self::Text, other) => other.to_string().into(),
            (_, value) => value,
        }
    }
}

/// Whether GDAL would take a text for a date or a time: digits, separators, and a date's length.
fn is_time(text: &str) -> bool {
    let bytes = text.as_bytes();
    let is = |at: usize, separators: &[u8]| bytes.get(at).is_some_and(|b| separators.contains(b));
    let digits = |at: std::ops::Range<usize>| bytes.get(at).is_some_and(|part| part.iter().all(u8::is_ascii_digit));
    let is_date = digits(0..4) && is(4, b"-/") && digits(5..7) && is(7, b"-/") && digits(8..10);
    let is_clock = digits(0..2) && is(2, b":") && digits(3..5);
    is_date || is_clock
}

/// The columns of a collection and their kinds.
struct CollectionColumns(Vec<(String, ValueKind)>);

impl CollectionColumns {
    /// `None` for columns that are left to GDAL.
    fn of(features: &[geojson::Feature]) -> Option<Self> {
        let mut columns: Vec<(String, ValueKind)> = Vec::new();
        let mut places: HashMap<String, usize> = HashMap::new();
        let mut add = |name: &str, kind: ValueKind| {
            let place = *places.entry(name.to_owned()).or_insert_with(|| {
                columns.push((name.to_owned(), kind));
                columns.len() - 1
            });
            columns[place].1 = columns[place].1.and(kind);
        };
        for feature in features {
            let own = feature.properties.iter().flatten();
            match &feature.id {
                // A text before the attributes is one of them, unless there is one of that name.
                Some(Id::String(_)) if feature.properties.iter().any(|own| own.contains_key(ID)) => return None,
                Some(Id::String(_)) => add(ID, ValueKind::Text),
                Some(Id::Number(_)) | None => {}
            }
            for (name, value) in own {
                add(name, ValueKind::of(value)?);
            }
        }
        let is_named = |feature: &&geojson::Feature| matches!(feature.id, Some(Id::String(_)));
        let n_named = features.iter().filter(is_named).count();
        let first = features.first()?;
        // A column that comes up later has a place among the others that GDAL works out.
        let n_first = first.properties.as_ref().map_or(0, serde_json::Map::len) + usize::from(is_named(&first));
        let is_plain = columns.len() == n_first && (n_named == 0 || n_named == features.len());
        is_plain.then_some(Self(columns))
    }

    fn feature(&self, feature: geojson::Feature, fid: u64) -> Feature {
        let mut own = feature.properties.unwrap_or_default();
        if let Some(Id::String(id)) = feature.id {
            own.insert(ID.to_owned(), id.into());
        }
        let mut value =
            |(name, kind): &(String, ValueKind)| (name.clone(), kind.value(own.remove(name).unwrap_or_default()));
        let attributes: JsonMap<String, Value> = self.0.iter().map(&mut value).collect();
        let outline = feature.geometry.as_ref().and_then(|geometry| outline_of_body(&geometry.value));
        let is_body = outline.is_some();
        let shape = match outline {
            Some(outline) => Some(outline.into()),
            None => feature.geometry.and_then(|geometry| shape(&geometry.value)),
        };
        let geometry = shape.map_or(FeatureGeometry::Missing, FeatureGeometry::Shape);
        Feature { fid: Some(fid), geometry, is_body, attributes }
    }
}

/// The attribute that holds a feature's id where it is a text.
const ID: &str = "id";

/// Whether a place has a third coordinate.
fn has_heights(geometry: &GeometryValue) -> bool {
    let of_line = |line: &Vec<Position>| line.iter().any(|at| at.len() > 2);
    match geometry {
        GeometryValue::Point { coordinates } => coordinates.len() > 2,
        GeometryValue::MultiPoint { coordinates } | GeometryValue::LineString { coordinates } => of_line(coordinates),
        GeometryValue::MultiLineString { coordinates } | GeometryValue::Polygon { coordinates } => {
            coordinates.iter().any(of_line)
        }
        GeometryValue::MultiPolygon { coordinates } => coordinates.iter().flatten().any(of_line),
        GeometryValue::GeometryCollection { geometries } => geometries.iter().any(|part| has_heights(&part.value)),
    }
}

/// The outline in plan of a body; `None` for anything else.
fn outline_of_body(geometry: &GeometryValue) -> Option<MultiPolygon<f64>> {
    if !has_heights(geometry) {
        return None;
    }
    match geometry {
        GeometryValue::MultiPolygon { .. } | GeometryValue::GeometryCollection { .. } => {
            body::outline(&faces(geometry)?)
        }
        _ => None,
    }
}

/// All faces of a geometry, however they are grouped; `None` where there is anything else in it.
fn faces(geometry: &GeometryValue) -> Option<Vec<Face>> {
    let face = |rings: &Vec<Vec<Position>>| {
        // GDAL gives places without a height the height 0.
        let heights = rings.first()?.iter().map(|at| at.as_slice().get(2).copied().unwrap_or(0.0));
        Some(Face::new(&polygon(rings)?, heights))
    };
    match geometry {
        GeometryValue::Polygon { coordinates } => Some(face(coordinates).into_iter().collect()),
        GeometryValue::MultiPolygon { coordinates } => Some(coordinates.iter().filter_map(face).collect()),
        GeometryValue::GeometryCollection { geometries } => {
            let parts = geometries.iter().map(|part| faces(&part.value)).collect::<Option<Vec<_>>>()?;
            Some(parts.into_iter().flatten().collect())
        }
        _ => None,
    }
}

/// `None` for an empty one.
fn shape(geometry: &GeometryValue) -> Option<geo_types::Geometry<f64>> {
    match geometry {
        GeometryValue::Point { coordinates } => Some(point(coordinates).into()),
        GeometryValue::LineString { coordinates } => Some(line(coordinates)?.into()),
        GeometryValue::Polygon { coordinates } => Some(polygon(coordinates)?.into()),
        GeometryValue::MultiPolygon { coordinates } => {
            let parts: Vec<Polygon<f64>> = coordinates.iter().filter_map(|part| polygon(part)).collect();
            (!parts.is_empty()).then(|| MultiPolygon::new(parts).into())
        }
        GeometryValue::MultiPoint { coordinates } => collection(coordinates.iter().map(|at| point(at).into())),
        GeometryValue::MultiLineString { coordinates } => {
            collection(coordinates.iter().filter_map(|part| Some(line(part)?.into())))
        }
        GeometryValue::GeometryCollection { geometries } => {
            collection(geometries.iter().filter_map(|part| shape(&part.value)))
        }
    }
}

fn collection(parts: impl Iterator<Item = geo_types::Geometry<f64>>) -> Option<geo_types::Geometry<f64>> {
    let parts: Vec<_> = parts.collect();
    (!parts.is_empty()).then_some(geo_types::Geometry::GeometryCollection(GeometryCollection(parts)))
}

fn polygon(rings: &[Vec<Position>]) -> Option<Polygon<f64>> {
    let mut rings = rings.iter().filter_map(|ring| line(ring));
    Some(Polygon::new(rings.next()?, rings.collect()))
}

fn line(positions: &[Position]) -> Option<LineString<f64>> {
    (!positions.is_empty()).then(|| positions.iter().map(|at| Coord { x: at[0], y: at[1] }).collect())
}

fn point(position: &Position) -> Point<f64> {
    Point::new(position[0], position[1])
}
