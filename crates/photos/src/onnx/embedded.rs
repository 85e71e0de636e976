//! The engine that is part of the program: rten.

use std::path::Path;
use std::sync::Arc;

use rten_tensor::prelude::*;

use super::{Contents, OnnxError, Port, Tensor, TensorContent};

/// A graph in rten.
pub(super) struct EmbeddedGraph {
    model: rten::Model,
    /// Threads that it computes on, if not on all cores.
    threads: Option<Arc<rten::ThreadPool>>,
}

impl std::fmt::Debug for EmbeddedGraph {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Graph").finish_non_exhaustive()
    }
}

impl EmbeddedGraph {
    pub(super) fn open(path: &Path, contents: &Contents) -> Result<Self, OnnxError> {
        if contents.has_cubic_resize {
            return Err(OnnxError::CubicResize { path: path.to_owned() });
        }
        let model = rten::Model::load_file(path).map_err(|e| OnnxError::Load {
            path: path.to_owned(),
            reason: e.to_string(),
            hint: format!("is all its external data beside it? If it is sound, {}", super::RUNTIME_HINT),
        })?;
        let pool = |n_threads| Arc::new(rten::ThreadPool::with_num_threads(n_threads));
        Ok(Self { model, threads: super::n_threads().map(pool) })
    }

    pub(super) fn of_bytes(path: &Path, bytes: &'static [u8]) -> Result<Self, OnnxError> {
        let model = rten::Model::load_static_slice(bytes).map_err(|e| OnnxError::Load {
            path: path.to_owned(),
            reason: e.to_string(),
            hint: "the program is damaged: install it anew".to_owned(),
        })?;
        Ok(Self { model, threads: None })
    }

    /// Inputs and outputs of the graph, in its order.
    pub(super) fn ports(&self) -> (Vec<Port>, Vec<Port>) {
        let ports = |ids: &[rten::NodeId]| ids.iter().filter_map(|id| self.port(*id)).collect::<Vec<_>>();
        (ports(self.model.input_ids()), ports(self.model.output_ids()))
    }

    fn port(&self, id: rten::NodeId) -> Option<Port> {
        let info = self.model.node_info(id)?;
        let dimension = |d: rten::Dimension| match d {
            rten::Dimension::Fixed(n) => Some(n),
            rten::Dimension::Symbolic(_) => None,
        };
        let numbers = match info.dtype() {
            None | Some(rten::ValueType::Tensor(rten::DataType::Float)) => TensorContent::Floats,
            Some(rten::ValueType::Tensor(rten::DataType::Int32)) => TensorContent::Integers,
            Some(_) => TensorContent::Other,
        };
        let shape = info.shape().unwrap_or_default().into_iter().map(dimension).collect();
        Some(Port { name: info.name()?.to_owned(), shape, numbers })
    }

    pub(super) fn run(&self, inputs: &[(&Port, &Tensor)], outputs: &[&str]) -> Result<Vec<Tensor>, String> {
        let mut given = Vec::with_capacity(inputs.len());
        for (port, tensor) in inputs {
            let id = self.model.node_id(&port.name).map_err(|e| e.to_string())?;
            let value: rten::ValueOrView = match port.numbers {
                TensorContent::Floats => rten_tensor::Tensor::from_data(&tensor.shape, tensor.values.clone()).into(),
                TensorContent::Integers => {
                    let whole: Vec<i32> = tensor.values.iter().map(|v| v.round() as i32).collect();
                    rten_tensor::Tensor::from_data(&tensor.shape, whole).into()
                }
                TensorContent::Other => return Err(format!("input {:?} takes no numbers", port.name)),
            };
            given.push((id, value));
        }
        let wanted = outputs.iter().map(|name| self.model.node_id(name).map_err(|e| e.to_string()));
        let wanted = wanted.collect::<Result<Vec<_>, _>>()?;
        let options = rten::RunOptions::default().with_thread_pool(self.threads.clone());
        let results = self.model.run(given, &wanted, Some(options)).map_err(|e| e.to_string())?;
        results.into_iter().zip(outputs).map(|(result, name)| tensor_of(result, name)).collect()
    }
}

fn tensor_of(value: rten::Value, name: &str) -> Result<Tensor, String> {
    if let rten::Value::Int32Tensor(whole) = &value {
        let values = whole.iter().map(|v| *v as f32).collect();
        return Ok(Tensor { shape: whole.shape().to_vec(), values });
    }
    let floats = value.into_tensor::<f32>().ok_or_else(|| format!("output {name:?} is no tensor of numbers"))?;
    Ok(Tensor { shape: floats.shape().to_vec(), values: floats.to_vec() })
}
