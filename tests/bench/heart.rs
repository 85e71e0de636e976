//! The heart: tracing, evaluating and solving, on a grid of buildings like the paper's scenes.
//!
//! `cargo bench --bench heart`

use std::f64::consts::{FRAC_PI_2, PI};
use std::hint::black_box;

use criterion::{Criterion, Throughput};
use geo_types::polygon;
use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::frames::Rigid;
use sizeup::optimise::{OptimiseConfig, Preset, Problem, ViewInput, solve};
use sizeup::prior::{DepthPrior, PriorGeometry, PriorKind};
use sizeup::render::PlacedCamera;
use sizeup::render::image::SceneTracer;
use sizeup::render::profile::{CappedScene, Profiles, Sampling};
use sizeup::scene::{HeightBounds, Scene};
use sizeup::terrain::{GroundLevel, Terrain};

/// `side × side` buildings of 5 to 45 m, 35 m apart, and obliques from four sides 150 m above ground.
fn town(side: u32, n_stations: u32) -> (Scene, Vec<f32>, Vec<ViewInput>) {
    let polygons: Vec<_> = (0..side * side)
        .map(|i| {
            let (x, y) = (f64::from(i % side) * 35.0, f64::from(i / side) * 35.0);
            let (w, d) = (14.0 + f64::from(i * 7 % 9), 11.0 + f64::from(i * 5 % 11));
            polygon![(x: x, y: y), (x: x + w, y: y), (x: x + w, y: y + d), (x: x, y: y + d)]
        })
        .collect();
    let truth = (0..side * side).map(|i| 5.0 + (i * 13 % 40) as f32).collect();
    let ground = GroundLevel { reference_m: 0.0, lowest_m: 0.0 };
    let footprints: Vec<_> = polygons.iter().map(|p| (p, ground)).collect();
    let bounds = HeightBounds { min_m: 2.0, max_m: 120.0 };
    let scene = Scene::new(&footprints, &Terrain::Constant(0.0), bounds, 500.0);
    let extent = f64::from(side) * 35.0;
    let mut views = Vec::new();
    for station in 0..n_stations * n_stations {
        for heading in 0..4 {
            let along = |i: u32| (f64::from(i) + 0.5) / f64::from(n_stations) * extent;
            let turn = DMat3::from_rotation_z(f64::from(heading) * FRAC_PI_2);
            let rotation = DMat3::from_rotation_x(PI - FRAC_PI_2 / 2.0) * turn;
            let look = rotation.transpose() * DVec3::Z;
            let target = DVec3::new(along(station % n_stations), along(station / n_stations), 0.0);
            let pose = Rigid::from_rotation_and_centre(rotation, target - look * (150.0 / -look.z));
            let placed = PlacedCamera::new(Camera::pinhole(448, 336, 360.0), pose, scene.origin);
            views.push(ViewInput { placed, is_oblique: true, key: views.len() as u64 });
        }
    }
    (scene, truth, views)
}

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
