//! Contours of many views into one layer, and masks into contours: near-linear growth is the point.
//!
//! `cargo bench --bench footprints`; the full size, a million contours, is
//! `cargo test --locked --test it a_million_contours -- --ignored --nocapture`.

use criterion::{BenchmarkId, Criterion};
use geo_types::{Coord, LineString, Polygon, Rect};
use sizeup::footprint::{ConsensusConfig, FootprintCandidate, Instances, SeenGround, Vectorising, agree, contours};
use sizeup::raster::Raster;

/// `n` L-shaped buildings, each in nine views that are off by some decimetres.
fn town(n: usize) -> (Vec<FootprintCandidate>, Vec<SeenGround>) {
    let side = (n as f64).sqrt().ceil() as usize;
    let everywhere = Rect::new((-1e4, -1e4), (side as f64 * 25.0 + 1e4, side as f64 * 25.0 + 1e4)).to_polygon();
    let seen = vec![SeenGround { area: everywhere }; 9];
    let mut candidates = Vec::with_capacity(9 * n);
    for i in 0..n {
        let (x, y) = ((i % side) as f64 * 25.0, (i / side) as f64 * 25.0);
        for view in 0..9 {
            let off = |k: usize| ((i * 31 + view * 17 + k * 7) % 13) as f64 * 0.03;
            let corner = |dx: f64, dy: f64| Coord { x: x + dx + off(0), y: y + dy + off(1) };
            let ring = LineString(vec![
                corner(0.0, 0.0),
                corner(14.0, 0.0),
                corner(14.0, 6.0),
                corner(7.0, 6.0),
                corner(7.0, 12.0),
                corner(0.0, 12.0),
                corner(0.0, 0.0),
            ]);
            let shape = Polygon::new(ring, Vec::new()).into();
            candidates.push(FootprintCandidate { view, shape, weight: 10.0, score: 1.0, is_cut: false });
        }
    }
    (candidates, seen)
}

fn dedupe(c: &mut Criterion) {
    let mut group = c.benchmark_group("contours of nine views into one layer");
    group.sample_size(10);
    for n in [250, 1000, 4000] {
        let (candidates, seen) = town(n);
        group.throughput(criterion::Throughput::Elements(candidates.len() as u64));
        group.bench_with_input(BenchmarkId::from_parameter(candidates.len()), &n, |b, _| {
            b.iter(|| agree(&candidates, &seen, &ConsensusConfig::default()));
        });
    }
    group.finish();
}

fn vectorise(c: &mut Criterion) {
    let (width, height) = (4000, 3000);
    let label = |i: usize| {
        let (col, row) = (i % width, i / width);
        let (a, b) = (col / 150, row / 150);
        if col % 150 < 100 && (row + col / 7) % 150 < 90 { (1 + a + 27 * b) as u32 } else { 0 }
    };
    let mask = Raster::from_vec(width, height, (0..width * height).map(label).collect()).expect("one per pixel");
    let how = Vectorising { instances: Instances::ByLabel, min_area_px2: 100.0, tolerance_px: 0.5 };
    let mut group = c.benchmark_group("masks into contours");
    group.sample_size(10);
    group.bench_function("12 MP", |b| b.iter(|| contours(&mask, how)));
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    dedupe(&mut criterion);
    vectorise(&mut criterion);
    criterion.final_summary();
}
