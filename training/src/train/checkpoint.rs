//! Checkpoints: parameters, the optimiser's state, and where the training was, in one safetensors file.
//!
//! ```text
//! now/NAME      parameters       best/NAME   those of the best look
//! first/NAME    first moments    second/NAME second moments         (absent in a network that is only to be used)
//! metadata "sizeup-train": configuration, step, best look, looks since
//! ```
//!
//! Random choices depend on the seed and the step alone, so that nothing else has to be kept. A file is written under another
//! name and renamed: a full disk or a kill leaves the one before whole.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use candle_core::{DType, Device, Tensor, Var};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::{Deserialize, Serialize};
use sizeup_geo::files;

use super::TrainConfig;
use super::optimise::Moments;
use crate::TrainError;
use crate::network::Input;
use crate::network::parameters::{Parameters, shapes};

/// Where the metadata stands.
const KEY: &str = "sizeup-train";
/// The form that this program writes and reads.
const FORMAT: u32 = 1;

/// Where a training is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Number of steps done.
    pub step: usize,
    /// The least loss on the scenes for validation so far.
    pub best_loss: Option<f64>,
    /// Step at which the loss was least.
    pub best_step: usize,
    /// Intersection over union of buildings at that step.
    pub best_iou: f64,
    /// Number of looks at the validation set since the best one.
    pub n_since: usize,
    /// Sum of the losses since the last line of the log, and how many.
    pub loss_sum: (f64, usize),
}

#[derive(Serialize, Deserialize)]
struct About {
    format: u32,
    config: TrainConfig,
    progress: Progress,
    /// SHA-256 of the set's manifest.
    set: String,
}

impl About {
    fn in_json(&self) -> String {
        serde_json::to_string(self).expect("plain data")
    }
}

/// All of a training.
#[derive(Debug)]
pub struct Checkpoint {
    /// Settings of the training.
    pub config: TrainConfig,
    /// Where the training stands.
    pub progress: Progress,
    /// SHA-256 of the manifest of its set.
    pub set: String,
    /// Parameters as they are now.
    pub parameters: Parameters,
    /// As of the best look.
    pub best: Parameters,
    /// The optimiser's; none in a network that is only to be used.
    pub moments: Option<Moments>,
}

impl Checkpoint {
    /// The same network, its best parameters blind to an input: what the input's first layer makes of it is nothing, as for an
    /// input of zeros.
    ///
    /// # Errors
    /// [`TrainError::Config`] for an input that it does not take, or that has no layer of its own.
    pub fn blind_to(mut self, input: Input) -> Result<Self, TrainError> {
        let name = match input {
            Input::Image => "texture.0.down.weight",
            Input::Depth => "geometry.0.down.weight",
            Input::Lean => "",
        };
        let Some(var) = self.best.vars.get(name) else {
            let problem = format!("the network has no layer for {:?} alone", input.name());
            return Err(TrainError::config(problem, "image or depth, of a network that takes it"));
        };
        let weights = var.as_tensor();
        let rest = weights.narrow(1, input.channels(), weights.dim(1)? - input.channels())?;
        let nothing = weights.narrow(1, 0, input.channels())?.zeros_like()?;
        let blind = Var::from_tensor(&Tensor::cat(&[nothing, rest], 1)?)?;
        self.best.vars.insert(name.to_owned(), blind);
        Ok(self)
    }

    /// Writes it, whole or not at all.
    ///
    /// # Errors
    /// [`TrainError::File`]: what was there before is still there.
    pub fn write(&self, path: &Path) -> Result<(), TrainError> {
        let mut tensors: Vec<(String, Tensor)> = Vec::new();
        let mut keep =
            |kind: &str, name: &str, tensor: &Tensor| tensors.push((format!("{kind}/{name}"), tensor.clone()));
        for (name, var) in &self.best.vars {
            keep("best", name, var.as_tensor());
        }
        if let Some(moments) = &self.moments {
            for (name, var) in &self.parameters.vars {
                keep("now", name, var.as_tensor());
            }
            for (name, (first, second)) in &moments.0 {
                keep("first", name, first);
                keep("second", name, second);
            }
        }
        let raw: Vec<(String, Vec<usize>, Vec<u8>)> = tensors
            .into_iter()
            .map(|(name, t)| {
                let values = t.flatten_all()?.to_dtype(DType::F32)?.to_vec1::<f32>()?;
                Ok((name, t.dims().to_vec(), values.iter().flat_map(|v| v.to_le_bytes()).collect()))
            })
            .collect::<Result<_, TrainError>>()?;
        let fault = |e: safetensors::SafeTensorError| {
            refuse(path, format!("it cannot be put together: {e}"), "this is a fault of the program")
        };
        let views = raw.iter().map(|(name, shape, bytes)| {
            Ok((name.clone(), TensorView::new(Dtype::F32, shape.clone(), bytes).map_err(fault)?))
        });
        let views: Vec<(String, TensorView<'_>)> = views.collect::<Result<_, TrainError>>()?;
        let about = About {
            format: FORMAT,
            config: self.config.clone(),
            progress: self.progress.clone(),
            set: self.set.clone(),
        };
        let text = about.in_json();
        let bytes = safetensors::serialize(views, Some(HashMap::from([(KEY.to_owned(), text)]))).map_err(fault)?;
        Ok(files::write_whole(path, |w| w.write_all(&bytes))?)
    }

    /// Reads one.
    ///
    /// # Errors
    /// [`TrainError::Checkpoint`] for a file that is none, is damaged, or whose tensors are not those of its network.
    pub fn read(path: &Path, device: &Device) -> Result<Self, TrainError> {
        let bytes = files::read_bytes(path)?;
        let damaged = |e: String| {
            refuse(path, format!("it cannot be read: {e}"), "is it a checkpoint of sizeup-train, and whole?")
        };
        let (_, head) = SafeTensors::read_metadata(&bytes).map_err(|e| damaged(e.to_string()))?;
        let text = head.metadata().as_ref().and_then(|m| m.get(KEY)).ok_or_else(|| {
            refuse(
                path,
                format!("it holds no {KEY:?} in its metadata"),
                "other programs' weights have to be brought into this form",
            )
        })?;
        let about: About = serde_json::from_str(text).map_err(|e| damaged(e.to_string()))?;
        if about.format != FORMAT {
            let problem = format!("expected form {FORMAT}, found {}", about.format);
            return Err(refuse(path, problem, "train anew, or use the program that wrote it"));
        }
        let file = SafeTensors::deserialize(&bytes).map_err(|e| damaged(e.to_string()))?;
        let group = |kind: &str| -> Result<Option<BTreeMap<String, Tensor>>, TrainError> {
            let mut found = BTreeMap::new();
            for (name, shape) in shapes(&about.config.network)? {
                match file.tensor(&format!("{kind}/{name}")) {
                    Ok(view) => found.insert(name.clone(), tensor(path, &name, &view, &shape, device)?),
                    Err(_) if found.is_empty() => return Ok(None),
                    Err(_) => {
                        return Err(refuse(
                            path,
                            format!("it lacks {kind}/{name}"),
                            "it is of another head: train anew",
                        ));
                    }
                };
            }
            Ok(Some(found))
        };
        let vars = |tensors: BTreeMap<String, Tensor>| -> Result<Parameters, TrainError> {
            let vars = tensors.into_iter().map(|(name, t)| Ok((name, Var::from_tensor(&t)?)));
            Ok(Parameters { vars: vars.collect::<Result<_, TrainError>>()? })
        };
        let best = group("best")?.ok_or_else(|| {
            refuse(path, "it lacks the network's parameters".to_owned(), "it is of another head: train anew")
        })?;
        let moments = match (group("first")?, group("second")?) {
            (Some(first), Some(second)) => {
                // Both have the network's names, in one order.
                let both = first.into_iter().zip(second.into_values()).map(|((name, f), s)| (name, (f, s)));
                Some(Moments(both.collect()))
            }
            _ => None,
        };
        let now = match group("now")? {
            Some(now) => vars(now)?,
            None => vars(best.clone())?,
        };
        Ok(Self {
            config: about.config,
            progress: about.progress,
            set: about.set,
            parameters: now,
            best: vars(best)?,
            moments,
        })
    }

    /// Goes on with a training only under the configuration and the set that it began with; where it ends may change.
    ///
    /// # Errors
    /// [`TrainError::Checkpoint`] naming what differs.
    pub fn check(&self, path: &Path, config: &TrainConfig, set: &str) -> Result<(), TrainError> {
        let anew = "choose another output folder to train anew, or go back to the configuration it began with";
        if self.config.network != config.network {
            let (own, wanted) = (self.config.network.in_json(), config.network.in_json());
            let problem = format!("it is of another head: expected {wanted}, found {own}");
            return Err(refuse(path, problem, anew));
        }
        if self.config != *config {
            let problem =
                "it was made with other settings (seed, crops, steps, loss, augmentation or looks)".to_owned();
            return Err(refuse(path, problem, anew));
        }
        if self.set != set {
            return Err(refuse(path, "it learned from another set".to_owned(), anew));
        }
        if self.moments.is_none() {
            let problem = "it has no optimiser's state: it is a network to be used".to_owned();
            return Err(refuse(path, problem, "go on from `last.safetensors`"));
        }
        Ok(())
    }
}

fn tensor(
    path: &Path,
    name: &str,
    view: &TensorView<'_>,
    shape: &[usize],
    device: &Device,
) -> Result<Tensor, TrainError> {
    if view.shape() != shape || view.dtype() != Dtype::F32 {
        let problem = format!("{name}: expected {shape:?} of F32, found {:?} of {:?}", view.shape(), view.dtype());
        return Err(refuse(path, problem, "it is of another head: train anew"));
    }
    let values: Vec<f32> = view.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    Ok(Tensor::from_vec(values, shape, device)?)
}

fn refuse(path: &Path, problem: String, hint: &str) -> TrainError {
    TrainError::Checkpoint { path: path.to_owned(), problem, hint: hint.to_owned() }
}
