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

/// Logistic fit of the probability that a building of the network is one (intersection over union of a half and more) in a real photo.
#[derive(Debug, Clone, Copy)]
pub(super) struct Calibration {
    offset: f64,
    slope: f64,
}

/// Fit for photos without depth: 264 buildings that the network drew in 24 tiles of four real places, none of which it learned from. Of
/// those with a mean of 0.5 to 0.7, 0.7 to 0.8, 0.8 to 0.9 and above, 3, 11, 18 and 21 % were hits.
pub(super) const BY_COLOURS: Calibration = Calibration { offset: -7.19, slope: 6.57 };
/// Fit for photos with depth, of the same tiles with their relief as depth: 196 buildings; 0, 17, 46 and 55 % were hits.
pub(super) const BY_COLOURS_AND_DEPTH: Calibration = Calibration { offset: -9.52, slope: 10.5 };

impl Calibration {
    /// Returns the probability for the mean probability of a building's pixels.
    ///
    /// ```text
    /// P = 1 / (1 + exp(−(a + b · p)))       p: mean probability of its pixels
    /// ```
    pub fn probability(self, mean: f64) -> f64 {
        1.0 / (1.0 + (-(self.offset + self.slope * mean)).exp())
    }
}

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
    measured: "in photos of unseen simulated towns IoU 78 % by building and 90 % of all pixels; in real photos without depth one of \
               eight is right, with depth every second (docs/footprint-network.md)",
    bytes: ONNX.len(),
};

#[cfg(test)]
mod tests {
    use super::*;

    /// The network is sure of meadows; one of eight buildings that it draws without depth is one.
    #[test]
    fn a_sure_network_is_not_believed_more_often_than_it_is_right() {
        for (mean, without, with) in [(0.6, 0.04, 0.04), (0.75, 0.09, 0.16), (0.85, 0.17, 0.36), (0.95, 0.28, 0.61)] {
            let found = [BY_COLOURS.probability(mean), BY_COLOURS_AND_DEPTH.probability(mean)];
            assert!((found[0] - without).abs() < 0.01 && (found[1] - with).abs() < 0.01, "{mean}: {found:?}");
        }
        // However sure it is: without depth a building stays unlikely.
        assert!(BY_COLOURS_AND_DEPTH.probability(0.0) < 0.01 && BY_COLOURS.probability(1.0) < 0.4);
    }
}
