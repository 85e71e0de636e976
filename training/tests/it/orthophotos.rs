//! Real orthophotos with outlines of roofs: learned from beside simulated photos, for what their labels tell.

use std::path::Path;

use candle_core::{Device, Tensor};
use image::{ImageBuffer, Luma, Rgb};
use serde_json::json;
use sizeup_training::dataset::Split;
use sizeup_training::dataset::load::Set;
use sizeup_training::dataset::manifest::{FILE, FileEntry};
use sizeup_training::network::Input;
use sizeup_training::train::run::Training;
use sizeup_training::train::sample::{Scene, of_step, whole};
use sizeup_training::train::{OrthophotoConfig, TrainConfig};

use crate::scene::{quick, small_network, villages};

/// Side of a tile, pixels of 0.25 m.
const SIDE: u32 = 128;

/// A roof of 8 m on a tile, away from its border.
fn is_roof(col: u32, row: u32) -> bool {
    (40..72).contains(&col) && (48..80).contains(&row)
}

/// A set of tiles without depth: one place to learn from, one to look at. The ground is a fine chequer, the roof white.
fn tiles(root: &Path) {
    let mut files = serde_json::Map::new();
    let mut scenes = Vec::new();
    for (scene, split) in [("here", "train"), ("there", "val")] {
        let names = ["images", "ground"].map(|folder| {
            std::fs::create_dir_all(root.join(scene).join(folder)).unwrap();
            format!("{scene}/{folder}/tile.png")
        });
        let ground = |col: u32, row: u32| if (col + row).is_multiple_of(2) { 40 } else { 80 };
        let colour = |col: u32, row: u32| Rgb([if is_roof(col, row) { 250_u8 } else { ground(col, row) }; 3]);
        ImageBuffer::from_fn(SIDE, SIDE, colour).save(root.join(&names[0])).unwrap();
        ImageBuffer::from_fn(SIDE, SIDE, |c, r| Luma([u16::from(is_roof(c, r))])).save(root.join(&names[1])).unwrap();
        let coco = json!({
            "images": [{
                "id": 1, "file_name": names[0], "width": SIDE, "height": SIDE, "scene": scene, "off_nadir_deg": 0.0,
                "nadir_px": [64.0, 64.0], "focal_px": 1e6, "ground_sample_m": 0.25,
                "ground": names[1], "roof": names[1], "visible": names[1],
            }],
            "annotations": [{
                "id": 1, "image_id": 1, "category_id": 1, "segmentation": { "size": [SIDE, SIDE], "counts": [SIDE * SIDE] },
                "bbox": [40, 48, 32, 32], "area": 1024, "iscrowd": 0, "label": 1, "building": "b", "visible_share": 1.0,
                "occluded": false, "truncated": false,
            }],
            "categories": [{ "id": 1, "name": "building" }],
        });
        let list = format!("{split}.json");
        std::fs::write(root.join(&list), coco.to_string()).unwrap();
        for name in names.into_iter().chain([list]) {
            let entry = serde_json::to_value(FileEntry::of(&root.join(&name)).unwrap()).unwrap();
            files.insert(name, entry);
        }
        scenes.push(json!({
            "name": scene, "split": split, "licence": "CC0-1.0", "n_buildings": 1, "n_photos": 1, "n_instances": 1,
            "n_occluded": 0, "n_with_depth": 0, "notes": [],
            "source": { "name": scene, "split": split, "licence": "CC0-1.0" },
        }));
    }
    let manifest = json!({ "format": "sizeup-footprints.v1", "scenes": scenes, "files": files });
    std::fs::write(root.join(FILE), manifest.to_string()).unwrap();
}

fn config() -> TrainConfig {
    let scenes = vec!["here".to_owned(), "there".to_owned()];
    TrainConfig { orthophotos: OrthophotoConfig { scenes, ..OrthophotoConfig::default() }, ..quick() }
}

/// One channel of a tensor `1 × channels × rows × columns`.
fn channel(tensor: &Tensor, channel: usize) -> Vec<f32> {
    tensor.narrow(1, channel, 1).unwrap().flatten_all().unwrap().to_vec1().unwrap()
}

fn sum(values: &[f32]) -> f32 {
    values.iter().sum()
}

#[test]
fn outlines_of_roofs_teach_roofs_and_the_ground_beside_a_rim_and_no_rise() {
    let folder = tempfile::tempdir().unwrap();
    tiles(folder.path());
    let photos = Set::open(folder.path()).unwrap().photos(Split::Train).unwrap();
    let scene = &Scene::ready(photos.clone(), &config()).unwrap()[0];
    let batch = whole(scene, &config(), &Device::Cpu).unwrap();
    let (_, depth) = batch.inputs.iter().find(|(name, _)| name == Input::Depth.name()).unwrap();
    assert_eq!(channel(depth, 0), vec![0.0; 128 * 128]);
    // 0.4 m are 1.6 pixels of 0.25 m: one row on each side of the outline. Beyond the corners pixels are 1.4 away.
    let ground = channel(&batch.weight, 0);
    let row: String = ground[64 * 128 + 36..64 * 128 + 76].iter().map(|w| if *w > 0.0 { '#' } else { '.' }).collect();
    assert_eq!(row, "###..##############################..###");
    assert_eq!(sum(&ground), (128 * 128 - (34 * 34 - 30 * 30)) as f32);
    assert_eq!(sum(&channel(&batch.weight, 1)), (128 * 128) as f32);
    assert_eq!((sum(&channel(&batch.target, 1)), sum(&channel(&batch.weight, 3))), (1024.0, 0.0));

    // As a photo like others, the same labels teach a rise of nought and the ground up to the outline.
    let as_others = whole(&Scene::ready(photos, &quick()).unwrap()[0], &quick(), &Device::Cpu).unwrap();
    assert_eq!(sum(&channel(&as_others.weight, 0)), (128 * 128) as f32);
    assert_eq!(sum(&channel(&as_others.weight, 3)), 1024.0);
}

/// A tile of 0.25 m seen at 1 m: four pixels each way become one. A chequer thinned out instead is black or white.
#[test]
fn a_much_finer_photo_is_averaged_and_not_thinned_out() {
    let folder = tempfile::tempdir().unwrap();
    tiles(folder.path());
    let photos = Set::open(folder.path()).unwrap().photos(Split::Train).unwrap();
    let config = TrainConfig { pixel_m: Some(1.0), ..config() };
    let photo = Scene::ready(photos, &config).unwrap().remove(0).photo;
    assert_eq!((photo.size, photo.image.ground_sample_m, photo.lean.nadir_px), ((32, 32), 1.0, [16.0, 16.0]));
    let at = |col: usize, row: usize| photo.rgb[row * 32 + col];
    assert_eq!((at(2, 2), at(12, 14)), ([60; 3], [250; 3]));
    let n_roof = photo.roof.data().iter().filter(|label| **label == 1).count();
    assert_eq!(n_roof, 64);
}

/// Crops that lean teach nothing of the ground; crops with depth have it on the roof. Both only where the configuration asks.
#[test]
fn crops_of_orthophotos_get_leans_and_depth_that_their_photos_lack() {
    let folder = tempfile::tempdir().unwrap();
    tiles(folder.path());
    let photos = Set::open(folder.path()).unwrap().photos(Split::Train).unwrap();
    for given in [0.0, 1.0] {
        let mut config = config();
        (config.orthophotos.leaning, config.orthophotos.raised) = (given, given);
        let scenes = Scene::ready(photos.clone(), &config).unwrap();
        let (mut lean, mut relief, mut ground, mut n_roof) = (0.0, 0.0, 0.0, 0.0);
        for step in 1..=8 {
            let batch = of_step(&scenes, &config, step, &Device::Cpu).unwrap();
            let input = |input: Input| &batch.inputs.iter().find(|(name, _)| name == input.name()).unwrap().1;
            lean += channel(input(Input::Lean), 0).iter().map(|v| v.abs()).sum::<f32>();
            let is_roof = channel(&batch.target, 1);
            relief += channel(input(Input::Depth), 0).iter().zip(&is_roof).map(|(r, is_roof)| r * is_roof).sum::<f32>();
            ground += sum(&channel(&batch.weight, 0));
            n_roof += sum(&is_roof);
        }
        assert!(n_roof > 1000.0, "most crops show the roof: {n_roof}");
        if given == 0.0 {
            assert!(lean < 1.0 && relief == 0.0 && ground > 10_000.0, "{lean} {relief} {ground}");
        } else {
            assert!(lean > 1000.0 && relief > 0.8 * n_roof && ground == 0.0, "{lean} {relief} of {n_roof} {ground}");
        }
    }
}

#[test]
fn a_training_learns_from_simulated_photos_and_orthophotos_together() {
    let folder = tempfile::tempdir().unwrap();
    let (simulated, real) = (folder.path().join("simulated"), folder.path().join("real"));
    villages(&simulated);
    tiles(&real);
    let sets = || [Set::open(&simulated).unwrap(), Set::open(&real).unwrap()];
    let told = std::cell::RefCell::new(String::new());
    let training = Training::new(config(), &sets(), &folder.path().join("out")).unwrap();
    let state = training.run(None, &|line| told.borrow_mut().push_str(line)).unwrap();
    assert_eq!(state.progress.step, 6);
    assert!(told.borrow().contains(" % of orthophotos, "), "{}", told.borrow());

    let mut unknown = config();
    unknown.orthophotos.scenes.push("nowhere".to_owned());
    let message = Training::new(unknown, &sets(), &folder.path().join("other")).unwrap_err().to_string();
    assert!(
        message.contains("\"nowhere\"") && message.contains("here, there") && message.contains("hint: "),
        "{message}"
    );
    // A network that sees nothing but depth cannot learn from them.
    let mut blind = config();
    blind.network =
        sizeup_training::network::NetworkConfig { inputs: vec![Input::Depth, Input::Lean], ..small_network() };
    let message = Training::new(blind, &sets(), &folder.path().join("blind")).unwrap_err().to_string();
    assert!(message.contains("tile.png has no depth") && message.contains("hint: "), "{message}");
}
