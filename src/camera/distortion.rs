//! Lens distortion in normalised image coordinates, and its inverse.
//!
//! Brown-Conrady in OpenCV's order, with `r² = x² + y²`:
//!
//! ```text
//! x_d = x·(1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²)
//! y_d = y·(1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2y²) + 2 p2 x y
//! ```

use glam::{DMat2, DVec2};
use serde::{Deserialize, Serialize};

/// Newton steps of the inverse: it converges quadratically, six suffice in every valid domain.
const MAX_NEWTON_STEPS: usize = 20;
/// Residual at which the inverse is exact for our purposes (1e-12 of the focal length).
const CONVERGED: f64 = 1e-12;

/// A lens model. `distort` maps ideal to observed normalised coordinates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "model")]
pub enum Distortion {
    /// An ideal pinhole.
    None,
    /// Radial and tangential, `OpenCV`'s order and signs.
    Brown {
        /// Radial, r².
        k1: f64,
        /// Radial, r⁴.
        k2: f64,
        /// Radial, r⁶.
        k3: f64,
        /// Tangential, first of `OpenCV`.
        p1: f64,
        /// Tangential, second of `OpenCV`.
        p2: f64,
    },
}

impl Distortion {
    /// The coefficients with their names.
    pub fn coefficients(&self) -> impl Iterator<Item = (&'static str, f64)> + use<> {
        match *self {
            Self::None => Vec::new(),
            Self::Brown { k1, k2, k3, p1, p2 } => vec![("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)],
        }
        .into_iter()
    }

    /// Observed position of an ideal one, or `None` beyond the radius where the polynomial folds back.
    #[must_use]
    pub fn distort(&self, ideal: DVec2) -> Option<DVec2> {
        let (distorted, jacobian) = self.distort_with_jacobian(ideal);
        self.is_valid_at(ideal, jacobian).then_some(distorted)
    }

    /// Ideal position of an observed one, by Newton's method; `None` where no valid one exists.
    #[must_use]
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        if matches!(self, Self::None) {
            return Some(distorted);
        }
        let mut ideal = distorted;
        for _ in 0..MAX_NEWTON_STEPS {
            let (value, jacobian) = self.distort_with_jacobian(ideal);
            let residual = value - distorted;
            if residual.length() < CONVERGED {
                return self.is_valid_at(ideal, jacobian).then_some(ideal);
            }
            if jacobian.determinant().abs() < 1e-9 {
                return None;
            }
            ideal -= jacobian.inverse() * residual;
        }
        None
    }

    fn distort_with_jacobian(&self, DVec2 { x, y }: DVec2) -> (DVec2, DMat2) {
        match *self {
            Self::None => (DVec2::new(x, y), DMat2::IDENTITY),
            Self::Brown { k1, k2, k3, p1, p2 } => {
                let r2 = x * x + y * y;
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                let d_radial = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3); // by r²
                let value = DVec2::new(
                    x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                    y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
                );
                let cross = 2.0 * x * y * d_radial + 2.0 * p1 * x + 2.0 * p2 * y;
                let dx = DVec2::new(radial + 2.0 * x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x, cross);
                let dy = DVec2::new(cross, radial + 2.0 * y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x);
                (value, DMat2::from_cols(dx, dy))
            }
        }
    }

    /// The model is one-to-one from the centre out to here: locally by the Jacobian's sign, and along the radius
    /// because a polynomial that has folded back and forth again would fool the sign alone.
    fn is_valid_at(&self, ideal: DVec2, jacobian: DMat2) -> bool {
        const RADIAL_CHECKS: usize = 8;
        if matches!(self, Self::None) {
            return true;
        }
        jacobian.determinant() > 0.0
            && (1..RADIAL_CHECKS).all(|i| {
                let (_, inner) = self.distort_with_jacobian(ideal * (i as f64 / RADIAL_CHECKS as f64));
                inner.determinant() > 0.0
            })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WARSAW_LIKE: Distortion = Distortion::Brown { k1: -0.0445, k2: 0.0188, k3: 0.0, p1: 5.96e-4, p2: 4.9e-5 };

    proptest! {
        #[test]
        fn undistort_inverts_distort(x in -0.9..0.9_f64, y in -0.7..0.7_f64) {
            let ideal = DVec2::new(x, y);
            let back = WARSAW_LIKE.undistort(WARSAW_LIKE.distort(ideal).unwrap()).unwrap();
            prop_assert!((back - ideal).length() < 1e-10);
        }

        #[test]
        fn the_jacobian_is_the_derivative(x in -0.9..0.9_f64, y in -0.7..0.7_f64) {
            let (at, h) = (DVec2::new(x, y), 1e-6);
            let (_, jacobian) = WARSAW_LIKE.distort_with_jacobian(at);
            for axis in [DVec2::X, DVec2::Y] {
                let difference = (WARSAW_LIKE.distort_with_jacobian(at + h * axis).0
                    - WARSAW_LIKE.distort_with_jacobian(at - h * axis).0) / (2.0 * h);
                prop_assert!((jacobian * axis - difference).length() < 1e-8);
            }
        }
    }

    #[test]
    fn beyond_the_fold_there_is_no_pixel() {
        let barrel = Distortion::Brown { k1: -0.3, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        // x·(1 − 0.3 x²) peaks at x = 1/√0.9 = 1.054.
        assert!(barrel.distort(DVec2::new(1.04, 0.0)).is_some());
        assert!(barrel.distort(DVec2::new(1.07, 0.0)).is_none());
        assert!(barrel.undistort(DVec2::new(0.75, 0.0)).is_none());
    }
}
