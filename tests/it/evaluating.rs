//! The command `sizeup evaluate`, and what it reports.

use std::path::Path;

use serde_json::{Value, json};

use crate::tiny_scene::{Outcome, sizeup};

/// `sizeup evaluate` and more arguments.
pub fn evaluate(result: &Path, truth: &Path, more: &[&str]) -> Outcome {
    sizeup().arg("evaluate").args([result, truth]).args(more).output().unwrap().into()
}

/// Its report as JSON.
pub fn report(result: &Path, truth: &Path, more: &[&str]) -> Value {
    let outcome = evaluate(result, truth, &[more, &["--json"]].concat());
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    serde_json::from_str(&outcome.stdout).unwrap()
}

/// A figure of a report.
pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// Two photos with known houses, as COCO: one drawn by run lengths, one by a polygon.
fn true_footprints() -> Value {
    // 40 columns and 20 rows; columns 4 to 13 from row 2 to 11.
    let counts: Vec<usize> = std::iter::once(4 * 20 + 2)
        .chain((0..10).flat_map(|i| if i < 9 { vec![10, 10] } else { vec![10] }))
        .chain([8 + 26 * 20])
        .collect();
    json!({
        "images": [
            {"id": 1, "file_name": "a/1.png", "width": 40, "height": 20},
            {"id": 2, "file_name": "a/2.png", "width": 40, "height": 20},
        ],
        "annotations": [
            {"image_id": 1, "segmentation": {"size": [20, 40], "counts": counts}},
            {"image_id": 2, "segmentation": [[10, 5, 20, 5, 20, 15, 10, 15]]},
        ],
        "categories": [{"id": 1, "name": "building"}],
    })
}

/// A square of 10 with its upper left corner at (`x`, `y`).
fn square(photo: i64, [x, y]: [f64; 2]) -> Value {
    json!({"image_id": photo, "score": 0.9, "category_id": 1,
        "segmentation": [[x, y, x + 10.0, y, x + 10.0, y + 10.0, x, y + 10.0]]})
}

#[test]
fn footprints_in_photos_are_measured_by_area_and_by_detection() {
    let folder = tempfile::tempdir().unwrap();
    let [truth, found] = ["truth.json", "found.json"].map(|name| folder.path().join(name));
    std::fs::write(&truth, true_footprints().to_string()).unwrap();
    // As a detector writes its results: a list. The first house moved by 2 (80 of 120 shared), the second found exactly, one
    // where no house is, and one of a low score.
    let mut doubtful = square(2, [25.0, 5.0]);
    doubtful["score"] = 0.2.into();
    let list = json!([square(1, [6.0, 2.0]), square(1, [25.0, 5.0]), square(2, [10.0, 5.0]), doubtful]);
    std::fs::write(&found, list.to_string()).unwrap();
    let measured = report(&found, &truth, &["--min-score", "0.5"]);
    let figure = |path: &str| number(measured.pointer(path).unwrap_or_else(|| panic!("no {path}")));
    // A mask's footprint cuts its corners, by half of half a pixel's square each.
    for (path, expected) in [
        ("/area_by_building/iou", f64::midpoint(2.0 / 3.0, 1.0)),
        ("/area_by_building/precision", 0.9),
        ("/area_by_building/recall", 0.9),
        ("/area_by_photo/f1", 0.9),
        ("/detection/precision", 2.0 / 3.0),
        ("/detection/recall", 1.0),
        ("/detection_by_photo/f1", f64::midpoint(2.0 / 3.0, 1.0)),
    ] {
        assert!((figure(path) - expected).abs() < 0.004, "{path}: {} {expected}", figure(path));
    }
    assert_eq!([figure("/n_found"), figure("/n_truth"), figure("/n_hits")], [3.0, 2.0, 2.0]);
    let all = report(&found, &truth, &[]);
    assert_eq!(number(&all["n_found"]), 4.0);
    assert!(evaluate(&found, &truth, &[]).stdout.contains("area, by building: IoU 83."));
}

#[test]
fn roofs_with_an_offset_are_moved_back_onto_the_ground() {
    let folder = tempfile::tempdir().unwrap();
    let [truth, found] = ["truth.json", "found.json"].map(|name| folder.path().join(name));
    let mut document = true_footprints();
    std::fs::write(&truth, document.to_string()).unwrap();
    let mut roof = square(2, [13.0, 1.0]);
    roof["offset"] = json!([3.0, -4.0]);
    document["annotations"] = json!([roof]);
    std::fs::write(&found, document.to_string()).unwrap();
    let moved = report(&found, &truth, &["--roof-offset"]);
    assert!((number(&moved["area_by_building"]["iou"]) - 0.5).abs() < 1e-9 && number(&moved["n_hits"]) == 1.0);
    // 7 × 6 of 158 shared where it stays.
    let stayed = report(&found, &truth, &[]);
    assert!((number(&stayed["area_by_building"]["iou"]) - 0.5 * 42.0 / 158.0).abs() < 1e-9, "{stayed}");
}

#[test]
fn footprints_in_photos_that_cannot_be_compared_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let [truth, found] = ["truth.json", "found.json"].map(|name| folder.path().join(name));
    std::fs::write(&truth, true_footprints().to_string()).unwrap();
    let refused = |document: &Value, more: &[&str], words: &[&str]| {
        std::fs::write(&found, document.to_string()).unwrap();
        let outcome = evaluate(&found, &truth, more);
        assert_eq!(outcome.code, 3, "{}", outcome.stderr);
        for word in words.iter().chain(&["found.json", "hint: "]) {
            assert!(outcome.stderr.contains(word), "{word:?} is not in: {}", outcome.stderr);
        }
    };
    let changed = |change: &dyn Fn(&mut Value)| {
        let mut document = true_footprints();
        change(&mut document);
        document
    };
    refused(&json!([square(7, [1.0, 1.0])]), &[], &["annotation 1 is of photo 7"]);
    refused(&true_footprints(), &["--roof-offset"], &["annotation 1 of a/1.png has no offset"]);
    refused(&changed(&|d| d["images"][1]["width"] = 41.into()), &[], &["a/2.png is 41 × 20 pixels", "40 × 20"]);
    refused(&changed(&|d| d["images"][0]["width"] = 41.into()), &[], &["annotation 1 of a/1.png is a mask of 40 × 20"]);
    let elsewhere = changed(&|d| {
        d["images"] = json!([{"id": 1, "file_name": "b/9.png", "width": 40, "height": 20}]);
        d["annotations"] = json!([]);
    });
    refused(&elsewhere, &[], &["none of the 2 photos"]);
    refused(&changed(&|d| d["annotations"][1]["segmentation"] = json!([[1, 2, 3, 4, 5, 6, 7]])), &[], &["7 numbers"]);
    refused(&json!({"type": "CityJSON"}), &[], &["no COCO file"]);
}
