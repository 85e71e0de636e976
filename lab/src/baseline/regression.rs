//! Regression of normalised depth: the paper's optimiser with another loss, and nothing else changed.
//!
//! Rays, view selection, epochs, steps and their schedule, optimiser and start are those of the `paper` preset as it is
//! configured; the loss is the mean absolute or squared difference of normalised inverse depth over building pixels.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_heights::optimise::{Loss, OptimiseConfig, OrdinalConfig, Preset, Problem, Solution, solve};

/// Which distance is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Norm {
    /// Absolute differences, L1.
    L1,
    /// Squared differences, L2.
    L2,
}

/// Heights by regression, with the settings of a run for everything but the loss.
#[must_use]
pub fn regression(problem: &Problem<'_>, config: &OptimiseConfig, norm: Norm) -> Solution {
    let loss = match norm {
        Norm::L1 => Loss::L1,
        Norm::L2 => Loss::L2,
    };
    let ordinal = OrdinalConfig { loss, ..config.ordinal.clone() };
    let mut solution = solve(problem, &OptimiseConfig { preset: Preset::Paper, ordinal, ..config.clone() });
    // One height per footprint is all that a yardstick knows; photos have no say in it.
    solution.heights.iter_mut().for_each(|solved| solved.roof = None);
    solution
}
