//! Reading `CityJSON` 1.0, 1.1 and 2.0 and `CityJSONSeq`, anybody's: objects with their surfaces.
//!
//! Textures, materials, templates and appearances are passed over. A template instance is counted as a geometry that
//! could not be read, never dropped in silence ([`CityFile::n_templates`]).

use std::fmt;
use std::fs;
use std::io::{BufRead as _, BufReader, Lines};
use std::path::{Path, PathBuf};

use indexmap::IndexMap;
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::{Map as JsonMap, Value};

use super::super::error::{MalformedFile, OutputError};
use super::super::prism::Surface;
use crate::crs::Crs;
use crate::files::FileError;

/// A city model as read.
#[derive(Debug, Clone, Default)]
pub struct CityFile {
    /// Its CRS, where it states one.
    pub crs: Option<Crs>,
    /// Its metadata as they stand.
    pub metadata: JsonMap<String, Value>,
    /// Positions in its CRS, x before y.
    pub vertices: Vec<[f64; 3]>,
    /// City objects in the file's order.
    pub objects: Vec<CityObject>,
    /// Template instances, which are not read.
    pub n_templates: usize,
}

/// One city object.
#[derive(Debug, Clone)]
pub struct CityObject {
    /// Unique id.
    pub id: String,
    /// `Building`, `BuildingPart`, ….
    pub kind: String,
    /// Ids of its parents.
    pub parents: Vec<String>,
    /// Attributes as they stand.
    pub attributes: JsonMap<String, Value>,
    /// One per level of detail.
    pub geometries: Vec<CityGeometry>,
}

/// One geometry of an object, as a flat list of surfaces.
#[derive(Debug, Clone)]
pub struct CityGeometry {
    /// Level of detail as text: `1.2`, `2`.
    pub lod: String,
    /// Whether surfaces enclose solids.
    pub is_solid: bool,
    /// All surfaces.
    pub surfaces: Vec<CitySurface>,
}

/// One surface: exterior ring, then holes; indices into [`CityFile::vertices`].
#[derive(Debug, Clone)]
pub struct CitySurface {
    /// Solid of a multi-solid, shell of the solid, surface of the shell.
    pub place: [usize; 3],
    /// Its semantics, where it is one of the three that matter here.
    pub kind: Option<Surface>,
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
            return Sequence::open(path)?.into_one();
        }
        let bytes = fs::read(path).map_err(FileError::on("cannot read", path))?;
        read_one(&bytes).map_err(|reason| MalformedFile { path: path.to_owned(), reason }.into())
    }
}

#[derive(Deserialize)]
struct RawFile {
    #[serde(rename = "type")]
    kind: String,
    version: Option<String>,
    transform: Option<RawTransform>,
    #[serde(default)]
    metadata: JsonMap<String, Value>,
    #[serde(rename = "CityObjects", default)]
    objects: IndexMap<String, RawObject>,
    #[serde(default)]
    vertices: Vec<[f64; 3]>,
}

#[derive(Debug, Deserialize, Clone)]
struct RawTransform {
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
    surfaces: Vec<RawSurface>,
    #[serde(default)]
    values: Value,
}

#[derive(Deserialize)]
struct RawSurface {
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
        u32::try_from(index).map(Nested::Index).map_err(E::custom)
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

fn read_one(bytes: &[u8]) -> Result<CityFile, String> {
    let raw: RawFile = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
    require_version(&raw)?;
    let mut city = CityFile { crs: crs_of(&raw.metadata)?, ..CityFile::default() };
    let transform = raw.transform.clone();
    city.metadata.clone_from(&raw.metadata);
    city.add(raw, transform.as_ref())?;
    Ok(city)
}

/// A sequence, feature by feature: iterates over city models of one feature each, in a CRS of their own.
#[derive(Debug)]
pub struct Sequence {
    path: PathBuf,
    lines: Lines<BufReader<fs::File>>,
    n_lines: usize,
    transform: Option<RawTransform>,
    header: CityFile,
    /// A header may hold objects itself, where it is a whole city model.
    is_header_due: bool,
}

impl Sequence {
    /// Reads the header.
    ///
    /// # Errors
    /// As [`CityFile::read`].
    pub fn open(path: &Path) -> Result<Self, OutputError> {
        let file = fs::File::open(path).map_err(FileError::on("cannot read", path))?;
        let lines = BufReader::with_capacity(1 << 18, file).lines();
        let header = CityFile::default();
        let mut sequence =
            Self { path: path.to_owned(), lines, n_lines: 0, transform: None, header, is_header_due: true };
        let Some(raw) = sequence.next_line()? else { return Ok(sequence) };
        sequence.header = sequence.read_header(raw).map_err(|reason| sequence.malformed(&reason))?;
        Ok(sequence)
    }

    /// The CRS it states.
    #[must_use]
    pub fn crs(&self) -> Option<&Crs> {
        self.header.crs.as_ref()
    }

    fn read_header(&mut self, raw: RawFile) -> Result<CityFile, String> {
        require_version(&raw)?;
        self.transform.clone_from(&raw.transform);
        let mut header =
            CityFile { crs: crs_of(&raw.metadata)?, metadata: raw.metadata.clone(), ..CityFile::default() };
        header.add(raw, self.transform.as_ref())?;
        Ok(header)
    }

    fn malformed(&self, reason: &str) -> OutputError {
        MalformedFile { path: self.path.clone(), reason: format!("line {}: {reason}", self.n_lines) }.into()
    }

    /// The next line that is not empty.
    fn next_line(&mut self) -> Result<Option<RawFile>, OutputError> {
        for line in self.lines.by_ref() {
            self.n_lines += 1;
            let line = line.map_err(FileError::on("cannot read", &self.path))?;
            if !line.trim().is_empty() {
                return serde_json::from_str(&line).map(Some).map_err(|e| self.malformed(&e.to_string()));
            }
        }
        Ok(None)
    }

    fn next_feature(&mut self) -> Result<Option<CityFile>, OutputError> {
        if std::mem::take(&mut self.is_header_due) && !self.header.objects.is_empty() {
            return Ok(Some(std::mem::take(&mut self.header)));
        }
        let Some(raw) = self.next_line()? else { return Ok(None) };
        if raw.kind != "CityJSONFeature" {
            return Err(self.malformed(&format!("expected a CityJSONFeature, found {:?}", raw.kind)));
        }
        let mut city = CityFile::default();
        city.add(raw, self.transform.as_ref()).map_err(|reason| self.malformed(&reason))?;
        Ok(Some(city))
    }

    /// All features as one model.
    fn into_one(mut self) -> Result<CityFile, OutputError> {
        self.is_header_due = false;
        let mut city = std::mem::take(&mut self.header);
        while let Some(raw) = self.next_line()? {
            if raw.kind != "CityJSONFeature" {
                return Err(self.malformed(&format!("expected a CityJSONFeature, found {:?}", raw.kind)));
            }
            city.add(raw, self.transform.as_ref()).map_err(|reason| self.malformed(&reason))?;
        }
        Ok(city)
    }
}

impl Iterator for Sequence {
    type Item = Result<CityFile, OutputError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_feature().transpose()
    }
}

fn require_version(raw: &RawFile) -> Result<(), String> {
    if raw.kind != "CityJSON" {
        return Err(format!("expected \"type\": \"CityJSON\", found {:?}", raw.kind));
    }
    match raw.version.as_deref() {
        Some(v) if ["1.0", "1.1", "2.0"].iter().any(|known| v.starts_with(known)) => Ok(()),
        found => Err(format!("expected CityJSON version 1.0, 1.1 or 2.0, found {}", found.unwrap_or("none"))),
    }
}

/// `urn:ogc:def:crs:EPSG::7415` or `https://www.opengis.net/def/crs/EPSG/0/7415`.
fn crs_of(metadata: &JsonMap<String, Value>) -> Result<Option<Crs>, String> {
    let Some(name) = metadata.get("referenceSystem").and_then(Value::as_str) else { return Ok(None) };
    let code = name.rsplit(['/', ':']).next().unwrap_or_default();
    Crs::parse(&format!("EPSG:{code}")).map(Some).map_err(|e| format!("referenceSystem {name:?}: {e}"))
}

impl CityFile {
    fn add(&mut self, raw: RawFile, transform: Option<&RawTransform>) -> Result<(), String> {
        let first = self.vertices.len();
        let place = |v: [f64; 3]| match transform {
            Some(t) => std::array::from_fn(|axis| v[axis] * t.scale[axis] + t.translate[axis]),
            None => v,
        };
        self.vertices.extend(raw.vertices.into_iter().map(place));
        let offset = u32::try_from(first).map_err(|_| "more than 2^32 vertices".to_owned())?;
        for (id, object) in raw.objects {
            let mut geometries = Vec::with_capacity(object.geometry.len());
            for geometry in &object.geometry {
                match geometry.read(offset, self.vertices.len()).map_err(|e| format!("object {id:?}: {e}"))? {
                    Some(geometry) => geometries.push(geometry),
                    None if geometry.kind == "GeometryInstance" => self.n_templates += 1,
                    None => {}
                }
            }
            let attributes = object.attributes.unwrap_or_default();
            self.objects.push(CityObject { id, kind: object.kind, parents: object.parents, attributes, geometries });
        }
        Ok(())
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
            let mut reader = SurfaceReader { geometry: self, offset, n_vertices, surfaces: &mut surfaces };
            reader.descend(boundaries, values, levels_above, [0; 3])?;
        }
        Ok(Some(CityGeometry { lod, is_solid: levels_above > 0, surfaces }))
    }

    fn kind_of(&self, value: &Value) -> Option<Surface> {
        let index = usize::try_from(value.as_u64()?).ok()?;
        match self.semantics.as_ref()?.surfaces.get(index)?.kind.as_str() {
            "GroundSurface" => Some(Surface::Ground),
            "RoofSurface" => Some(Surface::Roof),
            "WallSurface" => Some(Surface::Wall),
            _ => None,
        }
    }
}

struct SurfaceReader<'a> {
    geometry: &'a RawGeometry,
    offset: u32,
    n_vertices: usize,
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
                let rings = item.items()?.iter().map(|ring| self.ring(ring)).collect::<Result<_, _>>()?;
                self.surfaces.push(CitySurface { place, kind: self.geometry.kind_of(value), rings });
            }
        }
        Ok(())
    }

    fn ring(&self, ring: &Nested) -> Result<Vec<u32>, String> {
        let index = |item: &Nested| match item {
            Nested::Index(i) if (*i as usize) < self.n_vertices - self.offset as usize => Ok(i + self.offset),
            Nested::Index(i) => Err(format!("vertex index {i} of {}", self.n_vertices - self.offset as usize)),
            Nested::List(_) => Err("its boundaries are deeper than its type allows".to_owned()),
        };
        ring.items()?.iter().map(index).collect()
    }
}
