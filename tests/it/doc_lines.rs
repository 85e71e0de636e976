//! Documentation begins with what a thing is: "Standard deviation of a mask's border", not "Of a mask's border".

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// Words that a doc line should not begin with.
const FRAGMENTS: [&str; 3] = ["Of ", "What ", "Its "];
/// First doc lines in src and crates that still do. Whoever mends some lowers it; nobody raises it.
const MOST_IN_CODE: usize = 8;

fn is_fragment(text: &str) -> bool {
    FRAGMENTS.iter().any(|word| text.starts_with(word))
}

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// The first lines of doc comments.
fn first_doc_lines(text: &str) -> impl Iterator<Item = &str> {
    let is_doc = |line: &str| line.trim_start().starts_with("///");
    let before = std::iter::once("").chain(text.lines());
    let is_first = move |(line, before): &(&str, &str)| is_doc(line) && !is_doc(before);
    text.lines().zip(before).filter(is_first).map(|(line, _)| line.trim_start().trim_start_matches("///").trim_start())
}

#[test]
fn fewer_and_fewer_doc_lines_begin_in_the_middle_of_a_sentence() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    ["src", "crates"].iter().for_each(|folder| rust_files(&root.join(folder), &mut files));
    let n: usize =
        files.iter().map(|f| first_doc_lines(&fs::read_to_string(f).unwrap()).filter(|l| is_fragment(l)).count()).sum();
    assert!(n <= MOST_IN_CODE, "{n} doc lines begin with one of {FRAGMENTS:?}, {MOST_IN_CODE} are left to mend");
    println!("{n} of at most {MOST_IN_CODE}");
}

#[test]
fn descriptions_in_schemas_begin_with_what_a_thing_is() {
    fn look(value: &Value, found: &mut Vec<String>) {
        match value {
            Value::Object(members) => {
                let text = members.get("description").and_then(Value::as_str);
                found.extend(text.filter(|text| is_fragment(text)).map(str::to_owned));
                members.values().for_each(|member| look(member, found));
            }
            Value::Array(items) => items.iter().for_each(|item| look(item, found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    for name in ["run", "simulate", "changes", "align", "progress"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("schemas/{name}.schema.json"));
        look(&serde_json::from_slice(&fs::read(path).unwrap()).unwrap(), &mut found);
    }
    assert!(found.is_empty(), "{found:#?}");
}
