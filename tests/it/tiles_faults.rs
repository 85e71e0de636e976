//! What goes wrong with a city: nothing is lost, nothing doubled, and what is run again is only what is missing.

use std::fs::{self, File, FileTimes};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, SystemTime};

use serde_json::Value;

use crate::tiles::{SIZE, assert_same, ids, merge, plan, results, run_tile, undisturbed};
use crate::tiny_scene::Scene;

/// Starts a command in the scene's folder.
fn start(scene: &Scene, args: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_sizeup"))
        .current_dir(scene.path(""))
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Starts a command, and kills it the hard way after some time; whether it was still running.
fn kill_after(scene: &Scene, args: &[&str], milliseconds: u64) -> bool {
    let mut child = start(scene, args);
    std::thread::sleep(Duration::from_millis(milliseconds));
    let was_running = child.try_wait().unwrap().is_none();
    // SIGKILL: nothing in the program gets to know.
    child.kill().unwrap();
    child.wait().unwrap();
    was_running
}

/// Runs every tile; names of those that were not done already.
fn run_rest(scene: &Scene) -> Vec<String> {
    let ran = ids(scene).into_iter().filter(|id| {
        let outcome = run_tile(scene, id);
        assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
        !outcome.stderr.contains("was done already")
    });
    ran.collect()
}

#[test]
fn tiles_and_merges_that_are_killed_leave_the_city_as_if_they_had_not_been() {
    let scene = Scene::with_page();
    let expected = undisturbed(&scene);
    let ids = plan(&scene);
    // At many moments, so that some lie in the middle of the work and some in the middle of writing.
    let mut n_killed = 0;
    for (i, id) in ids.iter().enumerate() {
        for k in 0..6 {
            let id = if k % 2 == 0 { id } else { &ids[(i + k as usize) % ids.len()] };
            n_killed += usize::from(kill_after(&scene, &["tiles", "run", "city", "--tile", id], 20 + 70 * k));
        }
    }
    assert!(n_killed > 0, "nothing was killed while it ran");
    run_rest(&scene);
    for k in 0..6 {
        kill_after(&scene, &["tiles", "merge", "city"], 10 + 30 * k);
    }
    merge(&scene, &[]);
    assert_same(&expected, &results(&scene, "city"));
    scene.assert_no_litter();
}

#[test]
fn a_merge_that_is_killed_is_seen_in_the_status_until_it_is_merged_again() {
    let scene = Scene::with_page();
    plan(&scene);
    run_rest(&scene);
    merge(&scene, &[]);
    let merge_of =
        || serde_json::from_str::<Value>(&scene.sizeup(&["tiles", "status", "city", "--json"]).stdout).unwrap();
    assert_eq!(merge_of()["merge"], "done");
    // Another tileset: it is merged anew. A package has more than 40 KiB: the system kills the writer.
    let script = "ulimit -f 40; exec \"$@\"";
    let killed = Command::new("bash")
        .current_dir(scene.path(""))
        .args(["-c", script, "bash", env!("CARGO_BIN_EXE_sizeup"), "tiles", "merge", "city", "--geoid-height", "40"])
        .stderr(Stdio::null())
        .status()
        .unwrap();
    assert_eq!(killed.code(), None, "by a signal");
    let told = merge_of();
    assert!(told["merge"] == "failed" && told["merge_stale"].as_str().unwrap().contains("of two runs"), "{told}");
    let told = scene.sizeup(&["tiles", "status", "city"]);
    assert!(told.stderr.contains("the merge is not finished: these results may be of two runs"), "{}", told.stderr);
    merge(&scene, &[]);
    assert_eq!(merge_of()["merge"], "done");
}

#[test]
fn two_runners_of_one_tile_take_turns() {
    let scene = Scene::with_page();
    let expected = undisturbed(&scene);
    for id in plan(&scene) {
        let args = ["tiles", "run", "city", "--tile", &id];
        let runners: Vec<Child> = (0..3).map(|_| start(&scene, &args)).collect();
        for mut runner in runners {
            assert!([0, 5].contains(&runner.wait().unwrap().code().unwrap()));
        }
    }
    let mergers: Vec<Child> = (0..2).map(|_| start(&scene, &["tiles", "merge", "city"])).collect();
    for mut merger in mergers {
        assert!([0, 5].contains(&merger.wait().unwrap().code().unwrap()));
    }
    assert_same(&expected, &results(&scene, "city"));
    scene.assert_no_litter();
}

#[test]
fn a_runner_that_was_killed_holds_no_lock() {
    let scene = Scene::with_page();
    let ids = plan(&scene);
    kill_after(&scene, &["tiles", "run", "city", "--tile", &ids[0]], 60);
    let told = scene.sizeup(&["tiles", "status", "city"]);
    assert!(!told.stdout.contains("running"), "{}", told.stdout);
}

#[test]
fn a_full_disk_fails_the_tile_and_leaves_those_that_are_done() {
    let scene = Scene::with_page();
    let expected = undisturbed(&scene);
    let ids = plan(&scene);
    run_tile(&scene, &ids[0]);
    // Files of a few hundred bytes can be written, those of the results not.
    let script = "trap '' XFSZ; ulimit -f 1; exec \"$@\"";
    for id in &ids[1..] {
        let outcome = Command::new("bash")
            .current_dir(scene.path(""))
            .args(["-c", script, "bash", env!("CARGO_BIN_EXE_sizeup"), "tiles", "run", "city", "--tile", id])
            .output()
            .unwrap();
        assert_eq!(outcome.status.code(), Some(4), "{}", String::from_utf8_lossy(&outcome.stderr));
        assert!(!scene.path(&format!("city/tiles/{id}.done.json")).exists());
    }
    assert_eq!(run_rest(&scene), &ids[1..]);
    merge(&scene, &[]);
    assert_same(&expected, &results(&scene, "city"));
    scene.assert_no_litter();
}

#[test]
fn a_poisoned_prior_is_an_issue_of_its_photo_and_of_the_tiles_that_see_it() {
    let scene = Scene::with_page();
    let ids = plan(&scene);
    run_rest(&scene);
    let stem = scene.stems().into_iter().find(|stem| stem.contains("oblique")).unwrap();
    let whole = fs::read(scene.path(&format!("priors/{stem}.npy"))).unwrap();
    fs::write(scene.path(&format!("priors/{stem}.npy")), "not a prior").unwrap();
    let sees = |id: &String| {
        let views = scene.json(&format!("city/tiles/{id}/views.json"));
        views["views"].as_array().unwrap().iter().any(|view| view["id"].as_str().unwrap().starts_with(&stem))
    };
    let seeing: Vec<String> = ids.iter().filter(|id| sees(id)).cloned().collect();
    assert!(!seeing.is_empty());
    // Only the tiles that see the photo are run again.
    assert_eq!(run_rest(&scene), seeing);
    assert_eq!(merge(&scene, &[]).code, 5);
    let issues = scene.json("city/issues.json");
    let of_photo: Vec<&Value> =
        issues.as_array().unwrap().iter().filter(|issue| issue["code"] == "prior_unusable").collect();
    assert_eq!(of_photo.len(), 1, "once for all tiles: {issues}");
    fs::write(scene.path(&format!("priors/{stem}.npy")), whole).unwrap();
    assert_eq!(run_rest(&scene), seeing);
}

#[test]
fn times_of_files_decide_nothing() {
    let scene = Scene::with_page();
    let ids = plan(&scene);
    run_rest(&scene);
    let touch = |path: PathBuf, time: SystemTime| {
        File::options().append(true).open(path).unwrap().set_times(FileTimes::new().set_modified(time)).unwrap();
    };
    let (past, future) =
        (SystemTime::UNIX_EPOCH + Duration::from_secs(1), SystemTime::now() + Duration::from_secs(1 << 25));
    for stem in scene.stems() {
        touch(scene.path(&format!("priors/{stem}.npy")), future);
    }
    touch(scene.path("footprints.gpkg"), future);
    for id in &ids {
        touch(scene.path(&format!("city/tiles/{id}.done.json")), past);
    }
    assert!(run_rest(&scene).is_empty(), "only times have changed");
    // A change that its time hides is found all the same.
    scene.edit("sizeup.toml", |text| text.replace("seed = 1", "seed = 2"));
    touch(scene.path("sizeup.toml"), past);
    plan(&scene);
    assert_eq!(run_rest(&scene), ids);
}

#[test]
fn a_tile_whose_buildings_are_gone_is_done_and_empty_once_that_is_planned() {
    let scene = Scene::with_page();
    scene.change_footprints(|_| {});
    let ids = plan(&scene);
    // After the plan the layer loses all but its last building.
    let mut layer = scene.json("footprints.geojson");
    let kept = layer["features"].as_array().unwrap().last().unwrap().clone();
    layer["features"] = Value::Array(vec![kept]);
    fs::write(scene.path("footprints.geojson"), layer.to_string()).unwrap();
    for id in &ids {
        let refused = run_tile(&scene, id);
        assert_eq!(refused.code, 3, "{}", refused.stderr);
        assert!(refused.stderr.contains("footprints.geojson has changed"), "{}", refused.stderr);
    }
    let planned = scene.sizeup(&["tiles", "plan", "sizeup.toml", "--output", "city", "--size", SIZE]);
    assert_eq!(planned.code, 0, "{}", planned.stderr);
    assert_eq!(scene.json("city/tiles.json")["tiles"].as_array().unwrap().len(), 1);
    assert!([0, 5].contains(&run_tile(&scene, "0").code));
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    assert_eq!(scene.json("city/summary.json")["n_buildings"], 1);
}

#[test]
fn a_pool_of_processes_makes_the_same_city_and_starts_nothing_that_does_not_fit() {
    let scene = Scene::with_page();
    let expected = undisturbed(&scene);
    let tiled = ["--output", "city", "--tiled", "--size", SIZE, "--jobs", "2"];
    let refused = scene.run(&[&tiled[..], &["--total-memory", "10"]].concat());
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("needs about"), "{}", refused.stderr);
    assert!(scene.files("city/tiles").iter().all(|path| !path.to_string_lossy().ends_with(".done.json")));

    let outcome = scene.run(&tiled);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    // The merge differs in what was said about heights for 3D Tiles only.
    let of_tiles = |files: std::collections::BTreeMap<String, Vec<u8>>| {
        files.into_iter().filter(|(name, _)| name.starts_with("tiles/")).collect()
    };
    assert_same(&of_tiles(expected), &of_tiles(results(&scene, "city")));
}

#[test]
fn engines_are_told_not_to_try_input_again_that_only_the_tiles_find_unusable() {
    let scene = Scene::new();
    fs::write(scene.path("depth.onnx"), "no network").unwrap();
    let network = ["--set", "prior.source=network", "--set", "prior.model=depth.onnx"];
    let refused = scene.run(&[&["--tiled", "--heights", "none", "--output", "city"], &network[..]].concat());
    assert_eq!(refused.code, 3, "{}", refused.stderr);
    assert!(refused.stderr.contains("no network profile is set"), "{}", refused.stderr);
    assert!(refused.stderr.contains("hint: mend the settings or the input"), "{}", refused.stderr);
    let files = fs::read_dir(scene.path("city/tiles")).unwrap().map(|entry| entry.unwrap().file_name());
    let attempts: Vec<String> =
        files.filter_map(|name| name.into_string().ok()).filter(|name| name.ends_with(".try.json")).collect();
    assert_eq!(attempts.len(), 1, "one tile: {attempts:?}");
    let attempt = scene.json(&format!("city/tiles/{}", attempts[0]));
    assert_eq!((&attempt["exit_code"], &attempt["n_tries"]), (&Value::from(3), &Value::from(1)));
}
