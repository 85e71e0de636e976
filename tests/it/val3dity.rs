//! val3dity, the validator of solids by others: what it says of ours, where somebody has one.

use std::path::{Path, PathBuf};
use std::process::Command;

use geo::{MapCoords as _, Rotate as _};
use geo_types::{Coord, Point, Polygon, polygon};
use sizeup::crs::Crs;
use sizeup::optimise::Terrace;
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::{BuildingRecord, CityModel, Lineage, RoofShape};
use sizeup::scene::RoofForm;
use sizeup::simulate::{SimulateConfig, TownKind, simulate};
use sizeup::survey::Survey;

use crate::hostile_footprints::{AT, block};
use crate::sfcgal::assert_valid_to_sfcgal;
use crate::skipped::skip;
use crate::tiny_scene::Scene;

/// The program that `SIZEUP_VAL3DITY` names, the one that `make deps-val3dity` built, or one on the path.
pub fn val3dity() -> Option<PathBuf> {
    let named = std::env::var_os("SIZEUP_VAL3DITY").map(PathBuf::from);
    let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/tools/val3dity");
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let on_path = std::env::split_paths(&paths).map(|folder| folder.join("val3dity"));
    let found = named.into_iter().chain([ours]).chain(on_path).find(|path| path.is_file());
    if found.is_none() {
        skip("no val3dity (`make deps-val3dity` builds one)");
    }
    found
}

/// Asserts that val3dity calls a file valid, where there is one.
pub fn assert_valid_to_val3dity(path: &Path) {
    let Some(program) = val3dity() else { return };
    let report = path.with_extension("report.json");
    Command::new(program).arg(path).arg("--report").arg(&report).output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let features = report["features"].as_array().unwrap();
    let faults: Vec<String> =
        features.iter().filter(|one| one["validity"] != true).map(|one| one["id"].to_string()).collect();
    assert!(!features.is_empty(), "nothing was looked at");
    assert_eq!(report["validity"], true, "{}: {} of {faults:?}", path.display(), report["all_errors"]);
}

/// The footprint, turned and in the map.
fn placed(footprint: &Polygon<f64>, turn_deg: f64, east_m: f64) -> Polygon<f64> {
    let turned = footprint.rotate_around_point(turn_deg, Point::new(0.0, 0.0));
    turned.map_coords(|c| Coord { x: c.x + AT.0 + east_m, y: c.y + AT.1 })
}

/// Roofs of all forms over a part, whose ridges and steps end at the wall that it shares with the next.
fn roofs(turn_deg: f64, at: impl Fn(f64, f64) -> [f64; 2]) -> [RoofShape; 4] {
    let azimuth_deg = |turn_deg: f64| Some((90.0 - turn_deg).rem_euclid(180.0));
    let gable = RoofShape::new(RoofForm::Gable, 4.0, 7.3);
    let corners = [at(-1.0, -1.0), at(13.0, -1.0), at(13.0, 3.7), at(-1.0, 3.7)];
    [
        RoofShape { ridge_azimuth_deg: azimuth_deg(turn_deg), ..gable },
        RoofShape { ridge_azimuth_deg: azimuth_deg(turn_deg + 90.0), ..gable },
        RoofShape::new(RoofForm::Hip, 4.0, 6.5),
        RoofShape { step: Some(Terrace { corners, is_upper: true }), ..RoofShape::new(RoofForm::Stepped, 4.0, 8.0) },
    ]
}

/// Houses that were split across, turned any way, with every roof beside every other one.
fn split_houses() -> Vec<BuildingRecord> {
    let mut records = Vec::new();
    for i in 0..16 * 12_u32 {
        let (turn_deg, share) = (f64::from(i) * 7.31 + 3.0, 0.3 + 0.4 * f64::from(i % 5) / 5.0);
        let (x, slant, east_m) = (12.0 * share, 0.013 * f64::from(i % 7), f64::from(i) * 40.0);
        let first = polygon![(x: 0.0, y: 0.0), (x: x, y: 0.0), (x: x + slant, y: 8.013), (x: 0.0, y: 8.0)];
        let second = polygon![(x: x, y: 0.0), (x: 12.0, y: 0.0), (x: 12.0, y: 8.0), (x: x + slant, y: 8.013)];
        let at = |x: f64, y: f64| {
            let (sin, cos) = turn_deg.to_radians().sin_cos();
            [cos * x - sin * y + AT.0 + east_m, sin * x + cos * y + AT.1]
        };
        let roofs = roofs(turn_deg, at);
        let pair = [(first, roofs[i as usize % 4], 5.5), (second, roofs[i as usize / 4 % 4], 5.5)];
        for (k, (footprint, roof, height_m)) in pair.into_iter().enumerate() {
            let mut part = block(&format!("{i}#{}", k + 1), placed(&footprint, turn_deg, east_m), height_m);
            (part.part_of, part.roof) = (Some(i.to_string()), Some(roof));
            records.push(part);
        }
    }
    records
}

/// Writes them into a file, and returns how many parts they have.
pub fn write_split_houses(path: &Path) -> usize {
    let (crs, survey, lineage) = (Crs::parse("EPSG:25832").unwrap(), Survey::default(), Lineage::default());
    let records = split_houses();
    let model = CityModel { records: records.as_slice(), crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    cityjson::write(path, &model, &CityJsonConfig::default()).unwrap();
    records.len()
}

#[test]
fn parts_of_a_house_under_roofs_of_their_own_share_no_volume() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("parts.city.json");
    let n_parts = write_split_houses(&path);
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(text.matches("\"lod\":\"2.0\"").count(), n_parts, "all have their roof");
    assert_valid_to_val3dity(&path);
}

#[test]
fn a_town_of_a_run_is_valid_to_val3dity_at_all_levels_of_detail() {
    if val3dity().is_none() {
        return;
    }
    let mut config = SimulateConfig::default();
    (config.town.kind, config.town.n_buildings, config.flight.n_views) = (TownKind::Village, 40, Some(60));
    config.prior.longest_px = 224;
    (config.images.enabled, config.masks.enabled) = (false, false);
    let folder = tempfile::tempdir().unwrap();
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    let scene = Scene::of(folder);
    let outcome = scene.run(&["--set", "output.pictures=false", "--set", "output.report.page=false"]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let path = scene.path("result/city.city.json");
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("\"roof_form\":\"gable\""), "no roof is pitched");
    assert_valid_to_val3dity(&path);
    assert_valid_to_sfcgal(&path);
}
