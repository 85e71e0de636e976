//! The command `sizeup changes`: what it takes, what it writes, and what it refuses.

use std::fs;
use std::path::Path;

use geo::MapCoords as _;
use geo_types::{Coord, Rect};
use serde_json::Value;
use sizeup::changes::{
    AreaRule, Change, ChangeReason, ChangesConfig, ChangesReport, Class, Compared, LevelRule, ResultPair, compare,
    write_layer,
};
use sizeup::crs::{Crs, Transform};
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::read::{FoundBuildings, ReadOptions};
use sizeup::output::{BuildingRecord, CityModel, Lineage, Status};
use sizeup::survey::Survey;

use crate::tiny_scene::{N_BUILDINGS, N_VIEWS, Outcome, Scene, sizeup};
use crate::two_epochs::{compare_files, write_result};

const CRS: &str = "EPSG:25832";
const NORMAL: &str = "DHHN2016 height";
/// South-west corner of the town, map frame, metres.
const CORNER: [f64; 2] = [565_000.0, 5_932_000.0];

/// A measured building: west, south, width, depth from the town's corner; ground at 12 m, sigma 0.25 m.
fn house(id: &str, [west, south, width, depth]: [f64; 4], height_m: f64) -> BuildingRecord {
    let (west, south) = (CORNER[0] + west, CORNER[1] + south);
    let footprint = Rect::new((west, south), (west + width, south + depth)).to_polygon();
    BuildingRecord { height_sigma_m: Some(0.25), ..BuildingRecord::measured(id, footprint, 12.0, height_m) }
}

/// A row of houses, 30 m apart, all 8 m high.
fn street(prefix: &str, n: usize) -> Vec<BuildingRecord> {
    (0..n).map(|i| house(&format!("{prefix}{i}"), [30.0 * i as f64, 0.0, 12.0, 10.0], 8.0)).collect()
}

/// `sizeup changes old.gpkg new.gpkg` of two towns.
fn changes(old: &[BuildingRecord], new: &[BuildingRecord], more: &[&str]) -> ChangesReport {
    let folder = tempfile::tempdir().unwrap();
    write_result(&folder.path().join("old.gpkg"), old, CRS, NORMAL);
    write_result(&folder.path().join("new.gpkg"), new, CRS, NORMAL);
    compare_files(folder.path(), "old.gpkg", "new.gpkg", more)
}

/// Records as a result that says nothing of its photos.
fn without_photos(records: &[BuildingRecord]) -> Compared<'_> {
    Compared { records, cameras: &[] }
}

/// The row of a building of the new result, or of the old one.
fn row<'r>(report: &'r ChangesReport, id: &str) -> &'r Change {
    let is_about = |change: &&Change| change.new_ids.iter().chain(&change.old_ids).any(|own| own == id);
    report.changes.iter().find(is_about).unwrap_or_else(|| panic!("{id} is in no row"))
}

fn run(folder: &Path, args: &[&str]) -> Outcome {
    sizeup().current_dir(folder).arg("changes").args(args).output().unwrap().into()
}

#[test]
fn each_kind_of_change_is_told_with_its_reason_and_both_ids() {
    let (mut old, mut new) = (street("o", 9), street("n", 9));
    new[1].height_m = Some(11.0);
    new[2].height_m = Some(5.0);
    new[3].footprint = house("", [90.0, 0.0, 16.0, 10.0], 8.0).footprint;
    new[4].status = Status::Doubtful;
    new[5].height_m = Some(0.4);
    old.remove(6);
    new.remove(7);
    new.push(house("far", [900.0, 0.0, 10.0, 10.0], 8.0));
    let report = changes(&old, &new, &[]);
    for (id, other, class, reason) in [
        ("n0", "o0", Class::Same, ChangeReason::WithinLeast),
        ("n1", "o1", Class::Raised, ChangeReason::RoofMoved),
        ("n2", "o2", Class::Lowered, ChangeReason::RoofMoved),
        ("n3", "o3", Class::FootprintChanged, ChangeReason::FootprintGrew),
        ("n4", "o4", Class::Unsure, ChangeReason::NewDoubtful),
        ("n5", "o5", Class::Gone, ChangeReason::FlatNow),
        ("n6", "", Class::New, ChangeReason::NotInOld),
        ("o7", "", Class::Gone, ChangeReason::NotInNew),
        ("far", "", Class::Outside, ChangeReason::OutsideOld),
    ] {
        let found = row(&report, id);
        assert_eq!((found.class, found.reasons[0]), (class, reason), "{id}: {found:?}");
        assert!(other.is_empty() || found.old_ids == [other], "{id}: {found:?}");
    }
    let raised = row(&report, "n1");
    assert_eq!((raised.d_height_m, raised.d_roof_z_m, raised.d_ground_z_m), (Some(3.0), Some(3.0), Some(0.0)));
    assert!((raised.sigma_m.unwrap() - 0.354).abs() < 1e-9 && (raised.z.unwrap() - 8.485).abs() < 1e-9, "{raised:?}");
    assert!(raised.explanation.contains("roof level +3.00 m, sigma 0.35 m"), "{}", raised.explanation);
    assert_eq!((raised.iou, raised.old_area_m2, raised.new_area_m2), (Some(1.0), Some(120.0), Some(120.0)));
    assert_eq!(report.level_reference.as_deref(), Some(NORMAL));
}

#[test]
fn a_building_beyond_the_old_footprints_is_new_where_the_old_photos_looked() {
    let (old, mut new) = (street("o", 3), street("n", 3));
    new.push(house("edge", [30.0, 60.0, 10.0, 10.0], 8.0));
    let (west, south) = (CORNER[0], CORNER[1]);
    let cameras =
        [[west, south - 90.0], [west, south + 90.0], [west + 90.0, south + 90.0], [west + 90.0, south - 90.0]];
    let class = |cameras: &[[f64; 2]], area: AreaRule| {
        let config = ChangesConfig { area, ..ChangesConfig::default() };
        let old = Compared { records: &old, cameras };
        compare(&old, &without_photos(&new), &config).changes[3].class
    };
    assert_eq!(class(&cameras, AreaRule::Photos), Class::New);
    assert_eq!((class(&cameras, AreaRule::Footprints), class(&[], AreaRule::Photos)), (Class::Outside, Class::Outside));
}

#[test]
fn another_ground_is_no_other_roof() {
    let (old, mut new) = (street("o", 3), street("n", 3));
    (new[1].ground_z_m, new[1].base_z_m, new[1].height_m) = (Some(15.0), Some(15.0), Some(5.0));
    (new[2].ground_z_m, new[2].base_z_m) = (Some(15.0), Some(15.0));
    let report = changes(&old, &new, &[]);
    assert_eq!((row(&report, "n1").class, row(&report, "n1").reasons[0]), (Class::Same, ChangeReason::GroundDiffers));
    assert_eq!((row(&report, "n2").class, row(&report, "n2").reasons[0]), (Class::Unsure, ChangeReason::GroundMoved));
    let of_heights = changes(&old, &new, &["--heights-only"]);
    assert_eq!((row(&of_heights, "n1").class, row(&of_heights, "n2").class), (Class::Lowered, Class::Same));
    assert_eq!((of_heights.level_reference, row(&report, "n1").d_ground_z_m), (None, Some(3.0)));
}

#[test]
fn a_house_that_was_split_and_raised_in_part_is_one_row() {
    let old = street("o", 2);
    let halves = [house("left", [0.0, 0.0, 6.0, 10.0], 8.0), house("right", [6.0, 0.0, 6.0, 10.0], 16.0)];
    let report = changes(&old, &[&halves[..], &street("n", 2)[1..]].concat(), &[]);
    let split = row(&report, "right");
    assert_eq!(
        (&*split.new_ids, &*split.old_ids),
        (&["left".to_owned(), "right".to_owned()][..], &["o0".to_owned()][..])
    );
    assert_eq!(
        (split.class, split.d_height_m, split.reasons.contains(&ChangeReason::Split)),
        (Class::Raised, Some(4.0), true)
    );
    assert_eq!(report.changes.len(), 2);
}

#[test]
fn heights_without_a_sigma_are_compared_only_with_one_that_is_given() {
    let (mut old, mut new) = (street("o", 2), street("n", 2));
    old[0].height_sigma_m = None;
    new[0].height_m = Some(12.0);
    let report = changes(&old, &new, &[]);
    assert_eq!(
        (row(&report, "n0").class, row(&report, "n0").reasons[0]),
        (Class::Unsure, ChangeReason::OldSigmaUnknown)
    );
    assert_eq!(row(&changes(&old, &new, &["--old-sigma", "0.5"]), "n0").class, Class::Raised);
    assert_eq!(row(&changes(&old, &new, &["--old-sigma", "3"]), "n0").class, Class::Unsure);
}

#[test]
fn a_shift_of_the_flight_is_no_change_of_the_town_unless_it_is_kept() {
    let (old, mut new) = (street("o", 14), street("n", 14));
    for record in &mut new {
        record.height_m = record.height_m.map(|height_m| height_m + 2.5);
    }
    let taken = changes(&old, &new, &[]);
    assert_eq!((taken.counts["same"], taken.common_shift.roof_z.value_m), (14, 2.5));
    assert!(taken.notes.iter().any(|note| note.contains("roofs +2.50 m")), "{:?}", taken.notes);
    let kept = changes(&old, &new, &["--keep-shift"]);
    assert_eq!((kept.counts["raised"], kept.common_shift.roof_z.is_taken_off), (14, false));
}

#[test]
fn the_layer_opens_with_styles_lineage_and_a_row_per_building() {
    let folder = tempfile::tempdir().unwrap();
    let (old, mut new) = (street("o", 4), street("n", 4));
    new.remove(2);
    write_result(&folder.path().join("old.gpkg"), &old, CRS, NORMAL);
    write_result(&folder.path().join("new.gpkg"), &new, CRS, NORMAL);
    let outcome = run(folder.path(), &["old.gpkg", "new.gpkg", "--output", "out/of", "--json"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let summary: Value = serde_json::from_str(&outcome.stdout).unwrap();
    assert_eq!((&summary["counts"]["gone"], &summary["counts"]["same"]), (&Value::from(1), &Value::from(3)));
    assert!(summary.get("changes").is_none(), "buildings are in the files");
    assert_eq!(summary["old"]["sha256"].as_str().unwrap().len(), 64);
    let names: Vec<String> = {
        let entries = fs::read_dir(folder.path().join("out/of")).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    assert_eq!(names, ["changes.gpkg", "changes.html", "changes.json", "changes.png"]);
    let path = folder.path().join("out/of/changes.gpkg");
    let found = FoundBuildings::read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(found.crs.unwrap().horizontal_epsg(), Some(25832));
    let gone = found.buildings.iter().find(|building| building.attributes["class"] == "gone").unwrap();
    assert_eq!((&gone.attributes["old_id"], &gone.attributes["reasons"]), (&"o2".into(), &"not_in_new".into()));
    assert_eq!((found.buildings.len(), gone.footprint.is_some()), (4, true));
    let text_of = |query: &str| {
        let layer = sizeup::geodata::vector::VectorLayer::open(&path, None).unwrap();
        layer.into_text_of(query).unwrap()
    };
    let style = text_of("SELECT styleQML FROM layer_styles WHERE f_table_name = 'changes' AND useAsDefault = 1");
    assert!(style.contains("footprint_changed"));
    let lineage: Lineage = serde_json::from_str(&text_of("SELECT lineage FROM sizeup_lineage")).unwrap();
    assert_eq!(lineage.inputs.iter().map(|input| input.role.as_str()).collect::<Vec<_>>(), ["old", "new"]);
}

#[test]
fn the_page_lists_what_has_changed_whatever_ids_are_called() {
    let folder = tempfile::tempdir().unwrap();
    let (old, mut new) = (street("o", 3), street("n", 3));
    new[1].id = "<b>&\"1\"".to_owned();
    new[1].height_m = Some(12.0);
    write_result(&folder.path().join("old.gpkg"), &old, CRS, NORMAL);
    write_result(&folder.path().join("new.gpkg"), &new, CRS, NORMAL);
    compare_files(folder.path(), "old.gpkg", "new.gpkg", &[]);
    let page = fs::read_to_string(folder.path().join("changes/changes.html")).unwrap();
    assert!(page.contains("<td>&lt;b&gt;&amp;&quot;1&quot;</td><td>o1</td>") && !page.contains("<b>&"), "{page}");
    assert!(page.contains("<td class=\"n\">+4.00</td>") && page.contains("data:image/png;base64,"));
    assert!(!page.contains("<td>o0</td>"), "what is the same is counted only");
    crate::report::is_accessible(&format!("file://{}", folder.path().join("changes/changes.html").display()));
}

#[test]
fn a_result_in_another_crs_is_brought_over_and_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (street("o", 3), street("n", 3));
    let transform = Transform::new(&Crs::parse(CRS).unwrap(), &Crs::parse("EPSG:25833").unwrap()).unwrap();
    let moved: Vec<BuildingRecord> = old
        .into_iter()
        .map(|mut record| {
            record.footprint = record.footprint.map(|footprint| {
                footprint.map_coords(|c| transform.point(c.x, c.y).map(|(x, y)| Coord { x, y }).unwrap())
            });
            record
        })
        .collect();
    write_result(&folder.path().join("old.gpkg"), &moved, "EPSG:25833", NORMAL);
    write_result(&folder.path().join("new.gpkg"), &new, CRS, NORMAL);
    let report = compare_files(folder.path(), "old.gpkg", "new.gpkg", &[]);
    assert_eq!(report.counts["same"], 3, "{:?}", report.changes);
    assert!(report.notes.iter().any(|note| note.contains("brought from")), "{:?}", report.notes);
}

#[test]
fn cityjson_is_as_good_as_a_geopackage() {
    let folder = tempfile::tempdir().unwrap();
    let (old, mut new) = (street("o", 3), street("n", 3));
    new[1].height_m = Some(12.0);
    write_result(&folder.path().join("old.gpkg"), &old, CRS, NORMAL);
    let lineage = Lineage { vertical_reference: NORMAL.to_owned(), ..Lineage::default() };
    let (crs, survey) = (Crs::parse(CRS).unwrap(), Survey::default());
    let model = CityModel { records: &new[..], crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    fs::create_dir(folder.path().join("new")).unwrap();
    cityjson::write(&folder.path().join("new/city.city.json"), &model, &CityJsonConfig::default()).unwrap();
    let report = compare_files(folder.path(), "old.gpkg", "new", &[]);
    assert_eq!((report.counts["same"], row(&report, "n1").class), (2, Class::Raised), "{:?}", report.changes);
    assert_eq!(report.level_reference.as_deref(), Some(NORMAL));
}

#[test]
fn what_cannot_be_compared_is_said_with_a_hint_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_result(&at("old.gpkg"), &street("o", 3), CRS, NORMAL);
    write_result(&at("new.gpkg"), &street("n", 3), CRS, NORMAL);
    write_result(&at("other.gpkg"), &street("n", 3), CRS, "DHHN92 height");
    write_result(&at("empty.gpkg"), &[], CRS, NORMAL);
    write_result(&at("feet.gpkg"), &street("n", 3), "EPSG:2263", NORMAL);
    fs::create_dir(at("folder")).unwrap();
    fs::write(at("torn.json"), "{\"type\": \"CityJSON\", \"CityObjects\"").unwrap();
    for (args, code, said) in [
        (&["nowhere", "new.gpkg"][..], 3, "the old result nowhere does not exist"),
        (&["old.gpkg", "folder"], 3, "city.gpkg, city.city.jsonl, city.city.json"),
        (&["old.gpkg", "./old.gpkg"], 2, "are the same file"),
        (&["empty.gpkg", "new.gpkg"], 3, "the old result empty.gpkg has no building with a footprint"),
        (&["old.gpkg", "other.gpkg"], 3, "--heights-only"),
        (&["old.gpkg", "feet.gpkg"], 3, "projected"),
        (&["old.gpkg", "torn.json"], 3, "torn.json"),
        (&["old.gpkg", "new.gpkg", "--least-m", "0"], 2, "least_m is 0"),
        (&["old.gpkg", "new.gpkg", "--sigmas", "99"], 2, "expected 1 to 10"),
    ] {
        let outcome = run(folder.path(), &[args, &["--output", "changes"]].concat());
        assert_eq!(outcome.code, code, "{args:?}: {}", outcome.stderr);
        assert!(outcome.stderr.contains(said) && outcome.stdout.is_empty(), "{args:?}: {}", outcome.stderr);
        assert!(!at("changes").exists(), "{args:?}");
    }
    assert_eq!(run(folder.path(), &["old.gpkg", "other.gpkg", "--heights-only", "--output", "changes"]).code, 0);
}

#[test]
fn one_thread_or_many_come_to_the_same_bytes() {
    let (old, mut new) = (street("o", 40), street("n", 40));
    for (i, record) in new.iter_mut().enumerate() {
        record.height_m = Some(8.0 + 0.37 * i as f64);
    }
    let folder = tempfile::tempdir().unwrap();
    let crs = Crs::parse(CRS).unwrap();
    let bytes = [1, 4].map(|n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        let comparison =
            pool.install(|| compare(&without_photos(&old), &without_photos(&new), &ChangesConfig::default()));
        let path = folder.path().join(format!("{n_threads}.gpkg"));
        write_layer(&path, &comparison.changes, &crs, &Lineage::default()).unwrap();
        (fs::read(path).unwrap(), comparison)
    });
    assert!(bytes[0] == bytes[1]);
}

#[test]
fn two_runs_of_a_town_find_the_building_that_was_torn_down() {
    let scene = Scene::new();
    let before = scene.run(&[]);
    assert!(matches!(before.code, 0 | 5), "{}", before.stderr);
    // The one nearest to the middle of all: nobody doubts that the second flight looked there.
    let truth = scene.json("truth.geojson");
    let middle_of = |feature: &Value| {
        let ring = feature["geometry"]["coordinates"][0].as_array().unwrap();
        let mean = |axis: usize| ring.iter().map(|c| c[axis].as_f64().unwrap()).sum::<f64>() / ring.len() as f64;
        [mean(0), mean(1)]
    };
    let middles: Vec<[f64; 2]> = truth["features"].as_array().unwrap().iter().map(middle_of).collect();
    let town = [0, 1].map(|axis| middles.iter().map(|middle| middle[axis]).sum::<f64>() / middles.len() as f64);
    let distance = |middle: &[f64; 2]| (middle[0] - town[0]).hypot(middle[1] - town[1]);
    let torn_down =
        (0..middles.len()).min_by(|&a, &b| distance(&middles[a]).total_cmp(&distance(&middles[b]))).unwrap();
    let id = truth["features"][torn_down]["properties"]["id"].as_str().unwrap().to_owned();
    scene.change_footprints(|features| drop(features.remove(torn_down)));
    let after = scene.run(&["--set", "project.output='later'"]);
    assert!(matches!(after.code, 0 | 5), "{}", after.stderr);
    let outcome = scene.sizeup(&["changes", "result", "later", "--output", "changes"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let report: ChangesReport = serde_json::from_value(scene.json("changes/changes.json")).unwrap();
    assert_eq!(report.changes.len(), N_BUILDINGS);
    assert_eq!((row(&report, &id).class, report.counts["gone"], report.counts["new"]), (Class::Gone, 1, 0));
    assert!(outcome.stdout.contains("1  gone"), "{}", outcome.stdout);
    // Where a flight looked is told by its photos too.
    let pair = ResultPair::read(&scene.path("result"), &scene.path("later"), LevelRule::Compare).unwrap();
    assert_eq!((pair.old.cameras.len(), pair.new.cameras.len()), (N_VIEWS, N_VIEWS));
}
