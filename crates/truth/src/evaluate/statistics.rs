//! Height statistics, each with the definition that is printed beside it.

use serde::{Deserialize, Serialize};

use sizeup_heights::stats::{mean, quantile};

/// Meaning of each number of [`HeightStatistics`]: name in files, definition.
pub const DEFINITIONS: [(&str, &str); 14] = [
    ("n", "buildings of the reference with a height of at least the minimum, matched to a building with a height"),
    ("error_mean_m", "mean of e = |h - h*|, metres; h: result, h*: reference, both roof minus ground"),
    ("error_median_m", "median of e, metres"),
    ("error_p90_m", "90th percentile of e, metres; all percentiles interpolate linearly between order statistics"),
    ("error_max_m", "largest e, metres"),
    ("rmse_m", "square root of the mean of e^2, metres"),
    ("bias_m", "mean of h - h*, metres; positive: the result is too high"),
    ("within_1m_share", "share of buildings with e <= 1 m"),
    ("within_10pct_share", "share of buildings with e <= 0.1 h*"),
    ("accuracy_mean", "mean of acc = max(0, 1 - e / h*)"),
    ("accuracy_90", "acc that 90 % of the buildings reach: the 10th percentile of acc"),
    ("n_accuracy_clamped", "buildings with e > h*, whose acc is 0"),
    ("within_1_sigma_share", "share of the buildings with a stated sigma whose e <= sigma (normal errors: 0.68)"),
    ("within_2_sigma_share", "share of the buildings with a stated sigma whose e <= 2 sigma (normal errors: 0.95)"),
];

/// One matched pair of heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightPair {
    /// Height in the result, metres.
    pub height_m: f64,
    /// The reference, metres, above 0.
    pub truth_m: f64,
    /// Stated standard deviation of the result, metres.
    pub sigma_m: Option<f64>,
}

impl HeightPair {
    /// Height in the reference, metres.
    #[must_use]
    pub fn error_m(&self) -> f64 {
        (self.height_m - self.truth_m).abs()
    }
}

/// Statistics over a set of buildings; definitions in [`DEFINITIONS`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeightStatistics {
    /// Number of buildings compared.
    pub n: usize,
    /// Mean absolute error, metres.
    pub error_mean_m: f64,
    /// Median absolute error, metres.
    pub error_median_m: f64,
    /// 90th percentile of the absolute error, metres.
    pub error_p90_m: f64,
    /// Largest absolute error, metres.
    pub error_max_m: f64,
    /// Root mean square error, metres.
    pub rmse_m: f64,
    /// Mean signed error, metres.
    pub bias_m: f64,
    /// Share within one metre.
    pub within_1m_share: f64,
    /// Share within ten per cent.
    pub within_10pct_share: f64,
    /// Mean of `max(0, 1 − e / h*)` over the buildings.
    pub accuracy_mean: f64,
    /// Accuracy that 90 % of the buildings reach.
    pub accuracy_90: f64,
    /// Buildings whose accuracy was clamped to 0.
    pub n_accuracy_clamped: usize,
    /// Buildings with a stated sigma.
    pub n_with_sigma: usize,
    /// Share of those within one sigma; `None` without any.
    pub within_1_sigma_share: Option<f64>,
    /// Share of those within two sigmas; `None` without any.
    pub within_2_sigma_share: Option<f64>,
}

impl HeightStatistics {
    /// Over a set of pairs; `None` for no pairs.
    #[must_use]
    pub fn of(pairs: &[HeightPair]) -> Option<Self> {
        let errors: Vec<f64> = pairs.iter().map(HeightPair::error_m).collect();
        let squares: Vec<f64> = errors.iter().map(|e| e * e).collect();
        let signed: Vec<f64> = pairs.iter().map(|p| p.height_m - p.truth_m).collect();
        let accuracies: Vec<f64> = pairs.iter().map(|p| (1.0 - p.error_m() / p.truth_m).max(0.0)).collect();
        let share =
            |holds: &dyn Fn(&HeightPair) -> bool| pairs.iter().filter(|p| holds(p)).count() as f64 / pairs.len() as f64;
        let n_with_sigma = pairs.iter().filter(|p| p.sigma_m.is_some()).count();
        let within_sigmas = |k: f64| {
            let n = pairs.iter().filter(|p| p.sigma_m.is_some_and(|s| p.error_m() <= k * s)).count();
            (n_with_sigma > 0).then(|| n as f64 / n_with_sigma as f64)
        };
        Some(Self {
            n: pairs.len(),
            error_mean_m: mean(&errors)?,
            error_median_m: quantile(&errors, 0.5)?,
            error_p90_m: quantile(&errors, 0.9)?,
            error_max_m: quantile(&errors, 1.0)?,
            rmse_m: mean(&squares)?.sqrt(),
            bias_m: mean(&signed)?,
            within_1m_share: share(&|p| p.error_m() <= 1.0),
            within_10pct_share: share(&|p| p.error_m() <= 0.1 * p.truth_m),
            accuracy_mean: mean(&accuracies)?,
            accuracy_90: quantile(&accuracies, 0.1)?,
            n_accuracy_clamped: pairs.iter().filter(|p| p.error_m() > p.truth_m).count(),
            n_with_sigma,
            within_1_sigma_share: within_sigmas(1.0),
            within_2_sigma_share: within_sigmas(2.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(height_m: f64, truth_m: f64) -> HeightPair {
        HeightPair { height_m, truth_m, sigma_m: None }
    }

    #[test]
    fn a_hand_computed_case() {
        // errors 1, 2, 0.5, 12; signed +1, -2, +0.5, +12; accuracies 0.9, 0.9, 0.9, 0 (clamped: 12 > 5).
        let s = HeightStatistics::of(&[pair(11.0, 10.0), pair(18.0, 20.0), pair(5.5, 5.0), pair(17.0, 5.0)]).unwrap();
        assert_eq!((s.n, s.n_accuracy_clamped), (4, 1));
        assert_eq!(s.error_mean_m, 15.5 / 4.0);
        assert_eq!(s.error_median_m, 1.5);
        // numpy.percentile([0.5, 1, 2, 12], 90): position 2.7, 2 + 0.7 * 10.
        assert!((s.error_p90_m - 9.0).abs() < 1e-12);
        assert_eq!(s.error_max_m, 12.0);
        assert!((s.rmse_m - ((1.0 + 4.0 + 0.25 + 144.0) / 4.0_f64).sqrt()).abs() < 1e-12);
        assert_eq!(s.bias_m, 11.5 / 4.0);
        assert_eq!((s.within_1m_share, s.within_10pct_share), (0.5, 0.75));
        assert!((s.accuracy_mean - 2.7 / 4.0).abs() < 1e-12);
        // numpy.percentile([0, 0.9, 0.9, 0.9], 10): position 0.3.
        assert!((s.accuracy_90 - 0.27).abs() < 1e-12);
        assert_eq!(s.within_1_sigma_share, None);
    }

    #[test]
    fn sigma_shares_count_only_buildings_with_a_sigma() {
        let with = |height_m: f64, sigma_m: f64| HeightPair { height_m, truth_m: 10.0, sigma_m: Some(sigma_m) };
        let s = HeightStatistics::of(&[with(10.5, 1.0), with(11.5, 1.0), with(13.0, 1.0), pair(10.0, 10.0)]).unwrap();
        assert_eq!(s.n_with_sigma, 3);
        assert_eq!((s.within_1_sigma_share, s.within_2_sigma_share), (Some(1.0 / 3.0), Some(2.0 / 3.0)));
    }

    #[test]
    fn nothing_has_no_statistics() {
        assert_eq!(HeightStatistics::of(&[]), None);
    }
}
