//! Time to write and read back a town of 10,000 houses: `cargo bench --bench outputs`.
//!
//! `SIZEUP_BENCH_BUILDINGS=1000000` streams that many through every writer once instead, and back, and prints seconds
//! and peak memory: the houses are made one by one and never all in memory.

#![allow(clippy::print_stdout, reason = "a benchmark prints what it measured")]

use std::path::Path;
use std::time::Instant;

use criterion::Criterion;
use geo::polygon;
use sizeup::crs::Crs;
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::geopackage;
use sizeup::output::read::{FoundBuildings, ReadOptions, RecordFile};
use sizeup::output::tiles3d::{self, Heights, Tiles3dConfig};
use sizeup::output::{BuildingRecord, CityModel, Lineage, OutputError, Records, flatgeobuf};
use sizeup::survey::Survey;

/// L-shaped houses on a grid of 30 m, every tenth with a courtyard, made when they are asked for.
struct Houses {
    n: usize,
}

impl Records for Houses {
    fn visit(&self, visit: &mut dyn FnMut(&BuildingRecord) -> Result<(), OutputError>) -> Result<(), OutputError> {
        let side = (self.n as f64).sqrt().ceil() as usize;
        (0..self.n).try_for_each(|i| visit(&house(i, side)))
    }
}

fn house(i: usize, side: usize) -> BuildingRecord {
    let (x, y) = (500_000.0 + 30.0 * (i % side) as f64, 5_700_000.0 + 30.0 * (i / side) as f64);
    let footprint = if i.is_multiple_of(10) {
        polygon!(
            exterior: [(x: x, y: y), (x: x + 24.0, y: y), (x: x + 24.0, y: y + 24.0), (x: x, y: y + 24.0)],
            interiors: [[(x: x + 8.0, y: y + 8.0), (x: x + 8.0, y: y + 16.0), (x: x + 16.0, y: y + 16.0), (x: x + 16.0, y: y + 8.0)]],
        )
    } else {
        polygon![(x: x, y: y), (x: x + 20.0, y: y), (x: x + 20.0, y: y + 10.0), (x: x + 12.0, y: y + 10.0), (x: x + 12.0, y: y + 22.0), (x: x, y: y + 22.0)]
    };
    BuildingRecord {
        base_z_m: Some(100.75),
        height_sigma_m: Some(0.4),
        views: vec!["IMG_0001.JPG".to_owned(), "IMG_0002.JPG".to_owned(), "IMG_0003.JPG".to_owned()],
        ..BuildingRecord::measured(format!("house-{i:07}"), footprint, 101.25, 5.0 + (i % 97) as f64 * 0.31)
    }
}

fn main() {
    let crs = Crs::parse("EPSG:25832").expect("a known code");
    let (lineage, survey) = (Lineage::default(), Survey::default());
    let n_once = std::env::var("SIZEUP_BENCH_BUILDINGS").ok().and_then(|n| n.parse::<usize>().ok());
    let houses = Houses { n: n_once.unwrap_or(10_000) };
    let model = CityModel { records: &houses, crs: &crs, lineage: &lineage, issues: &[], survey: &survey };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name);
    let tiles = Tiles3dConfig { heights: Heights::GeoidHeight(46.0), ..Tiles3dConfig::default() };
    let write_city = || cityjson::write(&at("a.city.json"), &model, &CityJsonConfig::default()).expect("written");
    let write_seq =
        || cityjson::write_sequence(&at("a.city.jsonl"), &model, &CityJsonConfig::default()).expect("written");
    let write_gpkg = || geopackage::write(&at("a.gpkg"), &model).expect("written");
    let write_fgb = || flatgeobuf::write(&at("a.fgb"), &model).expect("written");
    let write_tiles = || tiles3d::write(&at("tiles"), &model, &tiles).expect("written");
    let read = |name: &str| FoundBuildings::read(&at(name), &ReadOptions::default()).expect("read").to_records().len();
    let stream = |name: &str| {
        let mut n = 0;
        let file = RecordFile::open(&at(name), ReadOptions::default()).expect("opened");
        file.visit(&mut |_| {
            n += 1;
            Ok(())
        })
        .expect("read");
        assert_eq!(n, houses.n);
    };

    if n_once.is_some() {
        // What needs least memory first: the peak only grows.
        once("write cityjsonseq", write_seq);
        once("stream cityjsonseq", || stream("a.city.jsonl"));
        once("write geopackage", write_gpkg);
        once("stream geopackage", || stream("a.gpkg"));
        once("write flatgeobuf", write_fgb);
        once("stream flatgeobuf", || stream("a.fgb"));
        once("write 3d tiles", write_tiles);
        once("write cityjson", write_city);
        once("read cityjson", || stream("a.city.json"));
        return;
    }
    let mut criterion = Criterion::default().sample_size(10).configure_from_args();
    criterion.bench_function("write cityjson, 10k buildings", |b| b.iter(write_city));
    criterion.bench_function("write cityjsonseq, 10k buildings", |b| b.iter(write_seq));
    criterion.bench_function("write geopackage, 10k buildings", |b| b.iter(write_gpkg));
    criterion.bench_function("write flatgeobuf, 10k buildings", |b| b.iter(write_fgb));
    criterion.bench_function("write 3d tiles, 10k buildings", |b| b.iter(write_tiles));
    criterion.bench_function("read cityjson, 10k buildings", |b| b.iter(|| read("a.city.json")));
    criterion.bench_function("stream cityjsonseq, 10k buildings", |b| b.iter(|| stream("a.city.jsonl")));
    criterion.bench_function("stream geopackage, 10k buildings", |b| b.iter(|| stream("a.gpkg")));
    criterion.final_summary();
}

fn once<T>(what: &str, work: impl FnOnce() -> T) {
    let start = Instant::now();
    work();
    println!("{what:20} {:6.1} s, peak memory so far {} MB", start.elapsed().as_secs_f64(), peak_memory_mb());
}

/// Linux's high-water mark of resident memory; 0 elsewhere.
fn peak_memory_mb() -> u64 {
    let status = std::fs::read_to_string(Path::new("/proc/self/status")).unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<u64>().ok()).unwrap_or(0) / 1024
}
