//! The layers of the house: crates depend, and modules import, downwards only.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A crate: its folder, the crates of ours that it may use, and its modules by level, lowest first. A crate without levels is
/// one room.
struct Room {
    name: &'static str,
    uses: &'static [&'static str],
    levels: &'static [&'static [&'static str]],
}

const ROOMS: [Room; 9] = [
    Room {
        name: "heights",
        uses: &[],
        levels: &[
            &["frames", "ids", "raster", "ray", "seed", "simd", "split", "stats"],
            &["camera", "terrain"],
            &["picture", "prior", "scene"],
            &["render"],
            &["ordinal", "views"],
            &["config", "photo_consistency"],
            &["evidence"],
            &["score"],
            &["roofs"],
            &["paper", "search"],
            &["optimise"],
            &["estimate"],
        ],
    },
    Room {
        name: "geo",
        uses: &["heights"],
        levels: &[
            &[
                "files",
                "gdal_log",
                "groups",
                "hashes",
                "issue",
                "kept",
                "limits",
                "lock",
                "paths",
                "template",
                "triangles",
                "unfinished",
                "units",
            ],
            &["cloud", "crs"],
            &["geodata"],
            &["terrain"],
        ],
    },
    Room { name: "survey", uses: &["geo", "heights"], levels: &[] },
    Room {
        name: "photos",
        uses: &["geo", "heights", "survey"],
        levels: &[&["onnx", "quality", "textures", "vegetation"], &["prior"], &["align"], &["dtm"]],
    },
    Room { name: "footprints", uses: &["geo", "heights", "photos", "survey"], levels: &[] },
    Room {
        name: "results",
        uses: &["footprints", "geo", "heights", "photos", "survey"],
        levels: &[&["output"], &["changes", "report"]],
    },
    Room {
        name: "truth",
        uses: &["geo", "heights", "photos", "results", "survey"],
        levels: &[&["evaluate", "simulate"]],
    },
    Room {
        name: PROGRAM,
        uses: &["footprints", "geo", "heights", "photos", "results", "survey", "truth"],
        levels: &[&["config", "recipe"], &["pipeline"], &["init", "tiles"], &["cli"]],
    },
    Room {
        name: LAB,
        uses: &["geo", "heights", "photos", "results", "survey", "truth"],
        levels: &[&["baseline"], &["benchmark"], &["cli"]],
    },
];

/// The package at the top of the tree.
const PROGRAM: &str = "sizeup";
/// The package that measures the program.
const LAB: &str = "lab";

/// Imports within a level: room, who, whom, and why.
const NEIGHBOURS: [(&str, &str, &str, &str); 6] = [
    ("geo", "files", "limits", "nothing is read whole that is over the limit"),
    ("geo", "template", "paths", "a name out of a file stays in its folder"),
    ("geo", "hashes", "files", "what is known of files is left behind in a file"),
    ("geo", "unfinished", "files", "a mark is a file"),
    ("geo", "unfinished", "lock", "a folder has one writer at a time"),
    ("geo", "lock", "files", "what cannot be locked is a file that cannot be written"),
];

/// What a room never touches, and why that is promised.
const PURE: [&str; 9] = ["gdal", "proj::", "proj_sys", "ort::", "rten", "std::fs", "std::path", "std::env", "std::net"];

/// One source file: its room, its path within the room's `src`, and its text.
struct Source {
    room: &'static Room,
    path: PathBuf,
    text: String,
}

impl Source {
    /// The top-level module: `render/bvh.rs` is of `render`, `files.rs` is `files`.
    fn module(&self) -> String {
        let first = self.path.components().next().unwrap();
        Path::new(first.as_os_str()).file_stem().unwrap().to_string_lossy().into_owned()
    }

    fn place(&self, line: usize) -> String {
        format!("{}/{}:{}", folder_of(self.room.name).display(), self.path.display(), line + 1)
    }
}

/// The folder of a room's package, within the project.
fn package_of(room: &str) -> PathBuf {
    match room {
        PROGRAM => PathBuf::new(),
        LAB => PathBuf::from(LAB),
        name => Path::new("crates").join(name),
    }
}

/// The folder of a room's sources, within the project.
fn folder_of(room: &str) -> PathBuf {
    package_of(room).join("src")
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

fn sources() -> Vec<Source> {
    let mut sources = Vec::new();
    for room in &ROOMS {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder_of(room.name));
        let mut files = Vec::new();
        source_files(&root, &mut files);
        files.sort();
        sources.extend(files.into_iter().map(|path| Source {
            room,
            text: fs::read_to_string(&path).unwrap(),
            path: path.strip_prefix(&root).unwrap().to_owned(),
        }));
    }
    sources
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

/// Who imports whom within the rooms that have levels, and where.
fn imports() -> Vec<(&'static Room, String, String, String)> {
    let mut imports = Vec::new();
    for source in sources().iter().filter(|source| !source.room.levels.is_empty()) {
        let importer = source.module();
        for (i, line) in source.text.lines().enumerate() {
            for imported in names_after_crate(code_of(line)) {
                if imported != importer && importer != "lib" {
                    imports.push((source.room, importer.clone(), imported, source.place(i)));
                }
            }
        }
    }
    imports
}

fn level_of(room: &Room, module: &str) -> Option<usize> {
    room.levels.iter().position(|level| level.contains(&module))
}

/// Why an import is forbidden, if it is.
fn objection(room: &Room, importer: &str, imported: &str) -> Option<String> {
    let (Some(above), Some(below)) = (level_of(room, importer), level_of(room, imported)) else {
        return Some("a module that is missing from this test's table".to_owned());
    };
    if above < below {
        return Some(format!("level {above} may not import from level {below} above it"));
    }
    let is_listed = NEIGHBOURS.iter().any(|(of, who, whom, _)| (*of, *who, *whom) == (room.name, importer, imported));
    (above == below && !is_listed).then(|| "neighbours on a level do not see each other".to_owned())
}

#[test]
fn crates_depend_downwards_only() {
    let ours: BTreeSet<&str> = ROOMS.iter().map(|room| room.name).collect();
    let folders = fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("crates")).unwrap();
    for folder in folders {
        let name = folder.unwrap().file_name().into_string().unwrap();
        assert!(ours.contains(&*name), "crates/{name} is missing from the table");
    }
    for (i, room) in ROOMS.iter().enumerate() {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join(package_of(room.name)).join("Cargo.toml");
        let text = fs::read_to_string(manifest).unwrap();
        let table: toml::Table = text.parse().unwrap();
        let named: BTreeSet<&str> =
            table["dependencies"].as_table().unwrap().keys().filter_map(|name| name.strip_prefix("sizeup-")).collect();
        assert_eq!(named, room.uses.iter().copied().collect(), "{}", room.name);
        let is_below = |name: &&str| ROOMS[..i].iter().any(|below| below.name == *name);
        assert!(room.uses.iter().all(is_below), "{} uses a room above it", room.name);
    }
}

#[test]
fn modules_import_downwards_only() {
    let objections: Vec<String> = imports()
        .iter()
        .filter_map(|(room, who, whom, place)| {
            Some(format!("{place}: {who} -> {whom}: {}", objection(room, who, whom)?))
        })
        .collect();
    assert!(objections.is_empty(), "\n{}", objections.join("\n"));
}

#[test]
fn every_listed_exception_is_needed() {
    let used: BTreeSet<(&str, String, String)> =
        imports().into_iter().map(|(room, who, whom, _)| (room.name, who, whom)).collect();
    for (room, who, whom, why) in &NEIGHBOURS {
        assert!(used.contains(&(*room, (*who).to_owned(), (*whom).to_owned())), "{who} -> {whom} ({why}) is not used");
    }
}

#[test]
fn every_module_has_its_level() {
    for source in sources().iter().filter(|source| !source.room.levels.is_empty()) {
        let module = source.module();
        assert!(
            matches!(&*module, "lib" | "main") || level_of(source.room, &module).is_some(),
            "{} of {} is missing from the table",
            module,
            source.room.name
        );
    }
}

#[test]
fn the_method_touches_no_file_and_no_native_library() {
    for source in sources().iter().filter(|source| source.room.name == "heights") {
        for (i, line) in source.text.lines().enumerate() {
            let touched = PURE.iter().find(|word| code_of(line).contains(**word));
            assert!(touched.is_none(), "{}: {}", source.place(i), touched.unwrap());
        }
    }
}

#[test]
fn only_the_command_line_prints_exits_and_reads_the_environment() {
    const WORDS: [&str; 6] = ["println!", "print!", "dbg!", "process::exit", "env::var", "env::args"];
    let says =
        |source: &Source| [PROGRAM, LAB].contains(&source.room.name) && matches!(&*source.module(), "cli" | "main");
    for source in sources().iter().filter(|source| !says(source)) {
        for (i, line) in source.text.lines().enumerate() {
            let word = WORDS.iter().find(|word| code_of(line).contains(**word));
            assert!(word.is_none(), "{}: {} outside cli", source.place(i), word.unwrap());
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
    for source in sources() {
        let module = source.module();
        for (i, line) in source.text.lines().enumerate() {
            for (library, doors) in DOORS {
                let starts_word = |at: usize| !code_of(line)[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
                let is_used = code_of(line).match_indices(library).any(|(at, _)| starts_word(at));
                assert!(!is_used || doors.contains(&&*module), "{}: {library}", source.place(i));
            }
        }
    }
}

/// Files of the pipeline that may read the whole configuration: its door, and the recipes, which hash it.
const DOORS: [&str; 3] = ["mod", "recipes", "run_settings"];

/// The files of the pipeline by their names, and each of its folders as one: their code without tests.
fn pipeline() -> BTreeMap<String, String> {
    let of_pipeline = sources().into_iter().filter(|source| source.path.starts_with("pipeline"));
    let code = |text: &str| {
        let text = text.split("#[cfg(test)]").next().unwrap_or_default();
        text.lines().map(code_of).collect::<Vec<_>>().join("\n")
    };
    let mut files = BTreeMap::<String, String>::new();
    for source in of_pipeline {
        let within: PathBuf = source.path.components().skip(1).take(1).collect();
        let name = within.file_stem().unwrap().to_string_lossy().into_owned();
        files.entry(name).or_default().push_str(&code(&source.text));
    }
    files
}

/// The words of a text.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty())
}

#[test]
fn a_stage_reads_its_own_settings_only() {
    let files = pipeline();
    assert!(files.len() > 12);
    for (name, code) in files.iter().filter(|(name, _)| !DOORS.contains(&name.as_str())) {
        assert!(!code.contains("RunConfig"), "src/pipeline/{name}.rs: a stage gets its own settings, see settings.rs");
    }
}

#[test]
fn no_file_of_the_pipeline_uses_another_in_a_circle() {
    let mut files = pipeline();
    let root = files.remove("mod").unwrap();
    let shown = root.split("pub use ").skip(1).filter_map(|rest| rest.split(';').next()?.split_once("::"));
    let home: BTreeMap<&str, &str> =
        shown.flat_map(|(module, names)| words(names).map(move |name| (name, module))).collect();
    let used = |code: &str| -> BTreeSet<String> {
        let names = code.split("super::").skip(1).filter_map(|rest| {
            let ends: &[char] = if rest.starts_with('{') { &[';'] } else { &[':', ';', '('] };
            rest.split(ends).next()
        });
        let known = |name: &str| {
            files.get_key_value(name).map(|(file, _)| &**file).or(home.get(name).copied()).map(str::to_owned)
        };
        names.flat_map(words).filter_map(known).collect()
    };
    let mut left: BTreeMap<&str, BTreeSet<String>> = files
        .iter()
        .map(|(name, code)| (name.as_str(), used(code).into_iter().filter(|used| used != name).collect()))
        .collect();
    assert!(left["stages"].contains("heights") && left["output"].contains("artefacts"), "arrows are found");
    // Files that use no file that is left are taken out, until none is: what remains is in circles.
    while let Some(free) =
        left.iter().find(|(_, used)| used.iter().all(|used| !left.contains_key(used.as_str()))).map(|(name, _)| *name)
    {
        left.remove(free);
    }
    assert!(left.is_empty(), "files that use each other: {:?}", left.keys());
}
