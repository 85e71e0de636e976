//! What is wrong with sets, settings and checkpoints has a name, a place and a hint; nothing is lost.

use std::path::Path;
use std::process::Command;

use candle_core::{Device, Tensor};
use sizeup_training::dataset::load::Set;
use sizeup_training::dataset::manifest::{FILE, FileEntry, Manifest};
use sizeup_training::dataset::{DatasetConfig, Split, make};
use sizeup_training::measure::{Row, measure};
use sizeup_training::network::evaluate::logits;
use sizeup_training::network::parameters::Parameters;
use sizeup_training::network::{FeatureConfig, Input, NetworkConfig};
use sizeup_training::train::checkpoint::Checkpoint;
use sizeup_training::train::loss::{loss, overlap};
use sizeup_training::train::optimise::Moments;
use sizeup_training::train::run::{LAST, Training};
use sizeup_training::train::sample::Batch;
use sizeup_training::train::{TrainConfig, features};

use crate::scene::{quick, small_network, villages};

/// Changes a file of a set and the manifest with it, as somebody would who makes sets by other means.
fn replace(root: &Path, name: &str, bytes: &[u8]) {
    std::fs::write(root.join(name), bytes).unwrap();
    let mut manifest: Manifest = serde_json::from_slice(&std::fs::read(root.join(FILE)).unwrap()).unwrap();
    manifest.files.insert(name.to_owned(), FileEntry::of(&root.join(name)).unwrap());
    std::fs::write(root.join(FILE), serde_json::to_vec(&manifest).unwrap()).unwrap();
}

fn refused<T: std::fmt::Debug>(result: Result<T, sizeup_training::TrainError>, words: &[&str]) {
    let message = result.unwrap_err().to_string();
    for word in words.iter().chain(&["hint: "]) {
        assert!(message.contains(word), "{word:?} is not in: {message}");
    }
}

#[test]
fn a_set_with_something_wrong_says_what_and_where() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("set");
    refused(Set::open(&root), &["manifest.json", "expected a set"]);
    villages(&root);
    let set = Set::open(&root).unwrap();
    assert!(set.manifest.scenes.iter().all(|s| s.n_photos > 0 && s.n_instances >= s.n_photos));
    let config: DatasetConfig = toml::from_str(crate::scene::VILLAGES).unwrap();
    refused(make::make(&config, &root, &|_| ()), &["there is a set already"]);

    let coco = set.coco(Split::Train).unwrap();
    let image = coco.images[0].clone();
    let photo = std::fs::read(root.join(&image.file_name)).unwrap();
    std::fs::write(root.join(&image.file_name), &photo[..photo.len() / 3]).unwrap();
    refused(Set::open(&root), &[&image.file_name, "expected", "SHA-256"]);
    replace(&root, &image.file_name, b"no photo at all");
    refused(Set::open(&root).unwrap().photos(Split::Train), &[&image.file_name, "cannot be read as a photo"]);
    replace(&root, &image.file_name, &photo);

    let labels = std::fs::read(root.join(&image.ground)).unwrap();
    let mut small = std::io::Cursor::new(Vec::new());
    image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(80, 64, image::Luma([1]))
        .write_to(&mut small, image::ImageFormat::Png)
        .unwrap();
    replace(&root, &image.ground, small.get_ref());
    refused(Set::open(&root).unwrap().photos(Split::Train), &[&image.ground, "160 × 128", "80 × 64"]);
    replace(&root, &image.ground, &labels);

    let text = std::fs::read_to_string(root.join("train.json")).unwrap();
    let changed = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut coco: serde_json::Value = serde_json::from_str(&text).unwrap();
        change(&mut coco);
        replace(&root, "train.json", coco.to_string().as_bytes());
        Set::open(&root).unwrap().coco(Split::Train)
    };
    refused(changed(&|c| c["images"][0]["off_nadir_deg"] = 31.0.into()), &["31.0° off the nadir", "15°"]);
    let without = |c: &mut serde_json::Value| {
        c["annotations"].as_array_mut().unwrap().retain(|a| a["image_id"] != image.id as u64);
    };
    refused(changed(&without), &[&image.file_name, "has no footprints"]);
    refused(changed(&|c| c["annotations"][0]["image_id"] = 999.into()), &["photo 999"]);
    refused(changed(&|c| c["images"][0]["scene"] = "b".into()), &["not in the split \"train\""]);
}

#[test]
fn scenes_that_cannot_be_are_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let make = |text: &str| make::make(&toml::from_str(text).unwrap(), folder.path(), &|_| ());
    refused(make("scene = []"), &["no scenes"]);
    let one = "[[scene]]\nname = \"a\"\nsplit = \"train\"\nlicence = \"x\"\n";
    refused(make(&format!("{one}{one}")), &["two scenes are called \"a\""]);
    refused(make(one), &["both `simulate` and `photos`, or neither"]);
    refused(make(&one.replace("\"a\"", "\"../a\"")), &["letters, digits"]);
    let oblique =
        toml::from_str::<DatasetConfig>(&format!("{one}simulate = {{ seed = \"x\" }}")).unwrap_err().to_string();
    assert!(oblique.contains("seed"), "{oblique}");
}

/// A user's photos: those of a simulation, tilted too far in one case.
#[test]
fn photos_of_ones_own_become_a_set_and_oblique_ones_do_not() {
    let folder = tempfile::tempdir().unwrap();
    villages(&folder.path().join("made"));
    let scene = folder.path().join("made/a");
    let georef: serde_json::Value = serde_json::from_slice(&std::fs::read(scene.join("georef.json")).unwrap()).unwrap();
    let text = |poses: &Path, height_field: &str| {
        format!(
            "[[scene]]\nname = \"mine\"\nsplit = \"test\"\nlicence = \"CC BY 4.0\"\n[scene.photos]\ncrs = {}\nheight_field = \"{height_field}\"\n\
             survey = {{ format = \"colmap\", path = {poses:?}, images = {:?}, offset = {} }}\n\
             footprints = {{ path = {:?}, id_field = \"id\" }}\nterrain = {{ dtm = {:?} }}\n\
             prior = {{ path = {:?}, kind = \"inverse_depth\" }}\n",
            georef["crs"],
            scene.join("images"),
            georef["offset"],
            scene.join("truth.geojson"),
            scene.join("dtm.tif"),
            scene.join("priors/{stem}.npy"),
        )
    };
    let make = |text: &str, to: &str| make::make(&toml::from_str(text).unwrap(), &folder.path().join(to), &|_| ());
    let manifest = make(&text(&scene.join("sparse"), "height_m"), "own").unwrap();
    let simulated = Set::open(&folder.path().join("made")).unwrap();
    assert_eq!(manifest.scenes[0].n_instances, simulated.manifest.scenes[0].n_instances);
    let own = Set::open(&folder.path().join("own")).unwrap().photos(Split::Test).unwrap();
    let expected = simulated.photos(Split::Train).unwrap();
    // The same footprints, from the layer rather than from the simulation: single pixels of the border may fall otherwise.
    let labels = |p: &sizeup_training::dataset::load::Photo| p.ground.map(|l| *l != 0);
    let off = labels(&own[0]).data().iter().zip(labels(&expected[0]).data()).filter(|(a, b)| a != b).count();
    assert!(off < 40 && own[0].relief.len() == 160 * 128, "{off}");
    refused(make(&text(&scene.join("sparse"), "storeys"), "no-heights"), &["has no height", "\"storeys\""]);

    // Every camera tilted by 40 degrees about its columns' axis: R' = T R, t' = T t.
    let tilted = folder.path().join("tilted");
    std::fs::create_dir(&tilted).unwrap();
    std::fs::copy(scene.join("sparse/cameras.txt"), tilted.join("cameras.txt")).unwrap();
    std::fs::write(tilted.join("points3D.txt"), "").unwrap();
    let turn = glam::DQuat::from_rotation_x(40_f64.to_radians());
    let images = std::fs::read_to_string(scene.join("sparse/images.txt")).unwrap();
    let tilt = |line: &str| -> String {
        let words: Vec<&str> = line.split(' ').collect();
        if line.starts_with('#') || words.len() != 10 {
            return if line.starts_with('#') { line.to_owned() } else { String::new() };
        }
        let v: Vec<f64> = words[1..8].iter().map(|w| w.parse().unwrap()).collect();
        let q = turn * glam::DQuat::from_xyzw(v[1], v[2], v[3], v[0]);
        let t = turn * glam::DVec3::new(v[4], v[5], v[6]);
        format!("{} {} {} {} {} {} {} {} {} {}", words[0], q.w, q.x, q.y, q.z, t.x, t.y, t.z, words[8], words[9])
    };
    let lines: Vec<String> = images.lines().map(tilt).collect();
    std::fs::write(tilted.join("images.txt"), lines.join("\n") + "\n").unwrap();
    refused(make(&text(&tilted, "height_m"), "oblique"), &["none of its", "straight down"]);
}

#[test]
fn checkpoints_of_another_head_or_another_set_are_not_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let (root, out) = (folder.path().join("set"), folder.path().join("out"));
    villages(&root);
    let set = Set::open(&root).unwrap();
    let run = |config: TrainConfig| Training::new(config, std::slice::from_ref(&set), &out)?.run(Some(2), &|_| ());
    run(quick()).unwrap();
    let before = std::fs::read(out.join(LAST)).unwrap();
    let mut wider = quick();
    wider.network.decoder = 16;
    refused(run(wider), &["last.safetensors", "another head", "\"decoder\":16", "\"decoder\":8"]);
    refused(run(TrainConfig { seed: 2, ..quick() }), &["other settings"]);
    let mut odd = quick();
    odd.crop_px = 60;
    refused(run(odd), &["crop_px = 60", "multiple of 8"]);
    refused(run(TrainConfig { pixel_m: Some(0.0), ..quick() }), &["pixel_m = 0", "0.01 to 10"]);
    let mut of_features = quick();
    (of_features.pixel_m, of_features.features) = (Some(0.3), Some(folder.path().to_owned()));
    of_features.network.inputs.clear();
    of_features.network.features = vec![FeatureConfig { name: "geo".to_owned(), channels: 3 }];
    refused(run(of_features), &["`pixel_m` and `features` are both set"]);
    let mut blind = quick();
    blind.network.inputs = Vec::new();
    refused(run(blind), &["inputs = []"]);
    assert_eq!(std::fs::read(out.join(LAST)).unwrap(), before);

    let path = out.join("cut.safetensors");
    std::fs::write(&path, &before[..before.len() / 2]).unwrap();
    refused(Checkpoint::read(&path, &Device::Cpu), &["cut.safetensors", "cannot be read"]);
    // Tensors of one head under the name of another.
    let text = String::from_utf8_lossy(&before).into_owned();
    assert!(text.contains("\\\"projected\\\":4"));
    let mut swapped = before.clone();
    let at = before.windows(15).position(|w| w == b"\\\"projected\\\":4").unwrap();
    swapped[at + 14] = b'8';
    std::fs::write(&path, &swapped).unwrap();
    refused(Checkpoint::read(&path, &Device::Cpu), &["expected [8,", "found [4,"]);
}

#[test]
fn networks_that_a_training_cannot_begin_with_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (root, out) = (folder.path().join("set"), folder.path().join("out"));
    villages(&root);
    let set = Set::open(&root).unwrap();
    Training::new(quick(), std::slice::from_ref(&set), &out).unwrap().run(Some(2), &|_| ()).unwrap();
    let best = out.join("best.safetensors");
    let onnx = folder.path().join("network.onnx");
    sizeup_training::export::write(&Checkpoint::read(&best, &Device::Cpu).unwrap(), 64, &onnx).unwrap();
    let begun = |start: &Path, config: TrainConfig| {
        let config = TrainConfig { start: Some(start.to_owned()), ..config };
        let new = folder.path().join("new");
        Training::new(config, std::slice::from_ref(&set), &new)?.run(Some(0), &|_| ())
    };
    let mut wider = quick();
    wider.network.decoder = 16;
    refused(begun(&best, wider.clone()), &["best.safetensors", "\"decoder\":8", "\"decoder\":16"]);
    refused(begun(&onnx, wider), &["network.onnx", "expected [16", "`start`"]);
    let mut shallower = quick();
    shallower.network.widths.pop();
    refused(begun(&onnx, shallower), &["network.onnx", "which the network to train has not"]);
    let mut deeper = quick();
    deeper.network.texture.push(8);
    refused(begun(&onnx, deeper), &["network.onnx", "it lacks texture."]);
    let row = Row::Network {
        name: "blind".to_owned(),
        path: onnx.clone(),
        tile: 64,
        dip: None,
        pixel_m: None,
        looks: 1,
        without: Some(Input::Depth),
    };
    refused(measure(&set, Split::Val, &[row], None), &["network.onnx", "without \"depth\"", "checkpoint"]);
    let bytes = std::fs::read(&onnx).unwrap();
    let path = folder.path().join("cut.onnx");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    refused(begun(&path, quick()), &["cut.onnx", "it is cut off"]);
    std::fs::write(&path, "no network at all").unwrap();
    refused(begun(&path, quick()), &["cut.onnx", "neither a checkpoint nor an ONNX file"]);
    let missing = begun(&folder.path().join("missing.onnx"), quick()).unwrap_err().to_string();
    assert!(missing.contains("missing.onnx"), "{missing}");
    let sets = [Set::open(&root).unwrap(), Set::open(&root).unwrap()];
    refused(Training::new(quick(), &sets, &out), &["scene \"a\" is in another set"]);
    refused(Training::new(quick(), &[], &out), &["no photos for \"train\""]);
}

#[test]
fn features_of_the_wrong_shape_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.safetensors");
    let map = Tensor::zeros((3, 8, 8), candle_core::DType::F32, &Device::Cpu).unwrap();
    candle_core::safetensors::save(&std::collections::HashMap::from([("tex2".to_owned(), map)]), &path).unwrap();
    let read = |name: &str, channels: usize| {
        features::read(&path, &[FeatureConfig { name: name.to_owned(), channels }], &Device::Cpu).map(|_| ())
    };
    read("tex2", 3).unwrap();
    refused(read("tex2", 256), &["a.safetensors", "expected 256", "[3, 8, 8]"]);
    refused(read("geo", 3), &["expected a feature \"geo\"", "tex2"]);
    let wanted = [FeatureConfig { name: "tex2".to_owned(), channels: 3 }];
    let absent = features::read(&folder.path().join("b.safetensors"), &wanted, &Device::Cpu);
    refused(absent.map(|_| ()), &["b.safetensors", "no features of this photo", "export_footprint_features.py"]);
}

#[test]
fn a_training_whose_photos_lack_features_does_not_begin() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("set");
    villages(&root);
    let set = Set::open(&root).unwrap();
    let mut config = quick();
    config.features = Some(folder.path().join("features"));
    config.network.inputs.clear();
    config.network.features = vec![FeatureConfig { name: "geo".to_owned(), channels: 3 }];
    let training = Training::new(config, std::slice::from_ref(&set), &folder.path().join("out")).map(|_| ());
    refused(training, &["photos have no features", ".safetensors", "export_footprint_features.py"]);
}

/// One building of 2 × 2 pixels in 64 × 64, a thousand to one, brighter than the ground; then none at all, and nothing known.
#[test]
fn a_building_in_a_thousand_pixels_is_learned_and_none_at_all_is_no_failure() {
    let config = TrainConfig {
        network: NetworkConfig { inputs: vec![Input::Image], ..small_network() },
        learning_rate: 1e-2,
        // It says "none" for about 400 steps, and then finds it.
        steps: 800,
        ..quick()
    };
    let side = 64;
    let is_built = |i: usize| (40..42).contains(&(i % side)) && (23..25).contains(&(i / side));
    let batch = |building: &dyn Fn(usize) -> bool, known: f32| {
        let tensor = |values: Vec<f32>, channels: usize| {
            Tensor::from_vec(values, (1, channels, side, side), &Device::Cpu).unwrap()
        };
        let target: Vec<f32> = (0..side * side).map(|i| f32::from(u8::from(building(i)))).collect();
        let image: Vec<f32> = target.iter().enumerate().map(|(i, t)| t + 0.1 * (i % 7) as f32).collect();
        Batch {
            inputs: vec![("image".to_owned(), tensor([&image[..]; 3].concat(), 3))],
            target: tensor(target.repeat(5), 5),
            weight: tensor(vec![known; 5 * side * side], 5),
        }
    };
    let parameters = Parameters::new(&config.network, 1, candle_core::DType::F32, &Device::Cpu).unwrap();
    let mut moments = Moments::new(&parameters).unwrap();
    let given = batch(&is_built, 1.0);
    let look = |given: &Batch| logits(&config.network, &parameters, &given.inputs, (side, side)).unwrap();
    for step in 1..=config.steps {
        let gradients = loss(&look(&given), &given, &config.loss).unwrap().backward().unwrap();
        moments.step(&parameters, &gradients, &config, step).unwrap();
    }
    let (both, either) = overlap(&look(&given), &given).unwrap();
    assert!(both >= 3.0 && either <= 6.0, "{both} of {either} pixels");
    for given in [batch(&|_| false, 1.0), batch(&is_built, 0.0)] {
        let lost = loss(&look(&given), &given, &config.loss).unwrap();
        let gradients = lost.backward().unwrap();
        let length = Moments::new(&parameters).unwrap().step(&parameters, &gradients, &config, 1).unwrap();
        assert!(lost.to_scalar::<f32>().unwrap().is_finite() && length.is_finite());
    }
}

/// A limit on the size of files stands in for a full disk: writing fails half way, and the signal for it is ignored.
#[test]
fn a_full_disk_leaves_the_last_checkpoint_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (root, out) = (folder.path().join("set"), folder.path().join("out"));
    villages(&root);
    let config = folder.path().join("train.toml");
    std::fs::write(&config, toml::to_string(&quick()).unwrap()).unwrap();
    Training::new(quick(), &[Set::open(&root).unwrap()], &out).unwrap().run(Some(3), &|_| ()).unwrap();
    let before = std::fs::read(out.join(LAST)).unwrap();
    let program = env!("CARGO_BIN_EXE_sizeup-train");
    let limit_kib = before.len() / 2048;
    let script = format!(
        "trap '' XFSZ; ulimit -f {limit_kib}; exec {program:?} train {config:?} --set {root:?} --output {out:?}"
    );
    let outcome = Command::new("bash").args(["-c", &script]).output().unwrap();
    let said = String::from_utf8_lossy(&outcome.stderr);
    assert_eq!(outcome.status.code(), Some(4), "{said}");
    assert!(said.contains("hint: is there room on the disk"), "{said}");
    assert_eq!(std::fs::read(out.join(LAST)).unwrap(), before);
    let litter: Vec<_> = std::fs::read_dir(&out)
        .unwrap()
        .map(|f| f.unwrap().file_name())
        .filter(|n| n.to_string_lossy().contains("partial"))
        .collect();
    assert!(litter.is_empty(), "{litter:?}");
}
