//! Lens distortion in normalised image coordinates, and its inverse.
//!
//! With `(x, y)` ideal, `r² = x² + y²`:
//!
//! ```text
//! Brown         x_d = x·L(r²) + 2 p1 x y + p2 (r² + 2x²),   L = 1 + k1 r² + k2 r⁴ + k3 r⁶
//!               y_d = y·L(r²) + p1 (r² + 2y²) + 2 p2 x y                               (OpenCV's order and signs)
//! BrownAffine   the same with L + k4 r⁸, then x_d ← x_d + skew·y_d                     (Metashape K4, B2; CAD skew)
//! Rational      L = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)          (OpenCV, COLMAP FULL_OPENCV)
//! Fisheye       θ = atan r,  θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸),  (x_d, y_d) = (x, y)·θ_d / r
//! FisheyeSeries the same with θ_d = θ (1 + k1 θ + k2 θ² + k3 θ³)                         (Pix4D)
//! ```
//!
//! The valid domain is where the model is one-to-one from the centre out; outside it there is no answer.
//! Sources: OpenCV calib3d and fisheye modules; Agisoft Metashape manual, appendix "Camera models" (whose P1 and P2
//! are OpenCV's p2 and p1).

use glam::{DMat2, DVec2};
use serde::{Deserialize, Serialize};

use super::fisheye;

/// Newton steps of the inverse: it converges quadratically, six suffice in every valid domain.
const MAX_NEWTON_STEPS: usize = 30;
/// Residual at which the inverse is exact for our purposes (1e-12 of the focal length).
const CONVERGED: f64 = 1e-12;

/// A lens model. `distort` maps ideal to observed normalised coordinates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "model")]
pub enum Distortion {
    /// An ideal pinhole without distortion.
    None,
    /// Radial and tangential, `OpenCV`'s order and signs.
    Brown {
        /// Radial coefficient of r².
        k1: f64,
        /// Radial coefficient of r⁴.
        k2: f64,
        /// Radial coefficient of r⁶.
        k3: f64,
        /// Tangential, first of `OpenCV`.
        p1: f64,
        /// Tangential, second of `OpenCV`.
        p2: f64,
    },
    /// Brown with one more radial term and a sheared pixel raster.
    BrownAffine {
        /// Radial coefficient of r².
        k1: f64,
        /// Radial coefficient of r⁴.
        k2: f64,
        /// Radial coefficient of r⁶.
        k3: f64,
        /// Radial coefficient of r⁸.
        k4: f64,
        /// Tangential, first of `OpenCV`.
        p1: f64,
        /// Tangential, second of `OpenCV`.
        p2: f64,
        /// Columns per row, in units of `fx`: Metashape's B2 / fx.
        skew: f64,
    },
    /// Rational radial and tangential, `OpenCV`'s order and signs.
    Rational {
        /// Coefficient of r² in the numerator.
        k1: f64,
        /// Coefficient of r⁴ in the numerator.
        k2: f64,
        /// Coefficient of r⁶ in the numerator.
        k3: f64,
        /// Coefficient of r² in the denominator.
        k4: f64,
        /// Coefficient of r⁴ in the denominator.
        k5: f64,
        /// Coefficient of r⁶ in the denominator.
        k6: f64,
        /// Tangential, first of `OpenCV`.
        p1: f64,
        /// Tangential, second of `OpenCV`.
        p2: f64,
    },
    /// Equidistant fisheye with a polynomial in θ (OpenCV's fisheye module).
    Fisheye {
        /// Coefficient of θ³.
        k1: f64,
        /// Coefficient of θ⁵.
        k2: f64,
        /// Coefficient of θ⁷.
        k3: f64,
        /// Coefficient of θ⁹.
        k4: f64,
    },
    /// Equidistant fisheye with all powers of θ (Pix4D).
    FisheyeSeries {
        /// Coefficient of θ².
        k1: f64,
        /// Coefficient of θ³.
        k2: f64,
        /// Coefficient of θ⁴.
        k3: f64,
    },
}

/// The radial factor and its derivative by r².
struct Radial {
    factor: f64,
    by_r2: f64,
}

/// `c0·t + c1·t² + …` and its derivative, Horner from the last.
fn polynomial(t: f64, coefficients: &[f64]) -> (f64, f64) {
    let (value, slope) =
        coefficients.iter().rev().fold((0.0, 0.0), |(value, slope), c| (value * t + c, slope * t + value));
    (value * t, slope * t + value)
}

impl Distortion {
    /// Brown's lens of radial and tangential coefficients, or none where all of them are 0.
    #[must_use]
    pub fn brown([k1, k2, k3]: [f64; 3], [p1, p2]: [f64; 2]) -> Self {
        if [k1, k2, k3, p1, p2].iter().all(|&c| c == 0.0) { Self::None } else { Self::Brown { k1, k2, k3, p1, p2 } }
    }

    /// The coefficients with their names.
    pub fn coefficients(&self) -> impl Iterator<Item = (&'static str, f64)> + use<> {
        match *self {
            Self::None => Vec::new(),
            Self::Brown { k1, k2, k3, p1, p2 } => vec![("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)],
            Self::BrownAffine { k1, k2, k3, k4, p1, p2, skew } => {
                vec![("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4), ("p1", p1), ("p2", p2), ("skew", skew)]
            }
            Self::Rational { k1, k2, k3, k4, k5, k6, p1, p2 } => {
                let radial = [("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4), ("k5", k5), ("k6", k6)];
                radial.into_iter().chain([("p1", p1), ("p2", p2)]).collect()
            }
            Self::Fisheye { k1, k2, k3, k4 } => vec![("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4)],
            Self::FisheyeSeries { k1, k2, k3 } => vec![("k1", k1), ("k2", k2), ("k3", k3)],
        }
        .into_iter()
    }

    /// The polynomial of a fisheye; `None` for the other lenses.
    fn fisheye(&self) -> Option<fisheye::FisheyeCoefficients> {
        match *self {
            Self::Fisheye { k1, k2, k3, k4 } => Some(fisheye::even([k1, k2, k3, k4])),
            Self::FisheyeSeries { k1, k2, k3 } => Some([k1, k2, k3, 0.0, 0.0, 0.0, 0.0, 0.0]),
            _ => None,
        }
    }

    /// Observed position of an ideal one, or `None` beyond the radius where the model folds back.
    #[must_use]
    pub fn distort(&self, ideal: DVec2) -> Option<DVec2> {
        if let Some(series) = self.fisheye() {
            return fisheye::distort(series, ideal);
        }
        let (distorted, jacobian) = self.distort_with_jacobian(ideal);
        self.is_valid_at(ideal, jacobian).then_some(distorted)
    }

    /// Ideal position of an observed one; `None` where no valid one exists.
    #[must_use]
    #[inline]
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        if matches!(self, Self::None) { Some(distorted) } else { self.search_ideal(distorted) }
    }

    /// The same for a lens that distorts, by Newton's method.
    fn search_ideal(&self, distorted: DVec2) -> Option<DVec2> {
        if let Some(series) = self.fisheye() {
            return fisheye::undistort(series, distorted);
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

    fn radial(&self, r2: f64) -> Radial {
        let of = |coefficients: &[f64]| {
            let (value, slope) = polynomial(r2, coefficients);
            Radial { factor: 1.0 + value, by_r2: slope }
        };
        match *self {
            Self::None | Self::Fisheye { .. } | Self::FisheyeSeries { .. } => Radial { factor: 1.0, by_r2: 0.0 },
            Self::Brown { k1, k2, k3, .. } => of(&[k1, k2, k3]),
            Self::BrownAffine { k1, k2, k3, k4, .. } => of(&[k1, k2, k3, k4]),
            Self::Rational { k1, k2, k3, k4, k5, k6, .. } => {
                let (above, below) = (of(&[k1, k2, k3]), of(&[k4, k5, k6]));
                let factor = above.factor / below.factor;
                Radial { factor, by_r2: (above.by_r2 - factor * below.by_r2) / below.factor }
            }
        }
    }

    /// Tangential coefficients in `OpenCV`'s order, and skew.
    fn tangential(&self) -> (f64, f64, f64) {
        match *self {
            Self::None | Self::Fisheye { .. } | Self::FisheyeSeries { .. } => (0.0, 0.0, 0.0),
            Self::Brown { p1, p2, .. } | Self::Rational { p1, p2, .. } => (p1, p2, 0.0),
            Self::BrownAffine { p1, p2, skew, .. } => (p1, p2, skew),
        }
    }

    /// All models but the fisheyes.
    fn distort_with_jacobian(&self, DVec2 { x, y }: DVec2) -> (DVec2, DMat2) {
        let r2 = x * x + y * y;
        let Radial { factor, by_r2 } = self.radial(r2);
        let (p1, p2, skew) = self.tangential();
        let value = DVec2::new(
            x * factor + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * factor + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * x * y * by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
        let dx = DVec2::new(factor + 2.0 * x * x * by_r2 + 2.0 * p1 * y + 6.0 * p2 * x, cross);
        let dy = DVec2::new(cross, factor + 2.0 * y * y * by_r2 + 6.0 * p1 * y + 2.0 * p2 * x);
        let shear = DMat2::from_cols(DVec2::X, DVec2::new(skew, 1.0));
        (shear * value, shear * DMat2::from_cols(dx, dy))
    }

    /// The model is one-to-one from the centre out to here: locally by the Jacobian's sign, and along the radius
    /// because a polynomial that has folded back and forth again would fool the sign alone.
    fn is_valid_at(&self, ideal: DVec2, jacobian: DMat2) -> bool {
        const RADIAL_CHECKS: usize = 8;
        if matches!(self, Self::None) {
            return true;
        }
        jacobian.determinant() > 0.0
            && self.radial(ideal.length_squared()).factor > 0.0
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

    fn lenses() -> Vec<Distortion> {
        vec![
            WARSAW_LIKE,
            Distortion::BrownAffine { k1: -0.04, k2: 0.02, k3: -0.004, k4: 1e-3, p1: 6e-4, p2: 5e-5, skew: 3e-4 },
            Distortion::Rational { k1: 0.3, k2: 0.05, k3: 0.001, k4: 0.32, k5: 0.07, k6: 0.002, p1: 1e-4, p2: -2e-4 },
            Distortion::Fisheye { k1: -0.02, k2: 0.004, k3: -0.001, k4: 2e-4 },
            Distortion::FisheyeSeries { k1: 0.0097, k2: -0.065, k3: 0.01 },
        ]
    }

    proptest! {
        #[test]
        fn undistort_inverts_distort_to_a_millionth_pixel(x in -0.9..0.9_f64, y in -0.7..0.7_f64) {
            // 1e-6 px at a focal length of 10,000 px.
            for lens in lenses() {
                let ideal = DVec2::new(x, y);
                let back = lens.undistort(lens.distort(ideal).unwrap()).unwrap();
                prop_assert!((back - ideal).length() < 1e-10, "{:?}", lens);
            }
        }

        #[test]
        fn the_jacobian_is_the_derivative(x in -0.9..0.9_f64, y in -0.7..0.7_f64) {
            let (at, h) = (DVec2::new(x, y), 1e-6);
            for lens in &lenses()[..3] {
                let (_, jacobian) = lens.distort_with_jacobian(at);
                for axis in [DVec2::X, DVec2::Y] {
                    let difference = (lens.distort_with_jacobian(at + h * axis).0
                        - lens.distort_with_jacobian(at - h * axis).0) / (2.0 * h);
                    prop_assert!((jacobian * axis - difference).length() < 1e-8, "{:?}", lens);
                }
            }
        }

        #[test]
        fn whatever_the_coefficients_a_pixel_that_comes_back_comes_back_right(
            k1 in -1.0..1.0_f64, k2 in -1.0..1.0_f64, k3 in -1.0..1.0_f64, u in -1.5..1.5_f64, v in -1.5..1.5_f64
        ) {
            let seen = DVec2::new(u, v);
            for lens in [
                Distortion::Brown { k1, k2, k3, p1: 1e-3, p2: -1e-3 },
                Distortion::Fisheye { k1, k2, k3, k4: 0.0 },
                Distortion::FisheyeSeries { k1, k2, k3 },
            ] {
                if let Some(ideal) = lens.undistort(seen) {
                    let again = lens.distort(ideal).unwrap();
                    prop_assert!((again - seen).length() < 1e-9, "{:?}", lens);
                }
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
