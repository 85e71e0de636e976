//! Whatever footprint comes in: a valid solid goes out, or a reason why there is none.

use std::path::Path;

use geo::{Area as _, Rotate as _, Translate as _};
use geo_types::{Coord, LineString, Point, Polygon};
use proptest::prelude::*;
use proptest::strategy::ValueTree as _;
use sizeup::crs::Crs;
use sizeup::footprint::clean::{CleaningRules, clean};
use sizeup::footprint::{FootprintConfig, MAX_AREA_CHANGE, read};
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::validate::{ValidateConfig, validate_file};
use sizeup::output::{BuildingRecord, CityModel, Lineage};
use sizeup::survey::Survey;

use crate::shared_data::shared_data;
use crate::val3dity::assert_valid_to_val3dity;

/// Where the footprints stand: as far from the origin as real ones do.
pub const AT: (f64, f64) = (565_450.0, 5_932_450.0);

fn rules() -> CleaningRules {
    let FootprintConfig { grid_m, min_area_m2, .. } = FootprintConfig::new("");
    CleaningRules { grid_m, min_area_m2, max_area_change: MAX_AREA_CHANGE }
}

pub fn block(id: &str, footprint: Polygon<f64>, height_m: f64) -> BuildingRecord {
    BuildingRecord { base_z_m: Some(21.7), ..BuildingRecord::measured(id, footprint, 22.0, height_m) }
}

/// Writes blocks, and says what our validator finds in the file: number and building.
fn faults_of(blocks: &[BuildingRecord], path: &Path) -> Vec<(u16, String)> {
    let (crs, survey) = (Crs::parse("EPSG:25832").unwrap(), Survey::default());
    let lineage = Lineage::default();
    let model = CityModel { records: blocks, crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    cityjson::write(path, &model, &CityJsonConfig::default()).unwrap();
    let found = validate_file(path, &ValidateConfig::default()).unwrap();
    assert_eq!(found.n_geometries, blocks.len(), "every block has its solid");
    found.faults.into_iter().map(|fault| (fault.number, fault.object)).collect()
}

#[test]
fn slits_spikes_and_corners_side_by_side_become_valid_solids_and_are_told() {
    let Some(data) = shared_data("hostile") else { return };
    let config = FootprintConfig {
        id_field: Some("id".to_owned()),
        ..FootprintConfig::new(data.join("thin_footprints.geojson"))
    };
    let layer = read(&config, &Crs::parse("EPSG:25832").unwrap()).unwrap();
    assert_eq!((layer.footprints.len(), layer.refused.len()), (12, 0));
    for footprint in &layer.footprints {
        // Squares of 10 m: the slits and spikes take and add less than 0.01 m².
        assert!((footprint.polygon.unsigned_area() - 100.0).abs() < 0.02, "{footprint:?}");
        assert_eq!(footprint.polygon.exterior().0.len(), 5, "a square again: {footprint:?}");
        let told = layer.issues.iter().filter(|issue| issue.code == "footprint_narrow_detail");
        assert_eq!(
            told.filter(|issue| format!("{:?}", issue.subject).contains(&format!("{:?}", footprint.id.0))).count(),
            1
        );
    }
    let blocks: Vec<BuildingRecord> = layer.footprints.iter().map(|f| block(&f.id.0, f.polygon.clone(), 9.0)).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("thin.city.json");
    assert_eq!(faults_of(&blocks, &path), []);
    assert_valid_to_val3dity(&path);
}

#[test]
fn footprints_that_were_never_cleaned_become_valid_solids_too() {
    // As `sizeup export` meets them in files of others.
    let square = |detail: &[(f64, f64)]| {
        let mut corners = vec![(0.0, 0.0)];
        corners.extend(detail);
        corners.extend([(10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]);
        Polygon::new(LineString::from(corners), vec![]).translate(AT.0, AT.1)
    };
    let blocks = [
        block("slit", square(&[(5.0, 0.0), (5.0, 5.0), (5.001, 0.0)]), 9.0),
        block(
            "spike",
            square(&[(4.999, 0.0), (5.0, -3.0), (5.001, 0.0)]).rotate_around_point(17.0, Point::new(AT.0, AT.1)),
            9.0,
        ),
        block("twice", square(&[(9.999, 0.0)]), 9.0),
    ];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.city.json");
    assert_eq!(faults_of(&blocks, &path), []);
    assert_valid_to_val3dity(&path);
}

/// What is wrong with one place of a footprint; sizes in metres.
#[derive(Debug, Clone, Copy)]
enum Flaw {
    /// The corner comes again, this far away.
    Twice(f64),
    /// A wedge of this width and depth into the wall; outwards where negative.
    Wedge(f64, f64),
    /// The wall's middle is pulled in until it is this far from the wall across.
    Neck(f64),
}

fn flaws() -> impl Strategy<Value = Flaw> {
    let width = || prop::sample::select(vec![0.0002, 0.0007, 0.001, 0.0014, 0.002, 0.003, 0.0049, 0.0051, 0.01]);
    prop_oneof![
        width().prop_map(Flaw::Twice),
        (width(), -6.0..6.0_f64).prop_map(|(width, depth)| Flaw::Wedge(width, depth)),
        width().prop_map(Flaw::Neck),
    ]
}

/// A rectangle with a flaw on each wall, and a courtyard near the first, anywhere and turned anyhow.
fn hostile_footprints() -> impl Strategy<Value = Polygon<f64>> {
    let sizes = (8.0..40.0_f64, 8.0..25.0_f64);
    let court = prop::option::of(0.0..0.02_f64);
    (sizes, prop::collection::vec(flaws(), 4), court, 0.0..360.0_f64, (0.0..1.0_f64, 0.0..1.0_f64)).prop_map(
        |((width, depth), flaws, court, turn_deg, (dx, dy))| {
            let corners: [(f64, f64); 4] = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)];
            let mut ring = Vec::new();
            for (i, flaw) in flaws.into_iter().enumerate() {
                let (a, b) = (corners[i], corners[(i + 1) % 4]);
                let length = f64::hypot(b.0 - a.0, b.1 - a.1);
                let (along, inwards) =
                    (((b.0 - a.0) / length, (b.1 - a.1) / length), (-(b.1 - a.1) / length, (b.0 - a.0) / length));
                let at = |t: f64, n: f64| Coord {
                    x: a.0 + t * along.0 + n * inwards.0,
                    y: a.1 + t * along.1 + n * inwards.1,
                };
                ring.push(at(0.0, 0.0));
                match flaw {
                    Flaw::Twice(gap) => ring.push(at(gap, 0.0)),
                    Flaw::Wedge(mouth, deep) => {
                        ring.extend([
                            at(0.4 * length, 0.0),
                            at(0.4 * length + mouth / 2.0, deep),
                            at(0.4 * length + mouth, 0.0),
                        ]);
                    }
                    Flaw::Neck(left) => {
                        let across = if i % 2 == 0 { depth } else { width };
                        ring.extend([at(0.7 * length, 0.0), at(0.75 * length, across - left), at(0.8 * length, 0.0)]);
                    }
                }
            }
            let hole = court.map(|gap| {
                let (low, high) = (0.1 * width, 0.3 * width);
                LineString::from(vec![(low, gap), (low, 2.0), (high, 2.0), (high, gap)])
            });
            Polygon::new(LineString::new(ring), hole.into_iter().collect())
                .rotate_around_point(turn_deg, Point::new(0.0, 0.0))
                .translate(AT.0 + dx, AT.1 + dy)
        },
    )
}

#[test]
fn hostile_footprints_of_all_kinds_become_valid_solids_or_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let (mut blocks, mut n_refused) = (Vec::new(), 0);
    for i in 0..300 {
        let footprint = hostile_footprints().new_tree(&mut runner).unwrap().current();
        match clean(&footprint, rules()) {
            Ok(cleaned) => {
                let east = f64::from(i % 20) * 100.0;
                for (k, part) in cleaned.parts.into_iter().enumerate() {
                    blocks.push(block(&format!("{i}#{k}"), part.translate(east, f64::from(i / 20) * 100.0), 9.0));
                }
            }
            Err(_) => n_refused += 1,
        }
    }
    // Necks across each other enclose no area that anybody could mean.
    assert!(n_refused < 100 && blocks.len() >= 200, "{n_refused} refused, {} blocks", blocks.len());
    let path = folder.path().join("hostile.city.json");
    assert_eq!(faults_of(&blocks, &path), []);
    assert_valid_to_val3dity(&path);
}

#[test]
fn a_footprint_that_is_mended_on_the_output_grid_is_named() {
    let at = |corners: &[(f64, f64)]| {
        Polygon::new(corners.iter().map(|(x, y)| Coord { x: AT.0 + x, y: AT.1 + y }).collect(), Vec::new())
    };
    let plain = at(&[(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]);
    // A slit whose mouth is one millimetre wide.
    let slit = at(&[(20.0, 0.0), (25.0, 0.0), (25.0, 5.0), (25.001, 0.0), (30.0, 0.0), (30.0, 10.0), (20.0, 10.0)]);
    let blocks = [block("plain", plain, 5.0), block("slit", slit, 5.0)];
    let issues = cityjson::check(&blocks).unwrap();
    let told: Vec<_> = issues.iter().map(|issue| (issue.code.as_str(), issue.subject.name(), issue.severity)).collect();
    assert_eq!(told, [("footprint_mended_on_grid", "slit", sizeup::issue::Severity::Note)]);
    assert!(issues[0].message.contains("its area changed by") && issues[0].place.is_some(), "{:?}", issues[0]);
}
