//! The equidistant fisheye: an angle θ off the axis lands at radius `θ_d = θ (1 + c1 θ + c2 θ² + … + c8 θ⁸)`.
//!
//! `OpenCV`'s has the even powers only, Pix4D's all up to the third. Rays are kept as `(x, y, 1)`, so the half space in
//! front of the camera (θ < 90°) is its domain; within it the polynomial must keep rising. Sources: OpenCV, fisheye
//! module; Pix4D support, "How are the Internal and External Camera Parameters defined?".

use std::f64::consts::FRAC_PI_2;

use glam::DVec2;

/// Below this radius the ratio `θ_d / r` is 1 to machine precision.
const AXIS: f64 = 1e-9;
/// Steps of the inverse; bisection alone needs 53.
const MAX_STEPS: usize = 80;
/// Samples along θ that show the polynomial rising.
const RISING_CHECKS: usize = 16;

/// The coefficients `c1` to `c8`.
pub(super) type FisheyeCoefficients = [f64; 8];

/// `OpenCV`'s `k1` to `k4`.
pub(super) fn even([k1, k2, k3, k4]: [f64; 4]) -> FisheyeCoefficients {
    [0.0, k1, 0.0, k2, 0.0, k3, 0.0, k4]
}

/// `θ_d` and its derivative: Horner from the last term `c8 θ⁹`.
fn bend(series: FisheyeCoefficients, theta: f64) -> (f64, f64) {
    let (factor, slope) =
        series.iter().rev().fold((0.0, 0.0), |(factor, slope), c| (theta * (factor + c), theta * slope + factor + c));
    (theta * (1.0 + factor), 1.0 + factor + theta * slope)
}

fn is_rising_to(k: FisheyeCoefficients, theta: f64) -> bool {
    (1..=RISING_CHECKS).all(|i| bend(k, theta * i as f64 / RISING_CHECKS as f64).1 > 0.0)
}

pub(super) fn distort(k: FisheyeCoefficients, ideal: DVec2) -> Option<DVec2> {
    let r = ideal.length();
    if r < AXIS {
        return Some(ideal);
    }
    let theta = r.atan();
    is_rising_to(k, theta).then(|| ideal * (bend(k, theta).0 / r))
}

/// Newton's method kept inside a shrinking bracket, so that it cannot leave the domain.
pub(super) fn undistort(k: FisheyeCoefficients, distorted: DVec2) -> Option<DVec2> {
    let r_d = distorted.length();
    if r_d < AXIS {
        return Some(distorted);
    }
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    // The first sample past the target closes the bracket, so that a later fold cannot offer a second answer.
    for i in 1..=RISING_CHECKS {
        let theta = FRAC_PI_2 * i as f64 / RISING_CHECKS as f64;
        if bend(k, theta).0 >= r_d {
            high = theta;
            break;
        }
        low = theta;
    }
    if bend(k, high).0 < r_d {
        return None;
    }
    let mut theta = 0.5 * (low + high);
    for _ in 0..MAX_STEPS {
        let (value, slope) = bend(k, theta);
        if value < r_d {
            low = theta;
        } else {
            high = theta;
        }
        let step = theta - (value - r_d) / slope;
        let next = if step > low && step < high { step } else { 0.5 * (low + high) };
        let is_done = (next - theta).abs() < 1e-15;
        theta = next;
        if is_done {
            break;
        }
    }
    (theta < FRAC_PI_2 && is_rising_to(k, theta)).then(|| distorted * (theta.tan() / r_d))
}
