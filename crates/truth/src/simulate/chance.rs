//! Draws that the `rand` crate leaves to others.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// A standard normal number (Box and Muller, 1958).
pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

/// Uniform between two numbers, `low` itself where they are equal.
pub(super) fn between(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// True with probability `p`.
pub(super) fn happens(rng: &mut ChaCha8Rng, p: f64) -> bool {
    rng.random::<f64>() < p
}
