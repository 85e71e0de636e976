//! What is quick and simple: yardsticks that a method has to beat.
//!
//! | name | from | gives |
//! |---|---|---|
//! | [`metric_lift`] | priors, calibrated on free ground | one height per footprint |
//! | [`regression`] | priors, normalised; the `paper` preset's optimiser | one height per footprint |
//! | [`constant`], [`neighbourhood`] | nothing, or known heights nearby | one height per footprint |
//! | [`percentile`] | a point cloud | one height per footprint |
//! | [`convex_hull`], [`stacked_prisms`] | a point cloud | a body per footprint |
//!
//! Those that give one height per footprint take the optimiser's [`Problem`](sizeup_heights::optimise::Problem) and answer with its
//! [`Solution`], so that the pipeline can run them in its place and write the same results.

mod curve;
mod hull;
mod known;
mod lift;
mod points;
mod regression;
mod slabs;

pub use hull::{HullError, convex_hull};
pub use known::{constant, neighbourhood};
pub use lift::{LiftConfig, metric_lift};
pub use points::{SegmentedCloud, percentile};
pub use regression::{Norm, regression};
pub use slabs::{Slab, SlabConfig, stacked_prisms};

use sizeup_heights::optimise::{Reason, Solution, SolvedHeight};

/// A solution without views; `None` = no height. Heights with a `doubt` are never called measured.
fn without_views(heights_m: Vec<Option<f64>>, doubt: Option<Reason>) -> Solution {
    let solved = |height_m: Option<f64>| SolvedHeight {
        height_m,
        reasons: if height_m.is_none() { vec![Reason::SeenByNoView] } else { doubt.into_iter().collect() },
        ..SolvedHeight::default()
    };
    Solution { heights: heights_m.into_iter().map(solved).collect(), ..Solution::default() }
}
