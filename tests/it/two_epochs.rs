//! A simulated town at two flights: what was built, torn down, raised and lowered between them is known.
//!
//! Results are written as records with the noise that they state, so that hundreds of buildings take seconds; a smaller town is flown
//! over twice and solved.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use geo::{Area as _, BooleanOps as _, MapCoords as _};
use geo_types::{Coord, LineString, Polygon};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use sizeup::changes::{Change, ChangesReport, Class};
use sizeup::crs::Crs;
use sizeup::output::cityjson;
use sizeup::output::geopackage;
use sizeup::output::read::{FoundBuildings, ReadOptions};
use sizeup::output::{BuildingRecord, CityModel, Lineage};
use sizeup::simulate::{CityJsonTown, SimulateConfig, TownKind, simulate, world};
use sizeup::survey::Survey;

use crate::tiny_scene::sizeup;

/// What lies between two flights: poses a little off, to the east, north and up, metres.
const FLIGHT_SHIFT_M: [f64; 3] = [0.5, -0.3, 0.4];
/// Standard deviation of corners of footprints, metres; the default of `--footprint-sigma`.
const CORNER_SIGMA_M: f64 = 0.3;
/// The least change of the town, metres.
const LEAST_CHANGE_M: f64 = 2.0;

/// What became of a building of the town.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fate {
    Same,
    Raised(f64),
    Lowered(f64),
    Gone,
    New,
    /// A strip of so many metres was torn down.
    Cut(f64),
    /// A strip of so many metres was built.
    Extended(f64),
    Split,
    Merged,
}

impl Fate {
    fn of(rng: &mut ChaCha8Rng, height_m: f64) -> Self {
        let by_m = rng.random_range(LEAST_CHANGE_M..8.0);
        let strip_m = rng.random_range(LEAST_CHANGE_M..6.0);
        match rng.random::<f64>() {
            p if p < 0.60 => Self::Same,
            p if p < 0.68 => Self::Raised(by_m),
            p if p < 0.74 && height_m > 7.0 => Self::Lowered(rng.random_range(LEAST_CHANGE_M..height_m - 4.0)),
            p if p < 0.80 => Self::Gone,
            p if p < 0.86 => Self::New,
            p if p < 0.90 => Self::Cut(strip_m),
            p if p < 0.94 => Self::Extended(strip_m),
            p if p < 0.97 => Self::Split,
            _ => Self::Merged,
        }
    }

    fn class(self) -> Class {
        match self {
            Self::Same | Self::Split | Self::Merged => Class::Same,
            Self::Raised(_) => Class::Raised,
            Self::Lowered(_) => Class::Lowered,
            Self::Gone => Class::Gone,
            Self::New => Class::New,
            Self::Cut(_) | Self::Extended(_) => Class::FootprintChanged,
        }
    }
}

/// A standard normal number.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

/// Direction of the longest edge of a footprint, and how far the footprint reaches along it.
fn long_side(footprint: &Polygon<f64>) -> (Coord<f64>, [f64; 2]) {
    let longest = footprint.exterior().lines().max_by(|a, b| {
        let length = |line: &geo_types::Line<f64>| line.dx().hypot(line.dy());
        length(a).total_cmp(&length(b))
    });
    let line = longest.unwrap();
    let along = Coord { x: line.dx(), y: line.dy() } / line.dx().hypot(line.dy());
    let at = |c: &Coord<f64>| c.x * along.x + c.y * along.y;
    let reach = footprint.exterior().coords().map(at).fold([f64::MAX, f64::MIN], |r, t| [r[0].min(t), r[1].max(t)]);
    (along, reach)
}

/// The part of a footprint between two distances along its long side, if that is one polygon.
fn strip(footprint: &Polygon<f64>, from_m: f64, to_m: f64) -> Option<Polygon<f64>> {
    const FAR_M: f64 = 1e3;
    let (along, _) = long_side(footprint);
    let first = *footprint.exterior().coords().next()?;
    let across_m = first.y * along.x - first.x * along.y;
    let corner = |t: f64, s: f64| Coord { x: t * along.x - s * along.y, y: t * along.y + s * along.x };
    let (low, high) = (across_m - FAR_M, across_m + FAR_M);
    let ring = [corner(from_m, low), corner(to_m, low), corner(to_m, high), corner(from_m, high)];
    let window = Polygon::new(LineString::from(ring.to_vec()), Vec::new());
    let [only] = <[Polygon<f64>; 1]>::try_from(footprint.intersection(&window).0).ok()?;
    (only.unsigned_area() > 25.0).then_some(only)
}

/// A building as a flight measures it.
fn measured(
    rng: &mut ChaCha8Rng,
    id: String,
    footprint: &Polygon<f64>,
    [ground_z_m, height_m]: [f64; 2],
) -> BuildingRecord {
    let sigma_m = rng.random_range(0.15..0.4);
    let mut off_m = || CORNER_SIGMA_M * normal(rng);
    // The ring's last corner is its first.
    let mut disturbed = |ring: &LineString<f64>| -> LineString<f64> {
        ring.0[..ring.0.len() - 1].iter().map(|c| Coord { x: c.x + off_m(), y: c.y + off_m() }).collect()
    };
    let exterior = disturbed(footprint.exterior());
    let footprint = Polygon::new(exterior, footprint.interiors().iter().map(disturbed).collect());
    BuildingRecord {
        height_sigma_m: Some(sigma_m),
        ..BuildingRecord::measured(id, footprint, ground_z_m, height_m + sigma_m * normal(rng))
    }
}

/// Two results of one town, and what became of each building.
struct TwoEpochs {
    folder: tempfile::TempDir,
    fates: BTreeMap<String, Fate>,
}

impl TwoEpochs {
    fn new(seed: u64, kind: TownKind, n_buildings: usize) -> Self {
        let mut config = SimulateConfig { seed, ..SimulateConfig::default() };
        (config.town.kind, config.town.n_buildings) = (kind, n_buildings);
        let town = world(&config).unwrap();
        let mut rng = sizeup::seed::stream(seed, "epochs", &[]);
        let [mut old, mut new] = [Vec::new(), Vec::new()];
        let mut fates = BTreeMap::new();
        for building in &town.buildings {
            let wanted = Fate::of(&mut rng, building.height_m);
            let (before, now, fate) = footprints(&building.footprint, wanted);
            let (ground_z_m, height_m) = (building.ground_z_m, building.height_m);
            let by_m = match fate {
                Fate::Raised(by_m) => by_m,
                Fate::Lowered(by_m) => -by_m,
                _ => 0.0,
            };
            let id = |epoch: &str, i: usize| format!("{epoch}-{}-{i}", building.id);
            for (i, footprint) in before.iter().enumerate() {
                old.push(measured(&mut rng, id("old", i), footprint, [ground_z_m, height_m]));
            }
            for (i, footprint) in now.iter().enumerate() {
                let [east_m, north_m, up_m] = FLIGHT_SHIFT_M;
                let footprint = footprint.map_coords(|c| Coord { x: c.x + east_m, y: c.y + north_m });
                new.push(measured(&mut rng, id("new", i), &footprint, [ground_z_m, height_m + by_m + up_m]));
            }
            fates.insert(building.id.to_string(), fate);
        }
        let folder = tempfile::tempdir().unwrap();
        for (name, records) in [("old.gpkg", &old), ("new.gpkg", &new)] {
            write_result(&folder.path().join(name), records, &town.crs, "DHHN2016 height");
        }
        Self { folder, fates }
    }

    fn compared(&self) -> ChangesReport {
        compare_files(self.folder.path(), "old.gpkg", "new.gpkg", &[])
    }

    /// The building of the town that a row is about, if it is one alone.
    fn subject(change: &Change) -> Option<String> {
        let ids = change.old_ids.iter().chain(&change.new_ids);
        let mut names: Vec<&str> = ids.map(|id| id.split('-').nth(1).unwrap()).collect();
        names.dedup();
        let [only] = names.as_slice() else { return None };
        Some((*only).to_owned())
    }
}

/// Footprints of a building before and after; its fate is `Same` where its shape does not allow another.
fn footprints(whole: &Polygon<f64>, fate: Fate) -> (Vec<Polygon<f64>>, Vec<Polygon<f64>>, Fate) {
    let (_, [from_m, to_m]) = long_side(whole);
    let middle_m = f64::midpoint(from_m, to_m);
    let rest = |strip_m: f64| strip(whole, from_m + strip_m, to_m);
    let halves = || Some(vec![strip(whole, from_m, middle_m)?, strip(whole, middle_m, to_m)?]);
    let one = || vec![whole.clone()];
    let changed = match fate {
        Fate::Gone => Some((one(), Vec::new())),
        Fate::New => Some((Vec::new(), one())),
        Fate::Cut(by_m) => rest(by_m).map(|rest| (one(), vec![rest])),
        Fate::Extended(by_m) => rest(by_m).map(|rest| (vec![rest], one())),
        Fate::Split => halves().map(|halves| (one(), halves)),
        Fate::Merged => halves().map(|halves| (halves, one())),
        Fate::Same | Fate::Raised(_) | Fate::Lowered(_) => Some((one(), one())),
    };
    changed.map_or_else(|| (one(), one(), Fate::Same), |(before, now)| (before, now, fate))
}

/// A result as a GeoPackage.
pub fn write_result(path: &Path, records: &[BuildingRecord], crs: &str, vertical_reference: &str) {
    let lineage = Lineage {
        crs: crs.to_owned(),
        vertical_reference: vertical_reference.to_owned(),
        reference_date: Some("2025-06-01".to_owned()),
        ..Lineage::default()
    };
    let (crs, survey) = (Crs::parse(crs).unwrap(), Survey::default());
    let model = CityModel { records, crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    geopackage::write(path, &model).unwrap();
}

/// `sizeup changes` of two files of a folder, as it is in `changes.json`.
pub fn compare_files(folder: &Path, old: &str, new: &str, more: &[&str]) -> ChangesReport {
    let output: PathBuf = folder.join("changes");
    let command = ["changes", old, new, "--output", "changes"];
    sizeup().current_dir(folder).args(command).args(more).assert().success();
    serde_json::from_slice(&std::fs::read(output.join("changes.json")).unwrap()).unwrap()
}

/// How well changes of towns were told.
#[derive(Debug, Default)]
struct Score {
    n_changed: usize,
    n_unchanged: usize,
    n_right: usize,
    n_wrong: usize,
    n_false_alarms: usize,
    n_unsure: usize,
}

impl Score {
    fn add(&mut self, town: &TwoEpochs, report: &ChangesReport) {
        let is_change = |fate: &&Fate| fate.class().is_change();
        let n_changed = town.fates.values().filter(is_change).count();
        self.n_changed += n_changed;
        self.n_unchanged += town.fates.len() - n_changed;
        for change in &report.changes {
            let fate = TwoEpochs::subject(change).map(|id| town.fates[&id]);
            let is_right = fate.is_some_and(|fate| fate.class() == change.class);
            self.n_right += usize::from(change.class.is_change() && is_right);
            self.n_wrong += usize::from(change.class.is_change() && !is_right);
            let was_unchanged = fate.is_none_or(|fate| fate.class() == Class::Same);
            self.n_false_alarms += usize::from(change.class.is_change() && was_unchanged);
            self.n_unsure += usize::from(change.class == Class::Unsure);
        }
    }

    fn f1(&self) -> f64 {
        let missed = self.n_changed - self.n_right;
        2.0 * self.n_right as f64 / (2 * self.n_right + self.n_wrong + missed) as f64
    }

    fn false_alarm_share(&self) -> f64 {
        self.n_false_alarms as f64 / self.n_unchanged as f64
    }
}

#[test]
fn changes_of_two_metres_and_more_are_told_and_hardly_any_others() {
    let mut all = Score::default();
    let kinds = [TownKind::Village, TownKind::District, TownKind::Downtown, TownKind::Industry];
    for (seed, kind) in (0..8).zip(kinds.into_iter().cycle()) {
        let town = TwoEpochs::new(seed, kind, 250);
        let mut score = Score::default();
        let report = town.compared();
        score.add(&town, &report);
        all.add(&town, &report);
        println!(
            "{kind:?}, seed {seed}: F1 {:.3}, false alarms {:.4}, {score:?}",
            score.f1(),
            score.false_alarm_share()
        );
        let shifts = [report.common_shift.east, report.common_shift.north, report.common_shift.roof_z];
        for (found, expected_m) in shifts.into_iter().zip(FLIGHT_SHIFT_M) {
            assert!(found.is_taken_off && (found.value_m - expected_m).abs() < 0.1, "{found:?}, expected {expected_m}");
        }
        assert!((report.spread.unwrap() - 1.0).abs() < 0.25, "sigmas are what they say: {:?}", report.spread);
    }
    println!("all: F1 {:.4}, false alarms {:.4}, {all:?}", all.f1(), all.false_alarm_share());
    assert!(all.f1() >= 0.95, "{all:?}");
    assert!(all.false_alarm_share() <= 0.01, "{all:?}");
}

#[test]
fn every_building_of_both_towns_is_in_one_row() {
    let town = TwoEpochs::new(20, TownKind::District, 120);
    let report = town.compared();
    let ids = |of: fn(&Change) -> &Vec<String>| {
        let mut ids: Vec<String> = report.changes.iter().flat_map(|change| of(change).iter().cloned()).collect();
        ids.sort();
        ids
    };
    let records = |name: &str| {
        let found = FoundBuildings::read(&town.folder.path().join(name), &ReadOptions::default());
        let mut ids: Vec<String> = found.unwrap().buildings.into_iter().map(|building| building.id).collect();
        ids.sort();
        ids
    };
    assert_eq!(ids(|change| &change.old_ids), records("old.gpkg"));
    assert_eq!(ids(|change| &change.new_ids), records("new.gpkg"));
    assert_eq!(report.counts.values().sum::<usize>(), report.changes.len());
    assert!(report.changes.iter().all(|change| !change.reasons.is_empty() && !change.explanation.is_empty()));
}

#[test]
fn sigmas_that_are_too_small_are_found_out_and_widened() {
    let town = TwoEpochs::new(30, TownKind::Village, 250);
    for name in ["old.gpkg", "new.gpkg"] {
        let dataset = gdal::Dataset::open_ex(
            town.folder.path().join(name),
            gdal::DatasetOptions { open_flags: gdal::GdalOpenFlags::GDAL_OF_UPDATE, ..Default::default() },
        );
        let claim = "UPDATE buildings SET height_sigma_m = height_sigma_m / 3";
        dataset.unwrap().execute_sql(claim, None, gdal::vector::sql::Dialect::DEFAULT).unwrap();
    }
    let false_alarms = |more: &[&str]| {
        let report = compare_files(town.folder.path(), "old.gpkg", "new.gpkg", more);
        let mut score = Score::default();
        score.add(&town, &report);
        (report, score.n_false_alarms)
    };
    // The least difference keeps scatter from being told: without it, sigmas alone decide.
    let least = ["--least-m", "0.1"];
    let (widened, n_widened) = false_alarms(&least);
    let (stated, n_stated) = false_alarms(&[&least[..], &["--stated-sigmas"]].concat());
    assert!((widened.spread.unwrap() - 3.0).abs() < 0.6, "{:?}", widened.spread);
    assert!(
        widened.notes.iter().any(|note| note.contains("too small") && note.contains("widened")),
        "{:?}",
        widened.notes
    );
    assert!(stated.notes.iter().any(|note| note.contains("left as stated")), "{:?}", stated.notes);
    assert!(n_widened <= 3 && n_stated > 20, "{n_widened} {n_stated}");
}

/// A town that two flights see: photos are not needed, poses and priors are each flight's own.
fn flown(folder: &Path, name: &str, seed: u64, buildings: &[BuildingRecord]) {
    let crs = Crs::parse("EPSG:25832").unwrap();
    let (lineage, survey) = (Lineage { crs: crs.definition().to_owned(), ..Lineage::default() }, Survey::default());
    let model = CityModel { records: buildings, crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    let city = folder.join(format!("{name}.city.json"));
    cityjson::write(&city, &model, &cityjson::CityJsonConfig::default()).unwrap();
    let mut config = SimulateConfig { seed, ..SimulateConfig::default() };
    config.cityjson = Some(CityJsonTown {
        path: city,
        translation_m: [0.0; 3],
        bounds_m: None,
        max_buildings: None,
        trees_per_building: 0.0,
    });
    config.flight.n_views = Some(80);
    (config.camera.width_px, config.camera.height_px) = (320, 240);
    config.prior.longest_px = 320;
    (config.images.enabled, config.masks.enabled) = (false, false);
    let scene = folder.join(name);
    simulate(&config, &scene, &|_, _| {}).unwrap();
    let ran = sizeup()
        .current_dir(&scene)
        .args(["run", "sizeup.toml", "--set", "optimise.working_px=320", "--set", "output.report.page=false"])
        .args(["--set", "output.pictures=false", "--set", "project.vertical_reference='DHHN2016 height'"])
        .output()
        .unwrap();
    assert!([Some(0), Some(5)].contains(&ran.status.code()), "{}", String::from_utf8_lossy(&ran.stderr));
}

#[test]
fn changes_between_two_flights_are_told_from_what_the_solver_finds() {
    let mut config = SimulateConfig { seed: 40, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::District, 32);
    let town = world(&config).unwrap();
    let [mut old, mut new] = [Vec::new(), Vec::new()];
    let mut classes = BTreeMap::new();
    for (i, building) in town.buildings.iter().enumerate() {
        let record = |height_m: f64| {
            let footprint = building.footprint.clone();
            BuildingRecord::measured(building.id.to_string(), footprint, building.ground_z_m, height_m)
        };
        let height_m = building.height_m;
        let (before_m, now_m, class) = match i % 8 {
            1 => (Some(height_m), Some(height_m + 4.0), Class::Raised),
            3 => (Some(height_m + 4.0), Some(height_m), Class::Lowered),
            5 => (Some(height_m), None, Class::Gone),
            7 => (None, Some(height_m), Class::New),
            _ => (Some(height_m), Some(height_m), Class::Same),
        };
        old.extend(before_m.map(record));
        new.extend(now_m.map(record));
        classes.insert(building.id.to_string(), class);
    }
    let folder = tempfile::tempdir().unwrap();
    flown(folder.path(), "old", 41, &old);
    flown(folder.path(), "new", 42, &new);
    let report = compare_files(folder.path(), "old/result", "new/result", &[]);
    let mut wrong = Vec::new();
    let (mut n_changes, mut n_unsure) = (0, 0);
    for change in &report.changes {
        let mut ids: Vec<&String> = change.old_ids.iter().chain(&change.new_ids).collect();
        ids.dedup();
        let [id] = ids.as_slice() else { panic!("{ids:?} are one building") };
        let expected = classes[*id];
        n_changes += usize::from(change.class.is_change() && change.class == expected);
        n_unsure += usize::from(change.class == Class::Unsure);
        if change.class != expected && change.class != Class::Unsure {
            wrong.push(format!("{id} is {expected:?}: {}", change.explanation));
        }
    }
    println!("{n_changes} changes told, {n_unsure} unsure, wrong: {wrong:?}");
    // Of 16 changes some may be left open, as other buildings may; none is invented, and none taken for another.
    assert!(wrong.is_empty(), "{wrong:?}");
    assert!(n_changes >= 13 && n_unsure <= 8, "{n_changes} changes told, {n_unsure} unsure");
}
