//! A city that is edited at random and planned again: only tiles that an edit can touch are run, and the result is that of
//! a run from nothing, to the byte.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use rand::seq::{IndexedRandom as _, SliceRandom as _};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use sizeup::geodata::raster::RasterFile;
use sizeup::geodata::{GridPlace, write_geotiff};
use sizeup::simulate::{SimulateConfig, simulate};

use crate::reviews::decide;
use crate::tiles::{assert_same, heights, ids, results};
use crate::tiny_scene::{Scene, write_npy};

/// Side of the tiles, metres.
const SIDE_M: f64 = 40.0;
/// Fewest tiles of the town.
const LEAST_TILES: usize = 30;
/// Options of every plan: small tiles that do not see each other.
const CUT: [&str; 10] =
    ["--size", "40", "--halo", "30", "--view-margin", "5", "--heights", "ellipsoidal", "--jobs", "2"];

/// A town of its own, narrow views over it, footprints as GeoJSON.
fn town(n_buildings: usize) -> Scene {
    let mut config = SimulateConfig::default();
    config.town.n_buildings = n_buildings;
    // Far from where the local frame's origin would round otherwise: a plan keeps its own, one from nothing takes the nearest.
    config.centre_m = [565_000.0, 5_932_000.0];
    config.flight.n_views = Some(24);
    (config.camera.width_px, config.camera.height_px) = (160, 120);
    config.prior.longest_px = 160;
    config.terrain.margin_m = 400.0;
    config.images.enabled = false;
    config.masks.enabled = false;
    let folder = tempfile::tempdir().unwrap();
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let path = folder.path().join("sizeup.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(
        &path,
        format!("{text}\n[optimise]\nworking_px = 80\n\n[output]\npictures = false\nreport.page = false\n"),
    )
    .unwrap();
    let scene = Scene::of(folder);
    scene.change_footprints(|features| {
        // Attributes that not all have, so that a reader meets them in another order when the listing has another.
        for (i, feature) in features.iter_mut().enumerate() {
            for (name, every) in [("floors", 2), ("street", 3)] {
                if i % every == 0 {
                    feature["properties"][name] = json!(i);
                }
            }
        }
    });
    scene
}

/// Plans, runs what is not done, merges.
fn run(scene: &Scene) {
    let ran = scene.run(&[&["--output", "city", "--tiled"], &CUT[..]].concat());
    assert!([0, 5].contains(&ran.code), "{}", ran.stderr);
}

/// Tiles that a plan would run again.
fn to_run(scene: &Scene) -> BTreeSet<String> {
    let cut = &CUT[..CUT.len() - 2];
    let args = [&["tiles", "plan", "sizeup.toml", "--output", "city", "--dry-run", "--json"], cut].concat();
    let told = scene.sizeup(&args);
    assert_eq!(told.code, 0, "{}", told.stderr);
    let planned: Value = serde_json::from_str(&told.stdout).unwrap();
    let changes = planned["changes"].as_array().unwrap();
    for change in changes {
        println!("{}: {}", change["tile"]["id"], change["why"]);
    }
    changes.iter().map(|change| change["tile"]["id"].as_str().unwrap().to_owned()).collect()
}

/// What each tile cost, which tells whether it was run.
fn costs(scene: &Scene) -> BTreeMap<String, Vec<u8>> {
    let cost = |id: String| Some((id.clone(), fs::read(scene.path(&format!("city/tiles/{id}/cost.json"))).ok()?));
    ids(scene).into_iter().filter_map(cost).collect()
}

/// Where something changed: places of the map, photos, or what every tile is made from.
#[derive(Default)]
struct Touched {
    places: Vec<[f64; 2]>,
    photos: Vec<String>,
    all: bool,
}

impl Touched {
    /// Whether a tile can notice, by what the plan says it reads.
    fn touches(&self, scene: &Scene, tile: &Value) -> bool {
        let side = |name: &str| tile["halo"][name].as_f64().unwrap();
        let holds = |[x, y]: &[f64; 2]| {
            (side("west_m")..=side("east_m")).contains(x) && (side("south_m")..=side("north_m")).contains(y)
        };
        let id = tile["id"].as_str().unwrap();
        let views = fs::read_to_string(scene.path(&format!("city/tiles/{id}/views.json"))).unwrap();
        self.all || self.places.iter().any(holds) || self.photos.iter().any(|photo| views.contains(photo))
    }
}

fn corners(feature: &Value) -> Vec<[f64; 2]> {
    let ring = feature["geometry"]["coordinates"][0].as_array().unwrap();
    ring.iter().map(|corner| [corner[0].as_f64().unwrap(), corner[1].as_f64().unwrap()]).collect()
}

/// Middle of a footprint's box.
fn middle(feature: &Value) -> [f64; 2] {
    let corners = corners(feature);
    [0, 1].map(|axis| {
        let (low, high) = corners
            .iter()
            .map(|corner| corner[axis])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        f64::midpoint(low, high)
    })
}

fn shift(feature: &mut Value, by: [f64; 2]) {
    let moved: Vec<Value> = corners(feature).iter().map(|[x, y]| json!([x + by[0], y + by[1]])).collect();
    feature["geometry"]["coordinates"] = json!([moved]);
}

/// The stem of a photo by its line of `images.txt`.
fn stem_of(line: &str) -> &str {
    let name = line.split_whitespace().last().unwrap();
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// Changes the list of photos, two lines each.
fn change_photos(scene: &Scene, change: impl FnOnce(&mut Vec<[String; 2]>)) {
    let path = scene.path("sparse/images.txt");
    let text = fs::read_to_string(&path).unwrap();
    let (head, lines): (Vec<&str>, Vec<&str>) = text.lines().partition(|line| line.starts_with('#'));
    let mut photos: Vec<[String; 2]> = lines.chunks(2).map(|two| [0, 1].map(|i| two[i].to_owned())).collect();
    change(&mut photos);
    let lines = head.into_iter().map(str::to_owned).chain(photos.into_iter().flatten());
    fs::write(&path, lines.map(|line| format!("{line}\n")).collect::<String>()).unwrap();
}

/// Lowers the terrain by two metres within ten of a place.
fn lower_terrain(scene: &Scene, place: [f64; 2]) {
    let path = scene.path("dtm.tif");
    let file = RasterFile::open(&path).unwrap();
    let (grid, mut heights, crs) = (file.grid().unwrap(), file.read(1).unwrap(), file.crs().unwrap().unwrap());
    let width = heights.width();
    for (i, z_m) in heights.data_mut().iter_mut().enumerate() {
        let x = grid.west + ((i % width) as f64 + 0.5) * grid.cell_x;
        let y = grid.north - ((i / width) as f64 + 0.5) * grid.cell_y;
        if (x - place[0]).hypot(y - place[1]) < 10.0 {
            *z_m -= 2.0;
        }
    }
    let (corner_m, cell_m) = ((grid.west, grid.north), (grid.cell_x, grid.cell_y));
    write_geotiff(&path, &heights, &GridPlace { corner_m, cell_m, crs: &crs, nodata: -9999.0 }).unwrap();
}

/// Makes an edit of some kind; says where.
fn edit(scene: &Scene, kind: usize, chance: &mut ChaCha8Rng) -> Touched {
    let mut layer = scene.json("footprints.geojson");
    let features = layer["features"].as_array_mut().unwrap();
    let at = chance.random_range(0..features.len());
    let mut touched = Touched::default();
    match kind {
        // Moved a little.
        0 => {
            touched.places.push(middle(&features[at]));
            shift(&mut features[at], [chance.random_range(0.5..2.0), chance.random_range(-2.0..-0.5)]);
            touched.places.push(middle(&features[at]));
        }
        // Gone.
        1 => touched.places.push(middle(&features.remove(at))),
        // One more, 30 m outside the rim, listed first.
        2 => {
            let east = features.iter().max_by(|a, b| middle(a)[0].total_cmp(&middle(b)[0])).unwrap();
            let mut more = east.clone();
            more["properties"]["id"] = json!(format!("more{}", chance.random::<u32>()));
            shift(&mut more, [30.0, 0.0]);
            touched.places.push(middle(&more));
            features.insert(0, more);
        }
        // The same in another order.
        3 => features.shuffle(chance),
        // Another prior of a photo, or none.
        4 => {
            let stem = scene.stems().choose(chance).unwrap().clone();
            write_npy(&scene.path(&format!("priors/{stem}.npy")), 40, 30, &vec![100.0; 1200]);
            touched.photos.push(stem);
        }
        5 => {
            let stem = scene.stems().choose(chance).unwrap().clone();
            fs::remove_file(scene.path(&format!("priors/{stem}.npy"))).unwrap();
            touched.photos.push(stem);
        }
        // Photos listed in another order, one of them no longer.
        6 | 7 => change_photos(scene, |photos| {
            photos.shuffle(chance);
            if kind == 7 {
                touched.photos.push(stem_of(&photos.pop().unwrap()[0]).to_owned());
            }
        }),
        // Three more photos, listed first.
        8 => change_photos(scene, |photos| {
            for i in 0..3 {
                let like = photos.choose(chance).unwrap().clone();
                let stem = format!("more{i}");
                let prior = |stem: &str| scene.path(&format!("priors/{stem}.npy"));
                // One whose prior an edit took has none to give.
                let _ = fs::copy(prior(stem_of(&like[0])), prior(&stem));
                let mut words: Vec<String> = like[0].split_whitespace().map(str::to_owned).collect();
                words[0] = (9000 + i).to_string();
                words[5] = (words[5].parse::<f64>().unwrap() + 3.0).to_string();
                *words.last_mut().unwrap() = format!("{stem}.jpg");
                photos.insert(0, [words.join(" "), String::new()]);
                touched.photos.push(stem);
            }
        }),
        // The house that is closest to it, over the seam to its east.
        9 => {
            let to_seam = |feature: &Value| SIDE_M - middle(feature)[0].rem_euclid(SIDE_M) + 0.5;
            let closest = (0..features.len()).min_by(|&a, &b| to_seam(&features[a]).total_cmp(&to_seam(&features[b])));
            let house = &mut features[closest.unwrap()];
            touched.places.push(middle(house));
            shift(house, [to_seam(house), 0.0]);
            touched.places.push(middle(house));
        }
        10 => {
            // A number as the others': a text would make texts of all.
            features[at]["properties"]["floors"] = json!(1000);
            touched.places.push(middle(&features[at]));
        }
        // A hollow under a house.
        11 => {
            lower_terrain(scene, middle(&features[at]));
            touched.all = true;
        }
        _ => {
            scene.edit("sizeup.toml", |text| format!("{text}\n[refinement]\nlong_side_px = 900\n"));
            touched.all = true;
        }
    }
    fs::write(scene.path("footprints.geojson"), layer.to_string()).unwrap();
    touched
}

/// Results without those of tiles that the plan no longer has.
fn of_plan(scene: &Scene) -> BTreeMap<String, Vec<u8>> {
    let ids: BTreeSet<String> = ids(scene).into_iter().collect();
    let is_kept = |name: &String| match name.strip_prefix("tiles/e") {
        Some(rest) => ids.contains(&format!("e{}", rest.split(['/', '.']).next().unwrap())),
        None => true,
    };
    results(scene, "city").into_iter().filter(|(name, _)| is_kept(name)).collect()
}

fn assert_as_from_nothing(scene: &Scene, kind: usize) {
    let kept = of_plan(scene);
    fs::rename(scene.path("city"), scene.path("kept")).unwrap();
    run(scene);
    println!("edit of kind {kind}");
    assert_same(&results(scene, "city"), &kept);
    fs::remove_dir_all(scene.path("city")).unwrap();
    fs::rename(scene.path("kept"), scene.path("city")).unwrap();
}

#[test]
fn edits_at_random_run_the_tiles_that_they_touch_and_come_to_what_a_run_from_nothing_does() {
    edits_run_what_they_touch(16, (0..8).collect());
}

#[test]
#[ignore = "slow: make test-slow"]
fn edits_of_all_kinds_run_the_tiles_that_they_touch_and_come_to_what_a_run_from_nothing_does() {
    edits_run_what_they_touch(46, (0..13).collect());
}

fn edits_run_what_they_touch(n_buildings: usize, mut kinds: Vec<usize>) {
    let scene = town(n_buildings);
    run(&scene);
    assert!(n_buildings < 40 || ids(&scene).len() >= LEAST_TILES, "{}", ids(&scene).len());
    let mut chance = ChaCha8Rng::seed_from_u64(26);
    kinds.shuffle(&mut chance);
    let (mut n_spared, mut n_run) = (0, 0);
    for (i, kind) in kinds.into_iter().enumerate() {
        let plan_before = scene.json("city/tiles.json");
        let saw_before: BTreeMap<String, String> = ids(&scene)
            .into_iter()
            .map(|id| (id.clone(), fs::read_to_string(scene.path(&format!("city/tiles/{id}/views.json"))).unwrap()))
            .collect();
        let touched = edit(&scene, kind, &mut chance);
        let told = to_run(&scene);
        let before = costs(&scene);
        run(&scene);
        let after = costs(&scene);
        let ran: BTreeSet<String> =
            after.iter().filter(|(id, cost)| before.get(*id) != Some(*cost)).map(|(id, _)| id.clone()).collect();
        assert_eq!(ran, told, "what was run is what a dry run had told");
        let plan = scene.json("city/tiles.json");
        for settled in ["origin_m", "heights_m", "halo_m", "view_margin_m"] {
            assert_eq!(plan[settled], plan_before[settled], "no edit carries it past a round number: {settled}");
        }
        let saw =
            |id: &str| saw_before.get(id).is_none_or(|views| touched.photos.iter().any(|photo| views.contains(photo)));
        let can_notice: BTreeSet<String> = plan["tiles"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|tile| saw(tile["id"].as_str().unwrap()) || touched.touches(&scene, tile))
            .map(|tile| tile["id"].as_str().unwrap().to_owned())
            .collect();
        assert!(ran.is_subset(&can_notice), "kind {kind}: {ran:?} were run, {can_notice:?} can notice");
        (n_run, n_spared) = (n_run + ran.len(), n_spared + after.len() - ran.len());
        // Each comparison is a run from nothing: after some edits, and the last.
        if i % 4 == 0 {
            assert_as_from_nothing(&scene, kind);
        }
    }
    assert!(n_run > 0 && n_spared > n_run, "{n_run} tiles run, {n_spared} spared");
}

#[test]
fn decisions_about_buildings_reach_their_tiles_and_outlive_another_tiling() {
    let scene = town(16);
    run(&scene);
    let first = heights(&scene.path("city/city.city.jsonl"));
    let whole = |id: &&String| first[*id].0.is_some() && !id.contains('#');
    let mut measured = first.keys().filter(whole);
    let (corrected, wrong) = (measured.next().unwrap(), measured.next_back().unwrap());
    scene.edit("sizeup.toml", |text| format!("{text}\n[reviews]\npath = \"reviews.geojson\"\n"));
    let decided = [
        json!({ "building_id": corrected, "decision": "corrected", "height_m": 12.5 }),
        json!({ "building_id": wrong, "decision": "wrong" }),
        json!({ "building_id": "nobody", "decision": "wrong" }),
    ];
    let expected = || {
        let mut expected = first.clone();
        expected.insert(corrected.clone(), (Some(12.5), "reviewed".to_owned()));
        expected.insert(wrong.clone(), (None, "unknown".to_owned()));
        expected
    };
    // None yet: a file without decisions changes no tile.
    decide(&scene, "reviews.geojson", &[]);
    assert!(to_run(&scene).is_empty());
    decide(&scene, "reviews.geojson", &decided);
    let touched = to_run(&scene);
    assert!(!touched.is_empty() && touched.len() < ids(&scene).len(), "{touched:?}");
    run(&scene);
    assert_eq!(heights(&scene.path("city/city.city.jsonl")), expected());
    assert_eq!(issues_of(&scene, "review_unmatched"), ["nobody"]);
    // The city as it was, once the decisions are taken back.
    decide(&scene, "reviews.geojson", &[]);
    assert_eq!(to_run(&scene), touched);
    run(&scene);
    assert_eq!(heights(&scene.path("city/city.city.jsonl")), first);
    // Other tiles, and one piece.
    decide(&scene, "reviews.geojson", &decided);
    let other = scene.run(&["--output", "other", "--tiled", "--size", "150", "--halo", "60"]);
    assert!([0, 5].contains(&other.code), "{}", other.stderr);
    let other = heights(&scene.path("other/city.city.jsonl"));
    for id in [corrected, wrong] {
        assert_eq!(other[id], expected()[id]);
    }
}

/// Buildings that the city has an issue of this code about.
fn issues_of(scene: &Scene, code: &str) -> Vec<String> {
    let issues = scene.json("city/issues.json");
    let of_code = issues.as_array().unwrap().iter().filter(|issue| issue["code"] == code);
    of_code.map(|issue| issue["subject"]["id"].as_str().unwrap_or_default().to_owned()).collect()
}
