//! The form of one `CityJSON` file by cjval, in parts: memory grows with its vertices only.
//!
//! Given a whole document, cjval takes some forty times its size. So it is given many small ones:
//!
//! 1. the head: everything but objects and vertices;
//! 2. what objects and vertices need of the head, with some of the objects, or some of the vertices.
//!
//! What no part can know is counted here and told in cjval's words: indices of vertices, references between objects, ids
//! that come twice, duplicate and unused vertices. (Vertices are compared number by number. cjval compares their digits
//! strung together, so that (1, 23, 4) and (12, 3, 4) are the same to it.)
//!
//! The file is read twice: for the head and the number of vertices, then for the rest.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use indexmap::IndexMap;
use rayon::prelude::*;
use serde::de::IgnoredAny;
use serde_json::{Map, Number, Value, json};

use super::super::OutputError;
use super::super::cityjson::pieces::{Pieces, read_pieces};
use super::super::cityjson::read::open;
use super::granted::{self, Appearance};
use super::schema::{
    EXTENSIONS, INDICES, MATERIALS, SCHEMA, SEMANTICS, SchemaCheck, SchemaFault, TEXTURES, has_other_extensions,
    validator,
};
use sizeup_geo::files::FileError;

/// Least size of a part, bytes: reading its schemas costs cjval some hundredths of a second each time.
const PART_BYTES: usize = 1 << 20;
/// Members of the head that the checks of objects and vertices need.
const COMMON: [&str; 5] = ["type", "version", "extensions", "transform", "appearance"];
/// cjval's names of what is counted here.
const FAMILIES: &str = "parents_children_consistency";
const DUPLICATES: &str = "duplicate_vertices";
const UNUSED: &str = "unused_vertices";
/// cjval's checks in its order. What one stage finds ends the check; the last one warns.
const STAGES: [&[&str]; 4] = [
    &[SCHEMA],
    &[EXTENSIONS],
    &[FAMILIES, INDICES, SEMANTICS, TEXTURES, MATERIALS],
    &["extra_root_properties", DUPLICATES, UNUSED],
];
/// Unused vertices that are named one by one.
const MOST_NAMED: usize = 5;

/// Checks a file; `None` where it is no `CityJSON` that can be read in pieces.
///
/// # Errors
/// [`OutputError::File`] if it cannot be read.
pub(super) fn check(path: &Path) -> Result<Option<SchemaCheck>, OutputError> {
    let mut head = DocumentHead::default();
    if let Some(broken) = read(path, &mut head)? {
        return Ok(broken.into_outcome());
    }
    let mut check = DocumentCheck::new(&head);
    if head.is_known()
        && let Some(broken) = read(path, &mut check)?
    {
        return Ok(broken.into_outcome());
    }
    Ok(Some(check.outcome()))
}

/// Why a file could not be read to its end.
enum Broken {
    Syntax(String),
    OtherThanPieces,
}

impl Broken {
    fn into_outcome(self) -> Option<SchemaCheck> {
        let Self::Syntax(message) = self else { return None };
        let fault = SchemaFault { check: "json_syntax".to_owned(), line: None, message };
        Some(SchemaCheck { errors: vec![fault], ..SchemaCheck::default() })
    }
}

fn read(path: &Path, pieces: &mut impl Pieces) -> Result<Option<Broken>, OutputError> {
    match read_pieces(open(path)?, pieces) {
        Ok(()) => Ok(None),
        Err(e) if e.is_io() => Err(FileError::on("cannot read", path)(e.into()).into()),
        Err(e) if e.is_data() => Ok(Some(Broken::OtherThanPieces)),
        Err(e) => Ok(Some(Broken::Syntax(e.to_string()))),
    }
}

/// A file without its objects and vertices.
#[derive(Default)]
struct DocumentHead {
    members: Map<String, Value>,
    n_vertices: usize,
}

impl Pieces for DocumentHead {
    type Object = IgnoredAny;
    type Vertex = IgnoredAny;
    type Member = Value;

    fn list(&mut self, name: &str) -> bool {
        let empty = if name == "vertices" { json!([]) } else { json!({}) };
        self.members.insert(name.to_owned(), empty).is_none()
    }

    fn object(&mut self, _: String, _: IgnoredAny) -> bool {
        true
    }

    fn vertex(&mut self, _: IgnoredAny) {
        self.n_vertices += 1;
    }

    fn member(&mut self, name: String, value: Value) {
        self.members.insert(name, value);
    }
}

impl DocumentHead {
    fn text(&self) -> String {
        Value::Object(self.members.clone()).to_string()
    }

    /// Whether it is of a kind and version that there is a schema for.
    fn is_known(&self) -> bool {
        let is = |name: &str, among: &[&str]| self.members.get(name).is_some_and(|v| among.iter().any(|of| v == of));
        is("type", &["CityJSON"]) && is("version", &["1.0", "1.1", "2.0"])
    }

    /// The start of a document with what objects and vertices need of it.
    fn start(&self) -> String {
        let common = COMMON.iter().filter_map(|name| Some(format!("{}:{},", json!(name), self.members.get(*name)?)));
        format!("{{{}", common.collect::<String>())
    }
}

/// A list of pieces as JSON, to be looked at by cjval.
enum PieceList {
    Objects(String),
    /// The first one's index, and the list.
    Vertices(usize, String),
}

impl PieceList {
    /// Findings of cjval, by check.
    fn look(&self, start: &str) -> Vec<(String, String)> {
        let text = match self {
            Self::Objects(list) => format!("{start}\"CityObjects\":{{{list}}},\"vertices\":[]}}"),
            Self::Vertices(_, list) => format!("{start}\"CityObjects\":{{}},\"vertices\":[{list}]}}"),
        };
        let said = said(&text);
        match self {
            Self::Objects(_) => said.filter(|(check, _)| check != INDICES && check != FAMILIES).collect(),
            Self::Vertices(first, _) => said
                .filter(|(check, _)| check == SCHEMA)
                .map(|(check, message)| (check, with_index(&message, *first)))
                .collect(),
        }
    }
}

fn said(text: &str) -> impl Iterator<Item = (String, String)> {
    granted::said(&validator(text)).into_iter().map(|(check, message, _)| (check, message))
}

/// A message on a vertex of a part with the vertex's index in the file.
fn with_index(message: &str, first: usize) -> String {
    const PATH: &str = "[path:/vertices/";
    let moved = message.rsplit_once(PATH).and_then(|(what, place)| {
        let n_digits = place.find(|c: char| !c.is_ascii_digit())?;
        let (index, rest) = place.split_at(n_digits);
        Some(format!("{what}{PATH}{}{rest}", index.parse::<usize>().ok()? + first))
    });
    moved.unwrap_or_else(|| message.to_owned())
}

/// Whom an object names.
struct Relatives {
    parents: Vec<String>,
    children: Vec<String>,
}

impl Relatives {
    fn of(object: &Value) -> Self {
        let names = |member: &str| {
            let names = object[member].as_array().into_iter().flatten();
            names.filter_map(|name| name.as_str().map(str::to_owned)).collect()
        };
        Self { parents: names("parents"), children: names("children") }
    }
}

/// Looks at a file's pieces as they come.
struct DocumentCheck {
    start: String,
    appearance: Appearance,
    part_bytes: usize,
    has_other_extensions: bool,
    /// Messages, by the name of the check that they come from.
    found: HashMap<String, Vec<String>>,
    /// Messages on parts before, so that what is wrong with the head is told once.
    said: HashSet<(String, String)>,
    objects: String,
    vertices: String,
    n_vertices_in_parts: usize,
    /// Parts to be looked at, one per core.
    parts: Vec<PieceList>,
    families: IndexMap<String, Relatives>,
    has_duplicate_ids: bool,
    positions: HashSet<[Number; 3]>,
    n_vertices: usize,
    is_used: Vec<bool>,
}

impl DocumentCheck {
    fn new(head: &DocumentHead) -> Self {
        let text = head.text();
        let mut secured = Value::Object(head.members.clone());
        let findings = granted::secure_document(&mut secured);
        let mut check = Self {
            start: head.start(),
            appearance: Appearance::of(&secured),
            part_bytes: PART_BYTES.max(text.len()),
            has_other_extensions: has_other_extensions(&text),
            found: HashMap::new(),
            said: HashSet::new(),
            objects: String::new(),
            vertices: String::new(),
            n_vertices_in_parts: 0,
            parts: Vec::new(),
            families: IndexMap::new(),
            has_duplicate_ids: false,
            positions: HashSet::new(),
            n_vertices: 0,
            is_used: vec![false; head.n_vertices],
        };
        findings.into_iter().for_each(|(name, message)| check.tell(name, message));
        check.hear(said(&secured.to_string()).collect());
        check
    }

    fn tell(&mut self, check: &str, message: String) {
        self.found.entry(check.to_owned()).or_default().push(message);
    }

    fn hear(&mut self, said: Vec<(String, String)>) {
        let news: Vec<(String, String)> = said.into_iter().filter(|fault| !self.said.contains(fault)).collect();
        for (check, message) in &news {
            self.tell(check, message.clone());
        }
        self.said.extend(news);
    }

    /// Ends the part that objects are gathered for, and the one of vertices.
    fn end_parts(&mut self) {
        let (objects, vertices) = (std::mem::take(&mut self.objects), std::mem::take(&mut self.vertices));
        self.parts.extend(Some(objects).filter(|list| !list.is_empty()).map(PieceList::Objects));
        let first = std::mem::replace(&mut self.n_vertices_in_parts, self.n_vertices);
        self.parts.extend(Some(vertices).filter(|list| !list.is_empty()).map(|list| PieceList::Vertices(first, list)));
        if self.parts.len() >= rayon::current_num_threads() {
            self.look();
        }
    }

    fn look(&mut self) {
        let said: Vec<_> = self.parts.par_iter().map(|part| part.look(&self.start)).collect();
        self.parts.clear();
        for said in said {
            self.hear(said);
        }
    }

    /// Indices of an object's geometries and addresses that no vertex has; the others are used.
    fn look_at_indices(&mut self, id: &str, object: &Value) {
        let list = |member: &str| object[member].as_array().into_iter().flatten();
        for geometry in list("geometry") {
            let wrong = self.use_vertices(&geometry["boundaries"]);
            match geometry["type"].as_str() {
                _ if wrong.is_empty() => {}
                Some("MultiPoint" | "MultiLineString") => {
                    for i in wrong {
                        self.tell(INDICES, format!("Vertices {i} don't exist"));
                    }
                }
                Some("GeometryInstance") => {
                    for i in wrong {
                        self.tell(INDICES, format!("Vertex {i} doesn't exist (in #{id})"));
                    }
                }
                _ => {
                    let all: Vec<String> = wrong.iter().map(u64::to_string).collect();
                    self.tell(INDICES, format!("vertices #{}/ don't exist", all.join("/#")));
                }
            }
        }
        for address in list("address") {
            let wrong = self.use_vertices(&address["location"]["boundaries"]);
            for i in wrong {
                self.tell(INDICES, format!("Vertices {i} don't exist"));
            }
        }
    }

    fn use_vertices(&mut self, boundaries: &Value) -> Vec<u64> {
        match boundaries {
            Value::Array(items) => items.iter().flat_map(|item| self.use_vertices(item)).collect(),
            other => {
                let Some(index) = other.as_u64() else { return Vec::new() };
                let is_used = usize::try_from(index).ok().and_then(|index| self.is_used.get_mut(index));
                is_used.map(|is_used| *is_used = true).map_or_else(|| vec![index], |()| Vec::new())
            }
        }
    }

    fn look_at_families(&mut self) {
        let families = std::mem::take(&mut self.families);
        for (id, child) in families.iter().flat_map(|(id, family)| family.children.iter().map(move |c| (id, c))) {
            match families.get(child) {
                None => self.tell(FAMILIES, format!("CityObject #{child} doesn't exist (referenced by #{id})")),
                Some(family) if !family.parents.contains(id) => {
                    self.tell(FAMILIES, format!("CityObject #{child} doesn't reference correct parent (#{id})"));
                }
                Some(_) => {}
            }
        }
        for (id, parent) in families.iter().flat_map(|(id, family)| family.parents.iter().map(move |p| (id, p))) {
            if !families.contains_key(parent) {
                self.tell(FAMILIES, format!("CityObject #{id} is an orphan (parent #{parent} doesn't exist)"));
            }
        }
    }

    fn look_at_unused(&mut self) {
        let unused: Vec<usize> = (0..self.is_used.len()).filter(|&i| !self.is_used[i]).collect();
        if unused.len() > MOST_NAMED {
            self.tell(UNUSED, format!("{} vertices are unused", unused.len()));
        } else {
            for i in unused {
                self.tell(UNUSED, format!("Vertex #{i} is unused"));
            }
        }
    }

    /// The first stage that found anything.
    fn outcome(mut self) -> SchemaCheck {
        self.end_parts();
        self.look();
        self.look_at_families();
        self.look_at_unused();
        if self.has_duplicate_ids && !self.found.contains_key(SCHEMA) {
            self.tell(SCHEMA, "Duplicate keys in 'CityObjects'".to_owned());
        }
        let mut outcome = SchemaCheck::default();
        let Some(stage) = STAGES.iter().find(|s| s.iter().any(|check| self.found.contains_key(*check))) else {
            return outcome;
        };
        let is_warning = *stage == STAGES[3] || (stage.contains(&EXTENSIONS) && self.has_other_extensions);
        let list = if is_warning { &mut outcome.warnings } else { &mut outcome.errors };
        for check in *stage {
            let messages = self.found.remove(*check).unwrap_or_default();
            let fault = |message| SchemaFault { check: (*check).to_owned(), line: None, message };
            list.extend(messages.into_iter().map(fault));
        }
        outcome
    }
}

impl Pieces for DocumentCheck {
    type Object = Value;
    type Vertex = Value;
    type Member = IgnoredAny;

    fn object(&mut self, id: String, mut object: Value) -> bool {
        self.look_at_indices(&id, &object);
        let findings = granted::secure_object(&id, &mut object, self.appearance);
        findings.into_iter().for_each(|(name, message)| self.tell(name, message));
        let piece = format!("{}:{object}", json!(id));
        if self.families.insert(id, Relatives::of(&object)).is_some() {
            self.has_duplicate_ids = true;
            return true;
        }
        self.objects.push_str(if self.objects.is_empty() { "" } else { "," });
        self.objects.push_str(&piece);
        if self.objects.len() >= self.part_bytes {
            self.end_parts();
        }
        true
    }

    fn vertex(&mut self, vertex: Value) {
        self.vertices.push_str(if self.vertices.is_empty() { "" } else { "," });
        self.vertices.push_str(&vertex.to_string());
        self.n_vertices += 1;
        if let Some([Value::Number(x), Value::Number(y), Value::Number(z)]) = vertex.as_array().map(Vec::as_slice)
            && !self.positions.insert([x.clone(), y.clone(), z.clone()])
        {
            self.tell(DUPLICATES, format!("Vertex ({x}, {y}, {z}) duplicated"));
        }
        if self.vertices.len() >= self.part_bytes {
            self.end_parts();
        }
    }
}
