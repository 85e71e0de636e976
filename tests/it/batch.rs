//! Cities through real engines: Snakemake on this machine, and through a real Slurm. Skipped where they are not installed
//! (`make deps-batch`; Debian's slurm-wlm and munge).

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use crate::tiles::{SIZE, assert_same, ids, results, undisturbed};
use crate::tiny_scene::Scene;

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn snakemake() -> Option<PathBuf> {
    let found = repository("target/batch/bin/snakemake");
    if found.exists() {
        return Some(found);
    }
    println!("skipped: no Snakemake here (make deps-batch)");
    None
}

/// A city of the scene by Snakemake, with a profile and more options.
fn engine(snakemake: &Path, scene: &Scene, profile: &str, more: &[&str]) -> Command {
    let mut command = Command::new(snakemake);
    // Its notes about itself stay in the scene's folder.
    command.current_dir(scene.path("")).env("HOME", scene.path("")).env("XDG_CACHE_HOME", scene.path("cache"));
    command.arg("--snakefile").arg(repository("workflows/Snakefile"));
    command.arg("--profile").arg(repository(&format!("workflows/profiles/{profile}")));
    command.args(more).args(["--config", "run=sizeup.toml", "output=city", "merge=--heights ellipsoidal"]);
    command.arg(format!("cut=--size {SIZE}")).arg(format!("sizeup={}", env!("CARGO_BIN_EXE_sizeup")));
    command.stdin(Stdio::null());
    command
}

fn assert_success(output: &Output) {
    let text = [&output.stdout[..], &output.stderr[..]].concat();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&text));
}

const LOCAL: [&str; 4] = ["--cores", "2", "--resources", "mem_mb=2000"];

#[test]
fn snakemake_makes_the_city_and_has_nothing_to_do_the_second_time() {
    let Some(snakemake) = snakemake() else { return };
    let scene = Scene::new();
    let expected = undisturbed(&scene);
    assert_success(&engine(&snakemake, &scene, "local", &LOCAL).output().unwrap());
    let made = results(&scene, "city");
    let of_tiles = |name: &str| !name.starts_with(".snakemake");
    let made = made.into_iter().filter(|(name, _)| of_tiles(name)).collect();
    assert_same(&expected, &made);
    let again = engine(&snakemake, &scene, "local", &LOCAL).output().unwrap();
    assert_success(&again);
    let said = [&again.stdout[..], &again.stderr[..]].concat();
    assert!(String::from_utf8_lossy(&said).contains("Nothing to be done"), "{}", String::from_utf8_lossy(&said));
}

#[test]
fn an_engine_that_is_killed_goes_on_where_it_was() {
    let Some(snakemake) = snakemake() else { return };
    let scene = Scene::new();
    let expected = undisturbed(&scene);
    let engine_of = |more: &[&str]| engine(&snakemake, &scene, "local", &[&LOCAL[..], more].concat());
    let mut child = engine_of(&[]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    // Until the first tile is done: then the others are under way or waiting.
    let is_any_done = || {
        let files = scene.files("city/tiles");
        files.iter().any(|path| path.to_string_lossy().ends_with(".done.json"))
    };
    while !is_any_done() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    // A child of the killed engine may still be writing: the tile's lock orders them.
    assert_success(&engine_of(&["--unlock"]).output().unwrap());
    assert_success(&engine_of(&[]).output().unwrap());
    assert_same(&expected, &results(&scene, "city"));
}

/// A Slurm of our own, ended on drop.
struct Slurm {
    folder: PathBuf,
}

impl Slurm {
    fn start(scene: &Scene) -> Option<Self> {
        let folder = scene.path("slurm");
        let started = Command::new(repository("tests/slurm/start.sh")).arg(&folder).output().unwrap();
        if started.status.success() {
            return Some(Self { folder });
        }
        let why = String::from_utf8_lossy(&started.stderr).into_owned();
        println!("skipped: no Slurm here: {}", why.lines().next().unwrap_or("it does not start"));
        None
    }

    fn conf(&self) -> PathBuf {
        self.folder.join("slurm.conf")
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        let _ = Command::new(repository("tests/slurm/stop.sh")).arg(&self.folder).status();
    }
}

#[test]
fn a_real_slurm_runs_the_tiles_of_snakemake() {
    let Some(snakemake) = snakemake() else { return };
    let scene = Scene::new();
    let expected = undisturbed(&scene);
    let Some(slurm) = Slurm::start(&scene) else { return };
    let more = [
        "--default-resources",
        "slurm_partition=batch",
        "runtime=10",
        "--slurm-status-command",
        "squeue",
        "--slurm-init-seconds-before-status-checks",
        "2",
        "--latency-wait",
        "5",
        "--retries",
        "0",
    ];
    let path = format!("{}:{}", slurm.folder.join("bin").display(), std::env::var("PATH").unwrap());
    let mut command = engine(&snakemake, &scene, "slurm", &more);
    let output = command.env("SLURM_CONF", slurm.conf()).env("PATH", path).output().unwrap();
    assert_success(&output);
    let said = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    let n_submitted = said.matches("has been submitted with SLURM jobid").count();
    assert_eq!(n_submitted, ids(&scene).len(), "every tile is a job: {said}");
    assert_same(&expected, &results(&scene, "city"));
}

#[test]
fn a_slurm_array_runs_the_tiles_without_an_engine() {
    let scene = Scene::new();
    let expected = undisturbed(&scene);
    let Some(slurm) = Slurm::start(&scene) else { return };
    let sent = Command::new(repository("workflows/slurm/submit.sh"))
        .current_dir(scene.path(""))
        .args(["sizeup.toml", "city", "--partition=batch"])
        .env("SLURM_CONF", slurm.conf())
        .env("SIZEUP", env!("CARGO_BIN_EXE_sizeup"))
        .env("CUT", format!("--size {SIZE}"))
        .output()
        .unwrap();
    assert_success(&sent);
    let is_over = || {
        let args = ["--noheader", "--states=all", "--format=%T"];
        let told = Command::new("squeue").args(args).env("SLURM_CONF", slurm.conf()).output().unwrap();
        let told = String::from_utf8_lossy(&told.stdout).into_owned();
        told.lines().all(|state| !["PENDING", "RUNNING", "COMPLETING", "CONFIGURING"].contains(&state.trim()))
    };
    let is_merged = || scene.path("city/city.done.json").exists();
    while !(is_merged() || is_over()) {
        std::thread::sleep(Duration::from_millis(200));
    }
    let log = || fs::read_to_string(scene.path("city/logs/merge.log")).unwrap_or_default();
    assert!(is_merged(), "{}", log());
    let of_tiles = |files: std::collections::BTreeMap<String, Vec<u8>>| {
        files.into_iter().filter(|(name, _)| name.starts_with("tiles/")).collect()
    };
    assert_same(&of_tiles(expected), &of_tiles(results(&scene, "city")));
}
