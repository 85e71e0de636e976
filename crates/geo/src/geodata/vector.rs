//! Reading vector layers: GeoPackage, Shapefile, FlatGeobuf and whatever else GDAL/OGR knows; GeoJSON without GDAL where it is
//! plain.

use std::path::{Path, PathBuf};

use gdal::Metadata as _;
use gdal::errors::GdalError;
use gdal::vector::{FieldValue, Geometry, LayerAccess, OGRFieldType, OGRwkbGeometryType as Kind, OwnedLayer};
use geo_types::{Coord, LineString, MultiPolygon, Point, Polygon};
use serde_json::{Map as JsonMap, Value};

use super::body::{self, Face};
use super::geojson_layer::GeoJsonLayer;
use super::open::{self, DatasetKind as Open, OpenError, Refusal};
use crate::crs::{Crs, CrsError};

/// Why a vector layer cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum VectorError {
    /// GDAL cannot open the file.
    #[error("cannot open layer {}\nhint: `ogrinfo {}` shows what GDAL makes of it", path.display(), path.display())]
    Open {
        /// Path of the layer's file.
        path: PathBuf,
        /// Error that GDAL reported.
        #[source]
        source: GdalError,
    },
    /// There is no such file.
    #[error("layer {} does not exist\nhint: is the path right? It counts from the folder of the configuration", path.display())]
    Absent {
        /// The layer's path.
        path: PathBuf,
    },
    /// It is not given to GDAL at all.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The file has several layers, or none, or not the one asked for.
    #[error(
        "{}: {problem}; its layers are {}\nhint: set `layer` to one of them",
        path.display(),
        if layers.is_empty() { "none".to_owned() } else { layers.join(", ") }
    )]
    Layer {
        /// Path of the layer's file.
        path: PathBuf,
        /// Why no layer was chosen.
        problem: String,
        /// Names of the layers that hold geometry.
        layers: Vec<String>,
    },
    /// The layer has a CRS that PROJ does not understand.
    #[error("the CRS of {} cannot be used", path.display())]
    Crs {
        /// Path of the layer's file.
        path: PathBuf,
        /// Why PROJ cannot use the CRS.
        #[source]
        source: CrsError,
    },
}

/// One feature of a layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Feature {
    /// The layer's own number for it, where it has one.
    pub fid: Option<u64>,
    /// Shape in the layer's CRS, x before y; Z and M dropped, arcs as chains of lines of at most 4° each, the faces of a body
    /// as its outline in plan.
    pub geometry: FeatureGeometry,
    /// Whether its shape is the outline of a body with walls, roofs or a floor.
    pub is_body: bool,
    /// Attributes, in the layer's order.
    pub attributes: JsonMap<String, Value>,
}

/// The shape of a feature.
#[derive(Debug, Clone, PartialEq)]
pub enum FeatureGeometry {
    /// No geometry: null, or an empty one.
    Missing,
    /// Points, lines or polygons.
    Shape(geo_types::Geometry<f64>),
    /// A kind we cannot turn into points, lines or polygons, by its name.
    Unsupported(String),
}

/// GDAL's driver of OpenStreetMap files, whose layers are views of one stream of features.
const OSM: &str = "OSM";
/// GDAL's driver of Shapefiles, whose text may be in any encoding.
const SHAPEFILE: &str = "ESRI Shapefile";
/// Where GDAL says in which encoding a Shapefile's text is.
const SHAPEFILE_METADATA: &str = "SHAPEFILE";
/// Encoding of a Shapefile that states none (no `.cpg`, language 0 in the `.dbf`) and is not UTF-8, as QGIS and GDAL's other
/// bindings take it.
const UNSTATED_ENCODING: &str = "ENCODING=ISO-8859-1";

/// A layer of a file, before it is opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LayerInfo {
    /// Name of the layer in its file.
    pub name: String,
    /// Whether it may hold polygons: so it says, or it does not say.
    pub may_hold_polygons: bool,
}

/// The layers of a file that hold geometry, in the file's order.
///
/// # Errors
/// [`VectorError::Open`], [`VectorError::Absent`]; [`VectorError::Refused`] as [`VectorLayer::open`].
pub fn layers_of(path: &Path) -> Result<Vec<LayerInfo>, VectorError> {
    let dataset = open_dataset(path)?;
    let info = |layer: gdal::vector::Layer<'_>| {
        let kind = gdal::vector::geometry_type_flatten(layer.defn().geometry_type());
        let may_hold_polygons = !matches!(
            kind,
            Kind::wkbPoint | Kind::wkbMultiPoint | Kind::wkbLineString | Kind::wkbMultiLineString | Kind::wkbMultiCurve
        );
        (kind != Kind::wkbNone).then(|| LayerInfo { name: layer.name(), may_hold_polygons })
    };
    Ok(dataset.layers().filter_map(info).collect())
}

fn open_dataset(path: &Path) -> Result<gdal::Dataset, VectorError> {
    open_dataset_with(path, &[])
}

fn open_dataset_with(path: &Path, options: &[&str]) -> Result<gdal::Dataset, VectorError> {
    if !crate::files::is_virtual(path) && !path.exists() {
        return Err(VectorError::Absent { path: path.to_owned() });
    }
    open::open_with(path, Open::Vector, options).map_err(|fault| match fault {
        OpenError::Refused(refusal) => refusal.into(),
        OpenError::Gdal(source) => VectorError::Open { path: path.to_owned(), source },
    })
}

/// A layer of vector features, open for reading.
#[derive(Debug)]
pub struct VectorLayer {
    source: LayerReader,
    path: PathBuf,
}

/// Names and kinds of a layer's attributes.
type FieldKinds = Vec<(String, OGRFieldType::Type)>;

/// Who reads the layer.
#[derive(Debug)]
enum LayerReader {
    /// GDAL, with the attributes' names and kinds.
    Gdal { layer: OwnedLayer, fields: FieldKinds },
    /// GeoJSON, which is read without GDAL.
    GeoJson(GeoJsonLayer),
}

impl VectorLayer {
    /// Opens a layer by name, or the only one of the file, which is read as what its extension says; `/vsizip/…` and the
    /// like work as well.
    ///
    /// # Errors
    /// [`VectorError::Open`], [`VectorError::Absent`]; [`VectorError::Refused`] for what is on a server, or has no extension that names a format; [`VectorError::Layer`] listing the layers there are.
    pub fn open(path: &Path, layer: Option<&str>) -> Result<Self, VectorError> {
        let own = GeoJsonLayer::read(path).filter(|own| layer.is_none_or(|name| name == own.name));
        match own {
            Some(own) => Ok(Self { source: LayerReader::GeoJson(own), path: path.to_owned() }),
            None => Self::open_with_gdal(path, layer),
        }
    }

    /// As [`Self::open`], through GDAL also where we could read the file ourselves: to compare with.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_with_gdal(path: &Path, layer: Option<&str>) -> Result<Self, VectorError> {
        let dataset = open_dataset(path)?;
        let is_osm = dataset.driver().short_name() == OSM;
        let names: Vec<(usize, String)> = dataset
            .layers()
            .enumerate()
            // Tables without geometry (styles, metadata) are no candidates.
            .filter(|(_, layer)| layer.defn().geometry_type() != Kind::wkbNone)
            .map(|(i, layer)| (i, layer.name()))
            .collect();
        let refuse = |problem: String| VectorError::Layer {
            path: path.to_owned(),
            problem,
            layers: names.iter().map(|(_, name)| name.clone()).collect(),
        };
        let chosen = match (layer, names.as_slice()) {
            (Some(wanted), _) => names
                .iter()
                .find(|(_, name)| name == wanted)
                .ok_or_else(|| refuse(format!("it has no layer {wanted:?}")))?,
            (None, [only]) => only,
            (None, []) => return Err(refuse("it has no layer with geometry".to_owned())),
            (None, several) => return Err(refuse(format!("it has {} layers", several.len()))),
        };
        if is_osm {
            silence(&dataset, chosen.0);
        }
        let is_shapefile = dataset.driver().short_name() == SHAPEFILE;
        let failed = |source| VectorError::Open { path: path.to_owned(), source };
        let mut layer = dataset.into_layer(chosen.0).map_err(failed)?;
        let fields_of = |layer: &OwnedLayer| -> FieldKinds {
            layer.defn().fields().map(|field| (field.name(), field.field_type())).collect()
        };
        let mut fields = fields_of(&layer);
        if is_shapefile && states_no_encoding(&layer) && !is_utf8(&mut layer, &fields) {
            layer = open_dataset_with(path, &[UNSTATED_ENCODING])?.into_layer(chosen.0).map_err(failed)?;
            fields = fields_of(&layer);
        }
        Ok(Self { source: LayerReader::Gdal { layer, fields }, path: path.to_owned() })
    }

    /// Whether GDAL reads the layer, not our own reader of GeoJSON.
    #[must_use]
    pub fn is_read_by_gdal(&self) -> bool {
        matches!(self.source, LayerReader::Gdal { .. })
    }

    /// The text in the first column that a query of the file gives; `None` where it fails or gives none.
    #[must_use]
    pub fn into_text_of(self, query: &str) -> Option<String> {
        let LayerReader::Gdal { layer, .. } = self.source else { return None };
        let dataset = layer.into_dataset();
        let mut found = dataset.execute_sql(query, None, gdal::vector::sql::Dialect::DEFAULT).ok()??;
        found.features().next()?.field_as_string(0).ok()?
    }

    /// Name of the layer in its file.
    #[must_use]
    pub fn name(&self) -> String {
        match &self.source {
            LayerReader::Gdal { layer, .. } => layer.name(),
            LayerReader::GeoJson(own) => own.name.clone(),
        }
    }

    /// CRS, `None` where the layer has none. A GeoJSON file without one is in WGS 84 by its standard.
    ///
    /// # Errors
    /// [`VectorError::Crs`] where it has one that PROJ does not understand.
    pub fn crs(&self) -> Result<Option<Crs>, VectorError> {
        let layer = match &self.source {
            LayerReader::Gdal { layer, .. } => layer,
            LayerReader::GeoJson(own) => return Ok(Some(own.crs.clone())),
        };
        let Some(spatial_ref) = layer.spatial_ref() else { return Ok(None) };
        super::crs_of(&spatial_ref).map_err(|source| VectorError::Crs { path: self.path.clone(), source })
    }

    /// Names of its attributes, in order.
    pub fn field_names(&self) -> impl Iterator<Item = &str> {
        let names: Vec<&str> = match &self.source {
            LayerReader::Gdal { fields, .. } => fields.iter().map(|(name, _)| name.as_str()).collect(),
            LayerReader::GeoJson(own) => own.fields.iter().map(String::as_str).collect(),
        };
        names.into_iter()
    }

    /// Shows only what meets a rectangle of the layer's own CRS from here on: west, south, east, north.
    pub fn look_at(&mut self, [west, south, east, north]: [f64; 4]) {
        match &mut self.source {
            LayerReader::Gdal { layer, .. } => layer.set_spatial_filter_rect(west, south, east, north),
            LayerReader::GeoJson(own) => own.window = Some([west, south, east, north]),
        }
    }

    /// Number of features that it shows, where the file tells without being gone through.
    #[must_use]
    pub fn n_features(&self) -> Option<u64> {
        match &self.source {
            LayerReader::Gdal { layer, .. } => layer.try_feature_count(),
            LayerReader::GeoJson(own) => Some(own.n_features()),
        }
    }

    /// Shows only what fulfils a condition on attributes, in OGR's SQL, from here on; nothing is asked of a layer that GDAL does
    /// not read.
    ///
    /// # Errors
    /// [`VectorError::Open`] for a condition that is none.
    pub fn only_where(&mut self, condition: &str) -> Result<(), VectorError> {
        let failed = |source| VectorError::Open { path: self.path.clone(), source };
        match &mut self.source {
            LayerReader::Gdal { layer, .. } => layer.set_attribute_filter(condition).map_err(failed),
            LayerReader::GeoJson(_) => Ok(()),
        }
    }

    /// All features, in the layer's order.
    pub fn features(&mut self) -> Box<dyn Iterator<Item = Feature> + '_> {
        match &mut self.source {
            LayerReader::Gdal { layer, fields } => Box::new(layer.features().map(|feature| {
                let (fid, attributes) = (feature.fid(), attributes(&feature, fields));
                match feature.geometry().and_then(outline_of_body) {
                    Some(outline) => {
                        let geometry = FeatureGeometry::Shape(outline.into());
                        Feature { fid, geometry, is_body: true, attributes }
                    }
                    None => {
                        let geometry = feature.geometry().map_or(FeatureGeometry::Missing, shape_of_feature);
                        Feature { fid, geometry, is_body: false, attributes }
                    }
                }
            })),
            LayerReader::GeoJson(own) => Box::new(own.features()),
        }
    }
}

/// Lets the other layers of an OpenStreetMap file take nothing in: GDAL keeps what it comes across for a layer that may be read
/// later, and gives up when that gets too much.
fn silence(dataset: &gdal::Dataset, chosen: usize) {
    const NOTHING: &str = "osm_id = 'none'";
    for (_, mut layer) in dataset.layers().enumerate().filter(|(i, _)| *i != chosen) {
        // A layer that does not know the attribute is read as a whole, as without this.
        let _ = layer.set_attribute_filter(NOTHING);
    }
}

fn states_no_encoding(layer: &OwnedLayer) -> bool {
    layer.metadata_item("SOURCE_ENCODING", SHAPEFILE_METADATA).is_none_or(|encoding| encoding.is_empty())
}

/// Whether most texts of a layer with letters beyond ASCII are UTF-8. Not all: a text that was cut to the width of its column
/// may end within a letter. Text in other encodings is hardly ever UTF-8 by chance.
fn is_utf8(layer: &mut OwnedLayer, fields: &[(String, OGRFieldType::Type)]) -> bool {
    let texts: Vec<usize> = (0..fields.len()).filter(|&i| fields[i].1 == OGRFieldType::OFTString).collect();
    let (mut n_sound, mut n_broken) = (0_usize, 0_usize);
    let mut count = |text: &str| {
        let is_broken = text.contains(char::REPLACEMENT_CHARACTER);
        n_broken += usize::from(is_broken);
        n_sound += usize::from(!is_broken && !text.is_ascii());
    };
    fields.iter().for_each(|(name, _)| count(name));
    for feature in layer.features() {
        texts.iter().filter_map(|&i| feature.field_as_string(i).ok().flatten()).for_each(|text| count(&text));
    }
    n_sound >= n_broken
}

fn attributes(feature: &gdal::vector::Feature<'_>, fields: &[(String, OGRFieldType::Type)]) -> JsonMap<String, Value> {
    let value = |(i, (name, kind)): (usize, &(String, OGRFieldType::Type))| {
        let text = feature.field_as_string(i).ok().flatten();
        let is_text = *kind == OGRFieldType::OFTString;
        let value = match text {
            None => Value::Null,
            // A field the feature leaves out (FlatGeobuf, sparse GeoJSON) is not null to OGR, but has no text either.
            Some(text) if text.is_empty() && !is_text => Value::Null,
            // OGR renders lists as "(2:a,b)"; an empty one has no memory behind it that could be borrowed.
            Some(text) if text.starts_with("(0:") && !is_text => Value::Array(Vec::new()),
            // Times and binaries have no value of their own in the bindings: keep their text.
            Some(text) => feature.field(i).ok().flatten().map_or(Value::String(text), json),
        };
        (name.clone(), value)
    };
    fields.iter().enumerate().map(value).collect()
}

/// An attribute as an id or a key: text as it stands, numbers in plain digits, so that the whole numbers of a column of reals have no
/// `.0` and no exponent.
#[must_use]
pub fn plain_text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        // Rust writes reals without exponents. + 0.0 turns −0 into 0.
        Value::Number(number) if number.is_f64() => (number.as_f64().unwrap_or_default() + 0.0).to_string(),
        other => other.to_string(),
    }
}

/// `NaN` and infinities have no JSON and become null.
fn json(value: FieldValue) -> Value {
    match value {
        FieldValue::IntegerValue(v) => v.into(),
        FieldValue::IntegerListValue(v) => v.into(),
        FieldValue::Integer64Value(v) => v.into(),
        FieldValue::Integer64ListValue(v) => v.into(),
        FieldValue::StringValue(v) => v.into(),
        FieldValue::StringListValue(v) => v.into(),
        FieldValue::RealValue(v) => v.into(),
        FieldValue::RealListValue(v) => v.into(),
        FieldValue::DateValue(v) => v.to_string().into(),
        // `Debug` of a date and time is its ISO 8601 form.
        FieldValue::DateTimeValue(v) => format!("{v:?}").into(),
    }
}

/// The outline in plan of a body; `None` for anything else.
fn outline_of_body(geometry: &Geometry) -> Option<MultiPolygon<f64>> {
    if !geometry.has_gdal_ptr() || !gdal::vector::geometry_type_has_z(geometry.geometry_type()) {
        return None;
    }
    match gdal::vector::geometry_type_flatten(geometry.geometry_type()) {
        Kind::wkbPolyhedralSurface | Kind::wkbTIN => body::outline_of_surface(&faces(geometry)?),
        Kind::wkbMultiPolygon | Kind::wkbMultiSurface | Kind::wkbGeometryCollection => body::outline(&faces(geometry)?),
        _ => None,
    }
}

/// All faces of a geometry, however they are grouped; `None` where there is anything else in it.
fn faces(geometry: &Geometry) -> Option<Vec<Face>> {
    match gdal::vector::geometry_type_flatten(geometry.geometry_type()) {
        Kind::wkbPolygon | Kind::wkbCurvePolygon | Kind::wkbTriangle => {
            let mut corners = Vec::new();
            children(geometry).next()?.get_points(&mut corners);
            Some(vec![Face::new(&polygon(geometry)?, corners.into_iter().map(|(_, _, z)| z))])
        }
        Kind::wkbMultiPolygon
        | Kind::wkbMultiSurface
        | Kind::wkbPolyhedralSurface
        | Kind::wkbTIN
        | Kind::wkbGeometryCollection => {
            let parts = children(geometry).map(|part| faces(&part)).collect::<Option<Vec<_>>>()?;
            Some(parts.into_iter().flatten().collect())
        }
        _ => None,
    }
}

fn shape_of_feature(geometry: &Geometry) -> FeatureGeometry {
    if !geometry.has_gdal_ptr() || geometry.is_empty() {
        return FeatureGeometry::Missing;
    }
    match shape(geometry) {
        Some(shape) => FeatureGeometry::Shape(shape),
        None => FeatureGeometry::Unsupported(geometry.geometry_name()),
    }
}

/// `None` for a kind (possibly within a collection) that has no counterpart.
fn shape(geometry: &Geometry) -> Option<geo_types::Geometry<f64>> {
    let kind = gdal::vector::geometry_type_flatten(geometry.geometry_type());
    match kind {
        Kind::wkbPoint => {
            let (x, y, _) = geometry.get_point(0);
            Some(Point::new(x, y).into())
        }
        Kind::wkbLineString | Kind::wkbCircularString | Kind::wkbCompoundCurve => Some(line(geometry)?.into()),
        Kind::wkbPolygon | Kind::wkbCurvePolygon | Kind::wkbTriangle => Some(polygon(geometry)?.into()),
        Kind::wkbMultiPolygon | Kind::wkbMultiSurface => {
            let parts = children(geometry).map(|part| polygon(&part)).collect::<Option<Vec<_>>>()?;
            Some(MultiPolygon::new(parts).into())
        }
        Kind::wkbMultiPoint | Kind::wkbMultiLineString | Kind::wkbMultiCurve | Kind::wkbGeometryCollection => {
            let parts = children(geometry).map(|part| shape(&part)).collect::<Option<Vec<_>>>()?;
            Some(geo_types::Geometry::GeometryCollection(geo_types::GeometryCollection(parts)))
        }
        _ => None,
    }
}

fn children(geometry: &Geometry) -> impl Iterator<Item = gdal::vector::GeometryRef<'_>> {
    (0..geometry.geometry_count()).map(|i| geometry.get_geometry(i)).filter(|child| !child.is_empty())
}

fn polygon(geometry: &Geometry) -> Option<Polygon<f64>> {
    let kind = gdal::vector::geometry_type_flatten(geometry.geometry_type());
    if !matches!(kind, Kind::wkbPolygon | Kind::wkbCurvePolygon | Kind::wkbTriangle) {
        return None;
    }
    let mut rings = children(geometry).map(|ring| line(&ring)).collect::<Option<Vec<_>>>()?.into_iter();
    Some(Polygon::new(rings.next()?, rings.collect()))
}

fn line(geometry: &Geometry) -> Option<LineString<f64>> {
    let mut points = Vec::new();
    match gdal::vector::geometry_type_flatten(geometry.geometry_type()) {
        Kind::wkbLineString => points = vertices(geometry),
        Kind::wkbCircularString => {
            let control = vertices(geometry);
            points.extend(control.first());
            for arc in control.windows(3).step_by(2) {
                super::curve::append_arc(&mut points, arc[0], arc[1], arc[2]);
            }
        }
        Kind::wkbCompoundCurve => {
            for piece in children(geometry) {
                let piece = line(&piece)?;
                // Each piece starts where the one before it ended.
                let repeats_end = points.last() == piece.0.first() && !points.is_empty();
                points.extend(piece.0.into_iter().skip(usize::from(repeats_end)));
            }
        }
        _ => return None,
    }
    Some(LineString::new(points))
}

fn vertices(geometry: &Geometry) -> Vec<Coord<f64>> {
    let mut points = Vec::with_capacity(geometry.point_count());
    geometry.get_points(&mut points);
    points.into_iter().map(|(x, y, _)| Coord { x, y }).collect()
}
