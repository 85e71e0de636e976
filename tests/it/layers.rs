//! The layers of the house: modules import downwards only.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Modules by level, lowest first.
const LEVELS: [&[&str]; 11] = [
    &[
        "files",
        "frames",
        "gdal_log",
        "hashes",
        "ids",
        "issue",
        "limits",
        "paths",
        "raster",
        "ray",
        "recipe",
        "seed",
        "simd",
        "stats",
        "template",
        "unfinished",
    ],
    &["camera", "cloud", "crs", "geodata", "onnx", "survey", "terrain"],
    &["footprint", "prior"],
    &["render", "scene"],
    &["ordinal", "views"],
    &["photometry"],
    &["dtm", "optimise"],
    &["baseline", "evaluate", "output", "report", "simulate"],
    &["config", "pipeline"],
    &["benchmark", "tiles"],
    &["cli"],
];

/// Imports within a level: who, whom, and why.
const NEIGHBOURS: [(&str, &str, &str); 16] = [
    ("files", "limits", "nothing is read whole that is over the limit"),
    ("template", "paths", "a name out of a file stays in its folder"),
    ("hashes", "files", "what is known of files is left behind in a file"),
    ("recipe", "hashes", "a recipe is told by its hash"),
    ("unfinished", "files", "a mark is a file"),
    ("geodata", "crs", "rasters and layers carry their CRS"),
    ("terrain", "crs", "a DTM is read in its own CRS"),
    ("terrain", "geodata", "a DTM is read through the one door to GDAL"),
    ("survey", "camera", "a view is a camera with a pose"),
    ("survey", "crs", "poses are moved into the project's CRS"),
    ("survey", "geodata", "camera positions and image footprints are written as layers"),
    ("survey", "terrain", "the survey report tells what the views see of the ground"),
    ("render", "scene", "traces the model, which knows nothing of tracing"),
    ("evaluate", "output", "compares the records that the writers write"),
    ("report", "output", "shows the records that the writers write"),
    ("pipeline", "config", "runs what the configuration says"),
];

/// Downward imports that the design forbids all the same.
const STRANGERS: [(&str, &str); 7] = [
    ("ordinal", "render"),
    ("ordinal", "scene"),
    ("render", "survey"),
    ("render", "crs"),
    ("output", "optimise"),
    ("report", "optimise"),
    ("simulate", "optimise"),
];

/// One mention of `crate::imported` in a module's code.
struct Import {
    importer: String,
    imported: String,
    place: String,
}

fn source_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            source_files(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Each source file's path within `src` and its text.
fn sources() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    source_files(&root, &mut files);
    files.sort();
    let read = |path: PathBuf| (path.strip_prefix(&root).unwrap().to_owned(), fs::read_to_string(&path).unwrap());
    files.into_iter().map(read).collect()
}

/// The top-level module of a file: `render/bvh.rs` is of `render`, `files.rs` is `files`.
fn module_of(path: &Path) -> String {
    Path::new(path.components().next().unwrap().as_os_str()).file_stem().unwrap().to_string_lossy().into_owned()
}

/// The code of a line, without its comment.
fn code_of(line: &str) -> &str {
    line.split("//").next().unwrap_or("")
}

/// Names after each `crate::` of a line; `crate::{a::b, c}` gives `a` and `c`.
fn names_after_crate(code: &str) -> Vec<String> {
    let name = |text: &str| text.trim().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    code.split("crate::")
        .skip(1)
        .flat_map(|rest| match rest.strip_prefix('{') {
            Some(group) => group.split(',').map(name).collect(),
            None => vec![name(rest)],
        })
        .filter(|name| !name.is_empty())
        .collect()
}

fn imports() -> Vec<Import> {
    let mut imports = Vec::new();
    for (path, text) in sources() {
        let importer = module_of(&path);
        for (i, line) in text.lines().enumerate() {
            for imported in names_after_crate(code_of(line)) {
                if imported != importer {
                    let place = format!("src/{}:{}", path.display(), i + 1);
                    imports.push(Import { importer: importer.clone(), imported, place });
                }
            }
        }
    }
    imports
}

fn level_of(module: &str) -> Option<usize> {
    LEVELS.iter().position(|level| level.contains(&module))
}

/// Why an import is forbidden, if it is.
fn objection(import: &Import) -> Option<String> {
    let pair = (import.importer.as_str(), import.imported.as_str());
    let (Some(above), Some(below)) = (level_of(pair.0), level_of(pair.1)) else {
        return Some("a module that is missing from this test's table".to_owned());
    };
    if above < below {
        return Some(format!("level {above} may not import from level {below} above it"));
    }
    let is_listed = |(who, whom, _): &(&str, &str, &str)| (*who, *whom) == pair;
    if above == below && !NEIGHBOURS.iter().any(is_listed) {
        return Some("neighbours on a level do not see each other".to_owned());
    }
    STRANGERS.contains(&pair).then(|| "the design keeps these two apart".to_owned())
}

#[test]
fn modules_import_downwards_only() {
    let objections: Vec<String> = imports()
        .iter()
        .filter_map(|i| Some(format!("{}: {} -> {}: {}", i.place, i.importer, i.imported, objection(i)?)))
        .collect();
    assert!(objections.is_empty(), "\n{}", objections.join("\n"));
}

#[test]
fn every_listed_exception_is_needed() {
    let used: BTreeSet<(String, String)> = imports().into_iter().map(|i| (i.importer, i.imported)).collect();
    for (who, whom, why) in &NEIGHBOURS {
        assert!(used.contains(&((*who).to_owned(), (*whom).to_owned())), "{who} -> {whom} ({why}) is no longer used");
    }
}

#[test]
fn every_module_has_its_level() {
    for (path, _) in sources() {
        let module = module_of(&path);
        assert!(
            matches!(&*module, "lib" | "main") || level_of(&module).is_some(),
            "{module} is missing from the table"
        );
    }
}

#[test]
fn only_the_command_line_prints_exits_and_reads_the_environment() {
    const WORDS: [&str; 6] = ["println!", "print!", "dbg!", "process::exit", "env::var", "env::args"];
    for (path, text) in sources().iter().filter(|(path, _)| !matches!(&*module_of(path), "cli" | "main")) {
        for (i, line) in text.lines().enumerate() {
            let word = WORDS.iter().find(|word| code_of(line).contains(**word));
            assert!(word.is_none(), "src/{}:{}: {} outside cli", path.display(), i + 1, word.unwrap());
        }
    }
}

#[test]
fn each_native_library_has_one_door() {
    // `crs` moves points with height through GDAL and reads PROJ's database with it: the `proj` crate does neither.
    const DOORS: [(&str, &[&str]); 5] = [
        ("proj::", &["crs"]),
        ("proj_sys::", &["crs"]),
        ("gdal::", &["geodata", "crs", "gdal_log"]),
        ("gdal_sys::", &["geodata"]),
        ("rten", &["onnx"]),
    ];
    for (path, text) in sources() {
        let module = module_of(&path);
        for (i, line) in text.lines().enumerate() {
            for (library, doors) in DOORS {
                let starts_word = |at: usize| !code_of(line)[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
                let is_used = code_of(line).match_indices(library).any(|(at, _)| starts_word(at));
                assert!(!is_used || doors.contains(&&*module), "src/{}:{}: {library}", path.display(), i + 1);
            }
        }
    }
}
