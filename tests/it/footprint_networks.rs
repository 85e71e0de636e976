//! The network that comes with sizeup, from photos to footprints, and what can be wrong with networks' settings and depth.

use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

use geo::{Area as _, BooleanOps as _};
use geo_types::{MultiPolygon, Polygon};
use sizeup::camera::Camera;
use sizeup::footprint::{ContourFineness, ContourSource as _, Segmenter, SegmenterConfig};
use sizeup::prior::{FilePriorConfig, FilePriors, PriorKind};
use sizeup::simulate::{PriorLevel, SimulateConfig, TownKind};
use sizeup::survey::View;
use tempfile::TempDir;

use crate::footprint_masks::{layer, run, view};
use crate::tiny_scene::{copy, simulate_from_above, write_npy};

/// A village that the network never saw, photos from above and depth as it wants them; its footprints are to be found.
static VILLAGE: LazyLock<TempDir> = LazyLock::new(|| {
    let scene = tempfile::tempdir().unwrap();
    let folder = scene.path();
    let mut config = SimulateConfig { seed: 151, ..SimulateConfig::default() };
    (config.town.kind, config.town.n_buildings) = (TownKind::Village, 12);
    (config.flight.n_views, config.flight.height_m) = (Some(40), 120.0);
    (config.camera.width_px, config.camera.height_px) = (480, 360);
    (config.prior.longest_px, config.prior.level) = (320, PriorLevel::Mid);
    simulate_from_above(&config, folder);
    let path = folder.join("sizeup.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let layer = "path = \"footprints.gpkg\"\nid_field = \"id\"\n";
    assert!(text.contains(layer));
    let text = text.replace(layer, "source = \"network\"\n");
    std::fs::write(&path, format!("{text}\n[output]\npictures = false\n")).unwrap();
    scene
});

fn union(footprints: &[Polygon<f64>]) -> MultiPolygon<f64> {
    footprints.iter().fold(MultiPolygon(Vec::new()), |sum, footprint| sum.union(footprint))
}

#[test]
fn the_built_in_network_outlines_a_village_with_the_runs_own_depth() {
    let folder = tempfile::tempdir().unwrap();
    let folder = &folder.path().join("village");
    copy(VILLAGE.path(), folder);
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

    // Depth that does not fit its photo is a mistake, and each photo says so.
    let nadir: Vec<PathBuf> =
        std::fs::read_dir(folder.join("priors")).unwrap().map(|file| file.unwrap().path()).collect();
    nadir.iter().for_each(|path| std::fs::write(path, "no depth").unwrap());
    let broken = run(folder, &["footprints", "sizeup.toml", "--output", "broken"]);
    assert_eq!(broken.code, 3, "{}", broken.stderr);
    for words in ["its depth cannot be used", "by colours alone", "hint: "] {
        assert!(broken.stderr.contains(words), "{words:?} is not in {}", broken.stderr);
    }
    // Photos without depth are seen by their colours.
    nadir.iter().for_each(|path| std::fs::remove_file(path).unwrap());
    let without = run(folder, &["footprints", "sizeup.toml", "--output", "without"]);
    assert_eq!(without.code, 0, "{}", without.stderr);
    let by_colours = union(&layer(&folder.join("without/footprints.gpkg")));
    // They find most of the buildings' area; ploughed fields too, in this village.
    let found = by_colours.intersection(&truth).unsigned_area() / truth.unsigned_area();
    assert!(found > 0.5, "{found}");
    let issues = std::fs::read_to_string(folder.join("without/issues.json")).unwrap();
    assert_eq!(issues.matches("footprints_without_depth").count(), nadir.len(), "{issues}");
}

/// One photo of a village: no other one gives depth to it. A depth map that is level everywhere tells as much as none.
#[test]
fn a_single_photo_is_looked_at_without_depth_and_with_a_level_one() {
    let folder = tempfile::tempdir().unwrap();
    let images = std::fs::read_dir(VILLAGE.path().join("images")).unwrap();
    let path = images.map(|file| file.unwrap().path()).min().unwrap();
    let (width, height) = image::image_dimensions(&path).unwrap();
    let seen = view("", 0.0, 0.0);
    let camera = Arc::new(Camera::pinhole(width, height, 400.0));
    let seen = View { id: "photo.png".into(), camera, image: Some(path), ..seen };
    let look = ContourFineness { min_area_px2: 20.0, tolerance_px: 0.3, pixel_m: 0.3 };
    let alone = Segmenter::new(SegmenterConfig::built_in()).unwrap().contours(&seen, look).unwrap();
    assert!(alone.contours.len() >= 2, "{} buildings", alone.contours.len());
    assert!(alone.without_depth.is_some());
    // Without depth six of ten are right: no building is certain.
    assert!(alone.contours.iter().all(|c| (0.0..0.85).contains(&c.score)), "{:?}", alone.contours);

    write_npy(&folder.path().join("photo.npy"), 4, 3, &[1492.0; 12]);
    let priors = || {
        let files = FilePriorConfig::new(folder.path().join("{stem}.npy").to_string_lossy(), PriorKind::Depth);
        Ok(Box::new(FilePriors::new(files, [])?) as Box<_>)
    };
    let with_level = Segmenter::with_depth(SegmenterConfig::built_in(), Some(&priors)).unwrap();
    let found = with_level.contours(&seen, look).unwrap();
    assert!(found.without_depth.as_ref().is_some_and(|why| why.contains("1492 everywhere")), "{found:?}");
    assert_eq!(found.contours, alone.contours);
}

#[test]
fn settings_of_networks_that_cannot_be_are_refused_with_what_to_write() {
    let refused = |config: SegmenterConfig| Segmenter::new(config).unwrap_err().to_string();
    let own = SegmenterConfig::built_in;
    let no_model = refused(SegmenterConfig { profile: Some("sam3".to_owned()), ..own() });
    assert!(no_model.contains("no `model`") && no_model.contains("hint: "), "{no_model}");
    for pixel_m in [0.0, 11.0, f64::NAN] {
        let odd = refused(SegmenterConfig { pixel_m: Some(pixel_m), ..own() });
        assert!(odd.contains(&format!("pixel_m = {pixel_m}")) && odd.contains("0.01 to 10"), "{odd}");
    }
}
