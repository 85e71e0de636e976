//! Same input, same bytes: on one thread and on several.

use std::fs;
use std::path::{Path, PathBuf};

use sizeup::config::RunConfig;
use sizeup::pipeline::{self, RunOptions, Stage};

use crate::tiny_scene::{N_BUILDINGS, Scene, lab, sizeup};

/// Every result by its name.
fn read_results(scene: &Scene) -> Vec<(String, Vec<u8>)> {
    let root = scene.path("result");
    let name = |path: &Path| path.strip_prefix(&root).unwrap().to_string_lossy().into_owned();
    // How long it took is no result, nor when files changed.
    let is_result = |path: &PathBuf| !path.ends_with("timing.json") && !path.ends_with("stages/hashes.json");
    let files = scene.files("result").into_iter().filter(is_result);
    files.map(|path| (name(&path), fs::read(&path).unwrap())).collect()
}

fn assert_same(one: &[(String, Vec<u8>)], other: &[(String, Vec<u8>)]) {
    let names = |results: &[(String, Vec<u8>)]| results.iter().map(|r| r.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(one), names(other));
    for ((name, a), (_, b)) in one.iter().zip(other) {
        assert!(a == b, "{name} differs");
    }
}

/// Blanks the number of threads, one digit, wherever the command is quoted.
fn without_threads(mut results: Vec<(String, Vec<u8>)>) -> Vec<(String, Vec<u8>)> {
    const QUOTED: &[u8] = b"--threads ";
    for (_, bytes) in &mut results {
        let places: Vec<usize> = (0..bytes.len()).filter(|&i| bytes[i..].starts_with(QUOTED)).collect();
        for at in places {
            bytes[at + QUOTED.len()] = b'N';
        }
    }
    results
}

#[test]
fn a_run_writes_the_same_bytes_on_one_thread_and_on_three() {
    let scene = Scene::with_page();
    for preset in ["optimise.preset=robust", "optimise.preset=paper"] {
        let run = |threads: &str| {
            let outcome = scene.run(&["--threads", threads, "--set", preset, "--set", "output.pictures=true"]);
            assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
            let results = without_threads(read_results(&scene));
            fs::remove_dir_all(scene.path("result")).unwrap();
            results
        };
        let one = run("1");
        for name in ["city.city.json", "city.gpkg", "issues.json", "summary.json", "lineage.json", "config.toml"] {
            assert!(one.iter().any(|(found, _)| found == name), "{name} is missing");
        }
        assert_same(&one, &run("3"));
    }
}

/// Some of the stages, with the same word for the command each time: the results quote it.
fn run_stages(scene: &Scene, from: Stage, until: Stage) {
    let config = RunConfig::load(&scene.path("sizeup.toml"), &[]).unwrap();
    let options = RunOptions { from, until, command: "test".to_owned() };
    pipeline::run(&config, &options, &|_| {}).unwrap();
}

#[test]
fn stages_run_one_by_one_write_the_bytes_of_a_single_run() {
    let scene = Scene::with_page();
    run_stages(&scene, Stage::Survey, Stage::Output);
    let whole = read_results(&scene);
    run_stages(&scene, Stage::Output, Stage::Output);
    assert_same(&whole, &read_results(&scene));

    fs::remove_dir_all(scene.path("result")).unwrap();
    run_stages(&scene, Stage::Survey, Stage::Footprints);
    assert!(!scene.path("result/city.gpkg").exists(), "nothing is written before the output stage");
    run_stages(&scene, Stage::Heights, Stage::Output);
    assert_same(&whole, &read_results(&scene));
}

#[test]
fn a_result_runs_again_from_its_own_configuration_where_it_was_moved_to() {
    let scene = Scene::with_page();
    run_stages(&scene, Stage::Survey, Stage::Output);
    let whole = read_results(&scene);
    let elsewhere = tempfile::tempdir().unwrap();
    let moved = elsewhere.path().join("moved");
    fs::rename(scene.path(""), &moved).unwrap();

    // Looked at from here, under its new name: the settings are those of the run.
    let look = |config: &str| {
        let mut command = sizeup();
        command
            .args(["view", "--quiet"])
            .arg(moved.join(config))
            .args(["--photo", "oblique", "--output"])
            .arg(moved.join("panel.png"));
        command.assert().success();
    };
    look("sizeup.toml");
    look("result/config.toml");

    let config = RunConfig::load(&moved.join("result/config.toml"), &[]).unwrap();
    let options = RunOptions { from: Stage::Survey, until: Stage::Output, command: "test".to_owned() };
    pipeline::run(&config, &options, &|_| {}).unwrap();
    for (name, bytes) in &whole {
        assert!(fs::read(moved.join("result").join(name)).unwrap() == *bytes, "{name} differs");
    }
    // Results elsewhere find the same input, by its full path.
    let mut config = RunConfig::load(&moved.join("sizeup.toml"), &[]).unwrap();
    let far_away = tempfile::tempdir().unwrap();
    config.project.output = far_away.path().join("result");
    pipeline::run(&config, &options, &|_| {}).unwrap();
    let far = RunConfig::load(&config.project.output.join("config.toml"), &[]).unwrap();
    assert_eq!(far.survey.path, moved.join("sparse"));
    assert_eq!(far.project.output, config.project.output);
}

#[test]
fn a_simulated_scene_is_the_same_from_the_command_line_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = |threads: &str| {
        let out = folder.path().join(threads);
        let n_buildings = format!("town.n_buildings={N_BUILDINGS}");
        let settings =
            [&*n_buildings, "flight.n_views=6", "camera.width_px=128", "camera.height_px=96", "prior.longest_px=64"];
        let mut command = lab();
        command.args(["simulate", "--quiet", "--threads", threads, "--preset", "village", "--output"]).arg(&out);
        for setting in settings {
            command.args(["--set", setting]);
        }
        command.assert().success().stdout("").stderr("");
        out
    };
    let (one, three) = (simulate("1"), simulate("3"));
    let mut n_files = 0;
    let mut folders = vec![one.clone()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.strip_prefix(&one).unwrap();
            assert!(fs::read(&path).unwrap() == fs::read(three.join(name)).unwrap(), "{} differs", name.display());
            n_files += 1;
        }
    }
    assert!(n_files > 15, "{n_files}");
}
