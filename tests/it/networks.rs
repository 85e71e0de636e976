//! Depth networks from ONNX files: tiny graphs of our own stand in for real ones.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::frames::Rigid;
use sizeup::onnx::EngineConfig;
use sizeup::prior::network::{NetworkConfig, NetworkPriors, inspect};
use sizeup::prior::{CacheConfig, CachedPriors, PriorCache, PriorError, PriorKind, PriorSource as _};
use sizeup::survey::View;
use sizeup::terrain::Terrain;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/onnx").join(name)
}

/// A photo that gets brighter to the right; its left half is black.
fn view(folder: &Path) -> View {
    let path = folder.join("a.png");
    let brightness = |x: u32| if x < 100 { 0 } else { (x + 50).min(255) as u8 };
    image::RgbImage::from_fn(200, 100, |x, _| image::Rgb([brightness(x); 3])).save(&path).unwrap();
    View {
        id: "a.png".into(),
        camera: Arc::new(Camera::pinhole(200, 100, 200.0)),
        camera_from_map: Rigid::new(DMat3::IDENTITY, DVec3::ZERO),
        image: Some(path),
    }
}

fn config(model: PathBuf, profile: &str) -> NetworkConfig {
    NetworkConfig { model, profile: Some(profile.to_owned()), custom: None, engine: EngineConfig::default(), cache: CacheConfig::default() }
}

#[test]
fn a_graph_gives_depth_with_sky_left_out_and_the_cache_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let view = view(folder.path());
    let priors = NetworkPriors::new(config(fixture("depth_of_brightness.onnx"), "da3-mono"), &[], &Terrain::Constant(0.0)).unwrap();
    let prior = priors.load(&view).unwrap();
    assert_eq!((prior.values.width(), prior.values.height()), (504, 252));
    assert_eq!(prior.kind, PriorKind::Depth);
    // exp(mean over channels of (b/255 − mean)/std): black is below 1 − 0.3, so sky.
    assert!(prior.values[(50, 100)].is_nan());
    // The middle of column 500 of 504 is column 198.1 of the photo, whose brightness is 50 more.
    let brightness = (500.5_f32 / 504.0 * 200.0 - 0.5 + 50.0) / 255.0;
    let expected = ((brightness - 0.485) / 0.229 + (brightness - 0.456) / 0.224 + (brightness - 0.406) / 0.225) / 3.0;
    let (found, half_a_grey_level) = (prior.values[(500, 100)], 1.01 * 0.5 / 255.0 / 0.224);
    assert!((found.ln() - expected).abs() < half_a_grey_level, "{found} {}", expected.exp());
    assert!(prior.values[(400, 100)] < found);

    let cache = PriorCache::open(folder.path().join("cache"), 1 << 30).unwrap();
    let cached = CachedPriors::new(priors, Some(cache));
    let (first, second) = (cached.load(&view).unwrap(), cached.load(&view).unwrap());
    assert_eq!(first.values[(500, 100)].to_bits(), second.values[(500, 100)].to_bits());
    assert_eq!(std::fs::read_dir(folder.path().join("cache")).unwrap().count(), 1);
}

#[test]
fn inspection_says_which_profiles_fit() {
    let found = inspect(&fixture("depth_of_brightness.onnx"), &EngineConfig::default()).unwrap();
    assert_eq!(found.inputs[0].shape, [None, Some(3), None, None]);
    let (da3, wiring) = &found.profiles[0];
    assert_eq!(da3.name, "da3-mono");
    assert_eq!(wiring.as_ref().unwrap().sky.as_deref(), Some("sky"));
}

#[test]
fn foreign_damaged_and_untagged_graphs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |config: NetworkConfig, words: &str| {
        let error = NetworkPriors::new(config, &[], &Terrain::Constant(0.0)).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(config(fixture("cubic_resize.onnx"), "da3-mono"), "cubic");
    refused(config(fixture("absent.onnx"), "da3-mono"), "absent.onnx");
    refused(config(fixture("depth_of_brightness.onnx"), "da4"), "depth-anything-v2");
    let mut bytes = std::fs::read(fixture("depth_of_brightness.onnx")).unwrap();
    bytes.truncate(bytes.len() / 2);
    let cut = folder.path().join("cut.onnx");
    std::fs::write(&cut, &bytes).unwrap();
    refused(config(cut, "da3-mono"), "cut.onnx");
    let text = folder.path().join("text.onnx");
    std::fs::write(&text, "not a network").unwrap();
    refused(config(text, "da3-mono"), "ONNX file");
    let untagged = NetworkConfig { model: fixture("depth_of_brightness.onnx"), profile: None, custom: None, engine: EngineConfig::default(), cache: CacheConfig::default() };
    assert!(matches!(NetworkPriors::new(untagged, &[], &Terrain::Constant(0.0)), Err(PriorError::Config { .. })));
}
