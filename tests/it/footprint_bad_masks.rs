//! Whatever is wrong with masks of nadir photos has a name and a place, and the others go on.

use geo::Area as _;
use glam::DVec3;
use serde_json::{Value, json};
use sizeup::evaluate::evaluate_footprints;
use sizeup::footprint::{
    ConsensusConfig, ContourKind, Detection, DetectionSettings, FootprintSource, InputAccuracy, MaskFiles, detect,
};
use sizeup::issue::Subject;
use sizeup::raster::Raster;
use sizeup::simulate::MaskContour;
use sizeup::terrain::{Dem, Terrain};

use crate::footprint_masks::{
    CENTRE, GROUND, INSTANCES, MASKS, PIXEL_M, SIZE, crs, find, mask, polygons, run, save, scene, source_of, town,
    view, with_masks,
};

fn codes(found: &Detection) -> Vec<&str> {
    found.layer.issues.iter().map(|i| i.code.as_str()).collect()
}

#[test]
fn every_bad_mask_has_a_name_and_the_others_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let (mut views, houses) = with_masks(folder.path());
    let path = |name: &str| folder.path().join(name);
    for name in ["wrong_size", "empty", "full", "noise", "text", "absent", "specks"] {
        views.push(view(&format!("{name}.jpg"), 0.0, 5.0));
    }
    save(&path("wrong_size.png"), &Raster::filled(200, 180, 1));
    save(&path("empty.png"), &Raster::filled(240, 180, 0));
    save(&path("full.png"), &Raster::filled(240, 180, 9));
    let noise = (0..240 * 180_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 31) as u16).collect();
    save(&path("noise.png"), &Raster::from_vec(240, 180, noise).unwrap());
    let specks = (0..240 * 180_u32).map(|i| u16::from(i % 240 % 6 == 0 && i / 240 % 6 == 0)).collect();
    save(&path("specks.png"), &Raster::from_vec(240, 180, specks).unwrap());
    std::fs::write(path("text.png"), "no picture").unwrap();
    let found = find(&source_of(folder.path(), INSTANCES), &views, &GROUND).unwrap();
    let codes = |name: &str| -> Vec<String> {
        let subject = sizeup::issue::Subject::View(format!("{name}.jpg"));
        found.layer.issues.iter().filter(|i| i.subject == subject).map(|i| i.code.clone()).collect()
    };
    for (name, code) in [
        ("wrong_size", "mask_wrong_size"),
        ("full", "mask_all_building"),
        ("noise", "mask_noise"),
        ("text", "mask_unreadable"),
        ("absent", "mask_absent"),
    ] {
        assert_eq!(codes(name), [code]);
    }
    // An empty mask and one of specks are masks: they say that there is no building.
    assert!(codes("empty").is_empty() && codes("specks").is_empty());
    assert_eq!((found.summary.n_views, found.summary.n_views_without), (10, 5));
    assert!(evaluate_footprints(&polygons(&found), &houses[..3]).iou > 0.9);
    // No usable mask at all is an error with the first one's reason.
    let none = find(&source_of(folder.path(), INSTANCES), &views[5..6], &GROUND).unwrap_err().to_string();
    assert!(none.contains("every pixel is a building") && none.contains("hint: check `above` and `kind`"), "{none}");
    let one_for_all = INSTANCES.replace("{stem}", "a");
    assert!(
        find(&source_of(folder.path(), &one_for_all), &views, &GROUND).unwrap_err().to_string().contains("same file")
    );
    let mut oblique = views[0].clone();
    oblique.camera_from_map = sizeup::simulate::pose(DVec3::new(CENTRE.x, CENTRE.y, 120.0), 0.0, 0.7);
    assert!(
        find(&source_of(folder.path(), INSTANCES), &[oblique], &GROUND)
            .unwrap_err()
            .to_string()
            .contains("straight down")
    );
}

#[test]
fn what_lies_beyond_the_terrain_is_left_out_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let (views, _) = with_masks(folder.path());
    // Ground west of 20 m east of the centre only: the hall has none.
    let terrain = |west: f64| {
        let heights = Raster::filled(40, 80, 20.0_f32);
        Terrain::Grid(Dem::new(heights, CENTRE.x + west, CENTRE.y + 80.0, 2.0, 2.0).unwrap())
    };
    let found = find(&source_of(folder.path(), INSTANCES), &views, &terrain(-60.0)).unwrap();
    let codes: Vec<&str> = found.layer.issues.iter().map(|i| i.code.as_str()).collect();
    assert!(codes.contains(&"contours_off_terrain"), "{codes:?}");
    assert_eq!(found.layer.footprints.len(), 3);
    let elsewhere = find(&source_of(folder.path(), INSTANCES), &views, &terrain(5000.0)).unwrap_err().to_string();
    assert!(elsewhere.contains("sees nothing of the terrain"), "{elsewhere}");
}

#[test]
fn masks_of_no_building_at_all_give_an_empty_layer_and_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    scene(folder, MaskContour::Ground, MASKS);
    for entry in std::fs::read_dir(folder.join("masks")).unwrap() {
        save(&entry.unwrap().path(), &Raster::filled(320, 240, 0));
    }
    let footprints = run(folder, &["footprints", "sizeup.toml"]);
    assert_eq!(footprints.code, 0, "{}", footprints.stderr);
    assert!(
        footprints.stderr.contains("0 buildings") && footprints.stderr.contains("1 warning"),
        "{}",
        footprints.stderr
    );
    let issues = std::fs::read_to_string(folder.join("result/issues.json")).unwrap();
    assert!(issues.contains("masks_empty"), "{issues}");
    let whole = run(folder, &["run", "sizeup.toml"]);
    assert_eq!(whole.code, 3, "{}", whole.stderr);
    assert!(whole.stderr.contains("none was found in the nadir photos"), "{}", whole.stderr);
    // Before anything is computed, `survey inspect` says whose mask is missing.
    let first = std::fs::read_dir(folder.join("masks")).unwrap().next().unwrap().unwrap().path();
    std::fs::remove_file(&first).unwrap();
    let looked = run(folder, &["survey", "inspect", "--config", "sizeup.toml"]);
    assert!(looked.stderr.contains("masks: 7 of 8 nadir photos have one"), "{}", looked.stderr);
    assert!(looked.stderr.contains(first.file_name().unwrap().to_str().unwrap()), "{}", looked.stderr);
}

#[test]
fn one_number_for_all_buildings_of_an_instance_mask_is_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let (views, mut houses) = town();
    houses.extend([0.0, 15.0].map(|x| crate::footprint_masks::house(x, -30.0, 9.0, 9.0)));
    for view in &views {
        let white = mask(view, &houses).map(|l| 255 * u16::from(*l > 0));
        save(&folder.path().join(view.id.0.replace("jpg", "png")), &white);
    }
    let found = find(&source_of(folder.path(), INSTANCES), &views, &GROUND).unwrap();
    assert!(codes(&found).contains(&"instances_in_parts"), "{:?}", codes(&found));
    let semantic = INSTANCES.replace("instance", "semantic");
    let found = find(&source_of(folder.path(), &semantic), &views, &GROUND).unwrap();
    assert!(!codes(&found).contains(&"instances_in_parts"), "{:?}", codes(&found));
}

/// One photo whose only annotation is `segmentation`.
fn with_annotation(segmentation: &Value) -> Detection {
    let folder = tempfile::tempdir().unwrap();
    let document = json!({
        "images": [{"id": 1, "file_name": "a.jpg", "width": SIZE.0, "height": SIZE.1}],
        "annotations": [{"image_id": 1, "category_id": 1, "segmentation": segmentation}],
        "categories": [{"id": 1, "name": "building"}],
    });
    std::fs::write(folder.path().join("masks.json"), document.to_string()).unwrap();
    let coco = "source = 'masks'\npath = 'masks.json'\nkind = 'coco'";
    // A second photo, which the file does not name.
    let views = [view("a.jpg", 0.0, 0.0), view("b.jpg", 0.0, 0.0)];
    find(&source_of(folder.path(), coco), &views, &GROUND).unwrap()
}

#[test]
fn coco_contours_that_cross_themselves_or_leave_the_photo_are_put_right() {
    // A bow tie holds two triangles that share a corner, of 900 and 300 pixels². No block stands on a corner's width: the
    // footprint is the larger one, and how much the other is, is told.
    let bow_tie = with_annotation(&json!([[100, 50, 160, 110, 160, 50, 120, 90]]));
    let areas: Vec<f64> = polygons(&bow_tie).iter().map(geo::Area::unsigned_area).collect();
    assert_eq!(areas.len(), 1, "{areas:?}");
    assert!((areas[0] - 900.0 * PIXEL_M * PIXEL_M).abs() < 12.0, "{areas:?}");
    let told = bow_tie.layer.issues.iter().find(|issue| issue.code == "footprint_pieces_left_out").unwrap();
    assert_eq!(told.subject, Subject::Building(bow_tie.layer.footprints[0].id.to_string()));
    let left_out_m2 = bow_tie.sightings[0].left_out_m2;
    assert!((left_out_m2 - 300.0 * PIXEL_M * PIXEL_M).abs() < 12.0, "{left_out_m2}");
    let words = [format!("{left_out_m2:.1} m²"), "25 % of all".to_owned()];
    assert!(words.iter().all(|words| told.message.contains(words)), "{}", told.message);
    // Half of this square lies beyond the photo.
    let beyond = with_annotation(&json!([[-40, 50, 40, 50, 40, 100, -40, 100]]));
    let found = &polygons(&beyond)[0];
    assert!(!codes(&beyond).contains(&"footprint_pieces_left_out"), "{:?}", codes(&beyond));
    assert!((found.unsigned_area() - 40.0 * 50.0 * PIXEL_M * PIXEL_M).abs() < 15.0, "{}", found.unsigned_area());
    assert!(codes(&beyond).contains(&"mask_absent"), "{:?}", codes(&beyond));
    let unlisted = beyond.layer.issues.iter().find(|i| i.code == "mask_absent").unwrap();
    assert!(unlisted.message.contains("does not list it"), "{}", unlisted.message);
}

#[test]
fn settings_out_of_range_are_named() {
    let (views, _) = town();
    let accuracy = InputAccuracy { angle_deg: -1.0, ..InputAccuracy::default() };
    let consensus = ConsensusConfig::default();
    let settings =
        DetectionSettings { contour: ContourKind::Ground, accuracy: &accuracy, consensus: &consensus, cadastre: None };
    let folder = tempfile::tempdir().unwrap();
    let FootprintSource::Masks(masks) = source_of(folder.path(), INSTANCES) else { unreachable!() };
    let source = MaskFiles::new(masks).unwrap();
    let error = detect(&source, &views, &GROUND, settings, &crs()).unwrap_err().to_string();
    assert!(error.contains("angle_deg = -1"), "{error}");
}
