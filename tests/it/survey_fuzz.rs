//! Every reader of poses against damaged files: cut off, overwritten, blown up, spliced. Whatever comes back is an
//! error or sound poses; nothing panics, hangs or takes memory for records that are not there.
//!
//! 64 files per reader by default; `PROPTEST_CASES=10000 cargo test --test it survey_fuzz` looks longer.

use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use sizeup::crs::Crs;
use sizeup::survey::{self, CameraConfig, Format, HeightConfig, Survey, SurveyConfig, SurveyError};

use super::survey_cli::opf;
use super::survey_formats::{ROWS, blocks_exchange, matrix_elements, photo};
use super::survey_hostile::write_binary_model;

/// Files per reader without `PROPTEST_CASES`.
const CASES: u32 = 64;

/// One way in which a file goes bad. Places are shares of the file's length.
#[derive(Debug, Clone)]
enum Damage {
    Truncate(f64),
    FlipBit(f64, u8),
    Overwrite(f64, Vec<u8>),
    Insert(f64, Vec<u8>),
    Remove(f64, usize),
    /// A piece of the file once more, elsewhere.
    Repeat(f64, f64, usize),
}

impl Damage {
    fn apply(&self, bytes: &mut Vec<u8>) {
        let place = |share: f64, bytes: &[u8]| ((share * bytes.len() as f64) as usize).min(bytes.len());
        match self {
            Self::Truncate(share) => bytes.truncate(place(*share, bytes)),
            Self::FlipBit(share, bit) => {
                let at = place(*share, bytes);
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << (bit % 8);
                }
            }
            Self::Overwrite(share, with) => {
                let at = place(*share, bytes);
                let n = with.len().min(bytes.len() - at);
                bytes[at..at + n].copy_from_slice(&with[..n]);
            }
            Self::Insert(share, what) => {
                let at = place(*share, bytes);
                bytes.splice(at..at, what.iter().copied());
            }
            Self::Remove(share, n) => {
                let at = place(*share, bytes);
                bytes.drain(at..(at + n).min(bytes.len()));
            }
            Self::Repeat(from, to, n) => {
                let (from, to) = (place(*from, bytes), place(*to, bytes));
                let piece = bytes[from..(from + n).min(bytes.len())].to_vec();
                bytes.splice(to..to, piece);
            }
        }
    }
}

/// Bytes that readers stumble over: counts, floats and words at the ends of their ranges.
fn nasty() -> impl Strategy<Value = Vec<u8>> {
    let words: Vec<Vec<u8>> = [
        "1e999",
        "-1e308",
        "NaN",
        "inf",
        "-0",
        "99999999999999999999",
        "-1",
        "\0",
        "\u{feff}",
        "<a>",
        "</a>",
        "&x;",
        "<![CDATA[",
        "[",
        "{",
        "\"",
        ",",
        "\n",
        "\r\n\r\n",
        "#",
        "EPSG:1",
        " ",
    ]
    .iter()
    .map(|word| word.as_bytes().to_vec())
    .chain([u64::MAX, u64::MAX / 48, 1 << 31, 1 << 40].map(|n| n.to_le_bytes().to_vec()))
    .chain([f64::NAN, f64::INFINITY, f64::MAX, 5e-324].map(|n| n.to_le_bytes().to_vec()))
    .chain([u32::MAX, 1 << 31].map(|n| n.to_le_bytes().to_vec()))
    .collect();
    prop_oneof![proptest::sample::select(words), proptest::collection::vec(any::<u8>(), 1..12)]
}

fn damages() -> impl Strategy<Value = Vec<Damage>> {
    let share = 0.0..1.0_f64;
    let damage = prop_oneof![
        1 => share.clone().prop_map(Damage::Truncate),
        3 => (share.clone(), any::<u8>()).prop_map(|(at, bit)| Damage::FlipBit(at, bit)),
        3 => (share.clone(), nasty()).prop_map(|(at, with)| Damage::Overwrite(at, with)),
        3 => (share.clone(), nasty()).prop_map(|(at, what)| Damage::Insert(at, what)),
        2 => (share.clone(), 1_usize..40).prop_map(|(at, n)| Damage::Remove(at, n)),
        1 => (share.clone(), share, 1_usize..200).prop_map(|(from, to, n)| Damage::Repeat(from, to, n)),
    ];
    proptest::collection::vec(damage, 1..4)
}

fn config(format: Format, path: PathBuf) -> SurveyConfig {
    let camera =
        CameraConfig { width: 400, height: 300, fx: 300.0, fy: None, cx: None, cy: None, k: [0.0; 3], p: [0.0; 2] };
    let height = HeightConfig { keep_ellipsoidal: true, ..HeightConfig::default() };
    SurveyConfig { format, camera: Some(camera), height, ..SurveyConfig::at(path) }
}

fn read(config: &SurveyConfig) -> Result<Survey, SurveyError> {
    survey::read(config, &Crs::parse("EPSG:25832").unwrap())
}

/// Damages each file of a survey that can be read, one at a time.
fn torture(config: &SurveyConfig, files: &[PathBuf]) {
    assert!(!read(config).unwrap_or_else(|e| panic!("{e}")).views.is_empty(), "the survey itself is sound");
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(CASES);
    for file in files {
        let good = fs::read(file).unwrap();
        let mut runner = TestRunner::new(Config { cases, failure_persistence: None, ..Config::default() });
        let outcome = runner.run(&damages(), |damages| {
            let mut bytes = good.clone();
            for damage in &damages {
                damage.apply(&mut bytes);
            }
            fs::write(file, &bytes).unwrap();
            for view in read(config).map(|survey| survey.views).unwrap_or_default() {
                let rotation = view.camera_from_map.rotation;
                prop_assert!(view.centre().is_finite(), "{:?}", view);
                prop_assert!((rotation.determinant() - 1.0).abs() < 1e-9, "{:?}", view);
                prop_assert!(view.camera.validate().is_ok(), "{:?}", view);
            }
            Ok(())
        });
        fs::write(file, &good).unwrap();
        outcome.unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    }
}

fn one_file(format: Format, name: &str, text: impl AsRef<[u8]>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    torture(&config(format, path.clone()), &[path]);
}

#[test]
fn colmap_binary() {
    let folder = tempfile::tempdir().unwrap();
    write_binary_model(folder.path(), DVec3::new(5e5, 57e5, 100.0));
    let files = ["images.bin", "cameras.bin"].map(|name| folder.path().join(name));
    torture(&config(Format::Colmap, folder.path().to_owned()), &files);
}

#[test]
fn colmap_text() {
    let folder = tempfile::tempdir().unwrap();
    let files = ["images.txt", "cameras.txt"].map(|name| folder.path().join(name));
    fs::write(&files[0], "# i\n1 0 1 0 0 -5e5 57e5 100 1 a b.jpg\n1 2 -1\n2 0 1 0 0 -5e5 57e5 90 2 c.jpg\n\n").unwrap();
    fs::write(&files[1], "1 PINHOLE 40 30 30 30 20 15\n2 OPENCV_FISHEYE 40 30 30 30 20 15 1e-2 0 0 0\n").unwrap();
    torture(&config(Format::Colmap, folder.path().to_owned()), &files);
}

#[test]
fn blocks_exchange_plain_and_zipped() {
    let xml = blocks_exchange("XRightYDown", &matrix_elements(ROWS));
    one_file(Format::BlocksExchange, "block.xml", &xml);
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    zip.start_file("block.xml", zip::write::SimpleFileOptions::default()).unwrap();
    zip.write_all(xml.as_bytes()).unwrap();
    one_file(Format::BlocksExchange, "block.xmlz", zip.finish().unwrap().into_inner());
}

#[test]
fn metashape() {
    let xml = r#"<?xml version="1.0"?><document version="2.0.0"><chunk><sensors><sensor id="0" type="frame">
        <resolution width="40" height="30"/><calibration type="frame" class="adjusted"><resolution width="40"
        height="30"/><f>30</f><cx>1</cx><b2>0.1</b2><k1>0.1</k1><k4>1e-3</k4></calibration></sensor></sensors>
        <components><component id="0"><transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>5e5 57e5 0
        </translation><scale>1</scale></transform></component></components><cameras><camera id="0" sensor_id="0"
        component_id="0" label="a"><transform>1 0 0 1 0 -1 0 2 0 0 -1 100 0 0 0 1</transform></camera></cameras>
        <reference>LOCAL_CS["Local"]</reference></chunk></document>"#;
    one_file(Format::Metashape, "cameras.xml", xml);
}

#[test]
fn opensfm_and_odm() {
    let camera = r#"{"c":{"projection_type":"brown","width":40,"height":30,"focal_x":0.8,"k1":0.1,"p2":1e-3}}"#;
    let shot = r#""rotation":[3.14159,0,0],"translation":[-5e5,57e5,100],"camera":"v2 c""#;
    let json = format!(r#"[{{"cameras":{camera},"shots":{{"a.jpg":{{{shot}}}}}}}]"#);
    one_file(Format::Opensfm, "reconstruction.json", json);
    let folder = tempfile::tempdir().unwrap();
    let files = ["shots.geojson", "cameras.json", "proj.txt"].map(|name| folder.path().join(name));
    let properties = format!(r#"{{"filename":"a.jpg",{}}}"#, shot.replace("-5e5", "5e5"));
    fs::write(&files[0], format!(r#"{{"features":[{{"properties":{properties}}}]}}"#)).unwrap();
    fs::write(&files[1], camera).unwrap();
    fs::write(&files[2], "EPSG:25832").unwrap();
    torture(&config(Format::Odm, files[0].clone()), &files);
}

#[test]
fn open_photogrammetry_format() {
    let folder = tempfile::tempdir().unwrap();
    opf(folder.path());
    let names = ["project.opf", "list.json", "input.json", "frame.json", "calibrated.json"];
    torture(&config(Format::Opf, folder.path().to_owned()), &names.map(|name| folder.path().join(name)));
}

#[test]
fn pix4d() {
    let folder = tempfile::tempdir().unwrap();
    let files =
        ["p_calibrated_camera_parameters.txt", "p_offset.xyz", "p_wkt.prj"].map(|name| folder.path().join(name));
    let image = "a b.jpg 40 30\n30 0 20\n0 30 15\n0 0 1\n-0.1 0.02 0\n1e-4 0\n1 2 100\n1 0 0\n0 -1 0\n0 0 -1\n";
    fs::write(&files[0], format!("{}{image}{image}", "header\n".repeat(8))).unwrap();
    fs::write(&files[1], "5e5 57e5 0\n").unwrap();
    fs::write(&files[2], "EPSG:25832").unwrap();
    torture(&config(Format::Pix4d, folder.path().to_owned()), &files);
    let name = "p_calibrated_external_camera_parameters.txt";
    one_file(
        Format::Pix4d,
        name,
        "imageName X Y Z Omega Phi Kappa\na.jpg 5e5 57e5 100 1 2 3\nb.jpg 5e5 57e5 90 4 5 6\n",
    );
}

#[test]
fn tables() {
    one_file(Format::GeoTxt, "geo.txt", "EPSG:25832\na.jpg 5e5 57e5 100 10 20 3 0.1 0.2\nb.jpg 5e5 57e5\n");
    one_file(
        Format::MetashapeOpk,
        "opk.txt",
        "# PhotoID, X\na\t5e5\t57e5\t100\t1\t2\t3\t0.1\nb\t5e5\t57e5\t9\t1\t2\t3\n",
    );
    let head = "name,x,y,z,omega,phi,kappa,width,height,fx,cx,k1,lens";
    one_file(
        Format::Csv,
        "a.csv",
        format!("{head}\na,5e5,57e5,100,1,2,3,40,30,30,20,0.1,brown\n\"b,c\",5,6,7,1,2,3\n"),
    );
}

/// One entry of a TIFF directory.
fn entry(tag: u16, kind: u16, n: usize, value: usize) -> [u8; 12] {
    let word = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
    let head = [tag.to_le_bytes(), kind.to_le_bytes()].concat();
    [head, word(n).to_vec(), word(value).to_vec()].concat().try_into().unwrap()
}

/// A TIFF header with GPS tags, focal length and an XMP packet, as it stands in a JPEG's EXIF segment or alone.
fn tiff() -> Vec<u8> {
    const N_ENTRIES: [usize; 3] = [5, 2, 6];
    let xmp = br#"<x><r GimbalYawDegree="10" GimbalPitchDegree="-60" GimbalRollDegree="0" RtkFlag="50"/></x>"#;
    let bytes_of = |n_entries: usize| 2 + 12 * n_entries + 4;
    let exif_at = 8 + bytes_of(N_ENTRIES[0]);
    let gps_at = exif_at + bytes_of(N_ENTRIES[1]);
    let data_at = gps_at + bytes_of(N_ENTRIES[2]);
    let mut data: Vec<u8> = Vec::new();
    let mut put = |what: &[u8]| -> usize {
        data.extend(what);
        data_at + data.len() - what.len()
    };
    let rationals = |values: &[u32]| -> Vec<u8> {
        values.iter().flat_map(|v| [v.to_le_bytes(), 1_u32.to_le_bytes()].concat()).collect()
    };
    let primary = vec![
        entry(0x0100, 4, 1, 40),
        entry(0x0101, 4, 1, 30),
        entry(0x02BC, 1, xmp.len(), put(xmp)),
        entry(0x8769, 4, 1, exif_at),
        entry(0x8825, 4, 1, gps_at),
    ];
    let exif = vec![entry(0x920A, 5, 1, put(&rationals(&[20]))), entry(0xA405, 3, 1, 28)];
    let gps = vec![
        entry(1, 2, 2, usize::from(b'N')),
        entry(2, 5, 3, put(&rationals(&[52, 1, 2]))),
        entry(3, 2, 2, usize::from(b'E')),
        entry(4, 5, 3, put(&rationals(&[11, 3, 4]))),
        entry(5, 1, 1, 0),
        entry(6, 5, 1, put(&rationals(&[150]))),
    ];
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    for directory in [primary, exif, gps] {
        bytes.extend(u16::try_from(directory.len()).unwrap().to_le_bytes());
        bytes.extend(directory.concat());
        bytes.extend([0; 4]);
    }
    bytes.extend(data);
    bytes
}

#[test]
fn mapping_agencies() {
    let prj = "$PROJECT 15.0.0\n  $LINEAR_UNITS_OF_OBJECT : m\n$END\n$CAMERA_DEFINITION\n  $ID : A\n  $CCD_COLUMNS : 400\n  \
               $CCD_ROWS : 300\n  $CCD_INTERIOR_ORIENTATION :\n    100 0 199.5\n    0 -100 149.5\n  $FOCAL_LENGTH : 50\n$END\n\
               $PHOTO\n  $PHOTO_NUM : 1\n  $CAMERA_ID : A\n  $EXT_ORI : 12:00:00 01/01/2026\n    50 5e5 57e5 100\n    \
               1 0 0\n    0 1 0\n    0 0 1\n$END\n";
    one_file(Format::Inpho, "block.prj", prj);
    let item = serde_json::json!({"type": "Feature", "stac_version": "1.0.0", "id": "a", "properties": {
        "pers:perspective_center": [5e5, 57e5, 1000.0], "pers:crs": 25832, "pers:omega": 0.0, "pers:phi": 0.0,
        "pers:kappa": 0.0, "pers:rotation_matrix": [1, 0, 0, 0, 1, 0, 0, 0, 1], "proj:shape": [300, 400],
        "pers:interior_orientation": {"sensor_array_dimensions": [400, 300], "pixel_spacing": [0.01, 0.01],
            "focal_length": 50.0, "principal_point_offset": [0.1, 0.2], "radial_distortion": [0, 0, 0, 0]}}});
    one_file(Format::Stac, "item.json", item.to_string());
}

#[test]
fn photos() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    let tags = "drone-dji:GpsLatitude=\"+52\" drone-dji:GpsLongitude=\"+11\" drone-dji:AbsoluteAltitude=\"+150\" \
        drone-dji:GimbalYawDegree=\"1\" drone-dji:GimbalPitchDegree=\"-60\" drone-dji:GimbalRollDegree=\"0\" \
        drone-dji:DewarpData=\"2020-01-01;3700,3701,12,-8,-0.1,0.02,1e-4,2e-4,-3e-3\"";
    photo(&path, tags, 5280, 3956);
    torture(&config(Format::Photos, path.clone()), std::slice::from_ref(&path));
    let log = folder.path().join("a_Timestamp.MRK");
    let line = "31\t1.5\t[2364]\t-339,N\t-361,E\t348,V\t52.0,Lat\t10.0,Lon\t310.25,Ellh\t0.012, 0.010, 0.020\t50,Q\n";
    fs::write(&log, line).unwrap();
    let numbered = folder.path().join("a_0031.jpg");
    fs::copy(&path, &numbered).unwrap();
    torture(&config(Format::Photos, numbered), &[log]);
    let mut without_camera = config(Format::Photos, folder.path().join("b.tif"));
    without_camera.camera = None;
    fs::write(&without_camera.path, tiff()).unwrap();
    let view = &read(&without_camera).unwrap().views[0];
    assert!((view.camera.fx_px - 28.0 / 43.266_615 * 50.0).abs() < 1e-6, "35 mm equivalent on a diagonal of 50 px");
    torture(&without_camera, &[without_camera.path.clone()]);
    // The same metadata in a JPEG.
    let exif = [b"Exif\0\0".to_vec(), tiff()].concat();
    let mut jpeg = vec![0xFF, 0xD8, 0xFF, 0xE1];
    jpeg.extend(u16::try_from(exif.len() + 2).unwrap().to_be_bytes());
    jpeg.extend(exif);
    let xmp = b"http://ns.adobe.com/xap/1.0/\0<x><r GimbalYawDegree=\"1\" GimbalPitchDegree=\"-60\" GimbalRollDegree=\"0\"/></x>";
    jpeg.extend([0xFF, 0xE1]);
    jpeg.extend(u16::try_from(xmp.len() + 2).unwrap().to_be_bytes());
    jpeg.extend(xmp);
    jpeg.extend([0xFF, 0xC0, 0, 11, 8, 0, 30, 0, 40, 1, 0, 0, 0]);
    let path = folder.path().join("c.jpg");
    fs::write(&path, jpeg).unwrap();
    torture(&config(Format::Photos, path.clone()), &[path]);
}

#[test]
fn a_name_without_end_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("images.bin");
    write_binary_model(folder.path(), DVec3::ZERO);
    let mut bytes = fs::read(&path).unwrap();
    let name_at = 8 + 4 + 56 + 4;
    bytes.splice(name_at..name_at, std::iter::repeat_n(b'a', 1 << 20));
    fs::write(&path, bytes).unwrap();
    let refused = read(&config(Format::Colmap, folder.path().to_owned())).unwrap_err().to_string();
    assert!(refused.contains("image name"), "{refused}");
}
