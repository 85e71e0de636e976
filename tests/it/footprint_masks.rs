//! Footprints from masks of nadir photos, from files to a city; whatever is wrong with the masks has a name.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use geo::{Area as _, BooleanOps as _};
use geo_types::{Polygon, Rect};
use glam::{DMat3, DVec2, DVec3};
use image::{GrayImage, ImageBuffer, Luma, RgbImage};
use serde_json::{Value, json};
use sizeup::camera::{Camera, Distortion};
use sizeup::crs::Crs;
use sizeup::evaluate::evaluate_footprints;
use sizeup::footprint::{
    CadastreChange, ContourSource, Detection, FootprintConfig, FootprintError, FootprintSource, MaskFiles, Segmenter,
    SegmenterConfig, detect, read,
};
use sizeup::frames::Rigid;
use sizeup::raster::Raster;
use sizeup::simulate::{MaskContour, SimulateConfig, simulate};
use sizeup::survey::View;
use sizeup::terrain::Terrain;

use crate::tiny_scene::{Outcome, sizeup};

pub(super) const CENTRE: DVec2 = DVec2::new(565_000.0, 5_932_000.0);
pub(super) const SIZE: (u32, u32) = (240, 180);
/// 100 m above the ground with a focal length of 200 pixels: a pixel is half a metre.
pub(super) const PIXEL_M: f64 = 0.5;

pub(super) fn crs() -> Crs {
    Crs::parse("EPSG:25832").unwrap()
}

/// A view straight down, 100 m above the ground, its middle `east` and `north` of [`CENTRE`].
pub(super) fn view(name: &str, east: f64, north: f64) -> View {
    let down = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let centre = (CENTRE + DVec2::new(east, north)).extend(120.0);
    View {
        id: name.into(),
        camera: Arc::new(Camera { distortion: Distortion::None, ..Camera::pinhole(SIZE.0, SIZE.1, 200.0) }),
        camera_from_map: Rigid::from_rotation_and_centre(down, centre),
        image: None,
    }
}

pub(super) const GROUND: Terrain = Terrain::Constant(20.0);

/// A house by its south-western corner and size, metres from [`CENTRE`].
pub(super) fn house(x: f64, y: f64, w: f64, h: f64) -> Polygon<f64> {
    let low = CENTRE + DVec2::new(x, y);
    Rect::new((low.x, low.y), (low.x + w, low.y + h)).to_polygon()
}

/// Labels of houses as a view sees them on the ground.
pub(super) fn mask(view: &View, houses: &[Polygon<f64>]) -> Raster<u16> {
    use geo::Contains as _;
    let mut mask = Raster::filled(SIZE.0 as usize, SIZE.1 as usize, 0);
    let centre = view.camera_from_map.centre();
    for row in 0..SIZE.1 as usize {
        for col in 0..SIZE.0 as usize {
            let at = geo_types::Point::new(
                centre.x + (col as f64 + 0.5 - 120.0) * PIXEL_M,
                centre.y - (row as f64 + 0.5 - 90.0) * PIXEL_M,
            );
            if let Some(i) = houses.iter().position(|h| h.contains(&at)) {
                mask[(col, row)] = i as u16 + 1;
            }
        }
    }
    mask
}

pub(super) fn save(path: &Path, mask: &Raster<u16>) {
    let (width, height) = (mask.width() as u32, mask.height() as u32);
    let image: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_raw(width, height, mask.data().to_vec()).unwrap();
    image.save(path).unwrap();
}

/// A layer of rectangles in the project's CRS.
fn write_layer(path: &Path, houses: &[(&str, Polygon<f64>)]) {
    let features: Vec<Value> = houses
        .iter()
        .map(|(id, p)| {
            let ring: Vec<Value> = p.exterior().0.iter().map(|c| json!([c.x, c.y])).collect();
            json!({"type": "Feature", "properties": {"key": id, "street": format!("at {id}")},
                   "geometry": {"type": "Polygon", "coordinates": [ring]}})
        })
        .collect();
    let layer = json!({"type": "FeatureCollection", "features": features,
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}});
    std::fs::write(path, layer.to_string()).unwrap();
}

pub(super) fn source_of(folder: &Path, toml: &str) -> FootprintSource {
    let mut source: FootprintSource = toml::from_str(toml).unwrap();
    source.visit_paths(&mut |path| *path = folder.join(&*path));
    source
}

pub(super) fn find(source: &FootprintSource, views: &[View], terrain: &Terrain) -> Result<Detection, FootprintError> {
    let contours: Box<dyn ContourSource> = match source {
        FootprintSource::Masks(masks) => Box::new(MaskFiles::new(masks.clone())?),
        FootprintSource::Network(network) => Box::new(Segmenter::new(network.clone())?),
        FootprintSource::Layer(_) => panic!("a layer is not looked for"),
    };
    detect(contours.as_ref(), views, terrain, source.detection().unwrap(), &crs())
}

pub(super) fn polygons(found: &Detection) -> Vec<Polygon<f64>> {
    found.layer.footprints.iter().map(|f| f.polygon.clone()).collect()
}

pub(super) const INSTANCES: &str = "source = 'masks'\npath = '{stem}.png'\nkind = 'instance'";

/// Three views over a pair of row houses, a single house, and a hall that no view shows whole.
pub(super) fn town() -> (Vec<View>, Vec<Polygon<f64>>) {
    let views = vec![view("a.jpg", -20.0, 0.0), view("b.jpg", 0.0, 5.0), view("c.jpg", 40.0, 0.0)];
    let houses = vec![
        house(-30.0, -10.0, 8.0, 12.0),
        house(-22.0, -10.0, 8.0, 12.0),
        house(0.0, 10.0, 11.0, 9.0),
        house(30.0, -20.0, 90.0, 14.0),
    ];
    (views, houses)
}

pub(super) fn with_masks(folder: &Path) -> (Vec<View>, Vec<Polygon<f64>>) {
    let (views, houses) = town();
    for view in &views {
        save(&folder.join(view.id.0.replace("jpg", "png")), &mask(view, &houses));
    }
    (views, houses)
}

#[test]
fn row_houses_stay_apart_and_a_hall_is_put_together_from_its_parts() {
    let folder = tempfile::tempdir().unwrap();
    let (mut views, mut houses) = with_masks(folder.path());
    // A fourth view sees the hall's other end.
    let far = view("d.jpg", 95.0, 0.0);
    save(&folder.path().join("d.png"), &mask(&far, &houses));
    views.push(far);
    let found = find(&source_of(folder.path(), INSTANCES), &views, &GROUND).unwrap();
    assert_eq!(found.layer.footprints.len(), 4, "{:?}", found.layer.issues);
    let evaluation = evaluate_footprints(&polygons(&found), &houses);
    assert!(evaluation.iou > 0.97, "{evaluation}");
    assert!(evaluation.corner_median_m.unwrap() < 0.1, "{evaluation}");
    let hall = found.sightings.iter().find(|s| s.is_assembled).expect("the hall");
    assert!(hall.n_views >= 2 && hall.agreement > 0.95, "{hall:?}");
    // The wall between the row houses is one line: two corners in common.
    houses.truncate(2);
    let row: Vec<_> = found
        .layer
        .footprints
        .iter()
        .filter(|f| houses.iter().any(|h| h.intersection(&f.polygon).unsigned_area() > 50.0))
        .collect();
    let [a, b] = row[..] else { panic!("{} row houses", row.len()) };
    let shared = a.polygon.exterior().0.iter().skip(1).filter(|c| b.polygon.exterior().0.contains(c)).count();
    assert_eq!(shared, 2);
    assert_eq!(a.polygon.intersection(&b.polygon).unsigned_area(), 0.0);
    // Each corner has an accuracy of its own, no better than a quarter of a pixel here and no worse than two.
    let sigmas: Vec<f64> = found.sightings.iter().flat_map(|s| s.corner_sigma_m.iter().copied()).collect();
    assert!(sigmas.iter().all(|s| (0.12..1.0).contains(s)), "{sigmas:?}");
}

#[test]
fn masks_without_numbers_join_row_houses_and_keep_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let (views, houses) = with_masks(folder.path());
    let semantic = "source = 'masks'\npath = '{stem}.png'\nkind = 'semantic'";
    let found = find(&source_of(folder.path(), semantic), &views, &GROUND).unwrap();
    let joined = houses[0].union(&houses[1]);
    let best = |truth: &geo_types::MultiPolygon<f64>| {
        let iou = |p: Polygon<f64>| {
            let shared = geo_types::MultiPolygon::new(vec![p.clone()]).intersection(truth).unsigned_area();
            shared / (p.unsigned_area() + truth.unsigned_area() - shared)
        };
        polygons(&found).into_iter().map(iou).fold(0.0, f64::max)
    };
    assert!(best(&joined) > 0.97 && best(&houses[2].clone().into()) > 0.95);
}

#[test]
fn masks_of_half_the_size_and_of_probabilities_give_the_same_houses() {
    let folder = tempfile::tempdir().unwrap();
    let (views, houses) = town();
    for view in &views {
        let full = mask(view, &houses[2..3]);
        // The share of each 2 × 2 block that is building, as 8-bit probability.
        let share = |x: u32, y: u32| {
            let n = (0..4).filter(|i| full[((2 * x + i % 2) as usize, (2 * y + i / 2) as usize)] > 0).count();
            Luma([(n * 255 / 4) as u8])
        };
        GrayImage::from_fn(SIZE.0 / 2, SIZE.1 / 2, share)
            .save(folder.path().join(view.id.0.replace("jpg", "png")))
            .unwrap();
    }
    let probability = "source = 'masks'\npath = '{stem}.png'\nkind = 'probability'\nabove = 127.5";
    let found = find(&source_of(folder.path(), probability), &views, &GROUND).unwrap();
    let evaluation = evaluate_footprints(&polygons(&found), &houses[2..3]);
    assert!(evaluation.n_results == 1 && evaluation.iou > 0.95, "{evaluation}");
}

/// The same masks as COCO run lengths and polygons, written here from the format's description.
#[test]
fn coco_run_lengths_and_polygons_are_read_as_masks_are() {
    let folder = tempfile::tempdir().unwrap();
    let (views, houses) = with_masks(folder.path());
    let from_masks = find(&source_of(folder.path(), INSTANCES), &views, &GROUND).unwrap();
    let (mut images, mut annotations) = (Vec::new(), Vec::new());
    for (i, view) in views.iter().enumerate() {
        images.push(json!({"id": i, "file_name": view.id.0, "width": SIZE.0, "height": SIZE.1}));
        let mask = mask(view, &houses);
        for label in 1..=houses.len() as u16 {
            let mut counts: Vec<u32> = vec![0];
            let (mut is_inside, columns) =
                (false, (0..mask.width()).flat_map(|c| (0..mask.height()).map(move |r| (c, r))));
            for at in columns {
                if (mask[at] == label) != is_inside {
                    is_inside = !is_inside;
                    counts.push(0);
                }
                *counts.last_mut().unwrap() += 1;
            }
            if counts.len() > 1 {
                annotations.push(json!({"image_id": i, "category_id": 7, "score": 0.9,
                    "segmentation": {"size": [SIZE.1, SIZE.0], "counts": counts}}));
            }
        }
        // A polygon of another category, which is not asked for.
        annotations.push(json!({"image_id": i, "category_id": 8, "segmentation": [[5, 5, 60, 5, 60, 60, 5, 60]]}));
    }
    let categories = json!([{"id": 7, "name": "building"}, {"id": 8, "name": "pool"}]);
    let document = json!({"images": images, "annotations": annotations, "categories": categories});
    std::fs::write(folder.path().join("masks.json"), document.to_string()).unwrap();
    let coco = "source = 'masks'\npath = 'masks.json'\nkind = 'coco'\ncategory = 'building'";
    let found = find(&source_of(folder.path(), coco), &views, &GROUND).unwrap();
    assert_eq!(polygons(&found).len(), polygons(&from_masks).len());
    let same = evaluate_footprints(&polygons(&found), &polygons(&from_masks));
    assert!(same.iou > 0.999, "{same}");
    let polygon_only = coco.replace("building", "pool");
    let pools = find(&source_of(folder.path(), &polygon_only), &views[..1], &GROUND).unwrap();
    assert_eq!(pools.layer.footprints.len(), 1);
    assert!((polygons(&pools)[0].unsigned_area() - 55.0 * 55.0 * PIXEL_M * PIXEL_M).abs() < 5.0);
    let wrong = coco.replace("building", "church");
    let error = find(&source_of(folder.path(), &wrong), &views, &GROUND).unwrap_err().to_string();
    assert!(error.contains("church") && error.contains("building, pool"), "{error}");
}

#[test]
fn a_cadastre_keeps_its_ids_and_changes_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let (views, houses) = with_masks(folder.path());
    write_layer(
        &folder.path().join("cadastre.geojson"),
        &[
            ("K1", houses[0].clone()),
            ("K2", house(-22.0, -10.0, 8.0, 6.0)),  // was half as long
            ("K3", house(-10.0, -35.0, 10.0, 8.0)), // pulled down
            ("K4", house(900.0, 900.0, 10.0, 8.0)), // where nobody looks
        ],
    );
    let text = format!("{INSTANCES}\n[cadastre]\npath = 'cadastre.geojson'\nid_field = 'key'");
    let found = find(&source_of(folder.path(), &text), &views, &GROUND).unwrap();
    let of = |id: &str| found.layer.footprints.iter().find(|f| f.id.0 == id).expect(id);
    assert_eq!(of("K1").attributes["street"], "at K1");
    assert_eq!(of("K1").attributes["cadastre"], "matched");
    assert_eq!(
        of("K1").polygon,
        read(
            &FootprintConfig {
                id_field: Some("key".into()),
                ..FootprintConfig::new(folder.path().join("cadastre.geojson"))
            },
            &crs()
        )
        .unwrap()
        .footprints[0]
            .polygon
    );
    assert_eq!(of("K2").attributes["cadastre"], "changed_footprint");
    assert!((of("K2").polygon.unsigned_area() - 96.0).abs() < 5.0, "the photos' footprint");
    assert_eq!(of("K4").attributes["cadastre"], "unseen");
    assert_eq!(found.vanished.iter().map(|f| f.id.0.as_str()).collect::<Vec<_>>(), ["K3"]);
    let n = |change| found.summary.by_change.get(&change).copied().unwrap_or(0);
    assert_eq!(
        [CadastreChange::Matched, CadastreChange::ChangedFootprint, CadastreChange::Vanished, CadastreChange::Unseen]
            .map(n),
        [1, 1, 1, 1]
    );
    assert_eq!(n(CadastreChange::New), found.layer.footprints.len() - 3);
    let codes: Vec<&str> = found.layer.issues.iter().map(|i| i.code.as_str()).collect();
    assert!(codes.contains(&"cadastre_vanished") && codes.contains(&"cadastre_changed_footprint"), "{codes:?}");
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/onnx").join(name)
}

/// A photo in which houses have their own colours.
fn with_photo(folder: &Path, colours: &[[u8; 3]]) -> (Vec<View>, Vec<Polygon<f64>>) {
    let mut view = view("p.png", 0.0, 0.0);
    let houses = vec![house(-40.0, -20.0, 26.0, 22.0), house(10.0, 5.0, 30.0, 20.0)];
    let mask = mask(&view, &houses);
    let pixel = |x: u32, y: u32| match mask[(x as usize, y as usize)] {
        0 => image::Rgb([20, 20, 20]),
        label => image::Rgb(colours[usize::from(label) - 1]),
    };
    let path = folder.join("p.png");
    RgbImage::from_fn(SIZE.0, SIZE.1, pixel).save(&path).unwrap();
    view.image = Some(path);
    (vec![view], houses)
}

/// A network with a built-in profile, but for the side of its tiles.
fn with_side(folder: &Path, model: &str, profile: &str, side_px: i64) -> SegmenterConfig {
    let profiles = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/footprints/src/segment/profiles.toml");
    let mut profiles: toml::Table = std::fs::read_to_string(profiles).unwrap().parse().unwrap();
    let all = profiles["profile"].as_array_mut().unwrap();
    let own = all.iter_mut().find(|own| own["name"].as_str() == Some(profile)).unwrap().as_table_mut().unwrap();
    own.insert("side_px".to_owned(), side_px.into());
    let path = folder.join(format!("{profile}-{side_px}.toml"));
    std::fs::write(&path, own.to_string()).unwrap();
    SegmenterConfig::new(fixture(model), path.to_str().unwrap())
}

#[test]
fn a_network_sees_a_photo_in_tiles_and_joins_what_they_cut() {
    let folder = tempfile::tempdir().unwrap();
    let (views, houses) = with_photo(folder.path(), &[[230; 3], [230; 3]]);
    for tile_px in [64, 100, 1000] {
        let config = with_side(folder.path(), "buildings_of_brightness.onnx", "semantic", tile_px);
        let found = find(&FootprintSource::Network(config), &views, &GROUND).unwrap();
        let evaluation = evaluate_footprints(&polygons(&found), &houses);
        assert!(evaluation.n_results == 2 && evaluation.iou > 0.95, "{tile_px}: {evaluation}");
    }
    let config = with_side(folder.path(), "instances_of_colours.onnx", "sam3", 96);
    let (views, houses) = with_photo(folder.path(), &[[255, 60, 60], [60, 255, 60]]);
    let found = find(&FootprintSource::Network(config), &views, &GROUND).unwrap();
    let evaluation = evaluate_footprints(&polygons(&found), &houses);
    assert!(evaluation.n_results == 2 && evaluation.iou > 0.95, "{evaluation}");
    // Scores: sigmoid(3)·sigmoid(4) and sigmoid(2)·sigmoid(4).
    let mut scores: Vec<f32> = found.candidates.iter().map(|c| c.score).collect();
    scores.sort_by(f32::total_cmp);
    assert!((scores[0] - 0.865).abs() < 1e-3 && (scores[1] - 0.935).abs() < 1e-3, "{scores:?}");
}

#[test]
fn a_network_that_stops_is_told_with_one_hint_and_is_no_fault_of_the_photo() {
    let folder = tempfile::tempdir().unwrap();
    let (views, _) = with_photo(folder.path(), &[[230; 3], [230; 3]]);
    // The embedded engine loads this graph and cannot run it.
    let profile = folder.path().join("mine.toml");
    let text = "name = 'mine'\nabout = 'a test'\ninputs = ['image']\nside_px = 64\nmean = [0.0, 0.0, 0.0]\nstd = [1.0, 1.0, 1.0]\n\
                masks = ['depth']\ngives = 'semantic'\nactivation = 'none'\nlicence = 'none'\n";
    std::fs::write(&profile, text).unwrap();
    let source = json!({"source": "network", "model": fixture("pad_by_axes.onnx"), "profile": profile});
    match find(&serde_json::from_value(source).unwrap(), &views, &GROUND) {
        Err(FootprintError::Masks { problem, hint }) => {
            assert!(problem.contains("pad_by_axes.onnx failed: the embedded engine: "), "{problem}");
            assert!(!problem.contains("its photo") && !problem.contains("hint:"), "{problem}");
            assert!(hint.contains("make deps-onnxruntime") && !hint.contains("hint:"), "{hint}");
        }
        Err(other) => panic!("{other}"),
        Ok(_) => crate::skipped::skip("this machine has ONNX Runtime, which runs the graph"),
    }
}

#[test]
fn a_head_over_two_backbones_gets_their_features_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let (views, houses) = with_photo(folder.path(), &[[230; 3], [230; 3]]);
    let mut config = SegmenterConfig::new(fixture("fpsam_head.onnx"), "fpsam.v1");
    let missing = Segmenter::new(config.clone()).unwrap_err().to_string();
    assert!(missing.contains("\"texture\"") && missing.contains("backbones"), "{missing}");
    config.backbones.insert("texture".to_owned(), fixture("fpsam_texture.onnx"));
    config.backbones.insert("geometry".to_owned(), fixture("fpsam_geometry.onnx"));
    let found = find(&FootprintSource::Network(config.clone()), &views, &GROUND).unwrap();
    let evaluation = evaluate_footprints(&polygons(&found), &houses);
    // The coarse features round corners off.
    assert!(evaluation.n_results == 2 && evaluation.iou > 0.85, "{evaluation}");
    config.backbones.insert("geometry".to_owned(), fixture("fpsam_texture.onnx"));
    let wrong = Segmenter::new(config).unwrap_err().to_string();
    assert!(wrong.contains("\"geo\"") && wrong.contains("fpsam_texture.onnx"), "{wrong}");
    let unknown = SegmenterConfig::new(fixture("fpsam_head.onnx"), "sam4");
    assert!(Segmenter::new(unknown).unwrap_err().to_string().contains("semantic, small.v1, sam3, fpsam.v1"));
}

/// A scene for the command line, its configuration reading footprints from masks.
pub(super) fn scene(folder: &Path, contour: MaskContour, footprints: &str) {
    let mut config = SimulateConfig::default();
    config.town.n_buildings = 8;
    config.flight.n_views = Some(40);
    (config.camera.width_px, config.camera.height_px) = (320, 240);
    config.prior.longest_px = 160;
    config.prior.level = sizeup::simulate::PriorLevel::Clean;
    config.images.enabled = false;
    config.masks.contour = contour;
    simulate(&config, folder, &|_, _| {}).unwrap();
    let path = folder.join("sizeup.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let layer = "path = \"footprints.gpkg\"\nid_field = \"id\"\n";
    assert!(text.contains(layer));
    let text = text.replace(layer, footprints);
    std::fs::write(
        &path,
        format!("{text}\n[optimise]\nworking_px = 160\n\n[output]\npictures = false\nreport.page = false\n"),
    )
    .unwrap();
}

pub(super) fn run(folder: &Path, args: &[&str]) -> Outcome {
    sizeup().current_dir(folder).args(args).output().unwrap().into()
}

pub(super) fn layer(path: &Path) -> Vec<Polygon<f64>> {
    let config = FootprintConfig {
        layer: path.extension().is_some_and(|e| e == "gpkg").then(|| "footprints".to_owned()),
        ..FootprintConfig::new(path)
    };
    read(&config, &crs()).unwrap().footprints.into_iter().map(|f| f.polygon).collect()
}

pub(super) const MASKS: &str = "source = \"masks\"\npath = \"masks/{stem}.png\"\nkind = \"instance\"\n";

#[test]
fn a_run_goes_from_masks_to_heights_and_is_the_same_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    scene(folder, MaskContour::Ground, MASKS);
    let footprints = run(folder, &["footprints", "sizeup.toml", "--threads", "1", "--output", "one"]);
    assert_eq!(footprints.code, 0, "{}", footprints.stderr);
    assert!(footprints.stderr.contains("8 buildings"), "{}", footprints.stderr);
    run(folder, &["footprints", "sizeup.toml", "--threads", "4", "--output", "four"]);
    let bytes = |name: &str| std::fs::read(folder.join(name).join("footprints.gpkg")).unwrap();
    assert_eq!(bytes("one"), bytes("four"));
    let evaluation =
        evaluate_footprints(&layer(&folder.join("one/footprints.gpkg")), &layer(&folder.join("truth.geojson")));
    assert!(evaluation.iou > 0.9 && evaluation.n_hits == 8, "{evaluation}");

    // The stage needs no priors; a run goes on to the heights.
    let text = std::fs::read_to_string(folder.join("sizeup.toml")).unwrap();
    let (before, prior) = text.split_once("[prior]").unwrap();
    let after = prior.split_once("\n\n[optimise]").unwrap().1;
    std::fs::write(folder.join("no_prior.toml"), format!("{before}[optimise]{after}")).unwrap();
    assert_eq!(run(folder, &["footprints", "no_prior.toml", "--output", "np"]).code, 0);
    let whole = run(folder, &["run", "sizeup.toml", "--json"]);
    assert!([0, 5].contains(&whole.code), "{}", whole.stderr);
    let summary: Value = serde_json::from_str(&whole.stdout).unwrap();
    assert_eq!(summary["detection"]["n_views"], 8);
    let heights = run(folder, &["evaluate", "result/city.city.json", "truth.geojson", "--json"]);
    let heights: Value = serde_json::from_str(&heights.stdout).unwrap();
    assert_eq!(heights["counts"]["n_compared"], 8, "{heights}");
    assert!(heights["all"]["error_median_m"].as_f64().unwrap() < 1.5, "{heights}");
    let city: Value = serde_json::from_slice(&std::fs::read(folder.join("result/city.city.json")).unwrap()).unwrap();
    let building = city["CityObjects"].as_object().unwrap().iter().find(|(_, o)| o["type"] == "Building").unwrap();
    assert!(building.1["attributes"]["footprint_confidence"].as_f64().unwrap() > 0.5, "{building:?}");
    let lineage = std::fs::read_to_string(folder.join("result/lineage.json")).unwrap();
    assert!(lineage.contains("masks/"), "the masks are among the inputs");
}

#[test]
fn roof_footprints_move_to_their_heights() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    scene(folder, MaskContour::Roof, &format!("{MASKS}contour = \"roof\"\n"));
    let first = run(folder, &["footprints", "sizeup.toml"]);
    assert_eq!(first.code, 0, "{}", first.stderr);
    let truth = layer(&folder.join("truth.geojson"));
    let at_guess = evaluate_footprints(&layer(&folder.join("result/footprints.gpkg")), &truth);
    let whole = run(folder, &["run", "sizeup.toml"]);
    assert!([0, 5].contains(&whole.code), "{}", whole.stderr);
    let stage: Value =
        serde_json::from_slice(&std::fs::read(folder.join("result/stages/footprints.json")).unwrap()).unwrap();
    let footprints: Vec<sizeup::footprint::Footprint> =
        serde_json::from_value(stage["data"]["layer"]["footprints"].clone()).unwrap();
    let moved: Vec<Polygon<f64>> = footprints.into_iter().map(|f| f.polygon).collect();
    let at_height = evaluate_footprints(&moved, &truth);
    println!("at the guessed height {at_guess}at the height found {at_height}");
    assert!(at_height.iou > at_guess.iou + 0.02 && at_height.iou > 0.85, "{at_guess}{at_height}");
}
