//! Priors of photos of 12 megapixels by networks: the stages of the work one after another, and overlapped.
//!
//! `cargo bench --bench priors`. The photos are simulated into target/bench-photos at the first time. A network that costs nothing, and a
//! real architecture where `make networks deps-onnxruntime` has left one.

#![allow(clippy::print_stdout, reason = "a benchmark prints what it measured")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use sizeup::config::RunConfig;
use sizeup::prior::{CacheConfig, NetworkConfig, PriorConfig, PriorSource as _, Priors};
use sizeup::simulate::{SimulateConfig, simulate};
use sizeup::stats;
use sizeup::survey::{self, View};
use sizeup::terrain::Terrain;

const N_ROUNDS: usize = 5;

type Way = (&'static str, fn(&Priors, &[&View]));

/// How, and what is done; the first one is what the others are compared with.
const WAYS: [Way; 3] = [
    ("one after another", |priors, views| views.iter().for_each(|view| load(priors, view))),
    ("a photo on each core", |priors, views| views.par_iter().with_max_len(1).for_each(|view| load(priors, view))),
    ("overlapped", ahead),
];

fn load(priors: &Priors, view: &View) {
    priors.load(view).expect("every photo has a prior");
}

fn ahead(priors: &Priors, views: &[&View]) {
    let outcomes = priors.compute_ahead(views, &|| {});
    assert!(outcomes.iter().all(|outcome| *outcome == Ok(false)), "{outcomes:?}");
}

/// Photos of a small town, as `sizeup simulate` makes them.
fn photos(folder: &Path) -> Vec<View> {
    if !folder.join("sizeup.toml").exists() {
        let mut config = SimulateConfig::default();
        (config.camera.width_px, config.camera.height_px) = (4000, 3000);
        config.flight.n_views = Some(16);
        config.town.n_buildings = 20;
        config.masks.enabled = false;
        simulate(&config, folder, &|_, _| {}).expect("photos are simulated");
    }
    let config = RunConfig::load(&folder.join("sizeup.toml"), &[]).expect("a run configuration");
    survey::read(&config.survey, &config.project.crs).expect("poses").views
}

/// Seconds of all cores together that this process has used.
fn processor_s() -> f64 {
    const TICKS_PER_S: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name of the program, in brackets, may hold spaces.
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    fields
        .get(11..13)
        .map_or(f64::NAN, |ticks| ticks.iter().filter_map(|t| t.parse::<f64>().ok()).sum::<f64>() / TICKS_PER_S)
}

/// All ways in turn, several times: what else goes on on the machine falls on all of them.
fn compare(name: &str, network: &NetworkConfig, views: &[View]) {
    let mut rounds: Vec<Vec<[f64; 2]>> = Vec::new();
    for _ in 0..N_ROUNDS {
        let time = |(_, compute): &Way| {
            let folder = tempfile::tempdir().expect("a folder for the cache");
            let cache = CacheConfig { folder: folder.path().to_owned(), ..CacheConfig::default() };
            let network = NetworkConfig { cache, ..network.clone() };
            let priors =
                PriorConfig::Network(Box::new(network)).open(views, &Terrain::Constant(0.0), 80.0).expect("a network");
            let (start, processor) = (Instant::now(), processor_s());
            compute(&priors, &views.iter().collect::<Vec<_>>());
            [start.elapsed().as_secs_f64(), processor_s() - processor]
        };
        rounds.push(WAYS.iter().map(time).collect());
    }
    println!("{name}, {} photos, {N_ROUNDS} rounds", views.len());
    for (i, (how, _)) in WAYS.iter().enumerate() {
        let median = |of: &dyn Fn(&Vec<[f64; 2]>) -> f64| {
            stats::median(&rounds.iter().map(of).collect::<Vec<_>>()).expect("rounds") / views.len() as f64
        };
        println!(
            "  {how:<26} {:.3} s per photo, {:.3} s of processor time; {:.2} of the time of the first",
            median(&|round| round[i][0]),
            median(&|round| round[i][1]),
            median(&|round| round[i][0] / round[0][0]) * views.len() as f64
        );
    }
}

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let views = photos(&root.join("target/bench-photos"));
    let free = NetworkConfig::new(root.join("fixtures/onnx/depth_of_brightness.onnx"), "da3-mono");
    compare("a network that costs nothing", &free, &views);
    let real: PathBuf = root.join("target/networks/graphs/depth-anything-v2-small.onnx");
    if real.exists() {
        let mut real = NetworkConfig::new(real, "depth-anything-v2");
        real.engine.library = Some(root.join("target/onnxruntime/libonnxruntime.so"));
        compare("Depth Anything V2 Small", &real, &views[..views.len().min(4)]);
    }
}
