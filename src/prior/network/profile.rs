//! Model profiles: what a network wants and gives, as data.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::onnx::Port;
use crate::prior::{PriorError, PriorKind};

/// How the photo is brought to the network's size, then to the nearest multiple per side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fit {
    /// Longer side to the wanted length; area mean when shrinking, cubic when growing, on bytes; then each side to the
    /// nearest multiple, ties up (Depth Anything 3, `upper_bound_resize`).
    LongestSide,
    /// Shorter side to at least the wanted length, each side rounded to a multiple, one cubic resize on fractions
    /// (Depth Anything V2, `lower_bound`).
    ShortestSide,
}

/// One kind of depth network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// What it is called in the configuration.
    pub name: String,
    /// Which network, and where its preprocessing was read.
    pub about: String,
    /// Names its image input goes by in known exports.
    pub inputs: Vec<String>,
    /// Names its depth output goes by.
    pub outputs: Vec<String>,
    /// What its numbers are.
    pub kind: PriorKind,
    /// Side that `fit` refers to, pixels.
    pub side_px: usize,
    /// How the photo is resized.
    pub fit: Fit,
    /// Both sides are multiples of this, pixels: the patch size.
    pub multiple_of: usize,
    /// Subtracted from red, green and blue after division by 255.
    pub mean: [f32; 3],
    /// Divided by after that.
    pub std: [f32; 3],
    /// Name of an output that tells sky, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sky_output: Option<String>,
    /// Where that output is above this, there is sky.
    #[serde(default)]
    pub sky_above: f32,
    /// What its weights may be used for.
    pub licence: String,
}

#[derive(Deserialize)]
struct Profiles {
    profile: Vec<Profile>,
}

/// The profiles that come with sizeup.
///
/// # Panics
/// Never: the text is part of the program and tested.
#[must_use]
pub fn built_in() -> Vec<Profile> {
    let profiles: Profiles = toml::from_str(include_str!("profiles.toml")).expect("the built-in profiles are valid");
    profiles.profile
}

/// A built-in profile by name.
///
/// # Errors
/// [`PriorError::Config`] listing the names there are.
pub fn by_name(name: &str) -> Result<Profile, PriorError> {
    let all = built_in();
    let names: Vec<String> = all.iter().map(|p| p.name.clone()).collect();
    all.into_iter().find(|profile| profile.name == name).ok_or_else(|| PriorError::Config {
        problem: format!("no network profile {name:?}"),
        hint: format!("there are {}", names.join(", ")),
    })
}

/// The ports of a graph that a profile would use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wiring {
    /// Image input.
    pub input: String,
    /// Dimensions of the image input: 4 (batch, channel, row, column) or 5 (views after the batch).
    pub rank: usize,
    /// Rows and columns where the graph fixes them.
    pub fixed_size: Option<(usize, usize)>,
    /// Depth output.
    pub output: String,
    /// Sky output, if the graph has it.
    pub sky: Option<String>,
}

impl Profile {
    /// How this profile connects to a graph.
    ///
    /// # Errors
    /// What does not fit, in one sentence.
    pub fn wire(&self, inputs: &[Port], outputs: &[Port]) -> Result<Wiring, String> {
        let names = |ports: &[Port]| ports.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ");
        let [input] = inputs else {
            return Err(format!("expected one input, found {}: {}", inputs.len(), names(inputs)));
        };
        if !self.inputs.contains(&input.name) {
            return Err(format!("expected an input named {}, found {}", self.inputs.join(" or "), input.name));
        }
        let is_image = matches!(input.shape.len(), 4 | 5) && input.shape[input.shape.len() - 3].is_none_or(|n| n == 3);
        if !is_image {
            return Err(format!(
                "input {} has shape {:?}, expected batch × 3 × rows × columns",
                input.name, input.shape
            ));
        }
        let known = |name: &String| outputs.iter().any(|port| port.name == *name);
        let output = self.outputs.iter().find(|name| known(name));
        let output = output.ok_or_else(|| {
            format!("expected an output named {}, found {}", self.outputs.join(" or "), names(outputs))
        })?;
        let [.., rows, columns] = input.shape[..] else { return Err("input without rows and columns".to_owned()) };
        Ok(Wiring {
            input: input.name.clone(),
            rank: input.shape.len(),
            fixed_size: rows.zip(columns),
            output: output.clone(),
            sky: self.sky_output.clone().filter(known),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_profiles_are_valid_and_distinct() {
        let all = built_in();
        assert!(all.len() >= 3);
        assert!(all.iter().all(|p| p.std.iter().all(|s| *s > 0.0) && p.side_px >= p.multiple_of));
        assert!(by_name("da4").unwrap_err().to_string().contains("depth-anything-v2"));
    }
}
