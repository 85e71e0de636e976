//! Depth images beside Embree's: the same prisms and rays, one core each, in one run.
//!
//! `cargo bench --bench embree`; needs `libembree-dev` and a C++ compiler, which nothing else here does.

mod town;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use glam::{DVec2, Vec3};
use sizeup::ray::Ray;
use sizeup::render::image::SceneTracer;
use sizeup::scene::Scene;
use town::town;

/// Half the side of the ground's square, metres.
const GROUND_M: f32 = 20_000.0;
/// The fastest of so many passes counts.
const PASSES: usize = 9;

fn main() {
    let (scene, heights_m, views) = town(10, 5);
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let program = folder.join("embree-trace");
    if !compile(&program) {
        println!("skipped: no Embree 3 to compare with (apt-get install libembree-dev)");
        return;
    }
    let triangles = triangles(&scene, &heights_m);
    let tracer = SceneTracer::new(&scene, &heights_m);
    println!("view: sizeup, Embree ray by ray, Embree in packets of 8 (million rays per second and core); agreement");
    for view in [0, 37, 50, 63, 99] {
        let placed = &views[view].placed;
        let rays: Vec<Ray> = (0..448 * 336)
            .filter_map(|i| placed.ray(DVec2::new(f64::from(i % 448) + 0.5, f64::from(i / 448) + 0.5)))
            .collect();
        let (mut scratch, mut depths) = (Vec::new(), Vec::new());
        let mut least = f64::INFINITY;
        for _ in 0..PASSES {
            let start = Instant::now();
            depths = rays.iter().map(|ray| tracer.trace(ray, &mut scratch).0).collect();
            least = least.min(start.elapsed().as_secs_f64());
        }
        let file = folder.join("embree.bin");
        write(&file, &triangles, &rays, &depths);
        let answer = Command::new(&program).arg(&file).output().expect("it was just compiled");
        let answer = String::from_utf8_lossy(&answer.stdout).into_owned();
        let figures: Vec<f64> = answer.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let [single, packets, greatest_m, differ] = figures[..] else { panic!("unexpected answer: {answer}") };
        let ours = rays.len() as f64 / least / 1e6;
        println!(
            "{view:3}: {ours:.1}, {single:.1}, {packets:.1}; within {greatest_m:.4} m but for {:.3} % of the rays",
            100.0 * differ
        );
    }
}

fn compile(program: &Path) -> bool {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bench/embree/trace.cpp");
    let compiler =
        Command::new("c++").args(["-O3", "-march=native", "-o"]).arg(program).arg(source).arg("-lembree3").status();
    compiler.is_ok_and(|status| status.success())
}

/// Walls and roofs of rectangular prisms, and the ground.
fn triangles(scene: &Scene, heights_m: &[f32]) -> Vec<[Vec3; 3]> {
    let mut triangles = Vec::new();
    let mut quad = |[a, b, c, d]: [Vec3; 4]| triangles.extend([[a, b, c], [a, c, d]]);
    for (prism, roof) in scene.prisms.iter().zip(scene.roofs(heights_m)) {
        let ring = prism.rings().next().expect("every prism has an outline");
        for edge in ring.windows(2) {
            let at = |corner: usize, z: f32| edge[corner].extend(z);
            quad([at(0, 0.0), at(1, 0.0), at(1, roof), at(0, roof)]);
        }
        quad([0, 1, 2, 3].map(|corner| ring[corner].extend(roof)));
    }
    let corner = |x: f32, y: f32| Vec3::new(x * GROUND_M, y * GROUND_M, 0.0);
    quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    triangles
}

fn write(file: &Path, triangles: &[[Vec3; 3]], rays: &[Ray], depths: &[f32]) {
    let mut bytes = Vec::new();
    bytes.extend((triangles.len() as u32).to_le_bytes());
    let corners = triangles.iter().flatten().flat_map(Vec3::to_array);
    bytes.extend(corners.flat_map(f32::to_le_bytes));
    bytes.extend((rays.len() as u32).to_le_bytes());
    for (ray, depth) in rays.iter().zip(depths) {
        let expected = if depth.is_nan() { f32::INFINITY } else { *depth };
        let values = ray.origin.to_array().into_iter().chain(ray.direction.to_array()).chain([expected]);
        bytes.extend(values.flat_map(f32::to_le_bytes));
    }
    std::fs::write(file, bytes).expect("the folder for temporary files of tests can be written to");
}
