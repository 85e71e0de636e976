//! Networks that a training begins with in the place of a draw.

use std::collections::BTreeMap;
use std::path::Path;

use candle_core::{Device, Tensor, Var};
use sizeup_geo::files;

use super::checkpoint::Checkpoint;
use crate::TrainError;
use crate::network::parameters::{Parameters, shapes};
use crate::network::{NetworkConfig, onnx};

/// Parameters of a checkpoint, the best ones, or of an ONNX file that this program wrote.
///
/// # Errors
/// [`TrainError::Checkpoint`] for a file that is neither, or whose layers are not those of `config`.
pub fn parameters(path: &Path, config: &NetworkConfig, device: &Device) -> Result<Parameters, TrainError> {
    if path.extension().is_some_and(|e| e == "safetensors") {
        let state = Checkpoint::read(path, device)?;
        if state.config.network != *config {
            let (own, wanted) = (state.config.network.in_json(), config.in_json());
            let problem = format!("its layers are {own}, those to train {wanted}");
            return Err(refuse(path, problem));
        }
        return Ok(state.best);
    }
    let bytes = files::read_bytes(path)?;
    let mut found = onnx::read(&bytes).map_err(|reason| {
        refuse(path, format!("it is neither a checkpoint nor an ONNX file of sizeup-train: {reason}"))
    })?;
    let mut vars = BTreeMap::new();
    for (name, shape) in shapes(config)? {
        let Some(values) = found.remove(&name) else {
            return Err(refuse(path, format!("it lacks {name}")));
        };
        if values.len() != shape.iter().product::<usize>() {
            let problem = format!("{name}: expected {shape:?}, found {} numbers", values.len());
            return Err(refuse(path, problem));
        }
        vars.insert(name, Var::from_tensor(&Tensor::from_vec(values, shape, device)?)?);
    }
    if let Some(more) = found.keys().next() {
        return Err(refuse(path, format!("it has {more}, which the network to train has not")));
    }
    Ok(Parameters { vars })
}

fn refuse(path: &Path, problem: String) -> TrainError {
    let hint = "`start` is a network of the same `network` settings; leave it out to begin from the seed".to_owned();
    TrainError::Checkpoint { path: path.to_owned(), problem, hint }
}
