//! A trained network as a file that `sizeup footprints` runs.

use std::path::Path;

use sizeup_geo::files;

use crate::TrainError;
use crate::network::onnx;
use crate::train::checkpoint::Checkpoint;
use crate::train::features;

/// Writes the best parameters of a checkpoint as ONNX, for tiles of `tile × tile` pixels.
///
/// # Errors
/// [`TrainError`] for a tile that the network cannot take, a head over features, and a file that cannot be written.
pub fn write(checkpoint: &Checkpoint, tile: usize, path: &Path) -> Result<(), TrainError> {
    let bytes = bytes(checkpoint, tile)?;
    Ok(files::write_whole(path, |w| w.write_all(&bytes))?)
}

/// The same, as bytes.
///
/// # Errors
/// As [`write`].
pub fn bytes(checkpoint: &Checkpoint, tile: usize) -> Result<Vec<u8>, TrainError> {
    let config = &checkpoint.config.network;
    let multiple = config.multiple();
    if !config.features.is_empty() {
        let problem = "this head takes features, whose sizes are those of its backbones";
        return Err(TrainError::config(
            problem,
            "`--like FOLDER/SCENE/PHOTO.safetensors`: a file that it learned from",
        ));
    }
    if tile == 0 || !tile.is_multiple_of(multiple) {
        let problem = format!("a tile of {tile} pixels: expected a multiple of {multiple}");
        return Err(TrainError::config(problem, "each level of the network halves the grid"));
    }
    let given: Vec<(String, [usize; 3])> =
        config.inputs.iter().map(|i| (i.name().to_owned(), [i.channels(), tile, tile])).collect();
    Ok(onnx::write(config, &checkpoint.best, &given, (tile, tile), &about(checkpoint))?)
}

/// Writes a head over features as ONNX, for maps as `like`, a photo's file of features, has of one tile; `side` is that of the masks.
///
/// # Errors
/// [`TrainError`] for a network that takes no features, a file that is not what it takes, and one that cannot be written.
pub fn write_head(checkpoint: &Checkpoint, like: &Path, side: usize, path: &Path) -> Result<(), TrainError> {
    let wanted = &checkpoint.config.network.features;
    if wanted.is_empty() {
        let problem = "this network takes photos, no features";
        return Err(TrainError::config(problem, "leave `--like` out; `--tile` says how large its tiles are"));
    }
    if side == 0 {
        return Err(TrainError::config("masks of 0 pixels", "`--tile` is the side of the masks"));
    }
    let bytes = head_bytes(checkpoint, &features::sizes_of_a_tile(like, wanted)?, side)?;
    Ok(files::write_whole(path, |w| w.write_all(&bytes))?)
}

/// A head over features of frozen backbones, as sizeup's profile `fpsam.v1` runs it: `sizes` are the rows and columns of each
/// feature map, `side` those of the masks.
///
/// # Errors
/// As [`write`].
pub fn head_bytes(checkpoint: &Checkpoint, sizes: &[(usize, usize)], side: usize) -> Result<Vec<u8>, TrainError> {
    let config = &checkpoint.config.network;
    if sizes.len() != config.features.len() {
        let problem = format!("{} sizes for {} features", sizes.len(), config.features.len());
        return Err(TrainError::config(problem, "rows and columns of each feature, in the configuration's order"));
    }
    let given: Vec<(String, [usize; 3])> = config
        .features
        .iter()
        .zip(sizes)
        .map(|(f, (rows, columns))| (f.name.clone(), [f.channels, *rows, *columns]))
        .collect();
    Ok(onnx::write(config, &checkpoint.best, &given, (side, side), &about(checkpoint))?)
}

fn about(checkpoint: &Checkpoint) -> [(&'static str, String); 4] {
    [
        ("profile", if checkpoint.config.network.features.is_empty() { "small.v1" } else { "fpsam.v1" }.to_owned()),
        ("set", checkpoint.set.clone()),
        ("seed", checkpoint.config.seed.to_string()),
        ("step", checkpoint.progress.best_step.to_string()),
    ]
}
