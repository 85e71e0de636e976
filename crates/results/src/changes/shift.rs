//! What all buildings have in common: two flights whose poses differ by a little, and stated sigmas that are too small.
//!
//! ```text
//! shift   median of d over matched pairs, without those farther than 3 s from it      σ_shift = 1.2533 s / √n
//! s       1.4826 · median |d − shift|, again over those within                        (a normal distribution's σ)
//! spread  the same s of (d − shift) / σ: 1 where the stated sigmas are right
//! ```
//!
//! A shift is taken off where it is more than three of its own sigmas and more than two centimetres. It stands for the
//! flights, not for the town, as long as most buildings have not changed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sizeup_heights::stats::{SIGMA_PER_MAD, STANDARD_ERROR_OF_MEDIAN, median};

/// Fewer pairs say nothing of what is common to all.
const MIN_PAIRS: usize = 10;
/// Sigmas from the middle beyond which values are left out, and its own sigmas that a shift must exceed.
const N_SIGMAS: f64 = 3.0;
/// The least shift that is taken off, metres: results keep millimetres, and nobody flies to centimetres.
const LEAST_M: f64 = 0.02;
/// After these the middle and its spread have settled.
const N_ROUNDS: usize = 8;

/// A shift that is common to all buildings; metres.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Shift {
    /// Median of the new values less the old ones, metres.
    pub value_m: f64,
    /// One standard deviation of it.
    pub sigma_m: f64,
    /// Pairs of buildings that it comes from; 0: too few to tell, and none is assumed.
    pub n_pairs: usize,
    /// Whether it was taken off before buildings were compared.
    pub is_taken_off: bool,
}

/// Whether a common shift is taken off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShiftRule {
    /// Where it is significant.
    #[default]
    TakeOff,
    /// Never: it is reported only.
    Keep,
}

impl Shift {
    /// Shift of differences between matched buildings, metres.
    #[must_use]
    pub fn of(differences_m: &[f64], rule: ShiftRule) -> Self {
        let Some(Middle { value, spread, n }) = middle(differences_m) else { return Self::default() };
        let sigma_m = STANDARD_ERROR_OF_MEDIAN * spread / (n as f64).sqrt();
        let is_significant = value.abs() > LEAST_M.max(N_SIGMAS * sigma_m);
        Self { value_m: value, sigma_m, n_pairs: n, is_taken_off: is_significant && rule == ShiftRule::TakeOff }
    }

    /// Shift that is taken off, metres.
    #[must_use]
    pub fn taken_m(&self) -> f64 {
        if self.is_taken_off { self.value_m } else { 0.0 }
    }

    /// The standard deviation that it adds to a difference, metres.
    #[must_use]
    pub fn added_sigma_m(&self) -> f64 {
        if self.is_taken_off { self.sigma_m } else { 0.0 }
    }
}

/// By how much differences scatter more than their sigmas say, 1 or more; `None` for too few pairs. `normalised`:
/// differences in sigmas.
#[must_use]
pub fn spread(normalised: &[f64]) -> Option<f64> {
    middle(normalised).map(|found| found.spread)
}

/// Middle of most values.
struct Middle {
    value: f64,
    spread: f64,
    n: usize,
}

fn middle(values: &[f64]) -> Option<Middle> {
    let mut within: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let mut found = median_and_spread(&within)?;
    for _ in 0..N_ROUNDS {
        let (n_before, (value, spread)) = (within.len(), found);
        within.retain(|v| (v - value).abs() <= N_SIGMAS * spread);
        if within.len() == n_before {
            break;
        }
        found = median_and_spread(&within)?;
    }
    let (value, spread) = found;
    (within.len() >= MIN_PAIRS).then_some(Middle { value, spread, n: within.len() })
}

fn median_and_spread(values: &[f64]) -> Option<(f64, f64)> {
    let middle = median(values)?;
    let off: Vec<f64> = values.iter().map(|v| (v - middle).abs()).collect();
    Some((middle, SIGMA_PER_MAD * median(&off)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evenly over the quantiles of a normal distribution, about: the sum of three uniform ones.
    fn around(middle: f64, sigma: f64, n: usize) -> Vec<f64> {
        let uniform = |i: usize, step: usize| ((i * step) % n) as f64 / n as f64 - 0.5;
        (0..n).map(|i| middle + 2.0 * sigma * (uniform(i, 1) + uniform(i, 7) + uniform(i, 31))).collect()
    }

    #[test]
    fn a_shift_is_found_though_a_third_of_the_town_was_raised() {
        let mut town = around(0.4, 0.3, 100);
        town.extend(around(5.4, 0.3, 50));
        let shift = Shift::of(&town, ShiftRule::TakeOff);
        assert!((shift.value_m - 0.4).abs() < 0.1 && shift.is_taken_off && shift.sigma_m < 0.06, "{shift:?}");
        assert_eq!(Shift::of(&town, ShiftRule::Keep).taken_m(), 0.0);
    }

    #[test]
    fn chance_is_no_shift_and_few_buildings_say_nothing() {
        let chance = Shift::of(&around(0.01, 0.3, 100), ShiftRule::TakeOff);
        assert!(!chance.is_taken_off && chance.n_pairs >= 95, "{chance:?}");
        assert_eq!(Shift::of(&around(3.0, 0.1, 9), ShiftRule::TakeOff), Shift::default());
    }

    #[test]
    fn sigmas_that_are_too_small_show_in_the_spread() {
        for factor in [1.0, 2.5] {
            let mut normalised = around(0.0, factor, 200);
            normalised.extend([30.0; 20]);
            let found = spread(&normalised).unwrap();
            assert!((found / factor - 1.0).abs() < 0.15, "{factor}: {found}");
        }
    }
}
