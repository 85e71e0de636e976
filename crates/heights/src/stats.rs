//! Order statistics, each with one stated definition.

/// The `q`-quantile, `0 ≤ q ≤ 1`, linearly interpolated between order statistics (`numpy.percentile`'s default).
/// `NaN`s are left out; `None` when nothing is left.
///
/// ```
/// assert_eq!(sizeup_heights::stats::quantile(&[4.0, 1.0, 3.0, 2.0], 0.5), Some(2.5));
/// ```
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut values: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
    let last = values.len().checked_sub(1)?;
    let position = q.clamp(0.0, 1.0) * last as f64;
    let (_, &mut below, rest) = values.select_nth_unstable_by(position.floor() as usize, f64::total_cmp);
    if position.fract() == 0.0 {
        return Some(below);
    }
    let above = rest.iter().copied().min_by(f64::total_cmp).unwrap_or(below);
    Some(below + (above - below) * position.fract())
}

/// [`quantile`] of values already in ascending order and free of `NaN`.
#[must_use]
pub fn quantile_of_sorted<T: Copy + Into<f64>>(sorted: &[T], q: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let position = q.clamp(0.0, 1.0) * last as f64;
    let below = position.floor() as usize;
    let above = position.ceil() as usize;
    let [low, high]: [f64; 2] = [sorted[below], sorted[above]].map(Into::into);
    Some(low + (high - low) * (position - below as f64))
}

/// The median with the mean of the middle two, or `None` for no values.
#[must_use]
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// The median that is one of the values: the lower middle of an even count (`torch.median`). Reorders `values`,
/// which must not hold `NaN`; `None` if empty.
#[must_use]
pub fn median_low(values: &mut [f32]) -> Option<f32> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Median and median absolute deviation from it, both [`median_low`]; `None` if empty.
#[must_use]
pub fn median_and_mad(values: &[f32]) -> Option<(f32, f32)> {
    let mut work = values.to_vec();
    let median = median_low(&mut work)?;
    for v in &mut work {
        *v = (*v - median).abs();
    }
    Some((median, median_low(&mut work)?))
}

/// A standard deviation per median absolute deviation of a normal distribution.
pub const SIGMA_PER_MAD: f64 = 1.4826;
/// The standard error of a median of normal values, by that of their mean: √(π/2).
pub const STANDARD_ERROR_OF_MEDIAN: f64 = 1.2533;

/// The standard deviation of residuals as their far side shows it (those of 0 and less), where only the near side is
/// heavy: what a model leaves out always stands in front of it. `None` if there is no far side.
#[must_use]
pub fn far_side_sigma(residuals: impl Iterator<Item = f64>) -> Option<f64> {
    let far_side: Vec<f64> = residuals.filter(|r| *r <= 0.0).map(f64::abs).collect();
    Some(SIGMA_PER_MAD * median(&far_side)?)
}

/// Tukey's biweight of a residual, 1 at 0 and 0 from the cut-off on; `cut_off` in standard deviations, on the near side
/// (positive residuals) and on the far side.
///
/// ```
/// use sizeup_heights::stats::biweight;
/// assert_eq!(biweight(0.0, 2.0, [3.0, 4.7]), 1.0);
/// assert_eq!(biweight(6.0, 2.0, [3.0, 4.7]), 0.0);
/// assert!(biweight(-6.0, 2.0, [3.0, 4.7]) > 0.3);
/// ```
#[must_use]
pub fn biweight(residual: f64, sigma: f64, [near, far]: [f64; 2]) -> f64 {
    let u = residual / (sigma * if residual > 0.0 { near } else { far });
    (1.0 - u * u).max(0.0).powi(2)
}

/// Arithmetic mean, or `None` for no values.
#[must_use]
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The place between three evenly spaced ones where the parabola through their values peaks, at most one spacing from
/// the middle; the middle itself if they have no peak.
#[must_use]
pub fn parabola_peak(middle: f64, spacing: f64, [before, at, after]: [f64; 3]) -> f64 {
    let curvature = before - 2.0 * at + after;
    if curvature >= 0.0 {
        return middle;
    }
    middle + spacing * (0.5 * (before - after) / curvature).clamp(-1.0, 1.0)
}

/// Standard error of an estimate from its leave-one-out values (jackknife); `None` for fewer than two.
#[must_use]
pub fn jackknife_sigma(leave_one_out: &[f64]) -> Option<f64> {
    let n = leave_one_out.len() as f64;
    let mean = mean(leave_one_out)?;
    let squares: f64 = leave_one_out.iter().map(|h| (h - mean).powi(2)).sum();
    (leave_one_out.len() > 1).then(|| ((n - 1.0) / n * squares).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate_like_numpy() {
        let v = [10.0, 20.0, 30.0, 40.0, f64::NAN];
        assert_eq!(quantile(&v, 0.9), Some(37.0));
        assert_eq!(quantile(&v, 0.0), Some(10.0));
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn the_far_side_tells_the_spread_whatever_stands_in_front() {
        let spread = |in_front: f64| far_side_sigma([-2.0, -1.0, 0.0, 1.0, in_front].into_iter());
        assert_eq!(spread(2.0), Some(SIGMA_PER_MAD));
        assert_eq!(spread(2.0), spread(1e6));
        assert_eq!(far_side_sigma([3.0].into_iter()), None);
    }

    #[test]
    fn mad_takes_the_lower_middle() {
        assert_eq!(median_and_mad(&[1.0, 2.0, 4.0, 9.0]), Some((2.0, 1.0)));
    }
}
