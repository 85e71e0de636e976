//! Depth networks from ONNX files: tiny graphs of our own stand in for real ones.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::frames::Rigid;
use sizeup::onnx::{EngineChoice, EngineConfig, Network, OnnxError, Tensor};
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
    NetworkConfig {
        model,
        profile: Some(profile.to_owned()),
        custom: None,
        engine: EngineConfig::default(),
        cache: CacheConfig::default(),
    }
}

#[test]
fn a_graph_gives_depth_with_sky_left_out_and_the_cache_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let view = view(folder.path());
    let priors =
        NetworkPriors::new(config(fixture("depth_of_brightness.onnx"), "da3-mono"), &[], &Terrain::Constant(0.0))
            .unwrap();
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
    let embedded = EngineConfig { name: EngineChoice::Rten, ..EngineConfig::default() };
    let cubic = config(fixture("cubic_resize.onnx"), "da3-mono");
    refused(NetworkConfig { engine: embedded, ..cubic }, "cubic");
    refused(config(fixture("instances_of_colours.onnx"), "da3-mono"), "does not fit");
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
    let untagged = NetworkConfig {
        model: fixture("depth_of_brightness.onnx"),
        profile: None,
        custom: None,
        engine: EngineConfig::default(),
        cache: CacheConfig::default(),
    };
    assert!(matches!(NetworkPriors::new(untagged, &[], &Terrain::Constant(0.0)), Err(PriorError::Config { .. })));
}

/// ONNX Runtime as `make deps-onnxruntime` fetches it, or `None` and a word.
fn onnxruntime() -> Option<EngineConfig> {
    let library = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/onnxruntime/libonnxruntime.so");
    if !library.exists() {
        println!("skipped: `make deps-onnxruntime` fetches ONNX Runtime");
        return None;
    }
    Some(EngineConfig { name: EngineChoice::OnnxRuntime, library: Some(library), ..EngineConfig::default() })
}

/// Values without pattern, 0 to 1.
fn some_values(shape: &[usize]) -> Tensor {
    let n: usize = shape.iter().product();
    Tensor { shape: shape.to_vec(), values: (0..n).map(|i| (i * 7919 % 1009) as f32 / 1009.0).collect() }
}

#[test]
fn both_engines_compute_the_same() {
    let Some(runtime) = onnxruntime() else { return };
    let embedded = EngineConfig { name: EngineChoice::Rten, threads: 1, ..EngineConfig::default() };
    let graphs = [
        ("depth_of_brightness.onnx", vec![1, 3, 28, 42]),
        ("fpsam_texture.onnx", vec![1, 3, 64, 64]),
        ("fpsam_geometry.onnx", vec![1, 3, 64, 64]),
    ];
    for (name, shape) in graphs {
        let [one, other] = [&embedded, &runtime].map(|engine| Network::open_with(&fixture(name), engine).unwrap());
        assert_eq!((one.engine(), other.engine()), (EngineChoice::Rten, EngineChoice::OnnxRuntime));
        assert_eq!(one.inputs(), other.inputs(), "{name}");
        let input = some_values(&shape);
        let outputs: Vec<&str> = one.outputs().iter().map(|port| port.name.as_str()).collect();
        let inputs = [(one.inputs()[0].name.as_str(), &input)];
        let (ones, others) = (one.run_many(&inputs, &outputs).unwrap(), other.run_many(&inputs, &outputs).unwrap());
        for ((a, b), output) in ones.iter().zip(&others).zip(&outputs) {
            assert_eq!(a.shape, b.shape, "{name} {output}");
            let largest = a.values.iter().fold(1.0_f32, |m, v| m.max(v.abs()));
            let worst = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // Sums of some hundred terms in single precision, in another order.
            assert!(worst <= 1e-5 * largest, "{name} {output}: {worst} of {largest}");
        }
    }
}

#[test]
fn what_the_embedded_engine_cannot_do_goes_to_the_other_one() {
    let Some(runtime) = onnxruntime() else { return };
    let either = EngineConfig { name: EngineChoice::Auto, ..runtime.clone() };
    let cubic = Network::open_with(&fixture("cubic_resize.onnx"), &either).unwrap();
    assert_eq!(cubic.engine(), EngineChoice::OnnxRuntime);
    let enlarged = cubic.run(("image", &some_values(&[1, 3, 14, 14])), "depth").unwrap();
    assert_eq!(enlarged.shape, [1, 3, 28, 28]);
    let simple = Network::open_with(&fixture("depth_of_brightness.onnx"), &either).unwrap();
    assert_eq!(simple.engine(), EngineChoice::Rten, "embedded where it can");
    let damaged = Network::open_with(&fixture("make.py"), &runtime).unwrap_err().to_string();
    assert!(damaged.contains("no sound ONNX file"), "{damaged}");
    let cuda = EngineConfig { providers: vec![sizeup::onnx::Provider::Cuda], ..runtime };
    let absent = Network::open_with(&fixture("depth_of_brightness.onnx"), &cuda).unwrap_err().to_string();
    assert!(absent.contains("engine.providers"), "{absent}");
}

#[test]
fn an_absent_runtime_is_named_with_how_to_get_it() {
    let absent = EngineConfig {
        name: EngineChoice::OnnxRuntime,
        library: Some("/nowhere/libonnxruntime.so".into()),
        ..EngineConfig::default()
    };
    let error = Network::open_with(&fixture("depth_of_brightness.onnx"), &absent).unwrap_err();
    assert!(matches!(error, OnnxError::NoRuntime { .. }));
    assert!(error.to_string().contains("make deps-onnxruntime"), "{error}");
}
