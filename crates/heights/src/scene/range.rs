//! Which heights a building can have: one range for all that looks for heights.
//!
//! Depth that is computed from the photos alone is searched for up to the greatest height, and solvers look no farther:
//! a height that the priors could not have shown is no answer. Frame: metres above a building's ground level.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Share of the clearance of the lowest oblique view to the highest ground that a building can have at most: a roof closer to
/// the cameras is in hardly any photo as a whole.
const CLEARANCE_SHARE: f64 = 0.8;
/// Greatest height that is looked for without being asked, metres: high flights clear the ground by far more than buildings do.
const MAX_HEIGHT_M: f64 = 150.0;
/// A greatest height that comes from the flight is a multiple of this, metres, so that a house more on higher ground, or a
/// photo more, leaves it where it is; and where it is low.
const GREATEST_STEP_M: f32 = 5.0;
const LOW_GREATEST_STEP_M: f32 = 1.0;
/// Greatest heights from here on are not low, metres.
const LOW_GREATEST_M: f32 = 25.0;

/// Which heights are looked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct HeightsConfig {
    /// Least height of a building above its ground, metres. Above 0.
    pub min_m: f32,
    /// Greatest height above ground, metres; absent: from the flight, 0.8 of the clearance between its lowest oblique view and the
    /// highest ground of the buildings, at most 150 m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_m: Option<f32>,
}

impl Default for HeightsConfig {
    fn default() -> Self {
        Self { min_m: 2.0, max_m: None }
    }
}

impl HeightsConfig {
    /// Why they make no range; `None` where they do.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        let Self { min_m, max_m } = *self;
        let is_range = min_m > 0.0 && min_m.is_finite() && max_m.is_none_or(|max_m| max_m > min_m && max_m.is_finite());
        let max = max_m.map_or("the default".to_owned(), |max_m| max_m.to_string());
        (!is_range).then(|| format!("heights from {min_m} to {max} m: expected 0 < min_m < max_m"))
    }

    /// The range in force for a flight whose lowest oblique view is so far above the highest ground, metres; its end is a
    /// round number where it comes from the flight.
    #[must_use]
    pub fn bounds(&self, clearance_m: f64) -> HeightBounds {
        let min_m = self.min_m;
        let of_flight_m = (CLEARANCE_SHARE * clearance_m).min(MAX_HEIGHT_M) as f32;
        HeightBounds { min_m, max_m: self.max_m.unwrap_or_else(|| in_round_numbers(min_m, of_flight_m)) }
    }
}

/// A greatest height in round numbers, not beyond what it was, metres; as it was where a step would leave no range.
fn in_round_numbers(min_m: f32, max_m: f32) -> f32 {
    let step_m = if max_m < LOW_GREATEST_M { LOW_GREATEST_STEP_M } else { GREATEST_STEP_M };
    let round_m = (max_m / step_m).floor() * step_m;
    if round_m > min_m { round_m } else { max_m }
}

/// Which heights a building can have, metres above its ground level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightBounds {
    /// Least height, metres.
    pub min_m: f32,
    /// Greatest height, metres.
    pub max_m: f32,
}

/// Distance around the footprints over which the ground is needed, in greatest heights: rays at 60° off nadir that pass over a
/// building of greatest height reach the ground 1.7 heights behind it.
const GROUND_MARGIN_HEIGHTS: f64 = 2.0;

impl HeightBounds {
    /// Distance around the footprints within which rays can meet the ground, metres.
    #[must_use]
    pub fn ground_margin_m(self) -> f64 {
        GROUND_MARGIN_HEIGHTS * f64::from(self.max_m)
    }

    /// Whether a height lies within them, metres.
    #[must_use]
    pub fn hold(self, height_m: f64) -> bool {
        (f64::from(self.min_m)..=f64::from(self.max_m)).contains(&height_m)
    }

    /// The nearest height within them, metres.
    #[must_use]
    pub fn nearest(self, height_m: f64) -> f64 {
        height_m.clamp(f64::from(self.min_m), f64::from(self.max_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_greatest_height_from_the_flight_is_a_round_number_below() {
        let ends = [117.85, 117.63, 150.0, 25.0, 24.9, 2.5].map(|max_m| in_round_numbers(2.0, max_m));
        assert_eq!(ends, [115.0, 115.0, 150.0, 25.0, 24.0, 2.5]);
        let asked = HeightsConfig { max_m: Some(61.3), ..HeightsConfig::default() };
        assert_eq!(asked.bounds(200.0).max_m, 61.3, "what is asked for stays");
    }
}
