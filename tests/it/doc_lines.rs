//! Documentation says what a thing is, and begins with it: "Standard deviation of a mask's border", not "Of a mask's border" or
//! "Deviation".

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// Words that a doc line should not begin with.
const FRAGMENTS: [&str; 3] = ["Of ", "What ", "Its "];
/// A doc comment of so few words says no more than the name below it did.
const LEAST_WORDS: usize = 3;

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

/// The doc comments of a file, each with the number of its first line.
fn doc_comments(text: &str) -> Vec<(usize, String)> {
    let mut comments: Vec<(usize, String)> = Vec::new();
    let mut is_within = false;
    for (i, line) in text.lines().enumerate() {
        let doc = line.trim_start().strip_prefix("///").map(str::trim);
        match doc {
            Some(more) if is_within => comments.last_mut().unwrap().1.extend([" ", more]),
            Some(first) => comments.push((i + 1, first.to_owned())),
            None => {}
        }
        is_within = doc.is_some();
    }
    comments
}

/// Doc comments in src and crates of which something is true, as `file:line: text`.
fn comments_that(is_so: impl Fn(&str) -> bool) -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    ["src", "crates", "lab/src"].iter().for_each(|folder| rust_files(&root.join(folder), &mut files));
    let mut found = Vec::new();
    let mut n = 0;
    for file in files {
        let comments = doc_comments(&fs::read_to_string(&file).unwrap());
        n += comments.len();
        let at = |(line, text): &(usize, String)| format!("{}:{line}: {text}", file.display());
        found.extend(comments.iter().filter(|(_, text)| is_so(text)).map(at));
    }
    assert!(n > 1000, "only {n} doc comments were found");
    found
}

#[test]
fn no_doc_comment_begins_in_the_middle_of_a_sentence() {
    let found = comments_that(is_fragment);
    assert!(found.is_empty(), "these begin with one of {FRAGMENTS:?}: {found:#?}");
}

#[test]
fn no_doc_comment_is_a_word_or_two() {
    let found = comments_that(|text| text.split_whitespace().count() < LEAST_WORDS);
    assert!(found.is_empty(), "these say too little: the thing, its unit, its frame, when it is missing: {found:#?}");
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
    for name in ["run", "depth-network", "footprint-network", "simulate", "changes", "align", "progress"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("schemas/{name}.schema.json"));
        look(&serde_json::from_slice(&fs::read(path).unwrap()).unwrap(), &mut found);
    }
    assert!(found.is_empty(), "{found:#?}");
}

/// A crate whose manifest says `doctest = false` has no documentation test that would never run.
#[test]
fn crates_that_run_no_documentation_tests_have_none() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let crates = fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let is_quiet =
        |folder: &PathBuf| fs::read_to_string(folder.join("Cargo.toml")).unwrap().contains("doctest = false");
    let quiet: Vec<PathBuf> = crates.chain([root.join("lab")]).filter(is_quiet).collect();
    assert!(quiet.len() > 3, "{quiet:?}");
    let mut files = Vec::new();
    quiet.iter().for_each(|folder| rust_files(&folder.join("src"), &mut files));
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let docs = text.lines().map(str::trim_start).filter(|line| line.starts_with("//!") || line.starts_with("///"));
        let fences = docs.filter_map(|line| line[3..].trim_start().strip_prefix("```"));
        // Every second one closes a block.
        let open: Vec<&str> = fences.step_by(2).collect();
        assert!(open.iter().all(|language| *language == "text"), "{}: {open:?}", file.display());
    }
}
