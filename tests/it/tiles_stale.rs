//! A city says what of it is stale, and why: settings, footprints, priors, files that are gone; and what has failed.

use std::fs::{self, File, FileTimes};
use std::process::Command;
use std::time::Duration;

use serde_json::Value;

use crate::skipped::skip;
use crate::tiles::{SIZE, ids, merge, plan, run_tile};
use crate::tiny_scene::{Outcome, Scene};

fn status(scene: &Scene, more: &[&str]) -> Value {
    let told = scene.sizeup(&[&["tiles", "status", "city", "--json", "--quiet"], more].concat());
    assert_eq!(told.code, 0, "{}", told.stderr);
    serde_json::from_str(&told.stdout).unwrap()
}

/// Where every tile stands.
fn states(scene: &Scene) -> Vec<String> {
    let tiles = status(scene, &[])["tiles"].clone();
    tiles.as_array().unwrap().iter().map(|tile| tile["state"].as_str().unwrap().to_owned()).collect()
}

fn plan_with(scene: &Scene, more: &[&str]) -> Outcome {
    scene.sizeup(&[&["tiles", "plan", "sizeup.toml", "--output", "city", "--size", SIZE], more].concat())
}

/// A city that is planned, run and merged.
fn city() -> Scene {
    let scene = Scene::new();
    scene.change_footprints(|_| {});
    for id in plan(&scene) {
        assert!([0, 5].contains(&run_tile(&scene, &id).code));
    }
    let merged = merge(&scene, &[]);
    assert!([0, 5].contains(&merged.code), "{}", merged.stderr);
    scene
}

#[test]
fn a_city_of_other_settings_is_stale_and_is_not_merged() {
    let scene = city();
    assert!(states(&scene).iter().all(|state| state == "done"));
    assert_eq!(status(&scene, &[])["merge"], "done");
    let limit = ["--heights", "ellipsoidal", "--set", "heights.max_m=12.0"];
    // First what it would change, then the change.
    let told = plan_with(&scene, &[&limit[..], &["--dry-run"]].concat());
    assert_eq!(told.code, 0, "{}", told.stderr);
    assert_eq!(told.stdout.lines().count(), ids(&scene).len(), "{}", told.stdout);
    assert!(told.stdout.lines().all(|line| line.contains("heights.max_m is 12.0, was not set")));
    assert!(told.stderr.contains("s of processor time"), "{}", told.stderr);
    assert!(states(&scene).iter().all(|state| state == "done"), "nothing has been planned yet");
    assert_eq!(plan_with(&scene, &limit).code, 0);
    let tiles = status(&scene, &[])["tiles"].clone();
    for tile in tiles.as_array().unwrap() {
        assert_eq!(tile["state"], "stale");
        assert!(tile["why"].as_str().unwrap().contains("heights.max_m is 12.0"), "{tile}");
    }
    let refused = merge(&scene, &[]);
    assert_eq!(refused.code, 3, "{}", refused.stderr);
    assert!(refused.stderr.contains("stale: heights.max_m is 12.0"), "{}", refused.stderr);
    // As they were: the tiles are done after all.
    plan(&scene);
    assert!(states(&scene).iter().all(|state| state == "done"));
}

#[test]
fn tiles_of_another_halo_are_not_taken_as_done() {
    let scene = city();
    assert_eq!(plan_with(&scene, &["--halo", "40", "--view-margin", "20"]).code, 0);
    assert!(states(&scene).iter().all(|state| state != "done"));
    assert_eq!(merge(&scene, &[]).code, 3);
}

#[test]
fn input_that_changes_after_the_plan_is_named_by_tiles_status_and_merge() {
    let scene = city();
    let text = fs::read_to_string(scene.path("footprints.geojson")).unwrap();
    let mut layer: Value = serde_json::from_str(&text).unwrap();
    // A metre further east.
    for corner in layer["features"][0]["geometry"]["coordinates"][0].as_array_mut().unwrap() {
        corner[0] = (corner[0].as_f64().unwrap() + 1.0).into();
    }
    fs::write(scene.path("footprints.geojson"), layer.to_string()).unwrap();
    let why = status(&scene, &[])["plan_stale"].as_str().unwrap().to_owned();
    assert!(why.contains("footprints.geojson has changed"), "{why}");
    let refused = merge(&scene, &[]);
    assert!(refused.code == 3 && refused.stderr.contains("footprints.geojson has changed"), "{}", refused.stderr);
    // Tiles would read the new footprints under the old plan.
    fs::remove_file(scene.path(&format!("city/tiles/{}.done.json", ids(&scene)[0]))).unwrap();
    let refused = run_tile(&scene, &ids(&scene)[0]);
    assert!(refused.code == 3 && refused.stderr.contains("footprints.geojson has changed"), "{}", refused.stderr);
    // The origin of what is merged after a new plan is the new layer.
    for id in plan(&scene) {
        assert!([0, 5].contains(&run_tile(&scene, &id).code));
    }
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    let hash = sizeup::hashes::sha256_hex(&fs::read(scene.path("footprints.geojson")).unwrap());
    assert!(fs::read_to_string(scene.path("city/lineage.json")).unwrap().contains(&hash));
}

#[test]
fn a_prior_that_changes_between_two_tiles_is_not_merged_as_two() {
    let scene = city();
    let stem = scene.stems().into_iter().find(|stem| stem.contains("oblique")).unwrap();
    let other = scene.stems().into_iter().rfind(|stem| stem.contains("oblique")).unwrap();
    let [path, other] = [stem, other].map(|stem| scene.path(&format!("priors/{stem}.npy")));
    // Same size; and the time of before, as copying tools keep it.
    let time = fs::metadata(&path).unwrap().modified().unwrap();
    fs::copy(other, &path).unwrap();
    File::options().append(true).open(&path).unwrap().set_times(FileTimes::new().set_modified(time)).unwrap();
    let tiles = status(&scene, &[])["tiles"].clone();
    let stale: Vec<&Value> = tiles.as_array().unwrap().iter().filter(|tile| tile["state"] == "stale").collect();
    assert!(!stale.is_empty());
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let why = stale[0]["why"].as_str().unwrap();
    assert!(why.contains(&name) && why.ends_with("has changed"), "{why}");
    assert!(merge(&scene, &[]).stderr.contains(&name));
    run_tile(&scene, stale[0]["tile"]["id"].as_str().unwrap());
    // One of several: still two hashes of one prior.
    if stale.len() > 1 {
        assert_eq!(merge(&scene, &[]).code, 3);
    }
}

#[test]
fn a_prior_that_changes_while_a_tile_is_being_run_is_told_and_the_tile_is_not_done() {
    let scene = Scene::new();
    let id = plan(&scene)[0].clone();
    let views = scene.json(&format!("city/tiles/{id}/views.json"));
    let prior = std::path::PathBuf::from(views["priors"][0].as_str().unwrap());
    let at = scene.path("").join(prior);
    let mut running = Command::new(env!("CARGO_BIN_EXE_sizeup"))
        .current_dir(scene.path(""))
        .args(["tiles", "run", "city", "--tile", &id])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // It writes down that it tries once it knows what it is made from.
    while !scene.path(&format!("city/tiles/{id}.try.json")).exists() {
        assert!(running.try_wait().unwrap().is_none(), "it is still being run");
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut bytes = fs::read(&at).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&at, bytes).unwrap();
    let ended = running.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(4), "{said}");
    assert!(said.contains("has changed") && said.contains(&id), "{said}");
    assert!(!scene.path(&format!("city/tiles/{id}.done.json")).exists());
    assert_eq!(states(&scene)[0], "failed");
    assert!([0, 5].contains(&run_tile(&scene, &id).code));
    assert_eq!(states(&scene)[0], "done");
}

#[test]
fn what_lies_beside_the_terrain_and_the_footprints_is_input_of_the_plan() {
    let scene = city();
    let plan_stale = || status(&scene, &[])["plan_stale"].as_str().unwrap_or_default().to_owned();
    assert_eq!(plan_stale(), "");
    // Statistics alone are what QGIS leaves behind.
    let holes = "<PAMDataset><PAMRasterBand band=\"1\"><NoDataValue>-1</NoDataValue></PAMRasterBand></PAMDataset>";
    fs::write(scene.path("dtm.tif.aux.xml"), holes).unwrap();
    assert!(plan_stale().contains("dtm.tif.aux.xml is new"), "{}", plan_stale());
    assert_eq!(merge(&scene, &[]).code, 3);
    plan(&scene);
    assert_eq!(plan_stale(), "");
    assert!(states(&scene).iter().all(|state| state == "done"), "the terrain is the same");
    fs::remove_file(scene.path("dtm.tif.aux.xml")).unwrap();
    assert!(plan_stale().contains("dtm.tif.aux.xml is gone"), "{}", plan_stale());
}

#[test]
fn what_has_not_changed_is_not_read_again_unless_asked() {
    let scene = city();
    // Until the clock has left the moment in which all was written.
    std::thread::sleep(Duration::from_millis(2100));
    status(&scene, &[]);
    let read = |more: &[&str]| status(&scene, more)["n_bytes_read"].as_u64().unwrap();
    assert_eq!(read(&[]), 0);
    let size = |stem: &String| fs::metadata(scene.path(&format!("priors/{stem}.npy"))).unwrap().len();
    let priors: u64 = scene.stems().iter().map(size).sum();
    assert!(read(&["--rehash"]) > priors);
}

#[test]
fn a_tile_that_failed_is_told_with_cause_code_and_tries() {
    let scene = Scene::new();
    let ids = plan(&scene);
    let limited = || {
        Command::new("bash")
            .current_dir(scene.path(""))
            .args(["-c", "trap '' XFSZ; ulimit -f 3; exec \"$@\"", "bash", env!("CARGO_BIN_EXE_sizeup")])
            .args(["tiles", "run", "city", "--tile", &ids[0]])
            .output()
            .unwrap()
    };
    assert_eq!(limited().status.code(), Some(4));
    assert_eq!(limited().status.code(), Some(4));
    let tile = status(&scene, &[])["tiles"][0].clone();
    assert_eq!((&tile["state"], &tile["exit_code"], &tile["n_tries"]), (&"failed".into(), &4.into(), &2.into()));
    assert!(tile["why"].as_str().unwrap().contains("cannot write"), "{tile}");
    let told = scene.sizeup(&["tiles", "status", "city"]).stdout;
    assert!(told.lines().next().unwrap().contains("failed, exit code 4, 2 tries: cannot write"), "{told}");
    assert!(merge(&scene, &[]).stderr.contains("failed: cannot write"));
    // One that was killed cannot tell.
    let killed = Command::new("bash")
        .current_dir(scene.path(""))
        .args(["-c", "ulimit -f 3; exec \"$@\"", "bash", env!("CARGO_BIN_EXE_sizeup"), "tiles", "run", "city"])
        .args(["--tile", &ids[1]])
        .output()
        .unwrap();
    assert_eq!(killed.status.code(), None);
    let tile = status(&scene, &[])["tiles"][1].clone();
    assert!(tile["state"] == "failed" && tile["why"].as_str().unwrap().contains("killed"), "{tile}");
    for id in &ids[..2] {
        assert!([0, 5].contains(&run_tile(&scene, id).code));
    }
    assert_eq!(states(&scene)[..2], ["done", "done"]);
}

#[test]
fn a_file_of_the_tileset_that_is_gone_is_noticed_and_made_again() {
    let scene = city();
    let is_mesh = |path: &std::path::PathBuf| path.extension().is_some_and(|e| e == "glb");
    let mesh = scene.files("city/3dtiles").into_iter().find(is_mesh).unwrap();
    fs::remove_file(&mesh).unwrap();
    let told = status(&scene, &[]);
    assert!(told["merge"] == "stale" && told["merge_stale"].as_str().unwrap().contains(".glb is missing"), "{told}");
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    assert!(mesh.exists());
}

#[test]
fn too_little_memory_is_a_setting_that_cannot_be() {
    let scene = Scene::new();
    let refused = plan_with(&scene, &["--memory", "50"]);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("--memory"), "{}", refused.stderr);
}

#[test]
fn a_grid_that_proj_lacks_stops_the_plan_and_not_the_merge() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| text.replace("EPSG:25832", "EPSG:25832+7837"));
    let refused = plan_with(&scene, &[]);
    if refused.code == 0 {
        skip("PROJ has the grids of EPSG:7837 here");
        return;
    }
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("3D Tiles") && refused.stderr.contains("--geoid-height"), "{}", refused.stderr);
    assert!(!scene.path("city/tiles.json").exists());
    let tiled = ["--tiled", "--size", SIZE, "--jobs", "2", "--output", "city"];
    for heights in [["--geoid-height", "45"], ["--heights", "none"]] {
        let made = scene.run(&[&tiled[..], &heights].concat());
        assert!([0, 5].contains(&made.code), "{}", made.stderr);
        assert_eq!(scene.path("city/3dtiles/tileset.json").exists() && heights[1] == "45", heights[1] == "45");
        assert!(scene.path("city/summary.json").exists());
    }
    let whole = scene.run(&["--geoid-height", "45"]);
    assert_eq!(whole.code, 2, "{}", whole.stderr);
}

#[test]
fn results_name_the_commit_of_the_program() {
    let Some(commit) = sizeup::recipe::commit() else {
        skip("built without git");
        return;
    };
    let scene = city();
    for name in ["city/lineage.json", "city/tiles.json"] {
        assert!(fs::read_to_string(scene.path(name)).unwrap().contains(commit), "{name}");
    }
}
