//! Depth images beside Embree's: the same prisms and rays, one core each, in one run.
//!
//! `cargo bench --bench embree`; needs `libembree-dev` and a C++ compiler, which nothing else here does.

#![allow(clippy::print_stdout, reason = "a benchmark prints what it measured")]

mod town;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use glam::{DVec2, Vec3};
use sizeup::ray::Ray;
use sizeup::render::image::SceneTracer;
use sizeup::render::tile::{RayTile, TILE};
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
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one");
    println!(
        "view: sizeup ray by ray, in tiles of 64, whole images with their rays made; Embree ray by ray, in packets of 8, \
         in packets of 16, in streams of 64"
    );
    println!("(million rays per second and core); tiles against the fastest of Embree's; agreement");
    for view in [0, 37, 50, 63, 99] {
        let placed = &views[view].placed;
        let rays: Vec<Ray> = (0..448 * 336)
            .filter_map(|i| placed.ray(DVec2::new(f64::from(i % 448) + 0.5, f64::from(i / 448) + 0.5)))
            .collect();
        let mut scratch = Vec::new();
        let (single_s, depths) =
            least_seconds(|| rays.iter().map(|ray| tracer.trace(ray, &mut scratch).0).collect::<Vec<f32>>());
        // 8 × 8 pixels, in packets of 4 × 2.
        let pixel = |tile: usize, k: usize| {
            let (col, row) = (8 * (tile % 56) + k % 4 + 4 * (k / 8 % 2), 8 * (tile / 56) + k / 4 % 2 + 2 * (k / 16));
            448 * row + col
        };
        let tiles: Vec<[Ray; TILE]> = (0..56 * 42).map(|tile| std::array::from_fn(|k| rays[pixel(tile, k)])).collect();
        // Both sides are given rays one after another, and fill their registers' arrays within the time that counts.
        let seen_by =
            |rays: &[Ray; TILE]| tracer.trace_tile(&RayTile::new(rays[0].origin, |k| Some(rays[k].direction)));
        let (tiles_s, in_tiles) = least_seconds(|| tiles.iter().map(seen_by).collect::<Vec<_>>());
        for (tile, seen) in in_tiles.iter().enumerate() {
            let is_same = |(k, depth): (usize, &f32)| depths[pixel(tile, k)].to_bits() == depth.to_bits();
            assert!(seen.depth.iter().enumerate().all(is_same), "tiles see what single rays see");
        }
        let (image_s, _) = least_seconds(|| pool.install(|| tracer.render(placed)));
        let file = folder.join("embree.bin");
        // Embree gets the rays tile by tile too: rays of one packet are nearer to each other than those of a row.
        let order: Vec<usize> = (0..tiles.len()).flat_map(|tile| (0..TILE).map(move |k| pixel(tile, k))).collect();
        write(&file, &triangles, order.iter().map(|pixel| (&rays[*pixel], depths[*pixel])));
        let answer = Command::new(&program).arg(&file).output().expect("it was just compiled");
        let answer = String::from_utf8_lossy(&answer.stdout).into_owned();
        let figures: Vec<f64> = answer.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let [single, of_8, of_16, streams, greatest_m, differ] = figures[..] else {
            panic!("unexpected answer: {answer}")
        };
        let [ours, in_tiles, images] = [single_s, tiles_s, image_s].map(|s| rays.len() as f64 / s / 1e6);
        println!(
            "{view:3}: {ours:.1}, {in_tiles:.1}, {images:.1}; {single:.1}, {of_8:.1}, {of_16:.1}, {streams:.1}; {:.2}; within \
             {greatest_m:.4} m but for {:.3} % of the rays",
            in_tiles / single.max(of_8).max(of_16).max(streams),
            100.0 * differ
        );
    }
}

/// The least time of several passes, and what the last one gave.
fn least_seconds<T>(mut pass: impl FnMut() -> T) -> (f64, T) {
    let mut timed = || {
        let start = Instant::now();
        let result = pass();
        (start.elapsed().as_secs_f64(), result)
    };
    (1..PASSES).fold(timed(), |(least, _), _| {
        let (seconds, result) = timed();
        (least.min(seconds), result)
    })
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
        let ring = prism.rings().next().expect("every prism has a footprint");
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

fn write<'a>(file: &Path, triangles: &[[Vec3; 3]], rays: impl ExactSizeIterator<Item = (&'a Ray, f32)>) {
    let mut bytes = Vec::new();
    bytes.extend((triangles.len() as u32).to_le_bytes());
    let corners = triangles.iter().flatten().flat_map(Vec3::to_array);
    bytes.extend(corners.flat_map(f32::to_le_bytes));
    bytes.extend((rays.len() as u32).to_le_bytes());
    for (ray, depth) in rays {
        let expected = if depth.is_nan() { f32::INFINITY } else { depth };
        let values = ray.origin.to_array().into_iter().chain(ray.direction.to_array()).chain([expected]);
        bytes.extend(values.flat_map(f32::to_le_bytes));
    }
    std::fs::write(file, bytes).expect("the folder for temporary files of tests can be written to");
}
