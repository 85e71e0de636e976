//! Depth networks from ONNX files: tiny graphs of our own stand in for real ones.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DMat3, DVec3};
use sizeup::camera::Camera;
use sizeup::frames::Rigid;
use sizeup::onnx::{EngineChoice, EngineConfig, Network, OnnxError, Tensor};
use sizeup::prior::network::{NetworkConfig, NetworkPriors, inspect};
use sizeup::prior::{
    CacheConfig, CachedPriors, DepthPrior, PriorCache, PriorConfig, PriorError, PriorKind, PriorSource as _,
};
use sizeup::survey::View;
use sizeup::terrain::Terrain;

use crate::skipped::skip;

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
    NetworkConfig::new(model, profile)
}

#[test]
fn a_graph_gives_depth_with_sky_left_out_and_the_cache_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let view = view(folder.path());
    let priors =
        NetworkPriors::new(config(fixture("depth_of_brightness.onnx"), "da3-mono"), &[], &Terrain::Constant(0.0), 50.0)
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
        let error = NetworkPriors::new(config, &[], &Terrain::Constant(0.0), 50.0).unwrap_err().to_string();
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
    let untagged = NetworkConfig { profile: None, ..config(fixture("depth_of_brightness.onnx"), "") };
    assert!(matches!(NetworkPriors::new(untagged, &[], &Terrain::Constant(0.0), 50.0), Err(PriorError::Config { .. })));
}

/// ONNX Runtime as `make deps-onnxruntime` fetches it, or `None` and a word.
fn onnxruntime() -> Option<EngineConfig> {
    let library = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/onnxruntime/libonnxruntime.so");
    if !library.exists() {
        skip("`make deps-onnxruntime` fetches ONNX Runtime");
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
    let embedded = EngineConfig { name: EngineChoice::Rten, ..EngineConfig::default() };
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

/// `exp` of the mean over the channels, as `pad_by_axes.onnx` has it, of one photo of 3 channels.
fn exp_of_mean(input: &Tensor) -> Vec<f32> {
    let n = input.values.len() / 3;
    (0..n).map(|i| ((input.values[i] + input.values[n + i] + input.values[2 * n + i]) / 3.0).exp()).collect()
}

#[test]
fn what_the_embedded_engine_loads_and_cannot_run_goes_to_the_other_one_too() {
    let Some(runtime) = onnxruntime() else { return };
    let graph = fixture("pad_by_axes.onnx");
    let input = some_values(&[1, 3, 14, 28]);
    let run = |engine: &EngineConfig| Network::open_with(&graph, engine).unwrap().run(("image", &input), "depth");
    let alone = run(&EngineConfig { name: EngineChoice::Rten, ..runtime.clone() }).unwrap_err().to_string();
    assert!(alone.contains("axes") && alone.contains("make deps-onnxruntime"), "{alone}");
    let either = EngineConfig { name: EngineChoice::Auto, ..runtime };
    let network = Network::open_with(&graph, &either).unwrap();
    assert_eq!(network.engine(), EngineChoice::Rten, "it loads there");
    // The first run finds out, the second one knows.
    for _ in 0..2 {
        let found = network.run(("image", &input), "depth").unwrap();
        let worst = found.values.iter().zip(exp_of_mean(&input)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(found.shape == [1, 1, 14, 28] && worst < 1e-5, "{worst}");
    }
}

#[test]
fn where_neither_engine_runs_a_graph_both_say_why() {
    // Whether a runtime is loaded by another test or not, this one cannot be.
    let engine = EngineConfig { library: Some("/nowhere/libonnxruntime.so".into()), ..EngineConfig::default() };
    let network = Network::open_with(&fixture("pad_by_axes.onnx"), &engine).unwrap();
    let error = network.run(("image", &some_values(&[1, 3, 14, 14])), "depth").unwrap_err().to_string();
    let (first, second) = (error.find("the embedded engine: "), error.find("; ONNX Runtime: "));
    assert!(first.is_some() && first < second && error.contains("axes"), "{error}");
    assert!(error.contains("/nowhere/libonnxruntime.so"), "{error}");
}

/// A photo of its own, brighter to the right by a tenth of `slope` per pixel.
fn photo(folder: &Path, name: &str, (width, height): (u32, u32), slope: u32) -> View {
    let path = folder.join(name);
    let brightness = |x: u32, y: u32| (90 + x * slope / 10 + y / 4).min(255) as u8;
    image::RgbImage::from_fn(width, height, |x, y| image::Rgb([brightness(x, y); 3])).save(&path).unwrap();
    View {
        id: name.into(),
        camera: Arc::new(Camera::pinhole(width, height, f64::from(width))),
        camera_from_map: Rigid::new(DMat3::IDENTITY, DVec3::ZERO),
        image: Some(path),
    }
}

/// Priors computed ahead, by view; a cache of their own.
fn computed(folder: &Path, views: &[View], network: NetworkConfig) -> Vec<Result<DepthPrior, String>> {
    let cache = CacheConfig { folder: folder.join("cache"), ..CacheConfig::default() };
    let config = PriorConfig::Network(Box::new(NetworkConfig { cache, ..network }));
    let priors = config.open(views, &Terrain::Constant(0.0), 80.0).unwrap();
    let n_done = AtomicUsize::new(0);
    let all: Vec<&View> = views.iter().collect();
    let outcomes = priors.compute_ahead(&all, &|| {
        n_done.fetch_add(1, Ordering::Relaxed);
    });
    assert_eq!(n_done.into_inner(), views.len());
    let again = priors.compute_ahead(&all, &|| {});
    let kept = views.iter().zip(outcomes).zip(again).map(|((view, first), second)| {
        // Computed now, found then; what failed fails again.
        let second = second.map_err(|second| assert_eq!(Err(second), first));
        if second.is_ok() {
            assert_eq!((first.clone(), second), (Ok(false), Ok(true)));
        }
        first.map(|_| priors.load(view).unwrap())
    });
    kept.collect()
}

#[test]
fn priors_computed_ahead_are_kept_and_a_photo_that_is_not_known_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let mut views: Vec<View> = (0..7)
        .map(|i| photo(folder.path(), &format!("{i}.png"), if i == 3 { (90, 120) } else { (120, 90) }, 6 + i))
        .collect();
    views[5].image = None;
    let found = computed(folder.path(), &views, config(fixture("depth_of_brightness.onnx"), "da3-mono"));
    let told = found[5].as_ref().unwrap_err();
    assert!(told.contains("photo is not known"), "{told}");
    let right = |i: usize| found[i].as_ref().unwrap().values[(480, 200)];
    assert!((1..7).filter(|i| ![3, 5].contains(i)).all(|i| right(i) > right(0)), "photos differ");
}

/// Looks straight down from 100 m.
fn down(folder: &Path, name: &str, east_m: f64, north_m: f64, slope: u32) -> View {
    let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let centre = DVec3::new(634_000.0 + east_m, 485_000.0 + north_m, 100.0);
    let camera_from_map = Rigid::from_rotation_and_centre(rotation, centre);
    View { camera_from_map, ..photo(folder, name, (200, 100), slope) }
}

#[test]
fn a_network_that_takes_and_gives_poses_gives_metres() {
    let folder = tempfile::tempdir().unwrap();
    let views = [
        down(folder.path(), "a.png", 0.0, 0.0, 6),
        down(folder.path(), "b.png", 27.0, 0.0, 7),
        down(folder.path(), "c.png", 0.0, 30.0, 8),
    ];
    let terrain = Terrain::Constant(0.0);
    let prior = |name: &str, profile: &str, views: &[View]| {
        NetworkPriors::new(config(fixture(name), profile), views, &terrain, 50.0).unwrap().load(&views[0]).unwrap()
    };
    let bright = prior("depth_of_brightness.onnx", "da3-mono", &views);
    // depth_of_poses.onnx: brightness · size of the translations · mean focal length / 100, poses twice as far apart as
    // given. Given are metres by the median distance of 0, 27 and 30 m; 200 pixels of focal length become 504.
    let (unit_m, size) = (27.0_f64, (1.0 + (30.0_f64 / 27.0).powi(2)).sqrt());
    let factor = size * 5.04 * unit_m / 2.0;
    let metric = prior("depth_of_poses.onnx", "da3-anyview", &views);
    assert_eq!((metric.kind, metric.values.width()), (PriorKind::Depth, 504));
    for (found, bright) in metric.values.data().iter().zip(bright.values.data()).filter(|(_, b)| !b.is_nan()) {
        let expected = f64::from(*bright) * factor;
        assert!((f64::from(*found) - expected).abs() < 1e-4 * expected, "{found} {expected}");
    }
    // With one neighbour alone: 27 m are the unit and the size.
    let pair = prior("depth_of_poses.onnx", "da3-anyview", &views[..2]);
    let expected = f64::from(bright.values[(500, 100)]) * 5.04;
    // The median of 0 and 27 is the lower one, so the least distance of 0.1 m is the unit: sizes of 270.
    assert!((f64::from(pair.values[(500, 100)]) - expected * 270.0 * 0.1 / 2.0).abs() < 1e-3 * expected, "{expected}");
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
