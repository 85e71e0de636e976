//! The paper's own features: what `tools/export_footprint_features.py` computes is what training and sizeup read. Real
//! architectures, tiny, with random weights; skipped where `make deps-features` was not called.

#![allow(clippy::print_stdout, reason = "a test that is skipped says so")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use candle_core::Device;
use glam::{DMat3, DVec3};
use image::RgbImage;
use sizeup_footprints::{ContourFineness, ContourSource as _, Segmenter, SegmenterConfig};
use sizeup_heights::camera::Camera;
use sizeup_heights::frames::Rigid;
use sizeup_photos::onnx::{Network, Tensor};
use sizeup_survey::View;
use sizeup_training::dataset::load::Set;
use sizeup_training::export;
use sizeup_training::network::{FeatureConfig, NetworkConfig};
use sizeup_training::train::run::Training;
use sizeup_training::train::{TrainConfig, features};

use crate::scene::{quick, small_network, villages};

const NAMES: [&str; 5] = ["tex0", "tex1", "tex2", "sem", "geo"];

/// One of the project's Python programs, and what it printed.
fn python(script: &str, arguments: &[&Path], flags: &[&str]) -> Option<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let python = root.join("target/features/bin/python");
    if !python.is_file() {
        println!("skipped: PyTorch and transformers are not installed (make deps-features)");
        return None;
    }
    let mut program = Command::new(python);
    program.arg(root.join("tools").join(script)).args(arguments).args(flags).env("CUDA_VISIBLE_DEVICES", "");
    let outcome = program.output().unwrap();
    let said = [outcome.stdout, outcome.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
    assert!(outcome.status.success(), "{said}");
    Some(said)
}

fn wanted() -> Vec<FeatureConfig> {
    NAMES.iter().map(|name| FeatureConfig { name: (*name).to_owned(), channels: 32 }).collect()
}

/// A photo of exactly what the networks see at once, without pattern.
fn photo(path: &Path) -> RgbImage {
    let value = |x: u32, y: u32, c: u32| ((x * 7919 + y * 104_729 + c * 1299) % 251) as u8;
    let photo = RgbImage::from_fn(112, 112, |x, y| image::Rgb([0, 1, 2].map(|c| value(x, y, c))));
    photo.save(path).unwrap();
    photo
}

/// By the means and deviations of profile `fpsam.v1`.
fn normalised(photo: &RgbImage, mean: [f32; 3], std: [f32; 3]) -> Tensor {
    let of = |c: usize| photo.pixels().map(move |p| (f32::from(p.0[c]) / 255.0 - mean[c]) / std[c]);
    Tensor { shape: vec![1, 3, 112, 112], values: (0..3).flat_map(of).collect() }
}

#[test]
fn files_and_graphs_of_the_same_networks_say_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let [photos, out, graphs] = ["photos", "out", "graphs"].map(|name| folder.path().join(name));
    std::fs::create_dir(&photos).unwrap();
    let photo = photo(&photos.join("a.png"));
    let flags = ["--random", "--tiny", "--graphs", graphs.to_str().unwrap()];
    let Some(said) = python("export_footprint_features.py", &[&photos, &out], &flags) else { return };
    assert!(said.contains("WARNING: random weights") && said.contains("1 new"), "{said}");
    let file = out.join("photos/a.safetensors");
    let kept = features::read(&file, &wanted(), &Device::Cpu).unwrap();
    let sides: Vec<usize> = kept.iter().map(|(_, map)| map.dim(2).unwrap()).collect();
    assert_eq!(sides, [32, 16, 8, 32, 8]);
    let texture = normalised(&photo, [0.5; 3], [0.5; 3]);
    let geometry = normalised(&photo, [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]);
    let run = |graph: &str, image: &Tensor, names: &[&str]| {
        Network::open(&graphs.join(graph)).unwrap().run_many(&[("image", image)], names).unwrap()
    };
    let mut seen = run("texture.onnx", &texture, &NAMES[..4]);
    seen.extend(run("geometry.onnx", &geometry, &NAMES[4..]));
    for ((name, kept), seen) in kept.iter().zip(&seen) {
        assert_eq!(seen.shape, kept.dims());
        let kept = kept.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let spread = kept.iter().map(|v| v.abs()).fold(0.0, f32::max);
        let apart = kept.iter().zip(&seen.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(spread > 0.0 && apart < 1e-4 * spread, "{name}: {apart} of {spread}");
    }
    // What is there is left as it is; what was made otherwise is not taken for it.
    let again = python("export_footprint_features.py", &[&photos, &out], &["--random", "--tiny"]).unwrap();
    assert!(again.contains("0 new, 1 were there"), "{again}");
}

#[test]
fn a_head_learns_from_the_features_of_a_set_and_sizeup_runs_it() {
    let folder = tempfile::tempdir().unwrap();
    let [set, out, graphs] = ["set", "out", "graphs"].map(|name| folder.path().join(name));
    villages(&set);
    // Photos of 160 × 128 pixels, seen in four tiles of 112.
    let flags = ["--random", "--tiny", "--half", "--graphs", graphs.to_str().unwrap()];
    let Some(said) = python("export_footprint_features.py", &[&set, &out], &flags) else { return };
    assert!(said.contains("2x2 tiles"), "{said}");
    let network = NetworkConfig { inputs: Vec::new(), features: wanted(), ..small_network() };
    let config = TrainConfig { network, features: Some(out.clone()), crop_px: 48, batch: 1, steps: 2, ..quick() };
    let set = Set::open(&set).unwrap();
    let training = Training::new(config, std::slice::from_ref(&set), &folder.path().join("run")).unwrap();
    let trained = training.run(None, &|_| ()).unwrap();
    let head = folder.path().join("head.onnx");
    export::write_head(&trained, &any_file(&out.join("a")), 112, &head).unwrap();
    let mut config = SegmenterConfig::new(&head, "fpsam.v1");
    for backbone in ["texture", "geometry"] {
        config.backbones.insert(backbone.to_owned(), graphs.join(format!("{backbone}.onnx")));
    }
    let path = folder.path().join("a.png");
    photo(&path);
    let view = View {
        id: "a.png".into(),
        camera: Arc::new(Camera::pinhole(112, 112, 112.0)),
        camera_from_map: Rigid::new(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)), DVec3::new(0.0, 0.0, 80.0)),
        image: Some(path),
    };
    let look = ContourFineness { min_area_px2: 16.0, tolerance_px: 0.5, pixel_m: 0.7 };
    Segmenter::new(config).unwrap().contours(&view, look).unwrap();
}

fn any_file(folder: &Path) -> PathBuf {
    std::fs::read_dir(folder).unwrap().next().unwrap().unwrap().path()
}

#[test]
fn the_features_are_those_of_the_networks_own_code() {
    let Some(said) = python("check_footprint_features.py", &[], &[]) else { return };
    assert_eq!(said.lines().filter(|line| line.starts_with("same: ")).count(), 10, "{said}");
}
