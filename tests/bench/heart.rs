//! The heart: tracing, evaluating and solving, on a grid of buildings like the paper's scenes.
//!
//! `cargo bench --bench heart`; the roofline alone: `cargo bench --bench heart -- roofline`

#![allow(clippy::print_stdout, reason = "a benchmark prints what it measured")]

mod town;

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, Throughput};
use sizeup::optimise::ViewInput;
use sizeup::optimise::{OptimiseConfig, Preset, Problem, Rays, solve};
use sizeup::prior::{DepthPrior, PriorGeometry, PriorKind};
use sizeup::render::image::SceneTracer;
use sizeup::render::profile::{CappedScene, Profiles, Sampling};
use sizeup::scene::Scene;
use town::town;

/// Memory that bandwidth is measured on, bytes: far more than any cache holds.
const BANDWIDTH_BYTES: usize = 512 << 20;
/// The fastest of so many passes counts.
const PASSES: usize = 7;

fn kernels(c: &mut Criterion) {
    let (scene, truth, views) = town(10, 5);
    let capped = CappedScene::new(&scene);
    let placed = &views[50].placed;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one");
    let sampling = Sampling { stride_px: 4, seed: 1, view: 0 };

    let mut group = c.benchmark_group("one core");
    let profiles = Profiles::trace(&scene, &capped, placed, sampling);
    let n_crossings: usize = (0..profiles.rays.len()).map(|i| profiles.intervals(i).len()).sum();
    println!(
        "{} rays, {:.2} intervals per ray, {:.1} bytes per ray",
        profiles.rays.len(),
        n_crossings as f64 / profiles.rays.len() as f64,
        profiles.bytes() as f64 / profiles.rays.len() as f64
    );
    group.throughput(Throughput::Elements(profiles.rays.len() as u64));
    group.bench_function("trace profiles", |b| {
        b.iter(|| pool.install(|| Profiles::trace(&scene, &capped, black_box(placed), sampling)));
    });
    let roofs = scene.roofs(&truth);
    group.bench_function("evaluate profiles", |b| {
        b.iter(|| (0..profiles.rays.len()).map(|i| profiles.sight(i, black_box(&roofs)).depth).sum::<f32>());
    });
    let tracer = SceneTracer::new(&scene, &truth);
    group.throughput(Throughput::Elements(448 * 336));
    group.bench_function("depth image", |b| b.iter(|| pool.install(|| tracer.render(black_box(placed)))));
    group.finish();
}

/// How far evaluating profiles is from what the memory can deliver, one core, all in one run: views that fit the cache
/// one by one, and all views of a town in turn, as a pass of the optimiser goes over them.
fn roofline(scene: &Scene, truth: &[f32], views: &[ViewInput]) {
    let words = vec![1_u64; BANDWIDTH_BYTES / 8];
    let mut copy = vec![0_u64; BANDWIDTH_BYTES / 8];
    let read = BANDWIDTH_BYTES as f64 / least_seconds(|| words.iter().fold(0, |sum: u64, w| sum.wrapping_add(*w)));
    let copied =
        2.0 * BANDWIDTH_BYTES as f64 / least_seconds(|| black_box(&mut copy).copy_from_slice(black_box(&words)));
    drop((words, copy));
    println!("roofline: this core reads {:.1} GB/s, copies {:.1} GB/s (both ways)", read / 1e9, copied / 1e9);

    let capped = CappedScene::new(scene);
    let trace = |view: &ViewInput| {
        Profiles::trace(scene, &capped, &view.placed, Sampling { stride_px: 4, seed: 1, view: view.key })
    };
    let all: Vec<Profiles> = views.iter().map(trace).collect();
    let roofs = scene.roofs(truth);
    let evaluate =
        |profiles: &Profiles| (0..profiles.rays.len()).map(|i| profiles.sight(i, black_box(&roofs)).depth).sum::<f32>();
    let one = [all[views.len() / 2].clone()];
    for (what, profiles, repeat) in [("one view", &one[..], 100), ("all views", &all[..], 1)] {
        let n_rays: usize = profiles.iter().map(|p| p.rays.len()).sum();
        let bytes: usize = profiles.iter().map(Profiles::bytes).sum();
        let seconds = least_seconds(|| (0..repeat).map(|_| profiles.iter().map(evaluate).sum::<f32>()).sum::<f32>());
        let evaluations = (repeat * n_rays) as f64 / seconds;
        let bytes_per_ray = bytes as f64 / n_rays as f64;
        println!(
            "roofline: {what}, {:.1} MB: {bytes_per_ray:.1} bytes per ray, {:.0} million evaluations/s, {:.1} GB/s or {:.0} % of \
             what the core reads",
            bytes as f64 / 1e6,
            evaluations / 1e6,
            evaluations * bytes_per_ray / 1e9,
            100.0 * evaluations * bytes_per_ray / read
        );
    }
}

fn least_seconds<T>(mut pass: impl FnMut() -> T) -> f64 {
    let mut timed = || {
        let start = Instant::now();
        black_box(pass());
        start.elapsed().as_secs_f64()
    };
    (0..PASSES).map(|_| timed()).fold(f64::INFINITY, f64::min)
}

fn solving(c: &mut Criterion) {
    let (scene, truth, views) = town(10, 5);
    let tracer = SceneTracer::new(&scene, &truth);
    let priors: Vec<DepthPrior> = views
        .iter()
        .map(|v| DepthPrior {
            values: tracer.render(&v.placed).depth,
            kind: PriorKind::Depth,
            geometry: PriorGeometry::ZDepth,
        })
        .collect();
    let load_prior = |view: usize| Ok(priors[view].clone());
    let solved = |config: &OptimiseConfig| {
        let problem = Problem {
            scene: &scene,
            views: &views,
            without_prior: &|_| None,
            load_prior: &load_prior,
            seed: 1,
            rays: &Rays::new(views.len(), config.stride_px),
            green: &|_| None,
            former: None,
            progress: &|_, _, _| {},
        };
        solve(&problem, config)
    };
    let mut group = c.benchmark_group("100 buildings, 100 views, all cores");
    group.sample_size(10);
    for preset in [Preset::Paper, Preset::Robust] {
        let config = OptimiseConfig { preset, ..OptimiseConfig::default() };
        let solution = solved(&config);
        let errors: Vec<f64> = solution
            .heights
            .iter()
            .zip(&truth)
            .filter_map(|(s, t)| Some((s.height_m? - f64::from(*t)).abs()))
            .collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        println!("{preset:?}: mean error {mean:.2} m, {} views used", solution.used_views.len());
        group.bench_function(format!("{preset:?}").to_lowercase(), |b| b.iter(|| solved(&config)));
    }
    group.finish();
}

fn main() {
    let (scene, truth, views) = town(10, 5);
    roofline(&scene, &truth, &views);
    let mut criterion = Criterion::default().configure_from_args();
    kernels(&mut criterion);
    solving(&mut criterion);
    criterion.final_summary();
}
