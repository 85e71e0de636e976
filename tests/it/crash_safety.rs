//! A file is the old one or the whole new one: when the disk is full, when the program is killed, and when several
//! write at once.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};

use geo::Translate as _;
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::read::{FoundBuildings, ReadOptions};

use crate::outputs::town;
use crate::skipped::skip;
use crate::tiny_scene::Scene;

const FORMATS: [&str; 4] = ["out.city.json", "out.city.jsonl", "out.gpkg", "out.fgb"];

/// A city to export, with names of its own, and more than the limits below allow.
fn input(folder: &Path, name: &str) -> PathBuf {
    let mut town = town();
    for i in 0..40 {
        let mut copy = town.records[2].clone();
        copy.id = format!("{name} {i}");
        copy.footprint = copy.footprint.map(|f| f.translate(100.0 * f64::from(i), 0.0));
        town.records.push(copy);
    }
    town.records.drain(..6);
    let path = folder.join(format!("{name}.city.json"));
    cityjson::write(&path, &town.model(), &CityJsonConfig::default()).unwrap();
    path
}

fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// An export under a limit of file size, in blocks of 1 KiB; without `trap` the system kills the writer.
fn export_limited(input: &Path, output: &Path, trap: &str, blocks: u32) -> ExitStatus {
    let script = format!("{trap} ulimit -f {blocks}; exec \"$@\"");
    Command::new("bash")
        .args(["-c", &script, "bash", env!("CARGO_BIN_EXE_sizeup"), "export"])
        .args([input, output])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .unwrap()
}

/// An export over an old file that ends as `trap` has it: what came of it, and the names beside the output.
fn exports_over_an_old_file(trap: &str) -> Vec<(&'static str, ExitStatus, Vec<String>)> {
    let folder = tempfile::tempdir().unwrap();
    let input = input(folder.path(), "a");
    let export = |name| {
        let results = folder.path().join("results").join(name);
        std::fs::create_dir_all(&results).unwrap();
        let output = results.join(name);
        std::fs::write(&output, "the old file").unwrap();
        let status = export_limited(&input, &output, trap, 4);
        assert_eq!(std::fs::read_to_string(&output).unwrap(), "the old file", "{name}");
        (name, status, names_in(&results))
    };
    FORMATS.into_iter().map(export).collect()
}

#[test]
fn a_write_that_fails_leaves_the_old_file_and_no_litter() {
    for (name, status, names) in exports_over_an_old_file("trap '' XFSZ;") {
        assert_eq!((status.code(), names), (Some(4), vec![name.to_owned()]));
    }
}

#[test]
fn a_writer_that_is_killed_leaves_the_old_file() {
    for (name, status, names) in exports_over_an_old_file("") {
        // By a signal: it could not tidy up.
        assert_eq!(status.code(), None, "{name}: {names:?}");
    }
}

/// Every file of a folder with its bytes.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else {
            found.push((path.clone(), std::fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

#[test]
fn a_tileset_stays_whole_when_its_next_writer_fails_or_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| input(folder.path(), name));
    let tiles = folder.path().join("tiles");
    let export = |input: &Path, limit: &str| {
        Command::new("bash")
            .args(["-c", &format!("{limit} exec \"$@\""), "bash", env!("CARGO_BIN_EXE_sizeup"), "export"])
            .args([input, &tiles])
            .args(["--to", "3dtiles", "--geoid-height", "43"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .unwrap()
    };
    assert!(export(&a, "").success());
    let before = contents(&tiles);
    for limit in ["trap '' XFSZ; ulimit -f 4;", "ulimit -f 4;"] {
        assert!(!export(&b, limit).success(), "{limit}");
        assert_eq!(contents(&tiles), before, "{limit}");
    }
    assert!(export(&b, "").success());
    assert_ne!(contents(&tiles), before);
}

#[test]
fn a_full_disk_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let input = input(folder.path(), "a");
    let disk = folder.path().join("disk");
    std::fs::create_dir(&disk).unwrap();
    // A disk of our own in a namespace of our own: no rights are needed where the system allows such namespaces.
    let mount = format!("mount -t tmpfs -o size=16k none {}", disk.display());
    let in_namespace = |script: &str| {
        Command::new("unshare")
            .args(["--user", "--map-root-user", "--mount", "bash", "-c", &format!("{mount} && {script}")])
            .output()
    };
    if !in_namespace("true").is_ok_and(|o| o.status.success()) {
        skip("this system allows no disk of one's own");
        return;
    }
    for name in FORMATS {
        let output = disk.join(name);
        let script = format!(
            "echo the old file > {out}; {sizeup} export {input} {out}; echo code $?; cat {out}; ls -A {disk}",
            out = output.display(),
            sizeup = env!("CARGO_BIN_EXE_sizeup"),
            input = input.display(),
            disk = disk.display(),
        );
        let outcome = in_namespace(&script).unwrap();
        let stdout = String::from_utf8_lossy(&outcome.stdout).into_owned();
        let stderr = String::from_utf8_lossy(&outcome.stderr);
        assert_eq!(stdout.lines().collect::<Vec<_>>(), ["code 4", "the old file", name], "{name}: {stderr}");
        assert!(!stderr.contains("sqlite") && !stderr.contains("INSERT"), "plain words, no statements: {stderr}");
        let full = ["disk is full", "No space left"];
        assert!(full.iter().any(|words| stderr.contains(words)), "{name}: {stderr}");
    }
}

#[test]
fn the_next_export_sweeps_what_a_killed_one_left() {
    let folder = tempfile::tempdir().unwrap();
    let input = input(folder.path(), "a");
    for name in FORMATS {
        let results = folder.path().join("results").join(name);
        std::fs::create_dir_all(&results).unwrap();
        let output = results.join(name);
        assert!(!export_limited(&input, &output, "", 4).success());
        // GDAL writes a FlatGeobuf when all of it is known: there is nothing to leave behind before.
        let leaves_some = name != "out.fgb";
        assert_eq!(!names_in(&results).is_empty(), leaves_some, "{name}: a writer that is killed sweeps nothing");
        assert!(export_limited(&input, &output, "", 100_000).success());
        assert_eq!(names_in(&results), [name]);
    }
}

#[test]
fn results_whose_writer_did_not_come_to_its_end_are_marked_until_they_are_whole_again() {
    let scene = Scene::with_page();
    assert!([0, 5].contains(&scene.run(&[]).code));
    let mark = scene.path("result/UNFINISHED.txt");
    assert!(!mark.exists());
    // The city model fits the limit, the package, which has pages of its own, does not.
    let size = std::fs::metadata(scene.path("result/city.city.json")).unwrap().len();
    let script = format!("ulimit -f {}; exec \"$@\"", size.div_ceil(1024) + 8);
    let killed = Command::new("bash")
        .current_dir(scene.path(""))
        .args(["-c", &script, "bash", env!("CARGO_BIN_EXE_sizeup"), "run", "sizeup.toml", "--from", "output"])
        .args(["--set", "project.reference_date=2026-05-01"])
        .output()
        .unwrap();
    assert!(!killed.status.success());
    assert!(mark.exists(), "{}", String::from_utf8_lossy(&killed.stderr));
    let export = || scene.sizeup(&["export", "result/city.gpkg", "again.city.json"]).stderr;
    assert!(
        export().contains("warning: result/city.gpkg is not finished: these results may be of two runs"),
        "{}",
        export()
    );
    assert!([0, 5].contains(&scene.run(&[]).code));
    assert!(!mark.exists() && !export().contains("warning"));
}

/// Starts a command in the scene's folder and kills it as soon as something is there; whether it was still running.
fn kill_when(scene: &Scene, args: &[&str], is_there: impl Fn() -> bool) -> bool {
    let mut child = Command::new(env!("CARGO_BIN_EXE_sizeup"))
        .current_dir(scene.path(""))
        .args(args)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !is_there() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    // SIGKILL: nothing in the program gets to know.
    child.kill().unwrap();
    child.wait().unwrap().code().is_none()
}

#[test]
fn a_run_that_is_killed_before_it_replaces_anything_is_seen_beside_the_older_result() {
    let scene = Scene::with_page();
    assert!([0, 5].contains(&scene.run(&[]).code));
    let read = |name: &str| std::fs::read(scene.path(name)).unwrap();
    let mark = scene.path("result/UNFINISHED.txt");
    let written = |name: &str| std::fs::metadata(scene.path(name)).and_then(|file| file.modified()).unwrap();
    let (city, footprints) = (read("result/city.gpkg"), written("result/stages/footprints.json"));
    let again = ["run", "sizeup.toml", "--set", "seed=7"];
    assert!(kill_when(&scene, &again, || mark.exists()), "it was killed at its start");
    assert!(mark.exists() && written("result/stages/footprints.json") == footprints);
    let is_solving = || written("result/stages/footprints.json") != footprints;
    assert!(kill_when(&scene, &again, is_solving), "it was killed while it solved");
    assert!(mark.exists() && read("result/city.gpkg") == city);

    let told = scene.sizeup(&["check", "result/city.city.json"]);
    let expected = "warning: result/city.city.json is not finished: a run was started and has not come to its end";
    assert!(told.code == 0 && told.stderr.contains(expected), "{}", told.stderr);
    let told = scene.sizeup(&["check", "result/city.city.json", "--json", "--quiet"]);
    let told: serde_json::Value = serde_json::from_str(&told.stdout).unwrap();
    assert!(told["unfinished"].as_str().unwrap().contains("of an earlier one"), "{told}");
    // A run of which it is known why it failed leaves what it found.
    assert_eq!(scene.run(&["--set", "survey.path='nowhere'"]).code, 3);
    assert!(!mark.exists(), "the older result is whole");
    assert!(kill_when(&scene, &again, || mark.exists()));
    assert!([0, 5].contains(&scene.run(&["--set", "seed=7"]).code));
    assert!(!mark.exists());
    let told = scene.sizeup(&["check", "result/city.city.json", "--json"]);
    assert!(!told.stdout.contains("unfinished") && !told.stderr.contains("warning"), "{}", told.stderr);
}

#[test]
fn a_second_run_into_one_folder_is_refused_while_the_first_is_alive() {
    let scene = Scene::with_page();
    let mark = scene.path("result/UNFINISHED.txt");
    let mut first = Command::new(env!("CARGO_BIN_EXE_sizeup"))
        .current_dir(scene.path(""))
        .args(["run", "sizeup.toml", "--set", "seed=7"])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !mark.exists() && first.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let second = scene.run(&[]);
    assert!(first.try_wait().unwrap().is_none(), "the first is alive");
    assert_eq!(second.code, 4, "{}", second.stderr);
    let process = format!("process {} (`", first.id());
    for words in ["cannot write into result", &process, "still writing its results there", "hint: ", "--output"] {
        assert!(second.stderr.contains(words), "{words:?} is missing in: {}", second.stderr);
    }
    assert!(scene.run(&["--output", "other", "--until", "survey"]).code == 0, "another folder is free");
    assert!([0, 5].contains(&first.wait().unwrap().code().unwrap()));
    assert!(!mark.exists() && scene.path("result/city.gpkg").exists(), "the first has come to its end");
    assert!([0, 5].contains(&scene.run(&[]).code), "and then the second may");
}

#[test]
fn a_folder_that_cannot_be_written_and_a_full_disk_are_told_with_a_hint() {
    let scene = Scene::with_page();
    let disk = scene.path("disk");
    std::fs::create_dir(&disk).unwrap();
    let in_namespace = |options: &str, script: &str| {
        let mount = format!("mount -t tmpfs -o {options} none {}", disk.display());
        Command::new("unshare")
            .current_dir(scene.path(""))
            .args(["--user", "--map-root-user", "--mount", "bash", "-c", &format!("{mount} && {script}")])
            .output()
    };
    if !in_namespace("size=16k", "true").is_ok_and(|o| o.status.success()) {
        skip("this system allows no disk of one's own");
        return;
    }
    let sizeup = env!("CARGO_BIN_EXE_sizeup");
    let run = format!("{sizeup} run sizeup.toml --output disk/result");
    let init = format!("{sizeup} init . --output disk/town/sizeup.toml --ground 20");
    for (options, script, hint) in [
        ("ro", &run, "hint: you may not write there"),
        ("ro", &init, "hint: you may not write there"),
        ("size=16k", &run, "hint: the disk is full"),
        ("size=256k", &run, "hint: the disk is full"),
    ] {
        let outcome = in_namespace(options, script).unwrap();
        let stderr = String::from_utf8_lossy(&outcome.stderr);
        assert_eq!(outcome.status.code(), Some(4), "{options}: {stderr}");
        assert!(stderr.contains(hint) && stderr.contains("disk/"), "{options}: {stderr}");
    }
}

#[test]
fn several_writers_of_one_file_never_mix() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = [input(folder.path(), "a"), input(folder.path(), "b")];
    for name in FORMATS {
        let output = folder.path().join("together").join(name);
        let export = |i: usize| {
            Command::new(env!("CARGO_BIN_EXE_sizeup"))
                .args([Path::new("export"), &inputs[i % 2], &output])
                .stderr(Stdio::null())
                .spawn()
                .unwrap()
        };
        let writers: Vec<_> = (0..6).map(export).collect();
        for mut writer in writers {
            assert!(writer.wait().unwrap().success(), "{name}");
        }
        let found = FoundBuildings::read(&output, &ReadOptions::default()).unwrap().buildings;
        assert_eq!(found.len(), 40, "{name}");
        let first = &found[0].id[..1];
        assert!(found.iter().all(|b| b.id.starts_with(first)), "{name}");
    }
    assert_eq!(names_in(&folder.path().join("together")), ["out.city.json", "out.city.jsonl", "out.fgb", "out.gpkg"]);
}
