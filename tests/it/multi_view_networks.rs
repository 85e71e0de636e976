//! Networks that match posed photos, and putting one in place by its name.

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use assert_cmd::Command;
use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::frames::Rigid;
use sizeup::onnx::{EngineConfig, Network, Tensor};
use sizeup::prior::PriorSource as _;
use sizeup::prior::network::known::known_by_name;
use sizeup::prior::network::{NetworkConfig, NetworkPriors};
use sizeup::survey::View;
use sizeup::terrain::Terrain;

use crate::skipped::skip;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/onnx").join(name)
}

/// The published checkpoint beside the repository, or `None` and a line that says so.
fn checkpoint() -> Option<PathBuf> {
    crate::shared_data::shared_data("../models/itermvs/blendedmvs_model_000015.ckpt")
}

/// Straight down from 100 m above ground, this far east; the photo is black on the left and light grey on the right.
fn view(folder: &Path, name: &str, east_m: f64) -> View {
    let path = folder.join(name);
    image::RgbImage::from_fn(160, 80, |x, _| image::Rgb([if x < 80 { 0 } else { 204 }; 3])).save(&path).unwrap();
    View {
        id: name.into(),
        camera: Arc::new(Camera::pinhole(160, 80, 160.0)),
        camera_from_map: Rigid::from_rotation_and_centre(
            DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
            DVec3::new(634_000.0 + east_m, 485_000.0, 110.0),
        ),
        image: Some(path),
    }
}

#[test]
fn a_matching_network_looks_between_the_tallest_roofs_and_the_ground_and_low_confidence_is_no_depth() {
    let folder = tempfile::tempdir().unwrap();
    let views = [view(folder.path(), "a.png", 0.0), view(folder.path(), "b.png", 26.0)];
    let config = NetworkConfig::new(fixture("depth_in_range.onnx"), "itermvs");
    let priors = NetworkPriors::new(config, &views, &Terrain::Constant(10.0), 50.0).unwrap();
    let prior = priors.load(&views[0]).unwrap();
    // The graph's depth is as far into the range as the photo is bright: 0.95 · 50 m … 1.05 · 100 m, 0.8 of the way.
    let (width, height) = (prior.values.width(), prior.values.height());
    assert_eq!((width, height), (1024, 512));
    let found = prior.values[(900, 250)];
    assert!((found - (47.5 + 0.8 * 57.5)).abs() < 0.01, "{found}");
    assert!(prior.values[(100, 250)].is_nan(), "black, so without confidence");
}

#[test]
fn depth_of_a_network_that_finds_poses_by_itself_is_in_metres_by_the_poses_of_the_photos() {
    let folder = tempfile::tempdir().unwrap();
    let views = [view(folder.path(), "a.png", 0.0), view(folder.path(), "b.png", 26.0)];
    let config = NetworkConfig::new(fixture("depth_and_pose_enc.onnx"), "vggt");
    let priors = NetworkPriors::new(config, &views, &Terrain::Constant(10.0), 50.0).unwrap();
    let prior = priors.load(&views[0]).unwrap();
    assert_eq!((prior.values.width(), prior.values.height()), (518, 266));
    // The graph's photos stand 2 of its units apart, ours 26 m; its depth is exp(brightness) units, of brightness 0 to 1.
    let (light, dark) = (prior.values[(450, 130)], prior.values[(60, 130)]);
    assert!((light - 13.0 * 0.8_f32.exp()).abs() < 1e-3 && (dark - 13.0).abs() < 1e-3, "{light} {dark}");
}

#[test]
fn a_network_gets_poses_from_the_camera_to_the_world_and_what_it_calls_ambiguous_is_no_depth() {
    let folder = tempfile::tempdir().unwrap();
    let views = [view(folder.path(), "a.png", 0.0), view(folder.path(), "b.png", 26.0)];
    let config = NetworkConfig::new(fixture("depth_of_camera_poses.onnx"), "map-anything");
    let priors = NetworkPriors::new(config, &views, &Terrain::Constant(10.0), 50.0).unwrap();
    let prior = priors.load(&views[0]).unwrap();
    // Depth is exp(mean of the normalised channels) · 26 m to the right · focal length of 518 px / 100.
    let normalised = [(0.485, 0.229), (0.456, 0.224), (0.406, 0.225)].map(|(mean, std)| (0.8 - mean) / std);
    let expected = (normalised.iter().sum::<f32>() / 3.0).exp() * 26.0 * 5.18;
    let found = prior.values[(450, 130)];
    assert!((found - expected).abs() < 1e-3 * expected, "{found} {expected}");
    assert!(prior.values[(60, 130)].is_nan(), "black, so ambiguous");
    // From the other photo the first one stands to the left.
    assert!(priors.load(&views[1]).is_err(), "no depth is negative");
}

#[test]
fn a_view_that_no_other_overlaps_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let views = [view(folder.path(), "a.png", 0.0), view(folder.path(), "b.png", 900.0)];
    let config = NetworkConfig::new(fixture("depth_in_range.onnx"), "itermvs");
    let priors = NetworkPriors::new(config, &views, &Terrain::Constant(10.0), 50.0).unwrap();
    let message = priors.load(&views[0]).unwrap_err().to_string();
    assert!(message.contains("a.png") && message.contains("overlap"), "{message}");
}

/// The photos of `tools/export_itermvs.py`, painted again.
fn painted(n: usize, rows: usize, columns: usize) -> Tensor {
    let value = |i: usize, c: usize, y: usize, x: usize| {
        let x = x + 6 * i;
        ((x * x * 7 + y * 31 + x * y * 5 + c * 83) % 256) as f32 / 127.5 - 1.0
    };
    let pixels = (0..n).flat_map(|i| {
        (0..3).flat_map(move |c| (0..rows).flat_map(move |y| (0..columns).map(move |x| value(i, c, y, x))))
    });
    Tensor { shape: vec![1, n, 3, rows, columns], values: pixels.collect() }
}

/// Depth and confidence of the embedded engine against `PyTorch`'s, which `fixtures/onnx/itermvs.f32` holds.
#[test]
fn itermvs_put_together_from_its_checkpoint_computes_what_pytorch_does() {
    const TOLERANCE: f32 = 1e-4; // of the depth: six digits of f32, less what 40 layers lose
    let Some(checkpoint) = checkpoint() else { return };
    let folder = tempfile::tempdir().unwrap();
    let graph = known_by_name("itermvs").unwrap().put_together(&checkpoint, folder.path()).unwrap();
    let network = Network::open_with(&graph, &EngineConfig::default()).unwrap();
    let (n, rows, columns) = (4, 64, 96);
    let mut extrinsics = Vec::new();
    let mut intrinsics = Vec::new();
    for i in 0..n {
        extrinsics.extend([1., 0., 0., -5. * i as f32, 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]);
        intrinsics.extend([120., 0., columns as f32 / 2., 0., 120., rows as f32 / 2., 0., 0., 1.]);
    }
    let inputs = [
        ("images", painted(n, rows, columns)),
        ("extrinsics", Tensor { shape: vec![1, n, 4, 4], values: extrinsics }),
        ("intrinsics", Tensor { shape: vec![1, n, 3, 3], values: intrinsics }),
        ("depth_range", Tensor { shape: vec![1, 2], values: vec![40.0, 120.0] }),
    ];
    let inputs: Vec<(&str, &Tensor)> = inputs.iter().map(|(name, tensor)| (*name, tensor)).collect();
    let found = network.run_many(&inputs, &["depth", "confidence"]).unwrap();
    let golden = std::fs::read(fixture("itermvs.f32")).unwrap();
    let golden: Vec<f32> = golden.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let every_other = |map: &Tensor| -> Vec<f32> {
        let row = |y: usize| map.values[y * columns..(y + 1) * columns].iter().copied().step_by(2);
        (0..rows).step_by(2).flat_map(row).collect()
    };
    let (depth, confidence) = golden.split_at(golden.len() / 2);
    for (found, expected) in every_other(&found[0]).into_iter().zip(depth) {
        assert!((found - expected).abs() < TOLERANCE * expected, "{found} {expected}");
    }
    for (found, expected) in every_other(&found[1]).into_iter().zip(confidence) {
        assert!((found - expected).abs() < TOLERANCE, "{found} {expected}");
    }
}

fn sizeup(models: &Path) -> Command {
    let mut command = Command::cargo_bin("sizeup").unwrap();
    command.env("SIZEUP_MODELS", models);
    command
}

#[test]
fn a_file_that_is_not_the_published_checkpoint_is_refused_and_nothing_is_put_in_place() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = folder.path().join("model.ckpt");
    std::fs::write(&wrong, b"no weights").unwrap();
    let models = folder.path().join("models");
    let output = sizeup(&models).args(["model", "get", "itermvs", "--from"]).arg(&wrong).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(message.contains("found 10 bytes") && message.contains("hint: fetch it again"), "{message}");
    assert!(!models.exists());
    let output = sizeup(&models).args(["model", "get", "itermvs2"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("there are itermvs"));
}

#[test]
fn a_run_that_wants_a_known_network_says_how_to_get_it() {
    let scene = crate::tiny_scene::Scene::new();
    scene.edit("sizeup.toml", |text| {
        let (others, _) = text.split_once("[prior]").unwrap();
        format!("{others}[prior]\nsource = \"network\"\nmodel = \"itermvs\"\n")
    });
    let output = sizeup(&scene.path("no models")).arg("run").arg(scene.path("sizeup.toml")).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_ne!(output.status.code(), Some(0), "{message}");
    assert!(message.contains("is not in place") && message.contains("sizeup model get itermvs"), "{message}");
}

#[test]
fn networks_whose_graph_one_brings_are_listed_with_their_licences_and_a_graph_is_sent_to_inspect() {
    let models = tempfile::tempdir().unwrap();
    let output = sizeup(models.path()).args(["model", "list"]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let (_, brought) = text.split_once("Graphs (ONNX) that you bring").unwrap();
    assert!(brought.contains("vggt ") && brought.contains("VGGT-1B for research only"), "{text}");
    assert!(brought.contains("map-anything ") && !brought.contains("itermvs "), "{text}");
    let output = sizeup(models.path()).args(["model", "list", "--json"]).output().unwrap();
    let listed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let vggt = listed.as_array().unwrap().iter().find(|row| row["network"]["name"] == "vggt").unwrap();
    assert!(vggt["in_place"].is_null() && vggt["network"]["licence"].as_str().unwrap().contains("commercial"));
    let graph = fixture("depth_and_pose_enc.onnx");
    let output = sizeup(models.path()).args(["model", "check"]).arg(&graph).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(message.contains("`sizeup model inspect"), "{message}");
    let output = sizeup(models.path()).args(["model", "inspect"]).arg(&graph).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.contains("fits    vggt") && text.contains("no fit  itermvs: expected an input named depth_range"),
        "{text}"
    );
}

/// A server on the loopback that answers every request with one file.
fn serve(content: Vec<u8>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let _ = stream.read(&mut [0; 4096]);
            let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\nConnection: close\r\n\r\n", content.len());
            let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(&content));
        }
    });
    format!("http://{address}/model.ckpt")
}

#[test]
fn a_network_is_fetched_checked_and_found_by_its_name() {
    if std::process::Command::new("curl").arg("--version").output().is_err() {
        skip("curl is not here");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let models = folder.path().join("models");
    let get = |url: &str| sizeup(&models).args(["model", "get", "itermvs", "--url", url]).output().unwrap();
    let output = get(&serve(vec![0; 1000]));
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
    let Some(checkpoint) = checkpoint() else { return };
    let output = get(&serve(std::fs::read(checkpoint).unwrap()));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = sizeup(&models).args(["model", "list", "--json"]).output().unwrap();
    let listed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(listed[0]["in_place"], models.join("itermvs.onnx").to_str().unwrap());
    let output = sizeup(&models).args(["model", "inspect"]).arg(models.join("itermvs.onnx")).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("fits    itermvs") && text.contains("itermvs.onnx_data"), "{text}");
}
