//! Every pose format, written here as its tool writes it, yields the same camera: yaw 30°, pitch −45°, roll 5° over grid
//! north, from the golden vectors of the rotation conventions.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use glam::{DMat3, DVec3};
use sizeup::camera::Distortion;
use sizeup::crs::{Crs, Geocentric, Transform, enu_from_geocentric};
use sizeup::survey::{self, CameraConfig, Format, HeightConfig, Site, Survey, SurveyConfig, VerticalDatum, View};

/// Rows of `camera_from_world` (x right; y down; z forward) in east, north, up.
pub const ROWS: [[f64; 3]; 3] = [
    [0.831_915_9, -0.551_469_1, -0.061_628_4],
    [-0.427_687_3, -0.566_463_6, -0.704_416_0],
    [0.353_553_4, 0.612_372_4, -std::f64::consts::FRAC_1_SQRT_2],
];
const QUATERNION: &str = "0.373612 0.88112 -0.277816 0.082828";
const ROTATION_VECTOR: [f64; 3] = [2.256_782, -0.711_561, 0.212_144];
const OPK: [f64; 3] = [40.8934, -20.7048, -27.2077];
/// A place in UTM 32N with a convergence of −2.3°.
const CENTRE: DVec3 = DVec3::new(699_200.25, 5_764_400.5, 210.125);
/// Rounding of the golden vectors, in each element of the matrix.
const ROUNDING: f64 = 4e-6;

fn utm() -> Crs {
    Crs::parse("EPSG:25832").unwrap()
}

fn golden_rotation() -> DMat3 {
    DMat3::from_cols_array_2d(&ROWS).transpose()
}

fn assert_pose(view: &View, rotation: DMat3, centre: DVec3, metres: f64) {
    let difference = (view.camera_from_map.rotation - rotation).to_cols_array();
    let largest = difference.into_iter().map(f64::abs).fold(0.0, f64::max);
    assert!(largest < ROUNDING, "{}: rotation off by {largest:.1e}", view.id);
    let off_m = (view.camera_from_map.centre() - centre).length();
    assert!(off_m < metres, "{}: position off by {off_m} m", view.id);
}

fn assert_golden(survey: &Survey) {
    assert_eq!(survey.views.len(), 1, "{:?}", survey.issues);
    assert_pose(&survey.views[0], golden_rotation(), CENTRE, 1e-3);
}

fn read(path: &Path) -> Survey {
    survey::read(&SurveyConfig::at(path), &utm()).unwrap()
}

fn camera() -> CameraConfig {
    CameraConfig { width: 4000, height: 3000, fx: 3000.0, fy: None, cx: None, cy: None, k: [0.0; 3], p: [0.0; 2] }
}

fn keep_ellipsoidal() -> HeightConfig {
    HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() }
}

/// `t = −R·C` of the golden camera.
fn translation(centre: DVec3) -> DVec3 {
    -(golden_rotation() * centre)
}

#[test]
fn colmap_text() {
    let folder = tempfile::tempdir().unwrap();
    let local = CENTRE - DVec3::new(699_000.0, 5_764_000.0, 0.0);
    let t = translation(local);
    fs::write(folder.path().join("cameras.txt"), "# c\n1 OPENCV 4000 3000 3000 3001 2000 1500 0.1 0.01 0.001 0.002\n")
        .unwrap();
    let images = format!("# i\n1 {QUATERNION} {} {} {} 1 with space.jpg\n\n", t.x, t.y, t.z);
    fs::write(folder.path().join("images.txt"), images).unwrap();
    let config = SurveyConfig { offset: [699_000.0, 5_764_000.0, 0.0], ..SurveyConfig::at(folder.path()) };
    let survey = survey::read(&config, &utm()).unwrap();
    assert_golden(&survey);
    assert_eq!(survey.views[0].id.0, "with space.jpg");
    let expected = Distortion::Brown { k1: 0.1, k2: 0.01, k3: 0.0, p1: 0.001, p2: 0.002 };
    assert_eq!(survey.views[0].camera.distortion, expected);
}

#[test]
fn colmap_binary() {
    let folder = tempfile::tempdir().unwrap();
    super::survey_hostile::write_binary_model(folder.path(), CENTRE);
    assert_golden(&read(folder.path()));
}

pub fn blocks_exchange(orientation: &str, rotation: &str) -> String {
    format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
        <BlocksExchange version="3.2">
          <SpatialReferenceSystems><SRS><Id>7</Id><Definition>EPSG:25832</Definition></SRS></SpatialReferenceSystems>
          <Block><SRSId>7</SRSId><Photogroups><Photogroup>
            <ImageDimensions><Width>4000</Width><Height>3000</Height></ImageDimensions>
            <CameraModelType>Perspective</CameraModelType>
            <FocalLength>24</FocalLength><SensorSize>32</SensorSize>
            <CameraOrientation>{orientation}</CameraOrientation>
            <PrincipalPoint><x>2001</x><y>1499</y></PrincipalPoint>
            <Distortion><K1>-0.01</K1><K2>0</K2><K3>0</K3><P1>0</P1><P2>0</P2></Distortion>
            <Photo><Id>0</Id><ImagePath>C:/flight/a &amp; b.jpg</ImagePath>
              <Pose><Rotation>{rotation}</Rotation>
                <Center><x>{}</x><y>{}</y><z>{}</z></Center>
                <Metadata><Rotation><Yaw>1</Yaw><Pitch>2</Pitch><Roll>3</Roll></Rotation></Metadata></Pose></Photo>
            <Photo><Id>1</Id><ImagePath>unaligned.jpg</ImagePath></Photo>
          </Photogroup></Photogroups><TiePoints><TiePoint/></TiePoints></Block>
        </BlocksExchange>"#,
        CENTRE.x, CENTRE.y, CENTRE.z
    )
}

pub fn matrix_elements(rows: [[f64; 3]; 3]) -> String {
    let element = |i: usize| format!("<M_{0}{1}>{2}</M_{0}{1}>", i / 3, i % 3, rows[i / 3][i % 3]);
    (0..9).map(element).collect()
}

#[test]
fn blocks_exchange_matrix_and_orientations() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.xml");
    let [x, y, z] = ROWS;
    let minus = |row: [f64; 3]| row.map(|value| -value);
    // The same camera in other axes: XRightYUp has rows x, −y, −z; XUpYRight has x_file = up = −y, y_file = right = x.
    for (orientation, rows) in
        [("XRightYDown", [x, y, z]), ("XRightYUp", [x, minus(y), minus(z)]), ("XUpYRight", [minus(y), x, z])]
    {
        fs::write(&path, blocks_exchange(orientation, &matrix_elements(rows))).unwrap();
        let survey = read(&path);
        assert_golden(&survey);
        assert_eq!(survey.views[0].id.0, "a & b.jpg");
        let camera = &survey.views[0].camera;
        // Pixels count from the centre of the first.
        assert_eq!((camera.fx_px, camera.cx_px, camera.cy_px), (3000.0, 2001.5, 1499.5));
        assert_eq!(survey.issues[0].code, "photo_without_pose");
    }
}

#[test]
fn blocks_exchange_angles_of_a_nadir_camera_have_omega_180() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.xml");
    let angles = "<Omega>180</Omega><Phi>0</Phi><Kappa>0</Kappa>";
    fs::write(&path, blocks_exchange("XRightYDown", angles)).unwrap();
    let nadir = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
    assert_pose(&read(&path).views[0], nadir, CENTRE, 1e-6);
}

#[test]
fn blocks_exchange_zipped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.xmlz");
    let mut zip = zip::ZipWriter::new(fs::File::create(&path).unwrap());
    zip.start_file("block.xml", zip::write::SimpleFileOptions::default()).unwrap();
    zip.write_all(blocks_exchange("XRightYDown", &matrix_elements(ROWS)).as_bytes()).unwrap();
    zip.finish().unwrap();
    assert_golden(&read(&path));
}

/// Longitude, latitude, height of the golden centre, and the rotation over true north there.
fn geodetic() -> (DVec3, DMat3) {
    let wgs84 = Crs::parse("EPSG:4326").unwrap();
    let (lon_deg, lat_deg) = Transform::new(&utm(), &wgs84).unwrap().point(CENTRE.x, CENTRE.y).unwrap();
    let north = Transform::new(&wgs84, &utm()).unwrap().north_at(lon_deg, lat_deg).unwrap();
    assert!(north.azimuth_rad.to_degrees() < -2.2, "the place has a convergence worth testing");
    (DVec3::new(lon_deg, lat_deg, CENTRE.z), golden_rotation() * north.target_from_source())
}

#[test]
fn opensfm_topocentric() {
    let (geodetic, camera_from_enu) = geodetic();
    let origin = geodetic + DVec3::new(0.002, -0.001, -100.0);
    let geocentric = Geocentric::new().unwrap();
    let enu_from_ecef = enu_from_geocentric(origin.x, origin.y);
    let in_enu = enu_from_ecef * (geocentric.geocentric(geodetic).unwrap() - geocentric.geocentric(origin).unwrap());
    // The tangent planes of origin and camera differ: the rotation refers to the origin's.
    let camera_from_origin = camera_from_enu * enu_from_geocentric(geodetic.x, geodetic.y) * enu_from_ecef.transpose();
    let t = -(camera_from_origin * in_enu);
    let vector = glam::DQuat::from_mat3(&camera_from_origin).to_scaled_axis();
    let json = serde_json::json!([{
        "cameras": {"v2 make model 4000 3000 brown 0.75": {"projection_type": "brown", "width": 4000, "height": 3000,
            "focal_x": 0.75, "focal_y": 0.75, "c_x": 0.001, "c_y": 0.0, "k1": 0.1, "k2": 0.0, "k3": 0.0, "p1": 0.0,
            "p2": 0.0}},
        "shots": {"a.jpg": {"rotation": vector.to_array(), "translation": t.to_array(),
            "camera": "v2 make model 4000 3000 brown 0.75"}},
        "reference_lla": {"latitude": origin.y, "longitude": origin.x, "altitude": origin.z}
    }]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("reconstruction.json");
    fs::write(&path, json.to_string()).unwrap();
    let refused = survey::read(&SurveyConfig::at(&path), &utm()).unwrap_err().to_string();
    assert!(refused.contains("geoid_offset"), "{refused}");
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    let survey = survey::read(&config, &utm()).unwrap();
    assert_golden(&survey);
    assert_eq!((survey.views[0].camera.fx_px, survey.views[0].camera.cx_px), (3000.0, 2004.0));
    assert!(survey.issues.iter().any(|issue| issue.code == "height_choice"), "the choice is recorded");
}

#[test]
fn odm_after_georeferencing() {
    let project = tempfile::tempdir().unwrap();
    let (opensfm, georeferencing) = (project.path().join("opensfm"), project.path().join("odm_georeferencing"));
    for folder in [&opensfm, &georeferencing] {
        fs::create_dir(folder).unwrap();
    }
    fs::write(georeferencing.join("coords.txt"), "WGS84 UTM 32N\n699000 5764000\n").unwrap();
    fs::write(georeferencing.join("proj.txt"), "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs").unwrap();
    fs::write(opensfm.join("reconstruction.topocentric.json"), "[]").unwrap();
    let t = translation(CENTRE - DVec3::new(699_000.0, 5_764_000.0, 0.0));
    let camera = serde_json::json!({"projection_type": "perspective", "width": 4000, "height": 3000, "focal": 0.75,
        "k1": 0.0, "k2": 0.0});
    let json = serde_json::json!([{ "cameras": {"v2 c": camera},
        "shots": {"a.jpg": {"rotation": ROTATION_VECTOR, "translation": t.to_array(), "camera": "v2 c"}},
        "reference_lla": {"latitude": 52.0, "longitude": 11.9, "altitude": 0.0} }]);
    fs::write(opensfm.join("reconstruction.json"), json.to_string()).unwrap();
    let config = SurveyConfig {
        height: keep_ellipsoidal(),
        crs: Some(utm()),
        ..SurveyConfig::at(opensfm.join("reconstruction.json"))
    };
    assert_golden(&survey::read(&config, &utm()).unwrap());

    let report = project.path().join("odm_report");
    fs::create_dir(&report).unwrap();
    fs::write(project.path().join("cameras.json"), serde_json::json!({ "c": camera }).to_string()).unwrap();
    let shots = serde_json::json!({"type": "FeatureCollection", "features": [{"type": "Feature",
        "properties": {"filename": "a.jpg", "camera": "v2 c", "rotation": ROTATION_VECTOR,
            "translation": CENTRE.to_array()},
        "geometry": {"type": "Point", "coordinates": geodetic().0.to_array()}}]});
    fs::write(report.join("shots.geojson"), shots.to_string()).unwrap();
    let config = SurveyConfig { path: report.join("shots.geojson"), ..config };
    assert_golden(&survey::read(&config, &utm()).unwrap());
}

#[test]
fn metashape_with_a_chunk_in_earth_centred_coordinates() {
    let (geodetic, camera_from_enu) = geodetic();
    let ecef = Geocentric::new().unwrap().geocentric(geodetic).unwrap();
    let ecef_from_camera = (camera_from_enu * enu_from_geocentric(geodetic.x, geodetic.y)).transpose();
    // An arbitrary chunk: ecef = scale · rotation · p + translation.
    let rotation = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_z(-1.1);
    let (scale, translation) = (12.5, ecef - DVec3::new(30.0, -20.0, 10.0));
    let chunk_from_camera = rotation.transpose() * ecef_from_camera;
    let centre = rotation.transpose() * (ecef - translation) / scale;
    let text = |matrix: DMat3| -> Vec<String> { (0..9).map(|i| matrix.col(i % 3)[i / 3].to_string()).collect() };
    let r = text(chunk_from_camera);
    let transform = format!(
        "{} {} {} {} {} {} {} {} {} {} {} {} 0 0 0 1",
        r[0], r[1], r[2], centre.x, r[3], r[4], r[5], centre.y, r[6], r[7], r[8], centre.z
    );
    let xml = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?><document version="2.0.0"><chunk label="Chunk 1" enabled="true">
        <sensors next_id="1"><sensor id="0" label="cam" type="frame"><resolution width="4000" height="3000"/>
          <calibration type="frame" class="initial"><resolution width="4000" height="3000"/><f>1</f></calibration>
          <calibration type="frame" class="adjusted"><resolution width="4000" height="3000"/><f>3000</f><cx>5</cx>
            <cy>-7</cy><b1>2</b1><b2>0.6</b2><k1>0.1</k1><p1>0.001</p1><p2>0.002</p2></calibration></sensor></sensors>
        <cameras next_id="3"><group id="0" label="g" type="folder">
          <camera id="0" sensor_id="0" label="a"><transform>{transform}</transform></camera></group>
          <camera id="1" sensor_id="0" label="unaligned"/></cameras>
        <transform><rotation>{}</rotation><translation>{} {} {}</translation><scale>{scale}</scale></transform>
        <reference>GEOGCS["WGS 84"]</reference></chunk></document>"#,
        text(rotation).join(" "),
        translation.x,
        translation.y,
        translation.z
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.xml");
    fs::write(&path, xml).unwrap();
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    let survey = survey::read(&config, &utm()).unwrap();
    assert_golden(&survey);
    assert!(survey.issues.iter().any(|issue| issue.code == "photo_without_pose"));
    // The manual's formulas, by hand.
    let (x, y) = (0.3, -0.2);
    let r2 = x * x + y * y;
    let radial = 1.0 + 0.1 * r2;
    let x_d = x * radial + 0.001 * (r2 + 2.0 * x * x) + 2.0 * 0.002 * x * y;
    let y_d = y * radial + 0.002 * (r2 + 2.0 * y * y) + 2.0 * 0.001 * x * y;
    let pixel = survey.views[0].camera.project(DVec3::new(x, y, 1.0)).unwrap();
    let (u, v) = (2000.0 + 5.0 + x_d * 3002.0 + y_d * 0.6, 1500.0 - 7.0 + y_d * 3000.0);
    assert!((pixel.x - u).abs() < 1e-9 && (pixel.y - v).abs() < 1e-9, "{pixel} against {u}, {v}");
}

#[test]
fn metashape_angles_pix4d_angles_and_geo_txt() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let [omega, phi, kappa] = OPK;
    let DVec3 { x, y, z } = CENTRE;
    fs::write(
        path("opk.txt"),
        format!("# Cameras (1)\n# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11\na b\t{x}\t{y}\t{z}\t{omega}\t{phi}\t{kappa}\t0.1\n"),
    )
    .unwrap();
    let config = SurveyConfig { camera: Some(camera()), ..SurveyConfig::at(path("opk.txt")) };
    assert_golden(&survey::read(&config, &utm()).unwrap());

    let name = "p_calibrated_external_camera_parameters.txt";
    fs::write(path(name), format!("imageName X Y Z Omega Phi Kappa \na.jpg   {x} {y} {z} {omega} {phi} {kappa}\n"))
        .unwrap();
    let config = SurveyConfig { camera: Some(camera()), ..SurveyConfig::at(path(name)) };
    assert_golden(&survey::read(&config, &utm()).unwrap());
    assert!(survey::read(&SurveyConfig::at(path(name)), &utm()).unwrap_err().to_string().contains("[survey.camera]"));

    // geo.txt counts yaw from true north, which lies at −2.3° in this grid, and pitch from the nadir.
    let (geodetic, _) = geodetic();
    let wgs84 = Crs::parse("EPSG:4326").unwrap();
    let north = Transform::new(&wgs84, &utm()).unwrap().north_at(geodetic.x, geodetic.y).unwrap();
    let yaw = 30.0 - north.azimuth_rad.to_degrees();
    fs::write(path("geo.txt"), format!("EPSG:25832\na.jpg {x} {y} {z} {yaw} 45 5 0.1 0.2\nbare.jpg {x} {y}\n"))
        .unwrap();
    let config =
        SurveyConfig { camera: Some(camera()), height: keep_ellipsoidal(), ..SurveyConfig::at(path("geo.txt")) };
    let survey = survey::read(&config, &utm()).unwrap();
    assert_golden(&survey);
    assert_eq!(survey.issues.iter().filter(|issue| issue.code == "photo_without_pose").count(), 1);
}

#[test]
fn pix4d_calibrated_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let local = CENTRE - DVec3::new(699_000.0, 5_764_000.0, 100.0);
    let row = |row: [f64; 3]| format!("{} {} {}", row[0], row[1], row[2]);
    let header = "fileName imageWidth imageHeight\ncamera matrix K [3x3]\nradial distortion [3x1]\n\
                  tangential distortion [2x1]\ncamera position t [3x1]\ncamera rotation R [3x3]\n\
                  camera model m = K [R|-Rt] X\n\n";
    let body = format!(
        "a b.jpg 4000 3000\n3000 0 2000\n0 3001 1500\n0 0 1\n-0.1 0.02 0.003\n0.0001 0.0002\n{}\n{}\n{}\n{}\n",
        row(local.to_array()),
        row(ROWS[0]),
        row(ROWS[1]),
        row(ROWS[2])
    );
    fs::write(path("p_calibrated_camera_parameters.txt"), format!("{header}{body}")).unwrap();
    fs::write(path("p_offset.xyz"), "699000.000 5764000.000 100.000\n").unwrap();
    let survey = read(folder.path());
    assert_golden(&survey);
    assert_eq!(survey.views[0].id.0, "a b.jpg");
    assert_eq!(survey.views[0].camera.fy_px, 3001.0);
}

#[test]
fn poses_in_a_neighbouring_zone_turn_by_the_difference_of_convergence() {
    let folder = tempfile::tempdir().unwrap();
    super::survey_hostile::write_binary_model(folder.path(), CENTRE);
    let zone_33 = Crs::parse("EPSG:25833").unwrap();
    let config = SurveyConfig { crs: Some(utm()), ..SurveyConfig::at(folder.path()) };
    let survey = survey::read(&config, &zone_33).unwrap();
    let to_33 = Transform::new(&utm(), &zone_33).unwrap();
    let (easting, northing) = to_33.point(CENTRE.x, CENTRE.y).unwrap();
    let north = to_33.north_at(CENTRE.x, CENTRE.y).unwrap();
    assert!(north.azimuth_rad.abs().to_degrees() > 4.0);
    let rotation = golden_rotation() * north.target_from_source().transpose();
    assert_pose(&survey.views[0], rotation, DVec3::new(easting, northing, CENTRE.z), 1e-3);
}

#[test]
fn heights_above_take_off_and_minus_a_stated_geoid() {
    let folder = tempfile::tempdir().unwrap();
    super::survey_hostile::write_binary_model(folder.path(), CENTRE);
    let z = |height: HeightConfig| {
        let config = SurveyConfig { height, ..SurveyConfig::at(folder.path()) };
        survey::read(&config, &utm()).unwrap().views[0].camera_from_map.centre().z
    };
    let takeoff =
        HeightConfig { reference: Some(VerticalDatum::AboveTakeoff), base: Some(55.0), ..HeightConfig::default() };
    assert!((z(takeoff) - CENTRE.z - 55.0).abs() < 1e-6);
    assert!((z(HeightConfig { geoid_offset: Some(44.5), ..HeightConfig::default() }) - CENTRE.z + 44.5).abs() < 1e-6);
}

#[test]
fn a_geographic_project_is_refused_with_the_surveys_own_utm_zone() {
    let folder = tempfile::tempdir().unwrap();
    super::survey_hostile::write_binary_model(folder.path(), CENTRE);
    let config = SurveyConfig { crs: Some(utm()), format: Format::Colmap, ..SurveyConfig::at(folder.path()) };
    for project in ["EPSG:4326", "EPSG:3857"] {
        let refused = survey::read(&config, &Crs::parse(project).unwrap()).unwrap_err().to_string();
        assert!(refused.contains("EPSG:32632"), "{refused}");
    }
}

#[test]
fn a_colmap_model_at_a_declared_enu_origin() {
    let (geodetic, camera_from_enu) = geodetic();
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cameras.txt"), "1 PINHOLE 4000 3000 3000 3000 2000 1500\n").unwrap();
    let [w, x, y, z] = survey::angles::quaternion_wxyz(camera_from_enu);
    // The camera stands 100 m above the origin.
    let t = -(camera_from_enu * DVec3::new(0.0, 0.0, 100.0));
    let image = format!("1 {w} {x} {y} {z} {} {} {} 1 a.jpg\n\n", t.x, t.y, t.z);
    fs::write(folder.path().join("images.txt"), image).unwrap();
    let config = SurveyConfig {
        enu_origin: Some([geodetic.y, geodetic.x, geodetic.z - 100.0]),
        height: keep_ellipsoidal(),
        ..SurveyConfig::at(folder.path())
    };
    assert_golden(&survey::read(&config, &utm()).unwrap());
}

/// One CSV row at longitude, latitude and ellipsoidal height, yaw over true north.
fn geographic_table(folder: &Path) -> SurveyConfig {
    let (geodetic, _) = geodetic();
    let wgs84 = Crs::parse("EPSG:4326").unwrap();
    let north = Transform::new(&wgs84, &utm()).unwrap().north_at(geodetic.x, geodetic.y).unwrap();
    let yaw = 30.0 - north.azimuth_rad.to_degrees();
    let path = folder.join("poses.csv");
    let row = format!("a.jpg,{},{},{},{yaw},-45,5\n", geodetic.x, geodetic.y, geodetic.z);
    fs::write(&path, format!("name,x,y,z,yaw,pitch,roll\n{row}")).unwrap();
    let mut config: SurveyConfig =
        toml::from_str("path = \"-\"\ncrs = \"EPSG:4979\"\n[csv]\nangles = \"ypr\"").unwrap();
    (config.path, config.camera) = (path, Some(camera()));
    config
}

#[test]
fn ellipsoidal_heights_reach_a_project_above_the_geoid() {
    let folder = tempfile::tempdir().unwrap();
    let config = geographic_table(folder.path());
    let survey = survey::read(&config, &Crs::parse("EPSG:32632+5773").unwrap()).unwrap();
    // EGM96 at 52° N 11.9° E: 44.1 m (the geoid in northern Germany lies 40 to 47 m above the ellipsoid).
    let geoid_m = CENTRE.z - survey.views[0].camera_from_map.centre().z;
    assert!((geoid_m - 44.0).abs() < 2.0, "{geoid_m}");
    let choice = survey.issues.iter().find(|issue| issue.code == "height_choice").unwrap();
    assert!(choice.message.contains("EGM96"), "{}", choice.message);
}

#[test]
fn without_its_grid_a_height_system_is_refused_by_the_grids_name() {
    let folder = tempfile::tempdir().unwrap();
    let config = geographic_table(folder.path());
    for (project, grid) in [("EPSG:25832+7837", "GCG2016"), ("EPSG:7415", "nlgeo2018"), ("EPSG:25832+3855", "egm08")] {
        match survey::read(&config, &Crs::parse(project).unwrap()) {
            // A machine with the grid installed: the geoid comes off.
            Ok(survey) => assert!((CENTRE.z - survey.views[0].camera_from_map.centre().z - 44.0).abs() < 3.0),
            Err(e) => assert!(e.to_string().contains(grid), "{project}: {e}"),
        }
    }
}

/// A JPEG of nothing but an XMP packet, a frame header and its end.
pub fn photo(path: &Path, tags: &str, width: u16, height: u16) {
    let packet = format!(
        "http://ns.adobe.com/xap/1.0/\0<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"r\"><rdf:Description \
         xmlns:drone-dji=\"d\" {tags}/></rdf:RDF></x:xmpmeta>\n\n"
    );
    let mut bytes = vec![0xFF, 0xD8, 0xFF, 0xE1];
    bytes.extend(u16::try_from(packet.len() + 2).unwrap().to_be_bytes());
    bytes.extend(packet.as_bytes());
    bytes.extend([0xFF, 0xC0, 0, 11, 8]);
    bytes.extend(height.to_be_bytes());
    bytes.extend(width.to_be_bytes());
    bytes.extend([1, 0, 0, 0, 0xFF, 0xD9]);
    fs::write(path, bytes).unwrap();
}

#[test]
fn rtk_photos_with_dewarp_data() {
    let folder = tempfile::tempdir().unwrap();
    let (geodetic, _) = geodetic();
    let wgs84 = Crs::parse("EPSG:4326").unwrap();
    let north = Transform::new(&wgs84, &utm()).unwrap().north_at(geodetic.x, geodetic.y).unwrap();
    let yaw = 30.0 - north.azimuth_rad.to_degrees();
    let tags = |yaw: f64, pitch: f64, roll: f64| {
        format!(
            "drone-dji:GpsLatitude=\"+{}\" drone-dji:GpsLongtitude=\"+{}\" drone-dji:AbsoluteAltitude=\"+{}\" \
             drone-dji:GimbalYawDegree=\"{yaw}\" drone-dji:GimbalPitchDegree=\"{pitch}\" \
             drone-dji:GimbalRollDegree=\"{roll}\" drone-dji:FlightYawDegree=\"77\" drone-dji:RtkFlag=\"50\" \
             drone-dji:DewarpFlag=\"0\" \
             drone-dji:DewarpData=\"2020-01-01;3700.5,3701.5,12.5,-8.25,-0.1,0.02,0.0001,0.0002,-0.003\"",
            geodetic.y, geodetic.x, geodetic.z
        )
    };
    photo(&folder.path().join("a.jpg"), &tags(yaw, -45.0, 5.0), 5280, 3956);
    photo(&folder.path().join("rolled.jpg"), &tags(yaw, -90.0, 180.0), 5280, 3956);
    photo(&folder.path().join("level.jpg"), &tags(yaw + 180.0, -90.0, 0.0), 5280, 3956);
    photo(&folder.path().join("no_gimbal.jpg"), "drone-dji:GpsLatitude=\"52\"", 5280, 3956);
    let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(folder.path()) };
    let survey = survey::read(&config, &utm()).unwrap();
    let view = |name: &str| survey.views.iter().find(|view| view.id.0 == name).unwrap();
    assert_pose(view("a.jpg"), golden_rotation(), CENTRE, 1e-3);
    assert_pose(view("rolled.jpg"), view("level.jpg").camera_from_map.rotation, CENTRE, 1e-3);
    let camera = &view("a.jpg").camera;
    assert_eq!((camera.fx_px, camera.fy_px), (3700.5, 3701.5));
    assert_eq!((camera.cx_px, camera.cy_px), (2640.0 + 12.5, 1978.0 - 8.25));
    let expected = Distortion::Brown { k1: -0.1, k2: 0.02, k3: -0.003, p1: 0.0001, p2: 0.0002 };
    assert_eq!(camera.distortion, expected);
    assert!(survey.issues.iter().any(|issue| issue.message.contains("focal length")), "{:?}", survey.issues);
}

#[test]
fn heights_by_rtk_without_a_fix_are_told_to_be_assumed() {
    let folder = tempfile::tempdir().unwrap();
    let tags = |flag: u32| {
        format!(
            "drone-dji:GpsLatitude=\"+52.1\" drone-dji:GpsLongitude=\"+9.2\" drone-dji:AbsoluteAltitude=\"+120\" \
             drone-dji:GimbalYawDegree=\"0\" drone-dji:GimbalPitchDegree=\"-90\" drone-dji:GimbalRollDegree=\"0\" \
             drone-dji:CalibratedFocalLength=\"3600\" drone-dji:AltitudeType=\"RtkAlt\" drone-dji:RtkFlag=\"{flag}\""
        )
    };
    photo(&folder.path().join("fixed.jpg"), &tags(50), 5280, 3956);
    let told = |reference: Option<VerticalDatum>| {
        let height = HeightConfig { reference, ..keep_ellipsoidal() };
        let survey = survey::read(&SurveyConfig { height, ..SurveyConfig::at(folder.path()) }, &utm()).unwrap();
        let about =
            |code: &str| survey.issues.iter().find(|issue| issue.code == code).map(|issue| issue.message.clone());
        about("height_reference_assumed")
    };
    assert_eq!(told(None), None);
    photo(&folder.path().join("single.jpg"), &tags(16), 5280, 3956);
    let message = told(None).unwrap();
    assert!(message.starts_with("1 of 2 photos have AltitudeType RtkAlt without an RTK fix"), "{message}");
    assert_eq!(told(Some(VerticalDatum::Project)), None);
}

#[test]
fn photos_of_other_drones_than_djis_have_poses_by_pix4ds_tags() {
    let folder = tempfile::tempdir().unwrap();
    let (geodetic, _) = geodetic();
    let wgs84 = Crs::parse("EPSG:4326").unwrap();
    let north = Transform::new(&wgs84, &utm()).unwrap().north_at(geodetic.x, geodetic.y).unwrap();
    let yaw = 30.0 - north.azimuth_rad.to_degrees();
    let place = format!(
        "drone-x:GpsLatitude=\"{}\" drone-x:GpsLongitude=\"{}\" drone-x:AbsoluteAltitude=\"{}\"",
        geodetic.y, geodetic.x, geodetic.z
    );
    let camera_tags = |pitch: f64| format!("{place} Camera:Yaw=\"{yaw}\" Camera:Pitch=\"{pitch}\" Camera:Roll=\"0\"");
    photo(&folder.path().join("down.jpg"), &camera_tags(0.0), 4000, 3000);
    photo(&folder.path().join("oblique.jpg"), &camera_tags(45.0), 4000, 3000);
    photo(&folder.path().join("sideways.jpg"), &format!("{place} FLIR:MAVYaw=\"1\""), 4000, 3000);
    let config = SurveyConfig { height: keep_ellipsoidal(), camera: Some(camera()), ..SurveyConfig::at(folder.path()) };
    let survey = survey::read(&config, &utm()).unwrap();
    let names: Vec<&str> = survey.views.iter().map(|view| view.id.0.as_str()).collect();
    assert_eq!(names, ["down.jpg", "oblique.jpg"], "{:?}", survey.issues);
    for (view, off_nadir_deg) in survey.views.iter().zip([0.0, 45.0]) {
        // The top of the photo points 30° east of grid north, and so does the axis where the photo is oblique.
        let up = -view.camera_from_map.rotation.row(1);
        let heading_deg = up.x.atan2(up.y).to_degrees();
        assert!(
            (heading_deg - 30.0).abs() < 1e-6 && (view.off_nadir_deg() - off_nadir_deg).abs() < 1e-6,
            "{heading_deg}"
        );
        assert!((view.centre() - CENTRE).length() < 1e-3);
    }
    let codes: Vec<&str> = survey.issues.iter().map(|issue| issue.code.as_str()).collect();
    assert!(codes.contains(&"view_directions"), "{codes:?}");
    // Remarks are no poses.
    let (_, report) = survey::inspect(&config, &utm(), Site::default()).unwrap();
    assert_eq!((report.n_poses, report.n_views), (3, 2));
    let refused = survey.issues.iter().find(|issue| issue.code == "photo_without_pose").unwrap();
    assert!(refused.message.contains("it has FLIR:MAVYaw"), "{refused:?}");
}

#[test]
fn photos_of_a_flight_that_was_too_fast_for_its_shutter_are_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let tags = |speed: f64, shutter: &str| {
        format!(
            "drone-dji:GpsLatitude=\"+52.1\" drone-dji:GpsLongitude=\"+9.2\" drone-dji:AbsoluteAltitude=\"+120\" \
             drone-dji:RelativeAltitude=\"+100\" drone-dji:GimbalYawDegree=\"0\" drone-dji:GimbalPitchDegree=\"-90\" \
             drone-dji:GimbalRollDegree=\"0\" drone-dji:RtkFlag=\"50\" drone-dji:CalibratedFocalLength=\"3600\" \
             drone-dji:FlightXSpeed=\"+{speed}\" drone-dji:FlightYSpeed=\"-{}\" drone-dji:FlightZSpeed=\"0.0\" \
             drone-dji:ShutterType=\"{shutter}\"",
            0.75 * speed
        )
    };
    // 15 m/s for 1/125 s at 36 pixels a metre: 4.3 pixels.
    let exposed = |name: &str, tags: &str| {
        let path = folder.path().join(name);
        photo(&path, tags, 5280, 3956);
        let bytes = fs::read(&path).unwrap();
        let ifd = |n: u8| [&[n, 0][..]].concat();
        let exif = [
            &b"Exif\0\0II\x2A\0\x08\0\0\0"[..],
            &ifd(1),
            &entry(0x8769, 4, 1, 26_u32.to_le_bytes()),
            &[0; 4],
            &ifd(1),
            &entry(0x829A, 5, 1, 44_u32.to_le_bytes()),
            &[0; 4],
            &1_u32.to_le_bytes(),
            &125_u32.to_le_bytes(),
        ]
        .concat();
        let length = u16::try_from(exif.len() + 2).unwrap().to_be_bytes();
        fs::write(&path, [&bytes[..2], &[0xFF, 0xE1], &length, &exif, &bytes[2..]].concat()).unwrap();
    };
    let told = || {
        let config = SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(folder.path()) };
        let issues = survey::read(&config, &utm()).unwrap().issues;
        let about_motion = issues.into_iter().filter(|i| ["motion_blur", "rolling_shutter"].contains(&i.code.as_str()));
        about_motion.map(|issue| (issue.code, issue.message)).collect::<Vec<_>>()
    };
    exposed("hovering.jpg", &tags(0.1, "Mechanical"));
    photo(&folder.path().join("untimed.jpg"), &tags(12.0, "Mechanical"), 5280, 3956);
    exposed("mechanical.jpg", &tags(12.0, "Mechanical"));
    let one = told();
    assert_eq!(one.len(), 1, "{one:?}");
    assert!(one[0].1.contains("1 of 3 photos") && one[0].1.contains("4.3 at most"), "{one:?}");
    exposed("electronic.jpg", &tags(12.0, "Electronic"));
    let both = told();
    assert_eq!(both.iter().map(|(code, _)| code.as_str()).collect::<Vec<_>>(), ["motion_blur", "rolling_shutter"]);
    assert!(both[1].1.contains("1 of 4 photos") && both[1].1.contains("15.0 m/s"), "{both:?}");
}

/// One entry of a TIFF directory, little-endian.
fn entry(tag: u16, kind: u16, n: usize, value: [u8; 4]) -> Vec<u8> {
    [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &u32::try_from(n).unwrap().to_le_bytes(), &value].concat()
}

/// A JPEG of a camera's make, a place, a height and a maker note, without XMP.
fn photo_with_maker_note(make: [u8; 4], geodetic: DVec3, note: &[u8]) -> Vec<u8> {
    const EXIF_AT: usize = 8 + 2 + 3 * 12 + 4;
    const GPS_AT: usize = EXIF_AT + 2 + 12 + 4;
    const DATA_AT: usize = GPS_AT + 2 + 5 * 12 + 4;
    let at = |offset: usize| u32::try_from(offset).unwrap().to_le_bytes();
    // Degrees over 10^7, no minutes and seconds.
    let angle = |degrees: f64| {
        let numbers = [(degrees.abs() * 1e7).round() as u32, 10_000_000, 0, 1, 0, 1];
        numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>()
    };
    let height = [(geodetic.z * 1e3).round() as u32, 1000].iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    let data = [angle(geodetic.y), angle(geodetic.x), height, note.to_vec()];
    let place_of = |i: usize| at(DATA_AT + data[..i].iter().map(Vec::len).sum::<usize>());
    let directories = [
        vec![entry(0x010F, 2, 4, make), entry(0x8769, 4, 1, at(EXIF_AT)), entry(0x8825, 4, 1, at(GPS_AT))],
        vec![entry(0x927C, 7, note.len(), place_of(3))],
        vec![
            entry(1, 2, 2, *b"N\0\0\0"),
            entry(2, 5, 3, place_of(0)),
            entry(3, 2, 2, *b"E\0\0\0"),
            entry(4, 5, 3, place_of(1)),
            entry(6, 5, 1, place_of(2)),
        ],
    ];
    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    for directory in directories {
        tiff.extend(u16::try_from(directory.len()).unwrap().to_le_bytes());
        tiff.extend(directory.concat());
        tiff.extend([0; 4]);
    }
    assert_eq!(tiff.len(), DATA_AT);
    let segment = [b"Exif\0\0".to_vec(), tiff, data.concat()].concat();
    let length = u16::try_from(segment.len() + 2).unwrap().to_be_bytes();
    [
        &[0xFF, 0xD8, 0xFF, 0xE1][..],
        &length,
        &segment,
        &[0xFF, 0xC0, 0, 11, 8, 11, 184, 15, 160, 1, 0, 0, 0, 0xFF, 0xD9],
    ]
    .concat()
}

#[test]
fn drone_photos_without_xmp_are_read_by_their_maker_notes_and_others_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let (geodetic, _) = geodetic();
    let wgs84 = Crs::parse("EPSG:4326").unwrap();
    let north = Transform::new(&wgs84, &utm()).unwrap().north_at(geodetic.x, geodetic.y).unwrap();
    let yaw = 30.0 - north.azimuth_rad.to_degrees();
    // Tags 9 to 11, and the aircraft's own angles before them, as floats.
    let note = |is_little: bool| -> Vec<u8> {
        let angles = [(6, 3.0), (7, 77.0), (8, -2.0), (9, -45.0), (10, yaw), (11, 5.0)];
        let order = |mut bytes: Vec<u8>| {
            if !is_little {
                bytes.reverse();
            }
            bytes
        };
        let entry = |(tag, angle): (u16, f64)| {
            let fields = [tag.to_le_bytes().to_vec(), 11_u16.to_le_bytes().to_vec(), 1_u32.to_le_bytes().to_vec()];
            fields.into_iter().chain([(angle as f32).to_le_bytes().to_vec()]).flat_map(order).collect::<Vec<u8>>()
        };
        order(6_u16.to_le_bytes().to_vec())
            .into_iter()
            .chain(angles.into_iter().flat_map(entry))
            .chain([0; 4])
            .collect()
    };
    let write = |name: &str, photo: Vec<u8>| fs::write(folder.path().join(name), photo).unwrap();
    write("little.jpg", photo_with_maker_note(*b"DJI\0", geodetic, &note(true)));
    write("big.jpg", photo_with_maker_note(*b"DJI\0", geodetic, &note(false)));
    write("other_make.jpg", photo_with_maker_note(*b"FLY\0", geodetic, &note(true)));
    write("other_note.jpg", photo_with_maker_note(*b"DJI\0", geodetic, b"[ae_dbg_info:abcdefghijklmnop]"));
    write("short.jpg", photo_with_maker_note(*b"DJI\0", geodetic, &note(true)[..40]));
    let config = SurveyConfig { height: keep_ellipsoidal(), camera: Some(camera()), ..SurveyConfig::at(folder.path()) };
    let survey = survey::read(&config, &utm()).unwrap();
    let names: Vec<&str> = survey.views.iter().map(|view| view.id.0.as_str()).collect();
    assert_eq!(names, ["big.jpg", "little.jpg"], "{:?}", survey.issues);
    for view in &survey.views {
        // Angles have two digits behind the point: 0.005 degrees.
        let off = (view.camera_from_map.rotation - golden_rotation()).to_cols_array();
        assert!(off.iter().all(|off| off.abs() < 1e-4), "{}: {off:?}", view.id);
        assert!((view.centre() - CENTRE).length() < 0.02, "{}", view.centre());
    }
    let refused: Vec<_> = survey.issues.iter().filter(|issue| issue.code == "photo_without_pose").collect();
    assert_eq!(refused.len(), 3, "{:?}", survey.issues);
    assert!(refused.iter().all(|issue| issue.message.contains("lack GimbalYawDegree")), "{refused:?}");
}

#[test]
fn misspelt_options_are_refused_and_the_schema_documents_each() {
    let refused = toml::from_str::<SurveyConfig>("path = \"x\"\nformt = \"csv\"").unwrap_err().to_string();
    assert!(refused.contains("formt"), "{refused}");
    let schema = serde_json::to_value(schemars::schema_for!(SurveyConfig)).unwrap();
    for (name, property) in schema["properties"].as_object().unwrap() {
        let text = property.to_string();
        assert!(text.contains("description") || text.contains("$ref"), "{name} has no description");
    }
}

#[test]
fn every_lens_survives_the_formats_that_can_express_it() {
    let lenses = [
        Distortion::None,
        Distortion::Brown { k1: -0.1, k2: 0.01, k3: 0.0, p1: 1e-4, p2: 2e-4 },
        Distortion::Brown { k1: -0.1, k2: 0.01, k3: 0.003, p1: 1e-4, p2: 2e-4 },
        Distortion::BrownAffine { k1: -0.1, k2: 0.01, k3: 0.003, k4: 1e-4, p1: 1e-4, p2: 2e-4, skew: 1e-5 },
        Distortion::Rational { k1: 0.1, k2: 0.2, k3: 0.3, k4: 0.11, k5: 0.22, k6: 0.33, p1: 1e-4, p2: 2e-4 },
        Distortion::Fisheye { k1: 0.01, k2: 0.02, k3: 0.03, k4: 0.04 },
    ];
    let views: Vec<View> = lenses
        .into_iter()
        .enumerate()
        .map(|(i, distortion)| View {
            id: sizeup::ids::ViewId(format!("{i}.jpg")),
            camera: std::sync::Arc::new(sizeup::camera::Camera {
                distortion,
                ..sizeup::camera::Camera::pinhole(4000, 3000, 3000.0 + i as f64 / 3.0)
            }),
            camera_from_map: sizeup::frames::Rigid::from_rotation_and_centre(
                glam::DMat3::from_quat(glam::DQuat::from_mat3(&golden_rotation()).normalize()),
                CENTRE + DVec3::X * i as f64 / 7.0,
            ),
            image: None,
        })
        .collect();
    let survey = Survey { views, issues: Vec::new() };
    let folder = tempfile::tempdir().unwrap();
    let terrain = sizeup::terrain::Terrain::Constant(0.0);
    for (target, name, settings, n_refused) in [
        (survey::Target::Csv, "poses.csv", "poses.survey.toml", 0),
        (survey::Target::Colmap, "model", "model/survey.toml", 1),
    ] {
        let written = survey::write(&survey, &utm(), &terrain, target, &folder.path().join(name)).unwrap();
        assert_eq!(written.issues.len(), n_refused, "{:?}", written.issues);
        let settings = folder.path().join(settings);
        let mut config: SurveyConfig = toml::from_str(&fs::read_to_string(&settings).unwrap()).unwrap();
        config.visit_paths(&mut |path| *path = settings.parent().unwrap().join(&*path));
        let back = survey::read(&config, &utm()).unwrap();
        assert_eq!(back.views.len(), survey.views.len() - n_refused);
        for view in &back.views {
            let original = survey.views.iter().find(|original| original.id == view.id).unwrap();
            assert_eq!(view.camera, original.camera);
            let off_m = (view.camera_from_map.centre() - original.camera_from_map.centre()).length();
            // Half a unit in the last place of a northing is 5e-10 m.
            assert!(off_m < 3e-9, "{name} {}: {off_m}", view.id);
        }
    }
}
