//! A prior whose order holds and whose shape does not, straightened along the ground of its view.
//!
//! ```text
//! p ≈ c(v)      c: rising curve,  v: inverse depth at which the same ray meets the terrain, 1/m
//! p ← c⁻¹(p)    where c is no line
//! ```
//!
//! The score compares how values vary, blind to scale and shift but not to a bend: where a prior is, say, the root of inverse
//! depth, or its rank, the ground itself runs in a curve, and a town of houses is best explained by towers. The poses and the
//! terrain know how the ground runs. As in [`super::calibrate`] what stands on it is *nearer*, so the curve is drawn to the
//! far envelope. It has few knots, and takes a drift of the prior along the way into the photo with it; where it fits hardly
//! better than a line, nothing is done. Nor is it where fewer than half of the photos run in a curve: a network bends all its maps
//! alike, and what concerns single ones is drift, which one view's rows do not tell from a bend. Buildings have no part in it.

use super::calibrate::{CUT_OFF, ROUNDS, robust_line};
use super::evidence::Evidence;
use crate::stats;

/// Knots of the curve, each the ground of as many rays.
const N_KNOTS: usize = 12;
/// Rays below which a view's ground tells nothing of a curve.
const MIN_RAYS: usize = 600;
/// A curve is taken where it leaves less than this share of what a line leaves.
const MUCH_LESS: f64 = 0.5;
/// A curve that strays by less than this share of its rise from a line (root of the mean square at the knots) is one. The
/// square and the square root stray by 0.07; a slow drift of a quarter of the values' spread, which a curve would mistake for a
/// bend, by 0.04.
const MIN_BEND: f64 = 0.05;

/// Whether priors bend as their network, or their file format, bends them: in at least half of the photos, of which there are some.
pub(super) fn are_bent(curves: &[Option<&GroundCurve>]) -> bool {
    let n_bent = curves.iter().flatten().count();
    2 * n_bent >= curves.len()
}

/// A rising polyline from inverse depth to the prior's values, with straight ends.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundCurve {
    /// Inverse depth, 1/m, and prior; both rise.
    knots: Vec<(f64, f64)>,
}

impl GroundCurve {
    /// The curve in which a view's prior runs along its ground; `None` where it runs straight, or where the photo shows too little
    /// ground to tell.
    #[must_use]
    pub fn along_ground(evidence: &Evidence<'_>) -> Option<Self> {
        let rays = evidence.profiles.rays.iter().zip(&evidence.nearness);
        let samples = rays.map(|(ray, &nearness)| (f64::from(ray.ground.recip()), f64::from(nearness)));
        Self::fit(samples.filter(|(v, p)| v.is_finite() && *v > 0.0 && p.is_finite()).collect())
    }

    /// Through the far envelope of (inverse depth of the ground, prior), where that is a bent line.
    fn fit(mut samples: Vec<(f64, f64)>) -> Option<Self> {
        if samples.len() < MIN_RAYS {
            return None;
        }
        let line = robust_line(&samples)?;
        let left_by_line = stats::far_side_sigma(samples.iter().map(|s| line.residual(s)))?;

        samples.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let bins: Vec<&[(f64, f64)]> = samples.chunks(samples.len().div_ceil(N_KNOTS)).collect();
        let mut curve = Self { knots: bins.iter().map(|bin| middle(bin)).collect() };
        for _ in 0..ROUNDS {
            let sigma = stats::far_side_sigma(samples.iter().map(|s| curve.residual(s)))?;
            if sigma <= 0.0 {
                break;
            }
            let shifts: Vec<f64> = bins.iter().map(|bin| curve.shift(bin, sigma)).collect();
            curve.knots.iter_mut().zip(shifts).for_each(|(knot, shift)| knot.1 += shift);
        }
        let left = stats::far_side_sigma(samples.iter().map(|s| curve.residual(s)))?;
        let rises = curve.knots.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 < pair[1].1);
        (rises && left < MUCH_LESS * left_by_line && curve.bend()? > MIN_BEND).then_some(curve)
    }

    /// The weighted mean of what the curve leaves of a bin.
    fn shift(&self, bin: &[(f64, f64)], sigma: f64) -> f64 {
        let (mut weights, mut sum) = (0.0, 0.0);
        for residual in bin.iter().map(|sample| self.residual(sample)) {
            let weight = stats::biweight(residual, sigma, CUT_OFF);
            weights += weight;
            sum += weight * residual;
        }
        if weights > 0.0 { sum / weights } else { 0.0 }
    }

    fn residual(&self, &(v, p): &(f64, f64)) -> f64 {
        p - interpolate(&self.knots, v, |knot| *knot)
    }

    /// Inverse depth, 1/m, at which the curve has a value.
    #[must_use]
    pub fn inverse_depth(&self, prior: f64) -> f64 {
        interpolate(&self.knots, prior, |&(v, p)| (p, v))
    }

    /// Root of the mean squared distance of the knots from the line through them, as a share of the curve's rise.
    fn bend(&self) -> Option<f64> {
        let line = robust_line(&self.knots)?;
        let squares: Vec<f64> = self.knots.iter().map(|knot| line.residual(knot).powi(2)).collect();
        let rise = self.knots.last()?.1 - self.knots.first()?.1;
        Some(stats::mean(&squares)?.sqrt() / rise)
    }
}

/// Mean inverse depth and median prior of a bin.
fn middle(bin: &[(f64, f64)]) -> (f64, f64) {
    let v: Vec<f64> = bin.iter().map(|s| s.0).collect();
    let p: Vec<f64> = bin.iter().map(|s| s.1).collect();
    (stats::mean(&v).unwrap_or(f64::NAN), stats::median(&p).unwrap_or(f64::NAN))
}

/// A polyline at `x`, its ends prolonged; `axes` says which of a knot's numbers is x and which is the value.
fn interpolate(knots: &[(f64, f64)], x: f64, axes: impl Fn(&(f64, f64)) -> (f64, f64)) -> f64 {
    let after = knots.partition_point(|knot| axes(knot).0 <= x).clamp(1, knots.len() - 1);
    let ((x0, y0), (x1, y1)) = (axes(&knots[after - 1]), axes(&knots[after]));
    y0 + (x - x0) / (x1 - x0) * (y1 - y0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ground from 200 to 80 m away, with things up to 15 % nearer on a third of it, as a prior sees it.
    fn samples(prior: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        let of = |i: usize| {
            let v = 1.0 / 200.0 + (1.0 / 80.0 - 1.0 / 200.0) * (i % 997) as f64 / 996.0;
            let stands = i.is_multiple_of(3);
            let nearer = if stands { 1.0 + 0.15 * (i % 7) as f64 / 6.0 } else { 1.0 };
            (v, prior(v * nearer))
        };
        (0..9000).map(of).collect()
    }

    #[test]
    fn a_root_and_a_cube_come_out_straight() {
        for power in [0.33, 3.0] {
            let curve = GroundCurve::fit(samples(|v| 7.0 * (v - 0.0049).powf(power) - 2.0)).unwrap();
            for v in [1.0 / 180.0, 1.0 / 140.0, 1.0 / 100.0, 1.0 / 85.0] {
                let found = curve.inverse_depth(7.0 * (v - 0.0049_f64).powf(power) - 2.0);
                assert!((found - v).abs() < 0.02 * v, "power {power}: {found} is not {v}");
            }
        }
    }

    #[test]
    fn a_line_is_left_alone_whatever_stands_on_the_ground() {
        assert_eq!(GroundCurve::fit(samples(|v| 7.0 * v - 2.0)), None);
    }

    #[test]
    fn noise_makes_no_curve_and_hides_a_slight_one() {
        let noise = |v: f64| 1e-3 * (v * 1e7).sin();
        assert_eq!(GroundCurve::fit(samples(|v| v + noise(v))), None);
        assert_eq!(GroundCurve::fit(samples(|v| v.powf(1.2) + noise(v))), None);
    }

    #[test]
    fn a_prior_that_falls_towards_the_camera_is_not_turned_round() {
        assert_eq!(GroundCurve::fit(samples(|v| -v.sqrt())), None);
    }
}
