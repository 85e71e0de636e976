//! Depth priors from a network that the user brings as an ONNX file.
//!
//! What the network wants is a [`Profile`]: data, not code. The photo is decoded at reduced size, resized exactly as
//! the network's own code does, and the output is taken as the whole photo.

pub mod preprocess;
pub mod profile;
pub mod resize;

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::profile::{Profile, Wiring};
use self::resize::Rgb;
use super::array::MapShape;
use super::{CacheKey, DepthPrior, KeyHasher, PriorError, PriorGeometry, PriorKind, PriorSource};
use crate::geodata::raster::{RasterFile, Resampling, Window};
use crate::onnx::{Network, Port, Tensor};
use crate::raster::Raster;
use crate::survey::View;

/// Longer side above which a photo is decoded at a whole fraction of its size, pixels: eight times what networks see.
const DECODE_SIDE_PX: usize = 4096;

/// Which network, and what kind of network it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// ONNX file.
    pub model: PathBuf,
    /// Built-in profile: "da3", "depth-anything-v2" or "depth-anything-v2-metric". It declares the numbers' direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// A profile of your own, in place of a built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub custom: Option<Profile>,
}

impl NetworkConfig {
    fn chosen(&self) -> Result<Profile, PriorError> {
        let refuse = |problem: &str| PriorError::Config {
            problem: problem.to_owned(),
            hint:
                "set `profile` to a built-in one, or `custom` to one of your own; a graph does not tell which way its \
                   numbers run"
                    .to_owned(),
        };
        match (&self.profile, &self.custom) {
            (Some(name), None) => profile::by_name(name),
            (None, Some(custom)) => Ok(custom.clone()),
            (None, None) => Err(refuse("no network profile is set")),
            (Some(_), Some(_)) => Err(refuse("both `profile` and `custom` are set")),
        }
    }
}

/// What a graph wants and gives, and which built-in profiles fit it.
#[derive(Debug)]
pub struct Inspection {
    /// Its inputs.
    pub inputs: Vec<Port>,
    /// Its outputs.
    pub outputs: Vec<Port>,
    /// Every built-in profile with its wiring, or why it does not fit.
    pub profiles: Vec<(Profile, Result<Wiring, String>)>,
}

/// Looks at a graph without running it.
///
/// # Errors
/// [`PriorError::Network`] if the engine cannot load it.
pub fn inspect(model: &Path) -> Result<Inspection, PriorError> {
    let network = Network::open(model)?;
    let (inputs, outputs) = (network.inputs().to_vec(), network.outputs().to_vec());
    let wired = profile::built_in().into_iter().map(|profile| {
        let wiring = profile.wire(&inputs, &outputs);
        (profile, wiring)
    });
    let profiles = wired.collect();
    Ok(Inspection { inputs, outputs, profiles })
}

/// Depth from a network.
#[derive(Debug)]
pub struct NetworkPriors {
    network: Network,
    config: NetworkConfig,
    profile: Profile,
    wiring: Wiring,
}

impl NetworkPriors {
    /// Loads the network and checks that its profile fits.
    ///
    /// # Errors
    /// [`PriorError::Network`], or [`PriorError::Config`] where the profile does not fit.
    pub fn new(config: NetworkConfig) -> Result<Self, PriorError> {
        let profile = config.chosen()?;
        let network = Network::open(&config.model)?;
        let wiring = profile.wire(network.inputs(), network.outputs()).map_err(|problem| PriorError::Config {
            problem: format!("profile {:?} does not fit {}: {problem}", profile.name, config.model.display()),
            hint: "`sizeup prior inspect` shows what the graph wants and which profiles fit".to_owned(),
        })?;
        Ok(Self { network, config, profile, wiring })
    }

    /// What the weights may be used for, for the log.
    #[must_use]
    pub fn licence(&self) -> &str {
        &self.profile.licence
    }

    fn map_of(&self, tensor: Tensor, what: &str) -> Result<Raster<f32>, PriorError> {
        let refuse = |problem: String| PriorError::File { path: self.config.model.clone(), problem };
        let shape = MapShape::of(&tensor.shape).map_err(|e| refuse(format!("output {what:?}: {e}")))?;
        if shape.n != 1 {
            return Err(refuse(format!("output {what:?} has {} maps, expected one", shape.n)));
        }
        Ok(shape.raster(tensor.values))
    }
}

impl PriorSource for NetworkPriors {
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError> {
        let photo = decode(view)?;
        let input = preprocess::tensor(&self.profile, &photo, self.wiring.fixed_size, self.wiring.rank);
        let output = |name: &str| self.map_of(self.network.run((self.wiring.input.as_str(), &input), name)?, name);
        let mut values = output(&self.wiring.output)?;
        let is_possible = |v: f32| v.is_finite() && (self.profile.kind == PriorKind::InverseDepth || v > 0.0);
        values.data_mut().iter_mut().filter(|v| !is_possible(**v)).for_each(|v| *v = f32::NAN);
        if let Some(name) = &self.wiring.sky {
            let sky = output(name)?;
            if (sky.width(), sky.height()) == (values.width(), values.height()) {
                for (value, sky) in values.data_mut().iter_mut().zip(sky.data()) {
                    if *sky > self.profile.sky_above {
                        *value = f32::NAN;
                    }
                }
            }
        }
        let first = values.data().iter().copied().find(|v| !v.is_nan());
        let varies = values.data().iter().any(|v| !v.is_nan() && Some(*v) != first);
        if !varies {
            return Err(PriorError::NoInformation {
                path: self.config.model.clone(),
                problem: format!("for {} it gives one and the same value everywhere, or none", view.id),
            });
        }
        Ok(DepthPrior { values, kind: self.profile.kind, geometry: PriorGeometry::ZDepth })
    }
}

impl CacheKey for NetworkPriors {
    fn feed(&self, view: &View, key: &mut KeyHasher) -> Result<(), PriorError> {
        key.bytes(b"network 1");
        key.json(&self.profile);
        key.file(&self.config.model)?;
        match &view.image {
            Some(image) => key.file(image),
            None => Ok(()),
        }
    }
}

/// The photo in colour, grey ones three times the same.
fn decode(view: &View) -> Result<Raster<Rgb>, PriorError> {
    let path = view.image.as_deref().ok_or_else(|| PriorError::Photo {
        view: view.id.to_string(),
        problem: "its photo is not known".to_owned(),
        hint: "a network needs the photo's file".to_owned(),
    })?;
    let file = RasterFile::open(path)?;
    let (width, height) = file.size();
    let fraction = width.max(height).div_ceil(DECODE_SIDE_PX);
    let size = (width.div_ceil(fraction), height.div_ceil(fraction));
    let whole = Window { col: 0, row: 0, width, height };
    let resampling = if fraction == 1 { Resampling::Nearest } else { Resampling::Average };
    let band = |i: usize| file.read_window(i, whole, size, resampling);
    let bands = if file.n_bands() >= 3 { [band(1)?, band(2)?, band(3)?] } else { [band(1)?, band(1)?, band(1)?] };
    let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8; // NaN becomes 0
    let pixels = (0..size.0 * size.1).map(|i| [0, 1, 2].map(|c: usize| byte(bands[c].data()[i])));
    Ok(Raster::from_vec(size.0, size.1, pixels.collect()).expect("bands are alike"))
}
