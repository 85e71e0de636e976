//! Heights from ordering: view selection, evidence, and one of two solvers, looped until the epochs are done.
//!
//! - `paper`: the pairwise ordinal hinge of [`crate::ordinal`], its derivative and Adam (`SiZeUp`, "Objective
//!   function").
//! - `robust`: the local search of one height at a time; see `search` and `score`.
//!
//! Input is a [`Problem`]: a scene, placed views and a way to load a view's prior. Only the priors of selected views are
//! loaded. Results do not depend on the number of threads.

mod inspect;
mod layer_shift;
mod rays;
mod solution;
mod solve;

pub use crate::config::{
    CalibrationRays, Gradient, Loss, MadGradient, OptimiseConfig, OrdinalConfig, Preset, Region, SearchConfig, StepOn,
};
pub use crate::evidence::straighten::PriorShape;
pub use crate::roofs::planes::{RoofPlane, RoofPlanes, Rule};
pub use crate::roofs::{Roof, Terrace, candidates};
pub use crate::search::disagreeing::DisagreeingView;
pub use crate::search::footprint_shift::FootprintShift;
pub use crate::search::levels::{LevelGain, OtherLevel};
pub use inspect::{InspectedPair, InspectedView, Inspection, inspect};
pub use layer_shift::{LayerShift, LevelOff};
pub use rays::Rays;
pub use solution::{Doubts, EpochRecord, Reason, Solution, SolvedHeight};
pub use solve::{Former, Kept, Problem, Solving, ViewInput, first_selection, solve};
