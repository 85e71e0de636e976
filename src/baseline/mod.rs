//! What is quick and simple: yardsticks that a method has to beat.
//!
//! | name | from | gives |
//! |---|---|---|
//! | [`metric_lift`] | priors, calibrated on free ground | one height per outline |
//!
//! Those that give one height per outline take the optimiser's [`Problem`](crate::optimise::Problem) and answer with its
//! [`Solution`](crate::optimise::Solution), so that the pipeline can run them in its place and write the same results.

mod curve;
mod lift;

pub use lift::{LiftConfig, metric_lift};
