//! How near a rendered picture is to a photo, over some of its pixels.
//!
//! ```text
//! PSNR = 10 log10(255² / mean squared difference of the three colours)
//! SSIM = mean of (2 μ_a μ_b + C1)(2 σ_ab + C2) / ((μ_a² + μ_b² + C1)(σ_a² + σ_b² + C2)),   C1 = (0.01 · 255)², C2 = (0.03 · 255)²
//! ```
//!
//! Means and variances of the grey picture are Gaussian-weighted (σ 1.5 pixels, 11 × 11) over those pixels of the window that count.
//!
//! Source: Wang, Bovik, Sheikh, Simoncelli, "Image Quality Assessment", IEEE TIP 13(4), 2004.

use image::RgbImage;
use rayon::prelude::*;

/// Radius of the window, pixels, and width of its Gaussian.
const RADIUS: i64 = 5;
const SIGMA_PX: f64 = 1.5;
const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);

/// Nearness of two pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Structural similarity, 1 for the same picture.
    pub ssim: f64,
    /// Mean of the squared differences of all colours, 0 to 255².
    pub mean_square: f64,
    /// Pixels that were compared.
    pub n_pixels: usize,
}

impl Similarity {
    /// Peak signal-to-noise ratio, decibels.
    #[must_use]
    pub fn psnr_db(&self) -> f64 {
        10.0 * (255.0 * 255.0 / self.mean_square.max(f64::MIN_POSITIVE)).log10()
    }
}

/// Nearness of two pictures of one size over the pixels that count, given row by row; `None` without any.
///
/// # Panics
/// If the sizes differ.
#[must_use]
pub fn similarity(a: &RgbImage, b: &RgbImage, counts: &[bool]) -> Option<Similarity> {
    assert_eq!(a.dimensions(), b.dimensions(), "pictures of one size");
    let (width, height) = (i64::from(a.width()), i64::from(a.height()));
    let grey = |picture: &RgbImage| -> Vec<f64> {
        let of = |p: &image::Rgb<u8>| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]);
        picture.pixels().map(of).collect()
    };
    let (grey_a, grey_b) = (grey(a), grey(b));
    let weight = |d: i64| (-0.5 * (d as f64 / SIGMA_PX).powi(2)).exp();
    let ssim_at = |i: usize| {
        let (x, y) = (i as i64 % width, i as i64 / width);
        let (mut n, mut sums) = (0.0, [0.0; 5]);
        for v in (y - RADIUS).max(0)..(y + RADIUS + 1).min(height) {
            for u in (x - RADIUS).max(0)..(x + RADIUS + 1).min(width) {
                let at = (v * width + u) as usize;
                if counts[at] {
                    let (w, p, q) = (weight(u - x) * weight(v - y), grey_a[at], grey_b[at]);
                    n += w;
                    [p, q, p * p, q * q, p * q].iter().zip(&mut sums).for_each(|(v, sum)| *sum += w * v);
                }
            }
        }
        let [p, q, pp, qq, pq] = sums.map(|sum| sum / n);
        let (var_p, var_q, cov) = (pp - p * p, qq - q * q, pq - p * q);
        (2.0 * p * q + C1) * (2.0 * cov + C2) / ((p * p + q * q + C1) * (var_p + var_q + C2))
    };
    let counted: Vec<usize> = (0..counts.len()).filter(|&i| counts[i]).collect();
    let values: Vec<f64> = counted.par_iter().map(|&i| ssim_at(i)).collect();
    let n_pixels = counted.len();
    let squares = counted.iter().map(|&i| {
        let at = (i as i64 % width, i as i64 / width);
        let of = |picture: &RgbImage| picture.get_pixel(at.0 as u32, at.1 as u32).0.map(f64::from);
        of(a).iter().zip(of(b)).map(|(p, q)| (p - q).powi(2)).sum::<f64>()
    });
    let mean_square = squares.sum::<f64>() / (3.0 * n_pixels.max(1) as f64);
    let ssim = values.iter().sum::<f64>() / n_pixels.max(1) as f64;
    (n_pixels > 0).then_some(Similarity { ssim, mean_square, n_pixels })
}
