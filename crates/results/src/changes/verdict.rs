//! Whether a difference is one, against what two sigmas explain.
//!
//! ```text
//! changed   |d| >= n σ         and  |d| + 1.645 σ >= least
//! same      |d| + 1.645 σ < least
//! unsure    otherwise
//! ```
//!
//! `d`: new minus old; `σ² = σ_old² + σ_new² + σ_shift²`; `n`: 3 by default, which a building that has not changed reaches
//! three times in a thousand where errors are normal. A building is `same` only where a change of `least` would have looked
//! larger nineteen times out of twenty (one-sided): a wide sigma makes it `unsure`, never `same`. A change needs not be
//! measured as `least` in full: what is 2 m is measured as less every second time.

/// Sigmas within which a normal error stays on one side 19 times out of 20.
const ONE_SIDED_95: f64 = 1.645;

/// Verdict on a difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The new one is higher.
    Up,
    /// The new one is lower.
    Down,
    /// Surely less than the least that is worth telling.
    Same,
    /// Neither a change nor none can be excluded.
    Unsure,
}

/// Rules of the decision; see the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecisionRules {
    /// Sigmas that a difference must reach to be a change.
    pub n_sigmas: f64,
    /// The least difference worth telling, metres.
    pub least_m: f64,
}

impl DecisionRules {
    /// Verdict on a difference and its standard deviation, metres.
    #[must_use]
    pub fn verdict(&self, difference_m: f64, sigma_m: f64) -> Verdict {
        let size_m = difference_m.abs();
        if size_m + ONE_SIDED_95 * sigma_m < self.least_m {
            return Verdict::Same;
        }
        match (size_m >= self.n_sigmas * sigma_m, difference_m > 0.0) {
            (false, _) => Verdict::Unsure,
            (true, true) => Verdict::Up,
            (true, false) => Verdict::Down,
        }
    }

    /// Distance that something can reach beyond its old place before it has changed, metres: the least size that [`Self::verdict`]
    /// calls a change.
    #[must_use]
    pub fn reach_m(&self, sigma_m: f64) -> f64 {
        (self.n_sigmas * sigma_m).max(self.least_m - ONE_SIDED_95 * sigma_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DECISION: DecisionRules = DecisionRules { n_sigmas: 3.0, least_m: 2.0 };

    #[test]
    fn a_sharp_measurement_tells_from_the_least_difference_on() {
        for (difference_m, expected) in
            [(2.0, Verdict::Up), (-2.0, Verdict::Down), (1.8, Verdict::Same), (0.0, Verdict::Same)]
        {
            assert_eq!(DECISION.verdict(difference_m, 0.05), expected, "{difference_m}");
        }
    }

    #[test]
    fn a_wide_sigma_is_unsure_and_never_same() {
        assert_eq!(DECISION.verdict(0.0, 1.3), Verdict::Unsure);
        assert_eq!(DECISION.verdict(3.8, 1.3), Verdict::Unsure);
        assert_eq!(DECISION.verdict(-4.0, 1.3), Verdict::Down);
    }

    #[test]
    fn the_reach_is_where_changes_begin() {
        for sigma_m in [0.01, 0.2, 0.4, 0.6, 1.5] {
            let reach_m = DECISION.reach_m(sigma_m);
            assert_eq!(DECISION.verdict(reach_m + 1e-9, sigma_m), Verdict::Up, "{sigma_m}");
            assert_ne!(DECISION.verdict(reach_m - 1e-9, sigma_m), Verdict::Up, "{sigma_m}");
        }
    }
}
