//! One gain per photo, so that surfaces which photos share have the same brightness in all of them.
//!
//! ```text
//! min over g:  Σ over pairs (a, b) on a surface  n · (g_a − g_b + r_ab)²  +  w · Σ g²
//! ```
//!
//! `g`: logarithm of a photo's gain; `r_ab`: median over the `n` shared cells of the logarithm of a's brightness by b's. The last
//! term keeps the town as bright as its photos are.

use super::median_or;
use super::views::Candidate;
use super::warp::shared;
use sizeup_geo::files::{FileError, UnnamedFile};

/// Weight of a gain's own size, in shared cells: small beside the cells of one wall.
const OWN_WEIGHT: f64 = 1.0;
/// Sweeps of Gauss and Seidel's method; a first choice.
const N_SWEEPS: usize = 50;
/// Darkest cell that is compared, of 255: below it the logarithm is noise.
const DARKEST: f32 = 8.0;

/// Factors of the photos' colours, one per view.
pub(super) fn solve(n_views: usize, candidates: &[Vec<Candidate>], file: &UnnamedFile) -> Result<Vec<f32>, FileError> {
    let mut pairs: Vec<Vec<(usize, f64, f64)>> = vec![Vec::new(); n_views];
    for of_surface in candidates {
        let brightness = |candidate: &Candidate| {
            Ok(candidate.means(file)?.iter().map(|mean| mean.iter().sum::<f32>() / 3.0).collect())
        };
        let brightness: Vec<Vec<f32>> = of_surface.iter().map(brightness).collect::<Result<_, FileError>>()?;
        for (i, (a, of_a)) in of_surface.iter().zip(&brightness).enumerate() {
            for (b, of_b) in of_surface.iter().zip(&brightness).skip(i + 1) {
                let ratios: Vec<f64> = shared(a, b).filter_map(|cell| ratio(of_a[cell], of_b[cell])).collect();
                let (n, ratio) = (ratios.len() as f64, median_or(&ratios, 0.0));
                pairs[a.view].push((b.view, n, ratio));
                pairs[b.view].push((a.view, n, -ratio));
            }
        }
    }
    let mut gains = vec![0.0_f64; n_views];
    for _ in 0..N_SWEEPS {
        for view in 0..n_views {
            let (weight, sum) = pairs[view].iter().fold((OWN_WEIGHT, 0.0), |(weight, sum), &(other, n, ratio)| {
                (weight + n, sum + n * (gains[other] - ratio))
            });
            gains[view] = sum / weight;
        }
    }
    Ok(gains.iter().map(|gain| gain.exp() as f32).collect())
}

/// Logarithm of one photo's brightness of a cell by another's.
fn ratio(a: f32, b: f32) -> Option<f64> {
    (a > DARKEST && b > DARKEST).then(|| f64::from(a / b).ln())
}
