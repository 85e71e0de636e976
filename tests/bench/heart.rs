//! The heart: tracing, evaluating and solving, on a grid of buildings like the paper's scenes.
//!
//! `cargo bench --bench heart`

mod town;

use std::hint::black_box;

use criterion::{Criterion, Throughput};
use sizeup::optimise::{OptimiseConfig, Preset, Problem, solve};
use sizeup::prior::{DepthPrior, PriorGeometry, PriorKind};
use sizeup::render::image::SceneTracer;
use sizeup::render::profile::{CappedScene, Profiles, Sampling};
use town::town;

fn kernels(c: &mut Criterion) {
    let (scene, truth, views) = town(10, 5);
    let capped = CappedScene::new(&scene);
    let placed = &views[50].placed;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one");
    let sampling = Sampling { stride_px: 4, seed: 1, view: 0 };

    let mut group = c.benchmark_group("one core");
    let profiles = Profiles::trace(&scene, &capped, placed, sampling);
    let n_crossings: usize = (0..profiles.rays.len()).map(|i| profiles.crossings(i).len()).sum();
    println!(
        "{} rays, {:.2} crossings per ray, {:.1} bytes per ray",
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
    let problem = Problem {
        scene: &scene,
        views: &views,
        load_prior: &|v| Ok(priors[v].clone()),
        seed: 1,
        start_m: &[],
        progress: &|_, _, _| {},
    };
    let mut group = c.benchmark_group("100 buildings, 100 views, all cores");
    group.sample_size(10);
    for preset in [Preset::Paper, Preset::Robust] {
        let config = OptimiseConfig { preset, ..OptimiseConfig::default() };
        let solution = solve(&problem, &config);
        let errors: Vec<f64> = solution
            .heights
            .iter()
            .zip(&truth)
            .filter_map(|(s, t)| Some((s.height_m? - f64::from(*t)).abs()))
            .collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        println!("{preset:?}: mean error {mean:.2} m, {} views used", solution.used_views.len());
        group.bench_function(format!("{preset:?}").to_lowercase(), |b| b.iter(|| solve(&problem, &config)));
    }
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    kernels(&mut criterion);
    solving(&mut criterion);
    criterion.final_summary();
}
