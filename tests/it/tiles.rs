//! A city in tiles is the city in one piece: plan, run, merge, status.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;
use sizeup::simulate::{ErrorConfig, PriorLevel, SimulateConfig, TownKind, simulate};

use crate::tiny_scene::{N_BUILDINGS, Outcome, Scene, sizeup};

/// Tiles small enough that the scene falls into several.
pub const SIZE: &str = "30";

/// Plans the scene's city into the folder `city`.
pub fn plan(scene: &Scene) -> Vec<String> {
    let outcome =
        scene.sizeup(&["tiles", "plan", "sizeup.toml", "--output", "city", "--size", SIZE, "--heights", "ellipsoidal"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    ids(scene)
}

/// Names of the plan's tiles.
pub fn ids(scene: &Scene) -> Vec<String> {
    let tiles = scene.json("city/tiles.json")["tiles"].clone();
    let ids: Vec<String> =
        tiles.as_array().unwrap().iter().map(|tile| tile["id"].as_str().unwrap().to_owned()).collect();
    assert!(ids.len() > 2, "{ids:?}");
    ids
}

/// Runs one tile of a scene in a process of its own.
pub fn run_tile(scene: &Scene, id: &str) -> Outcome {
    scene.sizeup(&["tiles", "run", "city", "--tile", id])
}

/// Merges what is done.
pub fn merge(scene: &Scene, more: &[&str]) -> Outcome {
    scene.sizeup(&[&["tiles", "merge", "city"], more].concat())
}

/// Everything that is a result: not what it cost, what was said, and who holds a lock.
pub fn results(scene: &Scene, folder: &str) -> BTreeMap<String, Vec<u8>> {
    let root = scene.path(folder);
    let name = |path: &Path| path.strip_prefix(&root).unwrap().to_string_lossy().into_owned();
    let is_result = |name: &String| {
        let is_note =
            [".ok", "cost.json", "log.txt", "timing.json", "stages/hashes.json"].iter().any(|end| name.ends_with(end));
        let folders = ["tiles/locks", "tiles/hashes", "logs"];
        !(is_note || folders.iter().any(|folder| name.starts_with(folder)))
    };
    let files = scene.files(folder).into_iter().map(|path| (name(&path), path));
    files.filter(|(name, _)| is_result(name)).map(|(name, path)| (name, fs::read(path).unwrap())).collect()
}

/// Panics where two results differ, and says in which file.
pub fn assert_same(one: &BTreeMap<String, Vec<u8>>, other: &BTreeMap<String, Vec<u8>>) {
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
    let differ: Vec<&String> =
        one.iter().filter(|(name, bytes)| **bytes != other[*name]).map(|(name, _)| name).collect();
    assert!(differ.is_empty(), "different: {differ:?}");
}

/// A city that nothing has gone wrong with, in the folder `undisturbed`.
pub fn undisturbed(scene: &Scene) -> BTreeMap<String, Vec<u8>> {
    for id in plan(scene) {
        assert!([0, 5].contains(&run_tile(scene, &id).code));
    }
    assert!([0, 5].contains(&merge(scene, &[]).code));
    let results = results(scene, "city");
    fs::rename(scene.path("city"), scene.path("undisturbed")).unwrap();
    results
}

/// Height and status by building, from a CityJSON file or sequence.
pub fn heights(path: &Path) -> BTreeMap<String, (Option<f64>, String)> {
    let text = fs::read_to_string(path).unwrap();
    let is_sequence = path.extension().is_some_and(|e| e == "jsonl");
    let documents: Vec<Value> = if is_sequence {
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    } else {
        vec![serde_json::from_str(&text).unwrap()]
    };
    let objects = documents.iter().flat_map(|document| document["CityObjects"].as_object().into_iter().flatten());
    let of = |object: &Value| {
        let attributes = &object["attributes"];
        (attributes["height_m"].as_f64(), attributes["status"].as_str().unwrap_or_default().to_owned())
    };
    objects.map(|(id, object)| (id.clone(), of(object))).collect()
}

#[test]
fn tiles_find_the_heights_of_a_run_in_one_piece() {
    let scene = Scene::new();
    undisturbed(&scene);
    let whole = scene.run(&["--output", "whole"]);
    assert!([0, 5].contains(&whole.code), "{}", whole.stderr);
    let (whole, tiled) =
        (heights(&scene.path("whole/city.city.json")), heights(&scene.path("undisturbed/city.city.jsonl")));
    assert_eq!(whole.len(), N_BUILDINGS);
    // The halo covers the whole scene: to the millimetre of the files, nothing may differ.
    assert_eq!(whole, tiled);
    let seams = scene.json("undisturbed/summary.json")["seams"]["classes"].clone();
    let n: u64 = seams.as_array().unwrap().iter().map(|class| class["n"].as_u64().unwrap()).sum();
    let n_same: u64 = seams.as_array().unwrap().iter().map(|class| class["n_same"].as_u64().unwrap()).sum();
    assert!(n > 0 && n == n_same, "{seams}");
}

#[test]
fn a_city_in_tiles_has_a_page_and_a_packed_project_that_are_made_again_where_they_are_gone() {
    let scene = Scene::with_page();
    for id in plan(&scene) {
        assert!([0, 5].contains(&run_tile(&scene, &id).code));
    }
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    let page = fs::read_to_string(scene.path("city/report.html")).unwrap();
    for id in heights(&scene.path("city/city.city.jsonl")).keys() {
        assert!(page.contains(&format!("\"id\":\"{id}\"")), "{id} is not in the page");
    }
    for name in ["report.html", "city.qgz"] {
        let before = fs::read(scene.path(&format!("city/{name}"))).unwrap();
        fs::remove_file(scene.path(&format!("city/{name}"))).unwrap();
        assert!([0, 5].contains(&merge(&scene, &[]).code));
        assert!(fs::read(scene.path(&format!("city/{name}"))).unwrap() == before, "{name} differs");
    }
    scene.edit("sizeup.toml", |text| text.replace("[output]\n", "[output]\nreport = { page = false }\n"));
    plan(&scene);
    for id in ids(&scene) {
        assert!([0, 5].contains(&run_tile(&scene, &id).code));
    }
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    assert!(!scene.path("city/report.html").exists(), "a page of before is not left behind");
}

/// Paints a photo of one colour.
fn paint(scene: &Scene, stem: &str, colour: [u8; 3]) {
    image::RgbImage::from_pixel(160, 120, image::Rgb(colour)).save(scene.path(&format!("images/{stem}.jpg"))).unwrap();
}

#[test]
fn photos_lie_under_the_map_of_a_city_in_tiles_and_one_that_changes_makes_its_page_anew() {
    let scene = Scene::with_page();
    fs::create_dir(scene.path("images")).unwrap();
    let stems = scene.stems();
    stems.iter().for_each(|stem| paint(&scene, stem, [90, 120, 60]));
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"images\""));
    scene.edit("sizeup.toml", |text| text.replace("[optimise]\n", "[refinement]\nenabled = false\n\n[optimise]\n"));
    for id in plan(&scene) {
        assert!([0, 5].contains(&run_tile(&scene, &id).code));
    }
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    let page = || fs::read_to_string(scene.path("city/report.html")).unwrap();
    let status =
        || -> Value { serde_json::from_str(&scene.sizeup(&["tiles", "status", "city", "--json"]).stdout).unwrap() };
    let before = page();
    let merged = scene.json("city/city.done.json");
    let photos: Vec<&String> = merged["photos"].as_object().unwrap().keys().collect();
    assert!(before.contains("\"backdrop\":{\"picture\":\"data:image/"), "the page has no photos");
    assert!(!photos.is_empty() && photos.iter().all(|photo| photo.contains("nadir")), "{photos:?}");
    assert_eq!(status()["merge"], "done");
    let photo = Path::new(photos[0]).file_name().unwrap().to_string_lossy().into_owned();
    paint(&scene, photo.trim_end_matches(".jpg"), [250, 30, 30]);
    assert_eq!(status()["merge"], "stale");
    for id in ids(&scene) {
        assert!([0, 5].contains(&run_tile(&scene, &id).code));
    }
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    assert!(page() != before && status()["merge"] == "done");
    fs::remove_file(scene.path(&format!("images/{photo}"))).unwrap();
    assert_eq!(status()["merge"], "stale");
}

/// West, south, east and north of a tile of a plan.
fn core_of(tile: &Value) -> [f64; 4] {
    ["west_m", "south_m", "east_m", "north_m"].map(|side| tile["core"][side].as_f64().unwrap())
}

#[test]
fn a_city_in_tiles_is_textured_tile_by_tile_and_again_where_a_picture_is_gone() {
    let scene = Scene::with_page();
    fs::create_dir(scene.path("images")).unwrap();
    scene.stems().iter().for_each(|stem| paint(&scene, stem, [90, 120, 60]));
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"images\""));
    let textures = "[output]\ntextures = { enabled = true, texel_m = 1.0 }\n";
    scene.edit("sizeup.toml", |text| text.replace("[output]\n", textures));
    scene.edit("sizeup.toml", |text| text.replace("[optimise]\n", "[refinement]\nenabled = false\n\n[optimise]\n"));
    for id in plan(&scene) {
        assert!([0, 5].contains(&run_tile(&scene, &id).code));
    }
    let merged = merge(&scene, &[]);
    assert!([0, 5].contains(&merged.code), "{}", merged.stderr);
    let once = results(&scene, "city");
    let pictures: Vec<&String> = once.keys().filter(|name| name.ends_with("textured/appearance/atlas-0.jpg")).collect();
    assert!(pictures.len() > 1, "{:?}", once.keys());
    assert_eq!(scene.json("city/3dtiles/tileset.json")["asset"]["extras"]["sizeup"]["textures"], true);
    // The pictures are in the city's tiles as they are in those of the plan.
    let in_tiles = |picture: &[u8]| {
        let is_glb =
            |name: &str| name.starts_with("3dtiles") && Path::new(name).extension().is_some_and(|e| e == "glb");
        let glbs = once.iter().filter(|(name, _)| is_glb(name));
        glbs.filter(|(_, glb)| glb.windows(picture.len()).any(|bytes| bytes == picture)).count()
    };
    assert!(pictures.iter().all(|picture| in_tiles(&once[*picture]) >= 1));
    // So is their ground, edge to edge, and all of it is in the report.
    let cores: Vec<[f64; 4]> = scene.json("city/tiles.json")["tiles"].as_array().unwrap().iter().map(core_of).collect();
    let mut grounds: Vec<[f64; 4]> = Vec::new();
    for (name, text) in once.iter().filter(|(name, _)| name.ends_with("textured/ground.json")) {
        let ground: Value = serde_json::from_slice(text).unwrap();
        grounds.push(serde_json::from_value(ground["bounds_m"].clone()).unwrap());
        let picture = &once[&name.replace("ground.json", "appearance/ground.jpg")];
        // Photos of one colour: the grounds of several tiles have the same picture.
        assert!(in_tiles(picture) >= 1, "{name}");
    }
    assert!(grounds.len() > 1, "{:?}", once.keys());
    let is_same = |a: &[f64; 4], b: &[f64; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(grounds.iter().all(|ground| cores.iter().any(|core| is_same(ground, core))), "{grounds:?} {cores:?}");
    let page = String::from_utf8(once["report.html"].clone()).unwrap();
    let (_, textures) = page.split_once("id=\"textured\">").unwrap();
    let textures: Value = serde_json::from_str(textures.split_once("</script>").unwrap().0).unwrap();
    assert_eq!(textures["grounds"].as_array().map(Vec::len), Some(grounds.len()));
    let gone = pictures[0];
    fs::remove_file(scene.path("city").join(gone)).unwrap();
    let id = gone.trim_start_matches("tiles/").split('/').next().unwrap();
    let again = run_tile(&scene, id);
    assert!(again.stderr.contains("is done") && [0, 5].contains(&again.code), "{}", again.stderr);
    assert!([0, 5].contains(&merge(&scene, &[]).code));
    assert_same(&once, &results(&scene, "city"));
    // Another photo: only its tiles are stale.
    let status =
        || -> Value { serde_json::from_str(&scene.sizeup(&["tiles", "status", "city", "--json"]).stdout).unwrap() };
    paint(&scene, &scene.stems()[0], [250, 30, 30]);
    let n_stale = status()["tiles"].as_array().unwrap().iter().filter(|tile| tile["state"] == "stale").count();
    assert!(n_stale > 0, "{:#}", status());
}

#[test]
fn halos_that_cut_through_a_town_leave_its_heights_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = SimulateConfig::default();
    config.town.n_buildings = 60;
    config.flight.n_views = Some(100);
    config.prior.longest_px = 224;
    (config.town.trees_per_building, config.town.cars_per_building) = (0.5, 0.0);
    (config.images.enabled, config.masks.enabled) = (false, false);
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let run = |args: &[&str]| {
        let outcome = sizeup().current_dir(folder.path()).args(args).output().unwrap();
        assert!([0, 5].contains(&outcome.status.code().unwrap()), "{}", String::from_utf8_lossy(&outcome.stderr));
    };
    let working = [
        "--set",
        "optimise.working_px=224",
        "--set",
        "output.pictures=false",
        "--set",
        "output.report.page=false",
        "--set",
        "optimise.search.calibrate_on=ground",
    ];
    run(&[&["run", "sizeup.toml", "--output", "whole"], &working[..]].concat());
    let cut = ["--tiled", "--size", "150", "--halo", "200", "--view-margin", "200"];
    run(&[&["run", "sizeup.toml", "--output", "tiled"], &cut[..], &working[..]].concat());
    let plan: Value = serde_json::from_slice(&fs::read(folder.path().join("tiled/tiles.json")).unwrap()).unwrap();
    let tiles = plan["tiles"].as_array().unwrap();
    assert!(tiles.iter().any(|tile| tile["n_solved"].as_u64() < Some(60)), "no halo cuts anything off");
    let (whole, tiled) =
        (heights(&folder.path().join("whole/city.city.json")), heights(&folder.path().join("tiled/city.city.jsonl")));
    assert_eq!(whole.keys().collect::<Vec<_>>(), tiled.keys().collect::<Vec<_>>());
    let mut differences: Vec<f64> =
        whole.iter().filter_map(|(id, (h, _))| Some((h.as_ref()? - tiled[id].0?).abs())).collect();
    differences.sort_by(f64::total_cmp);
    let n = differences.len();
    assert!(n >= 60, "{n} heights");
    println!("|Δh|: median {:.4} m, greatest {:.4} m", differences[n / 2], differences[n - 1]);
    // This halo is less than half as wide as a view shows, the default three times as wide: most heights are the same
    // all the same, and none is another one.
    let (half, most) = (differences[n / 2], differences[n * 4 / 5 - 1]);
    assert!(half < 0.001 && most < 0.05 && differences[n - 1] < 1.0, "{differences:?}");
}

#[test]
fn a_bad_photo_leaves_heights_that_were_not_measured_in_it_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = SimulateConfig::preset("demo").unwrap();
    config.town.n_buildings = 60;
    config.flight.n_views = Some(100);
    config.prior.longest_px = 224;
    (config.town.trees_per_building, config.town.cars_per_building) = (0.5, 0.0);
    (config.images.enabled, config.masks.enabled) = (false, false);
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let scene = Scene::of(folder);
    let run = |output: &str| {
        let sets = ["optimise.working_px=224", "output.pictures=false", "output.report.page=false"];
        let sets = sets.into_iter().chain(["optimise.search.calibrate_on=ground"]).flat_map(|set| ["--set", set]);
        let ran = scene.run(&["--output", output].into_iter().chain(sets).collect::<Vec<_>>());
        assert!([0, 5].contains(&ran.code), "{}", ran.stderr);
        scene.json(&format!("{output}/city.city.json"))["CityObjects"].clone()
    };
    let sound = run("sound");
    // One photo gets the prior of another.
    let oblique: Vec<String> = scene.stems().into_iter().filter(|stem| stem.ends_with("_oblique")).collect();
    let prior = |at: usize| scene.path(&format!("priors/{}.npy", oblique[at]));
    fs::copy(prior(39), prior(9)).unwrap();
    let with_bad = run("bad");
    let issues = fs::read_to_string(scene.path("bad/issues.json")).unwrap();
    assert!(issues.contains("prior_disagrees") && issues.contains(&oblique[9]), "{issues}");
    let others = sound.as_object().unwrap().iter().filter_map(|(id, object)| {
        let attributes = &object["attributes"];
        let is_measured_in_it = attributes["views"].to_string().contains(&oblique[9]);
        let change_m = attributes["height_m"].as_f64()? - with_bad[id]["attributes"]["height_m"].as_f64()?;
        (!is_measured_in_it).then_some(change_m.abs())
    });
    let changes_m: Vec<f64> = others.collect();
    let n_moved = changes_m.iter().filter(|change_m| **change_m > 0.01).count();
    println!("{n_moved} of {} moved by more than a centimetre", changes_m.len());
    // 3 of 59 stand beside what was measured in it. When all heights were looked for again, 16 moved.
    assert!(changes_m.len() > 50 && n_moved * 10 <= changes_m.len(), "{changes_m:?}");
}

#[test]
fn photos_of_all_kinds_refine_roofs_in_tiles_as_in_one_piece_and_a_poisoned_one_stops_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = SimulateConfig::default();
    config.town.n_buildings = N_BUILDINGS;
    config.flight.n_views = Some(16);
    (config.camera.width_px, config.camera.height_px) = (640, 480);
    config.prior.longest_px = 160;
    config.masks.enabled = false;
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let sizeup = |args: &[&str]| {
        let outcome: Outcome = sizeup().current_dir(folder.path()).args(args).output().unwrap().into();
        assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
        outcome
    };
    let plain = ["--set", "output.pictures=false", "--set", "output.report.page=false"];
    let working = [&["--set", "optimise.working_px=160"], &plain[..]].concat();
    sizeup(&[&["run", "sizeup.toml", "--output", "whole"], &working[..]].concat());
    sizeup(&[&["run", "sizeup.toml", "--output", "tiled", "--tiled", "--size", SIZE], &working[..]].concat());
    let read = |name: &str| heights(&folder.path().join(name));
    let whole = read("whole/city.city.json");
    assert_eq!(whole.len(), N_BUILDINGS);
    assert_eq!(whole, read("tiled/city.city.jsonl"));
    // Without photos there are other heights: they had a say.
    let blind = ["--output", "blind", "--set", "refinement.enabled=false"];
    sizeup(&[&["run", "sizeup.toml"], &blind[..], &working[..]].concat());
    assert_ne!(whole, read("blind/city.city.json"));

    let plan: Value = serde_json::from_slice(&fs::read(folder.path().join("tiled/tiles.json")).unwrap()).unwrap();
    let id = plan["tiles"][0]["id"].as_str().unwrap();
    let views = fs::read(folder.path().join(format!("tiled/tiles/{id}/views.json"))).unwrap();
    let views: Value = serde_json::from_slice(&views).unwrap();
    let photo = views["views"][0]["image"].as_str().unwrap();
    assert!(sizeup(&["tiles", "run", "tiled", "--tile", id]).stderr.contains("was done already"));
    fs::write(photo, "not a photo").unwrap();
    assert!(sizeup(&["tiles", "run", "tiled", "--tile", id]).stderr.contains("is done"));
}

#[test]
fn what_is_done_is_not_done_again_and_the_same_plan_is_the_same_bytes() {
    let scene = Scene::new();
    let ids = plan(&scene);
    for id in &ids {
        let first = run_tile(&scene, id);
        assert!(first.stderr.contains("is done"), "{}", first.stderr);
    }
    merge(&scene, &[]);
    let once = results(&scene, "city");
    plan(&scene);
    for id in &ids {
        let again = run_tile(&scene, id);
        assert!(again.stderr.contains("was done already"), "{}", again.stderr);
    }
    merge(&scene, &[]);
    assert_same(&once, &results(&scene, "city"));
    scene.assert_no_litter();
}

#[test]
fn a_missing_tile_stops_the_merge_unless_it_is_allowed_and_is_named_then() {
    let scene = Scene::new();
    let ids = plan(&scene);
    for id in &ids[1..] {
        run_tile(&scene, id);
    }
    let refused = merge(&scene, &[]);
    assert_eq!(refused.code, 3, "{}", refused.stderr);
    assert!(refused.stderr.contains(&ids[0]) && refused.stderr.contains("--allow-missing"), "{}", refused.stderr);
    assert!(!scene.path("city/city.gpkg").exists());

    assert_eq!(merge(&scene, &["--allow-missing"]).code, 5);
    let summary = scene.json("city/summary.json");
    assert_eq!(summary["missing_tiles"][0], ids[0].as_str());
    let issues = scene.json("city/issues.json");
    assert!(issues.as_array().unwrap().iter().any(|issue| issue["code"] == "tile_missing"), "{issues}");

    run_tile(&scene, &ids[0]);
    merge(&scene, &[]);
    assert_eq!(heights(&scene.path("city/city.city.jsonl")).len(), N_BUILDINGS);
}

#[test]
fn status_tells_where_each_tile_stands() {
    let scene = Scene::new();
    let ids = plan(&scene);
    run_tile(&scene, &ids[0]);
    run_tile(&scene, &ids[1]);
    fs::write(scene.path(&format!("city/tiles/{}/buildings.jsonl", ids[1])), "not what was written").unwrap();
    let told = scene.sizeup(&["tiles", "status", "city"]);
    let lines: Vec<&str> = told.stdout.lines().collect();
    assert_eq!(lines.len(), ids.len());
    assert!(lines[0].starts_with(&ids[0]) && lines[0].contains("\tdone"), "{}", lines[0]);
    assert!(lines[1].contains("damaged"), "{}", lines[1]);
    assert!(lines[2].contains("waiting"), "{}", lines[2]);
    // A damaged tile counts as missing, and running it mends it.
    assert_eq!(merge(&scene, &[]).code, 3);
    assert!(run_tile(&scene, &ids[1]).stderr.contains("is done"));
}

#[test]
fn every_building_belongs_to_one_tile_also_those_without_a_footprint() {
    let scene = Scene::new();
    scene.change_footprints(|features| {
        features[0]["geometry"] = Value::Null;
        features[1]["properties"]["id"] = features[2]["properties"]["id"].clone();
        // Two parts far apart, which fall into different tiles.
        let (one, other) =
            (features[3]["geometry"]["coordinates"].clone(), features[4]["geometry"]["coordinates"].clone());
        features[3]["geometry"] = serde_json::json!({ "type": "MultiPolygon", "coordinates": [one, other] });
        features.remove(4);
    });
    undisturbed(&scene);
    let whole = scene.run(&["--output", "whole"]);
    assert_eq!(whole.code, 5, "{}", whole.stderr);
    let (whole, tiled) =
        (heights(&scene.path("whole/city.city.json")), heights(&scene.path("undisturbed/city.city.jsonl")));
    assert!(whole.keys().any(|id| id.ends_with("~2")) && whole.keys().any(|id| id.ends_with("#2")), "{whole:?}");
    assert_eq!(whole, tiled);
}

/// Footprints from the simulated masks of the nadir photos.
fn find_footprints_in_masks(scene: &Scene, more: &str) {
    scene.edit("sizeup.toml", |text| {
        let masks = "source = \"masks\"\npath = \"masks/{stem}.png\"\nkind = \"instance\"\n";
        text.replace("path = \"footprints.gpkg\"\nid_field = \"id\"", &format!("{masks}{more}"))
    });
}

#[test]
fn footprints_found_in_photos_are_the_same_in_tiles_with_the_same_ids() {
    let scene = Scene::new();
    find_footprints_in_masks(&scene, "");
    let whole = scene.run(&["--output", "whole"]);
    assert!([0, 5].contains(&whole.code), "{}", whole.stderr);
    undisturbed(&scene);
    let found = scene.json("whole/stages/footprints.json")["data"]["layer"]["footprints"].clone();
    let of_whole: BTreeMap<String, Value> = found
        .as_array()
        .unwrap()
        .iter()
        .map(|one| (one["id"].as_str().unwrap().to_owned(), serde_json::json!([one["polygon"], one["attributes"]])))
        .collect();
    assert!(of_whole.len() >= N_BUILDINGS - 1, "{} footprints", of_whole.len());
    let mut of_tiles = BTreeMap::new();
    let files = scene.files("undisturbed/tiles").into_iter().filter(|path| path.ends_with("buildings.jsonl"));
    for line in files.flat_map(|path| fs::read_to_string(path).unwrap().lines().map(str::to_owned).collect::<Vec<_>>())
    {
        let one: Value = serde_json::from_str(&line).unwrap();
        let id = one["id"].as_str().unwrap().to_owned();
        let twice = of_tiles.insert(id, serde_json::json!([one["footprint"], one["attributes"]]));
        assert!(twice.is_none(), "{line} is in two tiles");
    }
    assert_eq!(of_whole, of_tiles, "corners and attributes to the bit");
    let (whole, tiled) =
        (heights(&scene.path("whole/city.city.json")), heights(&scene.path("undisturbed/city.city.jsonl")));
    assert_eq!(whole, tiled);
}

#[test]
fn the_paper_preset_is_refused_and_roofs_that_tiles_do_not_move_with_heights_are_told() {
    let scene = Scene::new();
    let refused = scene.sizeup(&["tiles", "plan", "sizeup.toml", "--set", "optimise.preset=paper"]);
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("robust"), "{}", refused.stderr);
    find_footprints_in_masks(&scene, "contour = \"roof\"\n");
    undisturbed(&scene);
    let issues = fs::read_to_string(scene.path("undisturbed/issues.json")).unwrap();
    assert_eq!(issues.matches("roofs_not_moved").count(), 1, "{issues}");
}

#[test]
fn a_fallback_attribute_that_no_footprint_has_is_refused_before_any_work_in_tiles_and_in_one_piece() {
    let scene = Scene::new();
    let set = |name: &str| {
        let name = format!("output.fallback.attribute={name}");
        ["--set".to_owned(), "output.fallback.source=attribute".to_owned(), "--set".to_owned(), name]
    };
    let wrong = set("levels");
    let wrong: Vec<&str> = wrong.iter().map(String::as_str).collect();
    let said = "none of the footprints has an attribute \"levels\"";
    let plan = scene.sizeup(&[&["tiles", "plan", "sizeup.toml", "--output", "city"], &wrong[..]].concat());
    assert_eq!(plan.code, 2, "{}", plan.stderr);
    assert!(plan.stderr.contains(said) && !scene.path("city/tiles.json").exists(), "{}", plan.stderr);
    let whole = scene.run(&[&["--output", "whole"], &wrong[..]].concat());
    assert_eq!(whole.code, 2, "{}", whole.stderr);
    assert!(whole.stderr.contains(said) && !scene.path("whole/stages/heights.json").exists(), "{}", whole.stderr);
    let right = set("type");
    let right: Vec<&str> = right.iter().map(String::as_str).collect();
    let plan = scene.sizeup(&[&["tiles", "plan", "sizeup.toml", "--output", "city"], &right[..]].concat());
    assert_eq!(plan.code, 0, "{}", plan.stderr);
}

#[test]
fn footprints_and_terrain_are_read_in_an_archive_where_they_lie() {
    let scene = Scene::new();
    let plain = undisturbed(&scene);
    let archive = scene.path("input.zip");
    let mut zip = zip::ZipWriter::new(fs::File::create(&archive).unwrap());
    for name in ["footprints.gpkg", "dtm.tif"] {
        zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        std::io::copy(&mut fs::File::open(scene.path(name)).unwrap(), &mut zip).unwrap();
        fs::remove_file(scene.path(name)).unwrap();
    }
    zip.finish().unwrap();
    let inside = |name: &str| format!("\"/vsizip/{}/{name}\"", archive.display());
    scene.edit("sizeup.toml", |text| {
        text.replace("\"footprints.gpkg\"", &inside("footprints.gpkg")).replace("\"dtm.tif\"", &inside("dtm.tif"))
    });
    undisturbed_again(&scene);
    let buildings = |files: &BTreeMap<String, Vec<u8>>| -> Vec<Vec<u8>> {
        files.iter().filter(|(name, _)| name.ends_with("buildings.jsonl")).map(|(_, bytes)| bytes.clone()).collect()
    };
    assert_eq!(buildings(&plain), buildings(&results(&scene, "city")));
}

fn undisturbed_again(scene: &Scene) {
    for id in plan(scene) {
        let ran = run_tile(scene, &id);
        assert!([0, 5].contains(&ran.code), "{}", ran.stderr);
    }
}

#[test]
fn a_tile_needs_no_more_memory_than_the_plan_says_and_not_much_less() {
    let scene = Scene::new();
    for id in plan(&scene) {
        run_tile(&scene, &id);
        let cost = scene.json(&format!("city/tiles/{id}/cost.json"));
        let (peak_mb, estimate_mb) = (cost["peak_mb"].as_u64().unwrap(), cost["estimate_mb"].as_u64().unwrap());
        assert!(peak_mb <= estimate_mb && estimate_mb < 4 * peak_mb, "{cost}");
    }
}

/// Greatest difference of heights between two cities, metres.
fn greatest_difference_m(scene: &Scene, [one, other]: [&str; 2]) -> f64 {
    let of = |folder: &str| heights(&scene.path(&format!("{folder}/city.city.jsonl")));
    let (one, other) = (of(one), of(other));
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
    let known = one.iter().filter_map(|(id, (height_m, _))| Some((*height_m)? - other[id].0?));
    known.map(f64::abs).fold(0.0, f64::max)
}

#[test]
#[ignore = "slow: make test-slow"]
fn tiles_whose_halo_ends_within_the_town_find_the_heights_of_a_run_in_one_piece() {
    let mut config = SimulateConfig { seed: 3, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::District, 700);
    (config.flight.n_views, config.flight.height_m) = (Some(420), 110.0);
    config.prior.longest_px = 128;
    (config.images.enabled, config.masks.enabled) = (false, false);
    let folder = tempfile::tempdir().unwrap();
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let scene = Scene::of(folder);
    let cut = |name: &str, size: &str| {
        let more = ["--set", "optimise.working_px=128", "--set", "optimise.search.calibrate_on=ground"];
        let ran = scene.run(
            &[&["--tiled", "--jobs", "2", "--heights", "none", "--size", size, "--output", name][..], &more].concat(),
        );
        assert!([0, 5].contains(&ran.code), "{}", ran.stderr);
        let tiles = scene.json(&format!("{name}/tiles.json"))["tiles"].clone();
        tiles.as_array().unwrap().iter().filter_map(|tile| tile["n_solved"].as_u64()).min().unwrap()
    };
    assert_eq!(cut("one", "6000"), 700);
    assert!(cut("many", "500") < 600, "no tile's halo covers the town");
    let far_m = greatest_difference_m(&scene, ["one", "many"]);
    assert!(far_m < 0.0005, "{far_m} m between two tilings");
}

#[test]
fn priors_that_bleed_over_edges_give_the_same_heights_in_any_tiling() {
    let mut config = SimulateConfig { seed: 1, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::Village, 24);
    config.flight.n_views = Some(60);
    (config.camera.width_px, config.camera.height_px) = (448, 336);
    (config.prior.level, config.prior.longest_px) = (PriorLevel::Bleed, 448);
    (config.images.enabled, config.masks.enabled) = (false, false);
    config.errors = ErrorConfig::REALISTIC;
    let folder = tempfile::tempdir().unwrap();
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let scene = Scene::of(folder);
    // Every tile has all buildings in its halo; its views are those that look at its core.
    let tiled = |name: &str, size: &str, margin: &str| {
        let cut = ["--tiled", "--jobs", "2", "--size", size, "--halo", "1500", "--view-margin", margin];
        let more = ["--output", name, "--heights", "none", "--set", "optimise.working_px=448"];
        let ran = scene.run(&[&cut[..], &more].concat());
        assert!([0, 5].contains(&ran.code), "{}", ran.stderr);
    };
    tiled("one", "3000", "0");
    tiled("many", "200", "25");
    let far_m = greatest_difference_m(&scene, ["one", "many"]);
    println!("{far_m} m");
    // Fits along the ground take a part of the rays: 12 mm.
    assert!(far_m <= 0.02, "{far_m} m between two tilings");
}
