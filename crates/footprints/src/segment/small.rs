//! The network that comes with sizeup: run where a configuration asks for a network and names none.
//!
//! `small.md` beside it says how it was made. It is what `sizeup-train` exports, as any other of the profile `small.v1`.

use serde::Serialize;

/// The graph as an ONNX file.
pub(super) const ONNX: &[u8] = include_bytes!("small.onnx");
/// Name of the profile by which the graph is run.
pub(super) const PROFILE: &str = "small.v1";
/// Ground per pixel that finer photos are reduced to, metres: the network learned so (`pixel_m` of training/configs/longer.toml).
pub(super) const PIXEL_M: f64 = 0.34;
/// Number of looks at each tile.
pub(super) const LOOKS: usize = 4;
/// The network's name in messages.
pub(super) const IN_WORDS: &str = "the built-in network";

/// A network that comes with sizeup.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct SmallNetwork {
    /// The name that `sizeup model list` gives it.
    pub name: &'static str,
    /// Purpose of the network, in words.
    pub about: &'static str,
    /// Licence of its weights.
    pub licence: &'static str,
    /// Set and settings that it was made from.
    pub source: &'static str,
    /// How well it finds buildings, measured, in words.
    pub measured: &'static str,
    /// Size of the graph's file, bytes.
    pub bytes: usize,
}

/// The one network that comes with sizeup.
pub const SMALL: SmallNetwork = SmallNetwork {
    name: "small",
    about: "buildings in near-nadir photos of 0.2 to 0.5 m per pixel, outlined where they meet the ground, from colours and depth",
    licence: "MIT OR Apache-2.0",
    source: "trained by training/configs/longer.toml on training/sets/simulated.toml, suburbs.toml and more.toml (docs/footprint-network.md)",
    measured: "in photos of unseen simulated towns IoU 78 % by building and 90 % of all pixels: roofs with a step are cut at it, and \
               real photos are harder (docs/footprint-network.md)",
    bytes: ONNX.len(),
};
