//! The documents: their commands exist, their configurations load, their links lead somewhere, and what can be run is run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::error::ErrorKind;
use clap::{CommandFactory as _, Parser as _};
use sizeup::cli::Cli;
use sizeup::config::RunConfig;
use sizeup::survey::Format;
use sizeup_lab::cli::Lab;
use toml::{Table, Value};

use crate::skipped::skip;
use crate::tiny_scene::Scene;

/// A document, by its path in the repository.
struct Document {
    name: String,
    text: String,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(name: &str) -> Document {
    Document { name: name.to_owned(), text: fs::read_to_string(root().join(name)).unwrap() }
}

/// The Markdown files of a folder.
fn pages(folder: &str) -> Vec<Document> {
    let names = fs::read_dir(root().join(folder)).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names
        .filter(|name| Path::new(name).extension().is_some_and(|e| e == "md"))
        .map(|name| format!("{folder}/{name}"))
        .collect();
    names.sort();
    names.iter().map(|name| read(name)).collect()
}

/// The README and all of `docs`, and the page of the laboratory; its notes hold for the programs of their days.
fn documents() -> Vec<Document> {
    let mut documents = vec![read("README.md"), read("lab/README.md")];
    documents.extend(["docs", "docs/how-to"].into_iter().flat_map(pages));
    documents
}

impl Document {
    /// Lines in and out of fenced blocks: the number, the block's language, or `None` outside, and the line.
    fn lines(&self) -> Vec<(usize, Option<&str>, &str)> {
        let mut language = None;
        let mut lines = Vec::new();
        for (i, line) in self.text.lines().enumerate() {
            match (line.trim_start().strip_prefix("```"), language) {
                (Some(_), Some(_)) => language = None,
                (Some(word), None) => language = Some(word.trim()),
                (None, _) => lines.push((i + 1, language, line)),
            }
        }
        lines
    }

    /// Fenced blocks of a language, with the number of their first line.
    fn blocks(&self, wanted: &str) -> Vec<(usize, String)> {
        let mut blocks: Vec<(usize, usize, String)> = Vec::new();
        for (number, language, line) in self.lines() {
            if language != Some(wanted) {
                continue;
            }
            match blocks.last_mut().filter(|(_, last, _)| *last + 1 == number) {
                Some((_, last, text)) => {
                    *last = number;
                    text.push_str(line);
                    text.push('\n');
                }
                None => blocks.push((number, number, format!("{line}\n"))),
            }
        }
        blocks.into_iter().map(|(first, _, text)| (first, text)).collect()
    }

    /// Commands of this program in fenced blocks, continued lines joined.
    fn commands(&self) -> Vec<(usize, Vec<String>)> {
        let mut commands = Vec::new();
        let mut open: Option<(usize, String)> = None;
        for (number, language, line) in self.lines() {
            if !matches!(language, Some("sh" | "" | "text")) {
                open = None;
                continue;
            }
            let (first, text) = match open.take() {
                Some((first, before)) => (first, format!("{before} {}", line.trim())),
                None => match command_in(line) {
                    Some(command) => (number, command.to_owned()),
                    None => continue,
                },
            };
            match text.strip_suffix('\\') {
                Some(before) => open = Some((first, before.trim_end().to_owned())),
                None => commands.push((first, words(&text))),
            }
        }
        commands
    }
}

/// The command in a line, after a prompt, the time that it takes, or a column of other things.
fn command_in(line: &str) -> Option<&str> {
    let at = line.find("sizeup ").or_else(|| line.find("sizeup-lab "))?;
    let before = line[..at].trim_start();
    let is_command = ["", "$ ", "/usr/bin/time -v ", "time "].contains(&before) || before.ends_with("   ");
    let subcommand = line[at..].split_whitespace().nth(1)?;
    (is_command && subcommand.starts_with(|c: char| c.is_ascii_lowercase() || c == '-')).then(|| &line[at..])
}

/// Whether the program, or its laboratory, takes a command.
fn parse(words: &[String]) -> Result<(), clap::Error> {
    match words[0].as_str() {
        "sizeup-lab" => Lab::try_parse_from(words).map(drop),
        _ => Cli::try_parse_from(words).map(drop),
    }
}

/// The words of a command as a shell would part them, up to a comment, a remark in the next column, or another command.
fn words(command: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let (mut word, mut quote, mut blanks) = (None::<String>, None::<char>, 0);
    for c in command.chars() {
        if quote == Some(c) {
            quote = None;
        } else if quote.is_some() {
            word.get_or_insert_default().push(c);
        } else if c == '\'' || c == '"' {
            quote = Some(c);
            word.get_or_insert_default();
        } else if c.is_whitespace() {
            words.extend(word.take());
            blanks += 1;
            if blanks >= 3 {
                break;
            }
            continue;
        } else if c == '>' && word.as_deref().is_none_or(|word| word == "2") {
            word = None;
            break;
        } else if (word.is_none() && "#|&".contains(c)) || c == ';' {
            break;
        } else {
            word.get_or_insert_default().push(c);
        }
        blanks = 0;
    }
    words.extend(word);
    words.retain(|word| !word.starts_with('$'));
    words
}

#[test]
fn words_are_those_of_a_shell() {
    let of = |text: &str| words(text).join("|");
    assert_eq!(of("sizeup run a.toml --set 'x={y=\"z w\"}' # why"), "sizeup|run|a.toml|--set|x={y=\"z w\"}");
    assert_eq!(of("sizeup run a.toml 2> log.jsonl"), "sizeup|run|a.toml");
    assert_eq!(of("sizeup export a b.csv          or .gpkg"), "sizeup|export|a|b.csv");
    assert_eq!(command_in("sizeup turns a flight into a city").map(|c| words(c)[1].clone()).as_deref(), Some("turns"));
}

#[test]
fn every_command_of_the_documents_is_one_that_the_program_takes() {
    let mut n = 0;
    let mut wrong = Vec::new();
    for document in documents().iter().filter(|document| document.name != "docs/reference.md") {
        for (line, words) in document.commands() {
            n += 1;
            if let Err(e) = parse(&words)
                && !matches!(e.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion)
            {
                wrong.push(format!("{}:{line}: {}\n{e}", document.name, words.join(" ")));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(n >= 70, "{n} commands were found");
}

#[test]
fn commands_within_sentences_name_what_there_is() {
    let (mut n, mut wrong) = (0, Vec::new());
    for document in documents() {
        for (line, language, text) in document.lines() {
            let quoted = text.split('`').skip(1).step_by(2).filter(|_| language.is_none());
            for command in
                quoted.filter(|quoted| ["sizeup ", "sizeup-lab "].iter().any(|program| quoted.starts_with(program)))
            {
                n += 1;
                let shown = command.split('…').next().unwrap_or_default();
                // What a sentence leaves out is no mistake; a command or an option that does not exist is.
                let faults = [ErrorKind::UnknownArgument, ErrorKind::InvalidSubcommand];
                let is_version = |word: &String| word.starts_with(|c: char| c.is_ascii_digit());
                let words = words(shown);
                if let Err(e) = parse(&words)
                    && faults.contains(&e.kind())
                    && !words.get(1).is_some_and(is_version)
                {
                    wrong.push(format!("{}:{line}: {command}\n{e}", document.name));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(n >= 50, "{n} commands were found");
}

/// Puts the keys of `more` where `table` lacks them.
fn fill(table: &mut Table, more: &Table) {
    for (key, value) in more {
        match (table.get_mut(key), value) {
            (Some(Value::Table(own)), Value::Table(more)) => fill(own, more),
            (Some(_), _) => {}
            (None, value) => drop(table.insert(key.clone(), value.clone())),
        }
    }
}

/// Loads what a document shows of a configuration, the rest of which it leaves to the reader.
fn load(shown: &Table) -> Result<(), String> {
    const REST: &str = "project.crs = 'EPSG:25832'\nsurvey.path = 'sparse'\n";
    const TERRAIN: [&str; 2] = ["", "terrain.constant_m = 0.0\n"];
    const FOOTPRINTS: [&str; 3] = [
        "",
        "footprints.path = 'a.gpkg'\n",
        "footprints = { source = 'masks', path = '{stem}.png', kind = 'instance' }\n",
    ];
    const PRIORS: [&str; 4] = [
        "",
        "prior.source = 'stereo'\n",
        "prior = { source = 'network', model = 'a.onnx', profile = 'da3-mono' }\n",
        "prior = { source = 'files', path = '{stem}.npy', kind = 'depth' }\n",
    ];
    let mut errors = Vec::new();
    for terrain in TERRAIN {
        for footprints in FOOTPRINTS {
            for prior in PRIORS {
                let mut whole = shown.clone();
                fill(&mut whole, &format!("{REST}{terrain}{footprints}{prior}").parse().unwrap());
                match RunConfig::from_text(&whole.to_string(), Path::new("a document"), &[]) {
                    Ok(_) => return Ok(()),
                    Err(e) => errors.push(e.to_string()),
                }
            }
        }
    }
    errors.sort();
    errors.dedup();
    Err(errors.join("\n"))
}

#[test]
fn every_configuration_of_the_documents_loads() {
    let (mut n, mut wrong) = (0, Vec::new());
    for document in documents() {
        for (line, text) in document.blocks("toml") {
            let shown: Result<Table, _> = text.parse();
            let loaded = match &shown {
                // The list of a network's training scenes, which the trainer reads.
                Ok(table) if table.contains_key("scene") => continue,
                Ok(table) => load(table),
                Err(e) => Err(e.to_string()),
            };
            n += 1;
            wrong.extend(loaded.err().map(|why| format!("{}:{line}: {why}", document.name)));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(n >= 20, "{n} configurations were found");
}

/// A heading's name in a link, as forges make it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn anchors(path: &Path) -> Vec<String> {
    let document = Document { name: String::new(), text: fs::read_to_string(path).unwrap() };
    let outside = document.lines().into_iter().filter(|(_, language, _)| language.is_none());
    let headings = outside.filter(|(_, _, line)| line.starts_with('#'));
    headings.map(|(_, _, line)| anchor(line.trim_start_matches('#'))).collect()
}

#[test]
fn every_link_and_picture_of_the_documents_is_there() {
    let (mut n, mut wrong) = (0, Vec::new());
    // Laboratory notes keep commands of their day; their links have to lead somewhere all the same.
    for document in documents().into_iter().chain(pages("lab")) {
        let own = root().join(&document.name);
        for (line, language, text) in document.lines() {
            let targets = text.split("](").skip(1).filter_map(|rest| rest.split_once(')').map(|(target, _)| target));
            for target in targets.filter(|target| language.is_none() && !target.contains("://")) {
                n += 1;
                let (path, heading) = target.split_once('#').unwrap_or((target, ""));
                let file: PathBuf = if path.is_empty() { own.clone() } else { own.parent().unwrap().join(path) };
                let is_there =
                    file.exists() && (heading.is_empty() || anchors(&file).iter().any(|anchor| anchor == heading));
                if !is_there {
                    wrong.push(format!("{}:{line}: {target}", document.name));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(n >= 80, "{n} links were found");
}

#[test]
fn every_pose_format_has_its_row_and_is_fuzzed() {
    let (survey, readers) = (read("docs/survey.md"), read("fuzz/src/readers.rs"));
    for (format, _) in Format::all() {
        let row = format!("| `{}` | ", format.name());
        assert!(survey.text.lines().any(|line| line.starts_with(&row)), "docs/survey.md has no row {row}");
        let reader = format!("Format::{format:?},");
        assert!(readers.text.contains(&reader), "fuzz/src/readers.rs has no reader of {reader}");
    }
}

#[test]
fn every_format_of_an_export_is_told_of_and_offered_in_qgis() {
    let command = Cli::command();
    let to = command.find_subcommand("export").unwrap().get_arguments().find(|argument| argument.get_id() == "to");
    let formats = to.unwrap().get_possible_values();
    let (how_to, plugin) = (read("docs/how-to/export.md"), read("qgis/sizeup/algorithms/export.py"));
    let commands: Vec<&str> = how_to.text.lines().filter(|line| line.contains("`sizeup export ")).collect();
    for format in &formats {
        let quoted = format!("\"{}\"", format.get_name());
        assert!(plugin.text.lines().any(|l| l.starts_with("FORMATS = ") && l.contains(&quoted)), "no {quoted} in QGIS");
        // Every run writes these two itself.
        if ["cityjson", "geopackage"].contains(&format.get_name()) {
            continue;
        }
        let help = format.get_help().unwrap().to_string();
        let asks = match help.rsplit_once(": .") {
            Some((_, extension)) => format!(".{extension}`"),
            None => format!("--to {}", format.get_name()),
        };
        assert!(
            commands.iter().any(|line| line.contains(&asks)),
            "docs/how-to/export.md has no `sizeup export` with {asks}"
        );
    }
    assert!(formats.len() >= 6, "{} formats", formats.len());
}

#[test]
fn the_reference_is_what_the_program_says_of_itself() {
    let program = env!("CARGO_BIN_EXE_sizeup");
    let written = Command::new("python3").arg(root().join("tools/reference.py")).arg(program).output();
    let Ok(written) = written else { return skip("python3 is not installed") };
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    let is_fresh = String::from_utf8(written.stdout).unwrap() == read("docs/reference.md").text;
    assert!(is_fresh, "docs/reference.md is out of date: run `tools/reference.py PROGRAM > docs/reference.md`");
}

/// Whether all that a command reads is in the scene, and it comes to an end by itself.
fn can_run(scene: &Scene, words: &[String]) -> bool {
    const ENDS: [&str; 6] = ["survey", "run", "evaluate", "check", "export", "footprints"];
    let is_output = |i: usize| ["--output", "--picture", "-o"].contains(&words[i - 1].as_str());
    let is_file = |word: &str| {
        let endings = [".toml", ".gpkg", ".geojson", ".json", ".jsonl", ".tif", ".laz", ".obj", ".xml", ".txt"];
        !word.contains('=') && (endings.iter().any(|ending| word.ends_with(ending)) || word.contains('/'))
    };
    let reads = || (2..words.len()).filter(|&i| !is_output(i) && is_file(&words[i]));
    words[0] == "sizeup"
        && ENDS.contains(&words[1].as_str())
        && reads().next().is_some()
        && reads().all(|i| scene.path(&words[i]).exists())
        && !words.iter().any(|word| word == "--tiled")
}

#[test]
fn the_commands_of_the_readme_and_the_tutorial_run_in_their_order() {
    let scene = Scene::with_page();
    let mut ran = Vec::new();
    for name in ["README.md", "docs/tutorial.md"] {
        for (line, words) in read(name).commands() {
            if can_run(&scene, &words) {
                let args: Vec<&str> = words[1..].iter().map(String::as_str).collect();
                let outcome = scene.sizeup(&args);
                assert!([0, 5].contains(&outcome.code), "{name}:{line}: {words:?}: {}", outcome.stderr);
                ran.push(words.join(" "));
            }
        }
    }
    for wanted in ["sizeup run sizeup.toml", "sizeup survey inspect --config sizeup.toml"] {
        assert!(ran.iter().any(|command| command == wanted), "{wanted} is not among {ran:?}");
    }
    assert!(scene.path("result/report.html").is_file(), "what the README says to look at");
}
