//! The method: from footprints, poses, depth priors and photos to one height per building or part.
//!
//! 1. [`optimise`](crate::optimise) solves the scene with the depth priors.
//! 2. Where the footprint layer as a whole is displaced, the photos are moved onto it and the scene is solved again.
//! 3. Footprints with two roof levels are split and solved again; parts whose heights do not differ are joined.
//! 4. The photos refine each roof, and split footprints that hold several levels ([`photo_consistency`](crate::photo_consistency)).
//! 5. Heights that only their surroundings contradict become doubtful.
//!
//! [`estimate_heights`] takes everything from memory. [`estimate`] takes the same apart: priors and photos that are loaded by need,
//! a given local frame, progress.

mod beside;
mod doubts;
mod parts;
mod refinement;
mod rounds;
mod simple;
mod task;

pub use rounds::{Solver, estimate, estimate_with, move_footprints, view_inputs};
pub use simple::{BuildingHeight, PartHeight, Settings, View, estimate_heights};
pub use task::{
    Building, Heights, LevelEvidence, LocalFrame, MethodSettings, NamedCamera, Part, Photos, Priors, Split, Task,
};
