//! A network learns what it is shown, goes on after a kill to the same bits, and does the same in ONNX.

use std::path::Path;

use candle_core::{DType, Device, Tensor};
use sizeup_photos::onnx::{Network, Tensor as Values};
use sizeup_training::dataset::Split;
use sizeup_training::dataset::load::Set;
use sizeup_training::export;
use sizeup_training::measure::{Row, measure};
use sizeup_training::network::evaluate::logits;
use sizeup_training::network::parameters::Parameters;
use sizeup_training::network::{FeatureConfig, Input, NetworkConfig};
use sizeup_training::train::TrainConfig;
use sizeup_training::train::checkpoint::{Checkpoint, Progress};
use sizeup_training::train::loss::{loss, overlap};
use sizeup_training::train::optimise::Moments;
use sizeup_training::train::run::{LAST, LOG, Training};
use sizeup_training::train::sample::{Scene, whole};

use crate::scene::{quick, small_network, villages};

fn checkpoint(config: TrainConfig, parameters: Parameters) -> Checkpoint {
    let progress = Progress { step: 0, best_loss: None, best_step: 0, best_iou: 0.0, n_since: 0, loss_sum: (0.0, 0) };
    let best = parameters.clone();
    Checkpoint { config, progress, set: "of a test".to_owned(), parameters, best, moments: None }
}

#[test]
fn one_photo_is_learned_by_heart_and_sizeup_draws_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("set");
    villages(&root);
    let mut set = Set::open(&root).unwrap();
    let config = TrainConfig { learning_rate: 1e-2, steps: 160, ..quick() };
    let photos = set.photos(Split::Train).unwrap();
    let n_shared = |s: &Scene| s.middles.is_shared.iter().filter(|b| **b).count();
    let scenes = Scene::ready(photos, &config).unwrap();
    let scene = scenes.iter().max_by_key(|s| n_shared(s)).unwrap();
    assert!(n_shared(scene) > 50, "there is a row of houses: {}", n_shared(scene));
    let batch = whole(scene, &config, &Device::Cpu).unwrap();
    let size = (batch.target.dim(2).unwrap(), batch.target.dim(3).unwrap());
    let sum =
        |t: &Tensor, channel: usize| t.narrow(1, channel, 1).unwrap().sum_all().unwrap().to_scalar::<f32>().unwrap();
    let (n_roof, n_risen) = (sum(&batch.target, 1), sum(&batch.weight, 3));
    assert!(n_risen > 0.7 * n_roof && n_risen <= n_roof, "the rise of {n_risen} of {n_roof} pixels of roofs is known");
    let parameters = Parameters::new(&config.network, 1, DType::F32, &Device::Cpu).unwrap();
    let mut moments = Moments::new(&parameters).unwrap();
    for step in 1..=config.steps {
        let found = logits(&config.network, &parameters, &batch.inputs, size).unwrap();
        let gradients = loss(&found, &batch, &config.loss).unwrap().backward().unwrap();
        moments.step(&parameters, &gradients, &config, step).unwrap();
    }
    let found = logits(&config.network, &parameters, &batch.inputs, size).unwrap();
    let (both, either) = overlap(&found, &batch).unwrap();
    assert!(both / either > 0.93, "IoU {}", both / either);

    // Through sizeup's own code, on that photo alone.
    let path = folder.path().join("heart.safetensors");
    checkpoint(config, parameters).write(&path).unwrap();
    set.manifest.files.retain(|name, _| Path::new(name).extension().is_none_or(|e| e != "json"));
    let mut coco: serde_json::Value = serde_json::from_slice(&std::fs::read(root.join("train.json")).unwrap()).unwrap();
    let id = scene.photo.image.id as u64;
    coco["images"].as_array_mut().unwrap().retain(|i| i["id"] == id);
    coco["annotations"].as_array_mut().unwrap().retain(|i| i["image_id"] == id);
    std::fs::write(root.join("train.json"), coco.to_string()).unwrap();
    let entry = sizeup_training::dataset::manifest::FileEntry::of(&root.join("train.json")).unwrap();
    set.manifest.files.insert("train.json".to_owned(), entry);
    let rows = [Row::Network {
        name: "by heart".to_owned(),
        path,
        tile: 128,
        dip: None,
        pixel_m: None,
        looks: 1,
        without: None,
    }];
    let measured = &measure(&set, Split::Train, &rows, None).unwrap()[0];
    // That its row houses stay apart takes more steps than a test has: only the area is held here.
    assert!(measured.instances.n_truth >= 4 && measured.iou_of_pixels > 0.9, "{measured:?}");
}

/// The labels of a set, the rises found in them and sizeup's own watershed give the footprints back, rows of houses too.
#[test]
fn what_a_network_is_to_say_of_roofs_makes_better_footprints_than_what_is_visible() {
    let folder = tempfile::tempdir().unwrap();
    villages(folder.path());
    let set = Set::open(folder.path()).unwrap();
    let measured = measure(&set, Split::Train, &[Row::Perfect, Row::Visible], None).unwrap();
    let iou = |i: usize| measured[i].instances.area_by_building.iou;
    assert!(measured[0].instances.n_truth >= 16, "{measured:?}");
    // Flown at 70 m, many roofs are cut off by the photo's border: 65 %, and 51 % of what is visible, when it was written.
    assert!(iou(0) > 0.6 && iou(0) > iou(1) + 0.1, "{} of roofs, {} of what is visible", iou(0), iou(1));
}

fn run(set: &Set, out: &Path, most_steps: Option<usize>) -> Checkpoint {
    Training::new(quick(), std::slice::from_ref(set), out).unwrap().run(most_steps, &|_| ()).unwrap()
}

#[test]
fn a_training_that_was_killed_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    villages(&folder.path().join("set"));
    let set = Set::open(&folder.path().join("set")).unwrap();
    let (whole, killed) = (folder.path().join("whole"), folder.path().join("killed"));
    run(&set, &whole, None);
    // Killed at step 3, so that the step since the checkpoint at 2 is lost; then at 5.
    run(&set, &killed, Some(3));
    run(&set, &killed, Some(3));
    let state = run(&set, &killed, None);
    assert_eq!(state.progress.step, 6);
    for file in [LAST, LOG, "best.safetensors", "curve.png", "val.png"] {
        let read = |folder: &Path| std::fs::read(folder.join(file)).unwrap();
        assert!(read(&whole) == read(&killed), "{file} differs");
    }
}

/// Photos of some 0.5 m per pixel, reduced to 1 m: half the pixels each way, as much of them built on; coarser ones are as they are.
#[test]
fn photos_finer_than_a_network_sees_are_reduced() {
    let folder = tempfile::tempdir().unwrap();
    villages(&folder.path().join("set"));
    let set = Set::open(&folder.path().join("set")).unwrap();
    let photos = set.photos(Split::Train).unwrap();
    let pixel_m = photos[0].image.ground_sample_m;
    assert!((0.4..0.7).contains(&pixel_m), "{pixel_m}");
    let seen = |pixel_m: f64| {
        let config = TrainConfig { pixel_m: Some(pixel_m), ..quick() };
        let scene = &Scene::ready(vec![photos[0].clone()], &config).unwrap()[0];
        let target = whole(scene, &config, &Device::Cpu).unwrap().target;
        let built = target.narrow(1, 0, 1).unwrap().mean_all().unwrap().to_scalar::<f32>().unwrap();
        (target.dims()[2..].to_vec(), built)
    };
    let (size, built) = seen(0.5 * pixel_m);
    let (reduced_size, reduced) = seen(2.0 * pixel_m);
    assert_eq!((size, reduced_size), (vec![128, 160], vec![64, 80]));
    assert!(built > 0.03 && (built - reduced).abs() < 0.1 * built, "{built} {reduced}");
    let out = folder.path().join("out");
    let config = TrainConfig { pixel_m: Some(1.0), steps: 2, ..quick() };
    Training::new(config, std::slice::from_ref(&set), &out).unwrap().run(None, &|_| ()).unwrap();
    assert!(out.join("val.png").exists());
}

/// A network that was exported, or the checkpoint that it was exported from: a training begins with the same numbers, and learns from two sets.
#[test]
fn a_training_goes_on_from_another_ones_network_with_more_photos() {
    let folder = tempfile::tempdir().unwrap();
    villages(&folder.path().join("set"));
    let text = crate::scene::VILLAGES.replace("name = \"", "name = \"more-").replace("seed = 5", "seed = 6");
    let more = folder.path().join("more");
    sizeup_training::dataset::make::make(&toml::from_str(&text).unwrap(), &more, &|_| ()).unwrap();
    let set = Set::open(&folder.path().join("set")).unwrap();
    let first = run(&set, &folder.path().join("first"), None);
    let best = folder.path().join("first/best.safetensors");
    let onnx = folder.path().join("first.onnx");
    export::write(&Checkpoint::read(&best, &Device::Cpu).unwrap(), 64, &onnx).unwrap();
    let values = |p: &Parameters| -> Vec<Vec<f32>> {
        p.vars.values().map(|v| v.as_tensor().flatten_all().unwrap().to_vec1().unwrap()).collect()
    };
    for (start, out) in [(best, "from-checkpoint"), (onnx, "from-onnx")] {
        let config = TrainConfig { start: Some(start), seed: 2, ..quick() };
        let sets = [Set::open(&folder.path().join("set")).unwrap(), Set::open(&more).unwrap()];
        let training = Training::new(config.clone(), &sets, &folder.path().join(out)).unwrap();
        assert_eq!(values(&training.run(Some(0), &|_| ()).unwrap().parameters), values(&first.best));
        let n_photos = |set: &Set| set.manifest.scenes.iter().map(|s| s.n_photos).sum::<usize>();
        let told = std::cell::RefCell::new(String::new());
        let state = training.run(None, &|line| told.borrow_mut().push_str(line)).unwrap();
        assert_ne!(values(&state.parameters), values(&first.best));
        let n_train = sets.iter().map(n_photos).sum::<usize>() - set.photos(Split::Val).unwrap().len() * 2;
        assert!(told.borrow().contains(&format!("{n_train} photos")), "{n_train}: {}", told.borrow());
        // The sets belong to it: it does not go on with one of them alone.
        let alone = Training::new(config, &sets[..1], &folder.path().join(out)).unwrap().run(None, &|_| ());
        assert!(alone.unwrap_err().to_string().contains("another set"));
    }
}

/// Largest difference of two maps' probabilities.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    let p = |v: &f32| 1.0 / (1.0 + (-v).exp());
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (p(a) - p(b)).abs()).fold(0.0, f32::max)
}

fn noise(shape: &[usize], key: f32) -> Tensor {
    let n: usize = shape.iter().product();
    let values: Vec<f32> =
        (0..n).map(|i| ((i as f32 + key) * 0.7).sin() + 0.3 * ((i as f32) * 0.031 * key).cos()).collect();
    Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
}

fn in_onnx(bytes: &[u8], given: &[(String, Tensor)]) -> Vec<f32> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("network.onnx");
    std::fs::write(&path, bytes).unwrap();
    let network = Network::open(&path).unwrap();
    let values: Vec<(String, Values)> = given
        .iter()
        .map(|(name, t)| {
            (name.clone(), Values { shape: t.dims().to_vec(), values: t.flatten_all().unwrap().to_vec1().unwrap() })
        })
        .collect();
    let inputs: Vec<(&str, &Values)> = values.iter().map(|(name, v)| (name.as_str(), v)).collect();
    network.run_many(&inputs, &["logits"]).unwrap().remove(0).values
}

#[test]
fn the_exported_network_says_the_same_to_a_ten_thousandth() {
    for config in [NetworkConfig::default(), small_network()] {
        let parameters = Parameters::new(&config, 5, DType::F32, &Device::Cpu).unwrap();
        let given: Vec<(String, Tensor)> = config
            .inputs
            .iter()
            .map(|i| (i.name().to_owned(), noise(&[1, i.channels(), 96, 96], 1.0 + i.channels() as f32)))
            .collect();
        let here =
            logits(&config, &parameters, &given, (96, 96)).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let checkpoint = checkpoint(TrainConfig { network: config, ..TrainConfig::default() }, parameters);
        let there = in_onnx(&export::bytes(&checkpoint, 96).unwrap(), &given);
        assert!(apart(&here, &there) < 1e-4, "{}", apart(&here, &there));
        assert!(here.iter().any(|v| v.abs() > 0.1), "it says something");
    }
}

/// Feature maps as SAM 3 and Depth Anything 3 give them, in small: strides 3.5, 7, 14, and 14 again.
#[test]
fn a_head_takes_features_of_any_stride_and_width_and_says_the_same_in_onnx() {
    let features = [("tex0", 6, 32), ("tex1", 5, 16), ("tex2", 7, 8), ("geo", 9, 8)];
    let config = NetworkConfig {
        inputs: Vec::new(),
        features: features
            .iter()
            .map(|(name, channels, _)| FeatureConfig { name: (*name).to_owned(), channels: *channels })
            .collect(),
        ..small_network()
    };
    let parameters = Parameters::new(&config, 5, DType::F32, &Device::Cpu).unwrap();
    let given: Vec<(String, Tensor)> =
        features.iter().map(|(name, c, side)| ((*name).to_owned(), noise(&[1, *c, *side, *side], *c as f32))).collect();
    let here =
        logits(&config, &parameters, &given, (112, 112)).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let checkpoint = checkpoint(TrainConfig { network: config, ..TrainConfig::default() }, parameters);
    let sizes: Vec<(usize, usize)> = features.iter().map(|(_, _, side)| (*side, *side)).collect();
    let there = in_onnx(&export::head_bytes(&checkpoint, &sizes, 112).unwrap(), &given);
    assert_eq!(here.len(), 5 * 112 * 112);
    assert!(apart(&here, &there) < 1e-4, "{}", apart(&here, &there));
}

/// The command takes sizes from a photo's features: of the maps, or of one tile where the file says so.
#[test]
fn a_head_is_exported_for_maps_like_those_that_it_learned_from() {
    let folder = tempfile::tempdir().unwrap();
    let features = [("tex0", 6, 32), ("geo", 9, 8)];
    let config = NetworkConfig {
        inputs: Vec::new(),
        features: features.iter().map(|(n, c, _)| FeatureConfig { name: (*n).to_owned(), channels: *c }).collect(),
        ..small_network()
    };
    let parameters = Parameters::new(&config, 5, DType::F32, &Device::Cpu).unwrap();
    let network = TrainConfig { network: config, features: Some("features".into()), ..TrainConfig::default() };
    let path = folder.path().join("best.safetensors");
    checkpoint(network, parameters).write(&path).unwrap();
    // Of a photo of two tiles side by side, one of which has 32 and 8 cells across.
    let wide = |channels: usize, side: usize| noise(&[channels, side, 2 * side], 1.0);
    let maps: Vec<(&str, Tensor)> = features.iter().map(|(name, c, side)| (*name, wide(*c, *side))).collect();
    let like = |name: &str, about: &[(&str, &str)]| {
        let path = folder.path().join(name);
        let about = about.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        safetensors::serialize_to_file(maps.clone(), Some(about), &path).unwrap();
        path
    };
    let export = |like: Option<&std::path::Path>| {
        let head = folder.path().join("head.onnx");
        let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_sizeup-train"));
        program.arg("export").arg(&path).args(["--tile", "64"]).arg("--output").arg(&head);
        like.iter().for_each(|like| {
            program.arg("--like").arg(like);
        });
        let outcome = program.output().unwrap();
        let said = String::from_utf8_lossy(&outcome.stderr).into_owned();
        if outcome.status.success() { Ok(std::fs::read(head).unwrap()) } else { Err(said) }
    };
    let inputs = |bytes: &[u8]| -> Vec<Vec<Option<usize>>> {
        let graph = folder.path().join("of.onnx");
        std::fs::write(&graph, bytes).unwrap();
        Network::open(&graph).unwrap().inputs().iter().map(|port| port.shape.clone()).collect()
    };
    let sized = |sizes: [[usize; 4]; 2]| sizes.map(|s| s.map(Some).to_vec()).to_vec();
    let whole = export(Some(&like("whole.safetensors", &[]))).unwrap();
    assert_eq!(inputs(&whole), sized([[1, 6, 32, 64], [1, 9, 8, 16]]));
    let tile = [("tile.tex0", "32x32"), ("tile.geo", "8x8")];
    let tiled = export(Some(&like("tile.safetensors", &tile))).unwrap();
    assert_eq!(inputs(&tiled), sized([[1, 6, 32, 32], [1, 9, 8, 8]]));
    let none = export(None).unwrap_err();
    assert!(none.contains("--like"), "{none}");
    let odd = export(Some(&like("odd.safetensors", &[("tile.geo", "8 by 8")]))).unwrap_err();
    assert!(odd.contains("\"8 by 8\"") && odd.contains("odd.safetensors"), "{odd}");
}

#[test]
fn a_network_blind_to_an_input_says_the_same_whatever_that_shows() {
    let config = small_network();
    let parameters = || Parameters::new(&config, 5, DType::F32, &Device::Cpu).unwrap();
    let of = |parameters| checkpoint(TrainConfig { network: config.clone(), ..TrainConfig::default() }, parameters);
    let blind = of(parameters()).blind_to(Input::Image).unwrap();
    let said = |network: &Parameters, image: f32, depth: f32| {
        let given = [(Input::Image, image), (Input::Depth, depth), (Input::Lean, 1.0)];
        let given: Vec<(String, Tensor)> =
            given.iter().map(|(i, key)| (i.name().to_owned(), noise(&[1, i.channels(), 32, 32], *key))).collect();
        logits(&config, network, &given, (32, 32)).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap()
    };
    assert_eq!(said(&blind.best, 2.0, 3.0), said(&blind.best, 5.0, 3.0));
    assert!(apart(&said(&blind.best, 2.0, 3.0), &said(&blind.best, 2.0, 6.0)) > 1e-3, "it sees depth");
    assert!(apart(&said(&parameters(), 2.0, 3.0), &said(&parameters(), 5.0, 3.0)) > 1e-3, "others see colours");
    let message = of(parameters()).blind_to(Input::Lean).unwrap_err().to_string();
    assert!(message.contains("\"lean\"") && message.contains("hint: "), "{message}");
}

#[test]
fn one_thread_and_many_train_the_same_network() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("set");
    villages(&set);
    let config = folder.path().join("train.toml");
    std::fs::write(&config, toml::to_string(&TrainConfig { steps: 3, ..quick() }).unwrap()).unwrap();
    let trained = |threads: &str| {
        let out = folder.path().join(threads);
        let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_sizeup-train"));
        program.env("RAYON_NUM_THREADS", threads).arg("train").arg(&config);
        let outcome = program.arg("--set").arg(&set).arg("--output").arg(&out).output().unwrap();
        assert!(outcome.status.success(), "{}", String::from_utf8_lossy(&outcome.stderr));
        std::fs::read(out.join(LAST)).unwrap()
    };
    assert!(trained("1") == trained("3"));
}
