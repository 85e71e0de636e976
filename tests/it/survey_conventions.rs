//! The less usual sentences of the formats' specifications, one by one: other angle sequences and units, all camera
//! axes, frames of blocks and chunks, drone metadata, every lens model of COLMAP.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use glam::{DMat3, DVec3};
use sizeup::camera::Distortion;
use sizeup::crs::{Crs, Geocentric, Transform};
use sizeup::survey::angles::{AngleConvention, AngleKind, AngleUnit, Direction, Sequence};
use sizeup::survey::{self, CameraConfig, Format, HeightConfig, Site, Survey, SurveyConfig, SurveyError};

use super::survey_formats::{ROWS, blocks_exchange, matrix_elements, photo};

fn utm() -> Crs {
    Crs::parse("EPSG:25832").unwrap()
}

fn keep_ellipsoidal() -> HeightConfig {
    HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() }
}

fn read(path: &Path) -> Result<Survey, SurveyError> {
    survey::read(&SurveyConfig { height: keep_ellipsoidal(), ..SurveyConfig::at(path) }, &utm())
}

fn write(folder: &Path, name: &str, text: &str) -> std::path::PathBuf {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, text).unwrap();
    path
}

fn off(a: DMat3, b: DMat3) -> f64 {
    (a - b).to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max)
}

/// `Rx`, `Ry`, `Rz` written out, angles in degrees.
fn elementary(axis: char, degrees: f64) -> DMat3 {
    let (s, c) = degrees.to_radians().sin_cos();
    let rows = match axis {
        'x' => [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]],
        'y' => [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
        _ => [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]],
    };
    DMat3::from_cols_array_2d(&rows).transpose()
}

#[test]
fn every_sequence_and_direction_is_the_product_it_names() {
    let (omega, phi, kappa) = (11.0, -23.0, 47.0);
    let y_up = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    for sequence in Sequence::ALL {
        let name = format!("{sequence:?}").to_lowercase();
        let angle = |axis: char| match axis {
            'x' => omega,
            'y' => phi,
            _ => kappa,
        };
        let product = name.chars().fold(DMat3::IDENTITY, |product, axis| product * elementary(axis, angle(axis)));
        for (direction, camera_from_world) in
            [(Direction::CameraToWorld, product.transpose()), (Direction::WorldToCamera, product)]
        {
            let convention =
                AngleConvention { sequence: Some(sequence), direction: Some(direction), ..AngleConvention::default() };
            let found = convention.camera_from_world(&[omega, phi, kappa]).unwrap();
            assert!(off(found, y_up * camera_from_world) < 1e-12, "{name} {direction:?}");
        }
    }
    // Phi first is the sequence yxz.
    let pok = AngleConvention { angles: AngleKind::Pok, ..AngleConvention::default() };
    let product = elementary('y', phi) * elementary('x', omega) * elementary('z', kappa);
    assert!(off(pok.camera_from_world(&[omega, phi, kappa]).unwrap(), y_up * product.transpose()) < 1e-12);
}

#[test]
fn gon_and_radians_are_the_same_angles() {
    let with = |unit, values: [f64; 3]| {
        AngleConvention { unit, ..AngleConvention::default() }.camera_from_world(&values).unwrap()
    };
    let degrees = [9.0, -18.0, 45.0];
    let expected = with(AngleUnit::Deg, degrees);
    assert!(off(with(AngleUnit::Gon, [10.0, -20.0, 50.0]), expected) < 1e-12);
    assert!(off(with(AngleUnit::Rad, degrees.map(f64::to_radians)), expected) < 1e-12);
}

#[test]
fn all_eight_camera_orientations_of_a_block_are_one_camera() {
    let folder = tempfile::tempdir().unwrap();
    let [x, y, _] = ROWS.map(DVec3::from_array);
    let towards = |word: &str| match word {
        "Right" => x,
        "Left" => -x,
        "Down" => y,
        _ => -y,
    };
    for name in
        ["XRightYDown", "XRightYUp", "XLeftYDown", "XLeftYUp", "XDownYRight", "XDownYLeft", "XUpYLeft", "XUpYRight"]
    {
        let (first, second) = name[1..].split_once('Y').unwrap();
        let (first, second) = (towards(first), towards(second));
        let rows = [first, second, first.cross(second)].map(|row| row.to_array());
        let path = write(folder.path(), "block.xml", &blocks_exchange(name, &matrix_elements(rows)));
        let view = &read(&path).unwrap().views[0];
        let expected = DMat3::from_cols_array_2d(&ROWS).transpose();
        assert!(off(view.camera_from_map.rotation, expected) < 4e-6, "{name}");
    }
}

#[test]
fn a_block_in_a_local_tangent_plane_lies_where_its_origin_is() {
    let folder = tempfile::tempdir().unwrap();
    let nadir = matrix_elements([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]);
    let text = blocks_exchange("XRightYDown", &nadir).replace(">EPSG:25832<", ">ENU:52.0,9.0<");
    // 300 m east, 400 m north and 120 m above the origin, which lies on the central meridian.
    let centre = |axis: &str, value: f64| format!("<{axis}>{value}</{axis}>");
    let start = text.find("<Center>").unwrap() + "<Center>".len();
    let end = text.find("</Center>").unwrap();
    let centre = [centre("x", 300.0), centre("y", 400.0), centre("z", 120.0)].concat();
    let text = format!("{}{centre}{}", &text[..start], &text[end..]);
    let view = &read(&write(folder.path(), "block.xml", &text)).unwrap().views[0];
    let origin = Transform::new(&Crs::parse("EPSG:4326").unwrap(), &utm()).unwrap().point(9.0, 52.0).unwrap();
    // UTM shrinks by 0.9996 on its central meridian: 12 cm over 300 m, 16 cm over 400 m.
    let expected = DVec3::new(origin.0 + 0.9996 * 300.0, origin.1 + 0.9996 * 400.0, 120.0);
    // The earth falls 2 cm below a tangent plane 500 m from where it touches.
    assert!((view.centre() - expected).length() < 0.03, "{} against {expected}", view.centre());
    assert!(view.off_nadir_deg() < 0.01, "verticals 500 m apart differ by 0.005°");
}

#[test]
fn a_chunks_component_goes_before_the_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let (lon, lat, height) = (9.0, 52.0, 150.0);
    let ecef = Geocentric::new().unwrap().geocentric(DVec3::new(lon, lat, height)).unwrap();
    let xml = format!(
        r#"<document version="2.0.0"><chunk><sensors><sensor id="0" type="frame"><resolution width="40" height="30"/>
        <calibration class="adjusted"><resolution width="40" height="30"/><f>30</f></calibration></sensor></sensors>
        <components><component id="7"><transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>{} {} {}
        </translation><scale>2</scale></transform></component></components><cameras>
        <camera id="0" sensor_id="0" component_id="7" label="a"><transform>{} 0 0 0 0 1</transform></camera></cameras>
        <transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>1 2 3</translation><scale>9</scale></transform>
        <reference>GEOGCS["WGS 84"]</reference></chunk></document>"#,
        ecef.x,
        ecef.y,
        ecef.z,
        {
            // Looking down at the place: columns are the camera's axes in earth-centred coordinates.
            let (lon, lat) = (9.0_f64.to_radians(), 52.0_f64.to_radians());
            let east = DVec3::new(-lon.sin(), lon.cos(), 0.0);
            let up = DVec3::new(lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin());
            let south = -up.cross(east);
            let rows: Vec<String> = (0..3).map(|i| format!("{} {} {} 0", east[i], south[i], -up[i])).collect();
            rows.join(" ")
        }
        .trim_end_matches(" 0")
    );
    let view = &read(&write(folder.path(), "cameras.xml", &xml)).unwrap().views[0];
    assert!((view.centre().z - 150.0).abs() < 1e-3 && view.off_nadir_deg() < 1e-4, "{view:?}");
    assert!((view.centre().x - 500_000.0).abs() < 1e-3, "9° E is zone 32's central meridian");
}

#[test]
fn pix4ds_projection_file_names_the_crs() {
    let folder = tempfile::tempdir().unwrap();
    let image = "a.jpg 40 30\n30 0 20\n0 30 15\n0 0 1\n0 0 0\n0 0\n500000 5700000 100\n1 0 0\n0 -1 0\n0 0 -1\n";
    let path = write(folder.path(), "p_calibrated_camera_parameters.txt", &format!("{}{image}", "h\n".repeat(8)));
    write(folder.path(), "p_wkt.prj", &wkt1_of_zone_33());
    let survey = read(&path).unwrap();
    let expected = Transform::new(&Crs::parse("EPSG:32633").unwrap(), &utm()).unwrap().point(500_000.0, 5_700_000.0);
    let (easting, northing) = expected.unwrap();
    let centre = survey.views[0].centre();
    assert!((centre.x - easting).abs() < 1e-3 && (centre.y - northing).abs() < 1e-3, "{centre}");
}

/// As Esri's software writes a `.prj`: WKT 1 without authorities.
fn wkt1_of_zone_33() -> String {
    r#"PROJCS["WGS_1984_UTM_Zone_33N",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,
    298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],
    PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",15.0],
    PARAMETER["Scale_Factor",0.9996],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]"#
        .replace("\n    ", "")
}

#[test]
fn opensfms_reference_may_stand_in_a_file_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let json = r#"[{"cameras":{"c":{"projection_type":"simple_radial","width":40,"height":30,"focal_x":0.75,"k1":0.1}},
        "shots":{"a.jpg":{"rotation":[3.141592653589793,0,0],"translation":[0,0,100],"camera":"c"}}}]"#;
    let path = write(folder.path(), "reconstruction.json", json);
    write(folder.path(), "reference_lla.json", r#"{"latitude":52.0,"longitude":9.0,"altitude":40.0}"#);
    let view = &read(&path).unwrap().views[0];
    assert!((view.centre() - DVec3::new(500_000.0, view.centre().y, 140.0)).length() < 1e-3, "{}", view.centre());
    // Normalised by the larger side about the middle; pixel centres at halves.
    assert_eq!((view.camera.fx_px, view.camera.cx_px, view.camera.cy_px), (30.0, 20.0, 15.0));
}

#[test]
fn every_state_of_positioning_is_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let tags = |flag: u32| {
        format!(
            "drone-dji:GpsLatitude=\"+52\" drone-dji:GpsLongitude=\"+9\" drone-dji:AbsoluteAltitude=\"+150\" \
             drone-dji:GimbalYawDegree=\"1\" drone-dji:GimbalPitchDegree=\"-60\" drone-dji:GimbalRollDegree=\"0\" \
             drone-dji:RtkFlag=\"{flag}\" drone-dji:CalibratedFocalLength=\"3700.5\" \
             drone-dji:CalibratedOpticalCenterX=\"2650\" drone-dji:CalibratedOpticalCenterY=\"1970\""
        )
    };
    for (i, flag) in [0, 16, 32, 34, 49, 50].into_iter().enumerate() {
        photo(&folder.path().join(format!("{i}.jpg")), &tags(flag), 5280, 3956);
    }
    let dewarped = format!(
        "{} drone-dji:DewarpFlag=\"1\" drone-dji:DewarpData=\"2020-01-01;3700,3701,12,-8,-0.1,0.02,1e-4,2e-4,-3e-3\"",
        tags(50)
    );
    photo(&folder.path().join("dewarped.jpg"), &dewarped, 5280, 3956);
    let config = SurveyConfig { format: Format::Photos, height: keep_ellipsoidal(), ..SurveyConfig::at(folder.path()) };
    let (survey, report) = survey::inspect(&config, &utm(), Site::default()).unwrap();
    let counts: Vec<(&str, usize)> = report.rtk.iter().map(|(state, n)| (state.as_str(), *n)).collect();
    assert_eq!(counts, [("fixed", 2), ("float", 3), ("none", 1), ("single", 1)]);
    let sources: Vec<(&str, usize)> = report.focal.iter().map(|(source, n)| (source.as_str(), *n)).collect();
    assert_eq!(sources, [("CalibratedFocalLength", 6), ("DewarpData", 1)], "what tells more goes first");
    let camera = |name: &str| survey.views.iter().find(|view| view.id.0 == name).unwrap().camera.clone();
    assert_eq!((camera("0.jpg").fx_px, camera("0.jpg").cx_px), (3700.5, 2650.0));
    // The camera has taken its distortion out already.
    assert_eq!((camera("dewarped.jpg").fx_px, &camera("dewarped.jpg").distortion), (3700.0, &Distortion::None));
}

#[test]
fn one_photo_is_a_survey_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let tags = "drone-dji:GpsLatitude=\"+52\" drone-dji:GpsLongitude=\"+9\" drone-dji:AbsoluteAltitude=\"+150\" \
        drone-dji:GimbalYawDegree=\"1\" drone-dji:GimbalPitchDegree=\"-60\" drone-dji:GimbalRollDegree=\"0\" \
        drone-dji:CalibratedFocalLength=\"3700\"";
    for name in ["a.jpg", "b.jpg"] {
        photo(&folder.path().join(name), tags, 5280, 3956);
    }
    let path = folder.path().join("a.jpg");
    let config = SurveyConfig { format: Format::Photos, height: keep_ellipsoidal(), ..SurveyConfig::at(&path) };
    let survey = survey::read(&config, &utm()).unwrap();
    assert_eq!(survey.views[0].image.as_deref(), Some(path.as_path()));
    assert!(survey.issues.iter().all(|issue| issue.code != "photo_without_pose"), "{:?}", survey.issues);
}

/// COLMAP's models by number: name, parameters after the focal lengths and principal point, whether we have it.
const COLMAP_MODELS: [(&str, usize, bool); 18] = [
    ("SIMPLE_PINHOLE", 3, true),
    ("PINHOLE", 4, true),
    ("SIMPLE_RADIAL", 4, true),
    ("RADIAL", 5, true),
    ("OPENCV", 8, true),
    ("OPENCV_FISHEYE", 8, true),
    ("FULL_OPENCV", 12, true),
    ("FOV", 5, false),
    ("SIMPLE_RADIAL_FISHEYE", 4, true),
    ("RADIAL_FISHEYE", 5, true),
    ("THIN_PRISM_FISHEYE", 12, false),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16, false),
    ("SIMPLE_DIVISION", 4, false),
    ("DIVISION", 5, false),
    ("SIMPLE_FISHEYE", 3, true),
    ("FISHEYE", 4, true),
    ("EUCM", 6, false),
    ("EQUIRECTANGULAR", 2, false),
];

#[test]
fn every_lens_model_of_colmap_is_read_or_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut cameras = 18_u64.to_le_bytes().to_vec();
    let mut images = 18_u64.to_le_bytes().to_vec();
    for (i, (name, n_params, _)) in COLMAP_MODELS.into_iter().enumerate() {
        let id = u32::try_from(i).unwrap();
        cameras.extend([id.to_le_bytes(), id.to_le_bytes()].concat());
        cameras.extend([400_u64.to_le_bytes(), 300_u64.to_le_bytes()].concat());
        let has_one_focal = name.starts_with("SIMPLE") || name.starts_with("RADIAL");
        let lens = if has_one_focal { vec![350.0, 200.0, 150.0] } else { vec![350.0, 350.0, 200.0, 150.0] };
        let params = lens.into_iter().chain(std::iter::repeat(0.0)).take(n_params);
        cameras.extend(params.flat_map(f64::to_le_bytes));
        images.extend(id.to_le_bytes());
        let pose: [f64; 7] = [0.0, 1.0, 0.0, 0.0, -5e5, 57e5, 100.0];
        images.extend(pose.into_iter().flat_map(f64::to_le_bytes));
        images.extend(id.to_le_bytes());
        images.extend(format!("{name}\0").bytes());
        images.extend(0_u64.to_le_bytes());
    }
    fs::write(folder.path().join("cameras.bin"), cameras).unwrap();
    fs::write(folder.path().join("images.bin"), images).unwrap();
    let survey = read(folder.path()).unwrap();
    for (name, _, is_known) in COLMAP_MODELS {
        let view = survey.views.iter().find(|view| view.id.0 == name);
        assert_eq!(view.is_some(), is_known, "{name}");
        if let Some(view) = view {
            // Without distortion, pinholes see 0.3 off the axis at 105 px and fisheyes at its angle.
            let radius_px = if name.contains("FISHEYE") { 350.0 * 0.3_f64.atan() } else { 350.0 * 0.3 };
            let pixel = view.camera.project(DVec3::new(0.3, 0.0, 1.0)).unwrap();
            assert!((pixel.x - 200.0 - radius_px).abs() < 1e-9 && pixel.y == 150.0, "{name}: {pixel}");
        } else {
            let named = survey.issues.iter().any(|issue| issue.message.contains(&format!("{name} is not supported")));
            assert!(named, "{name}: {:?}", survey.issues);
        }
    }
}

/// Ten views straight down on a row, 100 m up over a ground of 80 m.
fn row(folder: &Path, origin: (f64, f64), z: f64) -> SurveyConfig {
    let mut text = "name,x,y,z,omega,phi,kappa\n".to_owned();
    for i in 0..10 {
        writeln!(text, "{i}.jpg,{},{},{z},0,0,0", origin.0 + 10.0 * f64::from(i), origin.1).unwrap();
    }
    let camera =
        CameraConfig { width: 400, height: 300, fx: 300.0, fy: None, cx: None, cy: None, k: [0.0; 3], p: [0.0; 2] };
    SurveyConfig { camera: Some(camera), ..SurveyConfig::at(write(folder, "poses.csv", &text)) }
}

#[test]
fn a_survey_in_the_neighbouring_zone_names_that_zone() {
    let folder = tempfile::tempdir().unwrap();
    let zone_33 = Transform::new(&utm(), &Crs::parse("EPSG:25833").unwrap()).unwrap();
    let there = zone_33.point(690_000.0, 5_763_000.0).unwrap();
    let config = row(folder.path(), there, 180.0);
    let area = geo::Rect::new((689_500.0, 5_762_500.0), (690_500.0, 5_763_500.0)).to_polygon();
    let terrain = sizeup::terrain::Terrain::Constant(80.0);
    let site = Site { terrain: Some(&terrain), area: Some(&area) };
    let (_, report) = survey::inspect(&config, &utm(), site).unwrap();
    assert!(!report.is_sound());
    assert_eq!(report.trials[0].change, "crs = \"EPSG:25833\"", "{report}");
    assert_eq!(report.trials[0].sees_area, Some(1.0));
}

#[test]
fn positions_far_from_where_the_crs_is_used_are_wrong() {
    let folder = tempfile::tempdir().unwrap();
    // Northing left out: somewhere on the equator.
    let config = row(folder.path(), (690_000.0, 63_000.0), 180.0);
    let (_, report) = survey::inspect(&config, &utm(), Site::default()).unwrap();
    assert!(!report.is_sound() && report.findings[0].contains("EPSG:25832"), "{report}");
    // Local positions in a CRS of world-wide use cannot be refused, but are told.
    let config = row(folder.path(), (120.0, 340.0), 180.0);
    let (_, report) = survey::inspect(&config, &utm(), Site::default()).unwrap();
    assert!(report.findings.iter().chain(&report.notes).any(|told| told.contains("look local")), "{report}");
}

#[test]
fn heights_in_feet_are_converted_where_their_unit_is_stated_and_asked_for_where_not() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = row(folder.path(), (980_000.0, 200_000.0), 1000.0);
    let z = |config: &SurveyConfig, project: &str| {
        let survey = survey::read(config, &Crs::parse(project).unwrap())?;
        Ok::<f64, sizeup::survey::SurveyError>(survey.views[0].centre().z)
    };
    // New York in US survey feet: a table may count its heights in anything.
    config.crs = Some(Crs::parse("EPSG:2263").unwrap());
    let asked = z(&config, "EPSG:26918").unwrap_err().to_string();
    assert!(asked.contains("EPSG:2263 counts positions in feet") && asked.contains("EPSG:2263+6360"), "{asked}");
    // A US survey foot is 1200/3937 m, whether or not the project names a vertical system.
    config.crs = Some(Crs::parse("EPSG:2263+6360").unwrap());
    for project in ["EPSG:26918+5703", "EPSG:26918", "EPSG:32118"] {
        let z_m = z(&config, project).unwrap();
        assert!((z_m - 1000.0 * 1200.0 / 3937.0).abs() < 1e-6, "{project}: {z_m}");
    }
    config.crs = Some(Crs::parse("EPSG:2263+5703").unwrap());
    assert_eq!(z(&config, "EPSG:32118").unwrap(), 1000.0);
}

#[test]
fn a_colmap_world_in_feet_has_one_scale() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cameras.txt"), "1 PINHOLE 400 300 300 300 200 150\n").unwrap();
    // Straight down from 300 feet: C = −Rᵀ t.
    fs::write(folder.path().join("images.txt"), "1 0 1 0 0 0 0 300 1 a.jpg\n\n").unwrap();
    let config = SurveyConfig {
        crs: Some(Crs::parse("EPSG:2263").unwrap()),
        offset: [984_250.0, 213_254.166_666_666_7, 0.0],
        ..SurveyConfig::at(folder.path())
    };
    let (survey, report) = survey::inspect(&config, &Crs::parse("EPSG:32118").unwrap(), Site::default()).unwrap();
    let z_m = survey.views[0].centre().z;
    assert!((z_m - 300.0 * 1200.0 / 3937.0).abs() < 1e-9, "{z_m}");
    assert!(report.heights.contains("converted to metres from units of 0.304800610 m"), "{}", report.heights);
}

#[test]
fn heights_above_take_off_are_recognised_by_the_ground() {
    let folder = tempfile::tempdir().unwrap();
    let config = row(folder.path(), (690_000.0, 5_763_000.0), 100.0);
    let terrain = sizeup::terrain::Terrain::Constant(240.0);
    let (_, report) = survey::inspect(&config, &utm(), Site { terrain: Some(&terrain), area: None }).unwrap();
    assert!(!report.is_sound());
    let trial = &report.trials[0];
    assert_eq!(trial.change, "height.reference = \"above_takeoff\", height.base = 240", "{report}");
    assert_eq!(trial.above_ground, Some(1.0));
}
