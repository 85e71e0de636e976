//! A view's prior brought to metres, by the ground and the buildings as they stand.
//!
//! ```text
//! p ≈ a + d · v        p: prior's inverse depth,  v = 1 / R: rendered inverse depth for the present heights
//! ```
//!
//! What the scene does not model (trees, cars, buildings without a footprint) is always *nearer* than what is rendered in
//! its place, so residuals have one heavy side. The fit is re-weighted by Tukey's biweight with the spread measured on
//! the other side, which drives it to the far envelope: the ground. No terms in image position are fitted: on level
//! ground `1/R` is itself affine in them, and the fit would collapse.
//!
//! Where one end of the photo shows nothing but what the scene does not have, the line tilts towards it all the same. Depth in
//! metres, as stereo's, is therefore taken as it is.

use crate::config::CalibrationRays;
use crate::evidence::Evidence;
use crate::render::profile::Stops;
use crate::stats;

/// Rounds of re-weighting; the weights settle within ten.
pub(crate) const ROUNDS: usize = 12;
/// A round that moves the line by less than this share of the residuals' standard deviation anywhere is the last.
const SETTLED: f64 = 0.01;
/// Rays that a line is fitted to, about: evenly spaced ones of all that can be used.
const N_SAMPLES: usize = 1500;
/// Rays below which a view cannot be calibrated.
const MIN_RAYS: usize = 50;
/// Fewer rays on the ground than this do not do without those on buildings.
const MIN_GROUND_RAYS: usize = 200;
/// Cut-off of the biweight in standard deviations, on the near side and on the far side.
pub(crate) const CUT_OFF: [f64; 2] = [3.0, 4.7];

/// Mapping of a view's prior to inverse depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    offset: f64,
    gain: f64,
    /// Whether the prior is in metres of itself, and nothing had to be fitted.
    pub(crate) is_in_metres: bool,
}

impl Calibration {
    /// The line of priors that are inverse depths in 1/m as they are.
    pub(crate) const IN_METRES: Self = Self { offset: 0.0, gain: 1.0, is_in_metres: true };

    /// Fits a view with every roof where it is now; `None` where there is too little to go by, or where the prior
    /// falls towards the camera.
    #[must_use]
    pub fn fit(evidence: &Evidence<'_>, stops: &Stops, rays: CalibrationRays) -> Option<Self> {
        let (samples, n) = samples(evidence, stops, rays);
        if n < MIN_RAYS {
            return None;
        }
        robust_line(&samples).filter(|line| line.gain > 0.0)
    }

    pub(crate) fn gain(&self) -> f64 {
        self.gain
    }

    pub(crate) fn offset(&self) -> f64 {
        self.offset
    }

    /// Residual of a sample: its prior less the line's.
    pub(crate) fn residual(&self, &(v, p): &(f64, f64)) -> f64 {
        p - self.offset - self.gain * v
    }

    /// Inverse depth, 1/m, that a prior value stands for.
    #[must_use]
    pub fn inverse_depth(&self, prior: f32) -> f32 {
        ((f64::from(prior) - self.offset) / self.gain) as f32
    }
}

/// Rendered inverse depth and prior of evenly spaced ones of a view's rays, and how many can be used in all.
fn samples(evidence: &Evidence<'_>, stops: &Stops, rays: CalibrationRays) -> (Vec<(f64, f64)>, usize) {
    let is_on_anything = |ray: &usize| evidence.nearness[*ray].is_finite() && stops.depth(*ray).is_finite();
    let is_ground = |ray: &usize| stops.depth(*ray) >= evidence.profiles.rays[*ray].ground;
    let usable = || (0..evidence.nearness.len()).filter(is_on_anything);
    let n_ground = if rays == CalibrationRays::All { 0 } else { usable().filter(is_ground).count() };
    let needs_all = n_ground < MIN_GROUND_RAYS;
    let n = if needs_all { usable().count() } else { n_ground };
    let sample = |ray: usize| (f64::from(stops.depth(ray).recip()), f64::from(evidence.nearness[ray]));
    let taken = usable().filter(|ray| needs_all || is_ground(ray)).step_by(step(n, N_SAMPLES));
    (taken.map(sample).collect(), n)
}

/// One of so many of `n` samples leaves at most twice `wanted`, and all where there are fewer.
fn step(n: usize, wanted: usize) -> usize {
    (n / wanted).max(1)
}

/// Evenly spaced samples of those given, at most twice `n` of them and all where there are fewer.
pub(crate) fn thinned(samples: Vec<(f64, f64)>, n: usize) -> Vec<(f64, f64)> {
    let step = step(samples.len(), n);
    if step == 1 { samples } else { samples.into_iter().step_by(step).collect() }
}

/// The line through the far envelope of samples `(v, p)`.
pub(crate) fn robust_line(samples: &[(f64, f64)]) -> Option<Calibration> {
    let mut fit = weighted_line(samples, |_| 1.0)?;
    let ends =
        samples.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], (v, _)| [low.min(*v), high.max(*v)]);
    for _ in 0..ROUNDS {
        let sigma = stats::far_side_sigma(samples.iter().map(|sample| fit.residual(sample)))?;
        if sigma <= 0.0 {
            break;
        }
        let before = fit;
        fit = weighted_line(samples, |sample| stats::biweight(before.residual(sample), sigma, CUT_OFF))?;
        if ends.iter().all(|&v| (fit.residual(&(v, 0.0)) - before.residual(&(v, 0.0))).abs() < SETTLED * sigma) {
            break;
        }
    }
    Some(fit)
}

/// The line `p = offset + gain · v` of least weighted squares.
pub(crate) fn weighted_line(samples: &[(f64, f64)], weight: impl Fn(&(f64, f64)) -> f64) -> Option<Calibration> {
    let (mut w, mut wv, mut wp) = (0.0, 0.0, 0.0);
    let weights: Vec<f64> = samples.iter().map(weight).collect();
    for (&(v, p), &k) in samples.iter().zip(&weights) {
        w += k;
        wv += k * v;
        wp += k * p;
    }
    let (mean_v, mean_p) = (wv / w, wp / w);
    let (mut vv, mut vp) = (0.0, 0.0);
    for (&(v, p), &k) in samples.iter().zip(&weights) {
        vv += k * (v - mean_v) * (v - mean_v);
        vp += k * (v - mean_v) * (p - mean_p);
    }
    let gain = vp / vv;
    gain.is_finite().then_some(Calibration { offset: mean_p - gain * mean_v, gain, is_in_metres: false })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_through_exact_samples_is_found_whatever_the_weights() {
        let samples: Vec<_> = (0..20).map(|i| (0.01 * f64::from(i), 3.0 + 0.5 * 0.01 * f64::from(i))).collect();
        let line = weighted_line(&samples, |s| 1.0 + s.0).unwrap();
        assert!((line.offset - 3.0).abs() < 1e-12 && (line.gain - 0.5).abs() < 1e-12);
    }
}
