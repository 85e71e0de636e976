//! Cities through real engines: Snakemake on this machine, and through a real Slurm. Skipped where they are not installed
//! (`make deps-batch`; Debian's slurm-wlm and munge).

use std::fs::{self, File, FileTimes};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, SystemTime};

use crate::skipped::skip;
use crate::tiles::{SIZE, assert_same, heights, ids, merge, plan, results, undisturbed};
use crate::tiny_scene::{N_BUILDINGS, Scene};

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn snakemake() -> Option<PathBuf> {
    let found = repository("target/batch/bin/snakemake");
    if found.exists() {
        return Some(found);
    }
    skip("no Snakemake here (make deps-batch)");
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
fn skewed_clocks_give_snakemake_nothing_to_do() {
    let Some(snakemake) = snakemake() else { return };
    let scene = Scene::new();
    assert_success(&engine(&snakemake, &scene, "local", &LOCAL).output().unwrap());
    // As a node whose clock is a year behind would have written what is done, and one ahead what it was made from.
    let touch = |path: PathBuf, time: SystemTime| {
        File::options().append(true).open(path).unwrap().set_times(FileTimes::new().set_modified(time)).unwrap();
    };
    let year = Duration::from_secs(1 << 25);
    for path in scene.files("city").into_iter().filter(|path| path.extension().is_some_and(|e| e == "ok")) {
        touch(path, SystemTime::now() - year);
    }
    touch(scene.path("sizeup.toml"), SystemTime::now() + year);
    touch(scene.path("city/tiles.json"), SystemTime::now() + year);
    let again = engine(&snakemake, &scene, "local", &LOCAL).output().unwrap();
    assert_success(&again);
    let said = String::from_utf8_lossy(&[&again.stdout[..], &again.stderr[..]].concat()).into_owned();
    assert!(said.contains("Nothing to be done"), "{said}");
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

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned()
}

/// Greatest height of the merged city.
fn tallest_m(scene: &Scene) -> f64 {
    heights(&scene.path("city/city.city.jsonl")).values().filter_map(|(height_m, _)| *height_m).fold(0.0, f64::max)
}

#[test]
fn snakemake_notices_settings_footprints_and_priors_that_have_changed() {
    let Some(snakemake) = snakemake() else { return };
    let scene = Scene::new();
    scene.change_footprints(|_| {});
    let run = || {
        let output = engine(&snakemake, &scene, "local", &LOCAL).output().unwrap();
        assert_success(&output);
        said(&output)
    };
    run();
    let limit_m = (tallest_m(&scene) * 0.75).floor();
    // A setting.
    scene.edit("sizeup.toml", |text| {
        text.replace("[optimise]\n", &format!("[heights]\nmax_m = {limit_m:.1}\n\n[optimise]\n"))
    });
    let ran = run();
    assert_eq!(ran.matches("rule tile:").count(), ids(&scene).len(), "{ran}");
    assert!(tallest_m(&scene) <= limit_m, "{} m where {limit_m} m are looked for", tallest_m(&scene));
    assert!(run().contains("Nothing to be done"));
    // A building.
    let mut layer = scene.json("footprints.geojson");
    let gone = layer["features"].as_array_mut().unwrap().remove(2)["properties"]["id"].clone();
    fs::write(scene.path("footprints.geojson"), layer.to_string()).unwrap();
    run();
    let left = heights(&scene.path("city/city.city.jsonl"));
    assert!(left.len() == N_BUILDINGS - 1 && !left.contains_key(gone.as_str().unwrap()), "{left:?}");
    assert!(run().contains("Nothing to be done"));
    // A prior: only the tiles that see it.
    let stem = scene.stems().into_iter().find(|stem| stem.contains("oblique")).unwrap();
    fs::write(scene.path(&format!("priors/{stem}.npy")), "not a prior").unwrap();
    assert!(run().contains("rule tile:"));
    let issues = fs::read_to_string(scene.path("city/issues.json")).unwrap();
    assert!(issues.contains("prior_unusable"), "{issues}");
    // A result that was damaged.
    let damaged = scene.path(&format!("city/tiles/{}/buildings.jsonl", ids(&scene)[0]));
    fs::write(&damaged, "not what was written").unwrap();
    assert_eq!(run().matches("rule tile:").count(), 1);
    assert!(run().contains("Nothing to be done"));
}

#[test]
fn snakemake_goes_on_in_a_folder_that_was_planned_by_hand() {
    let Some(snakemake) = snakemake() else { return };
    let scene = Scene::new();
    let expected = undisturbed(&scene);
    plan(&scene);
    assert_success(&engine(&snakemake, &scene, "local", &LOCAL).output().unwrap());
    assert_same(&expected, &results(&scene, "city"));
}

#[test]
fn a_tile_has_a_time_limit_on_slurm_also_where_a_partition_is_named() {
    let Some(snakemake) = snakemake() else { return };
    let scene = Scene::new();
    assert_success(&engine(&snakemake, &scene, "local", &LOCAL).output().unwrap());
    fs::remove_file(scene.path(&format!("city/tiles/{}.done.json", ids(&scene)[0]))).unwrap();
    let more = ["--default-resources", "slurm_partition=batch", "slurm_account=me", "--dry-run"];
    let told = said(&engine(&snakemake, &scene, "slurm", &more).output().unwrap());
    let resources = told.lines().find(|line| line.contains("resources:") && line.contains("mem_mb=")).expect(&told);
    assert!(resources.contains("runtime=240") && resources.contains("slurm_partition=batch"), "{told}");
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
        skip(&format!("no Slurm here: {}", why.lines().next().unwrap_or("it does not start")));
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
        .env("CUT", format!("--size {SIZE} --heights ellipsoidal"))
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
    assert_same(&of_tiles(expected), &of_tiles(results(&scene, "city")));
}

/// A program that `make deps-batch` installs.
fn of_batch(name: &str) -> Option<PathBuf> {
    let found = repository("target/batch/bin").join(name);
    if !found.exists() {
        skip(&format!("no {name} here (make deps-batch)"));
    }
    Some(found).filter(|path| path.exists())
}

/// The official schema, which refuses what it does not know.
fn validate(validator: &Path, job: &Path) -> Output {
    Command::new(validator).arg("--strict").arg(job).output().unwrap()
}

#[test]
fn the_job_for_kubernetes_follows_its_schema() {
    let Some(validator) = of_batch("kubernetes-validate") else { return };
    let job = repository("workflows/kubernetes/job.yaml");
    assert_success(&validate(&validator, &job));
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(job).unwrap();
    for (right, wrong) in [
        ("backoffLimitPerIndex: 2", "backoffLimitPerTile: 2"),
        ("completions: 64", "completions: all"),
        ("onExitCodes: {", "onExitCode: {"),
        ("values: [2, 3]", "values: [input]"),
    ] {
        let path = folder.path().join("job.yaml");
        assert!(text.contains(right));
        fs::write(&path, text.replace(right, wrong)).unwrap();
        assert!(!validate(&validator, &path).status.success(), "{wrong} passes");
    }
}

/// Results of the tiles, without those of the merge.
fn of_tiles(results: std::collections::BTreeMap<String, Vec<u8>>) -> std::collections::BTreeMap<String, Vec<u8>> {
    results.into_iter().filter(|(name, _)| name.starts_with("tiles/")).collect()
}

#[test]
fn the_pods_of_the_job_for_kubernetes_run_the_tiles() {
    let Some(python) = of_batch("python") else { return };
    let scene = Scene::new();
    let expected = undisturbed(&scene);
    let n = plan(&scene).len();
    let script = "import sys, yaml; job = yaml.safe_load(open(sys.argv[1])); \
                  print('\\n'.join(job['spec']['template']['spec']['containers'][0]['command']))";
    let told =
        Command::new(python).args(["-c", script]).arg(repository("workflows/kubernetes/job.yaml")).output().unwrap();
    assert_success(&told);
    let command = String::from_utf8(told.stdout).unwrap();
    let words: Vec<&str> = command.lines().collect();
    assert_eq!(words[..2], ["sh", "-c"]);
    assert!(words[2].contains(" /work/city "), "{command}");
    // The volume is mounted elsewhere here, and the image's program is ours.
    let line = words[2].replace("/work/city", &scene.path("city").display().to_string());
    let program = Path::new(env!("CARGO_BIN_EXE_sizeup")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let pod = |index: usize| {
        let mut pod = Command::new(words[0]);
        pod.args([words[1], &line]).env("PATH", &path).env("JOB_COMPLETION_INDEX", index.to_string());
        pod.output().unwrap()
    };
    (0..n).for_each(|index| assert_success(&pod(index)));
    // The job's rule for failures goes by these.
    assert_eq!(pod(n).status.code(), Some(2), "there is no tile {n}");
    let views = scene.path(&format!("city/tiles/{}/views.json", ids(&scene)[0]));
    let sound = fs::read(&views).unwrap();
    fs::write(&views, b"{\xff").unwrap();
    assert_eq!(pod(0).status.code(), Some(3), "the plan is damaged");
    fs::write(&views, sound).unwrap();
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    assert_same(&expected, &results(&scene, "city"));
}

#[test]
fn the_tasks_of_a_slurm_array_run_the_tiles_without_slurm_too() {
    let scene = Scene::new();
    let expected = undisturbed(&scene);
    let n = plan(&scene).len();
    let task = |index: usize| {
        let mut task = Command::new("bash");
        task.arg(repository("workflows/slurm/tile.sh")).arg(scene.path("city"));
        task.env("SIZEUP", env!("CARGO_BIN_EXE_sizeup")).env("SLURM_ARRAY_TASK_ID", index.to_string()).output().unwrap()
    };
    (0..n).for_each(|index| assert_success(&task(index)));
    assert_eq!(task(n).status.code(), Some(2), "there is no tile {n}");
    assert_same(&of_tiles(expected), &of_tiles(results(&scene, "city")));
}

/// Writes an executable script.
fn write_script(path: &Path, text: &str) {
    fs::write(path, text).unwrap();
    fs::set_permissions(path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
}

#[test]
fn a_slurm_array_has_the_memory_of_its_tiles_and_a_second_one_tries_them_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // A plan of five tiles, and a Slurm that only writes down what it is sent.
    let tile = |number: usize, mb: usize| format!("{number}\ttile\t9 buildings\t9 views\t{mb} MB\twaiting\n");
    let todo: String = [(0, 900), (1, 117), (3, 230), (4, 1900), (7, 1700)].map(|(at, mb)| tile(at, mb)).concat();
    fs::write(path("todo"), todo).unwrap();
    write_script(&path("sizeup"), &format!("#!/bin/sh\n[ \"$2\" = plan ] || cat {}\n", path("todo").display()));
    let sent = path("sent");
    let sbatch = "#!/bin/sh\nprintf '%s\\t' \"$@\" >> SENT\necho >> SENT\nwc -l < SENT\n";
    write_script(&path("sbatch"), &sbatch.replace("SENT", &sent.display().to_string()));
    let submitted = Command::new(repository("workflows/slurm/submit.sh"))
        .args([path("sizeup.toml"), path("city")])
        .args(["--partition=batch"])
        .env("SIZEUP", path("sizeup"))
        .env("PATH", format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap()))
        .output()
        .unwrap();
    assert_success(&submitted);
    let sent = fs::read_to_string(sent).unwrap();
    let jobs: Vec<Vec<&str>> = sent.lines().map(|job| job.split_terminator('\t').collect()).collect();
    let expected: [&[&str]; 7] = [
        &["--array=1,3", "--mem=230M"],
        &["--array=1,3", "--mem=345M", "--dependency=afternotok:1", "--kill-on-invalid-dep=yes", "again"],
        &["--array=0,7", "--mem=1700M"],
        &["--array=0,7", "--mem=2550M", "--dependency=afternotok:3", "--kill-on-invalid-dep=yes", "again"],
        &["--array=4", "--mem=1900M"],
        &["--array=4", "--mem=2850M", "--dependency=afternotok:5", "--kill-on-invalid-dep=yes", "again"],
        &["--dependency=afterany:1:2:3:4:5:6", "--job-name=sizeup-merge"],
    ];
    assert_eq!(jobs.len(), expected.len(), "{sent}");
    for (job, words) in jobs.iter().zip(expected) {
        assert!(words.iter().all(|word| job.contains(word)), "{words:?} of {job:?}");
        assert!(job.contains(&"--partition=batch"), "{job:?}");
    }
}

#[test]
fn a_second_slurm_array_leaves_out_tiles_whose_input_is_unusable() {
    let scene = Scene::new();
    plan(&scene);
    let ids = ids(&scene);
    let n_tries = |id: &str| scene.json(&format!("city/tiles/{id}.try.json"))["n_tries"].clone();
    let failed_with = |id: &str, code: u8| {
        let attempt = serde_json::json!({ "tile": id, "n_tries": 1, "exit_code": code, "cause": "made up" });
        fs::write(scene.path(&format!("city/tiles/{id}.try.json")), attempt.to_string()).unwrap();
    };
    let again = || {
        let mut task = Command::new("bash");
        task.arg(repository("workflows/slurm/tile.sh")).arg(scene.path("city")).arg("again");
        task.env("SIZEUP", env!("CARGO_BIN_EXE_sizeup")).env("SLURM_ARRAY_TASK_ID", "0").output().unwrap()
    };
    for code in [2, 3] {
        failed_with(&ids[0], code);
        let refused = again();
        assert_eq!(refused.status.code(), Some(i32::from(code)), "{}", said(&refused));
        assert!(said(&refused).contains("is not tried again") && n_tries(&ids[0]) == 1, "{}", said(&refused));
    }
    failed_with(&ids[0], 4);
    assert_success(&again());
    assert!(scene.path(&format!("city/tiles/{}.done.json", ids[0])).exists());
    assert_success(&again());
}

/// What of Kubernetes' API Snakemake uses, as processes of this machine; ended on drop.
struct Kubernetes {
    api: std::process::Child,
    config: PathBuf,
}

impl Kubernetes {
    fn start(scene: &Scene, python: &Path) -> Self {
        let port_file = scene.path("port");
        // Pods find the program, Snakemake and its plugins as in an image that holds them: nothing is left to install.
        fs::create_dir(scene.path("image")).unwrap();
        fs::write(scene.path("image/pip"), "#!/bin/sh\nexit 0\n").unwrap();
        fs::set_permissions(scene.path("image/pip"), std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
        let path = [scene.path("image"), repository("target/batch/bin"), PathBuf::from(std::env::var("PATH").unwrap())];
        let path = path.map(|part| part.display().to_string()).join(":");
        let log = File::create(scene.path("pods.log")).unwrap();
        let mut api = Command::new(python);
        api.arg(repository("tests/kubernetes/api.py")).arg(&port_file).env("PATH", path).env("HOME", scene.path(""));
        let api = api.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log).spawn().unwrap();
        let config = scene.path("kubeconfig");
        let started = Self { api, config };
        while !port_file.exists() {
            std::thread::sleep(Duration::from_millis(50));
        }
        let server = format!("http://127.0.0.1:{}", fs::read_to_string(port_file).unwrap());
        let text = serde_json::json!({
            "apiVersion": "v1", "kind": "Config", "current-context": "here",
            "clusters": [{ "name": "here", "cluster": { "server": server } }],
            "contexts": [{ "name": "here", "context": { "cluster": "here", "user": "me" } }],
            "users": [{ "name": "me", "user": { "token": "none" } }],
        });
        fs::write(&started.config, text.to_string()).unwrap();
        started
    }
}

impl Drop for Kubernetes {
    fn drop(&mut self) {
        let _ = self.api.kill();
        let _ = self.api.wait();
    }
}

/// Without a cluster: the API that Snakemake talks to is ours, and its pods are processes. What they are told to do is real.
#[test]
fn the_profile_for_kubernetes_makes_the_city() {
    let (Some(snakemake), Some(python), Some(_)) = (snakemake(), of_batch("python"), of_batch("kubernetes-validate"))
    else {
        return;
    };
    if Command::new("rsync").arg("--version").output().is_err() {
        skip("no rsync here, which Snakemake's storage needs (make deps-batch)");
        return;
    }
    let scene = Scene::new();
    let expected = undisturbed(&scene);
    // Snakemake sends to the pods what lies below its folder.
    for file in ["Snakefile", "profiles/kubernetes/config.yaml"] {
        let copy = scene.path("workflows").join(file);
        fs::create_dir_all(copy.parent().unwrap()).unwrap();
        fs::copy(repository("workflows").join(file), copy).unwrap();
    }
    fs::create_dir(scene.path("storage")).unwrap();
    let kubernetes = Kubernetes::start(&scene, &python);
    let mut command = Command::new(snakemake);
    command.current_dir(scene.path("")).env("HOME", scene.path("")).env("XDG_CACHE_HOME", scene.path("cache"));
    command.args(["--snakefile", "workflows/Snakefile", "--profile", "workflows/profiles/kubernetes"]);
    command.args(["--retries", "0", "--latency-wait", "20", "--default-storage-prefix"]).arg(scene.path("storage"));
    command.args(["--config", "merge=--heights ellipsoidal"]).arg(format!("cut=--size {SIZE}"));
    let place = |key: &str, name: &str| format!("{key}={}", scene.path(name).display());
    command.args([place("run", "sizeup.toml"), place("output", "city")]);
    command.arg(format!("sizeup={}", env!("CARGO_BIN_EXE_sizeup"))).stdin(Stdio::null());
    let output = command.env("KUBECONFIG", &kubernetes.config).output().unwrap();
    let pods = fs::read_to_string(scene.path("pods.log")).unwrap();
    assert!(output.status.success(), "{}\n{pods}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(pods.matches("job snakejob-").count(), ids(&scene).len(), "every tile is a job: {pods}");
    let of_tiles = |name: &str| !name.starts_with(".snakemake");
    let made = results(&scene, "city").into_iter().filter(|(name, _)| of_tiles(name)).collect();
    assert_same(&expected, &made);
}
