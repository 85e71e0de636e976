//! Tables as spreadsheets, drones and photogrammetry write them.

use std::fs;

use super::*;
use crate::{HeightConfig, SurveyConfig, VerticalDatum};
use sizeup_geo::issue::Severity;

const CAMERA: CameraConfig =
    CameraConfig { width: 320, height: 240, fx: 300.0, fy: None, cx: None, cy: None, k: [0.0; 3], p: [0.0; 2] };

/// Poses of a table in some encoding, of a survey with a declared camera that `edit` changes.
fn read_bytes(bytes: &[u8], edit: impl Fn(&mut SurveyConfig)) -> Result<crate::Survey, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses.csv");
    fs::write(&path, bytes).unwrap();
    let mut config = SurveyConfig { camera: Some(CAMERA), ..SurveyConfig::at(path) };
    edit(&mut config);
    crate::read(&config, &Crs::parse("EPSG:25832").unwrap()).map_err(|e| e.to_string())
}

fn read_text(text: &str) -> Result<crate::Survey, String> {
    read_bytes(text.as_bytes(), |_| {})
}

fn centre(survey: &crate::Survey) -> DVec3 {
    survey.views[0].centre()
}

/// Centres are kept as translations of millions of metres.
const ROUNDING_M: f64 = 1e-6;

fn assert_is_at(survey: &crate::Survey) {
    assert!((centre(survey) - AT).length() < ROUNDING_M, "{}", centre(survey));
}

const AT: DVec3 = DVec3::new(565_019.25, 5_932_934.5, 137.5);
const TABLE: &str = "name,x,y,z,omega,phi,kappa\nStraße.jpg,565019.25,5932934.5,137.5,40.5,3.25,-3.5\n";

#[test]
fn the_same_table_is_read_in_every_encoding_and_with_every_separator() {
    let decimal_commas = TABLE.replace(',', ";").replace('.', ",").replace(",jpg", ".jpg");
    let tabs = TABLE.replace(',', "\t");
    let utf16 = |text: &str| {
        let units = std::iter::once('\u{feff}').chain(text.chars());
        let text: String = units.collect();
        text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>()
    };
    let latin_1: Vec<u8> = TABLE.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    let tables = [
        TABLE.as_bytes().to_vec(),
        format!("\u{feff}{TABLE}").into_bytes(),
        latin_1,
        utf16(&tabs),
        utf16(&decimal_commas),
        decimal_commas.clone().into_bytes(),
        decimal_commas.replace(';', "\t").into_bytes(),
        format!("sep=;\r\n{decimal_commas}").into_bytes(),
        format!("\"sep=,\"\n{TABLE}").into_bytes(),
        format!("{TABLE},,,,,,\n,,,,,,\n").into_bytes(),
        format!("{TABLE}\n\n").into_bytes(),
    ];
    let expected = read_text(TABLE).unwrap();
    assert_is_at(&expected);
    for bytes in tables {
        let about = String::from_utf8_lossy(&bytes).into_owned();
        let survey = read_bytes(&bytes, |_| {}).unwrap_or_else(|e| panic!("{about}: {e}"));
        assert_eq!((survey.views.len(), survey.issues.len()), (1, 0), "{about}: {:?}", survey.issues);
        assert_eq!(survey.views[0].id.0, "Straße.jpg", "{about}");
        assert_eq!(survey.views[0].camera_from_map, expected.views[0].camera_from_map, "{about}");
    }
}

#[test]
fn lines_of_issues_count_the_line_that_names_the_separator() {
    let survey = read_text("sep=;\nname;x;y;z;omega;phi;kappa\na;1;2;3;0;0;0\nb;1;2;x;0;0;0\n").unwrap();
    let refused: Vec<&str> = survey.issues.iter().map(|issue| issue.message.as_str()).collect();
    assert!(refused[0].starts_with("line 4: \"x\" in column 4"), "{refused:?}");
}

#[test]
fn separators_of_thousands_are_refused_and_not_taken_for_decimals() {
    for row in ["a;565,019.25;5,932,934.5;137.5;0;0;0", "a;565,019;5932934.5;137;0;0;0"] {
        let refused = read_text(&format!("name;x;y;z;omega;phi;kappa\n{row}\n")).unwrap_err();
        assert!(refused.contains("separator of thousands"), "{refused}");
    }
}

#[test]
fn a_drones_header_in_a_comment_has_its_units_and_its_name_of_two_words() {
    let text = "# image name,latitude [decimal degrees],longitude [decimal degrees],altitude [meter],omega [degrees],\
                phi [degrees],kappa [degrees],accuracy horizontal [meter]\nIMG_1.jpg,53.541,9.981,137.5,42,3,3,0.01\n";
    let survey = read_bytes(text.as_bytes(), |config| config.height.reference = Some(VerticalDatum::Project)).unwrap();
    assert_eq!(survey.views[0].id.0, "IMG_1.jpg");
    assert!((centre(&survey).z - 137.5).abs() < ROUNDING_M);
    // Without a statement of what heights count from it is asked for, and not a column.
    let asked = read_text(text).unwrap_err();
    assert!(asked.contains("no known reference"), "{asked}");
    // A header that lacks one column is named as the header, not the first row.
    let lacking = read_text(&text.replace("omega", "om")).unwrap_err();
    assert!(lacking.contains("no column \"omega\"; the columns are image name, latitude"), "{lacking}");
}

#[test]
fn heights_are_in_the_unit_of_their_header() {
    const FEET: f64 = 451.115_485_564_304_5;
    const US_FEET: f64 = 451.114_583_333_333_3;
    for (name, value) in [
        ("altitude(feet)", FEET),
        ("alt_ft", FEET),
        ("z [ft]", FEET),
        ("height (US survey feet)", US_FEET),
        ("height [m]", 137.5),
        ("z_m", 137.5),
        ("elevation", 137.5),
    ] {
        let text = format!("filename,x,y,{name},omega,phi,kappa\na.jpg,565019.25,5932934.5,{value},0,0,0\n");
        let survey = read_text(&text).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!((centre(&survey) - AT).length() < ROUNDING_M, "{name}: {}", centre(&survey));
        assert_eq!(survey.views[0].camera.height_px, 240, "{name}");
    }
    for (name, expected) in [("z [fathoms]", "\"z\" in \"fathoms\""), ("z [gon]", "expected a length")] {
        let refused = read_text(&TABLE.replace(",z,", &format!(",{name},"))).unwrap_err();
        assert!(refused.contains(expected), "{refused}");
    }
    let refused = read_text(&TABLE.replace("omega", "omega [mil]")).unwrap_err();
    assert!(refused.contains("\"omega\" in \"mil\""), "{refused}");
    assert!(read_text(&TABLE.replace("omega", "omega_rad")).unwrap_err().contains("csv.unit"));
}

#[test]
fn positions_in_another_unit_than_their_crs_are_refused() {
    let refused = read_text(&TABLE.replace(",x,y,", ",x [ft],y [ft],")).unwrap_err();
    assert!(refused.contains("units of 0.3048 m") && refused.contains("survey.crs"), "{refused}");
    assert!(read_text(&TABLE.replace(",x,y,", ",x [m],y [m],")).is_ok());
    // The unit of heights stands in the header, so a plane in feet has all that it needs.
    let text = "name,x_usft,y_usft,z [m],omega,phi,kappa\na.jpg,984250,213254.1666666667,91.5,0,0,0\n";
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("poses.csv"), text).unwrap();
    let at = SurveyConfig::at(folder.path().join("poses.csv"));
    let config = SurveyConfig { camera: Some(CAMERA), crs: Some(Crs::parse("EPSG:2263").unwrap()), ..at };
    let survey = crate::read(&config, &Crs::parse("EPSG:32118").unwrap()).unwrap();
    assert!((centre(&survey).z - 91.5).abs() < ROUNDING_M, "{}", centre(&survey));
}

#[test]
fn a_column_of_the_pose_is_not_the_images_size_as_well() {
    let text = "name,E,N,H,omega,phi,kappa\na.jpg,565019,5932934,138,0,0,0\nb.jpg,565019,5932934,138.5,0,0,0\n";
    let table = |z: &str| CsvConfig { z: z.to_owned(), ..CsvConfig::default() };
    for csv in [Some(table("H")), None] {
        let survey = read_bytes(text.as_bytes(), |config| config.csv.clone_from(&csv)).unwrap();
        let sizes: Vec<(u32, u32)> =
            survey.views.iter().map(|view| (view.camera.width_px, view.camera.height_px)).collect();
        assert_eq!(sizes, [(320, 240), (320, 240)], "{:?}", survey.issues);
        assert!((centre(&survey).z - 138.0).abs() < ROUNDING_M);
    }
    let text = "name,x,y,z,w,p,k,width,height,fx\na.jpg,565019,5932934,138,40,3,-3,400,300,350\n";
    let angle_columns = ["w", "p", "k"].map(str::to_owned).to_vec();
    let survey = read_bytes(text.as_bytes(), |config| {
        config.camera = None;
        config.csv = Some(CsvConfig { angle_columns: angle_columns.clone(), ..CsvConfig::default() });
    });
    let survey = survey.unwrap();
    assert_eq!((survey.views[0].camera.width_px, survey.views[0].camera.height_px), (400, 300));
}

#[test]
fn a_declared_camera_goes_before_columns_and_focal_lengths_in_other_units_are_refused() {
    // RealityScan's table: f in millimetres of 36 mm film.
    let text = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n\
                a.jpg,565019.25,5932934.5,137.5,354,42,0,33.75,0,0,0,0,0,0,0,0\n";
    let table = |text: &str, camera: Option<CameraConfig>| {
        read_bytes(text.as_bytes(), |config| {
            config.camera.clone_from(&camera);
            config.csv = Some(CsvConfig {
                angles: crate::angles::AngleKind::Ypr,
                angle_columns: ["heading", "pitch", "roll"].map(str::to_owned).to_vec(),
                pitch_zero: crate::angles::PitchZero::Nadir,
                ..CsvConfig::default()
            });
        })
    };
    let survey = table(text, Some(CAMERA)).unwrap();
    assert_eq!((survey.views[0].camera.fx_px, survey.views[0].camera.fy_px), (300.0, 300.0));
    assert!(table(text, None).unwrap_err().contains("there is no camera"));
    let sized = text.replace("t1,t2", "width,height").replace("0,0\n", "320,240\n");
    assert!(table(&sized, None).unwrap_err().contains("36 mm film"));
    let sized = sized.replace(",px,py,", ",o1,o2,").replace("33.75", "24");
    let refused = table(&sized, None).unwrap_err();
    assert!(refused.contains("a focal length of 24 px for 320 × 240 px"), "{refused}");
    let stated = sized.replace(",f,", ",f [mm],");
    assert!(table(&stated, None).unwrap_err().contains("counts \"f\" in \"mm\": expected pixels"));
    assert_eq!(table(&stated, Some(CAMERA)).unwrap().views[0].camera.fx_px, 300.0);
}

#[test]
fn a_declared_camera_far_too_short_is_refused_as_one_of_a_file() {
    let camera = CameraConfig { fx: 24.0, ..CAMERA };
    let refused = read_bytes(TABLE.as_bytes(), |config| config.camera = Some(camera.clone())).unwrap_err();
    assert!(refused.contains("a focal length of 24 px"), "{refused}");
}

#[test]
fn keep_ellipsoidal_stays_a_choice_of_heights_in_feet() {
    let text = "name,longitude,latitude,alt [ft],omega,phi,kappa\na.jpg,9.981,53.541,451.115485564,0,0,0\n";
    let keep = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    let survey = read_bytes(text.as_bytes(), |config| config.height = keep.clone()).unwrap();
    assert!((centre(&survey).z - 137.5).abs() < 1e-6);
    let note = survey.issues.iter().find(|issue| issue.code == "height_choice").unwrap();
    assert!(note.severity == Severity::Note && note.message.contains("units of 0.304800000 m"), "{note:?}");
}
