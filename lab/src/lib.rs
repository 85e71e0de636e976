//! Measures sizeup: baselines, and benchmarks that run every method on scenes with known truth.
//!
//! The binary `sizeup-lab` is its command line. Scenes and comparisons with the truth are in [`sizeup_truth`], as the
//! program itself has `sizeup demo` and `sizeup evaluate`.

pub mod baseline;
pub mod benchmark;
pub mod cli;
