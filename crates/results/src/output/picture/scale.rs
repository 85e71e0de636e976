//! Round numbers for axes, legends and scale bars.

/// The largest of 1, 2, 5 × 10ⁿ that is at most `value` (> 0).
pub fn round_down(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    let lead = [5.0, 2.0, 1.0].into_iter().find(|lead| lead * power <= value * (1.0 + 1e-9)).unwrap_or(1.0);
    lead * power
}

/// Ticks at round steps within `[low, high]`, about `n` of them.
pub fn ticks(low: f64, high: f64, n: usize) -> Vec<f64> {
    let step = step(low, high, n);
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last).map(|i| i as f64 * step).collect()
}

/// The round step of [`ticks`]: the smallest of 1, 2, 2.5, 5 × 10ⁿ that gives at most a quarter more than `n`.
pub fn step(low: f64, high: f64, n: usize) -> f64 {
    let wished = 0.8 * (high - low).max(f64::MIN_POSITIVE) / n.max(1) as f64;
    let power = 10_f64.powf(wished.log10().floor());
    let lead = [1.0, 2.0, 2.5, 5.0].into_iter().find(|lead| lead * power >= wished * (1.0 - 1e-9));
    lead.unwrap_or(10.0) * power
}

/// A tick's label with as many decimals as its step needs.
pub fn label(value: f64, step: f64) -> String {
    let decimals = (0..6).find(|d| ((step * 10_f64.powi(*d)).fract() - 0.5).abs() > 0.499_999).unwrap_or(6);
    format!("{value:.*}", decimals as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round() {
        assert_eq!(ticks(0.0, 20.0, 5), [0.0, 5.0, 10.0, 15.0, 20.0]);
        assert_eq!(round_down(730.0), 500.0);
        assert_eq!(round_down(0.02), 0.02);
        assert_eq!((label(2.5, 2.5), label(5.0, 5.0), label(0.25, 0.05)), ("2.5".into(), "5".into(), "0.25".into()));
    }
}
