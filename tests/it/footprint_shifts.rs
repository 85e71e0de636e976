//! Single footprints that lie elsewhere than the photos show their buildings: told by how much, and heights measured where they are.

use std::collections::BTreeMap;
use std::path::Path;

use geo::{Area as _, BooleanOps as _, Centroid as _};
use serde_json::Value;
use sizeup::output::BuildingRecord;
use sizeup::output::read::{FoundBuildings, ReadOptions};
use sizeup::simulate::{ErrorConfig, SimulateConfig, TownKind, simulate};

use crate::tiny_scene::{Outcome, sizeup};

fn town(kind: TownKind, folder: &Path, building_m: f64) {
    let mut config = SimulateConfig { seed: 43, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (kind, 24);
    config.flight.n_views = Some(50);
    (config.images.enabled, config.masks.enabled) = (false, false);
    config.errors = ErrorConfig { vertex_m: 0.1, building_m, ..ErrorConfig::REALISTIC };
    simulate(&config, folder, &|_, _| {}).unwrap();
}

/// Runs a town: its buildings, those of its issues that tell of single footprints, and the mean error of its heights, metres.
fn run(folder: &Path, more: &[&str]) -> (BTreeMap<String, BuildingRecord>, Vec<Value>, f64) {
    let mut command = sizeup();
    command.arg("run").arg(folder.join("sizeup.toml")).args(more);
    command.args(["--set", "output.pictures=false", "--set", "output.report.page=false"]);
    let outcome: Outcome = command.output().unwrap().into();
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let issues: Value = serde_json::from_slice(&std::fs::read(folder.join("result/issues.json")).unwrap()).unwrap();
    let is_told = |issue: &&Value| issue["code"].as_str().unwrap().starts_with("footprint");
    let told = issues.as_array().unwrap().iter().filter(is_told).cloned().collect();
    let mut command = sizeup();
    command.arg("evaluate").arg(folder.join("result/city.city.json")).arg(folder.join("truth.geojson")).arg("--json");
    let evaluated: Value = serde_json::from_slice(&command.output().unwrap().stdout).unwrap();
    (buildings(&folder.join("result/city.city.json")), told, evaluated["all"]["error_mean_m"].as_f64().unwrap())
}

fn buildings(path: &Path) -> BTreeMap<String, BuildingRecord> {
    let found = FoundBuildings::read(path, &ReadOptions::default()).unwrap().to_records();
    found.into_iter().map(|record| (record.id.clone(), record)).collect()
}

/// By how far a footprint lies from the true one, metres.
fn off_m(footprint: &geo_types::Polygon<f64>, of_truth: &BuildingRecord) -> f64 {
    let centre = |polygon: &geo_types::Polygon<f64>| polygon.centroid().unwrap();
    let (a, b) = (centre(footprint), centre(of_truth.footprint.as_ref().unwrap()));
    (a.x() - b.x()).hypot(a.y() - b.y())
}

#[test]
fn footprints_that_are_off_one_by_one_are_told_and_heights_are_measured_where_they_are() {
    for (kind, least_told) in [(TownKind::Village, 8), (TownKind::District, 8)] {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        town(kind, folder, 0.8);
        let (_, untold, before_m) = run(folder, &["--set", "optimise.search.measure_shift=false"]);
        assert!(untold.iter().all(|issue| issue["code"] != "footprint_off"));
        let (records, issues, after_m) = run(folder, &[]);
        let truth = buildings(&folder.join("truth.geojson"));
        let mut n_told = 0;
        for record in records.values().filter(|record| record.footprint_shift.is_some()) {
            // Parts of a building that was split stand as the whole does.
            let Some(of_truth) = truth.get(&record.id) else { continue };
            let given_m = off_m(record.footprint.as_ref().unwrap(), of_truth);
            let moved_m = off_m(&record.footprint_in_photos().unwrap(), of_truth);
            assert!(moved_m < 0.7 && moved_m < given_m, "{kind:?} {}: {given_m:.2} m, moved {moved_m:.2} m", record.id);
            n_told += 1;
        }
        let large = records.values().filter_map(|record| Some((record, truth.get(&record.id)?)));
        let n_large =
            large.filter(|(record, of_truth)| off_m(record.footprint.as_ref().unwrap(), of_truth) > 0.75).count();
        assert!(n_told >= least_told, "{kind:?}: {n_told} told, {n_large} are 0.75 m off");
        assert!(after_m < before_m + 0.01, "{kind:?}: {before_m:.3} m, {after_m:.3} m where they are");
        let notes = issues.iter().filter(|issue| issue["code"] == "footprint_off").count();
        assert!(notes >= n_told && issues.iter().any(|issue| issue["code"] == "footprints_off"), "{issues:?}");
        // Asked for, the moved footprints take the place of the given ones; houses that share walls still do.
        let (moved, ..) = run(folder, &["--from", "output", "--set", "output.footprints=in_photos"]);
        let mut overlap_m2 = 0.0;
        for (id, record) in &moved {
            let given = &records[id];
            let expected = given.footprint_in_photos().or_else(|| given.footprint.clone()).unwrap();
            let footprint = record.footprint.as_ref().unwrap();
            assert!(off_m(footprint, &BuildingRecord::measured("", expected, 0.0, 1.0)) < 0.01, "{id}");
            let others =
                moved.iter().filter(|(other, _)| *other > id).filter_map(|(_, other)| other.footprint.as_ref());
            overlap_m2 += others.map(|other| footprint.intersection(other).unsigned_area()).sum::<f64>();
        }
        assert!(overlap_m2 < 1.0, "{kind:?}: {overlap_m2:.2} m² of overlap");
    }
}

#[test]
fn footprints_in_place_are_left_alone() {
    for kind in [TownKind::Village, TownKind::District] {
        let folder = tempfile::tempdir().unwrap();
        town(kind, folder.path(), 0.0);
        let (records, issues, _) = run(folder.path(), &[]);
        let told: Vec<&BuildingRecord> = records.values().filter(|record| record.footprint_shift.is_some()).collect();
        assert!(told.is_empty() && issues.is_empty(), "{kind:?}: {told:?} {issues:?}");
    }
}
