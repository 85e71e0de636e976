//! A trained network as a file that `sizeup footprints` runs.

use std::path::Path;

use sizeup_geo::files;

use crate::TrainError;
use crate::network::onnx;
use crate::train::checkpoint::Checkpoint;

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
        return Err(TrainError::config(problem, "`head_bytes` takes their rows and columns"));
    }
    if tile == 0 || !tile.is_multiple_of(multiple) {
        let problem = format!("a tile of {tile} pixels: expected a multiple of {multiple}");
        return Err(TrainError::config(problem, "each level of the network halves the grid"));
    }
    let given: Vec<(String, [usize; 3])> =
        config.inputs.iter().map(|i| (i.name().to_owned(), [i.channels(), tile, tile])).collect();
    Ok(onnx::write(config, &checkpoint.best, &given, (tile, tile), &about(checkpoint))?)
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
