//! One reader of sizeup, fed with bytes by libFuzzer. Which one, the environment's `READER` says; `fuzz/run.sh` lists them.
//!
//! Readers take files, so every input becomes a file in memory (`/dev/shm`). An error is what most inputs deserve; a panic, an
//! overflow, ten seconds or a gigabyte are finds.
#![no_main]

use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

use glam::{DMat3, DVec3};
use libfuzzer_sys::fuzz_target;
use sizeup::camera::Camera;
use sizeup::config::RunConfig;
use sizeup::crs::Crs;
use sizeup::footprint::{Look, MaskConfig, MaskFiles, OutlineSource as _};
use sizeup::frames::Rigid;
use sizeup::geodata::vector::VectorLayer;
use sizeup::output::read::{FoundBuildings, ReadOptions};
use sizeup::output::validate::{ValidateConfig, validate_file};
use sizeup::prior::{FilePriorConfig, FilePriors, PriorKind, PriorSource as _};
use sizeup::survey::{self, CameraConfig, Format, HeightConfig, SurveyConfig, View};
use sizeup::tiles::Layout;

fuzz_target!(|bytes: &[u8]| {
    let case = &*CASE;
    std::fs::write(&case.file, bytes).expect("a file in memory can be written");
    (case.read)(&case.file, bytes);
});

/// A reader and the file that it is given.
struct Case {
    file: PathBuf,
    read: fn(&Path, &[u8]),
}

/// Name of the reader, name of its file, files beside it.
type Known = (&'static str, &'static str, fn(&Path, &[u8]), &'static [(&'static str, &'static str)]);

const CAMERAS: &str = "1 PINHOLE 40 30 30 30 20 15\n";
const CAMERAS_JSON: &str = r#"{"c":{"projection_type":"brown","width":40,"height":30,"focal_x":0.8}}"#;

const READERS: [Known; 26] = [
    ("colmap_text", "images.txt", |path, _| poses(Format::Colmap, folder(path)), &[("cameras.txt", CAMERAS)]),
    ("colmap_cameras", "cameras.txt", |path, _| poses(Format::Colmap, folder(path)), &[("images.txt", IMAGES)]),
    ("colmap_binary", "images.bin", |path, _| colmap_binary(path), &[]),
    ("blocks_exchange", "block.xml", |path, _| poses(Format::BlocksExchange, path), &[]),
    ("blocks_exchange_zip", "block.xmlz", |path, _| poses(Format::BlocksExchange, path), &[]),
    ("metashape", "cameras.xml", |path, _| poses(Format::Metashape, path), &[]),
    ("metashape_opk", "opk.txt", |path, _| poses(Format::MetashapeOpk, path), &[]),
    ("opensfm", "reconstruction.json", |path, _| poses(Format::Opensfm, path), &[]),
    ("odm", "shots.geojson", |path, _| poses(Format::Odm, path), &[("cameras.json", CAMERAS_JSON), ("proj.txt", "EPSG:25832")]),
    ("geo_txt", "geo.txt", |path, _| poses(Format::GeoTxt, path), &[]),
    ("pix4d", "p_calibrated_camera_parameters.txt", |path, _| poses(Format::Pix4d, path), &[]),
    ("opf", "project.opf", |path, _| poses(Format::Opf, path), &[]),
    ("csv", "poses.csv", |path, _| poses(Format::Csv, path), &[]),
    ("photo", "a.jpg", |path, _| poses(Format::Photos, path), &[]),
    ("photo_tiff", "a.tif", |path, _| poses(Format::Photos, path), &[]),
    ("cityjson", "a.city.json", |path, _| city(path), &[]),
    ("cityjson_sequence", "a.city.jsonl", |path, _| city(path), &[]),
    ("npy", "a.npy", |path, _| prior(path), &[]),
    ("npz", "a.npz", |path, _| prior(path), &[]),
    ("pfm", "a.pfm", |path, _| prior(path), &[]),
    ("exr", "a.exr", |path, _| prior(path), &[]),
    ("las", "a.las", |path, _| drop(sizeup::cloud::read(path)), &[]),
    ("geojson", "a.geojson", |path, _| layer(path), &[]),
    ("coco", "a.json", |path, _| masks(path), &[]),
    ("tiles", "tiles.json", |path, _| drop(Layout::new(folder(path)).read_manifest()), &[]),
    ("config", "sizeup.toml", |path, bytes| config(path, bytes), &[]),
];

const IMAGES: &str = "1 0 1 0 0 -5e5 57e5 100 1 a.jpg\n\n";

static CASE: LazyLock<Case> = LazyLock::new(|| {
    let wanted = std::env::var("READER").unwrap_or_default();
    let Some((_, name, read, beside)) = READERS.iter().find(|(reader, ..)| *reader == wanted) else {
        let names: Vec<&str> = READERS.iter().map(|(name, ..)| *name).collect();
        panic!("READER={wanted:?}: expected one of {}", names.join(", "));
    };
    let memory = Path::new("/dev/shm");
    let place = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let folder = tempfile::Builder::new().prefix("sizeup-fuzz-").tempdir_in(place).expect("a folder can be made").keep();
    for (name, text) in *beside {
        std::fs::write(folder.join(name), text).expect("a file in memory can be written");
    }
    Case { file: folder.join(name), read: *read }
});

fn folder(path: &Path) -> &Path {
    path.parent().expect("files lie in a folder")
}

/// The binary model's cameras lie beside its images.
fn colmap_binary(path: &Path) {
    static CAMERAS: &[u64] = &[1];
    let cameras = folder(path).join("cameras.bin");
    if !cameras.exists() {
        let mut bytes: Vec<u8> = CAMERAS.iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(1_i32.to_le_bytes());
        bytes.extend([4000_u64, 3000].iter().flat_map(|n| n.to_le_bytes()));
        bytes.extend([3000.0_f64, 3000.0, 2000.0, 1500.0].iter().flat_map(|n| n.to_le_bytes()));
        std::fs::write(&cameras, bytes).expect("a file in memory can be written");
    }
    poses(Format::Colmap, folder(path));
}

/// Whatever is read is sound.
fn poses(format: Format, path: &Path) {
    static CRS: LazyLock<Crs> = LazyLock::new(|| Crs::parse("EPSG:25832").expect("PROJ knows it"));
    let camera =
        CameraConfig { width: 400, height: 300, fx: 300.0, fy: None, cx: None, cy: None, k: [0.0; 3], p: [0.0; 2] };
    let height = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    let config = SurveyConfig { format, camera: Some(camera), height, ..SurveyConfig::at(path) };
    for view in survey::read(&config, &CRS).map(|survey| survey.views).unwrap_or_default() {
        assert!(view.centre().is_finite(), "{view:?}");
        assert!((view.camera_from_map.rotation.determinant() - 1.0).abs() < 1e-9, "{view:?}");
        assert!(view.camera.validate().is_ok(), "{view:?}");
    }
}

fn city(path: &Path) {
    let found = FoundBuildings::read(path, &ReadOptions::default());
    drop(found.map(|found| found.to_records()));
    drop(validate_file(path, &ValidateConfig::default()));
}

fn view() -> View {
    View {
        id: "a.jpg".into(),
        camera: Arc::new(Camera::pinhole(64, 48, 50.0)),
        camera_from_map: Rigid::new(DMat3::IDENTITY, DVec3::ZERO),
        image: None,
    }
}

fn prior(path: &Path) {
    let view = view();
    let config = FilePriorConfig::new(path.to_string_lossy(), PriorKind::Depth);
    let priors = FilePriors::new(config, [&view.id]).expect("the settings are sound");
    drop(priors.load(&view));
}

fn layer(path: &Path) {
    let Ok(mut layer) = VectorLayer::open(path, None) else { return };
    drop(layer.crs());
    assert!(layer.features().count() <= 1 << 20);
}

fn masks(path: &Path) {
    let settings = format!("path = {:?}\nkind = \"coco\"\n", path.to_string_lossy());
    let config: MaskConfig = toml::from_str(&settings).expect("the settings are sound");
    let Ok(masks) = MaskFiles::new(config) else { return };
    drop(masks.outlines(&view(), Look { min_area_px2: 1.0, tolerance_px: 1.0 }));
}

fn config(path: &Path, bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(config) = RunConfig::from_text(text, path, &[]) {
        let again = RunConfig::from_text(&config.to_toml(), path, &[]).expect("what is written can be read");
        assert_eq!(again.to_toml(), config.to_toml());
    }
}
