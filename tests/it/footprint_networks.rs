//! The network that comes with sizeup, from photos to footprints, and what can be wrong with networks' settings and depth.

use std::path::Path;

use geo::{Area as _, BooleanOps as _};
use geo_types::{MultiPolygon, Polygon};
use sizeup::footprint::{Segmenter, SegmenterConfig};
use sizeup::simulate::{PriorLevel, SimulateConfig, TownKind, simulate};

use crate::footprint_masks::{layer, run};

/// A village that the network never saw, photos and depth as it wants them; its footprints are to be found.
fn village(folder: &Path) {
    let mut config = SimulateConfig { seed: 151, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::Village, 12);
    (config.flight.n_views, config.flight.height_m) = (Some(40), 120.0);
    (config.camera.width_px, config.camera.height_px) = (480, 360);
    (config.prior.longest_px, config.prior.level) = (320, PriorLevel::Mid);
    simulate(&config, folder, &|_, _| {}).unwrap();
    let path = folder.join("sizeup.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let layer = "path = \"footprints.gpkg\"\nid_field = \"id\"\n";
    assert!(text.contains(layer));
    let text = text.replace(layer, "source = \"network\"\n");
    std::fs::write(&path, format!("{text}\n[output]\npictures = false\n")).unwrap();
}

fn union(footprints: &[Polygon<f64>]) -> MultiPolygon<f64> {
    footprints.iter().fold(MultiPolygon(Vec::new()), |sum, footprint| sum.union(footprint))
}

#[test]
fn the_built_in_network_outlines_a_village_with_the_runs_own_depth() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    village(folder);
    let found = run(folder, &["footprints", "sizeup.toml", "--json"]);
    assert_eq!(found.code, 0, "{}", found.stderr);
    assert!(found.stderr.contains("footprints by the built-in network: "), "{}", found.stderr);
    let summary: serde_json::Value = serde_json::from_str(&found.stdout).unwrap();
    assert!(summary["detection"]["footprints_from"].as_str().unwrap().contains("IoU"), "{summary}");
    // Of the area of all buildings together it finds more than roofs would give (44 % in photos, docs/footprint-network.md),
    // and not much less than perfect masks of what is visible (79 %); 81 % when it was written.
    let (found, truth) =
        (union(&layer(&folder.join("result/footprints.gpkg"))), union(&layer(&folder.join("truth.geojson"))));
    let iou = found.intersection(&truth).unsigned_area() / found.union(&truth).unsigned_area();
    assert!(iou > 0.65, "{iou}");

    // Where the photos that look straight down have no depth, each says so, and what to do.
    for file in std::fs::read_dir(folder.join("priors")).unwrap() {
        let path = file.unwrap().path();
        if path.to_string_lossy().contains("nadir") {
            std::fs::remove_file(path).unwrap();
        }
    }
    let without = run(folder, &["footprints", "sizeup.toml", "--output", "without"]);
    assert_eq!(without.code, 3, "{}", without.stderr);
    for words in ["its depth cannot be used", "does not exist", "hint: "] {
        assert!(without.stderr.contains(words), "{words:?} is not in {}", without.stderr);
    }
}

#[test]
fn settings_of_networks_that_cannot_be_are_refused_with_what_to_write() {
    let refused = |config: SegmenterConfig| Segmenter::new(config).unwrap_err().to_string();
    let own = SegmenterConfig::built_in;
    let no_model = refused(SegmenterConfig { profile: Some("sam3".to_owned()), ..own() });
    assert!(no_model.contains("no `model`") && no_model.contains("hint: "), "{no_model}");
    for looks in [0, 3, 8] {
        let odd = refused(SegmenterConfig { looks: Some(looks), ..own() });
        assert!(odd.contains(&format!("looks = {looks}")) && odd.contains("1, 2 or 4"), "{odd}");
    }
    for pixel_m in [0.0, 11.0, f64::NAN] {
        let odd = refused(SegmenterConfig { pixel_m: Some(pixel_m), ..own() });
        assert!(odd.contains(&format!("pixel_m = {pixel_m}")) && odd.contains("0.01 to 10"), "{odd}");
    }
    let no_depth = refused(own());
    assert!(no_depth.contains("the built-in network takes depth") && no_depth.contains("hint: "), "{no_depth}");
}
