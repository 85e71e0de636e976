//! The command line: what it prints where, and which exit code it ends with.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::process::{Command as Process, Stdio};

use serde_json::Value;
use sizeup::issue::{Issue, Severity};

use crate::tiny_scene::{N_BUILDINGS, Outcome, Scene, sizeup};

fn outcome(args: &[&str]) -> Outcome {
    sizeup().args(args).output().unwrap().into()
}

#[test]
fn help_of_every_subcommand_reads_well() {
    let overview = outcome(&["--help"]);
    assert_eq!((overview.code, &*overview.stderr), (0, ""));
    let commands = ["init", "run", "footprints", "evaluate", "changes", "check", "view", "demo", "schema"];
    for command in commands {
        // What only programs and shells ask for is not in the way of people.
        assert!(
            command == "schema" || overview.stdout.lines().any(|line| line.trim_start().starts_with(command)),
            "{}",
            overview.stdout
        );
        let help = outcome(&[command, "--help"]);
        assert_eq!((help.code, &*help.stderr), (0, ""));
        assert!(help.stdout.contains(&format!("Usage: sizeup {command}")), "{}", help.stdout);
        for line in help.stdout.lines() {
            assert!(line.chars().count() <= 120, "{command}: a line too long for a terminal: {line}");
        }
        // No option without a word about it: each is followed by text on its line or on the next.
        let lines: Vec<&str> = help.stdout.lines().take_while(|line| !line.starts_with("Examples:")).collect();
        for (i, line) in lines.iter().enumerate().filter(|(_, line)| line.trim_start().starts_with("--")) {
            let is_explained =
                line.trim_start().contains("  ") || lines.get(i + 1).is_some_and(|l| l.starts_with("   "));
            assert!(is_explained, "{command}: {line}");
        }
    }
    assert!(outcome(&["run", "--help"]).stdout.contains("Examples:"));
}

#[test]
fn a_call_without_arguments_shows_the_help_and_is_a_usage_error() {
    let bare = outcome(&[]);
    assert_eq!((bare.code, &*bare.stdout), (2, ""));
    assert!(bare.stderr.contains("Usage: sizeup"));
    let unknown = outcome(&["measure"]);
    assert_eq!((unknown.code, &*unknown.stdout), (2, ""));
    assert!(unknown.stderr.contains("measure"));
}

#[test]
fn a_command_of_the_laboratory_is_a_usage_error_with_a_hint() {
    for command in ["baseline", "benchmark", "simulate"] {
        let overview = outcome(&["--help"]).stdout;
        assert!(!overview.lines().any(|line| line.trim_start().starts_with(command)), "{overview}");
        let refused = outcome(&[command, "--output", "out"]);
        assert_eq!((refused.code, &*refused.stdout), (2, ""));
        assert!(refused.stderr.contains(&format!("`sizeup-lab {command}`")), "{}", refused.stderr);
    }
}

#[test]
fn a_misspelt_subcommand_and_a_misspelt_flag_are_answered_with_the_right_one() {
    for (args, meant) in [
        (&["rnu"][..], "'run'"),
        (&["footprint"], "'footprints'"),
        (&["tiles", "pln"], "'plan'"),
        (&["run", "--outptu", "x"], "'--output'"),
        (&["run", "--until", "heigths"], "'heights'"),
    ] {
        let told = outcome(args);
        assert_eq!((told.code, &*told.stdout), (2, ""));
        assert!(told.stderr.contains("similar") && told.stderr.contains(meant), "{args:?}: {}", told.stderr);
    }
}

#[test]
fn commands_take_the_configuration_that_lies_beside_them() {
    let scene = Scene::new();
    let ran = scene.sizeup(&["run"]);
    assert!([0, 5].contains(&ran.code), "{}", ran.stderr);
    let view = scene.stems().into_iter().find(|stem| stem.contains("oblique")).unwrap();
    let looked = scene.sizeup(&["view", "--photo", &view, "--output", "panel.png"]);
    assert!(looked.code == 0 && scene.path("panel.png").exists(), "{}", looked.stderr);
    let named = scene.sizeup(&["view", "sizeup.toml", "--photo", &view, "--output", "again.png"]);
    assert!(named.code == 0 && scene.path("again.png").exists(), "{}", named.stderr);
    let of_result = scene.sizeup(&["view", "result", "--photo", &view, "--output", "third.png"]);
    assert!(of_result.code == 0 && scene.path("third.png").exists(), "{}", of_result.stderr);
    assert_eq!(fs::read(scene.path("panel.png")).unwrap(), fs::read(scene.path("third.png")).unwrap());
    let checked = scene.sizeup(&["check"]);
    assert!(checked.stdout.contains("footprints.gpkg"), "it looks at the configuration too: {}", checked.stdout);

    let elsewhere = tempfile::tempdir().unwrap();
    let bare =
        |args: &[&str]| -> Outcome { sizeup().current_dir(elsewhere.path()).args(args).output().unwrap().into() };
    let photo = ["view", "--photo", "a", "--output", "a.png"];
    for args in [&["run"][..], &["run", "--tiled"], &photo, &["footprints"], &["tiles", "plan"]] {
        let told = bare(args);
        assert_eq!((told.code, &*told.stdout), (2, ""));
        for word in ["there is no sizeup.toml in this folder", "hint: `sizeup init FOLDER`"] {
            assert!(told.stderr.contains(word), "{args:?}: {}", told.stderr);
        }
    }
    assert_eq!(bare(&["check"]).code, 0, "the machine needs no configuration");
}

#[test]
fn the_version_goes_to_stdout() {
    let version = outcome(&["--version"]);
    assert_eq!((version.code, version.stdout.trim()), (0, concat!("sizeup ", env!("CARGO_PKG_VERSION"))));
}

#[test]
fn talk_goes_to_stderr_and_data_to_stdout() {
    let scene = Scene::new();
    let talking = scene.run(&[]);
    assert!([0, 5].contains(&talking.code), "{}", talking.stderr);
    assert_eq!(talking.stdout, "");
    assert!(talking.stderr.contains(&format!("{N_BUILDINGS} buildings")), "{}", talking.stderr);

    let quiet = scene.run(&["--quiet", "--json", "--from", "output"]);
    assert_eq!(quiet.stderr, "");
    let summary: Value = serde_json::from_str(&quiet.stdout).unwrap();
    assert_eq!(summary["n_buildings"], N_BUILDINGS);
    let statuses = summary["by_status"].as_object().unwrap();
    assert_eq!(statuses.values().filter_map(Value::as_u64).sum::<u64>(), N_BUILDINGS as u64);
    let n_failed: u64 = ["unknown", "refused"].iter().filter_map(|s| statuses.get(*s)?.as_u64()).sum();
    assert_eq!(quiet.code == 5, n_failed > 0 || summary["n_refused"].as_u64().unwrap() > 0, "{summary}");

    let table = scene.sizeup(&["evaluate", "result/city.city.json", "truth.geojson"]);
    assert_eq!((table.code, &*table.stderr), (0, ""));
    assert!(table.stdout.lines().count() > 3, "{}", table.stdout);
    let json = scene.sizeup(&["evaluate", "result/city.gpkg", "truth.geojson", "--json"]);
    assert_eq!((json.code, &*json.stderr), (0, ""));
    let evaluation: Value = serde_json::from_str(&json.stdout).unwrap();
    assert_eq!(evaluation["counts"]["n_truth"], N_BUILDINGS);
}

#[test]
fn a_reader_that_leaves_early_is_no_failure() {
    let scene = Scene::new();
    assert!([0, 5].contains(&scene.run(&[]).code));
    // The pipe's other end is closed before the command writes.
    let mut child = Process::new(env!("CARGO_BIN_EXE_sizeup"))
        .args(["evaluate", "--json", "result/city.city.json", "truth.geojson"])
        .current_dir(scene.path(""))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let mut talk = String::new();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    while stderr.read_line(&mut talk).unwrap() > 0 {}
    assert!(child.wait().unwrap().success(), "{talk}");
    assert_eq!(talk, "");
}

#[test]
fn nobody_listening_to_the_talk_is_no_failure() {
    let scene = Scene::new();
    let mut child = Process::new(env!("CARGO_BIN_EXE_sizeup"))
        .args(["run", "sizeup.toml", "--until", "footprints"])
        .current_dir(scene.path(""))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stderr.take());
    assert!(child.wait().unwrap().success());
}

#[test]
fn the_issues_of_a_run_that_ends_with_the_footprints_come_by_weight_too() {
    let scene = Scene::new();
    scene.change_footprints(|features| {
        let rings = features[0]["geometry"]["coordinates"].as_array_mut().unwrap();
        let flat = vec![rings[0][0].clone(), rings[0][1].clone(), rings[0][0].clone(), rings[0][0].clone()];
        rings.push(flat.into());
        let last = features.last_mut().unwrap()["geometry"]["coordinates"][0].as_array_mut().unwrap();
        *last = vec![last[0].clone(), last[1].clone(), last[0].clone(), last[1].clone(), last[0].clone()];
    });
    assert_eq!(scene.run(&["--until", "footprints"]).code, 5);
    let issues: Vec<Issue> = serde_json::from_value(scene.json("result/issues.json")).unwrap();
    let severities: Vec<Severity> = issues.iter().map(|issue| issue.severity).collect();
    assert!(severities.contains(&Severity::Note) && severities.contains(&Severity::Refused), "{issues:?}");
    assert!(issues.is_sorted_by_key(Issue::weight), "{issues:?}");
}

#[test]
fn a_run_that_ends_early_leaves_the_results_of_an_earlier_one_as_they_are() {
    let scene = Scene::new();
    assert!([0, 5].contains(&scene.run(&[]).code));
    let files = ["issues.json", "summary.json", "timing.json", "lineage.json", "city.city.json"];
    let read = || files.map(|name| fs::read_to_string(scene.path("result").join(name)).unwrap());
    let before = read();
    scene.change_footprints(|features| {
        let last = features.last_mut().unwrap()["geometry"]["coordinates"][0].as_array_mut().unwrap();
        *last = vec![last[0].clone(), last[1].clone(), last[0].clone(), last[1].clone(), last[0].clone()];
    });
    let early = scene.run(&["--until", "footprints"]);
    assert_eq!(early.code, 5, "{}", early.stderr);
    assert!(early.stderr.contains("see stages/issues.json"), "{}", early.stderr);
    let issues: Vec<Issue> = serde_json::from_value(scene.json("result/stages/issues.json")).unwrap();
    assert!(issues.iter().any(|issue| issue.severity == Severity::Refused), "{issues:?}");
    assert_eq!(read(), before);
}

#[test]
fn a_misspelt_key_is_shown_in_its_line() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| text.replace("id_field =", "id_feild ="));
    for more in [&[][..], &["--set", "seed=3"]] {
        let refused = scene.run(more);
        assert_eq!((refused.code, &*refused.stdout), (2, ""));
        for word in ["sizeup.toml", "line ", "id_feild = \"id\"", "^", "`id_field`", "hint: "] {
            assert!(refused.stderr.contains(word), "{word:?} is missing in: {}", refused.stderr);
        }
    }
}

#[test]
fn a_setting_that_cannot_be_set_is_a_usage_error() {
    let scene = Scene::new();
    for (assignment, word) in [
        ("optimise.preset", "expected key=value"),
        ("optimise.presett=paper", "presett"),
        ("optimise.preset=papre", "papre"),
        ("seed.x=1", "`seed` is a value"),
        ("=1", "the key is empty"),
        ("seed=many", "many"),
    ] {
        let refused = scene.run(&["--set", assignment]);
        assert_eq!((refused.code, &*refused.stdout), (2, ""), "{assignment}: {}", refused.stderr);
        for word in [word, "--set", "hint: "] {
            assert!(refused.stderr.contains(word), "{word:?} is missing in: {}", refused.stderr);
        }
    }
    assert!(!scene.path("result").exists());
}

#[test]
fn a_configuration_that_is_not_there_is_named() {
    let refused = outcome(&["run", "nowhere.toml"]);
    assert_eq!((refused.code, &*refused.stdout), (2, ""));
    assert!(refused.stderr.contains("nowhere.toml"), "{}", refused.stderr);
}

#[test]
fn a_run_without_a_configuration_is_refused_with_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    let refused: Outcome = sizeup().current_dir(folder.path()).arg("run").output().unwrap().into();
    assert_eq!((refused.code, &*refused.stdout), (2, ""));
    assert!(refused.stderr.contains("`sizeup init FOLDER` writes one"), "{}", refused.stderr);
}

#[test]
fn artefacts_of_other_settings_are_refused() {
    let scene = Scene::new();
    assert_eq!(scene.run(&["--until", "footprints"]).code, 0);
    let other = scene.run(&["--from", "heights", "--set", "footprints.min_area_m2=5"]);
    assert_eq!(other.code, 3, "{}", other.stderr);
    let why = "stale: footprints.min_area_m2 is 5.0, was 1.0";
    for word in ["footprints.json", why, "hint: ", "--from footprints"] {
        assert!(other.stderr.contains(word), "{word:?} is missing in: {}", other.stderr);
    }
    let absent = scene.run(&["--from", "output"]);
    assert_eq!(absent.code, 3, "{}", absent.stderr);
    assert!(absent.stderr.contains("heights.json") && absent.stderr.contains("--from heights"), "{}", absent.stderr);
    assert!(!scene.path("result/city.city.json").exists());
    let backwards = scene.run(&["--from", "output", "--until", "survey"]);
    assert_eq!(backwards.code, 2, "{}", backwards.stderr);
    scene.assert_no_litter();
}

#[test]
fn artefacts_of_footprints_that_have_changed_are_refused() {
    let scene = Scene::new();
    scene.change_footprints(|_| {});
    assert_eq!(scene.run(&["--until", "footprints"]).code, 0);
    let mut layer = scene.json("footprints.geojson");
    layer["features"].as_array_mut().unwrap().remove(0);
    std::fs::write(scene.path("footprints.geojson"), layer.to_string()).unwrap();
    let other = scene.run(&["--from", "heights"]);
    assert_eq!(other.code, 3, "{}", other.stderr);
    assert!(other.stderr.contains("footprints.geojson has changed"), "{}", other.stderr);
}

#[test]
fn artefacts_of_poses_priors_and_terrain_that_have_changed_are_refused() {
    let scene = Scene::new();
    assert!([0, 5].contains(&scene.run(&[]).code));
    let refused = |from: &str, why: &str, again: &str| {
        let other = scene.run(&["--from", from]);
        assert_eq!(other.code, 3, "{why}: {}", other.stderr);
        for word in [why, "stale: ", &format!("--from {again}")] {
            assert!(other.stderr.contains(word), "{word:?} is missing in: {}", other.stderr);
        }
    };
    assert!([0, 5].contains(&scene.run(&["--from", "output"]).code), "nothing has changed");
    let refinement = scene.run(&["--from", "output", "--set", "refinement.long_side_px=900"]);
    assert!(refinement.stderr.contains("stale: refinement.long_side_px is 900, was 2000"), "{}", refinement.stderr);
    // A prior, with the time of before, as copying tools keep it.
    let stem = scene.stems().into_iter().find(|stem| stem.contains("oblique")).unwrap();
    let prior = scene.path(&format!("priors/{stem}.npy"));
    let (bytes, time) = (std::fs::read(&prior).unwrap(), std::fs::metadata(&prior).unwrap().modified().unwrap());
    let mut other = bytes.clone();
    *other.last_mut().unwrap() ^= 1;
    std::fs::write(&prior, other).unwrap();
    std::fs::File::options().append(true).open(&prior).unwrap().set_modified(time).unwrap();
    refused("output", &format!("priors/{stem}.npy has changed"), "heights");
    std::fs::remove_file(&prior).unwrap();
    refused("output", &format!("priors/{stem}.npy is gone"), "heights");
    std::fs::write(&prior, bytes).unwrap();
    assert!([0, 5].contains(&scene.run(&["--from", "output"]).code), "as it was");
    // What lies beside the terrain is read with it, unless it is statistics alone.
    let holes = "<PAMDataset><PAMRasterBand band=\"1\"><NoDataValue>-1</NoDataValue></PAMRasterBand></PAMDataset>";
    std::fs::write(scene.path("dtm.tif.aux.xml"), holes).unwrap();
    refused("heights", "dtm.tif.aux.xml is new", "footprints");
    scene.edit("sparse/images.txt", |text| text.replacen("# ", "#  ", 1));
    refused("footprints", "sparse/images.txt has changed", "survey");
}

#[test]
fn evaluating_what_cannot_be_compared_is_bad_input() {
    let scene = Scene::new();
    let absent = scene.sizeup(&["evaluate", "nothing.city.json", "truth.geojson"]);
    assert_eq!((absent.code, &*absent.stdout), (3, ""));
    assert!(absent.stderr.contains("nothing.city.json"), "{}", absent.stderr);
    let usage = scene.sizeup(&["evaluate", "truth.geojson", "truth.geojson", "--crs", "EPSG:99999999"]);
    assert_eq!(usage.code, 2, "{}", usage.stderr);
}

#[test]
fn simulating_nonsense_is_a_usage_error() {
    let scene = Scene::new();
    for set in ["town.n_buildings=0", "camera.width_px=3", "flight.patern=free"] {
        let refused = scene.lab(&["simulate", "--output", "out", "--set", set]);
        assert_eq!((refused.code, &*refused.stdout), (2, ""), "{set}: {}", refused.stderr);
        assert!(!scene.path("out").exists());
    }
}

#[test]
fn a_wrong_tag_of_the_priors_is_told() {
    let scene = Scene::new();
    assert!(matches!(scene.run(&[]).code, 0 | 5));
    assert!(scene.issues("prior_looks_inverted").is_empty(), "the right tag raises no doubt");
    scene.edit("sizeup.toml", |text| text.replace("kind = \"inverse_depth\"", "kind = \"depth\""));
    let refused = scene.run(&["--set", "seed=2"]);
    assert_eq!(refused.code, 3, "{}", refused.stderr);
    assert!(refused.stderr.contains("inverted") && !refused.stderr.contains("tracing rays"), "{}", refused.stderr);
    assert!(scene.issues("prior_looks_inverted").is_empty(), "the results are those of before");
}
