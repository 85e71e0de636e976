//! The pairwise ordinal loss of one view (`SiZeUp`, "Objective function").
//!
//! ```text
//! D' = (D − median) / (MAD + ε),   R' = (R − median) / (MAD + ε)       over the same pixels
//! l(p, q) = max(0, m − s · (r_q − r_p)),    s = sign(d_q − d_p)
//! L = mean of l over the pairs with |d_q − d_p| ≥ τ_d
//! ```
//!
//! `d`: depth prior `D'`. `r`: rendered depth `R'`. Both are unitless and grow away from the camera. `s` is a label;
//! only `r` carries gradient. The median cancels in `r_q − r_p`. The MAD is held fixed in the gradient unless asked
//! otherwise: the derivative of a sample MAD rests on one pixel and flips its sign at random (Hong, Oper. Res. 57:118, 2009).

use crate::stats;

/// Keeps a flat sample (MAD = 0) from dividing by zero, relative to the median.
pub(crate) const EPSILON: f32 = 1e-6;

/// Place of `q` relative to `p` by the prior, as seen from the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthOrder {
    /// `q` is closer to the camera than `p`.
    Nearer,
    /// `q` is further from the camera than `p`.
    Farther,
}

impl DepthOrder {
    /// Label of a pair, or `None` if the prior contrast `|d_q − d_p|` stays below `min_contrast > 0` (the paper's
    /// `τ_d`): such a pair has no vote.
    #[must_use]
    pub fn from_prior(d_p: f32, d_q: f32, min_contrast: f32) -> Option<Self> {
        let contrast = d_q - d_p;
        if contrast >= min_contrast {
            Some(Self::Farther)
        } else if contrast <= -min_contrast {
            Some(Self::Nearer)
        } else {
            None // weak, or NaN where the prior has no value
        }
    }

    /// `s` of the formula.
    #[must_use]
    pub fn sign(self) -> f32 {
        match self {
            Self::Nearer => -1.0,
            Self::Farther => 1.0,
        }
    }

    /// Cost of a pair whose rendered contrast is `r_q − r_p`.
    ///
    /// ```
    /// use sizeup_heights::ordinal::DepthOrder;
    /// assert_eq!(DepthOrder::Farther.cost(0.8, 0.5), 0.0);
    /// assert_eq!(DepthOrder::Farther.cost(-0.2, 0.5), 0.7);
    /// ```
    #[must_use]
    pub fn cost(self, rendered_contrast: f32, margin: f32) -> f32 {
        (margin - self.sign() * rendered_contrast).max(0.0)
    }
}

/// Brings the depths of one view to a scale of their own: `(x − median) / (MAD + ε)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normaliser {
    /// Median of the sample.
    pub median: f32,
    /// `MAD + ε` of the sample.
    pub scale: f32,
}

impl Normaliser {
    /// From the values over a view's pixels; `None` for no values.
    #[must_use]
    pub fn from_values(values: &[f32]) -> Option<Self> {
        let (median, mad) = stats::median_and_mad(values)?;
        Some(Self { median, scale: mad + EPSILON * median.abs().max(f32::MIN_POSITIVE) })
    }

    /// The value less the median, in units of the scale.
    #[must_use]
    pub fn apply(&self, value: f32) -> f32 {
        (value - self.median) / self.scale
    }

    /// The normalised difference of two values: the median cancels.
    #[must_use]
    pub fn contrast(&self, from: f32, to: f32) -> f32 {
        (to - from) / self.scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weak_and_missing_contrasts_have_no_vote() {
        assert_eq!(DepthOrder::from_prior(1.0, 1.04, 0.05), None);
        assert_eq!(DepthOrder::from_prior(1.0, f32::NAN, 0.05), None);
        assert_eq!(DepthOrder::from_prior(1.0, 1.05, 0.04), Some(DepthOrder::Farther));
        assert_eq!(DepthOrder::from_prior(1.0, 0.5, 0.05), Some(DepthOrder::Nearer));
    }

    #[test]
    fn reversed_pair_costs_margin_plus_gap() {
        assert_eq!(DepthOrder::Nearer.cost(0.3, 0.5), 0.8);
        assert_eq!(DepthOrder::Nearer.cost(-0.5, 0.5), 0.0);
    }

    #[test]
    fn the_slope_is_the_central_difference_away_from_the_kink() {
        let (order, margin, delta) = (DepthOrder::Farther, 0.5, 1e-3);
        for contrast in [-1.0, 0.2, 0.9_f32] {
            let slope = (order.cost(contrast + delta, margin) - order.cost(contrast - delta, margin)) / (2.0 * delta);
            let expected = if contrast < margin { -1.0 } else { 0.0 };
            assert!((slope - expected).abs() < 1e-3, "{slope} at {contrast}");
        }
    }

    #[test]
    fn a_flat_sample_does_not_divide_by_zero() {
        let flat = Normaliser::from_values(&[7.0; 9]).unwrap();
        assert_eq!(flat.apply(7.0), 0.0);
        assert!(flat.apply(8.0).is_finite());
        assert!(Normaliser::from_values(&[0.0; 3]).unwrap().apply(0.0).is_finite());
    }
}
