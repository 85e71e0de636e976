//! ONNX Runtime as the second choice: for what the embedded engine loads and then cannot run.
//!
//! Operators and shapes are what an engine cannot run. So the first failure hands over all inputs of these shapes, and
//! no others: which engine computes a view does not depend on what was computed before it.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{EngineConfig, Port, Tensor, runtime};

/// Shapes of all inputs, in the order they are given.
type Shapes = Vec<Vec<usize>>;

/// A graph that ONNX Runtime loads when it is wanted.
#[derive(Debug)]
pub(super) struct SecondChoice {
    path: PathBuf,
    config: EngineConfig,
    state: Mutex<SecondState>,
}

#[derive(Debug, Default)]
struct SecondState {
    graph: Option<Arc<runtime::RuntimeGraph>>,
    /// Shapes that the embedded engine could not run, and ONNX Runtime could.
    taken_over: HashSet<Shapes>,
}

fn shapes(inputs: &[(&Port, &Tensor)]) -> Shapes {
    inputs.iter().map(|(_, tensor)| tensor.shape.clone()).collect()
}

impl SecondChoice {
    pub(super) fn new(path: &Path, config: &EngineConfig) -> Self {
        Self { path: path.to_owned(), config: config.clone(), state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, SecondState> {
        // Its parts are whole or absent, so a panic elsewhere leaves nothing half-done here.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The graph, where inputs of these shapes were handed over before.
    pub(super) fn graph_for(&self, inputs: &[(&Port, &Tensor)]) -> Option<Arc<runtime::RuntimeGraph>> {
        let state = self.state();
        state.graph.clone().filter(|_| state.taken_over.contains(&shapes(inputs)))
    }

    /// Runs what the embedded engine could not, for the `reason` it gave.
    pub(super) fn take_over(
        &self,
        inputs: &[(&Port, &Tensor)],
        outputs: &[&str],
        reason: &str,
    ) -> Result<Vec<Tensor>, String> {
        let both = |other: &str| format!("the embedded engine: {reason}; ONNX Runtime: {other}");
        let graph = self.open().map_err(|other| both(&other))?;
        let results = graph.run(inputs, outputs).map_err(|other| both(&other))?;
        if self.state().taken_over.insert(shapes(inputs)) {
            tracing::warn!(
                "the embedded engine cannot run {} ({reason}); ONNX Runtime runs it from here on",
                self.path.display()
            );
        }
        Ok(results)
    }

    fn open(&self) -> Result<Arc<runtime::RuntimeGraph>, String> {
        let mut state = self.state();
        if let Some(graph) = &state.graph {
            return Ok(Arc::clone(graph));
        }
        let graph = Arc::new(runtime::RuntimeGraph::open(&self.path, &self.config).map_err(|e| e.reason())?);
        state.graph = Some(Arc::clone(&graph));
        Ok(graph)
    }
}
