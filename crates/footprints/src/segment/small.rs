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
/// The network's name in messages.
pub(super) const IN_WORDS: &str = "the built-in network";

/// Logistic fit of the probability that a building of the network is one (intersection over union of a half and more) in a real photo.
#[derive(Debug, Clone, Copy)]
pub(super) struct Calibration {
    offset: f64,
    slope: f64,
}

/// Fit for photos without depth: 86 buildings that the network drew in four tiles of a village that it did not learn from. Of those with a
/// mean of 0.5 to 0.7, 0.7 to 0.8, 0.8 to 0.9 and above, 29, 55, 72 and 64 % were hits.
pub(super) const BY_COLOURS: Calibration = Calibration { offset: -4.62, slope: 6.26 };
/// Fit for photos with depth, of the same tiles with their relief as depth: 103 buildings; 29, 100, 87 and 93 % were hits.
pub(super) const BY_COLOURS_AND_DEPTH: Calibration = Calibration { offset: -4.94, slope: 8.06 };

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
    licence: "MIT OR Apache-2.0; it learned from simulated photos and from imagery (c) OpenAerialMap contributors, CC BY 4.0, with buildings \
              (c) OpenStreetMap contributors, ODbL 1.0",
    source: "trained by training/configs/real.toml on simulated towns and real orthophotos (docs/footprint-network.md)",
    measured: "in photos of unseen simulated towns IoU 76 % by building and 88 % of all pixels; in orthophotos of an unseen village 71 % of \
               all pixels, and six of ten buildings that it draws are right (docs/footprint-network.md)",
    bytes: ONNX.len(),
};

#[cfg(test)]
mod tests {
    use super::*;

    /// Buildings drawn in a real village, by the mean probability of their pixels, and how many of them were hits: the sum of the
    /// probabilities is their number.
    #[test]
    fn a_network_is_believed_as_often_as_it_is_right() {
        type Drawn = [(f64, usize, usize); 4];
        let by_colours: Drawn = [(0.6, 14, 4), (0.75, 11, 6), (0.85, 47, 34), (0.95, 11, 7)];
        let with_depth: Drawn = [(0.6, 7, 2), (0.75, 4, 4), (0.85, 30, 26), (0.95, 60, 56)];
        for (drawn, calibration) in [(by_colours, BY_COLOURS), (with_depth, BY_COLOURS_AND_DEPTH)] {
            let expected: f64 = drawn.iter().map(|(mean, n, _)| *n as f64 * calibration.probability(*mean)).sum();
            let n_hits: usize = drawn.iter().map(|(_, _, hits)| hits).sum();
            assert!((expected - n_hits as f64).abs() < 2.0, "{expected} of {n_hits}");
        }
        assert!(BY_COLOURS.probability(0.5) < 0.25 && BY_COLOURS_AND_DEPTH.probability(0.0) < 0.01);
    }
}
