//! Files in their producers' form that were read wrong without a word: each is read right now, or refused with a reason.

use std::fs;
use std::path::Path;

use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::crs::{Crs, Geocentric, Transform, enu_from_geocentric};
use sizeup::survey::{
    self, CameraConfig, CsvConfig, Format, HeightConfig, Reading, Site, Survey, SurveyConfig, SurveyError,
    SurveyReport, VerticalDatum,
};

use crate::skipped::skip;

fn crs(definition: &str) -> Crs {
    Crs::parse(definition).unwrap()
}

fn keep_ellipsoidal() -> HeightConfig {
    HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() }
}

fn camera() -> CameraConfig {
    CameraConfig { width: 4000, height: 3000, fx: 3000.0, fy: None, cx: None, cy: None, k: [0.0; 3], p: [0.0; 2] }
}

fn report(config: &SurveyConfig, project: &str) -> SurveyReport {
    Reading::of(config, &crs(project)).unwrap().report(Site::default())
}

/// ODM's reference, a whole metre of UTM zone 17 N with a convergence of 1.08°, and 36 shots about it.
struct Odm {
    offset: DVec3,
    reference: DVec3,
    /// Camera positions east, north, up of the reference, metres.
    enu: Vec<DVec3>,
    /// The same places in UTM minus the offset.
    grid: Vec<DVec3>,
}

const UTM_17: &str = "EPSG:32617";

impl Odm {
    fn new() -> Self {
        let offset = DVec3::new(640_000.0, 4_500_000.0, 0.0);
        let (lon, lat) = Transform::new(&crs(UTM_17), &crs("EPSG:4326")).unwrap().point(offset.x, offset.y).unwrap();
        let reference = DVec3::new(lon, lat, 0.0);
        let geocentric = Geocentric::new().unwrap();
        let (origin, axes) = (geocentric.geocentric(reference).unwrap(), enu_from_geocentric(lon, lat).transpose());
        let to_grid = Transform::new(&crs("EPSG:4326"), &crs(UTM_17)).unwrap();
        let enu: Vec<DVec3> = (0..36)
            .map(|i| DVec3::new(f64::from(i % 6) * 60.0 - 150.0, f64::from(i / 6) * 60.0 - 150.0, 320.0))
            .collect();
        let in_grid = |place: &DVec3| {
            let geodetic = geocentric.geodetic(origin + axes * *place).unwrap();
            let (x, y) = to_grid.point(geodetic.x, geodetic.y).unwrap();
            DVec3::new(x, y, geodetic.z) - offset
        };
        let grid = enu.iter().map(in_grid).collect();
        Self { offset, reference, enu, grid }
    }

    /// Nadir shots at these centres; GPS positions are east, north, up with an RTK receiver's centimetres.
    fn write(&self, path: &Path, centres: &[DVec3], has_gps: bool) {
        let nadir = DMat3::from_rotation_x(std::f64::consts::PI);
        let shots: serde_json::Map<String, serde_json::Value> = centres
            .iter()
            .zip(&self.enu)
            .enumerate()
            .map(|(i, (centre, gps))| {
                let noise = 0.02 * DVec3::new((i as f64 * 1.7).sin(), (i as f64 * 2.9).cos(), 0.0);
                let mut shot = serde_json::json!({"rotation": [std::f64::consts::PI, 0.0, 0.0],
                    "translation": (-(nadir * *centre)).to_array(), "camera": "v2 c"});
                if has_gps {
                    shot["gps_position"] = serde_json::json!((*gps + noise).to_array());
                    shot["gps_dop"] = serde_json::json!(0.02);
                }
                (format!("{i:02}.jpg"), shot)
            })
            .collect();
        let camera = serde_json::json!({"projection_type": "perspective", "width": 4000, "height": 3000, "focal": 0.75,
            "k1": 0.0, "k2": 0.0});
        let json = serde_json::json!([{"cameras": {"v2 c": camera}, "shots": shots, "reference_lla": {
            "latitude": self.reference.y, "longitude": self.reference.x, "altitude": 0.0}}]);
        fs::write(path, json.to_string()).unwrap();
    }

    fn assert_in_place(&self, survey: &Survey) {
        assert_eq!(survey.views.len(), self.grid.len());
        for (view, place) in survey.views.iter().zip(&self.grid) {
            let off_m = (view.centre() - (*place + self.offset)).length();
            assert!(off_m < 1e-3, "{}: {off_m} m off", view.id);
        }
    }
}

/// Angle by which the first photo's rows are turned against the grid's east, degrees.
fn turn_deg(survey: &Survey) -> f64 {
    let right = survey.views[0].camera_from_map.rotation.transpose() * DVec3::X;
    right.y.atan2(right.x).to_degrees()
}

#[test]
fn odms_rewritten_reconstruction_is_known_by_its_gps_positions() {
    let odm = Odm::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("reconstruction.json");
    odm.write(&path, &odm.grid, true);
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    let survey = survey::read(&config, &crs(UTM_17)).unwrap();
    odm.assert_in_place(&survey);
    assert!(turn_deg(&survey).abs() < 1e-6, "the grid's own axes");
    assert!(survey.issues.iter().any(|issue| issue.code == "frame_found"), "{:?}", survey.issues);
}

#[test]
fn a_topocentric_reconstruction_of_odm_stays_topocentric() {
    let odm = Odm::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("reconstruction.json");
    odm.write(&path, &odm.enu, true);
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    let survey = survey::read(&config, &crs(UTM_17)).unwrap();
    odm.assert_in_place(&survey);
    // Convergence is lon·sin lat: 1.656° · 0.651.
    assert!((turn_deg(&survey).abs() - 1.078).abs() < 0.005, "{}", turn_deg(&survey));
}

#[test]
fn what_nothing_tells_apart_is_refused_and_odms_own_folder_tells() {
    let odm = Odm::new();
    let folder = tempfile::tempdir().unwrap();
    let opensfm = folder.path().join("opensfm");
    fs::create_dir(&opensfm).unwrap();
    let path = opensfm.join("reconstruction.json");
    odm.write(&path, &odm.grid, false);
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    let refused = survey::read(&config, &crs(UTM_17)).unwrap_err().to_string();
    assert!(refused.contains("EPSG:32617") && refused.contains("odm_georeferencing"), "{refused}");
    let told = SurveyConfig { crs: Some(crs(UTM_17)), ..config.clone() };
    odm.assert_in_place(&survey::read(&told, &crs(UTM_17)).unwrap());

    let georeferencing = folder.path().join("odm_georeferencing");
    fs::create_dir(&georeferencing).unwrap();
    fs::write(georeferencing.join("coords.txt"), "WGS84 UTM 17N\n640000 4500000\n").unwrap();
    fs::write(georeferencing.join("proj.txt"), "+proj=utm +zone=17 +datum=WGS84 +units=m +no_defs").unwrap();
    odm.assert_in_place(&survey::read(&config, &crs(UTM_17)).unwrap());
}

#[test]
fn gps_positions_that_contradict_an_ordinary_reference_refuse_the_file() {
    let mut odm = Odm::new();
    // A reference that is no whole metre of its zone: a grid that nobody names.
    odm.reference.x += 1e-5;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("reconstruction.json");
    odm.write(&path, &odm.grid, true);
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    let refused = survey::read(&config, &crs(UTM_17)).unwrap_err().to_string();
    assert!(refused.contains("1.08°"), "{refused}");
}

fn shots(odm: &Odm, translation: impl Fn(&DVec3) -> DVec3, camera: &serde_json::Value) -> String {
    let lon_lat = Transform::new(&crs(UTM_17), &crs("EPSG:4326")).unwrap();
    let features: Vec<serde_json::Value> = odm
        .grid
        .iter()
        .enumerate()
        .map(|(i, place)| {
            let place = *place + odm.offset;
            let (lon, lat) = lon_lat.point(place.x, place.y).unwrap();
            let mut properties = serde_json::json!({"filename": format!("{i:02}.jpg"), "focal": 0.75, "width": 4000,
                "height": 3000, "rotation": [std::f64::consts::PI, 0.0, 0.0],
                "translation": translation(&place).to_array()});
            if !camera.is_null() {
                properties["camera"] = camera.clone();
            }
            serde_json::json!({"type": "Feature", "properties": properties,
                "geometry": {"type": "Point", "coordinates": [lon, lat, place.z]}})
        })
        .collect();
    serde_json::json!({"type": "FeatureCollection", "features": features}).to_string()
}

fn cameras_json(focals: &[f64]) -> String {
    let camera = |focal: &f64| {
        serde_json::json!({"projection_type": "brown", "width": 4000, "height": 3000, "focal_x": focal, "focal_y": focal,
            "c_x": 0.0, "c_y": 0.0, "k1": 0.0, "k2": 0.0, "k3": 0.0, "p1": 0.0, "p2": 0.0})
    };
    let all: serde_json::Map<String, serde_json::Value> =
        focals.iter().enumerate().map(|(i, focal)| (format!("dji {i}"), camera(focal))).collect();
    serde_json::Value::from(all).to_string()
}

#[test]
fn odms_shots_without_proj_txt_lie_where_their_longitude_and_latitude_say() {
    let odm = Odm::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shots.geojson");
    fs::write(folder.path().join("cameras.json"), cameras_json(&[0.75, 0.8])).unwrap();
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    // The project is in the neighbouring zone, whose eastings these are not; older versions name no camera.
    let project = crs("EPSG:32618");
    fs::write(&path, shots(&odm, |place| *place, &serde_json::Value::Null)).unwrap();
    let survey = survey::read(&config, &project).unwrap();
    let to_project = Transform::new(&crs(UTM_17), &project).unwrap();
    for (view, place) in survey.views.iter().zip(&odm.grid) {
        let place = *place + odm.offset;
        let (x, y) = to_project.point(place.x, place.y).unwrap();
        assert!((view.centre() - DVec3::new(x, y, place.z)).length() < 1e-3, "{}", view.centre());
        assert_eq!(view.camera.fx_px, 3000.0);
    }
    // Positions that are in no zone of their places are refused, and so is a CRS that contradicts them.
    fs::write(&path, shots(&odm, |place| *place - odm.offset, &serde_json::json!("dji 0"))).unwrap();
    let refused = survey::read(&config, &project).unwrap_err().to_string();
    assert!(refused.contains("proj.txt"), "{refused}");
    fs::write(&path, shots(&odm, |place| *place, &serde_json::json!("dji 0"))).unwrap();
    let told = SurveyConfig { crs: Some(crs("EPSG:32618")), ..config };
    let refused = survey::read(&told, &project).unwrap_err().to_string();
    assert!(refused.contains("their own longitude and latitude"), "{refused}");
}

#[test]
fn shots_without_a_camera_of_their_own_are_refused_where_two_would_do() {
    let odm = Odm::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shots.geojson");
    fs::write(folder.path().join("cameras.json"), cameras_json(&[0.75, 0.75])).unwrap();
    fs::write(&path, shots(&odm, |place| *place, &serde_json::Value::Null)).unwrap();
    let grid = Some(crs(UTM_17));
    let config = SurveyConfig { crs: grid, height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    let refused = survey::read(&config, &crs(UTM_17)).unwrap_err().to_string();
    assert!(refused.contains("several cameras"), "{refused}");
}

/// A block of Bentley's with the sample's sensor, 9420 x 14430 px of 7.2 um, in some axes and of some size and principal point.
fn bentley_camera(axes: &str, size: &str, point: &str) -> Result<Camera, SurveyError> {
    // Straight down: of axes with z backward by no turn.
    let omega = if axes == "XRightYDown" { 180 } else { 0 };
    let xml =
        super::survey_formats::blocks_exchange(axes, &format!("<Omega>{omega}</Omega><Phi>0</Phi><Kappa>0</Kappa>"))
            .replace("<Width>4000</Width><Height>3000</Height>", "<Width>9420</Width><Height>14430</Height>")
            .replace("<FocalLength>24</FocalLength><SensorSize>32</SensorSize>", size)
            .replace("<x>2001</x><y>1499</y>", point);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.xml");
    fs::write(&path, xml).unwrap();
    survey::read(&SurveyConfig::at(&path), &crs("EPSG:25832")).map(|survey| (*survey.views[0].camera).clone())
}

#[test]
fn the_principal_point_of_blocks_exchange_is_the_same_in_pixels_and_millimetres() {
    // The format's own sample has both, and its sensor's size.
    let size = "<FocalLength>100.735601903992</FocalLength><PixelSize>0.0072</PixelSize>";
    let read = |size, point| bentley_camera("XRightYDown", size, point).unwrap();
    let pixels = read(size, "<x>4683.755692</x><y>7223.0141002</y>");
    let millimetres = read(size, "<xmm>-0.1853590176</xmm><ymm>0.06130152144</ymm>");
    let off = |a: &Camera, b: &Camera| (a.cx_px - b.cx_px).abs().max((a.cy_px - b.cy_px).abs());
    assert!(off(&pixels, &millimetres) < 1e-6, "{pixels:?} {millimetres:?}");
    // In pixels too, from the centre of the first, and the focal length with the sensor's larger side.
    assert_eq!((pixels.cx_px, pixels.cy_px), (4_684.255_692, 7_223.514_100_2));
    let by_sensor = size.replace("<PixelSize>0.0072</PixelSize>", "<SensorSize>103.896</SensorSize>");
    let middle = "<x>4709.5</x><y>7214.5</y>";
    let in_pixels = read("<FocalLengthPixels>13991.05582</FocalLengthPixels>", middle);
    for same in [read(&by_sensor, middle), in_pixels, pixels.clone()] {
        assert!((same.fx_px - 13_991.055_82).abs() < 1e-4, "{same:?}");
    }
    // In other axes the millimetres are counted along those.
    for (axes, point) in [
        ("XRightYUp", "<xmm>-0.1853590176</xmm><ymm>-0.06130152144</ymm>"),
        ("XDownYRight", "<xmm>0.06130152144</xmm><ymm>-0.1853590176</ymm>"),
    ] {
        assert!(off(&pixels, &bentley_camera(axes, size, point).unwrap()) < 1e-6, "{axes}");
    }
}

#[test]
fn bentleys_yaw_pitch_roll_are_read_and_what_has_no_formula_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.xml");
    let read = |xml: &str| {
        fs::write(&path, xml).unwrap();
        Reading::of(&SurveyConfig::at(&path), &crs("EPSG:25832")).unwrap().into_survey()
    };
    let angles = "<Yaw>30</Yaw><Pitch>-45</Pitch><Roll>5</Roll>";
    let view = &read(&super::survey_formats::blocks_exchange("XRightYDown", angles)).views[0];
    let golden = DMat3::from_cols_array_2d(&super::survey_formats::ROWS).transpose();
    assert!((view.camera_from_map.rotation - golden).to_cols_array().iter().all(|off| off.abs() < 4e-6), "{view:?}");
    let says_why = |xml: &str, expected: &str| {
        let survey = read(xml);
        let reasons: Vec<&str> = survey.issues.iter().map(|issue| issue.message.as_str()).collect();
        assert!(survey.views.is_empty() && reasons.iter().any(|reason| reason.contains(expected)), "{reasons:?}");
    };
    let heading = super::survey_formats::blocks_exchange("XRightYDown", &angles.replace("Yaw", "Heading"));
    says_why(&heading, "export the rotation as a matrix");
    let fisheye = super::survey_formats::blocks_exchange("XRightYDown", angles)
        .replace("<CameraModelType>Perspective", "<CameraModelType>Fisheye")
        .replace("<Distortion>", "<FisheyeFocalMatrix><M_00>1960</M_00></FisheyeFocalMatrix><Distortion>");
    says_why(&fisheye, "camera model Fisheye: undistort the photos");
}

#[test]
fn colmap_images_survive_the_stripping_of_blank_lines() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cameras.txt"), "1 SIMPLE_PINHOLE 4000 3000 3000 2000 1500\n").unwrap();
    let pose = |i: usize, name: &str| format!("{i} 0 1 0 0 {} 0 100 1 {name}\n", -10.0 * i as f64);
    let observations = "100.5 200.25 -1 300 400 17\n";
    let names = ["a.jpg", "b with space.jpg", "00003", "d.jpg", "e.jpg"];
    let stripped: String = names.iter().enumerate().map(|(i, name)| pose(i, name)).collect();
    let complete: String = names.iter().enumerate().map(|(i, name)| pose(i, name) + "\n").collect();
    let mixed: String =
        names.iter().enumerate().map(|(i, name)| pose(i, name) + if i % 2 == 0 { observations } else { "" }).collect();
    for text in [stripped, complete, mixed] {
        fs::write(folder.path().join("images.txt"), format!("# Image list\n{text}")).unwrap();
        let config = SurveyConfig { offset: [500_000.0, 5_700_000.0, 0.0], ..SurveyConfig::at(folder.path()) };
        let survey = survey::read(&config, &crs("EPSG:25832")).unwrap();
        let mut found: Vec<&str> = survey.views.iter().map(|view| view.id.0.as_str()).collect();
        found.sort_unstable();
        let mut expected = names.to_vec();
        expected.sort_unstable();
        assert_eq!(found, expected, "{text}");
    }
}

/// A table of nadir photos at these positions.
fn table(folder: &Path, positions: &[[f64; 3]]) -> SurveyConfig {
    let path = folder.join("poses.csv");
    let rows: String =
        positions.iter().enumerate().map(|(i, [x, y, z])| format!("{i}.jpg,{x},{y},{z},0,0,0\n")).collect();
    fs::write(&path, format!("name,x,y,z,omega,phi,kappa\n{rows}")).unwrap();
    SurveyConfig {
        format: Format::Csv,
        camera: Some(camera()),
        csv: Some(CsvConfig::default()),
        ..SurveyConfig::at(path)
    }
}

#[test]
fn a_datum_shift_worse_than_a_metre_is_refused_by_the_name_of_the_better_grid() {
    let folder = tempfile::tempdir().unwrap();
    let config = SurveyConfig { crs: Some(crs("EPSG:4258")), ..table(folder.path(), &[[-1.5, 52.5, 600.0]]) };
    let Err(refused) = survey::read(&config, &crs("EPSG:27700")) else {
        skip("OSTN15 is installed");
        return;
    };
    let refused = refused.to_string();
    assert!(refused.contains("OSTN15") && refused.contains("accept_unsound"), "{refused}");
    let told = SurveyConfig { accept_unsound: true, ..config };
    let report = report(&told, "EPSG:27700");
    assert!(report.transform.contains("OSTN15"), "{}", report.transform);
}

#[test]
fn the_report_says_how_well_the_transformation_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let config =
        SurveyConfig { crs: Some(crs("EPSG:32632")), ..table(folder.path(), &[[699_000.0, 5_764_000.0, 600.0]]) };
    assert_eq!(report(&config, "EPSG:25832").transform, "EPSG:32632 to EPSG:25832, to 1 m");
    assert!(report(&config, "EPSG:32633").transform.ends_with("exact"));
    assert!(report(&config, "EPSG:32632").transform.starts_with("none"));
}

#[test]
fn heights_beside_degrees_have_to_be_named_where_the_project_names_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let table = table(folder.path(), &[[5.0, 52.0, 600.0]]);
    let config = SurveyConfig { crs: Some(crs("EPSG:4326")), ..table.clone() };
    let refused = survey::read(&config, &crs("EPSG:7415")).unwrap_err().to_string();
    assert!(refused.contains("EPSG:4979"), "{refused}");
    let height = HeightConfig { reference: Some(VerticalDatum::Project), ..HeightConfig::default() };
    let told = SurveyConfig { height, ..config };
    assert_eq!(survey::read(&told, &crs("EPSG:7415")).unwrap().views[0].centre().z, 600.0);

    // A declared geoid height is not dropped either.
    let config = SurveyConfig { crs: Some(crs("EPSG:4326+5773")), ..table };
    let refused = survey::read(&config, &crs("EPSG:28992")).unwrap_err().to_string();
    assert!(refused.contains("EGM96"), "{refused}");
}

#[test]
fn a_project_that_names_no_heights_takes_over_those_of_its_own_grid() {
    let folder = tempfile::tempdir().unwrap();
    let config = SurveyConfig { crs: Some(crs("EPSG:7415")), ..table(folder.path(), &[[92_000.0, 437_000.0, 600.0]]) };
    let report = report(&config, "EPSG:28992");
    assert!(report.heights.contains("NAP"), "{}", report.heights);
    assert!(report.is_sound(), "{report}");
}

#[test]
fn absurd_heights_never_look_right() {
    let folder = tempfile::tempdir().unwrap();
    for height_m in [4e10, -5_000.0, 25_000.0] {
        let config = table(folder.path(), &[[699_000.0, 5_764_000.0, height_m], [699_050.0, 5_764_000.0, height_m]]);
        let report = report(&config, "EPSG:25832");
        assert!(!report.is_sound(), "{height_m}: {report}");
        assert!(report.to_string().contains("m high"), "{report}");
    }
    // One bad photo of many is refused alone.
    let mut positions = vec![[699_000.0, 5_764_000.0, 300.0]; 20];
    positions.iter_mut().enumerate().for_each(|(i, position)| position[0] += 10.0 * i as f64);
    positions[7][2] = -5_000.0;
    let report = report(&table(folder.path(), &positions), "EPSG:25832");
    assert!(report.is_sound() && report.n_views == 19, "{report}");
    assert!(report.to_string().contains("7.jpg: its camera is -5000 m high"), "the text says why: {report}");
}

#[test]
fn convert_writes_nothing_that_inspect_calls_wrong() {
    let folder = tempfile::tempdir().unwrap();
    table(folder.path(), &[[699_000.0, 5_764_000.0, -50.0], [699_050.0, 5_764_000.0, -60.0]]);
    let output = folder.path().join("out.csv");
    let convert = |more: &[&str]| {
        let mut command = assert_cmd::Command::cargo_bin("sizeup").unwrap();
        command.args(["survey", "convert", "poses.csv", "--crs", "EPSG:25832", "--ground", "0", "--output", "out.csv"]);
        for (key, value) in [("width", "4000"), ("height", "3000"), ("fx", "3000")] {
            command.arg("--set").arg(format!("survey.camera.{key}={value}"));
        }
        command.args(more).current_dir(folder.path()).output().unwrap()
    };
    let refused = convert(&[]);
    assert_eq!(refused.status.code(), Some(3), "{}", String::from_utf8_lossy(&refused.stderr));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("below the ground"));
    assert!(!output.exists(), "nothing is written");
    let accepted = convert(&["--set", "survey.accept_unsound=true"]);
    assert!(accepted.status.success() && output.exists(), "{}", String::from_utf8_lossy(&accepted.stderr));
}

#[test]
fn proj_strings_need_no_type() {
    let definition = "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs";
    assert!(Crs::parse(definition).unwrap().is_projected());
}

/// A table written as it is, read with a declared camera.
fn text_table(folder: &Path, name: &str, text: &str) -> SurveyConfig {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    SurveyConfig { camera: Some(camera()), ..SurveyConfig::at(path) }
}

#[test]
fn tables_of_angles_are_read_in_their_producers_dress() {
    let folder = tempfile::tempdir().unwrap();
    let dresses = [
        (
            "comment.txt",
            "# produced today\n# ImageID Easting Northing Altitude Omega Phi Kappa\na.jpg 699000 5764000 300 0 0 90\n",
        ),
        ("units.opk", "Image;X [m];Y [m];Z [m];Omega [deg];Phi [deg];Kappa [deg]\na.jpg;699000;5764000;300;0;0;90\n"),
        (
            "quoted.csv",
            "\"name\", \"x\", \"y\", \"z\", \"omega\", \"phi\", \"kappa\"\na.jpg,699000,5764000,300,0,0,90\n",
        ),
        ("tabs.txt", "image\tx\ty\tz\tomega\tphi\tkappa\na.jpg   699000  5764000 300  0 0 90\n"),
        ("plain.csv", "name,x,y,z,omega,phi,kappa\na.jpg,699000,5764000,300,0,0,90\n"),
    ];
    for (name, text) in dresses {
        let survey = survey::read(&text_table(folder.path(), name, text), &crs("EPSG:25832"))
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(survey.views.len(), 1, "{name}: {:?}", survey.issues);
        let view = &survey.views[0];
        assert_eq!((view.id.0.as_str(), view.centre().z), ("a.jpg", 300.0), "{name}");
        // Kappa 90°: the image's right is north.
        assert!((turn_deg(&survey) - 90.0).abs() < 1e-9, "{name}");
    }
}

#[test]
fn a_header_in_gon_does_not_pass_for_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let text = "Image;X;Y;Z;Omega [gon];Phi [gon];Kappa [gon]\na.jpg;699000;5764000;300;0;0;100\n";
    let config = text_table(folder.path(), "gon.csv", text);
    let refused = survey::read(&config, &crs("EPSG:25832")).unwrap_err().to_string();
    assert!(refused.contains("csv.unit"), "{refused}");
    let csv = CsvConfig { unit: survey::angles::AngleUnit::Gon, ..CsvConfig::default() };
    let survey = survey::read(&SurveyConfig { csv: Some(csv), ..config }, &crs("EPSG:25832")).unwrap();
    assert!((turn_deg(&survey) - 90.0).abs() < 1e-9);
}

#[test]
fn longitude_and_latitude_columns_are_degrees_whose_heights_have_to_be_named() {
    let folder = tempfile::tempdir().unwrap();
    let text = "name,lat,lon,alt,yaw,pitch,roll\na.jpg,52.0,9.0,300,0,-90,0\n";
    let csv = CsvConfig { angles: survey::angles::AngleKind::Ypr, ..CsvConfig::default() };
    let config = SurveyConfig { csv: Some(csv), ..text_table(folder.path(), "odm_lla_rpy.csv", text) };
    let refused = survey::read(&config, &crs("EPSG:25832")).unwrap_err().to_string();
    assert!(refused.contains("height.reference"), "{refused}");
    let survey = survey::read(&SurveyConfig { height: keep_ellipsoidal(), ..config }, &crs("EPSG:25832")).unwrap();
    // 9° E is the zone's central meridian.
    assert!((survey.views[0].centre().x - 500_000.0).abs() < 1e-3, "{}", survey.views[0].centre());
}

#[test]
fn pix4ds_files_need_no_project_name() {
    let folder = tempfile::tempdir().unwrap();
    let header = "fileName imageWidth imageHeight\n\n\n\n\n\n\n\n";
    let body = "a.jpg 4000 3000\n3000 0 2000\n0 3000 1500\n0 0 1\n0 0 0\n0 0\n10 20 300\n1 0 0\n0 -1 0\n0 0 -1\n";
    fs::write(folder.path().join("calibrated_camera_parameters.txt"), format!("{header}{body}")).unwrap();
    // The offset on one line, and on four.
    for offset in ["699000 5764000 0\n", "offset:\n699000\n5764000\n0\n"] {
        fs::write(folder.path().join("offset.xyz"), offset).unwrap();
        for path in [folder.path().to_owned(), folder.path().join("calibrated_camera_parameters.txt")] {
            let survey = survey::read(&SurveyConfig::at(path), &crs("EPSG:25832")).unwrap();
            assert_eq!(survey.views[0].centre(), DVec3::new(699_010.0, 5_764_020.0, 300.0));
        }
    }
}

#[test]
fn nerfstudio_is_colmap_again_once_its_transform_is_undone() {
    // The golden camera of the rotation conventions: its rows x right, y down, z forward.
    let [x, y, z] = super::survey_formats::ROWS;
    let centre = [200.25, 400.5, 210.125];
    // Camera to world in x right, y up, z backward; then the converter's rows 0, 2, 1 with the last negated.
    let c2w = |row: usize| [x[row], -y[row], -z[row], centre[row]];
    let [first, second, third] = [c2w(0), c2w(1), c2w(2)];
    let matrix = serde_json::json!([first, third, second.map(|value| -value), [0.0, 0.0, 0.0, 1.0]]);
    let applied = serde_json::json!([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0]]);
    let json = serde_json::json!({"w": 4000, "h": 3000, "fl_x": 3000.0, "fl_y": 3001.0, "cx": 2001.0, "cy": 1499.0,
        "k1": 0.1, "k2": 0.01, "p1": 0.001, "p2": 0.002, "camera_model": "OPENCV", "applied_transform": applied,
        "frames": [{"file_path": "./images/a.jpg", "transform_matrix": matrix, "colmap_im_id": 1},
            {"file_path": "b.jpg", "transform_matrix": [[1.0, 0.0], [0.0, 1.0]]},
            {"file_path": "c.jpg", "transform_matrix": matrix, "camera_model": "EQUIRECTANGULAR"}]});
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    fs::write(&path, json.to_string()).unwrap();
    let config = SurveyConfig { offset: [699_000.0, 5_764_000.0, 0.0], ..SurveyConfig::at(folder.path()) };
    let survey = survey::read(&config, &crs("EPSG:25832")).unwrap();
    assert_eq!(survey.views.len(), 1, "{:?}", survey.issues);
    let view = &survey.views[0];
    assert!((view.centre() - DVec3::new(699_200.25, 5_764_400.5, 210.125)).length() < 1e-6, "{}", view.centre());
    let golden = DMat3::from_cols_array_2d(&super::survey_formats::ROWS).transpose();
    let off = (view.camera_from_map.rotation - golden).to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
    assert!(off < 4e-6, "rotation off by {off}");
    assert_eq!((view.camera.fy_px, view.camera.cx_px), (3001.0, 2001.0));
    let reasons: Vec<&str> = survey.issues.iter().map(|issue| issue.message.as_str()).collect();
    assert!(reasons.iter().any(|reason| reason.contains("EQUIRECTANGULAR")), "{reasons:?}");
    assert!(reasons.iter().any(|reason| reason.contains("expected 4")), "{reasons:?}");
}

#[test]
fn every_format_is_listed_with_what_its_path_is() {
    let listed = assert_cmd::Command::cargo_bin("sizeup").unwrap().args(["survey", "formats"]).output().unwrap();
    let listed = String::from_utf8(listed.stdout).unwrap();
    for name in ["colmap", "blocks_exchange", "opensfm", "odm", "nerfstudio", "metashape_opk", "photos", "csv"] {
        assert!(listed.lines().any(|line| line.starts_with(name)), "{name}: {listed}");
    }
}

/// Two blocks of one photo each; the systems that they name, and the definitions of systems 1 and 2.
fn blocks(named: [&str; 2], defined: [&str; 2]) -> String {
    let system = |(i, definition): (usize, &str)| {
        format!("<SRS><Id>{}</Id><Name>s</Name><Definition>{definition}</Definition></SRS>", i + 1)
    };
    let systems: String = defined.into_iter().enumerate().map(system).collect();
    let block = |(i, named): (usize, &str)| {
        format!(
            "<Block><Name>b{i}</Name><SRSId>{named}</SRSId><Photogroups><Photogroup><Name>g</Name>\
             <ImageDimensions><Width>4000</Width><Height>3000</Height></ImageDimensions>\
             <CameraOrientation>XRightYDown</CameraOrientation><FocalLength>24</FocalLength><SensorSize>32</SensorSize>\
             <Photo><Id>{i}</Id><ImagePath>{i}.jpg</ImagePath><Pose><Rotation><Omega>180</Omega><Phi>0</Phi><Kappa>0</Kappa></Rotation>\
             <Center><x>50000{i}</x><y>5700000</y><z>300</z></Center></Pose></Photo></Photogroup></Photogroups></Block>"
        )
    };
    let blocks: String = named.into_iter().enumerate().map(block).collect();
    format!(
        "<?xml version=\"1.0\"?><BlocksExchange version=\"3.2\"><SpatialReferenceSystems>{systems}\
         </SpatialReferenceSystems>{blocks}</BlocksExchange>"
    )
}

#[test]
fn blocks_in_a_system_that_is_not_defined_or_in_two_are_not_taken_for_the_projects() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("blocks.xml");
    let refused = |text: String, config: &SurveyConfig| {
        fs::write(&path, text).unwrap();
        survey::read(config, &crs("EPSG:25832")).err().map(|e| e.to_string())
    };
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    // One system under two numbers is one.
    assert_eq!(refused(blocks(["1", "2"], ["EPSG:25832", "EPSG:25832"]), &config), None);
    let undefined = blocks(["7", "7"], ["EPSG:25833", "EPSG:25833"]);
    let why = refused(undefined.clone(), &config).unwrap();
    assert!(why.contains("system \"7\", which the file does not define"), "{why}");
    assert_eq!(refused(undefined, &SurveyConfig { crs: Some(crs("EPSG:25832")), ..config.clone() }), None);
    let why = refused(blocks(["1", "2"], ["EPSG:25832", "EPSG:25833"]), &config).unwrap();
    assert!(why.contains("different systems (EPSG:25832, EPSG:25833)"), "{why}");
}

#[test]
fn parts_of_a_reconstruction_with_origins_of_their_own_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("reconstruction.json");
    let part = |longitude: f64, name: &str| {
        serde_json::json!({
            "cameras": { "c": { "projection_type": "perspective", "width": 4000, "height": 3000, "focal": 0.8, "k1": 0, "k2": 0 } },
            "shots": { name: { "rotation": [3.1, 0, 0], "translation": [0, 0, 100], "camera": "c" } },
            "reference_lla": { "latitude": 51.0, "longitude": longitude, "altitude": 0.0 },
        })
    };
    let read = |second: f64| {
        fs::write(&path, serde_json::json!([part(7.0, "a.jpg"), part(second, "b.jpg")]).to_string()).unwrap();
        let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
        survey::read(&config, &crs("EPSG:25832"))
    };
    assert_eq!(read(7.0).unwrap().views.len(), 2);
    let why = read(7.1).unwrap_err().to_string();
    assert!(why.contains("origins of their own") && why.contains("7.1"), "{why}");
}
