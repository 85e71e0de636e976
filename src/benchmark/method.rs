//! What is run on a scene.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::baseline::{LiftConfig, metric_lift};
use crate::config::RunConfig;
use crate::optimise::{OptimiseConfig, Preset, Problem, Solution, solve};

/// A way from a scene's evidence to one height per outline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The publication's optimiser.
    Paper,
    /// Ours.
    Robust,
    /// Priors to metres on free ground, roofs lifted, medians taken.
    MetricLift,
}

impl Method {
    /// All, in the order of the tables.
    pub const ALL: [Self; 3] = [Self::Paper, Self::Robust, Self::MetricLift];

    /// The name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Robust => "robust",
            Self::MetricLift => "metric_lift",
        }
    }

    /// Sets what the method needs in a run's configuration.
    pub(super) fn configure(self, config: &mut RunConfig) {
        config.optimise.preset = if self == Self::Paper { Preset::Paper } else { Preset::Robust };
    }

    /// Heights of a problem.
    pub(super) fn solve(self, problem: &Problem<'_>, config: &OptimiseConfig) -> Solution {
        match self {
            Self::Paper | Self::Robust => solve(problem, config),
            Self::MetricLift => metric_lift(problem, config, &LiftConfig::default()),
        }
    }
}
