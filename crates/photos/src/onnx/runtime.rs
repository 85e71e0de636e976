//! ONNX Runtime, loaded from its shared library when the first graph wants it.
//!
//! One library per process: the first one that loads stays. Several graphs share its environment; one graph computes one
//! input at a time, on as many threads as it may.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use ort::environment::Environment;
use ort::ep::{self, ExecutionProviderDispatch};
use ort::session::{Session, SessionInputValue};
use ort::value::{DynValue, TensorElementType, ValueType};

use super::{EngineConfig, OnnxError, Port, Provider, Tensor, TensorContent};

/// Paths at which the library is looked for if no configuration says so: known only to who may look at the surroundings.
static CANDIDATES: OnceLock<Vec<PathBuf>> = OnceLock::new();
/// The library in use and its environment.
static LIBRARY: Mutex<Option<&'static Library>> = Mutex::new(None);

/// A library that is loaded, until the process ends.
struct Library {
    path: PathBuf,
    environment: Environment,
}

/// Says where to look for the library. Only the first call counts.
pub fn look_in(candidates: Vec<PathBuf>) {
    let _ = CANDIDATES.set(candidates);
}

/// Loads the library, once per process; the path it was loaded from.
///
/// # Errors
/// [`OnnxError::NoRuntime`] if it is not found, too old, or another one is loaded already.
pub fn library(config: &EngineConfig) -> Result<&'static Path, OnnxError> {
    loaded(config).map(|library| library.path.as_path())
}

fn loaded(config: &EngineConfig) -> Result<&'static Library, OnnxError> {
    let refuse = |reason: String| OnnxError::NoRuntime { reason };
    let mut in_use = LIBRARY.lock().unwrap_or_else(PoisonError::into_inner);
    match (*in_use, &config.library) {
        (Some(library), Some(wanted)) if library.path != *wanted => {
            Err(refuse(format!("{} is loaded already, and {} is wanted now", library.path.display(), wanted.display())))
        }
        (Some(library), _) => Ok(library),
        (None, wanted) => {
            let library = &*Box::leak(Box::new(load(wanted.as_deref()).map_err(refuse)?));
            *in_use = Some(library);
            Ok(library)
        }
    }
}

fn load(wanted: Option<&Path>) -> Result<Library, String> {
    let (prefix, suffix) = (std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let of_system = PathBuf::from(format!("{prefix}onnxruntime{suffix}"));
    let places: Vec<PathBuf> = match wanted {
        Some(path) => vec![path.to_owned()],
        None => {
            let given = CANDIDATES.get().into_iter().flatten().filter(|path| path.exists()).cloned();
            given.chain([of_system]).collect()
        }
    };
    let mut reasons = Vec::new();
    for path in places {
        match ort::init_from(&path) {
            Ok(builder) => {
                let environment = builder.with_name("sizeup").build().map_err(|e| e.to_string())?;
                return Ok(Library { path, environment });
            }
            Err(error) => reasons.push(error.to_string()),
        }
    }
    Err(reasons.join("; "))
}

/// A graph in ONNX Runtime.
#[derive(Debug)]
pub(super) struct RuntimeGraph {
    /// Session of ONNX Runtime; locked, as a run changes it.
    session: Mutex<Session>,
}

impl RuntimeGraph {
    pub(super) fn open(path: &Path, config: &EngineConfig) -> Result<Self, OnnxError> {
        let library = loaded(config)?;
        let open = || -> Result<Session, String> {
            let text = |e: &dyn std::fmt::Display| e.to_string();
            let mut builder = Session::builder(&library.environment).map_err(|e| text(&e))?;
            // What goes wrong comes back as an error; the library's own talk about it is not for users.
            builder = builder.with_log_level(ort::logging::LogLevel::Fatal).map_err(|e| text(&e))?;
            if let Some(n_threads) = super::n_threads() {
                builder = builder.with_intra_threads(n_threads).map_err(|e| text(&e))?;
            }
            let providers: Vec<ExecutionProviderDispatch> = config.providers.iter().map(|p| dispatch(*p)).collect();
            builder = builder.with_execution_providers(providers).map_err(|e| text(&e))?;
            builder.commit_from_file(path).map_err(|e| text(&e))
        };
        let session = open().map_err(|reason| OnnxError::Load {
            path: path.to_owned(),
            reason,
            hint: if config.providers.is_empty() {
                "is it sound, and all its external data beside it?".to_owned()
            } else {
                "does this ONNX Runtime have the `engine.providers` that are asked for, and the machine what they need?"
                    .to_owned()
            },
        })?;
        Ok(Self { session: Mutex::new(session) })
    }

    fn session(&self) -> std::sync::MutexGuard<'_, Session> {
        // A run that panicked leaves the session as it was before.
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Inputs and outputs of the graph, in its order.
    pub(super) fn ports(&self) -> (Vec<Port>, Vec<Port>) {
        let session = self.session();
        let port = |outlet: &ort::value::Outlet| {
            let (numbers, shape) = match outlet.dtype() {
                ValueType::Tensor { ty, shape, .. } => (numbers_of(*ty), shape.to_vec()),
                _ => (TensorContent::Other, Vec::new()),
            };
            let shape = shape.into_iter().map(|n| usize::try_from(n).ok()).collect();
            Port { name: outlet.name().to_owned(), shape, numbers }
        };
        (session.inputs().iter().map(port).collect(), session.outputs().iter().map(port).collect())
    }

    pub(super) fn run(&self, inputs: &[(&Port, &Tensor)], outputs: &[&str]) -> Result<Vec<Tensor>, String> {
        let mut session = self.session();
        let mut given: Vec<(String, SessionInputValue<'_>)> = Vec::with_capacity(inputs.len());
        for (port, tensor) in inputs {
            let kind = session.inputs().iter().find(|outlet| outlet.name() == port.name).and_then(element_type);
            given.push((port.name.clone(), input_of(tensor, kind).map_err(|e| format!("input {:?}: {e}", port.name))?));
        }
        let results = session.run(given).map_err(|e| e.to_string())?;
        let tensor = |name: &&str| {
            let value = results.get(name).ok_or_else(|| format!("there is no output {name:?}"))?;
            tensor_of(value).map_err(|e| format!("output {name:?}: {e}"))
        };
        outputs.iter().map(tensor).collect()
    }
}

fn dispatch(provider: Provider) -> ExecutionProviderDispatch {
    let dispatch = match provider {
        Provider::Cuda => ep::CUDA::default().build(),
        Provider::TensorRt => ep::TensorRT::default().build(),
        Provider::OpenVino => ep::OpenVINO::default().build(),
        Provider::CoreMl => ep::CoreML::default().build(),
        Provider::DirectMl => ep::DirectML::default().build(),
    };
    dispatch.error_on_failure()
}

fn element_type(outlet: &ort::value::Outlet) -> Option<TensorElementType> {
    match outlet.dtype() {
        ValueType::Tensor { ty, .. } => Some(*ty),
        _ => None,
    }
}

fn numbers_of(kind: TensorElementType) -> TensorContent {
    use TensorElementType as T;
    match kind {
        T::Float32 | T::Float16 | T::Float64 => TensorContent::Floats,
        T::Int64 | T::Int32 | T::Uint8 | T::Bool => TensorContent::Integers,
        _ => TensorContent::Other,
    }
}

/// Values in the type that the graph wants.
fn input_of(tensor: &Tensor, kind: Option<TensorElementType>) -> Result<SessionInputValue<'static>, String> {
    use TensorElementType as T;
    let shape = tensor.shape.clone();
    let values = tensor.values.iter();
    let text = |e: ort::Error| e.to_string();
    Ok(match kind {
        Some(T::Float32) => ort::value::Tensor::from_array((shape, tensor.values.clone())).map_err(text)?.into(),
        Some(T::Float16) => {
            let values: Vec<half::f16> = values.map(|v| half::f16::from_f32(*v)).collect();
            ort::value::Tensor::from_array((shape, values)).map_err(text)?.into()
        }
        Some(T::Int64) => {
            let values: Vec<i64> = values.map(|v| v.round() as i64).collect();
            ort::value::Tensor::from_array((shape, values)).map_err(text)?.into()
        }
        Some(T::Uint8) => {
            let values: Vec<u8> = values.map(|v| v.round() as u8).collect();
            ort::value::Tensor::from_array((shape, values)).map_err(text)?.into()
        }
        other => return Err(format!("it takes {other:?}, expected floats or integers")),
    })
}

fn tensor_of(value: &DynValue) -> Result<Tensor, String> {
    use TensorElementType as T;
    let ValueType::Tensor { ty, .. } = value.dtype() else { return Err("it is no tensor".to_owned()) };
    match ty {
        T::Float32 => read::<f32>(value, |v| v),
        T::Float16 => read::<half::f16>(value, half::f16::to_f32),
        T::Float64 => read::<f64>(value, |v| v as f32),
        T::Int64 => read::<i64>(value, |v| v as f32),
        T::Uint8 => read::<u8>(value, f32::from),
        T::Bool => read::<bool>(value, |v| f32::from(u8::from(v))),
        other => Err(format!("it holds {other:?}, expected numbers")),
    }
}

fn read<T: ort::value::PrimitiveTensorElementType + Copy>(
    value: &DynValue,
    number: impl Fn(T) -> f32,
) -> Result<Tensor, String> {
    let (shape, values) = value.try_extract_tensor::<T>().map_err(|e| e.to_string())?;
    let shape = shape.iter().map(|n| usize::try_from(*n).unwrap_or(0)).collect();
    Ok(Tensor { shape, values: values.iter().map(|v| number(*v)).collect() })
}
