//! Scenes with known truth, and results compared with references.

pub mod evaluate;
pub mod simulate;
