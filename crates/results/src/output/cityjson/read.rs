//! Reading `CityJSON` 1.0, 1.1 and 2.0 and `CityJSONSeq`, anybody's: objects with their surfaces.
//!
//! Textures, materials, templates and appearances are passed over. A template instance is counted as a geometry that
//! could not be read, never dropped in silence ([`CityFile::n_templates`]).

use std::fmt;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use indexmap::IndexMap;
use serde::de::{IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::{Map as JsonMap, Value};

use super::super::error::{MalformedFile, OutputError};
use super::super::prism::FaceKind;
use super::pieces::{Pieces, read_pieces};
use super::read_sequence::CitySequence;
use sizeup_geo::crs::Crs;
use sizeup_geo::files::FileError;

/// The byte order mark of UTF-8.
const BYTE_ORDER_MARK: &str = "\u{feff}";
/// Coordinates beyond this are no place: the Earth is 4e10 mm around.
const FARTHEST: f64 = 1e11;

/// A city model as read.
#[derive(Debug, Clone, Default)]
pub struct CityFile {
    /// CRS, where it states one.
    pub crs: Option<Crs>,
    /// Metadata as they stand.
    pub metadata: JsonMap<String, Value>,
    /// Positions in its CRS, x before y.
    pub vertices: Vec<[f64; 3]>,
    /// City objects in the file's order.
    pub objects: Vec<CityObject>,
    /// Template instances, which are not read.
    pub n_templates: usize,
}

/// An object of `CityObjects`, as far as heights and footprints need it.
#[derive(Debug, Clone)]
pub struct CityObject {
    /// Unique id, its key in `CityObjects`.
    pub id: String,
    /// Type: `Building`, `BuildingPart`, ….
    pub kind: String,
    /// Ids of its parents.
    pub parents: Vec<String>,
    /// Ids of its parts.
    pub children: Vec<String>,
    /// Attributes as they stand.
    pub attributes: JsonMap<String, Value>,
    /// One per level of detail.
    pub geometries: Vec<CityGeometry>,
}

impl CityObject {
    /// The surfaces at a level of detail, or at the highest.
    pub fn surfaces(&self, lod: Option<&str>) -> impl Iterator<Item = &CitySurface> + use<'_> {
        let geometry = match lod {
            Some(lod) => self.geometries.iter().find(|g| g.lod == lod),
            // As text: "1.2" < "2" < "2.2".
            None => self.geometries.iter().max_by(|a, b| a.lod.cmp(&b.lod)),
        };
        geometry.into_iter().flat_map(|g| &g.surfaces)
    }
}

/// One geometry of an object, as a flat list of surfaces.
#[derive(Debug, Clone)]
pub struct CityGeometry {
    /// Level of detail as text: `1.2`, `2`.
    pub lod: String,
    /// Whether the surfaces enclose one or more solids.
    pub is_solid: bool,
    /// All surfaces of all shells.
    pub surfaces: Vec<CitySurface>,
}

/// One surface: exterior ring, then holes; indices into [`CityFile::vertices`].
#[derive(Debug, Clone)]
pub struct CitySurface {
    /// Solid of a multi-solid, shell of the solid, surface of the shell.
    pub place: [usize; 3],
    /// Semantics, where it is one of the three that matter here.
    pub kind: Option<FaceKind>,
    /// Rings as in the file (not closed).
    pub rings: Vec<Vec<u32>>,
}

impl CityFile {
    /// Reads a file; `….jsonl` is read as a sequence.
    ///
    /// # Errors
    /// [`OutputError::File`] if it cannot be opened, [`OutputError::Malformed`] if it is no `CityJSON` of a known
    /// version, or an index points nowhere.
    pub fn read(path: &Path) -> Result<Self, OutputError> {
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("jsonl")) {
            return CitySequence::open(path)?.into_one();
        }
        let mut city = Self::read_head(path)?;
        let mut objects = Vec::new();
        city.n_templates = visit_objects(path, &city.vertices, &mut |object| {
            objects.push(object);
            Ok(())
        })?;
        city.objects = objects;
        Ok(city)
    }

    /// Reads everything of a file but its objects.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_head(path: &Path) -> Result<Self, OutputError> {
        let malformed = |reason: String| OutputError::Malformed(MalformedFile { path: path.to_owned(), reason });
        let head: RawHead = serde_json::from_reader(open(path)?).map_err(|e| malformed(e.to_string()))?;
        let raw = RawFile {
            kind: head.kind,
            version: head.version,
            transform: head.transform,
            metadata: head.metadata,
            objects: IndexMap::new(),
            vertices: head.vertices,
        };
        require_version(&raw).map_err(malformed)?;
        let mut city =
            Self { crs: crs_of(&raw.metadata).map_err(malformed)?, metadata: raw.metadata.clone(), ..Self::default() };
        let transform = raw.transform.clone();
        city.add(raw, transform.as_ref()).map_err(malformed)?;
        Ok(city)
    }
}

/// Opens a file for reading from its start to its end.
///
/// # Errors
/// [`OutputError::File`].
pub(in crate::output) fn open(path: &Path) -> Result<BufReader<fs::File>, OutputError> {
    let file = fs::File::open(path).map_err(FileError::on("cannot read", path))?;
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let start = reader.fill_buf().map_err(FileError::on("cannot read", path))?;
    // What programs of Windows begin a text with is no part of it.
    if start.starts_with(BYTE_ORDER_MARK.as_bytes()) {
        reader.consume(BYTE_ORDER_MARK.len());
    }
    Ok(reader)
}

/// Hands the objects of a file to `visit` one by one; `vertices` are the file's. Says how many template instances were
/// passed over.
///
/// # Errors
/// As [`CityFile::read`], or the error of `visit`.
pub fn visit_objects(
    path: &Path,
    vertices: &[[f64; 3]],
    visit: &mut dyn FnMut(CityObject) -> Result<(), OutputError>,
) -> Result<usize, OutputError> {
    let malformed = |reason: String| OutputError::Malformed(MalformedFile { path: path.to_owned(), reason });
    let take = |id: String, object: RawObject, n_templates: &mut usize| {
        object.read(id, 0, vertices.len(), n_templates).map_err(malformed).and_then(&mut *visit)
    };
    let mut objects = ObjectVisitor { take, n_templates: 0, failure: None };
    let outcome = read_pieces(open(path)?, &mut objects);
    match (objects.failure, outcome) {
        (Some(failure), _) => Err(failure),
        (None, Err(e)) => Err(malformed(e.to_string())),
        (None, Ok(())) => Ok(objects.n_templates),
    }
}

/// A file of which only the objects are looked at.
struct ObjectVisitor<F> {
    take: F,
    n_templates: usize,
    failure: Option<OutputError>,
}

impl<F: FnMut(String, RawObject, &mut usize) -> Result<(), OutputError>> Pieces for ObjectVisitor<F> {
    type Object = RawObject;
    type Vertex = IgnoredAny;
    type Member = IgnoredAny;

    fn object(&mut self, id: String, object: RawObject) -> bool {
        self.failure = (self.take)(id, object, &mut self.n_templates).err();
        self.failure.is_none()
    }
}

/// A file without its objects.
#[derive(Deserialize)]
struct RawHead {
    #[serde(rename = "type")]
    kind: String,
    version: Option<String>,
    transform: Option<RawTransform>,
    #[serde(default)]
    metadata: JsonMap<String, Value>,
    #[serde(default)]
    vertices: Vec<[f64; 3]>,
}

/// A file or a feature of a sequence.
#[derive(Deserialize)]
pub(super) struct RawFile {
    #[serde(rename = "type")]
    pub(super) kind: String,
    version: Option<String>,
    pub(super) transform: Option<RawTransform>,
    #[serde(default)]
    pub(super) metadata: JsonMap<String, Value>,
    #[serde(rename = "CityObjects", default)]
    objects: IndexMap<String, RawObject>,
    #[serde(default)]
    vertices: Vec<[f64; 3]>,
}

/// From whole numbers to coordinates.
#[derive(Debug, Deserialize, Clone)]
pub(super) struct RawTransform {
    scale: [f64; 3],
    translate: [f64; 3],
}

#[derive(Deserialize)]
struct RawObject {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    parents: Vec<String>,
    #[serde(default)]
    children: Vec<String>,
    #[serde(default)]
    attributes: Option<JsonMap<String, Value>>,
    #[serde(default)]
    geometry: Vec<RawGeometry>,
}

#[derive(Deserialize)]
struct RawGeometry {
    #[serde(rename = "type")]
    kind: String,
    lod: Option<Value>,
    #[serde(default)]
    boundaries: Option<Nested>,
    semantics: Option<RawSemantics>,
}

#[derive(Deserialize)]
struct RawSemantics {
    #[serde(default)]
    surfaces: Vec<SurfaceKind>,
    #[serde(default)]
    values: Value,
}

#[derive(Deserialize)]
struct SurfaceKind {
    #[serde(rename = "type")]
    kind: String,
}

/// Boundaries: lists of lists of … of indices, as deep as the geometry's type says.
enum Nested {
    Index(u32),
    List(Vec<Nested>),
}

impl<'de> Deserialize<'de> for Nested {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NestedVisitor)
    }
}

/// Directly from the tokens: serde's untagged enums keep a copy of everything first, at five times the cost.
struct NestedVisitor;

impl<'de> Visitor<'de> for NestedVisitor {
    type Value = Nested;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a vertex index or a list of boundaries")
    }

    fn visit_u64<E: serde::de::Error>(self, index: u64) -> Result<Nested, E> {
        let too_large = |_| E::custom(format!("vertex index {index}: expected at most {}", u32::MAX));
        u32::try_from(index).map(Nested::Index).map_err(too_large)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Nested, A::Error> {
        let mut list = Vec::with_capacity(items.size_hint().unwrap_or(0));
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(Nested::List(list))
    }
}

impl Nested {
    fn items(&self) -> Result<&[Self], String> {
        match self {
            Self::List(items) => Ok(items),
            Self::Index(_) => Err("its boundaries are not as deep as its type needs".to_owned()),
        }
    }
}

pub(super) fn require_version(raw: &RawFile) -> Result<(), String> {
    if raw.kind != "CityJSON" {
        return Err(format!("expected \"type\": \"CityJSON\", found {:?}", raw.kind));
    }
    match raw.version.as_deref() {
        Some(v) if ["1.0", "1.1", "2.0"].iter().any(|known| v.starts_with(known)) => Ok(()),
        found => Err(format!("expected CityJSON version 1.0, 1.1 or 2.0, found {}", found.unwrap_or("none"))),
    }
}

/// The CRS that metadata state. Our own files have the vertical part that no single code stands for in their lineage.
pub(super) fn crs_of(metadata: &JsonMap<String, Value>) -> Result<Option<Crs>, String> {
    let Some(name) = metadata.get("referenceSystem").and_then(Value::as_str) else { return Ok(None) };
    let wrong = |reason: &str| format!("referenceSystem {name:?}: {reason}");
    let parse = |definition: String| Crs::parse(&definition).map_err(|e| wrong(&e.to_string()));
    let codes = epsg_codes(name);
    let crs = match codes.as_slice() {
        [] => return Err(wrong("expected an EPSG code, such as https://www.opengis.net/def/crs/EPSG/0/7415")),
        [code] => parse(format!("EPSG:{code}"))?,
        [first, second] => {
            let is_second_horizontal = parse(format!("EPSG:{first}"))?.is_vertical();
            let [plane, heights] = if is_second_horizontal { [second, first] } else { [first, second] };
            parse(format!("EPSG:{plane}+{heights}"))?.registered()
        }
        _ => return Err(wrong("expected a CRS and at most one of heights")),
    };
    if crs.is_vertical() {
        return Err(wrong(&format!("{crs} is a system of heights, and says nothing of positions")));
    }
    let of_lineage = metadata.get("sizeup").and_then(|lineage| lineage["crs"].as_str());
    let of_lineage = of_lineage.and_then(|definition| Crs::parse(definition).ok());
    Ok(Some(crs.with_heights_of(of_lineage.as_ref())))
}

/// EPSG codes in the name of a CRS, in its order: one of `urn:ogc:def:crs:EPSG::7415`, `https://www.opengis.net/def/crs/EPSG/0/7415` or
/// `EPSG:7415`; two of OGC's names of compounds, `…/def/crs-compound?1=…/EPSG/0/28992&2=…/EPSG/0/5709` and
/// `urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709`, and of PROJ's, `EPSG:28992+5709`.
fn epsg_codes(name: &str) -> Vec<&str> {
    name.split(['&', ',', '+']).filter_map(epsg_code).collect()
}

/// The code at the end of a part of a name, where that names EPSG or is the number alone.
fn epsg_code(part: &str) -> Option<&str> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let last = part.trim().trim_end_matches('/').rsplit(['/', ':', '#', '=']).next()?;
    let is_epsg = part.to_ascii_lowercase().contains("epsg") || is_number(part.trim());
    Some(last).filter(|last| is_epsg && is_number(last))
}

impl CityFile {
    pub(super) fn add(&mut self, raw: RawFile, transform: Option<&RawTransform>) -> Result<(), String> {
        let first = self.vertices.len();
        let place = |v: [f64; 3]| match transform {
            Some(t) => std::array::from_fn(|axis| v[axis] * t.scale[axis] + t.translate[axis]),
            None => v,
        };
        for (i, stored) in raw.vertices.into_iter().enumerate() {
            let vertex: [f64; 3] = place(stored);
            if !vertex.iter().all(|v| v.abs() <= FARTHEST) {
                return Err(format!("vertex {i} lies at {vertex:?}: no place on Earth in any unit"));
            }
            self.vertices.push(vertex);
        }
        let offset = u32::try_from(first).map_err(|_| "more than 2^32 vertices".to_owned())?;
        for (id, object) in raw.objects {
            self.objects.push(object.read(id, offset, self.vertices.len(), &mut self.n_templates)?);
        }
        Ok(())
    }
}

impl RawObject {
    fn read(self, id: String, offset: u32, n_vertices: usize, n_templates: &mut usize) -> Result<CityObject, String> {
        let mut geometries = Vec::with_capacity(self.geometry.len());
        for (i, geometry) in self.geometry.iter().enumerate() {
            match geometry.read(offset, n_vertices).map_err(|e| format!("object {id:?}: geometry/{i}: {e}"))? {
                Some(geometry) => geometries.push(geometry),
                None if geometry.kind == "GeometryInstance" => *n_templates += 1,
                None => {}
            }
        }
        let attributes = self.attributes.unwrap_or_default();
        Ok(CityObject { id, kind: self.kind, parents: self.parents, children: self.children, attributes, geometries })
    }
}

impl RawGeometry {
    /// `None` for points, lines and templates.
    fn read(&self, offset: u32, n_vertices: usize) -> Result<Option<CityGeometry>, String> {
        // Levels above a surface: none for a multi-surface, a shell for a solid, a solid for a multi-solid.
        let levels_above = match self.kind.as_str() {
            "MultiSurface" | "CompositeSurface" => 0,
            "Solid" => 1,
            "MultiSolid" | "CompositeSolid" => 2,
            _ => return Ok(None),
        };
        let lod = match &self.lod {
            Some(Value::String(text)) => text.clone(),
            Some(Value::Number(number)) => number.to_string(),
            _ => String::new(),
        };
        let mut surfaces = Vec::new();
        if let Some(boundaries) = &self.boundaries {
            let values = self.semantics.as_ref().map_or(&Value::Null, |s| &s.values);
            let n_levels = levels_above;
            let mut reader = SurfaceReader { geometry: self, offset, n_vertices, n_levels, surfaces: &mut surfaces };
            reader.descend(boundaries, values, levels_above, [0; 3])?;
        }
        Ok(Some(CityGeometry { lod, is_solid: levels_above > 0, surfaces }))
    }

    fn kind_of(&self, value: &Value) -> Option<FaceKind> {
        let index = usize::try_from(value.as_u64()?).ok()?;
        match self.semantics.as_ref()?.surfaces.get(index)?.kind.as_str() {
            "GroundSurface" => Some(FaceKind::Ground),
            "RoofSurface" => Some(FaceKind::Roof),
            "WallSurface" => Some(FaceKind::Wall),
            _ => None,
        }
    }
}

struct SurfaceReader<'a> {
    geometry: &'a RawGeometry,
    offset: u32,
    n_vertices: usize,
    /// Levels above a surface.
    n_levels: usize,
    surfaces: &'a mut Vec<CitySurface>,
}

impl SurfaceReader<'_> {
    fn descend(&mut self, nested: &Nested, values: &Value, levels: usize, place: [usize; 3]) -> Result<(), String> {
        for (i, item) in nested.items()?.iter().enumerate() {
            let value = values.get(i).unwrap_or(&Value::Null);
            let mut place = place;
            place[2 - levels] = i;
            if levels > 0 {
                self.descend(item, value, levels - 1, place)?;
            } else {
                let rings = item.items()?.iter().enumerate();
                let rings = rings.map(|(ring_idx, ring)| {
                    self.ring(ring).map_err(|e| {
                        let n_lists = self.n_levels + 1;
                        let at: String = place[3 - n_lists..].iter().map(|i| format!("{i}/")).collect();
                        format!("boundaries/{at}{ring_idx}{e}")
                    })
                });
                let rings = rings.collect::<Result<_, _>>()?;
                self.surfaces.push(CitySurface { place, kind: self.geometry.kind_of(value), rings });
            }
        }
        Ok(())
    }

    fn ring(&self, ring: &Nested) -> Result<Vec<u32>, String> {
        let n_vertices = self.n_vertices - self.offset as usize;
        let index = |(at, item): (usize, &Nested)| match item {
            Nested::Index(i) if (*i as usize) < n_vertices => Ok(i + self.offset),
            Nested::Index(i) => Err(format!("/{at}: vertex index {i} of {n_vertices}")),
            Nested::List(_) => Err(format!("/{at}: its boundaries are deeper than its type allows")),
        };
        ring.items().map_err(|e| format!(": {e}"))?.iter().enumerate().map(index).collect()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn crs(name: &str) -> Result<Option<Crs>, String> {
        crs_of(json!({ "referenceSystem": name }).as_object().unwrap())
    }

    #[test]
    fn a_crs_is_read_by_one_code_or_two() {
        for name in [
            "urn:ogc:def:crs:EPSG::7415",
            "https://www.opengis.net/def/crs/EPSG/0/7415",
            "http://www.opengis.net/def/crs/EPSG/0/7415/",
            "EPSG:7415",
        ] {
            assert_eq!(crs(name).unwrap().unwrap().epsg(), Some(7415), "{name}");
        }
        for name in [
            "http://www.opengis.net/def/crs-compound?1=http://www.opengis.net/def/crs/EPSG/0/28992&2=http://www.opengis.net/def/crs/EPSG/0/5709",
            "http://www.opengis.net/def/crs-compound?2=http://www.opengis.net/def/crs/EPSG/0/5709&1=http://www.opengis.net/def/crs/EPSG/0/28992",
            "urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709",
            "urn:ogc:def:crs,crs:EPSG:6.12:28992,crs:EPSG:6.12:5709",
            "EPSG:28992+5709",
        ] {
            let crs = crs(name).unwrap().unwrap();
            assert_eq!((crs.horizontal_epsg(), crs.vertical_epsg()), (Some(28992), Some(5709)), "{name}");
        }
    }

    #[test]
    fn a_system_of_heights_is_never_the_crs() {
        let refused = crs("http://www.opengis.net/def/crs/EPSG/0/5709").unwrap_err();
        assert!(refused.contains("system of heights"), "{refused}");
        for name in ["urn:adv:crs:ETRS89_UTM32*DE_DHHN92_NH", "", "EPSG:28992,EPSG:5709,EPSG:4326"] {
            assert!(crs(name).is_err(), "{name}");
        }
    }

    #[test]
    fn a_byte_order_mark_is_passed_over_and_an_index_that_is_none_has_a_place() {
        let folder = tempfile::tempdir().unwrap();
        let read = |name: &str, index: &str| {
            let city = json!({
                "type": "CityJSON", "version": "2.0", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
                "CityObjects": { "a": { "type": "Building", "geometry": [{
                    "type": "Solid", "lod": "1", "boundaries": [[[[0, 1, 2]], [[0, 1, "INDEX"]]]],
                }] } },
            });
            let text = city.to_string().replace("\"INDEX\"", index);
            let path = folder.path().join(name);
            fs::write(&path, format!("\u{feff}{text}")).unwrap();
            CityFile::read(&path).map(|city| city.objects.len()).map_err(|e| e.to_string())
        };
        assert_eq!(read("a.city.json", "2"), Ok(1));
        let far = read("a.city.json", "3").unwrap_err();
        assert!(far.contains("object \"a\": geometry/0: boundaries/0/1/0/2: vertex index 3 of 3"), "{far}");
        for index in ["99999999999999999999", "-1", "0.5", "4294967296", "1e20"] {
            let error = read("a.city.json", index).unwrap_err();
            assert!(error.contains("line 1 column") && error.contains("vertex index"), "{index}: {error}");
        }
    }
}
