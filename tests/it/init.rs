//! A folder of photos as a project: what is chosen and why, what is missing, and that what is written runs.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use geo_types::Geometry;
use glam::DVec3;
use serde_json::{Value, json};
use sizeup::config::RunConfig;
use sizeup::crs::{Crs, Geocentric, Transform};
use sizeup::geodata::vector::{FeatureGeometry, VectorLayer};
use sizeup::geodata::{FieldType, LayerFeature, write_polygon_layer};
use sizeup::simulate::{SimulateConfig, simulate};
use sizeup::survey::{Survey, SurveyConfig, View};
use tempfile::TempDir;

use crate::shared_data::shared_data;
use crate::tiny_scene::{Outcome, sizeup};

/// Buildings of the scene.
const N_BUILDINGS: usize = 6;
/// Number of photos in the folder.
const N_PHOTOS: usize = 24;
/// The CRS that it is simulated in.
const CRS: &str = "EPSG:25832";
/// The scene's mean ground, metres.
const GROUND_M: f64 = 23.0;
/// EGM96 above the ellipsoid at the scene in Hamburg, metres: <https://geographiclib.sourceforge.io/cgi-bin/GeoidEval>.
const GEOID_M: f64 = 39.9;

/// For runs that are not about poses: to look whether photos fit them takes most of such a run's time.
const AS_GIVEN: [&str; 2] = ["--set", "align.when=never"];

/// A scene with photos, as `sizeup-lab simulate` leaves it.
fn scene() -> &'static Path {
    static SCENE: OnceLock<TempDir> = OnceLock::new();
    SCENE.get_or_init(|| simulated(N_PHOTOS, [640, 480])).path()
}

fn simulated(n_photos: usize, [width_px, height_px]: [u32; 2]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut config = SimulateConfig::preset("demo").unwrap();
    config.town.n_buildings = N_BUILDINGS;
    config.flight.n_views = Some(n_photos);
    (config.camera.width_px, config.camera.height_px) = (width_px, height_px);
    simulate(&config, folder.path(), &|_, _| {}).unwrap();
    folder
}

/// The scene's true poses.
fn survey() -> Survey {
    let georef: Value = serde_json::from_slice(&fs::read(scene().join("georef.json")).unwrap()).unwrap();
    let offset = serde_json::from_value(georef["offset"].clone()).unwrap();
    let config = SurveyConfig { offset, ..SurveyConfig::at(scene().join("sparse")) };
    sizeup::survey::read(&config, &Crs::parse(CRS).unwrap()).unwrap()
}

/// A place where a user would work: a folder `flight`, and commands given beside it.
struct Desk {
    folder: TempDir,
}

impl Desk {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("flight")).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, args: &[&str]) -> Outcome {
        sizeup().current_dir(self.folder.path()).args(args).output().unwrap().into()
    }

    /// `sizeup init flight` and more, its summary, and its exit code. What is complete has to be a configuration.
    fn init(&self, more: &[&str]) -> (Value, Outcome) {
        let outcome = self.run(&[&["init", "flight", "--json", "--force"], more].concat());
        let summary: Value = serde_json::from_str(&outcome.stdout).unwrap_or_default();
        if outcome.code == 0 {
            RunConfig::load(&self.path("sizeup.toml"), &[]).unwrap();
            assert_eq!(summary["is_complete"], true);
        }
        (summary, outcome)
    }

    fn text(&self) -> String {
        fs::read_to_string(self.path("sizeup.toml")).unwrap()
    }

    /// Brings a file or folder of the scene.
    fn bring(&self, name: &str, to: &str) {
        copy(&scene().join(name), &self.path("flight").join(to));
    }

    /// Photos as a drone would have written them.
    fn photos(&self, to: &str, drone: &Drone) {
        drone.write(&self.path("flight").join(to));
    }
}

fn copy(from: &Path, to: &Path) {
    if !from.is_dir() {
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(from, to).unwrap();
        return;
    }
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        copy(&entry.path(), &to.join(entry.file_name()));
    }
}

/// What a drone writes into its photos.
struct Drone {
    /// Whether a base station gives positions.
    is_rtk: bool,
    /// Its zero of heights below the scene's, metres.
    zero_m: f64,
    /// Only photos up to this number.
    n_photos: usize,
    /// Whether it writes directions of view.
    has_angles: bool,
}

impl Default for Drone {
    fn default() -> Self {
        Self { is_rtk: false, zero_m: 0.0, n_photos: N_PHOTOS, has_angles: true }
    }
}

impl Drone {
    fn write(&self, folder: &Path) {
        fs::create_dir_all(folder).unwrap();
        let to_degrees = Transform::new(&Crs::parse(CRS).unwrap(), &Crs::parse("EPSG:4326").unwrap()).unwrap();
        for (i, view) in survey().views.iter().take(self.n_photos).enumerate() {
            let jpeg = fs::read(scene().join("images").join(&view.id.0)).unwrap();
            let centre = view.centre();
            let packet = self.packet(view, to_degrees.point(centre.x, centre.y).unwrap());
            let payload = [b"http://ns.adobe.com/xap/1.0/\0".as_slice(), packet.as_bytes()].concat();
            let length = u16::try_from(payload.len() + 2).unwrap().to_be_bytes();
            let photo = [&jpeg[..2], &[0xFF, 0xE1], &length, &payload, &jpeg[2..]].concat();
            fs::write(folder.join(format!("DJI_{:04}.JPG", i + 1)), photo).unwrap();
        }
    }

    fn packet(&self, view: &View, (lon_deg, lat_deg): (f64, f64)) -> String {
        let axis = view.axis_in_map();
        let up = view.camera_from_map.inverse().vector(-DVec3::Y);
        let ahead = if axis.z < -0.999 { up } else { axis };
        // The zone's middle is 9° east: grid north is off true north by the meridians' convergence.
        let convergence_deg = ((lon_deg - 9.0).to_radians().tan() * lat_deg.to_radians().sin()).atan().to_degrees();
        let yaw_deg = ahead.x.atan2(ahead.y).to_degrees() + convergence_deg;
        let pitch_deg = axis.z.asin().to_degrees();
        let height_m = view.centre().z;
        let mut tags = vec![
            ("GpsLatitude", lat_deg),
            ("GpsLongitude", lon_deg),
            ("AbsoluteAltitude", height_m + self.zero_m),
            ("RelativeAltitude", height_m - GROUND_M),
            ("CalibratedFocalLength", view.camera.fx_px),
        ];
        if self.has_angles {
            tags.extend([("GimbalYawDegree", yaw_deg), ("GimbalPitchDegree", pitch_deg), ("GimbalRollDegree", 0.0)]);
        }
        if self.is_rtk {
            tags.extend([("RtkFlag", 50.0), ("RtkStdLon", 0.012), ("RtkStdLat", 0.016), ("RtkStdHgt", 0.025)]);
        }
        let tags: Vec<String> = tags.iter().map(|(name, value)| format!("drone-dji:{name}=\"{value:+.9}\"")).collect();
        format!(
            "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\
             <rdf:Description xmlns:drone-dji=\"http://www.dji.com/drone-dji/1.0/\" {}/></rdf:RDF></x:xmpmeta>",
            tags.join(" ")
        )
    }
}

/// The scene's footprints, in longitude and latitude.
fn footprints_deg() -> Vec<Vec<(f64, f64)>> {
    let mut layer = VectorLayer::open(&scene().join("footprints.gpkg"), None).unwrap();
    let to_degrees = Transform::new(&Crs::parse(CRS).unwrap(), &Crs::parse("EPSG:4326").unwrap()).unwrap();
    let ring = |geometry: &FeatureGeometry| match geometry {
        FeatureGeometry::Shape(Geometry::Polygon(polygon)) => polygon.exterior().clone(),
        FeatureGeometry::Shape(Geometry::MultiPolygon(parts)) => parts.0[0].exterior().clone(),
        other => panic!("{other:?}"),
    };
    let footprint = |geometry: &FeatureGeometry| {
        let corners = ring(geometry).0;
        corners[..corners.len() - 1].iter().map(|c| to_degrees.point(c.x, c.y).unwrap()).collect()
    };
    layer.features().map(|feature| footprint(&feature.geometry)).collect()
}

/// An OpenStreetMap file as the website exports one: buildings as ways, one as a relation, and a park around them.
fn osm() -> String {
    let footprints = footprints_deg();
    let (mut nodes, mut ways) = (String::new(), String::new());
    let mut n_nodes = 0;
    let mut way = |id: usize, ring: &[(f64, f64)], tags: &str| {
        let first = n_nodes + 1;
        for (lon, lat) in ring {
            n_nodes += 1;
            writeln!(nodes, " <node id=\"{n_nodes}\" version=\"1\" lat=\"{lat:.9}\" lon=\"{lon:.9}\"/>").unwrap();
        }
        let members: Vec<String> = (first..=n_nodes).chain([first]).map(|id| format!("<nd ref=\"{id}\"/>")).collect();
        writeln!(ways, " <way id=\"{id}\" version=\"1\">{}{tags}</way>", members.join("")).unwrap();
    };
    for (i, ring) in footprints.iter().enumerate() {
        // The last is the outer ring of a relation.
        let is_relation = i + 1 == footprints.len();
        way(100 + i, ring, if is_relation { "" } else { "<tag k=\"building\" v=\"yes\"/>" });
    }
    let corners = || footprints.iter().flatten().copied();
    let (west, east) = (corners().map(|c| c.0).fold(180.0, f64::min), corners().map(|c| c.0).fold(-180.0, f64::max));
    let (south, north) = (corners().map(|c| c.1).fold(90.0, f64::min), corners().map(|c| c.1).fold(-90.0, f64::max));
    let park = [(west, south), (east, south), (east, north), (west, north)];
    way(900, &park, "<tag k=\"leisure\" v=\"park\"/>");
    let outer = 100 + footprints.len() - 1;
    let relation = format!(
        " <relation id=\"100\" version=\"1\"><member type=\"way\" ref=\"{outer}\" role=\"outer\"/>\
         <tag k=\"type\" v=\"multipolygon\"/><tag k=\"building\" v=\"apartments\"/></relation>\n"
    );
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<osm version=\"0.6\">\n{nodes}{ways}{relation}</osm>\n")
}

/// The scene's footprints in another CRS, one attribute and a name that tells nothing.
fn write_footprints(path: &Path, crs: &str) {
    let crs = Crs::parse(crs).unwrap();
    let to_map = Transform::new(&Crs::parse("EPSG:4326").unwrap(), &crs).unwrap();
    let polygon = |ring: &Vec<(f64, f64)>| {
        let corners: Vec<(f64, f64)> = ring.iter().map(|(lon, lat)| to_map.point(*lon, *lat).unwrap()).collect();
        geo_types::Polygon::new(corners.into(), Vec::new())
    };
    let polygons: Vec<_> = footprints_deg().iter().map(polygon).collect();
    let feature = |polygon| LayerFeature { polygon, texts: Vec::new(), numbers: vec![3.0] };
    let features: Vec<_> = polygons.iter().map(feature).collect();
    write_polygon_layer(path, "layer", &crs, &[("storeys", FieldType::Number)], &features).unwrap();
}

fn missing(summary: &Value) -> Vec<String> {
    let missing = summary["missing"].as_array().unwrap().iter();
    missing.map(|lack| lack["what"].as_str().unwrap().to_owned()).collect()
}

fn warnings(summary: &Value) -> String {
    summary["warnings"].to_string()
}

#[test]
#[ignore = "slow: make test-slow"]
fn photos_of_a_drone_and_openstreetmap_alone_become_measured_heights() {
    let desk = Desk::new();
    desk.photos("DCIM/100MEDIA", &Drone { zero_m: -35.0, ..Drone::default() });
    fs::write(desk.path("flight/map.osm"), osm()).unwrap();
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("next: sizeup run sizeup.toml"), "{}", outcome.stderr);
    assert_eq!(summary["poses"]["format"], "photos");
    assert_eq!(summary["footprints"]["n_polygons"], N_BUILDINGS, "the park is none: {summary:#}");
    assert_eq!(summary["crs"]["definition"], CRS, "the zone of Hamburg");
    assert_eq!(summary["ground_m"], GROUND_M - 35.0, "in the drone's own heights");
    assert_eq!(summary["ground_from_photos"], true);
    assert!(desk.text().contains("[dtm]"), "{}", desk.text());

    let run = desk.run(&["run", "sizeup.toml", "--set", "output.pictures=false", "--json"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let of_run: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(of_run["n_buildings"], N_BUILDINGS);
    // Four and six of six in two such flights: stereo from photos of 640 × 480 pixels leaves doubts.
    assert!(of_run["by_status"]["measured"].as_u64().unwrap() >= N_BUILDINGS as u64 / 2, "{of_run:#}");
    let truth = scene().join("truth.geojson");
    let evaluated = desk.run(&["evaluate", "result/city.city.json", truth.to_str().unwrap(), "--json"]);
    let evaluated: Value = serde_json::from_str(&evaluated.stdout).unwrap();
    let all = if evaluated["all"].is_null() { &evaluated["heights"]["all"] } else { &evaluated["all"] };
    println!("{all:#}");
    assert_eq!(all["n"], N_BUILDINGS);
    // A pixel is 0.39 m.
    assert!(all["error_mean_m"].as_f64().unwrap() < 0.5, "{evaluated:#}");
}

/// The lines of the first block of shell commands in a section of a document, without their comments.
fn shell_lines(document: &str, section: &str) -> Vec<String> {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(document)).unwrap();
    let (_, from) = text.split_once(&format!("\n## {section}\n")).unwrap_or_else(|| panic!("{document}: {section}"));
    let section = from.split("\n## ").next().unwrap();
    let (_, block) = section.split_once("```sh\n").unwrap();
    let lines =
        block.split("```").next().unwrap().lines().map(|line| line.split(" #").next().unwrap().trim().to_owned());
    lines.filter(|line| !line.is_empty()).collect()
}

#[test]
fn the_commands_on_the_first_screen_of_the_readme_run_as_they_stand() {
    let commands = shell_lines("README.md", "Run it on your own data");
    assert_eq!(commands.len(), 2, "{commands:?}");
    let desk = Desk::new();
    // Few and small photos: their depth takes long, and how good heights are is another test's matter.
    let few = simulated(10, [240, 180]);
    for name in ["images", "sparse", "georef.json", "dtm.tif"] {
        copy(&few.path().join(name), &desk.path("flight").join(name));
    }
    fs::write(desk.path("flight/map.osm"), osm()).unwrap();
    // Copied into a shell, with the program on its path.
    let program = Path::new(env!("CARGO_BIN_EXE_sizeup")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    for command in &commands {
        let mut shell = std::process::Command::new("sh");
        let output = shell.args(["-c", command]).env("PATH", &path).current_dir(desk.path("")).output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr);
        assert!([Some(0), Some(5)].contains(&output.status.code()), "{command}: {told}");
    }
    for result in ["report.html", "city.city.json", "city.gpkg", "pictures/map.png"] {
        assert!(desk.path("result").join(result).is_file(), "{result}");
    }
}

#[test]
fn the_targets_on_the_first_screen_of_the_readme_are_there() {
    let lines = shell_lines("README.md", "Install");
    assert_eq!(lines, ["make demo", "make test"]);
    for line in lines {
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", &format!("{line} --dry-run")]).current_dir(env!("CARGO_MANIFEST_DIR"));
        let told = shell.output().unwrap();
        assert!(told.status.success(), "{line}: {}", String::from_utf8_lossy(&told.stderr));
        assert!(String::from_utf8_lossy(&told.stdout).contains("cargo"), "{line}");
    }
}

#[test]
fn an_openstreetmap_file_gives_its_buildings_with_ids_of_their_own() {
    let desk = Desk::new();
    desk.bring("sparse", "sparse");
    desk.bring("images", "images");
    desk.bring("georef.json", "georef.json");
    desk.bring("dtm.tif", "dtm.tif");
    fs::write(desk.path("flight/map.osm"), osm()).unwrap();
    let (_, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let run = desk.run(&[&["run", "sizeup.toml", "--until", "footprints", "--json"][..], &AS_GIVEN].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
    let config = sizeup::footprint::FootprintConfig::new(desk.path("flight/map.osm"));
    let layer = sizeup::footprint::read(&config, &Crs::parse(CRS).unwrap()).unwrap();
    let mut ids: Vec<String> = layer.footprints.iter().map(|footprint| footprint.id.0.clone()).collect();
    ids.sort();
    let mut expected: Vec<String> = (0..N_BUILDINGS - 1).map(|i| format!("way/{}", 100 + i)).collect();
    expected.insert(0, "relation/100".to_owned());
    assert_eq!(ids, expected, "way 100 and relation 100 are two");
    assert!(layer.refused.is_empty() && layer.issues.is_empty(), "{:?}", layer.issues);
}

#[test]
fn adjusted_poses_come_before_those_of_the_photos_and_both_are_told() {
    let desk = Desk::new();
    desk.bring("sparse", "sparse");
    desk.bring("dtm.tif", "dtm.tif");
    desk.bring("footprints.gpkg", "footprints.gpkg");
    desk.bring("images", "images");
    desk.photos("images", &Drone::default());
    // The photos of the model are those that the drone's names are not of: give both the model's.
    for (i, view) in survey().views.iter().enumerate() {
        fs::rename(
            desk.path(&format!("flight/images/DJI_{:04}.JPG", i + 1)),
            desk.path("flight/images").join(&view.id.0),
        )
        .unwrap();
    }
    // The model alone does not say where it is: the photos do.
    let (summary, outcome) = desk.init(&[]);
    assert_eq!((outcome.code, &summary["poses"]["format"]), (0, &json!("photos")), "{}", outcome.stderr);
    assert!(summary["poses"]["passed"][0]["why"].as_str().unwrap().contains("local"), "{summary:#}");
    assert!(desk.text().contains("flight/sparse (colmap): its positions are local"), "{}", desk.text());
    // With a georeference beside it, it is the better one.
    desk.bring("georef.json", "georef.json");
    let (summary, outcome) = desk.init(&[]);
    assert_eq!((outcome.code, &summary["poses"]["format"]), (0, &json!("colmap")), "{}", outcome.stderr);
    assert!(summary["poses"]["why"].as_str().unwrap().contains("georef.json"));
    assert_eq!(summary["poses"]["passed"][0]["format"], "photos");
    assert!(summary["heights"].as_str().unwrap().contains("take-off confirms"), "{summary:#}");
    let run = desk.run(&[&["run", "sizeup.toml", "--until", "footprints"][..], &AS_GIVEN].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
}

#[test]
fn a_model_in_local_coordinates_takes_its_offset_from_the_command_line() {
    let desk = Desk::new();
    for name in ["sparse", "images", "dtm.tif", "footprints.gpkg"] {
        desk.bring(name, name);
    }
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 3);
    assert_eq!(missing(&summary), ["the place of the poses"], "{}", outcome.stderr);
    assert!(outcome.stderr.contains("--offset X,Y,Z"), "{}", outcome.stderr);
    assert!(desk.text().contains("# offset = ["), "{}", desk.text());
    let (summary, outcome) = desk.init(&["--offset", "565000,5932000,0"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert_eq!(summary["crs"]["why"], "the CRS of footprints.gpkg", "which lies where the poses' numbers are");
    assert!(desk.text().contains("offset = [565000.0, 5932000.0, 0.0]"), "{}", desk.text());
    // With their CRS named, longitudes and latitudes can be held against them too.
    fs::remove_file(desk.path("flight/footprints.gpkg")).unwrap();
    fs::write(desk.path("flight/map.osm"), osm()).unwrap();
    let (summary, outcome) = desk.init(&["--offset", "565000,5932000,0", "--crs", CRS]);
    assert_eq!((outcome.code, &summary["footprints"]["n_polygons"]), (0, &json!(N_BUILDINGS)), "{}", outcome.stderr);
}

/// The scene's views as a run of this configuration has them; positions and rotations have to be the true ones, to a centimetre and
/// 0.01 degrees, but for the level that heights count from.
fn assert_true_poses(desk: &Desk) {
    let config = RunConfig::load(&desk.path("sizeup.toml"), &[]).unwrap();
    let read = sizeup::survey::read(&config.survey, &config.project.crs).unwrap();
    let truth = survey();
    assert_eq!(read.views.len(), truth.views.len());
    for view in &read.views {
        // Metashape's labels have no extension.
        let stem = |view: &View| Path::new(&view.id.0).file_stem().unwrap().to_owned();
        let of_truth = truth.views.iter().find(|other| stem(other) == stem(view)).unwrap();
        let off_m = view.centre().truncate().distance(of_truth.centre().truncate());
        let turn = view.camera_from_map.rotation * of_truth.camera_from_map.rotation.transpose();
        let turn_rad = glam::DQuat::from_mat3(&turn).normalize().to_scaled_axis().length();
        assert!(off_m < 0.01 && turn_rad < 2e-4, "{}: {off_m} m, {turn_rad} rad", view.id);
        assert!((view.camera.fx_px - of_truth.camera.fx_px).abs() < 1e-6, "{}", view.id);
    }
}

#[test]
fn a_folder_of_odm_is_a_project() {
    let desk = Desk::new();
    desk.bring("images", "images");
    desk.bring("dtm.tif", "odm_dem/dtm.tif");
    fs::write(desk.path("flight/map.osm"), osm()).unwrap();
    let truth = survey();
    let camera = &truth.views[0].camera;
    let normalised = camera.fx_px / f64::from(camera.width_px.max(camera.height_px));
    let of_odm = json!({"projection_type": "perspective", "width": camera.width_px, "height": camera.height_px,
        "focal": normalised, "k1": 0.0, "k2": 0.0});
    let to_degrees = Transform::new(&Crs::parse(CRS).unwrap(), &Crs::parse("EPSG:4326").unwrap()).unwrap();
    let shot = |view: &View| {
        let centre = view.centre();
        let place = to_degrees.point(centre.x, centre.y).unwrap();
        let rotation = glam::DQuat::from_mat3(&view.camera_from_map.rotation).to_scaled_axis();
        json!({"type": "Feature", "geometry": {"type": "Point", "coordinates": [place.0, place.1, centre.z]},
            "properties": {"filename": view.id.0, "camera": "v2 c", "rotation": rotation.to_array(),
                "translation": centre.to_array()}})
    };
    let shots: Vec<Value> = truth.views.iter().map(shot).collect();
    for folder in ["odm_report", "odm_georeferencing"] {
        fs::create_dir_all(desk.path("flight").join(folder)).unwrap();
    }
    let shots = json!({"type": "FeatureCollection", "features": shots});
    fs::write(desk.path("flight/odm_report/shots.geojson"), shots.to_string()).unwrap();
    fs::write(desk.path("flight/cameras.json"), json!({ "c": of_odm }).to_string()).unwrap();
    let proj = "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs +type=crs";
    fs::write(desk.path("flight/odm_georeferencing/proj.txt"), proj).unwrap();
    let (summary, outcome) = desk.init(&["--crs", CRS]);
    assert_eq!((outcome.code, &summary["poses"]["format"]), (0, &json!("odm")), "{}", outcome.stderr);
    assert_eq!(summary["footprints"]["n_polygons"], N_BUILDINGS, "{summary:#}");
    assert!(desk.text().contains("odm_dem/dtm.tif"), "{}", desk.text());
    assert_true_poses(&desk);

    // Its grid by the code that other programs know it by.
    let (_, outcome) = desk.init(&[]);
    assert!(outcome.code == 0 && desk.text().contains("crs = \"EPSG:32632\""), "{}{}", outcome.stderr, desk.text());
    // Of no datum that PROJ knows: why footprints cannot follow is said.
    let proj = "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs";
    fs::write(desk.path("flight/odm_georeferencing/proj.txt"), proj).unwrap();
    let (_, outcome) = desk.init(&[]);
    let line = outcome.stderr.lines().find(|line| line.starts_with("missing: footprints that can be used")).unwrap();
    assert!(line.contains("no way between their datums"), "{line}");
}

#[test]
fn a_folder_with_cameras_of_metashape_is_a_project() {
    let desk = Desk::new();
    for name in ["images", "dtm.tif", "footprints.gpkg"] {
        desk.bring(name, name);
    }
    let truth = survey();
    let camera = &truth.views[0].camera;
    let (width, height) = (camera.width_px, camera.height_px);
    let (map, earth) = (Crs::parse(CRS).unwrap(), Crs::parse("EPSG:4326").unwrap());
    let (to_degrees, geocentric) = (Transform::new(&map, &earth).unwrap(), Geocentric::new().unwrap());
    let on_earth = |place: DVec3| {
        let degrees = to_degrees.point(place.x, place.y).unwrap();
        geocentric.geocentric(DVec3::new(degrees.0, degrees.1, place.z)).unwrap()
    };
    let pose = |(i, view): (usize, &View)| {
        let (centre, to_map) = (view.centre(), view.camera_from_map.rotation.transpose());
        // The camera's axes as they point on the earth, over a metre each.
        let axes = [to_map.x_axis, to_map.y_axis, to_map.z_axis];
        let axes = axes.map(|axis| (on_earth(centre + axis) - on_earth(centre)).normalize());
        let place = on_earth(centre);
        let row = |k: usize| format!("{} {} {} {}", axes[0][k], axes[1][k], axes[2][k], place[k]);
        let matrix = [row(0), row(1), row(2)].join(" ");
        let label = Path::new(&view.id.0).file_stem().unwrap().to_str().unwrap();
        format!("<camera id=\"{i}\" sensor_id=\"0\" label=\"{label}\"><transform>{matrix} 0 0 0 1</transform></camera>")
    };
    let cameras: String = truth.views.iter().enumerate().map(pose).collect();
    let xml = format!(
        "<?xml version=\"1.0\"?><document version=\"2.0.0\"><chunk><sensors><sensor id=\"0\" type=\"frame\">\
         <resolution width=\"{width}\" height=\"{height}\"/><calibration type=\"frame\" class=\"adjusted\">\
         <resolution width=\"{width}\" height=\"{height}\"/><f>{}</f></calibration></sensor></sensors>\
         <cameras>{cameras}</cameras><transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>0 0 0</translation>\
         <scale>1</scale></transform><reference>GEOGCS[&quot;WGS 84&quot;]</reference></chunk></document>",
        camera.fx_px
    );
    fs::write(desk.path("flight/cameras.xml"), xml).unwrap();
    let (summary, outcome) = desk.init(&[]);
    assert_eq!((outcome.code, &summary["poses"]["format"]), (0, &json!("metashape")), "{}", outcome.stderr);
    assert_true_poses(&desk);
}

#[test]
fn what_survey_align_and_convert_write_is_taken_with_its_settings() {
    let desk = Desk::new();
    let config = scene().join("sizeup.toml");
    let model = desk.path("flight/model");
    let args = ["survey", "convert", "--config", config.to_str().unwrap(), "--output", model.to_str().unwrap()];
    assert_eq!(desk.run(&args).code, 0);
    desk.bring("images", "images");
    desk.bring("footprints.gpkg", "footprints.gpkg");
    desk.bring("dtm.tif", "dtm.tif");
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(summary["poses"]["why"].as_str().unwrap().contains("survey.toml"), "{summary:#}");
    assert!(desk.text().contains("images = \"flight/images\""), "{}", desk.text());
    assert_eq!(desk.run(&[&["run", "sizeup.toml", "--until", "footprints"][..], &AS_GIVEN].concat()).code, 0);
}

#[test]
fn the_crs_is_the_one_asked_for_then_the_footprints_then_the_zone() {
    let desk = Desk::new();
    desk.photos("", &Drone { n_photos: 6, ..Drone::default() });
    write_footprints(&desk.path("flight/buildings.gpkg"), "EPSG:3035");
    let crs = |more: &[&str]| {
        let (summary, outcome) = desk.init(more);
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        assert!(desk.text().contains(&format!("crs = {}", summary["crs"]["definition"])), "{}", desk.text());
        (summary["crs"]["definition"].as_str().unwrap().to_owned(), summary["crs"]["why"].as_str().unwrap().to_owned())
    };
    assert_eq!(crs(&["--crs", "EPSG:25833"]), ("EPSG:25833".to_owned(), "as asked for by --crs".to_owned()));
    assert_eq!(crs(&[]), ("EPSG:3035".to_owned(), "the CRS of buildings.gpkg".to_owned()));
    write_footprints(&desk.path("flight/buildings.gpkg"), "EPSG:4326");
    let (definition, why) = crs(&[]);
    assert!(definition == CRS && why.contains("UTM zone of the photos"), "{definition}: {why}");
}

#[test]
fn what_is_missing_is_told_written_and_left_to_be_filled_in() {
    let desk = Desk::new();
    for name in ["sparse", "images", "georef.json"] {
        desk.bring(name, name);
    }
    fs::remove_file(desk.path("flight/sparse/points3D.txt")).unwrap();
    let (summary, outcome) = desk.init(&[]);
    assert_eq!((outcome.code, summary["is_complete"].clone()), (3, json!(false)));
    assert_eq!(missing(&summary), ["building footprints", "the ground"], "{}", outcome.stderr);
    for word in ["OpenStreetMap", "--footprints", "docs/footprints.md", "--dtm", "--ground"] {
        assert!(outcome.stderr.contains(word), "{word}: {}", outcome.stderr);
    }
    assert!(outcome.stderr.contains("next: add what is missing, then sizeup run sizeup.toml"), "{}", outcome.stderr);
    let run = desk.run(&["run", "sizeup.toml"]);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("[footprints] is missing"), "{}", run.stderr);
    // The # taken off, and the files put where they are said to be, it is a configuration.
    let mut text = desk.text();
    for line in ["[footprints]", "path = \"buildings.gpkg\"", "[terrain]", "dtm = \"dtm.tif\""] {
        assert!(text.contains(&format!("\n# {line}")), "{line}: {text}");
        text = text.replace(&format!("\n# {line}"), &format!("\n{line}"));
    }
    fs::write(desk.path("sizeup.toml"), text).unwrap();
    RunConfig::load(&desk.path("sizeup.toml"), &[]).unwrap();
    fs::copy(scene().join("footprints.gpkg"), desk.path("buildings.gpkg")).unwrap();
    fs::copy(scene().join("dtm.tif"), desk.path("dtm.tif")).unwrap();
    assert_eq!(desk.run(&[&["run", "sizeup.toml", "--until", "footprints"][..], &AS_GIVEN].concat()).code, 0);
    // Layers beside the photos' folder, where the project's file is, are found as well.
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert_eq!(summary["footprints"]["path"], "./buildings.gpkg");
    // Given on the command line, nothing is missing either.
    let truth = scene().join("truth.geojson");
    let (summary, outcome) = desk.init(&["--footprints", truth.to_str().unwrap(), "--ground", "23"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(summary["ground_m"] == 23.0 && summary["terrain"].is_null(), "{summary:#}");
    assert!(desk.text().contains("# [dtm]"), "left to the user: {}", desk.text());
}

#[test]
fn photos_that_look_straight_down_begin_a_project_with_a_note() {
    let desk = Desk::new();
    let survey = survey();
    let nadir = survey.views.iter().filter(|view| view.off_nadir_deg() <= 15.0);
    let all = desk.path("all");
    Drone::default().write(&all);
    for view in nadir {
        let i = survey.views.iter().position(|v| v.id == view.id).unwrap() + 1;
        let name = format!("DJI_{i:04}.JPG");
        fs::copy(all.join(&name), desk.path("flight").join(&name)).unwrap();
    }
    write_footprints(&desk.path("flight/buildings.gpkg"), CRS);
    let (summary, outcome) = desk.init(&[]);
    assert!(missing(&summary).iter().all(|what| what != "oblique photos"), "{summary:#}");
    let told = format!("{}{}", outcome.stdout, outcome.stderr);
    assert!(told.contains("look straight down") && told.contains("by stereo"), "{told}");
}

#[test]
fn an_existing_file_is_not_overwritten() {
    let desk = Desk::new();
    desk.photos("", &Drone { n_photos: 4, ..Drone::default() });
    fs::write(desk.path("sizeup.toml"), "mine").unwrap();
    let refused = desk.run(&["init", "flight"]);
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("sizeup.toml exists") && refused.stderr.contains("--force"), "{}", refused.stderr);
    assert_eq!(desk.text(), "mine");
    let elsewhere = desk.run(&["init", "flight", "--output", "town/project.toml"]);
    assert_eq!(elsewhere.code, 3, "no footprints: {}", elsewhere.stderr);
    let text = fs::read_to_string(desk.path("town/project.toml")).unwrap();
    assert!(text.contains("path = \"../flight\""), "named from its own folder: {text}");
    assert_eq!(desk.run(&["init", "flight", "--force"]).code, 3);
    assert_ne!(desk.text(), "mine");
}

#[test]
fn heights_of_a_receiver_and_of_a_terrain_model_are_brought_together_and_told() {
    let desk = Desk::new();
    desk.photos("photos", &Drone { is_rtk: true, zero_m: GEOID_M, ..Drone::default() });
    desk.bring("footprints.gpkg", "footprints.gpkg");
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(desk.text().contains("keep_ellipsoidal = true"), "{}", desk.text());
    assert_eq!(summary["flight"]["positioning"], json!({ "fixed": N_PHOTOS }));
    let sigma = &summary["flight"]["position_sigma_m"];
    assert!((sigma[0].as_f64().unwrap() - 0.02).abs() < 1e-6 && sigma[1] == 0.025, "{sigma}");
    // A surface model is no ground.
    desk.bring("dtm.tif", "dsm.tif");
    let (summary, _) = desk.init(&[]);
    assert!(summary["terrain"].is_null() && summary["other_rasters"][0]["why"].as_str().unwrap().contains("surface"));
    // A terrain model that does not say what its heights count from.
    desk.bring("dtm.tif", "dtm.tif");
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let config = RunConfig::load(&desk.path("sizeup.toml"), &[]).unwrap();
    let geoid_m = config.survey.height.geoid_offset.unwrap();
    assert!((geoid_m - GEOID_M).abs() < 2.0, "{geoid_m}");
    assert!(config.dtm.is_some(), "the photos put the rest right");
    assert!(desk.text().contains("ESTIMATED") && warnings(&summary).contains("estimated"), "{}", desk.text());
}

#[test]
fn barometric_heights_over_a_terrain_model_count_from_the_take_off() {
    let desk = Desk::new();
    desk.photos("", &Drone { zero_m: 180.0, ..Drone::default() });
    desk.bring("footprints.gpkg", "footprints.gpkg");
    // Photos and terrain in one folder: the terrain is no photo that lacks a pose.
    desk.bring("dtm.tif", "dtm.tif");
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert_eq!(summary["flight"]["n_photos"], N_PHOTOS);
    let config = RunConfig::load(&desk.path("sizeup.toml"), &[]).unwrap();
    let base_m = config.survey.height.base.unwrap();
    // The relief of the simulated ground is 3 m.
    assert!((base_m - GROUND_M).abs() < 2.0, "{base_m}");
    assert!(warnings(&summary).contains("no known zero"), "{summary:#}");
    let run = desk.run(&[&["run", "sizeup.toml", "--until", "survey", "--json"][..], &AS_GIVEN].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
}

#[test]
fn a_terrain_model_that_the_take_off_does_not_confirm_is_left_to_the_photos() {
    /// How far the poses stand above the terrain model's level, metres: less than what tells two levels apart for certain.
    const APART_M: f64 = 12.0;
    let desk = Desk::new();
    for name in ["sparse", "dtm.tif", "footprints.gpkg", "images", "priors"] {
        desk.bring(name, name);
    }
    desk.photos("images", &Drone::default());
    for (i, view) in survey().views.iter().enumerate() {
        let images = desk.path("flight/images");
        fs::rename(images.join(format!("DJI_{:04}.JPG", i + 1)), images.join(&view.id.0)).unwrap();
    }
    let (summary, outcome) = desk.init(&["--offset", &format!("565000,5932000,{APART_M}")]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(!summary["heights"].as_str().unwrap().contains("confirms"), "{summary:#}");
    assert!(warnings(&summary).contains("above the terrain model under the cameras"), "{summary:#}");
    let config = RunConfig::load(&desk.path("sizeup.toml"), &[]).unwrap();
    assert!(config.dtm.is_some_and(|dtm| dtm.within_m >= APART_M), "{}", desk.text());

    // The scene's own depth in place of stereo, which takes longer.
    let given = ["source=files", "path=flight/priors/{stem}.npy", "kind=inverse_depth", "geometry=z_depth"];
    let given: Vec<String> = given.iter().map(|setting| format!("prior.{setting}")).collect();
    let given = given.iter().flat_map(|setting| ["--set", setting.as_str()]);
    let run: Vec<&str> = ["run", "sizeup.toml", "--set", "output.pictures=false"].into_iter().chain(given).collect();
    let run = desk.run(&run);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let truth = scene().join("truth.geojson");
    let evaluated = desk.run(&["evaluate", "result/city.city.json", truth.to_str().unwrap(), "--json"]);
    let evaluated: Value = serde_json::from_str(&evaluated.stdout).unwrap();
    let all = if evaluated["all"].is_null() { &evaluated["heights"]["all"] } else { &evaluated["all"] };
    println!("{all:#}");
    assert!(all["n"] == N_BUILDINGS && all["error_mean_m"].as_f64().unwrap() < 0.5, "{evaluated:#}");
    // A height of the ground by hand is held against the take-off as well.
    let (summary, _) = desk.init(&["--offset", "565000,5932000,0", "--ground", "13"]);
    assert!(warnings(&summary).contains("from the take-off") && summary["ground_from_photos"] == true, "{summary:#}");
}

#[test]
fn a_project_within_the_folder_of_its_photos_runs_again() {
    let desk = Desk::new();
    desk.photos("", &Drone::default());
    desk.bring("footprints.gpkg", "footprints.gpkg");
    let within =
        |args: &[&str]| -> Outcome { sizeup().current_dir(desk.path("flight")).args(args).output().unwrap().into() };
    assert_eq!(within(&["init", "."]).code, 0);
    for _ in 0..2 {
        // The pictures of the first run are no photos of the second.
        let run = within(&[&["run", "sizeup.toml", "--until", "survey", "--json"][..], &AS_GIVEN].concat());
        assert_eq!(run.code, 0, "{}", run.stderr);
        let survey: Value = serde_json::from_slice(&fs::read(desk.path("flight/result/survey.json")).unwrap()).unwrap();
        assert_eq!((&survey["n_views"], &survey["issue_counts"]["photo_unreadable"]), (&json!(N_PHOTOS), &Value::Null));
    }
    assert_eq!(within(&["init", ".", "--force"]).code, 0);
}

#[test]
fn photos_in_several_folders_of_a_card_are_one_flight() {
    let desk = Desk::new();
    desk.photos("DCIM/100MEDIA", &Drone { n_photos: 12, ..Drone::default() });
    desk.photos("DCIM/101MEDIA", &Drone { n_photos: 12, zero_m: 0.001, ..Drone::default() });
    write_footprints(&desk.path("flight/buildings.gpkg"), CRS);
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert_eq!((&summary["flight"]["n_photos"], &summary["flight"]["n_views"]), (&json!(24), &json!(24)));
    assert!(desk.text().contains("path = \"flight/DCIM\""), "{}", desk.text());
}

#[test]
fn photos_of_a_rig_in_a_folder_for_each_lens_are_found_whatever_system_named_them() {
    let desk = Desk::new();
    for name in ["sparse", "dtm.tif", "footprints.gpkg", "georef.json"] {
        desk.bring(name, name);
    }
    desk.photos("images", &Drone::default());
    let images = desk.path("flight/sparse/images.txt");
    let mut text = fs::read_to_string(&images).unwrap();
    for (i, view) in survey().views.iter().enumerate() {
        let (lens, number) = (["back", "fwd", "left", "nadir", "right"][i % 5], i / 5);
        fs::create_dir_all(desk.path("flight/images").join(lens)).unwrap();
        fs::rename(
            desk.path(&format!("flight/images/DJI_{:04}.JPG", i + 1)),
            desk.path(&format!("flight/images/{lens}/DSC{number:05}.JPG")),
        )
        .unwrap();
        text = text.replace(&format!(" {}\n", view.id), &format!(" {lens}\\DSC{number:05}.jpg\n"));
    }
    fs::write(&images, text).unwrap();
    let (summary, outcome) = desk.init(&[]);
    assert_eq!((outcome.code, &summary["poses"]["format"]), (0, &json!("colmap")), "{}", outcome.stderr);
    assert!(desk.text().contains("images = \"flight/images\""), "{}", desk.text());
    let config = RunConfig::load(&desk.path("sizeup.toml"), &[]).unwrap();
    let survey = sizeup::survey::read(&config.survey, &config.project.crs).unwrap();
    assert_eq!(survey.views.len(), N_PHOTOS);
    for view in &survey.views {
        let photo = view.image.as_ref().expect("each has its photo").with_extension("jpg");
        assert!(photo.ends_with(&view.id.0), "{} has {}", view.id, photo.display());
    }
}

#[test]
fn parcels_are_no_buildings_and_results_no_input() {
    let desk = Desk::new();
    desk.photos("photos", &Drone { n_photos: 6, ..Drone::default() });
    // A parcel around everything.
    let crs = Crs::parse(CRS).unwrap();
    let (x, y) = (565_500.0, 5_932_500.0);
    let corners = [(-300.0, -300.0), (300.0, -300.0), (300.0, 300.0), (-300.0, 300.0)].map(|(dx, dy)| (x + dx, y + dy));
    let parcel = geo_types::Polygon::new(corners.to_vec().into(), Vec::new());
    let feature = LayerFeature { polygon: &parcel, texts: vec!["12/3".to_owned()], numbers: Vec::new() };
    let fields = [("number", FieldType::Text)];
    write_polygon_layer(&desk.path("flight/flurstuecke.gpkg"), "parcels", &crs, &fields, &[feature]).unwrap();
    // What a run of an earlier day has left.
    fs::create_dir_all(desk.path("flight/result/stages")).unwrap();
    fs::write(desk.path("flight/result/survey.json"), "{}").unwrap();
    write_footprints(&desk.path("flight/result/buildings.gpkg"), CRS);
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(missing(&summary), ["building footprints"], "{}", outcome.stderr);
    assert_eq!(summary["other_layers"].as_array().unwrap().len(), 1, "{summary:#}");
    write_footprints(&desk.path("flight/footprints.gpkg"), CRS);
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(summary["footprints"]["path"].as_str().unwrap().ends_with("footprints.gpkg"), "{summary:#}");
    assert!(desk.text().contains("flurstuecke.gpkg"), "the other is named: {}", desk.text());
}

/// Asserts how a command ends and what it says before and in its hint; nothing is written.
fn assert_refused(desk: &Desk, more: &[&str], code: i32, message: &[&str], hint: &[&str]) {
    let outcome = desk.run(&[&["init"], more].concat());
    assert_eq!(outcome.code, code, "{more:?}: {}", outcome.stderr);
    let (said, advice) = outcome.stderr.split_once("hint: ").unwrap_or_else(|| panic!("no hint: {}", outcome.stderr));
    for word in message {
        assert!(said.contains(word), "{word:?} is missing before the hint: {}", outcome.stderr);
    }
    for word in hint {
        assert!(advice.contains(word), "{word:?} is missing in the hint: {}", outcome.stderr);
    }
    assert!(!desk.path("sizeup.toml").exists());
}

#[test]
fn folders_that_hold_no_flight_are_told_what_they_hold() {
    let desk = Desk::new();
    assert_refused(&desk, &["nowhere"], 3, &["nowhere", "expected a folder"], &["path"]);
    fs::write(desk.path("a.jpg"), "x").unwrap();
    assert_refused(&desk, &["a.jpg"], 3, &["a.jpg", "found a file"], &["folder"]);
    assert_refused(&desk, &["flight"], 3, &["flight", "an empty folder"], &["right folder"]);
    fs::write(desk.path("flight/DJI_0001.MP4"), "video").unwrap();
    assert_refused(&desk, &["flight"], 3, &["1 video and no photos"], &["photos"]);
    let thumbnail = image::RgbImage::new(160, 120);
    thumbnail.save(desk.path("flight/DJI_0001.jpg")).unwrap();
    assert_refused(&desk, &["flight"], 3, &["only thumbnails"], &["card"]);
    desk.bring("images", "images");
    assert_refused(&desk, &["flight"], 3, &["without position and direction"], &["OpenDroneMap", "XMP"]);
    fs::remove_dir_all(desk.path("flight")).unwrap();
    desk.photos("", &Drone { has_angles: false, n_photos: 3, ..Drone::default() });
    assert_refused(&desk, &["flight"], 3, &["3 of them with a position, none with a direction"], &["photogrammetry"]);
    fs::write(desk.path("flight/DJI_0009.JPG"), "not a photo").unwrap();
    assert_refused(&desk, &["flight"], 3, &["1 cannot be read"], &[]);
    fs::write(desk.path("flight/reconstruction.json"), "[{\"cameras\": ").unwrap();
    assert_refused(&desk, &["flight"], 3, &["reconstruction.json", "opensfm", "cannot be read"], &["inspect"]);
}

#[test]
fn what_is_asked_for_and_cannot_be_used_is_told() {
    let desk = Desk::new();
    desk.photos("", &Drone { n_photos: 4, ..Drone::default() });
    assert_refused(&desk, &["flight", "--crs", "EPSG:4326"], 2, &["--crs", "EPSG:4326", "projected"], &["EPSG:25832"]);
    assert_refused(&desk, &["flight", "--crs", "EPSG:99"], 2, &["--crs", "EPSG:99"], &["EPSG:25832"]);
    assert_refused(&desk, &["flight", "--footprints", "no.gpkg"], 3, &["--footprints no.gpkg"], &["ogrinfo"]);
    fs::write(desk.path("broken.gpkg"), "no database").unwrap();
    assert_refused(&desk, &["flight", "--footprints", "broken.gpkg"], 3, &["broken.gpkg", "cannot open"], &["ogrinfo"]);
    fs::write(desk.path("broken.tif"), "no raster").unwrap();
    assert_refused(&desk, &["flight", "--dtm", "broken.tif"], 3, &["--dtm broken.tif"], &["gdalinfo"]);
    assert_refused(&desk, &["flight", "--dtm", "no.tif"], 3, &["no.tif", "does not exist"], &["gdalinfo"]);
    // A broken layer that nobody named is named, and the rest goes on.
    fs::write(desk.path("flight/broken.gpkg"), "no database").unwrap();
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 3);
    assert!(summary["other_layers"][0]["name"] == "broken.gpkg", "{summary:#}");
    // A CRS that positions reach only to 2 m: the file says so.
    let (summary, _) = desk.init(&["--crs", "EPSG:27700"]);
    assert!(missing(&summary)[0].contains("EPSG:27700"), "{summary:#}");
}

#[test]
fn real_photos_that_look_straight_down_get_their_ground_and_no_run() {
    let Some(folder) = shared_data("dji_xmp_photos") else { return };
    let desk = Desk::new();
    copy(&folder, &desk.path("flight"));
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(missing(&summary), ["overlapping photos", "building footprints"], "{}", outcome.stderr);
    assert_eq!((&summary["flight"]["n_views"], &summary["flight"]["n_nadir"]), (&json!(4), &json!(4)));
    assert_eq!(summary["crs"]["definition"], "EPSG:32615");
    // The photos' AbsoluteAltitude is 198 m, their RelativeAltitude 40 m.
    assert!((summary["ground_m"].as_f64().unwrap() - 158.0).abs() < 1.0, "{summary:#}");
    let height_m = summary["flight"]["above_ground_m"]["median"].as_f64().unwrap();
    assert!((height_m - 40.0).abs() < 1.0, "{height_m}");
    assert!(desk.text().contains("reference = \"project\""), "{}", desk.text());
}

#[test]
fn a_real_photo_with_a_base_station_states_its_accuracy() {
    let Some(folder) = shared_data("dji_rtk_photo") else { return };
    let desk = Desk::new();
    copy(&folder, &desk.path("flight"));
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(missing(&summary), ["photos", "building footprints"], "{}", outcome.stderr);
    assert_eq!(summary["flight"]["positioning"], json!({ "fixed": 1 }));
    assert!(summary["flight"]["position_sigma_m"][1].as_f64().unwrap() < 0.05);
    assert!(desk.text().contains("keep_ellipsoidal = true"), "{}", desk.text());
    // China's grid, to which PROJ knows no accurate way from WGS 84: written all the same, with what to declare.
    let (summary, _) = desk.init(&["--crs", "EPSG:4547"]);
    assert!(missing(&summary).iter().any(|what| what.contains("EPSG:4547")), "{summary:#}");
    assert!(outcome.code == 3 && desk.text().contains("# crs = \"EPSG:4490\""), "{}", desk.text());
}

/// The one height of the ground in what was written, metres.
fn constant_m(desk: &Desk) -> f64 {
    let text = desk.text();
    let line = text.lines().find(|line| line.starts_with("constant_m = ")).unwrap_or_else(|| panic!("{text}"));
    line.trim_start_matches("constant_m = ").split_whitespace().next().unwrap().parse().unwrap()
}

/// Whether what was written finds the terrain in the photos.
fn finds_terrain(desk: &Desk) -> bool {
    desk.text().lines().any(|line| line.starts_with("[dtm]"))
}

#[test]
fn the_ground_of_a_block_without_a_terrain_model_is_that_of_its_sparse_points() {
    let desk = Desk::new();
    for name in ["sparse", "images", "georef.json"] {
        desk.bring(name, name);
    }
    write_footprints(&desk.path("flight/buildings.gpkg"), CRS);
    let georef: Value = serde_json::from_slice(&fs::read(scene().join("georef.json")).unwrap()).unwrap();
    let middle = survey().views.iter().map(View::centre).sum::<DVec3>() / survey().views.len() as f64;
    let from_offset = middle - DVec3::from_array(serde_json::from_value(georef["offset"].clone()).unwrap());
    // Seven of ten points on the ground, the rest on roofs of 15 m; each in three photos.
    let write_points = |slope: f64| {
        let mut points = String::new();
        for i in 0..4000_u32 {
            let [x, y] = [i * 7919 % 400, i * 104_729 % 400].map(|c| f64::from(c) - 200.0);
            let z_m = GROUND_M + slope * x + if i % 10 < 7 { 0.0 } else { 15.0 };
            writeln!(points, "{i} {} {} {z_m} 0 0 0 0.5 1 0 2 0 3 0", from_offset.x + x, from_offset.y + y).unwrap();
        }
        fs::write(desk.path("flight/sparse/points3D.txt"), points).unwrap();
    };
    for (slope, is_from_photos) in [(0.0, false), (0.05, true)] {
        write_points(slope);
        let (_, outcome) = desk.init(&[]);
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        assert!((constant_m(&desk) - GROUND_M).abs() < 0.2 + 200.0 * slope, "{}", desk.text());
        assert_eq!(finds_terrain(&desk), is_from_photos, "{}", desk.text());
        assert!(outcome.stderr.contains("sparse points"), "{}", outcome.stderr);
    }
    // What cannot be read is told, and not taken for ground.
    fs::write(desk.path("flight/sparse/points3D.txt"), "1 2 three 4 0 0 0 0.5\n").unwrap();
    let (summary, outcome) = desk.init(&[]);
    assert_eq!((outcome.code, missing(&summary)), (3, vec!["the ground".to_owned()]), "{}", outcome.stderr);
    assert!(warnings(&summary).contains("points3D.txt"), "{summary:#}");
}

#[test]
fn a_real_block_runs_once_its_ground_is_given() {
    let Some(folder) = shared_data("warsaw_ochota_photos") else { return };
    let desk = Desk::new();
    for name in ["images", "sparse", "georef.json", "truth_buildings.geojson"] {
        copy(&folder.join(name), &desk.path("flight").join(name));
    }
    // Its true ground is 110.2 to 111.7 m.
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(!finds_terrain(&desk), "it is level: {}", desk.text());
    let level_m = constant_m(&desk);
    assert!((110.0..112.5).contains(&level_m), "{level_m} m");
    fs::remove_file(desk.path("flight/sparse/points3D.txt")).unwrap();
    let (summary_without, outcome) = desk.init(&[]);
    assert_eq!((outcome.code, missing(&summary_without)), (3, vec!["the ground".to_owned()]), "{}", outcome.stderr);
    assert_eq!((&summary["flight"]["n_nadir"], &summary["flight"]["n_oblique"]), (&json!(5), &json!(7)));
    assert_eq!(summary["crs"]["definition"], "EPSG:2180");
    let (summary, outcome) = desk.init(&["--ground", "111.6"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(summary["footprints"]["path"].as_str().unwrap().ends_with("truth_buildings.geojson"));
    let run = desk.run(&[&["run", "sizeup.toml", "--until", "footprints", "--json"][..], &AS_GIVEN].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
    let of_run: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&of_run["n_buildings"], &of_run["n_views"]), (&json!(9), &json!(12)));
}

/// A folder as it lies in the USA: Pix4D's poses, buildings and terrain in New York Long Island, US survey feet.
fn long_island(desk: &Desk, unit_of_heights: &str) {
    let params = desk.path("flight/town/1_initial/params");
    fs::create_dir_all(&params).unwrap();
    // As ArcGIS and Pix4D write it: without a code, under another name.
    let feet = "PROJCS[\"NAD_1983_StatePlane_New_York_Long_Island_FIPS_3104_Feet\",GEOGCS[\"GCS_North_American_1983\",\
        DATUM[\"D_North_American_1983\",SPHEROID[\"GRS_1980\",6378137.0,298.257222101]],PRIMEM[\"Greenwich\",0.0],\
        UNIT[\"Degree\",0.0174532925199433]],PROJECTION[\"Lambert_Conformal_Conic\"],PARAMETER[\"False_Easting\",984250.0],\
        PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Central_Meridian\",-74.0],\
        PARAMETER[\"Standard_Parallel_1\",40.66666666666666],PARAMETER[\"Standard_Parallel_2\",41.03333333333333],\
        PARAMETER[\"Latitude_Of_Origin\",40.16666666666666],UNIT[\"Foot_US\",0.3048006096012192]]";
    fs::write(params.join("town_wkt.prj"), feet).unwrap();
    fs::write(params.join("town_offset.xyz"), "984000.0 213000.0 100.0").unwrap();
    let mut cameras = "names\nK\nradial\ntangential\nt\nR\nm = K [R|-Rt] X\n\n".to_owned();
    for i in 0..12 {
        let (x, y) = (150.0 * f64::from(i % 4), 150.0 * f64::from(i / 4));
        writeln!(
            cameras,
            "IMG_{i:04}.jpg 320 240\n300 0 160\n0 300 120\n0 0 1\n0 0 0\n0 0\n{x} {y} 220\n1 0 0\n0 -0.76604444 -0.64278761\n0 0.64278761 -0.76604444"
        )
        .unwrap();
    }
    fs::write(params.join("town_calibrated_camera_parameters.txt"), cameras).unwrap();
    let crs = Crs::parse("EPSG:2263").unwrap();
    let house = |i: i32| {
        let (x, y) = (984_100.0 + 120.0 * f64::from(i % 3), 213_100.0 + 120.0 * f64::from(i / 3));
        geo_types::Rect::new((x, y), (x + 60.0, y + 40.0)).to_polygon()
    };
    let outlines: Vec<_> = (0..6).map(house).collect();
    let houses: Vec<_> = outlines
        .iter()
        .zip(1..)
        .map(|(polygon, id)| LayerFeature { polygon, texts: Vec::new(), numbers: vec![f64::from(id)] })
        .collect();
    let fields = [("bldg_id", FieldType::Number)];
    write_polygon_layer(&desk.path("flight/buildings.gpkg"), "buildings", &crs, &fields, &houses).unwrap();
    let driver = gdal::DriverManager::get_driver_by_name("GTiff").unwrap();
    let path = desk.path("flight/dem.tif");
    let mut dataset = driver.create_with_band_type::<f32, _>(&path, 100, 100, 1).unwrap();
    dataset.set_geo_transform(&[983_500.0, 20.0, 0.0, 214_500.0, 0.0, -20.0]).unwrap();
    dataset.set_spatial_ref(&gdal::spatial_ref::SpatialRef::from_epsg(2263).unwrap()).unwrap();
    let cells = vec![32.8_f32; 10_000];
    let mut band = dataset.rasterband(1).unwrap();
    band.write((0, 0), (100, 100), &mut gdal::raster::Buffer::new((100, 100), cells)).unwrap();
    drop(dataset);
    let unit =
        if unit_of_heights.is_empty() { String::new() } else { format!("<UnitType>{unit_of_heights}</UnitType>") };
    let text = format!("<PAMDataset><PAMRasterBand band=\"1\">{unit}</PAMRasterBand></PAMDataset>");
    fs::write(path.with_extension("tif.aux.xml"), text).unwrap();
}

#[test]
fn a_project_in_feet_gets_the_grid_in_metres_of_its_datum_and_is_asked_for_what_is_not_said() {
    let desk = Desk::new();
    long_island(&desk, "");
    let (summary, outcome) = desk.init(&[]);
    assert_eq!(summary["crs"]["definition"], "EPSG:32118", "{}", outcome.stderr);
    let why = summary["crs"]["why"].as_str().unwrap();
    assert!(why.contains("EPSG:2263") && why.contains("feet"), "{why}");
    assert!(!warnings(&summary).contains("EPSG:32618"), "{summary:#}");
    // 60 × 40 feet.
    let area_m2 = summary["footprints"]["median_area_m2"].as_f64().unwrap();
    assert!((area_m2 - 2400.0 * 0.3048 * 0.3048).abs() < 0.1, "{area_m2}");
    assert!(missing(&summary).contains(&"the unit of the terrain model".to_owned()), "{summary:#}");
    let text = desk.text();
    assert!(text.contains("# crs = \"EPSG:2263+6360\"") && text.contains("\"EPSG:2263+5703\" (in metres)"), "{text}");
    let dtm = "dtm = \"flight/dem.tif\"";
    assert!(text.contains(dtm), "{text}");

    long_island(&desk, "US survey foot");
    let (summary, outcome) = desk.init(&[]);
    assert!(!missing(&summary).contains(&"the unit of the terrain model".to_owned()), "{}", outcome.stderr);
    let ground = summary["ground"].as_str().unwrap();
    assert!(ground.contains("10.0 m under the cameras") && ground.contains("converted to metres"), "{ground}");
}

#[test]
fn a_crs_in_feet_that_is_asked_for_names_its_twin_in_metres() {
    let desk = Desk::new();
    long_island(&desk, "");
    assert_refused(&desk, &["flight", "--crs", "EPSG:2263"], 2, &["--crs", "EPSG:2263", "feet"], &["EPSG:32118"]);
}

/// Poses of four photos 100 m above the ground, with a direction each: where, and by how much they look up from straight down to the
/// east.
fn poses_looking_east(desk: &Desk, places: [(f64, f64); 4], tilts_deg: [f64; 4]) {
    desk.bring("images", "images");
    let names = survey().views.into_iter().map(|view| view.id.0);
    let mut text = "name,x,y,z,omega,phi,kappa,width,height,fx,cx,cy\n".to_owned();
    for ((name, (x, y)), tilt_deg) in names.zip(places).zip(tilts_deg) {
        let z = GROUND_M + 100.0;
        writeln!(text, "{name},{x},{y},{z},0,{},0,960,720,900,480,360", -tilt_deg).unwrap();
    }
    fs::write(desk.path("flight/poses.csv"), text).unwrap();
}

/// A layer with one square building, its south-western corner at a place.
fn square(desk: &Desk, (x, y): (f64, f64), crs: &str) {
    let ring = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)].map(|(dx, dy)| [x + dx, y + dy]);
    let layer = json!({
        "type": "FeatureCollection",
        "crs": { "type": "name", "properties": { "name": crs } },
        "features": [{ "type": "Feature", "properties": { "building": "yes" },
                       "geometry": { "type": "Polygon", "coordinates": [ring] } }],
    });
    fs::write(desk.path("flight/buildings.geojson"), layer.to_string()).unwrap();
}

const SPREAD: [(f64, f64); 4] =
    [(565_000.0, 5_933_000.0), (565_000.0, 5_933_030.0), (565_010.0, 5_933_060.0), (565_010.0, 5_933_090.0)];

#[test]
fn buildings_that_a_flight_shows_from_afar_are_its_footprints() {
    let desk = Desk::new();
    poses_looking_east(&desk, SPREAD, [66.0, 68.0, 66.0, 68.0]);
    square(&desk, (565_260.0, 5_933_040.0), "EPSG:25832");
    let (summary, outcome) = desk.init(&["--crs", CRS, "--ground", "23"]);
    assert_eq!(outcome.code, 0, "{}\n{}", outcome.stderr, desk.text());
    assert_eq!(summary["footprints"]["n_polygons"], 1, "{summary:#}");
    assert_eq!(missing(&summary), Vec::<String>::new());
}

#[test]
fn footprints_in_a_wrong_zone_are_told_with_their_distance() {
    let desk = Desk::new();
    poses_looking_east(&desk, SPREAD, [66.0, 68.0, 66.0, 68.0]);
    square(&desk, (565_260.0, 5_933_040.0), "EPSG:25833");
    let (summary, outcome) = desk.init(&["--crs", CRS, "--ground", "23"]);
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    let why = summary["other_layers"][0]["why"].as_str().unwrap();
    assert!(why.contains(" km away") && why.contains("CRS (its zone, too)"), "{why}");
}

#[test]
fn photos_from_one_spot_are_told_to_be_taken_from_different_places() {
    let desk = Desk::new();
    let here = (565_000.0, 5_933_000.0);
    poses_looking_east(&desk, [here, (here.0 + 0.7, here.1), here, (here.0, here.1 - 0.6)], [30.0, 40.0, 45.0, 35.0]);
    square(&desk, (565_070.0, 5_932_990.0), "EPSG:25832");
    let (summary, outcome) = desk.init(&["--crs", CRS, "--ground", "23"]);
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    assert_eq!(missing(&summary), ["photos from different places"], "{}", outcome.stderr);
    for more in [&[][..], &["--set", "dtm.within_m=15"]] {
        let run = desk.run(&[&["run", "--set", "align.when=never"], more].concat());
        assert_eq!(run.code, 3, "{}", run.stderr);
        for words in ["there is no baseline", "taken from one place", "hint: take the photos from different places"] {
            assert!(run.stderr.contains(words), "{words:?}: {}", run.stderr);
        }
        assert!(!run.stderr.contains("rough level") && !desk.path("result/city.gpkg").exists(), "{}", run.stderr);
    }
}
