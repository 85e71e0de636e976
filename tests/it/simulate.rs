//! A simulated scene is whole, true and the same every time.

use std::path::Path;

use sizeup::simulate::{SimulateConfig, simulate};

#[test]
#[ignore = "writes a scene to look at: SIMULATE_PRESET, SIMULATE_OUT"]
fn write_a_preset_to_look_at() {
    let preset = std::env::var("SIMULATE_PRESET").unwrap_or("demo".to_owned());
    let out = std::env::var("SIMULATE_OUT").unwrap();
    let start = std::time::Instant::now();
    let summary = simulate(&SimulateConfig::preset(&preset).unwrap(), Path::new(&out), &|_, _| {}).unwrap();
    println!("{summary:?} in {:?}", start.elapsed());
}
