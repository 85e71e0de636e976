//! Heights from ordering: view selection, evidence, and one of two solvers, looped until the epochs are done.
//!
//! - `paper`: the pairwise ordinal hinge of [`crate::ordinal`], its derivative and Adam (`SiZeUp`, "Objective
//!   function").
//! - `robust`: the local search of one height at a time; see `search` and `score`.
//!
//! Input is a [`Problem`]: a scene, placed views and a way to load a view's prior. Only the priors of selected views are
//! loaded. Results do not depend on the number of threads.

mod adam;
mod bleed;
mod calibrate;
mod config;
mod disagreeing;
mod empty_space;
mod evidence;
mod footprint_shift;
mod formed;
mod gradient;
mod inspect;
mod intervals;
mod layer_shift;
mod levels;
mod ordinal;
mod peak;
mod pitched;
mod planes;
mod rays;
mod regression;
mod roof;
mod schedule;
mod score;
mod search;
mod shift;
mod solution;
mod solve;
mod stepped;
mod straighten;
mod two_levels;
mod unmodelled;
mod vegetation;
mod wings;

pub use config::{
    CalibrationRays, Gradient, Loss, MadGradient, OptimiseConfig, OrdinalConfig, Preset, Region, SearchConfig, StepOn,
};
pub use disagreeing::DisagreeingView;
pub use footprint_shift::FootprintShift;
pub use inspect::{InspectedPair, InspectedView, Inspection, inspect};
pub use layer_shift::{LayerShift, LevelOff};
pub use levels::{LevelGain, OtherLevel};
pub use planes::{RoofPlane, RoofPlanes, Rule};
pub use rays::Rays;
pub use roof::{Roof, Terrace, candidates};
pub use solution::{Doubts, EpochRecord, Reason, Solution, SolvedHeight};
pub use solve::{Former, Kept, Problem, Solving, ViewInput, WithoutPrior, first_selection, solve};
pub use straighten::PriorShape;
