//! One reader of sizeup, fed with bytes by libFuzzer. Which one, the environment's `READER` says; `fuzz/run.sh` lists them.
//!
//! Readers take files, so every input becomes a file in memory (`/dev/shm`). An error is what most inputs deserve; a panic, an
//! overflow, ten seconds or a gigabyte are finds. With `SEEDS` set, files to begin with are written to that folder, and that is all.
#![no_main]

mod project;
mod seeds;
mod shapefile;

use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

use glam::{DMat3, DVec3};
use libfuzzer_sys::fuzz_target;
use sizeup::camera::Camera;
use sizeup::config::{self, RunConfig};
use sizeup::crs::Crs;
use sizeup::evaluate;
use sizeup::footprint::{self, ContourFineness, ContourSource as _, FootprintConfig, MaskConfig, MaskFiles};
use sizeup::frames::Rigid;
use sizeup::geodata::vector::VectorLayer;
use sizeup::hashes::Hashes;
use sizeup::onnx;
use sizeup::output::read::{FoundBuildings, ReadOptions};
use sizeup::output::reviews::Reviews;
use sizeup::output::validate::{ValidateConfig, validate_file};
use sizeup::pipeline::Stage;
use sizeup::prior::{FilePriorConfig, FilePriors, PriorCache, PriorKind, PriorSource as _};
use sizeup::report::Server;
use sizeup::simulate::SimulateConfig;
use sizeup::survey::{self, CameraConfig, Format, HeightConfig, SurveyConfig, View};
use sizeup::terrain::{self, MapBox, TerrainConfig};
use sizeup::tiles::{Attempt, Layout};

fuzz_target!(init: write_seeds(), |bytes: &[u8]| {
    let case = &*CASE;
    std::fs::write(&case.file, bytes).expect("a file in memory can be written");
    (case.read)(&case.file, bytes);
});

fn write_seeds() {
    if let Some(folder) = std::env::var_os("SEEDS") {
        seeds::write(Path::new(&folder)).expect("seeds can be written");
        std::process::exit(0);
    }
}

/// A reader and the file that it is given.
struct Case {
    file: PathBuf,
    read: fn(&Path, &[u8]),
}

/// Name of the reader, name of its file, files beside it.
type Known = (&'static str, &'static str, fn(&Path, &[u8]), &'static [(&'static str, &'static str)]);

const CAMERAS: &str = "1 PINHOLE 40 30 30 30 20 15\n";
const CAMERAS_JSON: &str = r#"{"c":{"projection_type":"brown","width":40,"height":30,"focal_x":0.8}}"#;

#[rustfmt::skip] // a table, which run.sh takes the names from
const READERS: &[Known] = &[
    ("colmap_text", "images.txt", |path, _| poses(Format::Colmap, folder(path)), &[("cameras.txt", CAMERAS)]),
    ("colmap_cameras", "cameras.txt", |path, _| poses(Format::Colmap, folder(path)), &[("images.txt", IMAGES)]),
    ("colmap_binary", "images.bin", |path, _| colmap_binary(path), &[]),
    ("blocks_exchange", "block.xml", |path, _| poses(Format::BlocksExchange, path), &[]),
    ("blocks_exchange_zip", "block.xmlz", |path, _| poses(Format::BlocksExchange, path), &[]),
    ("metashape", "cameras.xml", |path, _| poses(Format::Metashape, path), &[]),
    ("metashape_opk", "opk.txt", |path, _| poses(Format::MetashapeOpk, path), &[]),
    ("opensfm", "reconstruction.json", |path, _| poses(Format::Opensfm, path), &[]),
    ("opensfm_reference", "reference_lla.json", |path, _| poses(Format::Opensfm, &beside(path, "r.json")), &[("r.json", SFM)]),
    ("odm", "shots.geojson", |path, _| poses(Format::Odm, path), &[("cameras.json", CAMERAS_JSON), ("proj.txt", "EPSG:25832")]),
    ("odm_cameras", "cameras.json", |path, _| poses(Format::Odm, &beside(path, "s.geojson")), &[("s.geojson", SHOTS), ("proj.txt", "EPSG:25832")]),
    ("geo_txt", "geo.txt", |path, _| poses(Format::GeoTxt, path), &[]),
    ("pix4d", "p_calibrated_camera_parameters.txt", |path, _| poses(Format::Pix4d, path), &[]),
    ("pix4d_external", "p_calibrated_external_camera_parameters.txt", |path, _| poses(Format::Pix4d, path), &[]),
    ("pix4d_offset", "p_offset.xyz", |path, _| poses(Format::Pix4d, folder(path)), &[("p_calibrated_camera_parameters.txt", PIX4D)]),
    ("opf", "project.opf", |path, _| poses(Format::Opf, path), &[]),
    ("inpho", "block.prj", |path, _| poses(Format::Inpho, path), &[]),
    ("stac", "item.json", |path, _| poses(Format::Stac, path), &[]),
    ("nerfstudio", "transforms.json", |path, _| poses(Format::Nerfstudio, path), &[]),
    ("csv", "poses.csv", |path, _| poses(Format::Csv, path), &[]),
    ("recognised", "poses.txt", |path, _| recognised(path), &[]),
    ("photo", "a.jpg", |path, _| poses(Format::Photos, folder(path)), &[]),
    ("photo_tiff", "a.tif", |path, _| poses(Format::Photos, folder(path)), &[]),
    ("image_log", "DJI_007_Timestamp.MRK", |path, _| image_log(path), &[]),
    ("crs", "a.prj", |_, bytes| crs(bytes), &[]),
    ("cityjson", "a.city.json", |path, _| city(path), &[]),
    ("cityjson_sequence", "a.city.jsonl", |path, _| city(path), &[]),
    ("city_gpkg", "a.gpkg", |path, _| city(path), &[]),
    ("city_fgb", "a.fgb", |path, _| city(path), &[]),
    ("solids", "a.city.json", |path, _| solids(path), &[]),
    ("obj", "a.obj", |path, _| solids(path), &[]),
    ("npy", "a.npy", |path, _| prior(path), &[]),
    ("npz", "a.npz", |path, _| prior(path), &[]),
    ("pfm", "a.pfm", |path, _| prior(path), &[]),
    ("exr", "a.exr", |path, _| prior(path), &[]),
    ("prior_tiff", "a.tif", |path, _| prior(path), &[]),
    ("prior_png", "a.png", |path, _| prior(path), &[]),
    ("prior_names", "names.txt", |path, _| prior_names(path), &[]),
    ("kept_prior", "a.prior", |path, _| kept_prior(path), &[]),
    ("onnx", "a.onnx", |path, _| network(path), &[]),
    ("las", "a.las", |path, _| cloud(path), &[]),
    ("laz", "a.laz", |path, _| cloud(path), &[]),
    ("cloud_text", "a.xyz", |path, _| cloud(path), &[]),
    ("dtm", "dtm.tif", |path, _| ground(path), &[]),
    ("geojson", "a.geojson", |path, _| layer(path), &[]),
    ("gpkg", "a.gpkg", |path, _| layer(path), &[]),
    ("fgb", "a.fgb", |path, _| layer(path), &[]),
    ("shp", "a.shp", |path, _| shapefile::read(path), &[]),
    ("shx", "a.shx", |path, _| shapefile::read(path), &[]),
    ("dbf", "a.dbf", |path, _| shapefile::read(path), &[]),
    ("osm", "a.osm", |path, _| layer(path), &[]),
    ("osm_pbf", "a.osm.pbf", |path, _| layer(path), &[]),
    ("coco", "a.json", |path, _| masks(path, "coco"), &[]),
    ("mask_png", "a.png", |path, _| masks(path, "semantic"), &[]),
    ("reviews", "reviews.geojson", |path, _| drop(read(Reviews::read(path))), &[]),
    ("tiles", "tiles.json", |path, _| drop(read(Layout::new(folder(path)).read_manifest())), &[]),
    ("tile_done", "tiles/a.done.json", |path, _| drop(read(above(path).read_done("a").ok_or("not done"))), &[]),
    ("tile_attempt", "tiles/a.try.json", |path, _| drop(read(Attempt::read(&above(path), "a").ok_or("no try"))), &[]),
    ("stage_survey", "survey", |_, bytes| project::read_stage(Stage::Survey, bytes), &[]),
    ("stage_footprints", "footprints", |_, bytes| project::read_stage(Stage::Footprints, bytes), &[]),
    ("stage_heights", "heights", |_, bytes| project::read_stage(Stage::Heights, bytes), &[]),
    ("http", "request.txt", |_, bytes| request(bytes), &[]),
    ("hashes", "hashes.json", |path, _| Hashes::new().load(path), &[]),
    ("config", "sizeup.toml", |path, bytes| run_config(path, bytes), &[]),
    ("survey_config", "survey.toml", |_, bytes| drop(text(bytes).map(|text| read(toml::from_str::<SurveyConfig>(text)))), &[]),
    ("simulate_config", "town.toml", |path, bytes| drop(text(bytes).map(|text| read(config::parse::<SimulateConfig>(text, Some(path), &[])))), &[]),
    ("assignment", "sizeup.toml", |path, bytes| assignment(path, bytes), &[]),
];

const SFM: &str = r#"[{"cameras":{"c":{"projection_type":"brown","width":40,"height":30,"focal_x":0.8}},"shots":{"a.jpg":
    {"rotation":[3.14159,0,0],"translation":[0,0,100],"camera":"c"}}}]"#;
const SHOTS: &str = r#"{"features":[{"properties":{"filename":"a.jpg","rotation":[3.14159,0,0],"translation":[5e5,57e5,100],
    "camera":"c"}}]}"#;
const PIX4D: &str = "h\nh\nh\nh\nh\nh\nh\nh\na.jpg 40 30\n30 0 20\n0 30 15\n0 0 1\n-0.1 0.02 0\n1e-4 0\n1 2 100\n1 0 0\n0 -1 0\n0 0 -1\n";
const IMAGES: &str = "1 0 1 0 0 -5e5 57e5 100 1 a.jpg\n\n";

/// Where files go: what `PLACE` says, else into memory.
fn place() -> PathBuf {
    let memory = Path::new("/dev/shm");
    let usual = || if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    std::env::var_os("PLACE").map_or_else(usual, PathBuf::from)
}

static CASE: LazyLock<Case> = LazyLock::new(|| {
    let wanted = std::env::var("READER").unwrap_or_default();
    let Some((_, name, read, beside)) = READERS.iter().find(|(reader, ..)| *reader == wanted) else {
        let names: Vec<&str> = READERS.iter().map(|(name, ..)| *name).collect();
        panic!("READER={wanted:?}: expected one of {}", names.join(", "));
    };
    let folder =
        tempfile::Builder::new().prefix("sizeup-fuzz-").tempdir_in(place()).expect("a folder can be made").keep();
    for (name, text) in *beside {
        std::fs::write(folder.join(name), text).expect("a file in memory can be written");
    }
    std::fs::create_dir_all(folder.join("tiles")).expect("a folder can be made");
    Case { file: folder.join(name), read: *read }
});

/// Whether an error is a find: that tells whether seeds get past the door.
fn is_sound_expected() -> bool {
    static SOUND: LazyLock<bool> = LazyLock::new(|| std::env::var_os("SOUND").is_some());
    *SOUND
}

/// What was read. With `SOUND` set an error is a find.
fn read<T, E: std::fmt::Display>(result: Result<T, E>) -> Option<T> {
    match result {
        Err(error) if is_sound_expected() => panic!("{error}"),
        result => result.ok(),
    }
}

fn folder(path: &Path) -> &Path {
    path.parent().expect("files lie in a folder")
}

fn beside(path: &Path, name: &str) -> PathBuf {
    path.with_file_name(name)
}

/// The results that a tile's file belongs to.
fn above(path: &Path) -> Layout {
    Layout::new(folder(folder(path)))
}

fn text(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes).ok()
}

fn utm() -> &'static Crs {
    static CRS: LazyLock<Crs> = LazyLock::new(|| Crs::parse("EPSG:25832").expect("PROJ knows it"));
    &CRS
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
    let camera =
        CameraConfig { width: 400, height: 300, fx: 300.0, fy: None, cx: None, cy: None, k: [0.0; 3], p: [0.0; 2] };
    let height = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    // Photos have places in degrees, most inputs have any, and PROJ takes 50 ms to make a way to the project for each: none is asked for.
    let crs = (format == Format::Photos).then(|| utm().clone());
    let config = SurveyConfig { format, camera: Some(camera), crs, height, ..SurveyConfig::at(path) };
    let views = read(survey::read(&config, utm())).map(|survey| survey.views).unwrap_or_default();
    assert!(!(is_sound_expected() && views.is_empty()), "no pose");
    for view in views {
        assert!(view.centre().is_finite(), "{view:?}");
        assert!((view.camera_from_map.rotation.determinant() - 1.0).abs() < 1e-9, "{view:?}");
        assert!(view.camera.validate().is_ok(), "{view:?}");
    }
}

/// As `sizeup init` looks at it: of a format that nobody has declared.
fn recognised(path: &Path) {
    if survey::recognise(path).is_some() {
        drop(read(survey::first_look(&SurveyConfig::at(path))));
        poses(Format::Auto, path);
    }
}

/// A request to the viewer; `HOST` in it is the server's own name, which it has to be asked by. What it serves lies in one folder.
fn request(bytes: &[u8]) {
    static SERVER: LazyLock<Server> = LazyLock::new(|| {
        let home = folder(&CASE.file);
        let tiles = home.join("tileset");
        std::fs::create_dir_all(tiles.join("tiles")).expect("a folder can be made");
        for (path, text) in [
            ("tileset/tileset.json", "{}"),
            ("tileset/tiles/a b.glb", "glTF"),
            ("secret.json", SECRET),
            ("tileset/notes.txt", SECRET),
        ] {
            std::fs::write(home.join(path), text).expect("a file in memory can be written");
        }
        Server::bind(&tiles, home, 0).expect("a port is free")
    });
    let address = SERVER.address();
    let host = address.trim_start_matches("http://").trim_end_matches('/').as_bytes();
    let mut request = Vec::new();
    let mut rest = bytes;
    while let Some((first, after)) = rest.split_first() {
        match rest.strip_prefix(b"HOST") {
            Some(after) => {
                request.extend(host);
                rest = after;
            }
            None => {
                request.push(*first);
                rest = after;
            }
        }
    }
    let mut reply = Vec::new();
    read(SERVER.answer_one(request.as_slice(), &mut reply));
    assert!(reply.is_empty() || reply.starts_with(b"HTTP/1.1 "), "{reply:?}");
    assert!(!reply.windows(SECRET.len()).any(|part| part == SECRET.as_bytes()), "a file that is not the tileset's");
    assert!(!is_sound_expected() || reply.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&reply));
}

const SECRET: &str = "not for you";

/// A log beside a photo that it may place.
fn image_log(path: &Path) {
    let photo = beside(path, "DJI_20250502142325_0031_D.JPG");
    if !photo.exists() {
        let xmp = b"http://ns.adobe.com/xap/1.0/\0<x><r drone-dji:GpsLatitude=\"52\" drone-dji:GpsLongitude=\"9\" \
            drone-dji:AbsoluteAltitude=\"+300\" drone-dji:GimbalYawDegree=\"0\" drone-dji:GimbalPitchDegree=\"-90\" \
            drone-dji:GimbalRollDegree=\"0\" drone-dji:RtkFlag=\"50\" drone-dji:CalibratedFocalLength=\"3700\"/></x>";
        let mut bytes = vec![0xFF, 0xD8, 0xFF, 0xE1];
        bytes.extend(u16::try_from(xmp.len() + 2).expect("it is short").to_be_bytes());
        bytes.extend(xmp);
        bytes.extend([0xFF, 0xC0, 0, 11, 8, 0, 30, 0, 40, 1, 0, 0, 0, 0xFF, 0xD9]);
        std::fs::write(&photo, bytes).expect("a file in memory can be written");
    }
    poses(Format::Photos, folder(path));
}

fn crs(bytes: &[u8]) {
    let Some(crs) = text(bytes).and_then(|text| read(Crs::parse(text))) else { return };
    drop((crs.require_projected_metres(), crs.area_of_use_deg(), crs.vertical_epsg(), crs.geographic_base()));
}

fn solids(path: &Path) {
    let found = read(evaluate::solid::read_solids(path, None, Some(utm()), utm()));
    for solid in found.map(|found| found.solids).unwrap_or_default() {
        assert!(solid.facets.iter().flat_map(|facet| &facet.corners).all(|corner| !corner.x.is_nan()), "{solid:?}");
    }
}

/// A layer of a list of photos, one map each.
fn prior_names(path: &Path) {
    let stack = beside(path, "stack.npy");
    if !stack.exists() {
        let mut npy =
            b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 4), }".to_vec();
        npy.resize(127, b' ');
        npy.push(b'\n');
        npy.extend((1..=24_u8).flat_map(|v| f32::from(v).to_le_bytes()));
        std::fs::write(&stack, npy).expect("a file in memory can be written");
    }
    let config = FilePriorConfig {
        names: Some(path.to_owned()),
        ..FilePriorConfig::new(stack.to_string_lossy(), PriorKind::Depth)
    };
    let view = view();
    drop(read(FilePriors::new(config, [&view.id])).map(|priors| read(priors.load(&view))));
}

/// What an earlier run kept.
fn kept_prior(path: &Path) {
    static CACHE: LazyLock<PriorCache> =
        LazyLock::new(|| PriorCache::open(folder(&CASE.file), 1 << 30).expect("it can be opened"));
    let name = path.file_stem().and_then(|stem| stem.to_str()).expect("it has a name");
    drop(read(CACHE.get(name).ok_or("damaged")));
}

fn network(path: &Path) {
    drop(read(onnx::Contents::read(path)));
    let engine = onnx::EngineConfig { name: onnx::EngineChoice::Rten, ..onnx::EngineConfig::default() };
    drop(read(onnx::Network::open_with(path, &engine)));
}

fn cloud(path: &Path) {
    drop(read(evaluate::cloud_in_project(path, utm())));
}

fn ground(path: &Path) {
    let config = TerrainConfig { dtm: Some(path.to_owned()), ..TerrainConfig::default() };
    let area = MapBox { west_m: 5e5, south_m: 57e5 - 10.0, east_m: 5e5 + 10.0, north_m: 57e5 };
    let terrain = read(terrain::load(&config, utm(), area));
    assert!(terrain.and_then(|terrain| terrain.height_at(5e5 + 2.0, 57e5 - 2.0)).is_none_or(f64::is_finite));
}

fn city(path: &Path) {
    let found = read(FoundBuildings::read(path, &ReadOptions::default()));
    drop(found.map(|found| found.to_records()));
    if path.extension().is_some_and(|e| e == "json" || e == "jsonl") {
        drop(read(validate_file(path, &ValidateConfig::default())));
    }
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
    drop(read(priors.load(&view)));
}

fn layer(path: &Path) {
    // A shapefile's own CRS would be looked for among all that PROJ knows, 20 ms for every input; `crs` reads such text.
    let crs = if path.extension().is_some_and(|e| e == "shp") { "crs = \"EPSG:25832\"" } else { "" };
    let config: FootprintConfig = toml::from_str(&format!("path = {path:?}\n{crs}")).expect("the settings are sound");
    if let Some(found) = read(footprint::read(&config, utm())) {
        assert!(found.footprints.len() <= 1 << 20);
    }
    if !footprint::is_osm(path)
        && let Ok(mut layer) = VectorLayer::open(path, None)
    {
        assert!(layer.features().count() <= 1 << 20);
    }
}

fn masks(path: &Path, kind: &str) {
    let path = if kind == "coco" { path.to_owned() } else { path.with_file_name("{stem}.png") };
    let settings = format!("path = {path:?}\nkind = {kind:?}\n");
    let config: MaskConfig = toml::from_str(&settings).expect("the settings are sound");
    let Some(masks) = read(MaskFiles::new(config)) else { return };
    drop(masks.contours(&view(), ContourFineness { min_area_px2: 1.0, tolerance_px: 1.0, pixel_m: 0.1 }));
}

fn run_config(path: &Path, bytes: &[u8]) {
    let Some(text) = text(bytes) else { return };
    if let Some(config) = read(RunConfig::from_text(text, path, &[])) {
        let again = RunConfig::from_text(&config.to_toml(), path, &[]).expect("what is written can be read");
        assert_eq!(again.to_toml(), config.to_toml());
    }
}

/// One `--set` over a sound configuration.
fn assignment(path: &Path, bytes: &[u8]) {
    const CONFIG: &str = "[project]\ncrs = \"EPSG:25832\"\n[survey]\npath = \"s\"\n[footprints]\npath = \"f\"\n[terrain]\nconstant_m = 1.0\n\
        [prior]\nsource = \"stereo\"\n";
    let Some(text) = text(bytes) else { return };
    drop(read(RunConfig::from_text(CONFIG, path, &[text.to_owned()])));
}
