//! Running ONNX graphs: the only door to inference engines.
//!
//! * `rten`, in pure Rust and part of the program: nothing to install. It computes `Resize` with cubic interpolation as
//!   linear without a word, so it is not given such graphs.
//! * ONNX Runtime, a shared library that is looked for when it is wanted ([`runtime`]): every operator, faster, and other
//!   processors than the CPU.
//!
//! Left to choose, the first one takes every graph that it can load, and the other one the rest: what the first one
//! cannot load, and what it loads and then cannot run ([`second`]).

mod embedded;
mod proto;
pub mod runtime;
mod second;

use std::collections::BTreeMap;
use std::num::NonZero;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use sizeup_geo::paths::PathVisitor;

pub use proto::Contents;

use self::second::SecondChoice;

/// Why a graph cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OnnxError {
    /// It cannot be read, or uses something the engine does not know.
    #[error("cannot load the network {}: {reason}\nhint: {hint}", path.display())]
    Load {
        /// Path of the graph's file.
        path: PathBuf,
        /// The engine's own words.
        reason: String,
        /// Advice to the user: what to change or to look at.
        hint: String,
    },
    /// It holds an operation that the engine would compute wrongly.
    #[error(
        "the network {} resizes with cubic interpolation, which the embedded engine computes as linear\n\
         hint: {RUNTIME_HINT}; or export it with linear interpolation",
        path.display()
    )]
    CubicResize {
        /// Path of the graph's file.
        path: PathBuf,
    },
    /// ONNX Runtime is wanted and not there.
    #[error("ONNX Runtime cannot be used: {reason}\nhint: {RUNTIME_HINT}")]
    NoRuntime {
        /// Where the library was looked for, and what came of it.
        reason: String,
    },
    /// It has no input or output of that name.
    #[error("the network {} has no {what} {name:?}, but {}", path.display(), present.join(", "))]
    NoPort {
        /// Path of the graph's file.
        path: PathBuf,
        /// Kind of the port: `input` or `output`.
        what: &'static str,
        /// Name that was asked for.
        name: String,
        /// Names that the graph has.
        present: Vec<String>,
    },
    /// It stopped while running.
    #[error(
        "the network {} failed: {reason}\n\
         hint: a graph that was traced with one size of photo may take no other, whatever it declares: export it with that size \
         fixed; what the embedded engine cannot run, ONNX Runtime may: {RUNTIME_HINT}",
        path.display()
    )]
    Run {
        /// Path of the graph's file.
        path: PathBuf,
        /// The engine's own words.
        reason: String,
    },
}

impl OnnxError {
    /// Problem, without the file and the hint.
    fn reason(&self) -> String {
        match self {
            Self::Load { reason, .. } | Self::NoRuntime { reason } | Self::Run { reason, .. } => reason.clone(),
            Self::CubicResize { .. } => "the embedded engine computes its cubic interpolation as linear".to_owned(),
            Self::NoPort { .. } => self.to_string(),
        }
    }

    /// Problem, and what to try.
    #[must_use]
    pub fn problem_and_hint(&self) -> (String, String) {
        let text = self.to_string();
        let (problem, hint) = text.split_once("\nhint: ").unwrap_or((&text, ""));
        (problem.to_owned(), hint.to_owned())
    }

    /// Answers of both engines on one graph.
    fn and(&self, mut second: Self) -> Self {
        if let Self::Load { reason, .. } = &mut second {
            *reason = format!("the embedded engine: {}; ONNX Runtime: {reason}", self.reason());
        }
        second
    }
}

/// Way to come by ONNX Runtime.
const RUNTIME_HINT: &str = "`make deps-onnxruntime` fetches ONNX Runtime into target/onnxruntime (the Python package \
                            `onnxruntime` holds the same library); name another place in `engine.library` or ORT_DYLIB_PATH";

/// Choice of the engine that runs networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum EngineChoice {
    /// The embedded engine where it can run the graph, else ONNX Runtime where it is found; the log says so.
    #[default]
    Auto,
    /// The embedded engine, which needs nothing installed.
    Rten,
    /// ONNX Runtime's library, where it is installed.
    OnnxRuntime,
}

/// A processor that ONNX Runtime computes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Provider {
    /// NVIDIA GPUs through CUDA.
    Cuda,
    /// NVIDIA GPUs, with graphs compiled for them.
    TensorRt,
    /// Intel processors and GPUs.
    OpenVino,
    /// Apple's processors and GPUs through Core ML.
    CoreMl,
    /// Graphics cards under Windows.
    DirectMl,
}

/// Whether a profile is a file that describes a network, and not the name of a built-in one.
#[must_use]
pub fn is_profile_file(profile: &str) -> bool {
    Path::new(profile).extension().is_some_and(|extension| extension == "toml")
}

/// Reads the profile of a network from a TOML file.
///
/// # Errors
/// What is wrong with the file, with its path.
pub fn profile_in<P: DeserializeOwned>(path: &str) -> Result<P, String> {
    let text = sizeup_geo::files::read_text(Path::new(path)).map_err(|e| e.to_string())?;
    toml::from_str(&text).map_err(|e| format!("{path}: {e}"))
}

/// The profiles of networks, `[[profile]]` each, of a text.
///
/// # Errors
/// Where it is not valid.
pub fn profiles<P: DeserializeOwned>(text: &str) -> Result<Vec<P>, toml::de::Error> {
    let mut all: BTreeMap<String, Vec<P>> = toml::from_str(text)?;
    Ok(all.remove("profile").unwrap_or_default())
}

/// Threads of one inference, where the program may not use all cores; engines like to use all.
fn n_threads() -> Option<usize> {
    let (most, allowed) = (std::thread::available_parallelism().map_or(1, NonZero::get), rayon::current_num_threads());
    (allowed < most).then_some(allowed)
}

/// Which engine computes, and on what.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EngineConfig {
    /// Engine that runs the graph.
    pub name: EngineChoice,
    /// ONNX Runtime's shared library (`libonnxruntime.so`); without it `ORT_DYLIB_PATH`, the program's folder,
    /// target/onnxruntime and the system's libraries are looked at, in this order.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub library: Option<PathBuf>,
    /// Processors that ONNX Runtime computes on, tried in this order; what none of them can do is left to the CPU. One that the
    /// library does not have is an error.
    #[schemars(extend("x-expert" = true))]
    pub providers: Vec<Provider>,
}

impl EngineConfig {
    /// Hands every path of these settings to `visit`, which may change it.
    pub fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        self.library.iter_mut().for_each(visit);
    }
}

/// Numbers in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Length of each dimension.
    pub shape: Vec<usize>,
    /// Their product of values.
    pub values: Vec<f32>,
}

impl Tensor {
    fn check(&self) -> Result<(), String> {
        let n_values: usize = self.shape.iter().product();
        let is_whole = n_values == self.values.len();
        if is_whole { Ok(()) } else { Err(format!("{} values for shape {:?}", self.values.len(), self.shape)) }
    }
}

/// Content of a port, as far as it matters here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TensorContent {
    /// Floating-point numbers, or the graph does not say.
    Floats,
    /// 64-bit (or 32-bit) integers; values are rounded to them.
    Integers,
    /// Something that cannot be given or read here, such as strings.
    Other,
}

/// An input or output of a graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Port {
    /// Name in the graph.
    pub name: String,
    /// Dimensions, `None` where they are free; empty where the graph does not say, and for single numbers.
    pub shape: Vec<Option<usize>>,
    /// Type of the numbers.
    pub numbers: TensorContent,
}

impl Port {
    /// A port of floating-point numbers.
    #[must_use]
    pub fn floats(name: &str, shape: &[Option<usize>]) -> Self {
        Self { name: name.to_owned(), shape: shape.to_vec(), numbers: TensorContent::Floats }
    }
}

/// A graph that an engine has loaded and can run.
#[derive(Debug)]
pub struct Network {
    graph: Graph,
    /// Where the choice is free, and the embedded engine has loaded it.
    second: Option<SecondChoice>,
    path: PathBuf,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
}

#[derive(Debug)]
enum Graph {
    Embedded(Box<embedded::EmbeddedGraph>),
    Runtime(runtime::RuntimeGraph),
}

impl Network {
    /// Loads a graph with whichever engine can run it.
    ///
    /// # Errors
    /// [`OnnxError`] but for those of running.
    pub fn open(path: &Path) -> Result<Self, OnnxError> {
        Self::open_with(path, &EngineConfig::default())
    }

    /// Loads a graph with an engine of choice.
    ///
    /// # Errors
    /// [`OnnxError`] but for those of running.
    pub fn open_with(path: &Path, config: &EngineConfig) -> Result<Self, OnnxError> {
        let contents = Contents::read(path)?;
        let embedded = || embedded::EmbeddedGraph::open(path, &contents).map(|graph| Graph::Embedded(Box::new(graph)));
        let runtime = || runtime::RuntimeGraph::open(path, config).map(Graph::Runtime);
        // What only ONNX Runtime has is asked for by asking for it.
        let wants_runtime = config.name == EngineChoice::OnnxRuntime
            || config.name == EngineChoice::Auto && !config.providers.is_empty();
        let graph = match config.name {
            _ if wants_runtime => runtime()?,
            EngineChoice::Auto => match embedded() {
                Ok(graph) => graph,
                // Without the other engine, what the first one says is what helps.
                Err(error) if runtime::library(config).is_err() => return Err(error),
                Err(first) => {
                    let graph = runtime().map_err(|second| first.and(second))?;
                    tracing::info!("ONNX Runtime runs {}: {}", path.display(), first.reason());
                    graph
                }
            },
            _ => embedded()?,
        };
        let (inputs, outputs) = match &graph {
            Graph::Embedded(graph) => graph.ports(),
            Graph::Runtime(graph) => graph.ports(),
        };
        let is_free = config.name == EngineChoice::Auto && matches!(graph, Graph::Embedded(_));
        let second = is_free.then(|| SecondChoice::new(path, config));
        Ok(Self { graph, second, path: path.to_owned(), inputs, outputs })
    }

    /// Loads a graph that is part of the program, in the embedded engine; `name` is for messages.
    ///
    /// # Errors
    /// [`OnnxError::Load`].
    pub fn built_in(name: &str, bytes: &'static [u8]) -> Result<Self, OnnxError> {
        let path = PathBuf::from(name);
        let graph = embedded::EmbeddedGraph::of_bytes(&path, bytes)?;
        let (inputs, outputs) = graph.ports();
        Ok(Self { graph: Graph::Embedded(Box::new(graph)), second: None, path, inputs, outputs })
    }

    /// Which engine has loaded it, and is asked first.
    #[must_use]
    pub fn engine(&self) -> EngineChoice {
        match self.graph {
            Graph::Embedded(_) => EngineChoice::Rten,
            Graph::Runtime(_) => EngineChoice::OnnxRuntime,
        }
    }

    /// Inputs of the graph, in its order.
    #[must_use]
    pub fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    /// Outputs of the graph, in its order.
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

    /// Runs it on several inputs and reads several outputs, in the order asked for. Values are brought to the number
    /// type of each input, and from that of each output.
    ///
    /// # Errors
    /// [`OnnxError::NoPort`] or [`OnnxError::Run`].
    pub fn run_many(&self, inputs: &[(&str, &Tensor)], outputs: &[&str]) -> Result<Vec<Tensor>, OnnxError> {
        let failed = |reason: String| OnnxError::Run { path: self.path.clone(), reason };
        let given = inputs.iter().map(|(name, tensor)| {
            tensor.check().map_err(failed)?;
            Ok((self.port("input", name, &self.inputs)?, *tensor))
        });
        let given = given.collect::<Result<Vec<_>, OnnxError>>()?;
        for name in outputs {
            self.port("output", name, &self.outputs)?;
        }
        match &self.graph {
            Graph::Embedded(graph) => self.run_embedded(graph, &given, outputs),
            Graph::Runtime(graph) => graph.run(&given, outputs),
        }
        .map_err(failed)
    }

    fn run_embedded(
        &self,
        graph: &embedded::EmbeddedGraph,
        given: &[(&Port, &Tensor)],
        outputs: &[&str],
    ) -> Result<Vec<Tensor>, String> {
        let Some(second) = &self.second else { return graph.run(given, outputs) };
        if let Some(graph) = second.graph_for(given) {
            return graph.run(given, outputs);
        }
        graph.run(given, outputs).or_else(|reason| second.take_over(given, outputs, &reason))
    }

    fn port<'a>(&self, what: &'static str, name: &str, ports: &'a [Port]) -> Result<&'a Port, OnnxError> {
        ports.iter().find(|port| port.name == name).ok_or_else(|| OnnxError::NoPort {
            path: self.path.clone(),
            what,
            name: name.to_owned(),
            present: ports.iter().map(|port| port.name.clone()).collect(),
        })
    }
}
