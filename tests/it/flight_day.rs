//! The day of a flight, as the photos' EXIF has it, in every result.

use std::fs;
use std::path::Path;

use gdal::vector::LayerAccess as _;
use serde_json::Value;

use crate::tiny_scene::{N_VIEWS, Scene};

/// A photo that was taken at a time, by its EXIF.
fn photo(taken: &str) -> Vec<u8> {
    let mut jpeg = std::io::Cursor::new(Vec::new());
    image::DynamicImage::new_luma8(160, 120).write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    // One directory with a pointer to another, which has the time.
    let mut exif =
        b"Exif\0\0II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1a\0\0\0\0\0\0\0\x01\0\x03\x90\x02\0".to_vec();
    exif.extend(20_u32.to_le_bytes());
    exif.extend(44_u32.to_le_bytes());
    exif.extend([0; 4]);
    exif.extend(taken.as_bytes());
    exif.push(0);
    let mut photo = vec![0xFF, 0xD8, 0xFF, 0xE1];
    photo.extend(u16::try_from(exif.len() + 2).unwrap().to_be_bytes());
    photo.extend(exif);
    photo.extend(&jpeg.into_inner()[2..]);
    photo
}

fn with_photos(taken: impl Fn(usize) -> String) -> Scene {
    let scene = Scene::new();
    fs::create_dir_all(scene.path("images")).unwrap();
    let listed = fs::read_to_string(scene.path("sparse/images.txt")).unwrap();
    let names: Vec<&str> =
        listed.split_whitespace().filter(|word| Path::new(word).extension().is_some_and(|end| end == "jpg")).collect();
    assert_eq!(names.len(), N_VIEWS);
    for (i, name) in names.iter().enumerate() {
        fs::write(scene.path("images").join(name), photo(&taken(i))).unwrap();
    }
    scene
}

const QUICK: [&str; 8] = [
    "--set",
    "survey.images=\"images\"",
    "--set",
    "refinement.enabled=false",
    "--set",
    "output.report.page=false",
    "--set",
    "output.pictures=false",
];

/// The day in the origin, in the city's metadata and in the list of the layers.
fn days(scene: &Scene) -> [Option<String>; 3] {
    let json = |name: &str| -> Value { serde_json::from_slice(&fs::read(scene.path(name)).unwrap()).unwrap() };
    let text = |value: &Value| value.as_str().map(str::to_owned);
    let layers = gdal::Dataset::open(scene.path("result/city.gpkg")).unwrap();
    let mut listed = layers
        .execute_sql(
            "SELECT last_change FROM gpkg_contents WHERE table_name = 'buildings'",
            None,
            gdal::vector::sql::Dialect::DEFAULT,
        )
        .unwrap()
        .unwrap();
    let changed = listed.features().next().unwrap().field_as_string(0).unwrap().unwrap();
    [
        text(&json("result/lineage.json")["reference_date"]),
        text(&json("result/city.city.json")["metadata"]["referenceDate"]),
        Some(changed.replace('/', "-")[..10].to_owned()),
    ]
}

#[test]
fn results_have_the_last_day_of_the_flight_and_the_same_bytes_each_time() {
    let scene = with_photos(|i| format!("2025:05:{:02} 10:30:00", 12 + i % 3));
    assert_eq!(scene.run(&QUICK).code, 0);
    assert_eq!(days(&scene), [(); 3].map(|()| Some("2025-05-14".to_owned())));
    let bytes = |name: &str| fs::read(scene.path(name)).unwrap();
    let names = ["result/city.gpkg", "result/city.city.json", "result/lineage.json", "result/city.qgs"];
    let first = names.map(bytes);
    assert_eq!(scene.run(&QUICK).code, 0);
    assert!(first == names.map(bytes));
    // Somebody who knows better is believed.
    assert_eq!(scene.run(&[&QUICK[..], &["--set", "project.reference_date=\"2025-06-01\""]].concat()).code, 0);
    assert_eq!(days(&scene), [(); 3].map(|()| Some("2025-06-01".to_owned())));
}

#[test]
fn a_camera_whose_clock_was_never_set_tells_no_day() {
    let scene = with_photos(|_| "0000:00:00 00:00:00".to_owned());
    assert_eq!(scene.run(&QUICK).code, 0);
    assert_eq!(days(&scene), [None, None, Some("1970-01-01".to_owned())]);
}
