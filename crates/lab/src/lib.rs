//! What measures sizeup: scenes with known truth, results compared with references, and yardsticks.

pub mod baseline;
pub mod evaluate;
pub mod simulate;
