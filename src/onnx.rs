//! Running ONNX graphs: the only door to an inference engine.
//!
//! The embedded engine is `rten`, in pure Rust: nothing to install, and graphs it cannot run are refused when they are
//! opened. It computes `Resize` with cubic interpolation as linear without a word, so such graphs are refused here.

use std::path::{Path, PathBuf};

use rten_tensor::prelude::*;

/// Why a graph cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OnnxError {
    /// It cannot be read, or uses something the engine does not know.
    #[error("cannot load the network {}: {reason}\nhint: is it an ONNX file with all its external data beside it?", path.display())]
    Load {
        /// The file.
        path: PathBuf,
        /// The engine's own words.
        reason: String,
    },
    /// It holds an operation that the engine would compute wrongly.
    #[error(
        "the network {} resizes with cubic interpolation, which the embedded engine computes as linear\n\
         hint: export it with linear interpolation, or with fixed input sizes so that the exporter folds it away",
        path.display()
    )]
    CubicResize {
        /// The file.
        path: PathBuf,
    },
    /// It has no input or output of that name.
    #[error("the network {} has no {what} {name:?}, but {}", path.display(), present.join(", "))]
    NoPort {
        /// The file.
        path: PathBuf,
        /// "input" or "output".
        what: &'static str,
        /// What was asked for.
        name: String,
        /// What there is.
        present: Vec<String>,
    },
    /// It stopped while running.
    #[error("the network {} failed: {reason}", path.display())]
    Run {
        /// The file.
        path: PathBuf,
        /// The engine's own words.
        reason: String,
    },
}

/// Numbers in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Length of each dimension.
    pub shape: Vec<usize>,
    /// Their product of values.
    pub values: Vec<f32>,
}

/// An input or output of a graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Port {
    /// Its name in the graph.
    pub name: String,
    /// Its dimensions, `None` where they are free; empty where the graph does not say.
    pub shape: Vec<Option<usize>>,
}

/// A loaded graph.
pub struct Network {
    model: rten::Model,
    path: PathBuf,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
}

impl std::fmt::Debug for Network {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { path, inputs, outputs, model: _ } = self;
        f.debug_struct("Network").field("path", path).field("inputs", inputs).field("outputs", outputs).finish()
    }
}

impl Network {
    /// Loads a graph.
    ///
    /// # Errors
    /// [`OnnxError::Load`] or [`OnnxError::CubicResize`].
    pub fn open(path: &Path) -> Result<Self, OnnxError> {
        let failed = |reason: String| OnnxError::Load { path: path.to_owned(), reason };
        let bytes = std::fs::read(path).map_err(|e| failed(e.to_string()))?;
        if has_cubic_resize(&bytes) {
            return Err(OnnxError::CubicResize { path: path.to_owned() });
        }
        drop(bytes);
        let model = rten::Model::load_file(path).map_err(|e| failed(e.to_string()))?;
        let ports = |ids: &[rten::NodeId]| ids.iter().filter_map(|id| port(&model, *id)).collect::<Vec<_>>();
        let (inputs, outputs) = (ports(model.input_ids()), ports(model.output_ids()));
        Ok(Self { model, path: path.to_owned(), inputs, outputs })
    }

    /// What it wants.
    #[must_use]
    pub fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    /// What it gives.
    #[must_use]
    pub fn outputs(&self) -> &[Port] {
        &self.outputs
    }

    /// Runs it on one input and reads one output.
    ///
    /// # Errors
    /// [`OnnxError::NoPort`] or [`OnnxError::Run`].
    pub fn run(&self, input: (&str, &Tensor), output: &str) -> Result<Tensor, OnnxError> {
        let mut results = self.run_many(&[input], &[output])?;
        Ok(results.remove(0))
    }

    /// Runs it on several inputs and reads several outputs, in the order asked for.
    ///
    /// # Errors
    /// [`OnnxError::NoPort`] or [`OnnxError::Run`].
    pub fn run_many(&self, inputs: &[(&str, &Tensor)], outputs: &[&str]) -> Result<Vec<Tensor>, OnnxError> {
        let failed = |reason: String| OnnxError::Run { path: self.path.clone(), reason };
        let mut given = Vec::with_capacity(inputs.len());
        for (name, tensor) in inputs {
            let n_values: usize = tensor.shape.iter().product();
            if n_values != tensor.values.len() {
                return Err(failed(format!("{} values for shape {:?}", tensor.values.len(), tensor.shape)));
            }
            let values = rten_tensor::Tensor::from_data(&tensor.shape, tensor.values.clone());
            given.push((self.id("input", name, &self.inputs)?, values.into()));
        }
        let wanted: Vec<rten::NodeId> =
            outputs.iter().map(|name| self.id("output", name, &self.outputs)).collect::<Result<_, _>>()?;
        let results = self.model.run(given, &wanted, None).map_err(|e| failed(e.to_string()))?;
        let tensors = results.into_iter().zip(outputs).map(|(result, output)| {
            let result = result.into_tensor::<f32>();
            let result = result.ok_or_else(|| failed(format!("output {output:?} is no tensor of 32-bit floats")))?;
            Ok(Tensor { shape: result.shape().to_vec(), values: result.to_vec() })
        });
        tensors.collect()
    }

    fn id(&self, what: &'static str, name: &str, ports: &[Port]) -> Result<rten::NodeId, OnnxError> {
        let is_known = ports.iter().any(|port| port.name == name);
        self.model.find_node(name).filter(|_| is_known).ok_or_else(|| OnnxError::NoPort {
            path: self.path.clone(),
            what,
            name: name.to_owned(),
            present: ports.iter().map(|port| port.name.clone()).collect(),
        })
    }
}

fn port(model: &rten::Model, id: rten::NodeId) -> Option<Port> {
    let info = model.node_info(id)?;
    let dimension = |d: rten::Dimension| match d {
        rten::Dimension::Fixed(n) => Some(n),
        rten::Dimension::Symbolic(_) => None,
    };
    let shape = info.shape().unwrap_or_default().into_iter().map(dimension).collect();
    Some(Port { name: info.name()?.to_owned(), shape })
}

/// Looks for the attribute `mode = "cubic"` as protobuf stores it: field 1 (name), …, field 4 (string value).
fn has_cubic_resize(bytes: &[u8]) -> bool {
    bytes.windows(7).any(|window| window == b"\x22\x05cubic")
}
