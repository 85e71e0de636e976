//! The footprint network: feature maps of any stride and width, 1 × 1 projectors, a U-Net, a mask decoder.
//!
//! ```text
//! texture  image + lean ─ convolutions ─ tex0 (stride 2) ─ tex1 (4) ─ tex2 (8) ──┐
//! geometry depth + lean ─ convolutions ─ geo0 (stride 2) ─ geo1 (4) ─────────────┤  or the features of frozen networks
//!                                                                               ▼
//!   head   1 × 1 projectors ─ resized to one grid ─ concatenated ─ U-Net ─ decoder ─ logits: ground, roof, middle, rise, seam
//! ```
//!
//! This is the paper's head (`SiZeUp`, "Footprint Extraction"): there the features are those of SAM 3 and Depth Anything 3,
//! frozen; here small convolutions that learn along give them, and a configuration with `features` takes them from files.
//! The channels of roofs are ours: the paper leaves open how instances come apart.
//!
//! The architecture is written once, against [`Builder`]: one builder declares the parameters, one computes with candle, one
//! writes ONNX.

pub mod conv;
pub mod evaluate;
pub mod norm;
pub mod onnx;
pub mod parameters;
pub mod resize;

use candle_core::{Result, bail};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Channels that are normalised together.
const GROUP: usize = 8;

/// What the layers of a network are made with.
pub trait Builder {
    /// A map of features, batch left out.
    type Value: Clone;

    /// Channels, rows, columns.
    ///
    /// # Errors
    /// That of the framework.
    fn shape(&self, x: &Self::Value) -> Result<[usize; 3]>;
    /// A convolution with a bias, zeros beyond the border.
    ///
    /// # Errors
    /// Shapes that do not fit.
    fn conv(&mut self, name: &str, x: &Self::Value, shape: Kernel) -> Result<Self::Value>;
    /// Group normalisation and rectifier.
    ///
    /// # Errors
    /// Shapes that do not fit.
    fn norm(&mut self, name: &str, x: &Self::Value, n_groups: usize) -> Result<Self::Value>;
    /// Bilinear, to rows and columns.
    ///
    /// # Errors
    /// Shapes that do not fit.
    fn resize(&mut self, x: &Self::Value, rows: usize, columns: usize) -> Result<Self::Value>;
    /// One behind the other along the channels.
    ///
    /// # Errors
    /// Shapes that do not fit.
    fn concat(&mut self, xs: &[Self::Value]) -> Result<Self::Value>;
}

/// The size of a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kernel {
    /// Channels that it gives.
    pub n_out: usize,
    /// Rows and columns of its kernel, odd.
    pub side: usize,
    /// Cells from one output to the next.
    pub stride: usize,
}

/// What a network takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Input {
    /// The photo's colours, normalised with `ImageNet`'s mean and deviation: three channels.
    Image,
    /// How far things stand out of the ground's plane, from a depth prior: one channel.
    Depth,
    /// Which way upright things lean, from the pose: two channels.
    Lean,
}

impl Input {
    /// Its name in the graph.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Image => "image",
            Self::Depth => "depth",
            Self::Lean => "lean",
        }
    }

    /// Number of channels that the network takes.
    #[must_use]
    pub fn channels(self) -> usize {
        match self {
            Self::Image => 3,
            Self::Depth => 1,
            Self::Lean => 2,
        }
    }
}

/// A map of features that was computed before, by a network that does not learn.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FeatureConfig {
    /// Its name in the files and in the graph, such as "tex2" or "geo".
    pub name: String,
    /// Number of channels of the features.
    pub channels: usize,
}

/// How large a network is and what it sees.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NetworkConfig {
    /// What it takes: "image", "depth", "lean" in any combination with one of the first two; empty with `features`.
    pub inputs: Vec<Input>,
    /// Feature maps of frozen networks in place of `inputs`, the finest first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub features: Vec<FeatureConfig>,
    /// Channels of the texture backbone at strides 2, 4, 8 and so on.
    pub texture: Vec<usize>,
    /// Channels of the geometry backbone at strides 2, 4 and so on.
    pub geometry: Vec<usize>,
    /// Channels that each feature map is projected to.
    pub projected: usize,
    /// Channels of the U-Net, from the finest grid to the coarsest; each is half as fine as the one before.
    pub widths: Vec<usize>,
    /// Channels of the mask decoder.
    pub decoder: usize,
}

impl NetworkConfig {
    /// The settings on one line, for messages.
    pub(crate) fn in_json(&self) -> String {
        serde_json::to_string(self).expect("plain data")
    }
}

impl Default for NetworkConfig {
    fn default() -> Self {
        Self {
            inputs: vec![Input::Image, Input::Depth, Input::Lean],
            features: Vec::new(),
            texture: vec![16, 24, 40],
            geometry: vec![8, 16],
            projected: 8,
            widths: vec![16, 24, 40, 64, 80],
            decoder: 16,
        }
    }
}

/// Logits that a network gives: is there a building on the ground, is a roof seen, how near to its roof's middle a pixel lies, how far
/// the roof rises, and do two roofs meet.
pub const N_LOGITS: usize = 5;

impl NetworkConfig {
    /// What is wrong with it, if anything: found, and what is expected.
    #[must_use]
    pub fn fault(&self) -> Option<(String, &'static str)> {
        let has = |i: Input| self.inputs.contains(&i);
        let mut sorted = self.inputs.clone();
        sorted.sort_unstable();
        sorted.dedup();
        if sorted.len() != self.inputs.len() {
            return Some((format!("inputs = {:?}", self.inputs), "each input once"));
        }
        if self.features.is_empty() && !has(Input::Image) && !has(Input::Depth) {
            return Some((format!("inputs = {:?}", self.inputs), "\"image\", \"depth\" or both, or `features`"));
        }
        if !self.features.is_empty() && !self.inputs.is_empty() {
            return Some(("both `inputs` and `features`".to_owned(), "one of them; `inputs = []` with features"));
        }
        let widths =
            [&self.texture[..], &self.geometry[..], &self.widths[..], &[self.projected, self.decoder]].concat();
        let is_odd = |w: &usize| *w == 0 || *w > 4096 || (*w > GROUP && !w.is_multiple_of(4));
        if let Some(width) = widths.iter().find(|w| is_odd(w)) {
            return Some((format!("a layer of {width} channels"), "1 to 4096 channels, from 8 on a multiple of 4"));
        }
        let short = [("texture", &self.texture), ("geometry", &self.geometry), ("widths", &self.widths)];
        short.into_iter().find(|(_, w)| w.is_empty()).map(|(name, _)| (format!("{name} = []"), "at least one layer"))
    }

    /// What a tile's side has to be a multiple of, pixels.
    #[must_use]
    pub fn multiple(&self) -> usize {
        1 << self.widths.len().max(self.texture.len()).max(self.geometry.len())
    }
}

/// Groups of a layer: eight channels each where that works out, four otherwise.
fn n_groups(channels: usize) -> usize {
    [GROUP, 4].into_iter().find(|g| channels.is_multiple_of(*g)).map_or(1, |g| channels / g)
}

/// A convolution with normalisation and rectifier behind it.
fn layer<B: Builder>(b: &mut B, name: &str, x: &B::Value, n_out: usize, stride: usize) -> Result<B::Value> {
    let y = b.conv(name, x, Kernel { n_out, side: 3, stride })?;
    b.norm(&format!("{name}.norm"), &y, n_groups(n_out))
}

/// Feature maps of a few convolutions, each level half as fine as the one before.
fn backbone<B: Builder>(b: &mut B, name: &str, x: &B::Value, widths: &[usize]) -> Result<Vec<B::Value>> {
    let mut maps: Vec<B::Value> = Vec::new();
    for (i, &width) in widths.iter().enumerate() {
        let finer = maps.last().unwrap_or(x).clone();
        let down = layer(b, &format!("{name}.{i}.down"), &finer, width, 2)?;
        maps.push(layer(b, &format!("{name}.{i}.same"), &down, width, 1)?);
    }
    Ok(maps)
}

/// The head: feature maps, the finest first, to logits of `rows × columns`.
///
/// # Errors
/// Shapes that do not fit.
pub fn head<B: Builder>(
    b: &mut B,
    config: &NetworkConfig,
    features: &[(String, B::Value)],
    (rows, columns): (usize, usize),
) -> Result<B::Value> {
    let Some((_, finest)) = features.first() else { bail!("a head needs features") };
    let [_, grid_rows, grid_columns] = b.shape(finest)?;
    let mut projected = Vec::new();
    for (name, map) in features {
        let kernel = Kernel { n_out: config.projected, side: 1, stride: 1 };
        let thin = b.conv(&format!("head.project.{name}"), map, kernel)?;
        projected.push(b.resize(&thin, grid_rows, grid_columns)?);
    }
    let mut x = b.concat(&projected)?;
    let mut skips = Vec::new();
    for (i, &width) in config.widths.iter().enumerate() {
        x = layer(b, &format!("head.down.{i}.a"), &x, width, if i == 0 { 1 } else { 2 })?;
        x = layer(b, &format!("head.down.{i}.b"), &x, width, 1)?;
        skips.push(x.clone());
    }
    for (i, &width) in config.widths.iter().enumerate().rev().skip(1) {
        let [_, rows, columns] = b.shape(&skips[i])?;
        let wide = b.resize(&x, rows, columns)?;
        let both = b.concat(&[skips[i].clone(), wide])?;
        x = layer(b, &format!("head.up.{i}"), &both, width, 1)?;
    }
    let x = layer(b, "head.decoder.coarse", &x, config.decoder, 1)?;
    let x = b.resize(&x, rows, columns)?;
    b.conv("head.decoder.logits", &x, Kernel { n_out: N_LOGITS, side: 3, stride: 1 })
}

/// The whole network: inputs, or feature maps in the order of the configuration, to logits.
///
/// # Errors
/// Shapes that do not fit.
pub fn network<B: Builder>(
    b: &mut B,
    config: &NetworkConfig,
    given: &[(String, B::Value)],
    size: (usize, usize),
) -> Result<B::Value> {
    if !config.features.is_empty() {
        return head(b, config, given, size);
    }
    let named = |input: Input| given.iter().find(|(name, _)| name == input.name()).map(|(_, v)| v.clone());
    let lean = named(Input::Lean);
    let mut features = Vec::new();
    let branches =
        [(Input::Image, "texture", "tex", &config.texture), (Input::Depth, "geometry", "geo", &config.geometry)];
    for (input, name, short, widths) in branches {
        let Some(x) = named(input) else { continue };
        let x = match &lean {
            Some(lean) => b.concat(&[x, lean.clone()])?,
            None => x,
        };
        let maps = backbone(b, name, &x, widths)?;
        features.extend(maps.into_iter().enumerate().map(|(i, map)| (format!("{short}{i}"), map)));
    }
    head(b, config, &features, size)
}
