//! Surveys that are broken, cut off or made up: an error or an issue, never a panic and never a wrong pose in silence.

use std::fs;
use std::path::Path;

use glam::DVec3;
use proptest::prelude::*;
use sizeup::crs::Crs;
use sizeup::survey::angles::{AngleConvention, AngleKind, quaternion_wxyz};
use sizeup::survey::{self, Format, Survey, SurveyConfig, SurveyError};

/// A binary COLMAP model of one golden camera (yaw 30°, pitch −45°, roll 5°) with two observations.
pub fn write_binary_model(folder: &Path, centre: DVec3) {
    let convention = AngleConvention { angles: AngleKind::Ypr, ..AngleConvention::default() };
    let rotation = convention.camera_from_world(&[30.0, -45.0, 5.0]).unwrap();
    let translation = -(rotation * centre);
    let mut cameras = Vec::new();
    cameras.extend(1_u64.to_le_bytes());
    cameras.extend(1_u32.to_le_bytes());
    cameras.extend(1_i32.to_le_bytes());
    cameras.extend(4000_u64.to_le_bytes());
    cameras.extend(3000_u64.to_le_bytes());
    for param in [3000.0_f64, 3000.0, 2000.0, 1500.0] {
        cameras.extend(param.to_le_bytes());
    }
    let mut images = Vec::new();
    images.extend(1_u64.to_le_bytes());
    images.extend(1_u32.to_le_bytes());
    for value in quaternion_wxyz(rotation).into_iter().chain(translation.to_array()) {
        images.extend(value.to_le_bytes());
    }
    images.extend(1_u32.to_le_bytes());
    images.extend(b"a.jpg\0");
    images.extend(2_u64.to_le_bytes());
    images.extend([0; 48]);
    fs::write(folder.join("cameras.bin"), cameras).unwrap();
    fs::write(folder.join("images.bin"), images).unwrap();
}

fn utm() -> Crs {
    Crs::parse("EPSG:25832").unwrap()
}

fn read_as(format: Format, path: &Path) -> Result<Survey, SurveyError> {
    survey::read(&SurveyConfig { format, ..SurveyConfig::at(path) }, &utm())
}

fn text_model(images: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cameras.txt"), "1 PINHOLE 400 300 300 300 200 150\n2 FOV 400 300 1 1 1 1 1\n")
        .unwrap();
    fs::write(folder.path().join("images.txt"), images).unwrap();
    folder
}

#[test]
fn each_bad_pose_is_an_issue_with_its_name_and_reason() {
    let folder = text_model(
        "1 0 1 0 0 0 0 -100 1 good.jpg\n\n\
         2 0 0 0 0 0 0 -100 1 zero.jpg\n\n\
         3 0 1 0 0 NaN 0 -100 1 nan.jpg\n\n\
         4 1 0 0 0 0 0 -100 1 up.jpg\n\n\
         5 0 1 0 0 0 0 -100 9 lost_camera.jpg\n\n\
         6 0 1 0 0 0 0 -100 2 unknown_model.jpg\n\n\
         7 0 1 0 0 0 0 -100 1 twice.jpg\n\n\
         8 0 1 0 0 5 0 -100 1 twice.jpg\n\n\
         9 0 1 0 0 0 0 -100 1 same.jpg\n\n\
         10 0 1 0 0 0 0 -100 1 same.jpg\n\n",
    );
    let survey = read_as(Format::Colmap, folder.path()).unwrap();
    let names: Vec<&str> = survey.views.iter().map(|view| view.id.0.as_str()).collect();
    assert_eq!(names, ["good.jpg", "same.jpg"]);
    let mut codes: Vec<&str> = survey.issues.iter().map(|issue| issue.code.as_str()).collect();
    codes.sort_unstable();
    assert_eq!(
        codes,
        [
            "camera_unknown",
            "camera_unusable",
            "duplicate_name",
            "duplicate_name",
            "pose_unusable",
            "pose_unusable",
            "view_looks_up"
        ]
    );
}

#[test]
fn an_empty_model_and_a_model_of_bad_cameras_say_why() {
    let empty = read_as(Format::Colmap, text_model("# nothing\n").path()).unwrap_err();
    assert!(matches!(empty, SurveyError::NothingUsable { n_poses: 0, .. }), "{empty}");
    let fov = read_as(Format::Colmap, text_model("1 0 1 0 0 0 0 -100 2 a.jpg\n\n").path()).unwrap_err();
    assert!(fov.to_string().contains("FOV"), "{fov}");
    let line = read_as(Format::Colmap, text_model("1 0 1 0 zero 0 0 -100 2 a.jpg\n\n").path()).unwrap_err();
    assert!(line.to_string().contains("line 1"), "{line}");
}

#[test]
fn huge_counts_are_refused_before_memory_is() {
    let folder = tempfile::tempdir().unwrap();
    write_binary_model(folder.path(), DVec3::ZERO);
    for (file, at) in [("images.bin", 0), ("images.bin", 8 + 4 + 56 + 4 + 6), ("cameras.bin", 0)] {
        let path = folder.path().join(file);
        let good = fs::read(&path).unwrap();
        let mut bytes = good.clone();
        bytes[at..at + 8].copy_from_slice(&(u64::MAX / 2).to_le_bytes());
        fs::write(&path, bytes).unwrap();
        let refused = read_as(Format::Colmap, folder.path()).unwrap_err();
        assert!(refused.to_string().contains("announced"), "{refused}");
        fs::write(&path, good).unwrap();
    }
}

#[test]
fn every_truncation_of_a_binary_model_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_binary_model(folder.path(), DVec3::ZERO);
    for file in ["images.bin", "cameras.bin"] {
        let path = folder.path().join(file);
        let good = fs::read(&path).unwrap();
        for n in 0..good.len() {
            fs::write(&path, &good[..n]).unwrap();
            assert!(read_as(Format::Colmap, folder.path()).is_err(), "{file} cut to {n} bytes");
        }
        fs::write(&path, good).unwrap();
    }
}

const BLOCK: &str = "<BlocksExchange><Block><Photogroups><Photogroup><ImageDimensions><Width>40</Width>\
    <Height>30</Height></ImageDimensions><FocalLengthPixels>30</FocalLengthPixels><Photo><ImagePath>a.jpg</ImagePath>\
    <Pose><Rotation><Omega>180</Omega><Phi>0</Phi><Kappa>0</Kappa></Rotation><Center><x>5e5</x><y>57e5</y><z>9</z>\
    </Center></Pose></Photo></Photogroup></Photogroups></Block></BlocksExchange>";

#[test]
fn every_truncation_of_an_xml_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.xml");
    fs::write(&path, BLOCK).unwrap();
    assert_eq!(read_as(Format::BlocksExchange, &path).unwrap().views.len(), 1);
    for n in 0..BLOCK.len() {
        fs::write(&path, &BLOCK[..n]).unwrap();
        assert!(read_as(Format::BlocksExchange, &path).is_err(), "cut to {n} bytes");
    }
}

#[test]
fn xml_that_nests_or_expands_without_end_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.xml");
    let nested = format!("<BlocksExchange>{}", "<a>".repeat(100_000));
    let entities =
        "<!DOCTYPE x [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;\">]><BlocksExchange><SRS>&b;</SRS></BlocksExchange>";
    for (text, word) in [(nested.as_str(), "nested"), (entities, "entity")] {
        fs::write(&path, text).unwrap();
        let refused = read_as(Format::BlocksExchange, &path).unwrap_err().to_string();
        assert!(refused.contains(word), "{refused}");
    }
}

#[test]
fn negative_focal_lengths_and_nan_are_issues_of_their_photos() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.xml");
    for (from, to) in [("Pixels>30<", "Pixels>-30<"), (">5e5<", ">NaN<"), (">180<", ">inf<")] {
        fs::write(&path, BLOCK.replace(from, to)).unwrap();
        let refused = read_as(Format::BlocksExchange, &path).unwrap_err();
        assert!(matches!(refused, SurveyError::NothingUsable { .. }), "{refused}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn damaged_files_of_every_format_never_panic(
        at in 0_usize..600, byte in any::<u8>(), insert in proptest::collection::vec(any::<u8>(), 0..12)
    ) {
        let folder = tempfile::tempdir().unwrap();
        write_binary_model(folder.path(), DVec3::ZERO);
        let damage = |bytes: &[u8]| {
            let mut bytes = bytes.to_vec();
            let at = at % bytes.len();
            bytes[at] = byte;
            bytes.splice(at..at, insert.iter().copied());
            bytes
        };
        let images = fs::read(folder.path().join("images.bin")).unwrap();
        fs::write(folder.path().join("images.bin"), damage(&images)).unwrap();
        let _ = read_as(Format::Colmap, folder.path());
        let xml = folder.path().join("x.xml");
        fs::write(&xml, damage(BLOCK.as_bytes())).unwrap();
        for format in [Format::BlocksExchange, Format::Metashape, Format::Csv, Format::Opensfm, Format::MetashapeOpk] {
            let _ = read_as(format, &xml);
        }
        let mut jpeg = vec![0xFF, 0xD8, 0xFF, 0xE1];
        let body = [b"http://ns.adobe.com/xap/1.0/\0".as_slice(), BLOCK.as_bytes()].concat();
        jpeg.extend(u16::try_from(body.len() + 2).unwrap().to_be_bytes());
        jpeg.extend(body);
        jpeg.extend([0xFF, 0xC0, 0, 11, 8, 0, 30, 0, 40, 1, 0, 0, 0]);
        let photo = folder.path().join("x.jpg");
        fs::write(&photo, damage(&jpeg)).unwrap();
        let _ = read_as(Format::Photos, &photo);
    }
}
