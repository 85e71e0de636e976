//! Image filters of the corruption model. `NaN` = no value: it stays where it is and lends nothing to its neighbours.

use rand_chacha::ChaCha8Rng;

use sizeup_heights::raster::Raster;

use super::chance::{between, normal};

/// Waves in a smooth random field.
const N_WAVES: usize = 8;
/// A Gaussian is cut off after so many standard deviations.
const CUT_OFF: f64 = 3.0;

/// Gaussian blur with a standard deviation in pixels.
pub(super) fn blurred(map: &Raster<f32>, sd_px: f64) -> Raster<f32> {
    let reach = (CUT_OFF * sd_px).ceil() as isize;
    let kernel: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sd_px).powi(2)).exp() as f32).collect();
    let rows = blurred_along(map, &kernel, (1, 0));
    blurred_along(&rows, &kernel, (0, 1))
}

fn blurred_along(map: &Raster<f32>, kernel: &[f32], (dx, dy): (isize, isize)) -> Raster<f32> {
    let (width, height) = (map.width().cast_signed(), map.height().cast_signed());
    let reach = (kernel.len() / 2).cast_signed();
    let mut out = map.clone();
    for row in 0..height {
        for col in 0..width {
            if map[(col as usize, row as usize)].is_nan() {
                continue;
            }
            let (mut sum, mut weight) = (0.0, 0.0);
            for k in -reach..=reach {
                let (c, r) = (col + k * dx, row + k * dy);
                if c < 0 || r < 0 || c >= width || r >= height {
                    continue;
                }
                let value = map[(c as usize, r as usize)];
                if !value.is_nan() {
                    let w = kernel[(k + reach) as usize];
                    sum += w * value;
                    weight += w;
                }
            }
            out[(col as usize, row as usize)] = sum / weight;
        }
    }
    out
}

/// The highest value within a disc: what stands out grows by `radius_px` (a fraction grows that share of pixels'
/// directions only, as the disc on the pixel grid has it).
pub(super) fn grown(map: &Raster<f32>, radius_px: f64) -> Raster<f32> {
    let reach = radius_px.ceil() as isize;
    let disc: Vec<(isize, isize)> = (-reach..=reach)
        .flat_map(|y| (-reach..=reach).map(move |x| (x, y)))
        .filter(|&(x, y)| (x as f64).hypot(y as f64) <= radius_px)
        .collect();
    let mut out = map.clone();
    for row in 0..map.height().cast_signed() {
        for col in 0..map.width().cast_signed() {
            let around = disc.iter().filter_map(|&(x, y)| {
                let (c, r) = (usize::try_from(col + x).ok()?, usize::try_from(row + y).ok()?);
                map.get(c, r).copied()
            });
            out[(col as usize, row as usize)] = around.fold(f32::NEG_INFINITY, f32::max);
        }
    }
    out
}

/// A smooth random field with mean 0 and standard deviation 1 over the image, made of waves of the given lengths in
/// pixels.
pub(super) fn smooth_field(width: usize, height: usize, waves_px: (f64, f64), rng: &mut ChaCha8Rng) -> Raster<f32> {
    let waves: Vec<[f64; 4]> = (0..N_WAVES)
        .map(|_| {
            let direction = between(rng, 0.0, std::f64::consts::TAU);
            let k = std::f64::consts::TAU / between(rng, waves_px.0, waves_px.1);
            [k * direction.cos(), k * direction.sin(), between(rng, 0.0, std::f64::consts::TAU), normal(rng)]
        })
        .collect();
    let mut values = vec![0.0; width * height];
    for [kx, ky, phase, a] in waves {
        // sin(u + v) from tables of both: two multiplications per pixel in place of a sine.
        let columns: Vec<(f64, f64)> = (0..width).map(|x| (kx * x as f64).sin_cos()).collect();
        for (y, row) in values.chunks_exact_mut(width).enumerate() {
            let (sin_row, cos_row) = (ky * y as f64 + phase).sin_cos();
            for (value, (sin_col, cos_col)) in row.iter_mut().zip(&columns) {
                *value += a * (sin_col * cos_row + cos_col * sin_row);
            }
        }
    }
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt().max(f64::MIN_POSITIVE);
    let unit = values.iter().map(|v| ((v - mean) / sd) as f32).collect();
    Raster::from_vec(width, height, unit).expect("one value per pixel")
}

/// Moves everything by a smooth random field (nearest pixel, so edges stay sharp).
pub(super) fn warped(map: &Raster<f32>, sd_px: f64, waves_px: (f64, f64), rng: &mut ChaCha8Rng) -> Raster<f32> {
    let (width, height) = (map.width(), map.height());
    let [dx, dy] = [(); 2].map(|()| smooth_field(width, height, waves_px, rng));
    let mut out = map.clone();
    for row in 0..height {
        for col in 0..width {
            let moved = |at: usize, by: f32, n: usize| {
                (at as f64 + sd_px * f64::from(by)).round().clamp(0.0, (n - 1) as f64) as usize
            };
            let from = (moved(col, dx[(col, row)], width), moved(row, dy[(col, row)], height));
            // The sky's edge stays, so that the map keeps its holes.
            let value = map[from];
            if !out[(col, row)].is_nan() && !value.is_nan() {
                out[(col, row)] = value;
            }
        }
    }
    out
}
