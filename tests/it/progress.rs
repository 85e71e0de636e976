//! `--progress json`: what programs that call ours are told.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::tiny_scene::{Outcome, Scene};

/// Every line of stderr as the event it is.
fn events(outcome: &Outcome) -> Vec<Value> {
    let event = |line: &str| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
    outcome.stderr.lines().map(event).collect()
}

/// The events that the published schema knows, with the keys that each has to have.
fn published() -> Vec<(String, Vec<String>)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas/progress.schema.json");
    let schema: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    let of = |variant: &Value| {
        let required = variant["required"].as_array().unwrap().iter().map(|key| key.as_str().unwrap().to_owned());
        (variant["properties"]["event"]["const"].as_str().unwrap().to_owned(), required.collect())
    };
    schema["oneOf"].as_array().unwrap().iter().map(of).collect()
}

fn assert_published(events: &[Value]) {
    let published = published();
    for event in events {
        let (_, required) = published.iter().find(|(name, _)| event["event"] == **name).expect("a published event");
        assert!(required.iter().all(|key| !event[key].is_null()), "{event}");
    }
}

#[test]
fn a_run_tells_its_stages_how_far_it_is_and_that_it_is_done() {
    let scene = Scene::new();
    let outcome = scene.run(&["--progress", "json"]);
    let events = events(&outcome);
    assert_published(&events);
    let stages: Vec<&str> = events.iter().filter_map(|event| event["stage"].as_str()).collect();
    assert_eq!(stages, ["survey", "footprints", "heights", "output"]);
    let advances: Vec<&Value> = events.iter().filter(|event| event["event"] == "advance").collect();
    assert!(advances.iter().all(|event| event["done"].as_u64() <= event["total"].as_u64()), "{advances:?}");
    // A bar of the whole needs no more than this.
    let shares: Vec<f64> = events.iter().filter_map(|event| event["share"].as_f64()).collect();
    assert!(
        shares.len() > 8 && shares.is_sorted() && shares[0] == 0.0 && shares.iter().all(|s| *s <= 1.0),
        "{shares:?}"
    );
    for what in ["tracing", "priors", "epochs"] {
        let mut of = advances.iter().filter(|event| event["what"] == what);
        assert!(of.any(|event| event["done"] == event["total"]), "{what}: {advances:?}");
    }
    let last = events.last().unwrap();
    assert_eq!((&last["event"], last["code"].as_i64()), (&"done".into(), Some(i64::from(outcome.code))));
    assert!(events.iter().any(|e| e["message"].as_str().is_some_and(|text| text.contains("results in"))));
    assert!(outcome.stdout.is_empty(), "stdout is for data");
}

#[test]
fn data_on_stdout_stays_what_it_is() {
    let scene = Scene::new();
    let outcome = scene.sizeup(&["--progress", "json", "--json", "run", "sizeup.toml", "--until", "survey"]);
    let summary: Value = serde_json::from_str(&outcome.stdout).unwrap();
    assert!(summary["n_views"].as_u64() > Some(0));
    assert_eq!(events(&outcome).last().unwrap()["event"], "done");
}

#[test]
fn an_error_is_the_last_line_with_code_message_and_hint() {
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| text.replace("EPSG:25832", "EPSG:4326"));
    let outcome = scene.run(&["--progress=json"]);
    let events = events(&outcome);
    assert_published(&events);
    let last = events.last().unwrap();
    assert_eq!((&last["event"], last["code"].as_i64(), outcome.code), (&"error".into(), Some(2), 2));
    assert!(last["message"].as_str().unwrap().contains("4326") && !last["message"].as_str().unwrap().contains("hint:"));
    assert!(!last["hint"].as_str().unwrap().is_empty());
}

#[test]
fn a_command_line_that_cannot_be_read_is_an_event_too() {
    let scene = Scene::new();
    for form in
        [&["--progress", "json", "run", "--nonsense"][..], &["run", "--progress=json", "sizeup.toml", "--nonsense"]]
    {
        let outcome = scene.sizeup(form);
        let events = events(&outcome);
        assert_eq!((outcome.code, events.len()), (2, 1), "{}", outcome.stderr);
        assert_eq!((&events[0]["event"], &events[0]["code"]), (&"error".into(), &2.into()));
    }
    let help = scene.sizeup(&["--progress", "json", "--version"]);
    assert!(help.code == 0 && help.stdout.starts_with("sizeup ") && help.stderr.is_empty(), "{}", help.stderr);
}

#[test]
fn quiet_leaves_the_end_alone() {
    let scene = Scene::new();
    let outcome = scene.run(&["--progress", "json", "--quiet", "--until", "survey"]);
    assert_eq!(events(&outcome).iter().map(|e| e["event"].as_str().unwrap()).collect::<Vec<_>>(), ["done"]);
}

#[test]
fn a_warning_is_a_message_of_that_level_without_the_word() {
    let scene = Scene::new();
    fs::create_dir_all(scene.path("result")).unwrap();
    fs::write(scene.path("result/city.city.json"), "{}").unwrap();
    fs::write(scene.path("result/UNFINISHED.txt"), "a run was started\n").unwrap();
    let outcome = scene.sizeup(&["export", "result", "city.gpkg", "--progress", "json"]);
    let told = &events(&outcome)[0];
    assert_eq!((&told["event"], &told["level"]), (&"message".into(), &"warning".into()), "{}", outcome.stderr);
    assert!(told["message"].as_str().unwrap().starts_with("result/city.city.json is not finished: a run was started"));
    let outcome = scene.sizeup(&["export", "result", "city.gpkg"]);
    assert!(outcome.stderr.starts_with("warning: result/city.city.json is not finished"), "{}", outcome.stderr);
}
