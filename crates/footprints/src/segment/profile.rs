//! Segmenter profiles: what a network wants and gives, as data.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_photos::onnx::{Port, profiles};

/// Kind of masks that a network gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Gives {
    /// One map: is there a building? A second channel, if there is one, says how near to its building's middle a pixel lies.
    Semantic,
    /// Five maps: is there a building on the ground, is a roof seen, how near to its roof's middle a pixel lies, how far the roof rises, 1
    /// being 0.4 of the depth of its foot, and do two roofs meet. One or two maps are as of "semantic".
    Roofs,
    /// One map per building, `batch × instances × rows × columns`.
    Instances,
}

/// Function that turns outputs into probabilities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// `1 / (1 + exp(−x))`, for logits.
    Sigmoid,
    /// The outputs are probabilities already, 0 to 1.
    None,
}

/// A graph of its own whose outputs are a head's inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Backbone {
    /// Name in the configuration.
    pub name: String,
    /// Names its image input goes by.
    pub inputs: Vec<String>,
    /// Side of its square input, pixels.
    pub side_px: usize,
    /// Subtracted from red, green and blue after division by 255.
    pub mean: [f32; 3],
    /// Divided by after that.
    pub std: [f32; 3],
    /// Outputs that the head takes, under the same names.
    pub features: Vec<String>,
}

/// One kind of segmentation network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("x-expert" = true))]
pub struct SegmenterProfile {
    /// Name in the configuration.
    pub name: String,
    /// Which network, and where its preprocessing was read.
    pub about: String,
    /// Names its image input goes by; empty for a head over backbones.
    #[serde(default)]
    pub inputs: Vec<String>,
    /// Names its input for depth goes by: one channel, how far things stand out of the ground's plane.
    #[serde(default)]
    pub depth: Vec<String>,
    /// Names its input for the lean of upright things goes by: two channels, (pixel − nadir) over the focal length.
    #[serde(default)]
    pub lean: Vec<String>,
    /// Side of the square that a tile is brought to, pixels; a fixed size of the graph replaces it.
    pub side_px: usize,
    /// Subtracted from red, green and blue after division by 255.
    pub mean: [f32; 3],
    /// Divided by after that.
    pub std: [f32; 3],
    /// Names its masks go by.
    pub masks: Vec<String>,
    /// Kind of the masks.
    pub gives: Gives,
    /// Function that turns them into probabilities.
    pub activation: Activation,
    /// Where a second map says how near to a middle a pixel lies: how far it falls between two buildings, 0 to 1.
    #[serde(default = "default_dip")]
    pub dip: f32,
    /// Where five maps tell roofs apart: how far the third falls along the border of two, 0 to 1.
    #[serde(default = "default_valley")]
    pub valley: f32,
    /// Names of the instances' scores, through the same activation.
    #[serde(default)]
    pub scores: Vec<String>,
    /// Names of a score of the whole image that multiplies the others.
    #[serde(default)]
    pub presence: Vec<String>,
    /// Graphs that run before it.
    #[serde(default)]
    pub backbones: Vec<Backbone>,
    /// Licence of its weights.
    pub licence: String,
}

/// Chosen on the validation scenes of `training/sets/simulated.toml` (docs/footprint-network.md).
fn default_dip() -> f32 {
    0.003
}

/// How far middles less seams fall along the border of two roofs; chosen on those and on the validation scene of `suburbs.toml`.
fn default_valley() -> f32 {
    0.6
}

/// The profiles that come with sizeup.
///
/// # Panics
/// Never: the text is part of the program and tested.
#[must_use]
pub fn built_in() -> Vec<SegmenterProfile> {
    profiles(include_str!("profiles.toml")).expect("the built-in profiles are valid")
}

/// The first of some names that a graph has.
pub(super) fn port<'a>(names: &[String], ports: &'a [Port]) -> Option<&'a Port> {
    names.iter().find_map(|name| ports.iter().find(|port| port.name == *name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_profiles_are_valid_and_distinct() {
        let all = built_in();
        let mut names: Vec<&str> = all.iter().map(|p| p.name.as_str()).collect();
        names.dedup();
        assert_eq!(names.len(), all.len());
        for profile in &all {
            assert!(profile.std.iter().all(|s| *s > 0.0) && profile.side_px > 0 && !profile.masks.is_empty());
            assert_eq!(profile.inputs.is_empty(), !profile.backbones.is_empty(), "{}", profile.name);
        }
    }
}
