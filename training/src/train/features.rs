//! Features of frozen networks, computed once and kept: `FOLDER/SCENE/PHOTO.safetensors`, a tensor per feature map.
//!
//! A map is of the whole photo, brought to a square or not: positions are shares of the photo's width and height, so maps of
//! any stride go together. Labels are brought to `crop_px` rows and columns the same way. There is no augmentation: a
//! feature of a turned photo is not the turned feature.

use std::path::{Path, PathBuf};

use candle_core::{DType, Device, Tensor};
use rand::Rng as _;
use safetensors::SafeTensors;
use safetensors::tensor::Dtype;
use sizeup_geo::files;
use sizeup_heights::seed;

use super::TrainConfig;
use super::sample::{Batch, Scene, wanted};
use crate::TrainError;
use crate::network::{FeatureConfig, N_LOGITS};

/// Hint where a file is missing.
const COMPUTED_BY: &str = "tools/export_footprint_features.py computes the features of a set's photos";

/// The file of a photo's features.
#[must_use]
pub fn path_of(folder: &Path, scene: &Scene) -> PathBuf {
    let image = &scene.photo.image;
    let stem = Path::new(&image.file_name).file_stem().unwrap_or_default();
    folder.join(&image.scene).join(stem).with_extension("safetensors")
}

/// Reads a photo's feature maps, `1 × channels × rows × columns` each.
///
/// # Errors
/// [`TrainError::Set`] for a file that is missing or damaged, and for a map of another shape.
pub fn read(path: &Path, wanted: &[FeatureConfig], device: &Device) -> Result<Vec<(String, Tensor)>, TrainError> {
    let again = "compute the features anew; `network.features` lists their names and channels";
    if !path.exists() {
        return Err(TrainError::set(path, "there are no features of this photo", COMPUTED_BY));
    }
    let bytes = files::read_bytes(path)?;
    let file = SafeTensors::deserialize(&bytes)
        .map_err(|e| TrainError::set(path, format!("it cannot be read as features: {e}"), again))?;
    let mut maps = Vec::new();
    for feature in wanted {
        let view = file.tensor(&feature.name).map_err(|_| {
            let names = file.names().join(", ");
            TrainError::set(path, format!("expected a feature {:?}, found {names}", feature.name), again)
        })?;
        let (channels, rows, columns) = match *view.shape() {
            [channels, rows, columns] | [1, channels, rows, columns] => (channels, rows, columns),
            _ => (0, 0, 0),
        };
        let is_known = matches!(view.dtype(), Dtype::F32 | Dtype::F16);
        if channels != feature.channels || rows * columns == 0 || !is_known {
            let problem = format!(
                "{}: expected {} × rows × columns of F32 or F16, found {:?} of {:?}",
                feature.name,
                feature.channels,
                view.shape(),
                view.dtype()
            );
            return Err(TrainError::set(path, problem, again));
        }
        let kind = if view.dtype() == Dtype::F16 { DType::F16 } else { DType::F32 };
        let map = Tensor::from_raw_buffer(view.data(), kind, &[1, channels, rows, columns], device)?;
        maps.push((feature.name.clone(), map.to_dtype(DType::F32)?));
    }
    Ok(maps)
}

/// Whether there are features of all photos, so that a training does not stop at the first without.
///
/// # Errors
/// [`TrainError::Set`] with the first file that is missing, and with how many are.
pub fn check(photos: &[&Scene], config: &TrainConfig) -> Result<(), TrainError> {
    let Some(folder) = &config.features else { return Ok(()) };
    let paths = photos.iter().map(|photo| path_of(folder, photo));
    let missing: Vec<PathBuf> = paths.filter(|path| !path.exists()).collect();
    match &missing[..] {
        [] => Ok(()),
        [first, ..] => {
            let problem = format!("{} of {} photos have no features, this one among them", missing.len(), photos.len());
            Err(TrainError::set(first, problem, COMPUTED_BY))
        }
    }
}

/// Rows and columns of each map of one tile, the maps in the order of `wanted`: as the file's metadata have them under
/// `tile.NAME` ("288x288"), else those of the maps, which then are of one tile.
///
/// # Errors
/// As [`read`], and metadata that cannot be understood.
pub fn sizes_of_a_tile(path: &Path, wanted: &[FeatureConfig]) -> Result<Vec<(usize, usize)>, TrainError> {
    let maps = read(path, wanted, &Device::Cpu)?;
    let bytes = files::read_bytes(path)?;
    let stated = SafeTensors::read_metadata(&bytes).ok().and_then(|(_, about)| about.metadata().clone());
    let size_of = |(name, map): &(String, Tensor)| {
        let Some(text) = stated.as_ref().and_then(|stated| stated.get(&format!("tile.{name}"))) else {
            let (_, _, rows, columns) = map.dims4()?;
            return Ok((rows, columns));
        };
        let size = text.split_once('x').and_then(|(rows, columns)| Some((rows.parse().ok()?, columns.parse().ok()?)));
        size.filter(|(rows, columns): &(usize, usize)| rows * columns > 0).ok_or_else(|| {
            let problem = format!("its metadata say of {name} that a tile has {text:?} cells");
            TrainError::set(path, problem, "rows and columns, as in \"288x288\"")
        })
    };
    maps.iter().map(size_of).collect()
}

/// Whole photos with their features.
///
/// # Errors
/// As [`read`]; photos of a batch whose maps differ in size.
pub fn batch(scenes: &[&Scene], config: &TrainConfig, device: &Device) -> Result<Batch, TrainError> {
    let Some(folder) = &config.features else {
        return Err(TrainError::config("`features` is not set", "the folder of the feature files"));
    };
    let mut by_name: Vec<(String, Vec<Tensor>)> = Vec::new();
    let (mut targets, mut weights) = (Vec::new(), Vec::new());
    for scene in scenes {
        for (i, (name, map)) in read(&path_of(folder, scene), &config.network.features, device)?.into_iter().enumerate()
        {
            match by_name.get_mut(i) {
                Some((_, maps)) => maps.push(map),
                None => by_name.push((name, vec![map])),
            }
        }
        let (target, weight) = labels(scene, config);
        targets.extend(target);
        weights.extend(weight);
    }
    let (n, side) = (scenes.len(), config.crop_px);
    let inputs = by_name.into_iter().map(|(name, maps)| Ok((name, Tensor::cat(&maps, 0)?)));
    Ok(Batch {
        inputs: inputs.collect::<Result<_, TrainError>>()?,
        target: Tensor::from_vec(targets, (n, N_LOGITS, side, side), device)?,
        weight: Tensor::from_vec(weights, (n, N_LOGITS, side, side), device)?,
    })
}

/// A photo's labels at as many cells as the features' masks have, and how much each counts.
fn labels(scene: &Scene, config: &TrainConfig) -> (Vec<f32>, Vec<f32>) {
    let side = config.crop_px;
    let (columns, rows) = scene.photo.size;
    let cell = |i: usize| {
        let at = |k: usize, n: usize| ((k as f64 + 0.5) / side as f64 * n as f64) as usize;
        at(i / side, rows) * columns + at(i % side, columns)
    };
    let cells: Vec<usize> = (0..side * side).map(cell).collect();
    let wanted: Vec<_> = cells.iter().map(|c| wanted(scene, Some(*c), &config.loss)).collect();
    let of = |which: fn(&(f32, f32)) -> f32| -> Vec<f32> {
        (0..N_LOGITS).flat_map(|channel| wanted.iter().map(move |w| which(&w[channel]))).collect()
    };
    (of(|w| w.0), of(|w| w.1))
}

/// The photos of one step.
///
/// # Errors
/// As [`batch`].
pub fn of_step(scenes: &[Scene], config: &TrainConfig, step: usize, device: &Device) -> Result<Batch, TrainError> {
    let chosen: Vec<&Scene> = (0..config.batch)
        .map(|i| {
            let mut rng = seed::stream(config.seed, "crop", &[step as u64, i as u64]);
            &scenes[rng.random_range(0..scenes.len())]
        })
        .collect();
    batch(&chosen, config, device)
}
