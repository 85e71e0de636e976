//! `sizeup survey align`, from outside: poses of a simulated survey that are off come back.

use std::fs;
use std::path::Path;
use std::process::Output;
use std::sync::LazyLock;

use assert_cmd::Command;
use glam::{DMat3, DQuat, DVec3};
use serde_json::Value;
use tempfile::TempDir;

use crate::tiny_scene::lab;

fn sizeup(args: &[&str], threads: &str) -> Output {
    Command::cargo_bin("sizeup").unwrap().args(args).env("RAYON_NUM_THREADS", threads).output().unwrap()
}

fn text_of(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Name, rotation and centre of each photo of a COLMAP model whose `[survey]` table is in a file.
fn poses(model: &Path, config: &Path) -> Vec<(String, DQuat, DVec3)> {
    let table: toml::Table = fs::read_to_string(config).unwrap().parse().unwrap();
    let survey = table.get("survey").and_then(toml::Value::as_table).unwrap_or(&table);
    let offset: Vec<f64> =
        survey["offset"].as_array().unwrap().iter().map(|axis| axis.to_string().parse().unwrap()).collect();
    let text = fs::read_to_string(model.join("images.txt")).unwrap();
    let pose = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let n: Vec<f64> = words[1..8].iter().map(|word| word.parse().unwrap()).collect();
        let turn = DQuat::from_xyzw(n[1], n[2], n[3], n[0]).normalize();
        (words[9].to_owned(), turn, DVec3::from_slice(&offset) - turn.inverse() * DVec3::new(n[4], n[5], n[6]))
    };
    text.lines().filter(|line| line.contains(".jpg")).map(pose).collect()
}

fn middle(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Medians of position and rotation errors, metres and degrees.
fn errors(found: &[(String, DQuat, DVec3)], truth: &[(String, DQuat, DVec3)]) -> [f64; 2] {
    assert_eq!(found.len(), truth.len());
    let pairs = || found.iter().zip(truth);
    [
        middle(pairs().map(|(a, b)| a.2.distance(b.2)).collect()),
        middle(pairs().map(|(a, b)| a.1.angle_between(b.1).to_degrees()).collect()),
    ]
}

fn simulate(folder: &Path, position_m: &str, angle_deg: &str) {
    let position = format!("errors.position_m={position_m}");
    let angle = format!("errors.angle_deg={angle_deg}");
    let settings = [
        "seed=5",
        "town.n_buildings=12",
        "flight.n_views=24",
        "camera.width_px=600",
        "camera.height_px=450",
        "masks.enabled=false",
        "prior.longest_px=64",
    ];
    let mut args = vec!["simulate", "--preset", "district", "--output", folder.to_str().unwrap()];
    settings.iter().chain([&position.as_str(), &angle.as_str()]).for_each(|setting| args.extend(["--set", setting]));
    let made = lab().args(&args).env("RAYON_NUM_THREADS", "2").output().unwrap();
    assert!(made.status.success(), "{}", text_of(&made.stderr));
}

/// A survey whose poses are off by much more than a pixel; tests write elsewhere.
fn given() -> &'static Path {
    static SCENE: LazyLock<TempDir> = LazyLock::new(|| {
        let folder = tempfile::tempdir().unwrap();
        simulate(folder.path(), "0.3", "0.5");
        folder
    });
    SCENE.path()
}

/// The same with its true poses.
fn truth() -> &'static Path {
    static SCENE: LazyLock<TempDir> = LazyLock::new(|| {
        let folder = tempfile::tempdir().unwrap();
        simulate(folder.path(), "0", "0");
        folder
    });
    SCENE.path()
}

#[test]
fn poses_that_are_off_come_back_and_are_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let [aligned, again] = ["aligned", "again"].map(|name| folder.path().join(name));
    let config = given().join("sizeup.toml");
    let align = |output: &Path, threads: &str| {
        let args = ["survey", "align", "--config", config.to_str().unwrap(), "--json", "--output"];
        let done = sizeup(&[&args[..], &[output.to_str().unwrap()]].concat(), threads);
        assert_eq!(done.status.code(), Some(0), "{}", text_of(&done.stderr));
        done
    };
    let report: Value = serde_json::from_slice(&align(&aligned, "2").stdout).unwrap();
    align(&again, "1");
    for file in ["images.txt", "poses.csv", "align.json"] {
        assert_eq!(fs::read(aligned.join(file)).unwrap(), fs::read(again.join(file)).unwrap(), "{file}");
    }
    let of_scene = |scene: &Path| poses(&scene.join("sparse"), &scene.join("sizeup.toml"));
    let found = poses(&aligned, &aligned.join("survey.toml"));
    let [before, after] = [&of_scene(given()), &found].map(|found| errors(found, &of_scene(truth())));
    assert!(after[0] < before[0] / 2.0 && after[1] < before[1] / 5.0, "{before:?} {after:?}");
    assert_eq!(report["is_taken"], true);
    let fall = |key: &str| report[key]["median_px"].as_f64().unwrap();
    assert!(fall("after") < 0.2 * fall("before"), "{} {}", report["before"], report["after"]);
    let table = aligned.join("poses.csv");
    let args =
        ["survey", "inspect", table.to_str().unwrap(), "--crs", "EPSG:25832", "--set", "survey.csv.angles=quaternion"];
    let read = sizeup(&[&args[..], &["--json"]].concat(), "2");
    assert_eq!(read.status.code(), Some(0), "{}{}", text_of(&read.stdout), text_of(&read.stderr));
}

#[test]
fn a_focal_length_that_is_off_is_found_where_the_camera_is_not_calibrated() {
    const TOO_LONG: f64 = 1.03;
    let folder = tempfile::tempdir().unwrap();
    let [scene, held, found] = ["scene", "held", "found"].map(|name| folder.path().join(name));
    simulate(&scene, "0.02", "0.1");
    let cameras = scene.join("sparse/cameras.txt");
    let focal_of = |path: &Path| -> f64 {
        let text = fs::read_to_string(path).unwrap();
        let line = text.lines().find(|line| !line.starts_with('#') && !line.trim().is_empty()).unwrap();
        line.split_whitespace().nth(4).unwrap().parse().unwrap()
    };
    let truth_px = focal_of(&cameras);
    let text = fs::read_to_string(&cameras).unwrap();
    let longer = |word: &str| match word.parse::<f64>() {
        Ok(value) if (value - truth_px).abs() < 1e-6 => format!("{}", value * TOO_LONG),
        _ => word.to_owned(),
    };
    let lines: Vec<String> =
        text.lines().map(|line| line.split(' ').map(longer).collect::<Vec<_>>().join(" ")).collect();
    fs::write(&cameras, lines.join("\n") + "\n").unwrap();
    assert!((focal_of(&cameras) / truth_px - TOO_LONG).abs() < 1e-9, "{text}");
    let config = scene.join("sizeup.toml");
    let align = |output: &Path, more: &[&str]| -> Value {
        let args = ["survey", "align", "--config", config.to_str().unwrap(), "--json", "--output"];
        let sigma = ["--set", "align.position_sigma_m=0.03"];
        let done = sizeup(&[&args[..], &[output.to_str().unwrap()], &sigma, more].concat(), "2");
        assert_eq!(done.status.code(), Some(0), "{}", text_of(&done.stderr));
        serde_json::from_slice(&done.stdout).unwrap()
    };
    let of_held = align(&held, &[]);
    let of_found = align(&found, &["--set", "align.focal_sigma_percent=5"]);
    let after = |report: &Value| report["after"]["median_px"].as_f64().unwrap();
    assert!(after(&of_found) < 0.7 * after(&of_held), "{} {}", after(&of_found), after(&of_held));
    assert!(of_held["cameras"].is_null(), "a calibrated camera stays as it is");
    let camera = &of_found["cameras"][0];
    assert_eq!(camera["n_photos"], 24, "{camera}");
    // The written model has it too; a pinhole's first numbers are its focal lengths.
    let [held_px, found_px] = [&held, &found].map(|model| focal_of(&model.join("cameras.txt")));
    println!("focal length {truth_px:.1} px, given {held_px:.1}, found {found_px:.1}");
    assert!((found_px / truth_px - 1.0).abs() < 0.002, "{truth_px} {found_px}");
    assert!((camera["focal_px"].as_f64().unwrap() - found_px).abs() < 0.1, "{camera} {found_px}");
}

/// A run up to its poses: what it says of them, and the poses' stage.
fn run_until_survey(config: &Path, output: &Path, more: &[&str]) -> (Value, Value) {
    let args = ["run", config.to_str().unwrap(), "--until", "survey", "--json", "--output", output.to_str().unwrap()];
    let done = sizeup(&[&args[..], more].concat(), "2");
    assert_eq!(done.status.code(), Some(0), "{}", text_of(&done.stderr));
    let stage = fs::read(output.join("stages").join("survey.json")).unwrap();
    (serde_json::from_slice(&done.stdout).unwrap(), serde_json::from_slice(&stage).unwrap())
}

/// The same of a scene whose depth comes from stereo.
fn stereo_until_survey(scene: &Path, output: &Path, more: &[&str]) -> (Value, Value) {
    // Beside the scene's own, for the paths in it.
    let config = scene.join("stereo.toml");
    let text = fs::read_to_string(scene.join("sizeup.toml")).unwrap();
    let (others, _) = text.split_once("[prior]").unwrap();
    fs::write(&config, format!("{others}[prior]\nsource = \"stereo\"\n")).unwrap();
    run_until_survey(&config, output, more)
}

#[test]
fn a_run_from_stereo_aligns_poses_that_the_photos_do_not_fit_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let [aligned, exact, as_given] = ["aligned", "exact", "as_given"].map(|name| folder.path().join(name));

    let (summary, stage) = stereo_until_survey(given(), &aligned, &[]);
    let told = summary["poses"].as_str().unwrap();
    assert!(told.contains("of 24 were aligned"), "{told}");
    let report: Value = serde_json::from_slice(&fs::read(aligned.join("align.json")).unwrap()).unwrap();
    assert_eq!(report["is_taken"], true);
    let codes: Vec<&str> =
        stage["data"]["issues"].as_array().unwrap().iter().map(|issue| issue["code"].as_str().unwrap()).collect();
    assert!(codes.contains(&"poses_aligned"), "{codes:?}");

    let (summary, exact_stage) = stereo_until_survey(truth(), &exact, &[]);
    assert!(summary["poses"].is_null() && !exact.join("align.json").exists(), "{summary}");
    let (summary, given_stage) = stereo_until_survey(given(), &as_given, &["--set", "align.when=never"]);
    assert!(summary["poses"].is_null(), "{summary}");
    let rotations = |stage: &Value| -> Vec<DMat3> {
        let views = stage["data"]["views"].as_array().unwrap();
        views.iter().map(|view| serde_json::from_value(view["camera_from_map"]["rotation"].clone()).unwrap()).collect()
    };
    let off_deg = |stage: &Value| {
        let pairs = rotations(stage).into_iter().zip(rotations(&exact_stage));
        let turns = pairs.map(|(a, b)| DQuat::from_mat3(&(a * b.transpose())).normalize().to_scaled_axis().length());
        middle(turns.map(f64::to_degrees).collect())
    };
    let (before, after) = (off_deg(&given_stage), off_deg(&stage));
    assert!(before > 0.5 && after < before / 5.0, "{before} {after}");
}

#[test]
fn a_run_whose_photos_refine_roofs_aligns_poses_that_are_half_a_pixel_off() {
    let folder = tempfile::tempdir().unwrap();
    let given = folder.path().join("given");
    simulate(&given, "0.05", "0.1");
    let run = |scene: &Path, name: &str, more: &[&str]| -> (Value, Option<Value>) {
        let output = folder.path().join(name);
        let (summary, _) = run_until_survey(&scene.join("sizeup.toml"), &output, more);
        let report = fs::read(output.join("align.json")).ok();
        (summary, report.map(|report| serde_json::from_slice(&report).unwrap()))
    };
    let (summary, report) = run(&given, "aligned", &[]);
    assert!(summary["poses"].as_str().unwrap().contains("of 24 were aligned"), "{summary}");
    let report = report.unwrap();
    let [before, after] = ["before", "after"].map(|when| report[when]["median_px"].as_f64().unwrap());
    assert!((0.4..1.5).contains(&before) && after < 0.4 * before, "{report}");
    // Photos that nobody asks about roofs do not ask for better poses.
    let not_asked = [&["--set", "refinement.enabled=false"][..], &["--set", "optimise.preset=paper"]];
    for (i, more) in not_asked.into_iter().enumerate() {
        let (summary, report) = run(&given, &format!("not-asked-{i}"), more);
        assert!(summary["poses"].is_null() && report.is_none(), "{more:?} {summary}");
    }
    let (summary, report) = run(truth(), "exact", &[]);
    assert!(summary["poses"].is_null() && report.is_none(), "{summary}");
}

#[test]
fn what_cannot_be_aligned_is_refused_with_a_hint_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (poses, output) = (folder.path().join("poses.csv"), folder.path().join("aligned"));
    let rows = "name,x,y,z,omega,phi,kappa,width,height,fx,cx,cy\n\
        a.jpg,566000,5763000,180,5,0,0,400,300,500,200,150\nb.jpg,566010,5763000,180,5,0,0,400,300,500,200,150\n";
    fs::write(&poses, rows).unwrap();
    let align = |more: &[&str]| {
        let args =
            ["survey", "align", poses.to_str().unwrap(), "--crs", "EPSG:25832", "--output", output.to_str().unwrap()];
        let refused = sizeup(&[&args[..], more].concat(), "2");
        assert!(!output.exists());
        (refused.status.code(), text_of(&refused.stderr))
    };
    let (code, told) = align(&[]);
    assert!(code == Some(3) && told.contains("how high the ground is") && told.contains("hint"), "{told}");
    let (code, told) = align(&["--ground", "80"]);
    assert!(code == Some(3) && told.contains("0 of 2 poses have a photo") && told.contains("--images"), "{told}");
    let (code, told) = align(&["--ground", "80", "--set", "align.long_side_px=1"]);
    assert!(code == Some(2) && told.contains("long_side_px") && told.contains("320 to 8192"), "{told}");
}
