//! Makes a set: photos, labels, COCO files, the manifest last, so that a set that has one is whole.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use image::{ExtendedColorType, ImageEncoder};
use serde::Serialize;
use sizeup_footprints::segment::geometry::Lean;
use sizeup_geo::files::write_whole_unflushed;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

use super::coco::{CocoCategory, CocoImage, CocoInstance, CocoPrior, CocoSet, run_lengths};
use super::labels::Labels;
use super::manifest::{FILE, FORMAT, FileEntry, Manifest, SceneEntry};
use super::sources::{Source, stem};
use super::{DatasetConfig, SceneConfig, Split};
use crate::TrainError;

/// Instances smaller than this are no instances: a corner at a photo's border, pixels.
const LEAST_PX: usize = 16;
/// Hidden shares below this are noise of single pixels.
const OCCLUDED_FROM: f64 = 0.01;

/// Makes a set in a folder that has none yet; `told` hears what is done.
///
/// # Errors
/// [`TrainError`] for scenes that cannot be used and files that cannot be written.
pub fn make(config: &DatasetConfig, out: &Path, told: &dyn Fn(&str)) -> Result<Manifest, TrainError> {
    check(config, out)?;
    let mut sets: BTreeMap<Split, CocoSet> = BTreeMap::new();
    let mut scenes = Vec::new();
    for scene in &config.scene {
        let set = sets.entry(scene.split).or_default();
        let entry = make_scene(scene, out, set)?;
        told(&format!(
            "{}: {} photos, {} buildings, {} instances, {} of them partly hidden",
            entry.name, entry.n_photos, entry.n_buildings, entry.n_instances, entry.n_occluded
        ));
        entry.notes.iter().for_each(|note| told(&format!("  {note}")));
        scenes.push(entry);
    }
    for (split, set) in &mut sets {
        set.categories = vec![CocoCategory { id: 1, name: "building".to_owned() }];
        write_json(&out.join(format!("{}.json", split.name())), set)?;
    }
    let mut files = BTreeMap::new();
    list(out, out, &mut files)?;
    let manifest = Manifest { format: FORMAT.to_owned(), scenes, files };
    write_json(&out.join(FILE), &manifest)?;
    Ok(manifest)
}

fn check(config: &DatasetConfig, out: &Path) -> Result<(), TrainError> {
    if out.join(FILE).exists() {
        return Err(TrainError::set(out, "there is a set already", "choose another folder, or remove this one first"));
    }
    if config.scene.is_empty() {
        return Err(TrainError::config(
            "the set has no scenes",
            "write a [[scene]] for each; docs/footprint-network.md has one",
        ));
    }
    let mut names = BTreeSet::new();
    for scene in &config.scene {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if scene.name.is_empty() || !scene.name.chars().all(is_plain) {
            let problem = format!("a scene is called {:?}", scene.name);
            return Err(TrainError::config(problem, "names are letters, digits, `-` and `_`: they become folders"));
        }
        if !names.insert(&scene.name) {
            let problem = format!("two scenes are called {:?}", scene.name);
            return Err(TrainError::config(problem, "a scene is in one split only, under a name of its own"));
        }
    }
    Ok(())
}

fn make_scene(scene: &SceneConfig, out: &Path, set: &mut CocoSet) -> Result<SceneEntry, TrainError> {
    let folder = out.join(&scene.name);
    let mut source = Source::prepare(scene, &folder, &|_, _| ())?;
    let mut entry = SceneEntry {
        name: scene.name.clone(),
        split: scene.split,
        licence: scene.licence.clone(),
        n_buildings: source.world.buildings.len(),
        n_photos: 0,
        n_instances: 0,
        n_occluded: 0,
        n_with_depth: 0,
        notes: std::mem::take(&mut source.notes),
        source: scene.clone(),
    };
    for view in &source.views {
        match make_photo(scene, &source, view, out, set)? {
            None => entry.notes.push(format!("{}: it shows none of the footprints and is left out", view.id.0)),
            Some((n, n_occluded)) => {
                entry.n_photos += 1;
                entry.n_instances += n;
                entry.n_occluded += n_occluded;
                entry.n_with_depth += usize::from(source.prior.is_some());
            }
        }
    }
    if entry.n_photos == 0 {
        return Err(TrainError::scene(&scene.name)(
            "none of its photos shows any of its footprints\nhint: are poses and footprints in the CRS that they say?",
        ));
    }
    Ok(entry)
}

/// Labels of one photo; how many instances, and how many of them hidden. Nothing where it shows no footprint.
fn make_photo(
    scene: &SceneConfig,
    source: &Source,
    view: &View,
    out: &Path,
    set: &mut CocoSet,
) -> Result<Option<(usize, usize)>, TrainError> {
    let (labels, instances) = Labels::of(view, &source.world, &source.sight, source.complete_m);
    let instances: Vec<_> = instances.into_iter().filter(|i| i.area_px >= LEAST_PX).collect();
    if instances.is_empty() {
        return Ok(None);
    }
    let lean = Lean::of(view).ok_or_else(|| {
        TrainError::scene(&scene.name)(format!("{}: its nadir lies beyond its lens model", view.id.0))
    })?;
    let stem = stem(&view.id);
    let file = |kind: &str| format!("{}/{kind}/{stem}.png", scene.name);
    for (kind, map) in [("ground", &labels.ground), ("roof", &labels.roof), ("visible", &labels.visible)] {
        write_labels(&out.join(file(kind)), map)?;
    }
    let image_id = set.images.len() + 1;
    let centre = view.camera_from_map.centre();
    let ground_z = source.world.terrain.height_at(centre.x, centre.y);
    let mean_z = source.world.buildings.iter().map(|b| b.ground_z_m).sum::<f64>() / source.world.buildings.len() as f64;
    set.images.push(CocoImage {
        id: image_id,
        file_name: format!("{}/images/{}", scene.name, view.id.0),
        width: view.camera.width_px,
        height: view.camera.height_px,
        scene: scene.name.clone(),
        off_nadir_deg: view.off_nadir_deg(),
        nadir_px: lean.nadir_px,
        focal_px: lean.focal_px,
        ground_sample_m: (centre.z - ground_z.unwrap_or(mean_z)) / lean.focal_px,
        ground: file("ground"),
        roof: file("roof"),
        visible: file("visible"),
        prior: source.prior.map(|kind| CocoPrior { file: format!("{}/priors/{stem}.npy", scene.name), kind }),
    });
    let mut n_occluded = 0;
    for instance in &instances {
        let occluded = 1.0 - instance.visible_share > OCCLUDED_FROM;
        n_occluded += usize::from(occluded);
        let [left, top, right, bottom] = instance.bounds;
        set.annotations.push(CocoInstance {
            id: set.annotations.len() + 1,
            image_id,
            category_id: 1,
            segmentation: run_lengths(&labels.ground, instance),
            bbox: [left, top, right - left, bottom - top],
            area: instance.area_px,
            iscrowd: 0,
            label: instance.label,
            building: source.world.buildings[usize::from(instance.label) - 1].id.0.clone(),
            visible_share: (instance.visible_share * 1e4).round() / 1e4,
            occluded,
            truncated: instance.is_cut,
        });
    }
    Ok(Some((instances.len(), n_occluded)))
}

fn write_labels(path: &Path, labels: &Raster<u16>) -> Result<(), TrainError> {
    let bytes: Vec<u8> = labels.data().iter().flat_map(|v| v.to_ne_bytes()).collect();
    write_png(path, &bytes, (labels.width() as u32, labels.height() as u32), ExtendedColorType::L16)
}

/// A PNG, whole or absent; 16-bit samples in the machine's order.
pub(crate) fn write_png(
    path: &Path,
    bytes: &[u8],
    (width, height): (u32, u32),
    colour: ExtendedColorType,
) -> Result<(), TrainError> {
    let mut png = Vec::new();
    image::codecs::png::PngEncoder::new(&mut png)
        .write_image(bytes, width, height, colour)
        .map_err(|e| TrainError::set(path, format!("it cannot be encoded: {e}"), "this is a fault of the program"))?;
    Ok(write_whole_unflushed(path, |w| w.write_all(&png))?)
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), TrainError> {
    Ok(sizeup_geo::files::write_whole(path, |w| Ok(serde_json::to_writer(w, value)?))?)
}

/// Every file below a folder, in the order of the names.
fn list(root: &Path, folder: &Path, files: &mut BTreeMap<String, FileEntry>) -> Result<(), TrainError> {
    let unreadable = |e: std::io::Error| TrainError::set(folder, e.to_string(), "may it be read?");
    for item in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = item.map_err(unreadable)?.path();
        if path.is_dir() {
            list(root, &path, files)?;
        } else {
            let name = path.strip_prefix(root).unwrap_or(&path).to_string_lossy().replace('\\', "/");
            files.insert(name, FileEntry::of(&path)?);
        }
    }
    Ok(())
}
