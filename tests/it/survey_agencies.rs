//! Pose formats of mapping agencies and drones, against numbers that were worked out elsewhere: published items whose ground
//! polygons are known, and pixels from the collinearity equations of ω, φ, κ, computed once outside of the program.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use sizeup::crs::{Crs, Transform};
use sizeup::survey::{self, Format, HeightConfig, Survey, SurveyConfig, View};

use super::survey_formats::photo;

/// The projection centre of the pixels below.
const CENTRE: DVec3 = DVec3::new(699_200.25, 5_764_400.5, 210.125);
/// A point on the ground below it.
const GROUND: DVec3 = DVec3::new(699_290.0, 5_764_580.0, 12.0);
/// `(Rx(ω) Ry(φ) Rz(κ))ᵀ` of ω 40.8934°, φ −20.7048°, κ −27.2077°.
const MATRIX: &str = "0.8319154268 -0.5514694645 -0.0616291514\n   0.4276877953 0.5664638507 0.7044159678\n   \
                      -0.3535532101 -0.6123725464 0.7071067756";

fn utm() -> Crs {
    Crs::parse("EPSG:25832").unwrap()
}

fn read(path: &Path) -> Survey {
    survey::read(&SurveyConfig::at(path), &utm()).unwrap()
}

fn error(path: &Path) -> String {
    survey::read(&SurveyConfig::at(path), &utm()).unwrap_err().to_string()
}

fn pixel(view: &View, point_in_map: DVec3) -> DVec2 {
    view.camera.project(view.camera_from_map.point(point_in_map)).unwrap()
}

fn assert_pixel(view: &View, point_in_map: DVec3, expected: DVec2, within_px: f64) {
    let found = pixel(view, point_in_map);
    assert!((found - expected).length() < within_px, "{}: {found} instead of {expected}", view.id);
}

fn written(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

/// What makes an item, and the corners of its polygon: longitude and latitude of lower left, upper left, upper right, lower
/// right of the image, as published.
struct Published {
    id: &'static str,
    angles: [f64; 3],
    centre: [f64; 3],
    focal_mm: f64,
    matrix: [f64; 9],
    corners: [[f64; 2]; 4],
    /// Height of the ground at which the four corners fit best, metres: the other thing that nobody publishes.
    ground_m: f64,
}

/// Two items of the Danish oblique archive of 2019 (Styrelsen for Dataforsyning og Infrastruktur): one looks north, one west.
const PUBLISHED: [Published; 2] = [
    Published {
        id: "2019_83_37_2_0046_00001113",
        angles: [45.1494, -0.500_588, -0.368_475],
        centre: [580_185.73, 6_129_577.28, 1504.27],
        focal_mm: 108.2837,
        matrix: [
            0.999_941_154_780_583,
            -0.010_729_379_711_169_6,
            0.001_602_306_801_852_56,
            0.006_430_812_007_129_92,
            0.705_206_274_222_82,
            0.708_973_028_720_908,
            -0.008_736_797_640_020_93,
            -0.708_921_004_913_652,
            0.705_233_774_828_755,
        ],
        corners: [
            [10.256_902_168, 55.315_406_836],
            [10.254_352_853, 55.325_498_148],
            [10.274_061_542, 55.325_204_343],
            [10.270_493_846, 55.315_176_365],
        ],
        ground_m: 27.0,
    },
    Published {
        id: "2019_83_36_5_0028_00000842",
        angles: [1.087_45, 44.6841, 89.2089],
        centre: [593_092.69, 6_140_947.58, 1510.24],
        focal_mm: 108.3599,
        matrix: [
            0.009_817_161_901_187_91,
            0.999_908_851_350_567,
            0.009_268_890_062_726_09,
            -0.710_926_523_207_453,
            0.000_460_826_228_438_361,
            0.703_266_141_826_372,
            0.703_197_768_719_703,
            -0.013_493_577_360_219_2,
            0.710_866_247_220_709,
        ],
        corners: [
            [10.453_787_769, 55.402_462_329],
            [10.436_048_634, 55.401_054_292],
            [10.436_601_328, 55.412_371_195],
            [10.454_232_642, 55.410_275_596],
        ],
        ground_m: 7.0,
    },
];

fn item(published: &Published) -> serde_json::Value {
    let [omega, phi, kappa] = published.angles;
    serde_json::json!({
        "type": "Feature", "stac_version": "1.0.0",
        "stac_extensions": ["https://stac-extensions.github.io/perspective-imagery/v1.0.0/schema.json"],
        "id": published.id, "collection": "skraafotos2019",
        "properties": {
            "proj:shape": [8578.0, 11478.0], "direction": "north", "pers:omega": omega, "pers:phi": phi,
            "pers:kappa": kappa, "pers:perspective_center": published.centre, "pers:crs": 25832,
            "pers:vertical_crs": 5799, "pers:rotation_matrix": published.matrix,
            "pers:interior_orientation": {
                "camera_id": "PhaseOne", "focal_length": published.focal_mm, "pixel_spacing": [0.0046, 0.0046],
                "principal_point_offset": [0.0, 0.0], "sensor_array_dimensions": [11478.0, 8578.0]
            }
        },
        "assets": {}, "links": []
    })
}

/// Ten metres on the ground, pixels of 0.1 m: published polygons follow the relief, and another convention of angles, rows or
/// offsets moves a corner by thousands.
const CORNER_PX: f64 = 100.0;

#[test]
fn published_stac_items_see_their_ground_polygon_at_the_images_corners() {
    let folder = tempfile::tempdir().unwrap();
    let features: Vec<_> = PUBLISHED.iter().map(item).collect();
    let page = serde_json::json!({"type": "FeatureCollection", "features": features, "links": [{"rel": "next"}],
        "stac_version": "1.0.0", "note": "pers:"});
    let path = written(folder.path(), "items.json", &page.to_string());
    // Heights are those of the Danish vertical reference, which the project has to name too.
    let project = Crs::parse("EPSG:25832+5799").unwrap();
    let config = SurveyConfig { format: Format::Stac, ..SurveyConfig::at(&path) };
    let survey = survey::read(&config, &project).unwrap();
    assert_eq!(survey.views.len(), 2, "{:?}", survey.issues);
    assert!(survey.issues.iter().any(|issue| issue.code == "more_pages"), "{:?}", survey.issues);
    let to_map = Transform::new(&Crs::parse("EPSG:4258").unwrap(), &utm()).unwrap();
    for published in &PUBLISHED {
        let view = survey.views.iter().find(|view| view.id.0 == published.id).unwrap();
        assert_eq!((view.camera.width_px, view.camera.height_px), (11478, 8578));
        let corners = [[0.0, 8578.0], [0.0, 0.0], [11478.0, 0.0], [11478.0, 8578.0]];
        for ([lon_deg, lat_deg], corner) in published.corners.into_iter().zip(corners) {
            let (easting, northing) = to_map.point(lon_deg, lat_deg).unwrap();
            assert_pixel(view, DVec3::new(easting, northing, published.ground_m), DVec2::from(corner), CORNER_PX);
        }
    }
}

#[test]
fn a_stac_item_is_recognised_alone_and_in_a_folder_and_its_angles_do_without_the_matrix() {
    let folder = tempfile::tempdir().unwrap();
    let mut json = item(&PUBLISHED[0]);
    json["properties"].as_object_mut().unwrap().remove("pers:vertical_crs");
    let path = written(folder.path(), "item.json", &json.to_string());
    let of_matrix = read(&path);
    assert_eq!(read(folder.path()).views.len(), 1);
    json["properties"].as_object_mut().unwrap().remove("pers:rotation_matrix");
    json["properties"]["pers:interior_orientation"]["principal_point_offset"] = serde_json::json!([0.046, 0.023]);
    fs::write(&path, json.to_string()).unwrap();
    let of_angles = read(&path);
    let off = of_matrix.views[0].camera_from_map.rotation - of_angles.views[0].camera_from_map.rotation;
    assert!(off.to_cols_array().into_iter().all(|part| part.abs() < 1e-6), "{off}");
    // Right of and above the middle.
    let camera = &of_angles.views[0].camera;
    assert!((DVec2::new(camera.cx_px, camera.cy_px) - DVec2::new(5749.0, 4284.0)).length() < 1e-9, "{camera:?}");
}

#[test]
fn stac_items_that_contradict_themselves_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("item.json");
    let refused = |change: fn(&mut serde_json::Value), expected: &str| {
        let mut json = item(&PUBLISHED[0]);
        json["properties"].as_object_mut().unwrap().remove("pers:vertical_crs");
        change(&mut json["properties"]);
        fs::write(&path, json.to_string()).unwrap();
        let reason = error(&path);
        assert!(reason.contains(expected), "{reason}");
    };
    refused(|p| p["pers:kappa"] = serde_json::json!(1.0), "differ by");
    refused(|p| p["pers:rotation_matrix"] = serde_json::json!([1.0, 0.0]), "2 numbers: expected 9");
    refused(|p| p["pers:perspective_center"] = serde_json::json!([580_185.0, 6_129_577.0]), "expected X, Y, Z");
    refused(|p| p["pers:crs"] = serde_json::json!(4326), "degrees");
    refused(|p| p["proj:shape"] = serde_json::json!([100.0, 200.0]), "rows and columns");
    refused(
        |p| p["pers:interior_orientation"]["radial_distortion"] = serde_json::json!([0.0, 1e-5, 0.0, 0.0]),
        "radial_distortion",
    );
    refused(|p| p["pers:interior_orientation"] = serde_json::Value::Null, "[survey.camera]");
}

/// A project of one photo, its camera by the name of its block, and what stands in the camera.
fn project(camera: &str, calibration: &str, focal_mm: f64) -> String {
    let (block, key) = if camera == "old" { ("CAMERA", "TYPE") } else { ("CAMERA_DEFINITION", "ID") };
    format!(
        "$PROJECT 15.0.0\n  $PROJECT_NAME : a\n  $LINEAR_UNITS_OF_OBJECT : m\n$END\n\
         $PHOTO\n  $PHOTO_NUM : 17\n  $PHOTO_FILE : D:\\block 1\\LE_01\\ 7420.tif\n  $CAMERA_ID : {camera}\n  \
         $TERRAIN_HEIGHT : 12.0\n  $EXT_ORI : 19:07:49 17/08/2018\n   {focal_mm} {} {} {}\n   {MATRIX}\n  \
         $PHOTO_POINTS :\n   1 2 3\n  $END_POINTS\n$END\n\
         $PHOTO\n  $PHOTO_NUM : 18\n  $CAMERA_ID : {camera}\n$END\n\
         ${block}\n  ${key} : {camera}\n  $KIND : CCDFrame\n{calibration}  $FOCAL_LENGTH : {focal_mm}\n  \
         $PRINCIPAL_POINT_PPA : 0.000000 0.000000\n  $RADIAL_COEFFS :\n   0.0 0.0 0.0\n  $END\n$END\n",
        CENTRE.x, CENTRE.y, CENTRE.z
    )
}

/// Of a published 100-megapixel aerial camera of 4.6 µm.
const UPRIGHT: &str = "  $CCD_INTERIOR_ORIENTATION :\n    217.3923957723146 -0.0000000000000000 5798.5783629179\n    0.0 \
                       -217.39134227255337 4358.136527910467\n  $CCD_COLUMNS : 11608\n  $CCD_ROWS : 8708\n  \
                       $PIXEL_REFERENCE : CenterTopLeft\n";
/// Of a camera of 6 µm that is mounted turned.
const TURNED: &str = "  $CCD_INTERIOR_ORIENTATION :\n    -0.0000000000 -166.6666666667 4102.1667000000\n    -166.6666666667 \
                      -0.0000000000 3052.7167000000\n  $CCD_COLUMNS : 8205\n  $CCD_ROWS : 6106\n";

#[test]
fn an_inpho_project_sees_a_ground_point_where_the_collinearity_equations_do() {
    let folder = tempfile::tempdir().unwrap();
    // Column and row from the collinearity equations and the affine map, counted from the first pixel's centre.
    for (camera, calibration, focal_mm, expected) in [
        ("O42_LE", UPRIGHT, 51.68294, DVec2::new(5_315.495_544, 4_338.084_990)),
        ("old", TURNED, 50.0, DVec2::new(4_087.294_439, 3_411.018_332)),
    ] {
        let path = written(folder.path(), "block.prj", &project(camera, calibration, focal_mm));
        let survey = read(&path);
        assert_eq!(survey.views.len(), 1, "{:?}", survey.issues);
        assert_eq!(survey.views[0].id.0, "LE_01 7420.tif");
        assert!((survey.views[0].centre() - CENTRE).length() < 1e-6);
        assert_pixel(&survey.views[0], GROUND, expected + 0.5, 1e-3);
        let without = survey.issues.iter().find(|issue| issue.code == "photo_without_pose").unwrap();
        assert!(without.message.contains("not oriented"), "{without:?}");
    }
}

#[test]
fn what_an_inpho_project_means_is_not_guessed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.prj");
    let sound = project("c", UPRIGHT, 51.68294);
    let refused = |from: &str, to: &str, expected: &str| {
        assert!(sound.contains(from), "{from}");
        fs::write(&path, sound.replace(from, to)).unwrap();
        let reason = error(&path);
        assert!(reason.contains(expected), "{reason}");
    };
    refused("0.0 0.0 0.0", "0.0 -0.00001 0.0", "RADIAL_COEFFS");
    refused("PPA : 0.000000", "PPA : 0.012", "PRINCIPAL_POINT_PPA");
    refused("CenterTopLeft", "LowerLeft", "CenterTopLeft");
    refused("CCDFrame", "FilmFrame", "FilmFrame");
    refused("-0.0000000000000000", "3.5", "skewed");
    refused("-217.39134227255337", "217.39134227255337", "mirrors");
    refused("OBJECT : m", "OBJECT : ft", "LINEAR_UNITS_OF_OBJECT");
    refused("   51.68294 699", "   80.0 699", "expected the same");
    refused("0.8319154268", "0.9319154268", "no rotation");
    refused("$CAMERA_ID : c", "$CAMERA_ID : d", "not in the file");
    refused("  $END\n$END\n", "  $END\n", "truncated");
    let curved = sound.replace("$PROJECT_NAME : a", "$CURV_CORR_DEFAULT : on");
    fs::write(&path, curved).unwrap();
    assert!(read(&path).issues.iter().any(|issue| issue.code == "curvature_not_applied"));
}

#[test]
fn a_projects_own_grid_goes_before_the_runs() {
    let folder = tempfile::tempdir().unwrap();
    let wkt = "PROJCS[\"UTM33\",GEOGCS[\"ETRS89\",DATUM[\"European_Terrestrial_Reference_System_1989\",\
               SPHEROID[\"GRS 1980\",6378137,298.257222101]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],\
               PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_meridian\",15],\
               PARAMETER[\"scale_factor\",0.9996],PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",0],\
               UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"25833\"]]";
    let block =
        format!("$COORDINATE_SYSTEM_SET\n  $ID : a\n  $COORDINATE_SYSTEM : {wkt}\n$END_COORDINATE_SYSTEM\n$PHOTO\n");
    let text = project("c", UPRIGHT, 51.68294).replacen("$PHOTO\n", &block, 1);
    let path = written(folder.path(), "block.prj", &text);
    let survey = survey::read(&SurveyConfig::at(&path), &Crs::parse("EPSG:25833").unwrap()).unwrap();
    assert!((survey.views[0].centre() - CENTRE).length() < 1e-6);
    let elsewhere = read(&path).views[0].centre();
    assert!((elsewhere - CENTRE).length() > 1e5, "{elsewhere}");
}

/// Tags of a photo at a place, without a base station.
fn tags(lon_deg: f64, lat_deg: f64) -> String {
    format!(
        "drone-dji:GpsLatitude=\"{lat_deg}\" drone-dji:GpsLongitude=\"{lon_deg}\" drone-dji:AbsoluteAltitude=\"+300\" \
         drone-dji:GimbalYawDegree=\"0\" drone-dji:GimbalPitchDegree=\"-90\" drone-dji:GimbalRollDegree=\"0\" \
         drone-dji:RtkFlag=\"50\" drone-dji:CalibratedFocalLength=\"3700\""
    )
}

#[test]
fn an_image_log_beside_drone_photos_places_them() {
    let folder = tempfile::tempdir().unwrap();
    let (lon_deg, lat_deg) = (11.9, 52.0);
    for name in ["DJI_20250502142325_0031_D.JPG", "DJI_20250502142327_0032_D.JPG", "DJI_20250502142329_0033_D.JPG"] {
        photo(&folder.path().join(name), &tags(lon_deg, lat_deg), 5280, 3956);
    }
    // The second is 1.1 km off: another flight's. The third has no line.
    let line = |number: u32, lat_deg: f64| {
        format!(
            "{number}\t1.5\t[2364]\t  -339,N\t  -361,E\t   348,V\t{lat_deg},Lat\t{lon_deg},Lon\t310.25,Ellh\t0.012, 0.010, 0.020\t50,Q\n"
        )
    };
    let log = line(31, lat_deg + 1e-6) + &line(32, lat_deg + 0.01) + "33\tbroken\n";
    fs::write(folder.path().join("DJI_202505021412_007_Timestamp.MRK"), log).unwrap();
    let height = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    let config = SurveyConfig { height, ..SurveyConfig::at(folder.path()) };
    let survey = survey::read(&config, &utm()).unwrap();
    let place = |number: &str| survey.views.iter().find(|view| view.id.0.contains(number)).unwrap().centre();
    // A millionth of a degree is 0.11 m; 10.25 m higher than the photo's own altitude.
    assert!((place("0031") - place("0033") - DVec3::new(0.0, 0.111, 10.25)).length() < 0.02, "{}", place("0031"));
    assert!((place("0032") - place("0033")).length() < 1e-9);
    for code in ["mrk_positions", "mrk_disagrees", "mrk_unreadable"] {
        assert!(survey.issues.iter().any(|issue| issue.code == code), "{code}: {:?}", survey.issues);
    }
}

#[test]
fn other_formats_are_not_taken_for_these() {
    let folder = tempfile::tempdir().unwrap();
    // A CRS in a .prj, and STAC items without perspective imagery.
    let prj = written(folder.path(), "a_wkt.prj", "PROJCS[\"UTM\"]");
    assert!(error(&prj).contains("not recognised"), "{}", error(&prj));
    let satellite =
        written(folder.path(), "s2.json", "{\"type\": \"Feature\", \"stac_version\": \"1.0.0\", \"id\": \"a\"}");
    assert!(error(&satellite).contains("not recognised"), "{}", error(&satellite));
}
