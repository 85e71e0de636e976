//! Positions and heights of surveys against published coordinates, through the whole way from a file to the map.

use std::fs;
use std::path::Path;

use glam::DVec3;
use sizeup::crs::{Crs, Transform, Transform3d};
use sizeup::survey::{self, CameraConfig, HeightConfig, SurveyConfig};

/// A view straight down at a position, from a table in `crs`.
fn placed(folder: &Path, crs: &str, at: DVec3, project: &str, height: HeightConfig) -> DVec3 {
    let path = folder.join("poses.csv");
    fs::write(&path, format!("name,x,y,z,omega,phi,kappa\na.jpg,{},{},{},0,0,0\n", at.x, at.y, at.z)).unwrap();
    let camera =
        CameraConfig { width: 400, height: 300, fx: 300.0, fy: None, cx: None, cy: None, k: [0.0; 3], p: [0.0; 2] };
    let crs = Some(Crs::parse(crs).unwrap());
    let config = SurveyConfig { crs, camera: Some(camera), height, ..SurveyConfig::at(path) };
    let survey = survey::read(&config, &Crs::parse(project).unwrap()).unwrap_or_else(|e| panic!("{project}: {e}"));
    survey.views[0].centre()
}

#[test]
fn swiss_heights_reach_the_european_system_as_published() {
    // EPSG Guidance Note 7-2, "Vertical Offset and Slope": LN02 473.000 m at 47°20' N, 9°40' E is EVRF2000 472.690 m.
    let folder = tempfile::tempdir().unwrap();
    let at = DVec3::new(9.0 + 40.0 / 60.0, 47.0 + 20.0 / 60.0, 473.0);
    let found = placed(folder.path(), "EPSG:4258+5728", at, "EPSG:25832+5730", HeightConfig::default());
    assert!((found.z - 472.690).abs() < 1e-3, "{found}");
    let back = Transform::new(&Crs::parse("EPSG:25832").unwrap(), &Crs::parse("EPSG:4258").unwrap()).unwrap();
    let (lon_deg, lat_deg) = back.point(found.x, found.y).unwrap();
    assert!((lon_deg - at.x).abs() < 1e-9 && (lat_deg - at.y).abs() < 1e-9, "{lon_deg} {lat_deg}");
}

#[test]
fn french_heights_reach_the_european_system_by_the_registered_offset() {
    // EPSG transformation 5419, NGF IGN69 to EVRF2000: −0.486 m.
    let folder = tempfile::tempdir().unwrap();
    let at = DVec3::new(652_000.0, 6_862_000.0, 135.0);
    let found = placed(folder.path(), "EPSG:5698", at, "EPSG:2154+5730", HeightConfig::default());
    assert!((found - DVec3::new(at.x, at.y, 134.514)).length() < 1e-6, "{found}");
}

#[test]
fn earth_centred_positions_are_where_the_guidance_note_has_them() {
    // EPSG Guidance Note 7-2, "Geographic/Geocentric conversions": 53°48'33.820" N, 2°7'46.380" E, 73.0 m.
    let folder = tempfile::tempdir().unwrap();
    let at = DVec3::new(3_771_793.968, 140_253.342, 5_124_304.349);
    let keep = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    let path = folder.path().join("poses.csv");
    // The rotation refers to the earth-centred axes: towards the earth's centre.
    let down = -at.normalize();
    let right = DVec3::Z.cross(down).normalize();
    let below = down.cross(right);
    let rows: Vec<String> = [right, below, down].iter().flat_map(DVec3::to_array).map(|v| v.to_string()).collect();
    let text = format!(
        "name,x,y,z,r11,r12,r13,r21,r22,r23,r31,r32,r33,width,height,fx\na,{},{},{},{},40,30,30\n",
        at.x,
        at.y,
        at.z,
        rows.join(",")
    );
    fs::write(&path, text).unwrap();
    let mut config: SurveyConfig =
        toml::from_str("path = \"-\"\ncrs = \"EPSG:4978\"\n[csv]\nangles = \"matrix\"").unwrap();
    (config.path, config.height) = (path, keep);
    let survey = survey::read(&config, &Crs::parse("EPSG:32631").unwrap()).unwrap();
    let found = survey.views[0].centre();
    let back = Transform::new(&Crs::parse("EPSG:32631").unwrap(), &Crs::parse("EPSG:4326").unwrap()).unwrap();
    let (lon_deg, lat_deg) = back.point(found.x, found.y).unwrap();
    let published = (2.0 + 7.0 / 60.0 + 46.38 / 3600.0, 53.0 + 48.0 / 60.0 + 33.82 / 3600.0);
    // Seconds are printed to 0.001", some centimetres; metres to a millimetre.
    assert!((lon_deg - published.0).abs() < 3e-7 && (lat_deg - published.1).abs() < 3e-7, "{lon_deg} {lat_deg}");
    assert!((found.z - 73.0).abs() < 2e-3, "{found}");
    // Down to the earth's centre is the vertical but for the ellipsoid's flattening, 0.18° at this latitude.
    assert!(survey.views[0].off_nadir_deg() < 0.2, "{}", survey.views[0].off_nadir_deg());
}

#[test]
fn satellite_heights_lose_the_published_geoid() {
    // NGA's test point of EGM96: N = −31.628 m at 38.628155° N, 90.220845° W (Saint Louis).
    let folder = tempfile::tempdir().unwrap();
    let at = DVec3::new(-90.220_845, 38.628_155, 100.0);
    let found = placed(folder.path(), "EPSG:4979", at, "EPSG:32615+5773", HeightConfig::default());
    // The grid of 15' is interpolated bilinearly, by NGA's program with splines.
    assert!((found.z - 131.628).abs() < 0.06, "{found}");
}

#[test]
fn heights_without_a_known_way_are_refused_and_never_passed_through() {
    // PROJ knows no operation from LHN95 to EVRF2000: asked carelessly, it hands the height back unchanged.
    let (from, to) = (Crs::parse("EPSG:4258+5729").unwrap(), Crs::parse("EPSG:4258+5730").unwrap());
    let moved = Transform3d::new(&from, &to).and_then(|t| t.point(DVec3::new(9.67, 47.33, 473.0)));
    assert!(moved.is_err(), "{moved:?}");
}

#[test]
fn an_unknown_system_is_refused_in_one_line_of_our_own() {
    let refused = Crs::parse("EPSG:99999").unwrap_err().to_string();
    assert!(refused.contains("EPSG:99999") && refused.contains("hint"), "{refused}");
    for wrong in ["EPSG:25832 x", "EPSG:25832+", "EPSG:", "EPSG:25832;rm", ""] {
        assert!(Crs::parse(wrong).is_err(), "{wrong:?}");
    }
    // A compound's parts are found by their names where they have no codes of their own.
    let rotterdam = Crs::parse("EPSG:7415").unwrap();
    assert_eq!((rotterdam.horizontal_epsg(), rotterdam.vertical_epsg()), (Some(28992), Some(5709)));
    // Names and the forms of other tools still pass.
    for known in ["EPSG:25832+7837", "urn:ogc:def:crs:EPSG::28992", "+proj=utm +zone=32 +ellps=GRS80 +type=crs"] {
        assert!(Crs::parse(known).is_ok(), "{known}");
    }
}
