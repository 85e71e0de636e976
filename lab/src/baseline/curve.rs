//! How a view's prior grows with inverse depth, told by the ground.
//!
//! ```text
//! p = a + b·v + c·v²           p: prior's inverse depth,  v = 1 / R: inverse depth of the ground
//! r = α + β·x + γ·y            what of the residual a plane in the image explains: slow drift
//! ```
//!
//! The two are fitted one after the other. On level ground `v` is itself affine in `x` and `y`: a plane that took part in
//! the first fit would explain the ground alone, and the gain `b` would collapse. The curvature `c` is kept only where it
//! explains most of what a straight line leaves (a prior that is a monotone warp of the truth).
//!
//! What the scene does not model (trees, cars, buildings without a footprint) is nearer than the ground behind it, so
//! residuals have one heavy side: Tukey's biweight with the spread of the other side.

use sizeup_heights::stats;

/// Rounds of least squares with new weights.
const ROUNDS: usize = 12;
/// Samples below which a view cannot be calibrated.
const MIN_SAMPLES: usize = 50;
/// Cut-off of the biweight in standard deviations, on the near side and on the far side.
const CUT_OFF: [f64; 2] = [3.0, 4.7];
/// A curved fit is kept if the spread it leaves is at most this share of a straight line's.
const CURVED_SPREAD: f64 = 0.5;

/// A place on the ground as the prior sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    /// Inverse z-depth of the ground there, 1/m.
    pub v: f64,
    /// Prior, growing towards the camera.
    pub p: f64,
    /// Image column, −1 to 1 across the image.
    pub x: f64,
    /// Image row, −1 to 1 down the image.
    pub y: f64,
}

/// A view's curve from inverse depth to its prior, and the plane of its drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PriorCurve {
    /// `a`, `b`, `c` for `u = v / v_scale`.
    terms: [f64; 3],
    v_scale: f64,
    plane: [f64; 3],
    /// Largest `u` that the curve still grows to.
    u_limit: f64,
}

impl PriorCurve {
    /// `None` where there is too little to go by, or where the prior falls towards the camera.
    pub fn fit(samples: &[Sample]) -> Option<Self> {
        if samples.len() < MIN_SAMPLES {
            return None;
        }
        let v_scale = samples.iter().map(|s| s.v).sum::<f64>() / samples.len() as f64;
        let straight = robust(samples, |s| [1.0, s.v / v_scale, 0.0], 2, |s| s.p)?;
        let curved = robust(samples, |s| [1.0, s.v / v_scale, (s.v / v_scale).powi(2)], 3, |s| s.p);
        let u_max = samples.iter().map(|s| s.v / v_scale).fold(0.0, f64::max);
        let grows = |t: &[f64; 3], u: f64| t[1] + 2.0 * t[2] * u > 0.0;
        let u_min = samples.iter().map(|s| s.v / v_scale).fold(f64::INFINITY, f64::min);
        let fit = curved
            .filter(|f| f.spread < CURVED_SPREAD * straight.spread && grows(&f.terms, u_min) && grows(&f.terms, u_max))
            .unwrap_or(straight);
        if fit.terms[1] + 2.0 * fit.terms[2] <= 0.0 {
            return None;
        }
        let curve = Self {
            terms: fit.terms,
            v_scale,
            plane: [0.0; 3],
            u_limit: if fit.terms[2] < 0.0 { -fit.terms[1] / (2.0 * fit.terms[2]) } else { f64::INFINITY },
        };
        let plane = robust(samples, |s| [1.0, s.x, s.y], 3, |s| s.p - curve.prior_at(s.v))?;
        Some(Self { plane: plane.terms, ..curve })
    }

    fn prior_at(&self, v: f64) -> f64 {
        let u = v / self.v_scale;
        self.terms[0] + u * (self.terms[1] + u * self.terms[2])
    }

    /// z-depth, metres, that a prior value at an image position stands for; `None` beyond what the curve reaches.
    pub fn depth_m(&self, p: f64, x: f64, y: f64) -> Option<f64> {
        let p = p - self.plane[0] - self.plane[1] * x - self.plane[2] * y - self.terms[0];
        let [_, b, c] = self.terms;
        let u = if c == 0.0 {
            p / b
        } else {
            let root = b * b + 4.0 * c * p;
            if root < 0.0 {
                return None;
            }
            // Stable for small c of either sign.
            2.0 * p / (b + root.sqrt())
        };
        (u > 0.0 && u <= self.u_limit).then(|| 1.0 / (u * self.v_scale))
    }
}

struct CurveFit {
    terms: [f64; 3],
    /// Spread of the residuals on the far side.
    spread: f64,
}

/// Least squares with `n` of three basis functions, re-weighted.
fn robust(
    samples: &[Sample],
    basis: impl Fn(&Sample) -> [f64; 3],
    n: usize,
    value: impl Fn(&Sample) -> f64,
) -> Option<CurveFit> {
    let residual = |s: &Sample, terms: &[f64; 3]| {
        let b = basis(s);
        value(s) - (b[0] * terms[0] + b[1] * terms[1] + b[2] * terms[2])
    };
    let mut terms = least_squares(samples, &basis, n, &value, |_| 1.0)?;
    let mut spread = 0.0;
    for _ in 0..ROUNDS {
        spread = stats::far_side_sigma(samples.iter().map(|s| residual(s, &terms))).unwrap_or(0.0);
        if spread <= 0.0 {
            break;
        }
        let now = terms;
        let weight = |s: &Sample| stats::biweight(residual(s, &now), spread, CUT_OFF);
        terms = least_squares(samples, &basis, n, &value, weight)?;
    }
    Some(CurveFit { terms, spread })
}

fn least_squares(
    samples: &[Sample],
    basis: &impl Fn(&Sample) -> [f64; 3],
    n: usize,
    value: &impl Fn(&Sample) -> f64,
    weight: impl Fn(&Sample) -> f64,
) -> Option<[f64; 3]> {
    let mut normal = [[0.0; 4]; 3];
    for s in samples {
        let (b, k, y) = (basis(s), weight(s), value(s));
        for i in 0..n {
            for j in 0..n {
                normal[i][j] += k * b[i] * b[j];
            }
            normal[i][3] += k * b[i] * y;
        }
    }
    solve(normal, n)
}

/// Gauss and Jordan with pivoting; `None` for a singular system.
fn solve(mut rows: [[f64; 4]; 3], n: usize) -> Option<[f64; 3]> {
    let scale = (0..n).map(|i| rows[i][i].abs()).fold(0.0, f64::max);
    for col in 0..n {
        let pivot = (col..n).max_by(|&a, &b| rows[a][col].abs().total_cmp(&rows[b][col].abs()))?;
        if rows[pivot][col].abs() <= 1e-12 * scale {
            return None;
        }
        rows.swap(col, pivot);
        for row in (0..n).filter(|&row| row != col) {
            let factor = rows[row][col] / rows[col][col];
            let from = rows[col];
            rows[row].iter_mut().zip(from).for_each(|(to, from)| *to -= factor * from);
        }
    }
    let mut terms = [0.0; 3];
    for i in 0..n {
        terms[i] = rows[i][3] / rows[i][i];
    }
    Some(terms)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Level ground under a tilted camera: inverse depth is affine in the row.
    fn ground(p: impl Fn(f64, f64, f64) -> f64) -> Vec<Sample> {
        let place = |i: i32| (f64::from(i % 20) / 10.0 - 0.95, f64::from(i / 20) / 10.0 - 0.95);
        let sample = |(x, y): (f64, f64)| {
            let v = 0.005 * (1.0 + 0.3 * y);
            Sample { v, p: p(v, x, y), x, y }
        };
        (0..400).map(place).map(sample).collect()
    }

    #[test]
    fn an_affine_prior_lifts_exactly_and_the_plane_takes_no_gain() {
        let curve = PriorCurve::fit(&ground(|v, _, _| 3.0 + 40.0 * v)).unwrap();
        // A roof at 100 m in front of ground at 200 m.
        assert!((curve.depth_m(3.0 + 40.0 / 100.0, 0.2, 0.0).unwrap() - 100.0).abs() < 1e-6);
    }

    #[test]
    fn drift_across_the_view_is_taken_out() {
        let curve = PriorCurve::fit(&ground(|v, x, _| 3.0 + 40.0 * v + 0.02 * x)).unwrap();
        assert!((curve.depth_m(3.0 + 0.4 + 0.02 * 0.5, 0.5, 0.0).unwrap() - 100.0).abs() < 0.5);
    }

    #[test]
    fn a_monotone_warp_is_followed() {
        let warp = |v: f64| (200.0 * v).powf(1.5);
        let curve = PriorCurve::fit(&ground(|v, _, _| warp(v))).unwrap();
        assert!((curve.depth_m(warp(1.0 / 170.0), 0.0, 0.0).unwrap() - 170.0).abs() < 0.5);
    }

    #[test]
    fn trees_in_front_of_a_third_of_the_ground_change_little() {
        let mut samples = ground(|v, x, _| 3.0 + 40.0 * v + 1e-4 * (37.0 * x).sin());
        for s in samples.iter_mut().step_by(3) {
            s.p += 0.02;
        }
        let curve = PriorCurve::fit(&samples).unwrap();
        assert!((curve.depth_m(3.4, 0.0, 0.0).unwrap() - 100.0).abs() < 1.0);
    }

    #[test]
    fn a_prior_that_falls_towards_the_camera_is_refused() {
        assert_eq!(PriorCurve::fit(&ground(|v, _, _| 3.0 - 40.0 * v)), None);
        assert_eq!(PriorCurve::fit(&ground(|_, _, _| 3.0)[..40]), None);
    }
}
