//! The published schemas are those of the code.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::{Map, Value};

use crate::tiny_scene::lab;

#[test]
fn the_committed_schemas_are_what_the_code_writes() {
    let folder = tempfile::tempdir().unwrap();
    let mut sizeup = Command::new(env!("CARGO_BIN_EXE_sizeup"));
    sizeup.args(["schema", "--output"]).arg(folder.path()).assert().success().stdout("");
    lab().args(["schema", "--output"]).arg(folder.path()).assert().success().stdout("");
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas");
    let names = |folder: &Path| {
        let names = fs::read_dir(folder).map(|entries| entries.map(|e| e.unwrap().file_name()).collect::<Vec<_>>());
        let mut names = names.unwrap_or_default();
        names.sort();
        names
    };
    assert_eq!(names(&committed), names(folder.path()), "schemas/ is out of date: run `make schemas`");
    for name in names(folder.path()) {
        let is_same = fs::read(committed.join(&name)).unwrap() == fs::read(folder.path().join(&name)).unwrap();
        assert!(is_same, "schemas/{} is out of date: run `make schemas`", name.display());
    }
}

#[test]
fn a_schema_asked_for_by_name_goes_to_stdout() {
    let mut sizeup = Command::new(env!("CARGO_BIN_EXE_sizeup"));
    let output = sizeup.args(["schema", "run"]).output().unwrap();
    let schema: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(schema["title"], "RunConfig");
    assert!(schema["properties"]["footprints"].is_object() && output.stderr.is_empty());
}

/// As many keys as a user can be asked to meet; all others are marked `x-expert`.
const MAX_OPEN_KEYS: usize = 90;

/// The keys of a configuration, each with the places where it occurs and whether it is for experts there.
struct Keys<'a> {
    definitions: &'a Map<String, Value>,
    /// By the structure that holds it and its name.
    found: BTreeMap<(String, String), BTreeMap<String, bool>>,
}

impl Keys<'_> {
    /// What a schema refers to, marks and texts beside the reference first; with the name of the structure.
    fn resolved(&self, schema: &Value) -> (Option<String>, Map<String, Value>) {
        let mut schema = schema.as_object().cloned().unwrap_or_default();
        let mut options: Vec<Value> = schema.get("anyOf").and_then(Value::as_array).cloned().unwrap_or_default();
        options.retain(|option| option["type"] != "null");
        if let [only] = options.as_slice() {
            schema.extend(only.as_object().cloned().unwrap_or_default());
        }
        let name = schema.get("$ref").and_then(|r| Some(r.as_str()?.rsplit('/').next()?.to_owned()));
        let mut whole =
            name.as_ref().map(|name| self.definitions[name].as_object().cloned().unwrap()).unwrap_or_default();
        whole.extend(schema);
        (name, whole)
    }

    /// The structure that has the keys of a table, where one does: variants are written out in the schema.
    fn named_as(&self, table: &Map<String, Value>) -> Option<String> {
        let keys = |table: &Value| -> BTreeSet<String> {
            table["properties"].as_object().into_iter().flat_map(Map::keys).cloned().collect()
        };
        let own = keys(&Value::Object(table.clone()));
        self.definitions.iter().find(|(_, definition)| keys(definition) == own).map(|(name, _)| name.clone())
    }

    /// Adds the keys of a table and of those below it.
    fn add(&mut self, path: &str, holder: &str, table: &Map<String, Value>, is_expert: bool) {
        let is_expert = table.get("x-expert").map_or(is_expert, |mark| mark.as_bool().expect("true or false"));
        for (key, raw) in table.get("properties").and_then(Value::as_object).into_iter().flatten() {
            let (name, field) = self.resolved(raw);
            let path = format!("{path}.{key}");
            let variants = field.get("oneOf").and_then(Value::as_array).cloned().unwrap_or_default();
            let variants: Vec<Value> = variants.into_iter().filter(|v| !v["properties"]["source"].is_null()).collect();
            if !variants.is_empty() {
                for variant in variants {
                    let mut table = self.resolved(&variant).1;
                    table.get_mut("properties").and_then(Value::as_object_mut).unwrap().remove("source");
                    let holder = self.named_as(&table).unwrap_or_else(|| path.clone());
                    self.add(&path, &holder, &table, is_expert);
                }
            } else if field.contains_key("properties") {
                self.add(&path, &name.unwrap(), &field, is_expert);
            } else {
                let is_expert = field.get("x-expert").map_or(is_expert, |mark| mark.as_bool().expect("true or false"));
                self.found.entry((holder.to_owned(), key.clone())).or_default().insert(path, is_expert);
            }
        }
    }
}

#[test]
fn a_user_meets_few_keys_and_each_other_is_for_experts_wherever_it_occurs() {
    let schema = fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas/run.schema.json")).unwrap();
    let schema: Value = serde_json::from_slice(&schema).unwrap();
    let definitions = schema["$defs"].as_object().unwrap();
    let mut keys = Keys { definitions, found: BTreeMap::new() };
    keys.add("", "RunConfig", schema.as_object().unwrap(), false);
    assert!(keys.found.len() > 100, "only {} keys were found", keys.found.len());
    for ((holder, key), places) in &keys.found {
        let is_one = places.values().all(|is_expert| is_expert == places.values().next().unwrap());
        assert!(is_one, "{holder}::{key} is for experts in one place and open in another: {places:?}");
    }
    let is_open = |places: &BTreeMap<String, bool>| places.values().any(|is_expert| !is_expert);
    let open: Vec<String> =
        keys.found.iter().filter(|(_, p)| is_open(p)).map(|((h, k), _)| format!("{h}::{k}")).collect();
    assert!(open.len() <= MAX_OPEN_KEYS, "{} keys are open: mark the rarer ones `x-expert`: {open:#?}", open.len());
    println!("{} keys are open, {} for experts", open.len(), keys.found.len() - open.len());
}

#[test]
fn the_reference_has_each_key_once_where_it_belongs() {
    let reference = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference.md")).unwrap();
    let (_, settings) = reference.split_once("## Configuration of `sizeup run`").unwrap();
    let (open, rest) = settings.split_once("## Expert settings: configuration of `sizeup run`").unwrap();
    let (expert, _) = rest.split_once("## Profile of a depth network").unwrap();
    let n_of = |part: &str, key: &str| part.lines().filter(|line| line.starts_with(&format!("| `{key}` |"))).count();
    for key in ["crs", "working_px", "vertical_reference"] {
        assert!(n_of(open, key) > 0, "{key} is not among the keys that a user meets");
    }
    for key in ["stride_px", "min_confidence", "enu_origin"] {
        assert_eq!((n_of(open, key), n_of(expert, key)), (0, 1), "{key}");
    }
    assert_eq!(n_of(open, "confidence_key") + n_of(expert, "confidence_key"), 1, "a structure is listed once");
}
