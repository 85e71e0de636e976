//! What a graph is, before anything is computed with it.

use std::path::Path;

use super::profile::{self, Profile, Wiring};
use crate::onnx::{Contents, EngineChoice, EngineConfig, Network, Port};
use crate::prior::PriorError;

/// Inputs and outputs of a graph, and which built-in profiles fit it.
#[derive(Debug)]
pub struct GraphInspection {
    /// Inputs of the graph, in its order.
    pub inputs: Vec<Port>,
    /// Outputs of the graph, in its order.
    pub outputs: Vec<Port>,
    /// The engine that runs it.
    pub engine: EngineChoice,
    /// Contents of its file.
    pub contents: Contents,
    /// Every built-in profile with its wiring, or why it does not fit.
    pub profiles: Vec<(Profile, Result<Wiring, String>)>,
}

/// Looks at a graph without running it.
///
/// # Errors
/// [`PriorError::Network`] if the engine cannot load it.
pub fn inspect(model: &Path, engine: &EngineConfig) -> Result<GraphInspection, PriorError> {
    let network = Network::open_with(model, engine)?;
    let (inputs, outputs) = (network.inputs().to_vec(), network.outputs().to_vec());
    let wired = profile::built_in().into_iter().map(|profile| {
        let wiring = profile.wire(&inputs, &outputs);
        (profile, wiring)
    });
    let profiles = wired.collect();
    Ok(GraphInspection { inputs, outputs, engine: network.engine(), contents: Contents::read(model)?, profiles })
}
