//! The benchmark suites, small: they run, they go on where they were stopped, and their tables say what was measured.

use std::fs;

use serde_json::Value;

use crate::{Outcome, lab};

fn accuracy(folder: &std::path::Path, more: &[&str]) -> (Outcome, Value) {
    let mut command = lab();
    command.args(["benchmark", "accuracy", "--small", "--json", "--output"]).arg(folder).args(more);
    let outcome: Outcome = command.output().unwrap().into();
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let table = serde_json::from_str(&outcome.stdout).unwrap();
    (outcome, table)
}

fn row<'a>(table: &'a Value, level: &str, method: &str) -> &'a Value {
    let rows = table["rows"].as_array().unwrap();
    rows.iter().find(|r| r["level"] == level && r["method"] == method).unwrap()
}

#[test]
fn the_small_matrix_measures_every_method_and_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (_, first) = accuracy(folder.path(), &["--set", "levels=[\"clean\"]"]);
    assert_eq!(first["rows"].as_array().unwrap().len(), 3);
    for method in ["paper", "robust", "metric_lift"] {
        let statistics = &row(&first, "clean", method)["statistics"];
        assert!(statistics["n"].as_u64().unwrap() >= 5, "{method}: {statistics}");
        // Priors without errors but of 160 px: within metres, whatever the method.
        assert!(statistics["error_median_m"].as_f64().unwrap() < 2.5, "{method}: {statistics}");
    }
    // Without priors' errors a calibrated lift is at home.
    assert!(row(&first, "clean", "metric_lift")["statistics"]["error_median_m"].as_f64().unwrap() < 0.7);

    // A mark in an outcome survives a second run: it was taken over, not made anew; the new level is added.
    let path = folder.path().join("outcomes/village-clean-seed1-robust.json");
    let mut outcome: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    outcome["heights_s"] = 12_345.0.into();
    fs::write(&path, outcome.to_string()).unwrap();
    let (second, table) = accuracy(folder.path(), &[]);
    assert_eq!(row(&table, "clean", "robust")["heights_s"], 12_345.0);
    assert_eq!(table["rows"].as_array().unwrap().len(), 6);
    assert!(second.stderr.contains("village-mid-seed1"), "{}", second.stderr);
    let markdown = fs::read_to_string(folder.path().join("accuracy.md")).unwrap();
    assert!(markdown.contains("**mid**") && markdown.contains("| village | `metric_lift` |"), "{markdown}");
    // One program made all of them so far; what another one made is said, in the table too, and made anew on demand.
    assert!(markdown.contains("All 6 outcomes by `sizeup ") && !second.stderr.contains("outdated"), "{markdown}");
    outcome["program"] = "sizeup 0.0.1 (older)".into();
    fs::write(&path, outcome.to_string()).unwrap();
    let (mixed, table) = accuracy(folder.path(), &[]);
    assert_eq!(row(&table, "clean", "robust")["heights_s"], 12_345.0);
    assert!(mixed.stderr.contains("1 of 6 outcomes") && mixed.stderr.contains("--again outdated"), "{}", mixed.stderr);
    let markdown = fs::read_to_string(folder.path().join("accuracy.md")).unwrap();
    assert!(markdown.contains("different programs**: 1 by `sizeup 0.0.1 (older)`, 5 by `sizeup "), "{markdown}");
    let (fresh, table) = accuracy(folder.path(), &["--again", "outdated"]);
    assert_ne!(row(&table, "clean", "robust")["heights_s"], 12_345.0);
    assert!(!fresh.stderr.contains("outdated") && table["reliability"][0]["method"] == "robust", "{}", fresh.stderr);
    // Scenes are not kept unless asked for, and what is asked for again is made anew.
    assert!(fs::read_dir(folder.path().join("scenes")).unwrap().next().is_none());
    let (_, again) = accuracy(folder.path(), &["--again", "robust", "--keep-scenes"]);
    assert_ne!(row(&again, "clean", "robust")["heights_s"], 12_345.0);
    assert_eq!(row(&again, "clean", "robust")["statistics"], row(&first, "clean", "robust")["statistics"]);
    assert!(folder.path().join("scenes/village-clean-seed1/sizeup.toml").is_file());
}

#[test]
fn an_empty_list_and_an_unknown_method_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    let run = |more: &[&str]| -> Outcome {
        let mut command = lab();
        command.args(["benchmark", "accuracy", "--small", "--output"]).arg(folder.path()).args(more);
        command.output().unwrap().into()
    };
    let empty = run(&["--set", "seeds=[]"]);
    assert_eq!(empty.code, 2);
    assert!(empty.stderr.contains("seeds is empty"), "{}", empty.stderr);
    let unknown = run(&["--again", "magic"]);
    assert_eq!(unknown.code, 2);
    assert!(unknown.stderr.contains("metric_lift"), "{}", unknown.stderr);
}

#[test]
fn the_papers_tables_have_every_method_and_keep_its_own_numbers_apart() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = lab();
    command
        .args([
            "benchmark",
            "paper",
            "--small",
            "--set",
            "scenes=[\"mini-village\"]",
            "--set",
            "studies={of=[]}",
            "--output",
        ])
        .arg(folder.path());
    let outcome: Outcome = command.output().unwrap().into();
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let (ours, published) = outcome.stdout.split_once("Published by the paper").unwrap();
    for method in [
        "paper",
        "robust",
        "metric_lift",
        "regression_l2",
        "points_p90",
        "neighbourhood",
        "convex_hull",
        "stacked_prisms",
    ] {
        let rows_of = |name: &str| ours.lines().filter(|line| line.contains(&format!("| {name} |"))).count();
        assert_eq!(
            rows_of(&format!("`{method}`")),
            2,
            "{method} in the table of heights and in that of bodies:\n{ours}"
        );
        let n_formed = rows_of(&format!("`{method}`, LOD 2.0"));
        assert_eq!(n_formed, usize::from(method == "robust"), "{method}: roof forms in the table of bodies:\n{ours}");
    }
    assert!(published.contains("| res-1 | SiZeUp | 3.73/5.38 |") && !ours.contains("3.73/5.38"));
    let tables: Value = serde_json::from_slice(&fs::read(folder.path().join("paper.json")).unwrap()).unwrap();
    let outcomes = tables["scenes"][0]["outcomes"].as_array().unwrap();
    // Medians of points in the footprints are far better than a hull's top, and stacks fill their volume better than hulls.
    let of = |method: &str| outcomes.iter().find(|o| o["method"] == method).unwrap();
    let error = |method: &str| of(method)["heights"]["all"]["error_mean_m"].as_f64().unwrap();
    assert!(error("points_p50") < error("convex_hull"));
    let iou = |method: &str| of(method)["bodies"]["volume"]["voxel_iou"]["0.5"].as_f64().unwrap();
    assert!(iou("stacked_prisms") > iou("convex_hull") && iou("points_p50") > 0.6);
    let unknown: Outcome = lab()
        .args(["benchmark", "paper", "--set", "scenes=[\"res-9\"]", "--output"])
        .arg(folder.path())
        .output()
        .unwrap()
        .into();
    assert!(unknown.code == 2 && unknown.stderr.contains("mini-village"), "{}", unknown.stderr);
}

/// A village's roofs are pitched: blocks leave a good part of them uncovered, and their forms, where nothing else is wrong, nearly none.
#[test]
fn bodies_are_compared_at_the_results_highest_level_of_detail_too() {
    let folder = tempfile::tempdir().unwrap();
    let settings = [
        "scenes=[\"mini-village\"]",
        "methods=[\"robust\"]",
        "studies={of=[]}",
        "shrink=[8,24,448]",
        "level=\"clean\"",
        "errors.vertex_m=0",
        "errors.footprint_m=0",
        "errors.position_m=0",
        "errors.angle_deg=0",
    ];
    let mut command = lab();
    command.args(["benchmark", "paper", "--small"]).args(settings.iter().flat_map(|key| ["--set", key]));
    command.arg("--output").arg(folder.path());
    let outcome: Outcome = command.output().unwrap().into();
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let tables: Value = serde_json::from_slice(&fs::read(folder.path().join("paper.json")).unwrap()).unwrap();
    let of =
        |bodies: &str, measure: &str| tables["scenes"][0]["outcomes"][0][bodies]["surface"][measure].as_f64().unwrap();
    let [blocks, formed] = ["bodies", "formed_bodies"].map(|bodies| of(bodies, "completeness_05"));
    assert!(blocks < 0.92 && formed > 0.96, "within 0.5 m: {blocks} of blocks, {formed} with the forms of roofs");
    assert!(of("formed_bodies", "error_95_m") < 0.5 * of("bodies", "error_95_m"));
}

#[test]
fn the_papers_studies_change_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let outcome: Outcome = lab()
        .args(["benchmark", "paper", "--small", "--set", "scenes=[\"mini-village\"]"])
        .args(["--set", "methods=[\"robust\"]", "--set", "studies.of=[\"cover\",\"range\"]", "--output"])
        .arg(folder.path())
        .output()
        .unwrap()
        .into();
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let tables: Value = serde_json::from_slice(&fs::read(folder.path().join("studies.json")).unwrap()).unwrap();
    let rows = |study: usize| tables["studies"][study][1].as_array().unwrap().clone();
    // More views per building are more views, where no others are selected.
    let selected: Vec<f64> = rows(0)[1..].iter().map(|row| row["n_selected"].as_f64().unwrap()).collect();
    assert!(selected.len() == 5 && selected.is_sorted() && selected[4] > selected[0] + 2.0, "{selected:?}");
    // A range that was set is the one that heights are started from.
    let means: Vec<f64> = rows(1).iter().map(|row| row["statistics"]["error_mean_m"].as_f64().unwrap()).collect();
    assert!(means[1..].iter().all(|mean| *mean != means[0]), "{means:?}");
}

#[test]
fn textures_are_nearer_to_photos_left_out_than_the_best_photo_of_each_surface() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = lab();
    command.args(["benchmark", "textures", "--small", "--json", "--output"]).arg(folder.path());
    let outcome: Outcome = command.output().unwrap().into();
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let table: Value = serde_json::from_str(&outcome.stdout).unwrap();
    let of = |method: &str, name: &str| {
        let rows = table["rows"].as_array().unwrap();
        rows.iter().find(|row| row["method"] == method).unwrap()[name].as_f64().unwrap()
    };
    assert_eq!(of("agreeing", "n_photos"), 5.0, "every fifth of 25 photos");
    for name in ["ssim", "psnr_db"] {
        assert!(of("agreeing", name) > of("plain", name), "{name}: {table:#}");
    }
    // The aims of a town without depth errors, however small its photos.
    assert!(of("agreeing", "ssim") > 0.75 && of("agreeing", "psnr_db") > 22.0, "{table:#}");
    let markdown = fs::read_to_string(folder.path().join("textures.md")).unwrap();
    assert!(markdown.contains("| district | `agreeing` |"), "{markdown}");
    assert!(folder.path().join("pictures/district-agreeing.png").is_file());
    assert!(!folder.path().join("scenes/district").exists(), "scenes are not kept unless asked for");
}

#[test]
fn a_pass_that_is_left_out_is_a_row_with_other_heights() {
    let folder = tempfile::tempdir().unwrap();
    let run = |changes: &[&str]| -> Outcome {
        let mut command = lab();
        command.args(["benchmark", "passes", "--small", "--json", "--output"]).arg(folder.path());
        command.args(changes).output().unwrap().into()
    };
    let outcome = run(&[]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let table: Value = serde_json::from_str(&outcome.stdout).unwrap();
    let rows = table["rows"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|row| row["change"].as_str().unwrap()).collect();
    assert_eq!(names, ["as it is", "roof_forms = []"]);
    let mean_m = |i: usize| rows[i]["error_mean_m"].as_f64().unwrap();
    // A flat roof over a gable stands a third of the way up, not half.
    assert!(mean_m(0) < mean_m(1) && mean_m(0) < 1.0, "{table:#}");
    let unknown = run(&["--set", "changes=[\"no rays\"]"]);
    assert_eq!(unknown.code, 2, "{}", unknown.stderr);
    assert!(unknown.stderr.contains("split_levels = false"), "{}", unknown.stderr);
}
